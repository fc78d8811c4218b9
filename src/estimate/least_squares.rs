//! Small non-negative least squares: the albedos for a given lobe.
//!
//! ```text
//! min over x ≥ 0 of  Σ_i (y_i − J_i x)ᵀ P_i (y_i − J_i x)
//! ```
//!
//! with `y_i` an observation's RGB, `P_i` its precision, and `x` the albedos, at most seven. Sums over
//! observations are kept as normal equations.

use glam::{DMat3, DVec3};

/// Largest number of unknowns: three diffuse albedos and four of the lobe.
pub(super) const UNKNOWNS: usize = 7;

/// A diagonal that a pivot falls below this share of depends on the columns before it, to rounding.
const DEPENDENT: f64 = 1e-11;

/// Normal equations `A x = b` of a weighted least-squares problem, and `Σ yᵀ P y`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Normal {
    pub(super) a: [[f64; UNKNOWNS]; UNKNOWNS],
    pub(super) b: [f64; UNKNOWNS],
    pub(super) yy: f64,
    /// Number of unknowns in use.
    pub(super) size: usize,
}

impl Normal {
    /// Adds the diffuse albedos' part of an observation: unknowns 0 to 2.
    #[inline]
    pub(super) fn add_diffuse(&mut self, p: &DMat3, diffuse: DVec3, observed: DVec3) {
        let py = *p * observed;
        self.yy += observed.dot(py);
        for c in 0..3 {
            self.b[c] += diffuse[c] * py[c];
            for d in 0..3 {
                self.a[c][d] += diffuse[c] * p.col(d)[c] * diffuse[d];
            }
        }
    }

    /// Adds an observation, given its derivative by every unknown.
    pub(super) fn add(&mut self, p: &DMat3, jacobian: &[DVec3], observed: DVec3) {
        self.yy += observed.dot(*p * observed);
        for (i, column) in jacobian.iter().enumerate() {
            let weighted = *p * *column;
            self.b[i] += observed.dot(weighted);
            for (j, other) in jacobian.iter().enumerate() {
                self.a[i][j] += other.dot(weighted);
            }
        }
    }

    /// The weighted squared residual at `x`.
    pub(super) fn objective(&self, x: &[f64; UNKNOWNS]) -> f64 {
        let mut value = self.yy;
        for i in 0..self.size {
            value -= 2.0 * self.b[i] * x[i];
            for j in 0..self.size {
                value += x[i] * self.a[i][j] * x[j];
            }
        }
        value.max(0.0)
    }

    /// The best `x ≥ 0` and its objective (Lawson and Hanson 1974, ch. 23). A column that depends on
    /// others stays at zero.
    pub(super) fn solve(&self) -> ([f64; UNKNOWNS], f64) {
        let n = self.size;
        let mut free = [false; UNKNOWNS];
        let mut barred = [false; UNKNOWNS];
        let mut x = [0.0; UNKNOWNS];
        // Mostly nothing is at its bound.
        let all = std::array::from_fn(|i| i < n);
        if let Some(solution) = self.solve_free(&all)
            && solution[..n].iter().all(|v| *v >= 0.0)
        {
            return (solution, self.objective(&solution));
        }
        // Each pass frees the unknown that gains most; the count only guards against cycling in the
        // last bits.
        for _ in 0..3 * n {
            let gain = |i: usize| {
                let gradient = self.b[i] - (0..n).map(|j| self.a[i][j] * x[j]).sum::<f64>();
                gradient / self.a[i][i].sqrt().max(f64::MIN_POSITIVE)
            };
            let best = (0..n)
                .filter(|&i| !free[i] && !barred[i])
                .max_by(|&i, &j| gain(i).total_cmp(&gain(j)));
            let Some(entering) = best.filter(|&i| gain(i) > 1e-12 * self.yy.sqrt()) else {
                break;
            };
            free[entering] = true;
            loop {
                let Some(solution) = self.solve_free(&free) else {
                    free[entering] = false;
                    barred[entering] = true;
                    break;
                };
                // As far towards the solution as all stay positive.
                let step = (0..n)
                    .filter(|&i| free[i] && solution[i] <= 0.0)
                    .map(|i| x[i] / (x[i] - solution[i]))
                    .fold(1.0, f64::min);
                for i in (0..n).filter(|&i| free[i]) {
                    x[i] += step * (solution[i] - x[i]);
                }
                if step >= 1.0 {
                    break;
                }
                for i in 0..n {
                    if free[i] && x[i] <= 1e-15 {
                        (free[i], x[i]) = (false, 0.0);
                    }
                }
            }
        }
        (x, self.objective(&x))
    }

