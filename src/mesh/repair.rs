//! Dropping what no ray can use: triangles without area, repeated triangles, stray vertices.

use glam::DVec3;

/// Height over longest side under which a triangle counts as having no area.
///
/// It is about one f32 rounding: below it the corners' own rounding decides where the normal points.
/// Above it, thin but usable triangles would be lost and holes opened.
const SMALLEST_HEIGHT: f64 = 1e-7;

/// Keeps the triangles that satisfy `keep`; returns how many went.
pub(super) fn retain(
    triangles: &mut Vec<[u32; 3]>,
    mut keep: impl FnMut(&[u32; 3]) -> bool,
) -> usize {
    let before = triangles.len();
    triangles.retain(|triangle| keep(triangle));
    before - triangles.len()
}

/// Drops triangles that are a point or a line; returns how many.
pub(super) fn drop_zero_area(triangles: &mut Vec<[u32; 3]>, positions: &[DVec3]) -> usize {
    retain(triangles, |triangle| {
        let [a, b, c] = triangle.map(|v| positions[v as usize]);
        let sides = [b - a, c - b, a - c];
        // Measured in units of the longest side, so that no square under- or overflows.
        let longest = sides
            .iter()
            .map(|s| s.abs().max_element())
            .fold(0.0, f64::max);
        let inverse = longest.recip();
        inverse.is_finite()
            && (sides[0] * inverse).cross(sides[2] * inverse).length() > SMALLEST_HEIGHT
    })
}

/// Drops triangles whose (welded) corners and side repeat an earlier one; returns how many.
///
/// A triangle on the same corners that looks the other way is the back of a sheet, and stays.
pub(super) fn drop_duplicates(triangles: &mut Vec<[u32; 3]>, weld: &[u32]) -> usize {
    // Rotating the smallest index to the front keeps the orientation.
    let mut order: Vec<([u32; 3], u32)> = triangles
        .iter()
        .zip(0u32..)
        .map(|(triangle, position)| {
            let [a, b, c] = triangle.map(|v| weld[v as usize]);
            let rotated = [[a, b, c], [b, c, a], [c, a, b]];
            (rotated.into_iter().min().unwrap_or([a, b, c]), position)
        })
        .collect();
    order.sort_unstable();
    let mut repeated = vec![false; triangles.len()];
    for pair in order.windows(2) {
        if pair[0].0 == pair[1].0 {
            repeated[pair[1].1 as usize] = true;
        }
    }
    let mut repeated = repeated.into_iter();
    retain(triangles, |_| !repeated.next().unwrap_or(false))
}

/// How many of `vertices` vertices no triangle uses.
pub(super) fn count_unreferenced(vertices: usize, triangles: &[[u32; 3]]) -> usize {
    let mut used = vec![false; vertices];
    for &vertex in triangles.as_flattened() {
        used[vertex as usize] = true;
    }
    used.into_iter().filter(|&used| !used).count()
}

/// Numbers the used vertices anew, in their old order; returns the old number of each.
pub(super) fn renumber(triangles: &mut [[u32; 3]], vertices: usize) -> Vec<u32> {
    let mut used = vec![false; vertices];
    for &vertex in triangles.as_flattened() {
        used[vertex as usize] = true;
    }
    let mut kept = Vec::new();
    let mut new_number = vec![0u32; vertices];
    for (old, _) in (0u32..).zip(&used).filter(|(_, used)| **used) {
        new_number[old as usize] = kept.len() as u32;
        kept.push(old);
    }
    for vertex in triangles.as_flattened_mut() {
        *vertex = new_number[*vertex as usize];
    }
    kept
}

/// The values of the kept vertices.
pub(super) fn gather<T: Copy>(values: &[T], kept: &[u32]) -> Vec<T> {
    kept.iter().map(|&vertex| values[vertex as usize]).collect()
}
