//! Light that the object throws on itself.
//!
//! Where a point's view is blocked it sees another part of the object, whose radiance the current
//! estimate predicts: the diffuse reflection `rho_d T_d` of every point in every frame, all orders of
//! diffuse reflection included, and the specular reflection of unoccluded light. Under the paper's
//! Fresnel the specular part is small beside the light but not beside the diffuse part (rho_s = 2.35
//! reflects 4 % face on), so it counts.

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::Estimate;
use super::columns::Arrival;
use super::gloss::Gloss;
use super::visibility::{BlockedPatch, Visibility};
use crate::brdf::Ndf;

/// Orders of diffuse reflection. An order carries at most the share of the last that the albedo and
/// the blocked part of the hemisphere leave: below a third on ordinary objects.
const ORDERS: usize = 6;

/// What a point reflects with.
#[derive(Clone, Copy)]
struct Material {
    rho_d: Vec3,
    rho_s: Vec3,
    alpha: f32,
    ndf: Ndf,
}

/// Where the object's light comes from; what stays over the rounds of a fit.
pub(super) struct Scene<'a> {
    /// `[points]`.
    pub(super) visibilities: &'a [Visibility],
    /// `[points]` unit normals, object frame.
    pub(super) normals: &'a [Vec3],
    /// `[triangles]` points at each triangle's corners.
    pub(super) points_of_triangle: &'a [[u32; 3]],
    /// `[frames]` rotation of the object.
    pub(super) world_from_object: &'a [Mat3],
    /// Specular reflection of the light.
    pub(super) gloss: &'a Gloss,
    /// `[frame · points + point]` irradiance of the light alone over π.
    pub(super) irradiance: &'a [Vec3],
}

/// Predicted radiance of the object.
pub(super) struct Glow<'a> {
    scene: &'a Scene<'a>,
    materials: Vec<Material>,
    /// `[frame · points + point]` diffusely reflected radiance, linear RGB.
    diffuse: Vec<Vec3>,
}

impl<'a> Glow<'a> {
    /// The object's light under the current estimates.
    pub(super) fn new(scene: &'a Scene<'a>, estimates: &[Estimate]) -> Self {
        let points = estimates.len();
        let mut glow = Self {
            scene,
            materials: materials(estimates),
            diffuse: vec![Vec3::ZERO; scene.irradiance.len()],
        };
        // Irradiance over π that a point gets from the blocked part of its view.
        let gathered = |glow: &Self, i: usize, light: &dyn Fn(usize, &BlockedPatch) -> Vec3| {
            let (frame, point) = (i / points, i % points);
            let normal = glow.scene.normals[point];
            let patches = glow.scene.visibilities[point].blocked().iter();
            let flux: Vec3 = patches
                .map(|patch| {
                    let cos = patch.direction.dot(normal).max(0.0);
                    light(frame, patch) * (cos * patch.solid_angle)
                })
                .sum();
            flux / std::f32::consts::PI
        };
        let every = 0..scene.irradiance.len();
        let first: Vec<Vec3> = every
            .clone()
            .into_par_iter()
            .map(|i| {
                let specular = |frame, patch: &BlockedPatch| glow.specular(frame, patch);
                scene.irradiance[i] + gathered(&glow, i, &specular)
            })
            .collect();
        for _ in 0..ORDERS {
            glow.diffuse = every
                .clone()
                .into_par_iter()
                .map(|i| {
                    let diffuse = |frame, patch: &BlockedPatch| glow.diffuse(frame, patch);
                    let irradiance = first[i] + gathered(&glow, i, &diffuse);
                    irradiance * glow.materials[i % points].rho_d
                })
                .collect();
        }
        glow
    }

    /// The flux that a point gets from every blocked patch in `frame`.
    pub(super) fn arriving(
        &self,
        frame: usize,
        visibility: &Visibility,
        arrivals: &mut Vec<Arrival>,
    ) {
        arrivals.extend(visibility.blocked().iter().map(|patch| Arrival {
            direction: patch.direction,
            flux: (self.diffuse(frame, patch) + self.specular(frame, patch)) * patch.solid_angle,
        }));
    }

    /// Diffusely reflected radiance of a patch, between the points at its triangle's corners.
    fn diffuse(&self, frame: usize, patch: &BlockedPatch) -> Vec3 {
        let points = self.materials.len();
        let radiance = &self.diffuse[frame * points..][..points];
        let corners = self.scene.points_of_triangle[patch.triangle as usize];
        let (u, v) = (patch.barycentric.x, patch.barycentric.y);
        let at = |i: u32| radiance[i as usize];
        at(corners[0]) * (1.0 - u - v) + at(corners[1]) * u + at(corners[2]) * v
    }

    /// Light that a patch mirrors, with the material of its first corner's point.
    fn specular(&self, frame: usize, patch: &BlockedPatch) -> Vec3 {
        let point = self.scene.points_of_triangle[patch.triangle as usize][0] as usize;
        let material = &self.materials[point];
        let wo = -patch.direction;
        let cos_o = wo.dot(patch.normal);
        if cos_o <= 0.0 || material.rho_s == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let mirror = 2.0 * cos_o * patch.normal - wo;
        let open = self.scene.visibilities[point].open(mirror, material.alpha);
        if open == 0.0 {
            return Vec3::ZERO;
        }
        let mirror = self.scene.world_from_object[frame] * mirror;
        let light = self
            .scene
            .gloss
            .radiance(material.ndf, material.alpha, mirror, cos_o);
        light * material.rho_s * open
    }
}

/// What every point reflects with. Points without an albedo of their own (never seen) take the mean
/// of those that have one; points without a lobe have no specular reflection.
fn materials(estimates: &[Estimate]) -> Vec<Material> {
    let known = |e: &&Estimate| e.frames > 0 && e.sigma_rho_d.is_finite();
    let count = estimates.iter().filter(known).count().max(1) as f32;
    let mean = estimates
        .iter()
        .filter(known)
        .map(|e| e.rho_d / count)
        .sum::<Vec3>();
    estimates
        .iter()
        .map(|e| Material {
            rho_d: if known(&e) { e.rho_d } else { mean },
            rho_s: if e.sigma_rho_s.is_finite() {
                e.rho_s
            } else {
                Vec3::ZERO
            },
            alpha: e.alpha,
            ndf: e.ndf,
        })
        .collect()
}
