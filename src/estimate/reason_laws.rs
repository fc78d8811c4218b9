//! Every reason for which a roughness cannot be told is given for a trace made to have it.

use glam::Vec3;

use super::full;
use super::model_choice::Shares;
use super::noise::NoiseModel;
use super::turntable::{Material, Point, TURNTABLES, Turntable};
use super::{Estimate, FitSettings, Reason, Status};
use crate::brdf::Ndf;
use crate::image::RgbImage;

const NOISE: f32 = 0.01;

fn estimate(point: &Point) -> Estimate {
    let settings = FitSettings::default();
    let noise = NoiseModel::independent(true);
    let candidates = full::estimate(&point.trace, &point.columns, &settings.models(), &noise);
    Shares::even(&settings.models())
        .choose(&candidates)
        .estimate
}

/// A point of the equator, which shows its highlight to the camera.
fn well_lit(material: &Material) -> Point {
    let normal = Vec3::new(0.6, 0.3, 0.74).normalize();
    TURNTABLES[0].point_with_normal(normal, 1, material, NOISE)
}

fn reasons(points: impl Iterator<Item = Point>) -> Vec<Reason> {
    points
        .map(|point| {
            let estimate = estimate(&point);
            if estimate.reason != Reason::None {
                let matters = [Status::Unidentifiable, Status::TooFewSamples];
                assert!(matters.contains(&estimate.status), "{estimate:?}");
            }
            estimate.reason
        })
        .collect()
}

#[test]
fn a_well_lit_lobe_needs_no_reason() {
    let estimate = estimate(&well_lit(&Material::plastic(Ndf::Ggx, 0.2)));
    assert_eq!(estimate.reason, Reason::None, "{estimate:?}");
    assert_eq!(estimate.status, Status::Converged);
}

#[test]
fn few_frames_are_named() {
    let mut point = well_lit(&Material::plastic(Ndf::Ggx, 0.2));
    for frames in [1, 2, 3] {
        let mut few = point.again(3, 0.3);
        few.trace.observations.truncate(frames);
        assert_eq!(estimate(&few).reason, Reason::TooFewFrames, "{frames}");
    }
    point.trace.observations.truncate(1);
    assert_eq!(estimate(&point).status, Status::TooFewSamples);
}

#[test]
fn a_matte_surface_has_its_lobe_below_noise() {
    let matte = Material::neutral(Ndf::Ggx, 0.2, 0.0);
    let point = well_lit(&matte);
    let found = reasons((0..20).map(|seed| point.again(seed, NOISE)));
    let named = found
        .iter()
        .filter(|&&r| r == Reason::LobeBelowNoise)
        .count();
    println!("{found:?}");
    assert!(named >= 16, "{found:?}");
}

#[test]
fn the_pole_of_the_axis_sees_the_same_in_every_frame() {
    // Its normal does not turn: lobe and diffuse answer are constant, and so multiples of each other.
    let material = Material::plastic(Ndf::Ggx, 0.2);
    let point = TURNTABLES[0].point_with_normal(Vec3::Y, 1, &material, NOISE);
    assert_eq!(point.trace.observations.len(), 72);
    let found = reasons((0..20).map(|seed| point.again(seed, NOISE)));
    println!("{found:?}");
    let named = found.iter().filter(|&&r| r == Reason::Collinear).count();
    assert!(named >= 16, "{found:?}");
}

#[test]
fn a_lamp_that_is_never_mirrored_is_no_highlight() {
    // One small lamp at the zenith, and a point that faces down: only the sky's last glimmer is seen.
    let mut pixels = vec![[1e-3; 3]; 128 * 64];
    pixels[..4 * 128].fill([100.0; 3]);
    let lamp = RgbImage {
        width: 128,
        height: 64,
        pixels,
    };
    let turntable = Turntable::under(lamp, 72);
    let material = Material::plastic(Ndf::Beckmann, 0.1);
    let point =
        turntable.point_with_normal(Vec3::new(0.98, -0.1, 0.0).normalize(), 1, &material, 0.3);
    let found = reasons((0..20).map(|seed| point.again(seed, 0.3)));
    println!("{found:?}");
    let named = found.iter().filter(|&&r| r == Reason::NoHighlight).count();
    assert!(named >= 16, "{found:?}");
}

#[test]
fn strong_noise_leaves_the_width_open_or_two_minima() {
    // Lobes that are seen, in noise that leaves their width open.
    let mut counts = [0; Reason::ALL.len()];
    for (alpha, noise) in [(0.3, 0.1), (0.5, 0.1), (0.5, 0.15), (0.3, 0.15)] {
        let point = well_lit(&Material::plastic(Ndf::Ggx, alpha));
        for seed in 0..100 {
            let estimate = estimate(&point.again(seed, noise));
            counts[estimate.reason as usize] += 1;
            if estimate.reason == Reason::TwoMinima {
                assert!(estimate.sigma_alpha > 0.5 * estimate.alpha, "{estimate:?}");
            }
            if estimate.second_evidence.is_finite() {
                assert!(estimate.second_alpha > 0.0 && estimate.second_evidence <= 1e-6);
            }
        }
    }
    println!("{counts:?}");
    assert!(
        counts[Reason::WidthUndetermined as usize] >= 5,
        "{counts:?}"
    );
    assert!(counts[Reason::TwoMinima as usize] >= 5, "{counts:?}");
}
