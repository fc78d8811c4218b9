//! The object seen from the camera and from behind, coloured by its parameters.

use glam::{DVec2, Vec2, Vec3};
use rayon::prelude::*;

use super::ReportError;
use super::charts::short;
use crate::accel::Accel;
use crate::export::PointTable;
use crate::image::{RgbImage, srgb_encode, viridis};
use crate::mesh::Mesh;
use crate::rig::View;
use crate::scene::{MapSource, MaterialField, Scene};

/// One parameter over the object, both views side by side, in display values.
pub(super) struct ParameterView {
    pub(super) title: &'static str,
    /// What the colours mean.
    pub(super) legend: String,
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pixels: Vec<[u8; 3]>,
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
    let material = MaterialField::load(&scene.material, &mesh)?;
    let accel = Accel::build(&mesh.positions, &mesh.triangles);
    let first = scene.angles.first().copied().unwrap_or(0.0);
    let seen = Seen::trace(scene, &mesh, &accel, &[first, first + std::f64::consts::PI]);

    let mut views = Vec::new();
    views.push(seen.view("diffuse albedo", "as sRGB".to_owned(), |hit| {
        let rho_d = material.at(&mesh, hit.triangle, hit.barycentric).rho_d;
        rho_d
            .to_array()
            .map(|c| (255.0 * srgb_encode(f64::from(c.clamp(0.0, 1.0)))).round() as u8)
    }));
    let alpha = |hit: &Hit| {
        material
            .at(&mesh, hit.triangle, hit.barycentric)
            .alpha
            .get()
    };
    let rho_s = |hit: &Hit| material.at(&mesh, hit.triangle, hit.barycentric).rho_s.y;
    let logarithmic = |v: f32, low: f32, high: f32| {
        viridis(f64::from((v.max(1e-9) / low).ln() / (high / low).ln()))
    };
    views.push(seen.view("roughness alpha", range(0.02, 1.0), |hit| {
        logarithmic(alpha(hit), 0.02, 1.0)
    }));
    let strongest = quantile(
        &mut table.rho_s.iter().map(|r| r[1]).collect::<Vec<_>>(),
        0.95,
    )
    .max(0.1);
    views.push(seen.view(
        "specular albedo",
        range(0.01 * strongest, strongest),
        |hit| logarithmic(rho_s(hit), 0.01 * strongest, strongest),
    ));

    let on_vertices =
        matches!(scene.material.alpha, MapSource::Vertex(_)) && table.len() == mesh.positions.len();
    if on_vertices {
        let relative: Vec<f32> = table
            .sigma_alpha
            .iter()
            .zip(&table.alpha)
            .map(|(s, a)| (s / a).clamp(1e-3, 10.0))
            .collect();
        views.push(seen.view(
            "standard deviation of alpha, relative",
            range(0.01, 1.0),
            |hit| {
                logarithmic(
                    mesh.interpolate(&relative, hit.triangle, hit.barycentric),
                    0.01,
                    1.0,
                )
            },
        ));
        views.push(seen.view(
            "how each point ended",
            "colours as in the table of counts".to_owned(),
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

fn range(low: f32, high: f32) -> String {
    format!("{} dark to {} bright, logarithmic", short(low), short(high))
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

    fn view(
        &self,
        title: &'static str,
        legend: String,
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
