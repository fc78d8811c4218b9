//! Cameras' raw files and DNG, through the crate `flashraw` (cargo feature `raw`).
//!
//! ```text
//! sample = (stored − black) / (white − black), then bilinear demosaicing, in [0, 1]
//! ```
//!
//! turned upright as EXIF says. Everything else is left out: white balance, colour matrix, exposure and tone belong
//! to the picture, not to the measurement, and an automatic white balance changes between frames.

use std::io::{BufRead, Seek};

use super::{Fault, RgbImage};

/// Whether a file that begins with these bytes may be a raw file: everything but what is surely an image.
pub(super) fn may_be(magic: &[u8]) -> bool {
    let image = magic.starts_with(b"\x89PNG")
        || magic.starts_with(&[0xff, 0xd8, 0xff])
        || magic.starts_with(b"#?");
    !image
}

/// The camera's linear RGB, or `None` where the file is not a raw file.
#[cfg(feature = "raw")]
pub(super) fn read(file: &mut (impl BufRead + Seek)) -> Result<Option<RgbImage>, Fault> {
    let mut bytes = Vec::new();
    file.rewind().map_err(Fault::damaged)?;
    file.read_to_end(&mut bytes).map_err(Fault::damaged)?;
    file.rewind().map_err(Fault::damaged)?;
    super::read::without_panic(|| decode(&bytes))
}

/// Raw files are refused as unknown by the readers of images.
#[cfg(not(feature = "raw"))]
pub(super) fn read(_: &mut (impl BufRead + Seek)) -> Result<Option<RgbImage>, Fault> {
    Ok(None)
}

#[cfg(feature = "raw")]
fn decode(bytes: &[u8]) -> Result<Option<RgbImage>, Fault> {
    use ::image::{DynamicImage, Rgb32FImage, metadata::Orientation};
    use flashraw::low_level::core::{PixelData, RawImage};
    use flashraw::process::{DevelopParams, develop};
    use flashraw::{
        CorruptionPolicy, DecodeOptions, Demosaic, FlashRaw, Limits, OutputFormat, RawPixelData,
    };

    use super::read::{MAX_PIXELS, PACKED_LESS, check_size};

    if flashraw::supports(bytes).is_none() {
        return Ok(None);
    }
    let limits = Limits::default().with_max_samples(MAX_PIXELS as u64);
    let Ok(file) = FlashRaw::open_with(bytes, limits) else {
        // A plain TIFF begins as many raw files do; the readers of images say what is wrong with it.
        return Ok(None);
    };
    let info = file.frame_info();
    check_size(
        info.width as usize,
        info.height as usize,
        2 * info.cpp as usize,
        bytes.len() as u64,
        PACKED_LESS,
    )?;
    let options = DecodeOptions {
        output: OutputFormat::RawF32,
        limits,
        corruption_policy: CorruptionPolicy::Strict,
        ..DecodeOptions::default()
    };
    let frame = file.decode(options).map_err(Fault::damaged)?;
    let RawPixelData::F32(samples) = frame.data else {
        return Err(Fault::new(
            "its samples are not understood",
            "convert it to linear 16-bit TIFF",
        ));
    };
    let stored = RawImage {
        width: frame.width,
        height: frame.height,
        cpp: frame.cpp,
        data: PixelData::F32(samples),
        float_max: None,
    };
    let mut info = info.clone();
    info.black_level = frame.black_level;
    let plain = DevelopParams {
        wb: [1.0; 4],
        cam_to_rgb: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        cam4_to_rgb: None,
        levels: None,
        ..DevelopParams::new(&info, Demosaic::Bilinear, info.crop)
    };
    let image = develop(&stored, &info, frame.origin, &plain, false).map_err(Fault::damaged)?;
    let (width, height) = (image.width as usize, image.height as usize);
    check_size(width, height, 2, bytes.len() as u64, PACKED_LESS)?;
    // The crate turns pictures for the screen only.
    let Some(stored) = Rgb32FImage::from_raw(image.width, image.height, image.rgb) else {
        return Err(Fault::damaged("has fewer samples than pixels"));
    };
    let mut upright = DynamicImage::ImageRgb32F(stored);
    upright.apply_orientation(
        Orientation::from_exif(info.orientation as u8).unwrap_or(Orientation::NoTransforms),
    );
    let upright = upright.into_rgb32f();
    Ok(Some(RgbImage {
        width: upright.width() as usize,
        height: upright.height() as usize,
        pixels: upright.as_raw().as_chunks::<3>().0.to_vec(),
    }))
}
