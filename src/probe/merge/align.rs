//! Small shifts between the frames of a bracket (Ward 2003, *Fast, Robust Image Registration for
//! Compositing High Dynamic Range Photographs from Hand-Held Exposures*).
//!
//! Two frames are cut into bright and dark at samples of one radiance: a response that never falls keeps the
//! pixels' order, so the cuts are the same curve in the scene, whatever the response and the exposures.
//! The shift with the fewest disagreeing pixels is found from coarse to fine.

use std::collections::BTreeSet;

use super::Frame;
use super::pixels::is_panorama;

/// Levels of the pyramid at most: shifts up to 2^5 − 1 pixels.
const LEVELS: u32 = 5;
/// Shifts that go on from a coarse level to the next.
const CANDIDATES: usize = 4;
/// Pixels this close to the cut are noise.
const TOLERANCE: f32 = 4.0 / 255.0;
/// A shift must remove this share of the disagreement: where nothing moved, noise decides between
/// neighbours and should not.
const GAIN: f64 = 0.2;
/// Tiles on a side in which a shift must hold.
const TILES: usize = 4;
/// And this share of the pixels: a few edges make more disagree for a shift of one. Without it, frames of a smooth scene were moved by two pixels along its contours.
const LEAST_GAIN: f64 = 0.003;

/// By how many columns and rows each frame must be moved to lie on the middle one, whole pixels; frames in the
/// order of exposures, each compared with its neighbour.
pub(super) fn shifts(frames: &[Frame]) -> Vec<(i32, i32)> {
    let mut shifts = vec![(0, 0); frames.len()];
    for (from, to) in chain(frames.len()) {
        let (x, y) = shift(&frames[to], &frames[from]);
        shifts[from] = (shifts[to].0 + x, shifts[to].1 + y);
    }
    shifts
}

/// Every frame but the middle one with its neighbour towards the middle, whose place is known before.
pub(super) fn chain(frames: usize) -> impl Iterator<Item = (usize, usize)> {
    let middle = frames / 2;
    let down = (0..middle).rev().map(|from| (from, from + 1));
    down.chain((middle + 1..frames).map(|from| (from, from - 1)))
}

/// Bright (+1), dark (−1) or undecided (0).
struct Cut {
    width: usize,
    height: usize,
    signs: Vec<i8>,
}

/// The shift of `moved` onto `fixed`.
fn shift(fixed: &Frame, moved: &Frame) -> (i32, i32) {
    let (width, height) = (fixed.samples.width, fixed.samples.height);
    // No shift of more than a twelfth of the image.
    let levels = (width.min(height) / 12).max(1).ilog2().min(LEVELS);
    let pyramids = [fixed, moved].map(|frame| pyramid(frame, levels));
    let Some((fixed_cut, moved_cut)) = thresholds(&pyramids[0][0], &pyramids[1][0]) else {
        return (0, 0);
    };
    // The best few of each coarse level go on: in a dark frame, a handful of pixels decides there.
    let mut kept = vec![(0, 0)];
    for level in (0..pyramids[0].len()).rev() {
        let (a, b) = (
            cut(&pyramids[0][level], fixed_cut),
            cut(&pyramids[1][level], moved_cut),
        );
        let around = |&(x, y): &(i32, i32)| {
            (-1..=1).flat_map(move |j| (-1..=1).map(move |i| (2 * x + i, 2 * y + j)))
        };
        let candidates: BTreeSet<(i32, i32)> = kept.iter().flat_map(around).collect();
        let mut shares: Vec<(f64, i32, (i32, i32))> = (candidates.into_iter())
            .map(|(x, y)| (disagreement(&a, &b, (x, y)), x.abs() + y.abs(), (x, y)))
            .collect();
        shares.sort_unstable_by(|p, q| p.0.total_cmp(&q.0).then((p.1, p.2).cmp(&(q.1, q.2))));
        shares.truncate(if level > 1 { CANDIDATES } else { 1 });
        kept = shares.into_iter().map(|(.., shift)| shift).collect();
    }
    let best = kept.first().copied().unwrap_or((0, 0));
    let (a, b) = (
        cut(&pyramids[0][0], fixed_cut),
        cut(&pyramids[1][0], moved_cut),
    );
    if believable(&counts(&a, &b, (0, 0)), &counts(&a, &b, best)) {
        best
    } else {
        (0, 0)
    }
}

/// Whether a shift removes enough disagreement, and all over the image: something that moved by itself is better
/// matched in one place and leaves the rest worse.
fn believable(still: &[Count; TILES * TILES], moved: &[Count; TILES * TILES]) -> bool {
    let (mut before, mut after, mut decided) = (0.0, 0.0, 0.0);
    let (mut better, mut worse) = (0, 0);
    for (s, m) in still.iter().zip(moved) {
        // The same number of pixels in both, so that what left the image does not count.
        let (differ, remain) = (s.differ as f64, m.share() * s.decided as f64);
        (before, after) = (before + differ, after + remain);
        decided += s.decided as f64;
        let doubt = 3.0 * (differ + remain).sqrt() + 2.0;
        better += usize::from(differ - remain > doubt);
        worse += usize::from(remain - differ > doubt);
    }
    let gain = before - after;
    gain > GAIN * before && gain > LEAST_GAIN * decided && better >= 4 && 4 * worse <= better
}

