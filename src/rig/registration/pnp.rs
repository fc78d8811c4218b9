//! The object's pose from clicked pairs: points of the mesh and their pixels in one frame.
//!
//! ```text
//! min Σ_k | π( c + R(a, θ) (M X_k − c) ) − pixel_k |²
//! ```
//!
//! For a given rotation the best translation solves a linear system, since `(X_z) x' − X_x = 0` for every
//! ideal image point `x'`. From 48 rotations spread over all, that translation and then damped
//! Gauss–Newton steps lead to the minima; the lowest wins.

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3};

use super::equations::{Certainty, Equations, Kind, Match, directions};
use super::pose::{Placement, Pose, UNKNOWNS};
use crate::geometry::Similarity;
use crate::rig::Camera;

/// A point of the mesh and where a frame shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clicked {
    /// Mesh file's coordinates.
    pub point: DVec3,
    /// Pixel coordinates, the centre of the top left pixel at (½, ½).
    pub pixel: DVec2,
}

/// A pose that suits clicked pairs.
#[derive(Clone, Copy, Debug)]
pub struct PairsPose {
    /// Object frame from mesh file, at angle 0.
    pub object_from_file: Similarity,
    /// Root mean square distance of projected points from their pixels.
    pub rms: f64,
    /// Whether another pose, turned by more than 10°, suits them nearly as well.
    pub ambiguous: bool,
}

/// Why pairs give no pose.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PnpError {
    /// Too few.
    #[error("{0} pairs are too few: give 4 or more, 6 spread over the object for a good start")]
    TooFew(usize),
    /// Points in a line or in one place.
    #[error(
        "the points are nearly in one place or in one line, which leaves a turn open: spread them over \
         the object"
    )]
    Degenerate,
    /// No pose of all points before the camera comes near.
    #[error(
        "no pose before the camera suits the pairs; check that points are in the mesh file's coordinates, \
         pixels in (column, row), and the camera's numbers"
    )]
    Behind,
    /// No pose suits them.
    #[error(
        "no pose suits the pairs: the best leaves {rms:.0} pixels, most at pairs[{worst}]; check that points \
         are in the mesh file's coordinates, pixels in (column, row), and the camera's numbers"
    )]
    Apart {
        /// Root mean square distance, pixels.
        rms: f64,
        /// Index of the worst pair.
        worst: usize,
    },
}

/// Largest root mean square distance that still counts as a pose, as a share of the image's diagonal.
const LARGEST_RMS: f64 = 0.05;

/// The pose of the object in a frame at `angle` (radians) in which `pairs` were clicked. Scale and
/// turntable are those of `given`.
///
/// # Errors
/// If there are fewer than four pairs, if they lie in a line, or if no pose suits them.
pub fn pose_from_pairs(
    camera: &Camera,
    given: &Placement,
    angle: f64,
    pairs: &[Clicked],
) -> Result<PairsPose, PnpError> {
    if pairs.len() < 4 {
        return Err(PnpError::TooFew(pairs.len()));
    }
    let scale = given.object_from_file.scale;
    let centre = pairs.iter().map(|pair| pair.point).sum::<DVec3>() / pairs.len() as f64;
    let arms: Vec<DVec3> = pairs.iter().map(|pair| pair.point - centre).collect();
    let reach = arms.iter().map(|arm| arm.length()).fold(0.0, f64::max);
    let size = scale * reach;
    if !(size > 0.0 && size.is_finite()) {
        return Err(PnpError::Degenerate);
    }
    let search = Search {
        camera,
        pairs,
        arms: &arms,
        at_angle: given.turn.world_from_object(angle),
        turn: Placement {
            angles: vec![angle],
            ..given.clone()
        },
        scale,
        size,
    };
    let mut minima: Vec<Minimum> = rotations()
        .iter()
        .filter_map(|r| search.minimum(*r))
        .collect();
    minima.sort_by(|a, b| a.rms.total_cmp(&b.rms));
    let Some(best) = minima.first() else {
        return Err(PnpError::Behind);
    };
    let diagonal = (camera.width as f64).hypot(camera.height as f64);
    if best.rms > LARGEST_RMS * diagonal {
        let worst = search.distances(&best.pose).into_iter().enumerate();
        let worst = worst
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map_or(0, |(i, _)| i);
        return Err(PnpError::Apart {
            rms: best.rms,
            worst,
        });
    }
    if search.is_open(&best.pose) {
        return Err(PnpError::Degenerate);
    }
    let rotation = |minimum: &Minimum| minimum.pose.placed_from_mesh().matrix3 / scale;
    let turned = |other: &Minimum| {
        DQuat::from_mat3(&(rotation(other) * rotation(best).transpose()))
            .to_scaled_axis()
            .length()
    };
    let ambiguous = minima
        .iter()
        .any(|other| other.rms < 2.0 * best.rms + 1.0 && turned(other) > 10f64.to_radians());
    let placed = best.pose.placed_from_mesh();
    let object_from_file = Similarity {
        scale,
        rotation: DQuat::from_mat3(&rotation(best)).normalize(),
        translation: placed.transform_point3(-centre),
    };
    Ok(PairsPose {
        object_from_file,
        rms: best.rms,
        ambiguous,
    })
}

struct Search<'a> {
    camera: &'a Camera,
    pairs: &'a [Clicked],
    /// Points from their centre, mesh file's units.
    arms: &'a [DVec3],
    /// World from object in the clicked frame.
    at_angle: DAffine3,
    turn: Placement,
    scale: f64,
    size: f64,
}

