//! Cameras from other programs' files.
//!
//! | format | camera axes | pose in the file | first pixel's centre | up |
//! |---|---|---|---|---|
//! | OpenCV FileStorage (YAML, JSON, XML) | right, down, forward | none is read | 0, 0 | |
//! | COLMAP (text, binary) | right, down, forward | camera from world | ½, ½ | any |
//! | NeRF, nerfstudio, instant-ngp `transforms.json` | right, up, backward | world from camera | ½, ½ | +Z |
//!
//! Everything becomes turnlight's: right, down, forward; object from camera; ½, ½. In such files the camera
//! goes round an object that lies still, so their world is turnlight's object frame; see
//! [`super::Orbit`] for the turntable.

mod colmap;
mod colmap_binary;
mod colmap_text;
#[cfg(test)]
mod laws;
mod opencv;
mod opencv_store;
mod transforms;

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3};

use super::{CameraError, Lens};

/// One photograph and where its camera stood.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// The image, resolved against the file's folder (COLMAP: as it stands in the file).
    pub image: PathBuf,
    /// Camera axes (right, down, forward) to the file's world, which is the object's frame.
    pub object_from_camera: DAffine3,
}

/// What a file says.
#[derive(Clone, Debug)]
pub struct Imported {
    /// What kind of file it was.
    pub format: &'static str,
    /// The lens of all photographs.
    pub lens: Lens,
    /// Poses, where the format has them.
    pub shots: Vec<Shot>,
    /// Which way is up in the file's world, if the format says so.
    pub up: Option<DVec3>,
}

/// What the file may leave open.
#[derive(Clone, Debug, Default)]
pub struct ImportChoices {
    /// Take only this camera of a COLMAP model.
    pub camera: Option<u32>,
    /// Columns and rows of the image, where the file has none.
    pub size: Option<(usize, usize)>,
    /// Names of camera matrix and distortion in an OpenCV file.
    pub keys: Option<(String, String)>,
}

/// A file that cannot be used, by name.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", file.display())]
pub struct ImportError {
    /// The file.
    pub file: PathBuf,
    /// What is wrong with it.
    pub problem: ImportProblem,
}

/// What is wrong with a camera file.
#[derive(Debug, thiserror::Error)]
pub enum ImportProblem {
    /// It cannot be read.
    #[error("{0}; check the path and its permissions")]
    Read(std::io::Error),
    /// It is damaged, or another kind of file.
    #[error("{place}: {reason}; check that the file is complete, or export it again")]
    Damaged {
        /// Line, byte or field.
        place: String,
        /// What is wrong there.
        reason: String,
    },
    /// A field is absent.
    #[error("{field}: missing; {remedy}")]
    Missing {
        /// The field.
        field: String,
        /// What to do.
        remedy: String,
    },
    /// A value is not allowed.
    #[error("{field} = {value}: must be {requirement}")]
    Value {
        /// The field.
        field: String,
        /// Its value.
        value: String,
        /// What is allowed, and a remedy where there is a likely one.
        requirement: String,
    },
}

/// Results before anyone knows which file they are about.
type Parsed<T> = Result<T, ImportProblem>;

impl ImportProblem {
    fn damaged(place: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Damaged {
            place: place.into(),
            reason: reason.into(),
        }
    }

    fn missing(field: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Missing {
            field: field.into(),
            remedy: remedy.into(),
        }
    }

    fn value(
        field: impl Into<String>,
        value: impl ToString,
        requirement: impl Into<String>,
    ) -> Self {
        Self::Value {
            field: field.into(),
            value: value.to_string(),
            requirement: requirement.into(),
        }
    }

    fn in_file(self, file: &Path) -> ImportError {
        ImportError {
            file: file.to_owned(),
            problem: self,
        }
    }

    /// A camera's own complaint, under the name that the file has for it.
    fn lens(error: &CameraError, camera: &str) -> Self {
        match error {
            CameraError::Value {
                field,
                value,
                requirement,
            } => Self::value(format!("{camera}{field}"), value, *requirement),
            CameraError::View { problem, .. } => {
                Self::damaged(camera, format!("the view direction is {problem}"))
            }
        }
    }
}

