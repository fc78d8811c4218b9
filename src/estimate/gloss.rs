//! What a glossy surface reflects of distant light, by a table over the mirror direction.
//!
//! For light that the object throws on itself, a look-up will do: the lobe about the mirror direction
//! is taken to be the one of a surface seen face on, scaled to the directional albedo of the real
//! view (the split sum of Karis 2013, *Real Shading in Unreal Engine 4*). It is exact under uniform
//! light.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::light_cut::{LightCut, Lobe};
use super::lobe_sums::NodeArrays;
use crate::brdf::{Alpha, Ndf, dielectric};
use crate::geometry::{Local, direction_from_octahedral, octahedral_from_direction};
use crate::probe::LightPyramid;
use crate::sampling::SobolPath;

/// Cells across the octahedral map of mirror directions: 3.7° apart, below the width of the
/// narrowest lobe.
const CELLS: usize = 48;
/// Roughnesses of the tables, even in the logarithm.
pub(super) const ROUGHNESSES: usize = 8;
/// The narrowest: what is reflected is seen in patches 5.6° wide anyway.
const SMALLEST_ALPHA: f32 = 0.05;
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

pub(super) fn roughness(k: usize) -> f32 {
    SMALLEST_ALPHA.powf(1.0 - k as f32 / (ROUGHNESSES - 1) as f32)
}

impl Gloss {
    /// Tables for a light and an index of refraction.
    pub(super) fn new(pyramid: &LightPyramid, eta: f32) -> Self {
        let albedo = Ndf::ALL.map(|ndf| {
            let entries = (0..ROUGHNESSES).flat_map(|k| (0..COSINES).map(move |c| (k, c)));
            entries
                .map(|(k, c)| {
                    let cos = (c as f32 + 0.5) / COSINES as f32;
                    directional_albedo(ndf, Alpha::saturating(roughness(k)), eta, cos)
                })
                .collect()
        });
        let alphas: Vec<f32> = (0..ROUGHNESSES).map(roughness).collect();
        // [cell][ndf][roughness]
        let cells: Vec<[Vec<Vec3>; 2]> = (0..CELLS * CELLS)
            .into_par_iter()
            .map_init(
                || (LightCut::default(), NodeArrays::default()),
                |(cut, nodes), cell| {
                    let place = Vec2::new((cell % CELLS) as f32 + 0.5, (cell / CELLS) as f32 + 0.5);
                    let mirror = direction_from_octahedral(place / CELLS as f32);
                    let lobe = Lobe {
                        wo: mirror,
                        normal: mirror,
                        smallest_alpha: SMALLEST_ALPHA,
                    };
                    cut.for_lobe(pyramid, LIGHT_NODES, &lobe);
                    nodes.clear();
                    for &index in &cut.chosen {
                        let node = &pyramid.nodes()[index as usize];
                        let cos_i = node.direction.dot(mirror);
                        if cos_i > 0.0 {
                            // Seen face on, the half vector is half as far away as the light.
                            let cos_d = (0.5 * (1.0 + cos_i)).sqrt();
                            let flux = node.flux * dielectric(cos_d, eta);
                            nodes.push(0.5 * (1.0 - cos_i), cos_i, flux);
                        }
                    }
                    let mut sums = [Vec::new(), Vec::new()];
                    nodes.sums(&alphas, 1.0, &mut sums);
                    sums
                },
            )
            .collect();
        let light = [0, 1].map(|ndf| {
            let entries = (0..ROUGHNESSES).flat_map(|k| cells.iter().map(move |cell| (k, cell)));
            entries
                .map(|(k, cell)| {
                    let face_on = directional_albedo(
                        Ndf::ALL[ndf],
                        Alpha::saturating(roughness(k)),
                        eta,
                        1.0,
                    );
                    cell[ndf][k] / face_on
                })
                .collect()
        });
        Self { light, albedo }
    }

    /// Where a roughness lies in the tables.
    pub(super) fn place(alpha: f32) -> f32 {
        let x = (1.0 - alpha.ln() / SMALLEST_ALPHA.ln()) * (ROUGHNESSES - 1) as f32;
        x.clamp(0.0, (ROUGHNESSES - 1) as f32)
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
pub(super) fn directional_albedo(ndf: Ndf, alpha: Alpha, eta: f32, cos_o: f32) -> f32 {
    let wo = Local(Vec3::new((1.0 - cos_o * cos_o).max(0.0).sqrt(), 0.0, cos_o));
    let sample = |index: u32| {
        let [u, v, ..] = SobolPath::new(0, 0, 0, index).next_4d();
        let wm = ndf.sample_visible(wo, alpha, Vec2::new(u, v));
        let cos_d = wo.0.dot(wm.0);
        let wi = 2.0 * cos_d * wm.0 - wo.0;
        if wi.z <= 0.0 || cos_d <= 0.0 {
            return 0.0;
        }
        dielectric(cos_d, eta) * ndf.masking_exact(Local(wi), alpha)
    };
    (0..ALBEDO_SAMPLES).map(sample).sum::<f32>() / ALBEDO_SAMPLES as f32
}
