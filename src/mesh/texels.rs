//! Texels: one surface point a texel centre that a chart of the texture layout covers.

use std::f32::consts::FRAC_1_SQRT_2;

use glam::{DVec2, Vec2};

use super::{Mesh, MeshError, SurfacePoint};

const UNCOVERED: u32 = u32::MAX;
const LARGEST_RESOLUTION: u32 = 16_384;

/// Which texel of a square map each point belongs to.
#[derive(Clone, Debug)]
pub struct TexelGrid {
    /// Texels along one side.
    pub resolution: u32,
    /// `[N]` the texel of each point, row by row from the top left; ascending.
    pub texels: Vec<u32>,
    /// Texel centres that a second triangle covers too, as in mirrored or tiled layouts; the first
    /// triangle has them.
    pub overlaps: usize,
    /// Triangles that reach beyond the unit square; nothing outside it is sampled.
    pub outside: usize,
    /// Texels without a point, and none around them, in which triangles have corners all the same, as in
    /// charts smaller than a texel; and the point nearest to such a corner on the surface. Ascending.
    strays: Vec<(u32, u32)>,
}

/// The points at the texel centres that the texture layout covers, in the texels' order.
///
/// A centre on the edge between two triangles of a chart belongs to exactly one of them.
///
/// # Errors
///
/// If the mesh has no texture coordinates, or `resolution` is 0 or above 16384.
pub(super) fn texel_points(
    mesh: &Mesh,
    resolution: u32,
) -> Result<(Vec<SurfacePoint>, TexelGrid), MeshError> {
    let uvs = mesh.uvs.as_ref().ok_or(MeshError::NoTextureCoordinates)?;
    if !(1..=LARGEST_RESOLUTION).contains(&resolution) {
        return Err(MeshError::Resolution { resolution });
    }

    // Give each texel to the first triangle that covers its centre.
    let side = resolution as usize;
    let mut owner = vec![UNCOVERED; side * side];
    let (mut overlaps, mut outside) = (0, 0);
    for (corners, triangle) in mesh.triangles.iter().zip(0u32..) {
        let chart = corners.map(|v| uvs[v as usize].as_dvec2() * f64::from(resolution));
        let unit = |p: DVec2| p.cmpge(DVec2::ZERO).all() && p.max_element() <= resolution.into();
        outside += usize::from(!chart.into_iter().all(unit));
        for_each_centre(chart, resolution, |x, y| {
            let texel = &mut owner[y as usize * side + x as usize];
            if *texel == UNCOVERED {
                *texel = triangle;
            } else {
                overlaps += 1;
            }
        });
    }

    // Lift the covered centres onto the surface.
    let mut points = Vec::new();
    let mut texels = Vec::new();
    for (texel, &triangle) in (0u32..)
        .zip(&owner)
        .filter(|(_, owner)| **owner != UNCOVERED)
    {
        let centre = DVec2::new(f64::from(texel % resolution), f64::from(texel / resolution)) + 0.5;
        let uv = centre / f64::from(resolution);
        let [a, b, c] = mesh.triangles[triangle as usize].map(|v| uvs[v as usize].as_dvec2());
        let area = (b - a).perp_dot(c - a);
        let barycentric = DVec2::new((uv - a).perp_dot(c - a), (b - a).perp_dot(uv - a)) / area;
        let barycentric = barycentric.clamp(DVec2::ZERO, DVec2::ONE).as_vec2();
        texels.push(texel);
        points.push(SurfacePoint {
            position: mesh.position_at(triangle, barycentric),
            normal: mesh.normal_at(triangle, barycentric),
            triangle,
            barycentric,
            uv: Some(uv.as_vec2()),
        });
    }
    Ok((
        points,
        TexelGrid {
            resolution,
            texels,
            overlaps,
            outside,
            strays: Vec::new(),
        },
    ))
}

