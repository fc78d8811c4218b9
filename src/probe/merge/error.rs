//! Why a bracket cannot be merged.

use std::path::PathBuf;

use crate::image::Depth;

/// Why a bracket cannot be merged.
#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    /// Nothing to merge.
    #[error("a bracket of {count} images: at least 2 are needed; give every exposure")]
    TooFew {
        /// Images given.
        count: usize,
    },
    /// Not a time.
    #[error("{}: exposure = {exposure}: must be > 0 (1e-15 to 1e15); give the times with --times", name.display())]
    Exposure {
        /// The image.
        name: PathBuf,
        /// Its exposure.
        exposure: f64,
    },
    /// All alike.
    #[error(
        "every exposure is {exposure}: a bracket needs different ones; give the times with --times"
    )]
    SameExposure {
        /// The exposure.
        exposure: f64,
    },
    /// Sizes differ.
    #[error(
        "{}: size = {} × {}: must be {} × {} as in {}; give images of one camera setting",
        name.display(), size.0, size.1, expected.0, expected.1, first.display()
    )]
    Size {
        /// The image that differs.
        name: PathBuf,
        /// Its columns and rows.
        size: (usize, usize),
        /// The first image.
        first: PathBuf,
        /// The first image's columns and rows.
        expected: (usize, usize),
    },
    /// Kinds of samples differ.
    #[error(
        "{}: samples = {depth:?}: must be {expected:?} as in {}; give files of one kind",
        name.display(), first.display()
    )]
    Depth {
        /// The image that differs.
        name: PathBuf,
        /// Its samples.
        depth: Depth,
        /// The first image.
        first: PathBuf,
        /// The first image's samples.
        expected: Depth,
    },
    /// NaN or infinite.
    #[error(
        "{}: pixel ({column}, {row}) is NaN or infinite; export the image again",
        name.display()
    )]
    NotFinite {
        /// The image.
        name: PathBuf,
        /// Column.
        column: usize,
        /// Row.
        row: usize,
    },
    /// A response's file.
    #[error("{}: {fault}; give a file that `turnlight probe merge` wrote", path.display())]
    ResponseFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, with line and value.
        fault: String,
    },
    /// The images do not tell the response.
    #[error("{reason}; {remedy}")]
    Data {
        /// What they lack.
        reason: String,
        /// What the user can do.
        remedy: &'static str,
    },
}

impl MergeError {
    /// Whether the input is sound but does not hold what was asked for.
    pub fn is_about_data(&self) -> bool {
        matches!(self, Self::Data { .. })
    }
}
