//! Structural similarity.
//!
//! ```text
//! SSIM = (2 μ_a μ_b + C1) (2 σ_ab + C2) / ((μ_a² + μ_b² + C1) (σ_a² + σ_b² + C2))
//! C1 = 0.01², C2 = 0.03², range 1; means over 11 × 11 Gaussian windows, σ = 1.5
//! ```
//!
//! (Wang et al. 2004, *Image quality assessment: from error visibility to structural similarity*).
//! Windows centred at least 5 pixels from the border count, as in scikit-image. With a mask the
//! window's weights are those of its compared pixels, renormalised; windows centred on them count.

use super::convolve::{Edge, Plane, gaussian};

const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;
const RADIUS: usize = 5;

/// Sum of SSIM over windows, and how many there are.
pub(super) fn ssim_sum(a: &Plane, b: &Plane, compared: &[bool]) -> (f64, u64) {
    let kernel = gaussian(1.5, RADIUS);
    let mean = |value: &dyn Fn(usize) -> f64| {
        let values = (0..compared.len()).map(|i| if compared[i] { value(i) } else { 0.0 });
        Plane {
            values: values.collect(),
            ..*a
        }
        .convolve(&kernel, &kernel, Edge::Zero)
        .values
    };
    let weight = mean(&|_| 1.0);
    let (mu_a, mu_b) = (mean(&|i| a.values[i]), mean(&|i| b.values[i]));
    let aa = mean(&|i| a.values[i] * a.values[i]);
    let bb = mean(&|i| b.values[i] * b.values[i]);
    let ab = mean(&|i| a.values[i] * b.values[i]);

    let rows = RADIUS..a.height.saturating_sub(RADIUS);
    let columns = RADIUS..a.width.saturating_sub(RADIUS);
    let centres = rows.flat_map(|y| columns.clone().map(move |x| y * a.width + x));
    centres
        .filter(|&i| compared[i])
        .fold((0.0, 0), |(sum, count), i| {
            let w = weight[i];
            let (mu_a, mu_b) = (mu_a[i] / w, mu_b[i] / w);
            let var_a = aa[i] / w - mu_a * mu_a;
            let var_b = bb[i] / w - mu_b * mu_b;
            let cov = ab[i] / w - mu_a * mu_b;
            let ssim = (2.0 * mu_a * mu_b + C1) * (2.0 * cov + C2)
                / ((mu_a * mu_a + mu_b * mu_b + C1) * (var_a + var_b + C2));
            (sum + ssim, count + 1)
        })
}
