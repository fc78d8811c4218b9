//! Laws of the importers: a camera written in a format's own terms projects to the same pixels once read;
//! what is wrong is named, and nothing panics.

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};
use proptest::prelude::*;
use tempfile::TempDir;

use super::*;
use crate::rig::{Camera, Distortion, Intrinsics, fit_orbit};

/// Twelve frames of a turntable, as the camera sees them from the object: camera, and poses.
fn rig() -> (Camera, Vec<DAffine3>) {
    let lens = Lens {
        width: 800,
        height: 600,
        intrinsics: Intrinsics {
            fx: 910.5,
            fy: 905.25,
            cx: 411.75,
            cy: 290.5,
        },
        distortion: Distortion {
            k1: -0.11,
            k2: 0.04,
            p1: 1e-3,
            p2: -2e-3,
            k3: 0.0,
        },
    };
    let forward = DVec3::new(-0.1, -0.3, -1.0).normalize();
    let right = forward.cross(DVec3::new(0.05, 1.0, 0.0)).normalize();
    let camera = lens
        .camera(DVec3::new(0.5, 1.25, 4.0), forward, forward.cross(right))
        .unwrap();
    let turn = crate::geometry::Turn {
        axis: DVec3::new(0.02, 1.0, -0.01).normalize(),
        center: DVec3::new(0.1, 0.0, -0.05),
    };
    let world_from_camera = DAffine3 {
        matrix3: camera.world_from_camera,
        translation: camera.position,
    };
    let poses = (0..12)
        .map(|i| turn.world_from_object(0.5 * f64::from(i)).inverse() * world_from_camera)
        .collect();
    (camera, poses)
}

/// Where a point of the object is seen: by definition, the pinhole equation and OpenCV's distortion, the
/// pixel counted from the image's corner.
fn seen(camera: &Camera, object_from_camera: &DAffine3, point: DVec3) -> DVec2 {
    camera
        .project_from_camera(object_from_camera.inverse().transform_point3(point))
        .unwrap()
}

/// The imported cameras see the same pixels, to 1e-6; then the turntable that follows from them does, too.
fn assert_same_pixels(imported: &Imported, camera: &Camera, poses: &[DAffine3]) {
    let points = [
        DVec3::new(0.3, -0.2, 0.1),
        DVec3::new(-0.5, 0.4, -0.3),
        DVec3::ZERO,
    ];
    assert_eq!(imported.shots.len(), poses.len());
    let orbit = fit_orbit(
        &imported
            .shots
            .iter()
            .map(|shot| shot.object_from_camera)
            .collect::<Vec<_>>(),
    )
    .unwrap();
    let [right, down, forward] = [0, 1, 2].map(|i| orbit.world_from_camera.matrix3.col(i));
    assert!((right.cross(down) - forward).length() < 1e-9);
    let turned = imported
        .lens
        .camera(orbit.world_from_camera.translation, forward, down)
        .unwrap();
    for (i, pose) in poses.iter().enumerate() {
        for point in points {
            let expected = seen(camera, pose, point);
            let ideal = imported.shots[i]
                .object_from_camera
                .inverse()
                .transform_point3(point);
            let found = imported.lens.pixel(ideal.truncate() / ideal.z);
            assert!(
                (found - expected).length() < 1e-6,
                "{found}, not {expected}"
            );
            let world = orbit
                .turn
                .world_from_object(orbit.angles[i])
                .transform_point3(point);
            let found = turned.project(world).unwrap();
            assert!(
                (found - expected).length() < 1e-6,
                "turned: {found}, not {expected}"
            );
        }
    }
}

fn quaternion_and_translation(pose: &DAffine3) -> (DQuat, DVec3) {
    let camera_from_object = pose.inverse();
    (
        DQuat::from_mat3(&camera_from_object.matrix3).normalize(),
        camera_from_object.translation,
    )
}

/// The model as COLMAP writes it, images in reverse.
fn colmap_text(folder: &Path, camera: &Camera, poses: &[DAffine3]) {
    let (k, d) = (&camera.intrinsics, &camera.distortion);
    let cameras = format!(
        "# Camera list\n1 OPENCV 800 600 {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?}\n",
        k.fx, k.fy, k.cx, k.cy, d.k1, d.k2, d.p1, d.p2
    );
    let mut images = "# Image list\n".to_owned();
    for (i, pose) in poses.iter().enumerate().rev() {
        let (q, t) = quaternion_and_translation(pose);
        let points = if i % 2 == 0 {
            "1.5 2.5 -1 3.0 4.0 7"
        } else {
            ""
        };
        images += &format!(
            "{} {:?} {:?} {:?} {:?} {:?} {:?} {:?} 1 frame {i:02}.jpg\n{points}\n",
            i + 1,
            q.w,
            q.x,
            q.y,
            q.z,
            t.x,
            t.y,
            t.z
        );
    }
    std::fs::write(folder.join("cameras.txt"), cameras).unwrap();
    std::fs::write(folder.join("images.txt"), images).unwrap();
}

