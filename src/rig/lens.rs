//! A camera without its place: image size, intrinsics and distortion.

use glam::{DVec2, DVec3};

use super::{Camera, CameraError, Distortion, Intrinsics};

/// What a calibration finds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Pixels; the centre of the top left pixel at (½, ½).
    pub intrinsics: Intrinsics,
    /// OpenCV's coefficients.
    pub distortion: Distortion,
}

impl Lens {
    /// The lens of a camera.
    pub fn of(camera: &Camera) -> Self {
        Self {
            width: camera.width,
            height: camera.height,
            intrinsics: camera.intrinsics,
            distortion: camera.distortion,
        }
    }

    /// The camera with this lens at `position`, its axes given by `right × down = forward`, `forward` and
    /// `down` of unit length, world frame.
    ///
    /// # Errors
    /// A number is not finite or out of range, or the lens cannot be inverted at every pixel.
    pub fn camera(
        &self,
        position: DVec3,
        forward: DVec3,
        down: DVec3,
    ) -> Result<Camera, CameraError> {
        let size = (self.width, self.height);
        let at_origin = Camera::looking_at(
            size,
            self.intrinsics,
            self.distortion,
            DVec3::ZERO,
            forward,
            -down,
        )?;
        Ok(Camera {
            position,
            ..at_origin
        })
    }

    /// Refuses a lens that no scene file may hold.
    ///
    /// # Errors
    /// As [`Lens::camera`].
    pub fn check(&self) -> Result<(), CameraError> {
        self.camera(DVec3::ZERO, DVec3::Z, DVec3::Y).map(|_| ())
    }

    /// Pixel coordinates of ideal normalised coordinates `(X/Z, Y/Z)`.
    pub fn pixel(&self, ideal: DVec2) -> DVec2 {
        let p = self.distortion.distort(ideal);
        let k = &self.intrinsics;
        DVec2::new(k.fx * p.x + k.cx, k.fy * p.y + k.cy)
    }
}
