//! Light that the object throws on itself.
//!
//! Where a point's view is blocked it sees another part of the object, whose radiance the current
//! estimate predicts: the diffuse reflection `rho_d T_d` of every point in every frame, all orders of
//! diffuse reflection included, and the specular reflection of unoccluded light. Under the paper's
//! Fresnel the specular part is small beside the light but not beside the diffuse part (rho_s = 2.35
//! reflects 4 % face on), so it counts.

use glam::{BVec3, Mat3, Vec3};
use rayon::prelude::*;

use super::Estimate;
use super::gloss::Gloss;
use super::visibility::{BlockedPatch, Visibility};
use crate::brdf::Ndf;

/// Iterations of the object's own light in each round of a fit, which go on from the last round's. An
/// order of reflection carries at most the share of the last that albedo and the blocked part of the
/// hemisphere leave: below a third on ordinary objects.
const ITERATIONS: usize = 4;

/// What a point reflects with.
#[derive(Clone, Copy)]
struct Material {
    rho_d: Vec3,
    /// Channels of `rho_d` that are the point's own.
    is_fitted: BVec3,
    rho_s: Vec3,
    alpha: f32,
    /// The roughness in the tables of [`Gloss`].
    place: f32,
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
    /// `[point · frames + frame]` irradiance of the light alone over π.
    pub(super) irradiance: &'a [Vec3],
}

/// Predicted radiance of the object.
pub(super) struct Glow<'a> {
    scene: &'a Scene<'a>,
    materials: Vec<Material>,
    /// `[point · frames + frame]` irradiance over π, the object's own light included.
    irradiance: Vec<Vec3>,
    /// `[point · frames + frame]` diffusely reflected radiance.
    diffuse: Vec<Vec3>,
}

impl<'a> Glow<'a> {
    /// The object's light under estimates that were made in the light of `previous`, or of the
    /// sources alone.
    ///
    /// A fit determines the diffuse radiance `rho_d T_d` better than its factors: in a hollow, an
    /// albedo fitted without the object's light is too large by what that light adds. So it is the
    /// radiance that is held while the light is iterated, and the albedos follow.
    pub(super) fn new(
        scene: &'a Scene<'a>,
        estimates: &[Estimate],
        previous: Option<&Self>,
    ) -> Self {
        let frames = scene.world_from_object.len().max(1);
        let fitted_in = previous.map_or(scene.irradiance, |p| p.irradiance.as_slice());
        let fitted = materials(estimates);
        let mut glow = Self {
            scene,
            materials: fitted.clone(),
            irradiance: Vec::new(),
            diffuse: match previous {
                Some(previous) => previous.diffuse.clone(),
                None => vec![Vec3::ZERO; scene.irradiance.len()],
            },
        };
        let mut direct = scene.irradiance.to_vec();
        direct
            .par_chunks_mut(frames)
            .enumerate()
            .for_each(|(point, light)| glow.add_mirrored(point, light));
        for _ in 0..ITERATIONS {
            let mut irradiance = direct.clone();
            irradiance
                .par_chunks_mut(frames)
                .enumerate()
                .for_each(|(point, light)| glow.add_diffuse(point, light));
            // The albedo whose radiance is nearest to the fitted one, over all frames.
            for (point, material) in glow.materials.iter_mut().enumerate() {
                let (mut product, mut square) = (Vec3::ZERO, Vec3::ZERO);
                for i in point * frames..(point + 1) * frames {
                    product += fitted_in[i] * irradiance[i];
                    square += irradiance[i] * irradiance[i];
                }
                let ratio = product / square.max(Vec3::splat(f32::MIN_POSITIVE));
                let followed = (fitted[point].rho_d * ratio).min(Vec3::ONE);
                material.rho_d = Vec3::select(material.is_fitted, followed, material.rho_d);
            }
            for (i, (diffuse, light)) in glow.diffuse.iter_mut().zip(&irradiance).enumerate() {
                *diffuse = *light * glow.materials[i / frames].rho_d;
            }
            glow.irradiance = irradiance;
        }
        glow
    }

    /// Adds what a point's blocked directions mirror of the light: irradiance over π, `[frames]`.
    fn add_mirrored(&self, point: usize, light: &mut [Vec3]) {
        let normal = self.scene.normals[point];
        for patch in self.scene.visibilities[point].blocked() {
            let cos = patch.direction.dot(normal).max(0.0);
            let share = cos * patch.solid_angle / std::f32::consts::PI;
            if share > 0.0
                && let Some(mirrored) = self.mirrored(patch)
            {
                for (light, rotation) in light.iter_mut().zip(self.scene.world_from_object) {
                    *light += mirrored.radiance(self.scene.gloss, rotation) * share;
                }
            }
        }
    }

    /// Adds what a point's blocked directions reflect diffusely: irradiance over π, `[frames]`.
    fn add_diffuse(&self, point: usize, light: &mut [Vec3]) {
        let normal = self.scene.normals[point];
        for patch in self.scene.visibilities[point].blocked() {
            let cos = patch.direction.dot(normal).max(0.0);
            let share = cos * patch.solid_angle / std::f32::consts::PI;
            for (row, weight) in self.corners(patch) {
                let weight = weight * share;
                for (light, diffuse) in light.iter_mut().zip(row) {
                    *light += *diffuse * weight;
                }
            }
        }
    }

