//! `scene.toml` and `capture.toml`, checked: what to render, and what was photographed.

mod plan;

pub use plan::{
    Capture, CaptureFrame, MapSource, MaterialSource, ObjectSource, ProbeSource, Scene, Sensor,
    SpecularSource,
};
