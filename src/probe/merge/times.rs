//! Exposures from overlaps: EXIF rounds (1/60 is 1/64), and shutters drift.
//!
//! ```text
//! min over τ   Σ_jk n_jk/s_jk² (τ_j − τ_k − m_jk)² + Σ_j (τ_j − ln t_j)²/p²,     m_jk = median ln x_j/x_k
//! ```
//!
//! over pixels that are well exposed in both frames. Where the response is unknown too, any power
//! of both explains the samples as well; the claims then keep their overall slope.

use super::MergeError;
use super::pixels::Pixels;
use super::response::Response;
use crate::probe::cholesky::solve;

/// Fewer pixels tell nothing about a pair of frames.
const LEAST_PIXELS: usize = 50;
/// Standard deviation of a claim, in ln t.
const CLAIM: f64 = 0.2;
/// Expected exposures that are neither dark nor nearly saturated. Pixels are chosen by what all their frames
/// say: chosen by the two samples themselves, those that noise lifted over the dark end made every step of
/// a noisy bracket 0.3 % too small.
const USABLE: std::ops::Range<f64> = 0.03..0.85;
/// A median of many pixels is no better than this: vignetting, drift of lamps.
const FLOOR: f64 = 1e-3;

/// Exposures by frame.
pub(super) struct Exposures {
    pub(super) exposures: Vec<f64>,
    /// Whether an overlap tells it.
    pub(super) overlaps: Vec<bool>,
}

impl Exposures {
    pub(super) fn claimed(exposures: &[f64]) -> Self {
        Self {
            exposures: exposures.to_vec(),
            overlaps: vec![false; exposures.len()],
        }
    }
}

/// Exposures from overlaps, of the same mean logarithm as the claims; of the same slope if `keep_slope`.
pub(super) fn refine(
    pixels: &Pixels,
    response: &Response,
    claimed: &[f64],
    current: &[f64],
    keep_slope: bool,
) -> Exposures {
    let n = claimed.len();
    let radiances = radiances(pixels, response, current);
    let expected =
        |channel: usize, pixel: usize, frame: usize| radiances[channel][pixel] * current[frame];
    let ln_t: Vec<f64> = claimed.iter().map(|t| t.ln()).collect();
    let mut overlaps = vec![false; n];
    // Normal equations, the claims first.
    let mut matrix = vec![0.0; n * n];
    let mut right = vec![0.0; n];
    for j in 0..n {
        matrix[j * n + j] = 1.0 / (CLAIM * CLAIM);
        right[j] = ln_t[j] / (CLAIM * CLAIM);
    }
    for j in 0..n {
        for k in 0..j {
            let usable = |channel: usize, pixel: usize| {
                [j, k]
                    .iter()
                    .all(|&f| USABLE.contains(&expected(channel, pixel, f)))
            };
            let Some((ratio, variance)) = log_ratio(pixels, response, j, k, usable) else {
                continue;
            };
            let weight = 1.0 / variance;
            (overlaps[j], overlaps[k]) = (true, true);
            matrix[j * n + j] += weight;
            matrix[k * n + k] += weight;
            matrix[j * n + k] -= weight;
            matrix[k * n + j] -= weight;
            right[j] += weight * ratio;
            right[k] -= weight * ratio;
        }
    }
    let mut refined = solve(matrix, right).unwrap_or_else(|| ln_t.clone());

    let mean = |values: &[f64]| values.iter().sum::<f64>() / n as f64;
    let (claimed_mean, refined_mean) = (mean(&ln_t), mean(&refined));
    let mut slope = 1.0;
    if keep_slope {
        let cross: f64 = (ln_t.iter().zip(&refined))
            .map(|(c, r)| (c - claimed_mean) * (r - refined_mean))
            .sum();
        let square: f64 = refined.iter().map(|r| (r - refined_mean).powi(2)).sum();
        if cross > 0.0 && square > 0.0 {
            slope = cross / square;
        }
    }
    for r in &mut refined {
        *r = claimed_mean + slope * (*r - refined_mean);
    }
    Exposures {
        exposures: refined.into_iter().map(f64::exp).collect(),
        overlaps,
    }
}

/// `[channel][pixel]` `Σ x / Σ t` over unsaturated samples.
fn radiances(pixels: &Pixels, response: &Response, exposures: &[f64]) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|channel| {
        pixels
            .of(channel)
            .map(|samples| {
                let lit = samples.iter().zip(exposures);
                let (x, t) = lit.filter(|(v, _)| **v < pixels.saturation).fold(
                    (0.0, 0.0),
                    |(x, t), (&v, exposure)| {
                        (x + f64::from(response.linearise(channel, v)), t + exposure)
                    },
                );
                x / t
            })
            .collect()
    })
}

/// Median of `ln x_j/x_k` over the pixels that are `usable` by channel and number, and its variance.
fn log_ratio(
    pixels: &Pixels,
    response: &Response,
    j: usize,
    k: usize,
    usable: impl Fn(usize, usize) -> bool,
) -> Option<(f64, f64)> {
    let mut ratios = Vec::new();
    for channel in 0..3 {
        for (pixel, samples) in pixels.of(channel).enumerate() {
            let (a, b) = (samples[j], samples[k]);
            if pixels.well_exposed(a) && pixels.well_exposed(b) && usable(channel, pixel) {
                let (x, y) = (
                    response.linearise(channel, a),
                    response.linearise(channel, b),
                );
                if x > 0.0 && y > 0.0 {
                    ratios.push(f64::from(x / y).ln());
                }
            }
        }
    }
    if ratios.len() < LEAST_PIXELS {
        return None;
    }
    let middle = median(&mut ratios)?;
    let mut spread: Vec<f64> = ratios.iter().map(|r| (r - middle).abs()).collect();
    let sigma = 1.4826 * median(&mut spread)?;
    // A median's variance is π/2 that of a mean.
    let variance = 1.57 * sigma * sigma / ratios.len() as f64 + FLOOR * FLOOR;
    Some((middle, variance))
}

/// Whether samples grow as the exposures do: linear, and not encoded for a screen (slope 1/2.2).
pub(super) fn looks_linear(pixels: &Pixels, exposures: &[f64]) -> Result<bool, MergeError> {
    let linear = Response::linear();
    let mut slopes = Vec::new();
    for j in 0..exposures.len() {
        for k in 0..j {
            let stops = (exposures[j] / exposures[k]).ln();
            if stops.abs() > 0.2
                && let Some((ratio, _)) = log_ratio(pixels, &linear, j, k, |_, _| true)
            {
                slopes.push(ratio / stops);
            }
        }
    }
    match median(&mut slopes) {
        Some(slope) if slope < 0.1 => Err(MergeError::Data {
            reason: format!(
                "samples grow with the power {slope:.2} of the exposures: the times do not belong to the images"
            ),
            remedy: "check EXIF, or give the times with --times in the order of the files",
        }),
        Some(slope) => Ok(slope > 0.85),
        None => Err(MergeError::Data {
            reason: "no two exposures overlap, so that nothing tells the response".to_owned(),
            remedy: "add exposures in between, or give --response linear, srgb or a file",
        }),
    }
}

/// The middle value; `None` of none. Sorts.
pub(super) fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    let n = values.len();
    if n == 0 {
        None
    } else {
        Some(0.5 * (values[(n - 1) / 2] + values[n / 2]))
    }
}
