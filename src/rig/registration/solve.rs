//! The search: outlines are matched with borders, the equations are solved, coarse to fine.

use rayon::prelude::*;

use super::border::{COARSEST, Observed};
use super::bounds::{Bound, bounds, width};
use super::contour::{ContourPoint, Contours};
use super::equations::{
    Certainty, Directions, Equations, Kind, Match, directions, dot, scale, tile,
};
use super::pose::{Placement, Pose, Slopes, Step, UNKNOWNS};
use super::{FrameAgreement, OutlinePoint, Registered, RegistrationError, Settings, Stop, sigmas};
use crate::accel::Accel;
use crate::mesh::Mesh;
use crate::rig::Camera;

/// How far borders are looked for, in pixels of a level.
const REACH: f64 = 4.0;

/// Rounds at each level at most; a good start takes 4 to 8.
const ROUNDS: usize = 40;

/// Root mean square motion of the outline, in pixels of a level, below which a level is done.
const STILL: f64 = 1e-3;

/// How far off the start may be, as a share of the object's extent in the image: 5° and 5 % of the size
/// off, in pose and turntable, come to 0.2 at the far ends.
const SEARCH_SHARE: f64 = 0.2;

/// Fewest pixels of a level that the object may measure.
const SMALLEST_EXTENT: f64 = 12.0;

/// Least square of a direction's motion of the surface, relative to the best direction's.
const LEAST_SHARE: f64 = 1e-4;

/// Largest standard deviation, radians or sizes, that a step can be trusted with: 3° or 5 % of the size.
const LARGEST_SIGMA: f64 = 0.05;

/// Least share of the outlines that must find a border.
const LEAST_MATCHED: f64 = 0.25;

/// What one frame shows at one placement.
struct FrameMatches {
    points: Vec<(ContourPoint, Option<f64>)>,
    matches: Vec<Match>,
    /// The matches that count at the end: bounds where the mask has no shares, and what has none.
    finest: Vec<Match>,
}

/// The parts that stand still during a search.
struct Search<'a> {
    contours: Contours<'a>,
    camera: &'a Camera,
    observed: &'a [Observed],
    settings: &'a Settings,
    free: Vec<usize>,
}

/// Refines `start` so that the outlines of `mesh`, loaded under `start`, fall on the borders of the object
/// in `observed`, one for each of its angles.
///
/// The result depends on the input alone, not on the number of threads.
///
/// # Errors
/// If the outlines find no borders, or if the frames leave some direction of the unknowns undetermined and
/// the settings do not say to keep it as given.
pub fn register(
    mesh: &Mesh,
    accel: &Accel,
    camera: &Camera,
    start: &Placement,
    observed: &[Observed],
    settings: &Settings,
) -> Result<Registered, RegistrationError> {
    let search = Search {
        contours: Contours::new(mesh, accel),
        camera,
        observed,
        settings,
        free: if settings.turntable {
            (0..UNKNOWNS).collect()
        } else {
            (0..6).collect()
        },
    };
    let size = f64::from(mesh.bounding_radius()) * mesh.scale;
    let mut pose = Pose::new(start, mesh.object_from_mesh(), size);
    let mut rounds = 0;
    let mut stop = Stop::IterationLimit;
    for level in (0..=search.coarsest_level()).rev() {
        (pose, stop) = search.level(pose, level, false, &mut rounds)?;
    }
    // Distances read off masks of 0 and 255 lead here; what the pixels bound is sharper.
    if observed.iter().any(|frame| frame.binary().is_some()) {
        (pose, stop) = search.level(pose, 0, true, &mut rounds)?;
    }
    search.result(start, pose, rounds, stop)
}

