//! Warps from the unit square to directions.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

use glam::{Vec2, Vec3};

use crate::geometry::Local;

/// A direction about the normal with density `cos θ / π`, by lifting the concentric disc
/// (Shirley and Chiu 1997), which keeps strata compact.
#[inline]
pub fn cosine_hemisphere(u: Vec2) -> Local {
    let p = 2.0 * u - Vec2::ONE;
    if p == Vec2::ZERO {
        return Local(Vec3::Z);
    }
    let (r, phi) = if p.x.abs() > p.y.abs() {
        (p.x, FRAC_PI_4 * (p.y / p.x))
    } else {
        (p.y, FRAC_PI_2 - FRAC_PI_4 * (p.x / p.y))
    };
    let (sin, cos) = phi.sin_cos();
    Local(Vec3::new(
        r * cos,
        r * sin,
        (1.0 - r * r).max(0.0).sqrt().max(1e-6),
    ))
}
