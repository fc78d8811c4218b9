//! Two files, two folders, or two captures, frame by frame.

use std::{
    collections::BTreeMap,
    ffi::OsStr,
    fmt, fs,
    path::{Path, PathBuf},
};

use serde::Serialize;

use super::{
    CompareError, ImageErrors, bootstrap,
    errors::{HEADINGS, Sums},
    exposure::Percentile,
    pair::{Named, Pair, add_largest_channels, check_finite, compared},
};
use crate::image::{Mask, RgbImage, ToneCurve};

const EXTENSIONS: [&str; 7] = ["exr", "hdr", "png", "jpg", "jpeg", "tif", "tiff"];

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

/// Errors of `b` against the reference `a`: two image files, or two folders whose images have the
/// same names.
///
/// A folder that contains `images/` is a capture: its images are compared, and its `masks/` used
/// unless `masks` is given (`a`'s before `b`'s). `masks` is one mask for every frame, or a folder
/// of masks named as the frames, up to the extension.
pub fn compare_sequences(
    a: &Path,
    b: &Path,
    masks: Option<&Path>,
) -> Result<SequenceErrors, CompareError> {
    let frames = match_frames(a, b, masks)?;

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

/// Files that belong together.
struct Frame {
    name: String,
    reference: PathBuf,
    test: PathBuf,
    mask: Option<PathBuf>,
}

impl Frame {
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
}

fn match_frames(a: &Path, b: &Path, masks: Option<&Path>) -> Result<Vec<Frame>, CompareError> {
    if a.is_dir() != b.is_dir() {
        return Err(CompareError::Kinds {
            a: a.to_owned(),
            b: b.to_owned(),
        });
    }
    let (images_a, images_b) = (images_of(a), images_of(b));
    let mut frames: Vec<Frame> = if a.is_dir() {
        let (names_a, names_b) = (list(&images_a)?, list(&images_b)?);
        check_all_in(&names_a, &images_a, &names_b, &images_b)?;
        check_all_in(&names_b, &images_b, &names_a, &images_a)?;
        let frame = |name: String| Frame {
            reference: images_a.join(&name),
            test: images_b.join(&name),
            mask: None,
            name,
        };
        names_a.into_iter().map(frame).collect()
    } else {
        let name = a
            .file_name()
            .unwrap_or(OsStr::new(""))
            .to_string_lossy()
            .into_owned();
        vec![Frame {
            name,
            reference: a.to_owned(),
            test: b.to_owned(),
            mask: None,
        }]
    };

    let own = [a, b]
        .into_iter()
        .map(|path| path.join("masks"))
        .find(|masks| masks.is_dir());
    let Some(masks) = masks.map(Path::to_owned).or(own) else {
        return Ok(frames);
    };
    let masks_by_stem: Option<BTreeMap<String, String>> = if masks.is_dir() {
        Some(
            list(&masks)?
                .into_iter()
                .map(|name| (stem(&name), name))
                .collect(),
        )
    } else {
        None
    };
    let mut missing = Vec::new();
    for frame in &mut frames {
        match &masks_by_stem {
            None => frame.mask = Some(masks.clone()),
            Some(names) => match names.get(&stem(&frame.name)) {
                Some(name) => frame.mask = Some(masks.join(name)),
                None => missing.push(frame.name.clone()),
            },
        }
    }
    if missing.is_empty() {
        Ok(frames)
    } else {
        Err(CompareError::Missing {
            folder: masks,
            names: missing,
            other: images_a,
        })
    }
}

/// A capture's images, or the folder itself.
fn images_of(folder: &Path) -> PathBuf {
    let images = folder.join("images");
    if images.is_dir() {
        images
    } else {
        folder.to_owned()
    }
}

/// Names of the images in a folder, sorted; hidden files are none.
fn list(folder: &Path) -> Result<Vec<String>, CompareError> {
    let fault = |source| CompareError::Folder {
        path: folder.to_owned(),
        source,
    };
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(fault)? {
        let name = entry
            .map_err(fault)?
            .file_name()
            .to_string_lossy()
            .into_owned();
        let extension = Path::new(&name)
            .extension()
            .map(|e| e.to_string_lossy().to_lowercase());
        let known = extension.is_some_and(|e| EXTENSIONS.contains(&e.as_str()));
        if known && !name.starts_with('.') {
            names.push(name);
        }
    }
    if names.is_empty() {
        return Err(CompareError::NoImages {
            folder: folder.to_owned(),
        });
    }
    names.sort_unstable();
    Ok(names)
}

fn check_all_in(
    names: &[String],
    folder: &Path,
    others: &[String],
    other_folder: &Path,
) -> Result<(), CompareError> {
    let missing: Vec<String> = names
        .iter()
        .filter(|name| others.binary_search(name).is_err())
        .cloned()
        .collect();
    if missing.is_empty() {
        return Ok(());
    }
    let (folder, other) = (other_folder.to_owned(), folder.to_owned());
    Err(CompareError::Missing {
        folder,
        names: missing,
        other,
    })
}

fn stem(name: &str) -> String {
    Path::new(name)
        .file_stem()
        .unwrap_or(OsStr::new(""))
        .to_string_lossy()
        .into_owned()
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
