//! The patch of surface that a pixel averages over.
//!
//! Four rays at the 2 × 2 Gauss points of the pixel reproduce mean and variance of the normal over
//! the pixel's square to second order.

use glam::{DVec2, Vec2, Vec3};

use crate::accel::Accel;
use crate::mesh::Mesh;
use crate::rig::View;

/// Offset of the Gauss points from the pixel's centre: `1/(2√3)`.
const GAUSS: f64 = 0.288_675_134_594_812_9;

/// Patches whose normal varies more than this are creases or grazing limbs, which one normal and
/// one variance do not describe: 20° between a Gauss point and the mean.
const LARGEST_TURN_COS: f32 = 0.94;

/// Slant beyond which a pixel's stretch is not followed.
const SMALLEST_COS: f32 = 0.05;

/// What a pixel sees, if it is one smooth patch.
pub(super) struct Footprint {
    /// Centre, mesh frame.
    pub(super) position: Vec3,
    /// The triangle at the centre, and where on it.
    pub(super) place: (u32, Vec2),
    /// Mean shading normal, unit, object frame.
    pub(super) normal: Vec3,
    /// Mean geometric normal, unit, object frame.
    pub(super) geometric_normal: Vec3,
    /// Variance of the shading normal, radian² per tangent axis.
    pub(super) normal_variance: f32,
    /// To the camera, unit, object frame.
    pub(super) wo: Vec3,
    /// Width of the pixel on a plane through the centre that faces the camera, mesh units.
    pub(super) width: f32,
}

impl Footprint {
    /// The patch seen by the pixel at column `x`, row `y`; none where it sees an edge, a crease, or
    /// past the object.
    pub(super) fn of_pixel(
        mesh: &Mesh,
        accel: &Accel,
        view: &View,
        (x, y): (usize, usize),
    ) -> Option<Self> {
        let centre = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        let ray = view.ray(centre);
        let hit = accel.closest_hit(&ray, f32::INFINITY)?;
        let position = ray.at(hit.t);
        let width = view.pixel_width_at(hit.t);
        let corners = [
            (-GAUSS, -GAUSS),
            (GAUSS, -GAUSS),
            (-GAUSS, GAUSS),
            (GAUSS, GAUSS),
        ];
        let mut positions = [Vec3::ZERO; 4];
        let mut normals = [Vec3::ZERO; 4];
        let mut geometric_normal = Vec3::ZERO;
        for (i, (dx, dy)) in corners.into_iter().enumerate() {
            let ray = view.ray(centre + DVec2::new(dx, dy));
            let hit = accel.closest_hit(&ray, f32::INFINITY)?;
            positions[i] = ray.at(hit.t);
            normals[i] = mesh.normal_at(hit.triangle, Vec2::new(hit.u, hit.v));
            geometric_normal += mesh.geometric_normal(hit.triangle);
        }
        let normal = (normals[0] + normals[1] + normals[2] + normals[3]).try_normalize()?;
        if normals.iter().any(|n| n.dot(normal) < LARGEST_TURN_COS) {
            return None;
        }
        // On one surface the pixel's corners are no farther away than its slant stretches it.
        let reach = width / normal.dot(-ray.direction).max(SMALLEST_COS);
        if positions.iter().any(|p| p.distance(position) > reach) {
            return None;
        }
        let spread = normals.iter().map(|n| (*n - normal).length_squared());
        Some(Self {
            position,
            place: (hit.triangle, Vec2::new(hit.u, hit.v)),
            normal,
            geometric_normal: geometric_normal.try_normalize()?,
            normal_variance: spread.sum::<f32>() / 8.0,
            wo: -ray.direction,
            width,
        })
    }
}
