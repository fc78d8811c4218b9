//! The forward renderer: a path tracer over turntable poses.

mod centres;
mod corners;
mod direction_map;
mod expected_lobe;
mod frame;
mod frame_light;
mod guide;
mod halfspace;
mod integrator;
#[cfg(test)]
mod laws;
mod lobe_block;
mod lobe_table;
mod lune;
mod patches;
mod sensor;
mod sequence;
mod skips;
mod stage;
mod stats;
mod target_error;
mod weights;

pub use centres::pixel_centres;
pub use frame::{FrameSettings, PathCount, RenderedFrame, render_frame};
pub use sensor::expose;
pub use sequence::{RenderError, SequenceSettings, render_sequence};
pub use skips::{Skip, Skips};
pub use stage::Stage;
pub use stats::RenderStats;
