//! The parsers, each with its seeds and with what must hold of a file that it accepts.

use std::cell::OnceCell;
use std::path::Path;

use glam::{DVec2, Vec2, Vec3};
use turnlight::accel::Accel;
use turnlight::export::PointTable;
use turnlight::geometry::Ray;
use turnlight::image::{Mask, RgbImage, read_exr_channels, write_exr};
use turnlight::mesh::{LoadOptions, Mesh};
use turnlight::probe::Environment;
use turnlight::render::{FrameSettings, Sampling, SequenceSettings, Skips, Stage, render_sequence};
use turnlight::report::write_report;
use turnlight::rig::Camera;
use turnlight::scene::{Capture, MaterialField, Scene, Sensor};

use super::mutate::Form;
use super::{Parser, Room, fuzz, seeds};

type Outcome = Result<(), String>;

/// Meshes and text: a count of a billion vertices needs two hundred times as much.
const FLAT: Room = Room {
    flat: 1 << 26,
    per_byte: 0,
};
/// PNG: 4096 samples of one byte, each of which becomes three floats.
const PICTURE: Room = Room {
    per_byte: 1 << 16,
    ..FLAT
};
/// The same, and what the tiff crate (0.11) takes for the values of a tag before it can be told a limit.
const TAGGED: Room = Room {
    flat: 0x1400_0000,
    ..PICTURE
};
/// EXR and Radiance HDR: 65536 bytes, of which the two of a grey half become four floats.
const PACKED: Room = Room {
    per_byte: 1 << 19,
    ..FLAT
};

/// Two of them at once.
const TWO_PACKED: Room = Room {
    per_byte: 2 << 19,
    ..FLAT
};

fn parser(
    name: &'static str,
    file: &'static str,
    form: Form,
    seeds: Vec<Vec<u8>>,
    room: Room,
    inputs: u64,
) -> Parser {
    Parser {
        name,
        file,
        form,
        seeds,
        room,
        inputs,
    }
}

#[test]
fn ply_is_read_or_refused() {
    fuzz(
        parser("ply", "shape.ply", Form::Text, seeds::ply(), FLAT, 6_000),
        |_| (),
        mesh,
    );
}

#[test]
fn obj_is_read_or_refused() {
    fuzz(
        parser("obj", "shape.obj", Form::Text, seeds::obj(), FLAT, 6_000),
        |_| (),
        mesh,
    );
}

#[test]
fn stl_is_read_or_refused() {
    fuzz(
        parser("stl", "shape.stl", Form::Text, seeds::stl(), FLAT, 6_000),
        |_| (),
        mesh,
    );
}

#[test]
fn gltf_is_read_or_refused() {
    let beside = |folder: &Path| {
        std::fs::write(folder.join(seeds::BUFFER), seeds::gltf_buffer()).unwrap();
    };
    fuzz(
        parser("gltf", "shape.gltf", Form::Text, seeds::gltf(), FLAT, 6_000),
        beside,
        mesh,
    );
}

#[test]
fn glb_is_read_or_refused() {
    fuzz(
        parser("glb", "shape.glb", Form::Glb, seeds::glb(), FLAT, 6_000),
        |_| (),
        mesh,
    );
}

