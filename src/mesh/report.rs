//! What loading found and mended.

use std::fmt::{self, Display, Formatter};

/// What was found in a mesh file and what was done about it. All numbers are counts.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MeshReport {
    /// Faces of four or more corners, split into fans of triangles.
    pub polygons_split: usize,
    /// Faces of fewer than three corners, dropped.
    pub short_faces: usize,
    /// Vertices with a NaN or infinite coordinate.
    pub non_finite_vertices: usize,
    /// Triangles that use such a vertex, dropped.
    pub non_finite_triangles: usize,
    /// Triangles without area in single precision, dropped.
    pub zero_area_triangles: usize,
    /// Triangles that repeat another (same corners, same side), dropped.
    pub duplicate_triangles: usize,
    /// Vertices that no face uses, dropped.
    pub unreferenced_vertices: usize,
    /// Edges at which the surface ends.
    pub boundary_edges: usize,
    /// Edges shared by three or more triangles.
    pub non_manifold_edges: usize,
    /// Edges between two triangles of opposite orientation, as the file has them.
    pub inconsistent_edges: usize,
    /// Triangles turned over so that neighbours agree.
    pub reoriented_triangles: usize,
    /// Closed meshes whose faces all looked inwards (negative volume), turned over whole.
    pub inverted: usize,
    /// Open meshes whose faces contradicted the file's normals, turned over whole.
    pub turned_to_normals: usize,
    /// Closed components of negative volume that were left: cavities, or parts modelled inside out.
    pub inward_components: usize,
    /// Connected pieces.
    pub components: usize,
    /// Normals taken from the file.
    pub normals_taken: usize,
    /// Normals computed because the file has none.
    pub normals_computed: usize,
    /// Normals of the file that looked into the surface throughout, turned over.
    pub normals_flipped: usize,
    /// Normals of the file that were zero, NaN or looked into the surface, replaced.
    pub normals_repaired: usize,
    /// Vertices without a finite texture coordinate; if there are any, all are left out.
    pub missing_uvs: usize,
    /// Attribute values that are NaN or infinite, kept as they are.
    pub non_finite_attributes: usize,
}

impl MeshReport {
    /// Whether the surface has no rim and no fin: what a solid object's scan should be.
    pub fn is_closed(&self) -> bool {
        self.boundary_edges == 0 && self.non_manifold_edges == 0
    }

    /// The lines of the report, separated by semicolons.
    pub(super) fn in_one_line(&self) -> String {
        self.to_string().trim_end().replace('\n', "; ")
    }
}

impl Display for MeshReport {
    /// One line per nonzero count.
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let lines = [
            (self.components, "connected pieces"),
            (self.polygons_split, "polygons split into triangles"),
            (
                self.short_faces,
                "faces of fewer than three corners dropped",
            ),
            (
                self.non_finite_vertices,
                "vertices with a NaN or infinite coordinate",
            ),
            (
                self.non_finite_triangles,
                "triangles using a non-finite vertex dropped",
            ),
            (self.zero_area_triangles, "zero-area triangles dropped"),
            (self.duplicate_triangles, "duplicate triangles dropped"),
            (self.unreferenced_vertices, "unreferenced vertices dropped"),
            (self.boundary_edges, "boundary edges: the surface is open"),
            (self.non_manifold_edges, "non-manifold edges"),
            (
                self.inconsistent_edges,
                "edges between faces of opposite orientation",
            ),
            (
                self.reoriented_triangles,
                "triangles turned over to agree with their neighbours",
            ),
            (
                self.inverted,
                "closed mesh looked inwards and was turned over whole",
            ),
            (
                self.turned_to_normals,
                "open mesh turned over whole to agree with its normals",
            ),
            (
                self.inward_components,
                "closed pieces of negative volume left (cavities, or inverted)",
            ),
            (self.normals_taken, "normals taken from the file"),
            (self.normals_computed, "normals computed"),
            (
                self.normals_flipped,
                "normals looked inwards and were turned over",
            ),
            (
                self.normals_repaired,
                "zero, NaN or contradictory normals recomputed",
            ),
            (
                self.missing_uvs,
                "vertices without texture coordinate: texture coordinates left out",
            ),
            (
                self.non_finite_attributes,
                "non-finite attribute values kept",
            ),
        ];
        for (count, meaning) in lines.into_iter().filter(|(count, _)| *count > 0) {
            writeln!(f, "{count} {meaning}")?;
        }
        Ok(())
    }
}
