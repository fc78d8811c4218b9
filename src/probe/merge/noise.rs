//! The noise of a bracket, measured from how its frames disagree.
//!
//! ```text
//! σ²(x) = a x + b + q(x)²/12 + (c x)²
//! ```
//!
//! in linear exposure x, 1 the white: shot noise a, read noise b, quantisation to steps of q, and what
//! response and exposures may leave. a and b are fitted to the spread of `x_j − t_j L̂` as if that last term were 0:
//! it is a bound, and taking it off would leave a well-behaved bracket too little noise.

use super::pixels::Pixels;
use super::response::Response;
use super::times::median;
use crate::image::Depth;

/// What response, exposures and vignetting leave, relative: enough that no bright texel, whose noise is
/// small, is taken for a ghost.
const MODEL: f32 = 0.01;
/// The least read noise: 14 bits' half step.
const LEAST: f64 = 1e-9;
/// Bins of x, even in the logarithm, from 1e-4 to 1, and pixels that one needs.
const BINS: usize = 24;
const LEAST_PIXELS: usize = 100;

/// Variance of a linear exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Variance by exposure, a.
    pub shot: f32,
    /// Variance in the dark, b.
    pub read: f32,
    /// Steps of 255 that one step of the file is wide: 1 for 8 bits, 1/257 for 16, 0 for floats.
    pub quantum: f32,
}

impl Noise {
    /// Variance of exposure `x` where a step of 255 is `step` wide.
    #[inline]
    pub fn variance(&self, x: f32, step: f32) -> f32 {
        let quantum = self.quantum * step;
        let x = x.max(0.0);
        self.shot * x + self.read + quantum * quantum / 12.0 + MODEL * MODEL * x * x
    }

    /// Fits it.
    pub(super) fn measure(
        pixels: &Pixels,
        response: &Response,
        exposures: &[f64],
        depth: Depth,
    ) -> Self {
        let quantum = match depth {
            Depth::Bits8 => 1.0,
            Depth::Bits16 => 255.0 / 65535.0,
            Depth::Float | Depth::Raw => 0.0,
        };
        // Spread of the residuals by expected exposure, less the quantisation.
        let mut bins: Vec<Vec<f64>> = vec![Vec::new(); BINS];
        let mut quanta = [0.0; BINS];
        for channel in 0..3 {
            for samples in pixels.of(channel) {
                let lit: Vec<(f64, f64, f32)> = (samples.iter().zip(exposures))
                    .filter(|(v, _)| **v < pixels.saturation)
                    .map(|(&v, &t)| (f64::from(response.linearise(channel, v)), t, v))
                    .collect();
                let sum_t: f64 = lit.iter().map(|s| s.1).sum();
                let radiance = lit.iter().map(|s| s.0).sum::<f64>() / sum_t;
                for (x, t, v) in &lit {
                    let expected = t * radiance;
                    let place = (1.0 + expected.max(1e-9).log10() / 4.0) * BINS as f64;
                    // A sample that is nearly alone makes its own mean.
                    let free = 1.0 - t / sum_t;
                    if place < 0.0 || place >= BINS as f64 || free < 0.1 {
                        continue;
                    }
                    let step = f64::from(quantum * response.step(channel, *v));
                    bins[place as usize].push((x - expected).abs() / free.sqrt());
                    quanta[place as usize] += step * step / 12.0;
                }
            }
        }

        // Weighted by relative precision: min Σ n ((a x + b − s²)/s²)², a, b ≥ 0.
        let mut sums = [0.0; 5];
        for (bin, residuals) in bins.iter_mut().enumerate() {
            let n = residuals.len();
            if n < LEAST_PIXELS {
                continue;
            }
            let Some(spread) = median(residuals).map(|m| 1.4826 * m) else {
                continue;
            };
            let x = 10f64.powf(4.0 * ((bin as f64 + 0.5) / BINS as f64 - 1.0));
            let total = spread * spread;
            let own = (total - quanta[bin] / n as f64).max(0.0);
            let weight = n as f64 / (total + LEAST).powi(2);
            for (sum, term) in sums.iter_mut().zip([x * x, x, 1.0, x * own, own]) {
                *sum += weight * term;
            }
        }
        let [xx, x, one, xy, y] = sums;
        let determinant = xx * one - x * x;
        let (mut shot, mut read) = if determinant > 0.0 {
            (
                (xy * one - x * y) / determinant,
                (xx * y - x * xy) / determinant,
            )
        } else {
            (0.0, 0.0)
        };
        if shot < 0.0 {
            (shot, read) = (0.0, if one > 0.0 { y / one } else { 0.0 });
        } else if read < 0.0 {
            (shot, read) = (if xx > 0.0 { xy / xx } else { 0.0 }, 0.0);
        }
        Self {
            shot: shot.max(0.0) as f32,
            read: read.max(LEAST) as f32,
            quantum,
        }
    }
}
