//! Standard deviations in words and numbers that a user knows.

use glam::DVec3;
use serde::Serialize;

use super::equations::Matrix;
use super::pose::{Pose, Step};

/// Standard deviations of what was refined, world frame, the camera held. Infinite where the frames do not
/// tell; 0 where it was held.
#[derive(Clone, Copy, Debug, Serialize, PartialEq)]
pub struct Sigmas {
    /// Turn of the object about the world's axes through its middle, radians.
    pub rotation: [f64; 3],
    /// Place of the object's middle, scene units.
    pub translation: [f64; 3],
    /// That middle, world frame at angle 0.
    pub middle: [f64; 3],
    /// Tilt of the axis about the two directions `across`, radians.
    pub axis: [f64; 2],
    /// Place of the axis nearest to the object, along the same directions, scene units.
    pub center: [f64; 2],
    /// Two unit vectors perpendicular to the axis, world frame.
    pub across: [[f64; 3]; 2],
}

/// The standard deviations by a covariance of the unknowns.
pub(super) fn sigmas(covariance: &Matrix, unknown: &[Step], free: &[usize], pose: &Pose) -> Sigmas {
    // A hundredth of an undetermined direction leaves nothing of what the rest says.
    let sigma = |i: usize| {
        if !free.contains(&i) {
            0.0
        } else if unknown.iter().any(|direction| direction[i].abs() > 0.01) {
            f64::INFINITY
        } else {
            covariance[i][i].max(0.0).sqrt()
        }
    };
    let size = pose.size;
    Sigmas {
        rotation: [0, 1, 2].map(sigma),
        translation: [3, 4, 5].map(|i| size * sigma(i)),
        middle: pose.middle().to_array(),
        axis: [6, 7].map(sigma),
        center: [8, 9].map(|i| size * sigma(i)),
        across: pose.across().map(|u| u.to_array()),
    }
}

/// A direction of the unknowns in words: its largest part, and what moves with it.
pub(super) fn describe(direction: &Step, pose: &Pose) -> String {
    let [wx, wy, wz, sx, sy, sz, tilt_u, tilt_v, shift_u, shift_v] = *direction;
    let [u, v] = pose.across();
    let mut parts = [
        ("turning the object about", DVec3::new(wx, wy, wz)),
        ("shifting the object along", DVec3::new(sx, sy, sz)),
        (
            "tilting the turntable's axis about",
            tilt_u * u + tilt_v * v,
        ),
        (
            "shifting the turntable's axis along",
            shift_u * u + shift_v * v,
        ),
    ];
    parts.sort_by(|a, b| b.1.length().total_cmp(&a.1.length()));
    let words: Vec<String> = parts
        .iter()
        .filter(|(_, vector)| vector.length() > 0.3)
        .map(|(what, vector)| {
            // Of the two opposite directions, the one whose largest component is positive.
            let [x, y, z] = vector.normalize().to_array();
            let largest = [x, y, z]
                .into_iter()
                .fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
            let [x, y, z] = [x, y, z].map(|c| (100.0 * c * largest.signum()).round() / 100.0 + 0.0);
            format!("{what} [{x}, {y}, {z}]")
        })
        .collect();
    words.join(" while ")
}
