//! What stands at the centre of every pixel of a frame: depth, triangle, normal.

use glam::{DVec2, Vec2, Vec3};
use rayon::prelude::*;

use super::Stage;
use crate::image::Channel;

/// `depth.Z` (object units), `id.T` (triangle, −1 where nothing is) and `normal.X/Y/Z` (object frame) at
/// the turntable angle `angle` (radians), row by row from the top.
pub fn pixel_centres(stage: &Stage, angle: f64) -> Vec<Channel> {
    let camera = &stage.scene().camera;
    let view = stage.view(angle);
    let centre = |pixel: usize| {
        let (x, y) = (pixel % camera.width, pixel / camera.width);
        let ray = view.ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
        match stage.accel.closest_hit(&ray, f32::INFINITY) {
            Some(hit) => {
                let normal = stage.mesh.normal_at(hit.triangle, Vec2::new(hit.u, hit.v));
                (hit.t * stage.mesh.scale as f32, hit.triangle as f32, normal)
            }
            None => (0.0, -1.0, Vec3::ZERO),
        }
    };
    let centres: Vec<(f32, f32, Vec3)> = (0..camera.width * camera.height)
        .into_par_iter()
        .map(centre)
        .collect();
    let channel = |name: &str, value: fn(&(f32, f32, Vec3)) -> f32| Channel {
        name: name.to_owned(),
        samples: centres.iter().map(value).collect(),
    };
    vec![
        channel("depth.Z", |c| c.0),
        channel("id.T", |c| c.1),
        channel("normal.X", |c| c.2.x),
        channel("normal.Y", |c| c.2.y),
        channel("normal.Z", |c| c.2.z),
    ]
}
