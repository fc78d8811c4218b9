//! The outline of the mesh as a camera sees it: points where the surface turns away.
//!
//! An edge is on a contour where one of its triangles faces the camera and the other does not, or where
//! the surface ends. A point of it belongs to the *outer* outline if a ray just inside meets the object
//! and one just outside meets nothing; to an *inner* one if the ray outside meets the object farther back.

use glam::{DVec2, Vec3};

use crate::accel::Accel;
use crate::geometry::Ray;
use crate::mesh::{Edge, Mesh};
use crate::rig::View;

/// A step in depth, in sizes of the object, from which on an inner contour counts: nearer surfaces are
/// folds whose two sides look alike.
const LEAST_STEP: f32 = 0.05;

/// A mesh prepared for outlines.
pub(super) struct Contours<'a> {
    mesh: &'a Mesh,
    accel: &'a Accel,
    edges: Vec<Edge>,
    /// `[triangles]` unit.
    facets: Vec<Vec3>,
}

/// A point of an outline.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContourPoint {
    /// Mesh frame.
    pub(super) position: Vec3,
    /// Unit shading normal there, mesh frame.
    pub(super) normal: Vec3,
    /// Pixel coordinates.
    pub(super) pixel: DVec2,
    /// Unit, in the image, away from the surface.
    pub(super) outward: DVec2,
    /// Pixels of outline that it stands for.
    pub(super) length: f64,
    /// Whether nothing of the object is behind.
    pub(super) outer: bool,
}

impl<'a> Contours<'a> {
    pub(super) fn new(mesh: &'a Mesh, accel: &'a Accel) -> Self {
        Self {
            mesh,
            accel,
            edges: mesh.edges(),
            facets: (0..mesh.triangles.len() as u32)
                .map(|triangle| mesh.geometric_normal(triangle))
                .collect(),
        }
    }

    /// Whether a ray meets the object.
    pub(super) fn meets(&self, ray: &Ray) -> bool {
        self.accel.occluded(ray, f32::INFINITY)
    }

    /// Points of the outline within an image of `size` pixels, at most `spacing` pixels apart; inner ones
    /// too, if asked.
    pub(super) fn of_view(
        &self,
        view: &View,
        size: (usize, usize),
        spacing: f64,
        inner: bool,
    ) -> Vec<ContourPoint> {
        let eye = view.position();
        let facing: Vec<bool> = (self.mesh.triangles.iter())
            .zip(&self.facets)
            .map(|(corners, facet)| facet.dot(eye - self.mesh.positions[corners[0] as usize]) > 0.0)
            .collect();
        let faces = |triangle: u32| facing[triangle as usize];
        let mut points = Vec::new();
        for edge in &self.edges {
            if edge
                .other
                .is_some_and(|other| faces(other) == faces(edge.triangle))
            {
                continue;
            }
            let ends = edge.vertices.map(|v| self.mesh.positions[v as usize]);
            let [Some(from), Some(to)] = ends.map(|end| view.project(end)) else {
                continue;
            };
            // The surface lies on the side of the facing triangle's third corner.
            let facing = match edge.other {
                Some(other) if faces(other) => other,
                _ => edge.triangle,
            };
            let along = to - from;
            let length = along.length();
            let (Some(outward), Some(third)) = (
                along.perp().try_normalize(),
                self.farthest_corner(view, facing, from, along),
            ) else {
                continue;
            };
            let outward = if outward.dot(third - from) > 0.0 {
                -outward
            } else {
                outward
            };
            // Beyond the longest diagonal nothing more is seen of an edge.
            let count = ((length / spacing).ceil().max(1.0)) as usize;
            let count = count.min(4 * (size.0 + size.1));
            for i in 0..count {
                let share = (i as f32 + 0.5) / count as f32;
                let point = ContourPoint {
                    position: ends[0].lerp(ends[1], share),
                    normal: Vec3::ZERO,
                    pixel: DVec2::ZERO,
                    outward,
                    length: length / count as f64,
                    outer: true,
                };
                points.extend(self.seen(view, size, spacing, point, inner).map(|point| {
                    let [a, b] = edge.vertices.map(|v| self.mesh.normals[v as usize]);
                    ContourPoint {
                        normal: a.lerp(b, share).normalize_or_zero(),
                        ..point
                    }
                }));
            }
        }
        points
    }

    /// The corner of a triangle that is projected farthest from the line of an edge.
    fn farthest_corner(
        &self,
        view: &View,
        triangle: u32,
        from: DVec2,
        along: DVec2,
    ) -> Option<DVec2> {
        let corners = self.mesh.triangle_positions(triangle);
        let projected = corners.map(|corner| view.project(corner));
        projected.into_iter().flatten().max_by(|a, b| {
            let distance = |p: &DVec2| along.perp_dot(*p - from).abs();
            distance(a).total_cmp(&distance(b))
        })
    }

    /// The point with its pixel, if it is on the outline and inside the image.
    fn seen(
        &self,
        view: &View,
        (width, height): (usize, usize),
        spacing: f64,
        point: ContourPoint,
        inner: bool,
    ) -> Option<ContourPoint> {
        let pixel = view.project(point.position)?;
        let within = |x: f64, n: usize| x >= 0.0 && x < n as f64;
        if !within(pixel.x, width) || !within(pixel.y, height) {
            return None;
        }
        let aside = 0.5 * spacing * point.outward;
        let (inside, outside) = (view.ray(pixel - aside), view.ray(pixel + aside));
        if !self.meets(&outside) {
            let surface = self.meets(&inside);
            return surface.then_some(ContourPoint { pixel, ..point });
        }
        if !inner {
            return None;
        }
        let front = self.accel.closest_hit(&inside, f32::INFINITY)?.t;
        let back = self.accel.closest_hit(&outside, f32::INFINITY)?.t;
        let own = view.position().distance(point.position);
        let step = LEAST_STEP * self.mesh.bounding_radius();
        let visible = (front - own).abs() < 0.5 * step && back > own + step;
        visible.then_some(ContourPoint {
            pixel,
            outer: false,
            ..point
        })
    }
}
