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
mod forecast;
mod forward_model;
mod fresnel_model;
mod full;
mod gloss;
mod gradient;
mod half_angle;
mod interreflection;
mod least_squares;
mod light_cut;
mod lobe_cells;
mod lobe_form;
mod lobe_table;
mod lobe_weights;
mod model_choice;
mod non_negative;
mod noise;
mod normal_table;
mod objective;
mod pooling;
mod problem;
mod refraction;
mod representatives;
mod search;
mod tabulated;
mod uncertainty;
mod unknown_light;
mod visibility;
mod widening;

#[cfg(test)]
mod error_laws;
#[cfg(test)]
mod fresnel_laws;
#[cfg(test)]
mod forecast_laws;
#[cfg(test)]
mod laws;
#[cfg(test)]
mod reason_laws;
#[cfg(test)]
mod representatives_laws;
#[cfg(test)]
mod turntable;
#[cfg(test)]
mod unknown_light_laws;

pub use fit::{Fit, FitStats, fit};
pub use forecast::{CapturePlan, FORECAST_ALPHAS, Forecast, Forecaster, Lamp, UNKNOWN};
pub use fresnel_model::FresnelModel;
pub use tabulated::{TabulatedGroup, TabulatedNdf};
pub use unknown_light::EstimatedLight;

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
    /// The same with the light unknown, which is estimated in turns with the materials (Dong et al.
    /// 2014).
    UnknownLight,
}

/// Colour of the specular albedo.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SpecularColour {
    /// Whichever the data ask for, by the evidence of all points.
    Auto,
    /// One value for all channels.
    Neutral,
    /// One per channel.
    Rgb,
}

/// Which points share a lobe. The diffuse albedo is every point's own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pooling {
    /// None: every point stands alone.
    #[default]
    None,
    /// Neighbours whose data agree.
    Smooth,
    /// All of a material; how many materials there are is found from the data.
    Material,
    /// All.
    Object,
}

/// What a fit may choose, and how much work it does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FitSettings {
    /// Method.
    pub estimator: Estimator,
    /// The NDF, or `None` to try both and keep the smaller residual.
    #[serde(serialize_with = "ndf_name")]
    pub ndf: Option<Ndf>,
    /// Whether the NDF is also tabulated, without a formula, beside the parametric lobe.
    pub tabulated: bool,
    /// Colour of the specular albedo.
    pub specular: SpecularColour,
    /// Which points share a lobe. Alone unless asked for: pooling smears a texture of roughness, and
    /// the error bars of single points are honest.
    pub pool: Pooling,
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
            tabulated: false,
            specular: SpecularColour::Neutral,
            pool: Pooling::None,
            fresnel: FresnelModel::Dielectric { eta: 1.3 },
            light_nodes: 512,
            interreflections: 2,
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

/// What stands in the way of a roughness. The number is its code in `points.npz`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[repr(i32)]
pub enum Reason {
    /// Nothing: alpha is determined, or there are no samples at all.
    None = 0,
    /// Too few frames or samples to tell a lobe from diffuse light.
    TooFewFrames = 1,
    /// The point never looks where a lobe would show: a specular albedo of 1 would not be noticed.
    NoHighlight = 2,
    /// The lobe's trace is, to the noise, a multiple of the diffuse one.
    Collinear = 3,
    /// A specular albedo of 1 would be noticed, and there is none above the noise.
    LobeBelowNoise = 4,
    /// Two roughnesses explain the data about equally well.
    TwoMinima = 5,
    /// A lobe is seen, but the data do not tell its width.
    WidthUndetermined = 6,
}

impl Reason {
    /// All, in the order of their codes.
    pub const ALL: [Self; 7] = [
        Self::None,
        Self::TooFewFrames,
        Self::NoHighlight,
        Self::Collinear,
        Self::LobeBelowNoise,
        Self::TwoMinima,
        Self::WidthUndetermined,
    ];
}

/// A point's parameters, their uncertainty, and how they were reached.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Diffuse albedo, linear RGB.
    pub rho_d: Vec3,
    /// Specular albedo, linear RGB (equal where neutral); reflectance at normal incidence where `f90` is
    /// some.
    pub rho_s: Vec3,
    /// Schlick's reflectance at grazing; none under a dielectric's Fresnel term.
    pub f90: Option<f32>,
    /// Index of refraction; none under Schlick's Fresnel term.
    pub eta: Option<f32>,
    /// Roughness.
    pub alpha: f32,
    /// The NDF with the smaller residual.
    pub ndf: Ndf,
    /// Standard deviation of `rho_d`, by channel; infinite where the data do not determine it.
    pub sigma_rho_d: Vec3,
    /// Standard deviation of `rho_s` (largest channel).
    pub sigma_rho_s: f32,
    /// `alpha` times the standard deviation of `ln alpha`: over the profile likelihood, rival minima
    /// and the other NDF included.
    pub sigma_alpha: f32,
    /// `ln L_ggx − ln L_beckmann`, each at its best; NaN where only one was tried.
    pub ndf_evidence: f32,
    /// Roughness of the second-best local minimum; NaN if there is none.
    pub second_alpha: f32,
    /// Its ln likelihood less that of the estimate; NaN if there is none.
    pub second_evidence: f32,
    /// Frames in which the point is seen.
    pub frames: u32,
    /// Root-mean-square residual relative to the root-mean-square observation.
    pub residual: f32,
    /// Root-mean-square residual relative to the noise, robust against single outliers.
    pub misfit: f32,
    /// How it ended.
    pub status: Status,
    /// What stands in the way of a roughness.
    pub reason: Reason,
    /// Number of its material, where points were pooled by material or object.
    pub material: Option<u32>,
}

impl Estimate {
    /// What is said of a point without data.
    fn without_data(status: Status, frames: u32) -> Self {
        Self {
            rho_d: Vec3::ZERO,
            rho_s: Vec3::ZERO,
            f90: None,
            eta: Some(fresnel_model::PAPER_ETA),
            alpha: 1.0,
            ndf: Ndf::Ggx,
            sigma_rho_d: Vec3::INFINITY,
            sigma_rho_s: f32::INFINITY,
            sigma_alpha: f32::INFINITY,
            frames,
            ndf_evidence: f32::NAN,
            second_alpha: f32::NAN,
            second_evidence: f32::NAN,
            residual: 0.0,
            misfit: 1.0,
            status,
            reason: Reason::None,
            material: None,
        }
    }
}
