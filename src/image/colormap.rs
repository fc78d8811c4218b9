//! Scalars as colours, for parameter maps.

/// Coefficients of t⁰ to t⁶, RGB. Least-squares fit to the 256 entries of viridis (CC0, matplotlib):
/// off by at most 4.3 of 255. Degree 5 is off by 11, degree 7 by 2.6.
const VIRIDIS: [[f64; 3]; 7] = [
    [0.274_455, 0.005_768, 0.332_664],
    [0.107_708, 1.396_470, 1.386_771],
    [-0.327_241, 0.214_814, 0.091_977],
    [-4.599_932, -5.758_238, -19.291_809],
    [6.203_736, 14.153_965, 56.656_300],
    [4.751_787, -13.749_439, -65.320_968],
    [-5.432_077, 4.641_571, 26.272_108],
];

/// Colour of `t` in [0, 1], clamped: 8-bit sRGB, dark blue over green to yellow, lightness rising evenly.
/// NaN is grey, which the map does not hold.
pub fn viridis(t: f64) -> [u8; 3] {
    if t.is_nan() {
        return [128; 3];
    }
    let t = t.clamp(0.0, 1.0);
    std::array::from_fn(|c| {
        let value = VIRIDIS
            .iter()
            .rev()
            .fold(0.0, |sum, coefficients| sum * t + coefficients[c]);
        (255.0 * value).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{luminance, srgb_decode};

    #[test]
    fn viridis_meets_the_published_ends_and_middle() {
        // matplotlib 3.10: viridis(0), viridis(0.5), viridis(1).
        for (t, expected) in [
            (0.0, [68, 1, 84]),
            (0.5, [33, 145, 140]),
            (1.0, [253, 231, 37]),
        ] {
            let colour = viridis(t);
            for c in 0..3 {
                assert!(
                    colour[c].abs_diff(expected[c]) <= 5,
                    "{t}: {colour:?} {expected:?}"
                );
            }
        }
        assert_eq!(viridis(-1.0), viridis(0.0));
        assert_eq!(viridis(2.0), viridis(1.0));
    }

    #[test]
    fn viridis_rises_in_luminance() {
        let level = |i: u32| {
            luminance(viridis(f64::from(i) / 64.0).map(|b| srgb_decode(f64::from(b) / 255.0)))
        };
        assert!((0..64).all(|i| level(i) < level(i + 1)));
    }
}
