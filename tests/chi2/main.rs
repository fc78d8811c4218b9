//! Every sampler draws from the density it states: χ² tests over cells whose probabilities are
//! integrals of the stated density.

#[path = "../quadrature/mod.rs"]
mod quadrature;

mod harness;

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, Mat3, Vec2, Vec3};
use rayon::prelude::*;
use turnlight::brdf::{Alpha, Dichromatic, Fresnel, Ndf};
use turnlight::geometry::Local;
use turnlight::image::RgbImage;
use turnlight::probe::{Environment, LightClusters};
use turnlight::sampling::cosine_hemisphere;

use harness::{Failure, Histogram, Random, assert_family};
use quadrature::{integrate, lobe_normal};

/// The same in every build, so that fixed seeds give one outcome.
const SAMPLES: usize = 200_000;

const ALPHAS: [f32; 6] = [0.02, 0.05, 0.1, 0.3, 0.7, 1.0];
const THETAS_O: [f32; 5] = [0.0, 30.0, 60.0, 80.0, 89.0];

/// Not along an axis of the local frame, nor of any grid.
const AZIMUTH: f32 = 0.7;

fn alpha(value: f32) -> Alpha {
    Alpha::saturating(value)
}

fn view(theta_deg: f32) -> Local {
    let (sin, cos) = theta_deg.to_radians().sin_cos();
    Local(Vec3::new(sin * AZIMUTH.cos(), sin * AZIMUTH.sin(), cos))
}

/// Cells in lobe coordinates: `S × PHI`, azimuths counted from the view's.
const S: usize = 20;
const PHI: usize = 24;

fn lobe_cell(alpha: f64, wm: DVec3) -> usize {
    let r2 = (wm.x * wm.x + wm.y * wm.y) / (wm.z * wm.z * alpha * alpha);
    // 1 − (1 + r²)^−½, without cancellation for small r.
    let s = (-(-0.5 * r2.ln_1p()).exp_m1()).sqrt();
    let phi = (wm.y.atan2(wm.x) - f64::from(AZIMUTH)).rem_euclid(TAU) / TAU;
    let (row, column) = ((s * S as f64) as usize, (phi * PHI as f64) as usize);
    row.min(S - 1) * PHI + column.min(PHI - 1)
}

/// `∫ f(wm) dwm` over each cell.
fn integrate_lobe_cells(alpha: f64, f: impl Fn(DVec3) -> f64) -> Vec<f64> {
    let integrand = |s: f64, phi: f64| {
        let (wm, jacobian) = lobe_normal(alpha, s, phi + f64::from(AZIMUTH));
        f(wm) * jacobian
    };
    let step = DVec2::new(1.0 / S as f64, TAU / PHI as f64);
    (0..S * PHI)
        .map(|cell| {
            let low = step * DVec2::new((cell / PHI) as f64, (cell % PHI) as f64);
            let high = low + step;
            if high.x < 0.999 {
                return integrate(&integrand, low, high, 1e-6);
            }
            // A narrow lobe meets the horizon in the last row, too close to its end for the
            // first look of an adaptive rule.
            [low.x, 0.99, 0.998, 0.9996, 0.999_92, 1.0]
                .windows(2)
                .map(|s| {
                    let (low, high) = (DVec2::new(s[0], low.y), DVec2::new(s[1], high.y));
                    integrate(&integrand, low, high, 1e-7)
                })
                .sum()
        })
        .collect()
}

#[test]
fn cosine_hemisphere_samples_match_pdf_chi2() {
    // Cells of equal probability under cos θ / π: equal steps of cos² θ and of φ.
    let (rows, columns) = (20, 24);
    let results = (0..4)
        .map(|seed| {
            let probability = 1.0 / (rows * columns) as f64;
            let mut histogram = Histogram::new(vec![probability; rows * columns], SAMPLES);
            let mut random = Random(seed);
            for _ in 0..SAMPLES {
                let w = cosine_hemisphere(random.next_point()).0.as_dvec3();
                let row = ((w.z * w.z * rows as f64) as usize).min(rows - 1);
                let phi = w.y.atan2(w.x).rem_euclid(TAU) / TAU;
                let column = ((phi * columns as f64) as usize).min(columns - 1);
                histogram.count(row * columns + column);
            }
            (format!("seed {seed}"), histogram.p_value())
        })
        .collect();
    assert_family(results);
}

