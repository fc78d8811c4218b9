//! Where object and turntable stand, and how the image moves with them.
//!
//! ```text
//! Y_t = c + R(a, θ_t) (X − c),   X = M · object_from_mesh · x
//! ```
//!
//! A vertex `x` of the mesh is placed at `X` in the world at angle 0 by the motion `M` (what is sought of
//! the object's pose), then turned by `θ_t` about the axis `a` through the centre `c`. A small step of the
//! unknowns turns the object by ω about its middle `m` and shifts it by `s`, tilts the axis by β and
//! shifts the centre by γ (both perpendicular to the axis), and changes the angle by δ_t:
//!
//! ```text
//! dY = R (ω × (X − m) + s) + β × R(X − c) − R (β × (X − c)) + (1 − R) γ + δ a × (Y − c)
//! ```

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::geometry::{Similarity, Turn};
use crate::rig::{Camera, View};

/// Unknowns common to all frames: ω (3), s (3), β (2), γ (2).
pub(super) const UNKNOWNS: usize = 10;

/// One number for each common unknown; turns in radians, shifts in object sizes.
pub(super) type Step = [f64; UNKNOWNS];

/// The object's pose and the turntable.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    /// Object frame from mesh file, at angle 0.
    pub object_from_file: Similarity,
    /// Axis and centre, world frame.
    pub turn: Turn,
    /// `[frames]` radians.
    pub angles: Vec<f64>,
}

/// A placement on the way to the best one.
#[derive(Clone, Debug)]
pub(super) struct Pose {
    /// `M`: rotation, then translation, world frame.
    rotation: DQuat,
    translation: DVec3,
    turn: Turn,
    pub(super) angles: Vec<f64>,
    /// The mesh where the search began, world frame at angle 0.
    object_from_mesh: DAffine3,
    /// Radius of the object, scene units: the unit of shifts.
    pub(super) size: f64,
}

impl Pose {
    /// The placement as given, of a mesh loaded under it.
    pub(super) fn new(placement: &Placement, object_from_mesh: DAffine3, size: f64) -> Self {
        let mut pose = Self {
            rotation: DQuat::IDENTITY,
            translation: DVec3::ZERO,
            turn: placement.turn,
            angles: placement.angles.clone(),
            object_from_mesh,
            size,
        };
        pose.bring_center_near();
        pose
    }

    /// The same as a placement. The centre's place along the axis, which nothing determines, is that of
    /// `given`.
    pub(super) fn placement(&self, given: &Placement) -> Placement {
        let start = &given.object_from_file;
        let along = (given.turn.center - self.turn.center).dot(self.turn.axis);
        Placement {
            object_from_file: Similarity {
                scale: start.scale,
                rotation: (self.rotation * start.rotation).normalize(),
                translation: self.rotation * start.translation + self.translation,
            },
            turn: Turn {
                axis: self.turn.axis,
                center: self.turn.center + along * self.turn.axis,
            },
            angles: self.angles.clone(),
        }
    }

    /// World at angle 0 from mesh.
    pub(super) fn placed_from_mesh(&self) -> DAffine3 {
        DAffine3::from_rotation_translation(self.rotation, self.translation) * self.object_from_mesh
    }

    /// What the camera sees of the mesh in a frame.
    pub(super) fn view(&self, camera: &Camera, frame: usize) -> View {
        View::new(
            camera,
            &self.turn,
            self.angles[frame],
            self.placed_from_mesh(),
        )
    }

    /// Everything that the derivatives of one frame need.
    pub(super) fn slopes(&self, frame: usize) -> Slopes {
        Slopes {
            turned: DMat3::from_quat(DQuat::from_axis_angle(self.turn.axis, self.angles[frame])),
            middle: self.middle(),
            turn: self.turn,
            across: across(self.turn.axis),
            size: self.size,
        }
    }

    /// The object's middle, world frame at angle 0.
    pub(super) fn middle(&self) -> DVec3 {
        self.placed_from_mesh().translation
    }

    /// The pose after a step, and after a change of each frame's angle.
    pub(super) fn stepped(&self, step: &Step, angles: &[f64]) -> Self {
        let [wx, wy, wz, sx, sy, sz, tilt_u, tilt_v, shift_u, shift_v] = *step;
        let mut next = self.clone();

        // Turn the object about its middle, then shift it.
        let turn = DQuat::from_scaled_axis(DVec3::new(wx, wy, wz));
        let (middle, shift) = (self.middle(), self.size * DVec3::new(sx, sy, sz));
        next.rotation = (turn * self.rotation).normalize();
        next.translation = middle + turn * (self.translation - middle) + shift;

        // Tilt the axis about its centre, then shift that.
        let [u, v] = across(self.turn.axis);
        let tilt = DQuat::from_scaled_axis(tilt_u * u + tilt_v * v);
        next.turn.axis = (tilt * self.turn.axis).normalize();
        next.turn.center += self.size * (shift_u * u + shift_v * v);
        for (angle, change) in next.angles.iter_mut().zip(angles) {
            *angle += change;
        }
        next.bring_center_near();
        next
    }

    /// Moves the centre along the axis to where the object is, so that a tilt moves the object least.
    fn bring_center_near(&mut self) {
        let along = (self.middle() - self.turn.center).dot(self.turn.axis);
        self.turn.center += along * self.turn.axis;
    }

