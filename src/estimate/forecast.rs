//! What a light will be able to tell about roughness, before anything is photographed.
//!
//! ```text
//! F = Σ_t J_tᵀ J_t / σ²,   J = [T_d, T_s, g T_s, g² T_s, rho_s ∂T_s/∂ln alpha],   σ²(ln alpha) ≥ [F⁻¹]_αα
//! ```
//!
//! (Cramér and Rao; g = 1 − n·ω_o) for an open, convex surface: normals of one elevation about the
//! turntable's axis (+Y) see the same light in turn, so that σ depends on elevation and roughness alone.
//! Diffuse albedos are one a channel, the specular albedo is neutral, the lobe GGX's.
//!
//! How the lobe grows towards grazing counts as unknown, too, to second order. A fit takes Fresnel's index and
//! masking as given, and under perfectly even light it would tell roughness from them alone, to 5 %; real
//! surfaces do not keep to them so closely.

use std::f32::consts::PI;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::light_cut::{Lobe, LobeCut};
use crate::brdf::{Alpha, Dichromatic, Fresnel};
use crate::geometry::Frame;
use crate::probe::{Irradiance, LightPyramid};

/// Roughnesses of a forecast.
pub const FORECAST_ALPHAS: [f32; 5] = [0.05, 0.1, 0.2, 0.35, 0.5];
/// Elevations of the normals, degrees.
const ELEVATIONS: [f32; 17] = [
    -80.0, -70.0, -60.0, -50.0, -40.0, -30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0, 50.0,
    60.0, 70.0, 80.0,
];
/// Beyond this σ(ln alpha) a roughness counts as unknown.
pub const UNKNOWN: f64 = 0.3;
/// Views flatter than 78° are not counted.
const LEAST_COS: f32 = 0.2;
/// Frames in which a normal must be seen.
const LEAST_FRAMES: usize = 4;
/// Light nodes an observation: errors of the slopes would look like information.
const NODES: usize = 1 << 12;

/// What is going to be photographed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CapturePlan {
    /// To the camera, unit, world frame.
    pub wo: Vec3,
    /// Frames of one turn about +Y.
    pub frames: u32,
    /// Standard deviation of a sample over the mean of its trace.
    pub noise: f32,
    /// Diffuse albedo.
    pub rho_d: f32,
    /// Specular albedo.
    pub rho_s: f32,
    /// Fresnel's index.
    pub eta: f32,
}

/// A lamp that could be added.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// To its centre, unit, world frame.
    pub direction: Vec3,
    /// Radiance × solid angle, linear RGB × steradian.
    pub flux: Vec3,
    /// Half-angle, radians.
    pub radius: f32,
}

/// Expected σ(ln alpha).
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    /// Elevations of the normals, degrees.
    pub elevations: Vec<f32>,
    /// `[alpha][elevation]` σ(ln alpha), of [`FORECAST_ALPHAS`]; infinite where nothing tells it, none where the
    /// camera never looks.
    pub sigma: Vec<Vec<Option<f64>>>,
}

impl Forecast {
    /// Median of σ(ln alpha) over the normals of a sphere that the camera sees; infinite if there are none.
    pub fn median(&self, alpha: usize) -> f64 {
        let mut seen: Vec<(f64, f64)> = self.weighted(alpha).collect();
        seen.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let half = 0.5 * seen.iter().map(|s| s.1).sum::<f64>();
        let mut below = 0.0;
        for (sigma, weight) in seen {
            below += weight;
            if below >= half {
                return sigma;
            }
        }
        f64::INFINITY
    }

    /// Share of those normals whose roughness stays unknown.
    pub fn unknown(&self, alpha: usize) -> f64 {
        let all: f64 = self.weighted(alpha).map(|s| s.1).sum();
        let lost = self.weighted(alpha).filter(|s| s.0 > UNKNOWN);
        if all > 0.0 {
            lost.fold(0.0, |sum, s| sum + s.1) / all
        } else {
            1.0
        }
    }

    /// σ and the solid angle of its normals.
    fn weighted(&self, alpha: usize) -> impl Iterator<Item = (f64, f64)> {
        let sigmas = self.sigma[alpha].iter().zip(&self.elevations);
        sigmas.filter_map(|(sigma, e)| sigma.map(|s| (s, f64::from(e.to_radians().cos()))))
    }

