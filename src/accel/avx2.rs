//! The two inner tests with AVX2: all eight lanes at once, same operations as in `portable`.

use std::arch::x86_64::*;

use super::wide_tree::{Lanes, Node, Pack};
use super::woop::{FAR_SLACK, PackHits, PreparedRay, exact_edges};

#[inline]
#[target_feature(enable = "avx2")]
fn load(lanes: &Lanes) -> __m256 {
    bytemuck::cast(*lanes)
}

#[inline]
#[target_feature(enable = "avx2")]
fn store(lanes: __m256) -> Lanes {
    bytemuck::cast(lanes)
}

/// See [`super::portable::enter_children`].
#[inline]
#[target_feature(enable = "avx2")]
pub(super) fn enter_children(node: &Node, ray: &PreparedRay, t_max: f32) -> (u32, Lanes) {
    let mut near = _mm256_setzero_ps();
    let mut far = _mm256_set1_ps(t_max);
    for axis in 0..3 {
        let side = ray.entry_side[axis] & 1;
        let origin = _mm256_set1_ps(ray.origin[axis]);
        let inverse = _mm256_set1_ps(ray.inverse[axis]);
        let entry = _mm256_sub_ps(load(&node.bounds[axis][side]), origin);
        let exit = _mm256_sub_ps(load(&node.bounds[axis][side ^ 1]), origin);
        near = _mm256_max_ps(_mm256_mul_ps(entry, inverse), near);
        far = _mm256_min_ps(_mm256_mul_ps(exit, inverse), far);
    }
    let far = _mm256_mul_ps(far, _mm256_set1_ps(FAR_SLACK));
    let entered = _mm256_cmp_ps::<_CMP_LE_OQ>(near, far);
    (_mm256_movemask_ps(entered) as u32, store(near))
}

/// Lanes whose edge functions have one sign, and of these the lanes that contain a zero.
#[inline]
#[target_feature(enable = "avx2")]
fn inside(u: __m256, v: __m256, w: __m256) -> (__m256, __m256) {
    let zero = _mm256_setzero_ps();
    let least = _mm256_min_ps(u, _mm256_min_ps(v, w));
    let greatest = _mm256_max_ps(u, _mm256_max_ps(v, w));
    let inside = _mm256_or_ps(
        _mm256_cmp_ps::<_CMP_GE_OQ>(least, zero),
        _mm256_cmp_ps::<_CMP_LE_OQ>(greatest, zero),
    );
    let touching = _mm256_or_ps(
        _mm256_cmp_ps::<_CMP_EQ_OQ>(least, zero),
        _mm256_cmp_ps::<_CMP_EQ_OQ>(greatest, zero),
    );
    (inside, _mm256_and_ps(inside, touching))
}

/// See [`super::portable::hit_pack`].
#[inline]
#[target_feature(enable = "avx2")]
pub(super) fn hit_pack(pack: &Pack, ray: &PreparedRay, t_max: f32) -> Option<PackHits> {
    let [x, y, z] = ray.axes;
    let (along_x, along_y, along_z) = (&pack.vertices[x], &pack.vertices[y], &pack.vertices[z]);
    let origin = ray.axes.map(|axis| _mm256_set1_ps(ray.origin[axis]));
    let shear = ray.shear.map(|s| _mm256_set1_ps(s));

    // 1. Translate to the origin and shear, so that the ray is the z axis.
    let sheared = |vertex: usize| {
        let depth = _mm256_sub_ps(load(&along_z[vertex]), origin[2]);
        let x = _mm256_sub_ps(load(&along_x[vertex]), origin[0]);
        let y = _mm256_sub_ps(load(&along_y[vertex]), origin[1]);
        [
            _mm256_sub_ps(x, _mm256_mul_ps(shear[0], depth)),
            _mm256_sub_ps(y, _mm256_mul_ps(shear[1], depth)),
            depth,
        ]
    };
    let [a, b, c] = [sheared(0), sheared(1), sheared(2)];

    // 2. The origin is inside if the edge functions have one sign.
    let cross = |p: [__m256; 3], q: [__m256; 3]| {
        _mm256_sub_ps(_mm256_mul_ps(p[0], q[1]), _mm256_mul_ps(p[1], q[0]))
    };
    let [mut u, mut v, mut w] = [cross(c, b), cross(a, c), cross(b, a)];
    let (mut candidates, touching) = inside(u, v, w);
    if _mm256_movemask_ps(candidates) == 0 {
        return None;
    }

    // 3. Zero may be a rounded sign: decide it exactly.
    let mut zeros = _mm256_movemask_ps(touching) as u32;
    if zeros != 0 {
        let mut edges = [store(u), store(v), store(w)];
        while zeros != 0 {
            let lane = zeros.trailing_zeros() as usize;
            zeros &= zeros - 1;
            for (edge, exact) in edges.iter_mut().zip(exact_edges(pack, ray, lane)) {
                edge[lane] = exact;
            }
        }
        [u, v, w] = [load(&edges[0]), load(&edges[1]), load(&edges[2])];
        (candidates, _) = inside(u, v, w);
    }

    // 4. Distance.
    let zero = _mm256_setzero_ps();
    let determinant = _mm256_add_ps(_mm256_add_ps(u, v), w);
    let ab = _mm256_add_ps(_mm256_mul_ps(u, a[2]), _mm256_mul_ps(v, b[2]));
    let depth = _mm256_add_ps(ab, _mm256_mul_ps(w, c[2]));
    let t = _mm256_div_ps(_mm256_mul_ps(shear[2], depth), determinant);
    let in_range = _mm256_and_ps(
        _mm256_cmp_ps::<_CMP_GT_OQ>(t, zero),
        _mm256_cmp_ps::<_CMP_LE_OQ>(t, _mm256_set1_ps(t_max)),
    );
    let proper = _mm256_cmp_ps::<_CMP_NEQ_UQ>(determinant, zero);
    let hit = _mm256_and_ps(_mm256_and_ps(candidates, proper), in_range);
    let mask = _mm256_movemask_ps(hit) as u32;
    (mask != 0).then(|| PackHits {
        mask,
        t: store(t),
        v: store(v),
        w: store(w),
        determinant: store(determinant),
    })
}
