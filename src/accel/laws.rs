//! The laws that the ray queries keep.

use std::collections::BTreeMap;
use std::f32::consts::PI;

use glam::{DVec3, Vec3};
use proptest::prelude::*;

use super::{Accel, Hit, Instructions};
use crate::geometry::Ray;

fn ray(origin: Vec3, direction: Vec3) -> Ray {
    Ray { origin, direction }
}

fn towards(origin: Vec3, target: Vec3) -> Ray {
    ray(origin, (target - origin).normalize())
}

/// The same tree, walked without SIMD.
fn portable(accel: &Accel) -> Accel {
    Accel {
        instructions: Instructions::Portable,
        ..accel.clone()
    }
}

/// Where a ray meets the plane of a triangle, in double precision (Möller and Trumbore 1997), and
/// how far single precision may be off.
struct ExactHit {
    t: f64,
    u: f64,
    v: f64,
    /// Absolute, of `t`.
    t_error: f64,
    /// Absolute, of the barycentric coordinates.
    uv_error: f64,
}

impl ExactHit {
    /// `None` if the ray runs in the plane, or the triangle has no area.
    fn of(ray: &Ray, corners: [Vec3; 3]) -> Option<Self> {
        let [a, b, c] = corners.map(|corner| corner.as_dvec3());
        let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let (ab, ac, from_a): (DVec3, DVec3, DVec3) = (b - a, c - a, origin - a);
        let p = direction.cross(ac);
        let determinant = ab.dot(p);
        let q = from_a.cross(ab);
        let normal = ab.cross(ac);
        let longest = ab.length().max(ac.length()).max((b - c).length());
        if determinant == 0.0 {
            return None;
        }
        // Each vertex moves by a few roundings of the largest coordinate; the hit moves by as much
        // across the ray and by more along it, the more the ray grazes.
        let reach = [a, b, c, origin]
            .map(|v| v.abs().max_element())
            .into_iter()
            .fold(0.0, f64::max);
        let rounding = 16.0 * f64::from(f32::EPSILON) / 2.0 * reach;
        let grazing = (determinant / (normal.length() * direction.length())).abs();
        let height = normal.length() / longest;
        Some(Self {
            t: ac.dot(q) / determinant,
            u: from_a.dot(p) / determinant,
            v: direction.dot(q) / determinant,
            t_error: rounding / grazing * (longest / height),
            uv_error: rounding / (grazing * height),
        })
    }

    /// The smallest barycentric coordinate: how far inside the triangle the hit is.
    fn inside(&self) -> f64 {
        self.u.min(self.v).min(1.0 - self.u - self.v)
    }
}

/// An octahedron divided `levels` times, turned so that no edge lies in a coordinate plane.
fn geosphere(levels: usize, radius: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut positions: Vec<Vec3> = vec![
        Vec3::X,
        Vec3::Y,
        Vec3::Z,
        Vec3::NEG_X,
        Vec3::NEG_Y,
        Vec3::NEG_Z,
    ];
    let mut triangles = vec![
        [0, 1, 2],
        [1, 3, 2],
        [3, 4, 2],
        [4, 0, 2],
        [1, 0, 5],
        [3, 1, 5],
        [4, 3, 5],
        [0, 4, 5],
    ];
    let turn = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.3, 0.5, 0.7);
    for position in &mut positions {
        *position = turn * *position;
    }
    for _ in 0..levels {
        let mut middles = BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                positions.push((positions[a as usize] + positions[b as usize]).normalize());
                positions.len() as u32 - 1
            })
        };
        triangles = (triangles.iter())
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
    }
    for position in &mut positions {
        *position *= radius;
    }
    (positions, triangles)
}

/// Points spread over the unit sphere.
fn spread(count: usize) -> impl Iterator<Item = Vec3> + Clone {
    (0..count).map(move |i| {
        let z = 1.0 - (2 * i + 1) as f32 / count as f32;
        let phi = (i as f32 * 0.618_034).fract() * 2.0 * PI;
        let r = (1.0 - z * z).sqrt();
        Vec3::new(r * phi.cos(), r * phi.sin(), z)
    })
}

