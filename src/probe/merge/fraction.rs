//! The fractions of a pixel by which frames are still shifted, once the response is known (Lucas and Kanade 1981).
//!
//! ```text
//! min over d, c   Σ_p ρ( (L_k(p − d) − c L_j(p)) / L̄_j(p) )
//! ```
//!
//! over the edges `p` of the frame `j` that stays, in Gauss–Newton steps; L̄ is the mean of a pixel and its
//! neighbours, `d` the shift of frame `k`, and the gain `c` takes up what is left of the exposures. ρ is Student's, so that what moved by itself is outvoted.
//! A lamp of a few pixels differs by its whole brightness between frames half a pixel apart: on brackets whose frames
//! are up to half a pixel off, radiance is twice as far from the truth without this.

use rayon::prelude::*;

use super::Frame;
use super::align::chain;
use super::pixels::is_panorama;
use super::response::Response;
use crate::probe::cholesky::solve;

/// Steps at most.
const STEPS: usize = 12;
/// Pixels looked at, at most: more would only make the thousandths surer.
const MOST_PIXELS: usize = 1 << 20;
/// An edge changes by this share from one pixel to the next.
const EDGE: f32 = 0.1;
/// Fewer edges tell nothing.
const LEAST_EDGES: usize = 100;
/// Largest standard deviation, pixels, that is believed.
const LARGEST_SIGMA: f64 = 0.05;
/// Whole pixels are right to one; what asks for more is no shift.
const FARTHEST: f64 = 1.5;
/// Nearer to whole pixels than this, nothing is interpolated.
const WHOLE: f64 = 0.05;
/// Below this, steps of 8 bits are more than a few per cent.
const DARK: f32 = 20.0 / 255.0;
/// What response and noise model may be wrong by in the same way at many edges, relative; and how far, pixels, this
/// may move a shift that is believed. Smooth light has slopes, but they are all alike: without this, frames
/// that stood still were moved by a pixel.
const TOGETHER: f64 = 0.01;
const LARGEST_BIAS: f64 = 0.1;

/// Columns and rows by which each frame must be moved to lie on the middle one, from what is right to the pixel.
pub(super) fn refine(
    frames: &[Frame],
    whole: &[(i32, i32)],
    response: &Response,
    exposures: &[f64],
    saturation: f32,
) -> Vec<[f64; 2]> {
    let planes: Vec<Plane> = (frames.par_iter().zip(exposures))
        .map(|(frame, &exposure)| Plane::new(frame, response, exposure, saturation))
        .collect();
    let whole: Vec<[f64; 2]> = whole
        .iter()
        .map(|&(x, y)| [f64::from(x), f64::from(y)])
        .collect();
    let pairs: Vec<(usize, usize)> = chain(frames.len()).collect();
    let steps: Vec<[f64; 2]> = pairs
        .par_iter()
        .map(|&(from, to)| {
            let start = [0, 1].map(|i| whole[from][i] - whole[to][i]);
            shift(&planes[to], &planes[from], start).unwrap_or(start)
        })
        .collect();
    let mut shifts = vec![[0.0; 2]; frames.len()];
    for ((from, to), step) in pairs.into_iter().zip(steps) {
        shifts[from] = [0, 1].map(|i| shifts[to][i] + step[i]);
    }
    for shift in &mut shifts {
        // No −0.
        let nearest = shift.map(|s| s.round() + 0.0);
        if (0..2).all(|i| (shift[i] - nearest[i]).abs() < WHOLE) {
            *shift = nearest;
        }
    }
    shifts
}

/// Green radiance of a frame; NaN where it is dark or saturated.
struct Plane {
    width: usize,
    height: usize,
    around: bool,
    radiance: Vec<f32>,
}

impl Plane {
    fn new(frame: &Frame, response: &Response, exposure: f64, saturation: f32) -> Self {
        let (width, height) = (frame.samples.width, frame.samples.height);
        let radiance = |p: &[f32; 3]| {
            if p[1] > DARK && p[1] < saturation {
                response.linearise(1, p[1]) / exposure as f32
            } else {
                f32::NAN
            }
        };
        Self {
            width,
            height,
            around: is_panorama(width, height),
            radiance: frame.samples.pixels.iter().map(radiance).collect(),
        }
    }

    fn at(&self, x: i64, y: i64) -> f32 {
        let column = if self.around {
            x.rem_euclid(self.width as i64)
        } else {
            x
        };
        let inside = column >= 0 && column < self.width as i64 && y >= 0 && y < self.height as i64;
        if inside {
            self.radiance[y as usize * self.width + column as usize]
        } else {
            f32::NAN
        }
    }

    /// Change of the radiance by column and row.
    fn slope(&self, x: i64, y: i64) -> [f32; 2] {
        [
            0.5 * (self.at(x + 1, y) - self.at(x - 1, y)),
            0.5 * (self.at(x, y + 1) - self.at(x, y - 1)),
        ]
    }
}

/// Where the samples of a frame that is moved by a shift come from: Catmull and Rom's cubic.
#[derive(Clone, Copy, Debug)]
pub(super) struct Taps {
    /// Column and row of the first tap, less those of the place.
    corner: [i64; 2],
    /// Weights by column and by row.
    weights: [[f32; 4]; 2],
}

impl Taps {
    /// Those of a shift; a frame that is not moved by a fraction has one tap of weight 1.
    pub(super) fn new(shift: [f64; 2]) -> Self {
        let corner = shift.map(|d| (-d).floor() as i64 - 1);
        let weights = shift.map(|d| {
            let f = (-d - (-d).floor()) as f32;
            [
                f * (-0.5 + f * (1.0 - 0.5 * f)),
                1.0 + f * f * (-2.5 + 1.5 * f),
                f * (0.5 + f * (2.0 - 1.5 * f)),
                f * f * (-0.5 + 0.5 * f),
            ]
        });
        Self { corner, weights }
    }

