//! What a surface point sees: open sky, or the object itself.
//!
//! The map lives in the object frame, where geometry never moves, so it is made once for all
//! frames. Directions are cells of an octahedral grid; a coarse grid is traced whole, and only
//! cells beside a border between open and blocked are traced again at the next finer level.

use glam::{Vec2, Vec3};

use crate::accel::Accel;
use crate::geometry::{
    Ray, direction_from_octahedral, octahedral_from_direction, octahedral_neighbour, offset_origin,
};
use crate::traces::SurfaceNormals;

/// Cells across the grid that is traced whole: 5.6° apart, about 500 rays a hemisphere.
const COARSE: usize = 32;
/// Cells across the finest grid: 1.4°.
const FINE: usize = 128;
/// Resolutions of the pyramid, finest first.
const LEVELS: [usize; 5] = [FINE, 64, COARSE, 16, 8];
/// Words of the finest level, a bit a cell.
const WORDS: usize = FINE * FINE / 64;

/// A patch of the object seen from a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockedPatch {
    /// Towards the patch, unit, object frame.
    pub(super) direction: Vec3,
    /// Solid angle, steradian.
    pub(super) solid_angle: f32,
    /// Triangle met.
    pub(super) triangle: u32,
    /// Where on the triangle.
    pub(super) barycentric: Vec2,
    /// Shading normal there, unit, object frame.
    pub(super) normal: Vec3,
    /// Whether it is the back of a surface, which reflects nothing.
    pub(super) is_black: bool,
}

/// Share of the hemisphere, by cosine over the coarse grid, that counts as open all the same: that of a
/// facet's own plane below the horizon of a normal 3.6° from its own. Of even light it is a fifth of the
/// error that a point's rho_d may have.
const NEGLIGIBLE: f32 = 1e-3;

/// The directions from which light reaches a surface point.
pub(super) enum Visibility {
    /// Nothing blocks the hemisphere.
    Open,
    /// Something does.
    Partial {
        /// Open shares; cells below the horizon count as open.
        open: Box<Shares>,
        /// What blocks, in patches of at most one coarse cell.
        blocked: Vec<BlockedPatch>,
    },
}

/// The open share of cells at every resolution.
pub(super) struct Shares {
    /// A bit a cell of the finest, row by row.
    finest: [u64; WORDS],
    /// `[level − 1][cell]` of the others, in 255ths.
    coarser: [Vec<u8>; LEVELS.len() - 1],
}

/// Place of the coarse grid in [`LEVELS`].
const COARSE_LEVEL: usize = 2;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Cell {
    Open,
    Blocked,
    /// Below the horizon: never asked, so never a reason to refine.
    Below,
}

impl Visibility {
    /// Traces what is seen from `position` on a surface of geometric normal `normal` (mesh frame).
    /// The number of rays comes back too.
    pub(super) fn trace(
        accel: &Accel,
        surface: &SurfaceNormals,
        position: Vec3,
        normal: Vec3,
    ) -> (Self, u64) {
        let origin = offset_origin(position, normal);
        let mut rays = 0;
        let mut patches: Vec<Option<(u32, Vec2)>> = vec![None; COARSE * COARSE];
        let mut look = |n: usize, x: usize, y: usize| {
            let direction = centre(n, x, y);
            // A cell is below the horizon when all of it is.
            if direction.dot(normal) < -2.0 / n as f32 {
                return Cell::Below;
            }
            rays += 1;
            let ray = Ray { origin, direction };
            let patch = &mut patches[y * COARSE / n * COARSE + x * COARSE / n];
            let is_blocked = match patch {
                // What blocks the patch is known; here only whether anything does.
                Some(_) => accel.occluded(&ray, f32::INFINITY),
                None => {
                    let hit = accel.closest_hit(&ray, f32::INFINITY);
                    *patch = hit.map(|hit| (hit.triangle, Vec2::new(hit.u, hit.v)));
                    patch.is_some()
                }
            };
            if is_blocked {
                Cell::Blocked
            } else {
                Cell::Open
            }
        };

        let mut n = COARSE;
        let mut cells: Vec<Cell> = (0..n * n).map(|i| look(n, i % n, i / n)).collect();
        // Grazing cells may look below the shading normal's horizon into the surface itself; only
        // what rises above it makes a point concave.
        let blocked = cells
            .iter()
            .enumerate()
            .filter(|(_, c)| **c == Cell::Blocked);
        let share = blocked.map(|(i, _)| {
            let cos = centre(n, i % n, i / n).dot(normal).max(0.0);
            cos * solid_angle(n, i % n, i / n)
        });
        if share.sum::<f32>() <= NEGLIGIBLE * std::f32::consts::PI {
            return (Self::Open, rays);
        }
        while n < FINE {
            let border: Vec<bool> = (0..n * n).map(|i| is_border(&cells, n, i)).collect();
            let coarser = cells;
            let fine = 2 * n;
            cells = (0..fine * fine)
                .map(|i| {
                    let (x, y) = (i % fine, i / fine);
                    let parent = y / 2 * n + x / 2;
                    if border[parent] {
                        look(fine, x, y)
                    } else {
                        coarser[parent]
                    }
                })
                .collect();
            n = fine;
        }

        let open = Box::new(Shares::new(&cells));
        let mut blocked = Vec::new();
        for (i, patch) in patches.iter().enumerate() {
            let Some((triangle, barycentric)) = *patch else {
                continue;
            };
            let share = 1.0 - open.of(COARSE_LEVEL, i);
            if share > 0.0 {
                let direction = centre(COARSE, i % COARSE, i / COARSE);
                blocked.push(BlockedPatch {
                    direction,
                    solid_angle: share * solid_angle(COARSE, i % COARSE, i / COARSE),
                    triangle,
                    barycentric,
                    normal: surface.shading(triangle, barycentric),
                    is_black: direction.dot(surface.geometric[triangle as usize]) >= 0.0,
                });
            }
        }
        (Self::Partial { open, blocked }, rays)
    }

