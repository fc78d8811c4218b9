//! How close the forward model's sums are to the integrals they stand for, on the shipped probes.

use std::f64::consts::TAU;

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use super::columns::{Columns, ROUGHNESSES, roughness};
use super::forward_model::{ForwardModel, Scratch};
use super::fresnel_model::{Basis, FresnelModel};
use super::full;
use super::gloss::{self, Gloss};
use super::lobe_form::LobeForm;
use super::model_choice::Shares;
use super::noise::NoiseModel;
use super::visibility::Visibility;
use crate::brdf::{Alpha, Appearance, Ndf, dielectric};
use crate::geometry::Local;
use crate::image::RgbImage;
use crate::mesh::SurfacePoint;
use crate::probe::{Environment, LightPyramid, SplitLight};
use crate::sampling::SobolPath;
use crate::traces::{Observation, Trace};

const ALPHAS: [f32; 5] = [0.05, 0.1, 0.2, 0.5, 0.95];

fn environment(probe: &str) -> Environment {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/probes");
    let image = RgbImage::read(&folder.join(probe)).unwrap();
    Environment::new(image, 0.0).unwrap().0
}

/// An open point seen from many sides.
fn trace(observations: usize) -> Trace {
    let observe = |i: usize| {
        let [_, _, c, d] = SobolPath::new(5, 0, 0, i as u32).next_4d();
        // A camera of 28° × 28° looks along −Z; the normal lies within 75° of the view.
        let [u, v, ..] = SobolPath::new(6, 0, 0, i as u32).next_4d();
        let wo = Vec3::new(0.5 * (u - 0.5), 0.5 * (v - 0.5), 1.0).normalize();
        let frame = crate::geometry::Frame::about(wo);
        let (sin, cos) = (1.3 * c.sqrt()).sin_cos();
        let (y, x) = (TAU as f32 * d).sin_cos();
        let normal = frame.from_local(crate::geometry::Local(Vec3::new(sin * x, sin * y, cos)));
        Observation {
            frame: 0,
            radiance: Vec3::ONE,
            variance: Vec3::ONE,
            saturated: glam::BVec3::FALSE,
            position: Vec3::ZERO,
            wo,
            normal,
            geometric_normal: normal,
            normal_variance: 0.0,
        }
    };
    let point = SurfacePoint {
        position: Vec3::ZERO,
        normal: Vec3::Y,
        triangle: 0,
        barycentric: Vec2::ZERO,
        uv: None,
    };
    Trace {
        point,
        observations: (0..observations).map(observe).collect(),
    }
}

fn columns(light: &SplitLight, trace: &Trace) -> Columns {
    let light_nodes = super::FitSettings::default().light_nodes;
    let fresnel = FresnelModel::Dielectric { eta: 1.3 };
    let model = ForwardModel::new(light, &[Mat3::IDENTITY], fresnel, light_nodes);
    let mut columns = Columns::default();
    let mut scratch = Scratch::default();
    model.columns(trace, &Visibility::Open, None, &mut scratch, &mut columns);
    columns
}

/// `T_s` at [`ALPHAS`] for both NDFs, `[ndf][alpha]`, and `T_d`: of green, every texel its own node.
fn integral(texels: &[(Vec3, f32)], observation: &Observation) -> ([[f64; 5]; 2], f64) {
    let (normal, wo) = (observation.normal, observation.wo);
    let frame = crate::geometry::Frame::about(normal);
    let local = |d: Vec3| Local(frame.to_local(d).0);
    let local_wo = local(wo);
    let (mut specular, mut diffuse) = ([[0.0; 5]; 2], 0.0);
    for &(wi, flux) in texels {
        let local_wi = local(wi);
        if local_wi.0.z <= 0.0 {
            continue;
        }
        let flux = f64::from(flux);
        diffuse += flux * f64::from(local_wi.0.z) / std::f64::consts::PI;
        let half = Local((local_wi.0 + local_wo.0).normalize());
        let fresnel = f64::from(dielectric(half.0.dot(local_wi.0), 1.3));
        for ndf in Ndf::ALL {
            for (sum, alpha) in specular[ndf as usize].iter_mut().zip(ALPHAS) {
                let alpha = Alpha::saturating(alpha);
                let shape = ndf.density(half, alpha)
                    * ndf.masking_over_cos(local_wi, alpha)
                    * local_wi.0.z
                    * ndf.masking_over_cos(local_wo, alpha);
                *sum += 0.25 * flux * fresnel * f64::from(shape);
            }
        }
    }
    (specular, diffuse)
}

