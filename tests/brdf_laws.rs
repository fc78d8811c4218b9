//! Laws of the reflectance model, against double precision.

mod quadrature;

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3, Vec2, Vec3};
use proptest::prelude::*;
use turnlight::brdf::{Alpha, Dichromatic, Fresnel, Ndf};
use turnlight::geometry::Local;

use quadrature::{integrate, lobe_normal};

const ALPHAS: [f32; 9] = [1e-3, 3e-3, 0.01, 0.02, 0.05, 0.1, 0.3, 0.7, 1.0];

/// 89.99° from the normal.
const GRAZING: f32 = 1.745e-4;

fn alpha(value: f32) -> Alpha {
    Alpha::saturating(value)
}

fn lobe(ndf: Ndf, a: f32, fresnel: Fresnel) -> Dichromatic {
    Dichromatic {
        rho_d: Vec3::ZERO,
        rho_s: Vec3::ONE,
        alpha: alpha(a),
        ggx: f32::from(u8::from(ndf == Ndf::Ggx)),
        fresnel,
    }
}

/// A fully reflecting lobe: what it loses is masked, not absorbed.
const LOSSLESS: Fresnel = Fresnel::Schlick {
    f0: Vec3::ONE,
    f90: 1.0,
};

fn view(theta_deg: f64) -> Local {
    let (sin, cos) = theta_deg.to_radians().sin_cos();
    Local(DVec3::new(sin * 0.7f64.cos(), sin * 0.7f64.sin(), cos).as_vec3())
}

fn direction(cos: f32, phi: f32) -> Local {
    let sin = (1.0 - cos * cos).max(0.0).sqrt();
    Local(Vec3::new(sin * phi.cos(), sin * phi.sin(), cos))
}

/// The model in double precision, from the papers' own formulas.
mod exact {
    use super::*;

    pub(super) fn density(ndf: Ndf, wm: DVec3, a: f64) -> f64 {
        let cos2 = wm.z * wm.z;
        let tan2 = (wm.x * wm.x + wm.y * wm.y) / cos2;
        match ndf {
            Ndf::Beckmann => (-tan2 / (a * a)).exp() / (PI * a * a * cos2 * cos2),
            Ndf::Ggx => a * a / (PI * cos2 * cos2 * (a * a + tan2).powi(2)),
        }
    }

    /// `b = cot θ / alpha`, where Beckmann's fit changes its form at 1.6.
    pub(super) fn b(w: DVec3, a: f64) -> f64 {
        w.z / (a * w.x.hypot(w.y))
    }

    pub(super) fn masking(ndf: Ndf, w: DVec3, a: f64) -> f64 {
        let b = b(w, a);
        match ndf {
            Ndf::Ggx => 2.0 / (1.0 + (1.0 + 1.0 / (b * b)).sqrt()),
            Ndf::Beckmann if b >= 1.6 => 1.0,
            Ndf::Beckmann => b * (3.535 + 2.181 * b) / (1.0 + 2.276 * b + 2.577 * b * b),
        }
    }

    /// Smith's masking for the distribution itself: `1/(1 + Λ)` with the error function.
    pub(super) fn smith(ndf: Ndf, w: DVec3, a: f64) -> f64 {
        let b = b(w, a);
        match ndf {
            Ndf::Ggx => masking(ndf, w, a),
            Ndf::Beckmann => 1.0 / (1.0 + 0.5 * ((-b * b).exp() / (b * PI.sqrt()) - libm::erfc(b))),
        }
    }

    pub(super) fn fresnel(fresnel: Fresnel, cos: f64) -> f64 {
        match fresnel {
            Fresnel::Dielectric { eta } => {
                let eta = f64::from(eta);
                let cos_t = (1.0 - (1.0 - cos * cos) / (eta * eta)).sqrt();
                let s = (cos - eta * cos_t) / (cos + eta * cos_t);
                let p = (eta * cos - cos_t) / (eta * cos + cos_t);
                0.5 * (s * s + p * p)
            }
            Fresnel::Schlick { f0, f90 } => {
                let s = (1.0 - cos).powi(5);
                f64::from(f0.x) * (1.0 - s) + f64::from(f90) * s
            }
        }
    }