    /// Column, row and weight of each sample for the place `(x, y)`; weights of 0 are left out.
    pub(super) fn of(&self, x: i64, y: i64) -> impl Iterator<Item = (i64, i64, f32)> {
        let Self {
            corner,
            weights: [columns, rows],
        } = *self;
        (0..16)
            .map(move |i| (i % 4, i / 4))
            .map(move |(i, j)| {
                let place = (x + corner[0] + i as i64, y + corner[1] + j as i64);
                (place.0, place.1, columns[i] * rows[j])
            })
            .filter(|tap| tap.2 != 0.0)
    }
}

/// An edge pixel, all relative to the mean of its surroundings: slope by column and row, and radiance, of the frame
/// that stays; and how much brighter the moved one is.
struct Edge {
    row: [f64; 3],
    excess: f64,
}

/// The shift of `moved` onto `fixed`, if their edges tell it.
fn shift(fixed: &Plane, moved: &Plane, start: [f64; 2]) -> Option<[f64; 2]> {
    let mut shift = start;
    let mut last = None;
    for _ in 0..STEPS {
        let edges = edges(fixed, moved, shift);
        if edges.len() < LEAST_EDGES {
            return None;
        }
        let step = step(&edges)?;
        for (s, by) in shift.iter_mut().zip(step.by) {
            *s += by.clamp(-0.5, 0.5);
        }
        let still = step.by.iter().all(|d| d.abs() < 1e-3);
        last = Some(step);
        if still {
            break;
        }
    }
    let last = last?;
    let known = (0..2).all(|i| last.sigma[i] < LARGEST_SIGMA && last.bias[i] < LARGEST_BIAS);
    let near = (0..2).all(|i| (shift[i] - start[i]).abs() < FARTHEST);
    (known && near).then_some(shift)
}

fn edges(fixed: &Plane, moved: &Plane, shift: [f64; 2]) -> Vec<Edge> {
    let stride = ((fixed.width * fixed.height) as f64 / MOST_PIXELS as f64)
        .sqrt()
        .ceil()
        .max(1.0) as usize;
    let taps = Taps::new(shift);
    let mut edges = Vec::new();
    for y in (0..fixed.height as i64).step_by(stride) {
        for x in (0..fixed.width as i64).step_by(stride) {
            let here = fixed.at(x, y);
            let slope = fixed.slope(x, y);
            let around = [(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1)];
            let sum: f32 = around.map(|(i, j)| fixed.at(x + i, y + j)).iter().sum();
            let mean = 0.2 * sum;
            // Comparisons with NaN are false.
            let steep = slope[0].hypot(slope[1]) > EDGE * mean;
            if !steep {
                continue;
            }
            let there: f32 = taps.of(x, y).map(|(x, y, w)| w * moved.at(x, y)).sum();
            if there.is_finite() {
                edges.push(Edge {
                    row: [slope[0], slope[1], here].map(|v| f64::from(v / mean)),
                    excess: f64::from((there - here) / mean),
                });
            }
        }
    }
    edges
}

/// A step, and how far off it may be, by column and row.
struct Step {
    by: [f64; 2],
    /// Standard deviation by the residuals.
    sigma: [f64; 2],
    /// If all edges were wrong by [`TOGETHER`], with the signs that are worst.
    bias: [f64; 2],
}

/// The step that suits the edges best: excess ≈ slope · step + gain · radiance.
fn step(edges: &[Edge]) -> Option<Step> {
    let mut solution = [0.0; 3];
    let (mut sigma, mut bias) = ([0.0; 2], [0.0; 2]);
    let residual =
        |e: &Edge, s: &[f64; 3]| e.excess - e.row[0] * s[0] - e.row[1] * s[1] - e.row[2] * s[2];
    for _ in 0..3 {
        let mut sizes: Vec<f64> = edges.iter().map(|e| residual(e, &solution).abs()).collect();
        let middle = sizes.len() / 2;
        let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
        let scale = (1.4826 * *median).max(1e-4);
        let mut matrix = vec![0.0; 9];
        let mut right = vec![0.0; 3];
        let mut spread = [0.0; 9];
        for e in edges {
            let r = residual(e, &solution) / scale;
            let weight = 4.0 / (3.0 + r * r);
            let row = &e.row;
            for i in 0..3 {
                right[i] += weight * row[i] * e.excess;
                for j in 0..3 {
                    matrix[3 * i + j] += weight * row[i] * row[j];
                    spread[3 * i + j] += (weight * r * scale).powi(2) * row[i] * row[j];
                }
            }
        }
        let found = solve(matrix.clone(), right)?;
        solution = [found[0], found[1], found[2]];
        for i in 0..2 {
            let mut unit = vec![0.0; 3];
            unit[i] = 1.0;
            let column = solve(matrix.clone(), unit)?;
            let variance: f64 = (0..9)
                .map(|k| column[k / 3] * spread[k] * column[k % 3])
                .sum();
            sigma[i] = variance.sqrt();
            let worst = |e: &Edge| {
                let r = residual(e, &solution) / scale;
                let along: f64 = column.iter().zip(&e.row).map(|(a, b)| a * b).sum();
                4.0 / (3.0 + r * r) * along.abs()
            };
            bias[i] = TOGETHER * edges.iter().map(worst).sum::<f64>();
        }
    }
    let by = [solution[0], solution[1]];
    Some(Step { by, sigma, bias })
}
