//! Camera calibration from photographs of a flat board (Zhang 2000, *A Flexible New Technique for Camera
//! Calibration*).
//!
//! Corner `j` of the board in photograph `i` is seen at `m_ij`. With the board's points in its own plane,
//! `M_j = (X_j, Y_j, 0)`, and the lens of [`super::Camera`],
//!
//! ```text
//! min Σ_ij | m_ij − lens(R_i M_j + t_i) |²       over fx fy cx cy k1 k2 p1 p2 k3 and all R_i, t_i   (Zhang, Eq. 14)
//! ```
//!
//! starting from the closed form without distortion (`closed_form`), by Levenberg–Marquardt with exact
//! derivatives (`bundle`). The covariance of the intrinsics is `σ² (J'J)⁻¹`, `σ²` the residual variance.

mod bundle;
mod closed_form;
#[cfg(test)]
mod laws;

use glam::{DAffine3, DVec2, DVec3};

pub use super::arrow::Stop;
use super::{CameraError, Distortion, Intrinsics, Lens};
pub(super) use closed_form::nearest_rotation;

/// Fewer photographs than this leave the lens to chance.
pub const FEWEST_PHOTOGRAPHS: usize = 3;
/// A board's pose and its share of the lens are known from this many corners.
pub const FEWEST_CORNERS: usize = 8;
/// A focal length that is known no better than this, relative, is refused. Sound sets of ten photographs
/// reach 0.1 %; boards that differ in tilt by less than a few degrees leave 10 % and more.
const LOOSEST_FOCAL_LENGTH: f64 = 0.05;
/// Boards whose normals differ by less add nothing to one board (Zhang 2000, §3.3): the lens then rests on
/// its distortion alone. Radians.
const LEAST_TILT: f64 = 3.0 / 57.3;
/// Corners are never trusted beyond this, pixels: synthetic ones would make any set look determined.
const BEST_CORNER: f64 = 0.02;
/// A photograph whose corners are off by more than this many times the median photograph's is named.
/// Sound photographs of one board stay within 2.
const OUTLIER: f64 = 3.0;

/// A corner of the board and where it was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Place on the board, its plane's own axes, any unit that is the same for all photographs.
    pub board: DVec2,
    /// Pixels, the centre of the top left pixel at (½, ½).
    pub pixel: DVec2,
}

/// The corners seen in one photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardView {
    /// What to call the photograph.
    pub name: String,
    /// At least [`FEWEST_CORNERS`], not in a line.
    pub corners: Vec<Corner>,
}

/// Which of `k1, k2, p1, p2, k3` are sought; the others stay 0.
pub type FreeDistortion = [bool; 5];

/// A found lens.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The lens.
    pub lens: Lens,
    /// Standard deviations of fx, fy, cx, cy, pixels; see [`Calibration::deviations`].
    pub intrinsics_sigma: Intrinsics,
    /// Standard deviations of the distortion; 0 for coefficients that were held.
    pub distortion_sigma: Distortion,
    /// Root mean square distance of a corner from its prediction, pixels.
    pub rms: f64,
    /// One per photograph, in their order.
    pub photographs: Vec<PhotographFit>,
    /// Largest angle between two boards' normals, radians.
    pub largest_tilt: f64,
    /// Share of the image's 8 × 6 cells in which a corner was seen.
    pub coverage: f64,
    /// Why the iteration ended.
    pub stop: Stop,
    /// Steps of the iteration.
    pub steps: usize,
}

/// How well one photograph agrees.
#[derive(Clone, Debug)]
pub struct PhotographFit {
    /// What the photograph is called.
    pub name: String,
    /// Board to camera (right, down, forward), the board's unit.
    pub camera_from_board: DAffine3,
    /// Corners used.
    pub corners: usize,
    /// Root mean square distance of its corners from their predictions, pixels.
    pub rms: f64,
    /// The largest such distance, pixels.
    pub worst: f64,
    /// Whether it disagrees with the others.
    pub outlier: bool,
}

