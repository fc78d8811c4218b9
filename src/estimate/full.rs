//! The default estimator: variable projection over alpha, every model that is allowed, and error bars.

use glam::{DVec3, Vec3};

use super::appearance::is_precise;
use super::columns::Columns;
use super::least_squares::{Normal, inverse_diagonal};
use super::lobe_form::LobeForm;
use super::noise::{NoiseModel, deviation};
use super::normal_table::NormalTable;
use super::objective::Objective;
use super::problem::{ActiveBounds, Model, Problem, Solution};
use super::search::Landscape;
use super::uncertainty::{Deviations, verdict};
use super::{Estimate, FitSettings, Reason, Status};
use crate::brdf::{Appearance, Ndf};
use crate::traces::Trace;

/// Rounds of weights by the residuals' tails.
const ROUNDS: usize = 4;

/// Minima whose objectives differ by more than this are no rivals: a likelihood ratio of e^-15.
const FARTHEST_RIVAL: f64 = 30.0;

/// The best estimate under one model.
pub(super) struct Candidate {
    pub(super) model: Model,
    pub(super) estimate: Estimate,
    /// Logarithm of the residuals' likelihood, up to a constant that the models share.
    pub(super) ln_likelihood: f64,
    /// Half the logarithm of the number of samples, by which each unknown must improve it.
    pub(super) penalty: f64,
    /// All sums at the minimum's weights, over its scale; none without data.
    pub(super) table: Option<NormalTable>,
}

/// Fits one point, given its columns: one candidate a model, or a single one without data.
pub(super) fn estimate(
    trace: &Trace,
    columns: &Columns,
    models: &[Model],
    noise: &NoiseModel,
) -> Vec<Candidate> {
    let frames = trace.frames();
    let without = |status, reason| {
        vec![Candidate {
            model: models[0],
            estimate: Estimate {
                reason,
                eta: models[0].eta,
                ..Estimate::without_data(status, frames)
            },
            ln_likelihood: 0.0,
            penalty: 0.0,
            table: None,
        }]
    };
    if frames == 0 {
        return without(Status::Unseen, Reason::TooFewFrames);
    }
    let problem = Problem::new(trace, columns, noise);
    let samples = problem.samples();
    if samples == 0 {
        return without(Status::Saturated, Reason::None);
    }
    let most = models.iter().map(|model| model.unknowns()).max();
    if samples <= most.unwrap_or(0) {
        return without(Status::TooFewSamples, Reason::TooFewFrames);
    }

    let minima: Vec<Minimum> = models.iter().map(|&m| minimise(&problem, m)).collect();
    let scale = minima.iter().map(|m| m.scale).fold(f64::INFINITY, f64::min);
    minima
        .iter()
        .map(|minimum| {
            let (estimate, table) = minimum.conclude();
            Candidate {
                model: minimum.objective.model,
                estimate,
                ln_likelihood: minimum.ln_likelihood(scale),
                penalty: 0.5 * (samples as f64).ln(),
                table: Some(table),
            }
        })
        .collect()
}

impl FitSettings {
    /// The models that a point may have.
    pub(super) fn models(&self) -> Vec<Model> {
        let forms = LobeForm::allowed(self);
        let models = Ndf::ALL
            .into_iter()
            .filter(|&ndf| self.ndf.is_none_or(|n| n == ndf))
            .flat_map(|ndf| forms.iter().map(move |&form| (ndf, form)))
            .map(|(ndf, form)| Model {
                ndf,
                form,
                eta: form.eta(self.fresnel),
            });
        models.collect()
    }
}

/// Residuals of an estimate in assumed standard deviations, of observations with all channels.
///
/// They are stretched by what the parameters take up of them.
pub(super) fn residuals(trace: &Trace, columns: &Columns, candidate: &Candidate) -> Vec<Vec3> {
    let estimate = &candidate.estimate;
    let observations = trace.observations.len();
    let unknowns = candidate.model.unknowns() as f32;
    let samples = 3.0 * observations as f32;
    if !estimate.sigma_rho_d.is_finite() || samples < 3.0 * unknowns {
        return Vec::new();
    }
    let stretch = (samples / (samples - unknowns)).sqrt();
    let form = candidate.model.form;
    let jacobian = form.jacobian(columns, estimate.ndf, estimate.alpha.ln());
    let lobe = form.parameters(estimate.rho_s, estimate.f90);
    let mut residuals = Vec::with_capacity(observations);
    for (i, observation) in trace.observations.iter().enumerate() {
        let specular: DVec3 = jacobian[i * form.size()..]
            .iter()
            .zip(&lobe[..form.size()])
            .map(|(j, v)| *j * *v)
            .sum();
        let predicted = estimate.rho_d * columns.diffuse[i] + specular.as_vec3();
        let residual = (observation.radiance - predicted) / deviation(observation) * stretch;
        let whole = observation.variance.is_finite() && !observation.saturated.any();
        if whole && residual.is_finite() {
            residuals.push(residual);
        }
    }
    residuals
}

