//! What a linear sensor makes of radiance: shot noise, read noise, saturation, quantisation.
//!
//! ```text
//! electrons = radiance · exposure · full_well
//! stored    = round( clamp(Poisson(electrons) + N(0, read²), 0, full_well) / full_well · (2^bits − 1) )
//! image     = stored / ((2^bits − 1) · exposure)
//! ```

use rand_distr::{Distribution, Normal, Poisson};
use rand_pcg::Pcg64Mcg;

use crate::image::RgbImage;
use crate::scene::Sensor;

/// Exposes a radiance image, in place.
///
/// Every pixel has its own random stream, keyed by seed, frame and pixel. `exposure` multiplies
/// the sensor's own.
pub fn expose(image: &mut RgbImage, sensor: &Sensor, exposure: f64, seed: u64, frame: u32) {
    let exposure = sensor.exposure * exposure;
    let steps = ((1u64 << sensor.bits) - 1) as f64;
    for (i, pixel) in image.pixels.iter_mut().enumerate() {
        let state = u128::from(seed) << 64 | u128::from(frame) << 32 | i as u128;
        let mut random =
            Pcg64Mcg::new(state.wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c835) | 1);
        for channel in pixel {
            let mean = f64::from(*channel) * exposure * sensor.full_well_electrons;
            let shot = if mean > 0.0 {
                // Beyond 2^40 electrons, or if the mean is not representable, noise is nil.
                Poisson::new(mean.min(1e12)).map_or(mean, |p| p.sample(&mut random))
            } else {
                0.0
            };
            let read = Normal::new(0.0, sensor.read_noise_electrons)
                .map_or(0.0, |n| n.sample(&mut random));
            let filled = ((shot + read) / sensor.full_well_electrons).clamp(0.0, 1.0);
            *channel = ((filled * steps).round() / (steps * exposure)) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SENSOR: Sensor = Sensor {
        full_well_electrons: 30_000.0,
        read_noise_electrons: 5.0,
        bits: 14,
        exposure: 0.5,
    };

    fn exposed(radiance: f32) -> Vec<f64> {
        let mut image = RgbImage {
            width: 100,
            height: 100,
            pixels: vec![[radiance; 3]; 10_000],
        };
        expose(&mut image, &SENSOR, 1.0, 3, 7);
        image
            .pixels
            .iter()
            .flatten()
            .map(|&v| f64::from(v))
            .collect()
    }

    #[test]
    fn noise_has_the_variance_of_its_model() {
        for radiance in [0.01f32, 0.2, 1.0] {
            let values = exposed(radiance);
            let n = values.len() as f64;
            let mean = values.iter().sum::<f64>() / n;
            let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
            let expected = SENSOR.variance(f64::from(radiance), 1.0);
            assert!((mean - f64::from(radiance)).abs() < 4.0 * (expected / n).sqrt());
            assert!(
                (variance / expected - 1.0).abs() < 4.0 * (2.0 / n).sqrt(),
                "{variance} {expected}"
            );
        }
    }

    #[test]
    fn bright_pixels_saturate_at_one_over_exposure() {
        assert!(exposed(10.0).iter().all(|&v| (v - 2.0).abs() < 1e-6));
    }
}
