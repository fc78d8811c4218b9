//! A photograph with the registered outline on it.

use std::path::Path;

use glam::DVec2;

use super::{ReportError, views::quantile};
use crate::image::{RgbImage, ToneCurve, encode_png_bytes, write_atomically};
use crate::rig::registration::FrameAgreement;

/// The border as it is seen in the photograph or its mask.
const SEEN: [u8; 3] = [80, 190, 255];
/// The mesh's outline where it is within a pixel of the border.
const NEAR: [u8; 3] = [90, 220, 90];
/// The mesh's outline where it is farther off.
const FAR: [u8; 3] = [255, 70, 60];
/// The mesh's outline where no border is near.
const ALONE: [u8; 3] = [255, 60, 230];

/// The colours in words.
pub(super) const LEGEND: &str = "blue: border seen; green: outline of the mesh within a pixel of it; red: farther off; \
     magenta: no border near";

/// Smallest width or height of an overlay: smaller photographs are enlarged, or outline and border would
/// share their pixels.
const LEAST_SIDE: usize = 512;

/// Writes a photograph, dimmed, with the outline of the mesh and the border seen, as PNG.
pub fn write_overlay(
    path: &Path,
    photograph: &RgbImage,
    frame: &FrameAgreement,
) -> Result<(), ReportError> {
    let failed = |source| ReportError::Write {
        path: path.to_owned(),
        source,
    };
    let factor = LEAST_SIDE
        .div_ceil(photograph.width.min(photograph.height).max(1))
        .clamp(1, 8);
    let (width, height) = (factor * photograph.width, factor * photograph.height);
    let mut pixels = dimmed(photograph, factor);
    let mut draw = |place: DVec2, colour: [u8; 3]| {
        let place = (place * factor as f64).floor();
        if place.x >= 0.0 && place.y >= 0.0 && place.x < width as f64 && place.y < height as f64 {
            pixels[place.y as usize * width + place.x as usize] = colour;
        }
    };
    let seen = frame.outline.iter().filter_map(|point| point.seen);
    seen.for_each(|place| draw(place, SEEN));
    for point in &frame.outline {
        let colour = match point.seen {
            None => ALONE,
            Some(seen) if seen.distance(point.pixel) <= 1.0 => NEAR,
            Some(_) => FAR,
        };
        draw(point.pixel, colour);
    }
    let png = encode_png_bytes(width, height, &pixels).map_err(failed)?;
    write_atomically(path, |file| std::io::Write::write_all(file, &png)).map_err(failed)
}

/// The photograph at half its brightness, each pixel a square of `factor` pixels.
fn dimmed(photograph: &RgbImage, factor: usize) -> Vec<[u8; 3]> {
    let peak = |p: &[f32; 3]| p[0].max(p[1]).max(p[2]);
    let mut peaks: Vec<f32> = photograph
        .pixels
        .iter()
        .map(peak)
        .filter(|&v| v > 0.0)
        .collect();
    let white = quantile(&mut peaks, 0.99);
    let exposure = if white > 0.0 {
        1.0 / f64::from(white)
    } else {
        1.0
    };
    let curve = ToneCurve { exposure };
    let width = factor * photograph.width;
    (0..width * factor * photograph.height)
        .map(|i| {
            let (x, y) = (i % width / factor, i / width / factor);
            photograph.pixels[y * photograph.width + x].map(|v| curve.byte(v) / 2)
        })
        .collect()
}
