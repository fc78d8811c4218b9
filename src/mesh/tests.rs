//! Laws of loading, by way of files in every format.

use std::path::{Path, PathBuf};

use super::*;

mod defects;
mod formats;
mod fuzz;

/// A folder with files of one surface in every format, named `shape.*`.
fn written(surface: &Surface) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (extension, bytes) in encoded(surface) {
        std::fs::write(folder.path().join(format!("shape.{extension}")), bytes).unwrap();
    }
    folder
}

/// The bytes of one surface in every format, by extension; glTF carries its buffer inside.
fn encoded(surface: &Surface) -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("ply", ply_text(surface).into_bytes()),
        ("obj", obj_text(surface).into_bytes()),
        ("stl", stl_binary(surface)),
        ("STL", stl_text(surface).into_bytes()),
        ("glb", glb(surface)),
    ]
}

fn ply_text(surface: &Surface) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex {}\n\
         property double x\nproperty double y\nproperty double z\n",
        surface.positions.len()
    );
    if surface.normals.is_some() {
        text += "property float nx\nproperty float ny\nproperty float nz\n";
    }
    if surface.uvs.is_some() {
        text += "property float u\nproperty float v\n";
    }
    text += &format!(
        "element face {}\nproperty list uchar int vertex_index\nend_header\n",
        surface.triangles.len()
    );
    for (i, p) in surface.positions.iter().enumerate() {
        text += &format!("{:?} {:?} {:?}", p.x, p.y, p.z);
        if let Some(n) = surface.normals.as_ref().map(|n| n[i]) {
            text += &format!(" {:?} {:?} {:?}", n.x, n.y, n.z);
        }
        if let Some(uv) = surface.uvs.as_ref().map(|uvs| uvs[i]) {
            text += &format!(" {:?} {:?}", uv.x, 1.0 - uv.y);
        }
        text += "\n";
    }
    for [a, b, c] in &surface.triangles {
        text += &format!("3 {a} {b} {c}\n");
    }
    text
}

fn obj_text(surface: &Surface) -> String {
    let mut text = String::from("# made by hand\no shape\n");
    for p in &surface.positions {
        text += &format!("v {:?} {:?} {:?}\n", p.x, p.y, p.z);
    }
    for uv in surface.uvs.iter().flatten() {
        text += &format!("vt {:?} {:?}\n", uv.x, 1.0 - uv.y);
    }
    for n in surface.normals.iter().flatten() {
        text += &format!("vn {:?} {:?} {:?}\n", n.x, n.y, n.z);
    }
    for triangle in &surface.triangles {
        text += "f";
        for i in triangle.map(|v| v + 1) {
            text += &match (&surface.uvs, &surface.normals) {
                (Some(_), Some(_)) => format!(" {i}/{i}/{i}"),
                (Some(_), None) => format!(" {i}/{i}"),
                (None, Some(_)) => format!(" {i}//{i}"),
                (None, None) => format!(" {i}"),
            };
        }
        text += "\n";
    }
    text
}

fn stl_binary(surface: &Surface) -> Vec<u8> {
    let mut bytes = b"solid although binary".to_vec();
    bytes.resize(80, b' ');
    bytes.extend((surface.triangles.len() as u32).to_le_bytes());
    for triangle in &surface.triangles {
        bytes.extend([0; 12]);
        for p in triangle.map(|v| surface.positions[v as usize].as_vec3()) {
            bytes.extend(p.to_array().into_iter().flat_map(f32::to_le_bytes));
        }
        bytes.extend([0; 2]);
    }
    bytes
}

fn stl_text(surface: &Surface) -> String {
    let mut text = String::from("solid\n");
    for triangle in &surface.triangles {
        text += " facet normal 0 0 0\n  outer loop\n";
        for p in triangle.map(|v| surface.positions[v as usize]) {
            text += &format!("   vertex {:e} {:e} {:e}\n", p.x, p.y, p.z);
        }
        text += "  endloop\n endfacet\n";
    }
    text + "endsolid\n"
}