#[test]
fn visible_normals_match_pdf_chi2() {
    let cases: Vec<_> = Ndf::ALL
        .into_iter()
        .flat_map(|ndf| ALPHAS.map(|a| THETAS_O.map(|theta| (ndf, a, theta))))
        .flatten()
        .enumerate()
        .collect();
    let results = cases
        .into_par_iter()
        .map(|(case, (ndf, a, theta))| {
            let name = format!("{ndf:?} alpha {a} theta_o {theta} seed {case}");
            (name, visible_normals(ndf, a, theta, case as u64))
        })
        .collect();
    assert_family(results);
}

fn visible_normals(ndf: Ndf, a: f32, theta: f32, seed: u64) -> Result<f64, Failure> {
    let (wo, width) = (view(theta), f64::from(a));
    // The density of mirrored directions, times dwi/dwm = 4 (wo·wm).
    let mut probabilities = integrate_lobe_cells(width, |wm| {
        let cos = wo.0.as_dvec3().dot(wm).max(0.0);
        f64::from(ndf.pdf_reflected(wo, Local(wm.as_vec3()), alpha(a))) * 4.0 * cos
    });
    let total: f64 = probabilities.iter().sum();
    if (total - 1.0).abs() > 1e-4 {
        return Err(format!("the density integrates to {total}"));
    }
    probabilities.iter_mut().for_each(|p| *p /= total);
    let mut histogram = Histogram::new(probabilities, SAMPLES);
    let mut random = Random(seed);
    for _ in 0..SAMPLES {
        let wm = ndf.sample_visible(wo, alpha(a), random.next_point());
        histogram.count(lobe_cell(width, wm.0.as_dvec3()));
    }
    histogram.p_value()
}

/// Materials of the family: diffuse share, specular albedo, share of GGX.
const MATERIALS: [(f32, f32, f32); 4] = [
    (0.5, 1.0, 0.0),
    (0.5, 2.35, 1.0),
    (0.2, 20.0, 0.5),
    (0.0, 1.0, 0.5),
];

#[test]
fn dichromatic_samples_match_pdf_and_albedo() {
    let cases: Vec<_> = MATERIALS
        .into_iter()
        .flat_map(|m| [0.02, 0.1, 0.3, 1.0].map(|a| THETAS_O.map(|theta| (m, a, theta))))
        .flatten()
        .enumerate()
        .collect();
    let results = cases
        .into_par_iter()
        .map(|(case, ((rho_d, rho_s, ggx), a, theta))| {
            let material = Dichromatic {
                rho_d: Vec3::splat(rho_d),
                rho_s: Vec3::splat(rho_s),
                alpha: alpha(a),
                ggx,
                fresnel: Fresnel::PAPER,
            };
            let name = format!(
                "rho_d {rho_d} rho_s {rho_s} ggx {ggx} alpha {a} theta_o {theta} seed {case}"
            );
            (name, dichromatic(&material, view(theta), case as u64))
        })
        .collect();
    assert_family(results);
}

