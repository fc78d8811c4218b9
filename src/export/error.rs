//! Why something could not be written, or a written table not be read.

use std::path::{Path, PathBuf};

use crate::image::ImageError;
use crate::mesh::MeshError;

/// A failed export, or a file of an earlier one that cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The system refused, or the file is not what its name says.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system or the decoder said.
        reason: String,
    },
    /// An image of the results cannot be written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The mesh of the results cannot be written.
    #[error(transparent)]
    Geometry(#[from] MeshError),
    /// An array of `points.npz` is absent.
    #[error("{}: no array {name}; write the file with this version of turnlight", path.display())]
    MissingArray {
        /// The file.
        path: PathBuf,
        /// Name of the array.
        name: &'static str,
    },
    /// An array has the wrong type or shape, here or in a file.
    #[error("{}: {name} is {found}; must be {expected}", path.display())]
    Array {
        /// The file.
        path: PathBuf,
        /// Name of the array.
        name: &'static str,
        /// Type and shape.
        found: String,
        /// Type and shape, in C order.
        expected: String,
    },
    /// The scene holds something that Mitsuba has no equal for.
    #[error("{key}: Mitsuba has no {lacks}; {remedy}")]
    Unsupported {
        /// Key as in `scene.toml`.
        key: &'static str,
        /// What is missing there.
        lacks: &'static str,
        /// What the user can do.
        remedy: &'static str,
    },
    /// A material parameter refers to something that the mesh lacks.
    #[error("{key}: the mesh has no {lacks}; {remedy}")]
    Mesh {
        /// Key as in `scene.toml`.
        key: &'static str,
        /// What the mesh lacks.
        lacks: String,
        /// What the user can do.
        remedy: String,
    },
}

impl ExportError {
    /// Wraps whatever went wrong with the file at `path`.
    pub(super) fn file(path: &Path, reason: impl std::fmt::Display) -> Self {
        Self::File {
            path: path.to_path_buf(),
            reason: reason.to_string(),
        }
    }
}