impl Search<'_> {
    fn size(&self) -> (usize, usize) {
        (self.camera.width, self.camera.height)
    }

    /// The level from which borders are within reach.
    fn coarsest_level(&self) -> usize {
        let extents = self.observed.iter().filter_map(Observed::extent);
        let image = self.camera.width.min(self.camera.height) as f64;
        let extent = extents.fold(0.0, f64::max);
        let extent = if extent > 0.0 { extent } else { 0.5 * image };
        let search = self.settings.search.unwrap_or(SEARCH_SHARE * extent);
        let mut level = 0;
        while level < COARSEST
            && REACH * (1u64 << level) as f64 <= search
            && extent >= SMALLEST_EXTENT * (2u64 << level) as f64
        {
            level += 1;
        }
        level
    }

    /// Matches and steps at one level in turns.
    fn level(
        &self,
        mut pose: Pose,
        level: usize,
        finest: bool,
        rounds: &mut usize,
    ) -> Result<(Pose, Stop), RegistrationError> {
        for round in 0..ROUNDS {
            // Match, part the unknowns, step.
            let frames = self.matches(&pose, level, finest)?;
            let (equations, scale) = self.equations(&frames, level);
            let directions = self.directions(&frames, scale);
            // Where the matches keep changing, shorter steps settle.
            let share = if round < 15 { 1.0 } else { 0.5 };
            let (step, angles) =
                equations.solve(&directions.known, if level > 0 { 1e-3 } else { 0.0 });
            let (step, angles) = limited(&step, &angles, share);
            let motion = motion(&frames, &step, &angles);
            pose = pose.stepped(&step, &angles);
            *rounds += 1;
            if motion < STILL * (1u64 << level) as f64 {
                return Ok((pose, Stop::Converged));
            }
        }
        Ok((pose, Stop::IterationLimit))
    }

    /// Outlines of all frames with the borders that they find, and with the bounds of their masks if asked.
    fn matches(
        &self,
        pose: &Pose,
        level: usize,
        finest: bool,
    ) -> Result<Vec<FrameMatches>, RegistrationError> {
        let mut frames: Vec<FrameMatches> = (0..self.observed.len())
            .into_par_iter()
            .map(|frame| self.matches_of(pose, frame, level))
            .collect();
        let length = |points: &mut dyn Iterator<Item = f64>| points.sum::<f64>();
        let outline = length(&mut frames.iter().flat_map(|f| &f.points).map(|(p, _)| p.length));
        let matched = length(&mut frames.iter().flat_map(|f| &f.matches).map(|m| m.length));
        if outline == 0.0 {
            return Err(RegistrationError::OutOfView);
        }
        if matched < LEAST_MATCHED * outline {
            return Err(RegistrationError::NoBorder {
                found: 100.0 * matched / outline,
                reach: REACH * (1u64 << level) as f64,
            });
        }
        if finest {
            self.bound(pose, &mut frames);
        }
        Ok(frames)
    }

    /// Adds what the pixels of masks of 0 and 255 bound.
    fn bound(&self, pose: &Pose, frames: &mut [FrameMatches]) {
        let all: Vec<Vec<Bound>> = (frames.par_iter().zip(self.observed))
            .map(|(frame, observed)| {
                let points: Vec<ContourPoint> = frame.points.iter().map(|(p, _)| *p).collect();
                bounds(observed, &points)
            })
            .collect();
        let width = width(&all);
        let each = frames.par_iter_mut().zip(all).zip(self.observed);
        each.enumerate()
            .for_each(|(number, ((frame, bounds), observed))| {
                let slopes = pose.slopes(number);
                frame.finest = match observed.binary() {
                    Some(_) => (frame.matches.iter().filter(|m| !m.outer).copied()).collect(),
                    None => frame.matches.clone(),
                };
                frame.finest.extend(bounds.iter().filter_map(|bound| {
                    let (point, _) = &frame.points[bound.point];
                    let (distance, certainty) = bound.working(width);
                    let (border, ..) = observed.binary()?;
                    Some(Match {
                        distance,
                        certainty,
                        doubt: border.doubt(point.outward),
                        length: 1.0,
                        ..self.sensitivity(pose, &slopes, point)?
                    })
                }));
            });
    }

    /// How a point of the outline moves along its normal with the unknowns.
    fn sensitivity(&self, pose: &Pose, slopes: &Slopes, point: &ContourPoint) -> Option<Match> {
        let placed_from_mesh = pose.placed_from_mesh();
        let placed = placed_from_mesh.transform_point3(point.position.as_dvec3());
        let (_, [of_x, of_y]) = self.camera.project_with_slopes(slopes.world(placed))?;
        let gradient = point.outward.x * of_x + point.outward.y * of_y;
        let (common, angle) = slopes.along(placed, gradient);
        let normal = placed_from_mesh
            .transform_vector3(point.normal.as_dvec3())
            .normalize_or_zero();
        let (slides, angle_slide) = slopes.along(placed, gradient.length() * slopes.turned(normal));
        Some(Match {
            distance: 0.0,
            certainty: Certainty::Common,
            doubt: 0.0,
            length: point.length,
            outer: point.outer,
            slopes: common,
            angle_slope: angle,
            slides,
            angle_slide,
            tile: tile(point.pixel, self.size()),
        })
    }

    fn matches_of(&self, pose: &Pose, frame: usize, level: usize) -> FrameMatches {
        let observed = &self.observed[frame];
        let pixels = (1u64 << level) as f64;
        let view = pose.view(self.camera, frame);
        let inner = self.settings.inner && observed.has_photograph();
        let points = self.contours.of_view(&view, self.size(), pixels, inner);
        let slopes = pose.slopes(frame);
        let mut matched = FrameMatches {
            points: Vec::with_capacity(points.len()),
            matches: Vec::with_capacity(points.len()),
            finest: Vec::new(),
        };
        for point in points {
            let found = observed.border(
                level,
                point.pixel,
                point.outward,
                REACH * pixels,
                point.outer,
            );
            matched
                .points
                .push((point, found.map(|border| border.distance)));
            let moves = self.sensitivity(pose, &slopes, &point);
            if let (Some(border), Some(moves)) = (found, moves) {
                matched.matches.push(Match {
                    distance: border.distance,
                    doubt: border.doubt,
                    ..moves
                });
            }
        }
        matched
    }

    fn equations(&self, frames: &[FrameMatches], level: usize) -> (Equations, f64) {
        // A thousandth of a pixel is beyond what any mask tells.
        let matches: Vec<Vec<Match>> = frames.iter().map(|f| f.matches.clone()).collect();
        let scale = scale(&matches, 1e-3 * (1u64 << level) as f64);
        let counting = counting(frames);
        let equations = Equations::new(&counting, scale, self.settings.angles, Kind::Outline);
        (equations, scale)
    }

    fn directions(&self, frames: &[FrameMatches], scale: f64) -> Directions {
        let surface = Equations::new(
            &counting(frames),
            scale,
            self.settings.angles,
            Kind::Surface,
        );
        directions(&surface.normal, &self.free, LEAST_SHARE, LARGEST_SIGMA)
    }

    /// What is known at the end of a search.
    fn result(
        &self,
        start: &Placement,
        pose: Pose,
        rounds: usize,
        stop: Stop,
    ) -> Result<Registered, RegistrationError> {
        let frames = self.matches(&pose, 0, true)?;
        let (equations, scale) = self.equations(&frames, 0);
        let directions = self.directions(&frames, scale);
        let unknown: Vec<String> = directions
            .unknown
            .iter()
            .map(|direction| sigmas::describe(direction, &pose))
            .collect();
        if !unknown.is_empty() && !self.settings.keep_unknown {
            return Err(RegistrationError::Undetermined { unknown });
        }
        let covariance = equations.covariance(&counting(&frames), scale, &directions.known);
        let sigma = sigmas::sigmas(&covariance, &directions.unknown, &self.free, &pose);
        let agreement = (frames.into_iter().enumerate())
            .map(|(number, frame)| {
                let angle = equations.angle_of(number, frame.counting(), scale);
                self.agreement(&pose, number, frame, angle)
            })
            .collect();
        Ok(Registered {
            placement: pose.placement(start),
            size: pose.size,
            sigma,
            scale,
            rounds,
            stop,
            unknown,
            frames: super::agreement::judged(agreement),
        })
    }

    fn agreement(
        &self,
        pose: &Pose,
        number: usize,
        frame: FrameMatches,
        angle: Option<(f64, f64)>,
    ) -> FrameAgreement {
        let outline: f64 = frame.points.iter().map(|(point, _)| point.length).sum();
        let matched: f64 = frame.matches.iter().map(|m| m.length).sum();
        let square: f64 = frame
            .matches
            .iter()
            .map(|m| m.length * m.distance * m.distance)
            .sum();
        let near: f64 = (frame.matches.iter())
            .filter(|m| m.distance.abs() <= 1.0)
            .map(|m| m.length)
            .sum();
        FrameAgreement {
            rms: (square / matched).sqrt(),
            near: if outline > 0.0 { near / outline } else { 0.0 },
            overlap: super::agreement::overlap(
                &self.contours,
                &pose.view(self.camera, number),
                self.size(),
                &self.observed[number],
            ),
            angle: pose.angles[number],
            angle_offset: angle.map(|(change, _)| change),
            angle_sigma: angle.map(|(_, sigma)| sigma),
            disagrees: Vec::new(),
            outline: (frame.points.iter())
                .map(|(point, found)| OutlinePoint {
                    pixel: point.pixel,
                    seen: found.map(|distance| point.pixel + distance * point.outward),
                })
                .collect(),
        }
    }
}

