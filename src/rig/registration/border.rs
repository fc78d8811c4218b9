//! Where the object's border is in a photograph: coarse to fine, along a line.
//!
//! A mask's pixel is the share `m` of it that the object covers. Along the outline's outward normal the
//! share falls from 1 to 0, and passes ½ at the border. A mask of 0 and 255 alone is, by the contract, 255
//! only where the *whole* pixel is covered: a straight border with normal `n` must then be
//! `h = (|n_x| + |n_y|)/2` pixels from the pixel's centre, so that the mask's own border lies `h` inside
//! the object's. Without a mask, the border is where the photograph's luminance changes most.

use glam::DVec2;

use crate::image::{Mask, RgbImage, luminance};

/// What the pixels of a mask mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum MaskBorder {
    /// The covered share of each pixel.
    Coverage,
    /// 255 where the whole pixel is covered, else 0.
    Whole,
    /// 255 where the pixel's centre is covered, else 0: thresholded at one half.
    Half,
}

impl MaskBorder {
    /// By the contract: the covered share if there are values between 0 and 255, else whole pixels.
    pub fn of(masks: &[&Mask]) -> Self {
        let partial = |mask: &&Mask| mask.pixels.iter().any(|&p| p > 0 && p < 255);
        if masks.iter().any(partial) {
            Self::Coverage
        } else {
            Self::Whole
        }
    }

    /// How far inside the object's border the mask's is, pixels.
    fn inset(self, outward: DVec2) -> f64 {
        match self {
            Self::Whole => 0.5 * (outward.x.abs() + outward.y.abs()),
            // A share is rounded down, by half a step of 255 in the mean, in every pixel that the border
            // crosses: these reach over |n_x| + |n_y| pixels.
            Self::Coverage => (outward.x.abs() + outward.y.abs()) / 510.0,
            Self::Half => 0.0,
        }
    }

    /// How far all borders may be off together, pixels: nobody knows whether a share was rounded down or to
    /// the nearest; and on borders that curve, whole pixels and centres were 0.02 pixels off in the mean.
    pub(super) fn doubt(self, outward: DVec2) -> f64 {
        match self {
            Self::Coverage => (outward.x.abs() + outward.y.abs()) / 510.0,
            Self::Whole | Self::Half => 0.02,
        }
    }
}

/// Half of the line, in pixels of a level, over which a border's shares are summed: a border at 45° takes
/// 0.7 to either side, and as much again goes to interpolation.
const INTEGRATED: f64 = 1.75;

/// Steps of the search for a border, and of that sum, in pixels of a level. Interpolation has kinks, which
/// steps of a quarter misjudge by 0.005 pixels all along a border that runs with the pixels.
const SEARCHED: f64 = 0.25;
const SUMMED: f64 = 0.0625;

/// How near to 0 and 1 the ends of that line must be: the eye of a needle is no border.
const SATURATED: f64 = 0.05;

/// Where a border was found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Border {
    /// Pixels along the outward normal.
    pub(super) distance: f64,
    /// Standard deviation, pixels, of what all borders of its kind may be off by together.
    pub(super) doubt: f64,
}

/// How far lens and sensor may spread a photograph's light over all borders, pixels.
const SPILL: f64 = 0.1;

/// What is known of one frame.
#[derive(Clone, Debug)]
pub struct Observed {
    mask: Option<(MaskBorder, Vec<Level>)>,
    photograph: Option<Vec<Level>>,
}

/// An image reduced by a power of two; each sample is the mean of what it stands for.
#[derive(Clone, Debug)]
struct Level {
    width: usize,
    height: usize,
    samples: Samples,
}

/// Bytes where bytes are enough: a lab's video has many masks.
#[derive(Clone, Debug)]
enum Samples {
    Share(Vec<u8>),
    Luminance(Vec<f32>),
}

/// Reductions kept: the coarsest is 1/64.
pub(super) const COARSEST: usize = 6;

impl Observed {
    /// A frame with a mask, a photograph, or both. A photograph's pixels that are not finite count as
    /// black.
    pub fn new(mask: Option<(&Mask, MaskBorder)>, photograph: Option<&RgbImage>) -> Self {
        let mask = mask.map(|(mask, border)| {
            let samples = Samples::Share(mask.pixels.clone());
            (border, pyramid(mask.width, mask.height, samples))
        });
        let photograph = photograph.map(|image| {
            let level = |pixel: &[f32; 3]| {
                let value = luminance(pixel.map(f64::from)) as f32;
                if value.is_finite() { value } else { 0.0 }
            };
            let samples = Samples::Luminance(image.pixels.iter().map(level).collect());
            pyramid(image.width, image.height, samples)
        });
        Self { mask, photograph }
    }

