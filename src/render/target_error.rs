//! How many paths each part of a frame needs for an error that was asked for.
//!
//! Pilots of few paths are rendered twice, independently; their difference tells the error. Where the
//! answer is far off, the pilot is repeated with more paths. Then the pilots are thrown away: samples
//! that decide when to stop are not samples that count, since a pixel that has missed the rare bright
//! ones looks finished and is too dark. This way the image has no bias, at the price of the pilots.
//!
//! Half of the pixels decide how the tiles share the paths; the other half, which had no say, tells
//! what error that gives, and all shares are scaled until it is the one asked for. One half for both
//! would promise too much, for the same reason. Objects of few pixels have to do with that.

use glam::DVec3;

use super::RenderStats;
use super::frame::{FrameSampler, Sampled};

/// Tiles of this many pixels along either side share a number of paths.
const TILE: usize = 16;
/// Paths of the first pilot.
const FIRST: u32 = 2;
/// How many times more paths the next pilot has.
const STEP: u32 = 4;
/// A pilot says how many paths are needed if that is at most this many times its own.
const REACH: f64 = 8.0;
/// A tile's estimate is mixed with that of all tiles of the same pilot as if the latter came from this
/// many pixels: few pixels that have missed the rare bright paths would promise too much.
const PRIOR: f64 = 32.0;
/// Squared error falls as paths to the minus this, inside the object and on its silhouette, where
/// well-spread paths do better. Measured between 2 and 32 paths: 1.0 to 1.2, and 1.1 to 1.4.
const RATES: [f64; 2] = [1.08, 1.25];
/// Most paths of a pixel: where a frame would take more, the error is larger than asked for.
const MOST: f64 = (1 << 20) as f64;
/// Pilots of so many paths look for an object where triangles project onto a tile.
const LOOK: u32 = 128;
/// The checking pixels may ask for this many times more or fewer paths than the deciding ones.
const MOST_SCALED: f64 = 64.0;
/// Below so many object pixels, all decide and all check.
const FEW: usize = 400;

/// Paths of pixels, by tile.
pub(super) struct Plan {
    across: usize,
    /// `[tile]` not whole numbers: pixels round up or down.
    paths: Vec<f64>,
}

impl Plan {
    /// Paths of a pixel: rounded so that the tile has its number on average.
    pub(super) fn paths(&self, x: usize, y: usize) -> u32 {
        let paths = self.paths[y / TILE * self.across + x / TILE];
        // Thresholds spread over the pixels of a tile by the plastic number, as in the R2 sequence.
        let threshold = (0.754_877_7 * x as f64 + 0.569_840_3 * y as f64).fract();
        ((paths + threshold) as u32).max(1)
    }
}

/// What a pilot tells about the pixels of a tile that decide, or of those that check.
#[derive(Clone, Copy, Default)]
struct Measured {
    /// Squared relative error with the pilot's paths, summed over the pixels inside the object, and
    /// over those on its silhouette.
    sums: [f64; 2],
    /// Object pixels.
    pixels: f64,
}

impl Measured {
    fn add(&mut self, other: &Self) {
        (0..2).for_each(|kind| self.sums[kind] += other.sums[kind]);
        self.pixels += other.pixels;
    }

    fn mean(&self) -> f64 {
        (self.sums[0] + self.sums[1]) / self.pixels.max(1.0)
    }

    /// The squared error, summed over pixels, with `times` as many paths.
    fn with_paths(&self, times: f64) -> f64 {
        (0..2)
            .map(|kind| self.sums[kind] * times.powf(-RATES[kind]))
            .sum()
    }
}

/// A tile as its last pilot saw it.
#[derive(Clone, Copy, Default)]
struct Tile {
    deciding: Measured,
    checking: Measured,
    /// Paths of that pilot.
    pilot: f64,
    /// Paths that the deciding pixels ask for.
    share: f64,
}

