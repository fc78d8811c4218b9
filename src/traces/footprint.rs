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

/// What a pixel sees, if it is one patch.
pub(super) struct Footprint {
    /// Mean shading normal, unit, object frame.
    pub(super) normal: Vec3,
    /// Geometric normal of the first ray's triangle, unit, object frame.
    pub(super) geometric_normal: Vec3,
    /// Variance of the shading normal, radian² per tangent axis.
    pub(super) normal_variance: f32,
    /// To the camera, unit, object frame.
    pub(super) wo: Vec3,
}

/// The patch seen by the pixel at column `x`, row `y`, if it is one smooth patch within `reach`
/// (mesh units) of the tangent plane and of the position of `near`.
pub(super) fn footprint(
    mesh: &Mesh,
    accel: &Accel,
    view: &View,
    (x, y): (usize, usize),
    near: Vec3,
    reach: f32,
) -> Option<Footprint> {
    let centre = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
    let corners = [
        (-GAUSS, -GAUSS),
        (GAUSS, -GAUSS),
        (-GAUSS, GAUSS),
        (GAUSS, GAUSS),
    ];
    let mut normals = [Vec3::ZERO; 4];
    let mut geometric_normal = Vec3::ZERO;
    for (normal, (dx, dy)) in normals.iter_mut().zip(corners) {
        let ray = view.ray(centre + DVec2::new(dx, dy));
        let hit = accel.closest_hit(&ray, f32::INFINITY)?;
        if ray.at(hit.t).distance(near) > reach {
            return None;
        }
        *normal = mesh.normal_at(hit.triangle, Vec2::new(hit.u, hit.v));
        geometric_normal += mesh.geometric_normal(hit.triangle);
    }
    let mean = (normals[0] + normals[1] + normals[2] + normals[3]).try_normalize()?;
    if normals.iter().any(|n| n.dot(mean) < LARGEST_TURN_COS) {
        return None;
    }
    let spread: f32 = normals
        .iter()
        .map(|n| (*n - mean).length_squared())
        .sum::<f32>()
        / 4.0;
    Some(Footprint {
        normal: mean,
        geometric_normal: geometric_normal.try_normalize()?,
        normal_variance: 0.5 * spread,
        wo: -view.ray(centre).direction,
    })
}
