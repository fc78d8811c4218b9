//! The colours of the probe's camera made those of the object's camera, from a chart seen by both.
//!
//! ```text
//! camera = M · curve(probe),     min over M   Σ_patches ΔE²/(1 + ΔE)
//! ```
//!
//! The curve comes from greys of known reflectance ([`GreyCurve`]), `M` (3 × 3) from colours. ΔE2000
//! stands for the eye, so that a dark patch counts as much as a bright one.

mod chart;
mod curve;
mod error;
mod lab;
mod matching;

#[cfg(test)]
mod laws;

pub use chart::{Chart, Patch};
pub use curve::GreyCurve;
pub use error::ColourError;
pub use lab::{Lab, delta_e_2000};
pub use matching::{ColourMatch, PatchResidual, match_colours};
