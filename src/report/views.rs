//! The object seen from the camera and from behind, coloured by its parameters.

use glam::{DVec2, Vec2, Vec3};
use rayon::prelude::*;

use super::ReportError;
use crate::accel::Accel;
use crate::export::PointTable;
use crate::image::{RgbImage, srgb_encode, viridis};
use crate::mesh::Mesh;
use crate::rig::View;
use crate::scene::{MapSource, MaterialField, Scene};

/// One parameter over the object, both views side by side, in display values.
pub(super) struct ParameterView {
    pub(super) title: &'static str,
    pub(super) legend: Legend,
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pixels: Vec<[u8; 3]>,
}

/// What the colours of a view mean.
pub(super) enum Legend {
    /// In words.
    Words(&'static str),
    /// From dark to bright on a logarithmic scale.
    Scale {
        /// Value of the darkest colour, and below.
        low: f32,
        /// Value of the brightest, and above.
        high: f32,
    },
}

/// Colours of the status codes 0 to 5.
pub(super) const STATUS_COLOURS: [[u8; 3]; 6] = [
    [60, 160, 90],
    [240, 180, 60],
    [220, 90, 60],
    [150, 100, 200],
    [130, 130, 130],
    [250, 250, 250],
];

const BACKGROUND: [u8; 3] = [32, 34, 38];

/// Renders the views of a fit folder's scene. Parameters come from its vertex properties or maps;
/// uncertainty and status from the table, where its points are the mesh's vertices.
pub(super) fn parameter_views(
    scene: &Scene,
    table: &PointTable,
) -> Result<Vec<ParameterView>, ReportError> {
    let (mesh, _) = scene.object.load()?;
    let material = MaterialField::load(&scene.material, &mesh, &scene.object.mesh)?;
    let accel = Accel::build(&mesh.positions, &mesh.triangles);
    let first = scene.angles.first().copied().unwrap_or(0.0);
    let seen = Seen::trace(scene, &mesh, &accel, &[first, first + std::f64::consts::PI]);

    let mut views = Vec::new();
    views.push(
        seen.view("diffuse albedo", Legend::Words("as sRGB"), |hit| {
            let rho_d = material.at(&mesh, hit.triangle, hit.barycentric).rho_d;
            rho_d
                .to_array()
                .map(|c| (255.0 * srgb_encode(f64::from(c.clamp(0.0, 1.0)))).round() as u8)
        }),
    );
    let alpha = |hit: &Hit| {
        material
            .at(&mesh, hit.triangle, hit.barycentric)
            .alpha
            .get()
    };
    let rho_s = |hit: &Hit| material.at(&mesh, hit.triangle, hit.barycentric).rho_s.y;
    views.push(seen.scalar("roughness alpha", (0.02, 1.0), alpha));
    let strongest = quantile(
        &mut table.rho_s.iter().map(|r| r[1]).collect::<Vec<_>>(),
        0.95,
    )
    .max(0.1);
    let range = (0.01 * strongest, strongest);
    views.push(seen.scalar("specular albedo, green", range, rho_s));

    let on_vertices =
        matches!(scene.material.alpha, MapSource::Vertex(_)) && table.len() == mesh.positions.len();
    if on_vertices {
        let relative: Vec<f32> = table
            .sigma_alpha
            .iter()
            .zip(&table.alpha)
            .map(|(s, a)| (s / a).clamp(1e-3, 10.0))
            .collect();
        let title = "standard deviation of alpha, relative";
        views.push(seen.scalar(title, (0.01, 1.0), |hit| {
            mesh.interpolate(&relative, hit.triangle, hit.barycentric)
        }));
        // Points without a fit have no residual: they stay grey.
        let residual: Vec<f32> = (table.residual.iter().zip(&table.status))
            .map(|(&r, &status)| if status <= 2 { r } else { f32::NAN })
            .collect();
        let title = "residual, relative to the observation";
        views.push(seen.scalar(title, (0.003, 0.3), |hit| {
            mesh.interpolate(&residual, hit.triangle, hit.barycentric)
        }));
        views.push(seen.view(
            "how each point ended",
            Legend::Words("colours as in the table of counts"),
            |hit| {
                let (u, v) = (hit.barycentric.x, hit.barycentric.y);
                let nearest = if u > v {
                    if u > 1.0 - u - v { 1 } else { 0 }
                } else if v > 1.0 - u - v {
                    2
                } else {
                    0
                };
                let vertex = mesh.triangles[hit.triangle as usize][nearest];
                let code = table.status[vertex as usize].clamp(0, 5) as usize;
                STATUS_COLOURS[code]
            },
        ));
    }
    Ok(views)
}

/// The value below which a share of the finite values lies; 0 if there are none.
pub(super) fn quantile(values: &mut Vec<f32>, share: f32) -> f32 {
    values.retain(|v| v.is_finite());
    values.sort_unstable_by(f32::total_cmp);
    let index = (share * values.len().saturating_sub(1) as f32).round() as usize;
    values.get(index).copied().unwrap_or(0.0)
}

struct Hit {
    triangle: u32,
    barycentric: Vec2,
    /// Cosine between view and normal, for a little shading.
    facing: f32,
}

/// What each pixel sees, the views side by side.
struct Seen {
    width: usize,
    height: usize,
    hits: Vec<Option<Hit>>,
}

impl Seen {
    fn trace(scene: &Scene, mesh: &Mesh, accel: &Accel, angles: &[f64]) -> Self {
        let (width, height) = (scene.camera.width, scene.camera.height);
        // Views of at most 256 pixels keep the page small.
        let step = width.max(height).div_ceil(256).max(1);
        let (columns, rows) = (width.div_ceil(step), height.div_ceil(step));
        let views: Vec<View> = angles
            .iter()
            .map(|&angle| View::new(&scene.camera, &scene.turn, angle, mesh.object_from_mesh()))
            .collect();
        let across = columns * views.len();
        let hits = (0..across * rows)
            .into_par_iter()
            .map(|i| {
                let (x, y) = (i % across, i / across);
                let pixel = DVec2::new(
                    ((x % columns * step) as f64 + 0.5 * step as f64).min(width as f64 - 0.5),
                    ((y * step) as f64 + 0.5 * step as f64).min(height as f64 - 0.5),
                );
                let ray = views[x / columns].ray(pixel);
                let hit = accel.closest_hit(&ray, f32::INFINITY)?;
                let barycentric = Vec2::new(hit.u, hit.v);
                let normal: Vec3 = mesh.normal_at(hit.triangle, barycentric);
                let facing = normal.dot(-ray.direction).max(0.0);
                Some(Hit {
                    triangle: hit.triangle,
                    barycentric,
                    facing,
                })
            })
            .collect();
        Self {
            width: across,
            height: rows,
            hits,
        }
    }

