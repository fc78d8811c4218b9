//! How close the forward model's sums are to the integrals they stand for, on the shipped probes.

use std::f64::consts::TAU;

use glam::{DQuat, Mat3, Vec2, Vec3};

use super::columns::{Columns, ForwardModel, ROUGHNESSES, Scratch, roughness};
use super::gloss::{self, Gloss};
use super::noise::NoiseModel;
use super::visibility::Visibility;
use super::{full, ndf_choice};
use crate::brdf::{Alpha, Ndf, dielectric};
use crate::geometry::Local;
use crate::image::RgbImage;
use crate::mesh::SurfacePoint;
use crate::probe::{Environment, LightPyramid};
use crate::sampling::SobolPath;
use crate::traces::{Observation, Trace};

const ALPHAS: [f32; 5] = [0.05, 0.1, 0.2, 0.5, 0.95];

fn pyramid(probe: &str) -> LightPyramid {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/probes");
    let image = RgbImage::read(&folder.join(probe)).unwrap();
    LightPyramid::new(&Environment::new(image, 0.0).unwrap().0)
}

/// An open point seen from many sides: normals and views drawn over the sphere, view within 75° of
/// the normal.
fn trace(observations: usize) -> Trace {
    let observe = |i: usize| {
        let [a, b, c, d] = SobolPath::new(5, 0, 0, i as u32).next_4d();
        let normal = DQuat::from_rotation_y(TAU * f64::from(a)).as_quat()
            * Vec3::new(0.0, 2.0 * b - 1.0, (1.0 - (2.0 * b - 1.0).powi(2)).sqrt());
        let frame = crate::geometry::Frame::about(normal);
        let (sin, cos) = (1.3 * c).sin_cos();
        let (y, x) = (TAU as f32 * d).sin_cos();
        let wo = frame.from_local(crate::geometry::Local(Vec3::new(sin * x, sin * y, cos)));
        Observation {
            frame: 0,
            radiance: Vec3::ONE,
            variance: Vec3::ONE,
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

fn columns(pyramid: &LightPyramid, trace: &Trace, light_nodes: usize, diffuse: usize) -> Columns {
    let model = ForwardModel {
        pyramid,
        diffuse_nodes: ForwardModel::diffuse_nodes(pyramid, diffuse),
        world_from_object: &[Mat3::IDENTITY],
        eta: 1.3,
        light_nodes,
        window_cos: None,
        footprints: true,
    };
    let mut columns = Columns::default();
    model.columns(
        trace,
        &Visibility::Open,
        None,
        &mut Scratch::default(),
        &mut columns,
    );
    columns
}

/// Relative differences of green, ascending.
fn differences(tested: &[f32], exact: &[f32]) -> Vec<f32> {
    let mut all: Vec<f32> = tested
        .iter()
        .zip(exact)
        .map(|(t, e)| (t / e - 1.0).abs())
        .collect();
    all.sort_by(f32::total_cmp);
    all
}

fn specular(columns: &Columns, ndf: usize, alpha: f32) -> Vec<f32> {
    let mut values = Vec::new();
    columns.specular(ndf, alpha.ln(), |_, value, _| values.push(value.y));
    values
}

#[test]
fn default_nodes_reach_their_stated_errors() {
    // Exact: every texel of the probe its own node.
    let trace = trace(40);
    for probe in ["interior.exr", "courtyard.exr", "studio.exr", "city.exr"] {
        let pyramid = pyramid(probe);
        let exact = columns(&pyramid, &trace, usize::MAX, usize::MAX);
        let settings = super::FitSettings::default();
        let tested = columns(
            &pyramid,
            &trace,
            settings.light_nodes,
            ForwardModel::DIFFUSE_NODES,
        );
        for ndf in 0..2 {
            for alpha in ALPHAS {
                let all = differences(
                    &specular(&tested, ndf, alpha),
                    &specular(&exact, ndf, alpha),
                );
                let (median, p90) = (all[20], all[36]);
                println!("{probe} ndf {ndf} alpha {alpha}: median {median:.2e} p90 {p90:.2e}");
                assert!(
                    median < 0.01 && p90 < 0.02,
                    "{probe} {ndf} {alpha}: {median} {p90}"
                );
            }
        }
        let green = |columns: &Columns| columns.diffuse.iter().map(|d| d.y).collect::<Vec<_>>();
        let all = differences(&green(&tested), &green(&exact));
        println!(
            "{probe} diffuse: median {:.2e} p90 {:.2e}",
            all[20], all[36]
        );
        assert!(
            all[20] < 0.0015 && all[36] < 0.004,
            "{probe} diffuse {} {}",
            all[20],
            all[36]
        );
    }
}

#[test]
fn traces_between_roughnesses_are_those_of_the_integral() {
    // Every other roughness of the grid is left out in thought: a cubic through the neighbours of a
    // node two steps away, at twice the spacing, errs sixteen times as much as the real one.
    let columns = columns(&pyramid("interior.exr"), &trace(20), 4096, 64);
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
    let pyramid = LightPyramid::new(&Environment::new(image, 0.0).unwrap().0);
    let table = Gloss::new(&pyramid, 1.3);
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
                    1.3,
                    cos_o,
                );
                assert!(
                    (seen.x / (2.0 * albedo) - 1.0).abs() < 0.03,
                    "{ndf:?} {k} {c}: {seen} {albedo}"
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
    let table = Gloss::new(&LightPyramid::new(&environment), 1.3);
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
    let pyramid = pyramid("interior.exr");
    let model = ForwardModel {
        pyramid: &pyramid,
        diffuse_nodes: ForwardModel::diffuse_nodes(&pyramid, 512),
        world_from_object: &[Mat3::IDENTITY; 60],
        eta: 1.3,
        light_nodes: 1024,
        window_cos: None,
        footprints: true,
    };
    let mut columns = Columns::default();
    let mut scratch = Scratch::default();
    model.columns(&trace, &Visibility::Open, None, &mut scratch, &mut columns);
    let (ndf, alpha, rho_s) = material;
    let mut observed = Vec::new();
    columns.specular(ndf as usize, alpha.ln(), |i, specular, _| {
        let [a, b, c, d] = SobolPath::new(11, 0, 0, i as u32).next_4d();
        let noise = Vec3::splat(a - 0.5) + 0.3 * (Vec3::new(b, c, d) - 0.5);
        let exact = colour * columns.diffuse[i] + rho_s * specular;
        observed.push(exact * (Vec3::ONE + 3e-3 * noise));
    });
    for (observation, radiance) in trace.observations.iter_mut().zip(observed) {
        observation.radiance = radiance;
        observation.variance = (1e-3 * radiance) * (1e-3 * radiance);
    }
    (trace, columns)
}

fn best(trace: &Trace, columns: &Columns) -> super::Estimate {
    let noise = NoiseModel::independent(false);
    let candidates = full::estimate(trace, columns, &super::FitSettings::default(), &noise);
    ndf_choice::choose(&candidates, 0.5).estimate
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
                    observation.radiance.x = 1e3;
                    observation.variance.x = f32::INFINITY;
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

#[test]
fn diffuse_beside_a_lobe_is_what_it_leaves() {
    let colour = Vec3::new(0.4, 0.3, 0.2);
    let (trace, columns) = synthetic((Ndf::Ggx, 0.2, 2.35), colour);
    let noise = NoiseModel::independent(false);
    let beside = |rho_s: f32| {
        full::diffuse_beside(
            &trace,
            &columns,
            &noise,
            (Ndf::Ggx, 0.2, Vec3::splat(rho_s)),
        )
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
    assert!(full::diffuse_beside(&dark, &columns, &noise, (Ndf::Ggx, 0.2, Vec3::ONE)).is_none());
}