/// Why there is no calibration.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// Too few photographs.
    #[error(
        "{count} photographs show the board: at least {FEWEST_PHOTOGRAPHS} are needed, ten or more are \
         better; photograph it tilted by 20° to 45° in different directions"
    )]
    TooFew {
        /// How many there are.
        count: usize,
    },
    /// A photograph with too few corners, or with all in a line.
    #[error("{name}: {count} corners{why}; leave the photograph out, or show more of the board")]
    Corners {
        /// The photograph.
        name: String,
        /// How many corners.
        count: usize,
        /// What is wrong with them.
        why: &'static str,
    },
    /// The photographs do not determine the lens.
    #[error(
        "the photographs do not determine the lens{}: the boards are all but parallel or too small, their normals \
         differ by {:.1}° at most; \
         photograph the board tilted by 20° to 45° in different directions, also near the image's edges",
        focal_length(*.fx, *.sigma), .largest_tilt.to_degrees()
    )]
    Degenerate {
        /// Focal length, pixels.
        fx: f64,
        /// Its standard deviation, pixels; not finite where there is none.
        sigma: f64,
        /// Radians.
        largest_tilt: f64,
    },
    /// The iteration led nowhere.
    #[error(
        "no lens explains the corners (root mean square {rms:.3} pixels after {steps} steps); check that all \
         photographs are of one camera at one zoom, and that the board is flat"
    )]
    Lost {
        /// Pixels.
        rms: f64,
        /// Steps taken.
        steps: usize,
    },
    /// The lens found is one that no scene may hold.
    #[error(
        "the lens found cannot be used: {source}; photograph the board near the image's edges and corners, or \
         free fewer coefficients (--distortion k1,k2)"
    )]
    Lens {
        /// What is wrong.
        source: CameraError,
    },
}

fn focal_length(fx: f64, sigma: f64) -> String {
    if sigma.is_finite() {
        format!(" (fx = {fx:.0} ± {sigma:.0} pixels)")
    } else {
        String::new()
    }
}

