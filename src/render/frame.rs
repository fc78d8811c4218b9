//! One frame: every pixel's mean radiance, coverage and what stands at its centre.

use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::corners::{Corners, corners_of};
use super::frame_light::FrameLight;
use super::integrator::{Illuminated, PixelGuides};
use super::patches::Patches;
use super::target_error;
use super::{RenderStats, Skip, Skips, Stage};
use crate::image::{Mask, RgbImage};
use crate::rig::View;
use crate::sampling::SobolPath;

/// How many times more paths a pixel gets that the silhouette crosses. Inside, the guided paths leave
/// little noise; there, whether a path meets the object at all is all the noise there is.
const ON_SILHOUETTE: u32 = 4;
/// The same where all that is seen of the object is open: paths are cheap there, and with 4 times as many,
/// silhouettes made 97 % of a sphere's squared error.
const ON_OPEN_SILHOUETTE: u32 = 16;

/// Paths of a pixel that lies open as a whole, of `paths` elsewhere: what it shows is smooth, and its
/// squared error falls with the square of their number or faster. A power of two, which Sobol's points
/// are spread best in.
fn of_open(paths: u32) -> u32 {
    let root = f64::from(paths).sqrt().ceil() as u32;
    root.next_power_of_two().min(paths)
}

/// How many paths pixels get; four or sixteen times as many where the silhouette crosses them, and fewer
/// where nothing but smooth open surface is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathCount {
    /// The same number everywhere.
    PerPixel(u32),
    /// As many as each part of the frame needs for this relative RMSE: the square root of the mean
    /// over object pixels and channels of (image − truth)² / (truth² + (0.1 m)²), with m the mean of
    /// the truth over object pixels.
    TargetError(f32),
}

impl std::fmt::Display for PathCount {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::PerPixel(paths) => write!(f, "--spp {paths}"),
            Self::TargetError(error) => write!(f, "--target-error {error}"),
        }
    }
}

/// How a frame is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameSettings {
    /// Paths of pixels.
    pub paths: PathCount,
    /// Largest number of surface interactions of a path; 1 is direct light only.
    pub bounces: u32,
    /// Seed of all frames.
    pub seed: u64,
    /// What is left undone.
    pub skips: Skips,
}

/// A rendered frame.
pub struct RenderedFrame {
    /// Mean radiance over each pixel, black where the object is not; linear RGB.
    pub radiance: RgbImage,
    /// Coverage of each pixel.
    pub mask: Mask,
    /// Work done.
    pub stats: RenderStats,
}

/// What the paths of one pixel yield.
#[derive(Clone, Copy)]
pub(super) struct Sampled {
    /// Mean radiance.
    pub(super) radiance: Vec3,
    /// Coverage.
    pub(super) coverage: u8,
}

/// Pixels along a triangle from which on a lens may bend its edges by more than the margin.
const LONG_EDGE: f64 = 8.0;

/// Pixels that the object may cover: those within the box of some projected triangle. No ray of
/// any other pixel can meet the object, so it is not sampled at all.
///
/// A lens bends long edges out of the box of their ends: the box takes in their middles, and half as
/// much again as those stick out. A pixel of margin makes up for rounding; a triangle that reaches
/// behind the camera covers everything.
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
        let (mut low, mut high) = (a.min(b).min(c), a.max(b).max(c));
        if (high - low).max_element() > LONG_EDGE {
            let [a, b, c] = corners.map(|v| stage.mesh.positions[v as usize]);
            let (straight_low, straight_high) = (low, high);
            for middle in [(a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0] {
                let Some(middle) = view.project(middle) else {
                    covered.fill(true);
                    return covered;
                };
                low = low.min(middle);
                high = high.max(middle);
            }
            low -= 0.5 * (straight_low - low);
            high += 0.5 * (high - straight_high);
        }
        let (low, high) = (low - 1.0, high + 2.0);
        let columns = clip(low.x, width)..clip(high.x, width);
        for y in clip(low.y, height)..clip(high.y, height) {
            covered[y * width + columns.start..y * width + columns.end.max(columns.start)]
                .fill(true);
        }
    }
    covered
}

