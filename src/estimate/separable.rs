//! The inner problem of variable projection: albedos for a given lobe.
//!
//! ```text
//! min over rho_d ≥ 0 (RGB), rho_s ≥ 0 of  Σ_c Σ_t w_c(t) (T_c − rho_d,c D_c − rho_s S_c)²
//! ```
//!
//! Sums over time are kept as Gram entries; the problem then has four unknowns at most and is
//! solved exactly by trying its few active sets.

use super::SpecularColour;

/// Weighted sums over the samples of one channel.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Gram {
    /// `Σ w D²`.
    pub(super) dd: f64,
    /// `Σ w D S`.
    pub(super) ds: f64,
    /// `Σ w S²`.
    pub(super) ss: f64,
    /// `Σ w D T`.
    pub(super) dt: f64,
    /// `Σ w S T`.
    pub(super) st: f64,
    /// `Σ w T²`.
    pub(super) tt: f64,
}

impl Gram {
    /// Adds a sample of weight `w`.
    #[inline]
    pub(super) fn add(&mut self, w: f64, diffuse: f64, specular: f64, observed: f64) {
        self.dd += w * diffuse * diffuse;
        self.ds += w * diffuse * specular;
        self.ss += w * specular * specular;
        self.dt += w * diffuse * observed;
        self.st += w * specular * observed;
        self.tt += w * observed * observed;
    }

    /// The best diffuse albedo beside a given specular one.
    fn diffuse_beside(&self, rho_s: f64) -> f64 {
        if self.dd > 0.0 {
            ((self.dt - self.ds * rho_s) / self.dd).max(0.0)
        } else {
            0.0
        }
    }

    /// The weighted squared residual.
    fn objective(&self, rho_d: f64, rho_s: f64) -> f64 {
        let fitted = rho_d * (rho_d * self.dd + 2.0 * rho_s * self.ds - 2.0 * self.dt)
            + rho_s * (rho_s * self.ss - 2.0 * self.st);
        (self.tt + fitted).max(0.0)
    }
}

/// Albedos and their weighted squared residual.
#[derive(Clone, Copy, Debug)]
pub(super) struct Albedos {
    pub(super) rho_d: [f64; 3],
    pub(super) rho_s: [f64; 3],
    pub(super) objective: f64,
}

/// The non-negative albedos of least weighted residual.
pub(super) fn solve(grams: &[Gram; 3], colour: SpecularColour) -> Albedos {
    match colour {
        SpecularColour::Neutral => {
            let rho_s = best_specular(grams);
            assemble(grams, [rho_s; 3])
        }
        SpecularColour::Rgb => assemble(grams, grams.map(|gram| best_specular(&[gram]))),
    }
}

fn assemble(grams: &[Gram; 3], rho_s: [f64; 3]) -> Albedos {
    let rho_d = [0, 1, 2].map(|c| grams[c].diffuse_beside(rho_s[c]));
    let objective = (0..3).map(|c| grams[c].objective(rho_d[c], rho_s[c])).sum();
    Albedos {
        rho_d,
        rho_s,
        objective,
    }
}

/// The best specular albedo shared by some channels.
///
/// With each `rho_d,c` at its best, the objective is convex and piecewise quadratic in `rho_s`; a
/// piece is a set of channels whose diffuse albedo is positive. The minimum over `rho_s ≥ 0` is at
/// the vertex of one piece or at 0.
fn best_specular(grams: &[Gram]) -> f64 {
    let value = |rho_s: f64| {
        grams
            .iter()
            .map(|g| g.objective(g.diffuse_beside(rho_s), rho_s))
            .sum::<f64>()
    };
    let mut best = (value(0.0), 0.0);
    for active in 0..1u32 << grams.len() {
        let (mut numerator, mut denominator, mut scale) = (0.0, 0.0, 0.0);
        for (c, gram) in grams.iter().enumerate() {
            let projected = if active >> c & 1 == 1 && gram.dd > 0.0 {
                gram.ds / gram.dd
            } else {
                0.0
            };
            numerator += gram.st - projected * gram.dt;
            denominator += gram.ss - projected * gram.ds;
            scale += gram.ss;
        }
        // Columns that are collinear to rounding say nothing about rho_s.
        if denominator <= 1e-12 * scale || numerator <= 0.0 {
            continue;
        }
        let rho_s = numerator / denominator;
        let objective = value(rho_s);
        if objective < best.0 {
            best = (objective, rho_s);
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn grams(samples: &[(f64, f64, [f64; 3])]) -> [Gram; 3] {
        let mut grams = [Gram::default(); 3];
        for &(d, s, t) in samples {
            for c in 0..3 {
                grams[c].add(1.0, d, s, t[c]);
            }
        }
        grams
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
        for colour in [SpecularColour::Neutral, SpecularColour::Rgb] {
            let a = solve(&grams(&samples), colour);
            assert!((a.rho_s[1] - 2.35).abs() < 1e-9 && (a.rho_d[0] - 0.4).abs() < 1e-9);
            assert!(a.objective < 1e-9);
        }
    }

    #[test]
    fn collinear_columns_stay_finite() {
        let samples: Vec<_> = (1..5)
            .map(|i| (f64::from(i), 2.0 * f64::from(i), [1.0; 3]))
            .collect();
        let a = solve(&grams(&samples), SpecularColour::Neutral);
        assert!(a.rho_d.iter().chain(&a.rho_s).all(|r| r.is_finite()));
    }

    proptest! {
        #[test]
        fn no_other_albedo_is_better(
            samples in prop::collection::vec((0.0f64..2.0, 0.0f64..2.0, (-1.0f64..3.0, -1.0f64..3.0, -1.0f64..3.0)), 3..12),
            other in (0.0f64..3.0, 0.0f64..3.0, 0.0f64..3.0, 0.0f64..3.0),
        ) {
            let samples: Vec<_> = samples.into_iter().map(|(d, s, t)| (d, s, [t.0, t.1, t.2])).collect();
            let grams = grams(&samples);
            let best = solve(&grams, SpecularColour::Neutral);
            let rho_d = [other.0, other.1, other.2];
            let value: f64 = (0..3).map(|c| grams[c].objective(rho_d[c], other.3)).sum();
            prop_assert!(best.objective <= value + 1e-9);
            prop_assert!(best.rho_d.iter().chain(&best.rho_s).all(|&r| r >= 0.0));
        }
    }
}