    /// The open fraction of a cone of half-angle `spread` radians about `direction`.
    #[inline]
    pub(super) fn open(&self, direction: Vec3, spread: f32) -> f32 {
        match self {
            Self::Open => 1.0,
            Self::Partial { open, .. } => {
                // A cell of an n × n grid is about 3.5/n radians wide, a cone 2 × spread.
                let wanted = 1.75 / spread.max(1e-3);
                let level = LEVELS
                    .iter()
                    .rposition(|&n| n as f32 >= wanted)
                    .unwrap_or(0);
                let n = LEVELS[level];
                let uv = octahedral_from_direction(direction) * n as f32;
                let cell = |x: f32| (x as usize).min(n - 1);
                open.of(level, cell(uv.y) * n + cell(uv.x))
            }
        }
    }

    /// What blocks; nothing at an open point.
    pub(super) fn blocked(&self) -> &[BlockedPatch] {
        match self {
            Self::Open => &[],
            Self::Partial { blocked, .. } => blocked,
        }
    }
}

/// The direction in the middle of cell `(x, y)` of an `n × n` map.
fn centre(n: usize, x: usize, y: usize) -> Vec3 {
    direction_from_octahedral(Vec2::new(x as f32 + 0.5, y as f32 + 0.5) / n as f32)
}

/// Whether a neighbour on one of the four sides differs, both above the horizon. Where a border passes a
/// cell's corner, the two cells beside the corner see it, too.
fn is_border(cells: &[Cell], n: usize, i: usize) -> bool {
    let here = cells[i];
    if here == Cell::Below {
        return false;
    }
    let differs = |other: Cell| other != here && other != Cell::Below;
    let (x, y) = (i % n, i / n);
    if (1..n - 1).contains(&x) && (1..n - 1).contains(&y) {
        return [i - n, i - 1, i + 1, i + n]
            .map(|j| cells[j])
            .into_iter()
            .any(differs);
    }
    // Over the edge of the octahedral square.
    let (x, y) = (x as isize, y as isize);
    let sides = [(0, -1), (-1, 0), (1, 0), (0, 1)];
    sides
        .into_iter()
        .any(|(dx, dy)| differs(cells[octahedral_neighbour(n, x + dx, y + dy)]))
}

impl Shares {
    /// Of the cells of the finest grid.
    fn new(cells: &[Cell]) -> Self {
        let mut finest = [0; WORDS];
        for (i, cell) in cells.iter().enumerate() {
            finest[i / 64] |= u64::from(*cell != Cell::Blocked) << (i % 64);
        }
        let full: Vec<u8> = (cells
            .iter()
            .map(|c| if *c == Cell::Blocked { 0 } else { 255 }))
        .collect();
        let coarser = |n: usize, fine: &[u8]| -> Vec<u8> {
            let at = |x: usize, y: usize| u16::from(fine[y * 2 * n + x]);
            let mean = |i: usize| {
                let (x, y) = (2 * (i % n), 2 * (i / n));
                ((at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1) + 2) / 4) as u8
            };
            (0..n * n).map(mean).collect()
        };
        let second = coarser(LEVELS[1], &full);
        let third = coarser(LEVELS[2], &second);
        let fourth = coarser(LEVELS[3], &third);
        let fifth = coarser(LEVELS[4], &fourth);
        Self {
            finest,
            coarser: [second, third, fourth, fifth],
        }
    }

    /// Of a cell.
    #[inline]
    fn of(&self, level: usize, cell: usize) -> f32 {
        match level {
            0 => (self.finest[cell / 64] >> (cell % 64) & 1) as f32,
            _ => f32::from(self.coarser[level - 1][cell]) / 255.0,
        }
    }
}

