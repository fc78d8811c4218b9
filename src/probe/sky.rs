//! Mean radiance over cones of one width, by look-up.

use std::f32::consts::TAU;

use glam::{Vec3, Vec3A};
use rayon::prelude::*;

use super::Environment;
use crate::geometry::{CubeGrid, CubePlace, Frame, Local};

/// Samples of the map to a cone's width: a mean over a disc is next to linear over half of it.
const SAMPLES_PER_WIDTH: f32 = 2.0;
/// Look-ups of the light in a cone: rings of equal area, and sectors.
const PARTS: (usize, usize) = (8, 16);

/// A distant light, world frame, averaged over cones of a given solid angle.
#[derive(Clone, Debug)]
pub struct SkyMap {
    grid: CubeGrid,
    samples: Vec<Vec3A>,
}

impl SkyMap {
    /// Averages a light over cones of `solid_angle` steradian.
    pub fn new(environment: &Environment, solid_angle: f32) -> Self {
        let grid = CubeGrid::with_spacing(solid_angle.sqrt() / SAMPLES_PER_WIDTH);
        let probe_from_world = environment.world_from_probe().transpose();
        let (rings, sectors) = PARTS;
        let parts: Vec<Local> = (0..rings * sectors)
            .map(|part| {
                let (ring, sector) = (part / sectors, part % sectors);
                let z = 1.0 - solid_angle / TAU * (ring as f32 + 0.5) / rings as f32;
                let turn = sector as f32 + if ring % 2 == 0 { 0.0 } else { 0.5 };
                let (y, x) = (turn * TAU / sectors as f32).sin_cos();
                let sin = (1.0 - z * z).max(0.0).sqrt();
                Local(Vec3::new(sin * x, sin * y, z))
            })
            .collect();
        let mean = |index: usize| {
            let frame = Frame::about(grid.direction(index));
            let sum: Vec3 = parts
                .iter()
                .map(|part| environment.lookup(probe_from_world * frame.from_local(*part)))
                .sum();
            Vec3A::from(sum / parts.len() as f32)
        };
        Self {
            grid,
            samples: (0..grid.samples()).into_par_iter().map(mean).collect(),
        }
    }

    /// Mean radiance, linear RGB, of the cone about `direction` (unit, world frame).
    #[inline]
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let mean = self.grid.stencil(CubePlace::of(direction));
        mean.interpolate(&self.samples).max(Vec3A::ZERO).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{direction_from_latlong, direction_from_octahedral};
    use crate::image::RgbImage;
    use crate::sampling::{SobolPath, as_points};

    #[test]
    fn the_mean_of_a_linear_light_is_its_middle() {
        // Of a function linear in the direction, the mean over a cap is (1 + cos)/2 of its middle.
        let (width, height) = (256, 128);
        let pixels = (0..width * height)
            .map(|i| {
                let u = glam::Vec2::new(
                    ((i % width) as f32 + 0.5) / width as f32,
                    ((i / width) as f32 + 0.5) / height as f32,
                );
                (direction_from_latlong(u) + 2.0).to_array()
            })
            .collect();
        let image = RgbImage {
            width,
            height,
            pixels,
        };
        let (environment, _) = Environment::new(image, 0.4).unwrap();
        let light = environment.turned(glam::Mat3::IDENTITY);
        for solid_angle in [0.012, 0.2] {
            let map = SkyMap::new(&environment, solid_angle);
            let shrink = 1.0 - 0.5 * solid_angle / TAU;
            for i in 0..200 {
                let (u, _) = as_points(SobolPath::new(1, 0, 0, i).next_4d());
                let d = direction_from_octahedral(u);
                let exact = 2.0 + (light.radiance(Vec3::ZERO, d) - 2.0) * shrink;
                let seen = map.radiance(d);
                assert!((seen - exact).length() < 2e-3, "{d}: {seen} {exact}");
            }
        }
    }
}
