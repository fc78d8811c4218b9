//! Weighted least squares over all frames: `min Σ w_i (J_i x + a_i δ_t − d_i)²`.
//!
//! The angle changes δ_t, one a frame, are eliminated first (Schur's complement), so that what is solved
//! has at most ten unknowns however many frames there are. Weights are those of Student's t with three
//! degrees of freedom and the residuals' own scale: a pixel that is wrong by ten scales counts as a
//! thirtieth of one that is right.

use std::collections::BTreeMap;

use super::pose::{Step, UNKNOWNS};

/// Degrees of freedom of the residuals' distribution.
const FREEDOM: f64 = 3.0;

/// How much a distance counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Certainty {
    /// By Student's distribution about the scale of all.
    Common,
    /// By its own information, 1/pixel².
    Information(f64),
}

/// A point of an outline and the border found for it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Match {
    /// From the model's outline to the border seen, pixels along the outward normal.
    pub(super) distance: f64,
    /// How much it counts.
    pub(super) certainty: Certainty,
    /// Standard deviation of what all distances may be off by together, pixels.
    pub(super) doubt: f64,
    /// Pixels of outline that it stands for.
    pub(super) length: f64,
    /// Whether nothing of the object is behind.
    pub(super) outer: bool,
    /// Derivatives of the outline's place along the normal.
    pub(super) slopes: Step,
    /// The same by the frame's angle.
    pub(super) angle_slope: f64,
    /// Derivatives of the smooth surface's place along its own normal, in the same units.
    pub(super) slides: Step,
    /// The same by the frame's angle.
    pub(super) angle_slide: f64,
    /// Which square of the image it is in.
    pub(super) tile: (i32, i32),
}

/// The square of the image that holds a pixel: a quarter of the image wide.
///
/// Within a square residuals may depend on each other: neighbouring points of an outline share pixels, and
/// what a mesh or a mask gets wrong it gets wrong over a while. Squares of 16 pixels of 256 made the
/// standard deviations of a cup whose facets stood otherwise than the mesh's five times too small.
pub(super) fn tile(pixel: glam::DVec2, (width, height): (usize, usize)) -> (i32, i32) {
    let index = (pixel / (0.25 * width.min(height) as f64)).floor();
    (index.x as i32, index.y as i32)
}

/// A symmetric matrix of the common unknowns.
pub(super) type Matrix = [[f64; UNKNOWNS]; UNKNOWNS];

/// Sums of one frame.
#[derive(Clone, Copy)]
struct FrameSums {
    own: f64,
    mixed: Step,
    right: f64,
}

/// The equations at one placement.
pub(super) struct Equations {
    /// `Σ w J Jᵀ` after the angles are eliminated.
    pub(super) normal: Matrix,
    right: Step,
    frames: Vec<FrameSums>,
    angles: bool,
}

/// Robust scale of the residuals, pixels: 1.48 times the median distance, for which half of the outline
/// may be wrong; at least `least`.
pub(super) fn scale(frames: &[Vec<Match>], least: f64) -> f64 {
    let mut distances: Vec<f64> = frames.iter().flatten().map(|m| m.distance.abs()).collect();
    let middle = distances.len() / 2;
    if distances.is_empty() {
        return least;
    }
    let (_, median, _) = distances.select_nth_unstable_by(middle, f64::total_cmp);
    (1.4826 * *median).max(least)
}

/// Student's weight of a distance, 1/pixel².
fn weight(distance: f64, scale: f64) -> f64 {
    (FREEDOM + 1.0) / (FREEDOM * scale * scale + distance * distance)
}

/// Which derivatives the equations are made of.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Those of the outline.
    Outline,
    /// Those of the smooth surface: what they do not see, only the mesh's facets tell.
    Surface,
}

impl Match {
    /// Weight, 1/pixel.
    fn weight(&self, scale: f64) -> f64 {
        self.length
            * match self.certainty {
                Certainty::Common => weight(self.distance, scale),
                Certainty::Information(information) => information,
            }
    }

    /// How much a robust sum changes with the distance, relative to least squares.
    fn bend(&self, scale: f64) -> f64 {
        let (near, far) = (FREEDOM * scale * scale, self.distance * self.distance);
        match self.certainty {
            Certainty::Common => (near - far) / (near + far),
            Certainty::Information(_) => 1.0,
        }
    }

    fn slopes_of(&self, kind: Kind) -> (&Step, f64) {
        match kind {
            Kind::Outline => (&self.slopes, self.angle_slope),
            Kind::Surface => (&self.slides, self.angle_slide),
        }
    }
}