/// Solid angle of a cell, steradian: its two spherical triangles, flattened. Cells are small.
fn solid_angle(n: usize, x: usize, y: usize) -> f32 {
    let corner = |dx: usize, dy: usize| {
        direction_from_octahedral(Vec2::new((x + dx) as f32, (y + dy) as f32) / n as f32)
    };
    let (a, b, c, d) = (corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1));
    0.5 * ((b - a).cross(c - a).length() + (c - a).cross(d - a).length())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::PI;

    /// A wall z ∈ [−50, 50], y ∈ [0, h] at x = 1, seen from the ground at the origin.
    fn wall(height: f32) -> (Accel, SurfaceNormals) {
        let w = 50.0;
        let positions = [
            Vec3::new(1.0, 0.0, -w),
            Vec3::new(1.0, 0.0, w),
            Vec3::new(1.0, height, w),
            Vec3::new(1.0, height, -w),
        ];
        let surface = SurfaceNormals {
            geometric: vec![Vec3::NEG_X; 2],
            corners: vec![[Vec3::NEG_X; 3]; 2],
        };
        (Accel::build(&positions, &[[0, 1, 2], [0, 2, 3]]), surface)
    }

    #[test]
    fn cells_cover_the_sphere() {
        let sum: f32 = (0..COARSE * COARSE)
            .map(|i| solid_angle(COARSE, i % COARSE, i / COARSE))
            .sum();
        assert!((sum / (4.0 * PI) - 1.0).abs() < 3e-3);
    }

    #[test]
    fn an_empty_scene_is_open() {
        let accel = Accel::build(&[], &[]);
        assert!(matches!(
            Visibility::trace(&accel, &SurfaceNormals::default(), Vec3::ZERO, Vec3::Y).0,
            Visibility::Open
        ));
    }

    #[test]
    fn a_wall_blocks_its_view_factor() {
        // Form factor of an infinite wall from a differential area at its foot: the blocked share
        // of the cosine-weighted hemisphere is (1 − cos φ)/2 with φ the wall's elevation.
        for height in [0.5f32, 1.0, 3.0] {
            let (accel, surface) = wall(height);
            let (visibility, _) = Visibility::trace(&accel, &surface, Vec3::ZERO, Vec3::Y);
            let elevation = height.atan();
            let expected = 0.5 * (1.0 - elevation.cos());
            let n = 400;
            let mut blocked = 0.0;
            for i in 0..n {
                for j in 0..n {
                    let u = Vec2::new((i as f32 + 0.5) / n as f32, (j as f32 + 0.5) / n as f32);
                    let local = crate::sampling::cosine_hemisphere(u).0;
                    let direction = Vec3::new(local.x, local.z, local.y);
                    blocked += (1.0 - visibility.open(direction, 0.0)) / (n * n) as f32;
                }
            }
            assert!(
                (blocked - expected).abs() < 4e-3,
                "{height}: {blocked} {expected}"
            );
        }
    }

    #[test]
    fn what_hardly_rises_above_the_horizon_blocks_nothing() {
        // Elevations of 1.1° and 8.5°, below and above a coarse cell: shares of 1e-4 and 5.5e-3.
        for (height, is_open) in [(0.02, true), (0.15, false)] {
            let (accel, surface) = wall(height);
            let (visibility, _) = Visibility::trace(&accel, &surface, Vec3::ZERO, Vec3::Y);
            assert_eq!(matches!(visibility, Visibility::Open), is_open, "{height}");
        }
    }

    #[test]
    fn blocked_patches_add_up_to_what_is_not_open() {
        let (accel, surface) = wall(1.0);
        let (visibility, _) = Visibility::trace(&accel, &surface, Vec3::ZERO, Vec3::Y);
        let patches: f32 = visibility
            .blocked()
            .iter()
            .map(|p| p.solid_angle * p.direction.y.max(0.0))
            .sum();
        let expected = PI * 0.5 * (1.0 - (0.25 * PI).cos());
        assert!(
            (patches / expected - 1.0).abs() < 0.05,
            "{patches} {expected}"
        );
    }
}
