//! Two images in memory.

use std::ops::Range;

use rayon::prelude::*;

use super::{
    CompareError, ImageErrors,
    convolve::Plane,
    errors::{REL_MSE_EPSILON, Sums},
    exposure::Percentile,
    flip::{Shown, flip_sum},
    ssim::ssim_sum,
};
use crate::image::{Mask, RgbImage, ToneCurve, luminance, srgb_encode};

/// Errors of `test` against `reference` over the pixels that `mask` covers whole (all without a
/// mask), at the exposure that suits the reference.
pub fn compare_images(
    reference: &RgbImage,
    test: &RgbImage,
    mask: Option<&Mask>,
) -> Result<ImageErrors, CompareError> {
    let pair = unnamed_pair(reference, test, mask)?;
    let mut percentile = Percentile::new();
    pair.add_reference(&mut percentile);
    Ok(pair
        .sums(ToneCurve {
            exposure: percentile.exposure(),
        })
        .errors())
}

/// As [`compare_images`], at a given exposure. Exchanging the images changes only relMSE and the
/// ratio.
pub fn compare_at_exposure(
    reference: &RgbImage,
    test: &RgbImage,
    mask: Option<&Mask>,
    curve: ToneCurve,
) -> Result<ImageErrors, CompareError> {
    let pair = unnamed_pair(reference, test, mask)?;
    Ok(pair.sums(curve).errors())
}

/// A pair that no file names.
fn unnamed_pair<'a>(
    reference: &'a RgbImage,
    test: &'a RgbImage,
    mask: Option<&'a Mask>,
) -> Result<Pair<'a>, CompareError> {
    Pair::new(
        Named {
            name: "the reference",
            image: reference,
        },
        Named {
            name: "the test image",
            image: test,
        },
        mask.map(|mask| ("the mask", mask)),
    )
}

/// An image and what messages call it.
#[derive(Clone, Copy)]
pub(super) struct Named<'a> {
    pub(super) name: &'a str,
    pub(super) image: &'a RgbImage,
}

/// Images found comparable: of one size, finite where compared.
pub(super) struct Pair<'a> {
    reference: &'a RgbImage,
    test: &'a RgbImage,
    compared: Vec<bool>,
}

impl<'a> Pair<'a> {
    pub(super) fn new(
        reference: Named<'a>,
        test: Named<'a>,
        mask: Option<(&str, &Mask)>,
    ) -> Result<Self, CompareError> {
        check_size(reference, test.name, [test.image.width, test.image.height])?;
        let compared = compared(reference, mask)?;
        check_finite(reference, &compared)?;
        check_finite(test, &compared)?;
        Ok(Self {
            reference: reference.image,
            test: test.image,
            compared,
        })
    }

    pub(super) fn add_reference(&self, percentile: &mut Percentile) {
        add_largest_channels(self.reference, &self.compared, percentile);
    }

    pub(super) fn sums(&self, curve: ToneCurve) -> Sums {
        let mut sums = Sums::default();
        let pixels = self
            .reference
            .pixels
            .iter()
            .zip(&self.test.pixels)
            .zip(&self.compared);
        for ((reference, test), _) in pixels.filter(|(_, compared)| **compared) {
            sums.pixels += 1;
            for (&r, &t) in reference.iter().zip(test) {
                let display = curve.display(t) - curve.display(r);
                let (r, t) = (f64::from(r), f64::from(t));
                let squared = (t - r) * (t - r);
                sums.squared += squared;
                sums.relative += squared / (r * r + REL_MSE_EPSILON);
                sums.absolute += (t - r).abs();
                sums.reference += r;
                sums.test += t;
                sums.display_squared += display * display;
            }
        }

        // Windows and filters reach beyond the mask: what is outside is black in both, and what is
        // far outside is left away.
        let crop = self.crop();
        let compared = crop.of(&self.compared);
        let shown = |image: &RgbImage| -> Vec<[f64; 3]> {
            let pixels = crop.of(&image.pixels).into_iter().zip(&compared);
            let linear = |pixel: [f32; 3]| pixel.map(|x| curve.linear(x));
            pixels
                .map(|(p, &compared)| if compared { linear(p) } else { [0.0; 3] })
                .collect()
        };
        let (reference, test) = (shown(self.reference), shown(self.test));
        let (width, height) = (crop.columns.len(), crop.rows.len());
        let luma = |shown: &[[f64; 3]]| Plane {
            width,
            height,
            values: shown
                .par_iter()
                .map(|rgb| luminance(rgb.map(srgb_encode)))
                .collect(),
        };
        (sums.ssim, sums.windows) = ssim_sum(&luma(&reference), &luma(&test), &compared);
        sums.flip = flip_sum(
            &Shown {
                width,
                height,
                pixels: &reference,
            },
            &Shown {
                width,
                height,
                pixels: &test,
            },
            &compared,
        );
        sums
    }