impl Equations {
    /// Sums over the matches of each frame. With `angles`, all but the first frame's angle are unknown.
    pub(super) fn new(frames: &[Vec<Match>], scale: f64, angles: bool, kind: Kind) -> Self {
        let mut normal = [[0.0; UNKNOWNS]; UNKNOWNS];
        let mut right = [0.0; UNKNOWNS];
        let mut all = Vec::with_capacity(frames.len());
        for (number, matches) in frames.iter().enumerate() {
            let mut sums = FrameSums {
                own: 0.0,
                mixed: [0.0; UNKNOWNS],
                right: 0.0,
            };
            for m in matches {
                let w = m.weight(scale);
                let (slopes, angle) = m.slopes_of(kind);
                for (i, slope) in slopes.iter().enumerate() {
                    let weighted = w * slope;
                    for (cell, other) in normal[i].iter_mut().zip(slopes) {
                        *cell += weighted * other;
                    }
                    right[i] += weighted * m.distance;
                    sums.mixed[i] += weighted * angle;
                }
                sums.own += w * angle * angle;
                sums.right += w * angle * m.distance;
            }
            if angles && number > 0 && sums.own > 0.0 {
                add_square(&mut normal, &sums.mixed, -1.0 / sums.own);
                for (r, mixed) in right.iter_mut().zip(&sums.mixed) {
                    *r -= mixed * sums.right / sums.own;
                }
            }
            all.push(sums);
        }
        Self {
            normal,
            right,
            frames: all,
            angles,
        }
    }

    /// The best step within the span of `basis`, with the diagonal raised by the share `damping`, and the
    /// change of each frame's angle that goes with it.
    pub(super) fn solve(&self, basis: &[Step], damping: f64) -> (Step, Vec<f64>) {
        let inverse = self.inverse(basis, damping);
        let step = multiply(&inverse, &self.right);
        let change = |(number, sums): (usize, &FrameSums)| {
            if !self.angles || number == 0 || sums.own <= 0.0 {
                return 0.0;
            }
            (sums.right - dot(&sums.mixed, &step)) / sums.own
        };
        let changes = self.frames.iter().enumerate().map(change).collect();
        (step, changes)
    }

    /// The inverse of the normal matrix within the span of `basis`, 0 outside it.
    fn inverse(&self, basis: &[Step], damping: f64) -> Matrix {
        let mut reduced = [[0.0; UNKNOWNS]; UNKNOWNS];
        for (row, a) in basis.iter().enumerate() {
            let product = multiply(&self.normal, a);
            for (column, b) in basis.iter().enumerate() {
                reduced[row][column] = dot(&product, b);
            }
            reduced[row][row] *= 1.0 + damping;
        }
        let (values, vectors) = eigen(&reduced, basis.len());
        let mut inverse = [[0.0; UNKNOWNS]; UNKNOWNS];
        for (value, vector) in values
            .iter()
            .zip(&vectors)
            .filter(|(value, _)| **value > 0.0)
        {
            let mut direction = [0.0; UNKNOWNS];
            for (share, b) in vector.iter().zip(basis) {
                for (d, x) in direction.iter_mut().zip(b) {
                    *d += share * x;
                }
            }
            add_square(&mut inverse, &direction, 1.0 / value);
        }
        inverse
    }