    /// A number in colours, logarithmic between two values; NaN is grey.
    fn scalar(
        &self,
        title: &'static str,
        (low, high): (f32, f32),
        value: impl Fn(&Hit) -> f32,
    ) -> ParameterView {
        self.view(title, Legend::Scale { low, high }, |hit| {
            // Not max(): it would turn NaN into the floor.
            let v = value(hit);
            let v = if v < 1e-9 { 1e-9 } else { v };
            viridis(f64::from((v / low).ln() / (high / low).ln()))
        })
    }

    fn view(
        &self,
        title: &'static str,
        legend: Legend,
        colour: impl Fn(&Hit) -> [u8; 3],
    ) -> ParameterView {
        let shade = |hit: &Hit| {
            colour(hit).map(|c| (f32::from(c) * (0.75 + 0.25 * hit.facing)).round() as u8)
        };
        let pixels = self
            .hits
            .iter()
            .map(|hit| hit.as_ref().map_or(BACKGROUND, shade))
            .collect();
        ParameterView {
            title,
            legend,
            width: self.width,
            height: self.height,
            pixels,
        }
    }
}

/// Eight times the absolute difference of two radiance images.
pub(super) fn difference(a: &RgbImage, b: &RgbImage) -> Option<RgbImage> {
    if (a.width, a.height) != (b.width, b.height) {
        return None;
    }
    let pixels = a
        .pixels
        .iter()
        .zip(&b.pixels)
        .map(|(p, q)| [0, 1, 2].map(|c| 8.0 * (p[c] - q[c]).abs()))
        .collect();
    Some(RgbImage {
        width: a.width,
        height: a.height,
        pixels,
    })
}
