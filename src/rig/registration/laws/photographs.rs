//! Laws of the registration by photographs: where masks are missing, and inside the outline.

use super::stand::{Random, Rig};
use super::suzanne;
use crate::image::{Mask, RgbImage};
use crate::rig::registration::*;

/// A photograph of a mask's object: brighter than its surroundings, unevenly.
fn photograph(mask: &Mask, random: &mut Random) -> RgbImage {
    let mut noise: Vec<f64> = mask
        .pixels
        .iter()
        .map(|_| 0.02 * random.uniform())
        .collect();
    for (i, (value, &share)) in noise.iter_mut().zip(&mask.pixels).enumerate() {
        let (x, y) = ((i % mask.width) as f64, (i / mask.width) as f64);
        let object = 0.7 + 0.3 * (0.05 * x).sin() * (0.07 * y).cos();
        *value += 0.15 + (object - 0.15) * f64::from(share) / 255.0;
    }
    RgbImage {
        width: mask.width,
        height: mask.height,
        pixels: noise.into_iter().map(|v| [v as f32; 3]).collect(),
    }
}

#[test]
fn photographs_do_where_masks_are_missing() {
    let (rig, mut random) = suzanne(128, 12, 10);
    let masks = rig.masks(false);
    let observed: Vec<Observed> = masks
        .iter()
        .enumerate()
        .map(|(frame, mask)| {
            let photograph = photograph(mask, &mut random);
            let mask = (frame % 3 == 0).then_some((mask, MaskBorder::Coverage));
            Observed::new(mask, Some(&photograph))
        })
        .collect();
    let start = rig.off(&mut random, 2.0, 0.02);
    let found = rig
        .register_observed(&start, &observed, &Settings::default())
        .unwrap();
    let errors = rig.errors(&found.placement);
    assert!(
        errors.turn.length().to_degrees() < 0.1 && errors.most < 0.3,
        "{errors:?}"
    );
}

/// Photographs under a lamp at the camera's side, before a dark wall, with 1 % noise.
fn lit(rig: &Rig, random: &mut Random) -> Vec<RgbImage> {
    (0..rig.truth.angles.len())
        .map(|frame| {
            let mut image = rig.lit(frame);
            for pixel in &mut image.pixels {
                let noise = 0.02 * (random.uniform() - 0.5) as f32;
                *pixel = pixel.map(|c| c + noise);
            }
            image
        })
        .collect()
}

#[test]
fn photographs_alone_lead_back() {
    for seed in 14..16 {
        let (rig, mut random) = suzanne(128, 12, seed);
        let photographs = lit(&rig, &mut random);
        let observed: Vec<Observed> = photographs
            .iter()
            .map(|photograph| Observed::new(None, Some(photograph)))
            .collect();
        let start = rig.off(&mut random, 2.0, 0.02);
        let found = rig
            .register_observed(&start, &observed, &Settings::default())
            .unwrap();
        let errors = rig.errors(&found.placement);
        println!("{seed}: {errors:?} {:?}", found.sigma);
        assert!(
            errors.turn.length().to_degrees() < 0.1 && errors.axis < 0.1 && errors.rms < 0.3,
            "{seed}: {errors:?}"
        );
    }
}

#[test]
fn edges_inside_the_outline_are_found_and_agree() {
    let (rig, mut random) = suzanne(128, 12, 16);
    let (photographs, masks) = (lit(&rig, &mut random), rig.masks(false));
    let observed: Vec<Observed> = (photographs.iter().zip(&masks))
        .map(|(photograph, mask)| {
            Observed::new(Some((mask, MaskBorder::Coverage)), Some(photograph))
        })
        .collect();
    let start = rig.off(&mut random, 5.0, 0.05);
    let with = |inner| {
        let settings = Settings {
            inner,
            ..Settings::default()
        };
        rig.register_observed(&start, &observed, &settings).unwrap()
    };
    let (outline, edges) = (with(false), with(true));
    let points = |found: &Registered| -> usize {
        let seen = |f: &FrameAgreement| f.outline.iter().filter(|p| p.seen.is_some()).count();
        found.frames.iter().map(seen).sum()
    };
    let (of_outline, of_edges) = (points(&outline), points(&edges));
    let errors = rig.errors(&edges.placement);
    println!("{of_outline} {of_edges} points: {errors:?}");
    // A head hides little of itself: some hundred points more, which leave the pose where it is.
    assert!(of_edges > of_outline + 100);
    assert!(
        errors.turn.length().to_degrees() < 0.05 && errors.axis < 0.05 && errors.most < 0.3,
        "{errors:?}"
    );
}
