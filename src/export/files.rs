//! Files as wholes: written beside their place and renamed, images read and written as linear RGB.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::ExportError;
use crate::image::RgbImage;

/// Writes `path` whole or not at all: a temporary file in the same folder, renamed when complete.
pub(super) fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), ExportError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let temporary = path.with_file_name(format!(".{name}.tmp-{}", std::process::id()));
    let written = File::create(&temporary)
        .map(BufWriter::new)
        .and_then(|mut file| {
            write(&mut file)?;
            file.flush()?;
            drop(file);
            std::fs::rename(&temporary, path)
        });
    written.map_err(|error| {
        // The first error is the one to report, whether or not the remains can be removed.
        let _ = std::fs::remove_file(&temporary);
        ExportError::file(path, error)
    })
}

/// Writes linear RGB as float32 EXR.
pub(super) fn write_exr(path: &Path, image: &RgbImage) -> Result<(), ExportError> {
    exr::prelude::write_rgb_file(path, image.width, image.height, |x, y| {
        let [r, g, b] = image.pixels[y * image.width + x];
        (r, g, b)
    })
    .map_err(|error| ExportError::file(path, error))
}

/// Reads a map of material parameters: EXR as stored, 8 and 16 bit images sRGB-decoded.
pub(super) fn read_map(path: &Path) -> Result<RgbImage, ExportError> {
    if path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("exr"))
    {
        return read_exr(path);
    }
    let decoded = image::open(path).map_err(|error| ExportError::file(path, error))?;
    let is_float = matches!(
        decoded,
        image::DynamicImage::ImageRgb32F(_) | image::DynamicImage::ImageRgba32F(_)
    );
    let samples = decoded.to_rgb32f();
    let linear = |x: f32| match x {
        _ if is_float => x,
        x if x <= 0.04045 => x / 12.92,
        x => ((x + 0.055) / 1.055).powf(2.4),
    };
    let pixels = samples.pixels().map(|pixel| pixel.0.map(linear)).collect();
    Ok(RgbImage {
        width: samples.width() as usize,
        height: samples.height() as usize,
        pixels,
    })
}

fn read_exr(path: &Path) -> Result<RgbImage, ExportError> {
    let file = exr::prelude::read_first_flat_layer_from_file(path)
        .map_err(|error| ExportError::file(path, error))?;
    let layer = file.layer_data;
    let plane = |name: &str| {
        let found = layer
            .channel_data
            .list
            .iter()
            .find(|channel| channel.name == *name);
        found
            .or(layer.channel_data.list.first())
            .map(|channel| channel.sample_data.values_as_f32().collect::<Vec<_>>())
    };
    let (Some(r), Some(g), Some(b)) = (plane("R"), plane("G"), plane("B")) else {
        return Err(ExportError::file(path, "has no channels"));
    };
    let pixels = r
        .iter()
        .zip(&g)
        .zip(&b)
        .map(|((&r, &g), &b)| [r, g, b])
        .collect();
    Ok(RgbImage {
        width: layer.size.x(),
        height: layer.size.y(),
        pixels,
    })
}