/// Calls `visit(x, y)` for the texels whose centre lies in `chart` (corners in texels).
fn for_each_centre(chart: [DVec2; 3], resolution: u32, mut visit: impl FnMut(u32, u32)) {
    let [a, b, c] = chart;
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    // Counter-clockwise, so that the inside is on the left of every side.
    let sides = if area > 0.0 {
        [(a, b), (b, c), (c, a)]
    } else {
        [(a, c), (c, b), (b, a)]
    };
    let side = f64::from(resolution);
    // Centres are at half-integers; the range is empty where the chart misses them all.
    let range = |corners: [f64; 3]| {
        let low = corners.into_iter().fold(f64::INFINITY, f64::min);
        let high = corners.into_iter().fold(f64::NEG_INFINITY, f64::max);
        (low - 0.5).ceil().max(0.0) as u32..((high - 0.5).floor() + 1.0).clamp(0.0, side) as u32
    };
    let columns = range([a.x, b.x, c.x]);
    let rows = range([a.y, b.y, c.y]);
    for y in rows {
        for x in columns.clone() {
            let centre = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
            if sides.iter().all(|&(from, to)| is_left_of(centre, from, to)) {
                visit(x, y);
            }
        }
    }
}

/// Whether `point` is to the left of the side, or on it and the side is one of the two kinds
/// (rightward, or level and upward) that keep their points.
///
/// The two triangles at an edge run along it in opposite ways; ordering its ends first makes their
/// products exactly opposite, so that rounding can neither lose a centre nor give it twice.
fn is_left_of(point: DVec2, from: DVec2, to: DVec2) -> bool {
    let forward = (from.x, from.y) < (to.x, to.y);
    let (low, high) = if forward { (from, to) } else { (to, from) };
    let product = (high - low).perp_dot(point - low);
    if product == 0.0 {
        forward
    } else {
        (product > 0.0) == forward
    }
}

impl TexelGrid {
    /// The point whose texel holds a texture coordinate, if that texel is one of the points.
    pub fn point_at(&self, uv: Vec2) -> Option<u32> {
        let side = self.resolution as f32;
        let (x, y) = ((uv.x * side).floor(), (uv.y * side).floor());
        if !(x >= 0.0 && y >= 0.0 && x < side && y < side) {
            return None;
        }
        let texel = y as u32 * self.resolution + x as u32;
        self.texels.binary_search(&texel).ok().map(|i| i as u32)
    }

    /// Finds `strays`; `of_triangle` holds the points nearest to each triangle's corners.
    pub(super) fn find_strays(&mut self, mesh: &Mesh, of_triangle: &[[u32; 3]]) {
        let Some(uvs) = &mesh.uvs else { return };
        let side = self.resolution as usize;
        let has_point = |texel: usize| self.texels.binary_search(&(texel as u32)).is_ok();
        let mut strays = Vec::new();
        for (corners, nearest) in mesh.triangles.iter().zip(of_triangle) {
            for (vertex, point) in corners.iter().zip(nearest) {
                let place = (uvs[*vertex as usize] * side as f32).floor();
                let inside = place.cmpge(Vec2::ZERO).all() && place.max_element() < side as f32;
                let texel = place.y as usize * side + place.x as usize;
                let alone = |texel| {
                    !has_point(texel) && around(texel, side).all(|(other, _)| !has_point(other))
                };
                if inside && alone(texel) {
                    strays.push((texel as u32, *point));
                }
            }
        }
        strays.sort_unstable();
        strays.dedup_by_key(|(texel, _)| *texel);
        self.strays = strays;
    }

