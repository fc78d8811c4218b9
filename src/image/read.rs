//! Reading: the kind of a file is told from its first bytes, never from its name.
//!
//! A photograph whose EXIF says that the camera was held on its side is turned upright, as viewers show it: pixels
//! clicked and masks painted there are of the picture shown. What is left alone: alpha, colour profiles, Radiance's
//! EXPOSURE line.

use std::{
    fs::File,
    io::{BufRead, BufReader, Read, Seek, SeekFrom},
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
};

use ::image::{
    DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits, codecs::hdr::HdrDecoder,
};

use super::{Channel, Depth, Fault, ImageError, Mask, RgbImage, exr, jpeg, raw, srgb_decode};

/// The largest image that is read; 16384 × 8192, the largest probe, is half of it.
pub const MAX_PIXELS: usize = 1 << 28;

/// EXR and Radiance HDR pack no more than this many bytes into one: all-black DWAB comes to some
/// thousands. A header that claims more belongs to a truncated file.
pub(super) const PACKED_MOST: u64 = 1 << 16;

/// The same for PNG, JPEG and TIFF: progressive JPEG comes to 1536, LZW to 2700, deflate to 1032. The
/// decoder of JPEG fills what is missing with grey, so that a header of a kilobyte became an image of
/// 400 MB under the limit above.
pub(super) const PACKED_LESS: u64 = 1 << 12;

/// What integer samples of PNG, JPEG and TIFF stand for.
#[derive(Clone, Copy)]
enum Encoding {
    Srgb,
    Raw,
}

impl RgbImage {
    /// Reads EXR, Radiance HDR, PNG, JPEG or TIFF as linear RGB: integer samples are taken as sRGB and
    /// decoded, float samples stay as they are. Grey is expanded, alpha dropped. A camera's raw file or
    /// DNG is demosaiced to the camera's own linear RGB (see [`Depth::Raw`]).
    ///
    /// EXR: the first layer with R, G, B, else Y, else a lone channel; the display window, 0 where the file holds no data.
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        read_file(path, |file| read_any(file, Encoding::Srgb)).map(|(image, _)| image)
    }

    /// As [`RgbImage::read`], but integer samples are only divided by their maximum: for maps of numbers.
    pub fn read_raw(path: &Path) -> Result<Self, ImageError> {
        Self::read_samples(path).map(|(image, _)| image)
    }

    /// As [`RgbImage::read_raw`], and what the file's samples were.
    pub fn read_samples(path: &Path) -> Result<(Self, Depth), ImageError> {
        read_file(path, |file| read_any(file, Encoding::Raw))
    }
}

impl Mask {
    /// Reads a mask: 8-bit grey PNG as it stands; other images by their luminance, in 8 bits.
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        read_file(path, |file| {
            let image = without_panic(|| decode(file))?.into_luma8();
            let (width, height) = (image.width() as usize, image.height() as usize);
            Ok(Self {
                width,
                height,
                pixels: image.into_raw(),
            })
        })
    }
}

/// Columns, rows and all channels of an EXR file (display window, 0 where the file holds no data), in the file's
/// order, which is alphabetical; `LAYER.CHANNEL` where there are several layers.
pub fn read_exr_channels(path: &Path) -> Result<(usize, usize, Vec<Channel>), ImageError> {
    read_file(path, exr::read_channels)
}

pub(super) fn read_file<T>(
    path: &Path,
    read: impl FnOnce(BufReader<File>) -> Result<T, Fault>,
) -> Result<T, ImageError> {
    let open = || {
        let file = File::open(path).map_err(|e| Fault::new(e, "check the path"))?;
        if file.metadata().is_ok_and(|metadata| metadata.is_dir()) {
            return Err(Fault::new("is a folder", "give an image file"));
        }
        read(BufReader::new(file))
    };
    open().map_err(|fault| ImageError::file(path, fault))
}

