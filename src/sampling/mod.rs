//! Where samples go: low-discrepancy points and warps.

mod sobol;
mod warp;

pub use sobol::{SobolPath, as_points};
pub use warp::cosine_hemisphere;
