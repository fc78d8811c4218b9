//! Laws of the scene files: what is written reads back, what is wrong is named, nothing panics.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3, Vec3};
use proptest::prelude::*;
use tempfile::TempDir;

use super::*;
use crate::geometry::Similarity;

const SCENE: &str = r#"
[object]
mesh = "meshes/bunny.ply"
[material]
ndf = "ggx"
alpha = 0.2
rho_d = [0.4, 0.3, 0.2]
rho_s = 2.35
[probe]
image = "probe.exr"
rotation_deg = 90.0
[camera]
width = 64
height = 48
fov_x_deg = 32.0
position = [0.0, 1.37, 3.76]
look_at = [0.0, 0.0, 0.0]
[turntable]
axis = [0.0, 2.0, 0.0]
frames = 4
[sensor]
full_well_electrons = 30000.0
read_noise_electrons = 5.0
bits = 14
"#;

const CAPTURE: &str = r#"
[object]
mesh = "meshes/bunny.ply"
[probe]
image = "probe.exr"
[camera]
width = 64
height = 48
fov_x_deg = 32.0
position = [0.0, 1.37, 3.76]
look_at = [0.0, 0.0, 0.0]
[turntable]
center = [0.1, 0.0, 0.0]
[[frames]]
image = "probe.exr"
angle_deg = 0.0
[[frames]]
image = "probe.exr"
mask = "alpha.exr"
angle_deg = 5.0
exposure = 0.5
"#;

/// A folder with every file that the texts above name.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("meshes")).unwrap();
    for name in ["meshes/bunny.ply", "probe.exr", "alpha.exr"] {
        std::fs::write(folder.path().join(name), "").unwrap();
    }
    folder
}

fn scene(text: &str, folder: &Path) -> Result<Scene, String> {
    Scene::parse(text, &folder.join("scene.toml")).map_err(|error| error.to_string())
}

/// The error of the scene with `from` replaced by `to`, without the folder's name.
fn complaint(from: &str, to: &str) -> String {
    let folder = folder();
    assert!(SCENE.contains(from), "{from}");
    let error = scene(&SCENE.replacen(from, to, 1), folder.path()).unwrap_err();
    error.replace(&format!("{}/", folder.path().display()), "")
}

