//! Patches of a chart: from a list, or from an image whose corners were marked.

use std::path::Path;

use super::ColourError;
use crate::image::{RgbImage, srgb_decode};

/// A patch: its name and what a camera made of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// Name, or its number from 1.
    pub name: String,
    /// Mean sample, RGB.
    pub rgb: [f64; 3],
}

/// A chart's patches, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// At least one.
    pub patches: Vec<Patch>,
}

/// sRGB of the ColorChecker Classic's patches as published by their maker's 2005 averages (D65).
const COLORCHECKER: [(&str, [u8; 3]); 24] = [
    ("dark skin", [115, 82, 68]),
    ("light skin", [194, 150, 130]),
    ("blue sky", [98, 122, 157]),
    ("foliage", [87, 108, 67]),
    ("blue flower", [133, 128, 177]),
    ("bluish green", [103, 189, 170]),
    ("orange", [214, 126, 44]),
    ("purplish blue", [80, 91, 166]),
    ("moderate red", [193, 90, 99]),
    ("purple", [94, 60, 108]),
    ("yellow green", [157, 188, 64]),
    ("orange yellow", [224, 163, 46]),
    ("blue", [56, 61, 150]),
    ("green", [70, 148, 73]),
    ("red", [175, 54, 60]),
    ("yellow", [231, 199, 31]),
    ("magenta", [187, 86, 149]),
    ("cyan", [8, 133, 161]),
    ("white", [243, 243, 242]),
    ("neutral 8", [200, 200, 200]),
    ("neutral 6.5", [160, 160, 160]),
    ("neutral 5", [122, 122, 121]),
    ("neutral 3.5", [85, 85, 85]),
    ("black", [52, 52, 52]),
];

/// Half of the side of the square that is read, in patches: well inside their borders.
const HALF: f64 = 0.22;
/// Points along that side.
const POINTS: i32 = 21;
/// Samples of files of integers from here on are saturated.
const SATURATED: f32 = 0.98;

impl Chart {
    /// The ColorChecker Classic in linear sRGB.
    pub fn colorchecker() -> Self {
        let linear = |level: u8| srgb_decode(f64::from(level) / 255.0);
        let patches = COLORCHECKER
            .iter()
            .map(|(name, rgb)| Patch {
                name: (*name).to_owned(),
                rgb: rgb.map(linear),
            })
            .collect();
        Self { patches }
    }

