//! From a file's content to a checked mesh in its own frame.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DVec3, Vec2, Vec3};

use super::error::Fault;
use super::{LoadOptions, Mesh, MeshError, MeshReport, normals, repair, topology};
use crate::geometry::Similarity;

/// Coordinates beyond this count as infinite, so that products of three of them stay finite.
const LARGEST_COORDINATE: f64 = 1e100;

/// The content of a mesh file, in its own coordinates and as faulty as it comes.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// `[V]` vertex positions.
    pub positions: Vec<DVec3>,
    /// `[V]` normals of any length; zero or NaN where the file gives none.
    pub normals: Option<Vec<Vec3>>,
    /// `[V]` texture coordinates, (0, 0) at the top left of the image; NaN where the file gives none.
    pub uvs: Option<Vec<Vec2>>,
    /// `[V]` further vertex properties by name.
    pub attributes: BTreeMap<String, Vec<f32>>,
    /// `[T]` vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// Whether the format has one normal a facet, and so is shaded flat.
    pub flat: bool,
    /// Faces of four or more corners that became several triangles.
    pub polygons_split: usize,
    /// Faces of fewer than three corners that became none.
    pub short_faces: usize,
}

impl Surface {
    /// Adds a face, split into a fan of triangles about its first corner.
    pub(super) fn add_face(&mut self, corners: &[u32]) {
        match corners {
            [a, b, c] => self.triangles.push([*a, *b, *c]),
            [first, rest @ ..] if rest.len() > 2 => {
                self.polygons_split += 1;
                self.triangles
                    .extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
            }
            _ => self.short_faces += 1,
        }
    }

    /// The mesh of a surface made in code, as it stands and smooth.
    ///
    /// # Errors
    ///
    /// As [`Mesh::load`].
    pub fn into_mesh(self) -> Result<Mesh, MeshError> {
        let place = Similarity::default();
        Mesh::from_surface(
            self,
            &place,
            LoadOptions::default(),
            Path::new("generated surface"),
        )
        .map(|(mesh, _)| mesh)
    }
}

impl Mesh {
    /// Checks, repairs and recentres `surface`; `path` names it in errors.
    ///
    /// # Errors
    ///
    /// As [`Mesh::load`].
    pub fn from_surface(
        surface: Surface,
        object_from_file: &Similarity,
        options: LoadOptions,
        path: &Path,
    ) -> Result<(Self, MeshReport), MeshError> {
        check_shape(&surface, object_from_file).map_err(|fault| fault.in_file(path))?;
        let mut report = MeshReport {
            polygons_split: surface.polygons_split,
            short_faces: surface.short_faces,
            unreferenced_vertices: repair::count_unreferenced(
                surface.positions.len(),
                &surface.triangles,
            ),
            ..MeshReport::default()
        };
        let mut triangles = surface.triangles;

        // Place the surface in the object frame, and keep what has finite corners and an area.
        let object_from_file_affine = object_from_file.affine();
        let placed: Vec<DVec3> = surface
            .positions
            .iter()
            .map(|&position| object_from_file_affine.transform_point3(position))
            .collect();
        let finite: Vec<bool> = placed
            .iter()
            .map(|p| p.abs().cmple(DVec3::splat(LARGEST_COORDINATE)).all())
            .collect();
        report.non_finite_vertices = finite.iter().filter(|&&f| !f).count();
        report.non_finite_triangles =
            repair::retain(&mut triangles, |t| t.iter().all(|&v| finite[v as usize]));
        report.zero_area_triangles = repair::drop_zero_area(&mut triangles, &placed);

        // Recentre on the bounding box of what is left, and only then round.
        let Some((origin, scale)) = mesh_frame(&placed, &triangles) else {
            return Err(MeshError::Empty {
                path: path.to_path_buf(),
                report: Box::new(report),
            });
        };
        let positions: Vec<Vec3> = placed
            .iter()
            .map(|&position| ((position - origin) / scale).as_vec3())
            .collect();

        // Rounding may have merged corners. Seams split vertices; topology sees them welded.
        let weld = topology::weld(&positions);
        let rounded: Vec<DVec3> = positions
            .iter()
            .map(|position| position.as_dvec3())
            .collect();
        report.zero_area_triangles += repair::drop_zero_area(&mut triangles, &rounded);
        report.duplicate_triangles = repair::drop_duplicates(&mut triangles, &weld);
        if triangles.is_empty() {
            return Err(MeshError::Empty {
                path: path.to_path_buf(),
                report: Box::new(report),
            });
        }

        let closed = topology::orient(&mut triangles, &positions, &weld, &mut report);
        let file_normals = surface.normals.map(|file_normals| {
            let rotation = object_from_file.rotation.as_quat();
            file_normals
                .into_iter()
                .map(|n| rotation * n)
                .collect::<Vec<_>>()
        });
        let normals = normals::shading_normals(
            &positions,
            &weld,
            &mut triangles,
            file_normals,
            closed,
            &mut report,
        );

        // Leave out the vertices that no triangle uses any more.
        let kept = repair::renumber(&mut triangles, positions.len());
        let mut mesh = Self {
            positions: repair::gather(&positions, &kept),
            normals: repair::gather(&normals, &kept),
            uvs: surface.uvs.map(|uvs| repair::gather(&uvs, &kept)),
            attributes: surface
                .attributes
                .into_iter()
                .map(|(name, values)| (name, repair::gather(&values, &kept)))
                .collect(),
            triangles,
            smooth: !(options.flat || surface.flat),
            origin,
            scale,
        };
        if let Some(uvs) = &mesh.uvs {
            report.missing_uvs = uvs.iter().filter(|uv| !uv.is_finite()).count();
        }
        if report.missing_uvs > 0 {
            mesh.uvs = None;
        }
        report.non_finite_attributes = mesh
            .attributes
            .values()
            .flatten()
            .filter(|value| !value.is_finite())
            .count();
        normals::count_kept(&mut report, mesh.positions.len());
        Ok((mesh, report))
    }
}