    /// The points of the texels that share a side with point `i`'s.
    pub(super) fn beside(&self, i: usize) -> Vec<u32> {
        let side = i64::from(self.resolution);
        let texel = i64::from(self.texels[i]);
        let (x, y) = (texel % side, texel / side);
        [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)]
            .into_iter()
            .filter(|(x, y)| (0..side).contains(x) && (0..side).contains(y))
            .filter_map(|(x, y)| self.texels.binary_search(&((y * side + x) as u32)).ok())
            .map(|point| point as u32)
            .collect()
    }

    /// A map `[resolution][resolution]` of the points' values, with its seams padded: texels up to
    /// `padding` away from a chart get a mean of its rim; the others get `background`. Charts smaller
    /// than a texel get the value of the nearest point of the surface.
    ///
    /// # Panics
    ///
    /// If there are not as many values as points.
    pub fn map<const C: usize>(
        &self,
        values: &[[f32; C]],
        background: [f32; C],
        padding: u32,
    ) -> Vec<[f32; C]> {
        assert_eq!(values.len(), self.texels.len(), "one value a texel point");
        let side = self.resolution as usize;
        let mut map = vec![background; side * side];
        for (value, &texel) in values.iter().zip(&self.texels) {
            map[texel as usize] = *value;
        }
        for &(texel, point) in &self.strays {
            map[texel as usize] = values[point as usize];
        }
        self.dilate(&mut map, padding);
        map
    }

    /// Grows the charts of a map `[resolution][resolution]` outwards by `padding` texels, so that
    /// bilinear lookups and mipmaps near a seam do not mix in the background.
    fn dilate<const C: usize>(&self, map: &mut [[f32; C]], padding: u32) {
        let side = self.resolution as usize;
        let mut covered = vec![false; map.len()];
        let strays = self.strays.iter().map(|(texel, _)| texel);
        let mut rim: Vec<usize> = (self.texels.iter().chain(strays))
            .map(|&texel| texel as usize)
            .collect();
        rim.iter().for_each(|&texel| covered[texel] = true);
        for _ in 0..padding {
            // The uncovered texels around the rim get means of what was covered before this ring.
            let mut ring: Vec<usize> = rim
                .iter()
                .flat_map(|&texel| around(texel, side))
                .map(|(texel, _)| texel)
                .filter(|&texel| !covered[texel])
                .collect();
            ring.sort_unstable();
            ring.dedup();
            let filled: Vec<[f32; C]> = ring
                .iter()
                .map(|&texel| {
                    let mut weights = 0.0;
                    let mut sum = [0.0; C];
                    for (neighbour, weight) in around(texel, side) {
                        if covered[neighbour] {
                            weights += weight;
                            for (s, value) in sum.iter_mut().zip(map[neighbour]) {
                                *s += weight * value;
                            }
                        }
                    }
                    sum.map(|s| s / weights)
                })
                .collect();
            for (&texel, value) in ring.iter().zip(filled) {
                map[texel] = value;
                covered[texel] = true;
            }
            rim = ring;
        }
    }
}

