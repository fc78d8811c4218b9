//! One path: next-event estimation and BSDF sampling joined by multiple importance sampling.
//!
//! ```text
//! L(x, ω_o) = ∫ f(ω_i, ω_o; x) [ V E(ω_i) + (1 − V) L(x', −ω_i) ] (n·ω_i)+ dω_i          (Eq. 4)
//! ```
//!
//! Each bounce draws one direction from the light and one from the lobe; both estimate the direct
//! term with power-heuristic weights (Veach 1997), and the second carries the path on where it
//! meets the object again. The camera's own ray sees no background.

use glam::Vec3;

use super::{RenderStats, Stage};
use crate::accel::Hit;
use crate::geometry::{Frame, Ray, offset_origin};
use crate::probe::TurnedLight;
use crate::sampling::{SobolPath, as_points, power_heuristic};

/// From this many bounces on, paths end by Russian roulette. Before, nearly every path of an
/// object with albedo around ½ still matters and roulette only adds noise.
const ROULETTE_FROM_BOUNCE: u32 = 4;

/// Radiance along a camera ray that met the object at `hit`, linear RGB.
///
/// `bounces` is the largest number of surface interactions: 1 is direct light only.
pub(super) fn radiance(
    stage: &Stage,
    light: &TurnedLight<'_>,
    mut ray: Ray,
    mut hit: Hit,
    bounces: u32,
    path: &mut SobolPath,
    stats: &mut RenderStats,
) -> Vec3 {
    let mesh = &stage.mesh;
    let mut radiance = Vec3::ZERO;
    let mut throughput = Vec3::ONE;
    for bounce in 1..=bounces {
        // The surface here. Seen from behind its shading normal it is black.
        let barycentric = glam::Vec2::new(hit.u, hit.v);
        let frame = Frame::about(mesh.normal_at(hit.triangle, barycentric));
        let wo = frame.to_local(-ray.direction);
        if wo.cos_theta() <= 0.0 {
            break;
        }
        stats.bounces += 1;
        let position = mesh.position_at(hit.triangle, barycentric);
        let side = mesh.geometric_normal(hit.triangle);
        let leave = |direction: Vec3| {
            let outwards = if side.dot(direction) < 0.0 {
                -side
            } else {
                side
            };
            Ray {
                origin: offset_origin(position, outwards),
                direction,
            }
        };
        let brdf = stage.material.at(mesh, hit.triangle, barycentric);
        let (u_light, u_brdf) = as_points(path.next_4d());
        let [u_lobe, u_roulette, ..] = path.next_4d();

        // A direction towards the light.
        if let Some(sample) = light.sample(position, u_light) {
            let wi = frame.to_local(sample.wi);
            let reflected = brdf.eval(wi, wo) * wi.cos_theta();
            if reflected != Vec3::ZERO {
                stats.shadow_rays += 1;
                if !stage.accel.occluded(&leave(sample.wi), f32::INFINITY) {
                    let weight = power_heuristic(sample.pdf, brdf.pdf(wi, wo)) / sample.pdf;
                    radiance += throughput * reflected * sample.radiance * weight;
                }
            }
        }

        // A direction from the lobe: it meets the light, or the object again.
        let Some(sample) = brdf.sample(wo, u_lobe, u_brdf) else {
            break;
        };
        throughput *= sample.weight;
        ray = leave(frame.from_local(sample.wi));
        stats.closest_rays += 1;
        match stage.accel.closest_hit(&ray, f32::INFINITY) {
            None => {
                let weight = power_heuristic(sample.pdf, light.pdf(position, ray.direction));
                radiance += throughput * light.radiance(position, ray.direction) * weight;
                break;
            }
            Some(next) => hit = next,
        }

        if bounce >= ROULETTE_FROM_BOUNCE {
            let survival = throughput.max_element().min(0.95);
            if u_roulette >= survival {
                break;
            }
            throughput /= survival;
        }
    }
    radiance
}