    /// Writes the radiance of every patch that blocks a point's view in some frames, linear RGB:
    /// `[frames][blocked]`.
    pub(super) fn radiance(
        &self,
        frames: &[usize],
        visibility: &Visibility,
        radiance: &mut Vec<Vec3>,
    ) {
        let patches = visibility.blocked();
        radiance.clear();
        radiance.resize(frames.len() * patches.len(), Vec3::ZERO);
        for (p, patch) in patches.iter().enumerate() {
            let corners = self.corners(patch);
            let mirrored = self.mirrored(patch);
            let places = radiance.iter_mut().skip(p).step_by(patches.len());
            for (place, &frame) in places.zip(frames) {
                *place = corners
                    .iter()
                    .map(|(row, weight)| row[frame] * *weight)
                    .sum();
                if let Some(mirrored) = &mirrored {
                    let rotation = &self.scene.world_from_object[frame];
                    *place += mirrored.radiance(self.scene.gloss, rotation);
                }
            }
        }
    }

    /// Diffusely reflected radiance at the corners of a patch's triangle, `[frames]`, and the weight of
    /// each in the patch.
    fn corners(&self, patch: &BlockedPatch) -> [(&[Vec3], f32); 3] {
        let frames = self.scene.world_from_object.len();
        let corners = self.scene.points_of_triangle[patch.triangle as usize];
        let (u, v) = (patch.barycentric.x, patch.barycentric.y);
        let weights = if patch.is_black {
            [0.0; 3]
        } else {
            [1.0 - u - v, u, v]
        };
        std::array::from_fn(|k| {
            let row = &self.diffuse[corners[k] as usize * frames..][..frames];
            (row, weights[k])
        })
    }

    /// What a patch mirrors of the light, with the material of its first corner's point; none if
    /// nothing.
    fn mirrored(&self, patch: &BlockedPatch) -> Option<Mirrored> {
        let point = self.scene.points_of_triangle[patch.triangle as usize][0] as usize;
        let material = &self.materials[point];
        let wo = -patch.direction;
        let cos_o = wo.dot(patch.normal);
        if patch.is_black || cos_o <= 0.0 || material.rho_s == Vec3::ZERO {
            return None;
        }
        let mirror = 2.0 * cos_o * patch.normal - wo;
        let open = self.scene.visibilities[point].open(mirror, material.alpha);
        (open > 0.0).then_some(Mirrored {
            mirror,
            cos_o,
            rho_s: material.rho_s * open,
            place: material.place,
            ndf: material.ndf,
        })
    }
}

/// A patch that mirrors light.
struct Mirrored {
    /// The mirror direction, unit, object frame.
    mirror: Vec3,
    /// Cosine of the view to its normal.
    cos_o: f32,
    /// Specular albedo times the open share of the lobe.
    rho_s: Vec3,
    /// The roughness in the tables of [`Gloss`].
    place: f32,
    ndf: Ndf,
}

impl Mirrored {
    /// Radiance, linear RGB, of an object turned by `rotation`.
    #[inline]
    fn radiance(&self, gloss: &Gloss, rotation: &Mat3) -> Vec3 {
        gloss.radiance(self.ndf, self.place, *rotation * self.mirror, self.cos_o) * self.rho_s
    }
}

/// What every point reflects with. A diffuse albedo that the data determine neither to half its value
/// nor to 0.02, and a lobe that they do not determine, are the median of those that they do.
fn materials(estimates: &[Estimate]) -> Vec<Material> {
    let diffuse_known = |e: &Estimate, c: usize| {
        e.frames > 0 && e.sigma_rho_d[c] <= (0.5 * e.rho_d[c].min(1.0)).max(0.02)
    };
    let median = |values: &mut dyn Iterator<Item = f32>| {
        let mut values: Vec<f32> = values.collect();
        values.sort_by(f32::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    let lobes = || estimates.iter().filter(|e| e.lobe_is_known());
    let rho_d = Vec3::from([0, 1, 2].map(|c| {
        let known = estimates.iter().filter(|e| diffuse_known(e, c));
        median(&mut known.map(|e| e.rho_d[c].min(1.0)))
    }));
    let rho_s = Vec3::from([0, 1, 2].map(|c| median(&mut lobes().map(|e| e.rho_s[c]))));
    let alpha = median(&mut lobes().map(|e| e.alpha)).max(0.01);
    estimates
        .iter()
        .map(|e| {
            let (rho_s, alpha) = if e.lobe_is_known() {
                (e.rho_s, e.alpha)
            } else {
                (rho_s, alpha)
            };
            let is_fitted = BVec3::from_array([0, 1, 2].map(|c| diffuse_known(e, c)));
            Material {
                rho_d: Vec3::select(is_fitted, e.rho_d.min(Vec3::ONE), rho_d),
                is_fitted,
                rho_s,
                alpha,
                place: Gloss::place(alpha),
                ndf: e.ndf,
            }
        })
        .collect()
}