    /// The specular lobe of `rho_s = 1`, cosine excluded.
    pub(super) fn lobe(ndf: Ndf, wi: DVec3, wo: DVec3, a: f64, f: Fresnel) -> f64 {
        // ω_i·ω_h as half the length of the sum: the product itself is lost where directions that
        // were rounded to f32 are nearly opposite.
        let (wm, cos_half) = ((wi + wo).normalize(), 0.5 * (wi + wo).length());
        density(ndf, wm, a) * masking(ndf, wi, a) * masking(ndf, wo, a) * fresnel(f, cos_half)
            / (4.0 * wi.z * wo.z)
    }
}

/// `∫ f(wm) dwm` over the hemisphere of microfacet normals.
fn over_normals(a: f32, tolerance: f64, f: impl Fn(DVec3) -> f64) -> f64 {
    let integrand = |s: f64, phi: f64| {
        let (wm, jacobian) = lobe_normal(f64::from(a), s, phi + 0.7);
        f(wm) * jacobian
    };
    // Finer towards grazing normals, where a narrow lobe's tail meets the edge of what is visible,
    // too sharply for the first look of an adaptive rule.
    grid(
        &integrand,
        &[0.0, 0.25, 0.5, 0.75, 0.9, 0.96, 0.99, 0.997, 0.9995, 1.0],
        &[0.0, FRAC_PI_2, PI, 1.5 * PI, TAU],
        tolerance,
    )
}

/// `∫∫ f dx dy` over a grid of boxes.
fn grid(f: &impl Fn(f64, f64) -> f64, xs: &[f64], ys: &[f64], tolerance: f64) -> f64 {
    let mut sum = 0.0;
    for x in xs.windows(2) {
        for y in ys.windows(2) {
            let (low, high) = (DVec2::new(x[0], y[0]), DVec2::new(x[1], y[1]));
            sum += integrate(f, low, high, tolerance);
        }
    }
    sum
}

#[test]
fn ndf_projects_to_unit_area() {
    for ndf in Ndf::ALL {
        for a in ALPHAS {
            let area = over_normals(a, 1e-9, |wm| {
                f64::from(ndf.density(Local(wm.as_vec3()), alpha(a))) * wm.z
            });
            assert!((area - 1.0).abs() < 1e-6, "{ndf:?} alpha {a}: {area}");
        }
    }
}

#[test]
fn visible_normals_project_to_the_cosine() {
    for ndf in Ndf::ALL {
        for a in ALPHAS {
            for theta in [0.0, 30.0, 60.0, 80.0, 89.0, 89.99] {
                let wo = view(theta);
                let masking = f64::from(ndf.masking_exact(wo, alpha(a)));
                let visible = over_normals(a, 2e-6 * f64::from(wo.0.z), |wm| {
                    f64::from(ndf.density(Local(wm.as_vec3()), alpha(a)))
                        * wo.0.as_dvec3().dot(wm).max(0.0)
                });
                let area = masking * visible;
                assert!(
                    (area / f64::from(wo.0.z) - 1.0).abs() < 1e-4,
                    "{ndf:?} alpha {a} theta_o {theta}: {area}"
                );
            }
        }
    }
}

#[test]
fn masking_agrees_with_double_precision_and_falls_with_the_angle() {
    for ndf in Ndf::ALL {
        for a in ALPHAS {
            let mut last = [2.0f64; 2];
            for step in 0..=9_000 {
                let w = view(0.01 * f64::from(step.min(8_999)));
                let (wide, width) = (w.0.as_dvec3(), f64::from(a));
                let cos = wide.z;
                let found = [
                    f64::from(ndf.masking_over_cos(w, alpha(a))) * cos,
                    f64::from(ndf.masking_exact(w, alpha(a))),
                ];
                let truth = [
                    exact::masking(ndf, wide, width),
                    exact::smith(ndf, wide, width),
                ];
                let what = format!("{ndf:?} alpha {a} {w:?}: {found:?} {truth:?}");
                for i in 0..2 {
                    assert!((found[i] / truth[i] - 1.0).abs() < 2e-6, "{what}");
                    // The fit overshoots 1 by 6.1e-5 just before its branches meet.
                    assert!(found[i] < last[i] + 7e-5, "{what}");
                    assert!(found[i] <= 1.0 + 7e-5, "{what}");
                }
                assert!((found[0] / found[1] - 1.0).abs() < 0.0064, "{what}");
                last = found;
            }
        }
    }
}

