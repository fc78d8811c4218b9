//! The response by Robertson, Borman and Stevenson, *Estimation-theoretic approach to dynamic range
//! enhancement using multiple exposures*, 2003.
//!
//! ```text
//! L_i = Σ_j w(v_ij) t_j f(v_ij) / Σ_j w(v_ij) t_j²,      f(m) = mean of t_j L_i over v_ij = m   (Eq. 10, 14)
//! ```
//!
//! in alternation from a linear start, the middle level fixed.

use super::pixels::Pixels;
use super::response::{LEVELS, MIDDLE, Response};
use super::{MergeError, debevec};

/// Rounds at most, and the change of the response at which they end, relative. On simulated brackets radiance is 1.2
/// to 1.7 % off then; a thousand rounds end 1.5 to 2.6 % off, since the mean of noisy dark samples is no
/// sample of the mean. Debevec's stays below 0.9 %.
const ROUNDS: usize = 200;
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
        let f = alternate(&groups);
        // Levels that no pixel shows lie between those that some do.
        let seen: Vec<usize> = (0..LEVELS).filter(|&m| f[m] > 0.0).collect();
        if seen.len() < debevec::LEAST_LEVELS {
            return Err(MergeError::Data {
                reason: format!(
                    "only {} of 256 levels are seen well exposed in two frames, too few to recover the \
                     response",
                    seen.len()
                ),
                remedy: "add exposures in between, or give --response linear, srgb or a file",
            });
        }
        *logarithm = (0..LEVELS).map(|m| between(&seen, &f, m)).collect();
    }
    Ok(Response::from_logarithms(logarithms))
}

/// `f` by level, 0 where no pixel shows it.
fn alternate(groups: &[Vec<(usize, f64)>]) -> Vec<f64> {
    let weight = |m: usize| {
        let z = (m as f64 - 127.5) / 127.5;
        (-4.0 * z * z).exp()
    };
    let mut f: Vec<f64> = (0..LEVELS).map(|m| m as f64 / MIDDLE as f64).collect();
    for _ in 0..ROUNDS {
        let (mut sums, mut counts) = (vec![0.0; LEVELS], vec![0usize; LEVELS]);
        for group in groups {
            let (mut up, mut down) = (0.0, 0.0);
            for &(m, t) in group {
                up += weight(m) * t * f[m];
                down += weight(m) * t * t;
            }
            for &(m, t) in group {
                sums[m] += t * up / down;
                counts[m] += 1;
            }
        }
        let mut next: Vec<f64> = (sums.iter().zip(&counts))
            .map(|(sum, &count)| if count > 0 { sum / count as f64 } else { 0.0 })
            .collect();
        let middle = (0..LEVELS)
            .filter(|&m| next[m] > 0.0)
            .min_by_key(|m| m.abs_diff(MIDDLE))
            .map_or(1.0, |m| next[m]);
        next.iter_mut().for_each(|x| *x /= middle);
        let change = (next.iter().zip(&f))
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        f = next;
        if change < STILL {
            break;
        }
    }
    f
}

/// `ln f` at level `m` from the levels seen, straight in `ln m`, beyond them along the end.
fn between(seen: &[usize], f: &[f64], m: usize) -> f64 {
    let ln = |m: usize| (m as f64).max(0.5).ln();
    let after = seen.partition_point(|&s| s < m).clamp(1, seen.len() - 1);
    let (a, b) = (seen[after - 1], seen[after]);
    let share = (ln(m) - ln(a)) / (ln(b) - ln(a));
    f[a].ln() + share * (f[b].ln() - f[a].ln())
}