    /// The covariance of the step within the span of `basis`.
    ///
    /// `H⁻¹ (Σ_c u_c u_cᵀ) H⁻¹ / κ²`, with the scores `u_c = Σ w d J̃` summed over squares of the image: the
    /// residuals scale it, and those of one square may depend on each other in any way (Liang and Zeger
    /// 1986). `J̃` is `J` without what the frame's angle takes up, and κ how much less the robust sums
    /// change than least squares would (Huber 1981, Sec. 7.6). To this comes what all borders may be off by
    /// together.
    pub(super) fn covariance(&self, frames: &[Vec<Match>], scale: f64, basis: &[Step]) -> Matrix {
        let inverse = self.inverse(basis, 0.0);
        let mut spread = [[0.0; UNKNOWNS]; UNKNOWNS];
        let mut together = [0.0; UNKNOWNS];
        let (mut bend, mut total, mut squares) = (0.0, 0.0, 0usize);
        for (number, (matches, sums)) in frames.iter().zip(&self.frames).enumerate() {
            let taken = if self.angles && number > 0 && sums.own > 0.0 {
                1.0 / sums.own
            } else {
                0.0
            };
            let mut scores: BTreeMap<(i32, i32), Step> = BTreeMap::new();
            for m in matches {
                let w = m.weight(scale);
                let score = scores.entry(m.tile).or_insert([0.0; UNKNOWNS]);
                for (i, s) in score.iter_mut().enumerate() {
                    let slope = m.slopes[i] - m.angle_slope * taken * sums.mixed[i];
                    *s += w * m.distance * slope;
                    together[i] += w * m.doubt * slope;
                }
                bend += w * m.bend(scale);
                total += w;
            }
            squares += scores.len();
            scores
                .values()
                .for_each(|score| add_square(&mut spread, score, 1.0));
        }
        let unknowns = basis.len() + if self.angles { frames.len() - 1 } else { 0 };
        let small_sample = squares as f64 / squares.saturating_sub(unknowns).max(1) as f64;
        let kappa = (bend / total).max(0.05);
        let factor = small_sample / (kappa * kappa);
        let product = multiply_matrices(&multiply_matrices(&inverse, &spread), &inverse);
        let mut covariance = product.map(|row| row.map(|x| factor * x));
        add_square(&mut covariance, &multiply(&inverse, &together), 1.0);
        covariance
    }

    /// Change of one frame's angle alone that suits it best, and its standard deviation; radians. `None`
    /// where the outline does not show the angle.
    pub(super) fn angle_of(
        &self,
        number: usize,
        matches: &[Match],
        scale: f64,
    ) -> Option<(f64, f64)> {
        let own = self.frames[number].own;
        let seen: f64 = matches
            .iter()
            .map(|m| m.weight(scale) * m.angle_slide * m.angle_slide)
            .sum();
        if own <= 0.0 || seen < SLIDING * own {
            return None;
        }
        let mut scores: BTreeMap<(i32, i32), f64> = BTreeMap::new();
        for m in matches {
            let w = m.weight(scale);
            *scores.entry(m.tile).or_insert(0.0) += w * m.distance * m.angle_slope;
        }
        let spread: f64 = scores.values().map(|score| score * score).sum();
        let change: f64 = scores.values().sum::<f64>() / own;
        Some((change, spread.sqrt() / own))
    }
}

/// Share of its information from which on a direction counts as seen by the smooth surface; below it, the
/// facets of the mesh are all that tells it. A sphere of 64 segments has 3e-4 by its facets.
const SLIDING: f64 = 0.01;

/// Directions of the free unknowns that the outlines determine, and those they do not.
pub(super) struct Directions {
    pub(super) known: Vec<Step>,
    pub(super) unknown: Vec<Step>,
}

/// Parts the free unknowns by what the smooth surface's motion along its own normal shows (the slippage of
/// Gelfand and Guibas 2004): a sphere that turns, or a cup about its axis, slides along itself.
///
/// The outline's own derivatives would not do: the facets of a mesh tell its turn to a thousandth of a
/// degree, but the real object has none. A direction is unknown whose points move by less than a small
/// share of the best direction's (`least_share` of its square), or whose standard deviation would be beyond
/// `largest_sigma`.
pub(super) fn directions(
    surface: &Matrix,
    free: &[usize],
    least_share: f64,
    largest_sigma: f64,
) -> Directions {
    let mut reduced = [[0.0; UNKNOWNS]; UNKNOWNS];
    for (row, &i) in free.iter().enumerate() {
        for (column, &j) in free.iter().enumerate() {
            reduced[row][column] = surface[i][j];
        }
    }
    let (values, vectors) = eigen(&reduced, free.len());
    let most = values.iter().copied().fold(0.0, f64::max);
    let mut directions = Directions {
        known: Vec::new(),
        unknown: Vec::new(),
    };
    for (value, vector) in values.iter().zip(&vectors) {
        let mut direction = [0.0; UNKNOWNS];
        for (&i, x) in free.iter().zip(vector) {
            direction[i] = *x;
        }
        let seen = *value > least_share * most && *value * largest_sigma * largest_sigma > 1.0;
        if seen {
            directions.known.push(direction);
        } else {
            directions.unknown.push(direction);
        }
    }
    directions
}

