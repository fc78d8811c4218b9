//! From photographs to traces: which point of the surface every pixel shows, and what is seen there.

use std::path::PathBuf;

use glam::{Vec3, Vec4};
use rayon::prelude::*;
use serde::Serialize;

use super::footprint::Footprint;
use super::{Observation, SurfaceNormals, Trace, TraceSet};
use crate::accel::Accel;
use crate::image::{ImageError, Mask, RgbImage};
use crate::mesh::{Mesh, PointSet};
use crate::rig::View;
use crate::scene::{Capture, CaptureFrame, Sensor};

/// How observations are chosen.
#[derive(Clone, Copy, Debug)]
pub struct CollectSettings {
    /// Smallest cosine between normal and view. Below 0.2 (78°) a pixel covers five times its
    /// width of surface, and model and mesh normals are at their worst.
    pub smallest_cos: f32,
    /// How far from a pixel's patch its point may be, in widths of the pixel on the surface. On a
    /// mesh coarser than the image this bounds what is taken for the same material.
    pub reach: f32,
}

impl Default for CollectSettings {
    fn default() -> Self {
        Self {
            smallest_cos: 0.2,
            reach: 3.0,
        }
    }
}

/// What happened to the pixels; sums over frames.
#[derive(Clone, Copy, Debug, Default, Serialize, PartialEq, Eq)]
pub struct TraceStats {
    /// Pixels wholly covered by the object, by their mask.
    pub pixels: u64,
    /// Of these: no single smooth patch (an edge, a crease, or past the mesh).
    pub edges: u64,
    /// Seen at too grazing an angle.
    pub grazing: u64,
    /// Without a point within reach.
    pub far: u64,
    /// Observations; a pixel counts again for each further point that has no nearer one.
    pub observed: u64,
}

/// Why traces could not be collected.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// A photograph or mask cannot be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A photograph or mask has not the camera's size.
    #[error(
        "{}: is {found_width} x {found_height}, the camera {width} x {height}; \
         resize neither: correct [camera] or take the right file", path.display()
    )]
    Size {
        /// Image or mask.
        path: PathBuf,
        /// Columns found.
        found_width: usize,
        /// Rows found.
        found_height: usize,
        /// Columns of the camera.
        width: usize,
        /// Rows of the camera.
        height: usize,
    },
    /// A pixel inside the mask is NaN or infinite.
    #[error("{}: pixel ({x}, {y}) is {value}; mask it out or write the image again", path.display())]
    NotFinite {
        /// Image.
        path: PathBuf,
        /// Column.
        x: usize,
        /// Row.
        y: usize,
        /// The value.
        value: Vec3,
    },
}

/// A patch whose normal is farther from a point's, 60°, is another surface, as behind a thin wall.
const SAME_SIDE_COS: f32 = 0.5;

/// Relative noise assumed where no sensor is given: 1 % of the radiance, over a floor of 0.1 % of
/// the frame's mean. Only the relation between bright and dark samples matters then; the fit
/// scales the whole by its residuals.
const ASSUMED_NOISE: (f32, f32) = (0.01, 0.001);

