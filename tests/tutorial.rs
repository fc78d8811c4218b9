//! The tutorial (`scenes/tutorial/README.md`) as one chain on small photographs: from what is on the cards of two
//! cameras to a fit, its reproduction and a page.

#![expect(clippy::unwrap_used, reason = "a test may stop at once")]

#[path = "../scenes/tutorial/card.rs"]
mod card;
mod command;
mod photographs;

use std::path::Path;

use command::{succeeds, text};
use glam::DQuat;
use turnlight::image::RgbImage;
use turnlight::scene::{Capture, Scene};

/// Pixels of the object's camera on a side, half of the tutorial's; frames; pixels of the probe by one here.
const SIDE: usize = 128;
const FRAMES: usize = 8;
const PROBE: usize = 4;

/// The tutorial's scene, smaller; written to `folder`.
fn small_scene(folder: &Path) -> Scene {
    let tutorial = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/tutorial");
    let scene = Scene::load(&tutorial).unwrap();
    let light = RgbImage::read(&scene.probe.image).unwrap();
    let small = RgbImage::from_fn(light.width / PROBE, light.height / PROBE, |x, y| {
        let mut sum = [0.0; 3];
        for k in 0..PROBE * PROBE {
            let (column, row) = (PROBE * x + k % PROBE, PROBE * y + k / PROBE);
            let texel = light.pixels[row * light.width + column];
            sum = [0, 1, 2].map(|c| sum[c] + texel[c].max(0.0) / (PROBE * PROBE) as f32);
        }
        sum
    });
    turnlight::image::write_exr(&folder.join("light.exr"), &small).unwrap();
    let text_ = std::fs::read_to_string(tutorial.join("scene.toml")).unwrap();
    let small = text_
        .replace("256", &SIDE.to_string())
        .replace("frames = 24", &format!("frames = {FRAMES}"))
        .replace("../probes/courtyard.exr", "light.exr")
        .replace("../meshes", text(&tutorial.join("../meshes")));
    let path = folder.join("scene.toml");
    std::fs::write(&path, small).unwrap();
    let scene = Scene::load(&path).unwrap();
    assert_eq!((scene.camera.width, scene.angles.len()), (SIDE, FRAMES));
    scene
}

/// The tutorial's rough.toml with the small capture's frames and the camera that was calibrated.
fn rough(camera: &Path) -> String {
    let tutorial = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/tutorial");
    let read = |path: &Path| -> toml::Table {
        toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
    };
    let (mut rough, calibrated) = (read(&tutorial.join("rough.toml")), read(camera));
    let mesh = tutorial.join("../meshes/suzanne.ply");
    rough["object"]["mesh"] = text(&mesh).into();
    for key in ["width", "height", "fx", "fy", "cx", "cy", "distortion"] {
        rough["camera"][key] = calibrated["camera"][key].clone();
    }
    let frames = rough["frames"].as_array_mut().unwrap();
    frames.truncate(FRAMES);
    for (t, frame) in frames.iter_mut().enumerate() {
        frame["angle_deg"] = (360.0 * t as f64 / FRAMES as f64).into();
    }
    toml::to_string(&rough).unwrap()
}