fn read_any(mut file: impl BufRead + Seek, encoding: Encoding) -> Result<(RgbImage, Depth), Fault> {
    let mut magic = Vec::new();
    file.by_ref()
        .take(4)
        .read_to_end(&mut magic)
        .map_err(Fault::damaged)?;
    file.rewind().map_err(Fault::damaged)?;
    if magic == exr::MAGIC {
        return exr::read_rgb(file).map(|image| (image, Depth::Float));
    }
    if raw::may_be(&magic)
        && let Some(image) = raw::read(&mut file)?
    {
        return Ok((image, Depth::Raw));
    }
    let image = without_panic(|| decode(file))?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let depth = match &image {
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => Depth::Float,
        image if image.color().bytes_per_pixel() / image.color().channel_count() == 1 => {
            Depth::Bits8
        }
        _ => Depth::Bits16,
    };
    let pixels = match image {
        DynamicImage::ImageLuma8(samples) => expand_u8(&samples, 1, encoding),
        DynamicImage::ImageLumaA8(samples) => expand_u8(&samples, 2, encoding),
        DynamicImage::ImageRgb8(samples) => expand_u8(&samples, 3, encoding),
        DynamicImage::ImageRgba8(samples) => expand_u8(&samples, 4, encoding),
        DynamicImage::ImageLuma16(samples) => expand_u16(&samples, 1, encoding),
        DynamicImage::ImageLumaA16(samples) => expand_u16(&samples, 2, encoding),
        DynamicImage::ImageRgb16(samples) => expand_u16(&samples, 3, encoding),
        DynamicImage::ImageRgba16(samples) => expand_u16(&samples, 4, encoding),
        DynamicImage::ImageRgb32F(samples) => expand(&samples, 3, |x: f32| x),
        DynamicImage::ImageRgba32F(samples) => expand(&samples, 4, |x: f32| x),
        other => {
            let reason = format!("samples of kind {:?} are not understood", other.color());
            return Err(Fault::new(reason, "convert it to EXR or 16-bit PNG"));
        }
    };
    let image = RgbImage {
        width,
        height,
        pixels,
    };
    Ok((image, depth))
}

/// Everything but EXR and raw files.
fn decode(mut file: impl BufRead + Seek) -> Result<DynamicImage, Fault> {
    const KNOWN: &str = "give EXR, Radiance HDR, PNG, JPEG or TIFF";
    let file_bytes = file.seek(SeekFrom::End(0)).map_err(Fault::damaged)?;
    file.rewind().map_err(Fault::damaged)?;
    if file.fill_buf().map_err(Fault::damaged)?.starts_with(b"#?") {
        // Some programs sign Radiance files "#?RGBE".
        let decoder = HdrDecoder::new_nonstrict(file).map_err(Fault::damaged)?;
        return decode_checked(decoder, file_bytes, PACKED_MOST);
    }
    let mut reader = ImageReader::new(file)
        .with_guessed_format()
        .map_err(Fault::damaged)?;
    match reader.format() {
        None => return Err(Fault::new("is not an image of a known kind", KNOWN)),
        Some(ImageFormat::Jpeg) => {
            // The decoder, too, takes the whole file into memory.
            let mut bytes = Vec::new();
            let mut file = reader.into_inner();
            file.read_to_end(&mut bytes).map_err(Fault::damaged)?;
            jpeg::check_whole(&bytes)?;
            file.rewind().map_err(Fault::damaged)?;
            reader = ImageReader::with_format(file, ImageFormat::Jpeg);
        }
        Some(_) => {}
    }
    let decoder = reader.into_decoder().map_err(|error| match error {
        ::image::ImageError::Unsupported(_) => Fault::new(error, KNOWN),
        _ => Fault::damaged(error),
    })?;
    decode_checked(decoder, file_bytes, PACKED_LESS)
}