    /// One number to compare lamps by: the mean over roughnesses of the medians' logarithms.
    fn score(&self) -> f64 {
        let medians = (0..self.sigma.len()).map(|k| self.median(k).min(10.0).ln());
        medians.sum::<f64>() / self.sigma.len() as f64
    }
}

/// What an observation sees of unit albedos.
#[derive(Clone)]
struct Sight {
    normal: Vec3,
    diffuse: Vec3,
    /// `[alpha]` `T_s` and its derivative by `ln alpha`.
    specular: [(Vec3, Vec3); 5],
}

/// Traces by elevation, to which lamps can be added.
pub struct Forecaster {
    plan: CapturePlan,
    /// `[elevation][frame]`, only frames in which the normal is seen.
    sights: Vec<Vec<Sight>>,
    /// Flux of the whole light.
    pub(super) flux: Vec3,
}

impl Forecaster {
    /// Traces of the light alone.
    pub fn new(pyramid: &LightPyramid, plan: CapturePlan) -> Self {
        let irradiance = Irradiance::new(pyramid);
        let sights = ELEVATIONS
            .par_iter()
            .map(|&elevation| {
                let mut cut = LobeCut::default();
                normals(elevation, &plan)
                    .map(|normal| {
                        let mut sight = Sight::dark(normal);
                        sight.diffuse = irradiance.at(normal) / PI;
                        let lobe = Lobe {
                            wo: plan.wo,
                            normal,
                            smallest_alpha: 0.5 * FORECAST_ALPHAS[0],
                        };
                        cut.restart(0.0);
                        cut.visit(pyramid, NODES, &lobe, |seen| {
                            sight.add_lobe(seen.node.direction, seen.node.flux, &plan);
                        });
                        sight
                    })
                    .collect()
            })
            .collect();
        let roots = pyramid.roots().map(|i| pyramid.nodes()[i].flux);
        Self {
            plan,
            sights,
            flux: roots.sum(),
        }
    }

    /// The forecast for the light alone.
    pub fn forecast(&self) -> Forecast {
        self.of(&self.sights)
    }

    /// The forecast with a lamp added.
    pub fn with_lamp(&self, lamp: &Lamp) -> Forecast {
        // A disc in eight parts: its middle, and seven around.
        let frame = Frame::about(lamp.direction);
        let parts: Vec<Vec3> = (0..8)
            .map(|k| {
                let angle = 2.0 * PI * k as f32 / 7.0;
                let radius = if k == 7 { 0.0 } else { 0.756 * lamp.radius };
                let sideways = frame.tangent * angle.cos() + frame.bitangent * angle.sin();
                (lamp.direction + radius.tan() * sideways).normalize()
            })
            .collect();
        let mut sights = self.sights.clone();
        for sight in sights.iter_mut().flatten() {
            let cos = lamp.direction.dot(sight.normal).max(0.0);
            sight.diffuse += lamp.flux * (cos / PI);
            for &direction in &parts {
                sight.add_lobe(direction, lamp.flux / 8.0, &self.plan);
            }
        }
        self.of(&sights)
    }

    /// The direction above the table, on a grid of 10°, in which a lamp of half-angle `radius` with `share` of the present
    /// light's flux helps most, and the forecast with it.
    pub fn best_lamp(&self, radius: f32, share: f32) -> (Lamp, Forecast) {
        let candidates: Vec<Lamp> = (0..=8)
            .flat_map(|row| (0..36).map(move |column| (10.0 * row as f32, 10.0 * column as f32)))
            .map(|(elevation, azimuth)| Lamp {
                direction: direction(elevation, azimuth.to_radians()),
                flux: self.flux * share,
                radius,
            })
            .collect();
        let scores: Vec<f64> = candidates
            .par_iter()
            .map(|lamp| self.with_lamp(lamp).score())
            .collect();
        let best = (0..candidates.len())
            .min_by(|&a, &b| scores[a].total_cmp(&scores[b]))
            .unwrap_or(0);
        let lamp = candidates[best];
        (lamp, self.with_lamp(&lamp))
    }

