//! The weighted squared residual as a function of roughness, the albedos following.
//!
//! A saturated channel is a bound: the surface was at least as bright as the level. It counts as an
//! observation at the level, with its noise, where the model is darker, and as nothing where the model
//! is brighter:
//!
//! ```text
//! min over x ≥ 0 of  Σ_i r_iᵀ P_i r_i,   r_ic = max(0, level − J_ic x) where channel c of i is saturated
//! ```
//!
//! At one roughness that is convex and piecewise quadratic, so Newton's method on the set of active
//! bounds ends at its minimum (Qi and Sun 1993).

use glam::{BVec3, DMat3, DVec3};

use super::least_squares::{Normal, UNKNOWNS};
use super::normal_table::{LobeAlone, NormalTable, Samples};
use super::problem::{ActiveBounds, Model, Problem, Solution};

/// Steps of Newton's method on the active bounds. The set settles in two to four; the count only
/// guards against cycling in the last bits.
const BOUND_STEPS: usize = 40;

/// Pull towards the last step's albedos, as a share of what all bounds together would say of them: far
/// below any information that counts, far above rounding.
const STEADY: f64 = 1e-8;

/// The weighted squared residual over alpha, the albedos following.
pub(super) struct Objective<'p, 'a> {
    pub(super) problem: &'p Problem<'a>,
    pub(super) model: Model,
    /// `[observations]`.
    pub(super) weights: Vec<f64>,
    /// All sums of the observations without a saturated channel.
    table: NormalTable,
    /// The same with the diffuse albedos eliminated, where no bound can be active.
    alone: Option<LobeAlone>,
}

impl<'p, 'a> Objective<'p, 'a> {
    pub(super) fn new(problem: &'p Problem<'a>, model: Model, weights: Vec<f64>) -> Self {
        let mut whole = problem.precisions.clone();
        problem
            .saturated
            .iter()
            .for_each(|&i| whole[i].0 = DMat3::ZERO);
        let table = table(problem, model, &weights, &whole);
        let unbounded = problem.saturated.is_empty();
        Self {
            problem,
            model,
            weights,
            alone: unbounded.then(|| table.lobe_alone([true; 3])),
            table,
        }
    }

    /// All sums with given bounds taken as observations.
    pub(super) fn table_with(&self, active: &ActiveBounds) -> NormalTable {
        if self.problem.saturated.is_empty() {
            return self.table.clone();
        }
        let precisions = self.problem.precisions(active);
        table(self.problem, self.model, &self.weights, &precisions)
    }

    /// The best albedos at one roughness.
    pub(super) fn solve(&self, ln_alpha: f64) -> Solution {
        let Some(alone) = &self.alone else {
            return self.solve_bounded(self.table.at(ln_alpha), ln_alpha);
        };
        // Mostly no diffuse albedo is at zero, and the lobe's few are all that is to be found.
        let (lobe, value) = alone.lobe.at(ln_alpha).solve();
        let m = self.model.form.size();
        let rho_d = self.table.diffuse_beside(alone, ln_alpha, &lobe[..m]);
        let (x, value) = if rho_d.min_element() >= 0.0 {
            let mut x = [0.0; UNKNOWNS];
            x[..3].copy_from_slice(&rho_d.to_array());
            x[3..3 + m].copy_from_slice(&lobe[..m]);
            (x, value)
        } else {
            self.table.at(ln_alpha).solve()
        };
        Solution::new(&x, value, ActiveBounds::new())
    }

    pub(super) fn value(&self, ln_alpha: f64) -> f64 {
        self.solve(ln_alpha).value
    }

