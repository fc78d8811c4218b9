//! The response by Robertson, Borman and Stevenson, *Estimation-theoretic approach to dynamic range
//! enhancement using multiple exposures*, 2003.
//!
//! ```text
//! L_i = Σ_j w(v_ij) t_j f(v_ij) / Σ_j w(v_ij) t_j²,      f(m) = mean of t_j L_i over v_ij = m   (Eq. 10, 14)
//! ```
//!
//! in alternation from a linear start, the middle level fixed; with two changes, without either of which radiance comes
//! out 1.5 % off on simulated brackets instead of 0.8 %, and smoothed at the end. A sample is not asked about its own level: L_i is that of the
//! pixel's *other* samples, since a mean that contains the sample bends every f(m) towards itself. And the bell w
//! is lowered to 0 at its ends: at e⁻⁴, nearly saturated samples outweigh all others by their t².

use std::collections::BTreeSet;

use super::pixels::Pixels;
use super::response::{LEVELS, MIDDLE, Response};
use super::{MergeError, debevec};
use crate::probe::cholesky::solve as cholesky;

/// Rounds at most, and the change of any level at which they end, relative. 650 to 720 rounds are usual; after 200
/// radiance is still 1.7 % off, at changes of 1e-4 up to 0.1 % more than at the end.
const ROUNDS: usize = 2000;
const STILL: f64 = 1e-5;

pub(super) fn response(pixels: &Pixels, exposures: &[f64]) -> Result<Response, MergeError> {
    let mut logarithms: [Vec<f64>; 3] = Default::default();
    for (channel, logarithm) in logarithms.iter_mut().enumerate() {
        let groups: Vec<Vec<(usize, f64)>> = pixels
            .of(channel)
            .map(|samples| {
                let lit = samples.iter().zip(exposures);
                lit.filter(|(v, _)| pixels.well_exposed(**v))
                    .map(|(&v, &t)| ((v * (LEVELS - 1) as f32).round() as usize, t))
                    .collect::<Vec<_>>()
            })
            .filter(|group| group.len() > 1)
            .collect();
        let levels: BTreeSet<usize> = groups.iter().flatten().map(|&(m, _)| m).collect();
        if levels.len() < debevec::LEAST_LEVELS {
            return Err(MergeError::Data {
                reason: format!(
                    "only {} of 256 levels are seen well exposed in two frames, too few to recover the \
                     response",
                    levels.len()
                ),
                remedy: "add exposures in between, or give --response linear, srgb or a file",
            });
        }
        *logarithm = smooth(&groups, &alternate(&groups))?;
    }
    Ok(Response::from_logarithms(logarithms))
}

/// `ln f`, as smooth as Debevec's: levels are told apart by some hundred noisy samples each, and left alone their
/// scatter makes radiance a fifth worse.
fn smooth(groups: &[Vec<(usize, f64)>], f: &[f64]) -> Result<Vec<f64>, MergeError> {
    let mut matrix = vec![0.0; LEVELS * LEVELS];
    let mut right = vec![0.0; LEVELS];
    let mut total = 0.0;
    for &(m, _) in groups.iter().flatten() {
        matrix[m * LEVELS + m] += 1.0;
        right[m] += f[m].ln();
        total += 1.0;
    }
    debevec::add_smoothness(&mut matrix, total);
    cholesky(matrix, right).ok_or(MergeError::Data {
        reason: "the exposures do not determine the response".to_owned(),
        remedy: "give --response linear, srgb or a file",
    })
}

/// `f` by level.
fn alternate(groups: &[Vec<(usize, f64)>]) -> Vec<f64> {
    let bell = |m: usize| {
        let z = (m as f64 - 127.5) / 127.5;
        (-4.0 * z * z).exp()
    };
    let weights: Vec<f64> = (0..LEVELS)
        .map(|m| (bell(m) - bell(0)) / (1.0 - bell(0)))
        .collect();
    // The darkest level stands for half a step: its logarithm is asked for.
    let mut f: Vec<f64> = (0..LEVELS)
        .map(|m| (m as f64).max(0.5) / MIDDLE as f64)
        .collect();
    for _ in 0..ROUNDS {
        let (mut sums, mut counts) = (vec![0.0; LEVELS], vec![0usize; LEVELS]);
        for group in groups {
            let (mut up, mut down) = (0.0, 0.0);
            for &(m, t) in group {
                up += weights[m] * t * f[m];
                down += weights[m] * t * t;
            }
            for &(m, t) in group {
                let (others, exposure) = (up - weights[m] * t * f[m], down - weights[m] * t * t);
                // What rounding leaves of a sample that is alone is no radiance.
                if exposure > 1e-9 * down && others > 0.0 {
                    sums[m] += t * others / exposure;
                    counts[m] += 1;
                }
            }
        }
        let means: Vec<(usize, f64)> = (0..LEVELS)
            .filter(|&m| counts[m] > 0)
            .map(|m| (m, sums[m] / counts[m] as f64))
            .collect();
        if means.len() < 2 {
            break;
        }
        let mut next: Vec<f64> = (0..LEVELS).map(|m| between(&means, m)).collect();
        let middle = next[MIDDLE];
        next.iter_mut().for_each(|x| *x /= middle);
        let change = (next.iter().zip(&f))
            .map(|(a, b)| (a / b).ln().abs())
            .fold(0.0, f64::max);
        f = next;
        if change < STILL {
            break;
        }
    }
    f
}

/// `f` at level `m` from the levels seen, a power of `m` between them, beyond them as at the end.
fn between(seen: &[(usize, f64)], m: usize) -> f64 {
    let ln = |m: usize| (m as f64).max(0.5).ln();
    let after = seen
        .partition_point(|&(level, _)| level < m)
        .clamp(1, seen.len() - 1);
    let ((a, low), (b, high)) = (seen[after - 1], seen[after]);
    let share = (ln(m) - ln(a)) / (ln(b) - ln(a));
    (low.ln() + share * (high.ln() - low.ln())).exp()
}
