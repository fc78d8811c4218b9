//! Any light.

use super::*;

/// What a white plate under the sky of `probe` sends back, by brute force in double precision.
fn plate_under(probe: &RgbImage) -> f64 {
    let (environment, _) = turnlight::probe::Environment::new(probe.clone(), 0.0).unwrap();
    let light = environment.turned(glam::Mat3::IDENTITY);
    const STEPS: usize = 1500;
    let mut sum = 0.0;
    // Midpoints, equal in cos² and in longitude: each direction counts the same.
    for i in 0..STEPS {
        let cos = ((i as f64 + 0.5) / STEPS as f64).sqrt();
        let sin = (1.0 - cos * cos).sqrt();
        for j in 0..STEPS {
            let (y, x) = (std::f64::consts::TAU * (j as f64 + 0.5) / STEPS as f64).sin_cos();
            let wi = DVec3::new(sin * x, cos, sin * y).as_vec3();
            sum += f64::from(light.radiance(Vec3::ZERO, wi).y);
        }
    }
    sum / (STEPS * STEPS) as f64
}

#[test]
fn light_over_twelve_decades_is_summed_right() {
    // Texels from 1e-6 to 1e6 side by side, in no order.
    let wild = RgbImage::from_fn(16, 8, |x, y| {
        [10f32.powf(((x * 7 + y * 5) % 13) as f32 - 6.0); 3]
    });
    let mut one = grey(64, 32, 0.0);
    one.pixels[9 * 64 + 20] = [1e6; 3];
    for probe in [wild, one] {
        let expected = plate_under(&probe);
        for bounces in [1, 3] {
            let (mean, error) = inside(&Setup::new(&plate(9.0), &probe, WHITE).render(64, bounces));
            assert!(
                (mean - expected).abs() < 0.01 * expected + 4.0 * error,
                "{mean} ± {error}, expected {expected}"
            );
        }
        let frame = Setup::new(&cup(), &probe, PLASTIC).render(8, 3);
        assert!(inside(&frame).0 > 0.0);
    }
}

#[test]
fn image_scales_with_the_light() {
    let image = |factor: f32| {
        let mut probe = lamp_and_sky();
        probe
            .pixels
            .iter_mut()
            .for_each(|p| *p = p.map(|c| c * factor));
        let mut frame = Setup::new(&cup(), &probe, PLASTIC).render(8, 3);
        frame
            .radiance
            .pixels
            .iter_mut()
            .for_each(|p| *p = p.map(|c| c / factor));
        frame
    };
    let plain = image(1.0);
    for factor in [1e-9, 1e-6, 1e6] {
        let off = difference(&plain, &image(factor));
        assert!(off < 1e-3, "light × {factor}: {off}");
    }
}

#[test]
fn no_light_is_black() {
    for (width, height) in [(1, 1), (8, 4)] {
        let frame = Setup::new(&cup(), &grey(width, height, 0.0), PLASTIC).render(8, 3);
        assert!(frame.radiance.pixels.iter().all(|p| *p == [0.0; 3]));
    }
}

#[test]
fn one_texel_is_light_from_everywhere() {
    let (mean, _) = inside(&Setup::new(&plate(9.0), &grey(1, 1, 1.0), WHITE).render(64, 1));
    assert!((mean - 1.0).abs() < 1e-3, "{mean}");
}

#[test]
fn large_probes_light_as_small_ones() {
    // 1 + ½ cos θ on a white plate that looks up: 1 + ½ · ⅔. The largest is 4096 × 2048, 100 MB of floats.
    for (width, height) in [(64, 32), (4096, 2048)] {
        let cos = |y: usize| (std::f64::consts::PI * (y as f64 + 0.5) / height as f64).cos();
        let probe = RgbImage::from_fn(width, height, |_, y| [1.0 + 0.5 * cos(y) as f32; 3]);
        let (mean, _) = inside(&Setup::new(&plate(9.0), &probe, WHITE).render(64, 1));
        assert!(
            (mean / (4.0 / 3.0) - 1.0).abs() < 1e-3,
            "{width} × {height}: {mean}"
        );
    }
}

#[test]
fn broken_texels_are_mended_and_reported_or_refused_by_name() {
    let breaks = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0];
    for value in breaks {
        let mut probe = grey(32, 16, 1.0);
        probe.pixels[100] = [value; 3];
        let setup = Setup::new(&plate(9.0), &probe, WHITE);
        let (_, warnings) = setup.stage().unwrap();
        assert!(
            warnings
                .iter()
                .any(|w| w.contains("probe.exr") && w.contains("1 texels")),
            "{value}: {warnings:?}"
        );
        let (mean, _) = inside(&setup.render(16, 1));
        assert!(mean > 0.9 && mean < 1.001, "{value}: {mean}");
    }
    let mut ruined = grey(32, 16, 1.0);
    ruined.pixels[..100].fill([f32::NAN; 3]);
    let error = Setup::new(&plate(9.0), &ruined, WHITE)
        .stage()
        .err()
        .unwrap();
    assert!(
        error.contains("probe.exr") && error.contains("100 of 512"),
        "{error}"
    );
}