/// Relative differences, ascending.
fn differences(pairs: impl Iterator<Item = (f32, f64)>) -> Vec<f64> {
    let mut all: Vec<f64> = pairs.map(|(t, e)| (f64::from(t) / e - 1.0).abs()).collect();
    all.sort_by(f64::total_cmp);
    all
}

fn specular(columns: &Columns, ndf: usize, alpha: f32) -> Vec<f32> {
    let mut values = Vec::new();
    columns.specular(ndf, Basis::Dielectric, alpha.ln(), |_, value, _| {
        values.push(value.y)
    });
    values
}

#[test]
fn traces_reach_their_stated_errors() {
    let trace = trace(60);
    for probe in ["interior.exr", "courtyard.exr", "studio.exr", "city.exr"] {
        let environment = environment(probe);
        let pyramid = LightPyramid::new(&environment);
        let leaves = pyramid.nodes().iter().filter(|node| node.children == 0);
        let texels: Vec<(Vec3, f32)> = leaves.map(|node| (node.direction, node.flux.y)).collect();
        let exact: Vec<_> = trace
            .observations
            .par_iter()
            .map(|observation| integral(&texels, observation))
            .collect();
        let tested = columns(&SplitLight::new(&environment), &trace);
        for ndf in 0..2 {
            for (a, alpha) in ALPHAS.into_iter().enumerate() {
                let modelled = specular(&tested, ndf, alpha).into_iter();
                let all = differences(modelled.zip(exact.iter().map(|(s, _)| s[ndf][a])));
                let (median, p90) = (all[30], all[54]);
                println!("{probe} ndf {ndf} alpha {alpha}: median {median:.2e} p90 {p90:.2e}");
                assert!(
                    median < 0.008 && p90 < 0.07,
                    "{probe} {ndf} {alpha}: {median} {p90}"
                );
            }
        }
        let diffuse = tested.diffuse.iter().map(|d| d.y);
        let all = differences(diffuse.zip(exact.iter().map(|(_, d)| *d)));
        println!(
            "{probe} diffuse: median {:.2e} p90 {:.2e}",
            all[30], all[54]
        );
        assert!(all[30] < 1e-4 && all[54] < 3e-4, "{probe} diffuse");
    }
}

#[test]
fn traces_between_roughnesses_are_those_of_the_integral() {
    // Every other roughness of the grid is left out in thought: a cubic through the neighbours of a
    // node two steps away, at twice the spacing, errs sixteen times as much as the real one.
    let columns = columns(&SplitLight::new(&environment("interior.exr")), &trace(20));
    let mut largest = 0.0f32;
    for ndf in 0..2 {
        let at: Vec<Vec<f32>> = (0..ROUGHNESSES)
            .map(|k| specular(&columns, ndf, roughness(k)))
            .collect();
        for k in 3..ROUGHNESSES - 3 {
            for i in 0..20 {
                let cubic =
                    (9.0 * (at[k - 1][i] + at[k + 1][i]) - at[k - 3][i] - at[k + 3][i]) / 16.0;
                let peak = at.iter().map(|column| column[i]).fold(0.0, f32::max);
                largest = largest.max((cubic - at[k][i]).abs() / peak);
            }
        }
    }
    println!("at twice the spacing: {largest:.2e} of the peak");
    assert!(largest / 16.0 < 2e-3, "{largest}");
}

