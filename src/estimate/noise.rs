//! How residuals are weighed: noise that the channels share, and outliers.
//!
//! Sensor noise is independent between channels. Most else is not: the noise of a path tracer
//! (correlated 0.93 to 0.98 between Mitsuba's R, G and B), a misplaced silhouette, a shadow's border
//! all scale a pixel's light as a whole and leave its colour alone. Where the noise is not known, its
//! covariance between the channels is measured from the residuals of a first fit. And residuals have
//! tails, so they are taken as Student's t (Lange, Little and Taylor 1989): an observation at a
//! squared distance `q` weighs `(ν + k)/(ν + q/s)`, with k its channels and s the point's own scale.

use glam::{DMat3, DVec3, Vec3};

use crate::traces::Observation;

/// Degrees of freedom of the tails.
pub(super) const NU: f64 = 4.0;

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
}

impl NoiseModel {
    /// Channels that are independent.
    pub(super) fn independent(is_known: bool) -> Self {
        Self::with_covariance(DMat3::IDENTITY, is_known)
    }

    /// The covariance of residuals (in standard deviations), robust against their tails.
    pub(super) fn of_residuals(residuals: &[Vec3]) -> Self {
        if residuals.len() < FEWEST_RESIDUALS {
            return Self::independent(false);
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
        }
    }

    /// The inverse covariance of an observation, and its number of usable channels.
    pub(super) fn precision(&self, observation: &Observation) -> (DMat3, u32) {
        let deviation = deviation(observation);
        let mut set = 0;
        let mut inverse = DVec3::ZERO;
        for c in 0..3 {
            if deviation[c].is_finite() && deviation[c] > 0.0 {
                set |= 1 << c;
                inverse[c] = 1.0 / f64::from(deviation[c]);
            }
        }
        let scale = DMat3::from_diagonal(inverse);
        (scale * self.precision[set] * scale, set.count_ones())
    }
}

/// Standard deviation of an observation, by channel; infinite where it is saturated.
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
            frame: 0,
            radiance: Vec3::ONE,
            variance,
            position: Vec3::ZERO,
            wo: Vec3::Z,
            normal: Vec3::Z,
            geometric_normal: Vec3::Z,
            normal_variance: 0.0,
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
        let noise = NoiseModel::of_residuals(&residuals);
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
        let noise = NoiseModel::of_residuals(&residuals);
        let (p, usable) = noise.precision(&observation(Vec3::new(1.0, f32::INFINITY, 1.0)));
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
        assert_eq!(noise.precision(&observation(Vec3::INFINITY)).1, 0);
    }

    #[test]
    fn no_residuals_no_covariance() {
        let (p, usable) = NoiseModel::of_residuals(&[]).precision(&observation(Vec3::splat(0.25)));
        assert_eq!((p, usable), (DMat3::IDENTITY * 4.0, 3));
        let (p, _) =
            NoiseModel::of_residuals(&[Vec3::ZERO; 100]).precision(&observation(Vec3::ONE));
        assert!(p.is_finite());
    }
}
