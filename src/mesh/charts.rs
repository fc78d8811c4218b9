//! Charts for meshes that come without texture coordinates.
//!
//! The surface is cut into charts of similar normals, each is flattened by least squares conformal
//! maps (Lévy et al. 2002) evened out by as-rigid-as-possible steps (Liu et al. 2008), and the charts
//! are packed at one density, by the crate `uvunwrap`. Its result is the same on every machine and for
//! any number of threads: of its solvers the one that picks no kernels by processor is built in.

use glam::{Vec2, Vec3};
use serde::Serialize;

use super::{Mesh, MeshError, repair};

/// Texels kept free around every chart, so that two are at least twice as far apart: a bilinear
/// look-up at a chart's rim reaches one texel out, and the next coarser mipmap two.
const PADDING: u32 = 2;

/// What charts were made.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ChartReport {
    /// Charts that the surface was cut into.
    pub charts: usize,
    /// Triangles too thin for texture coordinates, a millionth of the mesh's extent; nothing is
    /// sampled on them.
    pub too_thin: usize,
    /// Share of the map that charts cover.
    pub covered: f32,
}

impl Mesh {
    /// The same triangles in the same order with a texture layout for a square map of `resolution`
    /// texels a side; vertices on seams are split. Texture coordinates there were are replaced.
    ///
    /// # Errors
    ///
    /// If the charts, with their padding, do not fit the map.
    pub fn with_charts(&self, resolution: u32) -> Result<(Self, ChartReport), MeshError> {
        let refused = |problem: String| MeshError::Charts {
            resolution,
            problem,
        };
        let positions: Vec<[f32; 3]> = self.positions.iter().map(Vec3::to_array).collect();
        let input = uvunwrap::MeshInput::new(&positions, self.triangles.as_flattened());
        let options = uvunwrap::Options {
            padding: PADDING,
            density: uvunwrap::Density::Auto {
                page_size: resolution,
            },
            ..uvunwrap::Options::default()
        };
        let atlas =
            uvunwrap::generate(&[input], &options).map_err(|error| refused(error.to_string()))?;
        if atlas.page_count > 1 || atlas.width.max(atlas.height) > resolution {
            return Err(refused(format!(
                "{} charts and the {PADDING} texels around each do not fit",
                atlas.chart_count
            )));
        }

        // A page is cropped to the rows in use: back to shares of the square.
        let [layout] = atlas.meshes.as_slice() else {
            return Err(refused("no layout was made".to_owned()));
        };
        let page = Vec2::new(atlas.width as f32, atlas.height as f32) / resolution as f32;
        let uvs = layout.vertices.iter().map(|v| Vec2::from(v.uv) * page);
        let from: Vec<u32> = layout.vertices.iter().map(|vertex| vertex.xref).collect();
        let (triangles, _) = layout.indices.as_chunks::<3>();
        let mesh = Self {
            positions: repair::gather(&self.positions, &from),
            normals: repair::gather(&self.normals, &from),
            uvs: Some(uvs.collect()),
            attributes: self
                .attributes
                .iter()
                .map(|(name, values)| (name.clone(), repair::gather(values, &from)))
                .collect(),
            triangles: triangles.to_vec(),
            smooth: self.smooth,
            origin: self.origin,
            scale: self.scale,
        };
        let report = ChartReport {
            charts: atlas.chart_count as usize,
            too_thin: (0..mesh.triangles.len() as u32)
                .filter(|&triangle| mesh.chart_area(triangle) == 0.0)
                .count(),
            covered: atlas.utilization * page.x * page.y,
        };
        Ok((mesh, report))
    }