/// Paths that a relative RMSE of `error` takes, and the work of the pilots.
pub(super) fn plan(sampler: &FrameSampler<'_>, seed: u64, error: f32) -> (Plan, RenderStats) {
    let across = sampler.width.div_ceil(TILE);
    let target = f64::from(error).powi(2);
    let mut stats = RenderStats::default();
    let mut tiles = vec![Tile::default(); across * sampler.height.div_ceil(TILE)];
    // Tiles that the next pilot is to see: at first, those that triangles project onto.
    let mut open = vec![false; tiles.len()];
    for pixel in 0..sampler.width * sampler.height {
        let (x, y) = (pixel % sampler.width, pixel / sampler.width);
        open[y / TILE * across + x / TILE] |= sampler.covers(pixel);
    }
    let mut seen = (0.0, 0);
    let mut pilot = FIRST;
    while open.iter().any(|&open| open) {
        let paths = |x: usize, y: usize| {
            if open[y / TILE * across + x / TILE] {
                pilot
            } else {
                0
            }
        };
        let [a, b] = [1, 2].map(|twin| {
            let (pixels, work) = sampler.sample(pilot_seed(seed, pilot, twin), &paths);
            stats += work;
            pixels
        });
        // The floor of the relative error is the first pilot's, which sees the whole frame.
        if seen.1 == 0 {
            seen = mean_of_object(&a, &b);
        }
        let (floor, few) = (0.1 * seen.0, seen.1 < FEW);
        for (tile, _) in tiles.iter_mut().zip(&open).filter(|(_, open)| **open) {
            *tile = Tile {
                pilot: f64::from(pilot),
                ..Tile::default()
            };
        }
        measure(sampler, [&a, &b], floor, few, &mut tiles, across);

        let mut all = Measured::default();
        let looked_at = tiles.iter().zip(&open).filter(|(_, open)| **open);
        looked_at.for_each(|(tile, _)| all.add(&tile.deciding));
        for (tile, open) in tiles.iter_mut().zip(&mut open) {
            if !*open {
                continue;
            }
            let Measured { sums, pixels } = tile.deciding;
            let squared = (sums[0] + sums[1] + PRIOR * all.mean()) / (pixels + PRIOR);
            let times = (squared / target).powf(1.0 / RATES[0]);
            tile.share = (tile.pilot * times).min(MOST);
            *open = if pixels > 0.0 {
                tile.share > REACH * tile.pilot
            } else {
                // Something small may stand there that so few paths have missed.
                pilot < LOOK
            };
        }
        pilot = pilot.saturating_mul(STEP);
    }

    // Scaled until the pixels that had no say are satisfied; by bisection, as rates differ.
    let pixels: f64 = tiles.iter().map(|tile| tile.checking.pixels).sum();
    let promised = |scale: f64| -> f64 {
        let promise = |tile: &Tile| {
            let paths = (scale * tile.share).max(1.0);
            tile.checking.with_paths(paths / tile.pilot)
        };
        tiles.iter().map(promise).sum::<f64>() / pixels.max(1.0)
    };
    let (mut low, mut high) = (1.0 / MOST_SCALED, MOST_SCALED);
    for _ in 0..32 {
        let middle = f64::sqrt(low * high);
        if promised(middle) > target {
            low = middle;
        } else {
            high = middle;
        }
    }
    // The frame's own pass counts them.
    stats.background_pixels = 0;
    let paths = tiles
        .iter()
        .map(|tile| (high * tile.share).clamp(1.0, MOST));
    let plan = Plan {
        across,
        paths: paths.collect(),
    };
    (plan, stats)
}

/// Whether a pixel shows the object, in either twin.
fn shows_object(a: &Sampled, b: &Sampled) -> bool {
    a.coverage > 0 || b.coverage > 0
}

/// Mean over object pixels and channels, and the number of the pixels.
fn mean_of_object(a: &[Sampled], b: &[Sampled]) -> (f64, usize) {
    let (mut sum, mut count) = (0.0, 0);
    for (a, b) in a.iter().zip(b) {
        if shows_object(a, b) {
            sum += f64::from((a.radiance + b.radiance).element_sum()) / 6.0;
            count += 1;
        }
    }
    (sum / f64::max(f64::from(count), 1.0), count as usize)
}

/// Adds the squared relative error of twins, half their squared difference, to their tiles: to the
/// half that the pixel belongs to, or to both where the object has `few` pixels.
fn measure(
    sampler: &FrameSampler<'_>,
    [a, b]: [&[Sampled]; 2],
    floor: f64,
    few: bool,
    tiles: &mut [Tile],
    across: usize,
) {
    let floor2 = (floor * floor).max(f64::MIN_POSITIVE);
    for (pixel, (a, b)) in a.iter().zip(b).enumerate() {
        if !shows_object(a, b) {
            continue;
        }
        let (x, y) = (pixel % sampler.width, pixel / sampler.width);
        let tile = &mut tiles[y / TILE * across + x / TILE];
        let (a, b) = (a.radiance.as_dvec3(), b.radiance.as_dvec3());
        let mean = 0.5 * (a + b);
        let relative = 0.5 * (a - b) * (a - b) / (mean * mean + DVec3::splat(floor2));
        let squared = relative.element_sum() / 3.0;
        let kind = usize::from(sampler.on_silhouette(pixel));
        let even = (x + y).is_multiple_of(2);
        for (half, counts) in [
            (&mut tile.deciding, few || even),
            (&mut tile.checking, few || !even),
        ] {
            if counts {
                half.sums[kind] += squared;
                half.pixels += 1.0;
            }
        }
    }
}

/// Seeds that share nothing with the frame's own, nor with each other.
fn pilot_seed(seed: u64, pilot: u32, twin: u64) -> u64 {
    let mixed = seed ^ (u64::from(pilot) << 2 | twin).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    mixed.wrapping_mul(0xbf58_476d_1ce4_e5b9).rotate_left(29)
}
