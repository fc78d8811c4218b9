//! Where samples go: low-discrepancy points, warps, tabulated distributions, MIS weights.

mod distribution;
mod mis;
mod sobol;
mod warp;

pub use distribution::{CellSample, Distribution1d, Distribution2d};
pub use mis::power_heuristic;
pub use sobol::{SobolPath, as_points};
pub use warp::cosine_hemisphere;
