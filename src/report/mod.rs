//! Results as one self-contained HTML page: what was fitted, how well it reproduces the
//! observation, and what the parameters look like on the object. A registration has a page of its own.

mod charts;
mod densities;
mod document;
mod embed;
mod overlay;
mod page;
mod probe;
mod registration;
mod views;

pub use overlay::write_overlay;
pub use registration::{RegistrationPage, registration_text, write_registration_page};

use std::path::{Path, PathBuf};

pub use probe::{ProbePage, write_probe_page};

use crate::compare::{CompareError, SequenceErrors, compare_sequences, pair_frames};
use crate::export::{ExportError, NdfTable, PointTable};
use crate::image::{ImageError, RgbImage, write_atomically};
use crate::scene::{AssetError, Capture, Scene, SceneError};

/// Why a report could not be written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The fit's arrays.
    #[error(transparent)]
    Table(#[from] ExportError),
    /// The fit's scene or the capture.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A file that they name.
    #[error(transparent)]
    Asset(#[from] AssetError),
    /// An image.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The comparison with the reproduction.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// The fit's record.
    #[error("{}: {reason}; give a folder that `turnlight fit` wrote", path.display())]
    Record {
        /// `fit.toml`.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The page could not be written.
    #[error("{}: cannot be written: {source}; check the disk and the permissions", path.display())]
    Write {
        /// The page or an image in it.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

/// One frame as it was observed and, if there is a reproduction, as it is reproduced.
struct ShownFrame {
    name: String,
    observed: RgbImage,
    reproduced: Option<RgbImage>,
}

/// Frames shown on the page, evenly spread over the sequence.
const FRAMES_SHOWN: usize = 4;

/// What was observed, beside what is reproduced.
struct Observation {
    frames: Vec<ShownFrame>,
    errors: Option<SequenceErrors>,
}

impl Observation {
    /// A few frames, and the figures over all of them.
    fn read(capture: &Path, reproduced: Option<&Path>) -> Result<Self, ReportError> {
        // (name, photograph, its reproduction) of every frame.
        let files: Vec<(String, PathBuf, Option<PathBuf>)> = match reproduced {
            Some(folder) => pair_frames(capture, folder, None)?
                .into_iter()
                .map(|pair| (pair.name, pair.reference, Some(pair.test)))
                .collect(),
            None => (Capture::load(capture)?.frames.into_iter())
                .map(|frame| {
                    let name = frame.image.file_name().unwrap_or_default();
                    (name.to_string_lossy().into_owned(), frame.image, None)
                })
                .collect(),
        };
        let count = files.len();
        let shown = (0..FRAMES_SHOWN.min(count)).map(|i| i * count / FRAMES_SHOWN.min(count));
        let frames = shown
            .map(|number| {
                let (name, observed, reproduced) = &files[number];
                let reproduced = reproduced.as_deref().map(RgbImage::read).transpose()?;
                Ok(ShownFrame {
                    name: name.clone(),
                    observed: RgbImage::read(observed)?,
                    reproduced,
                })
            })
            .collect::<Result<Vec<_>, ReportError>>()?;
        let errors = reproduced
            .map(|folder| compare_sequences(capture, folder, None))
            .transpose()?;
        Ok(Self { frames, errors })
    }
}

/// Writes the page about the fit folder `fit` to `out`; `reproduced` is a folder that
/// `turnlight reproduce` wrote.
pub fn write_report(fit: &Path, reproduced: Option<&Path>, out: &Path) -> Result<(), ReportError> {
    let table = PointTable::read_npz(&fit.join("points.npz"))?;
    let record_path = fit.join("fit.toml");
    let record = |reason: String| ReportError::Record {
        path: record_path.clone(),
        reason,
    };
    let text = std::fs::read_to_string(&record_path).map_err(|e| record(e.to_string()))?;
    let settings: toml::Table = toml::from_str(&text).map_err(|e| record(e.to_string()))?;
    let capture_path = settings
        .get("capture")
        .and_then(toml::Value::as_str)
        .ok_or_else(|| record("it has no key capture".to_owned()))?;
    let scene = Scene::load(fit.join("scene.toml"))?;

    // The observation may have been moved away; the estimate can be shown without it.
    let observation = Observation::read(Path::new(capture_path), reproduced);
    let views = views::parameter_views(&scene, &table)?;
    let ndf_path = fit.join("ndf.npz");
    let densities = if ndf_path.exists() {
        Some(NdfTable::read_npz(&ndf_path)?)
    } else {
        None
    };
    let content = page::Page {
        record: &settings,
        table: &table,
        densities: densities.as_ref(),
        observation: &observation,
        views: &views,
    };
    let html = page::page(&content).map_err(|source| ReportError::Write {
        path: out.to_owned(),
        source,
    })?;
    write_atomically(out, |file| std::io::Write::write_all(file, html.as_bytes())).map_err(
        |source| ReportError::Write {
            path: out.to_owned(),
            source,
        },
    )
}