struct Minimum {
    pose: Pose,
    rms: f64,
}

impl Search<'_> {
    /// Where steps lead to from a rotation, camera from file.
    fn minimum(&self, rotation: DMat3) -> Option<Minimum> {
        let translation = self.translation(&rotation)?;
        let axes = self.camera.world_from_camera;
        let world_from_arms = DAffine3 {
            matrix3: axes * rotation * self.scale,
            translation: self.camera.position + axes * translation,
        };
        let placed = self.at_angle.inverse() * world_from_arms;
        let mut pose = Pose::new(&self.turn, placed, self.size);
        let mut cost = self.cost(&pose)?;
        let mut damping = 1e-3;
        let free = basis();
        for _ in 0..100 {
            let matches = self.matches(&pose)?;
            let (step, _) = equations(&matches).solve(&free, damping);
            let next = pose.stepped(&step, &[0.0]);
            match self.cost(&next).filter(|lower| *lower < cost) {
                Some(lower) => {
                    let still = cost - lower < 1e-14 * cost;
                    (pose, cost, damping) = (next, lower, 0.1 * damping);
                    if still {
                        break;
                    }
                }
                None => damping *= 10.0,
            }
            if damping > 1e8 {
                break;
            }
        }
        let rms = (cost / self.pairs.len() as f64).sqrt();
        rms.is_finite().then_some(Minimum { pose, rms })
    }

    /// The best translation for a rotation, camera frame; `None` where it does not stand before the camera.
    fn translation(&self, rotation: &DMat3) -> Option<DVec3> {
        let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for (pair, arm) in self.pairs.iter().zip(self.arms) {
            let ideal = self.camera.ideal_point(pair.pixel);
            let turned = self.scale * (*rotation * *arm);
            for (row, rest) in [
                (
                    DVec3::new(1.0, 0.0, -ideal.x),
                    ideal.x * turned.z - turned.x,
                ),
                (
                    DVec3::new(0.0, 1.0, -ideal.y),
                    ideal.y * turned.z - turned.y,
                ),
            ] {
                normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
                right += rest * row;
            }
        }
        let translation = normal.inverse() * right;
        (translation.is_finite() && translation.z > 0.0).then_some(translation)
    }

    fn distances(&self, pose: &Pose) -> Vec<f64> {
        let matches = self.matches(pose).unwrap_or_default();
        matches
            .chunks(2)
            .map(|two| {
                two.iter()
                    .map(|m| m.distance * m.distance)
                    .sum::<f64>()
                    .sqrt()
            })
            .collect()
    }

    fn cost(&self, pose: &Pose) -> Option<f64> {
        let cost: f64 = self
            .matches(pose)?
            .iter()
            .map(|m| m.distance * m.distance)
            .sum();
        cost.is_finite().then_some(cost)
    }

    /// Two rows a pair; `None` where a point is behind the camera.
    fn matches(&self, pose: &Pose) -> Option<Vec<Match>> {
        let slopes = pose.slopes(0);
        let placed_from_mesh = pose.placed_from_mesh();
        let mut matches = Vec::with_capacity(2 * self.pairs.len());
        for (pair, arm) in self.pairs.iter().zip(self.arms) {
            let placed = placed_from_mesh.transform_point3(*arm);
            let (pixel, of) = self.camera.project_with_slopes(slopes.world(placed))?;
            for (distance, gradient) in (pair.pixel - pixel).to_array().into_iter().zip(of) {
                let (common, angle_slope) = slopes.along(placed, gradient);
                matches.push(Match {
                    distance,
                    certainty: Certainty::Common,
                    outer: true,
                    doubt: 0.0,
                    length: 1.0,
                    slopes: common,
                    angle_slope,
                    slides: common,
                    angle_slide: angle_slope,
                    tile: (0, 0),
                });
            }
        }
        Some(matches)
    }

    /// Whether a turn or a shift of the object leaves the pixels nearly where they are: clicks are good to
    /// a pixel.
    fn is_open(&self, pose: &Pose) -> bool {
        let Some(matches) = self.matches(pose) else {
            return true;
        };
        let per_pixel = equations(&matches)
            .normal
            .map(|row| row.map(|x| x * PLAIN * PLAIN));
        !directions(&per_pixel, &[0, 1, 2, 3, 4, 5], 1e-6, 0.5)
            .unknown
            .is_empty()
    }
}

/// A scale far beyond any distance: all weights are equal, as in plain least squares.
const PLAIN: f64 = 1e7;

fn equations(matches: &[Match]) -> Equations {
    Equations::new(&[matches.to_vec()], PLAIN, false, Kind::Outline)
}

/// The object's six unknowns.
fn basis() -> Vec<[f64; UNKNOWNS]> {
    (0..6)
        .map(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))))
        .collect()
}

/// The 24 turns of a cube, and the same turned by 45° about its diagonal.
fn rotations() -> Vec<DMat3> {
    let axes = [
        DVec3::X,
        -DVec3::X,
        DVec3::Y,
        -DVec3::Y,
        DVec3::Z,
        -DVec3::Z,
    ];
    let between = DMat3::from_axis_angle(DVec3::ONE.normalize(), 45f64.to_radians());
    let mut rotations = Vec::new();
    for x in axes {
        for y in axes.into_iter().filter(|y| y.dot(x) == 0.0) {
            let turn = DMat3::from_cols(x, y, x.cross(y));
            rotations.push(turn);
            rotations.push(turn * between);
        }
    }
    rotations
}
