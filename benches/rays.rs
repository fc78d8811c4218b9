//! Ray queries a second: turnlight beside Embree (cargo feature `embree`, library named by
//! `TURNLIGHT_EMBREE_LIB`), or beside obvhs's own traversals where Embree is missing.
//!
//! `cargo bench --bench rays [--features embree] -- [MESH] [--quick]`. All engines take turns on
//! the same rays within one run, and of several rounds the best counts, with one thread for every
//! chunk of rays by itself, which is over before the scheduler interferes. The number in brackets is
//! turnlight's rate over the engine's: above 1 turnlight is faster.

#![expect(clippy::print_stdout, reason = "a bench prints its table")]

use std::collections::HashMap;
use std::f32::consts::PI;
use std::hint::black_box;
use std::path::Path;
use std::time::{Duration, Instant};

use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::RayHit;
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use rayon::prelude::*;
use turnlight::accel::Accel;
#[cfg(feature = "embree")]
use turnlight::accel::embree::{Embree, Mode};
use turnlight::geometry::{Frame, Local, Ray, Similarity, offset_origin};
use turnlight::mesh::{LoadOptions, Mesh};

/// Rays a parallel task gets.
const CHUNK: usize = 2048;

fn main() {
    let arguments: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| a != "--bench")
        .collect();
    let quick = arguments.iter().any(|a| a == "--quick");
    let side = if quick { 256 } else { 768 };
    let rounds = if quick { 5 } else { 7 };

    let mut meshes = vec![("icosphere 82 k".to_owned(), bumpy_icosphere(6))];
    if !quick {
        meshes.push(("icosphere 1.3 M".to_owned(), bumpy_icosphere(8)));
    }
    let default = "../shared/data/meshes/spot/spot_triangulated.obj".to_owned();
    for path in arguments
        .iter()
        .filter(|a| !a.starts_with("--"))
        .chain([&default])
    {
        match Mesh::load(
            Path::new(path),
            &Similarity::default(),
            LoadOptions::default(),
        ) {
            Ok((mesh, _)) => meshes.push((path.clone(), (mesh.positions, mesh.triangles))),
            Err(error) => println!("{path}: {error}"),
        }
    }
    for (name, (positions, triangles)) in &meshes {
        println!("\n{name}: {} triangles", triangles.len());
        bench_mesh(positions, triangles, side, rounds);
    }
}

/// Which query a set of rays is for.
#[derive(Clone, Copy, PartialEq)]
enum Query {
    Closest,
    Occluded,
}

/// One engine's answer to a chunk of rays: a checksum that keeps the work from being optimised away
/// and shows disagreements (the number of hits).
type Answer<'a> = Box<dyn Fn(&[Ray], Query) -> usize + Sync + 'a>;

fn bench_mesh(positions: &[Vec3], triangles: &[[u32; 3]], side: usize, rounds: usize) {
    let (accel, seconds) = timed(|| Accel::build(positions, triangles));
    println!("  build: turnlight {seconds:.3} s");
    let mut engines: Vec<(&str, Answer)> = vec![(
        "turnlight",
        Box::new(|rays, query| {
            count(
                rays,
                query,
                |ray| accel.closest_hit(ray, f32::INFINITY).is_some(),
                |ray| accel.occluded(ray, f32::INFINITY),
            )
        }),
    )];

    #[cfg(feature = "embree")]
    for (name, mode) in [("Embree fast", Mode::Fast), ("Embree robust", Mode::Robust)] {
        match timed(|| Embree::build(positions, triangles, mode)) {
            (Ok(embree), seconds) => {
                println!("  build: {name} {seconds:.3} s");
                engines.push((
                    name,
                    Box::new(move |rays, query| {
                        count(
                            rays,
                            query,
                            |ray| embree.closest_hit(ray, f32::INFINITY).is_some(),
                            |ray| embree.occluded(ray, f32::INFINITY),
                        )
                    }),
                ));
            }
            (Err(error), _) => println!("  {name}: {error}"),
        }
    }
    if engines.len() == 1 {
        let (obvhs, seconds) = timed(|| Obvhs::build(positions, triangles));
        println!("  build: obvhs BVH2 and CWBVH {seconds:.3} s");
        let (bvh2, cwbvh) = (obvhs.clone(), obvhs);
        engines.push((
            "obvhs BVH2",
            Box::new(move |rays, query| bvh2.binary(rays, query)),
        ));
        engines.push((
            "obvhs CWBVH",
            Box::new(move |rays, query| cwbvh.wide(rays, query)),
        ));
    }

    println!("  Mrays/s {:>30} {:>10}", "1 thread", "all threads");
    for (name, rays, query) in ray_sets(&accel, positions, triangles, side) {
        let mut hits = vec![0; engines.len()];
        let chunks = rays.len().div_ceil(CHUNK);
        let mut serial = vec![vec![f64::INFINITY; chunks]; engines.len()];
        let mut parallel = vec![f64::INFINITY; engines.len()];
        for _ in 0..rounds {
            for (engine, (_, answer)) in engines.iter().enumerate() {
                hits[engine] = 0;
                for (chunk, best) in rays.chunks(CHUNK).zip(&mut serial[engine]) {
                    let (count, seconds) = timed(|| answer(chunk, query));
                    hits[engine] += count;
                    *best = best.min(seconds);
                }
                let (_, seconds) = timed(|| {
                    let chunks = rays.par_chunks(CHUNK);
                    chunks.map(|chunk| answer(chunk, query)).sum::<usize>()
                });
                parallel[engine] = parallel[engine].min(seconds);
            }
        }
        let best: Vec<[f64; 2]> = (serial.iter().zip(&parallel))
            .map(|(chunks, &parallel)| [chunks.iter().sum(), parallel])
            .collect();
        for (engine, (engine_name, _)) in engines.iter().enumerate() {
            let rate = best[engine].map(|seconds| rays.len() as f64 / seconds / 1e6);
            let ratio = [0, 1].map(|i| best[engine][i] / best[0][i]);
            println!(
                "  {name:<12} {engine_name:<14} {:>6.2} ({:.2}) {:>6.2} ({:.2})   {} hits",
                rate[0], ratio[0], rate[1], ratio[1], hits[engine]
            );
        }
    }
}

