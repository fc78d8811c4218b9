//! How residuals are weighed: noise that the channels share, and outliers.
//!
//! Sensor noise is independent between channels. Most else is not: the noise of a path tracer
//! (correlated 0.93 to 0.98 between Mitsuba's R, G and B), a misplaced silhouette, a shadow's border
//! all scale a pixel's light as a whole and leave its colour alone. Where the noise is not known, its
//! covariance between the channels is measured from the residuals of a first fit. And residuals have
//! tails, so they are taken as Student's t (Lange, Little and Taylor 1989): an observation at a
//! squared distance `q` weighs `(ν + k)/(ν + q/s)`, with k its channels and s the point's own scale.
//!
//! Where a sensor's model gives the noise, what is left to learn is how far the residuals have tails at
//! all: `ν` is the one that makes them most probable. Under pure sensor noise it is infinite, every
//! weight is 1, and the fit is the maximum-likelihood one, at the Cramér-Rao bound.

use glam::{BVec3, DMat3, DVec3, Vec3};

use crate::traces::Observation;

/// Degrees of freedom of the tails, where they are not measured.
const NU: f64 = 4.0;

/// Degrees of freedom that a measurement chooses from. Beyond 50 Student's law is the normal's: its
/// weights differ from 1 by a few per cent.
const MEASURED_NU: [f64; 6] = [4.0, 6.0, 10.0, 20.0, 50.0, f64::INFINITY];

/// Relative error of the forward model per radian² of the normal's variance over a pixel: the lobe of
/// a curved patch is only to second order a wider lobe. Measured on Suzanne: residuals double from
/// 1 % at 1e-3 radian².
const FOOTPRINT_ERROR: f32 = 10.0;

/// Fewer residuals than this say nothing of a covariance.
const FEWEST_RESIDUALS: usize = 30;

/// Rounds of the covariance's own weights.
const ROUNDS: usize = 20;

/// Covariance of the channels' residuals in units of their assumed standard deviations.
#[derive(Clone, Debug)]
pub(super) struct NoiseModel {
    /// Inverse covariance, for each set of usable channels (bit c: channel c).
    precision: [DMat3; 8],
    /// Whether variances are those of a sensor: the scale of a point's residuals is then at least 1.
    pub(super) is_known: bool,
    /// Degrees of freedom of the residuals' tails; infinite if they have none.
    nu: f64,
}

impl NoiseModel {
    /// Channels that are independent.
    pub(super) fn independent(is_known: bool) -> Self {
        Self::with_covariance(DMat3::IDENTITY, is_known)
    }

    /// What residuals (in standard deviations) say: their covariance, robust against their tails; of a
    /// known sensor, only the tails.
    pub(super) fn of_residuals(residuals: &[Vec3], is_known: bool) -> Self {
        if residuals.len() < FEWEST_RESIDUALS {
            return Self::independent(is_known);
        }
        if is_known {
            return Self {
                nu: measured_nu(residuals),
                ..Self::independent(true)
            };
        }
        let total: f64 = residuals
            .iter()
            .map(|r| f64::from(r.length_squared()))
            .sum();
        let mean_square = total / (3 * residuals.len()) as f64;
        if mean_square.is_nan() || mean_square <= 0.0 {
            return Self::independent(false);
        }
        let mut covariance = DMat3::IDENTITY * mean_square;
        for _ in 0..ROUNDS {
            let inverse = covariance.inverse();
            let mut sum = DMat3::ZERO;
            for r in residuals {
                let r = r.as_dvec3();
                let weight = (NU + 3.0) / (NU + r.dot(inverse * r));
                sum += DMat3::from_cols(r * r.x, r * r.y, r * r.z) * weight;
            }
            covariance = sum * (1.0 / residuals.len() as f64);
            // Stays invertible where channels are equal, as in grey images.
            let trace = covariance.x_axis.x + covariance.y_axis.y + covariance.z_axis.z;
            covariance += DMat3::IDENTITY * (1e-3 * trace);
        }
        Self::with_covariance(covariance, false)
    }

