//! The material of one surface point: diffuse albedo plus a rough specular lobe.

use std::f32::consts::{FRAC_1_PI, PI};

use glam::{Vec2, Vec3};

use super::{Alpha, Fresnel, Ndf};
use crate::geometry::Local;
use crate::sampling::cosine_hemisphere;

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
    /// `f(wi, wo) cos θ_i / pdf`, linear RGB.
    pub weight: Vec3,
    /// Of `wi`, per steradian, over both lobes.
    pub pdf: f32,
}

impl Dichromatic {
    /// Whether nothing is reflected at all.
    pub fn is_black(&self) -> bool {
        self.rho_d == Vec3::ZERO && self.rho_s == Vec3::ZERO
    }

    /// `f(wi, wo)`, per steradian, linear RGB, cosine excluded; zero unless both directions are
    /// above the surface.
    #[inline]
    pub fn eval(&self, wi: Local, wo: Local) -> Vec3 {
        if wi.0.z <= 0.0 || wo.0.z <= 0.0 {
            return Vec3::ZERO;
        }
        let diffuse = self.rho_d * FRAC_1_PI;
        if self.rho_s == Vec3::ZERO {
            return diffuse;
        }
        let Some((wm, cos_half)) = half_vector(wi, wo) else {
            return diffuse;
        };
        let lobe = |ndf: Ndf| {
            ndf.density(wm, self.alpha)
                * ndf.masking_over_cos(wi, self.alpha)
                * ndf.masking_over_cos(wo, self.alpha)
        };
        let shape = self.mix(lobe);
        diffuse + self.rho_s * self.fresnel.eval(cos_half) * (0.25 * shape)
    }

    /// `∂f/∂alpha`, per steradian, linear RGB.
    pub fn eval_d_alpha(&self, wi: Local, wo: Local) -> Vec3 {
        if wi.0.z <= 0.0 || wo.0.z <= 0.0 {
            return Vec3::ZERO;
        }
        let Some((wm, cos_half)) = half_vector(wi, wo) else {
            return Vec3::ZERO;
        };
        let a = self.alpha;
        // Product rule over D, G1(wi)/cos θ_i and G1(wo)/cos θ_o.
        let slope = self.mix(|ndf| {
            let (d, gi, go) = (
                ndf.density(wm, a),
                ndf.masking_over_cos(wi, a),
                ndf.masking_over_cos(wo, a),
            );
            ndf.density_d_alpha(wm, a) * gi * go
                + d * ndf.masking_over_cos_d_alpha(wi, a) * go
                + d * gi * ndf.masking_over_cos_d_alpha(wo, a)
        });
        self.rho_s * self.fresnel.eval(cos_half) * (0.25 * slope)
    }

    /// Density with which [`Dichromatic::sample`] returns `wi`, per steradian.
    #[inline]
    pub fn pdf(&self, wi: Local, wo: Local) -> f32 {
        if wi.0.z <= 0.0 || wo.0.z <= 0.0 {
            return 0.0;
        }
        let specular = self.specular_probability(wo);
        let diffuse_pdf = (1.0 - specular) * wi.0.z / PI;
        if specular == 0.0 {
            return diffuse_pdf;
        }
        diffuse_pdf + specular * self.pdf_specular(wi, wo)
    }

    /// A direction to the light from the specular lobe alone, by visible normals; `u_ndf` chooses
    /// between the NDFs. `None` where it points below the surface.
    #[inline]
    pub fn sample_specular(&self, wo: Local, u_ndf: f32, u: Vec2) -> Option<Local> {
        let ndf = if u_ndf < self.ggx {
            Ndf::Ggx
        } else {
            Ndf::Beckmann
        };
        let wm = ndf.sample_visible(wo, self.alpha, u).0;
        let wi = Local((2.0 * wo.0.dot(wm) * wm - wo.0).normalize());
        (wi.0.z > 0.0).then_some(wi)
    }

    /// Density with which [`Dichromatic::sample_specular`] returns `wi`, per steradian.
    #[inline]
    pub fn pdf_specular(&self, wi: Local, wo: Local) -> f32 {
        if wi.0.z <= 0.0 || wo.0.z <= 0.0 {
            return 0.0;
        }
        half_vector(wi, wo).map_or(0.0, |(wm, _)| {
            self.mix(|ndf| ndf.pdf_reflected(wo, wm, self.alpha))
        })
    }

    /// Draws a direction to the light: one lobe by its estimated share of the reflected light,
    /// then within it by cosine or by visible normals. `None` where the lobe points below the
    /// surface or nothing is reflected.
    #[inline]
    pub fn sample(&self, wo: Local, u_lobe: f32, u: Vec2) -> Option<BrdfSample> {
        if wo.0.z <= 0.0 || self.is_black() {
            return None;
        }
        let specular = self.specular_probability(wo);
        let wi = if u_lobe < specular {
            // The lobe variate is uniform again within its stratum.
            self.sample_specular(wo, u_lobe / specular, u)?
        } else {
            cosine_hemisphere(u)
        };
        let pdf = self.pdf(wi, wo);
        (wi.0.z > 0.0 && pdf > 0.0).then(|| BrdfSample {
            wi,
            weight: self.eval(wi, wo) * (wi.0.z / pdf),
            pdf,
        })
    }

    /// How often the specular lobe is sampled: its share of the light reflected towards `wo`,
    /// kept within [0.1, 0.9] when both lobes are present, so that neither starves where the
    /// estimate (Fresnel at the view's own angle) is poor.
    #[inline]
    fn specular_probability(&self, wo: Local) -> f32 {
        let specular = (self.rho_s * self.fresnel.eval(wo.0.z)).element_sum();
        let diffuse = self.rho_d.element_sum();
        if self.rho_s == Vec3::ZERO {
            0.0
        } else if diffuse == 0.0 {
            1.0
        } else {
            (specular / (specular + diffuse)).clamp(0.1, 0.9)
        }
    }

    #[inline]
    fn mix(&self, lobe: impl Fn(Ndf) -> f32) -> f32 {
        match self.ggx {
            0.0 => lobe(Ndf::Beckmann),
            1.0 => lobe(Ndf::Ggx),
            share => (1.0 - share) * lobe(Ndf::Beckmann) + share * lobe(Ndf::Ggx),
        }
    }
}

/// The microfacet normal that mirrors `wi` into `wo`, and `ω_i·ω_h`, which for unit vectors is
/// half the length of their sum: symmetric to the last bit, and accurate where the directions
/// are nearly opposite. `None` within 1e-6 of the horizon, both.
#[inline]
fn half_vector(wi: Local, wo: Local) -> Option<(Local, f32)> {
    let sum = wi.0 + wo.0;
    let length = sum.length();
    (length > 1e-6).then(|| (Local(sum / length), 0.5 * length))
}