fn points(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Vec3>> {
    let coordinate = || -1.0f32..1.0;
    let point = (coordinate(), coordinate(), coordinate()).prop_map(Vec3::from);
    prop::collection::vec(point, count)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn soup_hits_agree_with_brute_force_in_double_precision(
        corners in points(3..180),
        ends in points(40..41),
        exponent in -7i32..8,
    ) {
        let scale = 4.0f32.powi(exponent);
        let positions: Vec<Vec3> = corners.iter().map(|&p| p * scale).collect();
        let triangles: Vec<[u32; 3]> = (0..positions.len() as u32 / 3)
            .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
            .collect();
        let of = |i: usize| triangles[i].map(|v| positions[v as usize]);
        let accel = Accel::build(&positions, &triangles);
        for pair in ends.chunks(2) {
            let ray = towards(pair[0] * 2.0 * scale, pair[1] * scale);
            let found = accel.closest_hit(&ray, f32::INFINITY);
            prop_assert_eq!(found.is_some(), accel.occluded(&ray, f32::INFINITY));

            // What was found is a hit, as exact as single precision can be.
            if let Some(hit) = found
                && let Some(exact) = ExactHit::of(&ray, of(hit.triangle as usize))
            {
                prop_assert!(exact.inside() > -exact.uv_error);
                prop_assert!((exact.t - f64::from(hit.t)).abs() < exact.t_error);
                prop_assert!((exact.u - f64::from(hit.u)).abs() < exact.uv_error);
                prop_assert!((exact.v - f64::from(hit.v)).abs() < exact.uv_error);
            }
            // Nothing that is surely nearer was missed.
            for i in 0..triangles.len() {
                let Some(exact) = ExactHit::of(&ray, of(i)) else { continue };
                if exact.t > exact.t_error && exact.inside() > exact.uv_error {
                    let latest = exact.t + exact.t_error;
                    prop_assert!(found.is_some_and(|hit| f64::from(hit.t) < latest));
                }
            }
        }
    }

    #[test]
    fn simd_and_portable_hits_are_bit_identical(
        corners in points(3..300),
        ends in points(40..41),
        snap in prop::bool::ANY,
    ) {
        // On a coarse grid rays meet edges, vertices and coplanar triangles all the time.
        let grid = |p: Vec3| if snap { (p * 4.0).round() / 4.0 } else { p };
        let positions: Vec<Vec3> = corners.into_iter().map(grid).collect();
        let triangles: Vec<[u32; 3]> = (0..positions.len() as u32 - 2)
            .map(|i| [i, i + 1, i + 2])
            .collect();
        let accel = Accel::build(&positions, &triangles);
        let portable = portable(&accel);
        for pair in ends.chunks(2) {
            let ray = ray(grid(pair[0]), grid(pair[1]) - grid(pair[0]));
            let bits = |hit: Option<Hit>| {
                hit.map(|h| (h.t.to_bits(), h.triangle, h.u.to_bits(), h.v.to_bits()))
            };
            for t_max in [f32::INFINITY, 0.7] {
                prop_assert_eq!(
                    bits(accel.closest_hit(&ray, t_max)),
                    bits(portable.closest_hit(&ray, t_max))
                );
                prop_assert_eq!(accel.occluded(&ray, t_max), portable.occluded(&ray, t_max));
            }
        }
    }
}

#[test]
fn closed_mesh_never_leaks_at_vertices_and_edges() {
    for scale in [0.01, 1.0, 1000.0] {
        let (positions, triangles) = geosphere(5, scale);
        let accel = Accel::build(&positions, &triangles);
        let mut targets = positions.clone();
        for &[a, b, c] in &triangles {
            let [a, b, c] = [a, b, c].map(|v| positions[v as usize]);
            targets.extend([(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0]);
        }
        for eye in spread(12) {
            for &target in &targets {
                // From outside only what the sphere doesn't hide at its silhouette.
                for origin in [eye * 2.3 * scale, eye * 0.4 * scale] {
                    let outside = origin.length() > scale;
                    if outside && target.dot(eye) < 0.5 * scale {
                        continue;
                    }
                    let ray = towards(origin, target);
                    let hit = accel.closest_hit(&ray, f32::INFINITY);
                    let distance = (target - origin).length();
                    let near = hit.is_some_and(|hit| (hit.t - distance).abs() < 1e-3 * distance);
                    assert!(near, "scale {scale}: {ray:?} at {target} found {hit:?}");
                    assert!(accel.occluded(&ray, f32::INFINITY));
                }
            }
        }
    }
}

#[test]
fn axis_aligned_rays_hit_a_cube_everywhere() {
    // 8 × 8 quads a face: faces, edges and vertices lie on planes of the rays.
    const N: u32 = 8;
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for (axis, side) in (0..3).flat_map(|axis| [(axis, 0.0), (axis, 1.0)]) {
        let first = positions.len() as u32;
        for i in 0..=N {
            for j in 0..=N {
                let mut point = [side; 3];
                point[(axis + 1) % 3] = i as f32 / N as f32;
                point[(axis + 2) % 3] = j as f32 / N as f32;
                positions.push(Vec3::from(point));
            }
        }
        for i in 0..N {
            for j in 0..N {
                let corner = first + i * (N + 1) + j;
                triangles.push([corner, corner + 1, corner + N + 1]);
                triangles.push([corner + 1, corner + N + 2, corner + N + 1]);
            }
        }
    }
    let accel = Accel::build(&positions, &triangles);
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            for (i, j) in (0..=2 * N).flat_map(|i| (0..=2 * N).map(move |j| (i, j))) {
                let mut origin = [0.5 - 2.0 * sign; 3];
                origin[(axis + 1) % 3] = i as f32 / (2 * N) as f32;
                origin[(axis + 2) % 3] = j as f32 / (2 * N) as f32;
                // Zero components of either sign.
                for zero in [0.0, -0.0] {
                    let mut direction = [zero; 3];
                    direction[axis] = sign;
                    let ray = ray(origin.into(), direction.into());
                    let hit = accel.closest_hit(&ray, f32::INFINITY);
                    assert!(hit.is_some_and(|hit| hit.t == 1.5), "{ray:?}: {hit:?}");
                    assert!(!accel.occluded(&ray, 1.499));
                }
            }
        }
    }
}