/// A frame that can be sampled.
pub(super) struct FrameSampler<'a> {
    illuminated: Illuminated<'a>,
    view: View,
    number: u32,
    pub(super) width: usize,
    pub(super) height: usize,
    covered: Vec<bool>,
    /// Whether open pixels get few paths.
    thins: bool,
    corners: Vec<Corners>,
}

impl<'a> FrameSampler<'a> {
    fn new(
        stage: &'a Stage,
        patches: &'a Patches,
        number: u32,
        angle: f64,
        settings: &FrameSettings,
    ) -> Self {
        let camera = &stage.scene().camera;
        let (width, height) = (camera.width, camera.height);
        let view = stage.view(angle);
        let world_from_object = view.world_from_object();
        let covered = if settings.skips.has(Skip::Background) {
            covered_pixels(stage, &view, width, height)
        } else {
            vec![true; width * height]
        };
        let illuminated = Illuminated {
            stage,
            light: FrameLight::new(&stage.environment, &stage.clusters, world_from_object),
            world_from_object,
            patches,
            bounces: settings.bounces,
            skips: settings.skips,
        };
        let corners = corners_of(&illuminated, &view, &covered, width, height);
        // A plan measures how errors fall with the number of paths that it gives.
        let thins = settings.skips.has(Skip::Smooth)
            && matches!(settings.paths, PathCount::PerPixel(_))
            && !stage.material.has_textures();
        Self {
            illuminated,
            view,
            number,
            width,
            height,
            covered,
            corners,
            thins,
        }
    }

    /// Every pixel, row by row from the top, with `paths(x, y)` paths; 0 leaves it black. Each has its
    /// own sample sequence, keyed by seed, frame and pixel, and sums in f64: the result does not
    /// depend on the number of threads.
    pub(super) fn sample(
        &self,
        seed: u64,
        paths: &(dyn Fn(usize, usize) -> u32 + Sync),
    ) -> (Vec<Sampled>, RenderStats) {
        let rows: Vec<(Vec<Sampled>, RenderStats)> = (0..self.height)
            .into_par_iter()
            .map(|y| {
                let mut stats = RenderStats::default();
                let pixel = |x| self.sample_pixel(x, y, seed, paths(x, y), &mut stats);
                let row = (0..self.width).map(pixel).collect();
                (row, stats)
            })
            .collect();
        let mut stats = RenderStats::default();
        rows.iter().for_each(|(_, s)| stats += *s);
        (rows.into_iter().flat_map(|(row, _)| row).collect(), stats)
    }

    fn sample_pixel(
        &self,
        x: usize,
        y: usize,
        seed: u64,
        paths: u32,
        stats: &mut RenderStats,
    ) -> Sampled {
        let pixel = y * self.width + x;
        if !self.covered[pixel] {
            stats.background_pixels += 1;
            return Sampled {
                radiance: Vec3::ZERO,
                coverage: 0,
            };
        }
        let paths = match self.corners[pixel] {
            Corners::Silhouette => paths.saturating_mul(ON_SILHOUETTE),
            Corners::OpenSilhouette => paths.saturating_mul(ON_OPEN_SILHOUETTE),
            Corners::Open if self.thins => {
                stats.smooth_pixels += 1;
                of_open(paths)
            }
            _ => paths,
        };
        let mut sum = DVec3::ZERO;
        let mut guides = PixelGuides::default();
        let mut hits = 0;
        for index in 0..paths {
            let mut path = SobolPath::new(seed, self.number, pixel as u32, index);
            let [jitter_x, jitter_y, ..] = path.next_4d();
            let ray = self.view.ray(DVec2::new(
                x as f64 + f64::from(jitter_x),
                y as f64 + f64::from(jitter_y),
            ));
            stats.paths += 1;
            stats.closest_rays += 1;
            if let Some(hit) = self
                .illuminated
                .stage
                .accel
                .closest_hit(&ray, f32::INFINITY)
            {
                hits += 1;
                sum += self
                    .illuminated
                    .radiance(ray, hit, &mut guides, &mut path, stats)
                    .as_dvec3();
            }
        }
        Sampled {
            radiance: (sum / f64::from(paths.max(1))).as_vec3(),
            // 255 is kept for pixels that every sample hit.
            coverage: if hits == paths && paths > 0 {
                255
            } else {
                (u64::from(hits) * 255 / u64::from(paths.max(1))).min(254) as u8
            },
        }
    }