#[test]
fn gloss_reflects_uniform_light_by_the_albedo() {
    let image = RgbImage {
        width: 256,
        height: 128,
        pixels: vec![[2.0, 1.0, 0.5]; 256 * 128],
    };
    let light = SplitLight::new(&Environment::new(image, 0.0).unwrap().0);
    let table = Gloss::new(&light, FresnelModel::Dielectric { eta: 1.3 });
    for ndf in Ndf::ALL {
        for k in 0..gloss::ROUGHNESSES {
            for (mirror, c) in [
                (Vec3::Y, 15),
                (Vec3::new(0.6, -0.8, 0.0), 8),
                (Vec3::NEG_Z, 3),
            ] {
                let cos_o = (c as f32 + 0.5) / gloss::COSINES as f32;
                let seen = table.radiance(ndf, k as f32, mirror, cos_o);
                let albedo = gloss::directional_albedo(
                    ndf,
                    Alpha::saturating(gloss::roughness(k)),
                    |c| dielectric(c, 1.3),
                    cos_o,
                );
                // A quadtree over latitude and longitude is coarse about the poles.
                let bound = if mirror == Vec3::Y { 0.04 } else { 0.005 };
                assert!(
                    (seen.x / (2.0 * albedo) - 1.0).abs() < bound,
                    "{ndf:?} {k} {mirror}: {seen} {albedo}"
                );
            }
        }
    }
}

#[test]
fn gloss_face_on_is_the_integral() {
    // Seen face on, the split sum is no approximation: a strip of light over black.
    let pixels = (0..128 * 64)
        .map(|i| {
            if (i % 128) / 16 == 3 {
                [1.0; 3]
            } else {
                [0.01; 3]
            }
        })
        .collect();
    let (environment, _) = Environment::new(
        RgbImage {
            width: 128,
            height: 64,
            pixels,
        },
        0.0,
    )
    .unwrap();
    let fresnel = FresnelModel::Dielectric { eta: 1.3 };
    let table = Gloss::new(&SplitLight::new(&environment), fresnel);
    let light = environment.turned(glam::Mat3::IDENTITY);
    let alpha = Alpha::saturating(gloss::roughness(4));
    let frame_of = crate::geometry::Frame::about;
    for direction in [
        Vec3::X,
        Vec3::new(0.3, 0.2, -0.6).normalize(),
        Vec3::new(-0.1, 0.1, 1.0).normalize(),
    ] {
        let frame = frame_of(direction);
        let samples = 4096;
        let mean = (0..samples)
            .map(|i| {
                let [u, v, ..] = SobolPath::new(1, 0, 0, i).next_4d();
                let wm = Ndf::Ggx.sample_visible(Local(Vec3::Z), alpha, Vec2::new(u, v));
                let wi = Local(2.0 * wm.0.z * wm.0 - Vec3::Z);
                if wi.0.z <= 0.0 {
                    return 0.0;
                }
                let weight = dielectric(wm.0.z, 1.3) * Ndf::Ggx.masking_exact(wi, alpha);
                light.radiance(Vec3::ZERO, frame.from_local(wi)).x * weight
            })
            .sum::<f32>()
            / samples as f32;
        let seen = table
            .radiance(Ndf::Ggx, 4.0, direction, 0.5 * (31.0 / 16.0))
            .x;
        assert!(
            (seen / mean - 1.0).abs() < 0.05,
            "{direction}: {seen} {mean}"
        );
    }
}

/// A trace of an open point under a probe, of a given material, with noise of 0.1 % that the channels
/// share in part.
fn synthetic(material: (Ndf, f32, f32), colour: Vec3) -> (Trace, Columns) {
    let mut trace = trace(60);
    for (i, observation) in trace.observations.iter_mut().enumerate() {
        observation.frame = i as u32;
        // A tenth as wide as the narrowest lobe asked for.
        observation.normal_variance = 1e-5;
    }
    let light = SplitLight::new(&environment("interior.exr"));
    let fresnel = FresnelModel::Dielectric { eta: 1.3 };
    let model = ForwardModel::new(&light, &[Mat3::IDENTITY; 60], fresnel, 1024);
    let mut columns = Columns::default();
    let mut scratch = Scratch::default();
    model.columns(&trace, &Visibility::Open, None, &mut scratch, &mut columns);
    let (ndf, alpha, rho_s) = material;
    let mut observed = Vec::new();
    columns.specular(
        ndf as usize,
        Basis::Dielectric,
        alpha.ln(),
        |i, specular, _| {
            let [a, b, c, d] = SobolPath::new(11, 0, 0, i as u32).next_4d();
            let noise = Vec3::splat(a - 0.5) + 0.3 * (Vec3::new(b, c, d) - 0.5);
            let exact = colour * columns.diffuse[i] + rho_s * specular;
            observed.push(exact * (Vec3::ONE + 3e-3 * noise));
        },
    );
    for (observation, radiance) in trace.observations.iter_mut().zip(observed) {
        observation.radiance = radiance;
        observation.variance = (1e-3 * radiance) * (1e-3 * radiance);
    }
    (trace, columns)
}

