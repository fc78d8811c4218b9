//! The shading frame: an orthonormal basis whose third axis is the surface normal.

use glam::Vec3;

/// A direction in a shading frame, whose z axis is the surface normal.
///
/// A type of its own, so that a local direction never passes for one in the object or world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Local(pub Vec3);

impl Local {
    /// Cosine of the angle to the normal.
    #[inline]
    pub fn cos_theta(self) -> f32 {
        self.0.z
    }

    /// The direction mirrored about the normal.
    #[inline]
    pub fn mirrored(self) -> Self {
        Self(Vec3::new(-self.0.x, -self.0.y, self.0.z))
    }
}

/// An orthonormal basis `(tangent, bitangent, normal)` about a unit normal.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// First axis.
    pub tangent: Vec3,
    /// Second axis.
    pub bitangent: Vec3,
    /// Third axis, the surface normal.
    pub normal: Vec3,
}

impl Frame {
    /// A frame about `normal` (unit length), without branches or a singular direction
    /// (Duff et al. 2017, *Building an Orthonormal Basis, Revisited*, Listing 3).
    #[inline]
    pub fn about(normal: Vec3) -> Self {
        let sign = 1.0_f32.copysign(normal.z);
        let a = -1.0 / (sign + normal.z);
        let b = normal.x * normal.y * a;
        Self {
            tangent: Vec3::new(
                1.0 + sign * normal.x * normal.x * a,
                sign * b,
                -sign * normal.x,
            ),
            bitangent: Vec3::new(b, sign + normal.y * normal.y * a, -normal.y),
            normal,
        }
    }

    /// Into the frame: from the frame's surroundings (object or world) to local coordinates.
    #[inline]
    pub fn to_local(&self, direction: Vec3) -> Local {
        Local(Vec3::new(
            direction.dot(self.tangent),
            direction.dot(self.bitangent),
            direction.dot(self.normal),
        ))
    }

    /// Out of the frame, the inverse of [`Frame::to_local`].
    #[inline]
    pub fn from_local(&self, local: Local) -> Vec3 {
        self.tangent * local.0.x + self.bitangent * local.0.y + self.normal * local.0.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn frame_is_orthonormal_and_right_handed(x in -1.0f32..1.0, y in -1.0f32..1.0, z in -1.0f32..1.0) {
            let v = Vec3::new(x, y, z);
            prop_assume!(v.length() > 1e-3);
            let f = Frame::about(v.normalize());
            prop_assert!((f.tangent.cross(f.bitangent) - f.normal).length() < 1e-5);
            prop_assert!((f.tangent.length() - 1.0).abs() < 1e-5);
            prop_assert!(f.tangent.dot(f.normal).abs() < 1e-5);
        }

        #[test]
        fn to_local_inverts_from_local(x in -1.0f32..1.0, y in -1.0f32..1.0, z in -1.0f32..1.0) {
            let v = Vec3::new(x, y, z);
            prop_assume!(v.length() > 1e-3);
            let f = Frame::about(v.normalize());
            let w = Vec3::new(y, -z, x);
            prop_assert!((f.from_local(f.to_local(w)) - w).length() < 1e-5);
        }
    }
}
