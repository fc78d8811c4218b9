//! Why colours cannot be matched.

use std::path::PathBuf;

/// Why colours cannot be matched.
#[derive(Debug, thiserror::Error)]
pub enum ColourError {
    /// A file of patches.
    #[error("{}: {fault}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Line, value, what it must be.
        fault: String,
    },
    /// A patch of an image.
    #[error("{}: patch {number} at ({x:.0}, {y:.0}) {fault}", path.display())]
    Patch {
        /// The image.
        path: PathBuf,
        /// Its number from 1, row by row.
        number: usize,
        /// Its centre, pixels.
        x: f64,
        /// Its centre, pixels.
        y: f64,
        /// What is wrong with it, and the remedy.
        fault: String,
    },
    /// The patches do not belong together or tell nothing.
    #[error("{reason}; {remedy}")]
    Data {
        /// What is wrong.
        reason: String,
        /// What the user can do.
        remedy: String,
    },
}

impl ColourError {
    /// Whether the input is sound but does not hold what was asked for.
    pub fn is_about_data(&self) -> bool {
        matches!(self, Self::Data { .. })
    }
}
