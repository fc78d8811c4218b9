//! The mesh as PLY with Mitsuba's names: binary little endian, float32, object frame.

use std::io::{self, Write};

use crate::mesh::Mesh;

/// A vertex property of `D` components, known in Mitsuba as `vertex_NAME`.
pub(super) struct Attribute {
    /// NAME.
    pub(super) name: &'static str,
    /// Components a vertex, 1 or 3.
    pub(super) components: usize,
    /// `[V * components]`.
    pub(super) samples: Vec<f32>,
}

/// Writes the mesh; normals only where it is smooth, UVs where it has them.
///
/// Mitsuba reads `s t` with row 0 of an image at `t = 0`, as turnlight does, and gathers properties
/// `NAME_0 NAME_1 NAME_2` into one attribute.
pub(super) fn write(
    file: &mut impl Write,
    mesh: &Mesh,
    attributes: &[Attribute],
) -> io::Result<()> {
    let vertices = mesh.positions.len();
    writeln!(
        file,
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}"
    )?;
    let uvs = mesh.uvs.as_ref();
    let mut names: Vec<String> = ["x", "y", "z"].map(String::from).to_vec();
    if mesh.smooth {
        names.extend(["nx", "ny", "nz"].map(String::from));
    }
    if uvs.is_some() {
        names.extend(["s", "t"].map(String::from));
    }
    for attribute in attributes {
        names.extend((0..attribute.components).map(|i| format!("{}_{i}", attribute.name)));
    }
    for name in &names {
        writeln!(file, "property float {name}")?;
    }
    writeln!(
        file,
        "element face {}\nproperty list uchar int vertex_indices\nend_header",
        mesh.triangles.len()
    )?;

    let mut row: Vec<f32> = Vec::with_capacity(names.len());
    for v in 0..vertices {
        row.clear();
        let position = mesh.origin + mesh.scale * mesh.positions[v].as_dvec3();
        row.extend(position.as_vec3().to_array());
        if mesh.smooth {
            row.extend(mesh.normals[v].to_array());
        }
        row.extend(uvs.map(|uvs| uvs[v].to_array()).into_iter().flatten());
        for attribute in attributes {
            let n = attribute.components;
            row.extend(&attribute.samples[n * v..n * (v + 1)]);
        }
        row.iter()
            .try_for_each(|x| file.write_all(&x.to_le_bytes()))?;
    }
    for triangle in &mesh.triangles {
        file.write_all(&[3])?;
        triangle
            .iter()
            .try_for_each(|index| file.write_all(&index.to_le_bytes()))?;
    }
    Ok(())
}
