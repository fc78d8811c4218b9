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
        golden_section(
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
    golden_section(low, high, value)
}

/// The `ln alpha` of the smallest value: the best of the grid, then golden sections about it.
pub(super) fn minimise_over_alpha(value: impl Fn(f32) -> f64) -> f32 {
    let value = |x: f64| value(x as f32);
    let places = (0..ROUGHNESSES).map(|k| f64::from(roughness(k).ln()));
    let grid: Vec<(f64, f64)> = places.map(|x| (x, value(x))).collect();
    let best = (0..ROUGHNESSES)
        .min_by(|&a, &b| grid[a].1.total_cmp(&grid[b].1))
        .unwrap_or(0);
    descend(&grid, best, value).0 as f32
}

/// Place and value of the smallest value in a bracket, by golden sections. The ends count.
fn golden_section(mut low: f64, mut high: f64, value: impl Fn(f64) -> f64) -> (f64, f64) {
    const RATIO: f64 = 0.618_033_988_749_895;
    let ends = [(low, value(low)), (high, value(high))];
    let (mut a, mut b) = (high - RATIO * (high - low), low + RATIO * (high - low));
    let (mut at_a, mut at_b) = (value(a), value(b));
    while high - low > TOLERANCE {
        if at_a < at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - RATIO * (high - low);
            at_a = value(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + RATIO * (high - low);
            at_b = value(b);
        }
    }
    let inside = if at_a < at_b { (a, at_a) } else { (b, at_b) };
    ends.into_iter()
        .fold(inside, |best, end| if end.1 < best.1 { end } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_section_finds_inner_and_end_minima() {
        let (x, _) = golden_section(-1.0, 2.0, |x| (x - 0.3).powi(2));
        assert!((x - 0.3).abs() < 2e-5);
        assert_eq!(golden_section(-1.0, 2.0, |x| x).0, -1.0);
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
