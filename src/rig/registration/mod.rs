//! Registration: object and turntable, found from outlines.
//!
//! ```text
//! min Σ_t Σ_i ρ( n_i · (q_i − p_i) / s ),   p_i = π( c + R(a, θ_t) (M X_i − c) )
//! ```
//!
//! over the object's pose `M`, the turntable's axis `a` and centre `c` and, if asked, the angles `θ_t`. In
//! every frame, `X_i` are points of the mesh's outline, `p_i` their pixels, `n_i` the outline's normal in
//! the image, and `q_i` the object's border in the photograph along that normal. Sliding of `X_i` along the
//! surface as the object turns is along the outline, and so does not count to first order. Matches and
//! Gauss–Newton steps alternate, from reduced images to full ones; ρ is Student's (see `equations`).
//!
//! # What cannot be known, and is held
//!
//! One rigid motion of camera, object and turntable together changes no image, nor does a scaling of all
//! three about the camera; a shift of the centre along the axis and, where angles are refined, a common
//! change of all are turns of nothing. So these stay as given: the camera's pose and lens, the object's
//! scale, the centre's place along the axis, and the first frame's angle. What else the outlines do not
//! determine, such as the turn of a sphere, is refused by name or kept as given, with a standard deviation
//! of infinity.

mod agreement;
mod border;
mod bounds;
mod contour;
mod equations;
#[cfg(test)]
mod laws;
mod pnp;
mod pose;
mod sigmas;
mod solve;

use glam::{DMat3, DQuat, DVec2, DVec3};
use serde::Serialize;

use super::Camera;
use crate::geometry::{Similarity, Turn};

pub use border::{MaskBorder, Observed};
pub use pnp::{Clicked, PairsPose, PnpError, pose_from_pairs};
pub use pose::Placement;
pub use sigmas::Sigmas;
pub use solve::register;

/// What is refined, and from what.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// Refine the turntable's axis and centre, too.
    pub turntable: bool,
    /// Refine the angle of every frame but the first.
    pub angles: bool,
    /// Use the photographs' edges where the object stands before itself.
    pub inner: bool,
    /// How far off the outlines may be at the start, pixels; a fifth of the object's extent unless given.
    pub search: Option<f64>,
    /// Keep what the frames do not determine as it was given, instead of refusing it.
    pub keep_unknown: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            turntable: true,
            angles: false,
            inner: false,
            search: None,
            keep_unknown: false,
        }
    }
}

/// How a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stop {
    /// A step moved the outlines by less than a thousandth of a pixel.
    Converged,
    /// The matches went on changing.
    IterationLimit,
}

/// A point of the outline at the end.
#[derive(Clone, Copy, Debug)]
pub struct OutlinePoint {
    /// Pixel coordinates.
    pub pixel: DVec2,
    /// Pixel coordinates of the border matched with it; `None` if none is near.
    pub seen: Option<DVec2>,
}

/// How one frame agrees with the result.
#[derive(Clone, Debug, Serialize)]
pub struct FrameAgreement {
    /// Root mean square distance of the outline from its borders, pixels; NaN without any.
    pub rms: f64,
    /// Share of the outline within a pixel of a border.
    pub near: f64,
    /// Pixels covered by both mask and mesh over those covered by either; `None` without a mask.
    pub overlap: Option<f64>,
    /// Angle of the object, radians.
    pub angle: f64,
    /// Change of this angle alone that would suit the frame best, radians; `None` if the outline does not
    /// show it.
    pub angle_offset: Option<f64>,
    /// Its standard deviation, radians.
    pub angle_sigma: Option<f64>,
    /// In what the frame disagrees with the others; empty for a good one.
    pub disagrees: Vec<String>,
    /// The outline.
    #[serde(skip)]
    pub outline: Vec<OutlinePoint>,
}

/// The same images with the turntable's axis and centre as `given`: one motion of camera, object and
/// turntable together brings the axis back by the shortest turn.
pub fn with_turntable_held(
    camera: &Camera,
    found: &Placement,
    given: &Turn,
) -> (Camera, Placement) {
    let rotation = DQuat::from_rotation_arc(found.turn.axis, given.axis);
    let moved = |point: DVec3| given.center + rotation * (point - found.turn.center);
    let camera = Camera {
        position: moved(camera.position),
        world_from_camera: DMat3::from_quat(rotation) * camera.world_from_camera,
        ..*camera
    };
    let pose = &found.object_from_file;
    let placement = Placement {
        object_from_file: Similarity {
            scale: pose.scale,
            rotation: (rotation * pose.rotation).normalize(),
            translation: moved(pose.translation),
        },
        turn: *given,
        angles: found.angles.clone(),
    };
    (camera, placement)
}

/// A registered capture.
#[derive(Clone, Debug)]
pub struct Registered {
    /// Where object and turntable are.
    pub placement: Placement,
    /// Radius of the object, scene units.
    pub size: f64,
    /// How well that is known.
    pub sigma: Sigmas,
    /// Robust standard deviation of the outline's distances, pixels.
    pub scale: f64,
    /// Steps taken.
    pub rounds: usize,
    /// How the search ended.
    pub stop: Stop,
    /// What the frames do not determine, in words; kept as given.
    pub unknown: Vec<String>,
    /// `[frames]` how each agrees.
    pub frames: Vec<FrameAgreement>,
}

/// Why a capture could not be registered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RegistrationError {
    /// The mesh is seen in no frame.
    #[error(
        "at the given pose the camera sees nothing of the object; correct [object] and [camera], or give \
         pairs of points and pixels"
    )]
    OutOfView,
    /// The outlines are far from every border.
    #[error(
        "only {found:.0} % of the outline finds a border of the object within {reach:.0} pixels; start \
         nearer (pairs of points and pixels), or search farther"
    )]
    NoBorder {
        /// Share of the outline that finds one, per cent.
        found: f64,
        /// How far was searched, pixels.
        reach: f64,
    },
    /// The frames leave something open.
    #[error("the outlines do not change by {}", unknown.join(", nor by "))]
    Undetermined {
        /// In words.
        unknown: Vec<String>,
    },
}