fn colmap_binary(folder: &Path, camera: &Camera, poses: &[DAffine3]) {
    let (k, d) = (&camera.intrinsics, &camera.distortion);
    let mut cameras = 1u64.to_le_bytes().to_vec();
    for number in [1u32, 4] {
        cameras.extend(number.to_le_bytes());
    }
    for side in [800u64, 600] {
        cameras.extend(side.to_le_bytes());
    }
    for number in [k.fx, k.fy, k.cx, k.cy, d.k1, d.k2, d.p1, d.p2] {
        cameras.extend(number.to_le_bytes());
    }
    let mut images = (poses.len() as u64).to_le_bytes().to_vec();
    for (i, pose) in poses.iter().enumerate() {
        let (q, t) = quaternion_and_translation(pose);
        images.extend((i as u32 + 1).to_le_bytes());
        for number in [q.w, q.x, q.y, q.z, t.x, t.y, t.z] {
            images.extend(number.to_le_bytes());
        }
        images.extend(1u32.to_le_bytes());
        images.extend(format!("{i:02}.jpg\0").as_bytes());
        images.extend(2u64.to_le_bytes());
        images.extend([7u8; 48]);
    }
    std::fs::write(folder.join("cameras.bin"), cameras).unwrap();
    std::fs::write(folder.join("images.bin"), images).unwrap();
}

/// NeRF's axes: right, up, backward; its world: +Z up.
fn transforms(camera: &Camera, poses: &[DAffine3]) -> serde_json::Value {
    let (k, d) = (&camera.intrinsics, &camera.distortion);
    let frames: Vec<serde_json::Value> = poses
        .iter()
        .enumerate()
        .map(|(i, pose)| {
            let m = pose.matrix3;
            let axes = DMat3::from_cols(m.x_axis, -m.y_axis, -m.z_axis);
            let row = |r: usize| {
                let row = axes.row(r);
                [row.x, row.y, row.z, pose.translation[r]]
            };
            serde_json::json!({
                "file_path": format!("./images/{i:02}.jpg"),
                "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
            })
        })
        .collect();
    serde_json::json!({
        "camera_model": "OPENCV", "w": 800, "h": 600, "fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy,
        "k1": d.k1, "k2": d.k2, "p1": d.p1, "p2": d.p2, "frames": frames,
    })
}

fn written(name: &str, text: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

fn read(path: &Path) -> Result<Imported, String> {
    import(path, &ImportChoices::default()).map_err(|error| error.to_string())
}

#[test]
fn colmap_text_and_binary_project_to_the_same_pixels() {
    let (camera, poses) = rig();
    for write in [colmap_text, colmap_binary] {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &camera, &poses);
        let imported = read(folder.path()).unwrap();
        assert_same_pixels(&imported, &camera, &poses);
        assert!(
            imported.shots[3]
                .image
                .to_str()
                .unwrap()
                .ends_with("03.jpg")
        );
    }
}

#[test]
fn transforms_json_projects_to_the_same_pixels() {
    let (camera, poses) = rig();
    let mut value = transforms(&camera, &poses);
    let (folder, path) = written("transforms.json", &value.to_string());
    let imported = read(folder.path()).unwrap();
    assert_same_pixels(&imported, &camera, &poses);
    assert_eq!(imported.shots[2].image, folder.path().join("images/02.jpg"));
    assert_eq!(imported.up, Some(DVec3::Z));
    // The same intrinsics in every frame.
    let top = value.as_object_mut().unwrap();
    let fl_x = top.remove("fl_x").unwrap();
    for frame in top["frames"].as_array_mut().unwrap() {
        frame["fl_x"] = fl_x.clone();
    }
    std::fs::write(&path, value.to_string()).unwrap();
    assert_same_pixels(&read(&path).unwrap(), &camera, &poses);
}

#[test]
fn nerf_scenes_take_their_size_from_the_image_and_their_focal_length_from_the_angle() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("train")).unwrap();
    let image = crate::image::RgbImage::constant(40, 30, [0.5; 3]);
    let png = folder.path().join("train/r_0.png");
    crate::image::write_png(&png, &image, crate::image::ToneCurve::default()).unwrap();
    let text = r#"{"camera_angle_x": 0.8, "frames": [{"file_path": "./train/r_0",
        "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]}"#;
    let path = folder.path().join("transforms_train.json");
    std::fs::write(&path, text).unwrap();
    let lens = read(&path).unwrap().lens;
    assert_eq!(lens.intrinsics, Intrinsics::from_fov_x(40, 30, 0.8));
    std::fs::remove_file(png).unwrap();
    let error = read(&path).unwrap_err();
    assert!(
        error.contains("w and h: missing") && error.contains("--size"),
        "{error}"
    );
}

