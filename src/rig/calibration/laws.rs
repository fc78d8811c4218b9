//! Laws of calibration on synthetic boards: exact corners give the exact lens, noisy ones a lens within the
//! errors that are predicted, and sets that cannot tell are refused.

use glam::{DAffine3, DMat3, DVec2, DVec3};
use proptest::prelude::*;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;

use super::*;

const SIZE: (usize, usize) = (640, 480);

fn true_lens(focal: f64, k1: f64) -> Lens {
    Lens {
        width: SIZE.0,
        height: SIZE.1,
        intrinsics: Intrinsics {
            fx: focal,
            fy: 1.01 * focal,
            cx: 331.5,
            cy: 229.25,
        },
        distortion: Distortion {
            k1,
            k2: 0.02,
            p1: 0.002,
            p2: -0.001,
            k3: 0.01,
        },
    }
}

/// Boards of 9 × 6 corners in front of the camera, tilted by up to `tilt` radians in different directions.
fn poses(count: usize, tilt: f64) -> Vec<DAffine3> {
    (0..count)
        .map(|i| {
            let around = 2.4 * i as f64;
            let lean =
                DVec3::new(around.cos(), around.sin(), 0.0) * tilt * (0.6 + 0.4 * around.sin());
            let turned = DMat3::from_quat(glam::DQuat::from_scaled_axis(lean))
                * DMat3::from_rotation_z(0.3 * i as f64);
            let away = DVec3::new(3.0 * (1.7 * around).cos(), 2.0 * (1.3 * around).sin(), 12.0);
            DAffine3 {
                matrix3: turned,
                translation: away - turned * DVec3::new(4.0, 2.5, 0.0),
            }
        })
        .collect()
}

fn views(lens: &Lens, poses: &[DAffine3], noise: f64, seed: u64) -> Vec<BoardView> {
    let mut random = Pcg64Mcg::new(u128::from(seed) * 2 + 1);
    let normal = Normal::new(0.0, noise).unwrap();
    let mut view = |(i, pose): (usize, &DAffine3)| BoardView {
        name: format!("{i}.png"),
        corners: (0..54)
            .map(|j| {
                let board = DVec2::new(f64::from(j % 9), f64::from(j / 9));
                let p = pose.transform_point3(board.extend(0.0));
                let shift = DVec2::new(normal.sample(&mut random), normal.sample(&mut random));
                Corner {
                    board,
                    pixel: lens.pixel(p.truncate() / p.z) + shift,
                }
            })
            .collect(),
    };
    poses.iter().enumerate().map(&mut view).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn exact_corners_give_the_exact_lens(
        focal in 450.0f64..900.0, k1 in -0.2f64..0.2, count in 4usize..12, tilt in 0.4f64..0.8,
    ) {
        let lens = true_lens(focal, k1);
        let found = calibrate(SIZE, &views(&lens, &poses(count, tilt), 0.0, 1), [true; 5]).unwrap();
        prop_assert!(found.rms < 1e-7, "rms {} after {} steps, {:?}", found.rms, found.steps, found.stop);
        for ((name, value, _), truth) in found.deviations().into_iter().zip(parameters(&lens)) {
            let scale = if truth.abs() > 1.0 { truth.abs() } else { 1.0 };
            prop_assert!((value - truth).abs() <= 1e-6 * scale, "{name}: {value}, not {truth}");
        }
    }
}

fn parameters(lens: &Lens) -> [f64; 9] {
    let (k, d) = (&lens.intrinsics, &lens.distortion);
    [k.fx, k.fy, k.cx, k.cy, d.k1, d.k2, d.p1, d.p2, d.k3]
}

