//! The measuring rig: camera models and the turntable's poses.

mod camera;
mod view;

pub use camera::{Camera, CameraError, Distortion, Intrinsics};
pub use view::View;
