//! From photographs to traces: project every point into every frame and read what is seen there.

use std::path::PathBuf;

use glam::{Vec3, Vec4};
use rayon::prelude::*;
use serde::Serialize;

use super::footprint::footprint;
use super::{Observation, Trace, TraceSet};
use crate::accel::Accel;
use crate::image::{ImageError, Mask, RgbImage};
use crate::mesh::{Mesh, SurfacePoint};
use crate::rig::View;
use crate::scene::{Capture, CaptureFrame, Sensor};

/// How observations are chosen.
#[derive(Clone, Copy, Debug)]
pub struct CollectSettings {
    /// Smallest cosine between normal and view. Below 0.2 (78°) a pixel covers five times its
    /// width of surface, and model and mesh normals are at their worst.
    pub smallest_cos: f32,
}

impl Default for CollectSettings {
    fn default() -> Self {
        Self { smallest_cos: 0.2 }
    }
}

/// What happened to the point–frame pairs; sums over frames.
#[derive(Clone, Copy, Debug, Default, Serialize, PartialEq, Eq)]
pub struct TraceStats {
    /// Pairs of points and frames.
    pub pairs: u64,
    /// Turned away, or at too grazing an angle.
    pub turned_away: u64,
    /// Outside the image, or not wholly covered by the object in the mask.
    pub outside: u64,
    /// Hidden behind the object, or at an edge of it.
    pub hidden: u64,
    /// Observed.
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

/// Relative noise assumed where no sensor is given: 1 % of the radiance, over a floor of 0.1 % of
/// the frame's mean. Only the relation between bright and dark samples matters then; the fit
/// scales the whole by its residuals.
const ASSUMED_NOISE: (f32, f32) = (0.01, 0.001);

/// Collects the traces of `points` over all frames of a capture.
///
/// `points_of_triangle` names, for each triangle, the points nearest to its corners. `on_frame`
/// hears of every frame done.
pub fn collect(
    capture: &Capture,
    mesh: &Mesh,
    accel: &Accel,
    points: Vec<SurfacePoint>,
    points_of_triangle: Vec<[u32; 3]>,
    settings: &CollectSettings,
    on_frame: &(dyn Fn(usize) + Sync),
) -> Result<(TraceSet, TraceStats), TraceError> {
    let mut traces: Vec<Trace> = points
        .into_iter()
        .map(|point| Trace {
            point,
            observations: Vec::new(),
        })
        .collect();
    let mut stats = TraceStats::default();
    let mut world_from_object = Vec::with_capacity(capture.frames.len());
    let object_from_mesh = mesh.object_from_mesh();
    for (number, frame) in capture.frames.iter().enumerate() {
        let view = View::new(
            &capture.camera,
            &capture.turn,
            frame.angle,
            object_from_mesh,
        );
        world_from_object.push(view.world_from_object());
        let photograph = Photograph::read(capture, frame)?;

        // Each point on its own, in parallel; the outcome is stored in the order of the points.
        let look = |trace: &mut Trace| {
            let outcome = photograph.look(mesh, accel, &view, &trace.point, settings);
            if let Outcome::Observed(mut observation) = outcome {
                observation.frame = number as u32;
                trace.observations.push(observation);
            }
            outcome.count()
        };
        let counts: Vec<TraceStats> = traces
            .par_chunks_mut(256)
            .map(|chunk| sum(chunk.iter_mut().map(look)))
            .collect();
        stats = sum([stats].into_iter().chain(counts));
        on_frame(number);
    }
    let noise_is_known = capture.sensor.is_some();
    Ok((
        TraceSet {
            traces,
            world_from_object,
            points_of_triangle,
            noise_is_known,
        },
        stats,
    ))
}

/// What became of a point in a frame.
enum Outcome {
    TurnedAway,
    Outside,
    Hidden,
    Observed(Observation),
}

impl Outcome {
    fn count(&self) -> TraceStats {
        let one = TraceStats {
            pairs: 1,
            ..TraceStats::default()
        };
        match self {
            Self::TurnedAway => TraceStats {
                turned_away: 1,
                ..one
            },
            Self::Outside => TraceStats { outside: 1, ..one },
            Self::Hidden => TraceStats { hidden: 1, ..one },
            Self::Observed(_) => TraceStats { observed: 1, ..one },
        }
    }
}

fn sum(stats: impl Iterator<Item = TraceStats>) -> TraceStats {
    stats.fold(TraceStats::default(), |a, b| TraceStats {
        pairs: a.pairs + b.pairs,
        turned_away: a.turned_away + b.turned_away,
        outside: a.outside + b.outside,
        hidden: a.hidden + b.hidden,
        observed: a.observed + b.observed,
    })
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

    /// What this frame shows of a point.
    fn look(
        &self,
        mesh: &Mesh,
        accel: &Accel,
        view: &View,
        point: &SurfacePoint,
        settings: &CollectSettings,
    ) -> Outcome {
        // Does the point face the camera?
        let to_camera = view.position() - point.position;
        let cos = point.normal.dot(to_camera.normalize_or_zero());
        if cos < settings.smallest_cos {
            return Outcome::TurnedAway;
        }
        // Which pixel does it fall on, and does the object cover that pixel whole?
        let Some(pixel) = view.project(point.position) else {
            return Outcome::Outside;
        };
        let (x, y) = (pixel.x.floor(), pixel.y.floor());
        let (width, height) = (self.image.width, self.image.height);
        if !(x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64) {
            return Outcome::Outside;
        }
        let (x, y) = (x as usize, y as usize);
        let index = y * width + x;
        if self
            .mask
            .as_ref()
            .is_some_and(|mask| mask.pixels[index] != 255)
        {
            return Outcome::Outside;
        }
        // Is the patch in that pixel the surface around the point? Within two pixels' width,
        // stretched by the slant, it is.
        let pixel_width = view.pixel_width_at(to_camera.length());
        let reach = 2.0 * pixel_width / cos;
        let Some(patch) = footprint(mesh, accel, view, (x, y), point.position, reach) else {
            return Outcome::Hidden;
        };
        if patch.normal.dot(patch.wo) < settings.smallest_cos
            || patch.geometric_normal.dot(patch.wo) <= 0.0
        {
            return Outcome::TurnedAway;
        }
        let radiance = Vec3::from(self.image.pixels[index]);
        Outcome::Observed(Observation {
            frame: 0,
            radiance,
            variance: self.noise.variance(radiance),
            wo: patch.wo,
            normal: patch.normal,
            geometric_normal: patch.geometric_normal,
            normal_variance: patch.normal_variance,
        })
    }
}

impl Noise {
    fn variance(&self, radiance: Vec3) -> Vec3 {
        match self {
            Self::Sensor(sensor, exposure) => {
                let saturation = sensor.saturation(*exposure) as f32;
                let variance = |value: f32| {
                    if value >= saturation {
                        f32::INFINITY
                    } else {
                        sensor.variance(f64::from(value), *exposure) as f32
                    }
                };
                Vec3::new(
                    variance(radiance.x),
                    variance(radiance.y),
                    variance(radiance.z),
                )
            }
            Self::Assumed(mean) => {
                let (relative, floor) = ASSUMED_NOISE;
                let floor = (floor * mean).max(f32::MIN_POSITIVE.sqrt());
                radiance * radiance * (relative * relative) + Vec3::splat(floor * floor)
            }
        }
    }
}
