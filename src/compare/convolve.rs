//! Separable convolution of planes.

use rayon::prelude::*;

/// One number a pixel, row 0 at the top.
#[derive(Clone)]
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values: Vec<f64>,
}

/// What lies beyond the edge.
#[derive(Clone, Copy)]
pub(super) enum Edge {
    /// Nothing.
    Zero,
    /// The pixel at the edge.
    Repeat,
}

impl Plane {
    /// Correlates rows with `horizontal` and columns with `vertical`, both of odd length and
    /// centred.
    pub(super) fn convolve(&self, horizontal: &[f64], vertical: &[f64], edge: Edge) -> Self {
        self.rows(horizontal, edge).columns(vertical, edge)
    }

    fn rows(&self, kernel: &[f64], edge: Edge) -> Self {
        let mut out = self.clone();
        let rows = self.values.par_chunks_exact(self.width);
        out.values
            .par_chunks_exact_mut(self.width)
            .zip(rows)
            .for_each(|(out, row)| {
                let padded = pad(row, kernel.len() / 2, edge);
                out.fill(0.0);
                for (offset, weight) in kernel.iter().enumerate() {
                    let shifted = &padded[offset..offset + row.len()];
                    out.iter_mut()
                        .zip(shifted)
                        .for_each(|(out, value)| *out += weight * value);
                }
            });
        out
    }

    fn columns(&self, kernel: &[f64], edge: Edge) -> Self {
        let mut out = self.clone();
        out.values
            .par_chunks_exact_mut(self.width)
            .enumerate()
            .for_each(|(y, out)| {
                out.fill(0.0);
                for (weight, row) in taps(kernel, y, self.height, edge) {
                    let row = &self.values[row * self.width..(row + 1) * self.width];
                    out.iter_mut()
                        .zip(row)
                        .for_each(|(out, value)| *out += weight * value);
                }
            });
        out
    }
}

/// The row with `radius` more values at either end.
fn pad(row: &[f64], radius: usize, edge: Edge) -> Vec<f64> {
    let beyond = |end: Option<&f64>| match (edge, end) {
        (Edge::Repeat, Some(&value)) => value,
        _ => 0.0,
    };
    let (before, after) = (
        vec![beyond(row.first()); radius],
        vec![beyond(row.last()); radius],
    );
    [&before, row, &after].concat()
}

/// Weights and positions of a kernel centred at `at` on an axis of `size`.
fn taps(kernel: &[f64], at: usize, size: usize, edge: Edge) -> impl Iterator<Item = (f64, usize)> {
    let first = at as isize - (kernel.len() / 2) as isize;
    kernel.iter().enumerate().filter_map(move |(i, &weight)| {
        let position = first + i as isize;
        let inside = position.clamp(0, size as isize - 1);
        match edge {
            Edge::Zero if position != inside => None,
            _ => Some((weight, inside as usize)),
        }
    })
}

/// Gaussian of the given standard deviation at −radius..=radius, summing to 1.
pub(super) fn gaussian(sigma: f64, radius: usize) -> Vec<f64> {
    let radius = radius as i32;
    let weights: Vec<f64> = (-radius..=radius)
        .map(|x| (-0.5 * (f64::from(x) / sigma).powi(2)).exp())
        .collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|weight| weight / sum).collect()
}
