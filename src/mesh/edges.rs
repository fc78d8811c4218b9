//! Edges between triangles, for outlines: an edge is on the outline where the surface turns away.

use super::{Mesh, topology};

/// An edge, and the triangles that meet there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Its ends: vertices of the first triangle.
    pub vertices: [u32; 2],
    /// The first triangle.
    pub triangle: u32,
    /// The triangle on the other side; `None` on the rim of an open surface.
    pub other: Option<u32>,
}

impl Mesh {
    /// All edges, by position: vertices at one place count as one, so that seams of texture or normals
    /// are no rims. Where more than two triangles meet, each consecutive pair makes an edge.
    pub fn edges(&self) -> Vec<Edge> {
        let weld = topology::weld(&self.positions);
        let sides = topology::half_edges(&self.triangles, &weld);
        let mut edges = Vec::with_capacity(sides.len() / 2);
        for shared in sides.chunk_by(|a, b| a.edge == b.edge) {
            let ends = |side: &topology::HalfEdge| {
                let corners = self.triangles[side.triangle as usize];
                let [a, b, c] = corners.map(|v| u64::from(weld[v as usize]));
                let joins = |p: u64, q: u64| p.min(q) << 32 | p.max(q) == side.edge;
                if joins(a, b) {
                    [corners[0], corners[1]]
                } else if joins(b, c) {
                    [corners[1], corners[2]]
                } else {
                    [corners[2], corners[0]]
                }
            };
            let edge = |first: &topology::HalfEdge, other: Option<&topology::HalfEdge>| Edge {
                vertices: ends(first),
                triangle: first.triangle,
                other: other.map(|side| side.triangle),
            };
            match shared {
                [alone] => edges.push(edge(alone, None)),
                several => edges.extend(several.windows(2).map(|two| edge(&two[0], Some(&two[1])))),
            }
        }
        edges
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Similarity;
    use crate::mesh::{LoadOptions, cup};
    use std::path::Path;

    #[test]
    fn seams_of_a_closed_mesh_are_no_rims() {
        let (mesh, _) = Mesh::from_surface(
            cup(),
            &Similarity::default(),
            LoadOptions::default(),
            Path::new("cup"),
        )
        .unwrap();
        let edges = mesh.edges();
        assert!(edges.iter().all(|edge| edge.other.is_some()));
        // Every triangle of a closed surface has three edges, each shared by two.
        assert_eq!(2 * edges.len(), 3 * mesh.triangles.len());
        for edge in &edges {
            let corners = mesh.triangles[edge.triangle as usize];
            assert!(edge.vertices.iter().all(|v| corners.contains(v)));
        }
    }
}
