//! What distant light makes of an unoccluded surface, tabulated once for all frames.
//!
//! ```text
//! L_open(n) = rho_d/π · I(n),   I(n) = ∫ E(ω) (n·ω)+ dω
//! ```
//!
//! The light stands still in the world frame, so the table does not depend on the turntable.

mod cube;
mod irradiance;

pub use irradiance::Irradiance;
