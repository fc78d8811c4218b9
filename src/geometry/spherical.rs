//! The lat-long map: `ω = (sin θ sin φ, cos θ, −sin θ cos φ)` with `φ = 2πu`, `θ = πv`.
//!
//! This is Mitsuba 3's orientation at identity transform: `v = 0` is +Y, `u = ½` is +Z.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

/// The unit direction at `(u, v)`, `u` to the right and `v` down, both in [0, 1].
#[inline]
pub fn direction_from_latlong(uv: Vec2) -> Vec3 {
    let (sin_phi, cos_phi) = (2.0 * PI * uv.x).sin_cos();
    let (sin_theta, cos_theta) = (PI * uv.y).sin_cos();
    Vec3::new(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi)
}

/// `(u, v)` in [0, 1) × [0, 1] of a unit direction; the inverse of [`direction_from_latlong`].
///
/// `v` comes from `atan2`, which stays accurate at the poles where `acos` loses half its digits.
#[inline]
pub fn latlong_from_direction(direction: Vec3) -> Vec2 {
    let u = direction.x.atan2(-direction.z) / (2.0 * PI);
    let u = if u < 0.0 { u + 1.0 } else { u };
    let v = direction.x.hypot(direction.z).atan2(direction.y) / PI;
    Vec2::new(if u >= 1.0 { 0.0 } else { u }, v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn latlong_axes_are_mitsubas() {
        let at = |u, v| direction_from_latlong(Vec2::new(u, v));
        assert!((at(0.3, 0.0) - Vec3::Y).length() < 1e-6);
        assert!((at(0.5, 0.5) - Vec3::Z).length() < 1e-6);
        assert!((at(0.25, 0.5) - Vec3::X).length() < 1e-6);
        assert!((at(0.0, 0.5) + Vec3::Z).length() < 1e-6);
    }

    proptest! {
        #[test]
        fn latlong_inverts(u in 0.0f32..0.99999, v in 0.0005f32..0.9995) {
            let back = latlong_from_direction(direction_from_latlong(Vec2::new(u, v)));
            let du = (back.x - u).abs();
            prop_assert!(du.min(1.0 - du) * (PI * v).sin() < 2e-6);
            prop_assert!((back.y - v).abs() < 2e-6);
        }
    }
}