#[test]
fn scene_reads_every_section() {
    let folder = folder();
    std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    let scene = Scene::load(folder.path()).unwrap();
    assert_eq!(
        scene,
        Scene::load(folder.path().join("scene.toml")).unwrap()
    );
    assert_eq!(scene.object.mesh, folder.path().join("meshes/bunny.ply"));
    assert_eq!(scene.material.ggx, MapSource::Constant(1.0));
    assert_eq!(scene.material.alpha, MapSource::Constant(0.2));
    let rho_s = MapSource::Constant(Vec3::splat(2.35));
    assert_eq!(
        scene.material.specular,
        SpecularSource::Dielectric { eta: 1.3, rho_s }
    );
    assert_eq!(scene.turn.axis, DVec3::Y);
    assert!((scene.angles[1] - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    assert_eq!(scene.sensor.unwrap().exposure, 1.0);
}

#[test]
fn every_error_names_file_key_value_and_remedy() {
    let cases = [
        (
            "alpha = 0.2",
            "alhpa = 0.2",
            "scene.toml: material.alhpa: unknown key; did you mean alpha?",
        ),
        (
            "[sensor]",
            "[render]\n[sensor]",
            "scene.toml: render: unknown key; known here: object, material",
        ),
        (
            "alpha = 0.2",
            "alpha = 0",
            "scene.toml: material.alpha = 0: must be in [0.001, 1]; alpha is",
        ),
        (
            "alpha = 0.2",
            "alpha = nan",
            "scene.toml: material.alpha = nan: must be a finite number",
        ),
        (
            "alpha = 0.2",
            "",
            "scene.toml: material.alpha: missing; add a number in [0.001, 1]",
        ),
        (
            "alpha = 0.2",
            "alpha = \"a.exr\"",
            "scene.toml: material.alpha = \"a.exr\": no such file a.exr; paths",
        ),
        (
            "alpha = 0.2",
            "alpha = \"vertex:\"",
            "material.alpha = \"vertex:\": must be \"vertex:NAME\"",
        ),
        (
            "\"ggx\"",
            "\"gxx\"",
            "material.ndf = \"gxx\": must be \"beckmann\", \"ggx\" or a map of the GGX share; did you mean \"ggx\"?",
        ),
        (
            "[0.4, 0.3, 0.2]",
            "[0.4, -0.3, 0.2]",
            "material.rho_d[1] = -0.3: must be >= 0",
        ),
        (
            "[0.4, 0.3, 0.2]",
            "[0.4, 0.3]",
            "material.rho_d = [0.4, 0.3]: must be an array of 3 numbers",
        ),
        (
            "rho_s = 2.35",
            "rho_s = 1\nf0 = 0.04",
            "material.f0: contradicts fresnel = \"dielectric\"; remove f0, or set",
        ),
        (
            "rho_s = 2.35",
            "fresnel = \"schlick\"\nf0 = 0.04\neta = 1.5",
            "material.eta: contradicts fresnel = \"schlick\"; remove eta",
        ),
        (
            "rho_s = 2.35",
            "rho_s = 1\neta = 1.0",
            "material.eta = 1.0: must be in (1, 4]",
        ),
        (
            "fov_x_deg = 32.0",
            "fov_x_deg = 32.0\nfx = 9.0",
            "camera.fx: contradicts camera.fov_x_deg; remove fov_x_deg, or fx",
        ),
        ("fov_x_deg = 32.0", "fx = 9.0", "camera.fy: missing"),
        (
            "fov_x_deg = 32.0",
            "fov_x_deg = 180",
            "camera.fov_x_deg = 180: must be between 0 and 180",
        ),
        (
            "width = 64",
            "width = 64.0",
            "camera.width = 64.0: must be a whole number from 1 to 65536",
        ),
        (
            "look_at = [0.0, 0.0, 0.0]",
            "look_at = [0.0, 1.37, 3.76]",
            "camera.look_at = [0, 1.37, 3.76]: must be in front of",
        ),
        (
            "axis = [0.0, 2.0, 0.0]",
            "axis = [0, 0, 0]",
            "turntable.axis = [0, 0, 0]: must be a vector other than zero",
        ),
        (
            "frames = 4",
            "frames = 4\nangles_deg = [0]",
            "turntable.angles_deg: contradicts turntable.frames; remove one",
        ),
        (
            "bits = 14",
            "bits = 33",
            "sensor.bits = 33: must be a whole number from 1 to 32",
        ),
        (
            "rotation_deg = 90.0",
            "rotation_deg = \"90\"",
            "probe.rotation_deg = \"90\": must be a number",
        ),
        ("alpha = 0.2", "alpha = = 2", "scene.toml:6:9: "),
    ];
    for (from, to, expected) in cases {
        let error = complaint(from, to);
        assert!(error.contains(expected), "{to}: {error}");
    }
}

#[test]
fn capture_errors_name_the_frame() {
    let folder = folder();
    let file = folder.path().join("capture.toml");
    let error = |from: &str, to: &str| {
        Capture::parse(&CAPTURE.replacen(from, to, 1), &file)
            .unwrap_err()
            .to_string()
    };
    let found = error("exposure = 0.5", "exposure = -0.01");
    assert!(
        found.ends_with(
            "capture.toml: frames[1].exposure = -0.01: must be > 0; check the EXIF import"
        ),
        "{found}"
    );
    assert!(
        error("angle_deg = 5.0", "angel_deg = 5.0")
            .contains("frames[1].angel_deg: unknown key; did you mean angle_deg?")
    );
    assert!(
        error("[turntable]", "[turntable]\nframes = 2")
            .contains("remove frames and angles_deg from [turntable]")
    );
    assert!(error("[probe]", "[material]\n[probe]").contains("name the file scene.toml"));
    let missing = Capture::load(folder.path()).unwrap_err().to_string();
    assert!(missing.contains("capture.toml: No such file"), "{missing}");
}

#[test]
fn what_is_written_reads_back() {
    let folder = folder();
    let file = folder.path().join("scene.toml");
    let plain = Scene::parse(SCENE, &file).unwrap();
    let text = plain.to_toml(folder.path());
    assert!(
        text.contains("mesh = \"meshes/bunny.ply\"") && text.contains("frames = 4"),
        "{text}"
    );
    assert!(
        text.contains("fov_x_deg = 32.0") && text.contains("rotation_deg = 90.0"),
        "{text}"
    );
    assert_alike(&plain, &Scene::parse(&text, &file).unwrap());

    let mut rich = plain.clone();
    rich.material.ggx = MapSource::Constant(0.3);
    rich.material.alpha = MapSource::Texture(folder.path().join("alpha.exr"));
    rich.material.rho_d = MapSource::Vertex("rho_d".into());
    let f0 = MapSource::Constant(Vec3::new(0.1, 1.0 / 3.0, 1e-7));
    rich.material.specular = SpecularSource::Schlick {
        f0,
        f90: MapSource::Constant(0.9),
    };
    let rotation = DQuat::from_scaled_axis(DVec3::new(0.3, -0.2, 1.0));
    rich.object.object_from_file = Similarity {
        scale: 1e-3,
        rotation,
        translation: DVec3::new(0.1, 0.0, -2.0),
    };
    rich.camera.distortion.k1 = -0.1;
    rich.camera.intrinsics.cx += 0.25;
    rich.camera.world_from_camera *= DMat3::from_rotation_z(0.2);
    rich.angles = vec![0.0, -1.0, 7.0];
    rich.sensor = None;
    assert_alike(
        &rich,
        &Scene::parse(&rich.to_toml(folder.path()), &file).unwrap(),
    );

    let file = folder.path().join("capture.toml");
    let capture = Capture::parse(CAPTURE, &file).unwrap();
    let back = Capture::parse(&capture.to_toml(folder.path()), &file).unwrap();
    assert_eq!((&capture.frames, &capture.turn), (&back.frames, &back.turn));
}

#[test]
fn paths_are_written_relative_to_the_folder() {
    let folder = folder();
    let scene = Scene::parse(SCENE, &folder.path().join("scene.toml")).unwrap();
    let text = scene.to_toml(&folder.path().join("out/truth"));
    assert!(text.contains("mesh = \"../../meshes/bunny.ply\""), "{text}");
    let text = scene.to_toml(Path::new("/elsewhere"));
    assert!(
        text.contains(&format!("mesh = \"{}", folder.path().display())),
        "{text}"
    );
}

/// Equal up to the rounding of angles and directions.
fn assert_alike(a: &Scene, b: &Scene) {
    assert_eq!(
        (&a.object.mesh, &a.material, &a.sensor, &a.turn),
        (&b.object.mesh, &b.material, &b.sensor, &b.turn)
    );
    let (p, q) = (&a.object.object_from_file, &b.object.object_from_file);
    assert!(
        p.rotation.angle_between(q.rotation) < 1e-7
            && p.scale == q.scale
            && p.translation == q.translation
    );
    let (c, d) = (&a.camera, &b.camera);
    assert_eq!(
        (c.width, c.height, c.distortion, c.position),
        (d.width, d.height, d.distortion, d.position)
    );
    assert!(
        (c.intrinsics.fx / d.intrinsics.fx - 1.0).abs() < 1e-14
            && c.intrinsics.cx == d.intrinsics.cx
    );
    assert!(c.world_from_camera.abs_diff_eq(d.world_from_camera, 1e-14));
    assert!(
        (a.probe.rotation - b.probe.rotation).abs() < 1e-15 && a.angles.len() == b.angles.len()
    );
    assert!(
        a.angles
            .iter()
            .zip(&b.angles)
            .all(|(x, y)| (x - y).abs() < 1e-14)
    );
}

/// Text that is nearly a scene: a valid file with pieces overwritten by TOML fragments.
fn nearly_toml() -> impl Strategy<Value = String> {
    let fragment = prop::sample::select(vec![
        "[",
        "]",
        "[[frames]]",
        "=",
        "\n",
        "\"",
        "nan",
        "-inf",
        "1e999",
        "-1",
        "0",
        "9223372036854775807",
        "vertex:",
        "'''",
        "{",
        "}",
        "a.b.c = 1\n",
        "[object]",
        "\u{0}",
        "é",
        "1979-05-27",
        "true",
        "1e-320",
        "[1e308, -1e308, 1e308]",
        "[[1], 2]",
        "frames",
        "schlick",
        "# ",
    ]);
    (
        any::<bool>(),
        prop::collection::vec((any::<prop::sample::Index>(), 0usize..12, fragment), 0..5),
    )
        .prop_map(|(first, edits)| {
            let mut text: Vec<char> = if first { SCENE } else { CAPTURE }.chars().collect();
            for (at, length, fragment) in edits {
                let start = at.index(text.len().max(1)).min(text.len());
                text.splice(start..(start + length).min(text.len()), fragment.chars());
            }
            text.into_iter().collect()
        })
}

proptest! {
    #[test]
    fn any_text_is_read_or_refused(text in "\\PC*", structured in "([a-z_.\\[\\]={}\"'#, 0-9\n-]|frames|mesh){0,80}") {
        for text in [text, structured] {
            let _ = Scene::parse(&text, Path::new("scene.toml"));
            let _ = Capture::parse(&text, Path::new("capture.toml"));
        }
    }

    #[test]
    fn mutated_files_are_read_or_refused(text in nearly_toml()) {
        let folder = folder();
        let file = folder.path().join("x.toml");
        if let Ok(scene) = Scene::parse(&text, &file) {
            let again = Scene::parse(&scene.to_toml(folder.path()), &file);
            prop_assert!(again.is_ok(), "{:?}\n{}", again.err(), scene.to_toml(folder.path()));
        }
        if let Ok(capture) = Capture::parse(&text, &file) {
            prop_assert!(Capture::parse(&capture.to_toml(folder.path()), &file).is_ok());
        }
    }
}
