//! The merge of every texel: who agrees with whom, and their weighted mean.

use rayon::prelude::*;

use super::Frame;
use super::fraction::Taps;
use super::noise::Noise;
use super::pixels::at;
use super::response::Response;
use crate::image::{Mask, RgbImage};

/// Two frames disagree beyond this many standard deviations. Noise alone does so in a texel of 10^6.
const DISAGREE: f32 = 5.0;

/// A voice decides who is right if its relative error is at most so many times the least: three or four of
/// usual steps of exposure, so that one ghost among them is outvoted.
const KNOWS: f32 = 4.0;

/// What is known of the frames.
pub(super) struct Plan<'a> {
    pub(super) shifts: &'a [[f64; 2]],
    pub(super) exposures: &'a [f64],
    pub(super) response: &'a Response,
    pub(super) noise: &'a Noise,
    pub(super) saturation: f32,
}

/// The merged planes, and counts by frame.
pub(super) struct Combined {
    pub(super) radiance: RgbImage,
    pub(super) variance: RgbImage,
    pub(super) clipped: Mask,
    pub(super) ghosts: Mask,
    pub(super) saturated: Vec<usize>,
    pub(super) left_out: Vec<usize>,
}

/// A frame's say about a texel's channel.
#[derive(Clone, Copy)]
enum Say {
    /// Linear exposure, and how wide a step of 255 is there.
    Exposure(f32, f32),
    /// At least this exposure.
    Saturated(f32),
}

/// What a texel becomes.
#[derive(Clone, Copy)]
struct Texel {
    radiance: [f32; 3],
    variance: [f32; 3],
    clipped: bool,
}

/// A row of texels.
struct Row {
    texels: Vec<Texel>,
    /// `[width]` whether a frame was left out.
    ghosts: Vec<bool>,
    /// `[2][frames]` texels saturated, and left out.
    counts: [Vec<usize>; 2],
}

/// A frame at a texel: its exposure and what its channels say.
struct Voice {
    frame: usize,
    exposure: f32,
    says: [Say; 3],
}

pub(super) fn combine(frames: &[Frame], plan: &Plan<'_>) -> Combined {
    let (width, height) = (frames[0].samples.width, frames[0].samples.height);
    let moved: Vec<Moved<'_>> = (frames.iter().zip(plan.shifts))
        .map(|(frame, &shift)| Moved::new(frame, shift))
        .collect();
    let rows: Vec<Row> = (0..height)
        .into_par_iter()
        .map(|y| {
            let mut counts = [vec![0; frames.len()], vec![0; frames.len()]];
            let mut ghosts = vec![false; width];
            let texels = (0..width)
                .map(|x| {
                    let voices = voices(&moved, plan, x, y);
                    for voice in &voices {
                        let saturated = voice.says.iter().any(|s| matches!(s, Say::Saturated(_)));
                        counts[0][voice.frame] += usize::from(saturated);
                    }
                    let agreeing = agreeing(&voices, plan.noise);
                    ghosts[x] = agreeing.iter().any(|a| !a);
                    for (voice, agrees) in voices.iter().zip(&agreeing) {
                        counts[1][voice.frame] += usize::from(!agrees);
                    }
                    texel(&voices, &agreeing, plan)
                })
                .collect();
            Row {
                texels,
                ghosts,
                counts,
            }
        })
        .collect();

    let mask = |pixels: Vec<u8>| Mask {
        width,
        height,
        pixels,
    };
    let image = |pixels: Vec<[f32; 3]>| RgbImage {
        width,
        height,
        pixels,
    };
    let texels = || rows.iter().flat_map(|row| &row.texels);
    let sum = |which: usize| {
        (0..frames.len())
            .map(|j| rows.iter().map(|row| row.counts[which][j]).sum())
            .collect()
    };
    Combined {
        radiance: image(texels().map(|t| t.radiance).collect()),
        variance: image(texels().map(|t| t.variance).collect()),
        clipped: mask(texels().map(|t| 255 * u8::from(t.clipped)).collect()),
        ghosts: mask(
            rows.iter()
                .flat_map(|row| &row.ghosts)
                .map(|&g| 255 * u8::from(g))
                .collect(),
        ),
        saturated: sum(0),
        left_out: sum(1),
    }
}

fn voices(moved: &[Moved<'_>], plan: &Plan<'_>, x: usize, y: usize) -> Vec<Voice> {
    (moved.iter().zip(plan.exposures).enumerate())
        .filter_map(|(j, (moved, &exposure))| {
            Some(Voice {
                frame: j,
                exposure: exposure as f32,
                says: moved.says(plan, x as i64, y as i64)?,
            })
        })
        .collect()
}

/// A frame and where it is moved to.
struct Moved<'a> {
    frame: &'a Frame,
    whole: (i32, i32),
    /// Where it is moved by a fraction of a pixel, too.
    taps: Option<Taps>,
}

impl<'a> Moved<'a> {
    fn new(frame: &'a Frame, shift: [f64; 2]) -> Self {
        let whole = shift.map(f64::round);
        Self {
            frame,
            whole: (whole[0] as i32, whole[1] as i32),
            taps: (whole != shift).then(|| Taps::new(shift)),
        }
    }

    /// What the frame says about a texel; `None` outside it.
    fn says(&self, plan: &Plan<'_>, x: i64, y: i64) -> Option<[Say; 3]> {
        let nearest = at(self.frame, self.whole, x, y)?;
        Some([0, 1, 2].map(|c| {
            let v = nearest[c];
            if v >= plan.saturation {
                return Say::Saturated(plan.response.linearise(c, plan.saturation));
            }
            let between = self
                .taps
                .and_then(|taps| self.between(&taps, plan, c, (x, y)));
            let x = between.unwrap_or_else(|| plan.response.linearise(c, v));
            Say::Exposure(x, plan.response.step(c, v))
        }))
    }