#[test]
fn ray_in_the_plane_of_a_triangle_misses_it() {
    let accel = Accel::build(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]]);
    for (origin, direction) in [
        (Vec3::new(-1.0, 0.25, 0.0), Vec3::X),
        (Vec3::new(0.2, -1.0, 0.0), Vec3::Y),
        (Vec3::new(-1.0, 0.0, 0.0), Vec3::X),
        (
            Vec3::new(2.0, -1.0, 0.0),
            Vec3::new(-1.0, 1.0, 0.0).normalize(),
        ),
    ] {
        assert_eq!(
            accel.closest_hit(&ray(origin, direction), f32::INFINITY),
            None
        );
    }
}

#[test]
fn one_triangle_is_hit_from_both_sides_within_range() {
    let accel = Accel::build(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]]);
    for side in [1.0, -1.0] {
        let ray = ray(Vec3::new(0.25, 0.5, side), Vec3::new(0.0, 0.0, -side));
        let hit = Hit {
            t: 1.0,
            triangle: 0,
            u: 0.25,
            v: 0.5,
        };
        assert_eq!(accel.closest_hit(&ray, f32::INFINITY), Some(hit));
        assert_eq!(accel.closest_hit(&ray, 1.0), Some(hit));
        assert_eq!(accel.closest_hit(&ray, 0.999), None);
        assert!(accel.occluded(&ray, 1.0) && !accel.occluded(&ray, 0.999));
    }
    // A ray that starts on the triangle doesn't hit it.
    let on_it = ray(Vec3::new(0.25, 0.5, 0.0), Vec3::Z);
    assert_eq!(accel.closest_hit(&on_it, f32::INFINITY), None);
}

#[test]
fn empty_and_unusable_meshes_are_never_hit() {
    let nowhere = Vec3::splat(f32::NAN);
    let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, nowhere, Vec3::INFINITY];
    for triangles in [vec![], vec![[0, 1, 1], [0, 1, 3], [4, 1, 2], [0, 1, 99]]] {
        let accel = Accel::build(&positions, &triangles);
        let ray = ray(Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z);
        assert_eq!(accel.closest_hit(&ray, f32::INFINITY), None);
        assert!(!accel.occluded(&ray, f32::INFINITY));
    }
}