/// The tutorial's clicked pairs in an image of half the size.
fn half_pairs() -> String {
    let tutorial = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/tutorial");
    let mut pairs: toml::Table =
        toml::from_str(&std::fs::read_to_string(tutorial.join("pairs.toml")).unwrap()).unwrap();
    for pair in pairs["pairs"].as_array_mut().unwrap() {
        for x in pair["pixel"].as_array_mut().unwrap() {
            *x = (x.as_integer().unwrap() as f64 * SIDE as f64 / 256.0).into();
        }
    }
    toml::to_string(&pairs).unwrap()
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

#[test]
fn the_tutorial_leads_from_photographs_to_a_material() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let run = |words: &[&str]| succeeds(&[words, &["--quiet"]].concat());
    let scene = small_scene(folder.path());
    let light = RgbImage::read(&scene.probe.image).unwrap();
    card::write(&path("card"), &light, &scene.camera).unwrap();
    run(&[
        "render",
        text(&path("scene.toml")),
        "--out",
        text(&path("capture")),
        "--spp",
        "16",
    ]);

    // The light: brackets to radiance in the object camera's colours and unit.
    let jpegs = |name: &str| -> Vec<String> {
        (0..11)
            .map(|j| text(&path("card").join(name).join(format!("{j:02}.jpg"))).to_owned())
            .collect()
    };
    let merge = |images: &[String], more: &[&str], out: &str| {
        let images: Vec<&str> = images.iter().map(String::as_str).collect();
        let out = path(out);
        let words = ["probe", "merge", "--out", text(&out)];
        run(&[&words[..], more, &images].concat());
    };
    merge(&jpegs("brackets"), &[], "probe.exr");
    let response = path("probe.response.csv");
    merge(
        &jpegs("chart"),
        &["--response", text(&response)],
        "chart.exr",
    );
    run(&[
        "probe",
        "match",
        text(&path("chart.exr")),
        text(&path("card/chart.exr")),
        "--probe-corners",
        card::CHART_CORNERS,
        "--camera-corners",
        card::CHART_CORNERS,
        "--out",
        text(&path("match.toml")),
        "--apply",
        text(&path("probe.exr")),
        "--matched",
        text(&path("matched.exr")),
    ]);
    let matched = RgbImage::read(&path("matched.exr")).unwrap();
    let mut errors: Vec<f64> = (matched.pixels.iter().zip(&light.pixels))
        .map(|(a, b)| (f64::from(a[1]) / f64::from(b[1]) - 1.0).abs())
        .collect();
    errors.sort_unstable_by(f64::total_cmp);
    let (median, most) = (errors[errors.len() / 2], errors[errors.len() * 9 / 10]);
    println!("matched light: median error {median:.4}, nine of ten {most:.4}");
    assert!(median < 0.03 && most < 0.15, "{median} {most}");
    run(&[
        "probe",
        "inspect",
        text(&path("matched.exr")),
        "--out",
        text(&path("probe.html")),
        "--frames",
        "8",
    ]);

    // The camera, from the chessboard.
    let board = card::BOARD.map(|n| n.to_string()).join("x");
    run(&[
        "camera",
        "calibrate",
        text(&path("card/chessboard")),
        "--board",
        &board,
        "--distortion",
        "k1",
        "--out",
        text(&path("camera.toml")),
        "--report",
        text(&path("camera.json")),
    ]);
    let found = json(&path("camera.json"));
    let fx = found["parameters"]["fx"]["value"].as_f64().unwrap();
    let truth = scene.camera.intrinsics.fx;
    println!("fx {fx} of {truth}, {} pixels", found["rms_px"]);
    assert!((fx / truth - 1.0).abs() < 0.005, "{fx} {truth}");

    // Where object and turntable stand.
    std::fs::write(path("capture/rough.toml"), rough(&path("camera.toml"))).unwrap();
    std::fs::write(path("pairs.toml"), half_pairs()).unwrap();
    run(&[
        "register",
        text(&path("capture/rough.toml")),
        "--pairs",
        text(&path("pairs.toml")),
        "--out",
        text(&path("registered")),
    ]);
    let registered = Capture::load(path("registered")).unwrap();
    let (a, b) = (
        &registered.object.object_from_file,
        &scene.object.object_from_file,
    );
    let off = (a.rotation * DQuat::inverse(b.rotation))
        .to_scaled_axis()
        .length();
    let axis = registered.turn.axis.angle_between(scene.turn.axis);
    println!(
        "turn {:.4}°, axis {:.4}° off",
        off.to_degrees(),
        axis.to_degrees()
    );
    assert!(off.to_degrees() < 0.2 && axis.to_degrees() < 0.2);

    // The material, its reproduction against the photographs, and the page.
    run(&[
        "fit",
        text(&path("registered")),
        "--out",
        text(&path("fit")),
        "--interreflections",
        "0",
    ]);
    run(&[
        "reproduce",
        text(&path("fit")),
        "--out",
        text(&path("again")),
        "--spp",
        "16",
    ]);
    run(&[
        "compare",
        text(&path("registered")),
        text(&path("again")),
        "--json",
        text(&path("errors.json")),
    ]);
    run(&[
        "report",
        text(&path("fit")),
        "--reproduced",
        text(&path("again")),
        "--out",
        text(&path("report.html")),
    ]);
    let errors = json(&path("errors.json"));
    let overall = |key: &str| errors["overall"][key].as_f64().unwrap();
    println!(
        "PSNR {:.1} dB, mean ratio {:.3}",
        overall("psnr_db"),
        overall("mean_ratio")
    );
    assert!(overall("psnr_db") > 25.0 && (overall("mean_ratio") - 1.0).abs() < 0.05);
    let page = std::fs::read_to_string(path("report.html")).unwrap();
    assert!(page.contains("PSNR"));
}
