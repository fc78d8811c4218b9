//! A turntable from cameras that go round a still object.
//!
//! Where others let the camera move, turnlight turns the object: frame `t` shows it turned by `θ_t`, so that
//!
//! ```text
//! camera_from_object(t) = camera_from_world · Q(θ_t; a, c),     Q x = c + R(a, θ_t) (x − c)
//! ```
//!
//! with one camera, the axis `a` through `c`, and world = object at θ = 0, the first frame. The axis starts
//! as the common direction of all relative rotations, the centre as the point that they leave in place; all
//! are then refined together over every frame's rotation and position (`arrow`).

use glam::{DAffine3, DMat3, DQuat, DVec3};
use nalgebra::{Matrix3, SVector};

use super::arrow::{self, Arrow, Block};
use super::calibration::nearest_rotation;
use crate::geometry::Turn;

/// Rotations by less than this tell nothing about an axis, radians.
const STILL: f64 = 1e-3;
/// Cameras on a turntable as structure from motion finds them are off by some hundredths of a degree and
/// some thousandths of their distance; a camera carried round by hand, by several degrees and per cent.
const LARGEST_ROTATION_ERROR: f64 = 1.0 / 57.3;
/// As [`LARGEST_ROTATION_ERROR`], of the cameras' distance from the axis.
const LARGEST_POSITION_ERROR: f64 = 0.02;

/// One camera before a turntable.
#[derive(Clone, Debug)]
pub struct Orbit {
    /// The camera at the first frame: axes (right, down, forward) and place in the object's frame.
    pub world_from_camera: DAffine3,
    /// Axis and centre, object's frame. The axis points to the camera's upper side; the centre is the point
    /// of the axis that the camera looks at most closely.
    pub turn: Turn,
    /// Of every frame, radians from 0 to 2π; 0 for the first.
    pub angles: Vec<f64>,
    /// How well the poses are those of a turntable.
    pub errors: OrbitErrors,
}

/// What is left between the poses and a turntable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrbitErrors {
    /// Root mean square angle between camera axes, radians.
    pub rotation: f64,
    /// Root mean square distance between camera positions, over `distance`.
    pub position: f64,
    /// Of the camera from the axis, in the file's unit.
    pub distance: f64,
    /// Frame that is furthest off.
    pub worst_frame: usize,
    /// Its angle, radians.
    pub worst_rotation: f64,
    /// Its distance, over `distance`.
    pub worst_position: f64,
}

/// Why there is no turntable.
#[derive(Debug, thiserror::Error)]
pub enum OrbitError {
    /// One pose has no axis.
    #[error("{0} pose: a turntable needs two or more; import the lens alone with --lens-only")]
    TooFew(usize),
    /// The camera does not turn.
    #[error(
        "the poses differ by {:.4}° at most: nothing turned; if the object did, mask the background before \
         structure from motion, so that poses follow the object", .0.to_degrees()
    )]
    Still(f64),
    /// The camera does not move on a circle.
    #[error(
        "the poses are not those of a turntable: cameras are off by {:.2}° and {:.1} % of their distance from the \
         axis (root mean square; at most {:.0}° and {:.0} % are taken), worst frame {} by {:.2}° and {:.1} %; \
         leave out bad frames, or import the lens alone with --lens-only",
        .0.rotation.to_degrees(), 100.0 * .0.position, LARGEST_ROTATION_ERROR.to_degrees(),
        100.0 * LARGEST_POSITION_ERROR, .0.worst_frame, .0.worst_rotation.to_degrees(),
        100.0 * .0.worst_position
    )]
    NotATurntable(OrbitErrors),
}

/// Finds the turntable behind poses (object from camera).
///
/// # Errors
/// There are fewer than two poses, they hardly differ, or they are not on a circle.
pub fn fit_orbit(poses: &[DAffine3]) -> Result<Orbit, OrbitError> {
    if poses.len() < 2 {
        return Err(OrbitError::TooFew(poses.len()));
    }
    let start = initial(poses)?;
    let fit = Fit {
        poses,
        scale: start.scale,
    };
    // Without rounding to speak of, the start is already the answer.
    let state = arrow::minimise(&fit, start.state.clone(), 200)
        .map_or(start.state, |minimum| minimum.state);
    finish(poses, state)
}

/// Unknowns.
#[derive(Clone)]
struct State {
    axis: DVec3,
    center: DVec3,
    /// The camera at angle 0.
    world_from_camera: DAffine3,
    angles: Vec<f64>,
}

struct Start {
    state: State,
    /// Distance that positions are measured in.
    scale: f64,
}

