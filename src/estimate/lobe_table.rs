//! Normal equations at every roughness from sums over observations, made once.
//!
//! Between the roughnesses of the grid a specular trace is a cubic through four neighbours,
//! `T_s(x) = Σ_a w_a(x) T_s(x_a)` with `x = ln alpha`. So its products are known at every x from those of
//! neighbouring nodes:
//!
//! ```text
//! T_s(x)ᵀ P T_s(x) = Σ_ab w_a w_b T_s(x_a)ᵀ P T_s(x_b),    T_s(x)ᵀ P y = Σ_a w_a T_s(x_a)ᵀ P y
//! ```
//!
//! A search over x, its derivatives and whole sums over points then cost nothing per observation. Where
//! pixels' patches are curved, the traces at the nodes are those of the widened lobe, and the cubic runs
//! through them.

use super::columns::{RANGE, ROUGHNESSES, ln_step};
use super::least_squares::Normal;

/// Nodes of a cubic.
pub(super) const TAPS: usize = 4;

/// A cubic's weights at one place: those of its value and of its slope.
pub(super) struct Stencil {
    pub(super) first: usize,
    pub(super) value: [f64; TAPS],
    pub(super) slope: [f64; TAPS],
}

impl Stencil {
    /// Lagrange's cubic through the four nodes about `ln_alpha`. Beyond the grid a trace stays as it is at
    /// the end.
    pub(super) fn at(ln_alpha: f64) -> Self {
        let step = ln_step();
        let place = (ln_alpha - f64::from(RANGE.0).ln()) / step;
        let x = place.clamp(0.0, (ROUGHNESSES - 1) as f64);
        // A place at the end may lie past it by rounding.
        let per_step = if (x - place).abs() < 1e-6 {
            1.0 / step
        } else {
            0.0
        };
        let k = (x as usize).clamp(1, ROUGHNESSES - 3);
        let t = x - k as f64;
        let (a, b, c, d) = (t + 1.0, t, t - 1.0, t - 2.0);
        Self {
            first: k - 1,
            value: [
                -b * c * d / 6.0,
                a * c * d / 2.0,
                -a * b * d / 2.0,
                a * b * c / 6.0,
            ],
            slope: [
                -(c * d + b * d + b * c) / 6.0,
                (c * d + a * d + a * c) / 2.0,
                -(b * d + a * d + a * b) / 2.0,
                (b * c + a * c + a * b) / 6.0,
            ]
            .map(|weight| weight * per_step),
        }
    }
}

/// The lobe's part: products of its traces with each other and with what is observed.
#[derive(Clone, Debug)]
pub(super) struct LobeTable {
    /// Parameters of the lobe that enter linearly.
    pub(super) size: usize,
    /// `Σ yᵀ P y`.
    pub(super) yy: f64,
    /// `[node][parameter]` products with the observations.
    pub(super) b: Vec<f64>,
    /// `[node][lag][parameter at node − lag][parameter at node]` products with each other.
    pub(super) band: Vec<f64>,
}

impl LobeTable {
    /// A table of nothing.
    pub(super) fn zero(size: usize) -> Self {
        Self {
            size,
            yy: 0.0,
            b: vec![0.0; ROUGHNESSES * size],
            band: vec![0.0; ROUGHNESSES * TAPS * size * size],
        }
    }

    pub(super) fn band_index(&self, node: usize, lag: usize, j: usize, l: usize) -> usize {
        ((node * TAPS + lag) * self.size + j) * self.size + l
    }

    /// Product of parameter j's trace at node `m` with parameter l's at node `n`.
    fn product(&self, (m, j): (usize, usize), (n, l): (usize, usize)) -> f64 {
        if m <= n {
            self.band[self.band_index(n, n - m, j, l)]
        } else {
            self.band[self.band_index(m, m - n, l, j)]
        }
    }

    /// `Σ_ab u_a v_b` of the products of parameters j and l.
    fn blend(&self, first: usize, u: &[f64; TAPS], v: &[f64; TAPS], j: usize, l: usize) -> f64 {
        let mut sum = 0.0;
        for (a, u) in u.iter().enumerate() {
            for (b, v) in v.iter().enumerate() {
                sum += u * v * self.product((first + a, j), (first + b, l));
            }
        }
        sum
    }

    fn blend_b(&self, stencil: &Stencil, j: usize) -> f64 {
        let nodes = stencil.first..;
        nodes
            .zip(stencil.value)
            .map(|(node, w)| w * self.b[node * self.size + j])
            .sum()
    }

    /// Normal equations of the lobe alone at `ln_alpha`.
    pub(super) fn at(&self, ln_alpha: f64) -> Normal {
        let stencil = Stencil::at(ln_alpha);
        let mut normal = Normal {
            yy: self.yy,
            size: self.size,
            ..Normal::default()
        };
        self.fill(&stencil, 0, &mut normal);
        normal
    }

    pub(super) fn fill(&self, stencil: &Stencil, offset: usize, normal: &mut Normal) {
        for j in 0..self.size {
            normal.b[offset + j] = self.blend_b(stencil, j);
            for l in 0..=j {
                let (v, first) = (&stencil.value, stencil.first);
                let entry = self.blend(first, v, v, j, l);
                normal.a[offset + j][offset + l] = entry;
                normal.a[offset + l][offset + j] = entry;
            }
        }
    }

    /// Fisher information of (lobe, ln alpha) at `ln_alpha` and `lobe`, at unit scale.
    pub(super) fn information(&self, ln_alpha: f64, lobe: &[f64]) -> Vec<Vec<f64>> {
        let m = self.size;
        let stencil = Stencil::at(ln_alpha);
        let (value, slope, first) = (&stencil.value, &stencil.slope, stencil.first);
        let mut information = vec![vec![0.0; m + 1]; m + 1];
        for j in 0..m {
            for l in 0..m {
                information[j][l] = self.blend(first, value, value, j, l);
                let mixed = lobe[l] * self.blend(first, value, slope, j, l);
                information[j][m] += mixed;
                information[m][j] += mixed;
                information[m][m] += lobe[j] * lobe[l] * self.blend(first, slope, slope, j, l);
            }
        }
        information
    }

    /// Adds another table.
    pub(super) fn add(&mut self, other: &Self) {
        self.yy += other.yy;
        for (to, from) in [(&mut self.b, &other.b), (&mut self.band, &other.band)] {
            to.iter_mut().zip(from).for_each(|(t, f)| *t += f);
        }
    }

    /// All numbers in a row, to store: `yy` apart.
    pub(super) fn numbers(&self) -> impl Iterator<Item = f64> + '_ {
        self.b.iter().chain(&self.band).copied()
    }

    /// Adds numbers stored by [`LobeTable::numbers`], times a weight.
    pub(super) fn add_numbers(&mut self, yy: f64, numbers: &[f32], weight: f64) {
        self.yy += weight * yy;
        for (to, from) in self.b.iter_mut().chain(&mut self.band).zip(numbers) {
            *to += weight * f64::from(*from);
        }
    }
}