#[test]
fn lossless_lobe_never_gains_and_agrees_with_an_independent_integral() {
    for ndf in Ndf::ALL {
        for a in [1e-3, 0.02, 0.1, 0.4, 1.0] {
            for theta in [0.0, 45.0, 75.0, 85.0, 89.9] {
                for fresnel in [LOSSLESS, Fresnel::PAPER] {
                    let wo = view(theta);
                    let wide = wo.0.as_dvec3();
                    let (material, width) = (lobe(ndf, a, fresnel), f64::from(a));

                    // turnlight's values in lobe coordinates; dwi = 4 (wo·wm) dwm.
                    let albedo = over_normals(a, 2e-6, |wm| {
                        let cos = wide.dot(wm);
                        let wi = Local((2.0 * cos * wm - wide).as_vec3());
                        if cos <= 0.0 || wi.0.z <= 0.0 {
                            return 0.0;
                        }
                        f64::from(material.eval(wi, wo).x) * f64::from(wi.0.z) * 4.0 * cos
                    });

                    // Double precision in Cartesian slopes (x, y) = alpha tan(πu/2).
                    let integrand = |u: f64, v: f64| {
                        let (x, y) = ((FRAC_PI_2 * u).tan(), (FRAC_PI_2 * v).tan());
                        let wm = DVec3::new(width * x, width * y, 1.0).normalize();
                        let cos = wide.dot(wm);
                        let wi = 2.0 * cos * wm - wide;
                        if cos <= 0.0 || wi.z <= 0.0 {
                            return 0.0;
                        }
                        let dslopes = FRAC_PI_2.powi(2) * (1.0 + x * x) * (1.0 + y * y);
                        let dwm = width * width * wm.z.powi(3) * dslopes;
                        exact::lobe(ndf, wi, wide, width, fresnel) * wi.z * 4.0 * cos * dwm
                    };
                    let edges = [
                        -1.0, -0.999, -0.99, -0.95, -0.8, -0.4, 0.0, 0.4, 0.8, 0.95, 0.99, 0.999,
                        1.0,
                    ];
                    let truth = grid(&integrand, &edges, &edges, 1e-6);

                    let what = format!("{ndf:?} alpha {a} theta_o {theta} {fresnel:?}");
                    assert!(albedo <= 1.0 + 1e-4, "{what}: {albedo}");
                    assert!((albedo - truth).abs() < 1e-4, "{what}: {albedo} {truth}");
                }
            }
        }
    }
}

#[test]
fn white_furnace_returns_one() {
    let material = Dichromatic {
        rho_d: Vec3::ONE,
        rho_s: Vec3::ZERO,
        alpha: Alpha::MAX,
        ggx: 0.0,
        fresnel: Fresnel::PAPER,
    };
    for theta in [0.0, 60.0, 89.99] {
        let wo = view(theta);
        let integrand = |cos: f64, phi: f64| {
            let wi = direction(cos as f32, phi as f32);
            f64::from(material.eval(wi, wo).x * wi.0.z)
        };
        let albedo = integrate(&integrand, DVec2::ZERO, DVec2::new(1.0, TAU), 1e-8);
        assert!((albedo - 1.0).abs() < 1e-6, "theta_o {theta}: {albedo}");
        for i in 0..100 {
            let u = Vec2::new(i as f32 / 100.0, (i * 37 % 100) as f32 / 100.0);
            let weight = material.sample(wo, 0.3, u).map(|s| s.weight);
            assert!(weight.is_some_and(|w| (w - Vec3::ONE).length() < 1e-6));
        }
    }
}