/// The up to eight texels around one, with weights by inverse distance.
fn around(texel: usize, side: usize) -> impl Iterator<Item = (usize, f32)> {
    let (x, y) = (texel % side, texel / side);
    [-1isize, 0, 1].into_iter().flat_map(move |dy| {
        [-1isize, 0, 1].into_iter().filter_map(move |dx| {
            let (x, y) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
            let weight = if dx != 0 && dy != 0 {
                FRAC_1_SQRT_2
            } else {
                1.0
            };
            let inside = x < side && y < side && (dx, dy) != (0, 0);
            inside.then_some((y * side + x, weight))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::super::{PointSet, Surface, cup, sphere};
    use super::*;
    use glam::{DVec3, Vec2, Vec3};

    /// A square of two triangles whose texture coordinates fill the unit square.
    fn square() -> Mesh {
        let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        Surface {
            positions: corners
                .iter()
                .map(|c| DVec3::new(c.x.into(), 0.0, c.y.into()))
                .collect(),
            uvs: Some(corners.to_vec()),
            triangles: vec![[0, 2, 1], [0, 3, 2]],
            ..Surface::default()
        }
        .into_mesh()
        .unwrap()
    }

    #[test]
    fn texels_of_a_full_square_are_covered_once() {
        // Odd and even resolutions: the diagonal passes through centres or between them.
        for resolution in [1, 2, 7, 64] {
            let (points, grid) = texel_points(&square(), resolution).unwrap();
            assert_eq!(points.len() as u32, resolution * resolution);
            assert_eq!((grid.overlaps, grid.outside), (0, 0));
        }
    }

    #[test]
    fn texel_points_lie_where_their_uv_says() {
        let mesh = square();
        let (points, grid) = texel_points(&mesh, 8).unwrap();
        for (point, texel) in points.iter().zip(&grid.texels) {
            let uv = Vec2::new((texel % 8) as f32 + 0.5, (texel / 8) as f32 + 0.5) / 8.0;
            assert!(point.uv.unwrap().distance(uv) < 1e-6);
            assert!(
                mesh.uv_at(point.triangle, point.barycentric)
                    .unwrap()
                    .distance(uv)
                    < 1e-6
            );
            let expected = Vec3::new(2.0 * uv.x - 1.0, 0.0, 2.0 * uv.y - 1.0);
            assert!(point.position.distance(expected) < 1e-5);
            assert_eq!(point.normal, Vec3::Y);
        }
    }

    #[test]
    fn texels_of_the_sphere_sit_at_their_latitude_and_longitude() {
        use crate::geometry::direction_from_latlong;
        let mesh = sphere(25).into_mesh().unwrap();
        let (points, grid) = texel_points(&mesh, 128).unwrap();
        assert_eq!((grid.overlaps, grid.outside), (0, 0));
        // The polar triangles are wedges in the map, and leave notches of half a row.
        assert!(points.len() > 128 * 128 * 97 / 100, "{}", points.len());
        for point in &points {
            let direction = direction_from_latlong(point.uv.unwrap());
            let tolerance = if direction.y.abs() > 0.9 { 0.06 } else { 5e-3 };
            assert!(point.normal.distance(direction) < tolerance, "{point:?}");
        }
    }

    #[test]
    fn charts_of_the_cup_do_not_overlap() {
        let (points, grid) = texel_points(&cup().into_mesh().unwrap(), 256).unwrap();
        assert_eq!((grid.overlaps, grid.outside), (0, 0));
        assert!(points.len() > 256 * 256 * 8 / 10);
    }

    #[test]
    fn overlaps_and_tiles_are_counted() {
        let mut mesh = square();
        let uvs = mesh.uvs.as_mut().unwrap();
        uvs[1].x = 1.5;
        uvs[3] = Vec2::new(1.0, 0.25);
        let (points, grid) = texel_points(&mesh, 16).unwrap();
        assert!(grid.overlaps > 0 && grid.outside == 1);
        assert!(points.iter().all(|p| p.uv.unwrap().max_element() < 1.0));
    }

    #[test]
    fn texels_need_uvs_and_a_resolution() {
        let mut mesh = square();
        assert!(matches!(
            texel_points(&mesh, 0),
            Err(MeshError::Resolution { resolution: 0 })
        ));
        mesh.uvs = None;
        assert!(matches!(
            texel_points(&mesh, 4),
            Err(MeshError::NoTextureCoordinates)
        ));
    }

    #[test]
    fn charts_smaller_than_a_texel_take_the_value_beside_them_on_the_surface() {
        // Two triangles with a common edge, one of them shrunk into a corner of a far texel.
        let mut mesh = square();
        let [a, b, c] = mesh.triangles[1];
        mesh.triangles[1] = [a, b, c].map(|vertex| vertex + 4);
        let copies = |values: &mut Vec<Vec3>| values.extend_from_within(..);
        copies(&mut mesh.positions);
        copies(&mut mesh.normals);
        let far = Vec2::new(0.97, 0.03);
        let uvs = mesh.uvs.as_mut().unwrap();
        uvs.iter_mut()
            .for_each(|uv| *uv = Vec2::new(0.0, 0.5) + 0.5 * *uv);
        let small: Vec<Vec2> = uvs.iter().map(|uv| far + 0.01 * *uv).collect();
        uvs.extend(small);
        let set = PointSet::texels(&mesh, 16).unwrap();
        let grid = set.grid.as_ref().unwrap();
        assert!(
            grid.texels.iter().all(|texel| texel / 16 >= 8),
            "the small one has none"
        );
        let values: Vec<[f32; 1]> = set.points.iter().map(|p| [2.0 + p.position.x]).collect();
        let map = grid.map(&values, [0.0], 2);
        let found = map[15][0];
        assert!((1.0..=3.0).contains(&found), "{found}");
    }

    #[test]
    fn dilation_grows_charts_and_leaves_them_alone() {
        let mut mesh = square();
        mesh.uvs
            .iter_mut()
            .flatten()
            .for_each(|uv| *uv = Vec2::splat(0.25) + 0.5 * *uv);
        let (points, grid) = texel_points(&mesh, 16).unwrap();
        assert_eq!(points.len(), 64);
        let values = vec![[3.0, 5.0]; points.len()];
        let map = grid.map(&values, [0.0, -1.0], 2);
        let kept = |value: [f32; 2]| map.iter().filter(|v| **v == value).count();
        let grown = |v: &&[f32; 2]| (v[0] - 3.0).abs() < 1e-6 && (v[1] - 5.0).abs() < 1e-6;
        assert_eq!(map.iter().filter(grown).count(), 12 * 12);
        assert_eq!(kept([0.0, -1.0]), 256 - 144);
        assert!(
            grid.texels
                .iter()
                .all(|&texel| map[texel as usize] == [3.0, 5.0])
        );
    }
}