fn initial(poses: &[DAffine3]) -> Result<Start, OrbitError> {
    let quaternions: Vec<DQuat> = poses
        .iter()
        .map(|pose| DQuat::from_mat3(&pose.matrix3).normalize())
        .collect();
    // Camera t's axes are R(a, −θ) of the first's: the vector part of the turn between two frames is along
    // the axis. A few hundred references weigh all turns as well as all pairs would.
    let stride = poses.len().div_ceil(200);
    let mut spread = Matrix3::zeros();
    let mut largest = 0.0f64;
    for reference in quaternions.iter().step_by(stride) {
        for quaternion in &quaternions {
            let turn = *reference * quaternion.conjugate();
            let v = DVec3::new(turn.x, turn.y, turn.z);
            largest = largest.max(2.0 * v.length().min(1.0).asin());
            let v = nalgebra::Vector3::from(v.to_array());
            spread += v * v.transpose();
        }
    }
    if largest < STILL {
        return Err(OrbitError::Still(largest));
    }
    let eigen = spread.symmetric_eigen();
    let axis = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let axis = DVec3::new(axis[0], axis[1], axis[2]).normalize();
    let angles: Vec<f64> = quaternions
        .iter()
        .map(|quaternion| {
            let turn = quaternions[0] * quaternion.conjugate();
            2.0 * DVec3::new(turn.x, turn.y, turn.z).dot(axis).atan2(turn.w)
        })
        .collect();

    // p_t = c + R(−θ)(p_0 − c): linear in c, but for its place along the axis.
    let first = poses[0].translation;
    let (mut matrix, mut right) = (Matrix3::zeros(), nalgebra::Vector3::zeros());
    for (pose, angle) in poses.iter().zip(&angles) {
        let back = DMat3::from_axis_angle(axis, -angle);
        let m = DMat3::IDENTITY - back;
        let b = pose.translation - back * first;
        let (m, b) = (
            Matrix3::from_column_slice(&m.to_cols_array()),
            nalgebra::Vector3::from(b.to_array()),
        );
        matrix += m.transpose() * m;
        right += m.transpose() * b;
    }
    let along = nalgebra::Vector3::from(axis.to_array());
    matrix += along * along.transpose() * matrix.trace();
    let center = matrix.try_inverse().map_or(DVec3::ZERO, |inverse| {
        let c = inverse * right;
        DVec3::new(c[0], c[1], c[2])
    });
    let offset = first - center;
    let radius = (offset - axis * offset.dot(axis)).length();
    let extent = poses
        .iter()
        .map(|pose| (pose.translation - first).length())
        .fold(0.0, f64::max);
    Ok(Start {
        scale: radius.max(extent).max(1e-12),
        state: State {
            axis,
            center,
            world_from_camera: poses[0],
            angles,
        },
    })
}

struct Fit<'a> {
    poses: &'a [DAffine3],
    scale: f64,
}

/// Two directions square to the axis.
fn tangents(axis: DVec3) -> [DVec3; 2] {
    let first = axis.any_orthonormal_vector();
    [first, axis.cross(first)]
}

/// `[v]×`.
fn cross_matrix(v: DVec3) -> DMat3 {
    DMat3::from_cols(v.cross(DVec3::X), v.cross(DVec3::Y), v.cross(DVec3::Z))
}

