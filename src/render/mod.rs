//! The forward renderer: a path tracer over turntable poses.

mod frame;
mod guide;
mod halfspace;
mod integrator;
#[cfg(test)]
mod laws;
mod patches;
mod sensor;
mod sequence;
mod stage;
mod stats;

pub use frame::{FrameSettings, RenderedFrame, render_frame};
pub use sensor::expose;
pub use sequence::{RenderError, SequenceSettings, render_sequence};
pub use stage::Stage;
pub use stats::RenderStats;
