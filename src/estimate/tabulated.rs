//! An NDF without a formula: any density over the half angle that never rises.
//!
//! As Dong et al. (2014, *Appearance-from-Motion*) have it, but for known light and with error bars. After
//! the parametric fit, whose lobe gives Fresnel's term, masking and the specular albedo, the density is a sum
//! of non-negative steps (see [`super::half_angle`]), by least squares over all points that share it:
//!
//! ```text
//! min over c ≥ 0, rho_d,i of  Σ_i Σ_t ‖T_i(t) − rho_d,i T_d,i(t) − Σ_k c_k T_k,i(t)‖² / σ²
//! ```
//!
//! Each point's diffuse albedos are eliminated, so that points add up.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::columns::Columns;
use super::forward_model::{ForwardModel, Scratch};
use super::half_angle::{self, Fall, KNOTS, STEPS, angle};
use super::interreflection::Glow;
use super::noise::NoiseModel;
use super::non_negative;
use super::problem::{ActiveBounds, Model, Problem, Solution};
use super::visibility::Visibility;
use super::{Estimate, Pooling, Status};
use crate::brdf::Ndf;
use crate::traces::{Trace, TraceSet};

/// Points that are summed one after the other: no result depends on the number of threads.
const PIECE: usize = 256;

/// Densities over the half angle, one a group of points that share a lobe.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TabulatedNdf {
    /// `[K]` half angles, radians. Between them the density falls as the parametric lobe does, shifted and
    /// scaled; within the first it is level, beyond the last zero.
    pub theta: Vec<f32>,
    /// `[M]` every group.
    pub groups: Vec<TabulatedGroup>,
    /// `[N]` group of every point, none without a lobe.
    pub group: Vec<Option<u32>>,
}

/// The density that a group of points shares.
#[derive(Clone, Debug, PartialEq)]
pub struct TabulatedGroup {
    /// `[K]` `D(θ_h)`, per steradian, beside the specular albedo of the parametric lobe.
    pub density: Vec<f32>,
    /// `[K]` standard deviation; infinite where no light tells.
    pub sigma: Vec<f32>,
    /// `∫ D cos θ dω`: 1 if the parametric lobe's normalisation is right.
    pub integral: f32,
    /// Roughness of the parametric lobe.
    pub alpha: f32,
    /// NDF of the parametric lobe.
    pub ndf: Ndf,
    /// Points that share it.
    pub points: u32,
}

/// What the fit knows when densities are tabulated.
pub(super) struct Known<'a> {
    pub(super) traces: &'a TraceSet,
    pub(super) visibilities: &'a [Visibility],
    pub(super) model: &'a ForwardModel<'a>,
    pub(super) glow: Option<&'a Glow<'a>>,
    pub(super) noise: &'a NoiseModel,
    pub(super) models: &'a [Model],
    pub(super) estimates: &'a [Estimate],
}

/// Tabulates the densities of all groups.
pub(super) fn tabulate(known: &Known<'_>, pooling: Pooling) -> TabulatedNdf {
    let shared = matches!(pooling, Pooling::Object | Pooling::Material);
    let group_of = |index: usize| {
        let estimate = &known.estimates[index];
        let fitted = matches!(estimate.status, Status::Converged | Status::AlphaAtBound);
        let number = if shared {
            estimate.material? as usize
        } else {
            index
        };
        fitted.then_some(number)
    };
    let pieces: Vec<Vec<(usize, Summed)>> = (0..known.estimates.len().div_ceil(PIECE))
        .into_par_iter()
        .map(|piece| {
            let (mut scratch, mut columns) = Default::default();
            let mut groups: BTreeMap<usize, Summed> = BTreeMap::new();
            let end = ((piece + 1) * PIECE).min(known.estimates.len());
            for index in piece * PIECE..end {
                let Some(group) = group_of(index) else {
                    continue;
                };
                let system = system(known, index, &mut scratch, &mut columns);
                let sum = groups
                    .entry(group)
                    .or_insert_with(|| Summed::new(&known.estimates[index]));
                sum.system.add(&system);
                sum.points += 1;
            }
            if !shared {
                groups.values_mut().for_each(Summed::solve);
            }
            groups.into_iter().collect()
        })
        .collect();
    let mut groups: BTreeMap<usize, Summed> = BTreeMap::new();
    for (number, sum) in pieces.into_iter().flatten() {
        match groups.entry(number) {
            std::collections::btree_map::Entry::Vacant(entry) => {
                entry.insert(sum);
            }
            std::collections::btree_map::Entry::Occupied(mut entry) => {
                entry.get_mut().system.add(&sum.system);
                entry.get_mut().points += sum.points;
            }
        }
    }
    let numbers: Vec<usize> = groups.keys().copied().collect();
    let place = |index| numbers.binary_search(&group_of(index)?).ok();
    let group = (0..known.estimates.len())
        .map(|index| place(index).map(|m| m as u32))
        .collect();
    let groups = groups.into_values().map(|mut sum| {
        if sum.found.is_none() {
            sum.solve();
        }
        sum.finished()
    });
    TabulatedNdf {
        theta: (0..KNOTS).map(angle).collect(),
        groups: groups.collect(),
        group,
    }
}