    /// The border nearest to `pixel` along the unit vector `outward`, within `range`, searched at a level.
    pub(super) fn border(
        &self,
        level: usize,
        pixel: DVec2,
        outward: DVec2,
        range: f64,
        outer: bool,
    ) -> Option<Border> {
        match (&self.mask, &self.photograph) {
            (Some((border, levels)), _) if outer => {
                let found = levels[level.min(COARSEST)].falls(
                    (1u64 << level) as f64,
                    pixel,
                    outward,
                    range,
                )?;
                // The bias is of whole pixels: reductions only blur it.
                Some(Border {
                    distance: found + border.inset(outward),
                    doubt: border.doubt(outward),
                })
            }
            (_, Some(levels)) => {
                let pixels = (1u64 << level) as f64;
                let distance =
                    levels[level.min(COARSEST)].steepest(pixels, pixel, outward, range)?;
                Some(Border {
                    distance,
                    doubt: SPILL,
                })
            }
            _ => None,
        }
    }

    /// What a mask of 0 and 255 means, with its columns and rows; `None` without one.
    pub(super) fn binary(&self) -> Option<(MaskBorder, usize, usize)> {
        let (border, levels) = self.mask.as_ref()?;
        let binary = matches!(border, MaskBorder::Whole | MaskBorder::Half);
        binary.then_some((*border, levels[0].width, levels[0].height))
    }

    /// Whether the mask says that the object covers most of a pixel; `None` without a mask.
    pub(super) fn covers(&self, x: usize, y: usize) -> Option<bool> {
        let (_, levels) = self.mask.as_ref()?;
        Some(levels[0].at(x as isize, y as isize) >= 0.5)
    }

    /// Width and height of the box around the mask's pixels; `None` without a mask or if it is empty.
    pub(super) fn extent(&self) -> Option<f64> {
        let (_, levels) = self.mask.as_ref()?;
        let level = &levels[0];
        let covered =
            |i: &usize| level.at((i % level.width) as isize, (i / level.width) as isize) >= 0.5;
        let (mut low, mut high) = ((usize::MAX, usize::MAX), (0, 0));
        for i in (0..level.width * level.height).filter(covered) {
            let (x, y) = (i % level.width, i / level.width);
            low = (low.0.min(x), low.1.min(y));
            high = (high.0.max(x), high.1.max(y));
        }
        (low.0 <= high.0).then(|| (high.0 - low.0 + 1).max(high.1 - low.1 + 1) as f64)
    }

    /// Whether there is a photograph.
    pub(super) fn has_photograph(&self) -> bool {
        self.photograph.is_some()
    }
}

fn pyramid(width: usize, height: usize, samples: Samples) -> Vec<Level> {
    let mut levels = vec![Level {
        width,
        height,
        samples,
    }];
    for level in 0..COARSEST {
        let halved = levels[level].halved();
        levels.push(halved);
    }
    levels
}

