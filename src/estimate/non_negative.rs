//! Non-negative least squares of many unknowns, from normal equations.
//!
//! ```text
//! min over x ≥ 0 of  xᵀ A x − 2 bᵀ x
//! ```
//!
//! Active sets (Lawson and Hanson 1974, ch. 23): the unknown that gains most is freed, and those that would
//! become negative go back to zero. The start is all unknowns, less those that come out negative.

/// A diagonal that a pivot falls below this share of depends on the columns before it, to rounding.
const DEPENDENT: f64 = 1e-10;
/// A gain below this share of the largest right-hand side is none.
const NO_GAIN: f64 = 1e-9;

/// The best `x ≥ 0`; `a` is symmetric, row after row. An unknown that depends on others stays at zero.
pub(super) fn solve(a: &[f64], b: &[f64]) -> Vec<f64> {
    let n = b.len();
    let mut x = vec![0.0; n];
    let mut free: Vec<usize> = Vec::new();
    let mut barred = vec![false; n];
    let scale: Vec<f64> = (0..n)
        .map(|i| a[i * n + i].max(f64::MIN_POSITIVE).sqrt())
        .collect();
    let largest = (0..n).map(|i| (b[i] / scale[i]).abs()).fold(0.0, f64::max);
    let mut start: Vec<usize> = (0..n).filter(|&i| a[i * n + i] > 0.0).collect();
    while let Some(solution) = solve_free(a, b, &start) {
        if solution.iter().all(|s| *s > 0.0) {
            start.iter().zip(&solution).for_each(|(&i, s)| x[i] = *s);
            free = start;
            break;
        }
        let kept = start.iter().zip(&solution).filter(|(_, s)| **s > 0.0);
        start = kept.map(|(&i, _)| i).collect();
    }
    // Each pass frees an unknown; the count only guards against cycling in the last bits.
    for _ in 0..3 * n {
        let gain = |i: usize| {
            let fitted: f64 = free.iter().map(|&j| a[i * n + j] * x[j]).sum();
            (b[i] - fitted) / scale[i]
        };
        let open = (0..n).filter(|&i| a[i * n + i] > 0.0 && !barred[i] && !free.contains(&i));
        let best = open
            .map(|i| (i, gain(i)))
            .max_by(|x, y| x.1.total_cmp(&y.1));
        let Some((entering, _)) = best.filter(|(_, gain)| *gain > NO_GAIN * largest) else {
            break;
        };
        free.push(entering);
        loop {
            let Some(solution) = solve_free(a, b, &free) else {
                free.retain(|&i| i != entering);
                barred[entering] = true;
                break;
            };
            // As far towards the solution as all stay positive.
            let steps = free.iter().zip(&solution).filter(|(_, s)| **s <= 0.0);
            let step = steps
                .map(|(&i, s)| x[i] / (x[i] - s))
                .fold(1.0f64, f64::min);
            for (&i, s) in free.iter().zip(&solution) {
                x[i] += step * (s - x[i]);
            }
            if step >= 1.0 {
                break;
            }
            let floor = 1e-14 * x.iter().copied().fold(0.0, f64::max);
            for &i in &free {
                if x[i] <= floor {
                    x[i] = 0.0;
                }
            }
            free.retain(|&i| x[i] > 0.0);
            if free.is_empty() {
                break;
            }
        }
    }
    x
}

/// The solution over the unknowns in `free`, in their order; none if they depend on each other.
fn solve_free(a: &[f64], b: &[f64], free: &[usize]) -> Option<Vec<f64>> {
    let l = factor(a, b.len(), free)?;
    Some(substitute(&l, free.iter().map(|&i| b[i]).collect()))
}

/// Cholesky's factor of the rows and columns in `used`, row after row.
fn factor(a: &[f64], n: usize, used: &[usize]) -> Option<Vec<f64>> {
    let m = used.len();
    let mut l = vec![0.0; m * m];
    for i in 0..m {
        for j in 0..=i {
            let (before, row) = l.split_at(i * m);
            let other = if j < i {
                &before[j * m..][..j]
            } else {
                &row[..j]
            };
            let known: f64 = row[..j].iter().zip(other).map(|(x, y)| x * y).sum();
            let entry = a[used[i] * n + used[j]];
            let rest = entry - known;
            l[i * m + j] = if i != j {
                rest / l[j * m + j]
            } else if rest > DEPENDENT * entry {
                rest.sqrt()
            } else {
                return None;
            };
        }
    }
    Some(l)
}

/// `x` of `L Lᵀ x = y`.
fn substitute(l: &[f64], mut x: Vec<f64>) -> Vec<f64> {
    let m = x.len();
    for i in 0..m {
        let known: f64 = l[i * m..][..i].iter().zip(&x).map(|(l, x)| l * x).sum();
        x[i] = (x[i] - known) / l[i * m + i];
    }
    for i in (0..m).rev() {
        let known: f64 = (i + 1..m).map(|k| l[k * m + i] * x[k]).sum();
        x[i] = (x[i] - known) / l[i * m + i];
    }
    x
}

/// `uᵀ A⁻¹ u` over the unknowns in `used`, the others being fixed; none if they depend on each other.
pub(super) fn variance(
    a: &[f64],
    n: usize,
    used: &[usize],
    u: impl Fn(usize) -> f64,
) -> Option<f64> {
    let l = factor(a, n, used)?;
    let u: Vec<f64> = used.iter().map(|&i| u(i)).collect();
    let x = substitute(&l, u.clone());
    Some(u.iter().zip(&x).map(|(u, x)| u * x).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn solutions_meet_the_conditions_of_karush_kuhn_and_tucker(
            rows in prop::collection::vec(prop::collection::vec(-1.0f64..2.0, 13), 4..40),
        ) {
            let n = 12;
            let (mut a, mut b) = (vec![0.0; n * n], vec![0.0; n]);
            for row in &rows {
                for i in 0..n {
                    b[i] += row[i] * row[n];
                    for j in 0..n {
                        a[i * n + j] += row[i] * row[j];
                    }
                }
            }
            let x = solve(&a, &b);
            for i in 0..n {
                let gradient = b[i] - (0..n).map(|j| a[i * n + j] * x[j]).sum::<f64>();
                prop_assert!(x[i] >= 0.0);
                prop_assert!(gradient < 1e-6, "{i}: {gradient}");
                prop_assert!(x[i] == 0.0 || gradient.abs() < 1e-6, "{i}: {gradient}");
            }
        }
    }

    #[test]
    fn variance_is_that_of_the_inverse() {
        // Inverse of [[4, 1], [1, 3]] is [[3, −1], [−1, 4]] / 11.
        let a = [4.0, 1.0, 1.0, 3.0];
        let sum = variance(&a, 2, &[0, 1], |_| 1.0).unwrap();
        assert!((sum - 5.0 / 11.0).abs() < 1e-12);
        assert!((variance(&a, 2, &[1], |_| 1.0).unwrap() - 1.0 / 3.0).abs() < 1e-12);
        assert!(variance(&[1.0; 4], 2, &[0, 1], |_| 1.0).is_none());
    }
}
