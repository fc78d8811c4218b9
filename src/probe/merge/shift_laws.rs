//! Laws of the alignment.

use super::laws::{CAMERA, expose, exposures, film, scale_of, scene};
use super::*;

#[test]
fn shifts_are_found_and_still_frames_stay() {
    // Textured, as rooms are: smooth light tells no shift.
    let mut truth = scene(320, 160);
    for (i, p) in truth.pixels.iter_mut().enumerate() {
        let (x, y) = (i % 320, i / 320);
        let albedo = [0.3, 1.0, 0.5, 0.8][(x / 5 * 7 + y / 5 * 3 + x * y / 900) % 4];
        *p = p.map(|c| albedo * c);
    }
    let t = exposures();
    let large = |dx: usize, dy: usize| {
        RgbImage::from_fn(250, 128, |x, y| truth.pixels[(y + dy) * 320 + x + dx])
    };
    let shift = |j: usize| {
        if j == 3 {
            (7, 2)
        } else if j == 8 {
            (11, 12)
        } else {
            (9, 9)
        }
    };
    let bracket: Vec<Frame> = (0..11)
        .map(|j| Frame {
            name: format!("{j:02}.png").into(),
            samples: expose(&large(shift(j).0, shift(j).1), t[j], &CAMERA, j as u64),
            depth: Depth::Bits8,
            exposure: t[j],
        })
        .collect();
    let found = align::shifts(&bracket);
    for (j, found) in found.iter().enumerate() {
        let (x, y) = shift(j);
        println!("frame {j} {found:?} of {:?}", (x as i32 - 9, y as i32 - 9));
    }
    for (j, found) in found.iter().enumerate() {
        let (x, y) = shift(j);
        assert_eq!(*found, (x as i32 - 9, y as i32 - 9), "frame {j}");
    }
}

/// Texels of the fine image by texel of a frame, on a side.
const FINE: i64 = 4;

/// A textured panorama with lamps of one to four texels, four times finer than its frames are.
fn fine_room() -> RgbImage {
    let (width, height) = (256 * FINE as usize, 128 * FINE as usize);
    let turn = std::f64::consts::TAU;
    RgbImage::from_fn(width, height, |x, y| {
        let (u, v) = (x as f64 / width as f64, y as f64 / height as f64);
        let level = 2.0 * (turn * u).sin() - 0.3 + 0.5 * (9.0 * v).sin();
        let (column, row) = (x / 29, y / 23);
        let albedo = [0.3, 1.0, 0.5, 0.8, 0.2][(column * 7 + row * 3 + column * row) % 5];
        let (across, down) = (x % 211, y % 157);
        let side = 4 + 3 * ((x / 211 + y / 157) % 5);
        let lamp = if across < side && down < side {
            30.0
        } else {
            1.0
        };
        [1.0, 0.9, 0.7].map(|tint| (10f64.powf(level) * albedo * lamp * tint) as f32)
    })
}

/// What a camera sees that is turned by so many fine texels: means over squares of two texels of a frame, as lens
/// and sensor spread a point; columns go round.
fn turned(room: &RgbImage, (columns, rows): (i64, i64)) -> RgbImage {
    let (width, height) = (room.width as i64, room.height as i64);
    RgbImage::from_fn(256, 128, |x, y| {
        let mut sum = [0.0; 3];
        let side = 2 * FINE;
        for k in 0..side * side {
            let column = (x as i64 * FINE + k % side - FINE / 2 - columns).rem_euclid(width);
            let row = (y as i64 * FINE + k / side - FINE / 2 - rows).clamp(0, height - 1);
            let texel = room.pixels[(row * width + column) as usize];
            sum = [0, 1, 2].map(|c| sum[c] + texel[c]);
        }
        sum.map(|c| c / (side * side) as f32)
    })
}

/// Median and nine-tenths quantile of the relative error where nothing is clipped, rows at the rims left out.
fn errors(merged: &Merged, truth: &RgbImage) -> [f64; 2] {
    let scale = scale_of(film);
    let mut errors: Vec<f64> = (256 * 12..256 * 116)
        .filter(|&i| merged.clipped.pixels[i] == 0)
        .map(|i| (f64::from(merged.radiance.pixels[i][1] / truth.pixels[i][1]) / scale - 1.0).abs())
        .collect();
    errors.sort_unstable_by(f64::total_cmp);
    [0.5, 0.9].map(|share| errors[(share * errors.len() as f64) as usize])
}

#[test]
fn fractions_of_a_pixel_are_undone() {
    let room = fine_room();
    let truth = turned(&room, (0, 0));
    let t = exposures();
    let merged = |moves: &dyn Fn(usize) -> (i64, i64), align| {
        let frames: Vec<Frame> = (0..t.len())
            .map(|j| Frame {
                name: format!("{j:02}.png").into(),
                samples: expose(&turned(&room, moves(j)), t[j], &CAMERA, j as u64),
                depth: Depth::Bits8,
                exposure: t[j],
            })
            .collect();
        let settings = MergeSettings {
            align,
            ..MergeSettings::default()
        };
        merge(frames, &settings).unwrap()
    };

    // Frames that did not move are not touched, bit by bit.
    let (still, as_they_are) = (merged(&|_| (0, 0), true), merged(&|_| (0, 0), false));
    assert!(still.frames.iter().all(|f| f.shift == [0.0; 2]));
    assert_eq!(still.radiance, as_they_are.radiance);

    // Up to half a pixel, which whole pixels would leave as it is.
    let half = |j: usize| match j {
        5 => (0, 0),
        _ => ((j as i64 * 7) % 5 - 2, (j as i64 * 3) % 5 - 2),
    };
    // The same, and three frames turned on by ten columns, which go round.
    let far = |j: usize| {
        let (x, y) = half(j);
        (if j < 3 { x + 10 * FINE } else { x }, y)
    };
    let [none, left] = [&still, &merged(&half, false)].map(|merged| errors(merged, &truth));
    for moves in [&half as &dyn Fn(usize) -> (i64, i64), &far] {
        let merged = merged(moves, true);
        for (j, frame) in merged.frames.iter().enumerate() {
            let (x, y) = moves(j);
            let expected = [x, y].map(|k| -(k as f64) / FINE as f64);
            println!("{:?} of {expected:?}", frame.shift);
            for (found, expected) in frame.shift.iter().zip(expected) {
                assert!(
                    (found - expected).abs() < 0.1,
                    "frame {j}: {found} of {expected}"
                );
            }
        }
        let undone = errors(&merged, &truth);
        println!(
            "median and 90 % error: still {none:.4?}, whole pixels {left:.4?}, fractions {undone:.4?}"
        );
        assert!(undone[0] < 0.7 * left[0] && undone[1] < 0.7 * left[1]);
    }
}
