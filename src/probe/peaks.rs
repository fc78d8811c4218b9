//! Distant light in two parts: a sky that may be averaged over small cones, and the peaks above it.
//!
//! ```text
//! E(ω) = E_sky(ω) + E_lamps(ω),   E_sky = E · min(1, L/ΣE)
//! ```
//!
//! with `ΣE` the sum over the channels and `L` the value that it exceeds on [`PEAKS`] of the sphere. A
//! lamp keeps its place: it is a few small nodes of a quadtree, each of which is seen or hidden. What is
//! left has no peak that the mean over a cone would smear.

use super::{Environment, Irradiance, LightPyramid, SkyMap};

/// Share of the sphere that may be lamps. An indoor probe keeps half of its irradiance in 0.1 % of its
/// texels; 0.3 % of the sphere, 0.04 sr, is a hundred nodes of a degree.
const PEAKS: f64 = 0.003;

/// A light and its two parts, world frame.
#[derive(Clone, Debug)]
pub struct SplitLight {
    /// The whole light as a quadtree.
    pub whole: LightPyramid,
    /// What is left of the light without its peaks, averaged over cones of [`SplitLight::CONE`].
    pub sky: SkyMap,
    /// The sky's irradiance by normal.
    pub sky_irradiance: Irradiance,
    /// The peaks.
    pub lamps: LightPyramid,
}

impl SplitLight {
    /// Solid angle over which the sky is averaged, steradian: 6.3° across.
    pub const CONE: f32 = 0.012;

    /// Splits a light.
    pub fn new(environment: &Environment) -> Self {
        let limit = limit(environment);
        let mut sky = environment.image().clone();
        let mut lamps = sky.clone();
        for (sky, lamp) in sky.pixels.iter_mut().zip(&mut lamps.pixels) {
            let sum: f32 = sky.iter().sum();
            let share = if sum > limit { limit / sum } else { 1.0 };
            for (sky, lamp) in sky.iter_mut().zip(lamp) {
                *sky *= share;
                *lamp = if share < 1.0 { *lamp - *sky } else { 0.0 };
            }
        }
        let sky = environment.with_image(sky);
        Self {
            whole: LightPyramid::new(environment),
            sky: SkyMap::new(&sky, Self::CONE),
            sky_irradiance: Irradiance::new(&LightPyramid::new(&sky)),
            lamps: LightPyramid::new(&environment.with_image(lamps)),
        }
    }
}

/// The sum over channels that [`PEAKS`] of the sphere exceeds.
fn limit(environment: &Environment) -> f32 {
    let image = environment.image();
    let solid_angle = environment.texel_solid_angle();
    let mut texels: Vec<(f32, usize)> = image
        .pixels
        .iter()
        .enumerate()
        .map(|(i, pixel)| (pixel.iter().sum(), i / image.width))
        .collect();
    texels.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    let mut covered = 0.0;
    for (sum, row) in texels {
        covered += solid_angle[row];
        if covered > PEAKS * 4.0 * std::f64::consts::PI {
            return sum;
        }
    }
    0.0
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::image::RgbImage;

    #[test]
    fn both_parts_hold_the_whole_flux() {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/probes");
        let image = RgbImage::read(&folder.join("interior.exr")).unwrap();
        let environment = Environment::new(image, 0.7).unwrap().0;
        let split = SplitLight::new(&environment);
        let flux = |pyramid: &LightPyramid| -> Vec3 {
            pyramid.roots().map(|i| pyramid.nodes()[i].flux).sum()
        };
        let all = flux(&LightPyramid::new(&environment));
        let lamps = flux(&split.lamps);
        // Four normals in a tetrahedron: irradiances add up to nearly the flux of uniform light, so
        // compare with the table of the whole.
        let whole = Irradiance::new(&LightPyramid::new(&environment));
        let lamp_table = Irradiance::new(&split.lamps);
        for normal in [Vec3::Y, Vec3::X, Vec3::NEG_Z, Vec3::new(0.6, -0.8, 0.0)] {
            let parts = split.sky_irradiance.at(normal) + lamp_table.at(normal);
            let difference = parts - whole.at(normal);
            assert!(difference.length() < 2e-3 * whole.at(normal).length());
        }
        assert!(
            lamps.x > 0.2 * all.x && lamps.x < 0.9 * all.x,
            "{lamps} {all}"
        );
    }

    #[test]
    fn uniform_and_black_light_have_no_lamps() {
        for value in [0.0, 2.0] {
            let image = RgbImage::constant(32, 16, [value; 3]);
            let split = SplitLight::new(&Environment::new(image, 0.0).unwrap().0);
            assert!(split.lamps.roots().is_empty());
            assert!((split.sky.radiance(Vec3::Y).x - value).abs() < 1e-5);
        }
    }
}
