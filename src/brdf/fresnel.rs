//! Fresnel reflectance: exact for a dielectric, or Schlick's approximation with free ends.

use glam::Vec3;

/// How reflectance rises from normal incidence to grazing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fresnel {
    /// Exact unpolarised reflectance of a smooth dielectric of relative index `eta`.
    Dielectric {
        /// Index of refraction relative to the outside, > 1. The paper fixes 1.3.
        eta: f32,
    },
    /// `F = f0 (1 − s) + f90 s`, `s = (1 − cos)^5` (Schlick 1994, with a free end value); it can
    /// represent a metal and is linear in `f0` and `f90`.
    Schlick {
        /// Reflectance at normal incidence, linear RGB.
        f0: Vec3,
        /// Reflectance at grazing, neutral.
        f90: f32,
    },
}

impl Fresnel {
    /// The paper's choice for every material (Domon et al., after Eq. 2).
    pub const PAPER: Self = Self::Dielectric { eta: 1.3 };

    /// Reflectance at `cos = ω_i·ω_h` in [0, 1], linear RGB.
    #[inline]
    pub fn eval(&self, cos: f32) -> Vec3 {
        match *self {
            Self::Dielectric { eta } => Vec3::splat(dielectric(cos, eta)),
            Self::Schlick { f0, f90 } => {
                let s = schlick_weight(cos);
                f0 * (1.0 - s) + Vec3::splat(f90 * s)
            }
        }
    }
}

/// `(1 − cos)^5`.
#[inline]
pub fn schlick_weight(cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// Unpolarised reflectance of a dielectric seen from the less dense side,
/// `F = ½ (g−c)²/(g+c)² [1 + (c(g+c)−1)²/(c(g−c)+1)²]`, `g² = eta² − 1 + c²`
/// (Walter et al. 2007, Eq. 22); `g − c` is formed as `(eta² − 1)/(g + c)`, which does not cancel
/// for an index near 1.
#[inline]
pub fn dielectric(cos: f32, eta: f32) -> f32 {
    let c = cos.clamp(0.0, 1.0);
    let g2_minus_c2 = (eta - 1.0) * (eta + 1.0);
    let sum = c + (g2_minus_c2 + c * c).max(0.0).sqrt();
    let difference = g2_minus_c2 / sum;
    let ratio = difference / sum;
    let other = (c * sum - 1.0) / (c * difference + 1.0);
    0.5 * ratio * ratio * (1.0 + other * other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn dielectric_ends_are_exact() {
        assert!((dielectric(1.0, 1.3) - (0.3f32 / 2.3).powi(2)).abs() < 1e-8);
        assert!((dielectric(0.0, 1.3) - 1.0).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn dielectric_agrees_with_the_fresnel_equations(cos in 0.001f64..1.0, eta in 1.01f64..3.0) {
            // Transmitted angle from Snell's law, then both polarisations in double precision.
            let cos_t = (1.0 - (1.0 - cos * cos) / (eta * eta)).sqrt();
            let s = ((cos - eta * cos_t) / (cos + eta * cos_t)).powi(2);
            let p = ((eta * cos - cos_t) / (eta * cos + cos_t)).powi(2);
            let exact = 0.5 * (s + p);
            prop_assert!((f64::from(dielectric(cos as f32, eta as f32)) - exact).abs() < 2e-6);
        }

        #[test]
        fn schlick_runs_from_f0_to_f90(f0 in 0.0f32..1.0, f90 in 0.0f32..1.0) {
            let f = Fresnel::Schlick { f0: Vec3::splat(f0), f90 };
            prop_assert!((f.eval(1.0).x - f0).abs() < 1e-6);
            prop_assert!((f.eval(0.0).x - f90).abs() < 1e-6);
        }
    }
}
