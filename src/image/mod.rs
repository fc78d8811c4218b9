//! Linear float images in memory, and their files: EXR, Radiance HDR, PNG, JPEG, TIFF, and cameras' raw files.
//!
//! Samples pass through unchanged: NaN, infinite and negative ones too. Whoever uses an image knows
//! what they mean there (a probe repairs and reports them, a comparison refuses them).

mod atomic;
mod colormap;
mod exposure;
mod exr;
#[cfg(test)]
mod file_laws;
mod jpeg;
mod raw;
mod read;
mod tone;
mod write;

use std::path::{Path, PathBuf};

pub use atomic::write_atomically;
pub use colormap::viridis;
pub use exposure::Exposure;
pub use read::{MAX_PIXELS, read_exr_channels};
pub use tone::{ToneCurve, luminance, srgb_decode, srgb_encode};
pub use write::{encode_png, encode_png_bytes, write_exr, write_exr_channels, write_png};

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

/// What the samples of a file were before they became floats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// Integers of 8 bits.
    Bits8,
    /// Integers of 16 bits.
    Bits16,
    /// Floats: linear.
    Float,
    /// A sensor's own, demosaiced (bilinear): the camera's linear RGB, black at 0 and the sensor's white at
    /// 1, without white balance or colour matrix, since both may change from frame to frame.
    Raw,
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

impl ImageError {
    fn file(path: &Path, fault: Fault) -> Self {
        Self::File {
            path: path.to_owned(),
            reason: fault.reason,
            remedy: fault.remedy.to_owned(),
        }
    }
}

/// An [`ImageError`] before anyone knows which file it is about.
struct Fault {
    reason: String,
    remedy: &'static str,
}

impl Fault {
    fn new(reason: impl ToString, remedy: &'static str) -> Self {
        Self {
            // Some decoders end their sentences with a line break.
            reason: reason.to_string().trim().to_owned(),
            remedy,
        }
    }

    fn damaged(reason: impl ToString) -> Self {
        Self::new(
            reason,
            "check that the file is complete, or export it again",
        )
    }

    fn write(reason: impl ToString) -> Self {
        Self::new(
            reason,
            "check that the folder exists, is writable and has space left",
        )
    }
}

impl RgbImage {
    /// An image whose pixels are all `value`.
    pub fn constant(width: usize, height: usize, value: [f32; 3]) -> Self {
        Self {
            width,
            height,
            pixels: vec![value; width * height],
        }
    }

    /// An image with `pixels[y * width + x] = value(x, y)`.
    pub fn from_fn(width: usize, height: usize, value: impl Fn(usize, usize) -> [f32; 3]) -> Self {
        let pixels = (0..width * height)
            .map(|i| value(i % width, i / width))
            .collect();
        Self {
            width,
            height,
            pixels,
        }
    }

    /// The image at texture coordinates (`u` right, `v` down, row 0 at v = 0), repeating.
    ///
    /// Bilinear between texel centres, which lie at half-integers: `u = (x + ½) / width`.
    ///
    /// # Panics
    /// On an image without pixels; no reader returns one.
    pub fn bilinear(&self, u: f64, v: f64) -> [f32; 3] {
        let (x0, x1, fx) = neighbours(u, self.width);
        let (y0, y1, fy) = neighbours(v, self.height);
        let texel = |x: usize, y: usize| self.pixels[y * self.width + x];
        let (top, bottom) = (
            (texel(x0, y0), texel(x1, y0)),
            (texel(x0, y1), texel(x1, y1)),
        );
        std::array::from_fn(|c| {
            let upper = mix(top.0[c], top.1[c], fx);
            let lower = mix(bottom.0[c], bottom.1[c], fx);
            mix(upper, lower, fy)
        })
    }
}

/// The two texels either side of coordinate `s` on a repeating axis, and the share of the second.
fn neighbours(s: f64, size: usize) -> (usize, usize, f32) {
    let position = s.rem_euclid(1.0) * size as f64 - 0.5;
    let below = position.floor();
    let first = (below as i64).rem_euclid(size as i64) as usize;
    (first, (first + 1) % size, (position - below) as f32)
}

/// `a` and `b` exactly at the ends, so that an infinite neighbour of weight 0 makes no NaN.
fn mix(a: f32, b: f32, share: f32) -> f32 {
    if share == 0.0 {
        a
    } else {
        a * (1.0 - share) + b * share
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn checker() -> RgbImage {
        RgbImage::from_fn(4, 2, |x, y| [x as f32, y as f32, (x * y) as f32])
    }

    #[test]
    fn bilinear_returns_texels_at_their_centres() {
        let image = checker();
        for y in 0..2 {
            for x in 0..4 {
                let sample = image.bilinear((x as f64 + 0.5) / 4.0, (y as f64 + 0.5) / 2.0);
                assert_eq!(sample, image.pixels[y * 4 + x]);
            }
        }
    }

    #[test]
    fn bilinear_blends_across_the_seam() {
        assert_eq!(checker().bilinear(0.0, 0.25), [1.5, 0.0, 0.0]);
        assert_eq!(checker().bilinear(0.25, 0.0)[1], 0.5);
    }

    proptest! {
        #[test]
        fn bilinear_repeats(u in -3.0..3.0f64, v in -3.0..3.0f64, turns in -2i32..3) {
            let image = checker();
            let (a, b) = (image.bilinear(u, v), image.bilinear(u + f64::from(turns), v));
            for c in 0..3 {
                prop_assert!((a[c] - b[c]).abs() < 1e-5, "{a:?} {b:?}");
            }
        }

        #[test]
        fn bilinear_takes_any_number(u in any::<f64>(), v in any::<f64>()) {
            checker().bilinear(u, v);
        }
    }
}
