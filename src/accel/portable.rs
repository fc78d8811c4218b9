//! The two inner tests in plain Rust, lane by lane.
//!
//! The reference that `avx2` must equal bit by bit: same operations, same order, and `min` and `max`
//! that return their second argument when either is NaN, as the x86 instructions do.

use super::wide_tree::{Lanes, Node, Pack, WIDTH};
use super::woop::{FAR_SLACK, PackHits, PreparedRay, exact_edges};

#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Which children the ray enters before `t_max`, as a bit mask, and where it enters them.
#[inline(always)]
pub(super) fn enter_children(node: &Node, ray: &PreparedRay, t_max: f32) -> (u32, Lanes) {
    let mut near = [0.0; WIDTH];
    let mut far = [t_max; WIDTH];
    for axis in 0..3 {
        let side = ray.entry_side[axis] & 1;
        let (entry, exit) = (&node.bounds[axis][side], &node.bounds[axis][side ^ 1]);
        for lane in 0..WIDTH {
            // A ray within a face has 0 · ∞ = NaN here, which leaves `near` and `far` as they are.
            near[lane] = max(
                (entry[lane] - ray.origin[axis]) * ray.inverse[axis],
                near[lane],
            );
            far[lane] = min(
                (exit[lane] - ray.origin[axis]) * ray.inverse[axis],
                far[lane],
            );
        }
    }
    let mut mask = 0;
    for lane in 0..WIDTH {
        mask |= u32::from(near[lane] <= far[lane] * FAR_SLACK) << lane;
    }
    (mask, near)
}

/// Where the ray meets the triangles of a pack at `0 < t <= t_max`.
#[inline(always)]
pub(super) fn hit_pack(pack: &Pack, ray: &PreparedRay, t_max: f32) -> Option<PackHits> {
    let [x, y, z] = ray.axes;
    let zero = [0.0; WIDTH];
    let mut hits = PackHits {
        mask: 0,
        t: zero,
        v: zero,
        w: zero,
        determinant: zero,
    };
    for lane in 0..WIDTH {
        // 1. Translate to the origin and shear, so that the ray is the z axis.
        let sheared = |vertex: usize| {
            let depth = pack.vertices[z][vertex][lane] - ray.origin[z];
            [
                (pack.vertices[x][vertex][lane] - ray.origin[x]) - ray.shear[0] * depth,
                (pack.vertices[y][vertex][lane] - ray.origin[y]) - ray.shear[1] * depth,
                depth,
            ]
        };
        let [a, b, c] = [sheared(0), sheared(1), sheared(2)];

        // 2. The origin is inside if the edge functions have one sign.
        let mut edges = [
            c[0] * b[1] - c[1] * b[0],
            a[0] * c[1] - a[1] * c[0],
            b[0] * a[1] - b[1] * a[0],
        ];
        let least = min(edges[0], min(edges[1], edges[2]));
        let greatest = max(edges[0], max(edges[1], edges[2]));
        let inside = least >= 0.0 || greatest <= 0.0;
        if !inside {
            continue;
        }

        // 3. Zero may be a rounded sign: decide it exactly.
        if least == 0.0 || greatest == 0.0 {
            edges = exact_edges(pack, ray, lane);
            let least = min(edges[0], min(edges[1], edges[2]));
            let greatest = max(edges[0], max(edges[1], edges[2]));
            let inside = least >= 0.0 || greatest <= 0.0;
            if !inside {
                continue;
            }
        }

        // 4. Distance.
        let [u, v, w] = edges;
        let determinant = (u + v) + w;
        let t = ray.shear[2] * ((u * a[2] + v * b[2]) + w * c[2]) / determinant;
        if determinant != 0.0 && t > 0.0 && t <= t_max {
            hits.mask |= 1 << lane;
            hits.t[lane] = t;
            hits.v[lane] = v;
            hits.w[lane] = w;
            hits.determinant[lane] = determinant;
        }
    }
    (hits.mask != 0).then_some(hits)
}