impl Calibration {
    /// Names, values and standard deviations of the nine parameters; focal lengths and principal point in
    /// pixels.
    pub fn deviations(&self) -> [(&'static str, f64, f64); 9] {
        let (k, s) = (&self.lens.intrinsics, &self.intrinsics_sigma);
        let (d, e) = (&self.lens.distortion, &self.distortion_sigma);
        [
            ("fx", k.fx, s.fx),
            ("fy", k.fy, s.fy),
            ("cx", k.cx, s.cx),
            ("cy", k.cy, s.cy),
            ("k1", d.k1, e.k1),
            ("k2", d.k2, e.k2),
            ("p1", d.p1, e.p1),
            ("p2", d.p2, e.p2),
            ("k3", d.k3, e.k3),
        ]
    }
}

/// Finds the lens of a camera of `width × height` pixels that saw `views`.
///
/// # Errors
/// The views are too few or do not determine the lens, or no lens explains them.
pub fn calibrate(
    (width, height): (usize, usize),
    views: &[BoardView],
    free: FreeDistortion,
) -> Result<Calibration, CalibrationError> {
    if views.len() < FEWEST_PHOTOGRAPHS {
        return Err(CalibrationError::TooFew { count: views.len() });
    }
    for view in views {
        check_corners(view)?;
    }
    let size = DVec2::new(width as f64, height as f64);
    let start = closed_form::initial(size, views);
    let bundle = bundle::Bundle::new(views, free);
    let solution = bundle.solve(&start).ok_or(CalibrationError::Lost {
        rms: f64::INFINITY,
        steps: 0,
    })?;
    let corners: usize = views.iter().map(|view| view.corners.len()).sum();
    let rms = (solution.cost / corners as f64).sqrt();
    let largest_tilt = largest_tilt(&solution.poses);

    // A lens that the photographs do not determine wanders off; say that, rather than where it went.
    let noise = solution.noise.max(BEST_CORNER);
    let sigma_fx = solution
        .unit_sigma
        .map_or(f64::INFINITY, |sigma| sigma[0] * noise);
    let fx = solution.parameters[0];
    if sigma_fx > LOOSEST_FOCAL_LENGTH * fx || largest_tilt < LEAST_TILT {
        return Err(CalibrationError::Degenerate {
            fx,
            sigma: sigma_fx,
            largest_tilt,
        });
    }
    if solution.stop == Stop::IterationLimit || !rms.is_finite() {
        let steps = solution.steps;
        return Err(CalibrationError::Lost { rms, steps });
    }
    let lens = lens((width, height), &solution.parameters);
    lens.check()
        .map_err(|source| CalibrationError::Lens { source })?;
    let sigma = solution
        .unit_sigma
        .unwrap_or_default()
        .map(|unit| unit * solution.noise);
    let deviation = self::lens((width, height), &sigma);
    Ok(Calibration {
        lens,
        intrinsics_sigma: deviation.intrinsics,
        distortion_sigma: deviation.distortion,
        rms,
        photographs: photographs(&lens, views, &solution.poses),
        largest_tilt,
        coverage: coverage(size, views),
        stop: solution.stop,
        steps: solution.steps,
    })
}

fn lens((width, height): (usize, usize), parameters: &[f64; 9]) -> Lens {
    let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = *parameters;
    Lens {
        width,
        height,
        intrinsics: Intrinsics { fx, fy, cx, cy },
        distortion: Distortion { k1, k2, p1, p2, k3 },
    }
}

/// Refuses views from which no pose follows.
fn check_corners(view: &BoardView) -> Result<(), CalibrationError> {
    let count = view.corners.len();
    let wrong = |why| {
        Err(CalibrationError::Corners {
            name: view.name.clone(),
            count,
            why,
        })
    };
    if count < FEWEST_CORNERS {
        return wrong(", too few to know the board's pose");
    }
    if !view
        .corners
        .iter()
        .all(|c| c.board.is_finite() && c.pixel.is_finite())
    {
        return wrong(", one of them not a number");
    }
    if flatness(view.corners.iter().map(|c| c.board)) < 1e-3
        || flatness(view.corners.iter().map(|c| c.pixel)) < 1e-3
    {
        return wrong(", all in a line");
    }
    Ok(())
}

/// Smaller over larger spread of points: 0 in a line.
fn flatness(points: impl Iterator<Item = DVec2> + Clone) -> f64 {
    let count = points.clone().count() as f64;
    let mean = points.clone().sum::<DVec2>() / count;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in points {
        let d = p - mean;
        (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
    }
    let (middle, half) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
    if middle > 0.0 {
        ((middle - half).max(0.0) / (middle + half)).sqrt()
    } else {
        0.0
    }
}

fn largest_tilt(poses: &[DAffine3]) -> f64 {
    let normals: Vec<DVec3> = poses.iter().map(|pose| pose.matrix3.z_axis).collect();
    let angles = normals
        .iter()
        .flat_map(|a| normals.iter().map(move |b| a.angle_between(*b)));
    // A board seen from behind is as parallel as one from the front.
    angles
        .map(|angle| angle.min(std::f64::consts::PI - angle))
        .fold(0.0, f64::max)
}

fn photographs(lens: &Lens, views: &[BoardView], poses: &[DAffine3]) -> Vec<PhotographFit> {
    let mut fits: Vec<PhotographFit> = views
        .iter()
        .zip(poses)
        .map(|(view, pose)| {
            let squares: Vec<f64> = view
                .corners
                .iter()
                .map(|corner| {
                    let p = pose.transform_point3(corner.board.extend(0.0));
                    (lens.pixel(p.truncate() / p.z) - corner.pixel).length_squared()
                })
                .collect();
            PhotographFit {
                name: view.name.clone(),
                camera_from_board: *pose,
                corners: squares.len(),
                rms: (squares.iter().sum::<f64>() / squares.len() as f64).sqrt(),
                worst: squares.iter().copied().fold(0.0, f64::max).sqrt(),
                outlier: false,
            }
        })
        .collect();
    let mut errors: Vec<f64> = fits.iter().map(|fit| fit.rms).collect();
    errors.sort_by(f64::total_cmp);
    let median = errors[errors.len() / 2];
    for fit in &mut fits {
        // Below a thousandth of a pixel all are the same.
        fit.outlier = fit.rms > (OUTLIER * median).max(1e-3);
    }
    fits
}

fn coverage(size: DVec2, views: &[BoardView]) -> f64 {
    let mut seen = [false; 48];
    for corner in views.iter().flat_map(|view| &view.corners) {
        let cell = (corner.pixel / size * DVec2::new(8.0, 6.0)).floor();
        if cell.x >= 0.0 && cell.x < 8.0 && cell.y >= 0.0 && cell.y < 6.0 {
            seen[cell.y as usize * 8 + cell.x as usize] = true;
        }
    }
    seen.iter().filter(|cell| **cell).count() as f64 / 48.0
}
