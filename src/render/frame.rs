//! One frame: every pixel's mean radiance, coverage and what stands at its centre.

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::frame_light::FrameLight;
use super::integrator::{Illuminated, PixelGuides};
use super::{RenderStats, Stage};
use crate::image::{Channel, Mask, RgbImage};
use crate::rig::View;
use crate::sampling::SobolPath;

/// How many times more paths a pixel gets that the silhouette crosses. Inside, the guided paths leave
/// little noise; there, whether a path meets the object at all is all the noise there is.
const ON_SILHOUETTE: u32 = 4;

/// How a frame is sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameSettings {
    /// Paths per pixel; four times as many where the silhouette crosses it.
    pub samples_per_pixel: u32,
    /// Largest number of surface interactions of a path; 1 is direct light only.
    pub bounces: u32,
    /// Seed of all frames.
    pub seed: u64,
}

/// A rendered frame.
pub struct RenderedFrame {
    /// Mean radiance over each pixel, black where the object is not; linear RGB.
    pub radiance: RgbImage,
    /// Coverage of each pixel.
    pub mask: Mask,
    /// At pixel centres: `depth.Z` (object units), `normal.X/Y/Z` (object frame), `id.T` (triangle,
    /// −1 where nothing is).
    pub aovs: Vec<Channel>,
    /// Work done.
    pub stats: RenderStats,
}

/// What one pixel yields.
struct Pixel {
    radiance: Vec3,
    coverage: u8,
    depth: f32,
    normal: Vec3,
    triangle: f32,
}

impl Pixel {
    const BACKGROUND: Self = Self {
        radiance: Vec3::ZERO,
        coverage: 0,
        depth: 0.0,
        normal: Vec3::ZERO,
        triangle: -1.0,
    };
}

/// Pixels that the object may cover: those within the box of some projected triangle. No ray of
/// any other pixel can meet the object, so it is not sampled at all.
///
/// A pixel of margin makes up for rounding and for lens distortion bending the edges; a triangle
/// that reaches behind the camera covers everything.
fn covered_pixels(stage: &Stage, view: &View, width: usize, height: usize) -> Vec<bool> {
    let projected: Vec<Option<DVec2>> = stage
        .mesh
        .positions
        .iter()
        .map(|&p| view.project(p))
        .collect();
    let mut covered = vec![false; width * height];
    let clip = |x: f64, n: usize| x.clamp(0.0, n as f64) as usize;
    for corners in &stage.mesh.triangles {
        let [Some(a), Some(b), Some(c)] = corners.map(|v| projected[v as usize]) else {
            covered.fill(true);
            return covered;
        };
        let (low, high) = (a.min(b).min(c) - 1.0, a.max(b).max(c) + 2.0);
        let columns = clip(low.x, width)..clip(high.x, width);
        for y in clip(low.y, height)..clip(high.y, height) {
            covered[y * width + columns.start..y * width + columns.end.max(columns.start)]
                .fill(true);
        }
    }
    covered
}

/// Pixels of which some corners see the object and others do not, of those in `covered`.
///
/// The corners are no samples of the pixel, so that choosing by them biases nothing; what is too thin
/// for them to notice is sampled like the rest.
fn on_silhouette(
    stage: &Stage,
    view: &View,
    covered: &[bool],
    width: usize,
    height: usize,
) -> Vec<bool> {
    let sees_object = |x: usize, y: usize| {
        let ray = view.ray(DVec2::new(x as f64, y as f64));
        stage.accel.occluded(&ray, f32::INFINITY)
    };
    let near = |x: usize, y: usize| {
        let (columns, rows) = (
            x.saturating_sub(1)..(x + 1).min(width),
            y.saturating_sub(1)..(y + 1).min(height),
        );
        rows.into_iter()
            .any(|y| columns.clone().any(|x| covered[y * width + x]))
    };
    let corners: Vec<bool> = (0..=height)
        .into_par_iter()
        .flat_map_iter(|y| (0..=width).map(move |x| near(x, y) && sees_object(x, y)))
        .collect();
    (0..width * height)
        .map(|pixel| {
            let first = pixel / width * (width + 1) + pixel % width;
            let four = [first, first + 1, first + width + 1, first + width + 2];
            let seen = four.into_iter().filter(|&corner| corners[corner]).count();
            covered[pixel] && seen % 4 != 0
        })
        .collect()
}