    /// The compared pixels and those that windows and filters around them reach.
    fn crop(&self) -> Crop {
        let (width, height) = (self.reference.width, self.reference.height);
        let (mut columns, mut rows) = (width..0, height..0);
        for (i, _) in self
            .compared
            .iter()
            .enumerate()
            .filter(|(_, compared)| **compared)
        {
            let (x, y) = (i % width, i / width);
            columns = columns.start.min(x)..columns.end.max(x + 1);
            rows = rows.start.min(y)..rows.end.max(y + 1);
        }
        let grow = |range: Range<usize>, size: usize| {
            range.start.saturating_sub(REACH)..(range.end + REACH).min(size)
        };
        Crop {
            width,
            columns: grow(columns, width),
            rows: grow(rows, height),
        }
    }
}

/// At least the radius of every window and filter of SSIM and FLIP, pixels.
const REACH: usize = 16;

/// A part of an image.
struct Crop {
    /// Columns of the whole.
    width: usize,
    columns: Range<usize>,
    rows: Range<usize>,
}

impl Crop {
    fn of<T: Copy>(&self, values: &[T]) -> Vec<T> {
        let row = |y: usize| &values[y * self.width..][self.columns.clone()];
        self.rows.clone().flat_map(row).copied().collect()
    }
}

/// Which pixels count: those that the mask covers whole.
pub(super) fn compared(
    image: Named<'_>,
    mask: Option<(&str, &Mask)>,
) -> Result<Vec<bool>, CompareError> {
    if image.image.pixels.is_empty() {
        return Err(CompareError::NoPixels {
            image: image.name.to_owned(),
        });
    }
    let Some((name, mask)) = mask else {
        return Ok(vec![true; image.image.pixels.len()]);
    };
    check_size(image, name, [mask.width, mask.height])?;
    let largest = mask.pixels.iter().copied().max().unwrap_or(0);
    if largest < u8::MAX {
        return Err(CompareError::EmptyMask {
            mask: name.to_owned(),
            largest,
        });
    }
    Ok(mask
        .pixels
        .iter()
        .map(|&coverage| coverage == u8::MAX)
        .collect())
}

pub(super) fn check_finite(image: Named<'_>, compared: &[bool]) -> Result<(), CompareError> {
    let pixels = &image.image.pixels;
    let finite = |pixel: &[f32; 3]| pixel.iter().all(|x| x.is_finite());
    match (0..pixels.len()).find(|&i| compared[i] && !finite(&pixels[i])) {
        None => Ok(()),
        Some(i) => Err(CompareError::NonFinite {
            image: image.name.to_owned(),
            x: i % image.image.width,
            y: i / image.image.width,
            value: pixels[i],
        }),
    }
}

pub(super) fn add_largest_channels(
    image: &RgbImage,
    compared: &[bool],
    percentile: &mut Percentile,
) {
    let pixels = image
        .pixels
        .iter()
        .zip(compared)
        .filter(|(_, compared)| **compared);
    pixels.for_each(|(pixel, _)| percentile.add(pixel[0].max(pixel[1]).max(pixel[2])));
}

fn check_size(reference: Named<'_>, test: &str, test_size: [usize; 2]) -> Result<(), CompareError> {
    let reference_size = [reference.image.width, reference.image.height];
    if reference_size == test_size {
        return Ok(());
    }
    let (reference, test) = (reference.name.to_owned(), test.to_owned());
    Err(CompareError::Size {
        reference,
        reference_size,
        test,
        test_size,
    })
}