impl Level {
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mean = |i: usize| {
            let (x, y) = (2 * (i % width) as isize, 2 * (i / width) as isize);
            0.25 * (self.at(x, y) + self.at(x + 1, y) + self.at(x, y + 1) + self.at(x + 1, y + 1))
        };
        let means = (0..width * height).map(mean);
        Self {
            width,
            height,
            samples: match self.samples {
                Samples::Share(_) => {
                    Samples::Share(means.map(|m| (255.0 * m).round() as u8).collect())
                }
                Samples::Luminance(_) => Samples::Luminance(means.map(|m| m as f32).collect()),
            },
        }
    }

    /// The sample nearest to a place, within the image.
    fn at(&self, x: isize, y: isize) -> f64 {
        let x = x.clamp(0, self.width as isize - 1) as usize;
        let y = y.clamp(0, self.height as isize - 1) as usize;
        match &self.samples {
            Samples::Share(all) => f64::from(all[y * self.width + x]) / 255.0,
            Samples::Luminance(all) => f64::from(all[y * self.width + x]),
        }
    }

    /// Bilinear between sample centres; `None` outside the image.
    fn value(&self, place: DVec2) -> Option<f64> {
        let inside = place.x >= 0.0
            && place.y >= 0.0
            && place.x <= self.width as f64
            && place.y <= self.height as f64;
        if !inside {
            return None;
        }
        let corner = (place - 0.5).floor();
        let share = place - 0.5 - corner;
        let (x, y) = (corner.x as isize, corner.y as isize);
        let upper = self.at(x, y) * (1.0 - share.x) + self.at(x + 1, y) * share.x;
        let lower = self.at(x, y + 1) * (1.0 - share.x) + self.at(x + 1, y + 1) * share.x;
        Some(upper * (1.0 - share.y) + lower * share.y)
    }

    /// Samples along a line, `step` pixels of this level apart: offsets in pixels, and values.
    fn profile(
        &self,
        pixels: f64,
        pixel: DVec2,
        outward: DVec2,
        range: f64,
        step: f64,
    ) -> Vec<(f64, Option<f64>)> {
        let step = step * pixels;
        let count = (range / step).ceil() as i32;
        (-count..=count)
            .map(|i| {
                let offset = f64::from(i) * step;
                (offset, self.value((pixel + offset * outward) / pixels))
            })
            .collect()
    }

    /// The nearest place where the share falls from inside to outside.
    ///
    /// Found where it passes ½, then told by its integral around there: `∫ m ds` from `−r` is the border's
    /// distance from there whatever the border's angle to the pixels, while the place of ½ wavers by a
    /// tenth of a pixel with the border's phase. Where inside and outside are not both reached within `r`,
    /// as in a corner, ½ must do.
    fn falls(&self, pixels: f64, pixel: DVec2, outward: DVec2, range: f64) -> Option<f64> {
        let profile = self.profile(pixels, pixel, outward, range, SEARCHED);
        let crossing = |pair: &[(f64, Option<f64>)]| {
            let ((from, Some(high)), (to, Some(low))) = (pair[0], pair[1]) else {
                return None;
            };
            (high >= 0.5 && low < 0.5).then(|| from + (to - from) * (high - 0.5) / (high - low))
        };
        let half = profile
            .windows(2)
            .filter_map(crossing)
            .min_by(|a, b| a.abs().total_cmp(&b.abs()))?;
        let radius = INTEGRATED * pixels;
        let around = self.profile(pixels, pixel + half * outward, outward, radius, SUMMED);
        let shares: Option<Vec<f64>> = around.iter().map(|(_, share)| *share).collect();
        let Some([first, .., last]) = shares.as_deref() else {
            return Some(half);
        };
        if *first < 1.0 - SATURATED || *last > SATURATED {
            return Some(half);
        }
        // Trapezoids; the ends are 1 and 0.
        let sum = shares.iter().flatten().sum::<f64>() - 0.5 * (first + last);
        Some(half - radius + SUMMED * pixels * sum)
    }

    /// The place where the luminance changes most, or a nearer one where it changes more than half as
    /// much.
    fn steepest(&self, pixels: f64, pixel: DVec2, outward: DVec2, range: f64) -> Option<f64> {
        // A neighbour on either side along the border halves the noise.
        let aside = pixels * outward.perp();
        let lines = [-1.0, 0.0, 1.0]
            .map(|share| self.profile(pixels, pixel + share * aside, outward, range, SEARCHED));
        let value = |i: usize| Some((lines[0][i].1? + lines[1][i].1? + lines[2][i].1?) / 3.0);
        // Central differences over one pixel of the level.
        let count = lines[0].len();
        let slope = |i: usize| -> Option<f64> {
            Some(
                (value(i.checked_add(2).filter(|&j| j < count)?)? - value(i.checked_sub(2)?)?)
                    .abs(),
            )
        };
        let slopes: Vec<Option<f64>> = (0..count).map(slope).collect();
        let most = slopes.iter().flatten().copied().fold(0.0, f64::max);
        if most <= 0.0 {
            return None;
        }
        let peak = |three: &[Option<f64>]| {
            let (before, here, after) = (three[0]?, three[1]?, three[2]?);
            let is_peak = here >= 0.5 * most && here > before && here >= after;
            let bend = 2.0 * here - before - after;
            (is_peak && bend > 0.0).then(|| 0.5 * (after - before) / bend)
        };
        (1..count.saturating_sub(1))
            .filter_map(|i| Some(lines[0][i].0 + SEARCHED * pixels * peak(&slopes[i - 1..=i + 1])?))
            .min_by(|a, b| a.abs().total_cmp(&b.abs()))
    }
}