/// A mesh is as its type promises, and rays can be asked of it.
fn mesh(path: &Path) -> Outcome {
    let (mesh, report) =
        Mesh::load(path, &Default::default(), LoadOptions::default()).map_err(|e| e.to_string())?;
    let _ = report.to_string();
    let vertices = mesh.positions.len();
    assert!(!mesh.triangles.is_empty(), "no triangle");
    assert!(
        mesh.triangles
            .as_flattened()
            .iter()
            .all(|&v| (v as usize) < vertices),
        "index out of range"
    );
    assert!(
        mesh.positions
            .iter()
            .all(|p| p.is_finite() && p.abs().max_element() <= 1.0),
        "a position outside the mesh frame"
    );
    assert!(
        mesh.normals.len() == vertices && mesh.normals.iter().all(|n| n.is_normalized()),
        "a normal that is no unit vector"
    );
    assert!(
        mesh.scale > 0.0 && mesh.scale.is_finite() && mesh.origin.is_finite(),
        "frame"
    );
    assert!(
        mesh.uvs
            .iter()
            .all(|uvs| uvs.len() == vertices && uvs.iter().all(|uv| uv.is_finite())),
        "texture coordinates"
    );
    assert!(
        mesh.attributes
            .values()
            .all(|values| values.len() == vertices),
        "attributes"
    );
    let areas = (0..mesh.triangles.len() as u32).map(|t| mesh.geometric_normal(t));
    assert!(
        areas.into_iter().all(|n| n.is_normalized()),
        "a triangle without area"
    );
    let accel = Accel::build(&mesh.positions, &mesh.triangles);
    for direction in [Vec3::NEG_Z, Vec3::X, Vec3::new(0.36, 0.48, 0.8)] {
        let ray = Ray {
            origin: -3.0 * direction,
            direction,
        };
        if let Some(hit) = accel.closest_hit(&ray, f32::INFINITY) {
            assert!((hit.triangle as usize) < mesh.triangles.len(), "hit");
        }
    }
    Ok(())
}

#[test]
fn exr_is_read_or_refused() {
    let read = |path: &Path| {
        // Both ways in; a file may be fit for one only.
        let channels = read_exr_channels(path).map(|(width, height, channels)| {
            assert!(
                channels.iter().all(|c| c.samples.len() == width * height),
                "channels"
            );
        });
        probe(path).and(channels.map_err(|e| e.to_string()))
    };
    fuzz(
        parser(
            "exr",
            "probe.exr",
            Form::Binary,
            seeds::exr(),
            PACKED,
            3_000,
        ),
        |_| (),
        read,
    );
}

#[test]
fn hdr_is_read_or_refused() {
    fuzz(
        parser("hdr", "probe.hdr", Form::Text, seeds::hdr(), PACKED, 6_000),
        |_| (),
        probe,
    );
}

/// An image is whole, and the light made of it finite and not negative.
fn probe(path: &Path) -> Outcome {
    let image = RgbImage::read(path).map_err(|e| e.to_string())?;
    assert_eq!(image.pixels.len(), image.width * image.height);
    if image.pixels.len() > 1 << 16 {
        return Ok(());
    }
    // What the probe says is about texels; the file is named by who read it.
    if let Ok((environment, _)) = Environment::new(image, 0.5) {
        let sound = |c: &f32| c.is_finite() && *c >= 0.0;
        assert!(
            environment.image().pixels.as_flattened().iter().all(sound),
            "radiance"
        );
        assert!(
            environment.mean_radiance().to_array().iter().all(sound),
            "mean radiance"
        );
    }
    Ok(())
}

#[test]
fn png_is_read_or_refused() {
    fuzz(
        parser("png", "mask.png", Form::Png, seeds::png(), PICTURE, 5_000),
        |_| (),
        picture,
    );
}

#[test]
fn jpeg_and_tiff_are_read_or_refused() {
    fuzz(
        parser(
            "photograph",
            "photograph.tiff",
            Form::Binary,
            seeds::photographs(),
            TAGGED,
            6_000,
        ),
        |_| (),
        picture,
    );
}

/// The same size as mask, as image and as map of numbers.
fn picture(path: &Path) -> Outcome {
    let mask = Mask::read(path).map_err(|e| e.to_string())?;
    assert_eq!(mask.pixels.len(), mask.width * mask.height);
    for image in [RgbImage::read(path), RgbImage::read_raw(path)] {
        let image = image.map_err(|e| e.to_string())?;
        assert_eq!((image.width, image.height), (mask.width, mask.height));
        assert_eq!(image.pixels.len(), mask.pixels.len());
    }
    Ok(())
}

