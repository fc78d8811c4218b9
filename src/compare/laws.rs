//! Laws of the errors.

use std::{fs, path::Path};

use proptest::prelude::*;

use super::*;
use crate::image::{Mask, RgbImage, ToneCurve, write_exr};

/// Two images that Python makes too: `n / 127` and that plus `k / 100`, float32, not below 0.
fn synthetic() -> (RgbImage, RgbImage) {
    let level = |x, y, c| ((x * 5 + y * 3 + c * 40) % 128) as f32 / 127.0;
    let change = |x, y, c| (((x * 7 + y * 13 + c * 29) % 17) as f32 - 8.0) / 100.0;
    let reference = RgbImage::from_fn(48, 40, |x, y| std::array::from_fn(|c| level(x, y, c)));
    let test = RgbImage::from_fn(48, 40, |x, y| {
        std::array::from_fn(|c| (level(x, y, c) + change(x, y, c)).max(0.0))
    });
    (reference, test)
}

/// A disc of radius 14 around (20, 18) in 48 × 40.
fn disc() -> Mask {
    let covered = |i: usize| (i % 48).abs_diff(20).pow(2) + (i / 48).abs_diff(18).pow(2) < 196;
    Mask {
        width: 48,
        height: 40,
        pixels: (0..48 * 40).map(|i| 255 * u8::from(covered(i))).collect(),
    }
}

fn close(value: f64, expected: f64, tolerance: f64) {
    assert!(
        (value - expected).abs() <= tolerance * expected.abs(),
        "{value} is not {expected}"
    );
}

#[test]
fn errors_agree_with_scikit_image_and_nvidia_flip() {
    // scikit-image 0.26.0: structural_similarity(gaussian_weights=True, sigma=1.5,
    // use_sample_covariance=False, data_range=1) of Rec. 709 luma,
    // peak_signal_noise_ratio(data_range=1), of sRGB-encoded clip(x, 0, 1); NVIDIA's
    // flip-evaluator, evaluate(…, "LDR"), which computes in float32; the rest numpy 2.4.6.
    let (reference, test) = synthetic();
    let errors = compare_at_exposure(&reference, &test, None, ToneCurve::default()).unwrap();
    close(errors.psnr_db, 24.994_019_267_968_22, 1e-9);
    close(errors.ssim.unwrap(), 0.908_804_803_162_983_1, 1e-9);
    close(errors.flip, 0.045_551_884_919, 2e-4);
    close(errors.rmse, 0.048_427_052_016, 1e-6);
    close(errors.rel_mse, 0.030_769_692_669, 1e-6);
    close(errors.mae, 0.041_670_819_427, 1e-6);
    close(errors.mean_ratio, 1.001_394_710_087, 1e-6);
}

#[test]
fn equal_images_have_no_error() {
    let (image, _) = synthetic();
    for mask in [None, Some(&disc())] {
        let errors = compare_images(&image, &image, mask).unwrap();
        assert_eq!(
            (errors.rmse, errors.mae, errors.rel_mse, errors.flip),
            (0.0, 0.0, 0.0, 0.0)
        );
        assert_eq!((errors.mean_ratio, errors.psnr_db), (1.0, f64::INFINITY));
        close(errors.ssim.unwrap(), 1.0, 1e-12);
        assert!(
            serde_json::to_string(&errors)
                .unwrap()
                .contains("\"psnr_db\":null")
        );
    }
}

#[test]
fn black_images_are_equal() {
    let image = RgbImage::constant(20, 20, [0.0; 3]);
    let errors = compare_images(&image, &image, None).unwrap();
    assert_eq!(
        (errors.mean_ratio, errors.ssim, errors.flip),
        (1.0, Some(1.0), 0.0)
    );
}

#[test]
fn exchanging_images_keeps_the_symmetric_errors() {
    let (a, b) = synthetic();
    let mask = disc();
    let forward = compare_at_exposure(&a, &b, Some(&mask), ToneCurve::default()).unwrap();
    let backward = compare_at_exposure(&b, &a, Some(&mask), ToneCurve::default()).unwrap();
    close(forward.rmse, backward.rmse, 1e-12);
    close(forward.mae, backward.mae, 1e-12);
    close(forward.psnr_db, backward.psnr_db, 1e-12);
    close(forward.ssim.unwrap(), backward.ssim.unwrap(), 1e-12);
    close(forward.flip, backward.flip, 1e-12);
    close(forward.mean_ratio, 1.0 / backward.mean_ratio, 1e-12);
}

