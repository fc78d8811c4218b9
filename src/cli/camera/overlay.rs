//! A picture to judge an import by eye: the mesh's edges over a photograph.

use std::collections::HashSet;
use std::io::Write;
use std::path::Path;

use glam::{DQuat, DVec2, DVec3};

use crate::cli::failure::Failure;
use crate::geometry::{Similarity, Turn};
use crate::image::{RgbImage, ToneCurve, encode_png_bytes, write_atomically};
use crate::mesh::{LoadOptions, Mesh};
use crate::rig::{Camera, View};

/// Pieces of an edge, so that lines bend as the lens does.
const PIECES: u32 = 4;
const COLOUR: [u8; 3] = [255, 40, 0];

/// Draws the edges of the triangles that face the camera over `photograph`, the object's pose at angle 0.
pub(super) fn write(
    out: &Path,
    mesh: &Path,
    photograph: &Path,
    camera: &Camera,
    world_from_file: DQuat,
) -> Result<(), Failure> {
    let image = RgbImage::read(photograph)?;
    if (image.width, image.height) != (camera.width, camera.height) {
        return Err(Failure::Input(anyhow::anyhow!(
            "{}: size = {} × {}: must be the camera's {} × {}; give the images that the cameras were found with",
            photograph.display(),
            image.width,
            image.height,
            camera.width,
            camera.height
        )));
    }
    let pose = Similarity {
        rotation: world_from_file,
        ..Similarity::default()
    };
    let (mesh, _) = Mesh::load(mesh, &pose, LoadOptions::default())?;
    let turn = Turn {
        axis: DVec3::Y,
        center: DVec3::ZERO,
    };
    let view = View::new(camera, &turn, 0.0, mesh.object_from_mesh());
    let curve = ToneCurve::default();
    let mut pixels: Vec<[u8; 3]> = image
        .pixels
        .iter()
        .map(|pixel| pixel.map(|radiance| curve.byte(radiance)))
        .collect();
    let mut drawn = HashSet::new();
    for triangle in &mesh.triangles {
        let corners = triangle.map(|i| mesh.positions[i as usize]);
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        if normal.dot(view.position() - corners[0]) <= 0.0 {
            continue;
        }
        for i in 0..3 {
            let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
            if !drawn.insert((a.min(b), a.max(b))) {
                continue;
            }
            let (from, to) = (corners[i], corners[(i + 1) % 3]);
            let at = |k: u32| view.project(from.lerp(to, k as f32 / PIECES as f32));
            for k in 0..PIECES {
                if let (Some(from), Some(to)) = (at(k), at(k + 1)) {
                    line(&mut pixels, (image.width, image.height), from, to);
                }
            }
        }
    }
    let png = encode_png_bytes(image.width, image.height, &pixels)
        .map_err(|source| Failure::write(out, source))?;
    write_atomically(out, |file| file.write_all(&png)).map_err(|source| Failure::write(out, source))
}

/// A line a pixel wide; what lies outside the image is not drawn.
fn line(pixels: &mut [[u8; 3]], (width, height): (usize, usize), from: DVec2, to: DVec2) {
    let size = DVec2::new(width as f64, height as f64);
    // Points far outside come from triangles beside the camera; nothing between two of them need be seen.
    let near = |p: DVec2| (p - 0.5 * size).abs().cmple(2.0 * size).all();
    if !near(from) || !near(to) {
        return;
    }
    let steps = (to - from).abs().max_element().ceil().max(1.0);
    for k in 0..=steps as usize {
        let p = from.lerp(to, k as f64 / steps);
        if p.cmpge(DVec2::ZERO).all() && p.cmplt(size).all() {
            pixels[p.y as usize * width + p.x as usize] = COLOUR;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::write_png;
    use crate::rig::{Distortion, Intrinsics, Lens};

    #[test]
    fn edges_are_drawn_where_the_mesh_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        // A square of side 2 in the plane z = 0, counter-clockwise from +Z.
        let text = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n";
        std::fs::write(path("square.obj"), text).unwrap();
        let black = RgbImage::constant(64, 48, [0.0; 3]);
        write_png(&path("black.png"), &black, ToneCurve::default()).unwrap();
        let lens = Lens {
            width: 64,
            height: 48,
            intrinsics: Intrinsics {
                fx: 40.0,
                fy: 40.0,
                cx: 32.0,
                cy: 24.0,
            },
            distortion: Distortion::default(),
        };
        // Four units in front, so that a unit is ten pixels.
        let camera = lens
            .camera(DVec3::Z * 4.0, DVec3::NEG_Z, DVec3::NEG_Y)
            .unwrap();
        let out = path("overlay.png");
        let draw = |turn| write(&out, &path("square.obj"), &path("black.png"), &camera, turn);
        draw(DQuat::IDENTITY).unwrap();
        let picture = RgbImage::read(&out).unwrap();
        let lit = |x: usize, y: usize| picture.pixels[y * 64 + x][0] > 0.5;
        // Four sides, and the diagonal from bottom left to top right.
        for (x, y) in [(22, 20), (42, 20), (30, 14), (30, 34), (36, 20)] {
            assert!(lit(x, y), "{x} {y}");
        }
        assert!(!lit(36, 28) && !lit(10, 10) && !lit(50, 24));
        // From behind, nothing faces the camera.
        draw(DQuat::from_rotation_y(std::f64::consts::PI)).unwrap();
        let empty = RgbImage::read(&out).unwrap();
        assert!(empty.pixels.iter().all(|pixel| pixel[0] == 0.0));
    }
}