#[test]
fn errors_are_as_large_as_predicted() {
    // z of all parameters over many sets of noise: variance 1 but for chance, and no bias.
    const SETS: usize = 200;
    let lens = true_lens(540.0, -0.12);
    let poses = poses(8, 0.5);
    let mut squares = [0.0; 9];
    let mut sums = [0.0; 9];
    for set in 0..SETS {
        let found = calibrate(SIZE, &views(&lens, &poses, 0.2, set as u64), [true; 5]).unwrap();
        assert!(
            (found.rms - 0.2 * 2f64.sqrt()).abs() < 0.05,
            "rms {}",
            found.rms
        );
        for (i, ((_, value, sigma), truth)) in found
            .deviations()
            .into_iter()
            .zip(parameters(&lens))
            .enumerate()
        {
            let z = (value - truth) / sigma;
            sums[i] += z;
            squares[i] += z * z;
        }
    }
    // Significance 0.01 over 18 tests, by Šidák: 5.6e-4 each, |normal| < 3.45. A mean square of 200 has
    // standard deviation √(2/200) = 0.1.
    for (i, (name, ..)) in calibrate(SIZE, &views(&lens, &poses, 0.2, 0), [true; 5])
        .unwrap()
        .deviations()
        .into_iter()
        .enumerate()
    {
        let mean = sums[i] / (SETS as f64).sqrt();
        let spread = (squares[i] / SETS as f64 - 1.0) / 0.1;
        assert!(mean.abs() < 3.45, "{name}: biased by {mean} of its error");
        assert!(
            spread.abs() < 3.45,
            "{name}: variance {}",
            squares[i] / SETS as f64
        );
    }
}

#[test]
fn held_coefficients_stay_zero_without_error_bars() {
    let mut lens = true_lens(540.0, -0.12);
    lens.distortion = Distortion {
        k1: -0.25,
        ..Distortion::default()
    };
    let free = [true, false, false, false, false];
    let found = calibrate(SIZE, &views(&lens, &poses(6, 0.5), 0.0, 1), free).unwrap();
    assert!((found.lens.distortion.k1 + 0.25).abs() < 1e-9);
    for (name, value, sigma) in &found.deviations()[5..] {
        assert_eq!((*value, *sigma), (0.0, 0.0), "{name}");
    }
}

#[test]
fn boards_that_are_all_parallel_are_refused() {
    let lens = true_lens(540.0, -0.12);
    for tilt in [0.0, 0.4] {
        for noise in [0.0, 0.2] {
            let leaning = DMat3::from_rotation_y(tilt);
            let parallel: Vec<DAffine3> = poses(8, 0.0)
                .into_iter()
                .enumerate()
                .map(|(i, pose)| DAffine3 {
                    matrix3: leaning * pose.matrix3,
                    translation: leaning * pose.translation + DVec3::Z * i as f64,
                })
                .collect();
            let error = calibrate(SIZE, &views(&lens, &parallel, noise, 3), [true; 5]).unwrap_err();
            assert!(
                matches!(error, CalibrationError::Degenerate { .. }),
                "tilt {tilt}, noise {noise}: {error}"
            );
        }
    }
}

#[test]
fn too_few_boards_and_corners_are_refused_by_name() {
    let lens = true_lens(540.0, 0.0);
    let mut all = views(&lens, &poses(3, 0.5), 0.0, 1);
    let error = calibrate(SIZE, &all[..2], [true; 5]).unwrap_err();
    assert!(error.to_string().contains("2 photographs"), "{error}");
    all[1].corners.truncate(7);
    let error = calibrate(SIZE, &all, [true; 5]).unwrap_err();
    assert!(error.to_string().contains("1.png: 7 corners"), "{error}");
    all[1] = views(&lens, &poses(3, 0.5), 0.0, 1)[1].clone();
    all[1].corners.retain(|corner| corner.board.y == 2.0);
    let error = calibrate(SIZE, &all, [true; 5]).unwrap_err();
    assert!(error.to_string().contains("in a line"), "{error}");
}

#[test]
fn a_photograph_of_another_camera_is_named() {
    let lens = true_lens(540.0, -0.12);
    let mut all = views(&lens, &poses(8, 0.5), 0.1, 1);
    for corner in &mut all[5].corners {
        let centre = DVec2::new(320.0, 240.0);
        let away = corner.pixel - centre;
        corner.pixel.x += 4e-4 * away.y * away.y;
    }
    let found = calibrate(SIZE, &all, [true; 5]).unwrap();
    let named: Vec<&str> = found
        .photographs
        .iter()
        .filter(|fit| fit.outlier)
        .map(|fit| fit.name.as_str())
        .collect();
    assert_eq!(named, ["5.png"]);
}
