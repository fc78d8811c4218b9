//! Any lobe, from any side.

use super::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]

    #[test]
    fn any_roughness_renders_finite(
        alpha in prop_oneof![Just(1e-3), Just(1.0), (-3.0..0.0f64).prop_map(|e| 10f64.powf(e))],
        ndf in prop::sample::select(vec!["ggx", "beckmann"]),
        bounces in 1u32..4,
    ) {
        let material = format!("ndf = '{ndf}'\nalpha = {alpha:?}\nrho_d = 0.3\nrho_s = 2.35");
        let (mean, _) = inside(&Setup::new(&cup(), &lamp_and_sky(), &material).render(2, bounces));
        // The lamp's light is 30 at most on a surface that faces it.
        prop_assert!(mean > 0.0 && mean < 100.0, "{mean}");
    }
}

/// Every pixel sees the plate at this angle above the horizon.
fn grazing(elevation_deg: f64) -> Seen {
    let elevation = elevation_deg.to_radians();
    Seen {
        position: 4.0 * DVec3::new(0.0, elevation.sin(), elevation.cos()),
        look_at: DVec3::ZERO,
        // A third of the plate's apparent height.
        fov_x_deg: elevation_deg.min(60.0) / 6.0,
        side: 16,
    }
}

#[test]
fn white_furnace_returns_one_at_any_angle() {
    for elevation in [0.01, 0.1, 1.0, 10.0, 60.0] {
        let mut setup = Setup::new(&plate(1.0), &grey(8, 4, 1.0), WHITE);
        setup.seen = grazing(elevation);
        let (mean, _) = inside(&setup.render(64, 1));
        assert!((mean - 1.0).abs() < 1e-3, "{elevation}°: {mean}");
    }
}

#[test]
fn grazing_views_of_any_lobe_are_finite() {
    for alpha in [0.001, 0.1, 1.0] {
        for elevation in [0.01, 0.1, 1.0] {
            let material =
                format!("ndf = 'beckmann'\nalpha = {alpha:?}\nrho_d = 0.3\nrho_s = 2.35");
            let mut setup = Setup::new(&plate(1.0), &lamp_and_sky(), &material);
            setup.seen = grazing(elevation);
            let (mean, _) = inside(&setup.render(16, 1));
            assert!(mean > 0.0 && mean < 1e4, "{alpha} {elevation}°: {mean}");
        }
    }
}

#[test]
fn mirror_like_and_rough_lobes_gain_no_light() {
    for surface in [plate(1.0), sphere(24)] {
        for ndf in ["ggx", "beckmann"] {
            for alpha in [0.001, 0.01, 0.1, 0.4, 1.0] {
                let material = format!(
                    "ndf = '{ndf}'\nalpha = {alpha:?}\nrho_d = 0.0\nfresnel = 'schlick'\nf0 = 1.0\nf90 = 1.0"
                );
                let frame = Setup::new(&surface, &grey(8, 4, 1.0), &material).render(64, 1);
                let (mean, error) = inside(&frame);
                assert!(
                    mean < 1.0 + 4.0 * error + 1e-4,
                    "{ndf} {alpha}: {mean} ± {error}"
                );
                // A narrow lobe on a smooth surface loses next to nothing either.
                assert!(
                    alpha > 0.05 || mean > 0.98,
                    "{ndf} {alpha}: {mean} ± {error}"
                );
            }
        }
    }
}
