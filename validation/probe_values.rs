//! Radiance of a probe, and the density with which it is sampled, for `check_probe.py`.
//!
//!     probe_values MAP.npy ROTATION_DEG DIRECTIONS.npy RADIANCE.npy PDF.npy
//!
//! MAP is float32 [height, width, 3], row 0 at the zenith; DIRECTIONS is float32 [N, 3], unit, world
//! frame; RADIANCE is float32 [N, 3] and PDF float32 [N], per steradian.

mod npy;

use anyhow::{Result, bail, ensure};
use glam::{Mat3, Vec3};
use turnlight::image::RgbImage;
use turnlight::probe::{Environment, LightClusters};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [map, rotation, directions, radiance_out, pdf_out] = arguments.as_slice() else {
        bail!("usage: probe_values MAP.npy ROTATION_DEG DIRECTIONS.npy RADIANCE.npy PDF.npy");
    };
    let (texels, shape) = npy::read(map)?;
    let [height, width, 3] = shape[..] else {
        bail!("{map}: shape {shape:?}, must be [height, width, 3]");
    };
    let image = RgbImage {
        width: usize::try_from(width)?,
        height: usize::try_from(height)?,
        pixels: texels.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
    };
    let (environment, _) = Environment::new(image, rotation.parse::<f64>()?.to_radians())?;
    let light = environment.turned(Mat3::IDENTITY);

    let (values, shape) = npy::read(directions)?;
    ensure!(
        matches!(shape.as_slice(), [_, 3]),
        "{directions}: shape {shape:?}, must be [N, 3]"
    );
    let directions: Vec<Vec3> = values.chunks_exact(3).map(Vec3::from_slice).collect();
    let radiance = directions
        .iter()
        .flat_map(|&w| light.radiance(Vec3::ZERO, w).to_array());
    npy::write(radiance_out, &shape, radiance)?;
    // Patches chosen by their light, then directions within them.
    let clusters = LightClusters::new(&environment, 256);
    let flux: Vec<f64> = (0..clusters.count())
        .map(|k| f64::from(clusters.patch(k).flux))
        .collect();
    let total: f64 = flux.iter().sum();
    let probe_from_world = environment.world_from_probe().transpose();
    let pdf = directions.iter().map(|&w| {
        let (patch, density) = clusters.density(probe_from_world * w);
        (flux[patch] / total * f64::from(density)) as f32
    });
    npy::write(pdf_out, &shape[..1], pdf)
}