    /// The solution with the unknowns not in `free` at zero, by Cholesky; none if columns depend on
    /// each other.
    fn solve_free(&self, free: &[bool; UNKNOWNS]) -> Option<[f64; UNKNOWNS]> {
        let mut used = [0; UNKNOWNS];
        let mut m = 0;
        for i in (0..self.size).filter(|&i| free[i]) {
            used[m] = i;
            m += 1;
        }
        let mut l = [[0.0; UNKNOWNS]; UNKNOWNS];
        let mut z = [0.0; UNKNOWNS];
        for i in 0..m {
            for j in 0..=i {
                let known: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
                let rest = self.a[used[i]][used[j]] - known;
                if i != j {
                    l[i][j] = rest / l[j][j];
                } else if rest > DEPENDENT * self.a[used[i]][used[i]] {
                    l[i][i] = rest.sqrt();
                } else {
                    return None;
                }
            }
            let known: f64 = (0..i).map(|k| l[i][k] * z[k]).sum();
            z[i] = (self.b[used[i]] - known) / l[i][i];
        }
        let mut x = [0.0; UNKNOWNS];
        for i in (0..m).rev() {
            let known: f64 = (i + 1..m).map(|k| l[k][i] * x[used[k]]).sum();
            x[used[i]] = (z[i] - known) / l[i][i];
        }
        Some(x)
    }
}