#[test]
fn radiance_and_exposure_scale_together() {
    let (a, b) = synthetic();
    let scaled = |image: &RgbImage| {
        RgbImage::from_fn(48, 40, |x, y| image.pixels[y * 48 + x].map(|v| v * 1024.0))
    };
    let errors = compare_images(&a, &b, None).unwrap();
    let large = compare_images(&scaled(&a), &scaled(&b), None).unwrap();
    close(large.rmse, 1024.0 * errors.rmse, 1e-12);
    close(large.psnr_db, errors.psnr_db, 1e-12);
    close(large.flip, errors.flip, 1e-12);
}

#[test]
fn full_mask_is_no_mask() {
    let (a, b) = synthetic();
    let mask = Mask {
        width: 48,
        height: 40,
        pixels: vec![255; 48 * 40],
    };
    assert_eq!(
        compare_images(&a, &b, None).unwrap(),
        compare_images(&a, &b, Some(&mask)).unwrap()
    );
}

#[test]
fn cropping_far_outside_the_mask_changes_nothing() {
    let (a, b) = synthetic();
    let mask = disc();
    let wide = |image: &RgbImage| {
        RgbImage::from_fn(148, 140, |x, y| {
            match (x.checked_sub(50), y.checked_sub(50)) {
                (Some(x), Some(y)) if x < 48 && y < 40 => image.pixels[y * 48 + x],
                _ => [7.0; 3],
            }
        })
    };
    let mut pixels = vec![0; 148 * 140];
    for (i, &coverage) in mask.pixels.iter().enumerate() {
        pixels[(i / 48 + 50) * 148 + i % 48 + 50] = coverage;
    }
    let wide_mask = Mask {
        width: 148,
        height: 140,
        pixels,
    };
    let small = compare_images(&a, &b, Some(&mask)).unwrap();
    let large = compare_images(&wide(&a), &wide(&b), Some(&wide_mask)).unwrap();
    assert_eq!(
        (small.pixels, small.rmse, small.psnr_db),
        (large.pixels, large.rmse, large.psnr_db)
    );
    close(small.flip, large.flip, 1e-9);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn pixels_outside_the_mask_do_not_count(seed in any::<u32>(), garbage in any::<f32>()) {
        let (a, mut b) = synthetic();
        let mask = disc();
        let clean = compare_images(&a, &b, Some(&mask)).unwrap();
        let mut dirty = a.clone();
        for (i, &coverage) in mask.pixels.iter().enumerate() {
            if coverage < 255 && (i as u32).wrapping_mul(seed | 1).is_multiple_of(3) {
                dirty.pixels[i] = [garbage, f32::NAN, 1e30];
                b.pixels[i] = [f32::INFINITY; 3];
            }
        }
        prop_assert_eq!(compare_images(&dirty, &b, Some(&mask)).unwrap(), clean);
    }
}

#[test]
fn known_error_gives_known_psnr() {
    // Display values 0.5 and 0.6: 20 dB; a tenth of that step: 40 dB.
    let image =
        |display: f64| RgbImage::constant(16, 16, [crate::image::srgb_decode(display) as f32; 3]);
    for (step, decibels) in [(0.1, 20.0), (0.01, 40.0)] {
        let curve = ToneCurve::default();
        let errors = compare_at_exposure(&image(0.5), &image(0.5 + step), None, curve).unwrap();
        close(errors.psnr_db, decibels, 1e-5);
    }
}

