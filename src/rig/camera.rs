//! Pinhole camera with OpenCV's distortion.
//!
//! With `x = X/Z`, `y = Y/Z` in the camera frame (x right, y down, z forward) and `r² = x² + y²`:
//!
//! ```text
//! x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2x²)
//! y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2y²) + 2 p2 x y
//! px = fx x' + cx,   py = fy y' + cy
//! ```
//!
//! Pixel coordinates are continuous, the centre of the top left pixel at (½, ½).

use glam::{DMat3, DVec2, DVec3};

/// Focal lengths and principal point, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Horizontal focal length, pixels.
    pub fx: f64,
    /// Vertical focal length, pixels.
    pub fy: f64,
    /// Principal point, pixels from the left edge.
    pub cx: f64,
    /// Principal point, pixels from the top edge.
    pub cy: f64,
}

/// OpenCV's five coefficients.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// Radial, r².
    pub k1: f64,
    /// Radial, r⁴.
    pub k2: f64,
    /// Tangential.
    pub p1: f64,
    /// Tangential.
    pub p2: f64,
    /// Radial, r⁶.
    pub k3: f64,
}

/// A camera that stands still in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal lengths and principal point.
    pub intrinsics: Intrinsics,
    /// Lens distortion; zero for an ideal pinhole.
    pub distortion: Distortion,
    /// Optical centre, world frame.
    pub position: DVec3,
    /// Columns: the camera's right, down and forward axes, world frame.
    pub world_from_camera: DMat3,
}

/// What can be wrong with a camera's numbers.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// `position` and `look_at` coincide, or the view runs along the up direction.
    #[error(
        "look_at = {look_at}: the view direction from position = {position} is {problem}; move one of them"
    )]
    View {
        /// Optical centre.
        position: DVec3,
        /// Target.
        look_at: DVec3,
        /// What is wrong.
        problem: &'static str,
    },
    /// A number is outside its range.
    #[error("{field} = {value}: must be {requirement}")]
    Value {
        /// Field name as in scene.toml.
        field: &'static str,
        /// Offending value.
        value: f64,
        /// What is allowed.
        requirement: &'static str,
    },
}

impl Intrinsics {
    /// Square pixels and a centred principal point from the horizontal field of view (radians).
    pub fn from_fov_x(width: usize, height: usize, fov_x: f64) -> Self {
        let f = 0.5 * width as f64 / (0.5 * fov_x).tan();
        Self {
            fx: f,
            fy: f,
            cx: 0.5 * width as f64,
            cy: 0.5 * height as f64,
        }
    }
}

impl Camera {
    /// A camera at `position` looking at `look_at`, its up direction `up` projected (+Y unless the
    /// camera is rolled).
    pub fn looking_at(
        (width, height): (usize, usize),
        intrinsics: Intrinsics,
        distortion: Distortion,
        position: DVec3,
        look_at: DVec3,
        up: DVec3,
    ) -> Result<Self, CameraError> {
        let view = |problem| CameraError::View {
            position,
            look_at,
            problem,
        };
        let forward = (look_at - position)
            .try_normalize()
            .ok_or_else(|| view("zero"))?;
        let right = forward
            .cross(up)
            .try_normalize()
            .ok_or_else(|| view("parallel to up"))?;
        let down = forward.cross(right);
        let checks = [
            ("width", width as f64, width > 0, "at least 1 pixel"),
            ("height", height as f64, height > 0, "at least 1 pixel"),
            (
                "fx",
                intrinsics.fx,
                intrinsics.fx.is_finite() && intrinsics.fx > 0.0,
                "finite and > 0",
            ),
            (
                "fy",
                intrinsics.fy,
                intrinsics.fy.is_finite() && intrinsics.fy > 0.0,
                "finite and > 0",
            ),
            ("cx", intrinsics.cx, intrinsics.cx.is_finite(), "finite"),
            ("cy", intrinsics.cy, intrinsics.cy.is_finite(), "finite"),
        ];
        for (field, value, holds, requirement) in checks {
            if !holds {
                return Err(CameraError::Value {
                    field,
                    value,
                    requirement,
                });
            }
        }
        let camera = Self {
            width,
            height,
            intrinsics,
            distortion,
            position,
            world_from_camera: DMat3::from_cols(right, down, forward),
        };
        camera.check_lens()?;
        Ok(camera)
    }