    /// The world axes along which the tilt and the shift of the turntable's axis are given.
    pub(super) fn across(&self) -> [DVec3; 2] {
        across(self.turn.axis)
    }
}

/// Two unit vectors perpendicular to an axis and each other.
fn across(axis: DVec3) -> [DVec3; 2] {
    let (u, v) = axis.any_orthonormal_pair();
    [u, v]
}

/// How a point of one frame moves with the unknowns.
pub(super) struct Slopes {
    /// `R(a, θ_t)`.
    turned: DMat3,
    middle: DVec3,
    turn: Turn,
    across: [DVec3; 2],
    size: f64,
}

impl Slopes {
    /// Where the point placed at `placed` (world frame at angle 0) is in this frame.
    pub(super) fn world(&self, placed: DVec3) -> DVec3 {
        self.turn.center + self.turned * (placed - self.turn.center)
    }

    /// A direction of the world at angle 0, in this frame.
    pub(super) fn turned(&self, direction: DVec3) -> DVec3 {
        self.turned * direction
    }

    /// The derivatives by the common unknowns, and by the frame's angle, of `gradient · Y`.
    pub(super) fn along(&self, placed: DVec3, gradient: DVec3) -> (Step, f64) {
        // gradient · (R q) = back · q.
        let back = self.turned.transpose() * gradient;
        let arm = placed - self.middle;
        let of_turn = arm.cross(back);
        let spoke = placed - self.turn.center;
        let turned_spoke = self.turned * spoke;
        let of_tilt = turned_spoke.cross(gradient) - spoke.cross(back);
        let of_shift = gradient - back;
        let [u, v] = self.across;
        (
            [
                of_turn.x,
                of_turn.y,
                of_turn.z,
                self.size * back.x,
                self.size * back.y,
                self.size * back.z,
                u.dot(of_tilt),
                v.dot(of_tilt),
                self.size * u.dot(of_shift),
                self.size * v.dot(of_shift),
            ],
            gradient.dot(self.turn.axis.cross(turned_spoke)),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose(x: f64) -> Pose {
        let placement = Placement {
            object_from_file: Similarity::default(),
            turn: Turn {
                axis: DVec3::new(0.2, 1.0, -0.3).normalize(),
                center: DVec3::new(0.3, -2.0, 0.1 * x),
            },
            angles: vec![0.4, 1.7 + x],
        };
        let object_from_mesh = DAffine3::from_scale_rotation_translation(
            DVec3::splat(1.5),
            DQuat::IDENTITY,
            DVec3::new(0.1, 0.4, x),
        );
        Pose::new(&placement, object_from_mesh, 2.0)
    }

    proptest! {
        #[test]
        fn slopes_match_finite_differences(
            x in -1.0f64..1.0, y in -1.0f64..1.0, z in -1.0f64..1.0, gx in -1.0f64..1.0, unknown in 0..=UNKNOWNS,
        ) {
            let (pose, mesh) = (pose(x), DVec3::new(z, x, y));
            let gradient = DVec3::new(gx, y, 0.3);
            let at = |h: f64| {
                let (mut step, mut angles) = ([0.0; UNKNOWNS], [0.0; 2]);
                if unknown == UNKNOWNS { angles[1] = h } else { step[unknown] = h }
                let moved = pose.stepped(&step, &angles);
                let placed = moved.placed_from_mesh().transform_point3(mesh);
                gradient.dot(moved.slopes(1).world(placed))
            };
            let placed = pose.placed_from_mesh().transform_point3(mesh);
            let (common, angle) = pose.slopes(1).along(placed, gradient);
            let slope = if unknown == UNKNOWNS { angle } else { common[unknown] };
            let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
            prop_assert!((slope - difference).abs() < 1e-6, "{unknown}: {slope} {difference}");
        }
    }

    #[test]
    fn a_placement_moves_the_file_as_the_pose_moves_the_mesh() {
        let given = Placement {
            object_from_file: Similarity {
                scale: 1.5,
                rotation: DQuat::from_rotation_x(0.3),
                translation: DVec3::new(0.1, 0.4, -0.2),
            },
            turn: Turn {
                axis: DVec3::Y,
                center: DVec3::new(0.0, 7.0, 0.1),
            },
            angles: vec![0.0],
        };
        let pose = Pose::new(&given, given.object_from_file.affine(), 1.0);
        let step = [0.1, -0.2, 0.3, 0.5, 0.1, -0.4, 0.05, -0.1, 0.2, 0.1];
        let moved = pose.stepped(&step, &[0.2]);
        let after = moved.placement(&given);
        let point = DVec3::new(0.3, -0.6, 0.9);
        let direct = moved
            .slopes(0)
            .world(moved.placed_from_mesh().transform_point3(point));
        let through = after
            .turn
            .world_from_object(after.angles[0])
            .transform_point3(after.object_from_file.affine().transform_point3(point));
        assert!((direct - through).length() < 1e-12);
        // What nothing determines stays: scale, and the centre's place along the axis.
        assert_eq!(after.object_from_file.scale, 1.5);
        assert!(
            (after.turn.center - given.turn.center)
                .dot(after.turn.axis)
                .abs()
                < 1e-12
        );
    }
}
