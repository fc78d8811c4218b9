//! What is wrong with a probe's texels, and what can be done about it.

use std::fmt;

use crate::image::RgbImage;

/// What [`repair`] found and changed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ProbeReport {
    /// Texels with a NaN or infinite channel, replaced by the mean of their sound neighbours.
    pub not_finite: usize,
    /// Texels with a negative channel (lossy codecs ring), set to 0.
    pub negative: usize,
}

impl fmt::Display for ProbeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut notes = Vec::new();
        if self.not_finite > 0 {
            notes.push(format!(
                "{} texels not finite, filled from their neighbours",
                self.not_finite
            ));
        }
        if self.negative > 0 {
            notes.push(format!("{} texels negative, set to 0", self.negative));
        }
        f.write_str(&notes.join("; "))
    }
}

/// A probe that cannot be repaired.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ProbeError {
    /// No texels.
    #[error("the probe has {width} x {height} texels; it needs at least 1 x 1")]
    Empty {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// Too much is missing to invent it.
    #[error(
        "{not_finite} of {texels} probe texels are NaN or infinite, more than 1 %; \
         merge the exposures again, or paint the gap"
    )]
    NotFinite {
        /// Broken texels.
        not_finite: usize,
        /// All texels.
        texels: usize,
    },
}

/// Makes every texel finite and non-negative, or refuses.
///
/// Up to 1 % of texels may be NaN or infinite; each takes the mean of its finite neighbours
/// (periodic in longitude), or 0 where it has none.
pub fn repair(mut image: RgbImage) -> Result<(RgbImage, ProbeReport), ProbeError> {
    let (width, height) = (image.width, image.height);
    if width == 0 || height == 0 {
        return Err(ProbeError::Empty { width, height });
    }
    let broken: Vec<usize> = (0..image.pixels.len())
        .filter(|&i| image.pixels[i].iter().any(|c| !c.is_finite()))
        .collect();
    if broken.len() * 100 > image.pixels.len() {
        return Err(ProbeError::NotFinite {
            not_finite: broken.len(),
            texels: image.pixels.len(),
        });
    }

    // Means come from the original texels, so that the result does not depend on their order.
    let filled: Vec<[f32; 3]> = broken
        .iter()
        .map(|&i| {
            let (x, y) = (i % width, i / width);
            let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
            let around = rows.flat_map(|row| {
                [x + width - 1, x, x + 1].map(|column| row * width + column % width)
            });
            let sound: Vec<[f32; 3]> = around
                .map(|j| image.pixels[j])
                .filter(|p| p.iter().all(|c| c.is_finite()))
                .collect();
            let count = sound.len().max(1) as f32;
            [0, 1, 2].map(|c| sound.iter().map(|p| p[c] / count).sum())
        })
        .collect();
    for (&i, texel) in broken.iter().zip(filled) {
        image.pixels[i] = texel;
    }

    let mut negative = 0;
    for texel in &mut image.pixels {
        if texel.iter().any(|&c| c < 0.0) {
            negative += 1;
            *texel = texel.map(|c| c.max(0.0));
        }
    }
    Ok((
        image,
        ProbeReport {
            not_finite: broken.len(),
            negative,
        },
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(width: usize, height: usize) -> RgbImage {
        RgbImage {
            width,
            height,
            pixels: vec![[0.5; 3]; width * height],
        }
    }

    #[test]
    fn broken_texels_are_filled_and_counted() {
        let mut image = grey(20, 10);
        image.pixels[5] = [f32::NAN, 1.0, 1.0];
        image.pixels[60] = [0.5, -1e-3, 0.5];
        let (image, report) = repair(image).unwrap();
        assert_eq!(
            report,
            ProbeReport {
                not_finite: 1,
                negative: 1
            }
        );
        assert_eq!(image.pixels[5], [0.5; 3]);
        assert_eq!(image.pixels[60], [0.5, 0.0, 0.5]);
        assert!(report.to_string().contains("1 texels negative"));
    }

    #[test]
    fn a_ruined_probe_is_refused_with_its_count() {
        let mut image = grey(10, 10);
        image.pixels[..2].fill([f32::INFINITY; 3]);
        assert!(
            repair(image)
                .unwrap_err()
                .to_string()
                .starts_with("2 of 100")
        );
    }
}