/// Collects the traces of all points over all frames of a capture.
///
/// Every pixel is an observation of the point that stands for the middle of its patch, if one is
/// within reach; a point too small to have pixels of its own in a frame takes the one it is projected
/// onto. `on_frame` hears of every frame done.
pub fn collect(
    capture: &Capture,
    mesh: &Mesh,
    accel: &Accel,
    points: &PointSet,
    settings: &CollectSettings,
    on_frame: &(dyn Fn(usize) + Sync),
) -> Result<(TraceSet, TraceStats), TraceError> {
    let mut traces: Vec<Trace> = points
        .points
        .iter()
        .map(|&point| Trace {
            point,
            observations: Vec::new(),
        })
        .collect();
    let mut stats = TraceStats::default();
    let mut world_from_object = Vec::with_capacity(capture.frames.len());
    for (number, frame) in capture.frames.iter().enumerate() {
        let view = View::new(
            &capture.camera,
            &capture.turn,
            frame.angle,
            mesh.object_from_mesh(),
        );
        world_from_object.push(view.world_from_object());
        let photograph = Photograph::read(capture, frame)?;
        let patches = photograph.patches(mesh, accel, &view, points, settings, &mut stats);
        let owned = owned_pixels(&patches, traces.len());
        stats.observed += traces
            .par_iter_mut()
            .enumerate()
            .map(|(index, trace)| {
                let position = trace.point.position;
                let own = owned.of(index);
                let borrowed = if own.is_empty() {
                    let pixel = photograph.pixel_of(&view, position);
                    pixel.filter(|&pixel| {
                        let patch = patches[pixel as usize].as_ref();
                        patch.is_some_and(|patch| {
                            patch.footprint.geometric_normal.dot(trace.point.normal) > SAME_SIDE_COS
                        })
                    })
                } else {
                    None
                };
                let mut pixels: Vec<(f32, u32)> = own
                    .iter()
                    .copied()
                    .chain(borrowed)
                    .filter_map(|pixel| {
                        let patch = patches[pixel as usize].as_ref()?;
                        let distance = patch.footprint.position.distance(position);
                        (distance <= settings.reach * patch.width_on_surface())
                            .then_some((distance, pixel))
                    })
                    .collect();
                pixels.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                trace
                    .observations
                    .extend(pixels.iter().filter_map(|&(_, pixel)| {
                        let patch = patches[pixel as usize].as_ref()?;
                        Some(photograph.observation(number, pixel, &patch.footprint))
                    }));
                pixels.len() as u64
            })
            .sum::<u64>();
        on_frame(number);
    }
    let noise_is_known = capture.sensor.is_some();
    Ok((
        TraceSet {
            traces,
            world_from_object,
            points_of_triangle: points.of_triangle.clone(),
            surface: SurfaceNormals::of_mesh(mesh),
            noise_is_known,
        },
        stats,
    ))
}

/// A pixel's patch, and the point that stands for its middle.
struct Patch {
    footprint: Footprint,
    owner: Option<u32>,
}

impl Patch {
    /// Width of the pixel on the surface, along the slant.
    fn width_on_surface(&self) -> f32 {
        self.footprint.width / self.footprint.normal.dot(self.footprint.wo)
    }
}

/// Pixels by the point that owns them.
struct OwnedPixels {
    /// `[points + 1]` where each point's pixels start.
    starts: Vec<usize>,
    pixels: Vec<u32>,
}

impl OwnedPixels {
    fn of(&self, point: usize) -> &[u32] {
        &self.pixels[self.starts[point]..self.starts[point + 1]]
    }
}

fn owned_pixels(patches: &[Option<Patch>], points: usize) -> OwnedPixels {
    let mut pairs: Vec<(u32, u32)> = (0u32..)
        .zip(patches)
        .filter_map(|(pixel, patch)| Some((patch.as_ref()?.owner?, pixel)))
        .collect();
    pairs.sort_unstable();
    let starts = (0..=points as u32)
        .map(|point| pairs.partition_point(|(owner, _)| *owner < point))
        .collect();
    OwnedPixels {
        starts,
        pixels: pairs.into_iter().map(|(_, pixel)| pixel).collect(),
    }
}

/// A frame's image, mask and noise in memory.
struct Photograph {
    image: RgbImage,
    mask: Option<Mask>,
    noise: Noise,
}

/// Variance of a stored value.
enum Noise {
    /// By the sensor's model at this frame's exposure.
    Sensor(Sensor, f64),
    /// Assumed, for a mean radiance of the frame.
    Assumed(f32),
}

impl Photograph {
    fn read(capture: &Capture, frame: &CaptureFrame) -> Result<Self, TraceError> {
        let (width, height) = (capture.camera.width, capture.camera.height);
        let check = |path: &PathBuf, found_width, found_height| {
            if (found_width, found_height) == (width, height) {
                return Ok(());
            }
            Err(TraceError::Size {
                path: path.clone(),
                found_width,
                found_height,
                width,
                height,
            })
        };
        let image = RgbImage::read(&frame.image)?;
        check(&frame.image, image.width, image.height)?;
        let mask = frame.mask.as_deref().map(Mask::read).transpose()?;
        if let (Some(path), Some(mask)) = (&frame.mask, &mask) {
            check(path, mask.width, mask.height)?;
        }

        let inside = |i: usize| mask.as_ref().is_none_or(|m| m.pixels[i] == 255);
        let mut total = Vec4::ZERO;
        for (i, pixel) in image.pixels.iter().enumerate().filter(|(i, _)| inside(*i)) {
            let value = Vec3::from(*pixel);
            if !value.is_finite() {
                let path = frame.image.clone();
                return Err(TraceError::NotFinite {
                    path,
                    x: i % width,
                    y: i / width,
                    value,
                });
            }
            total += value.extend(1.0);
        }
        let noise = match &capture.sensor {
            Some(sensor) => Noise::Sensor(*sensor, frame.exposure),
            None => Noise::Assumed(total.truncate().element_sum() / (3.0 * total.w.max(1.0))),
        };
        Ok(Self { image, mask, noise })
    }

