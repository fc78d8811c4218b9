//! Laws of the merge, on brackets whose radiance is known.

use rand_distr::{Distribution, Normal};
use rand_pcg::{Pcg64Mcg as Pcg64, rand_core::SeedableRng};

use super::*;

/// A camera of 8 bits: `v = round(255 · tone(clamp(t L + noise)))/255`.
pub(super) struct Camera {
    tone: fn(f64) -> f64,
    /// Electrons at white, and read noise in electrons.
    full_well: f64,
    read: f64,
}

fn srgb(x: f64) -> f64 {
    crate::image::srgb_encode(x)
}

/// sRGB and half of an S-curve over it, as cameras' picture styles have it.
pub(super) fn film(x: f64) -> f64 {
    let v = srgb(x);
    0.5 * v + 0.5 * v * v * (3.0 - 2.0 * v)
}

fn gamma(x: f64) -> f64 {
    x.powf(1.0 / 1.8)
}

pub(super) const CAMERA: Camera = Camera {
    tone: film,
    full_well: 30_000.0,
    read: 5.0,
};

/// Smooth and with lamps, radiance from 1e-3 to 1e3, colours apart.
pub(super) fn scene(width: usize, height: usize) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let (u, v) = (x as f64 / width as f64, y as f64 / height as f64);
        let level = 6.0 * u - 3.0 + 0.3 * (9.0 * v).sin() + 0.2 * (31.0 * u * v).cos();
        let lamp = if (x / 8 + y / 8) % 29 == 0 { 1.0 } else { 0.0 };
        let base = 10f64.powf((level + lamp).min(3.0));
        [1.0, 0.8 + 0.1 * v, 0.6 + 0.3 * u].map(|tint| (base * tint) as f32)
    })
}

pub(super) fn expose(radiance: &RgbImage, exposure: f64, camera: &Camera, seed: u64) -> RgbImage {
    let mut random = Pcg64::seed_from_u64(seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let pixels = radiance
        .pixels
        .iter()
        .map(|p| {
            p.map(|l| {
                let x = exposure * f64::from(l);
                let electrons = camera.full_well * x;
                let sigma = (electrons + camera.read * camera.read).sqrt() / camera.full_well;
                let noisy = (x + sigma * normal.sample(&mut random)).clamp(0.0, 1.0);
                ((255.0 * (camera.tone)(noisy)).round() / 255.0) as f32
            })
        })
        .collect();
    RgbImage {
        width: radiance.width,
        height: radiance.height,
        pixels,
    }
}

/// Eleven exposures, 1.4 stops apart, from 1/2000 s on.
pub(super) fn exposures() -> Vec<f64> {
    (0..11)
        .map(|j| 2f64.powf(1.4 * f64::from(j)) / 2000.0)
        .collect()
}

fn frames(
    radiance: &RgbImage,
    true_exposures: &[f64],
    claimed: &[f64],
    camera: &Camera,
) -> Vec<Frame> {
    (true_exposures.iter().zip(claimed).enumerate())
        .map(|(j, (&t, &claim))| Frame {
            name: format!("{j:02}.png").into(),
            samples: expose(radiance, t, camera, 1000 + j as u64),
            depth: Depth::Bits8,
            exposure: claim,
        })
        .collect()
}

/// Median relative error over unclipped texels, with the scale that the middle level fixes.
fn median_error(merged: &Merged, truth: &RgbImage, scale: f64) -> f64 {
    let mut errors = Vec::new();
    for (i, (a, b)) in merged.radiance.pixels.iter().zip(&truth.pixels).enumerate() {
        if merged.clipped.pixels[i] == 0 {
            errors.extend((0..3).map(|c| (f64::from(a[c] / b[c]) / scale - 1.0).abs()));
        }
    }
    times::median(&mut errors).unwrap()
}

/// What radiance 1 becomes: the middle level means sRGB's 0.216.
pub(super) fn scale_of(tone: fn(f64) -> f64) -> f64 {
    let v = 128.0 / 255.0;
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let x = 0.5 * (low + high);
        if tone(x) < v { low = x } else { high = x }
    }
    crate::image::srgb_decode(v) / low
}

