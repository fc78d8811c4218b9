//! Photographs of a camera held on its side: every command sees them upright, as viewers show them.

#![expect(clippy::unwrap_used, reason = "a test may stop at once")]

mod command;
mod photographs;

use std::io::Cursor;
use std::path::{Path, PathBuf};

use command::{succeeds, text, turnlight};
use image::{ImageFormat, RgbImage as Bytes};
use photographs::{dng_held, jpeg_held, tiff_of};
use turnlight::image::{Mask, RgbImage};

/// Columns and rows of the picture as it is seen.
const WIDTH: u32 = 48;
const HEIGHT: u32 = 32;

/// Where a file keeps the pixel that is seen at `(x, y)`.
type Place = fn(u32, u32) -> (u32, u32);

/// EXIF's numbers, and what they mean.
const HELD: [(u16, Place); 8] = [
    (1, |x, y| (x, y)),
    (2, |x, y| (WIDTH - 1 - x, y)),
    (3, |x, y| (WIDTH - 1 - x, HEIGHT - 1 - y)),
    (4, |x, y| (x, HEIGHT - 1 - y)),
    (5, |x, y| (y, x)),
    (6, |x, y| (y, WIDTH - 1 - x)),
    (7, |x, y| (HEIGHT - 1 - y, WIDTH - 1 - x)),
    (8, |x, y| (HEIGHT - 1 - y, x)),
];

/// The file's pixels of a picture that is seen as `seen`.
fn stored(seen: &Bytes, (number, place): (u16, Place)) -> Bytes {
    let on_its_side = number > 4;
    let (width, height) = if on_its_side {
        (HEIGHT, WIDTH)
    } else {
        (WIDTH, HEIGHT)
    };
    let mut file = Bytes::new(width, height);
    for (x, y, pixel) in seen.enumerate_pixels() {
        let (column, row) = place(x, y);
        file.put_pixel(column, row, *pixel);
    }
    file
}

/// A picture without any symmetry, of blocks that JPEG keeps.
fn picture(exposure: f64) -> Bytes {
    Bytes::from_fn(WIDTH, HEIGHT, |x, y| {
        let (i, j) = (f64::from(x / 8), f64::from(y / 8));
        let value = |scale: f64| (exposure * scale * (10.0 + 15.0 * i + 40.0 * j)).min(255.0) as u8;
        image::Rgb([value(1.0), value(0.8), value(0.6)])
    })
}

fn write(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn jpeg(image: &Bytes) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    image.write_to(&mut file, ImageFormat::Jpeg).unwrap();
    file.into_inner()
}

#[test]
fn photographs_are_read_upright() {
    let folder = tempfile::tempdir().unwrap();
    let seen = picture(1.0);
    let expected: Vec<[f32; 3]> = seen
        .pixels()
        .map(|p| p.0.map(|c| f32::from(c) / 255.0))
        .collect();
    for held in HELD {
        let number = held.0;
        let file = stored(&seen, held);
        let tiff = write(
            folder.path(),
            &format!("{number}.tif"),
            &tiff_of(&file, number),
        );
        let image = RgbImage::read_raw(&tiff).unwrap();
        assert_eq!(
            (image.width, image.height),
            (WIDTH as usize, HEIGHT as usize)
        );
        assert_eq!(image.pixels, expected, "TIFF {number}");
        let mask = Mask::read(&tiff).unwrap();
        assert_eq!((mask.width, mask.height), (WIDTH as usize, HEIGHT as usize));

        let jpeg = write(
            folder.path(),
            &format!("{number}.jpg"),
            &jpeg_held(&jpeg(&file), number),
        );
        let image = RgbImage::read_raw(&jpeg).unwrap();
        assert_eq!(
            (image.width, image.height),
            (WIDTH as usize, HEIGHT as usize)
        );
        let furthest = (image.pixels.as_flattened().iter())
            .zip(expected.as_flattened())
            .fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
        assert!(furthest < 0.05, "JPEG {number}: {furthest}");
    }
    // A number that EXIF does not have, as some programs write 0: as stored.
    for number in [0, 9, 60000] {
        let path = write(folder.path(), "odd.tif", &tiff_of(&seen, number));
        assert_eq!(RgbImage::read_raw(&path).unwrap().pixels, expected);
        let path = write(folder.path(), "odd.jpg", &jpeg_held(&jpeg(&seen), number));
        assert_eq!(RgbImage::read_raw(&path).unwrap().width, WIDTH as usize);
    }
}