const OPENCV: &str = "%YAML:1.0\n---\nimage_width: 800\nimage_height: 600\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   \
    cols: 3\n   dt: d\n   data: [ 910.5, 0., 411.25, 0., 905.25,\n       290., 0., 0., 1. ]\ndistortion_coefficients: \
    !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ -0.11, 0.04, 1.0e-03, -2.0e-03, 0. ]\n";

#[test]
fn opencv_counts_pixels_from_the_centre_of_the_first() {
    let (camera, _) = rig();
    let (_folder, path) = written("camera.yml", OPENCV);
    let imported = read(&path).unwrap();
    // The same lens whose principal point OpenCV has half a pixel less.
    assert_eq!(imported.lens, Lens::of(&camera));
    assert!(imported.shots.is_empty());
}

#[test]
fn wrong_fields_are_named_with_file_value_and_remedy() {
    for (from, to, named) in [
        (
            "image_width: 800\n",
            "",
            "image_width and image_height: missing; give the size",
        ),
        (
            "image_width: 800",
            "image_width: 8.5",
            "image_width = 8.5: must be a whole number",
        ),
        (
            "camera_matrix",
            "left_matrix",
            "camera_matrix: missing; this file has the matrices left_matrix, distortion",
        ),
        (
            "910.5, 0.,",
            "910.5, 2.,",
            "camera_matrix.data[0][1] = 2: must be 0",
        ),
        ("910.5", "-910.5", "fx = -910.5: must be finite and > 0"),
        (
            "-0.11,",
            "-0.11, 1.,",
            "distortion_coefficients.data = 6 numbers: must be",
        ),
        (
            "0. ]\n",
            "0., 0.1, 0., 0. ]\n",
            "distortion_coefficients.data[5] = 0.1: must be 0",
        ),
        (
            "image_width",
            "fisheye_model: 1\nimage_width",
            "fisheye_model = 1: must be 0",
        ),
        (
            "-0.11",
            "-11.0",
            "distortion = -11: must be a lens that can be inverted",
        ),
    ] {
        assert!(OPENCV.contains(from), "{from}");
        // The last one, where there are several.
        let at = if from.starts_with("0. ]") {
            OPENCV.rfind(from)
        } else {
            OPENCV.find(from)
        }
        .unwrap();
        let text = format!("{}{to}{}", &OPENCV[..at], &OPENCV[at + from.len()..]);
        let (_folder, path) = written("camera.yml", &text);
        let error = read(&path).unwrap_err();
        assert!(
            error.contains("camera.yml: ") && error.contains(named),
            "{error}"
        );
    }
    let (camera, poses) = rig();
    let good = transforms(&camera, &poses[..2]).to_string();
    for (from, to, named) in [
        (
            "\"OPENCV\"",
            "\"OPENCV_FISHEYE\"",
            "camera_model = \"OPENCV_FISHEYE\": must be OPENCV, PINHOLE",
        ),
        ("\"w\":800", "\"w\":0", "w = 0: must be a whole number"),
        (
            "\"fl_x\":910.5",
            "\"fl_x\":\"wide\"",
            "fl_x = \"wide\": must be a number",
        ),
        ("\"fl_x\":910.5,", "", "fl_x: missing; or camera_angle_x"),
        ("\"w\":", "\"k4\":0.5,\"w\":", "k4 = 0.5: must be 0"),
        (
            "transform_matrix",
            "transform",
            "frames[0].transform_matrix: missing",
        ),
        (
            "./images/00.jpg\"",
            "./images/00.jpg\",\"fl_x\":900",
            "frames[1] = another lens: must be that of frames[0]",
        ),
        (
            "[0.0,0.0,0.0,1.0]]",
            "[0.0,0.0,0.0,1.0],[1.0]]",
            "frames[0].transform_matrix = [[",
        ),
        ("\"frames\"", "\"frames\":[],\"views\"", "frames: missing"),
    ] {
        assert!(good.contains(from), "{from} {good}");
        let (_folder, path) = written("transforms.json", &good.replacen(from, to, 1));
        let error = read(&path).unwrap_err();
        assert!(
            error.contains("transforms.json: ") && error.contains(named),
            "{error}"
        );
    }
}

