//! Laws of the forecast.

use glam::Vec3;

use super::forecast::*;
use crate::image::RgbImage;
use crate::probe::{Environment, LightPyramid};

fn plan() -> CapturePlan {
    CapturePlan {
        wo: direction(20.0, 0.0),
        frames: 72,
        noise: 0.01,
        rho_d: 0.3,
        rho_s: 2.35,
        eta: 1.3,
    }
}

fn light(value: impl Fn(usize, usize) -> f32) -> LightPyramid {
    let image = RgbImage::from_fn(256, 128, |x, y| [value(x, y); 3]);
    LightPyramid::new(&Environment::new(image, 0.0).unwrap().0)
}

#[test]
fn uniform_light_tells_no_roughness() {
    let forecast = Forecaster::new(&light(|_, _| 1.0), plan()).forecast();
    for k in 0..FORECAST_ALPHAS.len() {
        println!(
            "{k}: median {:.3}, unknown {:.2}",
            forecast.median(k),
            forecast.unknown(k)
        );
        assert!(forecast.median(k) > UNKNOWN, "{forecast:?}");
    }
}

#[test]
fn small_lamps_tell_it_and_noise_scales() {
    let lit = light(|x, y| {
        if (100..103).contains(&x) && (40..43).contains(&y) {
            2e3
        } else {
            1.0
        }
    });
    let low = Forecaster::new(&lit, plan()).forecast();
    let high = Forecaster::new(
        &lit,
        CapturePlan {
            noise: 0.02,
            ..plan()
        },
    )
    .forecast();
    let mut known = 0;
    for k in 0..FORECAST_ALPHAS.len() {
        for (a, b) in low.sigma[k].iter().zip(&high.sigma[k]) {
            if let (Some(a), Some(b)) = (a, b)
                && a.is_finite()
            {
                assert!((b / a - 2.0).abs() < 1e-6, "{a} {b}");
                known += usize::from(*a < 0.1);
            }
        }
    }
    assert!(known > 10, "{low:?}");
}

#[test]
fn a_lamp_on_a_grey_sky_is_asked_for_and_helps() {
    let grey = Forecaster::new(&light(|_, y| 1.0 + 0.3 * (1.0 - y as f32 / 64.0)), plan());
    let before = grey.forecast();
    let (lamp, after) = grey.best_lamp(2f32.to_radians(), 0.25);
    assert!((lamp.direction.length() - 1.0).abs() < 1e-5);
    for k in 0..FORECAST_ALPHAS.len() {
        println!("{k}: {:.3} {:.3}", before.median(k), after.median(k));
        assert!(after.median(k) < 0.5 * before.median(k), "{k}");
    }
}

#[test]
fn a_lamp_of_the_map_and_one_added_say_the_same() {
    // 3 × 3 texels of 1.4° about the direction of texel (101, 41), 2e3 bright.
    let plain = Forecaster::new(&light(|_, _| 1.0), plan());
    let lit = light(|x, y| {
        if (100..103).contains(&x) && (40..43).contains(&y) {
            2e3
        } else {
            1.0
        }
    });
    let whole: Vec3 = lit.roots().map(|i| lit.nodes()[i].flux).sum();
    let uv = glam::Vec2::new(101.5 / 256.0, 41.5 / 128.0);
    let lamp = Lamp {
        direction: crate::geometry::direction_from_latlong(uv),
        flux: whole - plain.flux,
        radius: 2.4f32.to_radians(),
    };
    let (a, b) = (
        Forecaster::new(&lit, plan()).forecast(),
        plain.with_lamp(&lamp),
    );
    // From alpha 0.1 on, where the lamp's shape no longer matters.
    for k in 1..FORECAST_ALPHAS.len() {
        let ratio = a.median(k) / b.median(k);
        assert!((0.8..1.25).contains(&ratio), "{k} {ratio}");
    }
}
