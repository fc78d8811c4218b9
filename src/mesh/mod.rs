//! Triangle meshes: load, validate, repair, normalise.

use std::collections::BTreeMap;

use glam::{DVec3, Vec2, Vec3};

/// An indexed triangle mesh in the *mesh frame*: centred on its bounding box and scaled so that
/// the largest absolute coordinate is 1. `object = origin + scale * mesh`.
///
/// The mesh frame makes every later computation independent of the file's unit and position; files
/// in double precision are recentred before they are rounded to f32.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// `[V]` vertex positions, mesh frame.
    pub positions: Vec<Vec3>,
    /// `[V]` unit shading normals; computed (angle-weighted) where the file has none.
    pub normals: Vec<Vec3>,
    /// `[V]` texture coordinates, (0, 0) at the *top left* of the image, if the file has them.
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
