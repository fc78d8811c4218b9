//! Nothing that can be photographed or modelled makes turnlight panic or lose its numbers: finite and
//! right within noise, or refused by name.
//!
//! The mesh's repairs are laws of `src/mesh/tests`, the lobe's own numbers those of `brdf_laws`, and a capture
//! that is masked whole one of `pipeline`; here are the whole renderer and the whole fit.

#![expect(clippy::unwrap_used, reason = "a test may stop at once")]

#[path = "../command/mod.rs"]
mod command;
mod fit;
mod geometry;
mod light;
mod material;

use std::path::PathBuf;
use std::time::Instant;

use glam::{DVec3, Vec3};
use proptest::prelude::*;
use tempfile::TempDir;
use turnlight::image::{RgbImage, write_exr};
use turnlight::mesh::{Surface, cup, sphere};
use turnlight::render::{FrameSettings, PathCount, RenderedFrame, Skips, Stage, render_frame};
use turnlight::scene::Scene;

const WHITE: &str = "ndf = 'ggx'\nalpha = 0.5\nrho_d = 1.0\nrho_s = 0.0";
const PLASTIC: &str = "ndf = 'ggx'\nalpha = 0.2\nrho_d = [0.4, 0.3, 0.2]\nrho_s = 2.35";

/// Where a camera stands, what it looks at, and how wide it sees.
#[derive(Clone, Copy, Debug)]
struct Seen {
    position: DVec3,
    look_at: DVec3,
    fov_x_deg: f64,
    /// Columns and rows.
    side: usize,
}

/// The unit sphere fills most of it.
const FROM_ABOVE: Seen = Seen {
    position: DVec3::new(0.0, 1.37, 3.76),
    look_at: DVec3::ZERO,
    fov_x_deg: 32.0,
    side: 24,
};

/// A folder with a scene of one mesh in one light.
struct Setup {
    folder: TempDir,
    mesh: String,
    material: String,
    seen: Seen,
    /// Further lines: of `[object]`, and whole sections.
    object: String,
    sections: String,
}

impl Setup {
    fn new(surface: &Surface, probe: &RgbImage, material: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("mesh.ply"), double_ply(surface)).unwrap();
        write_exr(&folder.path().join("probe.exr"), probe).unwrap();
        Self {
            folder,
            mesh: "mesh.ply".to_owned(),
            material: material.to_owned(),
            seen: FROM_ABOVE,
            object: String::new(),
            sections: "[turntable]\nframes = 1\n".to_owned(),
        }
    }

    fn write(&self) -> PathBuf {
        let Seen {
            position,
            look_at,
            fov_x_deg,
            side,
        } = self.seen;
        let text = format!(
            "[object]\nmesh = '{}'\n{}\n[material]\n{}\n[probe]\nimage = 'probe.exr'\n[camera]\n\
             width = {side}\nheight = {side}\nfov_x_deg = {fov_x_deg:?}\n\
             position = {:?}\nlook_at = {:?}\n{}",
            self.mesh,
            self.object,
            self.material,
            position.to_array(),
            look_at.to_array(),
            self.sections
        );
        let path = self.folder.path().join("scene.toml");
        std::fs::write(&path, text).unwrap();
        path
    }

    fn stage(&self) -> Result<(Stage, Vec<String>), String> {
        let scene = Scene::load(self.write()).map_err(|e| e.to_string())?;
        Stage::load(&scene).map_err(|e| e.to_string())
    }

    fn render(&self, samples_per_pixel: u32, bounces: u32) -> RenderedFrame {
        let (stage, _) = self.stage().unwrap();
        let frame = render_frame(
            &stage,
            0,
            0.0,
            &FrameSettings {
                paths: PathCount::PerPixel(samples_per_pixel),
                bounces,
                seed: 7,
                skips: Skips::ALL,
            },
        );
        let numbers = frame.radiance.pixels.as_flattened();
        assert!(numbers.iter().all(|v| v.is_finite()), "{}", self.material);
        frame
    }
}

/// A binary file in double precision, without normals.
fn double_ply(surface: &Surface) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
         property double z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        surface.positions.len(),
        surface.triangles.len()
    )
    .into_bytes();
    for position in &surface.positions {
        bytes.extend(position.to_array().into_iter().flat_map(f64::to_le_bytes));
    }
    for triangle in &surface.triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}

/// A square plate of half-width `half` that looks up.
fn plate(half: f64) -> Surface {
    let corner = |x: f64, z: f64| DVec3::new(x * half, 0.0, z * half);
    Surface {
        positions: vec![
            corner(-1.0, -1.0),
            corner(-1.0, 1.0),
            corner(1.0, 1.0),
            corner(1.0, -1.0),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Surface::default()
    }
}

/// The plate of half-width 1 in `count`² squares.
fn tiles(count: u32) -> Surface {
    let side = count + 1;
    let place = |i: u32| 2.0 * f64::from(i) / f64::from(count) - 1.0;
    let square = |i: u32| {
        let a = i / count * side + i % count;
        [[a, a + side, a + 1], [a + 1, a + side, a + side + 1]]
    };
    Surface {
        positions: (0..side * side)
            .map(|v| DVec3::new(place(v % side), 0.0, place(v / side)))
            .collect(),
        triangles: (0..count * count).flat_map(square).collect(),
        ..Surface::default()
    }
}

fn grey(width: usize, height: usize, value: f32) -> RgbImage {
    RgbImage::constant(width, height, [value; 3])
}

/// A lamp a thousand times as bright as the sky, which is brighter above than below.
fn lamp_and_sky() -> RgbImage {
    RgbImage::from_fn(32, 16, |x, y| match (x, y) {
        (5..7, 4) => [1000.0, 900.0, 700.0],
        _ => [0.5, 0.6, 0.7].map(|c: f32| c * (1.0 - y as f32 / 20.0)),
    })
}

/// Mean and its standard error of the green channel over pixels that the object covers whole.
fn inside(frame: &RenderedFrame) -> (f64, f64) {
    let values: Vec<f64> = (frame.radiance.pixels.iter().zip(&frame.mask.pixels))
        .filter(|(_, coverage)| **coverage == 255)
        .map(|(pixel, _)| f64::from(pixel[1]))
        .collect();
    assert!(values.len() > 20, "{} pixels inside", values.len());
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, (variance / count).sqrt())
}

/// Root mean square of the difference of two images over that of the first.
fn difference(a: &RenderedFrame, b: &RenderedFrame) -> f64 {
    let (a, b) = (
        a.radiance.pixels.as_flattened(),
        b.radiance.pixels.as_flattened(),
    );
    let squares = a
        .iter()
        .zip(b)
        .map(|(x, y)| f64::from(x - y).powi(2))
        .sum::<f64>();
    let scale = a.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>();
    assert!(scale > 0.0 && a.len() == b.len());
    (squares / scale).sqrt()
}
