//! The light is estimated, too: the setting of Dong et al. (2014, *Appearance-from-Motion: Recovering
//! Spatially Varying Surface Reflectance under Unknown Lighting*), which the paper is compared with.
//!
//! What is seen is linear in the light once the materials are known, so the two are found in turns:
//!
//! ```text
//! materials   the paper's gradient estimator in the last light
//! light       min over E ≥ 0 of  Σ ‖T(x, t) − ∫ (rho_d/π + f_s) E(R_t ω) (n·ω)+ dω‖² + λ Σ w_ij (E_i − E_j)²
//! ```
//!
//! over texels i beside j of a small lat-long map. `w_ij = 1/(|E_i − E_j| + ε)` of the last light makes
//! differences few and large, as Dong et al. assume of natural light.
//!
//! Simplified against them: lobes are Beckmann or GGX, not tabulated; the light is fitted to the traces, not to
//! their gradients alone, which leave its mean open; the light is fitted to some of the points, on which alone
//! the turns are taken. Nothing tells the light's scale from the albedos', so its mean radiance is taken as
//! the probe's; nothing else of the probe is used.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::Estimate;
use super::columns::Columns;
use super::forward_model::{ForwardModel, Scratch};
use super::fresnel_model::FresnelModel;
use super::visibility::Visibility;
use super::{FitSettings, gradient, non_negative};
use crate::brdf::{Alpha, Ndf, dielectric};
use crate::geometry::{Local, direction_from_latlong};
use crate::probe::{Environment, SplitLight};
use crate::traces::{Observation, Trace, TraceSet};

/// Texels of the light: 11° apart.
pub(super) const WIDTH: usize = 32;
pub(super) const HEIGHT: usize = 16;
pub(super) const TEXELS: usize = WIDTH * HEIGHT;
/// Directions by which a texel's share of a lobe is summed, across and down.
const SUBDIVISION: usize = 4;
/// Points that the light is fitted to.
const POINTS: usize = 160;
/// Observations of each of them.
const FRAMES: usize = 24;
/// Most turns.
const ROUNDS: u32 = 12;
/// A light that changes by less than this, relative root mean square, is settled.
const SETTLED: f64 = 0.01;
/// Weight of the differences, over the mean diagonal of the normal equations.
const SMOOTHNESS: f64 = 1e-3;
/// Difference, over the mean radiance, below which texels count as alike.
const ALIKE: f64 = 0.1;
/// The lobe that all points have at first, and its specular albedo: that of a plastic.
const FIRST_ALPHA: f32 = 0.1;
const FIRST_RHO_S: f32 = 2.35;

/// A light that was estimated.
#[derive(Clone, Debug, PartialEq)]
pub struct EstimatedLight {
    /// Texels across.
    pub width: usize,
    /// Texels down.
    pub height: usize,
    /// `[height][width]` linear RGB radiance, row 0 at the zenith, world frame; its mean is the probe's.
    pub radiance: Vec<[f32; 3]>,
    /// Turns that were taken.
    pub rounds: u32,
    /// How much the last turn changed it, root mean square relative to its own.
    pub change: f64,
}

/// Finds the light in turns with the materials; `known` gives its mean radiance and nothing else.
pub(super) fn estimate_light(
    traces: &TraceSet,
    known: &SplitLight,
    settings: &FitSettings,
) -> EstimatedLight {
    let whole = known.whole.roots().map(|i| known.whole.nodes()[i].flux);
    let mean = whole.sum::<Vec3>().element_sum() / (4.0 * std::f32::consts::PI);
    let seen: Vec<&Trace> = traces.traces.iter().filter(|t| t.frames() >= 4).collect();
    let some: Vec<Trace> = seen
        .iter()
        .step_by(seen.len().div_ceil(POINTS).max(1))
        .map(|trace| trace.nearest())
        .collect();
    let mut light = EstimatedLight {
        width: WIDTH,
        height: HEIGHT,
        radiance: vec![[mean / 3.0; 3]; TEXELS],
        rounds: 0,
        change: f64::INFINITY,
    };
    let mut materials: Vec<Estimate> = some.iter().map(|t| first_guess(t, mean / 3.0)).collect();
    while light.rounds < ROUNDS && light.change > SETTLED {
        let radiance = fit_light(&some, &materials, traces, settings.fresnel, &light.radiance);
        let radiance = of_mean(radiance, mean);
        light.change = change(&radiance, &light.radiance);
        light.radiance = radiance;
        light.rounds += 1;
        let Some(split) = light.split() else {
            break;
        };
        materials = fit_materials(&some, &split, traces, settings);
    }
    light
}

impl EstimatedLight {
    /// As the fit uses it.
    pub(super) fn split(&self) -> Option<SplitLight> {
        let texels = self.radiance.clone();
        let environment = Environment::from_texels(self.width, self.height, texels).ok()?;
        Some(SplitLight::new(&environment))
    }
}