#[test]
fn responses_of_many_shapes_are_recovered() {
    let truth = scene(256, 128);
    for tone in [film as fn(f64) -> f64, srgb, gamma] {
        for curve in [Curve::Auto, Curve::Robertson] {
            let camera = Camera { tone, ..CAMERA };
            let settings = MergeSettings {
                curve,
                ..MergeSettings::default()
            };
            let merged = merge(
                frames(&truth, &exposures(), &exposures(), &camera),
                &settings,
            )
            .unwrap();
            assert!(!merged.linear);
            let error = median_error(&merged, &truth, scale_of(tone));
            println!(
                "{:?} median error {error:.4} {:?}",
                settings.curve, merged.noise
            );
            assert!(error < 0.01, "{:?} {error}", settings.curve);
        }
    }
}

#[test]
fn the_range_is_kept_and_clipped_texels_are_found() {
    // The brightest texels saturate at the shortest exposure: 1/2000 · 1000 · 4.
    let mut truth = scene(256, 128);
    truth
        .pixels
        .iter_mut()
        .for_each(|p| *p = p.map(|c| 4.0 * c));
    let t = exposures();
    let merged = merge(frames(&truth, &t, &t, &CAMERA), &MergeSettings::default()).unwrap();
    let (mut clipped, mut found, mut open, mut wrong) = (0, 0, 0, 0);
    for (p, &mask) in truth.pixels.iter().zip(&merged.clipped.pixels) {
        let brightest = p.iter().fold(0.0f64, |a, &c| a.max(f64::from(c))) * t[0];
        if brightest >= 1.0 {
            clipped += 1;
            found += usize::from(mask != 0);
        } else if brightest < 0.9 {
            open += 1;
            wrong += usize::from(mask != 0);
        }
    }
    println!("clipped {clipped} found {found}; open {open} wrong {wrong}");
    assert!(clipped > 500 && found * 100 >= clipped * 99);
    assert!(wrong * 1000 <= open);
    // Every channel's range, from the darkest hundredth to the brightest.
    let mut values: Vec<f64> = merged
        .radiance
        .pixels
        .iter()
        .map(|p| f64::from(p[1]))
        .collect();
    values.sort_unstable_by(f64::total_cmp);
    let range = values[values.len() - 1] / values[values.len() / 100];
    let mut true_values: Vec<f64> = truth.pixels.iter().map(|p| f64::from(p[1])).collect();
    true_values.sort_unstable_by(f64::total_cmp);
    println!("range {range:.3e}");
    assert!(range > 1e5, "{range}");
}

#[test]
fn wrong_times_are_refined() {
    let truth = scene(256, 128);
    let t = exposures();
    // EXIF that rounds: up to 10 % off, alternately.
    let claimed: Vec<f64> = (0..11)
        .map(|j| t[j] * [1.0, 1.06, 0.94, 1.1][j % 4])
        .collect();
    let camera = Camera {
        tone: |x| x,
        ..CAMERA
    };
    for settings in [
        MergeSettings {
            curve: Curve::Linear,
            ..MergeSettings::default()
        },
        MergeSettings::default(),
    ] {
        let merged = merge(frames(&truth, &t, &claimed, &camera), &settings).unwrap();
        assert!(merged.linear);
        let mean: f64 = (0..11).map(|j| (claimed[j] / t[j]).ln()).sum::<f64>() / 11.0;
        for (record, t) in merged.frames.iter().zip(&t) {
            assert!(record.overlaps);
            let off = (record.exposure / t).ln() - mean;
            assert!(off.abs() < 0.01, "{record:?} {off}");
        }
        let error = median_error(&merged, &truth, (-mean).exp());
        assert!(error < 0.01, "{error}");
    }
}

