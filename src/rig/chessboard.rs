//! The inner corners of a chessboard in a photograph.
//!
//! Detection is calib-targets': ChESS corners (Bennett & Lasenby 2014) joined to a labelled grid, each
//! corner refined at the saddle of its grey values. Labels count from the board's own first corner seen;
//! which one that is, and whether columns and rows are swapped, differs between photographs, and a
//! calibration does not mind: the pose takes it up.

use calib_targets_chessboard::{
    ChessboardDetection, ChessboardDetector, ChessboardParams, DetectorConfig, GrayImageView,
    default_chess_config, detect_corners,
};
use chess_corners::{ImageRefiner, MultiscaleConfig, SaddlePointConfig};
use glam::DVec2;

use super::{BoardView, Corner, FEWEST_CORNERS};
use crate::image::{RgbImage, luminance, srgb_encode};

/// Inner corners of a board, the larger number first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board {
    /// Along the longer side.
    pub columns: usize,
    /// Along the shorter side.
    pub rows: usize,
}

/// Smallest and largest number of inner corners along a side.
pub const BOARD_SIDES: std::ops::RangeInclusive<usize> = 3..=200;

/// Images with a shorter side are not searched: no board is to be seen, and the detector's rings leave them.
const SHORTEST_SIDE: usize = 48;

/// Why a photograph shows no usable board.
#[derive(Debug, thiserror::Error)]
pub enum BoardError {
    /// None is seen.
    #[error(
        "no chessboard with {} × {} inner corners was found ({found} corners seen); photograph it sharp, \
         evenly lit and with a white margin", board.columns, board.rows
    )]
    NotSeen {
        /// What was looked for.
        board: Board,
        /// Corners of the largest grid that was found.
        found: usize,
    },
    /// One of another size is.
    #[error(
        "a grid of {columns} × {rows} inner corners was found, which a board of {} × {} has not; count the \
         corners where four squares meet, and cover other chequered things", board.columns, board.rows
    )]
    Larger {
        /// What was looked for.
        board: Board,
        /// Larger side of the grid found.
        columns: usize,
        /// Smaller side of the grid found.
        rows: usize,
    },
}

impl Board {
    /// The board with these numbers of inner corners, in either order, each within [`BOARD_SIDES`].
    pub fn new(one: usize, other: usize) -> Option<Self> {
        let (columns, rows) = (one.max(other), one.min(other));
        (BOARD_SIDES.contains(&columns) && BOARD_SIDES.contains(&rows))
            .then_some(Self { columns, rows })
    }

    /// Finds the board in a photograph, the whole of it or a half of its corners at least.
    ///
    /// # Errors
    /// There is none, or a larger one.
    pub fn find(self, name: &str, photograph: &RgbImage) -> Result<BoardView, BoardError> {
        if photograph.width.min(photograph.height) < SHORTEST_SIDE {
            let found = 0;
            return Err(BoardError::NotSeen { board: self, found });
        }
        let grey = grey(photograph);
        let view = GrayImageView {
            width: photograph.width,
            height: photograph.height,
            data: &grey,
        };
        let all = self.columns * self.rows;
        let (mut best, mut larger, mut found) = (None::<ChessboardDetection>, None, 0);
        for config in configurations() {
            let Some(detection) = detect(&view, &config) else {
                continue;
            };
            found = detection.corners.len().max(found);
            let (columns, rows) = extent(&detection);
            if columns > self.columns || rows > self.rows {
                larger = Some((columns, rows));
                continue;
            }
            let count = detection.corners.len();
            if count > best.as_ref().map_or(0, |best| best.corners.len()) {
                best = Some(detection);
            }
            if count == all {
                break;
            }
        }
        let enough = (all / 2).max(FEWEST_CORNERS);
        match (best, larger) {
            (Some(best), _) if best.corners.len() >= enough => {
                Ok(self::view(name, &refined(&view, best)))
            }
            (_, Some((columns, rows))) => Err(BoardError::Larger {
                board: self,
                columns,
                rows,
            }),
            _ => Err(BoardError::NotSeen { board: self, found }),
        }
    }
}

