//! A light that a small map can hold is found from what it shows on known materials.

use glam::Vec3;

use super::fresnel_model::FresnelModel;
use super::turntable::{Material, Turntable};
use super::unknown_light::{HEIGHT, TEXELS, WIDTH, change, fit_light};
use super::{Estimate, Status};
use crate::brdf::Ndf;
use crate::image::RgbImage;
use crate::traces::Trace;

/// A sky and three windows.
fn truth() -> Vec<[f32; 3]> {
    let window = |i: usize| match (i % WIDTH, i / WIDTH) {
        (6..9, 5..7) => 20.0,
        (18..20, 6..9) => 12.0,
        (26..27, 4..6) => 30.0,
        _ => 0.5,
    };
    (0..TEXELS)
        .map(|i| [window(i), 0.9 * window(i), 0.7 * window(i)])
        .collect()
}

#[test]
fn light_is_found_where_the_materials_are_known() {
    let truth = truth();
    let image = RgbImage::from_fn(WIDTH, HEIGHT, |x, y| truth[y * WIDTH + x]);
    let turntable = Turntable::under(image, 48);
    let material = Material::neutral(Ndf::Ggx, 0.1, 4.0);
    let points: Vec<Trace> = (0..120)
        .map(|i| turntable.point(i, &material, 0.002).trace)
        .collect();
    let estimate = Estimate {
        rho_d: material.rho_d,
        rho_s: Vec3::splat(4.0),
        alpha: 0.1,
        ..Estimate::without_data(Status::Converged, 48)
    };
    let traces = turntable.traces();
    let materials = vec![estimate; points.len()];
    let eta = FresnelModel::Dielectric { eta: 1.3 };
    let mut light = vec![[1.0; 3]; TEXELS];
    for _ in 0..3 {
        light = fit_light(&points, &materials, &traces, eta, &light);
    }
    let error = change(&truth, &light);
    println!("light found to {error:.3}");
    assert!(error < 0.15, "{error}");
    // No light at all is an error of one, uniform light hardly better.
    assert!(change(&truth, &vec![[1.0; 3]; TEXELS]) > 0.8);
}
