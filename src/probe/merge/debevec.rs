//! The response by Debevec and Malik, *Recovering High Dynamic Range Radiance Maps from Photographs*, 1997.
//!
//! ```text
//! min over g, ln L   Σ_ij w(v_ij)² (g(v_ij) − ln L_i − ln t_j)² + λ Σ_k (D_k g)²,   g = ln f   (Eq. 3)
//! ```
//!
//! The radiances are eliminated: given `g` each is a weighted mean, which leaves 256 unknowns however
//! many pixels speak. `D_k g` is the change of `d g/d ln v` at level k, so that a power law, which most
//! responses nearly are, costs nothing; the paper's second difference bends the dark end. Three rounds
//! of Tukey's weights take what moved out of the sum.

use super::pixels::Pixels;
use super::response::{LEVELS, MIDDLE, Response};
use super::{MergeError, times::median};
use crate::probe::cholesky::solve as cholesky;

/// λ over the mean weight of a level. Frames far apart leave waves of their distance open: at 0.02 the three
/// photographs of an office, 3 stops apart, came out 0.3 stops off at level 235 against other solvers;
/// at 2, curves that are no power law are flattened by 0.7 % on the mean instead of 0.3 %.
const SMOOTHNESS: f64 = 0.2;

/// Levels that must be seen well exposed in two frames.
pub(super) const LEAST_LEVELS: usize = 64;

/// A well-exposed sample of one of a pixel's frames.
struct Sample {
    /// Level below, and share of the level above.
    level: usize,
    share: f64,
    /// The paper's weight, and with what it still counts.
    hat: f64,
    weight: f64,
    /// `ln t_j`.
    exposure: f64,
}

pub(super) fn response(pixels: &Pixels, exposures: &[f64]) -> Result<Response, MergeError> {
    let ln_t: Vec<f64> = exposures.iter().map(|t| t.ln()).collect();
    let mut logarithms: [Vec<f64>; 3] = Default::default();
    for (channel, g) in logarithms.iter_mut().enumerate() {
        let mut groups: Vec<Vec<Sample>> = pixels
            .of(channel)
            .map(|samples| samples_of(pixels, samples, &ln_t))
            .filter(|group| group.len() > 1)
            .collect();
        let mut seen = [false; LEVELS];
        groups.iter().flatten().for_each(|s| seen[s.level] = true);
        let count = seen.iter().filter(|&&s| s).count();
        if count < LEAST_LEVELS {
            return Err(MergeError::Data {
                reason: format!(
                    "only {count} of 256 levels are seen well exposed in two frames, too few to \
                     recover the response"
                ),
                remedy: "add exposures in between, or give --response linear, srgb or a file",
            });
        }
        for round in 0..4 {
            *g = solve(&groups)?;
            if round < 3 {
                reweigh(&mut groups, g);
            }
        }
    }
    Ok(Response::from_logarithms(logarithms))
}

fn samples_of(pixels: &Pixels, samples: &[f32], ln_t: &[f64]) -> Vec<Sample> {
    samples
        .iter()
        .zip(ln_t)
        .filter(|(v, _)| pixels.well_exposed(**v))
        .map(|(&v, &exposure)| {
            let place = f64::from(v) * (LEVELS - 1) as f64;
            let level = (place as usize).min(LEVELS - 2);
            // The paper's hat, squared as its objective squares it.
            let hat = 2.0 * f64::from(v.min(1.0 - v)).max(0.0);
            Sample {
                level,
                share: place - level as f64,
                hat: (hat * hat).max(1e-6),
                weight: (hat * hat).max(1e-6),
                exposure,
            }
        })
        .collect()
}

impl Sample {
    fn value(&self, g: &[f64]) -> f64 {
        (1.0 - self.share) * g[self.level] + self.share * g[self.level + 1]
    }

    fn row(&self) -> [(usize, f64); 2] {
        [(self.level, 1.0 - self.share), (self.level + 1, self.share)]
    }
}

/// `ln L` of a pixel given the response; `None` if none of its samples counts.
fn radiance(group: &[Sample], g: &[f64]) -> Option<f64> {
    let weight: f64 = group.iter().map(|s| s.weight).sum();
    let terms = group.iter().map(|s| s.weight * (s.value(g) - s.exposure));
    (weight > 0.0).then(|| terms.sum::<f64>() / weight)
}

/// Tukey's weights: none beyond 4.7 standard deviations.
fn reweigh(groups: &mut [Vec<Sample>], g: &[f64]) {
    let mut residuals: Vec<f64> = Vec::new();
    for group in groups.iter() {
        let radiance = radiance(group, g);
        residuals.extend(group.iter().map(|s| match radiance {
            Some(radiance) => (s.value(g) - s.exposure - radiance).abs(),
            None => f64::INFINITY,
        }));
    }
    let scale = 4.685 * 1.4826 * median(&mut residuals.clone()).unwrap_or(0.0).max(1e-6);
    let mut residuals = residuals.into_iter();
    for sample in groups.iter_mut().flatten() {
        let r = residuals.next().unwrap_or(0.0) / scale;
        let kept = (1.0 - r * r).max(0.0);
        sample.weight = sample.hat * kept * kept;
    }
}

/// The normal equations with the radiances eliminated, and their solution.
fn solve(groups: &[Vec<Sample>]) -> Result<Vec<f64>, MergeError> {
    let mut matrix = vec![0.0; LEVELS * LEVELS];
    let mut right = vec![0.0; LEVELS];
    let mut total = 0.0;
    for group in groups {
        let weight: f64 = group.iter().map(|s| s.weight).sum();
        if weight <= 0.0 {
            continue;
        }
        let mean: f64 = group.iter().map(|s| s.weight * s.exposure).sum::<f64>() / weight;
        total += weight;
        for s in group {
            for (i, a) in s.row() {
                right[i] += s.weight * a * (s.exposure - mean);
                for (j, b) in s.row() {
                    matrix[i * LEVELS + j] += s.weight * a * b;
                }
                for other in group {
                    for (j, b) in other.row() {
                        matrix[i * LEVELS + j] -= s.weight * other.weight * a * b / weight;
                    }
                }
            }
        }
    }

    add_smoothness(&mut matrix, total);
    // The scale is open: the middle level is 0.
    matrix[MIDDLE * LEVELS + MIDDLE] += total;

    cholesky(matrix, right).ok_or(MergeError::Data {
        reason: "the exposures do not determine the response".to_owned(),
        remedy: "give --response linear, srgb or a file",
    })
}

/// Adds `λ Σ_k (D_k g)²` for data that weigh `total`: the change of the slope in ln v; level 0 stands at half a level.
pub(super) fn add_smoothness(matrix: &mut [f64], total: f64) {
    let lambda = SMOOTHNESS * total / LEVELS as f64;
    let ln_v = |k: usize| (k as f64).max(0.5).ln();
    for k in 1..LEVELS - 1 {
        let (below, above) = (ln_v(k) - ln_v(k - 1), ln_v(k + 1) - ln_v(k));
        let row = [
            (k - 1, 1.0 / below),
            (k, -1.0 / below - 1.0 / above),
            (k + 1, 1.0 / above),
        ];
        for (i, a) in row {
            for (j, b) in row {
                matrix[i * LEVELS + j] += lambda * a * b;
            }
        }
    }
}