/// The files that scenes name.
fn named(folder: &Path) {
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
        assert!(
            again.is_ok(),
            "what is written does not read back: {:?}\n{text}",
            again.err()
        );
        Ok(())
    };
    fuzz(
        parser(
            "scene",
            "scene.toml",
            Form::Text,
            seeds::scene(),
            FLAT,
            6_000,
        ),
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
        assert!(
            again.is_ok(),
            "what is written does not read back: {:?}\n{text}",
            again.err()
        );
        Ok(())
    };
    fuzz(
        parser(
            "capture",
            "capture.toml",
            Form::Text,
            seeds::capture(),
            FLAT,
            6_000,
        ),
        named,
        read,
    );
}

/// Axes are axes, and pixels have rays.
fn assert_camera(camera: &Camera) {
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
        parser(
            "map",
            "map.exr",
            Form::Binary,
            seeds::parameter_map(),
            TWO_PACKED,
            3_000,
        ),
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
        parser("property", "mesh.ply", Form::Text, seeds, FLAT, 6_000),
        scene,
        read,
    );
}

/// A fit folder with everything but what is damaged.
fn fit_folder(folder: &Path) {
    named(folder);
    let material = "ndf = \"ggx\"\nalpha = \"vertex:rough\"\nrho_d = 0.5\nrho_s = 1.0";
    std::fs::write(folder.join("scene.toml"), seeds::scene_of(material)).unwrap();
    std::fs::write(folder.join("mesh.ply"), seeds::ply_text(&[("rough", 0.2)])).unwrap();
    std::fs::write(folder.join("points.npz"), &seeds::points()[0]).unwrap();
    std::fs::write(folder.join("fit.toml"), &seeds::record()[0]).unwrap();
}

fn report(path: &Path) -> Outcome {
    let folder = path.parent().unwrap();
    write_report(folder, None, &folder.join("report.html")).map_err(|e| e.to_string())
}

#[test]
fn points_npz_is_read_or_refused() {
    let read = |path: &Path| {
        let table = PointTable::read_npz(path).map_err(|e| e.to_string())?;
        assert!(
            table.status.len() == table.len() && table.borrowed.len() == table.len(),
            "lengths"
        );
        report(path)
    };
    fuzz(
        parser(
            "points",
            "points.npz",
            Form::Zip,
            seeds::points(),
            FLAT,
            3_000,
        ),
        fit_folder,
        read,
    );
}

#[test]
fn fit_toml_is_read_or_refused() {
    fuzz(
        parser("record", "fit.toml", Form::Text, seeds::record(), FLAT, 400),
        fit_folder,
        report,
    );
}

#[test]
fn render_toml_is_read_or_refused() {
    let scene = |folder: &Path| {
        named(folder);
        let material = "ndf = \"ggx\"\nalpha = 0.2\nrho_d = 0.5\nrho_s = 1.0";
        std::fs::write(folder.join("scene.toml"), seeds::scene_of(material)).unwrap();
        std::fs::create_dir(folder.join("images")).unwrap();
        // The frame is there already: nothing is rendered.
        std::fs::write(folder.join("images/0000.exr"), "").unwrap();
    };
    let stage = OnceCell::new();
    let read = |path: &Path| {
        let out = path.parent().unwrap();
        let stage: &Stage =
            stage.get_or_init(|| Stage::load(&Scene::load(out).unwrap()).unwrap().0);
        let settings = SequenceSettings {
            out: out.to_owned(),
            frame: FrameSettings {
                sampling: Sampling::PerPixel(1),
                bounces: 1,
                seed: 0,
                skips: Skips::ALL,
            },
            frames: Some(0..1),
            resume: true,
            aovs: false,
        };
        // A file of another run is refused: the seed is one.
        match render_sequence(stage.scene(), stage, &settings, &|_| ()) {
            Ok(_) => Ok(()),
            Err(error) => {
                let error = error.to_string();
                assert!(error.contains(out.to_str().unwrap()), "{error}");
                Ok(())
            }
        }
    };
    fuzz(
        parser(
            "provenance",
            "render.toml",
            Form::Text,
            seeds::provenance(),
            FLAT,
            200,
        ),
        scene,
        read,
    );
}