    /// The area of a triangle in the texture layout, of the unit square's; negative where mirrored.
    fn chart_area(&self, triangle: u32) -> f64 {
        let Some(uvs) = &self.uvs else { return 0.0 };
        let [a, b, c] = self.triangles[triangle as usize].map(|v| uvs[v as usize].as_dvec2());
        0.5 * (b - a).perp_dot(c - a)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;
    use std::path::Path;

    use super::super::{LoadOptions, PointSet, TexelGrid, cup, sphere};
    use super::*;
    use crate::geometry::Similarity;

    /// Meshes without texture coordinates, and a resolution for each.
    fn bare() -> Vec<(&'static str, Mesh, u32)> {
        let suzanne = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes/suzanne.ply");
        let (suzanne, _) =
            Mesh::load(&suzanne, &Similarity::default(), LoadOptions::default()).unwrap();
        let mut sphere = sphere(12).into_mesh().unwrap();
        let mut cup = cup().into_mesh().unwrap();
        (sphere.uvs, cup.uvs) = (None, None);
        vec![
            ("sphere", sphere, 96),
            ("cup", cup, 256),
            ("suzanne", suzanne, 256),
        ]
    }

    /// The chart of every triangle: triangles that share a vertex of the layout are of one.
    fn chart_of(mesh: &Mesh) -> Vec<u32> {
        let mut root: Vec<u32> = (0..mesh.positions.len() as u32).collect();
        fn find(root: &mut [u32], mut v: u32) -> u32 {
            while root[v as usize] != v {
                root[v as usize] = root[root[v as usize] as usize];
                v = root[v as usize];
            }
            v
        }
        for [a, b, c] in &mesh.triangles {
            let first = find(&mut root, *a);
            for other in [b, c] {
                let other = find(&mut root, *other);
                root[other as usize] = first;
            }
        }
        mesh.triangles
            .iter()
            .map(|t| find(&mut root, t[0]))
            .collect()
    }

    fn texels(mesh: &Mesh, resolution: u32) -> (PointSet, TexelGrid) {
        let points = PointSet::texels(mesh, resolution).unwrap();
        let grid = points.grid.clone().unwrap();
        (points, grid)
    }

    #[test]
    fn charts_leave_the_surface_as_it_is() {
        for (name, mesh, resolution) in bare() {
            let (charted, report) = mesh.with_charts(resolution).unwrap();
            assert_eq!(charted.triangles.len(), mesh.triangles.len(), "{name}");
            assert_eq!(report.too_thin, 0, "{name}");
            for (old, new) in mesh.triangles.iter().zip(&charted.triangles) {
                for (old, new) in old.iter().zip(new) {
                    let (old, new) = (*old as usize, *new as usize);
                    assert_eq!(mesh.positions[old], charted.positions[new], "{name}");
                    assert_eq!(mesh.normals[old], charted.normals[new], "{name}");
                }
            }
        }
    }

    #[test]
    fn charts_cover_every_triangle_once_and_keep_their_distance() {
        for (name, mesh, resolution) in bare() {
            let (charted, report) = mesh.with_charts(resolution).unwrap();
            let chart = chart_of(&charted);
            let areas = (0..charted.triangles.len() as u32).map(|t| charted.chart_area(t));
            assert!(areas.clone().all(|area| area > 0.0), "{name}: turned over");
            let (points, grid) = texels(&charted, resolution);
            assert_eq!((grid.overlaps, grid.outside), (0, 0), "{name}");
            // No texel of another chart within four texels.
            let owner: HashMap<(i64, i64), u32> = points
                .points
                .iter()
                .zip(&grid.texels)
                .map(|(point, texel)| {
                    let side = i64::from(resolution);
                    let place = (i64::from(*texel) % side, i64::from(*texel) / side);
                    (place, chart[point.triangle as usize])
                })
                .collect();
            for (&(x, y), &own) in &owner {
                let beside = (-4..=4).flat_map(|dy| (-4..=4).map(move |dx| (x + dx, y + dy)));
                let mut others = beside.filter_map(|place| owner.get(&place));
                assert!(others.all(|other| *other == own), "{name}: near ({x}, {y})");
            }
            // One density: most of the surface within a third of the mean.
            let mean = areas.clone().sum::<f64>()
                / (0..charted.triangles.len() as u32)
                    .map(|t| f64::from(charted.area(t)))
                    .sum::<f64>();
            let even: f64 = areas
                .zip(0u32..)
                .map(|(area, t)| (area / f64::from(charted.area(t)), charted.area(t)))
                .filter(|(density, _)| (density / mean).ln().abs() < 0.29)
                .map(|(_, area)| f64::from(area))
                .sum();
            let all: f64 = (0..charted.triangles.len() as u32)
                .map(|t| f64::from(charted.area(t)))
                .sum();
            println!(
                "{name}: {report:?}, {:.3} of the area at the mean density",
                even / all
            );
            assert!(even > 0.8 * all, "{name}: {}", even / all);
            assert!(report.covered > 0.3, "{name}: {report:?}");
        }
    }

    #[test]
    fn charts_are_the_same_for_any_number_of_threads() {
        for (name, mesh, resolution) in bare() {
            let made = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                let (mesh, report) = pool
                    .unwrap()
                    .install(|| mesh.with_charts(resolution))
                    .unwrap();
                (mesh.triangles, mesh.uvs, report)
            };
            assert!(made(1) == made(3), "{name}");
        }
    }

    #[test]
    fn neighbours_reach_over_the_seams_of_charts() {
        let (_, mesh, resolution) = bare().swap_remove(0);
        let (charted, _) = mesh.with_charts(resolution).unwrap();
        let chart = chart_of(&charted);
        let (points, grid) = texels(&charted, resolution);
        let neighbours = points.neighbours(&charted);
        // A texel's side on the unit sphere.
        let texel = (4.0 * std::f32::consts::PI / grid.texels.len() as f32).sqrt();
        let mut across = 0;
        for (i, beside) in neighbours.iter().enumerate() {
            let here = &points.points[i];
            for &j in beside {
                let there = &points.points[j as usize];
                let apart = here.position.distance(there.position);
                assert!(apart < 4.0 * texel, "{apart} of {texel}");
                assert!(neighbours[j as usize].contains(&(i as u32)), "mutual");
                across +=
                    usize::from(chart[here.triangle as usize] != chart[there.triangle as usize]);
            }
        }
        assert!(across > 100, "{across}");
        assert!(neighbours.iter().all(|beside| !beside.is_empty()));
    }

    #[test]
    fn charts_that_do_not_fit_are_refused_with_the_remedy() {
        let (_, suzanne, _) = bare().pop().unwrap();
        let told = suzanne.with_charts(16).unwrap_err().to_string();
        assert!(
            told.contains("resolution = 16") && told.contains("vertices"),
            "{told}"
        );
    }
}