/// Array lengths, index ranges and the transform.
fn check_shape(surface: &Surface, object_from_file: &Similarity) -> Result<(), Fault> {
    let vertices = surface.positions.len();
    let lengths = surface
        .attributes
        .iter()
        .map(|(name, values)| (name.as_str(), values.len()));
    let lengths = lengths
        .chain(
            surface
                .normals
                .iter()
                .map(|normals| ("normals", normals.len())),
        )
        .chain(
            surface
                .uvs
                .iter()
                .map(|uvs| ("texture coordinates", uvs.len())),
        );
    for (name, length) in lengths {
        if length != vertices {
            return Err(Fault::new(
                name,
                format!("{length} values for {vertices} vertices"),
            ));
        }
    }
    for (face, triangle) in surface.triangles.iter().enumerate() {
        if let Some(&index) = triangle.iter().find(|&&v| v as usize >= vertices) {
            return Err(Fault::index(face, index, vertices));
        }
    }
    let Similarity {
        scale,
        rotation,
        translation,
    } = *object_from_file;
    if !(scale.is_finite() && scale > 0.0 && rotation.is_normalized() && translation.is_finite()) {
        return Err(Fault::new(
            "object transform",
            format!(
                "scale {scale}, rotation {rotation}, translation {translation}: \
                 scale must be > 0, rotation a unit quaternion and all numbers finite"
            ),
        ));
    }
    Ok(())
}

/// Centre and half the longest side of the bounding box of `triangles`; none without extent.
fn mesh_frame(positions: &[DVec3], triangles: &[[u32; 3]]) -> Option<(DVec3, f64)> {
    let mut low = DVec3::INFINITY;
    let mut high = DVec3::NEG_INFINITY;
    for &vertex in triangles.as_flattened() {
        low = low.min(positions[vertex as usize]);
        high = high.max(positions[vertex as usize]);
    }
    let scale = ((high - low) * 0.5).max_element();
    let origin = low + (high - low) * 0.5;
    (scale.is_normal() && scale > 0.0 && origin.is_finite()).then_some((origin, scale))
}
