//! Scenes, captures and the materials of scenes.

use std::path::Path;

use glam::{DVec2, DVec3, Vec2};
use turnlight::geometry::{Similarity, Turn};
use turnlight::image::{RgbImage, write_exr};
use turnlight::rig::registration::{Clicked, Placement, pose_from_pairs};
use turnlight::rig::{Camera, Distortion, Intrinsics};
use turnlight::scene::{Capture, ClickedPairs, MaterialField, Scene, Sensor};

use super::mutate::Form;
use super::room::{FLAT, TWO_PACKED};
use super::{Outcome, Parser, fuzz, seeds};

/// The files that scenes name.
pub(crate) fn named(folder: &Path) {
    for name in seeds::NAMED {
        std::fs::write(folder.join(name), "").unwrap();
    }
    std::fs::write(folder.join("mesh.ply"), seeds::ply_text(&[])).unwrap();
    write_exr(
        &folder.join("probe.exr"),
        &RgbImage::constant(4, 2, [0.5; 3]),
    )
    .unwrap();
}

#[test]
fn scene_toml_is_read_or_refused() {
    let read = |path: &Path| {
        let scene = Scene::load(path).map_err(|e| e.to_string())?;
        assert_camera(&scene.camera);
        assert_sensor(scene.sensor.as_ref());
        assert!(
            scene.turn.axis.is_normalized() && scene.turn.center.is_finite(),
            "turn"
        );
        assert!(scene.probe.rotation.is_finite(), "probe");
        assert!(
            !scene.angles.is_empty() && scene.angles.iter().all(|a| a.is_finite()),
            "angles"
        );
        let text = scene.to_toml(path.parent().unwrap());
        let again = Scene::parse(&text, path);
        assert_reads_back(&text, again);
        Ok(())
    };
    fuzz(
        Parser {
            name: "scene",
            file: "scene.toml",
            form: Form::Text,
            seeds: seeds::scene(),
            room: FLAT,
            inputs: 6_000,
        },
        named,
        read,
    );
}

#[test]
fn capture_toml_is_read_or_refused() {
    let read = |path: &Path| {
        let capture = Capture::load(path).map_err(|e| e.to_string())?;
        assert_camera(&capture.camera);
        assert_sensor(capture.sensor.as_ref());
        let frames = &capture.frames;
        assert!(!frames.is_empty(), "frames");
        assert!(
            frames
                .iter()
                .all(|f| f.angle.is_finite() && f.exposure > 0.0),
            "frames"
        );
        let text = capture.to_toml(path.parent().unwrap());
        let again = Capture::parse(&text, path);
        assert_reads_back(&text, again);
        Ok(())
    };
    fuzz(
        Parser {
            name: "capture",
            file: "capture.toml",
            form: Form::Text,
            seeds: seeds::capture(),
            room: FLAT,
            inputs: 6_000,
        },
        named,
        read,
    );
}

#[test]
fn clicked_pairs_are_read_or_refused() {
    let read = |path: &Path| {
        let clicked = ClickedPairs::load(path).map_err(|e| e.to_string())?;
        assert!(!clicked.pairs.is_empty(), "pairs");
        let finite = |p: &Clicked| p.point.is_finite() && p.pixel.is_finite();
        assert!(clicked.pairs.iter().all(finite), "{clicked:?}");
        // Whatever was clicked, a pose that is found is one.
        let camera = Camera::looking_at(
            (64, 48),
            Intrinsics::from_fov_x(64, 48, 0.6),
            Distortion::default(),
            DVec3::new(0.0, 0.5, 4.0),
            DVec3::ZERO,
            DVec3::Y,
        );
        let given = Placement {
            object_from_file: Similarity::default(),
            turn: Turn {
                axis: DVec3::Y,
                center: DVec3::ZERO,
            },
            angles: vec![0.0],
        };
        if let Ok(found) = pose_from_pairs(&camera.unwrap(), &given, 0.3, &clicked.pairs) {
            let pose = found.object_from_file;
            assert!(
                pose.rotation.is_normalized()
                    && pose.translation.is_finite()
                    && found.rms.is_finite(),
                "{found:?}"
            );
        }
        Ok(())
    };
    fuzz(
        Parser {
            name: "pairs",
            file: "pairs.toml",
            form: Form::Text,
            seeds: seeds::pairs(),
            room: FLAT,
            inputs: 2_000,
        },
        |_| (),
        read,
    );
}