    /// Refuses intrinsics under which some pixel has no ray: on a grid over the image, a pixel's ray must
    /// lead back to it.
    fn check_lens(&self) -> Result<(), CameraError> {
        const STEPS: usize = 8;
        let returns = |i: usize| {
            let share =
                DVec2::new((i % (STEPS + 1)) as f64, (i / (STEPS + 1)) as f64) / STEPS as f64;
            let pixel = share * DVec2::new(self.width as f64, self.height as f64);
            let ideal = self.ideal_point(pixel);
            self.direction(pixel).is_finite()
                && self
                    .project_from_camera(ideal.extend(1.0))
                    .is_some_and(|back| (back - pixel).abs().max_element() < 1.0)
        };
        if (0..(STEPS + 1) * (STEPS + 1)).all(returns) {
            return Ok(());
        }
        let Distortion { k1, k2, p1, p2, k3 } = self.distortion;
        let largest = [k1, k2, p1, p2, k3]
            .into_iter()
            .fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
        Err(if largest == 0.0 {
            CameraError::Value {
                field: "fx",
                value: self.intrinsics.fx,
                requirement: "such, with fy, cx and cy, that every pixel has a direction of its own; \
                              they are in pixels",
            }
        } else {
            CameraError::Value {
                field: "distortion",
                value: largest,
                requirement: "a lens that can be inverted at every pixel; check the calibration, or crop \
                              the image to where it holds",
            }
        })
    }

    /// Unit direction, world frame, of the ray through pixel coordinates `pixel`.
    pub fn direction(&self, pixel: DVec2) -> DVec3 {
        let p = self.ideal_point(pixel);
        (self.world_from_camera * DVec3::new(p.x, p.y, 1.0)).normalize()
    }

    /// Undistorted normalised coordinates `(X/Z, Y/Z)` of a pixel.
    #[inline]
    pub fn ideal_point(&self, pixel: DVec2) -> DVec2 {
        let k = &self.intrinsics;
        self.distortion
            .undistort(DVec2::new((pixel.x - k.cx) / k.fx, (pixel.y - k.cy) / k.fy))
    }

    /// Pixel coordinates of a world point, or `None` behind the camera.
    ///
    /// The result may lie outside the image.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        self.project_from_camera(self.world_from_camera.transpose() * (point - self.position))
    }

    /// Pixel coordinates of a world point and their derivatives by it, pixels per scene unit, world
    /// frame; `None` behind the camera.
    pub fn project_with_slopes(&self, point: DVec3) -> Option<(DVec2, [DVec3; 2])> {
        let axes = &self.world_from_camera;
        let (right, down, forward) = (axes.x_axis, axes.y_axis, axes.z_axis);
        let offset = point - self.position;
        let depth = offset.dot(forward);
        let pixel = self.project(point)?;
        let ideal = DVec2::new(offset.dot(right), offset.dot(down)) / depth;
        let of_x = (right - ideal.x * forward) / depth;
        let of_y = (down - ideal.y * forward) / depth;
        let [xx, xy, yy] = self.distortion.slopes(ideal);
        let k = &self.intrinsics;
        Some((
            pixel,
            [
                k.fx * (xx * of_x + xy * of_y),
                k.fy * (xy * of_x + yy * of_y),
            ],
        ))
    }

    /// Pixel coordinates of a point given along the camera's axes (right, down, forward).
    pub fn project_from_camera(&self, point: DVec3) -> Option<DVec2> {
        if point.z <= 0.0 {
            return None;
        }
        let p = self
            .distortion
            .distort(DVec2::new(point.x / point.z, point.y / point.z));
        let k = &self.intrinsics;
        Some(DVec2::new(k.fx * p.x + k.cx, k.fy * p.y + k.cy))
    }
}

impl Distortion {
    /// Ideal to distorted normalised coordinates.
    pub fn distort(&self, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        DVec2::new(
            p.x * radial + 2.0 * self.p1 * p.x * p.y + self.p2 * (r2 + 2.0 * p.x * p.x),
            p.y * radial + self.p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * self.p2 * p.x * p.y,
        )
    }

    /// The symmetric derivative `[∂x'/∂x, ∂x'/∂y = ∂y'/∂x, ∂y'/∂y]` of [`Distortion::distort`].
    fn slopes(&self, p: DVec2) -> [f64; 3] {
        let r2 = p.length_squared();
        let radial = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let slope = self.k1 + r2 * (2.0 * self.k2 + 3.0 * r2 * self.k3);
        [
            radial + 2.0 * p.x * p.x * slope + 2.0 * self.p1 * p.y + 6.0 * self.p2 * p.x,
            2.0 * (p.x * p.y * slope + self.p1 * p.x + self.p2 * p.y),
            radial + 2.0 * p.y * p.y * slope + 6.0 * self.p1 * p.y + 2.0 * self.p2 * p.x,
        ]
    }

