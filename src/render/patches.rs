//! Where the object is in its own way, roughly: what paths are guided by.
//!
//! The surface is cut into patches of neighbouring triangles that face alike, and those into spots.
//! Of every patch some six hundred rays tell, by cells of the octahedral map in the object frame, how
//! often a direction is blocked; where they disagree, every spot is asked apart, cell by cell. This
//! only decides where samples go; whether a sample is blocked is always asked anew. Patches and cells
//! of spots are explored when a path first needs them, each from its own numbers, so the result does
//! not depend on the order.

use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

use glam::{Vec2, Vec3};

use super::direction_map::{CELL_WIDTH, CELLS, SIDE, cell_middle, direction_in, place_in};
use super::halfspace::VertexTree;
use crate::accel::Accel;
use crate::geometry::{Frame, Ray, octahedral_neighbour};
use crate::mesh::Mesh;
use crate::sampling::{SobolPath, as_points, cosine_hemisphere};

/// Rays of a cell, along either side.
const RAYS: usize = 2;
/// Largest number of patches: each costs a tenth of a millisecond.
const MOST_PATCHES: usize = 2048;
/// Largest number of spots; each keeps a byte a cell, from when its patch is explored.
const MOST_SPOTS: usize = 1 << 17;
/// Rays that tell whether a triangle lies open at all.
const EXPOSURE_RAYS: u32 = 4;
/// Probability at least that a direction is blocked, and that it is open: no direction is ruled out,
/// and a wrong expectation costs no more than its inverse. At 0.03 rare bright samples made most of the
/// noise of `suzanne-painted` (RMS of 144 paths 0.0171 against 0.0134); at 0.2 it rises again.
pub(super) const DOUBT: f32 = 0.1;

/// What is known about one patch.
#[derive(Debug)]
pub(super) struct Patch {
    /// `[cell]` probability that a direction is blocked, in (0, 1).
    pub(super) blocked: [f32; CELLS],
    /// `[cell]` whether rays of the cell or beside it disagree.
    mixed: [bool; CELLS],
    /// Whether nothing of the mesh rises above the plane of any triangle of the patch: directions
    /// above the plane need no ray.
    pub(super) convex: bool,
    /// `[spot of the patch][cell]` which of a cell's rays are blocked there, a bit each; [`ASKED`] if
    /// they were traced. Convex patches need none.
    answers: Box<[AtomicU8]>,
    first_spot: u32,
}

/// Bit of an answer that is there.
const ASKED: u8 = 1 << (RAYS * RAYS);

impl Patch {
    /// A patch of which no spot knows better.
    #[cfg(test)]
    pub(super) fn known(blocked: [f32; CELLS]) -> Self {
        Self {
            blocked,
            mixed: [false; CELLS],
            convex: false,
            answers: Box::new([]),
            first_spot: 0,
        }
    }
}

/// The patches of a mesh, and their spots.
#[derive(Debug)]
pub(super) struct Patches {
    /// `[triangle]` its spot.
    spot_of: Vec<u32>,
    /// `[spot]` its patch.
    patch_of: Vec<u32>,
    /// Triangles in order of their spots: spot `k` has `triangles[spots[k]..spots[k + 1]]`.
    triangles: Vec<u32>,
    spots: Vec<u32>,
    /// Patch `k` has the spots `first_spots[k]..first_spots[k + 1]`.
    first_spots: Vec<u32>,
    patches: Vec<OnceLock<Box<Patch>>>,
    vertices: VertexTree,
}