#[test]
fn colmap_models_without_a_lens_here_are_refused_by_name() {
    let (camera, poses) = rig();
    let folder = tempfile::tempdir().unwrap();
    colmap_text(folder.path(), &camera, &poses);
    let images = std::fs::read_to_string(folder.path().join("images.txt")).unwrap();
    let cameras = |text: &str| std::fs::write(folder.path().join("cameras.txt"), text).unwrap();
    for (model, lens) in [
        ("SIMPLE_PINHOLE 800 600 900 400 300", Ok((900.0, 0.0, 0.0))),
        ("PINHOLE 800 600 900 901 400 300", Ok((901.0, 0.0, 0.0))),
        (
            "SIMPLE_RADIAL 800 600 900 400 300 -0.1",
            Ok((900.0, -0.1, 0.0)),
        ),
        (
            "RADIAL 800 600 900 400 300 -0.1 0.02",
            Ok((900.0, -0.1, 0.0)),
        ),
        (
            "FULL_OPENCV 800 600 900 902 400 300 -0.1 0.02 0 0 0.01 0 0 0",
            Ok((902.0, -0.1, 0.01)),
        ),
        (
            "FULL_OPENCV 800 600 900 902 400 300 -0.1 0.02 0 0 0.01 0.1 0 0",
            Err("model = FULL_OPENCV: must be FULL_OPENCV with k4"),
        ),
        (
            "OPENCV_FISHEYE 800 600 900 902 400 300 0 0 0 0",
            Err("model = OPENCV_FISHEYE: must be SIMPLE_PINHOLE"),
        ),
        (
            "FOV 800 600 900 902 400 300 0.1",
            Err("model = FOV: must be"),
        ),
        (
            "PINHOLE 800 600 900 901 400",
            Err("line 1: PARAMS[3] is missing"),
        ),
        (
            "PINHOLE 800 600 900 901 400 300 1",
            Err("line 1: more than the 4 parameters"),
        ),
        (
            "PINHOLES 800 600 900",
            Err("line 1: MODEL = PINHOLES: must be one of"),
        ),
        (
            "PINHOLE 800 600 nine",
            Err("line 1: PARAMS[0] = nine: must be a number"),
        ),
    ] {
        cameras(&format!("1 {model}\n"));
        match (read(folder.path()), lens) {
            (Ok(imported), Ok((fy, k1, k3))) => {
                assert_eq!(imported.lens.intrinsics.fy, fy);
                assert_eq!(imported.lens.intrinsics.cx, 400.0);
                assert_eq!(
                    (imported.lens.distortion.k1, imported.lens.distortion.k3),
                    (k1, k3)
                );
            }
            (Err(error), Err(named)) => assert!(
                error.contains("cameras.txt: ") && error.contains(named),
                "{error}"
            ),
            (found, _) => panic!("{model}: {found:?}"),
        }
    }
    cameras("1 PINHOLE 800 600 900 901 400 300\n2 PINHOLE 800 600 950 951 400 300\n");
    let error = read(folder.path()).unwrap_err();
    assert!(error.contains("--camera one of 1, 2"), "{error}");
    let second = ImportChoices {
        camera: Some(2),
        ..ImportChoices::default()
    };
    assert_eq!(
        import(folder.path(), &second).unwrap().lens.intrinsics.fx,
        950.0
    );
    cameras("7 PINHOLE 800 600 900 901 400 300\n");
    let error = read(folder.path()).unwrap_err();
    assert!(
        error.contains("images.txt: ") && error.contains("camera = 1: must be a camera"),
        "{error}"
    );
    cameras("1 PINHOLE 800 600 900 901 400 300\n");
    let cut: Vec<&str> = images.lines().skip(1).take(1).collect();
    std::fs::write(folder.path().join("images.txt"), cut[0].split_at(20).0).unwrap();
    let error = read(folder.path()).unwrap_err();
    assert!(error.contains("images.txt: line 1"), "{error}");
}

#[test]
fn truncated_binary_models_are_refused_at_every_length() {
    let (camera, poses) = rig();
    let folder = tempfile::tempdir().unwrap();
    colmap_binary(folder.path(), &camera, &poses[..2]);
    for name in ["cameras.bin", "images.bin"] {
        let whole = std::fs::read(folder.path().join(name)).unwrap();
        for length in 0..whole.len() {
            std::fs::write(folder.path().join(name), &whole[..length]).unwrap();
            let error = read(folder.path()).unwrap_err();
            assert!(error.contains(name) && error.contains("byte"), "{error}");
        }
        // A count beyond what the file can hold.
        let mut large = whole.clone();
        large[..8].copy_from_slice(&u64::MAX.to_le_bytes());
        std::fs::write(folder.path().join(name), &large).unwrap();
        let error = read(folder.path()).unwrap_err();
        assert!(error.contains("but room for"), "{error}");
        std::fs::write(folder.path().join(name), &whole).unwrap();
    }
    assert!(read(folder.path()).is_ok());
}

proptest! {
    #[test]
    fn no_text_panics(text in "\\PC{0,200}") {
        for name in ["a.yml", "a.xml", "a.json", "cameras.txt"] {
            let (_folder, path) = written(name, &text);
            let _ = read(&path);
        }
    }
}