    /// Reads `name,r,g,b` or `r,g,b` a line; `#` begins a comment.
    pub fn read_csv(path: &Path) -> Result<Self, ColourError> {
        let fault = |fault: String| ColourError::File {
            path: path.to_owned(),
            fault,
        };
        let text = std::fs::read_to_string(path).map_err(|e| {
            fault(format!(
                "{e}; give a list of patches, `name,r,g,b` a line, or an image"
            ))
        })?;
        let mut patches = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if line.is_empty() {
                continue;
            }
            let fields: Vec<&str> = line.split(',').map(str::trim).collect();
            let (name, values) = match fields[..] {
                [r, g, b] => ((patches.len() + 1).to_string(), [r, g, b]),
                [name, r, g, b] => (name.to_owned(), [r, g, b]),
                _ => {
                    return Err(fault(format!(
                        "line {} = {line:?}: must be `name,r,g,b` or `r,g,b`",
                        number + 1
                    )));
                }
            };
            let mut rgb = [0.0; 3];
            for (channel, value) in rgb.iter_mut().zip(values) {
                *channel = match value.parse::<f64>() {
                    Ok(x) if (0.0..1e12).contains(&x) => x,
                    _ => {
                        return Err(fault(format!(
                            "line {}: {name} = {value}: must be a number of at least 0",
                            number + 1
                        )));
                    }
                };
            }
            patches.push(Patch { name, rgb });
        }
        if patches.is_empty() {
            return Err(fault(
                "holds no patches; give `name,r,g,b` a line".to_owned(),
            ));
        }
        Ok(Self { patches })
    }

    /// Reads patches from an image. `corners` are the centres of the first patch, the last of the first
    /// row, the last, and the first of the last row, pixels; `clipped` tells whether samples near 1 are saturated.
    pub fn sample(
        path: &Path,
        image: &RgbImage,
        corners: [[f64; 2]; 4],
        (columns, rows): (usize, usize),
        clipped: bool,
    ) -> Result<Self, ColourError> {
        let place = projection(corners);
        let pitch = (
            1.0 / (columns.max(2) - 1) as f64,
            1.0 / (rows.max(2) - 1) as f64,
        );
        let patches = (0..columns * rows)
            .map(|i| {
                let centre = (
                    (i % columns) as f64 * pitch.0,
                    (i / columns) as f64 * pitch.1,
                );
                let (x, y) = place(centre.0, centre.1);
                let fault = |fault: &str| ColourError::Patch {
                    path: path.to_owned(),
                    number: i + 1,
                    x,
                    y,
                    fault: fault.to_owned(),
                };
                let mut samples: [Vec<f32>; 3] = Default::default();
                for step in 0..POINTS * POINTS {
                    let offset = |n: i32| HALF * (2.0 * f64::from(n) / f64::from(POINTS - 1) - 1.0);
                    let (u, v) = (offset(step % POINTS), offset(step / POINTS));
                    let (x, y) = place(centre.0 + u * pitch.0, centre.1 + v * pitch.1);
                    let inside =
                        x >= 0.0 && y >= 0.0 && x < image.width as f64 && y < image.height as f64;
                    if !inside {
                        return Err(fault("lies outside the image; check the corners"));
                    }
                    let pixel = image.pixels[y as usize * image.width + x as usize];
                    for (list, sample) in samples.iter_mut().zip(pixel) {
                        list.push(sample);
                    }
                }
                if samples.iter().flatten().any(|s| !s.is_finite()) {
                    return Err(fault(
                        "holds NaN or infinite samples; export the image again",
                    ));
                }
                let rgb = samples.map(|mut list| trimmed_mean(&mut list));
                if clipped && rgb.iter().any(|&c| c >= f64::from(SATURATED)) {
                    return Err(fault(
                        "is saturated; photograph the chart with less exposure",
                    ));
                }
                if rgb.iter().any(|&c| c < 0.0) {
                    return Err(fault("is negative; check black level and corners"));
                }
                Ok(Patch {
                    name: (i + 1).to_string(),
                    rgb,
                })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { patches })
    }
}

/// The mean of the middle half: scratches and highlights fall out.
fn trimmed_mean(samples: &mut [f32]) -> f64 {
    samples.sort_unstable_by(f32::total_cmp);
    let quarter = samples.len() / 4;
    let middle = &samples[quarter..samples.len() - quarter];
    middle.iter().map(|&s| f64::from(s)).sum::<f64>() / middle.len() as f64
}

/// The projective map of the unit square onto a quadrangle (Heckbert 1989, *Fundamentals of Texture Mapping
/// and Image Warping*, section 2.2.3).
pub(super) fn projection(corners: [[f64; 2]; 4]) -> impl Fn(f64, f64) -> (f64, f64) {
    let [[x0, y0], [x1, y1], [x2, y2], [x3, y3]] = corners;
    let (dx1, dx2, sx) = (x1 - x2, x3 - x2, x0 - x1 + x2 - x3);
    let (dy1, dy2, sy) = (y1 - y2, y3 - y2, y0 - y1 + y2 - y3);
    let determinant = dx1 * dy2 - dx2 * dy1;
    // A quadrangle without area has no perspective; its patches are refused for what they hold.
    let (g, h) = if determinant.abs() > 1e-12 {
        (
            (sx * dy2 - dx2 * sy) / determinant,
            (dx1 * sy - sx * dy1) / determinant,
        )
    } else {
        (0.0, 0.0)
    };
    let (a, b) = (x1 - x0 + g * x1, x3 - x0 + h * x3);
    let (d, e) = (y1 - y0 + g * y1, y3 - y0 + h * y3);
    move |u, v| {
        let w = g * u + h * v + 1.0;
        ((a * u + b * v + x0) / w, (d * u + e * v + y0) / w)
    }
}