impl Patches {
    /// Cuts a mesh into patches and spots; none is explored yet.
    pub(super) fn new(mesh: &Mesh) -> Self {
        let count = mesh.triangles.len();
        // Place and facing of each triangle, side by side; a right angle weighs as much as the
        // object's radius.
        let places: Vec<[f32; 6]> = (0..count as u32)
            .map(|triangle| {
                let [a, b, c] = mesh.triangle_positions(triangle);
                let middle = (a + b + c) / 3.0;
                let normal = mesh.normal_at(triangle, Vec2::splat(1.0 / 3.0));
                [middle.x, middle.y, middle.z, normal.x, normal.y, normal.z]
            })
            .collect();
        let mut triangles: Vec<u32> = (0..count as u32).collect();
        let (mut first_spots, mut spots, mut patch_of) = (Vec::new(), Vec::new(), Vec::new());
        let patch_size = count.div_ceil(MOST_PATCHES).max(1);
        let spot_size = count.div_ceil(MOST_SPOTS).max(1);
        let mut waiting = vec![(0, count, false)];
        while let Some((start, end, mut in_patch)) = waiting.pop() {
            if !in_patch && end - start <= patch_size {
                first_spots.push(spots.len() as u32);
                in_patch = true;
            }
            if end - start <= spot_size {
                spots.push(start as u32);
                patch_of.push(first_spots.len() as u32 - 1);
                continue;
            }
            // Across the widest extent, through the median.
            let part = &mut triangles[start..end];
            let extent = |axis: usize| {
                let values = part.iter().map(|&t| places[t as usize][axis]);
                let (low, high) = values.fold((f32::MAX, f32::MIN), |(low, high), x| {
                    (low.min(x), high.max(x))
                });
                high - low
            };
            let axis = (0..6)
                .max_by(|&a, &b| extent(a).total_cmp(&extent(b)))
                .unwrap_or(0);
            let middle = part.len() / 2;
            part.select_nth_unstable_by(middle, |&a, &b| {
                let (x, y) = (places[a as usize][axis], places[b as usize][axis]);
                x.total_cmp(&y).then(a.cmp(&b))
            });
            // The first half is cut next: patches come out in the order of their triangles.
            waiting.push((start + middle, end, in_patch));
            waiting.push((start, start + middle, in_patch));
        }
        let patches = first_spots.iter().map(|_| OnceLock::new()).collect();
        first_spots.push(spots.len() as u32);
        spots.push(count as u32);
        let mut spot_of = vec![0; count];
        for (spot, ends) in spots.windows(2).enumerate() {
            for &triangle in &triangles[ends[0] as usize..ends[1] as usize] {
                spot_of[triangle as usize] = spot as u32;
            }
        }
        Self {
            spot_of,
            patch_of,
            triangles,
            spots,
            first_spots,
            patches,
            vertices: VertexTree::new(&mesh.positions),
        }
    }

    /// The same patches, none of them explored.
    pub(super) fn unexplored(&self) -> Self {
        Self {
            spot_of: self.spot_of.clone(),
            patch_of: self.patch_of.clone(),
            triangles: self.triangles.clone(),
            spots: self.spots.clone(),
            first_spots: self.first_spots.clone(),
            patches: self.patches.iter().map(|_| OnceLock::new()).collect(),
            vertices: self.vertices.clone(),
        }
    }

    /// The numbers of the patch and of the spot of a triangle.
    #[inline]
    pub(super) fn of(&self, triangle: u32) -> (u32, u32) {
        let spot = self.spot_of[triangle as usize];
        (self.patch_of[spot as usize], spot)
    }

    /// A patch, explored now if it was not yet.
    #[inline]
    pub(super) fn get(&self, patch: u32, mesh: &Mesh, accel: &Accel) -> &Patch {
        self.patches[patch as usize].get_or_init(|| Box::new(self.explore(patch, mesh, accel)))
    }

    /// Number of patches explored so far.
    pub(super) fn explored(&self) -> u64 {
        let explored = self.patches.iter().filter(|patch| patch.get().is_some());
        explored.count() as u64
    }

    /// Probability that a direction (unit, object frame), which lies in `cell`, is blocked at a spot
    /// of `patch`.
    #[inline]
    pub(super) fn blocked(
        &self,
        patch: &Patch,
        spot: u32,
        (direction, cell): (Vec3, usize),
        mesh: &Mesh,
        accel: &Accel,
    ) -> f32 {
        if !patch.mixed[cell] {
            return patch.blocked[cell];
        }
        // Threads may both ask, and both find the same.
        let answer = &patch.answers[(spot - patch.first_spot) as usize * CELLS + cell];
        let mut rays = answer.load(Ordering::Relaxed);
        if rays == 0 {
            rays = ASKED | self.ask(spot, cell, mesh, accel);
            answer.store(rays, Ordering::Relaxed);
        }
        // The ray nearest to the direction counts for half.
        let near = quarter_of(direction, cell);
        let all = (rays & (ASKED - 1)).count_ones() as f32 / (RAYS * RAYS) as f32;
        let nearest = f32::from(rays >> near & 1);
        (0.5 * (all + nearest)).clamp(DOUBT, 1.0 - DOUBT)
    }

    /// Which of a cell's rays are blocked at a spot, a bit each.
    fn ask(&self, spot: u32, cell: usize, mesh: &Mesh, accel: &Accel) -> u8 {
        let triangles = self.triangles_of(spot..spot + 1);
        (0..RAYS * RAYS)
            .map(|ray| {
                let number = (cell * RAYS * RAYS + ray) as u32;
                let blocked =
                    probe_ray(triangles, (0x5107, spot, number), (cell, ray), mesh, accel);
                u8::from(blocked) << ray
            })
            .sum()
    }

    fn triangles_of(&self, spots: Range<u32>) -> &[u32] {
        let end = |spot: u32| self.spots[spot as usize] as usize;
        &self.triangles[end(spots.start)..end(spots.end)]
    }