impl FrameMatches {
    fn counting(&self) -> &[Match] {
        if self.finest.is_empty() {
            &self.matches
        } else {
            &self.finest
        }
    }
}

fn counting(frames: &[FrameMatches]) -> Vec<Vec<Match>> {
    frames.iter().map(|f| f.counting().to_vec()).collect()
}

/// A step no longer than a fifth of a radian or of the size in any unknown, times `share`.
fn limited(step: &Step, angles: &[f64], share: f64) -> (Step, Vec<f64>) {
    const LONGEST: f64 = 0.2;
    let largest = step
        .iter()
        .chain(angles)
        .fold(0.0, |a: f64, x| a.max(x.abs()));
    let factor = share
        * if largest > LONGEST {
            LONGEST / largest
        } else {
            1.0
        };
    (
        step.map(|x| factor * x),
        angles.iter().map(|x| factor * x).collect(),
    )
}

/// Root mean square motion of the outlines by a step, pixels.
fn motion(frames: &[FrameMatches], step: &Step, angles: &[f64]) -> f64 {
    let (mut square, mut length) = (0.0, 0.0);
    for (frame, angle) in frames.iter().zip(angles) {
        for m in frame.counting() {
            let moved = dot(&m.slopes, step) + m.angle_slope * angle;
            square += m.length * moved * moved;
            length += m.length;
        }
    }
    if length > 0.0 {
        (square / length).sqrt()
    } else {
        0.0
    }
}
