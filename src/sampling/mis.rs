//! Multiple importance sampling.

/// Weight of a sample drawn with density `pdf` when another technique would have drawn it with
/// `other` (Veach 1997, power heuristic, β = 2); both per steradian.
///
/// Formed from the ratio, so that densities near f32's limits (a lit texel of 1e-8 sr under a lobe
/// of alpha 1e-3) do not overflow when squared.
#[inline]
pub fn power_heuristic(pdf: f32, other: f32) -> f32 {
    if pdf <= 0.0 {
        return 0.0;
    }
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn weights_of_both_techniques_sum_to_one(a in 1e-12f32..1e30, b in 1e-12f32..1e30) {
            prop_assert!((power_heuristic(a, b) + power_heuristic(b, a) - 1.0).abs() < 1e-5);
        }
    }
}