    /// Newton's method on the set of active bounds, given the sums of all observations without any.
    fn solve_bounded(&self, whole: Normal, ln_alpha: f64) -> Solution {
        let problem = self.problem;
        let m = self.model.form.size();
        let saturated = problem.saturated.iter().copied();
        let (columns, ndf) = (problem.columns, self.model.ndf);
        let lobe = self
            .model
            .form
            .jacobian_of(saturated, columns, ndf, ln_alpha as f32);
        let with = |active: &ActiveBounds| {
            let mut normal = whole;
            for (place, active) in active.iter().enumerate() {
                let i = problem.saturated[place];
                let mut jacobian = [DVec3::ZERO; UNKNOWNS];
                for (c, axis) in DVec3::AXES.into_iter().enumerate() {
                    jacobian[c] = axis * problem.diffuse(i)[c];
                }
                jacobian[3..3 + m].copy_from_slice(&lobe[place * m..][..m]);
                let precision = problem.bounded(place, *active).0 * self.weights[i];
                normal.add(&precision, &jacobian[..3 + m], problem.observed(i));
            }
            normal
        };
        let darker = |x: &[f64; UNKNOWNS]| -> ActiveBounds {
            let solution = Solution::new(x, 0.0, ActiveBounds::new());
            problem
                .saturated
                .iter()
                .zip(lobe.chunks_exact(m))
                .map(|(&i, lobe)| {
                    let predicted = problem.predicted(i, lobe, &solution);
                    let below = predicted.cmplt(problem.observed(i));
                    let saturated = problem.trace.observations[i].saturated;
                    BVec3::new(
                        saturated.x && below.x,
                        saturated.y && below.y,
                        saturated.z && below.z,
                    )
                })
                .collect()
        };

        // From the albedos without bounds, with the bounds that those break.
        let (mut x, _) = whole.solve();
        let mut active = darker(&x);
        let mut normal = with(&active);
        let mut value = normal.objective(&x);
        let all = with(&vec![BVec3::TRUE; problem.saturated.len()]);
        for _ in 0..BOUND_STEPS {
            // An albedo on which no active bound bears stays where it is.
            let mut steadied = normal;
            for (k, value) in x.iter().enumerate().take(3 + m) {
                let hold = STEADY * all.a[k][k];
                steadied.a[k][k] += hold;
                steadied.b[k] += hold * value;
            }
            let (target, _) = steadied.solve();
            // The whole step, or as much of it as makes things better.
            let mut share = 1.0;
            let mut moved = false;
            while share > 1e-3 {
                let next = std::array::from_fn(|k| x[k] + share * (target[k] - x[k]));
                let bounds = darker(&next);
                let quadratic = with(&bounds);
                let reached = quadratic.objective(&next);
                let settled = bounds == active && share == 1.0;
                if reached < value || settled {
                    (x, active, normal, value) = (next, bounds, quadratic, reached.min(value));
                    moved = !settled;
                    break;
                }
                share *= 0.5;
            }
            if !moved {
                break;
            }
        }
        Solution::new(&x, value, active)
    }
}

/// All of a point's sums, `[observations]` precisions times weights.
fn table(
    problem: &Problem<'_>,
    model: Model,
    weights: &[f64],
    precisions: &[(DMat3, u32)],
) -> NormalTable {
    let count = 0..weights.len();
    let weighted = precisions.iter().zip(weights).map(|((p, _), w)| *p * *w);
    let samples = Samples::new(
        count.clone().map(|i| problem.observed(i)),
        count.map(|i| problem.diffuse(i)),
        weighted,
    );
    NormalTable::new(problem.columns, model.ndf, model.form, &samples)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::Ndf;
    use crate::estimate::lobe_form::LobeForm;
    use crate::estimate::noise::NoiseModel;
    use crate::estimate::turntable::{Material, TURNTABLES};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// At the solution the gradient of the one-sided objective vanishes for what is free, and
        /// points outwards for what is at zero.
        #[test]
        fn bounded_albedos_meet_the_conditions_of_karush_kuhn_and_tucker(
            index in 0u32..200, level in 0.05f64..0.9, ln_alpha in -4.0f64..-0.2, coloured in any::<bool>(),
        ) {
            let turntable = &TURNTABLES[0];
            let material = Material::plastic(Ndf::Ggx, 0.1);
            let mut point = turntable.point(index, &material, 0.01);
            point.saturate_above(level);
            let noise = NoiseModel::independent(true);
            let problem = Problem::new(&point.trace, &point.columns, &noise);
            prop_assume!(problem.samples() > 0);
            let form = if coloured { LobeForm::Rgb } else { LobeForm::Neutral };
            let model = Model { ndf: Ndf::Ggx, form, eta: Some(1.3) };
            let weights = vec![1.0; point.trace.observations.len()];
            let objective = Objective::new(&problem, model, weights);
            let solution = objective.solve(ln_alpha);

            let m = form.size();
            let lobe = form.jacobian(&point.columns, model.ndf, ln_alpha as f32);
            let mut gradient = [0.0; UNKNOWNS];
            let mut size = [0.0; UNKNOWNS];
            for (i, observation) in point.trace.observations.iter().enumerate() {
                let predicted = problem.predicted(i, &lobe[i * m..][..m], &solution);
                let deviation = crate::estimate::noise::deviation(observation);
                for c in 0..3 {
                    let mut r = f64::from(observation.radiance[c]) - predicted[c];
                    if observation.saturated.test(c) {
                        r = r.max(0.0);
                    }
                    let p = 1.0 / f64::from(deviation[c]).powi(2);
                    let mut add = |k: usize, derivative: f64| {
                        gradient[k] -= 2.0 * p * r * derivative;
                        size[k] += 2.0 * p * (f64::from(observation.radiance[c]) * derivative).abs();
                    };
                    add(c, problem.diffuse(i)[c]);
                    for j in 0..m {
                        add(3 + j, lobe[i * m + j][c]);
                    }
                }
            }
            let x = [&solution.rho_d.to_array()[..], &solution.lobe].concat();
            for k in 0..3 + m {
                prop_assert!(x[k] >= 0.0);
                prop_assert!(gradient[k] >= -1e-6 * size[k], "{k}: {} of {}", gradient[k], size[k]);
                prop_assert!(x[k] == 0.0 || gradient[k].abs() <= 1e-6 * size[k], "{k}: {} of {}", gradient[k], size[k]);
            }
        }
    }
}
