//! Light from far away: radiance by direction.

use std::f64::consts::PI;

use glam::{DVec3, Mat3, Vec3};

use super::{ProbeError, ProbeReport, repair};
use crate::geometry::latlong_from_direction;
use crate::image::RgbImage;

/// A distant environment in the world frame.
#[derive(Clone, Debug)]
pub struct Environment {
    image: RgbImage,
    world_from_probe: Mat3,
    /// `[height]` solid angle of one texel of each row, steradian.
    texel_solid_angle: Vec<f64>,
    /// `[height]` how much of a texel's solid angle the rows above, of and below it light.
    row_weights: Vec<[f64; 3]>,
}

impl Environment {
    /// From a lat-long image, turned by `rotation` radians right-handed about +Y.
    pub fn new(image: RgbImage, rotation: f64) -> Result<(Self, ProbeReport), ProbeError> {
        let (image, report) = repair(image)?;
        let (width, height) = (image.width, image.height);

        // A texel's solid angle, exactly: Δφ (cos θ_top − cos θ_bottom).
        let cos_edge = |row: usize| (PI * row as f64 / height as f64).cos();
        let texel_solid_angle: Vec<f64> = (0..height)
            .map(|row| 2.0 * PI / width as f64 * (cos_edge(row) - cos_edge(row + 1)))
            .collect();

        let row_weights: Vec<[f64; 3]> = (0..height)
            .map(|row| row_weights(row, height).map(|w| w * 2.0 * PI / width as f64))
            .collect();

        let world_from_probe = Mat3::from_rotation_y(rotation as f32);
        Ok((
            Self {
                image,
                world_from_probe,
                texel_solid_angle,
                row_weights,
            },
            report,
        ))
    }

    /// From `[height][width]` texels, row 0 at the zenith, world frame.
    pub fn from_texels(
        width: usize,
        height: usize,
        texels: Vec<[f32; 3]>,
    ) -> Result<Self, ProbeError> {
        let image = RgbImage::from_fn(width, height, |x, y| {
            texels.get(y * width + x).copied().unwrap_or_default()
        });
        Self::new(image, 0.0).map(|(environment, _)| environment)
    }

    /// The same map with another image of its size.
    pub(super) fn with_image(&self, image: RgbImage) -> Self {
        Self {
            image,
            ..self.clone()
        }
    }

    /// The repaired image.
    pub fn image(&self) -> &RgbImage {
        &self.image
    }

    /// Rotation from the probe's own axes to the world's.
    pub fn world_from_probe(&self) -> Mat3 {
        self.world_from_probe
    }

    /// `[height]` solid angle of one texel of each row, steradian.
    pub fn texel_solid_angle(&self) -> &[f64] {
        &self.texel_solid_angle
    }

    /// `∫ E dω` over one texel's cell, exactly, linear RGB × steradian.
    pub(super) fn cell_flux(&self, column: usize, row: usize) -> DVec3 {
        cell_flux(&self.image, column, row, self.row_weights[row])
    }

    /// Mean over the sphere of the radiance, linear RGB.
    pub fn mean_radiance(&self) -> Vec3 {
        let mut flux = DVec3::ZERO;
        for row in 0..self.image.height {
            for column in 0..self.image.width {
                flux += self.cell_flux(column, row);
            }
        }
        (flux / (4.0 * PI)).as_vec3()
    }

    /// The light as an object sees it that is turned by `world_from_object`.
    pub fn turned(&self, world_from_object: Mat3) -> TurnedLight<'_> {
        TurnedLight {
            environment: self,
            probe_from_object: self.world_from_probe.transpose() * world_from_object,
        }
    }

    /// Bilinear look-up, probe frame.
    #[inline]
    pub(super) fn lookup(&self, direction: Vec3) -> Vec3 {
        let (width, height) = (self.image.width, self.image.height);
        let uv = latlong_from_direction(direction);
        let x = uv.x * width as f32 - 0.5;
        let y = (uv.y * height as f32 - 0.5).clamp(0.0, (height - 1) as f32);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        // x is in [−½, width − ½): one wrap on either side.
        let left = if x0 < 0.0 { width - 1 } else { x0 as usize };
        let right = if left + 1 == width { 0 } else { left + 1 };
        let top = y0 as usize;
        let bottom = (top + 1).min(height - 1);
        let at = |column: usize, row: usize| Vec3::from(self.image.pixels[row * width + column]);
        at(left, top)
            .lerp(at(right, top), fx)
            .lerp(at(left, bottom).lerp(at(right, bottom), fx), fy)
    }
}

