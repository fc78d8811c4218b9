//! Cameras of other programs, and corners found by them.

use std::path::Path;

use glam::DMat3;
use turnlight::geometry::Turn;
use turnlight::rig::{Camera, CornerFile, ImportChoices, calibrate, fit_orbit, import};
use turnlight::scene::{RigSections, Scene};

use super::mutate::Form;
use super::room::FLAT;
use super::scenes::{assert_camera, assert_reads_back, named};
use super::{Outcome, Parser, fuzz, seeds};

/// A lens has rays, poses are rigid, and a turntable found among them is written as a scene that reads back.
fn cameras(path: &Path) -> Outcome {
    let of_file = |error: String| format!("{}: {error}", path.display());
    let imported = import(path, &ImportChoices::default()).map_err(|e| e.to_string())?;
    let lens = imported.lens;
    for shot in &imported.shots {
        let pose = shot.object_from_camera;
        let square = pose.matrix3.transpose() * pose.matrix3;
        assert!(square.abs_diff_eq(DMat3::IDENTITY, 1e-6), "{pose:?}");
        assert!(pose.translation.is_finite(), "{pose:?}");
    }
    let poses: Vec<_> = imported
        .shots
        .iter()
        .map(|s| s.object_from_camera)
        .collect();
    let place = |pose: &glam::DAffine3| -> Result<Camera, String> {
        let m = &pose.matrix3;
        lens.camera(pose.translation, m.z_axis, m.y_axis)
            .map_err(|e| of_file(e.to_string()))
    };
    let (camera, turn) = match poses.as_slice() {
        [] => (place(&glam::DAffine3::IDENTITY)?, None),
        [one] => (place(one)?, None),
        many => {
            let orbit = fit_orbit(many).map_err(|e| of_file(e.to_string()))?;
            assert!(
                orbit.angles.iter().all(|a| (0.0..7.0).contains(a)),
                "angles"
            );
            (place(&orbit.world_from_camera)?, Some(orbit.turn))
        }
    };
    assert_camera(&camera);
    let turn = turn.unwrap_or(Turn {
        axis: glam::DVec3::Y,
        center: glam::DVec3::ZERO,
    });
    assert!(
        turn.axis.is_normalized() && turn.center.is_finite(),
        "{turn:?}"
    );
    let rig = RigSections {
        remarks: &[],
        lens: &lens,
        camera: Some(&camera),
        turn: Some(&turn),
        frames: &[],
    };
    let folder = path.parent().unwrap();
    let rest = "frames = 3\n[object]\nmesh = \"mesh.ply\"\n[probe]\nimage = \"probe.exr\"\n[material]\n\
                ndf = \"ggx\"\nalpha = 0.2\nrho_d = 0.5\nrho_s = 1.0\n";
    let text = rig.to_toml(folder) + rest;
    assert_reads_back(&text, Scene::parse(&text, &folder.join("scene.toml")));
    Ok(())
}

/// The parser `name` of cameras in `file`, with the file `beside` next to it.
fn camera_file(
    name: &'static str,
    file: &'static str,
    seeds: Vec<Vec<u8>>,
    beside: Option<(&'static str, Vec<u8>)>,
) {
    let form = if file.ends_with(".bin") {
        Form::Binary
    } else {
        Form::Text
    };
    let prepare = |folder: &Path| {
        named(folder);
        if let Some((file, bytes)) = &beside {
            std::fs::write(folder.join(file), bytes).unwrap();
        }
    };
    fuzz(
        Parser {
            name,
            file,
            form,
            seeds,
            room: FLAT,
            inputs: 6_000,
        },
        prepare,
        cameras,
    );
}

#[test]
fn opencv_yaml_is_read_or_refused() {
    camera_file("opencv_yaml", "lens.yml", vec![seeds::opencv_yaml()], None);
}

#[test]
fn opencv_xml_is_read_or_refused() {
    camera_file("opencv_xml", "lens.xml", vec![seeds::opencv_xml()], None);
}

#[test]
fn opencv_json_and_transforms_are_read_or_refused() {
    let seeds = vec![seeds::transforms(), seeds::opencv_json()];
    camera_file("transforms", "transforms.json", seeds, None);
}

#[test]
fn colmap_text_is_read_or_refused() {
    let [cameras, images] = seeds::colmap_text();
    let (c, i) = (vec![cameras.clone()], vec![images.clone()]);
    camera_file(
        "cameras_txt",
        "cameras.txt",
        c,
        Some(("images.txt", images)),
    );
    camera_file(
        "images_txt",
        "images.txt",
        i,
        Some(("cameras.txt", cameras)),
    );
}

#[test]
fn colmap_binary_is_read_or_refused() {
    let [cameras, images] = seeds::colmap_binary();
    let (c, i) = (vec![cameras.clone()], vec![images.clone()]);
    camera_file(
        "cameras_bin",
        "cameras.bin",
        c,
        Some(("images.bin", images)),
    );
    camera_file(
        "images_bin",
        "images.bin",
        i,
        Some(("cameras.bin", cameras)),
    );
}

#[test]
fn corners_are_read_and_calibrated_or_refused() {
    let read = |path: &Path| {
        let file = CornerFile::load(path).map_err(|e| e.to_string())?;
        let found = calibrate((file.width, file.height), &file.views, [true; 5])
            .map_err(|e| format!("{}: {e}", path.display()))?;
        assert!(found.rms.is_finite(), "rms {}", found.rms);
        assert!(
            found
                .deviations()
                .iter()
                .all(|(_, x, s)| x.is_finite() && s.is_finite())
        );
        found.lens.check().unwrap();
        Ok(())
    };
    fuzz(
        Parser {
            name: "corners",
            file: "corners.json",
            form: Form::Text,
            seeds: vec![seeds::corners()],
            room: FLAT,
            inputs: 300,
        },
        |_| (),
        read,
    );
}