/// A packed glTF file whose node moves the shape there and back.
fn glb(surface: &Surface) -> Vec<u8> {
    let count = surface.positions.len();
    let mut bin = Vec::new();
    let mut views = Vec::new();
    let mut view = |bin: &mut Vec<u8>, bytes: Vec<u8>| {
        views.push(format!(
            r#"{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#,
            bin.len(),
            bytes.len()
        ));
        bin.extend(bytes);
        views.len() - 1
    };
    let floats = |values: Vec<f32>| values.into_iter().flat_map(f32::to_le_bytes).collect();
    // Stored mirrored in x and moved by one in y; the node's transform undoes both.
    let flat = |p: &DVec3| [-p.x as f32, p.y as f32 - 1.0, p.z as f32];
    view(
        &mut bin,
        floats(surface.positions.iter().flat_map(flat).collect()),
    );
    let mut accessors = vec![format!(
        r#"{{"bufferView":0,"componentType":5126,"count":{count},"type":"VEC3","min":[-9,-9,-9],"max":[9,9,9]}}"#
    )];
    let indices = surface.triangles.iter().flat_map(|[a, b, c]| [*a, *c, *b]);
    let bytes = indices.flat_map(u32::to_le_bytes).collect();
    view(&mut bin, bytes);
    accessors.push(format!(
        r#"{{"bufferView":1,"componentType":5125,"count":{},"type":"SCALAR"}}"#,
        3 * surface.triangles.len()
    ));
    let mut attributes = String::from(r#""POSITION":0"#);
    if let Some(normals) = &surface.normals {
        let flat = |n: &Vec3| [-n.x, n.y, n.z];
        let index = view(&mut bin, floats(normals.iter().flat_map(flat).collect()));
        attributes += &format!(r#","NORMAL":{}"#, accessors.len());
        accessors.push(format!(
            r#"{{"bufferView":{index},"componentType":5126,"count":{count},"type":"VEC3"}}"#
        ));
    }
    if let Some(uvs) = &surface.uvs {
        let index = view(
            &mut bin,
            floats(uvs.iter().flat_map(|uv| uv.to_array()).collect()),
        );
        attributes += &format!(r#","TEXCOORD_0":{}"#, accessors.len());
        accessors.push(format!(
            r#"{{"bufferView":{index},"componentType":5126,"count":{count},"type":"VEC2"}}"#
        ));
    }
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
        "nodes":[{{"translation":[0,1,0],"children":[1]}},{{"scale":[-1,1,1],"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{{attributes}}},"indices":1}}]}}],
        "accessors":[{}],"bufferViews":[{}],"buffers":[{{"byteLength":{}}}]}}"#,
        accessors.join(","),
        views.join(","),
        bin.len()
    );
    let mut json = json.into_bytes();
    while json.len() % 4 != 0 {
        json.push(b' ');
    }
    let mut bytes = b"glTF".to_vec();
    bytes.extend(2u32.to_le_bytes());
    bytes.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", bin)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

fn load(path: &Path) -> Result<(Mesh, MeshReport), MeshError> {
    Mesh::load(path, &Similarity::default(), LoadOptions::default())
}

fn from_surface(surface: Surface) -> Result<(Mesh, MeshReport), MeshError> {
    let place = Similarity::default();
    Mesh::from_surface(
        surface,
        &place,
        LoadOptions::default(),
        Path::new("test surface"),
    )
}

/// Corners of all triangles, object frame.
fn corners(mesh: &Mesh) -> Vec<DVec3> {
    let flat = mesh.triangles.as_flattened();
    flat.iter()
        .map(|&v| mesh.to_object(mesh.positions[v as usize]))
        .collect()
}

/// What every mesh must satisfy, however bad its file.
fn assert_sound(mesh: &Mesh) {
    assert!(!mesh.triangles.is_empty());
    assert!(
        mesh.triangles
            .as_flattened()
            .iter()
            .all(|&v| (v as usize) < mesh.positions.len())
    );
    assert!(
        mesh.positions
            .iter()
            .all(|p| p.is_finite() && p.abs().max_element() <= 1.0)
    );
    assert!(
        mesh.normals.iter().all(|n| n.is_normalized()),
        "normals are unit vectors"
    );
    assert!(mesh.scale > 0.0 && mesh.scale.is_finite() && mesh.origin.is_finite());
    for triangle in 0..mesh.triangles.len() as u32 {
        assert!(
            mesh.geometric_normal(triangle).is_normalized(),
            "triangle {triangle} has an area"
        );
    }
    assert_eq!(mesh.normals.len(), mesh.positions.len());
    assert!(mesh.uvs.iter().all(|uvs| uvs.len() == mesh.positions.len()));
    assert!(
        mesh.attributes
            .values()
            .all(|values| values.len() == mesh.positions.len())
    );
}

/// A tetrahedron whose faces look outwards.
fn tetrahedron() -> Surface {
    Surface {
        positions: vec![
            DVec3::new(1.0, 1.0, 1.0),
            DVec3::new(1.0, -1.0, -1.0),
            DVec3::new(-1.0, 1.0, -1.0),
            DVec3::new(-1.0, -1.0, 1.0),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]],
        ..Surface::default()
    }
}

/// A mesh of the shared test data, if it is on this machine.
fn shared(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()?
        .join("shared/data")
        .join(name);
    if !path.exists() {
        println!("skipped: shared/data/{name} is not here");
        return None;
    }
    Some(path)
}
