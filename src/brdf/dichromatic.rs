//! The material of one surface point.

use glam::Vec3;

use super::{Alpha, Fresnel};
use crate::geometry::Local;

/// Parameters of the dichromatic model at one surface point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dichromatic {
    /// Diffuse albedo, linear RGB.
    pub rho_d: Vec3,
    /// Specular albedo, linear RGB; above 1 is normal (plastic under the paper's eta = 1.3 has
    /// 2.35). Ones where `fresnel` is Schlick's, whose F0 and F90 absorb it.
    pub rho_s: Vec3,
    /// Roughness of the lobe.
    pub alpha: Alpha,
    /// Share of GGX in the lobe: 0 Beckmann, 1 GGX; between only where a map interpolates.
    pub ggx: f32,
    /// Fresnel reflectance of the lobe.
    pub fresnel: Fresnel,
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct BrdfSample {
    /// To the light.
    pub wi: Local,
    /// `f(wi, wo) cos θ_i / pdf`.
    pub weight: Vec3,
    /// Of `wi`, per steradian, over both lobes.
    pub pdf: f32,
}
