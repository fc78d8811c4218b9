//! Distributions of microfacet normals (NDFs) and their masking.
//!
//! ```text
//! Beckmann   D = exp(−tan²θ/α²) / (π α² cos⁴θ)
//! GGX        D = α² / (π (cos²θ (α² − 1) + 1)²)
//! ```
//!
//! (Walter et al. 2007, *Microfacet Models for Refraction through Rough Surfaces*, Eq. 25 and 33.)

use std::f32::consts::PI;

use glam::Vec3;

use crate::geometry::Local;

/// Roughness of a microfacet lobe, in [1e-3, 1]: below, f32 cannot resolve the lobe.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Alpha(f32);

/// A roughness outside [1e-3, 1].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("alpha = {0}: must be in [0.001, 1]; alpha is the NDF's own parameter, the square of glTF's roughness")]
pub struct AlphaError(pub f32);

impl Alpha {
    /// Smallest roughness.
    pub const MIN: Self = Self(1e-3);
    /// Largest roughness.
    pub const MAX: Self = Self(1.0);

    /// Checks the range.
    pub fn new(value: f32) -> Result<Self, AlphaError> {
        if (Self::MIN.0..=Self::MAX.0).contains(&value) { Ok(Self(value)) } else { Err(AlphaError(value)) }
    }

    /// The nearest roughness in range; NaN becomes the largest.
    pub fn saturating(value: f32) -> Self {
        if value.is_nan() { Self::MAX } else { Self(value.clamp(Self::MIN.0, Self::MAX.0)) }
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
}