    /// The linear exposure between samples; `None` where one of them is saturated or missing. Not below the
    /// least of them: the cubic undershoots beside lamps.
    fn between(&self, taps: &Taps, plan: &Plan<'_>, c: usize, (x, y): (i64, i64)) -> Option<f32> {
        let (mut sum, mut least) = (0.0, f32::INFINITY);
        for (column, row, weight) in taps.of(x, y) {
            let v = at(self.frame, (0, 0), column, row)?[c];
            if v >= plan.saturation {
                return None;
            }
            let exposure = plan.response.linearise(c, v);
            sum += weight * exposure;
            least = least.min(exposure);
        }
        Some(sum.max(least))
    }
}

/// Which voices agree with the one that most agree with, among those that know: a saturated or dark sample
/// agrees with everyone.
fn agreeing(voices: &[Voice], noise: &Noise) -> Vec<bool> {
    let doubts: Vec<f32> = voices.iter().map(|v| v.doubt(noise)).collect();
    let least = doubts.iter().copied().fold(f32::INFINITY, f32::min);
    let knows = |i: usize| doubts[i] <= KNOWS * least;
    let support = |i: usize| {
        voices
            .iter()
            .filter(|b| agree(&voices[i], b, noise))
            .count()
    };
    (0..voices.len())
        .filter(|&i| knows(i))
        .max_by_key(|&i| (support(i), i))
        .map(|i| voices.iter().map(|b| agree(&voices[i], b, noise)).collect())
        .unwrap_or_default()
}

impl Voice {
    /// Relative standard deviation over the channels; infinite where one is saturated.
    fn doubt(&self, noise: &Noise) -> f32 {
        let (mut variance, mut square) = (0.0, 0.0);
        for say in &self.says {
            match say {
                Say::Exposure(x, step) => {
                    variance += noise.variance(*x, *step);
                    square += x * x;
                }
                Say::Saturated(_) => return f32::INFINITY,
            }
        }
        (variance / square.max(f32::MIN_POSITIVE)).sqrt()
    }
}

/// Whether two frames can be of one radiance, in every channel.
fn agree(a: &Voice, b: &Voice, noise: &Noise) -> bool {
    (a.says.iter().zip(&b.says)).all(|says| match says {
        (Say::Exposure(x, p), Say::Exposure(y, q)) => {
            let (l, m) = (x / a.exposure, y / b.exposure);
            // Both at their mean's noise: a sample that noise made dark is no surer.
            let mean = 0.5 * (l + m);
            let sigma2 = noise.variance(mean * a.exposure, *p) / (a.exposure * a.exposure)
                + noise.variance(mean * b.exposure, *q) / (b.exposure * b.exposure);
            (l - m) * (l - m) <= DISAGREE * DISAGREE * sigma2
        }
        (Say::Exposure(x, p), Say::Saturated(least)) => {
            reaches(x / a.exposure, *p, a.exposure, least / b.exposure, noise)
        }
        (Say::Saturated(least), Say::Exposure(y, q)) => {
            reaches(y / b.exposure, *q, b.exposure, least / a.exposure, noise)
        }
        (Say::Saturated(_), Say::Saturated(_)) => true,
    })
}

/// Whether a radiance may be as high as `least`. A saturated sample is worth less than its level
/// says where the response is steep: a fifth is allowed for.
fn reaches(radiance: f32, step: f32, exposure: f32, least: f32, noise: &Noise) -> bool {
    let sigma = noise.variance(radiance * exposure, step).sqrt() / exposure;
    radiance + DISAGREE * sigma >= 0.8 * least
}

fn texel(voices: &[Voice], agreeing: &[bool], plan: &Plan<'_>) -> Texel {
    let mut texel = Texel {
        radiance: [0.0; 3],
        variance: [f32::INFINITY; 3],
        clipped: false,
    };
    for c in 0..3 {
        let heard = || {
            voices
                .iter()
                .zip(agreeing)
                .filter(|(_, a)| **a)
                .map(|(v, _)| v)
        };
        let exposures = || {
            heard().filter_map(|v| match v.says[c] {
                Say::Exposure(x, step) => Some((x, step, v.exposure)),
                Say::Saturated(_) => None,
            })
        };
        // Start from Σ x / Σ t, then weigh by the noise at that radiance, twice.
        let (sum_x, sum_t) = exposures().fold((0.0f64, 0.0f64), |(x, t), s| {
            (x + f64::from(s.0), t + f64::from(s.2))
        });
        if sum_t == 0.0 {
            // The highest of the lower bounds.
            let bound = heard().filter_map(|v| match v.says[c] {
                Say::Saturated(least) => Some(least / v.exposure),
                Say::Exposure(..) => None,
            });
            texel.radiance[c] = bound.fold(0.0, f32::max);
            texel.clipped |= !voices.is_empty();
            continue;
        }
        let mut radiance = sum_x / sum_t;
        let mut precision = 0.0;
        for _ in 0..2 {
            let (mut up, mut down) = (0.0, 0.0);
            for (x, step, t) in exposures() {
                let t = f64::from(t);
                let expected = (radiance * t) as f32;
                let weight = t / f64::from(plan.noise.variance(expected, step));
                up += weight * f64::from(x);
                down += weight * t;
            }
            (radiance, precision) = (up / down, down);
        }
        texel.radiance[c] = radiance as f32;
        texel.variance[c] = (1.0 / precision) as f32;
    }
    texel
}