/// The diffuse albedo beside a lobe that is given, where the data determine it.
pub(super) fn diffuse_beside(
    trace: &Trace,
    columns: &Columns,
    noise: &NoiseModel,
    look: &Appearance,
    form: LobeForm,
) -> Option<Vec3> {
    let (ndf, ln_alpha) = (look.ndf(), look.alpha.ln());
    let parameters = form.parameters(look.rho_s, Some(look.f90));
    let problem = Problem::new(trace, columns, noise);
    let none = ActiveBounds::new();
    let precisions = problem.precisions(&none);
    let mut weights = vec![1.0; precisions.len()];
    let mut known = None;
    let model = Model {
        ndf,
        form,
        eta: None,
    };
    let m = form.size();
    for _ in 0..ROUNDS {
        let mut normal = Normal {
            size: 3,
            ..Normal::default()
        };
        let lobe = form.jacobian(columns, ndf, ln_alpha);
        for (i, (p, _)) in precisions.iter().enumerate() {
            let specular: DVec3 = (0..m).map(|j| lobe[m * i + j] * parameters[j]).sum();
            let rest = problem.observed(i) - specular;
            normal.add_diffuse(&(*p * weights[i]), problem.diffuse(i), rest);
        }
        if normal.yy == 0.0 {
            return None;
        }
        let (x, _) = normal.solve();
        let rho_d = DVec3::new(x[0], x[1], x[2]);
        let solution = Solution {
            rho_d,
            lobe: parameters,
            ..Solution::default()
        };
        let squares = problem.squares(model, f64::from(ln_alpha), &solution);
        let scale;
        (weights, scale) = problem.reweigh(&squares, &weights, 3);
        let information = (0..3).map(|c| normal.a[c][..3].to_vec()).collect();
        let variances = inverse_diagonal(information);
        let sigma = Vec3::from([0, 1, 2].map(|c| (scale * variances[c]).sqrt() as f32));
        let rho_d = rho_d.as_vec3();
        known = is_precise(rho_d, sigma).then_some(rho_d);
    }
    known
}

/// The best parameters under one model.
pub(super) struct Minimum<'p, 'a> {
    /// With the weights that the minimum was found by.
    pub(super) objective: Objective<'p, 'a>,
    pub(super) ln_alpha: f64,
    pub(super) solution: Solution,
    /// `[ROUGHNESSES]` (ln alpha, value) over the grid.
    pub(super) grid: Vec<(f64, f64)>,
    /// `[observations]` squared distances of the residuals, and channels.
    squares: Vec<(f64, u32)>,
    /// Scale of the squared distances.
    scale: f64,
    /// The second-best minimum: `ln alpha`, and its ln likelihood less the best one's.
    second: Option<(f64, f64)>,
}

/// The smallest residual over alpha under one model, weights and scale in step with it.
fn minimise<'p, 'a>(problem: &'p Problem<'a>, model: Model) -> Minimum<'p, 'a> {
    let mut weights = vec![1.0; problem.trace.observations.len()];
    let rounds = if problem.noise.is_normal() { 0 } else { ROUNDS };
    let mut place = None;
    for _ in 0..rounds {
        let objective = Objective::new(problem, model, weights);
        let value = |x| objective.value(x);
        // Weights move a minimum a little; whether another is better by now, the last survey will tell.
        let (ln_alpha, _) = match place {
            None => Landscape::survey(value).minima[0],
            Some(last) => Landscape::near(last, value),
        };
        place = Some(ln_alpha);
        let solution = objective.solve(ln_alpha);
        let squares = problem.squares(model, ln_alpha, &solution);
        (weights, _) = problem.reweigh(&squares, &objective.weights, model.unknowns());
    }
    let objective = Objective::new(problem, model, weights);
    let landscape = Landscape::survey(|x| objective.value(x));
    let mut minimum = Minimum::at(objective, landscape.minima[0].0, landscape.grid);
    if let Some(rival) = landscape.minima.get(1)
        && (rival.1 - minimum.solution.value) / minimum.scale < FARTHEST_RIVAL
    {
        let rival = minimum.rival(rival.0);
        let evidence = minimum.ln_likelihood_of(&rival.squares, minimum.scale)
            - minimum.ln_likelihood(minimum.scale);
        // By weights of its own the rival may be the better one.
        let loser = if evidence > 0.0 {
            std::mem::replace(&mut minimum, rival)
        } else {
            rival
        };
        minimum.second = Some((loser.ln_alpha, -evidence.abs()));
    }
    minimum
}

