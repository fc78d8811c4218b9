//! What is on the cards of a laboratory's two cameras: exposure brackets of the light, a colour chart seen by both,
//! and a chessboard, all taken by turnlight's own sensor model.

use std::io::Cursor;
use std::path::Path;

use glam::{DMat3, DVec2, DVec3};
use image::codecs::jpeg::JpegEncoder;
use turnlight::image::{RgbImage, srgb_encode, write_exr};
use turnlight::probe::Chart;
use turnlight::render::expose;
use turnlight::rig::Camera;
use turnlight::scene::Sensor;

use super::photographs::with_exif;

/// Both cameras' sensors.
const SENSOR: Sensor = Sensor {
    full_well_electrons: 30_000.0,
    read_noise_electrons: 5.0,
    bits: 14,
    exposure: 1.0,
};

/// What the probe's camera makes of the other's linear RGB: other filters, another white.
const PROBE_FROM_CAMERA: [[f32; 3]; 3] = [[1.1, 0.35, 0.05], [0.2, 0.75, 0.05], [0.02, 0.3, 0.9]];

/// Exposure times of the brackets, in units of 1/4000 s; what the first makes white is radiance 120.
const TIMES: [u32; 11] = [1, 3, 8, 20, 50, 130, 320, 800, 2000, 5000, 12_500];
const WHITE: f32 = 120.0;

/// Centres of the chart's corner patches, in the order and form of `--probe-corners` and `--camera-corners`.
pub(crate) const CHART_CORNERS: &str = "30,30,230,30,230,150,30,150";

/// Inner corners of the chessboard, columns and rows.
pub(crate) const BOARD: [usize; 2] = [6, 5];

/// Writes `brackets/*.jpg` and `chart/*.jpg` of the probe's camera, and `chart.exr` and `chessboard/*.jpg` of the
/// object's camera, whose lens is `camera`'s; `light` is the light in that camera's colours.
pub(crate) fn write(folder: &Path, light: &RgbImage, camera: &Camera) -> anyhow::Result<()> {
    let folders = ["brackets", "chart", "chessboard"].map(|name| folder.join(name));
    for folder in &folders {
        std::fs::create_dir_all(folder)?;
    }
    let [brackets, charts, boards] = folders;
    bracket(&brackets, light, 1)?;
    let chart = chart();
    bracket(&charts, &chart, 2)?;
    let mut seen = chart;
    expose(&mut seen, &SENSOR, 1.0, 3, 0);
    write_exr(&folder.join("chart.exr"), &seen)?;
    for number in 0..14 {
        let mut board = chessboard(camera, number);
        expose(&mut board, &SENSOR, 1.0, 4, number);
        let file = jpeg(&board, srgb_encode)?;
        std::fs::write(boards.join(format!("{number:02}.jpg")), file)?;
    }
    Ok(())
}

/// Eleven exposures of the probe's camera, with EXIF.
fn bracket(folder: &Path, seen: &RgbImage, seed: u64) -> anyhow::Result<()> {
    // An S-curve over sRGB, as picture styles have it.
    let style = |x: f64| {
        let v = srgb_encode(x);
        0.5 * v + 0.5 * v * v * (3.0 - 2.0 * v)
    };
    for (number, &time) in (0..).zip(&TIMES) {
        let mut image = seen.clone();
        for p in &mut image.pixels {
            let light = p.map(|c| c.max(0.0) * time as f32 / WHITE);
            *p = PROBE_FROM_CAMERA.map(|row| (0..3).map(|c| row[c] * light[c]).sum());
        }
        expose(&mut image, &SENSOR, 1.0, seed, number);
        let file = with_exif(&jpeg(&image, style)?, (time, 4000));
        std::fs::write(folder.join(format!("{number:02}.jpg")), file)?;
    }
    Ok(())
}

fn jpeg(image: &RgbImage, tone: impl Fn(f64) -> f64) -> anyhow::Result<Vec<u8>> {
    let samples: Vec<u8> = (image.pixels.as_flattened().iter())
        .map(|&x| (255.0 * tone(f64::from(x.clamp(0.0, 1.0)))).round() as u8)
        .collect();
    let mut file = Cursor::new(Vec::new());
    let size = (image.width as u32, image.height as u32);
    JpegEncoder::new_with_quality(&mut file, 97).encode(
        &samples,
        size.0,
        size.1,
        image::ExtendedColorType::Rgb8,
    )?;
    Ok(file.into_inner())
}

/// A ColorChecker, patches 40 pixels apart, before a grey wall.
fn chart() -> RgbImage {
    let patches = Chart::colorchecker().patches;
    RgbImage::from_fn(260, 180, |x, y| {
        let (column, row) = (x.saturating_sub(10) / 40, y.saturating_sub(10) / 40);
        let inside = |v: usize| v >= 10 && (v - 10) % 40 >= 3 && (v - 10) % 40 < 37;
        if inside(x) && inside(y) && column < 6 && row < 4 {
            patches[6 * row + column].rgb.map(|c| c as f32)
        } else {
            [0.1; 3]
        }
    })
}

/// The board in another pose for every number: tilted by up to 35°, also near the image's corners.
fn chessboard(camera: &Camera, number: u32) -> RgbImage {
    let about = f64::from(number) * 2.4;
    let tilt = 35f64.to_radians() * (0.4 + 0.6 * f64::from(number % 3) / 2.0);
    let axis = DVec3::new(about.cos(), about.sin(), 0.0);
    let turn = DMat3::from_axis_angle(axis, tilt) * DMat3::from_rotation_z(0.3 * about.sin());
    // The board, of squares of 1, fills about two thirds of the view.
    let squares = BOARD.map(|n| n as f64 + 1.0);
    let corner = camera.ideal_point(DVec2::ZERO).abs();
    let distance = 0.75 * squares[0] / corner.x;
    let aside = DVec2::from_angle(1.7 * about) * 0.25 * corner * distance;
    let middle = DVec3::new(aside.x, aside.y, distance);
    let (across, down, normal) = (turn.x_axis, turn.y_axis, turn.z_axis);
    RgbImage::from_fn(camera.width, camera.height, |x, y| {
        const SIDE: u32 = 6;
        let mut sum = 0.0;
        for k in 0..SIDE * SIDE {
            let inside =
                (DVec2::new(f64::from(k % SIDE), f64::from(k / SIDE)) + 0.5) / f64::from(SIDE);
            let ray = (camera.ideal_point(DVec2::new(x as f64, y as f64) + inside)).extend(1.0);
            let met = ray * (middle.dot(normal) / ray.dot(normal)) - middle;
            let place = [
                met.dot(across) + 0.5 * squares[0],
                met.dot(down) + 0.5 * squares[1],
            ];
            let on_board = (0..2).all(|i| place[i] > 0.0 && place[i] < squares[i]);
            let dark = (place[0].floor() + place[1].floor()).rem_euclid(2.0) != 0.0;
            sum += if on_board && dark { 0.04 } else { 0.7 };
        }
        [sum / (SIDE * SIDE) as f32; 3]
    })
}
