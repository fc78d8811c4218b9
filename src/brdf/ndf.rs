//! Distributions of microfacet normals (NDFs) and their masking.
//!
//! ```text
//! Beckmann   D = exp(−tan²θ/α²) / (π α² cos⁴θ)
//! GGX        D = α² / (π (cos²θ (α² − 1) + 1)²)
//! ```
//!
//! (Walter et al. 2007, *Microfacet Models for Refraction through Rough Surfaces*, Eq. 25 and 33.)

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::visible_slopes;
use crate::geometry::Local;

/// Roughness of a microfacet lobe, in [1e-3, 1]: below, f32 cannot resolve the lobe.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Alpha(f32);

/// A roughness outside [1e-3, 1].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "alpha = {0}: must be in [0.001, 1]; alpha is the NDF's own parameter, the square of glTF's roughness"
)]
pub struct AlphaError(pub f32);

impl Alpha {
    /// Smallest roughness.
    pub const MIN: Self = Self(1e-3);
    /// Largest roughness.
    pub const MAX: Self = Self(1.0);

    /// Checks the range.
    pub fn new(value: f32) -> Result<Self, AlphaError> {
        if (Self::MIN.0..=Self::MAX.0).contains(&value) {
            Ok(Self(value))
        } else {
            Err(AlphaError(value))
        }
    }

    /// The nearest roughness in range; NaN becomes the largest.
    pub fn saturating(value: f32) -> Self {
        if value.is_nan() {
            Self::MAX
        } else {
            Self(value.clamp(Self::MIN.0, Self::MAX.0))
        }
    }

    /// The number.
    #[inline]
    pub fn get(self) -> f32 {
        self.0
    }
}

/// The shape of the specular lobe.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Ndf {
    /// Gaussian slopes: highlights with a weak tail.
    Beckmann,
    /// Trowbridge–Reitz: highlights with a strong tail.
    Ggx,
}

impl Ndf {
    /// Both, in the order of their codes in `points.npz` (0 Beckmann, 1 GGX).
    pub const ALL: [Self; 2] = [Self::Beckmann, Self::Ggx];

    /// Density of microfacet normals `D(wm)`, per steradian; zero below the surface.
    ///
    /// Written with sin² and cos² of the half vector apart: `cos²(α² − 1) + 1` cancels for narrow
    /// lobes.
    #[inline]
    pub fn density(self, wm: Local, alpha: Alpha) -> f32 {
        let (sin2, cos2) = sin2_cos2(wm);
        if wm.0.z <= 0.0 {
            return 0.0;
        }
        let a2 = alpha.0 * alpha.0;
        match self {
            Self::Beckmann => {
                let exponent = sin2 / (cos2 * a2);
                // exp(−100) is 0 in f32, and so may be cos⁴ of a half vector that steep.
                if exponent > 100.0 {
                    return 0.0;
                }
                (-exponent).exp() / (PI * a2 * cos2 * cos2)
            }
            Self::Ggx => {
                let q = sin2 + a2 * cos2;
                a2 / (PI * q * q)
            }
        }
    }

    /// `∂D/∂alpha`.
    #[inline]
    pub fn density_d_alpha(self, wm: Local, alpha: Alpha) -> f32 {
        let (sin2, cos2) = sin2_cos2(wm);
        if wm.0.z <= 0.0 {
            return 0.0;
        }
        let a = alpha.0;
        match self {
            Self::Beckmann => match self.density(wm, alpha) {
                0.0 => 0.0,
                density => density * 2.0 * (sin2 / (cos2 * a * a) - 1.0) / a,
            },
            Self::Ggx => {
                let q = sin2 + a * a * cos2;
                2.0 * a * (sin2 - a * a * cos2) / (PI * q * q * q)
            }
        }
    }

    /// Smith masking divided by the cosine, `G1(w) / cos θ`, which stays finite at grazing.
    ///
    /// GGX: Walter et al. 2007, Eq. 34. Beckmann: their rational fit (after Eq. 27), as Mitsuba has
    /// it; within 0.63 % of the exact form, see [`Ndf::masking_exact`].
    #[inline]
    pub fn masking_over_cos(self, w: Local, alpha: Alpha) -> f32 {
        let (sin2, cos2) = sin2_cos2(w);
        let cos = w.0.z;
        match self {
            Self::Ggx => 2.0 / (cos + (cos2 + alpha.0 * alpha.0 * sin2).sqrt()),
            Self::Beckmann => {
                let slope = alpha.0 * sin2.sqrt();
                let b = cos / slope;
                if b >= 1.6 || slope == 0.0 {
                    1.0 / cos
                } else {
                    (3.535 + 2.181 * b) / (slope * (1.0 + b * (2.276 + b * 2.577)))
                }
            }
        }
    }