/// Reads the cameras of a file, or of the model in a folder.
///
/// # Errors
/// The kind of file is unknown, it is damaged, or it describes a lens that turnlight has not.
pub fn import(path: &Path, choices: &ImportChoices) -> Result<Imported, ImportError> {
    let extension = path
        .extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default();
    let name = path
        .file_name()
        .map(|n| n.to_string_lossy().into_owned())
        .unwrap_or_default();
    if path.is_dir() {
        return import_folder(path, choices);
    }
    match (name.as_str(), extension.as_str()) {
        ("cameras.bin" | "images.bin" | "cameras.txt" | "images.txt", _) => {
            let folder = path.parent().unwrap_or(Path::new(""));
            colmap::read(folder, extension == "bin", choices)
        }
        (_, "json") => {
            let text = read_text(path)?;
            let value: serde_json::Value = serde_json::from_str(&text).map_err(|error| {
                let place = format!("line {}, column {}", error.line(), error.column());
                ImportProblem::damaged(place, error.to_string()).in_file(path)
            })?;
            if value.get("frames").is_some() {
                transforms::read(path, &value, choices)
            } else {
                let store = opencv_store::from_json(&value);
                opencv::read(&store, choices).map_err(|problem| problem.in_file(path))
            }
        }
        (_, "yml" | "yaml") => {
            let store = opencv_store::from_yaml(&read_text(path)?);
            store
                .and_then(|store| opencv::read(&store, choices))
                .map_err(|problem| problem.in_file(path))
        }
        (_, "xml") => {
            let store = opencv_store::from_xml(&read_text(path)?);
            store
                .and_then(|store| opencv::read(&store, choices))
                .map_err(|problem| problem.in_file(path))
        }
        _ => Err(ImportProblem::damaged(
            "name",
            "neither a folder of COLMAP, nor a .json, .yml, .yaml or .xml file, nor COLMAP's cameras.bin or .txt",
        )
        .in_file(path)),
    }
}

fn import_folder(folder: &Path, choices: &ImportChoices) -> Result<Imported, ImportError> {
    for inside in ["", "sparse/0", "sparse"] {
        let model = folder.join(inside);
        for (name, binary) in [("cameras.bin", true), ("cameras.txt", false)] {
            if model.join(name).is_file() {
                return colmap::read(&model, binary, choices);
            }
        }
    }
    for name in ["transforms.json", "transforms_train.json"] {
        let file = folder.join(name);
        if file.is_file() {
            return import(&file, choices);
        }
    }
    let remedy = "name a folder with cameras.bin and images.bin, cameras.txt and images.txt, or transforms.json";
    Err(ImportProblem::missing("cameras", remedy).in_file(folder))
}

fn read_text(path: &Path) -> Result<String, ImportError> {
    let bytes = std::fs::read(path).map_err(|e| ImportProblem::Read(e).in_file(path))?;
    String::from_utf8(bytes).map_err(|error| {
        let place = format!("byte {}", error.utf8_error().valid_up_to());
        ImportProblem::damaged(place, "not text in UTF-8").in_file(path)
    })
}

/// An image side, checked.
fn side(field: &str, value: f64) -> Parsed<usize> {
    if value.fract() == 0.0 && (1.0..=65536.0).contains(&value) {
        return Ok(value as usize);
    }
    Err(ImportProblem::value(
        field,
        value,
        "a whole number of pixels from 1 to 65536",
    ))
}

/// The rotation nearest to `matrix`, which must be one but for the digits of a text file.
fn rotation(field: &str, matrix: DMat3) -> Parsed<DMat3> {
    let off = matrix.transpose() * matrix - DMat3::IDENTITY;
    let worst = off
        .to_cols_array()
        .into_iter()
        .fold(0.0, |a: f64, b| if b.is_nan() { b } else { a.max(b.abs()) });
    if worst.is_nan() || worst > 1e-3 || matrix.determinant() < 0.0 {
        let requirement =
            "a rotation: right-handed, its columns of length 1 and square to each other";
        return Err(ImportProblem::value(
            field,
            format!("{:?}", matrix.to_cols_array_2d()),
            requirement,
        ));
    }
    Ok(super::calibration::nearest_rotation(matrix))
}

/// A camera's place; beyond this, single steps are lost to rounding.
fn position(field: &str, place: DVec3) -> Parsed<DVec3> {
    if place.is_finite() && place.abs().max_element() <= 1e9 {
        return Ok(place);
    }
    Err(ImportProblem::value(field, place, "finite and within ±1e9"))
}