    /// Distorted to ideal normalised coordinates, by Newton's method with the exact Jacobian.
    pub fn undistort(&self, distorted: DVec2) -> DVec2 {
        if *self == Self::default() {
            return distorted;
        }
        let mut p = distorted;
        for _ in 0..20 {
            let residual = self.distort(p) - distorted;
            let [a, cross, d] = self.slopes(p);
            let determinant = a * d - cross * cross;
            if determinant.abs() < 1e-12 {
                break;
            }
            let step = DVec2::new(
                (d * residual.x - cross * residual.y) / determinant,
                (a * residual.y - cross * residual.x) / determinant,
            );
            p -= step;
            if step.length_squared() < 1e-30 {
                break;
            }
        }
        p
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn camera(distortion: Distortion) -> Camera {
        Camera::looking_at(
            (640, 480),
            Intrinsics::from_fov_x(640, 480, 0.9),
            distortion,
            DVec3::new(0.3, 1.0, 4.0),
            DVec3::ZERO,
            DVec3::Y,
        )
        .unwrap()
    }

    #[test]
    fn camera_x_runs_right_and_y_down() {
        let camera = camera(Distortion::default());
        let centre = camera.project(DVec3::ZERO).unwrap();
        assert!((centre - DVec2::new(320.0, 240.0)).length() < 1e-9);
        assert!(camera.project(DVec3::new(0.1, 0.0, 0.0)).unwrap().x > 320.0);
        assert!(camera.project(DVec3::new(0.0, 0.1, 0.0)).unwrap().y < 240.0);
    }

    #[test]
    fn lenses_without_a_ray_for_some_pixel_are_refused_by_name() {
        let plain = Intrinsics::from_fov_x(640, 480, 0.9);
        let folded = |k1, p2| Distortion {
            k1,
            p2,
            ..Distortion::default()
        };
        let wide = |fx| Intrinsics { fx, ..plain };
        for (intrinsics, distortion, named) in [
            (plain, folded(-5.0, 0.0), "distortion = -5"),
            (plain, folded(0.1, 1e308), "distortion = 1"),
            (wide(1e-320), Distortion::default(), "fx = "),
        ] {
            let error = Camera::looking_at(
                (640, 480),
                intrinsics,
                distortion,
                DVec3::Z,
                DVec3::ZERO,
                DVec3::Y,
            );
            let error = error.unwrap_err().to_string();
            assert!(error.starts_with(named), "{error}");
        }
    }

    #[test]
    fn looking_straight_down_is_refused_by_name() {
        let error = Camera::looking_at(
            (4, 4),
            Intrinsics::from_fov_x(4, 4, 0.5),
            Distortion::default(),
            DVec3::Y,
            DVec3::ZERO,
            DVec3::Y,
        )
        .unwrap_err();
        assert!(error.to_string().contains("look_at"));
    }

    proptest! {
        #[test]
        fn projection_slopes_match_finite_differences(
            x in -0.8f64..0.8, y in -0.6f64..0.6, z in -0.5f64..0.5, k1 in -0.2f64..0.2, p1 in -0.01f64..0.01,
        ) {
            let camera = camera(Distortion { k1, k2: 0.05, p1, p2: -0.5 * p1, k3: 0.01 });
            let point = DVec3::new(x, y, z);
            let (pixel, slopes) = camera.project_with_slopes(point).unwrap();
            prop_assert_eq!(pixel, camera.project(point).unwrap());
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let h = 1e-6;
                let difference = (camera.project(point + h * axis).unwrap()
                    - camera.project(point - h * axis).unwrap()) / (2.0 * h);
                let slope = DVec2::new(slopes[0].dot(axis), slopes[1].dot(axis));
                prop_assert!((slope - difference).length() < 1e-5 * (1.0 + slope.length()));
            }
        }

        #[test]
        fn project_inverts_direction(px in 0.0f64..640.0, py in 0.0f64..480.0, k1 in -0.2f64..0.2, p1 in -0.01f64..0.01) {
            let camera = camera(Distortion { k1, k2: 0.05, p1, p2: -0.5 * p1, k3: 0.0 });
            let pixel = DVec2::new(px, py);
            let point = camera.position + 3.0 * camera.direction(pixel);
            prop_assert!((camera.project(point).unwrap() - pixel).length() < 1e-6);
        }
    }
}