    /// Whether triangles project onto a pixel.
    pub(super) fn covers(&self, pixel: usize) -> bool {
        self.covered[pixel]
    }

    /// Whether the silhouette crosses a pixel.
    pub(super) fn on_silhouette(&self, pixel: usize) -> bool {
        matches!(
            self.corners[pixel],
            Corners::Silhouette | Corners::OpenSilhouette
        )
    }
}

/// Renders the frame number `number` of the turntable at `angle` (radians).
pub fn render_frame(
    stage: &Stage,
    number: u32,
    angle: f64,
    settings: &FrameSettings,
) -> RenderedFrame {
    let own_patches;
    let patches = if settings.skips.has(Skip::Explored) {
        &stage.patches
    } else {
        own_patches = stage.patches.unexplored();
        &own_patches
    };
    let sampler = FrameSampler::new(stage, patches, number, angle, settings);
    let (pixels, mut stats) = match settings.paths {
        PathCount::PerPixel(paths) => sampler.sample(settings.seed, &|_, _| paths),
        PathCount::TargetError(error) => {
            let (plan, pilots) = target_error::plan(&sampler, settings.seed, error);
            let (pixels, mut stats) = sampler.sample(settings.seed, &|x, y| plan.paths(x, y));
            stats += pilots;
            stats.pilot_paths = pilots.paths;
            (pixels, stats)
        }
    };
    if !settings.skips.has(Skip::Explored) {
        stats.patches_explored = patches.explored();
    }
    let (width, height) = (sampler.width, sampler.height);
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
        stats,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::write_exr;
    use crate::scene::Scene;

    #[test]
    fn covered_pixels_hold_every_hit_behind_a_bending_lens() {
        // A plate of two triangles that fills most of the view, through barrel and pincushion lenses.
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(
            path("plate.obj"),
            "v -1 -0.9 0\nv 1 -0.9 0\nv 1 0.9 0\nv -1 0.9 0\nf 1 2 3 4\n",
        )
        .unwrap();
        write_exr(&path("probe.exr"), &RgbImage::constant(8, 4, [1.0; 3])).unwrap();
        for distortion in ["[-0.08, 0, 0, 0, 0]", "[0.15, 0, 0.01, -0.01, 0]"] {
            let scene = format!(
                "[object]\nmesh = 'plate.obj'\n[material]\nndf = 'ggx'\nalpha = 0.5\nrho_d = 0.5\n\
                 rho_s = 0.0\n[probe]\nimage = 'probe.exr'\n[camera]\nwidth = 200\nheight = 180\n\
                 fx = 130\nfy = 130\ncx = 100\ncy = 90\ndistortion = {distortion}\n\
                 position = [0.0, 0.0, 1.6]\nlook_at = [0.0, 0.0, 0.0]\n[turntable]\nframes = 1\n"
            );
            std::fs::write(path("scene.toml"), scene).unwrap();
            let (stage, _) = Stage::load(&Scene::load(path("scene.toml")).unwrap()).unwrap();
            let view = stage.view(0.0);
            let covered = covered_pixels(&stage, &view, 200, 180);
            let mut hits = 0;
            for y in 0..180 {
                for x in 0..200 {
                    let ray = view.ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                    if stage.accel.occluded(&ray, f32::INFINITY) {
                        hits += 1;
                        assert!(covered[y * 200 + x], "{distortion}: {x} {y}");
                    }
                }
            }
            assert!((10_000..36_000).contains(&hits), "{distortion}: {hits}");
        }
    }
}