/// A group while it is summed.
struct Summed {
    system: System,
    lobe: Estimate,
    points: u32,
    found: Option<Density>,
}

impl Summed {
    fn new(lobe: &Estimate) -> Self {
        Self {
            system: System::default(),
            lobe: *lobe,
            points: 0,
            found: None,
        }
    }

    /// Solves, and forgets the sums.
    fn solve(&mut self) {
        self.found = Some(self.system.solve());
        self.system = System::default();
    }

    fn finished(self) -> TabulatedGroup {
        let Density { density, sigma } = self.found.unwrap_or_default();
        TabulatedGroup {
            integral: integral(&density, &Fall::new(self.lobe.ndf, self.lobe.alpha)) as f32,
            density: density.iter().map(|v| *v as f32).collect(),
            sigma: sigma.iter().map(|v| *v as f32).collect(),
            alpha: self.lobe.alpha,
            ndf: self.lobe.ndf,
            points: self.points,
        }
    }
}

/// `[K]` a density and its standard deviation.
#[derive(Clone, Debug, Default)]
pub(super) struct Density {
    pub(super) density: Vec<f64>,
    pub(super) sigma: Vec<f64>,
}

/// Normal equations of the steps, over the noise.
#[derive(Clone, Debug, Default)]
pub(super) struct System {
    /// `[steps][steps]`; empty: of nothing.
    a: Vec<f64>,
    /// `[steps]`.
    b: Vec<f64>,
}

impl System {
    /// Takes another in.
    pub(super) fn add(&mut self, other: &Self) {
        self.a.resize(STEPS * STEPS, 0.0);
        self.b.resize(STEPS, 0.0);
        for (to, from) in [(&mut self.a, &other.a), (&mut self.b, &other.b)] {
            to.iter_mut().zip(from).for_each(|(t, f)| *t += f);
        }
    }

    /// A point's, its diffuse albedos following where they are above zero: steps' columns and weights by
    /// observation.
    pub(super) fn of_point(
        problem: &Problem<'_>,
        steps: &[[glam::Vec3; STEPS]],
        weights: &[f64],
        is_diffuse: [bool; 3],
    ) -> Self {
        let (mut a, mut b) = (vec![0.0; STEPS * STEPS], vec![0.0; STEPS]);
        let mut cross = vec![DVec3::ZERO; STEPS];
        let (mut diffuse, mut own) = (DMat3::ZERO, DVec3::ZERO);
        for (i, ((p, _), steps)) in problem.precisions.iter().zip(steps).enumerate() {
            let p = *p * weights[i];
            let (y, d) = (
                problem.observed(i),
                DMat3::from_diagonal(problem.diffuse(i)),
            );
            diffuse += d * p * d;
            own += d * (p * y);
            for (k, column) in steps.iter().enumerate() {
                let weighted = p * column.as_dvec3();
                b[k] += weighted.dot(y);
                cross[k] += d * weighted;
                for (l, other) in steps[..=k].iter().enumerate() {
                    a[k * STEPS + l] += weighted.dot(other.as_dvec3());
                }
            }
        }
        let inverse = inverse_of(&diffuse, is_diffuse);
        let follows = inverse * own;
        for k in 0..STEPS {
            let beside = inverse * cross[k];
            b[k] -= cross[k].dot(follows);
            for l in 0..=k {
                a[k * STEPS + l] -= beside.dot(cross[l]);
                a[l * STEPS + k] = a[k * STEPS + l];
            }
        }
        Self { a, b }
    }

