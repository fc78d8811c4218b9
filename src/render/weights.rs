//! A few hundred weights to draw from.

/// Weights: as many as a guide has places to look at.
pub(super) const PLACES: usize = 256;

/// Weights in groups, so that neither building nor searching is a long chain.
#[derive(Clone)]
pub(super) struct Weights {
    each: [f32; PLACES],
    groups: [f32; GROUPS],
    pub(super) sum: f32,
}

/// Groups of weights, and weights in a group.
const GROUPS: usize = 16;

impl Weights {
    pub(super) fn new(each: [f32; PLACES]) -> Self {
        let groups = std::array::from_fn(|g| sum_of(&each[g * GROUPS..(g + 1) * GROUPS]));
        let sum = groups.iter().sum();
        Self { each, groups, sum }
    }

    /// The weight that holds the quantile `u`, and where in it, in [0, 1).
    #[inline]
    pub(super) fn invert(&self, u: f32) -> (usize, f32) {
        let mut rest = u * self.sum;
        let mut group = 0;
        while group + 1 < GROUPS && rest >= self.groups[group] {
            rest -= self.groups[group];
            group += 1;
        }
        let mut k = group * GROUPS;
        let last = k + GROUPS - 1;
        while k < last && rest >= self.each[k] {
            rest -= self.each[k];
            k += 1;
        }
        // Rounding may carry the last quantiles past the last weight.
        while k > 0 && self.each[k] == 0.0 {
            k -= 1;
        }
        let width = self.each[k];
        let place = if width > 0.0 { rest / width } else { 0.5 };
        (k, place.clamp(0.0, 1.0 - f32::EPSILON / 2.0))
    }

    /// Probability of weight `k`.
    #[inline]
    pub(super) fn share(&self, k: usize) -> f32 {
        self.each[k] / self.sum
    }
}

/// Sum in eight lanes.
#[inline]
pub(super) fn sum_of(values: &[f32]) -> f32 {
    let mut lanes = [0.0; 8];
    for eight in values.chunks_exact(8) {
        for (lane, value) in lanes.iter_mut().zip(eight) {
            *lane += value;
        }
    }
    lanes.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_quantiles_never_reach_empty_weights() {
        for filled in 1..PLACES {
            let weight = |k: usize| {
                if k < filled {
                    0.1 + (k as f32 * 0.7).sin().abs()
                } else {
                    0.0
                }
            };
            let weights = Weights::new(std::array::from_fn(weight));
            for below in 1..64 {
                let u = 1.0 - below as f32 * f32::EPSILON / 2.0;
                assert!(weights.invert(u).0 < filled, "{filled} {below}");
            }
        }
    }

    #[test]
    fn weights_are_drawn_by_their_share() {
        let weights = Weights::new(std::array::from_fn(
            |k| if k % 3 == 0 { 0.0 } else { k as f32 },
        ));
        let n = 100_000;
        let mut counts = [0.0f32; PLACES];
        for i in 0..n {
            let (k, place) = weights.invert((i as f32 + 0.5) / n as f32);
            assert!((0.0..1.0).contains(&place));
            counts[k] += 1.0 / n as f32;
        }
        for (k, count) in counts.into_iter().enumerate() {
            assert!((count - weights.share(k)).abs() < 5e-5, "{k}");
        }
    }
}
