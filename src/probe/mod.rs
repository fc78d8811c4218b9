//! The light: an HDR lat-long map recorded by an omni-directional camera, from its photographs on.
//!
//! The map is a function on the sphere, bilinear between texel centres, periodic in longitude and
//! clamped towards the poles; everything here (look-up, clusters, pyramid) sees that one function.

mod cholesky;
mod clusters;
mod colour;
mod environment;
mod inspect;
mod irradiance;
mod merge;
mod peaks;
mod pyramid;
mod repair;
mod sky;

pub use clusters::{LightClusters, LightPatch};
pub use colour::{
    Chart, ColourError, ColourMatch, GreyCurve, Lab, Patch, PatchResidual, delta_e_2000,
    match_colours,
};
pub use environment::{Environment, TurnedLight};
pub use inspect::{Inspection, Source};
pub use irradiance::Irradiance;
pub use merge::{
    Curve, Frame, FrameRecord, MergeError, MergeSettings, Merged, Noise, Response, merge,
};
pub use peaks::SplitLight;
pub use pyramid::{LightNode, LightPyramid};
pub use repair::{ProbeError, ProbeReport, repair};
pub use sky::SkyMap;
