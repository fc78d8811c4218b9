//! Directions above the horizon of the shading normal and below the triangle's own plane.
//!
//! ```text
//! { ω : n·ω > 0, s·ω < 0 },   ω = sin β (sin φ u − cos φ t) + cos β k,   0 < φ < γ,   cos γ = n·s
//! ```
//!
//! with `k` along both horizons, `u` the normal and `t` across, where the side leans to. Smooth
//! shading of an open point sees light there that its triangle hides. The lune is as wide as the normals
//! differ, `γ`; directions are drawn with a density in proportion to `φ`, as the cosine `n·ω = sin β sin φ`
//! about is.

use glam::{Vec2, Vec3};

/// Normals that differ by less, radians, count as one: the light between is below `γ²`.
const NARROWEST: f32 = 3e-4;

/// The lune between two horizons.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lune {
    along: Vec3,
    normal: Vec3,
    /// Unit, in the shading horizon: where the side leans to.
    across: Vec3,
    /// Its angle, radians.
    pub(super) width: f32,
}

impl Lune {
    /// Between the horizons of a shading normal and of a triangle's `side`, both unit; `None` where
    /// they are the same.
    #[inline]
    pub(super) fn between(normal: Vec3, side: Vec3) -> Option<Self> {
        let cross = normal.cross(side);
        let sin = cross.length();
        let width = sin.atan2(normal.dot(side));
        if width < NARROWEST {
            return None;
        }
        let along = cross / sin;
        Some(Self {
            along,
            normal,
            across: along.cross(normal),
            width,
        })
    }

    /// A direction (unit) and its density per steradian, `φ/γ²`.
    #[inline]
    pub(super) fn sample(&self, u: Vec2) -> (Vec3, f32) {
        let phi = self.width * u.x.sqrt();
        let z = 2.0 * u.y - 1.0;
        let sin = (1.0 - z * z).max(0.0).sqrt();
        let (sin_phi, cos_phi) = phi.sin_cos();
        let direction = sin * (sin_phi * self.normal - cos_phi * self.across) + z * self.along;
        (direction.normalize(), phi / (self.width * self.width))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn directions_lie_between_the_horizons(
            n in (-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0),
            s in (-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0),
            x in 0.01f32..0.99, y in 0.01f32..0.99,
        ) {
            let (n, s) = (Vec3::from(n), Vec3::from(s));
            prop_assume!(n.length() > 0.1 && s.length() > 0.1);
            let (n, s) = (n.normalize(), s.normalize());
            prop_assume!(n.dot(s) > 0.0 && n.dot(s) < 0.999);
            let lune = Lune::between(n, s).unwrap();
            let (direction, density) = lune.sample(Vec2::new(x, y));
            prop_assert!(direction.dot(n) > -1e-5 && direction.dot(s) < 1e-5);
            prop_assert!(density > 0.0);
        }
    }

    #[test]
    fn density_is_that_of_the_samples() {
        // The mean of n·ω/density is the cosine's integral over the lune, π/2 (1 − cos γ).
        let (n, s) = (Vec3::Z, Vec3::new(0.3, 0.2, 0.9).normalize());
        let lune = Lune::between(n, s).unwrap();
        let side = 256;
        let mut sum = 0.0;
        for k in 0..side * side {
            let u = Vec2::new((k % side) as f32 + 0.5, (k / side) as f32 + 0.5) / side as f32;
            let (direction, density) = lune.sample(u);
            sum += f64::from(n.dot(direction) / density) / f64::from(side * side);
        }
        let expected = std::f64::consts::FRAC_PI_2 * (1.0 - f64::from(n.dot(s)));
        assert!((sum / expected - 1.0).abs() < 1e-3, "{sum} {expected}");
    }
}
