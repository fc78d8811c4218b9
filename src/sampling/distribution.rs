//! Piecewise-constant distributions on [0, 1) and on the unit square.

use glam::Vec2;

/// The largest f32 below 1.
const BELOW_ONE: f64 = 1.0 - f32::EPSILON as f64 / 2.0;

/// A piecewise-constant density on [0, 1), sampled by inverting its CDF.
///
/// Sums run in f64: 16384 × 8192 f32 weights over twelve decades would lose the small ones.
#[derive(Clone, Debug)]
pub struct Distribution1d {
    /// `[cells + 1]`, from 0 to 1.
    cdf: Vec<f64>,
}

impl Distribution1d {
    /// From non-negative, finite weights; all-zero weights give the uniform density. The sum of
    /// the weights comes back too.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> (Self, f64) {
        let mut cdf = vec![0.0];
        let mut sum = 0.0;
        for w in weights {
            sum += w;
            cdf.push(sum);
        }
        let cells = (cdf.len() - 1) as f64;
        if sum > 0.0 {
            cdf.iter_mut().for_each(|c| *c /= sum);
        } else {
            cdf.iter_mut()
                .enumerate()
                .for_each(|(i, c)| *c = i as f64 / cells);
        }
        (Self { cdf }, sum)
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.cdf.len() - 1
    }

    /// Probability of cell `i`.
    #[inline]
    pub fn probability(&self, i: usize) -> f64 {
        self.cdf[i + 1] - self.cdf[i]
    }

    /// The cell that holds quantile `u` in [0, 1), and where in it, in [0, 1) and still below 1
    /// as an f32.
    #[inline]
    pub fn invert(&self, u: f64) -> (usize, f64) {
        // The last cell whose CDF starts at or below u; empty cells are never chosen, not even
        // when a sum of variates was rounded up to 1.
        let u = u.min(1.0 - f64::EPSILON);
        let i = self.cdf.partition_point(|&c| c <= u).clamp(1, self.cells()) - 1;
        let width = self.probability(i);
        let inside = if width > 0.0 {
            (u - self.cdf[i]) / width
        } else {
            0.5
        };
        (i, inside.clamp(0.0, BELOW_ONE))
    }
}

/// A cell of a [`Distribution2d`] and a place in it.
#[derive(Clone, Copy, Debug)]
pub struct CellSample {
    /// Row of the cell.
    pub row: usize,
    /// Column of the cell.
    pub column: usize,
    /// Where in the cell, [0, 1)².
    pub inside: Vec2,
    /// Probability of the cell.
    pub probability: f64,
}

/// A distribution over the cells of a grid: a marginal over rows, a conditional in each.
#[derive(Clone, Debug)]
pub struct Distribution2d {
    rows: Distribution1d,
    columns: Vec<Distribution1d>,
}

impl Distribution2d {
    /// From `[height][width]` non-negative weights, row by row.
    pub fn new<R: IntoIterator<Item = f64>>(weights: impl IntoIterator<Item = R>) -> Self {
        let (columns, sums): (Vec<_>, Vec<_>) =
            weights.into_iter().map(Distribution1d::new).unzip();
        let (rows, _) = Distribution1d::new(sums);
        Self { rows, columns }
    }

    /// A cell with its probability, and a uniform place in it.
    #[inline]
    pub fn sample(&self, u: Vec2) -> CellSample {
        let (row, y) = self.rows.invert(f64::from(u.y));
        let (column, x) = self.columns[row].invert(f64::from(u.x));
        let inside = Vec2::new(x as f32, y as f32);
        CellSample {
            row,
            column,
            inside,
            probability: self.probability(row, column),
        }
    }

    /// Probability of a cell.
    #[inline]
    pub fn probability(&self, row: usize, column: usize) -> f64 {
        self.rows.probability(row) * self.columns[row].probability(column)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn zero_weights_give_the_uniform_distribution() {
        let d = Distribution2d::new(vec![vec![0.0; 4]; 2]);
        assert!((d.probability(1, 3) - 0.125).abs() < 1e-12);
    }

    #[test]
    fn empty_cells_are_never_chosen() {
        let (d, _) = Distribution1d::new([0.0, 1.0, 0.0, 3.0, 0.0]);
        for i in 0..1000 {
            let (cell, _) = d.invert(f64::from(i) / 1000.0);
            assert!(cell == 1 || cell == 3);
        }
        assert_eq!(d.invert(1.0).0, 3);
    }

    #[test]
    fn places_in_a_cell_stay_below_one() {
        // 1 − 1e-9 is 1 as an f32, which is the next cell.
        let d = Distribution2d::new([[1.0, 1.0]]);
        let below_half = 0.5 - f32::EPSILON / 4.0;
        let cell = d.sample(Vec2::new(below_half, 1.0 - f32::EPSILON / 2.0));
        assert_eq!((cell.row, cell.column), (0, 0));
        assert!(cell.inside.x < 1.0 && cell.inside.y < 1.0, "{cell:?}");
        let (_, inside) = Distribution1d::new([1.0]).0.invert(1.0 - 1e-12);
        assert!((inside as f32) < 1.0);
    }

    proptest! {
        #[test]
        fn cells_are_chosen_by_their_weight(weights in prop::collection::vec(0.0f64..1e6, 2..40)) {
            let total: f64 = weights.iter().sum();
            prop_assume!(total > 1.0);
            let (d, sum) = Distribution1d::new(weights.iter().copied());
            prop_assert!((sum - total).abs() < 1e-6 * total);
            let n = 20_000;
            let mut counts = vec![0.0; weights.len()];
            for i in 0..n {
                counts[d.invert((f64::from(i) + 0.5) / f64::from(n)).0] += 1.0 / f64::from(n);
            }
            for (count, weight) in counts.iter().zip(&weights) {
                prop_assert!((count - weight / total).abs() < 1.01 / f64::from(n));
            }
        }
    }
}