/// Renders the frame number `number` of the turntable at `angle` (radians).
///
/// Every pixel has its own sample sequence, keyed by seed, frame and pixel, and sums in f64: the
/// result does not depend on the number of threads.
pub fn render_frame(
    stage: &Stage,
    number: u32,
    angle: f64,
    settings: &FrameSettings,
) -> RenderedFrame {
    let camera = &stage.scene().camera;
    let (width, height) = (camera.width, camera.height);
    let view = stage.view(angle);
    let world_from_object = view.world_from_object();
    let illuminated = Illuminated {
        stage,
        light: FrameLight::new(&stage.environment, &stage.clusters, world_from_object),
        world_from_object,
        bounces: settings.bounces,
    };

    let covered = covered_pixels(stage, &view, width, height);

    let silhouette = on_silhouette(stage, &view, &covered, width, height);

    let render_pixel = |x: usize, y: usize, stats: &mut RenderStats| {
        if !covered[y * width + x] {
            stats.background_pixels += 1;
            return Pixel::BACKGROUND;
        }
        let mut sum = DVec3::ZERO;
        let mut guides = PixelGuides::default();
        let mut hits = 0;
        let samples = if silhouette[y * width + x] {
            settings.samples_per_pixel.saturating_mul(ON_SILHOUETTE)
        } else {
            settings.samples_per_pixel
        };
        for index in 0..samples {
            let mut path = SobolPath::new(settings.seed, number, (y * width + x) as u32, index);
            let [jitter_x, jitter_y, ..] = path.next_4d();
            let pixel = DVec2::new(
                x as f64 + f64::from(jitter_x),
                y as f64 + f64::from(jitter_y),
            );
            let ray = view.ray(pixel);
            stats.paths += 1;
            stats.closest_rays += 1;
            if let Some(hit) = stage.accel.closest_hit(&ray, f32::INFINITY) {
                hits += 1;
                sum += illuminated
                    .radiance(ray, hit, &mut guides, &mut path, stats)
                    .as_dvec3();
            }
        }
        let centre = view.ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
        let at_centre = stage.accel.closest_hit(&centre, f32::INFINITY);
        Pixel {
            radiance: (sum / f64::from(samples.max(1))).as_vec3(),
            // 255 is kept for pixels that every sample hit.
            coverage: if hits == samples && samples > 0 {
                255
            } else {
                (u64::from(hits) * 255 / u64::from(samples.max(1))).min(254) as u8
            },
            depth: at_centre.map_or(0.0, |hit| hit.t * stage.mesh.scale as f32),
            normal: at_centre.map_or(Vec3::ZERO, |hit| {
                stage
                    .mesh
                    .normal_at(hit.triangle, glam::Vec2::new(hit.u, hit.v))
            }),
            triangle: at_centre.map_or(-1.0, |hit| hit.triangle as f32),
        }
    };

    // Rows in parallel, collected in order.
    let rows: Vec<(Vec<Pixel>, RenderStats)> = (0..height)
        .into_par_iter()
        .map(|y| {
            let mut stats = RenderStats::default();
            let row = (0..width).map(|x| render_pixel(x, y, &mut stats)).collect();
            (row, stats)
        })
        .collect();

    let mut stats = RenderStats::default();
    rows.iter().for_each(|(_, s)| stats += *s);
    let pixels: Vec<Pixel> = rows.into_iter().flat_map(|(row, _)| row).collect();
    let channel = |name: &str, value: &dyn Fn(&Pixel) -> f32| Channel {
        name: name.to_owned(),
        samples: pixels.iter().map(value).collect(),
    };
    RenderedFrame {
        radiance: RgbImage {
            width,
            height,
            pixels: pixels.iter().map(|p| p.radiance.to_array()).collect(),
        },
        mask: Mask {
            width,
            height,
            pixels: pixels.iter().map(|p| p.coverage).collect(),
        },
        aovs: vec![
            channel("depth.Z", &|p| p.depth),
            channel("id.T", &|p| p.triangle),
            channel("normal.X", &|p| p.normal.x),
            channel("normal.Y", &|p| p.normal.y),
            channel("normal.Z", &|p| p.normal.z),
        ],
        stats,
    }
}
