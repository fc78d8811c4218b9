//! What a point shows of each half angle: columns for an NDF of any shape.
//!
//! ```text
//! D(θ_h) = Σ_k c_k s_k(θ_h),   s_k = 1 up to knot k, falling to 0 at knot k + 1
//! T_k    = ¼ G1(ω_o)/cos θ_o Σ_j Φ_j F_j G1(ω_j) s_k(θ_h,j)
//! ```
//!
//! With `c_k ≥ 0` that is any function that never rises. Fresnel's term and masking are those of a lobe that
//! is given, and between knots a step falls as that lobe's own density does: falling straight in `ln tan θ_h`
//! instead, the knots in a steep tail came out 10 % too low and more.

use glam::Vec3;

use super::Estimate;
use super::columns::roughness;
use super::forward_model::ForwardModel;
use super::interreflection::Glow;
use super::light_cut::{Lobe, LobeCut, to_object};
use super::visibility::Visibility;
use crate::brdf::{Alpha, Fresnel, Ndf};
use crate::geometry::Local;
use crate::traces::{Observation, Trace};

/// Knots over the half angle.
pub(super) const KNOTS: usize = 28;
/// Steps: one less, as the NDF is zero at the last knot.
pub(super) const STEPS: usize = KNOTS - 1;
/// Tangents of the first and last knots, a factor of 1.29 apart. Half vectors within the first are not told
/// apart.
const RANGE: (f32, f32) = (0.01, 8.0);
/// Variance of a node over its squared distance to the normal below which it is a point.
const NARROW: f32 = 1e-4;

/// Half angle of a knot, radians.
pub(super) fn angle(knot: usize) -> f32 {
    let (first, last) = RANGE;
    let share = knot as f32 / (KNOTS - 1) as f32;
    (first * (last / first).powf(share)).atan()
}

/// Working memory, one a thread.
#[derive(Default)]
pub(super) struct Scratch {
    cut: LobeCut,
    glow: Vec<Vec3>,
}

/// The given part of a lobe.
struct Given {
    estimate: Estimate,
    alpha: Alpha,
    fresnel: Fresnel,
    fall: Fall,
}

/// How steps fall between their knots: as a lobe's density does.
pub(super) struct Fall {
    ndf: Ndf,
    alpha: Alpha,
    /// The lobe's density at the knots, over that at the first.
    densities: [f32; KNOTS],
}

impl Fall {
    pub(super) fn new(ndf: Ndf, alpha: f32) -> Self {
        let alpha = Alpha::saturating(alpha);
        let first = density(ndf, alpha, angle(0).sin().powi(2));
        Self {
            ndf,
            alpha,
            densities: std::array::from_fn(|k| density(ndf, alpha, angle(k).sin().powi(2)) / first),
        }
    }

    /// The last knot before a half angle, and how far the step has fallen from there to the next, in [0, 1];
    /// none beyond the last knot.
    pub(super) fn at(&self, sin2_h: f32) -> Option<(usize, f32)> {
        let tan2 = sin2_h / (1.0 - sin2_h).max(1e-6);
        let (first, last) = RANGE;
        let per_knot = (KNOTS - 1) as f32 / (last / first).ln();
        let place = (0.5 * tan2.max(1e-12).ln() - first.ln()) * per_knot;
        if place >= (KNOTS - 1) as f32 {
            return None;
        }
        if place <= 0.0 {
            return Some((0, 0.0));
        }
        let knot = place as usize;
        let (upper, lower) = (self.densities[knot], self.densities[knot + 1]);
        // Where the lobe is level to rounding, or zero, in the logarithm of the tangent.
        let share = if upper - lower > 1e-3 * upper && upper > 1e-20 {
            let first = density(self.ndf, self.alpha, angle(0).sin().powi(2));
            let here = density(self.ndf, self.alpha, sin2_h) / first;
            (upper - here) / (upper - lower)
        } else {
            place.fract()
        };
        Some((knot, share.clamp(0.0, 1.0)))
    }
}

fn density(ndf: Ndf, alpha: Alpha, sin2_h: f32) -> f32 {
    let wm = Vec3::new(sin2_h.sqrt(), 0.0, (1.0 - sin2_h).max(0.0).sqrt());
    ndf.density(Local(wm), alpha)
}

impl Given {
    fn new(estimate: &Estimate) -> Self {
        let fresnel = match (estimate.f90, estimate.eta) {
            (None, Some(eta)) => Fresnel::Dielectric { eta },
            (f90, _) => Fresnel::Schlick {
                f0: estimate.rho_s,
                f90: f90.unwrap_or(1.0),
            },
        };
        Self {
            estimate: *estimate,
            alpha: Alpha::saturating(estimate.alpha),
            fresnel,
            fall: Fall::new(estimate.ndf, estimate.alpha),
        }
    }

