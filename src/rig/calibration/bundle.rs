//! The least-squares problem of all corners: nine parameters of the lens, six of every board's pose.
//!
//! A pose moves by `R ← exp([w]×) R, t ← t + d`, so that `∂p/∂w = −[R M]×` and `∂p/∂d = 1` for the point
//! `p = R M + t` in the camera's axes.

use glam::{DAffine3, DMat2, DMat3, DQuat, DVec2, DVec3};
use nalgebra::SVector;

use super::super::arrow::{self, Arrow, Block, Stop};
use super::closed_form::Start;
use super::{BoardView, FreeDistortion};
use crate::rig::Distortion;

/// A damped iteration that has not ended by then goes nowhere; sound sets need ten to thirty steps.
const MOST_STEPS: usize = 500;

pub(super) struct Bundle<'a> {
    views: &'a [BoardView],
    free: FreeDistortion,
}

/// Where the iteration ended.
pub(super) struct Solution {
    /// fx, fy, cx, cy (pixels), k1, k2, p1, p2, k3.
    pub(super) parameters: [f64; 9],
    /// Board to camera, one per view.
    pub(super) poses: Vec<DAffine3>,
    /// Sum of squared distances, pixels².
    pub(super) cost: f64,
    /// Standard deviation of a corner's coordinate, pixels.
    pub(super) noise: f64,
    /// Standard deviations of the parameters for corners of unit standard deviation; `None` where the views
    /// do not determine them.
    pub(super) unit_sigma: Option<[f64; 9]>,
    pub(super) stop: Stop,
    pub(super) steps: usize,
}

#[derive(Clone)]
pub(super) struct State {
    lens: [f64; 9],
    poses: Vec<DAffine3>,
}

impl<'a> Bundle<'a> {
    pub(super) fn new(views: &'a [BoardView], free: FreeDistortion) -> Self {
        Self { views, free }
    }

    /// The minimum near `start`, or `None` where a board begins behind the camera.
    pub(super) fn solve(&self, start: &Start) -> Option<Solution> {
        let [fx, fy, cx, cy] = start.intrinsics;
        let state = State {
            lens: [fx, fy, cx, cy, 0.0, 0.0, 0.0, 0.0, 0.0],
            poses: start.poses.clone(),
        };
        let found = arrow::minimise(self, state, MOST_STEPS)?;
        let residuals: usize = self.views.iter().map(|view| 2 * view.corners.len()).sum();
        let held = self.free.iter().filter(|free| !**free).count();
        let unknowns = 9 - held + 6 * self.views.len();
        let unit_sigma = found.shared_covariance.and_then(|covariance| {
            let sigma: [f64; 9] = std::array::from_fn(|i| covariance[(i, i)].sqrt());
            let known = |i: usize| sigma[i] > 0.0 || (i >= 4 && !self.free[i - 4]);
            (0..9).all(known).then_some(sigma)
        });
        Some(Solution {
            parameters: found.state.lens,
            poses: found.state.poses,
            cost: found.cost,
            noise: (found.cost / residuals.saturating_sub(unknowns).max(1) as f64).sqrt(),
            unit_sigma,
            stop: found.stop,
            steps: found.steps,
        })
    }
}

impl Arrow<9, 6> for Bundle<'_> {
    type State = State;

    fn blocks(&self) -> usize {
        self.views.len()
    }

    fn linearise(&self, state: &State, block: usize) -> Option<Block<9, 6>> {
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = state.lens;
        let distortion = Distortion { k1, k2, p1, p2, k3 };
        let focal = DVec2::new(fx, fy);
        let pose = &state.poses[block];
        let mut found = Block::empty();
        for corner in &self.views[block].corners {
            let turned = pose.matrix3 * corner.board.extend(0.0);
            let p = turned + pose.translation;
            // A focal length through zero, or a point behind the camera, is no lens at all.
            if !(p.z > 1e-9 && fx > 0.0 && fy > 0.0) {
                return None;
            }
            let ideal = p.truncate() / p.z;
            let bent = distortion.distort(ideal);
            let residual = focal * bent + DVec2::new(cx, cy) - corner.pixel;
            let by_ideal = distortion_by_ideal(&distortion, ideal);
            let by_coefficient = distortion_by_coefficient(ideal);
            for axis in 0..2 {
                let mut shared = SVector::<f64, 9>::zeros();
                shared[axis] = bent[axis];
                shared[2 + axis] = 1.0;
                for (k, free) in self.free.iter().enumerate() {
                    if *free {
                        shared[4 + k] = focal[axis] * by_coefficient[k][axis];
                    }
                }
                let row = focal[axis] * by_ideal.row(axis) / p.z;
                let by_point = DVec3::new(row.x, row.y, -row.dot(ideal));
                let by_turn = turned.cross(by_point);
                let own = SVector::from([
                    by_turn.x, by_turn.y, by_turn.z, by_point.x, by_point.y, by_point.z,
                ]);
                found.add(residual[axis], &shared, &own);
            }
        }
        Some(found)
    }

    fn moved(&self, state: &State, shared: &SVector<f64, 9>, own: &[SVector<f64, 6>]) -> State {
        let pose = |(pose, step): (&DAffine3, &SVector<f64, 6>)| {
            let turn = DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2]));
            let rotation = DMat3::from_quat(turn) * pose.matrix3;
            DAffine3 {
                // Through a quaternion, so that rounding does not add up to shear.
                matrix3: DMat3::from_quat(DQuat::from_mat3(&rotation).normalize()),
                translation: pose.translation + DVec3::new(step[3], step[4], step[5]),
            }
        };
        State {
            lens: std::array::from_fn(|i| state.lens[i] + shared[i]),
            poses: state.poses.iter().zip(own).map(pose).collect(),
        }
    }
}

