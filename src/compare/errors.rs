//! Sums over pixels, which add up over frames, and the errors they come to.

use std::{
    fmt,
    ops::{Add, AddAssign},
};

use serde::Serialize;

/// Errors of one image, or of a sequence pooled over its pixels.
///
/// In JSON a number that is not finite is `null`: `psnr_db` of images whose display values agree.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ImageErrors {
    /// Compared pixels.
    pub pixels: u64,
    /// Root mean square error, radiance.
    pub rmse: f64,
    /// Mean of `(t − r)² / (r² + 0.01)`. The 0.01 (radiance²) is the literature's (Rousselle et al.
    /// 2011); it keeps black pixels from deciding, and is meant for radiance around 1.
    pub rel_mse: f64,
    /// Mean absolute error, radiance.
    pub mae: f64,
    /// Mean of the test over the mean of the reference; 1 when both are 0.
    pub mean_ratio: f64,
    /// Peak signal-to-noise ratio of display values, dB; infinite when they are equal.
    pub psnr_db: f64,
    /// Structural similarity of display luma, at most 1; `None` where no 11 × 11 window fits into
    /// the image around a compared pixel.
    pub ssim: Option<f64>,
    /// LDR-FLIP, 0 (equal) to 1.
    pub flip: f64,
}

/// What [`ImageErrors`] is made from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sums {
    pub(super) pixels: u64,
    /// Over pixels and channels.
    pub(super) squared: f64,
    pub(super) relative: f64,
    pub(super) absolute: f64,
    pub(super) reference: f64,
    pub(super) test: f64,
    pub(super) display_squared: f64,
    /// Over windows.
    pub(super) windows: u64,
    pub(super) ssim: f64,
    /// Over pixels.
    pub(super) flip: f64,
}

/// Keeps dark pixels from dominating relMSE, radiance².
pub(super) const REL_MSE_EPSILON: f64 = 1e-2;

impl Sums {
    pub(super) fn errors(&self) -> ImageErrors {
        let pixels = self.pixels as f64;
        let samples = 3.0 * pixels;
        let both_black = self.reference == 0.0 && self.test == 0.0;
        ImageErrors {
            pixels: self.pixels,
            rmse: (self.squared / samples).sqrt(),
            rel_mse: self.relative / samples,
            mae: self.absolute / samples,
            mean_ratio: if both_black {
                1.0
            } else {
                self.test / self.reference
            },
            psnr_db: -10.0 * (self.display_squared / samples).log10(),
            ssim: (self.windows > 0).then(|| self.ssim / self.windows as f64),
            flip: self.flip / pixels,
        }
    }
}

impl Add for Sums {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            pixels: self.pixels + other.pixels,
            squared: self.squared + other.squared,
            relative: self.relative + other.relative,
            absolute: self.absolute + other.absolute,
            reference: self.reference + other.reference,
            test: self.test + other.test,
            display_squared: self.display_squared + other.display_squared,
            windows: self.windows + other.windows,
            ssim: self.ssim + other.ssim,
            flip: self.flip + other.flip,
        }
    }
}

impl AddAssign for Sums {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

/// Headings of [`ImageErrors`]'s line.
pub(super) const HEADINGS: &str =
    "   pixels        RMSE      relMSE         MAE   ratio    PSNR    SSIM    FLIP";

impl fmt::Display for ImageErrors {
    /// One line, in the columns of a sequence's table.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ssim = self
            .ssim
            .map_or_else(|| "-".to_owned(), |ssim| format!("{ssim:.4}"));
        write!(
            f,
            "{:9} {:11.4e} {:11.4e} {:11.4e} {:7.4} {:7.2} {ssim:>7} {:7.4}",
            self.pixels,
            self.rmse,
            self.rel_mse,
            self.mae,
            self.mean_ratio,
            self.psnr_db,
            self.flip
        )
    }
}