    /// The usable patch of every pixel, row by row.
    fn patches(
        &self,
        mesh: &Mesh,
        accel: &Accel,
        view: &View,
        points: &PointSet,
        settings: &CollectSettings,
        stats: &mut TraceStats,
    ) -> Vec<Option<Patch>> {
        let width = self.image.width;
        let look = |pixel: usize, stats: &mut TraceStats| {
            if self.mask.as_ref().is_some_and(|m| m.pixels[pixel] != 255) {
                return None;
            }
            let place = (pixel % width, pixel / width);
            let Some(footprint) = Footprint::of_pixel(mesh, accel, view, place) else {
                stats.edges += 1;
                return None;
            };
            if footprint.normal.dot(footprint.wo) < settings.smallest_cos
                || footprint.geometric_normal.dot(footprint.wo) <= 0.0
            {
                stats.grazing += 1;
                return None;
            }
            let (triangle, barycentric) = footprint.place;
            let mut patch = Patch {
                footprint,
                owner: points.nearest(mesh, triangle, barycentric),
            };
            let reach = settings.reach * patch.width_on_surface();
            let within = |&owner: &u32| {
                let place = points.points[owner as usize].position;
                place.distance(patch.footprint.position) <= reach
            };
            patch.owner = patch.owner.filter(within);
            stats.far += u64::from(patch.owner.is_none());
            Some(patch)
        };
        let rows: Vec<(Vec<Option<Patch>>, TraceStats)> = (0..self.image.height)
            .into_par_iter()
            .map(|y| {
                let mut stats = TraceStats::default();
                let row = (y * width..(y + 1) * width).map(|i| look(i, &mut stats));
                (row.collect(), stats)
            })
            .collect();
        let inside = |m: &Mask| m.pixels.iter().filter(|&&p| p == 255).count();
        stats.pixels += self.mask.as_ref().map_or(self.image.pixels.len(), inside) as u64;
        let mut patches = Vec::with_capacity(self.image.pixels.len());
        for (row, counts) in rows {
            patches.extend(row);
            stats.edges += counts.edges;
            stats.grazing += counts.grazing;
            stats.far += counts.far;
        }
        patches
    }

    /// The pixel that a position is projected onto.
    fn pixel_of(&self, view: &View, position: Vec3) -> Option<u32> {
        let pixel = view.project(position)?;
        let (x, y) = (pixel.x.floor(), pixel.y.floor());
        let (width, height) = (self.image.width, self.image.height);
        (x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64)
            .then(|| (y as usize * width + x as usize) as u32)
    }

    fn observation(&self, frame: usize, pixel: u32, footprint: &Footprint) -> Observation {
        let stored = Vec3::from(self.image.pixels[pixel as usize]);
        let saturation = self.noise.saturation();
        let radiance = stored.min(Vec3::splat(saturation));
        Observation {
            frame: frame as u32,
            radiance,
            variance: self.noise.variance(radiance),
            saturated: stored.cmpge(Vec3::splat(saturation)),
            position: footprint.position,
            wo: footprint.wo,
            normal: footprint.normal,
            geometric_normal: footprint.geometric_normal,
            normal_variance: footprint.normal_variance,
        }
    }
}

impl Noise {
    /// The stored value from which on a channel is saturated.
    fn saturation(&self) -> f32 {
        match self {
            Self::Sensor(sensor, exposure) => sensor.saturation(*exposure) as f32,
            Self::Assumed(_) => f32::INFINITY,
        }
    }

    fn variance(&self, radiance: Vec3) -> Vec3 {
        match self {
            Self::Sensor(sensor, exposure) => {
                radiance.map(|value| sensor.variance(f64::from(value), *exposure) as f32)
            }
            // A frame without light tells nothing.
            Self::Assumed(mean) if *mean <= 0.0 => Vec3::INFINITY,
            Self::Assumed(mean) => {
                let (relative, floor) = ASSUMED_NOISE;
                let floor = (floor * mean).max(f32::MIN_POSITIVE.sqrt());
                radiance * radiance * (relative * relative) + Vec3::splat(floor * floor)
            }
        }
    }
}
