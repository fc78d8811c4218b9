//! The dichromatic microfacet model.
//!
//! ```text
//! f(ω_i, ω_o) = rho_d/π + rho_s D(ω_h; alpha) G1(ω_i; alpha) G1(ω_o; alpha) F(ω_i·ω_h) / (4 (n·ω_i)(n·ω_o))
//! ```
//!
//! (Domon et al., Eq. 1–2), isotropic, separable Smith masking, single scattering.

mod appearance;
mod dichromatic;
mod fresnel;
mod ndf;
mod visible_slopes;

pub use appearance::Appearance;
pub use dichromatic::{BrdfSample, Dichromatic};
pub use fresnel::{Fresnel, dielectric, schlick_weight};
pub use ndf::{Alpha, AlphaError, Ndf};
