//! Rays, and where a secondary ray may safely start.

use glam::Vec3;

/// A half-line; `direction` has unit length.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Start, in the frame of the geometry that is asked.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
}

impl Ray {
    /// The ray that leaves a surface at `position`, computed on a triangle of normal `side`, for
    /// `direction`, on whichever side of the triangle's plane that lies.
    #[inline]
    pub fn leaving(position: Vec3, side: Vec3, direction: Vec3) -> Self {
        let outwards = if side.dot(direction) < 0.0 {
            -side
        } else {
            side
        };
        Self {
            origin: offset_origin(position, outwards),
            direction,
        }
    }

    /// The point at distance `t`.
    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// Moves `point`, computed on a surface of normal `normal`, off that surface by a few units in the
/// last place, so that a ray leaving on the side of `normal` does not meet the surface again
/// (Wächter and Binder 2019, *A Fast and Robust Method for Avoiding Self-Intersection*, Ray Tracing
/// Gems, Ch. 6).
///
/// The offset is relative to each coordinate, and absolute near zero. The absolute part suits
/// coordinates of magnitude one, which is what [`crate::mesh::Mesh`] guarantees for a file of any
/// unit.
#[inline]
pub fn offset_origin(point: Vec3, normal: Vec3) -> Vec3 {
    const ORIGIN_ZONE: f32 = 1.0 / 32.0;
    const FLOAT_SCALE: f32 = 1.0 / 65536.0;
    const INT_SCALE: f32 = 256.0;
    let along = |p: f32, n: f32| {
        if p.abs() < ORIGIN_ZONE {
            p + FLOAT_SCALE * n
        } else {
            let step = (INT_SCALE * n) as i32;
            let bits = p.to_bits() as i32;
            f32::from_bits((if p < 0.0 { bits - step } else { bits + step }) as u32)
        }
    };
    Vec3::new(
        along(point.x, normal.x),
        along(point.y, normal.y),
        along(point.z, normal.z),
    )
}