fn dichromatic(material: &Dichromatic, wo: Local, seed: u64) -> Result<f64, Failure> {
    let width = f64::from(material.alpha.get());
    let view = wo.0.as_dvec3();
    let reflected = |wm: DVec3| Local((2.0 * view.dot(wm) * wm - view).as_vec3());
    // Both integrals over wi, turned into integrals over wm by dwi = 4 (wo·wm) dwm.
    let over_normals = |f: &dyn Fn(Local) -> f64| {
        integrate_lobe_cells(width, |wm| 4.0 * view.dot(wm).max(0.0) * f(reflected(wm)))
    };
    let mut probabilities = over_normals(&|wi| f64::from(material.pdf(wi, wo)));
    let specular_only = Dichromatic {
        rho_d: Vec3::ZERO,
        ..*material
    };
    let albedo: f64 = f64::from(material.rho_d.x)
        + over_normals(&|wi| f64::from(specular_only.eval(wi, wo).x * wi.0.z.max(0.0)))
            .iter()
            .sum::<f64>();

    // No sample: the lobe pointed below the surface.
    let above: f64 = probabilities.iter().sum();
    if above > 1.0 + 1e-4 {
        return Err(format!("the density integrates to {above}"));
    }
    probabilities.push((1.0 - above).max(0.0));
    let nothing = probabilities.len() - 1;
    let mut histogram = Histogram::new(probabilities, SAMPLES);
    let mut random = Random(seed);
    let (mut sum, mut squares) = (0.0, 0.0);
    for _ in 0..SAMPLES {
        let u_lobe = random.next_f32();
        let Some(sample) = material.sample(wo, u_lobe, random.next_point()) else {
            histogram.count(nothing);
            continue;
        };
        let pdf = material.pdf(sample.wi, wo);
        if (sample.pdf / pdf - 1.0).abs() > 1e-6 {
            return Err(format!("sample and pdf disagree: {} {pdf}", sample.pdf));
        }
        let weight = f64::from(sample.weight.x);
        sum += weight;
        squares += weight * weight;
        let wm = (sample.wi.0.as_dvec3() + view).normalize();
        histogram.count(lobe_cell(width, wm));
    }
    let n = SAMPLES as f64;
    let mean = sum / n;
    let sigma = ((squares / n - mean * mean).max(0.0) / n).sqrt();
    if (mean - albedo).abs() > 4.0 * sigma + 1e-5 * albedo {
        return Err(format!(
            "E[weight] = {mean} ± {sigma}, but the albedo is {albedo}"
        ));
    }
    histogram.p_value()
}

fn map(width: usize, height: usize, mut value: impl FnMut(usize) -> f32) -> RgbImage {
    let pixels = (0..width * height).map(|i| [value(i); 3]).collect();
    RgbImage {
        width,
        height,
        pixels,
    }
}

#[test]
fn probe_samples_match_pdf_chi2() {
    let mut random = Random(5);
    // Four decades at random; one texel at the equator's seam, in each polar row, or all there is.
    let maps = [
        (
            "random",
            map(16, 8, |_| 10f32.powf(4.0 * random.next_f32())),
        ),
        ("odd", map(7, 5, |i| 1.0 + (i % 11) as f32)),
        ("seam", map(16, 8, |i| f32::from(u8::from(i == 64)))),
        ("north", map(16, 8, |i| f32::from(u8::from(i == 3)))),
        ("south", map(16, 8, |i| f32::from(u8::from(i == 125)))),
        ("single", map(1, 1, |_| 3.0)),
        ("row", map(6, 1, |i| i as f32)),
        ("column", map(1, 6, |i| i as f32)),
    ];
    let turns = [
        (0.0, Mat3::IDENTITY),
        (0.9, Mat3::from_rotation_y(2.2)),
        (
            -2.0,
            Mat3::from_rotation_x(0.7) * Mat3::from_rotation_z(-1.1),
        ),
    ];
    let cases: Vec<_> = maps
        .iter()
        .flat_map(|map| turns.map(|turn| (map, turn)))
        .enumerate()
        .collect();
    let results = cases
        .into_par_iter()
        .map(|(case, ((name, image), (rotation, turn)))| {
            let name = format!("{name} rotation {rotation} turn {turn:?} seed {case}");
            (name, probe(image, rotation, turn, case as u64))
        })
        .collect();
    assert_family(results);
}

