//! Slopes of Beckmann's microfacets as seen from a direction, at unit roughness
//! (Heitz and d'Eon 2014, *Importance Sampling Microfacet-Based BSDFs using the Distribution of
//! Visible Normals*; inversion after Jakob 2014, *An Improved Visible Normal Sampling Routine for
//! the Beckmann Distribution*).

use std::f64::consts::PI;

use glam::Vec2;

/// A visible slope for a view at `tan θ`, in the frame whose x axis is the view's azimuth.
///
/// Asks for the tangent because f32 cosines of the small angles that stretching by a small alpha
/// leaves are all 1.
///
/// The marginal CDF of the slope `x = erf⁻¹(b)` is
/// `C(b) ∝ 1 + b + (tan θ/√π) exp(−x²)`, inverted by Newton steps inside a shrinking bracket, in
/// double precision: at grazing the CDF is so steep that f32 shows in χ² tests.
pub(super) fn sample_beckmann(tan_theta: f32, u: Vec2) -> Vec2 {
    let tan = f64::from(tan_theta).clamp(0.0, 1e9);
    let (u, v) = (
        f64::from(u.x).clamp(1e-9, 1.0 - 1e-9),
        f64::from(u.y).clamp(1e-9, 1.0 - 1e-9),
    );

    // Bracket b in (−1, erf(cot θ)]: steeper slopes face away.
    let cot = 1.0 / tan;
    let weight = tan / PI.sqrt();
    let (mut low, mut high) = (-1.0, libm::erf(cot));
    let total = 1.0 + high + weight * (-cot * cot).exp();

    // Jakob's fitted start, then Newton.
    let theta = tan.atan();
    let fit = 1.0 + theta * (-0.876 + theta * (0.4265 - 0.0594 * theta));
    let mut b = high - (1.0 + high) * (1.0 - u).powf(fit);
    for _ in 0..20 {
        if !(b > low && b < high) {
            b = 0.5 * (low + high);
        }
        let x = erf_inverse(b);
        let excess = (1.0 + b + weight * (-x * x).exp()) / total - u;
        if excess.abs() < 1e-9 {
            break;
        }
        if excess > 0.0 {
            high = b;
        } else {
            low = b;
        }
        b -= excess * total / (1.0 - x * tan);
    }
    Vec2::new(erf_inverse(b) as f32, erf_inverse(2.0 * v - 1.0) as f32)
}

/// Inverse error function: Giles's single-precision polynomial (*Approximating the erfinv
/// function*, GPU Computing Gems 2, 2011) refined by one Newton step.
fn erf_inverse(y: f64) -> f64 {
    let y = y.clamp(-1.0 + 1e-14, 1.0 - 1e-14);
    let w = -((1.0 - y) * (1.0 + y)).ln();
    let horner = |z: f64, c: [f64; 9]| c.iter().fold(0.0, |sum, c| sum * z + c);
    let x = y * if w < 5.0 {
        horner(
            w - 2.5,
            [
                2.810_226_36e-08,
                3.432_739_39e-07,
                -3.523_387_7e-06,
                -4.391_506_54e-06,
                0.000_218_580_87,
                -0.001_253_725_03,
                -0.004_177_681_640,
                0.246_640_727,
                1.501_409_41,
            ],
        )
    } else {
        horner(
            w.sqrt() - 3.0,
            [
                -0.000_200_214_257,
                0.000_100_950_558,
                0.001_349_343_22,
                -0.003_673_428_44,
                0.005_739_507_73,
                -0.007_622_461_3,
                0.009_438_870_47,
                1.001_674_06,
                2.832_976_82,
            ],
        )
    };
    let error = libm::erf(x) - y;
    x - error / (2.0 / PI.sqrt() * (-x * x).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn erf_inverse_inverts() {
        for i in -999..=999 {
            let y = f64::from(i) / 1000.0;
            assert!((libm::erf(erf_inverse(y)) - y).abs() < 1e-12, "y = {y}");
        }
    }

    #[test]
    fn slope_marginal_is_inverted_to_high_accuracy() {
        for tan in [0.0, 1e-5, 1e-3, 0.045, 0.5, 1.7, 10.0, 1000.0] {
            let weight = tan / PI.sqrt();
            let high = libm::erf(1.0 / tan);
            let total = 1.0 + high + weight * (-1.0 / (tan * tan)).exp();
            for i in 1..200 {
                let u = i as f32 / 200.0;
                let x = f64::from(sample_beckmann(tan as f32, Vec2::new(u, 0.5)).x);
                let cdf = (1.0 + libm::erf(x) + weight * (-x * x).exp()) / total;
                assert!(
                    (cdf - f64::from(u)).abs() < 1e-6,
                    "tan {tan} u {u} cdf {cdf}"
                );
            }
        }
    }
}
