//! What others ask of a mesh: corners, normals, interpolated values, frames.
//!
//! A point of triangle `(p0, p1, p2)` is `(1 − b1 − b2) p0 + b1 p1 + b2 p2`; `barycentric` is
//! `(b1, b2)` throughout.

use std::ops::{Add, Mul};

use glam::{DAffine3, DQuat, DVec3, Vec2, Vec3};

use super::Mesh;

impl Mesh {
    /// The corners of a triangle, mesh frame.
    #[inline]
    pub fn triangle_positions(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|vertex| self.positions[vertex as usize])
    }

    /// The unit normal of a triangle's plane, on the side from which it is counter-clockwise.
    ///
    /// Computed in f64, since the cross product of a small triangle's sides underflows in f32.
    #[inline]
    pub fn geometric_normal(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.triangle_positions(triangle).map(Vec3::as_dvec3);
        (b - a).cross(c - a).normalize_or_zero().as_vec3()
    }

    /// The area of a triangle in mesh units squared.
    #[inline]
    pub fn area(&self, triangle: u32) -> f32 {
        let [a, b, c] = self.triangle_positions(triangle).map(Vec3::as_dvec3);
        (0.5 * (b - a).cross(c - a).length()) as f32
    }

    /// The value at a point of a triangle of what is known at the vertices.
    #[inline]
    pub fn interpolate<T>(&self, at_vertices: &[T], triangle: u32, barycentric: Vec2) -> T
    where
        T: Copy + Mul<f32, Output = T> + Add<Output = T>,
    {
        let [a, b, c] =
            self.triangles[triangle as usize].map(|vertex| at_vertices[vertex as usize]);
        a * (1.0 - barycentric.x - barycentric.y) + b * barycentric.x + c * barycentric.y
    }

    /// The position of a point of a triangle, mesh frame.
    #[inline]
    pub fn position_at(&self, triangle: u32, barycentric: Vec2) -> Vec3 {
        self.interpolate(&self.positions, triangle, barycentric)
    }

    /// The unit shading normal at a point of a triangle: interpolated and normalised, or the
    /// triangle's own where the mesh is flat or the vertices' normals cancel.
    #[inline]
    pub fn normal_at(&self, triangle: u32, barycentric: Vec2) -> Vec3 {
        if !self.smooth {
            return self.geometric_normal(triangle);
        }
        self.interpolate(&self.normals, triangle, barycentric)
            .try_normalize()
            .unwrap_or_else(|| self.geometric_normal(triangle))
    }

    /// The texture coordinate at a point of a triangle, if the mesh has any.
    #[inline]
    pub fn uv_at(&self, triangle: u32, barycentric: Vec2) -> Option<Vec2> {
        self.uvs
            .as_ref()
            .map(|uvs| self.interpolate(uvs, triangle, barycentric))
    }

    /// Largest distance of a vertex from the mesh frame's origin, in mesh units: 1 to √3.
    pub fn bounding_radius(&self) -> f32 {
        self.positions
            .iter()
            .map(|position| position.length())
            .fold(0.0, f32::max)
    }

    /// A position of the mesh frame in the object frame.
    #[inline]
    pub fn to_object(&self, position: Vec3) -> DVec3 {
        self.origin + self.scale * position.as_dvec3()
    }

    /// A position of the object frame in the mesh frame; the inverse of [`Mesh::to_object`].
    #[inline]
    pub fn to_mesh(&self, position: DVec3) -> Vec3 {
        ((position - self.origin) / self.scale).as_vec3()
    }

    /// The map from the mesh frame to the object frame.
    pub fn object_from_mesh(&self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(
            DVec3::splat(self.scale),
            DQuat::IDENTITY,
            self.origin,
        )
    }
}
