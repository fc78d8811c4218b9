//! Two files, two folders, or two captures, frame by frame.

use std::{fmt, path::Path};

use serde::Serialize;

use super::{
    CompareError, ImageErrors, bootstrap,
    errors::{HEADINGS, Sums},
    exposure::Percentile,
    frames::{FramePair, pair_frames},
    pair::{Named, Pair, add_largest_channels, check_finite, compared},
};
use crate::image::{Mask, RgbImage, ToneCurve};

/// Errors of one frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameErrors {
    /// File name.
    pub name: String,
    /// Its errors.
    #[serde(flatten)]
    pub errors: ImageErrors,
}

/// Ends of 95 % intervals, error by error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// Lower ends.
    pub low: ImageErrors,
    /// Upper ends.
    pub high: ImageErrors,
}

/// Errors of a sequence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SequenceErrors {
    /// Exposure at which all frames were shown for PSNR, SSIM and FLIP.
    pub exposure: f64,
    /// Frame by frame, by name.
    pub frames: Vec<FrameErrors>,
    /// Over the pixels of all frames.
    pub overall: ImageErrors,
    /// 95 % intervals of `overall` over frames (bootstrap, fixed seed); `None` for a single frame.
    pub interval95: Option<Interval>,
}

/// Errors of `b` against the reference `a`, frame by frame as [`pair_frames`] pairs them.
pub fn compare_sequences(
    a: &Path,
    b: &Path,
    masks: Option<&Path>,
) -> Result<SequenceErrors, CompareError> {
    let frames = pair_frames(a, b, masks)?;

    // One exposure for all frames, from the reference.
    let mut percentile = Percentile::new();
    for frame in &frames {
        let (reference, mask) = (RgbImage::read(&frame.reference)?, frame.read_mask()?);
        let (name, mask_name) = (frame.reference.display().to_string(), frame.mask_name());
        let named = Named {
            name: &name,
            image: &reference,
        };
        let compared = compared(named, mask.as_ref().map(|mask| (mask_name.as_str(), mask)))?;
        check_finite(named, &compared)?;
        add_largest_channels(&reference, &compared, &mut percentile);
    }
    let curve = ToneCurve {
        exposure: percentile.exposure(),
    };

    let sums: Vec<Sums> = frames
        .iter()
        .map(|frame| frame.sums(curve))
        .collect::<Result<_, CompareError>>()?;
    let overall = sums
        .iter()
        .fold(Sums::default(), |pooled, &frame| pooled + frame)
        .errors();
    let frames = frames.into_iter().zip(&sums);
    Ok(SequenceErrors {
        exposure: curve.exposure,
        frames: frames
            .map(|(f, sums)| FrameErrors {
                name: f.name,
                errors: sums.errors(),
            })
            .collect(),
        overall,
        interval95: bootstrap::interval(&sums).map(|[low, high]| Interval { low, high }),
    })
}

impl FramePair {
    fn sums(&self, curve: ToneCurve) -> Result<Sums, CompareError> {
        let (reference, test) = (
            RgbImage::read(&self.reference)?,
            RgbImage::read(&self.test)?,
        );
        let mask = self.read_mask()?;
        let names = [&self.reference, &self.test].map(|path| path.display().to_string());
        let mask_name = self.mask_name();
        let pair = Pair::new(
            Named {
                name: &names[0],
                image: &reference,
            },
            Named {
                name: &names[1],
                image: &test,
            },
            mask.as_ref().map(|mask| (mask_name.as_str(), mask)),
        )?;
        Ok(pair.sums(curve))
    }

    fn read_mask(&self) -> Result<Option<Mask>, CompareError> {
        Ok(self.mask.as_deref().map(Mask::read).transpose()?)
    }

    fn mask_name(&self) -> String {
        self.mask
            .as_deref()
            .unwrap_or(Path::new(""))
            .display()
            .to_string()
    }
}

impl fmt::Display for SequenceErrors {
    /// A table for the terminal.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self
            .frames
            .iter()
            .map(|frame| frame.name.chars().count())
            .max();
        let width = width.unwrap_or(0).max("95 % from".len());
        writeln!(f, "{:width$} {HEADINGS}", "frame")?;
        for frame in &self.frames {
            writeln!(f, "{:width$} {}", frame.name, frame.errors)?;
        }
        if let Some(interval) = &self.interval95 {
            writeln!(f, "{:width$} {}", "overall", self.overall)?;
            writeln!(f, "{:width$} {}", "95 % from", interval.low)?;
            writeln!(f, "{:width$} {}", "95 % to", interval.high)?;
        }
        write!(
            f,
            "PSNR (dB), SSIM and FLIP of sRGB at exposure {:.5}",
            self.exposure
        )
    }
}
