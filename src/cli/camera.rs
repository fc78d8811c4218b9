//! `turnlight camera`.

mod calibrate;
mod import;
mod overlay;

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand, ValueEnum};

use super::arguments::Common;
use super::failure::Failure;
use crate::rig::{BOARD_SIDES, Board, FreeDistortion};

/// Where the camera's numbers come from.
#[derive(Debug, Subcommand)]
pub(super) enum Camera {
    /// Focal lengths, principal point and distortion from photographs of a chessboard.
    ///
    /// Photograph a flat board ten times or more with the lens and focus of the capture: tilted by 20° to 45°
    /// in different directions, also near the image's edges. Writes a [camera] section, the position left
    /// open, and prints how well every photograph agrees.
    Calibrate(Calibrate),
    /// Cameras from OpenCV (YAML, JSON, XML), COLMAP (text, binary), or NeRF's and nerfstudio's transforms.json.
    ///
    /// Writes [camera] and, where the file has poses, [turntable] and [[frames]]: in such files the camera goes
    /// round an object that lies still; turnlight turns the object before a camera that stands still. The first
    /// frame has angle 0.
    Import(Import),
}

#[derive(Args, Debug)]
pub(super) struct Calibrate {
    /// Photographs, or folders of them.
    #[arg(required_unless_present = "corners", requires = "board")]
    photographs: Vec<PathBuf>,
    /// Inner corners of the board, where four squares meet, such as 9x6.
    #[arg(long, value_parser = board, value_name = "COLUMNSxROWS")]
    board: Option<Board>,
    /// Corners found by another program instead of photographs: JSON with "width", "height",
    /// "first_pixel_centre" (0 from OpenCV, else 0.5) and "photographs", a list of "name" and "corners", which
    /// are lists [column, row, x, y] of the corner on the board (squares) and in the photograph (pixels).
    #[arg(long, conflicts_with_all = ["photographs", "board"], value_name = "FILE.json")]
    corners: Option<PathBuf>,
    /// Coefficients of distortion to find, the others being 0: k1, k2, p1, p2, k3 with commas, or none.
    #[arg(long, default_value = "k1,k2,p1,p2,k3", value_parser = distortion, value_name = "LIST")]
    distortion: Distortion,
    /// TOML file to write.
    #[arg(long, default_value = "camera.toml")]
    out: PathBuf,
    /// Also write lens, standard deviations, and every photograph's errors and board pose (squares; camera axes
    /// right, down, forward) to this file.
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Also write the corners found, in the form that --corners reads.
    #[arg(long, value_name = "FILE.json")]
    write_corners: Option<PathBuf>,
}

#[derive(Args, Debug)]
pub(super) struct Import {
    /// The file, or COLMAP's folder (also its parent with sparse/0).
    source: PathBuf,
    /// TOML file to write.
    #[arg(long, default_value = "camera.toml")]
    out: PathBuf,
    /// Leave poses aside.
    #[arg(long)]
    lens_only: bool,
    /// Folder of COLMAP's images; SOURCE/images or SOURCE unless given.
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
    /// Draw the edges of this mesh, which stands in the file's coordinates, over the first image, to see whether
    /// they agree.
    #[arg(
        long,
        requires = "overlay",
        conflicts_with = "lens_only",
        value_name = "FILE"
    )]
    mesh: Option<PathBuf>,
    /// PNG to draw on.
    #[arg(long, requires = "mesh", value_name = "FILE.png")]
    overlay: Option<PathBuf>,
    /// Which way is up in the file's world, to become turnlight's +Y: an axis, or the turntable's own.
    /// z for transforms.json, else y, unless given.
    #[arg(long, value_enum)]
    up: Option<Up>,
    /// Take only this camera of COLMAP's.
    #[arg(long, value_name = "ID")]
    camera: Option<u32>,
    /// Columns and rows of the images, where the file does not tell.
    #[arg(long, value_parser = size, value_name = "WIDTHxHEIGHT")]
    size: Option<(usize, usize)>,
    /// Names of camera matrix and distortion in an OpenCV file, such as M1,D1.
    #[arg(long, value_parser = keys, value_name = "MATRIX,DISTORTION")]
    keys: Option<(String, String)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Up {
    X,
    Y,
    Z,
    #[value(name = "-x")]
    MinusX,
    #[value(name = "-y")]
    MinusY,
    #[value(name = "-z")]
    MinusZ,
    Axis,
}

#[derive(Clone, Copy, Debug)]
struct Distortion(FreeDistortion);

/// The names of a lens' coefficients, in turnlight's order.
const COEFFICIENTS: [&str; 5] = ["k1", "k2", "p1", "p2", "k3"];

pub(super) fn run(command: &Camera, common: &Common) -> Result<(), Failure> {
    match command {
        Camera::Calibrate(arguments) => calibrate::run(arguments, common),
        Camera::Import(arguments) => import::run(arguments, common),
    }
}

/// The folder that a file stands in; a bare name stands in the current one.
fn folder_of(file: &Path) -> &Path {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

fn pair(text: &str) -> Option<(usize, usize)> {
    let (one, other) = text.split_once('x')?;
    Some((one.parse().ok()?, other.parse().ok()?))
}

fn board(text: &str) -> Result<Board, String> {
    pair(text)
        .and_then(|(one, other)| Board::new(one, other))
        .ok_or_else(|| {
            let (least, most) = (BOARD_SIDES.start(), BOARD_SIDES.end());
            format!("must be COLUMNSxROWS, each {least} to {most} inner corners, such as 9x6")
        })
}

fn size(text: &str) -> Result<(usize, usize), String> {
    pair(text)
        .filter(|(w, h)| (1..=65536).contains(w) && (1..=65536).contains(h))
        .ok_or_else(|| "must be WIDTHxHEIGHT in pixels, such as 4000x3000".to_owned())
}

fn keys(text: &str) -> Result<(String, String), String> {
    match text.split_once(',') {
        Some((matrix, distortion)) if !matrix.is_empty() && !distortion.is_empty() => {
            Ok((matrix.to_owned(), distortion.to_owned()))
        }
        _ => Err("must be two names with a comma, such as M1,D1".to_owned()),
    }
}

fn distortion(text: &str) -> Result<Distortion, String> {
    let mut free = [false; 5];
    if text != "none" {
        for word in text.split(',') {
            let place = COEFFICIENTS.iter().position(|name| *name == word);
            free[place
                .ok_or_else(|| format!("must be none, or some of {}", COEFFICIENTS.join(",")))?] =
                true;
        }
    }
    Ok(Distortion(free))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_refused() {
        assert!(board("9x6").is_ok() && board("6x9").is_ok());
        assert!(board("9").is_err() && board("2x9").is_err() && board("9x6x1").is_err());
        assert!(size("0x5").is_err() && size("640x480") == Ok((640, 480)));
        assert!(keys("M1").is_err() && keys("M1,D1").is_ok());
        assert_eq!(
            distortion("k1,k3").unwrap().0,
            [true, false, false, false, true]
        );
        assert_eq!(distortion("none").unwrap().0, [false; 5]);
        assert!(distortion("k4").is_err() && distortion("").is_err());
    }
}
