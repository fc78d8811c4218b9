//! Surface points: where on a mesh materials are measured, and which points neighbour which.

use glam::{Vec2, Vec3};

use super::texels::texel_points;
use super::{Mesh, MeshError, TexelGrid, seams, topology};

/// A point of the surface at which a material is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Mesh frame.
    pub position: Vec3,
    /// Unit shading normal.
    pub normal: Vec3,
    /// The triangle it lies on.
    pub triangle: u32,
    /// `(b1, b2)` in that triangle.
    pub barycentric: Vec2,
    /// Texture coordinate, (0, 0) at the top left of the image.
    pub uv: Option<Vec2>,
}

/// The points to be measured, and which of them stands for a place on the surface.
#[derive(Clone, Debug)]
pub struct PointSet {
    /// `[N]` in the order in which results are given.
    pub points: Vec<SurfacePoint>,
    /// Where the points stand in texture space, if they are texels.
    pub grid: Option<TexelGrid>,
    /// `[triangles]` the points nearest to each triangle's corners.
    pub of_triangle: Vec<[u32; 3]>,
}

impl PointSet {
    /// The mesh's vertices.
    pub fn vertices(mesh: &Mesh) -> Self {
        Self {
            points: vertex_points(mesh),
            grid: None,
            of_triangle: mesh.triangles.clone(),
        }
    }

    /// The texel centres of a square map that the texture layout covers.
    ///
    /// # Errors
    ///
    /// If the mesh has no texture coordinates, or `resolution` is 0 or above 16384.
    pub fn texels(mesh: &Mesh, resolution: u32) -> Result<Self, MeshError> {
        let (points, mut grid) = texel_points(mesh, resolution)?;
        let of_triangle = nearest_points(mesh, &points);
        if !points.is_empty() {
            grid.find_strays(mesh, &of_triangle);
        }
        Ok(Self {
            of_triangle,
            points,
            grid: Some(grid),
        })
    }

    /// `[N]` the points beside each: over the mesh's edges, or the texels' sides and the seams of the
    /// texture layout.
    pub fn neighbours(&self, mesh: &Mesh) -> Vec<Vec<u32>> {
        match &self.grid {
            None => {
                // All vertices at a position, under the first of them.
                let neighbours = neighbours(mesh);
                let mut together = vec![Vec::new(); self.points.len()];
                for (vertex, first) in (0..).zip(&neighbours.weld) {
                    together[*first as usize].push(vertex);
                }
                let beside = |vertex: u32| {
                    let first = neighbours.weld[vertex as usize];
                    let positions = [first]
                        .into_iter()
                        .chain(neighbours.of(vertex).iter().copied());
                    let all = positions.flat_map(|position| together[position as usize].iter());
                    all.copied().filter(|&other| other != vertex).collect()
                };
                (0..self.points.len() as u32).map(beside).collect()
            }
            Some(grid) => {
                let mut beside: Vec<Vec<u32>> =
                    (0..grid.texels.len()).map(|i| grid.beside(i)).collect();
                for (a, b) in seams::facing(mesh, grid) {
                    for (from, to) in [(a, b), (b, a)] {
                        let others = &mut beside[from as usize];
                        if !others.contains(&to) {
                            others.push(to);
                        }
                    }
                }
                beside
            }
        }
    }

    /// The point that stands for a place on the surface: the nearest corner of its triangle, or the
    /// texel it lies in, if that is one of the points.
    pub fn nearest(&self, mesh: &Mesh, triangle: u32, barycentric: Vec2) -> Option<u32> {
        match &self.grid {
            None => {
                let place = mesh.position_at(triangle, barycentric);
                let distance = |vertex: &u32| mesh.positions[*vertex as usize].distance(place);
                let corners = self.of_triangle[triangle as usize];
                corners
                    .into_iter()
                    .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            }
            Some(grid) => grid.point_at(mesh.uv_at(triangle, barycentric)?),
        }
    }
}

/// One point a vertex, in the vertices' order.
///
/// The triangle is the first that uses the vertex; a loaded mesh has one for every vertex. The
/// normal is the vertex's own, also on a flat mesh.
fn vertex_points(mesh: &Mesh) -> Vec<SurfacePoint> {
    let mut place = vec![(0, Vec2::ZERO); mesh.positions.len()];
    for (triangle, corners) in mesh.triangles.iter().enumerate().rev() {
        for (vertex, barycentric) in corners.iter().zip([Vec2::ZERO, Vec2::X, Vec2::Y]) {
            place[*vertex as usize] = (triangle as u32, barycentric);
        }
    }
    place
        .into_iter()
        .enumerate()
        .map(|(vertex, (triangle, barycentric))| SurfacePoint {
            position: mesh.positions[vertex],
            normal: mesh.normals[vertex],
            triangle,
            barycentric,
            uv: mesh.uvs.as_ref().map(|uvs| uvs[vertex]),
        })
        .collect()
}

/// Which vertices edges join, with seams closed.
#[derive(Clone, Debug)]
pub struct Neighbours {
    /// `[V]` the first vertex at the same position; vertices that share it are one point.
    pub weld: Vec<u32>,
    /// `[V + 1]` where each welded vertex's neighbours start.
    starts: Vec<u32>,
    /// All neighbours, one vertex after the other.
    joined: Vec<u32>,
}

