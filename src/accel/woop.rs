//! The ray, prepared for watertight intersection (Woop, Benthin and Wald 2013, *Watertight
//! Ray/Triangle Intersection*, JCGT 2(1)).
//!
//! Vertices are moved to the ray's origin and sheared so that the ray runs along +z; then the ray
//! meets a triangle where its three edge functions
//!
//! ```text
//! U = Cx By − Cy Bx,   V = Ax Cy − Ay Cx,   W = Bx Ay − By Ax
//! ```
//!
//! have one sign. Two triangles that share an edge compute the same number for it but for its sign,
//! so a ray never slips between them. This holds only while each product is rounded by itself: a
//! fused multiply-add would round one product and not the other. Where an edge function is exactly
//! zero, its sign is decided in double precision, in which the products are exact.

use super::wide_tree::{Lanes, Pack};
use crate::geometry::Ray;

/// How much later than computed a ray may leave a box, relative to the distance.
///
/// Ize 2013 (*Robust BVH Ray Traversal*, JCGT 2(2)) derives `1 + 2 γ(3)`, γ(n) = n ε / (1 − n ε),
/// ε = 2⁻²⁴, for a box test whose inputs are exact. Here the hits that must not be lost are the
/// rounded ones of the sheared triangle: its subtraction, slope and product add four more roundings.
/// The boxes themselves are padded for the part of that error which does not shrink with the
/// distance (see `build`).
pub(super) const FAR_SLACK: f32 = 1.0 + 14.0 / (1 << 24) as f32;

/// A ray with everything that is computed once and used at each node or triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct PreparedRay {
    pub(super) origin: [f32; 3],
    /// Reciprocal direction; ±∞ where a component is zero.
    pub(super) inverse: [f32; 3],
    /// `[axis]` which side of a box the ray enters by: 0 lower, 1 upper.
    pub(super) entry_side: [usize; 3],
    /// The two minor axes and the one along which the direction is greatest.
    pub(super) axes: [usize; 3],
    /// Slopes of the direction on the minor axes, and the reciprocal of its greatest component.
    pub(super) shear: [f32; 3],
}

impl PreparedRay {
    /// `None` if the ray can't hit anything: a component is NaN or infinite, or no direction.
    #[inline]
    pub(super) fn new(ray: &Ray) -> Option<Self> {
        let direction = ray.direction;
        let magnitude = direction.abs();
        let z = if magnitude.x > magnitude.y {
            if magnitude.x > magnitude.z { 0 } else { 2 }
        } else if magnitude.y > magnitude.z {
            1
        } else {
            2
        };
        let usable = ray.origin.is_finite() && direction.is_finite() && magnitude[z] > 0.0;
        if !usable {
            return None;
        }
        let (x, y) = ((z + 1) % 3, (z + 2) % 3);
        let shear = [
            direction[x] / direction[z],
            direction[y] / direction[z],
            1.0 / direction[z],
        ];
        Some(Self {
            origin: ray.origin.to_array(),
            inverse: direction.recip().to_array(),
            entry_side: direction
                .to_array()
                .map(|d| usize::from(d.is_sign_negative())),
            axes: [x, y, z],
            shear,
        })
    }
}

/// Where a ray meets the triangles of a pack. Lanes outside `mask` are meaningless.
#[derive(Clone, Copy, Debug)]
pub(super) struct PackHits {
    /// Bit `i` is set if triangle `i` is hit within the range asked for; not 0.
    pub(super) mask: u32,
    /// Distance, in units of the ray's direction.
    pub(super) t: Lanes,
    /// Edge functions of vertices 1 and 2: barycentric coordinates times `determinant`.
    pub(super) v: Lanes,
    pub(super) w: Lanes,
    /// `U + V + W`, not zero.
    pub(super) determinant: Lanes,
}

/// Edge functions `[U, V, W]` of one triangle of a pack, the products exact.
///
/// The sheared coordinates are those of single precision, so that both neighbours of an edge see
/// the same ones.
#[cold]
#[inline(never)]
pub(super) fn exact_edges(pack: &Pack, ray: &PreparedRay, lane: usize) -> [f32; 3] {
    let [x, y, z] = ray.axes;
    let sheared = |vertex: usize| {
        let from_origin = |axis: usize| pack.vertices[axis][vertex][lane] - ray.origin[axis];
        let depth = from_origin(z);
        [
            f64::from(from_origin(x) - ray.shear[0] * depth),
            f64::from(from_origin(y) - ray.shear[1] * depth),
        ]
    };
    let [a, b, c] = [sheared(0), sheared(1), sheared(2)];
    [
        (c[0] * b[1] - c[1] * b[0]) as f32,
        (a[0] * c[1] - a[1] * c[0]) as f32,
        (b[0] * a[1] - b[1] * a[0]) as f32,
    ]
}
