//! The light: an HDR lat-long map recorded by an omni-directional camera.
//!
//! The map is a function on the sphere, bilinear between texel centres, periodic in longitude and
//! clamped towards the poles; everything here (look-up, clusters, pyramid) sees that one function.

mod clusters;
mod environment;
mod irradiance;
mod peaks;
mod pyramid;
mod repair;
mod sky;

pub use clusters::{LightClusters, LightPatch};
pub use environment::{Environment, TurnedLight};
pub use irradiance::Irradiance;
pub use peaks::SplitLight;
pub use pyramid::{LightNode, LightPyramid};
pub use repair::{ProbeError, ProbeReport, repair};
pub use sky::SkyMap;