impl Neighbours {
    /// The vertices that an edge joins to `vertex` (each the first at its position), ascending.
    #[inline]
    pub fn of(&self, vertex: u32) -> &[u32] {
        let first = self.weld[vertex as usize] as usize;
        &self.joined[self.starts[first] as usize..self.starts[first + 1] as usize]
    }
}

/// The vertex adjacency of a mesh, over vertices welded by position.
pub fn neighbours(mesh: &Mesh) -> Neighbours {
    let weld = topology::weld(&mesh.positions);
    let mut edges: Vec<(u32, u32)> = mesh
        .triangles
        .iter()
        .flat_map(|corners| {
            let [a, b, c] = corners.map(|vertex| weld[vertex as usize]);
            [(a, b), (b, c), (c, a), (b, a), (c, b), (a, c)]
        })
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let mut starts = vec![0u32; mesh.positions.len() + 1];
    for (from, _) in &edges {
        starts[*from as usize + 1] += 1;
    }
    for vertex in 1..starts.len() {
        starts[vertex] += starts[vertex - 1];
    }
    Neighbours {
        weld,
        starts,
        joined: edges.into_iter().map(|(_, to)| to).collect(),
    }
}

/// For each triangle's corners, the nearest of `points`: `[T]`, indices into `points`.
///
/// A corner looks among the points on the triangles around it; corners without any take what a
/// neighbour over an edge found. An index stays 0 only where no chart of points reaches.
fn nearest_points(mesh: &Mesh, points: &[SurfacePoint]) -> Vec<[u32; 3]> {
    let neighbours = neighbours(mesh);
    let weld = |vertex: u32| neighbours.weld[vertex as usize] as usize;
    let mut nearest: Vec<Option<(f32, u32)>> = vec![None; mesh.positions.len()];
    for (index, point) in points.iter().enumerate() {
        for vertex in mesh.triangles[point.triangle as usize] {
            let distance = mesh.positions[vertex as usize].distance_squared(point.position);
            let best = &mut nearest[weld(vertex)];
            if best.is_none_or(|(known, _)| distance < known) {
                *best = Some((distance, index as u32));
            }
        }
    }
    // Outwards from what is known, a ring of vertices at a time.
    let mut rim: Vec<usize> = (0..nearest.len())
        .filter(|&v| nearest[v].is_some())
        .collect();
    while !rim.is_empty() {
        let mut next = Vec::new();
        for vertex in rim {
            let found = nearest[vertex];
            for &other in neighbours.of(vertex as u32) {
                if nearest[other as usize].is_none() {
                    nearest[other as usize] = found;
                    next.push(other as usize);
                }
            }
        }
        rim = next;
    }
    let at = |vertex: u32| nearest[weld(vertex)].map_or(0, |(_, index)| index);
    mesh.triangles
        .iter()
        .map(|corners| corners.map(at))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::sphere;
    use super::*;

    #[test]
    fn vertex_points_are_the_vertices() {
        let mesh = sphere(4).into_mesh().unwrap();
        let points = vertex_points(&mesh);
        assert_eq!(points.len(), mesh.positions.len());
        for (vertex, point) in points.iter().enumerate() {
            assert_eq!(
                mesh.position_at(point.triangle, point.barycentric),
                mesh.positions[vertex]
            );
            assert_eq!(point.normal, mesh.normals[vertex]);
            assert_eq!(point.uv, mesh.uv_at(point.triangle, point.barycentric));
        }
    }

    #[test]
    fn the_nearest_point_of_a_vertex_is_itself() {
        let mesh = sphere(4).into_mesh().unwrap();
        let points = vertex_points(&mesh);
        for (corners, nearest) in mesh.triangles.iter().zip(nearest_points(&mesh, &points)) {
            for (vertex, point) in corners.iter().zip(nearest) {
                let there = points[point as usize].position;
                assert_eq!(there, mesh.positions[*vertex as usize]);
            }
        }
        // From a single point, every corner is reached.
        let one = nearest_points(&mesh, &points[7..8]);
        assert!(one.iter().flatten().all(|&i| i == 0));
    }

    #[test]
    fn neighbours_close_the_seam_and_are_mutual() {
        let mesh = sphere(4).into_mesh().unwrap();
        let neighbours = neighbours(&mesh);
        let mut edges = 0;
        for vertex in 0..mesh.positions.len() as u32 {
            let around = neighbours.of(vertex);
            assert!(
                around.len() == 4 || around.len() == 6,
                "the octahedron's corners have four"
            );
            for &other in around {
                assert_eq!(neighbours.weld[other as usize], other);
                assert!(
                    neighbours
                        .of(other)
                        .contains(&neighbours.weld[vertex as usize])
                );
            }
            edges += if neighbours.weld[vertex as usize] == vertex {
                around.len()
            } else {
                0
            };
        }
        // Every edge of a closed surface is shared by two triangles.
        assert_eq!(edges, 3 * mesh.triangles.len());
    }
}