    fn of(&self, sights: &[Vec<Sight>]) -> Forecast {
        let sigma = (0..FORECAST_ALPHAS.len())
            .map(|k| {
                sights
                    .iter()
                    .map(|turn| {
                        (turn.len() >= LEAST_FRAMES).then(|| sigma_ln_alpha(turn, k, &self.plan))
                    })
                    .collect()
            })
            .collect();
        Forecast {
            elevations: ELEVATIONS.to_vec(),
            sigma,
        }
    }
}

/// A direction at `elevation` degrees and `azimuth` radians from +Z towards +X.
pub(super) fn direction(elevation: f32, azimuth: f32) -> Vec3 {
    let (sin, cos) = elevation.to_radians().sin_cos();
    Vec3::new(cos * azimuth.sin(), sin, cos * azimuth.cos())
}

/// The normals of a turn that the camera sees, world frame.
fn normals(elevation: f32, plan: &CapturePlan) -> impl Iterator<Item = Vec3> {
    let start = direction(elevation, 0.0);
    let (frames, wo) = (plan.frames, plan.wo);
    (0..frames)
        .map(move |t| Mat3::from_rotation_y(2.0 * PI * t as f32 / frames as f32) * start)
        .filter(move |normal| normal.dot(wo) > LEAST_COS)
}

impl Sight {
    fn dark(normal: Vec3) -> Self {
        Self {
            normal,
            diffuse: Vec3::ZERO,
            specular: [(Vec3::ZERO, Vec3::ZERO); 5],
        }
    }

    /// Adds what the lobes make of light from one direction.
    fn add_lobe(&mut self, direction: Vec3, flux: Vec3, plan: &CapturePlan) {
        let frame = Frame::about(self.normal);
        let (wi, wo) = (frame.to_local(direction), frame.to_local(plan.wo));
        if wi.0.z <= 0.0 {
            return;
        }
        for (sum, alpha) in self.specular.iter_mut().zip(FORECAST_ALPHAS) {
            let lobe = Dichromatic {
                rho_d: Vec3::ZERO,
                rho_s: Vec3::ONE,
                alpha: Alpha::saturating(alpha),
                ggx: 1.0,
                fresnel: Fresnel::Dielectric { eta: plan.eta },
            };
            sum.0 += flux * lobe.eval(wi, wo) * wi.0.z;
            sum.1 += flux * lobe.eval_d_alpha(wi, wo) * (wi.0.z * alpha);
        }
    }
}

/// The bound for a trace, with all albedos and the growth towards grazing unknown.
fn sigma_ln_alpha(turn: &[Sight], alpha: usize, plan: &CapturePlan) -> f64 {
    // Of specular trace, its growth and its slope, what is not a multiple of the diffuse trace, over the noise.
    let mut information = [[0.0f64; 4]; 4];
    for c in 0..3 {
        let rows: Vec<[f64; 5]> = turn
            .iter()
            .map(|sight| {
                let (s, slope) = sight.specular[alpha];
                let grazing = 1.0 - sight.normal.dot(plan.wo);
                [
                    sight.diffuse[c],
                    s[c],
                    grazing * s[c],
                    grazing * grazing * s[c],
                    plan.rho_s * slope[c],
                ]
                .map(f64::from)
            })
            .collect();
        let dot = |i: usize, j: usize| rows.iter().map(|r| r[i] * r[j]).sum::<f64>();
        let level: f64 = rows
            .iter()
            .map(|r| f64::from(plan.rho_d) * r[0] + f64::from(plan.rho_s) * r[1])
            .sum();
        let sigma = f64::from(plan.noise) * level / turn.len() as f64;
        let dd = dot(0, 0);
        if sigma <= 0.0 || dd <= 0.0 {
            continue;
        }
        for (i, row) in information.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                let apart = dot(i + 1, j + 1) - dot(0, i + 1) * dot(0, j + 1) / dd;
                *entry += apart / (sigma * sigma);
            }
        }
    }
    // What is left of the slope when the others are taken out, one after the other.
    let whole = information[3][3];
    for k in 0..3 {
        let row = information[k];
        if row[k] > 1e-12 * whole {
            for other in &mut information[k + 1..] {
                let share = other[k] / row[k];
                for (entry, above) in other.iter_mut().zip(row) {
                    *entry -= share * above;
                }
            }
        }
    }
    // Below this it is a multiple of them up to rounding.
    if information[3][3] > 1e-9 * whole {
        information[3][3].sqrt().recip()
    } else {
        f64::INFINITY
    }
}