/// Materials before there is a light: all change is due to one lobe, and what never leaves is diffuse.
fn first_guess(trace: &Trace, mean: f32) -> Estimate {
    let darkest = trace.observations.iter().map(|o| o.radiance);
    let floor = darkest.reduce(Vec3::min).unwrap_or_default();
    Estimate {
        rho_d: (floor / mean.max(f32::MIN_POSITIVE)).clamp(Vec3::ZERO, Vec3::ONE),
        rho_s: Vec3::splat(FIRST_RHO_S),
        alpha: FIRST_ALPHA,
        ..Estimate::without_data(super::Status::Converged, trace.frames())
    }
}

/// The paper's estimator in a light.
fn fit_materials(
    some: &[Trace],
    light: &SplitLight,
    traces: &TraceSet,
    settings: &FitSettings,
) -> Vec<Estimate> {
    let rotations = &traces.world_from_object;
    let model = ForwardModel::new(light, rotations, settings.fresnel, settings.light_nodes);
    let model = model.of_the_paper(settings.window);
    some.par_iter()
        .map_init(
            || (Scratch::default(), Columns::default()),
            |(scratch, columns), trace| {
                model.columns(trace, &Visibility::Open, None, scratch, columns);
                gradient::estimate(trace, columns, settings)
            },
        )
        .collect()
}

/// What one observation shows of every texel, for unit albedos.
struct Row {
    observed: Vec3,
    rho_d: Vec3,
    rho_s: f32,
    /// `[texels]` `∫ (n·ω)+ dω / π`.
    diffuse: Vec<f32>,
    /// `[texels]` `∫ f_s (n·ω)+ dω`.
    specular: Vec<f32>,
}

impl Row {
    fn entry(&self, texel: usize, channel: usize) -> f64 {
        let diffuse = self.rho_d[channel] * self.diffuse[texel];
        f64::from(diffuse + self.rho_s * self.specular[texel])
    }
}

/// The light of least squares, given materials, near the last one's edges.
pub(super) fn fit_light(
    some: &[Trace],
    materials: &[Estimate],
    traces: &TraceSet,
    fresnel: FresnelModel,
    last: &[[f32; 3]],
) -> Vec<[f32; 3]> {
    let eta = fresnel.eta().unwrap_or(super::fresnel_model::PAPER_ETA);
    let directions = directions();
    let rows: Vec<Row> = some
        .par_iter()
        .zip(materials)
        .flat_map_iter(|(trace, material)| {
            let step = trace.observations.len().div_ceil(FRAMES).max(1);
            let observations = trace.observations.iter().step_by(step);
            observations.filter(|o| !o.saturated.any()).map(|o| {
                let rotation = &traces.world_from_object[o.frame as usize];
                row(
                    o,
                    *rotation * o.wo,
                    *rotation * o.normal,
                    material,
                    eta,
                    &directions,
                )
            })
        })
        .collect();
    let channels: Vec<Vec<f64>> = (0..3)
        .map(|c| {
            let last: Vec<f64> = last.iter().map(|texel| f64::from(texel[c])).collect();
            fit_channel(&rows, c, &last)
        })
        .collect();
    (0..TEXELS)
        .map(|i| [0, 1, 2].map(|c: usize| channels[c][i] as f32))
        .collect()
}

fn fit_channel(rows: &[Row], channel: usize, last: &[f64]) -> Vec<f64> {
    let entries: Vec<Vec<f64>> = rows
        .iter()
        .map(|row| (0..TEXELS).map(|i| row.entry(i, channel)).collect())
        .collect();
    let mut a: Vec<f64> = (0..TEXELS)
        .into_par_iter()
        .flat_map_iter(|i| {
            let mut products = vec![0.0; TEXELS];
            for entries in entries.iter().filter(|entries| entries[i] != 0.0) {
                for (product, entry) in products.iter_mut().zip(entries) {
                    *product += entries[i] * entry;
                }
            }
            products
        })
        .collect();
    let b: Vec<f64> = (0..TEXELS)
        .into_par_iter()
        .map(|i| {
            let products = entries.iter().zip(rows);
            products
                .map(|(entries, row)| entries[i] * f64::from(row.observed[channel]))
                .sum()
        })
        .collect();

    // Differences between neighbours: few and large, as they were in the last light.
    let trace: f64 = (0..TEXELS).map(|i| a[i * TEXELS + i]).sum();
    let mean = last.iter().sum::<f64>() / TEXELS as f64;
    let strength = SMOOTHNESS * trace / TEXELS as f64;
    for i in 0..TEXELS {
        let (column, row) = (i % WIDTH, i / WIDTH);
        let right = row * WIDTH + (column + 1) % WIDTH;
        let below = (row + 1 < HEIGHT).then_some(i + WIDTH);
        for j in [Some(right), below].into_iter().flatten() {
            let difference = (last[i] - last[j]).abs() / mean.max(f64::MIN_POSITIVE);
            let weight = strength / (difference + ALIKE);
            a[i * TEXELS + i] += weight;
            a[j * TEXELS + j] += weight;
            a[i * TEXELS + j] -= weight;
            a[j * TEXELS + i] -= weight;
        }
    }
    non_negative::solve(&a, &b)
}