#[test]
fn narrow_beckmann_lobes_lean_towards_the_view() {
    // Seen from θ_o, the slope along the view, in units of alpha, has the density
    // (1 + x alpha tan θ_o) exp(−x²)/√π while alpha tan θ_o is small: its mean is half of that.
    // A sampler that takes such angles for normal incidence has a mean of 0.
    let (a, n) = (2e-3f32, 1 << 20);
    let wo = Local(Vec3::new(0.5, 0.0, 0.75f32.sqrt()));
    let mut mean = 0.0;
    for i in 0..n {
        // A lattice: its error on a smooth integrand is far below that of random points.
        let u = Vec2::new(
            (i as f32 + 0.5) / n as f32,
            (f64::from(i) * 0.618_033_988_749).fract() as f32,
        );
        let wm = Ndf::Beckmann.sample_visible(wo, alpha(a), u).0.as_dvec3();
        mean += wm.x / wm.z / f64::from(a) / f64::from(n);
    }
    let lean = 0.5 * f64::from(a) * 0.5 / 0.75f64.sqrt();
    assert!((mean / lean - 1.0).abs() < 0.02, "{mean} {lean}");
}

/// `ln alpha` uniform over the range; cosines with a share at grazing; azimuths with shares at
/// equal and at opposite.
fn any_alpha() -> impl Strategy<Value = f32> {
    (-3.0f32..=0.0).prop_map(|e| 10f32.powf(e))
}

fn any_cos() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => GRAZING..=1.0f32,
        2 => (0.0f32..=3.75).prop_map(|e| 10f32.powf(-e)),
        1 => Just(GRAZING),
        1 => Just(1.0f32),
    ]
}

fn any_phi() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => 0.0f32..std::f32::consts::TAU,
        1 => Just(0.0f32),
        1 => Just(std::f32::consts::PI),
        1 => -1e-3f32..1e-3,
        1 => 3.1406f32..3.1426,
    ]
}

fn any_pair() -> impl Strategy<Value = (Local, Local)> {
    (any_cos(), any_cos(), any_phi()).prop_map(|(i, o, phi)| (direction(i, phi), direction(o, 0.0)))
}

