//! The probe between two conventions of rows.
//!
//! turnlight's row `i` of `H` is centred at `v = (i + ½)/H`, bilinear between centres and constant
//! beyond the first and last. Mitsuba's row `j` of `H'` lies at `v = j/(H' − 1)`, the first and last
//! on the poles. With `H' = 2H + 1` its odd rows fall on turnlight's centres and its even rows
//! halfway between, where the bilinear function is their mean: both see the same function.

use crate::image::RgbImage;

/// Mitsuba wants two columns at least.
const FEWEST_COLUMNS: usize = 2;

/// The probe with `2H + 1` rows, for Mitsuba's `envmap`.
pub(super) fn with_rows_on_poles(probe: &RgbImage) -> RgbImage {
    // A map of one column is constant in longitude; any number of equal columns is the same map.
    let width = probe.width.max(FEWEST_COLUMNS);
    let height = 2 * probe.height + 1;
    let last = probe.height.saturating_sub(1);
    let texel = |row: usize, column: usize| probe.pixels[row * probe.width + column % probe.width];
    let pixel = |j: usize, column: usize| {
        let (above, below) = (j.saturating_sub(1) / 2, (j / 2).min(last));
        let (a, b) = (texel(above, column), texel(below, column));
        // Halved first: the sum of two large texels may overflow.
        std::array::from_fn(|c| {
            if above == below {
                a[c]
            } else {
                0.5 * a[c] + 0.5 * b[c]
            }
        })
    };
    let pixels = (0..height)
        .flat_map(|j| (0..width).map(move |i| (j, i)))
        .map(|(j, i)| pixel(j, i))
        .collect();
    RgbImage {
        width,
        height,
        pixels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odd_rows_are_the_originals_and_even_rows_their_midpoints() {
        let rows = [1.0f32, 5.0, 2.0];
        let probe = RgbImage {
            width: 1,
            height: 3,
            pixels: rows.iter().map(|&x| [x; 3]).collect(),
        };
        let out = with_rows_on_poles(&probe);
        assert_eq!((out.width, out.height), (2, 7));
        let column: Vec<f32> = (0..7).map(|j| out.pixels[2 * j][0]).collect();
        assert_eq!(column, [1.0, 1.0, 3.0, 5.0, 3.5, 2.0, 2.0]);
    }

    #[test]
    fn one_texel_lights_every_direction() {
        let out = with_rows_on_poles(&RgbImage {
            width: 1,
            height: 1,
            pixels: vec![[f32::MAX, 2.0, 3.0]],
        });
        assert_eq!((out.width, out.height), (2, 3));
        assert!(
            out.pixels
                .iter()
                .all(|&pixel| pixel == [f32::MAX, 2.0, 3.0])
        );
    }
}
