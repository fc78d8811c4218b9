//! How a curved patch widens a lobe.
//!
//! Normals that vary by `σ²` per axis blur the density of slopes by a Gaussian. Beckmann's density is one
//! itself, of variance `alpha²/2` per axis, so that it stays one:
//!
//! ```text
//! B(alpha) ∗ N(σ²) = B(√(alpha² + 2σ²))
//! ```
//!
//! (Tokuyoshi and Kaplanyan 2019). GGX is a mixture of Beckmann's, `1/alpha'²` being exponential with mean
//! `1/alpha²`, and each of them widens by itself:
//!
//! ```text
//! G(alpha) ∗ N(σ²) = G(alpha) + ∫ q(alpha'; alpha) [B(√(alpha'² + 2σ²)) − B(alpha')] d ln alpha'
//! q = 2 r² exp(−r²),   r = alpha / alpha'
//! ```
//!
//! The core of GGX widens twice as fast as by `√(alpha² + 2σ²)`, and its tail, which that would brighten,
//! not at all. Traces are linear in the density but for the masking, which the difference hardly knows.

use std::sync::LazyLock;

use glam::Vec3;

use super::columns::{RANGE, ROUGHNESSES, ln_step, roughness};
use super::lobe_table::Stencil;
use crate::brdf::Ndf;

/// `[roughness of GGX][roughness of Beckmann]` the mixture; lobes narrower than the grid's count as its
/// narrowest, and wider ones do not change.
static MIXTURE: LazyLock<[[f32; ROUGHNESSES]; ROUGHNESSES]> = LazyLock::new(|| {
    let step = ln_step() as f32;
    std::array::from_fn(|k| {
        let mut weights: [f32; ROUGHNESSES] = std::array::from_fn(|j| {
            let r = roughness(k) / roughness(j);
            2.0 * r * r * (-r * r).exp() * step
        });
        let beyond = roughness(k) / RANGE.0 * (0.5 * step).exp();
        weights[0] += (-beyond * beyond).exp();
        weights
    })
});

/// Normals' variance over the squared roughness below which the narrowest lobe does not notice.
const UNNOTICED: f32 = 1e-4;

/// What a patch does to the lobes of the grid.
pub(super) struct Widening {
    /// `[roughness]` where each widened lobe of Beckmann's lies in the grid; none if nothing changes.
    places: Option<[Stencil; ROUGHNESSES]>,
}

impl Widening {
    /// That of a patch whose normals vary by `normal_variance` (radian² per axis).
    pub(super) fn of(normal_variance: f32) -> Self {
        let place = |k: usize| {
            let alpha = roughness(k);
            Stencil::at(f64::from(
                0.5 * (alpha * alpha + 2.0 * normal_variance).ln(),
            ))
        };
        let is_noticed = normal_variance > UNNOTICED * RANGE.0 * RANGE.0;
        Self {
            places: is_noticed.then(|| std::array::from_fn(place)),
        }
    }

    /// Traces `[ndf][roughness]` of a flat patch, widened.
    pub(super) fn of_lobes(&self, flat: &[[Vec3; ROUGHNESSES]; 2]) -> [[Vec3; ROUGHNESSES]; 2] {
        let Some(places) = &self.places else {
            return *flat;
        };
        let [beckmann, ggx] = [Ndf::Beckmann, Ndf::Ggx].map(|ndf| &flat[ndf as usize]);
        let widened: [Vec3; ROUGHNESSES] = std::array::from_fn(|k| {
            let nodes = beckmann[places[k].first..].iter().zip(&places[k].value);
            nodes.map(|(node, weight)| *node * *weight as f32).sum()
        });
        let mut blurred = *ggx;
        for (blurred, weights) in blurred.iter_mut().zip(MIXTURE.iter()) {
            for ((weight, wide), narrow) in weights.iter().zip(&widened).zip(beckmann) {
                *blurred += *weight * (*wide - *narrow);
            }
            *blurred = blurred.max(Vec3::ZERO);
        }
        let mut lobes = *flat;
        lobes[Ndf::Beckmann as usize] = widened;
        lobes[Ndf::Ggx as usize] = blurred;
        lobes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::Alpha;
    use crate::geometry::Local;

    /// Densities of slopes at a slope, of every roughness: D cos⁴.
    fn densities(slope: f32) -> [[Vec3; ROUGHNESSES]; 2] {
        let half = Local(Vec3::new(slope, 0.0, 1.0).normalize());
        Ndf::ALL.map(|ndf| {
            std::array::from_fn(|k| {
                let density = ndf.density(half, Alpha::saturating(roughness(k)));
                Vec3::splat(density * half.0.z.powi(4))
            })
        })
    }

    /// Against the integral of the density over Gaussian slopes.
    #[test]
    fn widened_densities_are_blurred_ones() {
        for k in (6..ROUGHNESSES - 4).step_by(3) {
            let alpha = roughness(k);
            for share in [0.1f32, 0.25, 0.5] {
                let sigma = share * alpha;
                for place in [0.0, 0.5, 1.0, 2.0, 4.0] {
                    let slope = place * alpha;
                    let widened = Widening::of(sigma * sigma).of_lobes(&densities(slope));
                    let mut blurred = [0.0f64; 2];
                    let n = 48;
                    let mut mass = 0.0f64;
                    for i in 0..n * n {
                        let at = |i: usize| (i as f32 + 0.5) / n as f32 * 10.0 - 5.0;
                        let (x, y) = (at(i % n), at(i / n));
                        let weight = f64::from((-0.5 * (x * x + y * y)).exp());
                        mass += weight;
                        let there = densities((slope + sigma * x).hypot(sigma * y));
                        for (sum, lobe) in blurred.iter_mut().zip(there) {
                            *sum += weight * f64::from(lobe[k].x);
                        }
                    }
                    for ndf in Ndf::ALL {
                        let exact = (blurred[ndf as usize] / mass) as f32;
                        let peak = densities(0.0)[ndf as usize][k].x;
                        let error = (widened[ndf as usize][k].x - exact).abs();
                        assert!(
                            error < 0.01 * exact + 2e-3 * peak,
                            "{ndf:?} alpha {alpha}, sigma {sigma}, slope {slope}: off by {error} of {exact}"
                        );
                    }
                }
            }
        }
    }
}