    fn with_covariance(covariance: DMat3, is_known: bool) -> Self {
        let precision = std::array::from_fn(|set| {
            let usable = |c: usize| set >> c & 1 == 1;
            // The rows and columns of unusable channels are replaced by the identity's, and cut out
            // of the inverse.
            let mut reduced = DMat3::IDENTITY;
            for c in (0..3).filter(|&c| usable(c)) {
                for d in (0..3).filter(|&d| usable(d)) {
                    reduced.col_mut(d)[c] = covariance.col(d)[c];
                }
            }
            let mut inverse = reduced.inverse();
            for c in (0..3).filter(|&c| !usable(c)) {
                inverse.col_mut(c)[c] = 0.0;
            }
            inverse
        });
        Self {
            precision,
            is_known,
            nu: NU,
        }
    }

    /// Whether residuals have no tails: all weights are 1.
    pub(super) fn is_normal(&self) -> bool {
        self.nu.is_infinite()
    }

    /// Weight of an observation of `k` channels at squared distance `q` in units of the scale.
    pub(super) fn weight(&self, q: f64, k: u32) -> f64 {
        if self.is_normal() {
            1.0
        } else {
            (self.nu + f64::from(k)) / (self.nu + q)
        }
    }

    /// `−2 ln` of its likelihood, up to a constant.
    pub(super) fn deviance(&self, q: f64, k: u32) -> f64 {
        student_deviance(self.nu, q, f64::from(k))
    }

    /// Variance of an estimate over that of weighted least squares with these weights: Student's
    /// information is `(ν + k)/(ν + k + 2)` of the normal's, with k = 3.
    pub(super) fn spread(&self) -> f64 {
        if self.is_normal() {
            1.0
        } else {
            (self.nu + 5.0) / (self.nu + 3.0)
        }
    }

    /// The inverse covariance of an observation, and its number of usable channels. Of the saturated
    /// ones only those in `bounding` count.
    pub(super) fn precision(&self, observation: &Observation, bounding: BVec3) -> (DMat3, u32) {
        let deviation = deviation(observation);
        let mut set = 0;
        let mut inverse = DVec3::ZERO;
        for c in 0..3 {
            let counts = !observation.saturated.test(c) || bounding.test(c);
            if counts && deviation[c].is_finite() && deviation[c] > 0.0 {
                set |= 1 << c;
                inverse[c] = 1.0 / f64::from(deviation[c]);
            }
        }
        let scale = DMat3::from_diagonal(inverse);
        (scale * self.precision[set] * scale, set.count_ones())
    }
}

/// The degrees of freedom that make residuals of unit covariance, up to a scale, most probable.
fn measured_nu(residuals: &[Vec3]) -> f64 {
    let squares: Vec<f64> = residuals
        .iter()
        .map(|r| r.as_dvec3().length_squared())
        .collect();
    let count = squares.len() as f64;
    let deviance = |nu: f64| {
        let mut scale = squares.iter().sum::<f64>() / (3.0 * count);
        if nu.is_finite() {
            for _ in 0..ROUNDS {
                let weighed = squares.iter().map(|q| q * (nu + 3.0) / (nu + q / scale));
                scale = (weighed.sum::<f64>() / (3.0 * count)).max(f64::MIN_POSITIVE);
            }
        }
        let terms = squares
            .iter()
            .map(|q| student_deviance(nu, q / scale.max(f64::MIN_POSITIVE), 3.0));
        terms.sum::<f64>() + count * (3.0 * scale.max(f64::MIN_POSITIVE).ln() + ln_norm(nu))
    };
    let mut best = (f64::INFINITY, NU);
    for nu in MEASURED_NU {
        let value = deviance(nu);
        if value < best.0 {
            best = (value, nu);
        }
    }
    best.1
}

/// `−2 ln` of Student's density in k dimensions at squared distance `q`, without its norm.
fn student_deviance(nu: f64, q: f64, k: f64) -> f64 {
    if nu.is_infinite() {
        q
    } else {
        (nu + k) * (q / nu).ln_1p()
    }
}

/// `−2 ln` of the norm of Student's density in three dimensions.
fn ln_norm(nu: f64) -> f64 {
    if nu.is_infinite() {
        return 3.0 * std::f64::consts::TAU.ln();
    }
    let gammas = libm::lgamma(0.5 * (nu + 3.0)) - libm::lgamma(0.5 * nu);
    3.0 * (nu * std::f64::consts::PI).ln() - 2.0 * gammas
}

