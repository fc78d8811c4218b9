//! Writing a mesh as binary little-endian PLY, from which loading gives the same mesh again.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::ply::UV_NAMES;
use super::{Mesh, MeshError};

/// Distance from the origin, in mesh units, above which coordinates are written as doubles.
///
/// In floats the rounding error is at most 6e-8 (4 + 1) = 3e-7 mesh units at this distance, no more
/// than the mesh's own rounding.
const FLOAT_DISTANCE: f64 = 4.0;

/// Names that loading would not give back as attributes.
const RESERVED: [&str; 6] = ["x", "y", "z", "nx", "ny", "nz"];

/// Writes `mesh` in object coordinates to `path`, which appears complete or not at all.
///
/// A flat mesh is written without normals; load it with [`super::LoadOptions::flat`].
///
/// # Errors
///
/// If the folder cannot be written, or an attribute's name is reserved or not one printable word.
pub fn write_ply(path: &Path, mesh: &Mesh) -> Result<(), MeshError> {
    let unfit = |name: &&String| {
        name.is_empty()
            || !name.chars().all(|c| c.is_ascii_graphic())
            || RESERVED.contains(&name.as_str())
            || UV_NAMES.as_flattened().contains(&name.as_str())
    };
    if let Some(name) = mesh.attributes.keys().find(unfit) {
        return Err(MeshError::AttributeName {
            path: path.to_path_buf(),
            name: name.clone(),
        });
    }

    // Written beside its place and then moved there, so that nobody sees half a file.
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}.part", std::process::id()));
    let part = path.with_file_name(name);
    let written = write_contents(&part, mesh).and_then(|()| fs::rename(&part, path));
    written.map_err(|source| {
        // The part may not exist; the first error is the one to report.
        let _ = fs::remove_file(&part);
        MeshError::Write {
            path: path.to_path_buf(),
            source,
        }
    })
}

fn write_contents(path: &Path, mesh: &Mesh) -> io::Result<()> {
    let mut out = BufWriter::new(File::create(path)?);
    let far = mesh.origin.abs().max_element() > FLOAT_DISTANCE * mesh.scale;
    // Floats hold no more than 1e38 and lose digits below 1e-38.
    let wide = far || !(1e-30..1e30).contains(&mesh.scale);
    let uvs = mesh.uvs.as_deref();

    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    writeln!(out, "element vertex {}", mesh.positions.len())?;
    for axis in ["x", "y", "z"] {
        writeln!(
            out,
            "property {} {axis}",
            if wide { "double" } else { "float" }
        )?;
    }
    let normals = if mesh.smooth {
        ["nx", "ny", "nz"].as_slice()
    } else {
        &[]
    };
    let uv_names = if uvs.is_some() {
        UV_NAMES[0].as_slice()
    } else {
        &[]
    };
    let attributes = mesh.attributes.keys().map(String::as_str);
    for name in normals.iter().chain(uv_names).copied().chain(attributes) {
        writeln!(out, "property float {name}")?;
    }
    writeln!(out, "element face {}", mesh.triangles.len())?;
    writeln!(out, "property list uchar int vertex_indices\nend_header")?;

    for (vertex, position) in mesh.positions.iter().enumerate() {
        let position = mesh.to_object(*position);
        if wide {
            for coordinate in position.to_array() {
                out.write_all(&coordinate.to_le_bytes())?;
            }
        } else {
            write_floats(&mut out, &position.as_vec3().to_array())?;
        }
        if mesh.smooth {
            write_floats(&mut out, &mesh.normals[vertex].to_array())?;
        }
        if let Some(uvs) = uvs {
            // PLY's v points up.
            write_floats(&mut out, &[uvs[vertex].x, 1.0 - uvs[vertex].y])?;
        }
        for values in mesh.attributes.values() {
            write_floats(&mut out, &[values[vertex]])?;
        }
    }
    for triangle in &mesh.triangles {
        out.write_all(&[3])?;
        for vertex in triangle {
            out.write_all(&vertex.to_le_bytes())?;
        }
    }
    out.into_inner()?.sync_all()
}

fn write_floats(out: &mut impl Write, values: &[f32]) -> io::Result<()> {
    values
        .iter()
        .try_for_each(|value| out.write_all(&value.to_le_bytes()))
}
