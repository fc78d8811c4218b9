//! Pooled points are as accurate as their data together, and materials are found.

use glam::Vec3;
use rayon::prelude::*;

use super::super::full;
use super::super::model_choice::Shares;
use super::super::noise::NoiseModel;
use super::super::turntable::{Material, Point, TURNTABLES};
use super::super::{Estimate, FitSettings, Pooling};
use super::{PointProfile, pool};
use crate::brdf::Ndf;

const NOISE: f32 = 0.01;

/// Noise without tails, as it is measured of these points.
fn pure() -> NoiseModel {
    let residuals: Vec<Vec3> = (0..64)
        .map(|i| {
            Vec3::from([1.0, 2.0, 3.0].map(|k: f32| 1.2 * (k * i as f32 * 0.7 + k).sin() * 1.1))
        })
        .collect();
    let noise = NoiseModel::of_residuals(&residuals, true);
    assert!(noise.is_normal());
    noise
}

fn single(points: &[Point], settings: &FitSettings) -> (Vec<Option<PointProfile>>, Vec<Estimate>) {
    let noise = pure();
    let models = settings.models();
    let candidates: Vec<_> = points
        .par_iter()
        .map(|point| full::estimate(&point.trace, &point.columns, &settings.models(), &noise))
        .collect();
    let shares = Shares::of(&models, candidates.iter().map(Vec::as_slice));
    let estimates = candidates.iter().map(|c| shares.choose(c).estimate);
    let profiles = candidates.iter().map(|candidates| {
        let tables: Vec<_> = candidates
            .iter()
            .filter_map(|c| Some((c.table.as_ref()?, &c.estimate, c.ln_likelihood)))
            .collect();
        (tables.len() == models.len()).then(|| PointProfile::new(tables.into_iter()))
    });
    (profiles.collect(), estimates.collect())
}

/// Fits points and pools them.
fn pooled(
    points: &[Point],
    pooling: Pooling,
    neighbours: &[Vec<u32>],
) -> (Option<u32>, Vec<Estimate>) {
    let settings = FitSettings {
        pool: pooling,
        ..FitSettings::default()
    };
    let (profiles, mut estimates) = single(points, &settings);
    let materials = pool(
        pooling,
        &settings.models(),
        &profiles,
        neighbours,
        &mut estimates,
    );
    (materials, estimates)
}

fn error(estimate: &Estimate, alpha: f32) -> f64 {
    f64::from(estimate.alpha / alpha).ln()
}

#[test]
fn pooled_errors_fall_with_the_root_of_the_count() {
    let material = Material::plastic(Ndf::Ggx, 0.2);
    // A point well lit, seen over and over with noise of its own.
    let normal = Vec3::new(0.6, 0.3, 0.74).normalize();
    let point = TURNTABLES[0].point_with_normal(normal, 0, &material, NOISE);
    let errors = |count: u64, groups: u64| -> Vec<f64> {
        (0..groups)
            .map(|group| {
                let points: Vec<Point> = (0..count)
                    .map(|k| point.again(1000 * group + k, NOISE))
                    .collect();
                let (_, estimates) = pooled(&points, Pooling::Object, &[]);
                error(&estimates[0], 0.2)
            })
            .collect()
    };
    let rms = |errors: &[f64]| {
        let sum: f64 = errors.iter().map(|e| e * e).sum();
        (sum / errors.len() as f64).sqrt()
    };
    let one = rms(&errors(1, 600));
    for (count, groups) in [(4, 300), (16, 200), (100, 150)] {
        let errors = errors(count, groups);
        let ratio = rms(&errors) * (count as f64).sqrt() / one;
        let mean = errors.iter().sum::<f64>() / groups as f64;
        println!("{count}: {ratio:.3} of {one:.4}, mean error {mean:+.5}");
        // 150 groups leave 6 % of doubt.
        assert!((0.8..1.2).contains(&ratio), "{count}: {ratio}");
    }
}

#[test]
fn pooled_error_bars_are_the_errors() {
    // Groups of different points under every probe.
    let mut squares = Vec::new();
    for (probe, turntable) in TURNTABLES.iter().enumerate() {
        for (ndf, alpha) in [(Ndf::Ggx, 0.1), (Ndf::Beckmann, 0.3)] {
            let material = Material::plastic(ndf, alpha);
            for group in 0..12u32 {
                let points: Vec<Point> = (0..40)
                    .into_par_iter()
                    .map(|k| {
                        turntable.point(1000 * group + 97 * k + probe as u32, &material, NOISE)
                    })
                    .collect();
                let (_, estimates) = pooled(&points, Pooling::Object, &[]);
                let estimate = estimates.iter().find(|e| e.frames > 8).unwrap();
                assert_eq!(estimate.ndf, ndf);
                squares.push(
                    (error(estimate, alpha) * f64::from(estimate.alpha / estimate.sigma_alpha))
                        .powi(2),
                );
            }
        }
    }
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    println!("z² of {} groups: {mean:.3}", squares.len());
    // χ² of 96 has a deviation of 0.14.
    assert!((0.6..1.4).contains(&mean), "{mean}");
}