    fn reflectance(&self, cos_d: f32) -> Vec3 {
        let fresnel = self.fresnel.eval(cos_d);
        match self.fresnel {
            Fresnel::Dielectric { .. } => self.estimate.rho_s * fresnel,
            Fresnel::Schlick { .. } => fresnel,
        }
    }

    fn masking(&self, cos: f32) -> f32 {
        let cos = cos.max(1e-5);
        let w = Local(Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos));
        self.estimate.ndf.masking_over_cos(w, self.alpha)
    }
}

/// Light by knot: the prefix sums are the steps' columns.
struct ByKnot([Vec3; KNOTS]);

impl ByKnot {
    /// Adds light at a half angle.
    fn add_at(&mut self, fall: &Fall, sin2_h: f32, light: Vec3) {
        if let Some((knot, share)) = fall.at(sin2_h) {
            self.0[knot] += light * (1.0 - share);
            self.0[knot + 1] += light * share;
        }
    }

    /// Adds a node whose half vectors vary by `variance` per axis: at two places with the first two moments
    /// of its patch's `θ_h²`.
    fn add(&mut self, fall: &Fall, sin2_h: f32, variance: f32, light: Vec3) {
        if variance < NARROW * (sin2_h + RANGE.0 * RANGE.0) {
            self.add_at(fall, sin2_h, light);
        } else {
            let (distance, deviation) = ((sin2_h + variance).sqrt(), variance.sqrt());
            for place in [distance - deviation, (distance + deviation).min(1.0)] {
                self.add_at(fall, place * place, 0.5 * light);
            }
        }
    }

    fn steps(&self) -> [Vec3; STEPS] {
        let mut sum = Vec3::ZERO;
        std::array::from_fn(|k| {
            sum += self.0[k];
            sum
        })
    }
}

/// `[observations][steps]` of a point whose Fresnel term, masking and specular albedo are those of an
/// estimate, linear RGB for a density of one.
pub(super) fn columns(
    model: &ForwardModel<'_>,
    trace: &Trace,
    visibility: &Visibility,
    glow: Option<&Glow<'_>>,
    estimate: &Estimate,
    scratch: &mut Scratch,
) -> Vec<[Vec3; STEPS]> {
    let given = Given::new(estimate);
    scratch.cut.restart(0.0);
    let mut columns = Vec::with_capacity(trace.observations.len());
    for observations in trace.observations.chunk_by(|a, b| a.frame == b.frame) {
        scratch.glow.clear();
        if let Some(glow) = glow {
            glow.radiance(
                &[observations[0].frame as usize],
                visibility,
                &mut scratch.glow,
            );
        }
        for observation in observations {
            columns.push(of_observation(
                model,
                observation,
                visibility,
                &given,
                scratch,
            ));
        }
    }
    columns
}

fn of_observation(
    model: &ForwardModel<'_>,
    observation: &Observation,
    visibility: &Visibility,
    given: &Given,
    scratch: &mut Scratch,
) -> [Vec3; STEPS] {
    // In the world frame, where the light stands still.
    let rotation = &model.world_from_object[observation.frame as usize];
    let (normal, wo) = (*rotation * observation.normal, *rotation * observation.wo);
    let side = *rotation * observation.geometric_normal;
    let lobe = Lobe {
        wo,
        normal,
        smallest_alpha: 0.5 * roughness(0),
    };
    let mut by_knot = ByKnot([Vec3::ZERO; KNOTS]);
    let weight = |cos_d: f32, cos_i: f32| given.reflectance(cos_d) * (given.masking(cos_i) * cos_i);

    // The light.
    let Scratch { cut, glow } = scratch;
    cut.visit(&model.light.whole, model.light_nodes, &lobe, |seen| {
        let node = seen.node;
        if node.direction.dot(side) <= 0.0 {
            return;
        }
        let open = visibility.open(to_object(rotation, node.direction), node.spread);
        if open > 0.0 {
            let light = node.flux * open * weight(seen.cos_d, seen.cos_i);
            let variance = seen.variance_h + observation.normal_variance;
            by_knot.add(&given.fall, seen.sin2_h, variance, light);
        }
    });

    // The object's own light.
    for (patch, radiance) in visibility.blocked().iter().zip(glow) {
        let wi = *rotation * patch.direction;
        let cos_i = wi.dot(normal);
        if *radiance == Vec3::ZERO || cos_i <= 0.0 || wi.dot(side) <= 0.0 {
            continue;
        }
        let half = wi + wo;
        let length2 = half.length_squared().max(1e-12);
        let sin2_h = half.cross(normal).length_squared() / length2;
        let light = *radiance * patch.solid_angle * weight((0.5 * length2.sqrt()).min(1.0), cos_i);
        let variance = patch.solid_angle / 6.0 * (0.0625 + 0.25 / length2);
        by_knot.add(
            &given.fall,
            sin2_h,
            variance + observation.normal_variance,
            light,
        );
    }
    let masking = 0.25 * given.masking(normal.dot(wo));
    by_knot.steps().map(|step| step * masking)
}