/// Standard deviation of an observation, by channel; infinite where it tells nothing.
pub(super) fn deviation(observation: &Observation) -> Vec3 {
    let model = FOOTPRINT_ERROR * observation.normal_variance * observation.radiance;
    let variance = observation.variance + model * model;
    Vec3::new(variance.x.sqrt(), variance.y.sqrt(), variance.z.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::SobolPath;

    fn observation(variance: Vec3) -> Observation {
        Observation {
            variance,
            ..Observation::face_on(0)
        }
    }

    /// Normal deviates by Box and Muller.
    fn gaussian(u: f32, v: f32) -> f32 {
        (-2.0 * (1.0 - u).ln()).sqrt() * (std::f32::consts::TAU * v).cos()
    }

    #[test]
    fn the_covariance_is_measured_through_outliers() {
        // A common part of variance 4 and own parts of variance 1; one in twenty is an outlier.
        let residuals: Vec<Vec3> = (0..4000)
            .map(|i| {
                let [a, b, c, d] = SobolPath::new(3, 0, 0, i).next_4d();
                let [e, f, g, h] = SobolPath::new(4, 0, 0, i).next_4d();
                let common = 2.0 * gaussian(a, b);
                let r =
                    Vec3::splat(common) + Vec3::new(gaussian(c, d), gaussian(e, f), gaussian(g, h));
                if i % 20 == 0 { 30.0 * r } else { r }
            })
            .collect();
        let noise = NoiseModel::of_residuals(&residuals, false);
        let covariance = noise.precision[7].inverse();
        let correlation = covariance.y_axis.x / (covariance.x_axis.x * covariance.y_axis.y).sqrt();
        assert!((correlation - 0.8).abs() < 0.03, "{correlation}");
    }

    #[test]
    fn saturated_channels_have_no_part() {
        let residuals: Vec<Vec3> = (0..100)
            .map(|i| {
                Vec3::new(
                    (i as f32).sin(),
                    (i as f32 * 1.1).sin(),
                    (i as f32 * 0.7).cos(),
                )
            })
            .collect();
        let noise = NoiseModel::of_residuals(&residuals, false);
        let saturated = Observation {
            saturated: BVec3::new(false, true, false),
            ..observation(Vec3::ONE)
        };
        let (_, usable) = noise.precision(&saturated, BVec3::TRUE);
        assert_eq!(usable, 3, "as a bound it counts");
        let (p, usable) = noise.precision(&saturated, BVec3::FALSE);
        assert_eq!(usable, 2);
        assert_eq!(p.y_axis, DVec3::ZERO);
        assert_eq!((p.x_axis.y, p.z_axis.y), (0.0, 0.0));
        let covariance = noise.precision[7].inverse();
        let (a, b, c) = (
            covariance.x_axis.x,
            covariance.z_axis.x,
            covariance.z_axis.z,
        );
        assert!((p.x_axis.x - c / (a * c - b * b)).abs() < 1e-9 * p.x_axis.x);
        let nothing = observation(Vec3::INFINITY);
        assert_eq!(noise.precision(&nothing, BVec3::FALSE).1, 0);
    }

    #[test]
    fn no_residuals_no_covariance() {
        let of = |residuals: &[Vec3], variance| {
            let noise = NoiseModel::of_residuals(residuals, false);
            noise.precision(&observation(Vec3::splat(variance)), BVec3::FALSE)
        };
        assert_eq!(of(&[], 0.25), (DMat3::IDENTITY * 4.0, 3));
        assert!(of(&[Vec3::ZERO; 100], 1.0).0.is_finite());
        let still = NoiseModel::of_residuals(&[Vec3::ZERO; 100], true);
        assert!(still.weight(1.0, 3).is_finite());
    }

    #[test]
    fn pure_sensor_noise_has_no_tails_and_outliers_have() {
        let residuals = |outliers: bool| -> Vec<Vec3> {
            (0..4000)
                .map(|i| {
                    let [a, b, c, d] = SobolPath::new(3, 0, 0, i).next_4d();
                    let [e, f, ..] = SobolPath::new(4, 0, 0, i).next_4d();
                    let r = Vec3::new(gaussian(a, b), gaussian(c, d), gaussian(e, f));
                    if outliers && i % 20 == 0 { 30.0 * r } else { r }
                })
                .collect()
        };
        assert!(NoiseModel::of_residuals(&residuals(false), true).is_normal());
        assert_eq!(NoiseModel::of_residuals(&residuals(true), true).nu, 4.0);
    }
}
