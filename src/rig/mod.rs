//! The measuring rig: camera models, their calibration and import, and the turntable's poses.
//! The measuring rig: camera models, the turntable's poses, and where object and turntable stand.

mod arrow;
mod calibration;
mod camera;
mod chessboard;
mod corner_file;
mod import;
mod lens;
mod orbit;
pub mod registration;
mod view;

pub use calibration::{
    BoardView, Calibration, CalibrationError, Corner, FEWEST_CORNERS, FEWEST_PHOTOGRAPHS,
    FreeDistortion, PhotographFit, Stop, calibrate,
};
pub use camera::{Camera, CameraError, Distortion, Intrinsics};
pub use chessboard::{BOARD_SIDES, Board, BoardError};
pub use corner_file::{CornerFile, CornerFileError};
pub use import::{ImportChoices, ImportError, ImportProblem, Imported, Shot, import};
pub use lens::Lens;
pub use orbit::{Orbit, OrbitError, OrbitErrors, fit_orbit};
pub use view::View;