#[test]
#[cfg(feature = "raw")]
fn raw_files_are_read_upright() {
    let folder = tempfile::tempdir().unwrap();
    // Brighter to the right and, more so, downwards, in steps that demosaicing leaves.
    let level = |x: u16, y: u16| 1000 + 100 * (x / 16) + 1000 * (y / 16);
    let read = |number: u16| {
        let path = write(folder.path(), "held.dng", &dng_held(64, 48, number, level));
        RgbImage::read(&path).unwrap()
    };
    let upright = read(1);
    assert_eq!((upright.width, upright.height), (64, 48));
    // Held so that the sensor's left is up: EXIF 6 says to turn the picture clockwise.
    let turned = read(6);
    assert_eq!((turned.width, turned.height), (48, 64));
    for (x, y) in [(8, 8), (40, 8), (8, 60), (40, 60)] {
        assert_eq!(
            turned.pixels[y * 48 + x],
            upright.pixels[(47 - x) * 64 + y],
            "{x}, {y}"
        );
    }
}

#[test]
fn one_frame_held_on_its_side_changes_no_command() {
    let folder = tempfile::tempdir().unwrap();
    let frame = |exposure: f64, held: usize, name: &str| {
        let file = stored(&picture(exposure), HELD[held]);
        write(folder.path(), name, &tiff_of(&file, HELD[held].0))
    };
    // Brackets: the same probe whichever way the camera was held.
    let levels = [0.25, 0.5, 1.0, 2.0];
    let merged = |held: [usize; 4], out: &str| {
        let files: Vec<PathBuf> = (0..4)
            .map(|j| frame(levels[j], held[j], &format!("{out}{j}.tif")))
            .collect();
        let out = folder.path().join(format!("{out}.exr"));
        let mut words = vec!["probe", "merge", "--response", "linear", "--trust-times"];
        words.extend(["--times", "1/4,1/2,1,2", "--out", text(&out)]);
        words.extend(files.iter().map(|file| text(file)));
        succeeds(&words);
        std::fs::read(out).unwrap()
    };
    assert!(merged([0; 4], "upright") == merged([0, 5, 2, 7], "held"));

    // Comparisons: the same picture.
    let (a, b) = (frame(1.0, 0, "a.tif"), frame(1.0, 6, "b.tif"));
    let json = folder.path().join("errors.json");
    succeeds(&["compare", text(&a), text(&b), "--json", text(&json)]);
    let errors: serde_json::Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    assert_eq!(errors["overall"]["rmse"], 0.0);

    // Chessboards: one that is upright among some on their sides is not of their size, and is named.
    let (upright, aside) = (frame(1.0, 0, "c.tif"), folder.path().join("d.tif"));
    let file = stored(&picture(1.0), HELD[5]);
    std::fs::write(&aside, tiff_of(&file, 1)).unwrap();
    let words = ["camera", "calibrate", "--board", "9x6", "--out"];
    let out = folder.path().join("camera.toml");
    let files = [text(&out), text(&upright), text(&aside)];
    let run = turnlight(&[&words[..], &files].concat());
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert_eq!(run.status.code(), Some(2), "{said}");
    assert!(
        said.contains("d.tif: size = 32 × 48: must be 48 × 32"),
        "{said}"
    );
    assert!(!out.exists());
}