/// Derivatives of the distorted point by the ideal one: row = distorted, column = ideal.
fn distortion_by_ideal(d: &Distortion, p: DVec2) -> DMat2 {
    let r2 = p.length_squared();
    let radial = 1.0 + r2 * (d.k1 + r2 * (d.k2 + r2 * d.k3));
    // d(radial)/d(r²).
    let slope = d.k1 + r2 * (2.0 * d.k2 + 3.0 * r2 * d.k3);
    let cross = 2.0 * (p.x * p.y * slope + d.p1 * p.x + d.p2 * p.y);
    DMat2::from_cols(
        DVec2::new(
            radial + 2.0 * p.x * p.x * slope + 2.0 * d.p1 * p.y + 6.0 * d.p2 * p.x,
            cross,
        ),
        DVec2::new(
            cross,
            radial + 2.0 * p.y * p.y * slope + 6.0 * d.p1 * p.y + 2.0 * d.p2 * p.x,
        ),
    )
}

/// Derivatives of the distorted point by k1, k2, p1, p2, k3.
fn distortion_by_coefficient(p: DVec2) -> [DVec2; 5] {
    let r2 = p.length_squared();
    let xy = 2.0 * p.x * p.y;
    [
        p * r2,
        p * r2 * r2,
        DVec2::new(xy, r2 + 2.0 * p.y * p.y),
        DVec2::new(r2 + 2.0 * p.x * p.x, xy),
        p * r2 * r2 * r2,
    ]
}

#[cfg(test)]
mod tests {
    use super::super::{Corner, closed_form};
    use super::*;

    #[test]
    fn derivatives_match_differences() {
        // The gradient of the cost in every direction, through the public face of the block: a step along
        // one unknown changes the cost by gradient times step.
        let corner = |x: f64, y: f64| Corner {
            board: DVec2::new(x, y),
            pixel: DVec2::new(310.0 + 60.0 * x + 3.0 * y, 250.0 - 4.0 * x + 55.0 * y),
        };
        let views = [BoardView {
            name: String::new(),
            corners: (0..12)
                .map(|i| corner(f64::from(i % 4) - 1.5, f64::from(i / 4) - 1.0))
                .collect(),
        }];
        let bundle = Bundle::new(&views, [true; 5]);
        let pose = closed_form::initial(DVec2::new(640.0, 480.0), &views).poses[0];
        let state = State {
            lens: [500.0, 520.0, 310.0, 245.0, -0.2, 0.1, 0.01, -0.02, 0.05],
            poses: vec![DAffine3 {
                translation: pose.translation + DVec3::new(0.1, -0.2, 0.5),
                matrix3: pose.matrix3 * DMat3::from_rotation_x(0.3),
            }],
        };
        let cost = |shared: &SVector<f64, 9>, own: SVector<f64, 6>| {
            let moved = bundle.moved(&state, shared, &[own]);
            bundle.linearise(&moved, 0).unwrap().cost()
        };
        let gradient = bundle.linearise(&state, 0).unwrap().gradient();
        for unknown in 0..15 {
            let size = if unknown < 4 { 1e-3 } else { 1e-6 };
            let (mut shared, mut own) = (SVector::zeros(), SVector::zeros());
            if unknown < 9 {
                shared[unknown] = size;
            } else {
                own[unknown - 9] = size;
            }
            let difference = (cost(&shared, own) - cost(&-shared, -own)) / (2.0 * size);
            let exact = 2.0 * gradient[unknown];
            assert!(
                (difference - exact).abs() <= 1e-5 * exact.abs().max(1.0),
                "{unknown}: {difference} {exact}"
            );
        }
    }
}