/// Green, halved again and again.
struct Grey {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

fn pyramid(frame: &Frame, levels: u32) -> Vec<Grey> {
    let image = &frame.samples;
    let mut pyramid = vec![Grey {
        width: image.width,
        height: image.height,
        values: image.pixels.iter().map(|p| p[1]).collect(),
    }];
    for level in 0..levels as usize {
        let fine = &pyramid[level];
        let (width, height) = (fine.width / 2, fine.height / 2);
        let values = (0..width * height)
            .map(|i| {
                let corner = 2 * (i / width) * fine.width + 2 * (i % width);
                let below = corner + fine.width;
                let v = &fine.values;
                0.25 * (v[corner] + v[corner + 1] + v[below] + v[below + 1])
            })
            .collect();
        pyramid.push(Grey {
            width,
            height,
            values,
        });
    }
    pyramid
}

/// Where to cut the two frames: the sample of the fixed one that leaves most room to black and white in both, and
/// what the moved one has, in the middle, where the fixed one has that; `None` where no sample has room in both.
///
/// Ward cuts both at the median. But something bright that walks into one frame moves its median, and
/// with it every contour of a smooth scene.
fn thresholds(fixed: &Grey, moved: &Grey) -> Option<(f32, f32)> {
    let step = fixed.values.len().div_ceil(1 << 18).max(1);
    let mut pairs: Vec<(f32, f32)> = (fixed.values.iter().zip(&moved.values))
        .step_by(step)
        .map(|(&a, &b)| (a, b))
        .collect();
    pairs.sort_unstable_by(|p, q| p.0.total_cmp(&q.0).then(p.1.total_cmp(&q.1)));
    let room = |v: f32| v.min(1.0 - v);
    let best = (5..=95)
        .step_by(5)
        .filter_map(|percent| {
            let here = pairs[(pairs.len() - 1) * percent / 100].0;
            let from = pairs.partition_point(|p| p.0 < here - TOLERANCE);
            let to = pairs.partition_point(|p| p.0 <= here + TOLERANCE);
            let mut there: Vec<f32> = pairs[from..to].iter().map(|p| p.1).collect();
            there.sort_unstable_by(f32::total_cmp);
            let there = *there.get(there.len() / 2)?;
            Some((here, there))
        })
        .max_by(|p, q| {
            let rooms = [p, q].map(|c| room(c.0).min(room(c.1)));
            rooms[0].total_cmp(&rooms[1])
        })?;
    (room(best.0).min(room(best.1)) >= 2.0 * TOLERANCE).then_some(best)
}

/// A frame cut at a sample.
fn cut(grey: &Grey, threshold: f32) -> Cut {
    let sign = |v: &f32| {
        if (v - threshold).abs() < TOLERANCE {
            0
        } else if *v > threshold {
            1
        } else {
            -1
        }
    };
    Cut {
        width: grey.width,
        height: grey.height,
        signs: grey.values.iter().map(sign).collect(),
    }
}

/// Pixels that both frames decide, and those of them that disagree.
#[derive(Clone, Copy, Default)]
struct Count {
    decided: u64,
    differ: u64,
}

impl Count {
    fn share(self) -> f64 {
        if self.decided == 0 {
            1.0
        } else {
            self.differ as f64 / self.decided as f64
        }
    }
}

/// Share of decided pixels that disagree when `moved` is shifted.
fn disagreement(fixed: &Cut, moved: &Cut, shift: (i32, i32)) -> f64 {
    let mut all = Count::default();
    for count in counts(fixed, moved, shift) {
        all.decided += count.decided;
        all.differ += count.differ;
    }
    all.share()
}

/// Counts by tile of the fixed frame.
fn counts(fixed: &Cut, moved: &Cut, shift: (i32, i32)) -> [Count; TILES * TILES] {
    let (width, height) = (fixed.width as i64, fixed.height as i64);
    let (dx, dy) = (i64::from(shift.0), i64::from(shift.1));
    let around = is_panorama(fixed.width, fixed.height);
    let (x0, x1) = if around {
        (0, width)
    } else {
        (dx.max(0), (width + dx).min(width))
    };
    let mut counts = [Count::default(); TILES * TILES];
    for y in dy.max(0)..(height + dy).min(height) {
        let row = y as usize * TILES / fixed.height * TILES;
        for x in x0..x1 {
            let a = fixed.signs[(y * width + x) as usize];
            let b = moved.signs[((y - dy) * width + (x - dx).rem_euclid(width)) as usize];
            let count = &mut counts[row + x as usize * TILES / fixed.width];
            count.decided += u64::from(a * b != 0);
            count.differ += u64::from(a * b < 0);
        }
    }
    counts
}