fn probe(image: &RgbImage, rotation: f64, turn: Mat3, seed: u64) -> Result<f64, Failure> {
    let (environment, _) = Environment::new(image.clone(), rotation).map_err(|e| e.to_string())?;
    let light = environment.turned(turn);
    let object_from_probe = (turn.transpose() * Mat3::from_rotation_y(rotation as f32)).as_dmat3();

    // Each texel in 2 × 4 parts, equal in φ and in θ: the bilinear look-up is smooth in each.
    let (columns, rows) = (2 * image.width, 4 * image.height);
    let edges: Vec<f64> = (0..=rows)
        .map(|row| (PI * row as f64 / rows as f64).cos())
        .collect();
    let direction = |cos: f64, phi: f64| {
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        object_from_probe * DVec3::new(sin * phi.sin(), cos, -sin * phi.cos())
    };
    let over_cells = |f: &dyn Fn(Vec3) -> f64| -> Vec<f64> {
        let integrand = |cos: f64, phi: f64| f(direction(cos, phi).as_vec3());
        let step = TAU / columns as f64;
        (0..rows * columns)
            .map(|cell| {
                let (row, column) = (cell / columns, (cell % columns) as f64);
                let low = DVec2::new(edges[row + 1], step * column);
                let high = DVec2::new(edges[row], step * (column + 1.0));
                integrate(
                    &integrand,
                    low,
                    high,
                    1e-7 * f64::from(environment.mean_radiance().x),
                )
            })
            .collect()
    };
    // Patches chosen by their light, then directions within them.
    let clusters = LightClusters::new(&environment, 16);
    let flux_of: Vec<f64> = (0..clusters.count())
        .map(|k| f64::from(clusters.patch(k).flux))
        .collect();
    let sum_of_flux: f64 = flux_of.iter().sum();
    let probe_from_object = object_from_probe.transpose().as_mat3();
    let pdf = |w: Vec3| {
        let (patch, density) = clusters.density(probe_from_object * w);
        flux_of[patch] / sum_of_flux * f64::from(density)
    };
    let density = over_cells(&pdf);
    let total: f64 = density.iter().sum();
    if (total - 1.0).abs() > 1e-4 {
        return Err(format!("the density integrates to {total}"));
    }
    let flux: f64 = over_cells(&|w| f64::from(light.radiance(Vec3::ZERO, w).x))
        .iter()
        .sum();
    let stated = 4.0 * PI * f64::from(environment.mean_radiance().x);
    if (stated / flux - 1.0).abs() > 1e-4 {
        return Err(format!("mean_radiance says {stated}, the look-up {flux}"));
    }

    // A sample may fall on the dark side of a cell that is lit at one edge; it is withheld.
    let mut probabilities = over_cells(&|w| {
        let lit = light.radiance(Vec3::ZERO, w) != Vec3::ZERO;
        pdf(w) * f64::from(u8::from(lit))
    });
    probabilities.push((total - probabilities.iter().sum::<f64>()).max(0.0));
    let withheld = probabilities.len() - 1;

    let mut histogram = Histogram::new(probabilities, SAMPLES);
    let mut random = Random(seed);
    let (mut sum, mut squares) = (0.0, 0.0);
    for _ in 0..SAMPLES {
        let mut rest = f64::from(random.next_point().x) * sum_of_flux;
        let chosen = flux_of.iter().position(|&flux| {
            rest -= flux;
            rest < 0.0
        });
        let patch = chosen.unwrap_or(flux_of.len() - 1);
        let direction = clusters.sample(patch, random.next_point(), random.next_point().x);
        let wi = object_from_probe.as_mat3() * direction;
        let arriving = light.radiance(Vec3::ZERO, wi);
        if arriving == Vec3::ZERO {
            histogram.count(withheld);
            continue;
        }
        let estimate = f64::from(arriving.x) / pdf(wi);
        sum += estimate;
        squares += estimate * estimate;
        let w = direction.as_dvec3();
        let row = edges.partition_point(|&edge| edge > w.y).clamp(1, rows) - 1;
        let phi = w.x.atan2(-w.z).rem_euclid(TAU) / TAU;
        let column = ((phi * columns as f64) as usize).min(columns - 1);
        histogram.count(row * columns + column);
    }
    let n = SAMPLES as f64;
    let mean = sum / n;
    let sigma = ((squares / n - mean * mean).max(0.0) / n).sqrt();
    if (mean - flux).abs() > 4.0 * sigma + 1e-5 * flux {
        return Err(format!(
            "E[L/pdf] = {mean} ± {sigma}, but the flux is {flux}"
        ));
    }
    histogram.p_value()
}

#[test]
fn the_variates_are_uniform_chi2() {
    // The harness's own variates, so that a failure above is the sampler's.
    let mut histogram = Histogram::new(vec![1.0 / 400.0; 400], SAMPLES);
    let mut random = Random(99);
    for _ in 0..SAMPLES {
        let p: Vec2 = random.next_point() * 20.0;
        histogram.count(p.y as usize * 20 + p.x as usize);
    }
    assert_family(vec![("seed 99".to_owned(), histogram.p_value())]);
}
