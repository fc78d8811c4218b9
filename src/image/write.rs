//! Writing, each file whole or not at all.

use std::{
    collections::HashSet,
    io::{self, Cursor, Write},
    path::Path,
};

use ::image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use super::{Channel, Fault, ImageError, Mask, RgbImage, ToneCurve, exr, write_atomically};

/// Writes linear RGB as EXR: float32 R, G, B, losslessly compressed. Equal images give equal bytes.
pub fn write_exr(path: &Path, image: &RgbImage) -> Result<(), ImageError> {
    let plane = |c: usize| image.pixels.iter().map(|pixel| pixel[c]).collect();
    let planes = vec![("R", plane(0)), ("G", plane(1)), ("B", plane(2))];
    write_planes(path, (image.width, image.height), planes)
}

/// Writes named float32 planes as one EXR layer, losslessly compressed. Equal planes give equal bytes.
pub fn write_exr_channels(
    path: &Path,
    width: usize,
    height: usize,
    channels: &[Channel],
) -> Result<(), ImageError> {
    let planes = channels
        .iter()
        .map(|c| (c.name.as_str(), c.samples.clone()))
        .collect();
    write_planes(path, (width, height), planes)
}

fn write_planes(
    path: &Path,
    (width, height): (usize, usize),
    planes: Vec<(&str, Vec<f32>)>,
) -> Result<(), ImageError> {
    let mut names = HashSet::new();
    let fault = if width == 0 || height == 0 {
        Some(format!("{width} × {height} is empty"))
    } else if planes.is_empty() {
        Some("there are no channels to write".to_owned())
    } else {
        planes.iter().find_map(|(name, samples)| {
            if name.is_empty() || name.len() > 255 || name.contains('\0') {
                Some(format!("channel name {name:?} does not fit the format"))
            } else if !names.insert(*name) {
                Some(format!("channel {name:?} stands twice"))
            } else if samples.len() != width * height {
                let count = samples.len();
                Some(format!(
                    "channel {name:?} has {count} samples for {width} × {height} pixels"
                ))
            } else {
                None
            }
        })
    };
    if let Some(reason) = fault {
        return Err(ImageError::file(
            path,
            Fault::new(reason, "nothing was written"),
        ));
    }
    write_file(path, |file| {
        exr::write_planes(file, (width, height), planes)
    })
}

impl Mask {
    /// Writes an 8-bit grey PNG.
    pub fn write(&self, path: &Path) -> Result<(), ImageError> {
        let png = encode(&self.pixels, self.width, self.height, ExtendedColorType::L8);
        write_png_bytes(path, png)
    }
}

/// Writes an 8-bit sRGB PNG after the tone curve.
pub fn write_png(path: &Path, image: &RgbImage, curve: ToneCurve) -> Result<(), ImageError> {
    write_png_bytes(path, encode_png(image, curve))
}

/// The bytes of an 8-bit sRGB PNG after the tone curve, to embed.
pub fn encode_png(image: &RgbImage, curve: ToneCurve) -> io::Result<Vec<u8>> {
    let bytes: Vec<[u8; 3]> = image
        .pixels
        .iter()
        .map(|pixel| pixel.map(|radiance| curve.byte(radiance)))
        .collect();
    encode_png_bytes(image.width, image.height, &bytes)
}

/// The bytes of a PNG of 8-bit sRGB pixels, such as those of [`viridis`](super::viridis).
pub fn encode_png_bytes(width: usize, height: usize, pixels: &[[u8; 3]]) -> io::Result<Vec<u8>> {
    encode(
        pixels.as_flattened(),
        width,
        height,
        ExtendedColorType::Rgb8,
    )
}

fn encode(
    samples: &[u8],
    width: usize,
    height: usize,
    kind: ExtendedColorType,
) -> io::Result<Vec<u8>> {
    let channels = usize::from(kind.channel_count());
    if samples.is_empty() || samples.len() != width * height * channels {
        let reason = format!(
            "{} samples do not make {width} × {height} pixels",
            samples.len()
        );
        return Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
    }
    let side = |pixels: usize| u32::try_from(pixels).map_err(io::Error::other);
    let mut png = Cursor::new(Vec::new());
    PngEncoder::new(&mut png)
        .write_image(samples, side(width)?, side(height)?, kind)
        .map_err(io::Error::other)?;
    Ok(png.into_inner())
}

fn write_png_bytes(path: &Path, png: io::Result<Vec<u8>>) -> Result<(), ImageError> {
    let png = png.map_err(|e| ImageError::file(path, Fault::new(e, "nothing was written")))?;
    write_file(path, |file| file.write_all(&png))
}

fn write_file(
    path: &Path,
    write: impl FnOnce(&mut io::BufWriter<std::fs::File>) -> io::Result<()>,
) -> Result<(), ImageError> {
    write_atomically(path, write).map_err(|e| ImageError::file(path, Fault::write(e)))
}