/// Ways to look, the best first: coarse to fine, which passes over texture and noise, then at full
/// resolution, for boards whose squares are a few pixels wide.
fn configurations() -> [DetectorConfig; 2] {
    let saddle = default_chess_config().with_refiner(ImageRefiner::saddle_point());
    [
        saddle.with_multiscale(MultiscaleConfig::pyramid_default()),
        saddle,
    ]
}

/// The same board, its corners placed by as many pixels as its squares allow.
///
/// The patch reaches a tenth of a square each way: on OpenCV's photographs (squares of 31 to 46 pixels) the
/// corners of a calibration are off by 0.190 pixels with the detector's own half size of 2, 0.178 with a tenth
/// of a square, 0.175 with an eighth, 0.185 with a sixth, where the patch reaches the next corner of boards
/// seen at a slant.
fn refined(view: &GrayImageView<'_>, board: ChessboardDetection) -> ChessboardDetection {
    let radius = board
        .cell_size
        .map_or(2, |cell| (0.1 * cell).round().clamp(2.0, 8.0) as i32);
    let mut saddle = SaddlePointConfig::default();
    if radius <= saddle.radius {
        return board;
    }
    saddle.radius = radius;
    let [coarse_to_fine, _] = configurations();
    match detect(
        view,
        &coarse_to_fine.with_refiner(ImageRefiner::SaddlePoint(saddle)),
    ) {
        Some(finer)
            if finer.corners.len() >= board.corners.len() && extent(&finer) == extent(&board) =>
        {
            finer
        }
        _ => board,
    }
}

fn detect(view: &GrayImageView<'_>, config: &DetectorConfig) -> Option<ChessboardDetection> {
    let corners = detect_corners(view, config);
    ChessboardDetector::new(ChessboardParams::default())
        .ok()?
        .detect(&corners)
}

/// Inner corners along the longer and the shorter side of the labelled grid.
fn extent(detection: &ChessboardDetection) -> (usize, usize) {
    let side = |label: fn(&calib_targets_chessboard::ChessboardCorner) -> i32| {
        let labels = || detection.corners.iter().map(label);
        let span = labels().max().unwrap_or(0) - labels().min().unwrap_or(0);
        span.unsigned_abs() as usize + 1
    };
    let (u, v) = (side(|c| c.grid.u), side(|c| c.grid.v));
    (u.max(v), u.min(v))
}

fn view(name: &str, detection: &ChessboardDetection) -> BoardView {
    let corner = |c: &calib_targets_chessboard::ChessboardCorner| Corner {
        board: DVec2::new(f64::from(c.grid.u), f64::from(c.grid.v)),
        // The detector counts from the centre of the first pixel.
        pixel: DVec2::new(f64::from(c.position.x), f64::from(c.position.y)) + 0.5,
    };
    BoardView {
        name: name.to_owned(),
        corners: detection.corners.iter().map(corner).collect(),
    }
}