fn best(trace: &Trace, columns: &Columns) -> super::Estimate {
    let noise = NoiseModel::independent(false);
    let settings = super::FitSettings::default();
    let candidates = full::estimate(trace, columns, &settings.models(), &noise);
    Shares::even(&settings.models())
        .choose(&candidates)
        .estimate
}

#[test]
fn full_recovers_material_through_outliers_and_saturation() {
    let colour = Vec3::new(0.4, 0.3, 0.0);
    for (ndf, alpha) in [(Ndf::Ggx, 0.1), (Ndf::Beckmann, 0.3), (Ndf::Ggx, 0.3)] {
        let (mut trace, columns) = synthetic((ndf, alpha, 2.35), colour);
        // One observation in ten is a shadow or a firefly, one in ten saturates red.
        for (i, observation) in trace.observations.iter_mut().enumerate() {
            match i % 10 {
                3 => observation.radiance *= if i % 20 == 3 { 0.3 } else { 4.0 },
                7 => {
                    observation.radiance.x *= 0.5;
                    observation.saturated.x = true;
                }
                _ => {}
            }
        }
        let estimate = best(&trace, &columns);
        let message = format!("{ndf:?} {alpha}: {estimate:?}");
        assert_eq!(estimate.ndf, ndf, "{message}");
        assert!((estimate.alpha / alpha - 1.0).abs() < 0.02, "{message}");
        assert!((estimate.rho_s.x / 2.35 - 1.0).abs() < 0.02, "{message}");
        assert!(
            (estimate.rho_d - colour).abs().max_element() < 0.003,
            "{message}"
        );
        assert_eq!(estimate.status, super::Status::Converged, "{message}");
        assert!(estimate.sigma_alpha < 0.02 * alpha, "{message}");
    }
}

#[test]
fn a_matte_point_has_no_lobe() {
    let colour = Vec3::new(0.4, 0.3, 0.2);
    let (trace, columns) = synthetic((Ndf::Ggx, 0.2, 0.0), colour);
    let estimate = best(&trace, &columns);
    assert!(estimate.rho_s.x < 0.1, "{estimate:?}");
    assert!(
        (estimate.rho_d - colour).abs().max_element() < 0.005,
        "{estimate:?}"
    );
}

const LOOK: Appearance = Appearance {
    rho_d: Vec3::ZERO,
    rho_s: Vec3::ONE,
    f90: 1.0,
    alpha: 0.2,
    ggx: 1.0,
};

#[test]
fn diffuse_beside_a_lobe_is_what_it_leaves() {
    let colour = Vec3::new(0.4, 0.3, 0.2);
    let (trace, columns) = synthetic((Ndf::Ggx, 0.2, 2.35), colour);
    let noise = NoiseModel::independent(false);
    let beside = |rho_s: f32| {
        let look = Appearance {
            rho_s: Vec3::splat(rho_s),
            ..LOOK
        };
        full::diffuse_beside(&trace, &columns, &noise, &look, LobeForm::Rgb)
    };
    assert!((beside(2.35).unwrap() - colour).abs().max_element() < 0.002);
    assert!(
        beside(1.5).unwrap().x > 0.402,
        "less gloss leaves more to the diffuse part"
    );
    let mut dark = trace.clone();
    dark.observations
        .iter_mut()
        .for_each(|o| o.variance = Vec3::INFINITY);
    assert!(full::diffuse_beside(&dark, &columns, &noise, &LOOK, LobeForm::Rgb).is_none());
}
