//! The parameters that a surface point is rendered with.

use glam::Vec3;

use super::Ndf;

/// Parameters of the dichromatic model at a surface point, between its two NDFs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Appearance {
    /// Diffuse albedo, linear RGB.
    pub rho_d: Vec3,
    /// Specular albedo, linear RGB; under Schlick's Fresnel term the reflectance at normal incidence.
    pub rho_s: Vec3,
    /// Reflectance at grazing under Schlick's Fresnel term; unused under another.
    pub f90: f32,
    /// Roughness.
    pub alpha: f32,
    /// Share of GGX, between Beckmann (0) and GGX (1).
    pub ggx: f32,
}

impl Appearance {
    /// The NDF that prevails.
    pub fn ndf(&self) -> Ndf {
        if self.ggx >= 0.5 {
            Ndf::Ggx
        } else {
            Ndf::Beckmann
        }
    }
}
