//! What the corners of a frame's pixels see: where paths are worth more, and where less.
//!
//! The corners are no samples of the pixel, so that choosing by them biases nothing; what is too thin
//! for them to notice is sampled like the rest.

use glam::{DVec2, Vec2, Vec3};
use rayon::prelude::*;

use super::integrator::Illuminated;
use crate::accel::Hit;
use crate::geometry::Ray;
use crate::rig::View;

/// What one corner of a pixel sees; the more is known, the greater.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
enum Corner {
    Nothing,
    Object,
    /// Surface that nothing rises above.
    Open,
    /// The same, and tables know what it reflects.
    Tabulated,
}

/// What a pixel's corners see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Corners {
    /// Nothing, or something that is not open everywhere.
    Inside,
    /// Some the object and others not.
    Silhouette,
    /// Some open surface and others nothing.
    OpenSilhouette,
    /// Open surface, all of them, and tables know what it reflects.
    Open,
}

/// What corners see of the pixels in `covered`.
pub(super) fn corners_of(
    illuminated: &Illuminated<'_>,
    view: &View,
    covered: &[bool],
    width: usize,
    height: usize,
) -> Vec<Corners> {
    let seen = |x: usize, y: usize| {
        let ray = view.ray(DVec2::new(x as f64, y as f64));
        match illuminated.stage.accel.closest_hit(&ray, f32::INFINITY) {
            None => Corner::Nothing,
            Some(hit) if !illuminated.is_open(&ray, &hit) => Corner::Object,
            Some(hit) if !illuminated.is_tabulated(&ray, &hit) => Corner::Open,
            Some(_) => Corner::Tabulated,
        }
    };
    let near = |x: usize, y: usize| {
        let (columns, rows) = (
            x.saturating_sub(1)..(x + 1).min(width),
            y.saturating_sub(1)..(y + 1).min(height),
        );
        rows.into_iter()
            .any(|y| columns.clone().any(|x| covered[y * width + x]))
    };
    let corners: Vec<Corner> = (0..=height)
        .into_par_iter()
        .flat_map_iter(|y| {
            (0..=width).map(move |x| {
                if near(x, y) {
                    seen(x, y)
                } else {
                    Corner::Nothing
                }
            })
        })
        .collect();
    (0..width * height)
        .map(|pixel| {
            let first = pixel / width * (width + 1) + pixel % width;
            let four = [first, first + 1, first + width + 1, first + width + 2];
            let count = |at_least: Corner| {
                let of = |corner: &usize| corners[*corner] >= at_least;
                four.iter().filter(|corner| of(corner)).count()
            };
            match (covered[pixel], count(Corner::Object)) {
                (true, seen @ 1..4) if count(Corner::Open) == seen => Corners::OpenSilhouette,
                (true, 1..4) => Corners::Silhouette,
                (true, 4) if count(Corner::Tabulated) == 4 => Corners::Open,
                _ => Corners::Inside,
            }
        })
        .collect()
}

impl Illuminated<'_> {
    /// Whether nothing rises above the surface where a camera ray met it from above.
    fn is_open(&self, ray: &Ray, hit: &Hit) -> bool {
        let mesh = &self.stage.mesh;
        let (number, _) = self.patches.of(hit.triangle);
        mesh.geometric_normal(hit.triangle).dot(ray.direction) < 0.0
            && self.patches.get(number, mesh, &self.stage.accel).convex
    }

    /// Whether tables know what an open surface reflects where a camera ray met it.
    fn is_tabulated(&self, ray: &Ray, hit: &Hit) -> bool {
        let (stage, mesh) = (self.stage, &self.stage.mesh);
        let barycentric = Vec2::new(hit.u, hit.v);
        let (normal, side) = (
            mesh.normal_at(hit.triangle, barycentric),
            mesh.geometric_normal(hit.triangle),
        );
        if self.light.has_lamp_between(normal, side) {
            return false;
        }
        let cos_o = -normal.dot(ray.direction);
        let served = stage.lobe.as_ref().is_some_and(|table| table.serves(cos_o));
        served || stage.material.at(mesh, hit.triangle, barycentric).rho_s == Vec3::ZERO
    }
}
