//! `turnlight camera` as a user meets it: OpenCV's photographs where they are at hand, a turntable from
//! COLMAP that becomes a capture, and what is said about bad input.

#![expect(clippy::unwrap_used, reason = "a test may stop at once")]

mod command;

use std::path::{Path, PathBuf};

use command::{succeeds, text, turnlight};
use turnlight::image::{RgbImage, ToneCurve, write_png};
use turnlight::scene::Capture;

/// OpenCV's chessboard photographs, or nothing where they are not at hand.
fn photographs() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .unwrap()
        .join("shared/data/calibration/opencv_stereo");
    let Ok(entries) = std::fs::read_dir(&folder) else {
        return Vec::new();
    };
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|e| e == "jpg"));
    files.sort();
    files
}

/// Runs the command, which must fail with `code` and say `named`, and write nothing.
fn refused(folder: &Path, words: &[&str], code: i32, named: &str) {
    let before = std::fs::read_dir(folder).unwrap().count();
    let out = folder.join("never.toml");
    let run = turnlight(&[words, &["--out", text(&out)]].concat());
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert_eq!(run.status.code(), Some(code), "{words:?}: {said}");
    assert!(said.contains(named), "{words:?}: {said}");
    assert_eq!(
        std::fs::read_dir(folder).unwrap().count(),
        before,
        "{words:?}"
    );
}

