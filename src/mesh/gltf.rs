//! glTF 2.0, as JSON with buffers beside it or inside it (`.gltf`) or packed (`.glb`).
//!
//! All triangles of the default scene are concatenated, each placed by its nodes' transforms. The
//! `gltf` crate reads the JSON and checks its references; buffers and accessors are read here,
//! since the crate's own readers panic on accessors that reach beyond their buffer.

use std::path::Path;

use glam::{DMat3, DMat4, DQuat, DVec3, Vec2, Vec3};
use gltf::mesh::Mode;
use gltf::{Document, Gltf, Node, Primitive, Semantic};

use super::Surface;
use super::error::Fault;

mod accessor;

/// Required extensions that change nothing about geometry, by prefix.
const HARMLESS_EXTENSIONS: [&str; 6] = [
    "KHR_materials_",
    "KHR_texture_",
    "KHR_lights_",
    "EXT_texture_",
    "KHR_mesh_quantization",
    "KHR_animation_",
];

/// Vertices of a scene in which a few nodes repeat a large mesh, above which memory would run out.
const MOST_VERTICES: usize = 1 << 28;

/// Reads a glTF file; `folder` is where its buffers are looked for.
pub(super) fn read(bytes: &[u8], folder: Option<&Path>) -> Result<Surface, Fault> {
    let (document, blob) = parse(bytes)?;
    let buffers = accessor::load_buffers(&document, blob, folder)?;
    let scene = document
        .default_scene()
        .or_else(|| document.scenes().next())
        .ok_or_else(|| Fault::new("scenes", "there is no scene; export one"))?;

    // Walk down the nodes; a node may be reached once, or the walk would not end.
    let mut surface = Surface::default();
    let mut reached = vec![false; document.nodes().len()];
    let mut open: Vec<(Node<'_>, DMat4)> =
        scene.nodes().map(|node| (node, DMat4::IDENTITY)).collect();
    open.reverse();
    while let Some((node, file_from_parent)) = open.pop() {
        if std::mem::replace(&mut reached[node.index()], true) {
            return Err(Fault::new(
                format!("nodes[{}]", node.index()),
                "is a child twice, or its own ancestor; the file is invalid, export it again",
            ));
        }
        let file_from_node = file_from_parent * parent_from_node(&node);
        for primitive in node.mesh().iter().flat_map(|mesh| mesh.primitives()) {
            let field = format!(
                "nodes[{}] primitive {}{}",
                node.index(),
                primitive.index(),
                node.name()
                    .map(|name| format!(" ({name})"))
                    .unwrap_or_default()
            );
            append(&mut surface, &primitive, &buffers, &file_from_node)
                .map_err(|problem| Fault::new(field, problem))?;
        }
        let first = open.len();
        open.extend(node.children().map(|child| (child, file_from_node)));
        open[first..].reverse();
    }
    Ok(surface)
}

/// The checked JSON, and the binary part of a packed file.
fn parse(bytes: &[u8]) -> Result<(Document, Option<Vec<u8>>), Fault> {
    // The crate subtracts the header's 12 bytes from its length without looking.
    if bytes.starts_with(b"glTF") {
        let length = bytes
            .get(8..12)
            .map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        if length.is_none_or(|length| length < 12 || length as usize > bytes.len()) {
            return Err(Fault::new(
                "header",
                format!(
                    "announces more than the file's {} bytes: it is truncated",
                    bytes.len()
                ),
            ));
        }
    }
    let fault = |error: gltf::Error| {
        Fault::new(
            "glTF",
            format!("{error}; the file is truncated or not valid glTF 2.0"),
        )
    };
    let Gltf { document, blob } = Gltf::from_slice_without_validation(bytes).map_err(fault)?;
    let mut json = document.into_json();
    for required in std::mem::take(&mut json.extensions_required) {
        if !HARMLESS_EXTENSIONS
            .iter()
            .any(|prefix| required.starts_with(prefix))
        {
            return Err(Fault::new(
                "extensionsRequired",
                format!("`{required}` is not supported; export without mesh compression"),
            ));
        }
    }
    // The crate's validation looks up POSITION before it has checked that index.
    let accessors = json.accessors.len();
    for (mesh, primitive) in json.meshes.iter().enumerate().flat_map(|(mesh, content)| {
        content
            .primitives
            .iter()
            .map(move |primitive| (mesh, primitive))
    }) {
        if let Some(index) = primitive
            .attributes
            .values()
            .find(|i| i.value() >= accessors)
        {
            return Err(Fault::new(
                format!("meshes[{mesh}]"),
                format!("accessor {index}: the file has {accessors}; export it again"),
            ));
        }
    }
    Ok((Document::from_json(json).map_err(fault)?, blob))
}

fn parent_from_node(node: &Node<'_>) -> DMat4 {
    use gltf::scene::Transform;
    match node.transform() {
        Transform::Matrix { matrix } => {
            DMat4::from_cols_array_2d(&matrix.map(|column| column.map(f64::from)))
        }
        Transform::Decomposed {
            translation,
            rotation,
            scale,
        } => {
            let rotation = DQuat::from_array(rotation.map(f64::from));
            DMat4::from_scale_rotation_translation(
                DVec3::from(scale.map(f64::from)),
                if rotation.length() > 1e-6 {
                    rotation.normalize()
                } else {
                    DQuat::IDENTITY
                },
                DVec3::from(translation.map(f64::from)),
            )
        }
    }
}

/// Adds one primitive's triangles; says what is wrong with it.
fn append(
    surface: &mut Surface,
    primitive: &Primitive<'_>,
    buffers: &[Vec<u8>],
    file_from_node: &DMat4,
) -> Result<(), String> {
    let mode = primitive.mode();
    if !matches!(
        mode,
        Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan
    ) {
        return Ok(()); // points and lines have no surface
    }
    let read = |semantic: &Semantic, components: usize| -> Result<Option<Vec<f64>>, String> {
        let Some(accessor) = primitive.get(semantic) else {
            return Ok(None);
        };
        let values = accessor::numbers(&accessor, components, buffers)
            .map_err(|problem| format!("{}: {problem}", semantic.to_string()))?;
        Ok(Some(values))
    };

    // Positions first: they say how many vertices there are.
    let positions = read(&Semantic::Positions, 3)?.ok_or("attribute POSITION is missing")?;
    let before = surface.positions.len();
    let count = positions.len() / 3;
    if before + count > MOST_VERTICES {
        return Err(format!(
            "more than {MOST_VERTICES} vertices; reduce the scene"
        ));
    }
    let place = |p: &[f64]| file_from_node.transform_point3(DVec3::from_slice(p));
    surface
        .positions
        .extend(positions.chunks_exact(3).map(place));

    // Normals go by the inverse transpose. A part without them gets computed ones.
    let node_from_file = DMat3::from_mat4(*file_from_node).inverse();
    let turn = |n: &[f64]| (node_from_file.transpose() * DVec3::from_slice(n)).as_vec3();
    let normals: Option<Vec<Vec3>> =
        read(&Semantic::Normals, 3)?.map(|n| n.chunks_exact(3).map(turn).collect());
    extend(&mut surface.normals, normals, before, count, Vec3::ZERO)?;

    // glTF's v points down already.
    let uvs = read(&Semantic::TexCoords(0), 2)?;
    let uvs: Option<Vec<Vec2>> = uvs.map(|uvs| {
        uvs.chunks_exact(2)
            .map(|uv| Vec2::new(uv[0] as f32, uv[1] as f32))
            .collect()
    });
    extend(&mut surface.uvs, uvs, before, count, Vec2::NAN)?;

    let indices: Vec<u32> = match primitive.indices() {
        Some(accessor) => accessor::numbers(&accessor, 1, buffers)
            .map_err(|problem| format!("indices: {problem}"))?
            .into_iter()
            .map(|index| index as u32)
            .collect(),
        None => (0..count as u32).collect(),
    };
    if let Some((place, index)) = indices
        .iter()
        .enumerate()
        .find(|(_, i)| **i as usize >= count)
    {
        return Err(format!(
            "face {}: index {index}: the primitive has {count} vertices; export it again",
            place / 3
        ));
    }
    let corners: Vec<[u32; 3]> = match mode {
        Mode::Triangles => indices
            .chunks_exact(3)
            .map(|t| [t[0], t[1], t[2]])
            .collect(),
        Mode::TriangleStrip => indices
            .windows(3)
            .enumerate()
            .map(|(i, t)| {
                if i % 2 == 0 {
                    [t[0], t[1], t[2]]
                } else {
                    [t[1], t[0], t[2]]
                }
            })
            .collect(),
        _ => indices
            .windows(2)
            .skip(1)
            .map(|t| [indices[0], t[0], t[1]])
            .collect(),
    };
    // A node that mirrors turns the winding over.
    let mirrored = file_from_node.determinant() < 0.0;
    let offset = before as u32;
    surface
        .triangles
        .extend(corners.into_iter().map(|[a, b, c]| {
            if mirrored {
                [a, c, b].map(|v| v + offset)
            } else {
                [a, b, c].map(|v| v + offset)
            }
        }));
    Ok(())
}

/// Appends one part's values, filling the parts that have none with `absent`.
fn extend<T: Copy>(
    all: &mut Option<Vec<T>>,
    part: Option<Vec<T>>,
    before: usize,
    count: usize,
    absent: T,
) -> Result<(), String> {
    match (all.as_mut(), part) {
        (_, Some(part)) if part.len() != count => {
            return Err(format!(
                "{} values for {count} vertices; export it again",
                part.len()
            ));
        }
        (Some(all), Some(part)) => all.extend(part),
        (Some(all), None) => all.resize(before + count, absent),
        (None, Some(part)) => {
            let mut filled = vec![absent; before];
            filled.extend(part);
            *all = Some(filled);
        }
        (None, None) => {}
    }
    Ok(())
}
