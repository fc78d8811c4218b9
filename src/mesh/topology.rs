//! How triangles hang together: welded vertices, edges, orientation, connected pieces.

use std::collections::HashMap;

use glam::{DVec3, Vec3};
use rayon::slice::ParallelSliceMut;

use super::MeshReport;

/// Volumes within this of zero (mesh units cubed; the frame's box holds 8) have no sign: a closed
/// sheet of no thickness reaches 1e-7 by rounding alone.
const SMALLEST_VOLUME: f64 = 1e-6;

/// For every vertex, the first vertex at exactly the same position.
pub(super) fn weld(positions: &[Vec3]) -> Vec<u32> {
    let mut first_at = HashMap::with_capacity(positions.len());
    positions
        .iter()
        .zip(0u32..)
        .map(|(position, vertex)| {
            // Adding zero makes −0 equal to 0.
            let bits = (*position + Vec3::ZERO).to_array().map(f32::to_bits);
            *first_at.entry(bits).or_insert(vertex)
        })
        .collect()
}

/// One side of a triangle, as an edge between welded vertices.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct HalfEdge {
    /// Smaller vertex in the high half, larger in the low half.
    pub(super) edge: u64,
    pub(super) triangle: u32,
    /// Whether the triangle runs from the smaller vertex to the larger.
    ascending: bool,
}

/// All sides of all triangles, sorted by edge.
pub(super) fn half_edges(triangles: &[[u32; 3]], weld: &[u32]) -> Vec<HalfEdge> {
    let mut sides: Vec<HalfEdge> = triangles
        .iter()
        .zip(0u32..)
        .flat_map(|(corners, triangle)| {
            let [a, b, c] = corners.map(|v| weld[v as usize]);
            [(a, b), (b, c), (c, a)].map(|(from, to)| HalfEdge {
                edge: (u64::from(from.min(to)) << 32) | u64::from(from.max(to)),
                triangle,
                ascending: from < to,
            })
        })
        .collect();
    sides.par_sort_unstable();
    sides
}

/// Disjoint sets whose members know their parity relative to the set's root.
struct ParitySets {
    parent: Vec<u32>,
    /// Whether a member differs from its parent.
    differs: Vec<bool>,
}

impl ParitySets {
    fn new(members: usize) -> Self {
        Self {
            parent: (0..members as u32).collect(),
            differs: vec![false; members],
        }
    }

    /// The root of `member` and whether `member` differs from it.
    fn find(&mut self, member: u32) -> (u32, bool) {
        let (mut root, mut differs) = (member, false);
        while self.parent[root as usize] != root {
            differs ^= self.differs[root as usize];
            root = self.parent[root as usize];
        }
        // Hang the whole path under the root.
        let (mut node, mut node_differs) = (member, differs);
        while self.parent[node as usize] != root && node != root {
            let next = self.parent[node as usize];
            let next_differs = node_differs ^ self.differs[node as usize];
            self.parent[node as usize] = root;
            self.differs[node as usize] = node_differs;
            (node, node_differs) = (next, next_differs);
        }
        (root, differs)
    }

    /// Joins the sets of `a` and `b`, which differ or not; a contradiction changes nothing.
    fn join(&mut self, a: u32, b: u32, differ: bool) {
        let (root_a, a_differs) = self.find(a);
        let (root_b, b_differs) = self.find(b);
        if root_a != root_b {
            let (low, high) = (root_a.min(root_b), root_a.max(root_b));
            self.parent[high as usize] = low;
            self.differs[high as usize] = a_differs ^ b_differs ^ differ;
        }
    }
}

/// Makes neighbouring triangles agree and closed meshes look outwards; counts edges and pieces.
/// Returns whether the surface encloses a volume.
pub(super) fn orient(
    triangles: &mut [[u32; 3]],
    positions: &[Vec3],
    weld: &[u32],
    report: &mut MeshReport,
) -> bool {
    // Edges: one triangle is a rim, more than two are a fin, two that run the same way contradict.
    let mut sides = half_edges(triangles, weld);
    let mut patches = ParitySets::new(triangles.len());
    for shared in sides.chunk_by(|a, b| a.edge == b.edge) {
        match shared {
            [_] => report.boundary_edges += 1,
            [a, b] => {
                let contradict = a.ascending == b.ascending;
                report.inconsistent_edges += usize::from(contradict);
                patches.join(a.triangle, b.triangle, contradict);
            }
            _ => report.non_manifold_edges += 1,
        }
    }

    // Within each patch the side that covers the smaller area turns over.
    if report.inconsistent_edges > 0 {
        report.reoriented_triangles = turn_minorities(triangles, positions, &mut patches);
        sides = half_edges(triangles, weld);
    }

    // Pieces hang together by edges, fins included.
    let mut pieces = ParitySets::new(triangles.len());
    let mut open_at = Vec::new();
    for shared in sides.chunk_by(|a, b| a.edge == b.edge) {
        for pair in shared.windows(2) {
            pieces.join(pair[0].triangle, pair[1].triangle, false);
        }
        let ascending = shared.iter().filter(|side| side.ascending).count();
        if 2 * ascending != shared.len() {
            open_at.push(shared[0].triangle);
        }
    }
    let mut open = vec![false; triangles.len()];
    for triangle in open_at.iter() {
        open[pieces.find(*triangle).0 as usize] = true;
    }
    let mut volumes = vec![0.0; triangles.len()];
    for (corners, triangle) in triangles.iter().zip(0u32..) {
        let root = pieces.find(triangle).0;
        report.components += usize::from(root == triangle);
        let [a, b, c] = corners.map(|v| positions[v as usize].as_dvec3());
        volumes[root as usize] += a.dot(b.cross(c)) / 6.0;
    }

    // A closed mesh of negative volume is inside out.
    let closed = open_at.is_empty();
    if closed && volumes.iter().sum::<f64>() < -SMALLEST_VOLUME {
        report.inverted = 1;
        turn_over(triangles);
        volumes.iter_mut().for_each(|volume| *volume = -*volume);
    }
    report.inward_components = volumes
        .iter()
        .zip(&open)
        .filter(|(volume, open)| **volume < -SMALLEST_VOLUME && !**open)
        .count();
    closed
}

/// Reverses the orientation of every triangle.
pub(super) fn turn_over(triangles: &mut [[u32; 3]]) {
    triangles
        .iter_mut()
        .for_each(|triangle| triangle.swap(1, 2));
}

fn turn_minorities(
    triangles: &mut [[u32; 3]],
    positions: &[Vec3],
    patches: &mut ParitySets,
) -> usize {
    let area = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|v| positions[v as usize].as_dvec3());
        DVec3::length((b - a).cross(c - a))
    };
    let mut balance = vec![0.0; triangles.len()];
    for (corners, triangle) in triangles.iter().zip(0u32..) {
        let (root, differs) = patches.find(triangle);
        balance[root as usize] += if differs {
            -area(corners)
        } else {
            area(corners)
        };
    }
    let mut turned = 0;
    for (corners, triangle) in triangles.iter_mut().zip(0u32..) {
        let (root, differs) = patches.find(triangle);
        if differs == (balance[root as usize] >= 0.0) {
            corners.swap(1, 2);
            turned += 1;
        }
    }
    turned
}
