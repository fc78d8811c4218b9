//! Directions of the object frame in cells: an octahedral map of 16 × 16.

use glam::{Vec2, Vec3};

use crate::geometry::{direction_from_octahedral, octahedral_from_direction};

/// Cells along the map's side: 12° wide. Finer ones need more rays to learn what blocks them.
pub(super) const SIDE: usize = 16;
/// Cells of the map.
pub(super) const CELLS: usize = SIDE * SIDE;
/// Width of a cell, radians.
pub(super) const CELL_WIDTH: f32 = 0.22;
/// Squared spread of a cell's directions about its middle, radians².
pub(super) const CELL_SPREAD2: f32 = 4.0 * std::f32::consts::PI / CELLS as f32 / 6.0;
/// How far from its middle a cell reaches, as a chord.
pub(super) const CELL_RADIUS: f32 = 0.27;

/// The direction at a place in [0, 1]² of a cell.
#[inline]
pub(super) fn direction_in(cell: usize, within: Vec2) -> Vec3 {
    let corner = Vec2::new((cell % SIDE) as f32, (cell / SIDE) as f32);
    direction_from_octahedral((corner + within) / SIDE as f32)
}

/// The direction in the middle of a cell.
#[inline]
pub(super) fn cell_middle(cell: usize) -> Vec3 {
    direction_in(cell, Vec2::splat(0.5))
}

/// The place in [0, 1]² of a cell at which a direction of it lies.
#[inline]
pub(super) fn place_in(direction: Vec3, cell: usize) -> Vec2 {
    let corner = Vec2::new((cell % SIDE) as f32, (cell / SIDE) as f32);
    octahedral_from_direction(direction) * SIDE as f32 - corner
}

/// The cell that holds a direction.
#[inline]
pub(super) fn cell_of(direction: Vec3) -> usize {
    let place = octahedral_from_direction(direction) * SIDE as f32;
    let index = |x: f32| (x as usize).min(SIDE - 1);
    index(place.y) * SIDE + index(place.x)
}

/// Density, per steradian, of a direction drawn evenly over the square of its cell.
///
/// The square has area (2/SIDE)² on the octahedron |x| + |y| + |z| = 1, whose area element in (x, y)
/// covers |p|^-3 of solid angle.
#[inline]
pub(super) fn density_in_cell(direction: Vec3) -> f32 {
    let p = 1.0 / direction.abs().element_sum();
    CELLS as f32 / 4.0 * (p * p * p)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_reach_no_farther_than_stated() {
        for cell in 0..CELLS {
            for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                let corner = direction_in(cell, Vec2::new(x, y));
                assert!(
                    (corner - cell_middle(cell)).length() < CELL_RADIUS,
                    "{cell}"
                );
            }
        }
    }

    #[test]
    fn densities_are_those_of_even_squares() {
        // The mean of 1/density over a cell's square is its solid angle; together they are 4π.
        let n = 32;
        let mut solid_angle = 0.0;
        for cell in 0..CELLS {
            for i in 0..n * n {
                let within = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
                let direction = direction_in(cell, within);
                assert_eq!(cell_of(direction), cell);
                solid_angle += f64::from(1.0 / density_in_cell(direction)) / (n * n) as f64;
            }
        }
        assert!((solid_angle / (4.0 * std::f64::consts::PI) - 1.0).abs() < 1e-4);
    }
}