#[test]
fn opencv_photographs_give_opencv_s_lens() {
    let files = photographs();
    if files.is_empty() {
        println!("skipped: shared/data/calibration is not here");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (out, report) = (
        folder.path().join("camera.toml"),
        folder.path().join("report.json"),
    );
    let corners = folder.path().join("corners.json");
    let mut words = vec!["camera", "calibrate", "--board", "9x6", "--out", text(&out)];
    words.extend(["--report", text(&report), "--write-corners", text(&corners)]);
    words.extend(files.iter().map(|file| text(file)));
    succeeds(&words);
    let read = |path: &Path| -> serde_json::Value {
        serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
    };
    let found = read(&report);
    // OpenCV 5.0 with the best of nine refinement windows: 0.1797 pixels, fx 532.99
    // (validation/check_calibration.py).
    let rms = found["rms_px"].as_f64().unwrap();
    let fx = found["parameters"]["fx"]["value"].as_f64().unwrap();
    assert!(rms < 1.05 * 0.1797, "{rms}");
    assert!((fx / 532.99 - 1.0).abs() < 0.005, "{fx}");
    assert_eq!(found["photographs"].as_array().unwrap().len(), 13);
    let written = std::fs::read_to_string(&out).unwrap();
    assert!(
        written.contains("[camera]") && written.contains("distortion = ["),
        "{written}"
    );

    // The corners written give the same lens again.
    succeeds(&[
        "camera",
        "calibrate",
        "--corners",
        text(&corners),
        "--out",
        text(&out),
        "--report",
        text(&report),
    ]);
    let again = read(&report)["parameters"]["fx"]["value"].as_f64().unwrap();
    assert!((again - fx).abs() < 1e-6, "{again} {fx}");

    // Two photographs are too few, a smaller board and another size are refused.
    let two = [text(&files[0]), text(&files[1])];
    let calibrate = |board, more: &[&'static str]| {
        let mut words = vec!["camera", "calibrate", "--quiet", "--board", board];
        words.extend(more);
        words
    };
    let mut words = calibrate("9x6", &[]);
    words.extend(two);
    refused(folder.path(), &words, 1, "2 photographs show the board");
    let mut words = calibrate("5x4", &[]);
    words.extend(two);
    refused(
        folder.path(),
        &words,
        1,
        "a grid of 9 × 6 inner corners was found",
    );
    let small = folder.path().join("small.png");
    write_png(
        &small,
        &RgbImage::constant(64, 48, [0.5; 3]),
        ToneCurve::default(),
    )
    .unwrap();
    let mut words = calibrate("9x6", &[]);
    words.extend([text(&files[0]), text(&small)]);
    refused(
        folder.path(),
        &words,
        2,
        "small.png: size = 64 × 48: must be 640 × 480",
    );
    let cut = folder.path().join("cut.jpg");
    std::fs::write(&cut, &std::fs::read(&files[0]).unwrap()[..100]).unwrap();
    let mut words = calibrate("9x6", &[]);
    words.extend([text(&files[0]), text(&cut)]);
    refused(folder.path(), &words, 2, "cut.jpg: ");
}

#[test]
fn usage_of_calibrate_is_checked() {
    let folder = tempfile::tempdir().unwrap();
    let path = text(folder.path()).to_owned();
    refused(folder.path(), &["camera", "calibrate"], 2, "required");
    refused(folder.path(), &["camera", "calibrate", &path], 2, "--board");
    let words = ["camera", "calibrate", &path, "--board", "9x6"];
    refused(folder.path(), &words, 2, "no photographs here");
    let absent = folder.path().join("absent.jpg");
    let words = ["camera", "calibrate", text(&absent), "--board", "9x6"];
    refused(folder.path(), &words, 2, "absent.jpg: ");
    let words = ["camera", "calibrate", "--corners", text(&absent)];
    refused(folder.path(), &words, 2, "absent.jpg: ");
}

/// A COLMAP model of `count` cameras round +Y, every fifth of a radian; `lift` moves them off the circle.
fn model(folder: &Path, count: u32, lift: f64) {
    let cameras = "1 SIMPLE_RADIAL 640 480 500 320 240 -0.05\n";
    let mut images = String::new();
    for i in 0..count {
        let (s, c) = (0.1 * f64::from(i)).sin_cos();
        images += &format!(
            "{} {c} 0 {s} 0 0 {} 4 1 {i:02}.png\n\n",
            i + 1,
            lift * f64::from(i * i % 7)
        );
    }
    std::fs::write(folder.join("cameras.txt"), cameras).unwrap();
    std::fs::write(folder.join("images.txt"), images).unwrap();
}

#[test]
fn a_colmap_model_becomes_a_capture() {
    let folder = tempfile::tempdir().unwrap();
    model(folder.path(), 6, 0.0);
    std::fs::create_dir(folder.path().join("images")).unwrap();
    let grey = RgbImage::constant(640, 480, [0.5; 3]);
    for i in 0..6 {
        let name = folder.path().join(format!("images/{i:02}.png"));
        write_png(&name, &grey, ToneCurve::default()).unwrap();
    }
    let out = folder.path().join("camera.toml");
    succeeds(&["camera", "import", text(folder.path()), "--out", text(&out)]);
    let sections = std::fs::read_to_string(&out).unwrap()
        + "[object]\nmesh = 'images/00.png'\n[probe]\nimage = 'images/00.png'\n";
    let capture = Capture::parse(&sections, &folder.path().join("capture.toml")).unwrap();
    assert_eq!(capture.frames.len(), 6);
    // The axis points to the camera's upper side, which in COLMAP's first camera is -Y.
    let axis = capture.turn.axis;
    assert!((axis - glam::DVec3::NEG_Y).length() < 1e-9, "{axis}");
    assert!(capture.turn.center.length() < 1e-9);
    for (i, frame) in capture.frames.iter().enumerate() {
        let expected = (-0.2 * i as f64).rem_euclid(std::f64::consts::TAU);
        assert!((frame.angle - expected).abs() < 1e-9, "{}", frame.angle);
        assert!(frame.image.ends_with(format!("images/{i:02}.png")));
    }
    assert!((capture.camera.position - glam::DVec3::NEG_Z * 4.0).length() < 1e-9);
}

#[test]
fn models_that_are_no_turntable_are_refused_with_figures() {
    let folder = tempfile::tempdir().unwrap();
    model(folder.path(), 12, 0.1);
    let source = text(folder.path()).to_owned();
    let words = ["camera", "import", source.as_str()];
    refused(
        folder.path(),
        &words,
        1,
        "the poses are not those of a turntable: cameras are off by",
    );
    let out = folder.path().join("lens.toml");
    succeeds(&[
        "camera",
        "import",
        &source,
        "--lens-only",
        "--out",
        text(&out),
    ]);
    let lens = std::fs::read_to_string(&out).unwrap();
    assert!(
        lens.contains("distortion = [-0.05") && !lens.contains("[turntable]"),
        "{lens}"
    );
    std::fs::remove_file(folder.path().join("images.txt")).unwrap();
    refused(folder.path(), &words, 2, "images.txt: ");
}

#[test]
fn names_in_transforms_json_are_relative_to_it() {
    // Run in the folder above, the source a relative folder with images/ in it.
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("nerf");
    std::fs::create_dir_all(source.join("images")).unwrap();
    let frame = |i: u32| {
        let (s, c) = (0.4 * f64::from(i)).sin_cos();
        format!(
            r#"{{"file_path": "images/{i}.png", "transform_matrix":
                [[{c}, {s}, 0, {}], [{s}, -{c}, 0, {}], [0, 0, -1, 0], [0, 0, 0, 1]]}}"#,
            2.0 * s,
            -2.0 * c
        )
        .replace("--", "")
    };
    let frames = [frame(0), frame(1), frame(2)].join(",");
    let text = format!(r#"{{"w": 64, "h": 48, "camera_angle_x": 0.7, "frames": [{frames}]}}"#);
    std::fs::write(source.join("transforms.json"), text).unwrap();
    let run = std::process::Command::new(env!("CARGO_BIN_EXE_turnlight"))
        .args(["camera", "import", "nerf", "--up=-z"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stderr)
    );
    let written = std::fs::read_to_string(folder.path().join("camera.toml")).unwrap();
    assert!(
        written.contains("image = \"nerf/images/0.png\""),
        "{written}"
    );
}