/// Display grey values, stretched where the brightest hundredth is darker than half or brighter than
/// white.
fn grey(photograph: &RgbImage) -> Vec<u8> {
    let light: Vec<f32> = photograph
        .pixels
        .iter()
        .map(|pixel| luminance(pixel.map(f64::from)) as f32)
        .map(|light| {
            if light.is_finite() {
                light.max(0.0)
            } else {
                0.0
            }
        })
        .collect();
    let mut sorted = light.clone();
    let rank = sorted.len() - 1 - sorted.len() / 100;
    let (_, bright, _) = sorted.select_nth_unstable_by(rank, f32::total_cmp);
    let white = if (0.2..=1.0).contains(bright) || *bright == 0.0 {
        1.0
    } else {
        f64::from(*bright)
    };
    light
        .iter()
        .map(|&light| (srgb_encode((f64::from(light) / white).min(1.0)) * 255.0).round() as u8)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A board of 8 × 6 squares as a lens blurs it, over two pixels, with eight samples a side; `place` takes
    /// a pixel to board coordinates in squares.
    fn drawn(place: impl Fn(DVec2) -> DVec2, white: f32) -> RgbImage {
        RgbImage::from_fn(320, 240, |x, y| {
            let sample = |i: usize| {
                let offset = DVec2::new((i % 8) as f64, (i / 8) as f64) * 0.25 - 0.375;
                let p = place(DVec2::new(x as f64, y as f64) + offset);
                let inside = p.x > -1.0 && p.y > -1.0 && p.x < 7.0 && p.y < 5.0;
                let odd = (p.x.floor() + p.y.floor()).rem_euclid(2.0) != 0.0;
                if inside && odd { 0.02 } else { 0.8 }
            };
            [white * (0..64).map(sample).sum::<f32>() / 64.0; 3]
        })
    }

    #[test]
    fn corners_of_a_drawn_board_are_found_to_a_twentieth_of_a_pixel_on_average() {
        let turned = |p: DVec2| {
            let q = p - DVec2::new(88.3, 61.7);
            DVec2::from_angle(-0.2).rotate(q) / 23.0
        };
        // Also as a linear image of much light, and of little.
        for white in [1.0, 300.0, 1e-3] {
            let found = Board::new(5, 7)
                .unwrap()
                .find("drawn", &drawn(turned, white))
                .unwrap();
            assert_eq!(found.corners.len(), 35);
            let square = |corner: &Corner| {
                let board = turned(corner.pixel);
                ((board - board.round()) * 23.0).length_squared()
            };
            let squares: Vec<f64> = found.corners.iter().map(square).collect();
            let rms = (squares.iter().sum::<f64>() / 35.0).sqrt();
            let worst = squares.iter().copied().fold(0.0, f64::max).sqrt();
            assert!(
                rms < 0.05 && worst < 0.15,
                "light {white}: {rms}, worst {worst}"
            );
        }
    }

    proptest! {
        #[test]
        fn any_image_is_searched_without_a_panic(
            width in 1usize..130, height in 1usize..130, seed in any::<u32>(), coarse in 1usize..12,
        ) {
            // Blocks of noise: from snow to something like squares.
            let image = RgbImage::from_fn(width, height, |x, y| {
                let block = (x / coarse + 256 * (y / coarse)) as u32;
                let word = (block ^ seed).wrapping_mul(2_654_435_761).rotate_left(13);
                [(word.wrapping_mul(2_246_822_519) >> 24) as f32 / 255.0; 3]
            });
            let _ = Board::new(3, 3).unwrap().find("noise", &image);
        }
    }

    #[test]
    fn other_boards_and_none_are_refused() {
        let plain = |p: DVec2| (p - DVec2::new(88.0, 61.0)) / 23.0;
        let image = drawn(plain, 1.0);
        let larger = Board::new(4, 4).unwrap().find("a", &image).unwrap_err();
        assert!(matches!(
            larger,
            BoardError::Larger {
                columns: 7,
                rows: 5,
                ..
            }
        ));
        let many = Board::new(20, 20).unwrap().find("a", &image).unwrap_err();
        assert!(matches!(many, BoardError::NotSeen { found: 35, .. }));
        for empty in [
            RgbImage::constant(1, 1, [f32::NAN; 3]),
            RgbImage::constant(90, 70, [0.5; 3]),
        ] {
            let none = Board::new(4, 4).unwrap().find("a", &empty).unwrap_err();
            assert!(matches!(none, BoardError::NotSeen { found: 0, .. }));
        }
        assert!(Board::new(2, 9).is_none() && Board::new(9, 201).is_none());
    }
}
