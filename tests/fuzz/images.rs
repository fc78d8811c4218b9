//! Images: probes, masks, photographs.

use std::path::Path;

use turnlight::image::{Mask, RgbImage, read_exr_channels};
use turnlight::probe::Environment;

use super::mutate::Form;
use super::room::{PACKED, PICTURE, TAGGED};
use super::{Outcome, Parser, fuzz, seeds};

#[test]
fn exr_is_read_or_refused() {
    let read = |path: &Path| {
        // Both ways in; a file may be fit for one only.
        let channels = read_exr_channels(path).map(|(width, height, channels)| {
            assert!(
                channels.iter().all(|c| c.samples.len() == width * height),
                "channels"
            );
        });
        probe(path).and(channels.map_err(|e| e.to_string()))
    };
    fuzz(
        Parser {
            name: "exr",
            file: "probe.exr",
            form: Form::Binary,
            seeds: seeds::exr(),
            room: PACKED,
            inputs: 3_000,
        },
        |_| (),
        read,
    );
}

#[test]
fn hdr_is_read_or_refused() {
    fuzz(
        Parser {
            name: "hdr",
            file: "probe.hdr",
            form: Form::Text,
            seeds: seeds::hdr(),
            room: PACKED,
            inputs: 6_000,
        },
        |_| (),
        probe,
    );
}

/// An image is whole, and the light made of it finite and not negative.
fn probe(path: &Path) -> Outcome {
    let image = RgbImage::read(path).map_err(|e| e.to_string())?;
    assert_eq!(image.pixels.len(), image.width * image.height);
    if image.pixels.len() > 1 << 16 {
        return Ok(());
    }
    // What the probe says is about texels; the file is named by who read it.
    if let Ok((environment, _)) = Environment::new(image, 0.5) {
        let sound = |c: &f32| c.is_finite() && *c >= 0.0;
        assert!(
            environment.image().pixels.as_flattened().iter().all(sound),
            "radiance"
        );
        assert!(
            environment.mean_radiance().to_array().iter().all(sound),
            "mean radiance"
        );
    }
    Ok(())
}

#[test]
fn png_is_read_or_refused() {
    fuzz(
        Parser {
            name: "png",
            file: "mask.png",
            form: Form::Png,
            seeds: seeds::png(),
            room: PICTURE,
            inputs: 5_000,
        },
        |_| (),
        picture,
    );
}

#[test]
fn jpeg_and_tiff_are_read_or_refused() {
    fuzz(
        Parser {
            name: "photograph",
            file: "photograph.tiff",
            form: Form::Binary,
            seeds: seeds::photographs(),
            room: TAGGED,
            inputs: 6_000,
        },
        |_| (),
        picture,
    );
}

/// The same size as mask, as image and as map of numbers.
fn picture(path: &Path) -> Outcome {
    let mask = Mask::read(path).map_err(|e| e.to_string())?;
    assert_eq!(mask.pixels.len(), mask.width * mask.height);
    for image in [RgbImage::read(path), RgbImage::read_raw(path)] {
        let image = image.map_err(|e| e.to_string())?;
        assert_eq!((image.width, image.height), (mask.width, mask.height));
        assert_eq!(image.pixels.len(), mask.pixels.len());
    }
    Ok(())
}