/// Columns of a matrix beside each other.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// Shared: axis (2), centre across the axis (2), camera turn (3) and place (3); of a frame: its angle.
impl Arrow<10, 1> for Fit<'_> {
    type State = State;

    fn blocks(&self) -> usize {
        self.poses.len()
    }

    fn linearise(&self, state: &State, frame: usize) -> Option<Block<10, 1>> {
        let angle = state.angles[frame];
        let (sin, cos) = angle.sin_cos();
        let axis = state.axis;
        // R(a, −θ), and its derivatives by angle and axis.
        let back = DMat3::from_axis_angle(axis, -angle);
        let by_angle = -(cross_matrix(axis) * back);
        let by_axis = tangents(axis)
            .map(|u| cross_matrix(u) * -sin + (outer(axis, u) + outer(u, axis)) * (1.0 - cos));
        let camera = state.world_from_camera;
        let offset = camera.translation - state.center;
        let pose = &self.poses[frame];
        let mut block = Block::empty();
        // Positions, in units of the cameras' distance.
        let s = 1.0 / self.scale;
        let position = (state.center + back * offset - pose.translation) * s;
        let across = tangents(axis).map(|u| (u - back * u) * s);
        for i in 0..3 {
            let mut shared = SVector::<f64, 10>::zeros();
            for k in 0..2 {
                shared[k] = (by_axis[k] * offset)[i] * s;
                shared[2 + k] = across[k][i];
            }
            for k in 0..3 {
                shared[7 + k] = back.col(k)[i] * s;
            }
            let own = SVector::from([(by_angle * offset)[i] * s]);
            block.add(position[i], &shared, &own);
        }
        // Axes of the camera: their differences, over √2, are the angle between them.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        for column in 0..3 {
            let v = camera.matrix3.col(column);
            let difference = (back * v - pose.matrix3.col(column)) * half;
            for i in 0..3 {
                let mut shared = SVector::<f64, 10>::zeros();
                for k in 0..2 {
                    shared[k] = (by_axis[k] * v)[i] * half;
                }
                for k in 0..3 {
                    shared[4 + k] = (back * DVec3::AXES[k].cross(v))[i] * half;
                }
                let own = SVector::from([(by_angle * v)[i] * half]);
                block.add(difference[i], &shared, &own);
            }
        }
        Some(block)
    }

    fn moved(&self, state: &State, shared: &SVector<f64, 10>, own: &[SVector<f64, 1>]) -> State {
        let [u, v] = tangents(state.axis);
        let turn = DQuat::from_scaled_axis(DVec3::new(shared[4], shared[5], shared[6]));
        let turned = DMat3::from_quat(turn) * state.world_from_camera.matrix3;
        State {
            axis: (state.axis + u * shared[0] + v * shared[1]).normalize(),
            center: state.center + u * shared[2] + v * shared[3],
            world_from_camera: DAffine3 {
                matrix3: nearest_rotation(turned),
                translation: state.world_from_camera.translation
                    + DVec3::new(shared[7], shared[8], shared[9]),
            },
            angles: state
                .angles
                .iter()
                .zip(own)
                .map(|(a, o)| a + o[0])
                .collect(),
        }
    }
}

/// Angles from the first frame's, the axis up, the centre where the camera looks; refuses what is no
/// turntable.
fn finish(poses: &[DAffine3], state: State) -> Result<Orbit, OrbitError> {
    let errors = errors(poses, &state);
    if !errors.rotation.is_finite()
        || !errors.position.is_finite()
        || errors.rotation > LARGEST_ROTATION_ERROR
        || errors.position > LARGEST_POSITION_ERROR
    {
        return Err(OrbitError::NotATurntable(errors));
    }
    // The camera at the first frame's angle takes the place of the one at 0.
    let back = around(&state, -state.angles[0]);
    let world_from_camera = back * state.world_from_camera;
    let (down, forward) = (
        world_from_camera.matrix3.y_axis,
        world_from_camera.matrix3.z_axis,
    );
    let offset = world_from_camera.translation - state.center;
    let upward = -down.dot(state.axis);
    // A camera that looks along the axis has its upper side across it: then it is above.
    let sense = if upward.abs() > 0.1 {
        upward
    } else {
        offset.dot(state.axis)
    };
    let sign = if sense < 0.0 { -1.0 } else { 1.0 };
    let axis = state.axis * sign;
    // Nearest points of two lines: the axis and the camera's line of sight.
    let cosine = axis.dot(forward);
    let square = 1.0 - cosine * cosine;
    let along = if square > 1e-6 {
        (offset.dot(axis) - offset.dot(forward) * cosine) / square
    } else {
        0.0
    };
    let tau = std::f64::consts::TAU;
    let angle = |angle: &f64| {
        let turned = ((angle - state.angles[0]) * sign).rem_euclid(tau);
        // Rounding below 0 is not a whole turn.
        if tau - turned < 1e-9 { 0.0 } else { turned }
    };
    Ok(Orbit {
        world_from_camera,
        turn: Turn {
            axis,
            center: state.center + axis * along,
        },
        angles: state.angles.iter().map(angle).collect(),
        errors,
    })
}

/// The rigid motion by `angle` about the axis.
fn around(state: &State, angle: f64) -> DAffine3 {
    Turn {
        axis: state.axis,
        center: state.center,
    }
    .world_from_object(angle)
}