fn count(
    rays: &[Ray],
    query: Query,
    closest: impl Fn(&Ray) -> bool,
    occluded: impl Fn(&Ray) -> bool,
) -> usize {
    match query {
        Query::Closest => rays.iter().filter(|ray| closest(black_box(ray))).count(),
        Query::Occluded => rays.iter().filter(|ray| occluded(black_box(ray))).count(),
    }
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}

/// Primary rays in scanline order; diffuse bounces, shadow rays to a few lights and bundles over the
/// hemisphere from what they hit; and rays between random points of the bounding sphere.
fn ray_sets(
    accel: &Accel,
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    side: usize,
) -> Vec<(&'static str, Vec<Ray>, Query)> {
    let mut random = Random(1);
    let radius = positions.iter().map(|p| p.length()).fold(0.0, f32::max);
    let eye = Vec3::new(0.6, 0.9, 2.4) * radius;
    let camera = Frame::about(eye.normalize());
    let primary: Vec<Ray> = (0..side * side)
        .map(|pixel| {
            let x = ((pixel % side) as f32 + random.next()) / side as f32 - 0.5;
            let y = ((pixel / side) as f32 + random.next()) / side as f32 - 0.5;
            let direction = camera.from_local(Local(Vec3::new(0.85 * x, 0.85 * y, -1.0)));
            Ray {
                origin: eye,
                direction: direction.normalize(),
            }
        })
        .collect();

    let surface: Vec<(Vec3, Frame)> = (primary.iter())
        .filter_map(|ray| {
            let hit = accel.closest_hit(ray, f32::INFINITY)?;
            let [a, b, c] = triangles[hit.triangle as usize].map(|v| positions[v as usize]);
            let normal = (b - a).cross(c - a).normalize();
            let normal = if normal.dot(ray.direction) > 0.0 {
                -normal
            } else {
                normal
            };
            Some((offset_origin(ray.at(hit.t), normal), Frame::about(normal)))
        })
        .collect();
    let mut bounce = |&(origin, frame): &(Vec3, Frame)| {
        let (radius, phi) = (random.next().sqrt(), 2.0 * PI * random.next());
        let z = (1.0 - radius * radius).max(0.0).sqrt();
        let local = Local(Vec3::new(radius * phi.cos(), radius * phi.sin(), z));
        Ray {
            origin,
            direction: frame.from_local(local).normalize(),
        }
    };
    let incoherent: Vec<Ray> = surface.iter().map(&mut bounce).collect();
    let bundles: Vec<Ray> = (surface.iter().step_by(surface.len() / 256 + 1))
        .flat_map(|point| (0..2000).map(|_| bounce(point)).collect::<Vec<_>>())
        .collect();
    let lights = [
        Vec3::new(3.0, 2.0, 1.0),
        Vec3::new(-2.0, 1.0, 2.0),
        Vec3::new(0.0, 4.0, -1.0),
    ];
    let shadow = (surface.iter().enumerate())
        .map(|(i, &(origin, _))| Ray {
            origin,
            direction: lights[i % 3].normalize(),
        })
        .collect();

    let mut in_sphere = || loop {
        let p = Vec3::new(random.next(), random.next(), random.next()) * 2.0 - 1.0;
        if p.length_squared() <= 1.0 {
            return p * radius;
        }
    };
    let random_rays = (0..side * side)
        .map(|_| {
            let origin = in_sphere();
            Ray {
                origin,
                direction: (in_sphere() - origin).normalize(),
            }
        })
        .collect();
    vec![
        ("primary", primary, Query::Closest),
        ("incoherent", incoherent.clone(), Query::Closest),
        ("shadow", shadow, Query::Occluded),
        ("ambient", incoherent, Query::Occluded),
        ("bundle", bundles, Query::Occluded),
        ("random", random_rays, Query::Closest),
    ]
}

