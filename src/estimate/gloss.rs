//! What a glossy surface reflects of distant light, by a table over the mirror direction.
//!
//! For light that the object throws on itself, a look-up will do: the lobe about the mirror direction
//! is taken to be the one of a surface seen face on, scaled to the directional albedo of the real
//! view (the split sum of Karis 2013, *Real Shading in Unreal Engine 4*). It is exact under uniform
//! light.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::columns;
use super::forward_model::{LobeScratch, open_lobe};
use super::fresnel_model::FresnelModel;
use crate::brdf::{Alpha, Ndf};
use crate::geometry::{Local, direction_from_octahedral, octahedral_from_direction};
use crate::probe::SplitLight;
use crate::sampling::SobolPath;

/// Cells across the octahedral map of mirror directions: 3.7° apart, below the width of the
/// narrowest lobe.
const CELLS: usize = 48;
/// Roughnesses of the tables: every third of the fit's, up to the widest.
pub(super) const ROUGHNESSES: usize = 7;
/// Step between them in the fit's grid. The narrowest is 0.046: what is reflected is seen in patches
/// 5.6° wide anyway.
const STEP: usize = 3;
/// View angles of the albedo table, even in the cosine.
pub(super) const COSINES: usize = 16;
/// Light nodes a cell.
const LIGHT_NODES: usize = 1024;
/// Samples of an entry of the albedo table.
const ALBEDO_SAMPLES: u32 = 256;

/// Reflected radiance of unit specular albedo.
pub(super) struct Gloss {
    /// `[ndf][roughness][cell]` radiance face on over the albedo face on, linear RGB.
    light: [Vec<Vec3>; 2],
    /// `[ndf][roughness][cosine]` directional albedo, Fresnel included.
    albedo: [Vec<f32>; 2],
}

/// Number in the fit's grid of roughness `k`.
fn number(k: usize) -> usize {
    columns::ROUGHNESSES - 1 - STEP * (ROUGHNESSES - 1 - k)
}

/// Roughness `k` of the tables.
pub(super) fn roughness(k: usize) -> f32 {
    columns::roughness(number(k))
}

impl Gloss {
    /// Tables for a light and the first of a model's Fresnel terms.
    pub(super) fn new(light: &SplitLight, fresnel: FresnelModel) -> Self {
        let reflectance = |cos_d: f32| fresnel.reflectance(fresnel.bases()[0], cos_d);
        let albedo_at = |ndf: Ndf, k: usize, cos: f32| {
            directional_albedo(ndf, Alpha::saturating(roughness(k)), reflectance, cos)
        };
        let albedo = Ndf::ALL.map(|ndf| {
            let entries = (0..ROUGHNESSES).flat_map(|k| (0..COSINES).map(move |c| (k, c)));
            entries
                .map(|(k, c)| albedo_at(ndf, k, (c as f32 + 0.5) / COSINES as f32))
                .collect()
        });
        // [cell][ndf][roughness of the fit]
        let cells: Vec<[[Vec3; columns::ROUGHNESSES]; 2]> = (0..CELLS * CELLS)
            .into_par_iter()
            .map_init(LobeScratch::default, |scratch, cell| {
                let place = Vec2::new((cell % CELLS) as f32 + 0.5, (cell / CELLS) as f32 + 0.5);
                let mirror = direction_from_octahedral(place / CELLS as f32);
                open_lobe(light, fresnel, LIGHT_NODES, mirror, scratch)
            })
            .collect();
        let map = |ndf: Ndf| {
            let entries = (0..ROUGHNESSES).flat_map(|k| {
                let face_on = albedo_at(ndf, k, 1.0);
                let cells = cells.iter();
                cells.map(move |cell| cell[ndf as usize][number(k)] / face_on)
            });
            entries.collect()
        };
        Self {
            light: Ndf::ALL.map(map),
            albedo,
        }
    }

    /// Where a roughness lies in the tables.
    pub(super) fn place(alpha: f32) -> f32 {
        let step = (roughness(1) / roughness(0)).ln();
        ((alpha / roughness(0)).ln() / step).clamp(0.0, (ROUGHNESSES - 1) as f32)
    }

    /// Radiance that a surface of unit `rho_s` and of a roughness at `place` reflects of unoccluded
    /// light towards a view at `cos_o` from its normal, whose mirror direction (world frame) is
    /// `mirror`.
    pub(super) fn radiance(&self, ndf: Ndf, place: f32, mirror: Vec3, cos_o: f32) -> Vec3 {
        let k = (place as usize).min(ROUGHNESSES - 2);
        let t = place - k as f32;
        // Bilinear within the octahedral square; across its edges the nearest cell.
        let place = octahedral_from_direction(mirror) * CELLS as f32 - 0.5;
        let place = place.clamp(Vec2::ZERO, Vec2::splat((CELLS - 1) as f32));
        let (column, row) = (
            (place.x as usize).min(CELLS - 2),
            (place.y as usize).min(CELLS - 2),
        );
        let (u, v) = (place.x - column as f32, place.y - row as f32);
        let light = |k: usize| {
            let map = &self.light[ndf as usize][k * CELLS * CELLS..][..CELLS * CELLS];
            let first = row * CELLS + column;
            let above = map[first].lerp(map[first + 1], u);
            let below = map[first + CELLS].lerp(map[first + CELLS + 1], u);
            above.lerp(below, v)
        };
        let c = ((cos_o * COSINES as f32) as usize).min(COSINES - 1);
        let albedo = |k: usize| self.albedo[ndf as usize][k * COSINES + c];
        let at = |k: usize| light(k) * albedo(k);
        at(k).lerp(at(k + 1), t)
    }
}

/// `∫ f_s cos θ_i dω_i` for unit `rho_s`, over visible normals: the mean of `F G1(wi)`.
pub(super) fn directional_albedo(
    ndf: Ndf,
    alpha: Alpha,
    reflectance: impl Fn(f32) -> f32,
    cos_o: f32,
) -> f32 {
    let wo = Local(Vec3::new((1.0 - cos_o * cos_o).max(0.0).sqrt(), 0.0, cos_o));
    let sample = |index: u32| {
        let [u, v, ..] = SobolPath::new(0, 0, 0, index).next_4d();
        let wm = ndf.sample_visible(wo, alpha, Vec2::new(u, v));
        let cos_d = wo.0.dot(wm.0);
        let wi = 2.0 * cos_d * wm.0 - wo.0;
        if wi.z <= 0.0 {
            return 0.0;
        }
        reflectance(cos_d) * ndf.masking_exact(Local(wi), alpha)
    };
    (0..ALBEDO_SAMPLES).map(sample).sum::<f32>() / ALBEDO_SAMPLES as f32
}