#[test]
fn what_moved_is_left_out() {
    let truth = scene(256, 128);
    let t = exposures();
    let mut bracket = frames(&truth, &t, &t, &CAMERA);
    // Someone walks through one frame.
    for y in 40..80 {
        for x in 100..140 {
            let shade = (x - 100) as f32 / 100.0 + (y - 40) as f32 / 200.0;
            bracket[5].samples.pixels[y * 256 + x] = [0.35, 0.6, 0.2].map(|c: f32| c - 0.2 + shade);
        }
    }
    let merged = merge(bracket, &MergeSettings::default()).unwrap();
    let scale = scale_of(film);
    let inside = || (40..80).flat_map(|y| (100..140).map(move |x| y * 256 + x));
    let mut errors: Vec<f64> = inside()
        .map(|i| (f64::from(merged.radiance.pixels[i][1] / truth.pixels[i][1]) / scale - 1.0).abs())
        .collect();
    let found = inside().filter(|&i| merged.ghosts.pixels[i] != 0).count();
    let outside = merged.ghosts.pixels.iter().filter(|&&g| g != 0).count() - found;
    let error = times::median(&mut errors).unwrap();
    println!("{:?}", merged.noise);
    println!("found {found} of 1600, elsewhere {outside}; median error there {error:.4}");
    assert!(found > 1500 && outside < 312 && error < 0.02);
}

#[test]
fn variance_tells_the_error() {
    let truth = scene(256, 128);
    let t = exposures();
    let camera = Camera {
        tone: |x| x,
        full_well: 2000.0,
        read: 5.0,
    };
    let settings = MergeSettings {
        curve: Curve::Linear,
        ..MergeSettings::default()
    };
    let merged = merge(frames(&truth, &t, &t, &camera), &settings).unwrap();
    let mut z: Vec<f64> = Vec::new();
    for (i, p) in truth.pixels.iter().enumerate() {
        if merged.clipped.pixels[i] == 0 {
            let error = merged.radiance.pixels[i][1] - p[1];
            z.push(f64::from(error / merged.variance.pixels[i][1].sqrt()).abs());
        }
    }
    let median = times::median(&mut z).unwrap();
    println!("{:?}", merged.noise);
    println!("median |error|/sigma {median:.3} (0.674 would be perfect)");
    assert!((0.4..0.9).contains(&median), "{median}");
}

#[test]
fn threads_do_not_change_a_bit() {
    let truth = scene(128, 64);
    let t = exposures();
    let bracket = frames(&truth, &t, &t, &CAMERA);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| merge(bracket.clone(), &MergeSettings::default()).unwrap())
    };
    let (one, three) = (run(1), run(3));
    assert_eq!(one.radiance, three.radiance);
    assert_eq!(one.clipped, three.clipped);
    assert_eq!(one.frames, three.frames);
}

#[test]
fn bad_brackets_are_refused_by_name() {
    let truth = scene(24, 12);
    let good = || frames(&truth, &[0.01, 0.1], &[0.01, 0.1], &CAMERA);
    let error = |frames: Vec<Frame>| {
        merge(frames, &MergeSettings::default())
            .unwrap_err()
            .to_string()
    };
    let mut one = good();
    one.pop();
    assert!(error(one).contains("at least 2"));
    assert!(error(Vec::new()).contains("at least 2"));
    let mut mixed = good();
    mixed[1].samples = scene(12, 12);
    assert!(error(mixed).starts_with("01.png: size = 12 × 12"));
    let mut wrong = good();
    wrong[1].exposure = -1.0;
    assert!(error(wrong).starts_with("01.png: exposure = -1"));
    let mut same = good();
    same[1].exposure = 0.01;
    assert!(error(same).contains("different"));
    let mut nan = good();
    nan[0].samples.pixels[30] = [f32::NAN; 3];
    assert!(error(nan).starts_with("00.png: pixel (6, 1)"));
    let mut kinds = good();
    kinds[1].depth = Depth::Float;
    assert!(error(kinds).contains("samples"));
}

#[test]
fn response_files_are_read_back_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("response.csv");
    let response = Response::srgb();
    std::fs::write(&path, response.to_csv()).unwrap();
    assert_eq!(Response::read_csv(&path).unwrap(), response);
    for text in [
        "",
        "0,1,2\n",
        "0,0,0,nan\n",
        "1,0,0,0\n",
        "0,1,1,1\n1,0,0,0\n",
    ] {
        std::fs::write(&path, text).unwrap();
        let error = Response::read_csv(&path).unwrap_err().to_string();
        assert!(error.contains("response.csv"), "{error}");
    }
}