#[test]
fn unusable_input_is_named() {
    let (a, b) = synthetic();
    let text = |result: Result<ImageErrors, CompareError>| result.unwrap_err().to_string();
    let small = RgbImage::constant(4, 4, [0.0; 3]);
    assert!(text(compare_images(&a, &small, None)).contains("48 × 40"));
    let empty = Mask {
        width: 48,
        height: 40,
        pixels: vec![1; 48 * 40],
    };
    assert!(text(compare_images(&a, &b, Some(&empty))).contains("the largest is 1"));
    let mut broken = b.clone();
    broken.pixels[5 * 48 + 7][1] = f32::NAN;
    let message = text(compare_images(&a, &broken, None));
    assert!(
        message.contains("the test image: pixel x = 7, y = 5"),
        "{message}"
    );
    let none = RgbImage::constant(0, 0, [0.0; 3]);
    assert!(text(compare_images(&none, &none, None)).contains("no pixels"));
    assert_eq!(compare_images(&small, &small, None).unwrap().ssim, None);
}

/// Three frames in `folder/images`, frame i off by `step · i`, with masks.
fn capture(folder: &Path, step: f32) {
    let (image, _) = synthetic();
    fs::create_dir_all(folder.join("images")).unwrap();
    fs::create_dir_all(folder.join("masks")).unwrap();
    for i in 0..3 {
        let mut frame = image.clone();
        for (pixel, &coverage) in frame.pixels.iter_mut().zip(&disc().pixels) {
            // Outside the mask nothing counts.
            let offset = if coverage == 255 {
                step * i as f32
            } else {
                step
            };
            *pixel = pixel.map(|x| x + offset);
        }
        write_exr(&folder.join(format!("images/{i:04}.exr")), &frame).unwrap();
        disc()
            .write(&folder.join(format!("masks/{i:04}.png")))
            .unwrap();
    }
}

#[test]
fn sequence_pools_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    capture(&a, 0.0);
    capture(&b, 0.5);
    let errors = compare_sequences(&a, &b, None).unwrap();
    let rmse: Vec<f64> = errors
        .frames
        .iter()
        .map(|frame| frame.errors.rmse)
        .collect();
    assert_eq!(errors.frames[2].name, "0002.exr");
    assert_eq!(rmse[0], 0.0);
    close(rmse[1], 0.5, 1e-6);
    close(rmse[2], 1.0, 1e-6);
    close(errors.overall.rmse, (1.25f64 / 3.0).sqrt(), 1e-6);
    let interval = errors.interval95.unwrap();
    assert!(interval.low.rmse < errors.overall.rmse && errors.overall.rmse < interval.high.rmse);
    assert!(interval.low.psnr_db < errors.overall.psnr_db);
    assert_eq!(compare_sequences(&a, &b, None).unwrap(), errors);
    let table = errors.to_string();
    assert!(
        table.contains("0001.exr") && table.contains("95 % from"),
        "{table}"
    );
    serde_json::to_string(&errors).unwrap();

    // Files, plain folders and a single mask mean the same.
    let file = |folder: &Path| folder.join("images/0002.exr");
    let mask = a.join("masks/0000.png");
    let single = compare_sequences(&file(&a), &file(&b), Some(&mask)).unwrap();
    close(single.overall.rmse, 1.0, 1e-6);
    assert!(single.interval95.is_none());
    let plain = compare_sequences(&a.join("images"), &b.join("images"), Some(&mask)).unwrap();
    assert_eq!(plain.overall, errors.overall);
}

#[test]
fn sequence_names_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    capture(&a, 0.0);
    capture(&b, 0.0);
    let message = |masks| compare_sequences(&a, &b, masks).unwrap_err().to_string();
    fs::remove_file(a.join("masks/0001.png")).unwrap();
    assert!(
        message(None).contains("nothing stands against 0001.exr"),
        "{}",
        message(None)
    );
    fs::remove_file(b.join("images/0002.exr")).unwrap();
    assert!(message(None).contains("0002.exr") && message(None).contains("b/images"));
    fs::remove_file(a.join("images/0000.exr")).unwrap();
    assert!(message(None).contains("0002.exr"));
    fs::remove_dir_all(b.join("images")).unwrap();
    assert!(message(None).contains("holds no images"));
    let file = a.join("images/0001.exr");
    let mixed = compare_sequences(&file, &b, None).unwrap_err().to_string();
    assert!(mixed.contains("one is a file"), "{mixed}");
}