/// What was read can be written and read again.
pub(crate) fn assert_reads_back<T, E: std::fmt::Debug>(text: &str, again: Result<T, E>) {
    assert!(
        again.is_ok(),
        "what is written does not read back: {:?}\n{text}",
        again.err()
    );
}

/// Axes are axes, and pixels have rays.
pub(crate) fn assert_camera(camera: &Camera) {
    assert!(camera.position.is_finite(), "camera position");
    let axes = camera.world_from_camera;
    let square = axes.transpose() * axes;
    assert!(
        square.abs_diff_eq(glam::DMat3::IDENTITY, 1e-9),
        "camera axes {axes}"
    );
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    for share in [[0.0, 0.0], [1.0, 1.0], [0.5, 0.5], [0.3, 0.7]] {
        let direction = camera.direction(size * DVec2::from(share));
        assert!(direction.is_finite(), "direction {direction} of {camera:?}");
    }
}

fn assert_sensor(sensor: Option<&Sensor>) {
    if let Some(sensor) = sensor {
        assert!(
            sensor.full_well_electrons > 0.0 && sensor.exposure > 0.0,
            "{sensor:?}"
        );
        assert!((1..=32).contains(&sensor.bits), "{sensor:?}");
    }
}

/// Wherever it is looked up, a material is finite and in range.
fn assert_material(scene: &Scene) -> Outcome {
    let (mesh, _) = scene.object.load().map_err(|e| e.to_string())?;
    let field = MaterialField::load(&scene.material, &mesh, &scene.object.mesh)
        .map_err(|e| e.to_string())?;
    for triangle in 0..mesh.triangles.len() as u32 {
        for barycentric in [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::new(0.3, 0.4)] {
            let material = field.at(&mesh, triangle, barycentric);
            let colours = [material.rho_d, material.rho_s];
            assert!(
                colours
                    .iter()
                    .all(|c| c.is_finite() && c.min_element() >= 0.0)
                    && (1e-3..=1.0).contains(&material.alpha.get())
                    && (0.0..=1.0).contains(&material.ggx),
                "{material:?}"
            );
        }
    }
    Ok(())
}

#[test]
fn material_maps_are_read_or_refused() {
    let scene = |folder: &Path| {
        named(folder);
        // One number and one colour are read from it.
        let material = "ndf = \"ggx\"\nalpha = \"map.exr\"\nrho_d = \"map.exr\"\nrho_s = 2.0";
        std::fs::write(folder.join("scene.toml"), seeds::scene_of(material)).unwrap();
    };
    let read = |path: &Path| {
        let scene = Scene::load(path.parent().unwrap()).map_err(|e| e.to_string())?;
        assert_material(&scene)
    };
    fuzz(
        Parser {
            name: "map",
            file: "map.exr",
            form: Form::Binary,
            seeds: seeds::parameter_map(),
            room: TWO_PACKED,
            inputs: 3_000,
        },
        scene,
        read,
    );
}

#[test]
fn vertex_properties_are_read_or_refused() {
    const NAMES: [&str; 6] = ["ggx", "rough", "d", "s_r", "s_g", "s_b"];
    let scene = |folder: &Path| {
        named(folder);
        let material = "ndf = \"vertex:ggx\"\nalpha = \"vertex:rough\"\nrho_d = \"vertex:d\"\nrho_s = \"vertex:s\"";
        std::fs::write(folder.join("scene.toml"), seeds::scene_of(material)).unwrap();
    };
    let read = |path: &Path| {
        let scene = Scene::load(path.parent().unwrap()).map_err(|e| e.to_string())?;
        assert_material(&scene)
    };
    let seeds = vec![seeds::ply_text(&NAMES.map(|name| (name, 0.5)))];
    fuzz(
        Parser {
            name: "property",
            file: "mesh.ply",
            form: Form::Text,
            seeds,
            room: FLAT,
            inputs: 6_000,
        },
        scene,
        read,
    );
}