#[test]
fn rays_that_are_not_finite_hit_nothing() {
    let (positions, triangles) = geosphere(3, 1.0);
    let accel = Accel::build(&positions, &triangles);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let mut broken = Vec3::ZERO;
            broken[axis] = bad;
            for ray in [ray(broken, Vec3::Z), ray(Vec3::ZERO, Vec3::Z + broken)] {
                assert_eq!(accel.closest_hit(&ray, f32::INFINITY), None);
                assert!(!accel.occluded(&ray, f32::INFINITY));
            }
        }
    }
    let good = ray(Vec3::ZERO, Vec3::Z);
    assert_eq!(
        accel.closest_hit(&ray(Vec3::ZERO, Vec3::ZERO), f32::INFINITY),
        None
    );
    assert_eq!(accel.closest_hit(&good, f32::NAN), None);
    assert_eq!(accel.closest_hit(&good, -1.0), None);
    assert!(!accel.occluded(&good, f32::NAN) && !accel.occluded(&good, 0.0));
}

#[test]
fn identical_triangles_build_fast_and_the_lowest_index_wins() {
    const COPIES: usize = 100_000;
    let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let accel = Accel::build(&positions, &vec![[0, 1, 2]; COPIES]);
    let ray = ray(Vec3::new(0.25, 0.25, 1.0), Vec3::NEG_Z);
    for accel in [&accel, &portable(&accel)] {
        assert_eq!(
            accel
                .closest_hit(&ray, f32::INFINITY)
                .map(|hit| hit.triangle),
            Some(0)
        );
        assert!(accel.occluded(&ray, f32::INFINITY));
    }
}

#[test]
fn long_thin_triangles_of_a_cone_do_not_leak() {
    // 20 000 slivers from the apex to the rim, aspect ratio 3000.
    const RIM: u32 = 20_000;
    let mut positions = vec![Vec3::new(0.0, 0.0, 1.0)];
    positions.extend((0..RIM).map(|i| {
        let phi = 2.0 * PI * i as f32 / RIM as f32;
        Vec3::new(phi.cos(), phi.sin(), 0.0)
    }));
    let triangles: Vec<[u32; 3]> = (0..RIM).map(|i| [0, 1 + i, 1 + (i + 1) % RIM]).collect();
    let accel = Accel::build(&positions, &triangles);
    for (i, direction) in spread(20_000).enumerate() {
        let rim = positions[1 + i % RIM as usize];
        // Along the seams, and anywhere over the cone.
        let on_seam = positions[0].lerp(rim, 0.05 + 0.9 * (i as f32 * 0.754_877).fract());
        let anywhere = Vec3::new(direction.x * 0.9, direction.y * 0.9, 0.0);
        for target in [on_seam, anywhere] {
            let ray = towards(Vec3::new(0.1, 0.2, 5.0), target);
            assert!(accel.closest_hit(&ray, f32::INFINITY).is_some(), "{ray:?}");
        }
    }
}

#[test]
fn tree_does_not_depend_on_the_number_of_threads() {
    let (positions, triangles) = geosphere(5, 1.0);
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        format!(
            "{:?}",
            pool.install(|| Accel::build(&positions, &triangles)).tree
        )
    };
    assert!(build(1) == build(3));
}

#[cfg(feature = "embree")]
#[test]
fn closest_hits_agree_with_embree() {
    use super::embree::{Embree, Mode};

    let (positions, triangles) = geosphere(6, 1.0);
    let positions: Vec<Vec3> = (positions.iter())
        .map(|p| *p * (1.0 + 0.2 * (9.0 * p.x).sin() * (8.0 * p.y).cos()))
        .collect();
    let Ok(embree) = Embree::build(&positions, &triangles, Mode::Robust) else {
        return;
    };
    let accel = Accel::build(&positions, &triangles);
    for (origin, direction) in spread(20_000).zip(spread(20_001).skip(777).cycle()) {
        let ray = ray(origin * 1.3, direction);
        let [ours, theirs] = [
            accel.closest_hit(&ray, f32::INFINITY),
            embree.closest_hit(&ray, f32::INFINITY),
        ];
        match (ours, theirs) {
            (None, None) => {}
            (Some(ours), Some(theirs)) => assert!((ours.t - theirs.t).abs() < 1e-4),
            _ => panic!("{ray:?}: {ours:?} against {theirs:?}"),
        }
        assert_eq!(ours.is_some(), embree.occluded(&ray, f32::INFINITY));
    }
}
