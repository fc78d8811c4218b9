//! The Fresnel term is told by the evidence: metals by Schlick's, dielectrics by theirs, on points of a
//! turning object with independent sensor noise of 1 %.

use glam::Vec3;
use rayon::prelude::*;

use super::fresnel_model::{FresnelModel, PAPER_ETA};
use super::full;
use super::lobe_form::LobeForm;
use super::model_choice::Shares;
use super::noise::NoiseModel;
use super::problem::Model;
use super::turntable::{Material, Point, TURNTABLES};
use super::{Estimate, FitSettings, Status, refraction};
use crate::brdf::Ndf;

const ALPHAS: [f32; 3] = [0.05, 0.1, 0.3];

/// Fits points of a kind of material at every roughness, under every probe and both NDFs, all as one
/// object.
fn fitted(
    material: impl Fn(Ndf, f32) -> Material + Sync,
    settings: &FitSettings,
) -> Vec<(Material, Estimate)> {
    let noise = NoiseModel::independent(true);
    let fit = |(truth, point): &(Material, Point), models: &[Model]| {
        let columns = match settings.fresnel {
            FresnelModel::Dielectric { .. } => &point.own_columns,
            FresnelModel::Auto | FresnelModel::Schlick => &point.columns,
        };
        let candidates = full::estimate(&point.trace, columns, models, &noise);
        (*truth, candidates)
    };
    let points: Vec<_> = (0..480u32)
        .into_par_iter()
        .map(|i| {
            let alpha = ALPHAS[i as usize % 3];
            let truth = material(Ndf::ALL[(i / 3) as usize % 2], alpha);
            let point = TURNTABLES[(i / 6) as usize % 4].point(i, &truth, 0.01);
            (truth, point)
        })
        .collect();
    // As `fit` does: the index between those tried is told by some of the points.
    let models = settings.models();
    let first: Vec<_> = points
        .par_iter()
        .step_by(4)
        .map(|p| fit(p, &models))
        .collect();
    let further = refraction::between(&models, first.iter().map(|p| p.1.as_slice()));
    let models = Model::with_dielectrics(&models, &further);
    let points: Vec<_> = points.par_iter().map(|p| fit(p, &models)).collect();
    let shares = Shares::of(&models, points.iter().map(|p| p.1.as_slice()));
    points
        .into_iter()
        .map(|(truth, candidates)| (truth, shares.choose(&candidates).estimate))
        .filter(|(_, estimate)| estimate.status == Status::Converged)
        .collect()
}

fn with_fresnel(fresnel: FresnelModel) -> FitSettings {
    FitSettings {
        fresnel,
        ..FitSettings::default()
    }
}

fn median(mut values: Vec<f32>) -> f32 {
    values.sort_by(f32::total_cmp);
    values[values.len() / 2]
}

#[test]
fn metals_are_told_by_their_evidence_and_measured() {
    // Reflectance at normal incidence of gold, aluminium and copper, near enough.
    for f0 in [[1.0, 0.78, 0.34], [0.91, 0.92, 0.92], [0.95, 0.64, 0.54]] {
        let metal = |ndf, alpha| Material {
            ndf,
            alpha,
            rho_d: Vec3::ZERO,
            lobe: [f0[0], f0[1], f0[2], 1.0],
            form: LobeForm::Schlick,
            eta: PAPER_ETA,
        };
        let all = fitted(metal, &with_fresnel(FresnelModel::Auto));
        let schlick: Vec<_> = all.iter().filter(|(_, e)| e.f90.is_some()).collect();
        let share = schlick.len() as f32 / all.len() as f32;
        let alpha = median(schlick.iter().map(|(t, e)| e.alpha / t.alpha).collect());
        println!("{f0:?}: {share:.4} of {}, alpha {alpha:.4}", all.len());
        assert!(all.len() > 300 && share >= 0.95, "{share} of {}", all.len());
        assert!((alpha - 1.0).abs() < 0.03, "{alpha}");
        for (c, f0) in f0.into_iter().enumerate() {
            let ratios = schlick.iter().map(|(_, e)| e.rho_s[c] / f0 as f32);
            let ratio = median(ratios.collect());
            assert!((ratio - 1.0).abs() < 0.03, "channel {c}: {ratio}");
        }
    }
}

#[test]
fn dielectrics_are_not_harmed_by_the_choice() {
    // As nature has them, and the paper's plastic; 1.45 and 1.65 are none of the indices to choose from.
    let mut harmed = Vec::new();
    for (eta, rho_s) in [
        (1.3, 2.35),
        (1.4, 1.0),
        (1.45, 1.0),
        (1.5, 1.0),
        (1.65, 1.0),
        (1.8, 1.0),
    ] {
        let material = |ndf, alpha| Material {
            eta,
            ..Material::neutral(ndf, alpha, rho_s)
        };
        let error = |fresnel| {
            let all = fitted(material, &with_fresnel(fresnel));
            let share = |is: &dyn Fn(&Estimate) -> bool| {
                all.iter().filter(|(_, e)| is(e)).count() as f32 / all.len() as f32
            };
            let errors = all.iter().map(|(t, e)| (e.alpha / t.alpha).ln().abs());
            let biases = all.iter().map(|(t, e)| (e.alpha / t.alpha).ln());
            let mut indices: Vec<f32> = all.iter().filter_map(|(_, e)| e.eta).collect();
            indices.sort_by(f32::total_cmp);
            let indices: Vec<_> = (indices.chunk_by(|a, b| a == b))
                .map(|same| (same[0], same.len()))
                .collect();
            let schlick = share(&|e| e.f90.is_some());
            println!(
                "  indices {indices:?} Schlick {schlick:.3}, bias {:+.4}",
                median(biases.collect())
            );
            (median(errors.collect()), schlick, all.len())
        };
        let (told, _, points) = error(FresnelModel::Dielectric { eta });
        let (free, schlick, converged) = error(FresnelModel::Auto);
        println!(
            "index {eta}: {points} points, told {told:.4}; by evidence {free:.4}, {schlick:.4} of {converged} Schlick"
        );
        if free > 1.1 * told || (converged as f32) < 0.95 * points as f32 {
            harmed.push(eta);
        }
    }
    assert!(harmed.is_empty(), "indices {harmed:?}");
}

#[test]
fn a_tint_is_told_by_the_evidence() {
    let settings = FitSettings {
        specular: super::SpecularColour::Auto,
        ..FitSettings::default()
    };
    let tinted = |ndf, alpha| Material {
        lobe: [4.0, 2.5, 1.5, 0.0],
        form: LobeForm::Rgb,
        ..Material::plastic(ndf, alpha)
    };
    let is_tinted = |e: &Estimate| e.rho_s.x != e.rho_s.y;
    let all = fitted(tinted, &settings);
    let right = all.iter().filter(|(_, e)| is_tinted(e)).count();
    println!("tinted: {right} of {}", all.len());
    assert!(20 * right >= 19 * all.len());
    let all = fitted(Material::plastic, &settings);
    let wrong = all.iter().filter(|(_, e)| is_tinted(e)).count();
    println!("neutral: {wrong} of {} tinted", all.len());
    assert!(20 * wrong <= all.len());
}
