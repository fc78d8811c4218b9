//! From traces to materials.
//!
//! For every surface point, the parameters that minimise the noise-weighted difference between the
//! observed trace and the forward model (Domon et al., Eq. 5):
//!
//! ```text
//! min over rho_d, rho_s ≥ 0, alpha, NDF of   Σ_t ‖T(t) − rho_d T_d(t) − rho_s T_s(t; alpha, NDF)‖² / σ_t²
//! T_d(t) = ∫ V E(R_t ω_i) (n·ω_i)+ dω_i / π,     T_s(t; alpha) = ∫ f_s V E(R_t ω_i) (n·ω_i)+ dω_i
//! ```
//!
//! Given alpha and NDF the albedos are a tiny non-negative least-squares problem (variable
//! projection, Golub and Pereyra 1973); what is left is a search over one number.

mod appearance;
mod columns;
mod fit;
mod fresnel_model;
mod full;
mod gloss;
mod gradient;
mod interreflection;
mod least_squares;
mod light_cut;
mod lobe_cells;
mod ndf_choice;
mod noise;
mod visibility;

#[cfg(test)]
mod laws;

pub use fit::{Fit, FitStats, fit};
pub use fresnel_model::FresnelModel;

use glam::Vec3;
use serde::Serialize;

use crate::brdf::Ndf;

/// Which method finds the parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Estimator {
    /// Variable projection with noise weights, self-shadowing and interreflection.
    Full,
    /// The paper's method: temporal gradients with the diffuse gradient taken as zero (Eq. 8), then
    /// albedos by NNLS (Eq. 10); no self-shadowing, directions within a window of the mirror
    /// direction.
    Gradient,
}

/// Colour of the specular albedo.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SpecularColour {
    /// One value for all channels.
    Neutral,
    /// One per channel.
    Rgb,
}

/// What a fit may choose, and how much work it does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FitSettings {
    /// Method.
    pub estimator: Estimator,
    /// The NDF, or `None` to try both and keep the smaller residual.
    #[serde(serialize_with = "ndf_name")]
    pub ndf: Option<Ndf>,
    /// Colour of the specular albedo.
    pub specular: SpecularColour,
    /// Fresnel's term.
    pub fresnel: FresnelModel,
    /// About how many light nodes an observation gets. With 512 the error of `T_s` on the four shipped
    /// probes is 0.06 to 0.6 % in the median (test `traces_reach_their_stated_errors`); it falls a little
    /// faster than their number grows.
    pub light_nodes: usize,
    /// Rounds of interreflection: 0 treats the object's own light as black.
    pub interreflections: u32,
    /// Half-angle of the `gradient` estimator's window about the mirror direction, radians.
    pub window: f32,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self {
            estimator: Estimator::Full,
            ndf: None,
            specular: SpecularColour::Neutral,
            fresnel: FresnelModel::Dielectric { eta: 1.3 },
            light_nodes: 512,
            interreflections: 3,
            window: std::f32::consts::FRAC_PI_2,
        }
    }
}

fn ndf_name<S: serde::Serializer>(ndf: &Option<Ndf>, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(match ndf {
        None => "auto",
        Some(Ndf::Beckmann) => "beckmann",
        Some(Ndf::Ggx) => "ggx",
    })
}

/// How the search for a point's parameters ended. The number is its code in `points.npz`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[repr(i32)]
pub enum Status {
    /// A minimum inside the range of alpha, which the data determine.
    Converged = 0,
    /// The data do not determine alpha: no highlight was seen, or it looks like diffuse light. The
    /// diffuse albedo may still be good; its own standard deviation tells.
    Unidentifiable = 1,
    /// The minimum is at an end of the range of alpha, [0.01, 1].
    AlphaAtBound = 2,
    /// Fewer usable samples than unknowns.
    TooFewSamples = 3,
    /// Never seen.
    Unseen = 4,
    /// Every sample is saturated.
    Saturated = 5,
}

impl Status {
    /// All, in the order of their codes.
    pub const ALL: [Self; 6] = [
        Self::Converged,
        Self::Unidentifiable,
        Self::AlphaAtBound,
        Self::TooFewSamples,
        Self::Unseen,
        Self::Saturated,
    ];
}

/// A point's parameters, their uncertainty, and how they were reached.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Diffuse albedo, linear RGB.
    pub rho_d: Vec3,
    /// Specular albedo, linear RGB (equal where neutral).
    pub rho_s: Vec3,
    /// Roughness.
    pub alpha: f32,
    /// The NDF with the smaller residual.
    pub ndf: Ndf,
    /// Standard deviation of `rho_d`, by channel; infinite where the data do not determine it.
    pub sigma_rho_d: Vec3,
    /// Standard deviation of `rho_s` (largest channel).
    pub sigma_rho_s: f32,
    /// Standard deviation of `alpha`.
    pub sigma_alpha: f32,
    /// Frames in which the point is seen.
    pub frames: u32,
    /// Root-mean-square residual relative to the root-mean-square observation.
    pub residual: f32,
    /// How it ended.
    pub status: Status,
}

impl Estimate {
    /// What is said of a point without data.
    fn without_data(status: Status, frames: u32) -> Self {
        Self {
            rho_d: Vec3::ZERO,
            rho_s: Vec3::ZERO,
            alpha: 1.0,
            ndf: Ndf::Ggx,
            sigma_rho_d: Vec3::INFINITY,
            sigma_rho_s: f32::INFINITY,
            sigma_alpha: f32::INFINITY,
            frames,
            residual: 0.0,
            status,
        }
    }
}