/// A direction, the solid angle that it stands for, and the texels about it with their bilinear weights.
struct Ray {
    direction: Vec3,
    solid_angle: f32,
    texels: [(usize, f32); 4],
}

/// Directions over the whole sphere, [`SUBDIVISION`] to a texel either way.
fn directions() -> Vec<Ray> {
    let (columns, rows) = (WIDTH * SUBDIVISION, HEIGHT * SUBDIVISION);
    let step = std::f32::consts::PI / rows as f32;
    (0..columns * rows)
        .map(|i| {
            let place = Vec2::new((i % columns) as f32 + 0.5, (i / columns) as f32 + 0.5);
            let uv = place / Vec2::new(columns as f32, rows as f32);
            let x = uv.x * WIDTH as f32 - 0.5;
            let y = (uv.y * HEIGHT as f32 - 0.5).clamp(0.0, (HEIGHT - 1) as f32);
            let (fx, fy) = (x - x.floor(), y - y.floor());
            let left = (x.floor() + WIDTH as f32) as usize % WIDTH;
            let (right, top) = ((left + 1) % WIDTH, y as usize);
            let bottom = (top + 1).min(HEIGHT - 1);
            Ray {
                direction: direction_from_latlong(uv),
                solid_angle: step * step * (std::f32::consts::PI * uv.y).sin(),
                texels: [
                    (top * WIDTH + left, (1.0 - fx) * (1.0 - fy)),
                    (top * WIDTH + right, fx * (1.0 - fy)),
                    (bottom * WIDTH + left, (1.0 - fx) * fy),
                    (bottom * WIDTH + right, fx * fy),
                ],
            }
        })
        .collect()
}

/// What an open surface shows; directions in the world frame.
fn row(
    observation: &Observation,
    wo: Vec3,
    normal: Vec3,
    material: &Estimate,
    eta: f32,
    directions: &[Ray],
) -> Row {
    let alpha = Alpha::saturating(material.alpha);
    let ndf: Ndf = material.ndf;
    let masking = |cos: f32| {
        let w = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
        ndf.masking_over_cos(Local(w), alpha)
    };
    let to_camera = 0.25 * masking(normal.dot(wo).max(1e-3));
    let mut row = Row {
        observed: observation.radiance,
        rho_d: material.rho_d,
        rho_s: material.rho_s.x,
        diffuse: vec![0.0; TEXELS],
        specular: vec![0.0; TEXELS],
    };
    for ray in directions {
        let cos_i = ray.direction.dot(normal);
        if cos_i <= 0.0 {
            continue;
        }
        let flux = cos_i * ray.solid_angle;
        let half = ray.direction + wo;
        let length2 = half.length_squared().max(1e-12);
        let sin2_h = (half.cross(normal).length_squared() / length2).min(1.0);
        let wm = Local(Vec3::new(sin2_h.sqrt(), 0.0, (1.0 - sin2_h).sqrt()));
        let fresnel = dielectric(0.5 * length2.sqrt(), eta);
        let specular = ndf.density(wm, alpha) * masking(cos_i) * to_camera * fresnel * flux;
        for (texel, weight) in ray.texels {
            row.diffuse[texel] += weight * flux / std::f32::consts::PI;
            row.specular[texel] += weight * specular;
        }
    }
    row
}

/// Solid angle of a texel, row by row.
fn solid_angle(texel: usize) -> f64 {
    let edge = |row: usize| (std::f64::consts::PI * row as f64 / HEIGHT as f64).cos();
    let row = texel / WIDTH;
    std::f64::consts::TAU / WIDTH as f64 * (edge(row) - edge(row + 1))
}

/// Scaled to a mean radiance, its channels summed.
fn of_mean(mut radiance: Vec<[f32; 3]>, mean: f32) -> Vec<[f32; 3]> {
    let texels = radiance.iter().enumerate();
    let flux: f64 = texels
        .map(|(i, texel)| solid_angle(i) * f64::from(texel.iter().sum::<f32>()))
        .sum();
    let own = flux / (4.0 * std::f64::consts::PI);
    if own > 0.0 {
        let scale = (f64::from(mean) / own) as f32;
        radiance
            .as_flattened_mut()
            .iter_mut()
            .for_each(|v| *v *= scale);
    }
    radiance
}

/// Root mean square difference over the root mean square, by solid angle.
pub(super) fn change(now: &[[f32; 3]], before: &[[f32; 3]]) -> f64 {
    let (mut difference, mut whole) = (0.0, 0.0);
    for (i, (now, before)) in now.iter().zip(before).enumerate() {
        for (n, b) in now.iter().zip(before) {
            difference += solid_angle(i) * f64::from(n - b).powi(2);
            whole += solid_angle(i) * f64::from(*n).powi(2);
        }
    }
    if whole > 0.0 {
        (difference / whole).sqrt()
    } else {
        0.0
    }
}