/// A sheet of points over a sphere's northern half, left and right of another material, and each one's
/// four neighbours.
fn sheet(side: u32, materials: [Material; 2]) -> (Vec<Point>, Vec<Vec<u32>>, Vec<u32>) {
    let place = |i: u32| (i % side, i / side);
    let label = |i: u32| u32::from(place(i).0 >= side / 2);
    let points = (0..side * side)
        .into_par_iter()
        .map(|i| {
            let (x, y) = place(i);
            let (u, v) = (x as f32 / side as f32, (y as f32 + 0.5) / side as f32);
            let (sin, cos) = (std::f32::consts::TAU * u).sin_cos();
            let height = 1.4 * v - 0.6;
            let around = (1.0 - height * height).sqrt();
            let normal = Vec3::new(around * cos, height, around * sin);
            let material = &materials[label(i) as usize];
            TURNTABLES[1].point_with_normal(normal, u64::from(i), material, NOISE)
        })
        .collect();
    let neighbours = (0..side * side)
        .map(|i| {
            let (x, y) = place(i);
            let mut all = vec![y * side + (x + 1) % side, y * side + (x + side - 1) % side];
            all.extend((y > 0).then(|| i - side));
            all.extend((y + 1 < side).then(|| i + side));
            all
        })
        .collect();
    (points, neighbours, (0..side * side).map(label).collect())
}

#[test]
fn two_materials_are_found_and_told_apart() {
    for materials in [
        [
            Material::plastic(Ndf::Ggx, 0.1),
            Material::plastic(Ndf::Ggx, 0.3),
        ],
        [
            Material::plastic(Ndf::Beckmann, 0.2),
            Material::neutral(Ndf::Beckmann, 0.2, 10.0),
        ],
    ] {
        let (points, neighbours, labels) = sheet(30, materials);
        let (count, estimates) = pooled(&points, Pooling::Material, &neighbours);
        println!("{count:?} materials");
        assert_eq!(count, Some(2));
        let told: Vec<bool> = estimates
            .iter()
            .zip(&labels)
            .filter_map(|(e, label)| Some(e.material? == *label))
            .collect();
        let right = told.iter().filter(|&&t| t).count() as f64 / told.len() as f64;
        let right = right.max(1.0 - right);
        println!("{:.4} of {} points told right", right, told.len());
        assert!(right >= 0.97, "{right}");
        for (estimate, label) in estimates.iter().zip(&labels) {
            let truth = &materials[*label as usize];
            if estimate.material.is_some() && right == 1.0 {
                assert!(error(estimate, truth.alpha).abs() < 0.03, "{estimate:?}");
            }
        }
    }
}

#[test]
fn one_material_stays_one() {
    let material = Material::plastic(Ndf::Ggx, 0.2);
    let (points, neighbours, _) = sheet(24, [material; 2]);
    let (count, _) = pooled(&points, Pooling::Material, &neighbours);
    assert_eq!(count, Some(1));
}

#[test]
fn neighbours_help_within_a_material_and_not_across_its_edge() {
    let materials = [
        Material::plastic(Ndf::Ggx, 0.1),
        Material::plastic(Ndf::Ggx, 0.3),
    ];
    let (points, neighbours, labels) = sheet(30, materials);
    let (_, alone) = pooled(&points, Pooling::None, &neighbours);
    let (_, smooth) = pooled(&points, Pooling::Smooth, &neighbours);
    let median = |estimates: &[Estimate], edge: bool| {
        let mut errors: Vec<f64> = (0..estimates.len())
            .filter(|&i| {
                let (x, at) = (i % 30, |x: usize| {
                    (13..=16).contains(&x) || !(2..=27).contains(&x)
                });
                estimates[i].frames > 8 && at(x) == edge
            })
            .map(|i| error(&estimates[i], materials[labels[i] as usize].alpha).abs())
            .collect();
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    };
    for edge in [false, true] {
        let (before, after) = (median(&alone, edge), median(&smooth, edge));
        println!("edge {edge}: {before:.4} alone, {after:.4} with neighbours");
        assert!(after < 0.5 * before, "{before} {after}");
    }
}