    fn explore(&self, patch: u32, mesh: &Mesh, accel: &Accel) -> Patch {
        let first_spot = self.first_spots[patch as usize];
        let end_spot = self.first_spots[patch as usize + 1];
        let triangles = self.triangles_of(first_spot..end_spot);
        let normals = triangles
            .iter()
            .map(|&triangle| mesh.normal_at(triangle, Vec2::splat(1.0 / 3.0)));
        let facing = normals.sum::<Vec3>().normalize_or(Vec3::Y);

        let convex = triangles.iter().all(|&triangle| {
            let [corner, ..] = mesh.triangle_positions(triangle);
            let normal = mesh.geometric_normal(triangle);
            normal.dot(facing) > 0.0 && self.vertices.is_below(corner, normal)
        });
        if convex {
            // Only what lies below the planes is blocked.
            let blocked = std::array::from_fn(|cell| {
                let height = cell_middle(cell).dot(facing) / CELL_WIDTH;
                (0.5 - height).clamp(DOUBT, 1.0 - DOUBT)
            });
            return Patch {
                blocked,
                mixed: [false; CELLS],
                convex,
                answers: Box::new([]),
                first_spot,
            };
        }

        // Triangles under other layers, where no path will come from, have nothing to say.
        let exposed: Vec<u32> = triangles
            .iter()
            .copied()
            .filter(|&triangle| is_exposed(triangle, mesh, accel))
            .collect();
        let triangles = if exposed.is_empty() {
            triangles
        } else {
            &exposed
        };

        // The share of blocked rays in each cell; triangles of one patch face alike within some
        // degrees, so what lies behind need not be known.
        let mut hits = [0.5; CELLS];
        let mut number = 0;
        for (cell, hits) in hits.iter_mut().enumerate() {
            if cell_middle(cell).dot(facing) < -0.4 {
                continue;
            }
            *hits = 0.0;
            for ray in 0..RAYS * RAYS {
                if probe_ray(triangles, (0x9a7c, patch, number), (cell, ray), mesh, accel) {
                    *hits += 1.0 / (RAYS * RAYS) as f32;
                }
                number += 1;
            }
        }

        // A cell beside a blocked one may be blocked in part, whatever its few rays say.
        let blocked: [f32; CELLS] = std::array::from_fn(|cell| {
            let (x, y) = ((cell % SIDE) as isize, (cell / SIDE) as isize);
            let mut around = 0.0;
            for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1)] {
                around += hits[octahedral_neighbour(SIDE, x + dx, y + dy)] / 4.0;
            }
            0.8 * hits[cell] + 0.2 * around
        });
        Patch {
            blocked: blocked.map(|share| share.clamp(DOUBT, 1.0 - DOUBT)),
            mixed: blocked.map(|share| share > 1e-6 && share < 1.0 - 1e-6),
            convex,
            answers: (0..(end_spot - first_spot) as usize * CELLS)
                .map(|_| AtomicU8::new(0))
                .collect(),
            first_spot,
        }
    }
}

/// Whether a ray from one of some triangles is blocked: `key` chooses triangle, place on it and
/// direction in the quarter `ray` of a cell.
fn probe_ray(
    triangles: &[u32],
    (seed, group, number): (u64, u32, u32),
    (cell, ray): (usize, usize),
    mesh: &Mesh,
    accel: &Accel,
) -> bool {
    let [x, y, u, v] = SobolPath::new(seed, 0, group, number).next_4d();
    let triangle = triangles[number as usize % triangles.len()];
    let within = Vec2::new((ray % RAYS) as f32 + x, (ray / RAYS) as f32 + y);
    let direction = direction_in(cell, within / RAYS as f32);
    let position = mesh.position_at(triangle, folded(Vec2::new(u, v)));
    let side = mesh.geometric_normal(triangle);
    let ray = Ray::leaving(position, side, direction);
    accel.occluded(&ray, f32::INFINITY)
}

/// Whether any of some rays upward from a triangle leaves the object.
fn is_exposed(triangle: u32, mesh: &Mesh, accel: &Accel) -> bool {
    let side = mesh.geometric_normal(triangle);
    let frame = Frame::about(side);
    (0..EXPOSURE_RAYS).any(|number| {
        let (u, other) = as_points(SobolPath::new(0xe705, 0, triangle, number).next_4d());
        let direction = frame.from_local(cosine_hemisphere(u));
        let position = mesh.position_at(triangle, folded(other));
        let ray = Ray::leaving(position, side, direction);
        !accel.occluded(&ray, f32::INFINITY)
    })
}

/// Barycentric coordinates, evenly over a triangle, of a point of the unit square.
fn folded(u: Vec2) -> Vec2 {
    if u.x + u.y > 1.0 { Vec2::ONE - u } else { u }
}

/// The ray of a cell whose part of it holds a direction.
#[inline]
fn quarter_of(direction: Vec3, cell: usize) -> usize {
    let within = place_in(direction, cell) * RAYS as f32;
    let index = |x: f32| (x.max(0.0) as usize).min(RAYS - 1);
    index(within.y) * RAYS + index(within.x)
}