/// The light at one pose of the turntable, in the object frame.
///
/// All light is asked for by position and direction. A distant environment ignores the position;
/// light sources nearby would not.
#[derive(Clone, Copy, Debug)]
pub struct TurnedLight<'a> {
    environment: &'a Environment,
    probe_from_object: Mat3,
}

impl TurnedLight<'_> {
    /// Radiance arriving at `position` from `wi` (unit), object frame, linear RGB.
    #[inline]
    pub fn radiance(&self, _position: Vec3, wi: Vec3) -> Vec3 {
        self.environment.lookup(self.probe_from_object * wi)
    }
}

/// `∫ w sin θ dθ` over the cell of `row` for the weights `w` that the bilinear function gives to
/// the rows above, of and below it there.
///
/// The mean over the cell in θ, ⅛, ¾ and ⅛, would be 14 % too bright for a light in a polar row
/// of eight, where the solid angle shrinks to nothing across the cell.
fn row_weights(row: usize, height: usize) -> [f64; 3] {
    let step = PI / height as f64;
    let (top, middle, bottom) = (
        step * row as f64,
        step * (row as f64 + 0.5),
        step * (row as f64 + 1.0),
    );
    // ∫ (middle − θ)/step sin θ dθ from the top edge down, ∫ (θ − middle)/step sin θ dθ below.
    let above = 0.5 * top.cos() - (middle.sin() - top.sin()) / step;
    let below = (bottom.sin() - middle.sin()) / step - 0.5 * bottom.cos();
    [above, top.cos() - bottom.cos() - above - below, below]
}

/// `∫ E dω` over a cell; in longitude the weights are ⅛, ¾, ⅛.
fn cell_flux(image: &RgbImage, column: usize, row: usize, row_weights: [f64; 3]) -> DVec3 {
    let (width, height) = (image.width, image.height);
    let columns = [(column + width - 1) % width, column, (column + 1) % width];
    let rows = [row.saturating_sub(1), row, (row + 1).min(height - 1)];
    let mut flux = DVec3::ZERO;
    for (row, row_weight) in rows.into_iter().zip(row_weights) {
        for (column, column_weight) in columns.into_iter().zip([0.125, 0.75, 0.125]) {
            let texel = Vec3::from(image.pixels[row * width + column]).as_dvec3();
            flux += texel * (row_weight * column_weight);
        }
    }
    flux
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::geometry::direction_from_latlong;

    fn lit(width: usize, height: usize, column: usize, row: usize, value: f32) -> Environment {
        let mut pixels = vec![[0.0; 3]; width * height];
        pixels[row * width + column] = [value; 3];
        Environment::new(
            RgbImage {
                width,
                height,
                pixels,
            },
            0.0,
        )
        .unwrap()
        .0
    }

    #[test]
    fn a_lit_texel_is_brightest_at_its_centre() {
        let e = lit(16, 8, 4, 3, 2.0);
        let centre = direction_from_latlong(Vec2::new(4.5 / 16.0, 3.5 / 8.0));
        assert!((e.lookup(centre).x - 2.0).abs() < 1e-5);
        let edge = direction_from_latlong(Vec2::new(5.0 / 16.0, 3.5 / 8.0));
        assert!((e.lookup(edge).x - 1.0).abs() < 1e-4);
    }

    #[test]
    fn one_texel_maps_are_constant() {
        let e = lit(1, 1, 0, 0, 3.0);
        for d in [Vec3::X, Vec3::NEG_Y, Vec3::new(-0.6, 0.0, -0.8)] {
            assert!((e.lookup(d).y - 3.0).abs() < 1e-6);
        }
        assert!((e.mean_radiance().x - 3.0).abs() < 1e-5);
    }

    #[test]
    fn rotation_turns_the_probe_right_handed_about_y() {
        let mut pixels = vec![[0.0; 3]; 16 * 8];
        pixels[4 * 16 + 8] = [1.0; 3];
        let image = RgbImage {
            width: 16,
            height: 8,
            pixels,
        };
        let brightest = direction_from_latlong(Vec2::new(8.5 / 16.0, 4.5 / 8.0));
        let (e, _) = Environment::new(image, std::f64::consts::FRAC_PI_2).unwrap();
        let light = e.turned(Mat3::IDENTITY);
        let moved = Mat3::from_rotation_y(std::f32::consts::FRAC_PI_2) * brightest;
        assert!((light.radiance(Vec3::ZERO, moved).x - 1.0).abs() < 1e-4);
    }
}