fn errors(poses: &[DAffine3], state: &State) -> OrbitErrors {
    let offset = state.world_from_camera.translation - state.center;
    let distance = (offset - state.axis * offset.dot(state.axis)).length();
    let of = |(pose, angle): (&DAffine3, &f64)| {
        let model = around(state, -angle) * state.world_from_camera;
        let turn = DQuat::from_mat3(&(model.matrix3.transpose() * pose.matrix3)).normalize();
        let rotation = 2.0 * DVec3::new(turn.x, turn.y, turn.z).length().min(1.0).asin();
        let position = (model.translation - pose.translation).length() / distance;
        (rotation, position)
    };
    let all: Vec<(f64, f64)> = poses.iter().zip(&state.angles).map(of).collect();
    let mean = |square: &dyn Fn(&(f64, f64)) -> f64| {
        (all.iter().map(square).sum::<f64>() / all.len() as f64).sqrt()
    };
    let badness = |(rotation, position): &(f64, f64)| {
        rotation / LARGEST_ROTATION_ERROR + position / LARGEST_POSITION_ERROR
    };
    let worst_frame = (0..all.len())
        .max_by(|a, b| badness(&all[*a]).total_cmp(&badness(&all[*b])))
        .unwrap_or(0);
    OrbitErrors {
        rotation: mean(&|(rotation, _)| rotation * rotation),
        position: mean(&|(_, position)| position * position),
        distance,
        worst_frame,
        worst_rotation: all[worst_frame].0,
        worst_position: all[worst_frame].1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Poses of a camera round a still object.
    fn poses(turn: &Turn, camera: DAffine3, angles: &[f64]) -> Vec<DAffine3> {
        angles
            .iter()
            .map(|angle| turn.world_from_object(*angle).inverse() * camera)
            .collect()
    }

    fn looking(from: DVec3, at: DVec3) -> DAffine3 {
        let forward = (at - from).normalize();
        let right = forward.cross(DVec3::Y).normalize();
        DAffine3 {
            matrix3: DMat3::from_cols(right, forward.cross(right), forward),
            translation: from,
        }
    }

    proptest! {
        #[test]
        fn a_turntable_is_found_again(
            tilt in -0.3f64..0.3, x in -2.0f64..2.0, step in 0.05f64..0.5, count in 2usize..40,
        ) {
            let turn = Turn { axis: DVec3::new(tilt, 1.0, -0.2).normalize(), center: DVec3::new(x, 0.3, -0.5) };
            let camera = looking(DVec3::new(0.2, 1.5, 4.0), DVec3::new(0.1, 0.0, 0.0));
            let angles: Vec<f64> = (0..count).map(|i| step * i as f64).collect();
            let all = poses(&turn, camera, &angles);
            let found = fit_orbit(&all).unwrap();
            prop_assert!((found.turn.axis - turn.axis).length() < 1e-8, "{:?}", found.turn);
            let offset = found.turn.center - turn.center;
            prop_assert!((offset - turn.axis * offset.dot(turn.axis)).length() < 1e-7, "{offset}");
            for ((pose, angle), expected) in all.iter().zip(&found.angles).zip(&angles) {
                let back = found.turn.world_from_object(*angle).inverse() * found.world_from_camera;
                prop_assert!(back.abs_diff_eq(*pose, 1e-7));
                let whole = (angle - expected).rem_euclid(std::f64::consts::TAU);
                prop_assert!(whole.min(std::f64::consts::TAU - whole) < 1e-8);
            }
        }
    }

    #[test]
    fn noise_is_averaged_and_reported() {
        let turn = Turn {
            axis: DVec3::Y,
            center: DVec3::ZERO,
        };
        let camera = looking(DVec3::new(0.0, 1.0, 4.0), DVec3::ZERO);
        let angles: Vec<f64> = (0..36).map(|i| f64::from(i) * 10f64.to_radians()).collect();
        let mut all = poses(&turn, camera, &angles);
        // Half a thousandth of a radian and of the distance, in different directions.
        for (i, pose) in all.iter_mut().enumerate() {
            let direction =
                DVec3::new((7 * i) as f64, (11 * i + 1) as f64, (13 * i + 2) as f64).map(f64::sin);
            *pose = DAffine3 {
                matrix3: DMat3::from_quat(DQuat::from_scaled_axis(5e-4 * direction)) * pose.matrix3,
                translation: pose.translation + 2e-3 * direction,
            };
        }
        let found = fit_orbit(&all).unwrap();
        assert!(
            (found.turn.axis - DVec3::Y).length() < 2e-4,
            "{}",
            found.turn.axis
        );
        assert!(found.errors.rotation > 2e-4 && found.errors.rotation < 1e-3);
        assert!(found.errors.position > 2e-4 && found.errors.position < 1e-3);
    }

    #[test]
    fn other_paths_are_refused_with_figures() {
        let still = vec![looking(DVec3::Z, DVec3::ZERO); 3];
        assert!(matches!(fit_orbit(&still), Err(OrbitError::Still(_))));
        assert!(matches!(fit_orbit(&still[..1]), Err(OrbitError::TooFew(1))));
        let wander: Vec<DAffine3> = (0..12)
            .map(|i| {
                let t = f64::from(i) * 0.5;
                looking(
                    DVec3::new(4.0 * t.sin(), 1.5 * (2.0 * t).sin(), 4.0 * t.cos()),
                    DVec3::ZERO,
                )
            })
            .collect();
        let error = fit_orbit(&wander).unwrap_err();
        assert!(matches!(error, OrbitError::NotATurntable(_)), "{error}");
        assert!(error.to_string().contains("worst frame"), "{error}");
    }
}
