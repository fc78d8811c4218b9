//! Rigid motions: the object's pose on the table and the table's turn.

use glam::{DAffine3, DQuat, DVec3};

/// Scale, then rotation, then translation: how mesh coordinates become object coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Uniform factor, > 0.
    pub scale: f64,
    /// Unit quaternion.
    pub rotation: DQuat,
    /// In scene units.
    pub translation: DVec3,
}

impl Default for Similarity {
    fn default() -> Self {
        Self {
            scale: 1.0,
            rotation: DQuat::IDENTITY,
            translation: DVec3::ZERO,
        }
    }
}

impl Similarity {
    /// The transform as an affine map.
    pub fn affine(&self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(
            DVec3::splat(self.scale),
            self.rotation,
            self.translation,
        )
    }
}

/// The turntable: a rotation axis (unit) through a centre, in the world frame.
///
/// At angle 0 the world frame and the object frame coincide; a positive angle turns the object
/// right-handed about the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Unit axis.
    pub axis: DVec3,
    /// A point on the axis.
    pub center: DVec3,
}

impl Turn {
    /// The rigid motion of the object at `angle` (radians).
    pub fn world_from_object(&self, angle: f64) -> DAffine3 {
        let rotation = DQuat::from_axis_angle(self.axis, angle);
        DAffine3::from_rotation_translation(rotation, self.center - rotation * self.center)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positive_angle_turns_right_handed_about_the_axis() {
        let turn = Turn {
            axis: DVec3::Y,
            center: DVec3::ZERO,
        };
        let x = turn
            .world_from_object(std::f64::consts::FRAC_PI_2)
            .transform_point3(DVec3::Z);
        assert!((x - DVec3::X).length() < 1e-12);
    }

    #[test]
    fn the_centre_stays() {
        let turn = Turn {
            axis: DVec3::new(0.6, 0.8, 0.0),
            center: DVec3::new(1.0, 2.0, 3.0),
        };
        let moved = turn.world_from_object(1.234).transform_point3(turn.center);
        assert!((moved - turn.center).length() < 1e-12);
    }
}
