//! How far images are from a reference, over the pixels of the object.
//!
//! With reference `r` and test `t`, means over pixels and channels:
//!
//! ```text
//! RMSE   = √ mean (t − r)²              MAE = mean |t − r|             linear radiance
//! relMSE = mean (t − r)² / (r² + 0.01)                                 linear radiance
//! PSNR   = −10 log10 mean (T(t) − T(r))²                               T: tone curve, in [0, 1]
//! SSIM, FLIP                                                           display values
//! ```
//!
//! The tone curve is [`ToneCurve`]: exposure, clamp to [0, 1], sRGB. Unless set, the exposure maps
//! the 99th percentile of the reference's largest channel over the compared pixels to 1, so that
//! lamps and glints do not darken the rest; a sequence has one exposure. Compared pixels are those
//! that the object covers whole (mask 255); what lies outside the mask influences nothing.

mod bootstrap;
mod convolve;
mod errors;
mod exposure;
mod flip;
mod frames;
#[cfg(test)]
mod laws;
mod pair;
mod sequence;
mod ssim;

use std::path::PathBuf;

pub use errors::ImageErrors;
pub use frames::{FramePair, pair_frames};
pub use pair::{compare_at_exposure, compare_images};
pub use sequence::{FrameErrors, Interval, SequenceErrors, compare_sequences};

use crate::image::ImageError;
#[cfg(doc)]
use crate::image::ToneCurve;
use crate::scene::SceneError;

/// Why images cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// An image or mask could not be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A capture could not be read.
    #[error(transparent)]
    Capture(#[from] SceneError),
    /// Two captures differ in their number of frames.
    #[error("{} has {frames_a} frames, {} has {frames_b}; compare captures of the same frames", a.display(), b.display())]
    Counts {
        /// First capture.
        a: PathBuf,
        /// Its frames.
        frames_a: usize,
        /// Second capture.
        b: PathBuf,
        /// Its frames.
        frames_b: usize,
    },
    /// Two images differ in size.
    #[error("{reference} is {}, {test} is {}; compare images of one size", size(*reference_size), size(*test_size))]
    Size {
        /// Name of the reference.
        reference: String,
        /// Columns and rows.
        reference_size: [usize; 2],
        /// Name of the image or mask held against it.
        test: String,
        /// Columns and rows.
        test_size: [usize; 2],
    },
    /// No pixel is covered whole.
    #[error(
        "{mask}: no pixel is 255 (the largest is {largest}), so there is nothing to compare; give a mask of 0 and 255 with the object in it"
    )]
    EmptyMask {
        /// Name of the mask.
        mask: String,
        /// Largest coverage in it.
        largest: u8,
    },
    /// The images have no pixels.
    #[error("{image}: has no pixels; give an image that has")]
    NoPixels {
        /// Name of the image.
        image: String,
    },
    /// A compared pixel is NaN or infinite.
    #[error("{image}: pixel x = {x}, y = {y} is {value:?}; repair it or mask it out")]
    NonFinite {
        /// Name of the image.
        image: String,
        /// Column, from the left.
        x: usize,
        /// Row, from the top.
        y: usize,
        /// Linear RGB.
        value: [f32; 3],
    },
    /// Files of one folder have no counterpart in the other.
    #[error("{}: nothing stands against {} of {}; compare folders with the same file names", folder.display(), names.join(", "), other.display())]
    Missing {
        /// Folder in which they are missing.
        folder: PathBuf,
        /// Names in the other folder.
        names: Vec<String>,
        /// Folder in which they are.
        other: PathBuf,
    },
    /// A folder without images.
    #[error("{}: holds no images (EXR, HDR, PNG, JPEG, TIFF); give a folder of images or a capture", folder.display())]
    NoImages {
        /// The folder.
        folder: PathBuf,
    },
    /// A file against a folder.
    #[error("{} and {}: one is a file, the other a folder; compare like with like", a.display(), b.display())]
    Kinds {
        /// First path.
        a: PathBuf,
        /// Second path.
        b: PathBuf,
    },
    /// A folder could not be listed.
    #[error("{}: {source}; check the path", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

fn size([width, height]: [usize; 2]) -> String {
    format!("{width} × {height}")
}