/// Diagonal of the inverse of a symmetric positive semi-definite matrix; infinite for unknowns that
/// it does not determine.
///
/// Scaled to a unit diagonal first, then inverted by Gauss–Jordan steps on the largest remaining
/// pivot. A pivot below 1e-10 means that the column depends on the others to rounding: all
/// unknowns that take part are undetermined.
pub(super) fn inverse_diagonal(matrix: Vec<Vec<f64>>) -> Vec<f64> {
    let n = matrix.len();
    let scale: Vec<f64> = (0..n).map(|i| matrix[i][i].max(0.0).sqrt()).collect();
    let known: Vec<usize> = (0..n).filter(|&i| scale[i] > 0.0).collect();
    let m = known.len();
    let mut a: Vec<Vec<f64>> = (0..m)
        .map(|i| {
            let row =
                (0..m).map(|j| matrix[known[i]][known[j]] / (scale[known[i]] * scale[known[j]]));
            row.chain((0..m).map(|j| if i == j { 1.0 } else { 0.0 }))
                .collect()
        })
        .collect();
    let mut open: Vec<usize> = (0..m).collect();
    let mut variances = vec![f64::INFINITY; n];
    while let Some(place) =
        (0..open.len()).max_by(|&x, &y| a[open[x]][open[x]].total_cmp(&a[open[y]][open[y]]))
    {
        let pivot = open.swap_remove(place);
        if a[pivot][pivot] < 1e-10 {
            // Everything still open, and whatever is coupled to it, is undetermined.
            open.push(pivot);
            for i in (0..m).filter(|i| !open.contains(i)) {
                if open.iter().all(|&j| a[i][j].abs() < 1e-6) {
                    variances[known[i]] = a[i][m + i] / (scale[known[i]] * scale[known[i]]);
                }
            }
            return variances;
        }
        let inverse = 1.0 / a[pivot][pivot];
        a[pivot].iter_mut().for_each(|v| *v *= inverse);
        let row = a[pivot].clone();
        for (i, other) in a.iter_mut().enumerate().filter(|(i, _)| *i != pivot) {
            let factor = other[pivot];
            debug_assert!(i != pivot);
            other
                .iter_mut()
                .zip(&row)
                .for_each(|(v, r)| *v -= factor * r);
        }
    }
    for i in 0..m {
        variances[known[i]] = a[i][m + i] / (scale[known[i]] * scale[known[i]]);
    }
    variances
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn normal(samples: &[(f64, f64, [f64; 3])], p: &DMat3, coloured: bool) -> Normal {
        let mut normal = Normal {
            size: if coloured { 6 } else { 4 },
            ..Normal::default()
        };
        for &(d, s, t) in samples {
            let mut jacobian: Vec<DVec3> = DVec3::AXES.map(|axis| axis * d).to_vec();
            if coloured {
                jacobian.extend(DVec3::AXES.map(|axis| axis * s));
            } else {
                jacobian.push(DVec3::splat(s));
            }
            normal.add(p, &jacobian, DVec3::from(t));
        }
        normal
    }

    /// Channels correlated by 0.9.
    fn correlated() -> DMat3 {
        (DMat3::IDENTITY * 0.1 + DMat3::from_cols(DVec3::ONE, DVec3::ONE, DVec3::ONE) * 0.9)
            .inverse()
    }

    #[test]
    fn exact_data_give_exact_albedos() {
        let truth = ([0.4, 0.3, 0.2], 2.35);
        let samples: Vec<_> = (0..9)
            .map(|i| {
                let (d, s) = (1.0 + 0.1 * f64::from(i), f64::from(i * i) * 0.02);
                (d, s, truth.0.map(|r| r * d + truth.1 * s))
            })
            .collect();
        for p in [DMat3::IDENTITY, correlated()] {
            for coloured in [false, true] {
                let (x, objective) = normal(&samples, &p, coloured).solve();
                assert!((x[3] - 2.35).abs() < 1e-8 && (x[0] - 0.4).abs() < 1e-8);
                assert!(objective < 1e-8);
            }
        }
    }

    #[test]
    fn collinear_columns_stay_finite() {
        let samples: Vec<_> = (1..5)
            .map(|i| (f64::from(i), 2.0 * f64::from(i), [1.0; 3]))
            .collect();
        let (x, _) = normal(&samples, &DMat3::IDENTITY, false).solve();
        assert!(x.iter().all(|r| r.is_finite() && *r >= 0.0));
        // Only the sum is determined: Σ d / Σ d² = 10/30.
        assert!((x[0] + 2.0 * x[3] - 1.0 / 3.0).abs() < 1e-9, "{x:?}");
    }

    #[test]
    fn inverse_diagonal_of_a_known_matrix() {
        let v = inverse_diagonal(vec![vec![4.0, 1.0], vec![1.0, 3.0]]);
        assert!((v[0] - 3.0 / 11.0).abs() < 1e-12 && (v[1] - 4.0 / 11.0).abs() < 1e-12);
    }

    #[test]
    fn dependent_unknowns_are_undetermined_and_others_are_not() {
        // Unknowns 0 and 1 only occur as a sum; 2 stands alone; 3 does not occur.
        let v = inverse_diagonal(vec![
            vec![1.0, 1.0, 0.0, 0.0],
            vec![1.0, 1.0, 0.0, 0.0],
            vec![0.0, 0.0, 4.0, 0.0],
            vec![0.0; 4],
        ]);
        assert!(v[0].is_infinite() && v[1].is_infinite() && v[3].is_infinite());
        assert!((v[2] - 0.25).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn solutions_meet_the_conditions_of_karush_kuhn_and_tucker(
            samples in prop::collection::vec((0.0f64..2.0, 0.0f64..2.0, (-1.0f64..3.0, -1.0f64..3.0, -1.0f64..3.0)), 3..12),
            coloured in any::<bool>(),
        ) {
            let samples: Vec<_> = samples.into_iter().map(|(d, s, t)| (d, s, [t.0, t.1, t.2])).collect();
            let normal = normal(&samples, &correlated(), coloured);
            let (x, _) = normal.solve();
            let size = normal.yy.max(1.0);
            for i in 0..normal.size {
                let gradient = normal.b[i] - (0..normal.size).map(|j| normal.a[i][j] * x[j]).sum::<f64>();
                prop_assert!(x[i] >= 0.0);
                prop_assert!(gradient <= 1e-6 * size, "{i}: {gradient}");
                prop_assert!(x[i] == 0.0 || gradient.abs() <= 1e-6 * size, "{i}: {gradient}");
            }
        }
    }
}