    /// The density of least squares that never rises.
    pub(super) fn solve(&self) -> Density {
        if self.b.is_empty() {
            return Density::default();
        }
        let c = non_negative::solve(&self.a, &self.b);
        let mut density = vec![0.0; KNOTS];
        for k in (0..STEPS).rev() {
            density[k] = density[k + 1] + c[k];
        }
        let sigma = (0..KNOTS).map(|knot| {
            // The steps that are in use, and the one that ends here; what no light tells is not known.
            let used: Vec<usize> = (0..STEPS).filter(|&k| c[k] > 0.0 || k == knot).collect();
            let above = |k: usize| if k >= knot { 1.0 } else { 0.0 };
            let told = (knot..STEPS).any(|k| self.a[k * STEPS + k] > 0.0);
            let variance = non_negative::variance(&self.a, STEPS, &used, above);
            variance.filter(|_| told).map_or(f64::INFINITY, f64::sqrt)
        });
        let sigma = sigma.collect();
        Density { density, sigma }
    }
}

/// Inverse over the channels that are free, zero elsewhere.
fn inverse_of(matrix: &DMat3, free: [bool; 3]) -> DMat3 {
    let used = |c: usize| free[c] && matrix.col(c)[c] > 0.0;
    let mut kept = DMat3::IDENTITY;
    for c in (0..3).filter(|&c| used(c)) {
        for d in (0..3).filter(|&d| used(d)) {
            kept.col_mut(d)[c] = matrix.col(d)[c];
        }
    }
    let mut inverse = kept.inverse();
    for c in (0..3).filter(|&c| !used(c)) {
        inverse.col_mut(c)[c] = 0.0;
    }
    inverse
}

/// One point's normal equations, by Student's weights of the parametric lobe's residuals.
fn system(
    known: &Known<'_>,
    index: usize,
    (scratch, half_scratch): &mut (Scratch, half_angle::Scratch),
    columns: &mut Columns,
) -> System {
    let (trace, estimate): (&Trace, &Estimate) =
        (&known.traces.traces[index], &known.estimates[index]);
    let visibility = &known.visibilities[index];
    known
        .model
        .columns(trace, visibility, known.glow, scratch, columns);
    let steps = half_angle::columns(
        known.model,
        trace,
        visibility,
        known.glow,
        estimate,
        half_scratch,
    );
    let problem = Problem::new(trace, columns, known.noise);
    let even = vec![1.0; trace.observations.len()];
    let same = |model: &&Model| model.ndf == estimate.ndf && model.eta == estimate.eta;
    let weights = match known.models.iter().find(same) {
        Some(model) if !known.noise.is_normal() => {
            let model = Model {
                form: model.form.coloured(),
                ..*model
            };
            let solution = Solution {
                rho_d: estimate.rho_d.as_dvec3(),
                lobe: model.form.parameters(estimate.rho_s, estimate.f90),
                active: ActiveBounds::new(),
                ..Solution::default()
            };
            let squares = problem.squares(model, f64::from(estimate.alpha.ln()), &solution);
            problem.reweigh(&squares, &even, model.unknowns()).0
        }
        _ => even,
    };
    let free = estimate.rho_d.cmpgt(glam::Vec3::ZERO);
    System::of_point(&problem, &steps, &weights, [free.x, free.y, free.z])
}