/// Vigna's splitmix64, as floats in [0, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 40) as f32 / (1 << 24) as f32
    }
}

type Indexed = (Vec<Vec3>, Vec<[u32; 3]>);

/// An icosahedron divided `levels` times, with bumps that shade each other.
fn bumpy_icosphere(levels: usize) -> Indexed {
    let g = f32::midpoint(1.0, 5.0_f32.sqrt());
    let mut positions: Vec<Vec3> = [
        (-1.0, g, 0.0),
        (1.0, g, 0.0),
        (-1.0, -g, 0.0),
        (1.0, -g, 0.0),
        (0.0, -1.0, g),
        (0.0, 1.0, g),
        (0.0, -1.0, -g),
        (0.0, 1.0, -g),
        (g, 0.0, -1.0),
        (g, 0.0, 1.0),
        (-g, 0.0, -1.0),
        (-g, 0.0, 1.0),
    ]
    .map(|(x, y, z)| Vec3::new(x, y, z).normalize())
    .to_vec();
    let mut triangles: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..levels {
        let mut middles = HashMap::new();
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
    for p in &mut positions {
        let coarse = (5.0 * p.x).sin() * (6.0 * p.y + 1.0).sin() * (7.0 * p.z).cos();
        let fine = (31.0 * p.x).sin() * (37.0 * p.y).sin() * (41.0 * p.z + 0.5).sin();
        *p *= 1.0 + 0.15 * coarse + 0.02 * fine;
    }
    (positions, triangles)
}

/// obvhs's own trees and traversals.
#[derive(Clone)]
struct Obvhs {
    bvh2: Bvh2,
    cwbvh: CwBvh,
    bvh2_triangles: Vec<RtTriangle>,
    cwbvh_triangles: Vec<RtTriangle>,
}

impl Obvhs {
    fn build(positions: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let triangles: Vec<Triangle> = (triangles.iter())
            .map(|t| t.map(|v| Vec3A::from(positions[v as usize])))
            .map(|[v0, v1, v2]| Triangle { v0, v1, v2 })
            .collect();
        let settings = BvhBuildParams::medium_build();
        let bvh2 = build_bvh2_from_tris(&triangles, settings, &mut Duration::default());
        let cwbvh = build_cwbvh_from_tris(&triangles, settings, &mut Duration::default());
        let ordered = |indices: &[u32]| {
            indices
                .iter()
                .map(|&i| RtTriangle::from(&triangles[i as usize]))
                .collect()
        };
        Self {
            bvh2_triangles: ordered(&bvh2.primitive_indices),
            cwbvh_triangles: ordered(&cwbvh.primitive_indices),
            bvh2,
            cwbvh,
        }
    }

    fn binary(&self, rays: &[Ray], query: Query) -> usize {
        let test = |ray: &obvhs::ray::Ray, i: usize| self.bvh2_triangles[i].intersect(ray);
        count(
            rays,
            query,
            |ray| {
                self.bvh2
                    .ray_traverse(converted(ray), &mut RayHit::none(), test)
            },
            |ray| !self.bvh2.ray_traverse_miss(converted(ray), test),
        )
    }

    fn wide(&self, rays: &[Ray], query: Query) -> usize {
        let test = |ray: &obvhs::ray::Ray, i: usize| self.cwbvh_triangles[i].intersect(ray);
        count(
            rays,
            query,
            |ray| {
                self.cwbvh
                    .ray_traverse(converted(ray), &mut RayHit::none(), test)
            },
            |ray| !self.cwbvh.ray_traverse_miss(converted(ray), test),
        )
    }
}

fn converted(ray: &Ray) -> obvhs::ray::Ray {
    obvhs::ray::Ray::new_inf(ray.origin.into(), ray.direction.into())
}
