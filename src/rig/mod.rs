//! The measuring rig: camera models and the turntable's poses.

mod camera;

pub use camera::{Camera, CameraError, Distortion, Intrinsics};
