//! Minima over `ln alpha`: all of them, since the second-best may be nearly as good.

use super::columns::{ROUGHNESSES, roughness};

/// How closely a minimum's place is found, in `ln alpha`: a hundredth of what the best single points
/// determine.
const TOLERANCE: f64 = 1e-5;

/// An objective over the range of alpha.
pub(super) struct Landscape {
    /// `[ROUGHNESSES]` (ln alpha, value) at the grid's roughnesses.
    pub(super) grid: Vec<(f64, f64)>,
    /// (ln alpha, value) of every local minimum, the best first.
    pub(super) minima: Vec<(f64, f64)>,
}

impl Landscape {
    /// Values on the grid, and every local minimum to 1e-5. The grid is finer than an objective's own
    /// scale, so no minimum hides in it.
    pub(super) fn survey(value: impl Fn(f64) -> f64) -> Self {
        let places = (0..ROUGHNESSES).map(|k| f64::from(roughness(k).ln()));
        let grid: Vec<(f64, f64)> = places.map(|x| (x, value(x))).collect();
        let is_lowest = |k: usize| {
            // Of a level stretch only the first place counts.
            (k == 0 || grid[k].1 < grid[k - 1].1)
                && (k + 1 == ROUGHNESSES || grid[k].1 <= grid[k + 1].1)
        };
        let mut minima: Vec<(f64, f64)> = (0..ROUGHNESSES)
            .filter(|&k| is_lowest(k))
            .map(|k| descend(&grid, k, &value))
            .collect();
        minima.sort_by(|a, b| a.1.total_cmp(&b.1));
        Self { grid, minima }
    }

    /// The best minimum within a step of the grid about `ln_alpha`.
    pub(super) fn near(ln_alpha: f64, value: impl Fn(f64) -> f64) -> (f64, f64) {
        let low = f64::from(roughness(0).ln());
        let high = f64::from(roughness(ROUGHNESSES - 1).ln());
        let step = (high - low) / (ROUGHNESSES - 1) as f64;
        minimum_within(
            (ln_alpha - step).max(low),
            (ln_alpha + step).min(high),
            value,
        )
    }
}

/// The minimum between the neighbours of node `k`.
fn descend(grid: &[(f64, f64)], k: usize, value: impl Fn(f64) -> f64) -> (f64, f64) {
    let low = grid[k.saturating_sub(1)].0;
    let high = grid[(k + 1).min(grid.len() - 1)].0;
    minimum_within(low, high, value)
}

/// The `ln alpha` of the smallest value: the best of the grid, and what lies about it.
pub(super) fn minimise_over_alpha(value: impl Fn(f32) -> f64) -> f32 {
    let value = |x: f64| value(x as f32);
    let places = (0..ROUGHNESSES).map(|k| f64::from(roughness(k).ln()));
    let grid: Vec<(f64, f64)> = places.map(|x| (x, value(x))).collect();
    let best = (0..ROUGHNESSES)
        .min_by(|&a, &b| grid[a].1.total_cmp(&grid[b].1))
        .unwrap_or(0);
    descend(&grid, best, value).0 as f32
}

/// Place and value of the smallest value in a bracket (Brent 1973, ch. 5): parabolas through the three best
/// places, and golden sections where those do not shrink the bracket. The ends count.
fn minimum_within(low: f64, high: f64, value: impl Fn(f64) -> f64) -> (f64, f64) {
    const GOLDEN: f64 = 0.381_966_011_250_105;
    let ends = [(low, value(low)), (high, value(high))];
    let (mut low, mut high) = (low, high);
    let start = low + GOLDEN * (high - low);
    let mut best = (start, value(start));
    let (mut second, mut third) = (best, best);
    // Of the last step and the one before it.
    let (mut step, mut before) = (0.0f64, 0.0f64);
    // A golden section each round would take 24 of them.
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if (best.0 - middle).abs() <= 2.0 * TOLERANCE - 0.5 * (high - low) {
            break;
        }
        let parabola = vertex(best, second, third).filter(|vertex| {
            let inside = low < *vertex && *vertex < high;
            inside && (vertex - best.0).abs() < 0.5 * before.abs()
        });
        before = step;
        step = match parabola {
            // Beside an end, a step to the other side closes the bracket.
            Some(vertex) if (vertex - low).min(high - vertex) < 2.0 * TOLERANCE => {
                TOLERANCE.copysign(middle - best.0)
            }
            Some(vertex) => vertex - best.0,
            None => {
                before = if best.0 < middle { high } else { low } - best.0;
                GOLDEN * before
            }
        };
        let place = best.0 + step.abs().max(TOLERANCE).copysign(step);
        let next = (place, value(place));
        if next.1 <= best.1 {
            if place < best.0 {
                high = best.0;
            } else {
                low = best.0;
            }
            (third, second, best) = (second, best, next);
        } else {
            if place < best.0 {
                low = place;
            } else {
                high = place;
            }
            if next.1 <= second.1 || second.0 == best.0 {
                (third, second) = (second, next);
            } else if next.1 <= third.1 || third.0 == best.0 || third.0 == second.0 {
                third = next;
            }
        }
    }
    ends.into_iter()
        .fold(best, |best, end| if end.1 < best.1 { end } else { best })
}

/// Where the parabola through three places is level; none if they are not three.
fn vertex(a: (f64, f64), b: (f64, f64), c: (f64, f64)) -> Option<f64> {
    let (r, q) = ((a.0 - b.0) * (a.1 - c.1), (a.0 - c.0) * (a.1 - b.1));
    let vertex = a.0 - ((a.0 - c.0) * q - (a.0 - b.0) * r) / (2.0 * (q - r));
    vertex.is_finite().then_some(vertex)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minima_within_a_bracket_and_at_its_ends() {
        let (x, _) = minimum_within(-1.0, 2.0, |x| (x - 0.3).powi(2));
        assert!((x - 0.3).abs() < 2e-5);
        assert_eq!(minimum_within(-1.0, 2.0, |x| x).0, -1.0);
        // A kink, where no parabola helps.
        let (x, _) = minimum_within(-1.0, 2.0, |x: f64| (x - 0.3).abs());
        assert!((x - 0.3).abs() < 2e-5);
    }

    #[test]
    fn parabolas_need_few_values() {
        let count = std::cell::Cell::new(0);
        let (x, _) = minimum_within(-0.2, 0.14, |x: f64| {
            count.set(count.get() + 1);
            (x - 0.03).cosh()
        });
        assert!((x - 0.03).abs() < 2e-5);
        assert!(count.get() <= 12, "{} values", count.get());
    }

    #[test]
    fn every_local_minimum_is_found_best_first() {
        let value = |x: f64| (x + 3.0).powi(2).min(0.5 + (x + 1.0).powi(2));
        let landscape = Landscape::survey(value);
        let places: Vec<f64> = landscape.minima.iter().map(|m| m.0).collect();
        assert_eq!(places.len(), 2, "{places:?}");
        assert!((places[0] + 3.0).abs() < 1e-4 && (places[1] + 1.0).abs() < 1e-4);
        assert_eq!(Landscape::survey(|_| 1.0).minima.len(), 1);
    }
}