/// A pair about a mirror direction, where a lobe of this width is bright.
fn near_mirror(a: f32, cos: f32, x: f32, y: f32) -> Option<(Local, Local)> {
    let wo = direction(cos, 0.0);
    let wm = Vec3::new(a * x, a * y, 1.0).normalize();
    let wi = (2.0 * wo.0.dot(wm) * wm - wo.0).normalize();
    (wi.z > GRAZING).then_some((Local(wi), wo))
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: if cfg!(debug_assertions) { 5_000 } else { 50_000 },
        rng_seed: proptest::test_runner::RngSeed::Fixed(20_240_607),
        failure_persistence: None,
        max_global_rejects: 1_000_000,
        ..ProptestConfig::default()
    })]

    #[test]
    fn reflectance_is_reciprocal((wi, wo) in any_pair(), a in any_alpha(), ggx in 0.0f32..=1.0) {
        for fresnel in [Fresnel::PAPER, LOSSLESS] {
            let material = Dichromatic {
                rho_d: Vec3::splat(0.3),
                ggx,
                ..lobe(Ndf::Ggx, a, fresnel)
            };
            let (forth, back) = (material.eval(wi, wo).x, material.eval(wo, wi).x);
            prop_assert!((forth - back).abs() <= 1e-6 * forth.max(back), "{forth} {back}");
            let (forth, back) = (material.eval_d_alpha(wi, wo).x, material.eval_d_alpha(wo, wi).x);
            // Three terms of up to f/alpha each may cancel.
            let scale = forth.abs().max(material.eval(wi, wo).x / a);
            prop_assert!((forth - back).abs() <= 1e-6 * scale, "{forth} {back}");
        }
    }

    #[test]
    fn values_agree_with_double_precision(
        (wi, wo) in any_pair(), a in any_alpha(), cos in any_cos(), x in -3.0f32..3.0, y in -3.0f32..3.0,
    ) {
        for (wi, wo) in [Some((wi, wo)), near_mirror(a, cos, x, y)].into_iter().flatten() {
            for ndf in Ndf::ALL {
                for fresnel in [Fresnel::PAPER, LOSSLESS] {
                    let found = f64::from(lobe(ndf, a, fresnel).eval(wi, wo).x);
                    let (i, o) = (wi.0.as_dvec3(), wo.0.as_dvec3());
                    let truth = exact::lobe(ndf, i, o, f64::from(a), fresnel);
                    prop_assert!(
                        (found - truth).abs() <= 5e-5 * truth + 1e-30,
                        "{:?} {:?} {} {}", ndf, fresnel, found, truth
                    );
                }
            }
        }
    }

    #[test]
    fn derivative_by_alpha_matches_central_differences(
        (wi, wo) in any_pair(), a in any_alpha(), cos in any_cos(), x in -3.0f32..3.0, y in -3.0f32..3.0,
    ) {
        for (wi, wo) in [Some((wi, wo)), near_mirror(a, cos, x, y)].into_iter().flatten() {
            let (i, o, width) = (wi.0.as_dvec3(), wo.0.as_dvec3(), f64::from(a));
            let step = 1e-5 * width;
            for ndf in Ndf::ALL {
                // Beckmann's fit has a kink.
                let kink = |w| (exact::b(w, width) - 1.6).abs() < 1e-4;
                if ndf == Ndf::Beckmann && (kink(i) || kink(o)) {
                    continue;
                }
                let f = |a| exact::lobe(ndf, i, o, a, Fresnel::PAPER);
                let truth = (f(width + step) - f(width - step)) / (2.0 * step);
                let found = f64::from(lobe(ndf, a, Fresnel::PAPER).eval_d_alpha(wi, wo).x);
                // The slope crosses zero; there f/alpha gives the scale.
                let scale = truth.abs().max(0.1 * f(width) / width);
                prop_assert!(
                    (found - truth).abs() <= 1e-4 * scale + 1e-25,
                    "{ndf:?} found {found} truth {truth} f {}", f(width)
                );
            }
        }
    }

    #[test]
    fn everything_is_finite(
        (mut wi, mut wo) in any_pair(), a in any_alpha(), ggx in prop_oneof![Just(0.0f32), Just(1.0), 0.0f32..1.0],
        tiny in prop_oneof![3 => Just(None), 1 => (-38.0f32..-4.0).prop_map(|e| Some(10f32.powf(e)))],
        same in any::<bool>(), u in (0.0f32..1.0, 0.0f32..1.0, 0.0f32..1.0),
        dielectric in any::<bool>(),
    ) {
        // Also where a frame's dot products leave the cosine at next to nothing.
        if let Some(z) = tiny {
            wo = Local(Vec3::new(0.6, 0.8, z));
            wi = if same { Local(Vec3::new(-0.6, 0.8, z)) } else { wi };
        }
        if same && tiny.is_none() {
            wi = wo;
        }
        let fresnel = if dielectric { Fresnel::PAPER } else { LOSSLESS };
        for rho_d in [0.0, 0.5] {
            let material = Dichromatic { rho_d: Vec3::splat(rho_d), rho_s: Vec3::splat(58.0), ggx, ..lobe(Ndf::Ggx, a, fresnel) };
            let f = material.eval(wi, wo);
            prop_assert!(f.is_finite() && f.x >= 0.0, "f {f}");
            let slope = material.eval_d_alpha(wi, wo);
            prop_assert!(slope.is_finite(), "slope {slope}");
            let pdf = material.pdf(wi, wo);
            prop_assert!(pdf.is_finite() && pdf >= 0.0, "pdf {pdf}");
            if let Some(sample) = material.sample(wo, u.0, Vec2::new(u.1, u.2)) {
                prop_assert!(sample.weight.is_finite() && sample.pdf.is_finite(), "{sample:?}");
                prop_assert!((sample.wi.0.length() - 1.0).abs() < 1e-5, "{sample:?}");
                // One lobe can be at most 10 times rarer than the other.
                prop_assert!(sample.weight.x <= 10.1 * (rho_d + 58.0), "{sample:?}");
            }
        }
    }
}
