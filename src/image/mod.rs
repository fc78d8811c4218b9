//! Linear float images in memory, and their files: EXR, Radiance HDR, PNG, JPEG, TIFF.

use std::path::PathBuf;

/// Linear RGB image; row 0 at the top, `pixels[y * width + x]`.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[height * width]` linear RGB, Rec. 709 primaries.
    pub pixels: Vec<[f32; 3]>,
}

/// Which pixels the object covers: 255 whole, 0 not at all; row 0 at the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[height * width]` coverage, 0..=255.
    pub pixels: Vec<u8>,
}

/// One named plane of float samples, for EXR layers such as `depth.Z` or `alpha`.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Channel name as it stands in the file.
    pub name: String,
    /// `[height * width]` samples, row 0 at the top.
    pub samples: Vec<f32>,
}

/// What can go wrong with an image file.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The file is absent, unreadable, truncated or of an unknown kind.
    #[error("{}: {reason}; {remedy}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the decoder or the system said.
        reason: String,
        /// What the user can do.
        remedy: String,
    },
}