    /// `∂/∂alpha` of [`Ndf::masking_over_cos`].
    #[inline]
    pub fn masking_over_cos_d_alpha(self, w: Local, alpha: Alpha) -> f32 {
        let (sin2, cos2) = sin2_cos2(w);
        let (cos, a) = (w.0.z, alpha.0);
        match self {
            Self::Ggx => {
                let root = (cos2 + a * a * sin2).sqrt();
                -2.0 * a * sin2 / (root * (cos + root) * (cos + root))
            }
            Self::Beckmann => {
                let slope = a * sin2.sqrt();
                let b = cos / slope;
                if b >= 1.6 || slope == 0.0 {
                    return 0.0;
                }
                // G1 = N/M of b, b = cos/(alpha sin), db/dalpha = −b/alpha.
                let n = b * (3.535 + 2.181 * b);
                let m = 1.0 + b * (2.276 + b * 2.577);
                let dn = 3.535 + 4.362 * b;
                let dm = 2.276 + 5.154 * b;
                (dn * m - n * dm) / (m * m) * (-b / a) / cos
            }
        }
    }

    /// Smith masking `G1(w)` that belongs to `D` exactly: the share of the projected area that is
    /// visible, which normalises the density of visible normals. For GGX it is the one above.
    #[inline]
    pub fn masking_exact(self, w: Local, alpha: Alpha) -> f32 {
        match self {
            Self::Ggx => self.masking_over_cos(w, alpha) * w.0.z,
            Self::Beckmann => {
                let sin = (w.0.x * w.0.x + w.0.y * w.0.y).sqrt();
                let a = w.0.z / (alpha.0 * sin);
                // erfc(4) is below f32's resolution of 1.
                if a > 4.0 || sin == 0.0 {
                    return 1.0;
                }
                // 1/(1 + Λ) with Λ = (erf(a) − 1)/2 + exp(−a²)/(2a√π), multiplied through by 2a
                // so that a = 0 is no division by zero.
                let twice_a_lambda = (-a * a).exp() / PI.sqrt() - a * libm::erfcf(a);
                2.0 * a / (2.0 * a + twice_a_lambda)
            }
        }
    }

    /// A microfacet normal drawn from those visible from `wo`, with density
    /// `G1(wo) D(wm) (wo·wm) / cos θ_o`.
    ///
    /// GGX by spherical caps (Dupuy and Benyoub 2023, Listing 3); Beckmann through slopes
    /// (Heitz and d'Eon 2014, with Jakob's 2014 inversion).
    #[inline]
    pub fn sample_visible(self, wo: Local, alpha: Alpha, u: Vec2) -> Local {
        let stretched = Vec3::new(alpha.0 * wo.0.x, alpha.0 * wo.0.y, wo.0.z.max(1e-7)).normalize();
        match self {
            Self::Ggx => {
                let z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
                let sin = (1.0 - z * z).max(0.0).sqrt();
                let (sin_phi, cos_phi) = (2.0 * PI * u.x).sin_cos();
                let h = Vec3::new(sin * cos_phi, sin * sin_phi, z) + stretched;
                Local(Vec3::new(alpha.0 * h.x, alpha.0 * h.y, h.z.max(1e-12)).normalize())
            }
            Self::Beckmann => {
                let sin = (stretched.x * stretched.x + stretched.y * stretched.y).sqrt();
                let slope = visible_slopes::sample_beckmann(sin / stretched.z, u);
                let (sin_phi, cos_phi) = if sin > 0.0 {
                    (stretched.y / sin, stretched.x / sin)
                } else {
                    (0.0, 1.0)
                };
                let x = cos_phi * slope.x - sin_phi * slope.y;
                let y = sin_phi * slope.x + cos_phi * slope.y;
                Local(Vec3::new(-alpha.0 * x, -alpha.0 * y, 1.0).normalize())
            }
        }
    }

    /// Density, per steradian of `wi`, of mirroring `wo` at a normal from [`Ndf::sample_visible`]:
    /// `G1(wo) D(wm) / (4 cos θ_o)`.
    #[inline]
    pub fn pdf_reflected(self, wo: Local, wm: Local, alpha: Alpha) -> f32 {
        self.masking_exact(wo, alpha) * self.density(wm, alpha) / (4.0 * wo.0.z)
    }
}

#[inline]
fn sin2_cos2(w: Local) -> (f32, f32) {
    (w.0.x * w.0.x + w.0.y * w.0.y, w.0.z * w.0.z)
}