/// Eigenvalues and unit eigenvectors of the first `n` rows and columns of a symmetric matrix, by Jacobi's
/// rotations.
pub(super) fn eigen(matrix: &Matrix, n: usize) -> (Vec<f64>, Vec<Vec<f64>>) {
    let mut a: Vec<Vec<f64>> = matrix[..n].iter().map(|row| row[..n].to_vec()).collect();
    let mut vectors: Vec<Vec<f64>> = (0..n)
        .map(|i| (0..n).map(|j| f64::from(u8::from(i == j))).collect())
        .collect();
    for _sweep in 0..60 {
        let off: f64 = (0..n)
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .map(|(i, j)| a[i][j].powi(2))
            .sum();
        let diagonal: f64 = (0..n).map(|i| a[i][i].powi(2)).sum();
        if off <= 1e-32 * diagonal {
            break;
        }
        for p in 0..n {
            for q in p + 1..n {
                if a[p][q] == 0.0 {
                    continue;
                }
                // The rotation that makes a[p][q] vanish, by the smaller angle.
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let c = 1.0 / t.hypot(1.0);
                let s = t * c;
                for row in &mut a {
                    (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
                }
                turn_rows(&mut a, (p, q), (c, s));
                turn_rows(&mut vectors, (p, q), (c, s));
            }
        }
    }
    ((0..n).map(|i| a[i][i]).collect(), vectors)
}

/// Turns two rows, `p < q`, in their plane.
fn turn_rows(rows: &mut [Vec<f64>], (p, q): (usize, usize), (c, s): (f64, f64)) {
    let (before, from_q) = rows.split_at_mut(q);
    for (x, y) in before[p].iter_mut().zip(&mut from_q[0]) {
        (*x, *y) = (c * *x - s * *y, s * *x + c * *y);
    }
}

pub(super) fn dot(a: &Step, b: &Step) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn multiply(matrix: &Matrix, vector: &Step) -> Step {
    std::array::from_fn(|i| dot(&matrix[i], vector))
}

fn multiply_matrices(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..UNKNOWNS).map(|k| a[i][k] * b[k][j]).sum()))
}

fn add_square(matrix: &mut Matrix, vector: &Step, factor: f64) {
    for (row, x) in matrix.iter_mut().zip(vector) {
        for (cell, y) in row.iter_mut().zip(vector) {
            *cell += factor * x * y;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn eigen_rebuilds_the_matrix(values in prop::collection::vec(-2.0f64..2.0, 55)) {
            // Row after row of the lower triangle.
            let place = |i: usize, j: usize| i.max(j) * (i.max(j) + 1) / 2 + i.min(j);
            let matrix: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| values[place(i, j)]));
            let (values, vectors) = eigen(&matrix, UNKNOWNS);
            for i in 0..UNKNOWNS {
                for j in 0..UNKNOWNS {
                    let sum: f64 = (0..UNKNOWNS).map(|k| values[k] * vectors[k][i] * vectors[k][j]).sum();
                    prop_assert!((sum - matrix[i][j]).abs() < 1e-12);
                    let product: f64 = (0..UNKNOWNS).map(|k| vectors[i][k] * vectors[j][k]).sum();
                    prop_assert!((product - f64::from(u8::from(i == j))).abs() < 1e-12);
                }
            }
        }

        #[test]
        fn solving_recovers_steps_and_angles(
            slopes in prop::collection::vec(-1.0f64..1.0, 3 * 40 * 11), step in prop::collection::vec(-1.0f64..1.0, 12),
        ) {
            // Three frames; the angles of the second and third are unknown too.
            let frames: Vec<Vec<Match>> = (0..3).map(|t| (0..40).map(|i| {
                let row = &slopes[(t * 40 + i) * 11..][..11];
                let common: Step = std::array::from_fn(|k| row[k]);
                let angle = if t == 0 { 0.0 } else { step[9 + t] };
                let truth: Step = std::array::from_fn(|k| step[k]);
                Match {
                    distance: dot(&common, &truth) + row[10] * angle,
                    certainty: Certainty::Common, doubt: 0.0, length: 1.0, outer: true, slopes: common, angle_slope: row[10],
                    slides: common, angle_slide: row[10], tile: (i as i32, 0),
                }
            }).collect()).collect();
            let equations = Equations::new(&frames, 1e3, true, Kind::Outline);
            let basis: Vec<Step> = (0..UNKNOWNS).map(|i| std::array::from_fn(|j| f64::from(u8::from(i == j)))).collect();
            let (found, angles) = equations.solve(&basis, 0.0);
            for k in 0..UNKNOWNS {
                prop_assert!((found[k] - step[k]).abs() < 1e-6, "{k}: {} {}", found[k], step[k]);
            }
            prop_assert!(angles[0] == 0.0 && (angles[1] - step[10]).abs() < 1e-6 && (angles[2] - step[11]).abs() < 1e-6);
        }
    }
}
