//! Triangle meshes: load, validate, repair, normalise.
//!
//! A file becomes a [`Surface`] (its content, in f64), and a surface becomes a [`Mesh`] (checked,
//! repaired, in its own frame, in f32) with a [`MeshReport`] of what was found on the way.
//! [`Mesh::with_charts`] gives it a texture layout where it has none, and [`PointSet`] picks the points of a mesh at which materials are measured.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DVec3, Vec2, Vec3};

use crate::geometry::Similarity;

mod assemble;
mod charts;
mod edges;
mod error;
mod gltf;
mod normals;
mod obj;
mod ply;
mod points;
mod queries;
mod repair;
mod report;
mod seams;
mod shapes;
mod stl;
mod texels;
mod topology;
mod write_ply;

pub use assemble::Surface;
pub use charts::ChartReport;
pub use edges::Edge;
pub use error::MeshError;
pub use points::{Neighbours, PointSet, SurfacePoint, neighbours};
pub use report::MeshReport;
pub use shapes::{cup, sphere};
pub use texels::TexelGrid;
pub use write_ply::write_ply;

#[cfg(test)]
mod tests;

/// An indexed triangle mesh in the *mesh frame*: centred on its bounding box and scaled so that
/// the largest absolute coordinate is 1. `object = origin + scale * mesh`.
///
/// The mesh frame makes every later computation independent of the file's unit and position; files
/// in double precision are recentred before they are rounded to f32.
///
/// A loaded mesh has at least one triangle, none without area, every vertex used, every index in
/// range and everything but the attributes finite.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// `[V]` vertex positions, mesh frame.
    pub positions: Vec<Vec3>,
    /// `[V]` unit shading normals; computed (angle-weighted) where the file has none.
    pub normals: Vec<Vec3>,
    /// `[V]` texture coordinates, (0, 0) at the *top left* of the image, if the file has them or charts
    /// were made.
    pub uvs: Option<Vec<Vec2>>,
    /// `[V]` further float properties of the file's vertices, by name.
    pub attributes: BTreeMap<String, Vec<f32>>,
    /// `[T]` vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Whether shading normals are interpolated (`true`) or each triangle is flat.
    pub smooth: bool,
    /// Object-frame position of the mesh frame's origin.
    pub origin: DVec3,
    /// Object units per mesh unit, > 0.
    pub scale: f64,
}

/// How a mesh is to be loaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// Shade every triangle with its geometric normal, whatever normals the file has.
    pub flat: bool,
}

impl Mesh {
    /// Loads a `.ply`, `.obj`, `.gltf`, `.glb` or `.stl` file.
    ///
    /// `object_from_file` places the file's coordinates in the object frame. It is applied in f64,
    /// before the mesh is recentred and rounded, so that neither it nor the file's own position
    /// costs precision.
    ///
    /// # Errors
    ///
    /// If the file cannot be read, breaks its format, names vertices that it does not have, or has
    /// no triangle of finite corners and nonzero area. Lesser defects are mended and reported.
    pub fn load(
        path: &Path,
        object_from_file: &Similarity,
        options: LoadOptions,
    ) -> Result<(Self, MeshReport), MeshError> {
        let extension = path
            .extension()
            .map(|e| e.to_string_lossy().into_owned())
            .unwrap_or_default();
        let reader = match extension.to_ascii_lowercase().as_str() {
            "ply" => |bytes: &[u8], _: &Path| ply::read(bytes),
            "obj" => |bytes: &[u8], _: &Path| obj::read(bytes),
            "stl" => |bytes: &[u8], _: &Path| stl::read(bytes),
            "gltf" | "glb" => |bytes: &[u8], path: &Path| gltf::read(bytes, path.parent()),
            _ => {
                return Err(MeshError::Extension {
                    path: path.to_path_buf(),
                    extension,
                });
            }
        };
        let bytes = std::fs::read(path).map_err(|source| MeshError::Read {
            path: path.to_path_buf(),
            source,
        })?;
        let surface = reader(&bytes, path).map_err(|fault| fault.in_file(path))?;
        Self::from_surface(surface, object_from_file, options, path)
    }
}