impl<'p, 'a> Minimum<'p, 'a> {
    /// Of an objective at a given roughness.
    fn at(objective: Objective<'p, 'a>, ln_alpha: f64, grid: Vec<(f64, f64)>) -> Self {
        let Objective { problem, model, .. } = objective;
        let solution = objective.solve(ln_alpha);
        let squares = problem.squares(model, ln_alpha, &solution);
        let (_, scale) = problem.reweigh(&squares, &objective.weights, model.unknowns());
        Self {
            objective,
            ln_alpha,
            solution,
            grid,
            squares,
            scale,
            second: None,
        }
    }

    /// A second minimum, under weights of its own.
    fn rival(&self, mut ln_alpha: f64) -> Self {
        let (problem, model) = (self.objective.problem, self.objective.model);
        let rounds = if problem.noise.is_normal() { 0 } else { ROUNDS };
        let mut weights = self.objective.weights.clone();
        for _ in 0..rounds {
            let objective = Objective::new(problem, model, weights);
            (ln_alpha, _) = Landscape::near(ln_alpha, |x| objective.value(x));
            let squares = problem.squares(model, ln_alpha, &objective.solve(ln_alpha));
            (weights, _) = problem.reweigh(&squares, &objective.weights, model.unknowns());
        }
        let objective = Objective::new(problem, model, weights);
        (ln_alpha, _) = Landscape::near(ln_alpha, |x| objective.value(x));
        let grid = Landscape::survey(|x| objective.value(x)).grid;
        Self::at(objective, ln_alpha, grid)
    }

    /// Of Student's t at a scale that the models share.
    fn ln_likelihood(&self, scale: f64) -> f64 {
        self.ln_likelihood_of(&self.squares, scale)
    }

    fn ln_likelihood_of(&self, squares: &[(f64, u32)], scale: f64) -> f64 {
        let noise = self.objective.problem.noise;
        let terms = squares.iter().map(|(q, k)| noise.deviance(q / scale, *k));
        -0.5 * terms.sum::<f64>()
    }

    /// Estimate, error bars and verdict; and the sums at its weights, over the scale.
    fn conclude(&self) -> (Estimate, NormalTable) {
        let model = self.objective.model;
        let problem = self.objective.problem;
        let spread = self.scale * problem.noise.spread();
        let table = self.objective.table_with(&self.solution.active);
        let deviations = Deviations::of(self, &table, spread);
        let (status, reason) = verdict(self, &table, &deviations, spread);
        let alpha = self.ln_alpha.exp() as f32;
        let (second_alpha, second_evidence) = self.second.unwrap_or((f64::NAN, f64::NAN));
        let mut estimate = Estimate {
            rho_d: self.solution.rho_d.as_vec3(),
            alpha,
            sigma_rho_d: deviations.rho_d,
            sigma_rho_s: deviations.lobe[..model.form.albedos()]
                .iter()
                .copied()
                .fold(0.0, f64::max) as f32,
            sigma_alpha: alpha * deviations.ln_alpha as f32,
            frames: problem.trace.frames(),
            residual: self.relative_residual(),
            misfit: self.scale.sqrt() as f32,
            status,
            reason,
            second_alpha: second_alpha.exp() as f32,
            second_evidence: second_evidence as f32,
            ..Estimate::without_data(status, 0)
        };
        model.put(&self.solution.lobe, &mut estimate);
        (estimate, table.scaled(1.0 / spread))
    }

    /// Root-mean-square residual over the root-mean-square observation, channels in use.
    fn relative_residual(&self) -> f32 {
        let Objective { problem, model, .. } = &self.objective;
        let m = model.form.size();
        let lobe = model
            .form
            .jacobian(problem.columns, model.ndf, self.ln_alpha as f32);
        let (mut squares, mut total) = (0.0, 0.0);
        let precisions = problem.precisions(&self.solution.active);
        for (i, (p, _)) in precisions.iter().enumerate() {
            let observed = problem.observed(i);
            let predicted = problem.predicted(i, &lobe[i * m..][..m], &self.solution);
            for c in 0..3 {
                if p.col(c)[c] > 0.0 {
                    squares += (observed[c] - predicted[c]).powi(2);
                    total += observed[c].powi(2);
                }
            }
        }
        if total > 0.0 {
            (squares / total).sqrt() as f32
        } else {
            0.0
        }
    }
}