/// `∫ D cos θ dω`.
fn integral(density: &[f64], fall: &Fall) -> f64 {
    if density.len() < KNOTS {
        return 0.0;
    }
    const PLACES: usize = 4000;
    let at = |theta: f64| match fall.at(theta.sin().powi(2) as f32) {
        None => 0.0,
        Some((knot, share)) => {
            density[knot] + f64::from(share) * (density[knot + 1] - density[knot])
        }
    };
    // Even in the square root of the angle: narrow lobes are resolved.
    let half = std::f64::consts::FRAC_PI_2;
    let place = |i: usize| half * ((i as f64 + 0.5) / PLACES as f64).powi(2);
    let slope = |i: usize| 2.0 * half * (i as f64 + 0.5) / (PLACES as f64).powi(2);
    (0..PLACES)
        .map(|i| {
            let theta = place(i);
            std::f64::consts::TAU * at(theta) * theta.sin() * theta.cos() * slope(i)
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::Alpha;
    use crate::estimate::turntable::{Material, TURNTABLES};
    use crate::geometry::Local;

    fn true_density(ndf: Ndf, alpha: f32, theta: f32) -> f64 {
        let wm = Local(glam::Vec3::new(theta.sin(), 0.0, theta.cos()));
        f64::from(ndf.density(wm, Alpha::saturating(alpha)))
    }

    #[test]
    fn integral_of_a_known_density_is_one() {
        for (ndf, alpha) in [(Ndf::Beckmann, 0.3), (Ndf::Ggx, 0.1)] {
            let density: Vec<f64> = (0..KNOTS)
                .map(|k| true_density(ndf, alpha, angle(k)))
                .collect();
            let sum = integral(&density, &Fall::new(ndf, alpha));
            assert!((sum - 1.0).abs() < 0.01, "{ndf:?} {alpha}: {sum}");
        }
    }

    /// Plastic on all normals, 1 % noise; the density is taken for any that never rises.
    #[test]
    fn densities_are_measured_within_their_error_bars() {
        let noise = NoiseModel::independent(true);
        for (ndf, alpha) in [
            (Ndf::Ggx, 0.1),
            (Ndf::Beckmann, 0.2),
            (Ndf::Ggx, 0.2),
            (Ndf::Beckmann, 0.4),
        ] {
            let material = Material::plastic(ndf, alpha);
            let systems: Vec<System> = (0..400u32)
                .into_par_iter()
                .map(|i| {
                    let turntable = &TURNTABLES[i as usize % 4];
                    let point = turntable.point(i, &material, 0.01);
                    let steps = turntable.half_angle(&point.trace, &material);
                    let problem = Problem::new(&point.trace, &point.columns, &noise);
                    let even = vec![1.0; steps.len()];
                    System::of_point(&problem, &steps, &even, [true; 3])
                })
                .collect();
            let mut sum = System::default();
            systems.iter().for_each(|system| sum.add(system));
            let Density { density, sigma } = sum.solve();
            let peak = true_density(ndf, alpha, 0.0);
            let (mut told, mut worst) = (0, 0.0f64);
            for k in 0..KNOTS {
                let truth = true_density(ndf, alpha, angle(k));
                let error = density[k] - truth;
                println!(
                    "{ndf:?} {alpha} {:6.2}°: {:9.4} ± {:8.4}, truth {truth:9.4}",
                    angle(k).to_degrees(),
                    density[k],
                    sigma[k]
                );
                // The forward models of data and fit differ: by a percent or two, and in steep tails by
                // some 1e-4 of the peak.
                if sigma[k] < 0.1 * truth && truth > 0.01 * peak {
                    told += 1;
                    worst = worst.max((error / truth).abs());
                    assert!(
                        error.abs() < 3.5 * sigma[k] + 0.02 * truth + 1e-3 * peak,
                        "{ndf:?} {alpha} at {k}: {} {truth}",
                        density[k]
                    );
                }
                assert!(k == 0 || density[k] <= density[k - 1]);
            }
            println!(
                "{ndf:?} {alpha}: {told} knots above 1 % of the peak told to 10 %, worst {worst:.3}, integral {:.3}",
                integral(&density, &Fall::new(ndf, alpha))
            );
            assert!(told >= 8, "{told}");
        }
    }
}
