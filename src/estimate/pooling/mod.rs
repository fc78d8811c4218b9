//! Points that share a lobe: alpha, NDF and specular albedo from many points at once, rho_d from each.
//!
//! With its diffuse albedos eliminated, a point's weighted squared residual is quadratic in the lobe's
//! albedos, with coefficients that are known at every roughness from sums that need no observation again
//! (see [`super::lobe_table`]):
//!
//! ```text
//! S_i(alpha, rho_s) = c_i − 2 b_i(alpha) rho_s + a_i(alpha) rho_s²
//! ```
//!
//! So what a group of points says together is the sum of its members' functions, its minimum is found as
//! a single point's is, and points weigh by what they know: their `a_i` is their information. A member's
//! deviance from the group, `S_i(group) − min S_i`, is χ² of as many degrees of freedom as the lobe has
//! parameters, if the member is of the group's material.

mod material;
mod object;
mod profile;
mod smooth;

#[cfg(test)]
mod laws;

pub(super) use profile::PointProfile;

use profile::Group;

use super::problem::Model;
use super::{Estimate, Pooling};

/// Replaces the lobes of points with data by pooled ones; returns the number of lobes that differ, by
/// the kind of pooling: materials, or nothing to count.
pub(super) fn pool(
    pooling: Pooling,
    models: &[Model],
    profiles: &[Option<PointProfile>],
    neighbours: &[Vec<u32>],
    estimates: &mut [Estimate],
) -> Option<u32> {
    match pooling {
        Pooling::None => None,
        Pooling::Object => {
            object::pool(models, profiles, estimates);
            Some(1)
        }
        Pooling::Material => Some(material::pool(models, profiles, neighbours, estimates)),
        Pooling::Smooth => {
            smooth::pool(models, profiles, neighbours, estimates);
            None
        }
    }
}