fn decode_checked(
    mut decoder: impl ImageDecoder,
    file_bytes: u64,
    most_packed: u64,
) -> Result<DynamicImage, Fault> {
    let (width, height) = decoder.dimensions();
    let bytes = usize::from(decoder.color_type().bytes_per_pixel());
    check_size(
        width as usize,
        height as usize,
        bytes,
        file_bytes,
        most_packed,
    )?;
    // The check above bounds the pixels, this what tags of the file may ask for besides; the crate's own
    // limit refuses large probes.
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(4 * decoder.total_bytes() + (1 << 24));
    decoder.set_limits(limits).map_err(Fault::damaged)?;
    let orientation = decoder.orientation().map_err(Fault::damaged)?;
    let mut image = DynamicImage::from_decoder(decoder).map_err(Fault::damaged)?;
    image.apply_orientation(orientation);
    Ok(image)
}

/// Refuses sizes that are empty, too large, or more than a file of this length can hold if it packs
/// `most_packed` bytes into one.
pub(super) fn check_size(
    width: usize,
    height: usize,
    bytes_per_pixel: usize,
    file_bytes: u64,
    most_packed: u64,
) -> Result<(), Fault> {
    let pixels = width as u128 * height as u128;
    if pixels == 0 {
        return Err(Fault::damaged(format!(
            "has no pixels ({width} × {height})"
        )));
    }
    if pixels > MAX_PIXELS as u128 {
        let reason = format!("{width} × {height} is more than {MAX_PIXELS} pixels");
        return Err(Fault::new(reason, "scale it down or crop it"));
    }
    let bytes = pixels * bytes_per_pixel as u128;
    if bytes > u128::from(file_bytes) * u128::from(most_packed) {
        let reason = format!("claims {width} × {height} pixels in a file of {file_bytes} bytes");
        return Err(Fault::damaged(reason));
    }
    Ok(())
}

/// Runs a decoder of another crate; a panic in it becomes an error.
///
/// The exr crate's decompressors index by numbers that a damaged file supplies, and panic. Nothing of
/// the decoder outlives the call, so no broken state can be seen.
pub(super) fn without_panic<T>(decode: impl FnOnce() -> Result<T, Fault>) -> Result<T, Fault> {
    catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|_| {
        Err(Fault::damaged(
            "is damaged in a way that stopped its decoder",
        ))
    })
}

fn expand_u8(samples: &[u8], channels: usize, encoding: Encoding) -> Vec<[f32; 3]> {
    let values = levels(u8::MAX.into(), encoding);
    expand(samples, channels, |x: u8| values[usize::from(x)])
}

fn expand_u16(samples: &[u16], channels: usize, encoding: Encoding) -> Vec<[f32; 3]> {
    let values = levels(u16::MAX.into(), encoding);
    expand(samples, channels, |x: u16| values[usize::from(x)])
}

/// The value of each integer sample 0..=max.
fn levels(max: u32, encoding: Encoding) -> Vec<f32> {
    (0..=max)
        .map(|level| {
            let value = f64::from(level) / f64::from(max);
            match encoding {
                Encoding::Srgb => srgb_decode(value) as f32,
                Encoding::Raw => value as f32,
            }
        })
        .collect()
}

/// Interleaved grey, grey-alpha, RGB or RGBA to RGB.
fn expand<T: Copy>(samples: &[T], channels: usize, value: impl Fn(T) -> f32) -> Vec<[f32; 3]> {
    let rgb = |pixel: &[T]| match *pixel {
        [r, g, b, ..] => [value(r), value(g), value(b)],
        [y, ..] => [value(y); 3],
        [] => [0.0; 3],
    };
    samples.chunks_exact(channels).map(rgb).collect()
}

/// The readers of [`RgbImage::read`] and [`Mask::read`] on bytes in memory.
#[cfg(test)]
pub(super) fn for_fuzz(file: std::io::Cursor<&[u8]>) {
    if let Ok((image, _)) = read_any(file.clone(), Encoding::Srgb) {
        assert_eq!(image.pixels.len(), image.width * image.height);
    }
    let _ = without_panic(|| decode(file));
}
