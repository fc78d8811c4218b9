//! COLMAP's sparse models: cameras and images, as text or binary.
//!
//! A model names its parameters in this order; distortion is OpenCV's. Principal points count from the
//! corner of the image. Poses are camera from world: `p_camera = R(q) p_world + t`.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::{ImportChoices, ImportError, ImportProblem, Imported, Parsed, Shot, position, side};
use super::{colmap_binary, colmap_text};
use crate::rig::{Distortion, Intrinsics, Lens};

/// COLMAP's models in the order of their numbers, and how many parameters each has.
pub(super) const MODELS: [(&str, usize); 12] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
];

/// A camera as it stands in the file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FileCamera {
    pub(super) id: u32,
    /// Place in [`MODELS`].
    pub(super) model: usize,
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) parameters: Vec<f64>,
}

/// An image as it stands in the file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FileImage {
    pub(super) id: u32,
    /// w, x, y, z.
    pub(super) quaternion: [f64; 4],
    pub(super) translation: [f64; 3],
    pub(super) camera: u32,
    pub(super) name: String,
}

/// Reads the model in `folder`.
pub(super) fn read(
    folder: &Path,
    binary: bool,
    choices: &ImportChoices,
) -> Result<Imported, ImportError> {
    let extension = if binary { "bin" } else { "txt" };
    let (camera_file, image_file) = (
        folder.join(format!("cameras.{extension}")),
        folder.join(format!("images.{extension}")),
    );
    let bytes =
        |file: &PathBuf| std::fs::read(file).map_err(|e| ImportProblem::Read(e).in_file(file));
    let (camera_bytes, image_bytes) = (bytes(&camera_file)?, bytes(&image_file)?);
    let (cameras, images) = if binary {
        (
            colmap_binary::cameras(&camera_bytes),
            colmap_binary::images(&image_bytes),
        )
    } else {
        (
            colmap_text::cameras(&camera_bytes),
            colmap_text::images(&image_bytes),
        )
    };
    let cameras = cameras.map_err(|problem| problem.in_file(&camera_file))?;
    let images = images.map_err(|problem| problem.in_file(&image_file))?;
    let lens = one_lens(&cameras, choices).map_err(|problem| problem.in_file(&camera_file))?;
    let shots = shots(images, &cameras, choices).map_err(|problem| problem.in_file(&image_file))?;
    Ok(Imported {
        format: if binary {
            "COLMAP, binary"
        } else {
            "COLMAP, text"
        },
        lens,
        shots,
        up: None,
    })
}

/// The lens that all cameras share, or that of the one chosen.
fn one_lens(cameras: &[FileCamera], choices: &ImportChoices) -> Parsed<Lens> {
    let ids = || {
        let ids: Vec<String> = cameras.iter().take(8).map(|c| c.id.to_string()).collect();
        ids.join(", ")
    };
    let chosen = match choices.camera {
        Some(id) => cameras.iter().find(|c| c.id == id).ok_or_else(|| {
            ImportProblem::value("--camera", id, format!("one of this file's: {}", ids()))
        })?,
        None => cameras.first().ok_or_else(|| {
            ImportProblem::missing("cameras", "the model is empty; export it again")
        })?,
    };
    let found = lens(chosen)?;
    if choices.camera.is_none() {
        for other in &cameras[1..] {
            if lens(other)? != found {
                return Err(ImportProblem::value(
                    format!("camera {}", other.id),
                    "another lens",
                    format!(
                        "that of camera {}, since one camera stands before a turntable; run COLMAP with a single \
                         camera (--ImageReader.single_camera 1), or choose with --camera one of {}",
                        chosen.id,
                        ids()
                    ),
                ));
            }
        }
    }
    Ok(found)
}

/// The lens of a camera whose model turnlight has.
fn lens(camera: &FileCamera) -> Parsed<Lens> {
    let name = format!("camera {}: ", camera.id);
    let (model, count) = MODELS[camera.model];
    let p = &camera.parameters;
    if p.len() != count {
        return Err(ImportProblem::value(
            format!("{name}parameters of {model}"),
            p.len(),
            format!("{count} numbers"),
        ));
    }
    let refused = |requirement: &str| {
        Err(ImportProblem::value(
            format!("{name}model"),
            model,
            requirement,
        ))
    };
    let radial = |k1, k2, p1, p2, k3| Distortion { k1, k2, p1, p2, k3 };
    let (fx, fy, cx, cy, distortion) = match model {
        "SIMPLE_PINHOLE" => (p[0], p[0], p[1], p[2], Distortion::default()),
        "PINHOLE" => (p[0], p[1], p[2], p[3], Distortion::default()),
        "SIMPLE_RADIAL" => (p[0], p[0], p[1], p[2], radial(p[3], 0.0, 0.0, 0.0, 0.0)),
        "RADIAL" => (p[0], p[0], p[1], p[2], radial(p[3], p[4], 0.0, 0.0, 0.0)),
        "OPENCV" => (p[0], p[1], p[2], p[3], radial(p[4], p[5], p[6], p[7], 0.0)),
        "FULL_OPENCV" => {
            if p[9..].iter().any(|k| *k != 0.0) {
                return refused(
                    "FULL_OPENCV with k4 = k5 = k6 = 0, or OPENCV; turnlight's lens has no denominator",
                );
            }
            (p[0], p[1], p[2], p[3], radial(p[4], p[5], p[6], p[7], p[8]))
        }
        _ => {
            return refused(
                "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL or OPENCV; undistort the images \
                 (colmap image_undistorter) and import that model",
            );
        }
    };
    let lens = Lens {
        width: side(&format!("{name}width"), camera.width)?,
        height: side(&format!("{name}height"), camera.height)?,
        intrinsics: Intrinsics { fx, fy, cx, cy },
        distortion,
    };
    lens.check()
        .map_err(|error| ImportProblem::lens(&error, &name))?;
    Ok(lens)
}

/// The images of the chosen camera, in the order of their names.
fn shots(
    mut images: Vec<FileImage>,
    cameras: &[FileCamera],
    choices: &ImportChoices,
) -> Parsed<Vec<Shot>> {
    images.retain(|image| choices.camera.is_none_or(|id| image.camera == id));
    images.sort_by(|a, b| a.name.cmp(&b.name));
    let shot = |image: &FileImage| {
        let name = format!("image {} ({}): ", image.id, image.name);
        if !cameras.iter().any(|camera| camera.id == image.camera) {
            let requirement = "a camera of cameras.txt or cameras.bin beside it";
            return Err(ImportProblem::value(
                format!("{name}camera"),
                image.camera,
                requirement,
            ));
        }
        let [w, x, y, z] = image.quaternion;
        let quaternion = DQuat::from_xyzw(x, y, z, w);
        let length = quaternion.length();
        if !length.is_finite() || (length - 1.0).abs() >= 1e-3 {
            return Err(ImportProblem::value(
                format!("{name}rotation"),
                quaternion,
                "a quaternion of length 1",
            ));
        }
        let object_from_camera = DMat3::from_quat((quaternion / length).conjugate());
        let translation = position(
            &format!("{name}translation"),
            DVec3::from_array(image.translation),
        )?;
        Ok(Shot {
            image: PathBuf::from(&image.name),
            object_from_camera: DAffine3 {
                matrix3: object_from_camera,
                translation: -(object_from_camera * translation),
            },
        })
    };
    images.iter().map(shot).collect()
}
