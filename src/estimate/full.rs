//! The default estimator: variable projection over alpha, both NDFs, and error bars.

use glam::{DMat3, DVec3, Vec3};

use super::appearance::is_precise;
use super::columns::{Columns, ROUGHNESSES, roughness};
use super::fresnel_model::Basis;
use super::least_squares::{Normal, UNKNOWNS, inverse_diagonal};
use super::noise::{NU, NoiseModel, deviation};
use super::{Estimate, FitSettings, SpecularColour, Status};
use crate::brdf::Ndf;
use crate::traces::Trace;

/// A standard deviation of `ln alpha` above this says that the data do not determine alpha: the
/// 68 % interval then spans more than a factor of 2.7.
const LARGEST_SIGMA_LN_ALPHA: f64 = 0.5;

/// Rounds of weights by the residuals' tails.
const ROUNDS: usize = 4;

/// What is known of a point's scale of residuals before it is fitted, as a number of channels'
/// residuals of scale 1: it steadies points with few observations.
const PRIOR_RESIDUALS: f64 = 6.0;

/// The best estimate under one NDF.
pub(super) struct Candidate {
    pub(super) estimate: Estimate,
    /// Logarithm of the residuals' likelihood, up to a constant that the NDFs share.
    pub(super) ln_likelihood: f64,
}

/// Fits one point, given its columns: one candidate an NDF, or a single one without data.
pub(super) fn estimate(
    trace: &Trace,
    columns: &Columns,
    settings: &FitSettings,
    noise: &NoiseModel,
) -> Vec<Candidate> {
    let frames = trace.frames();
    let without = |status| {
        vec![Candidate {
            estimate: Estimate::without_data(status, frames),
            ln_likelihood: 0.0,
        }]
    };
    if frames == 0 {
        return without(Status::Unseen);
    }
    let problem = Problem::new(trace, columns, settings.specular, noise);
    let samples = problem.samples();
    if samples == 0 {
        return without(Status::Saturated);
    }
    if samples <= problem.unknowns() {
        return without(Status::TooFewSamples);
    }

    let minima: Vec<Minimum> = Ndf::ALL
        .into_iter()
        .filter(|&ndf| settings.ndf.is_none_or(|n| n == ndf))
        .map(|ndf| problem.minimise(ndf))
        .collect();
    let scale = minima.iter().map(|m| m.scale).fold(f64::INFINITY, f64::min);
    minima
        .iter()
        .map(|minimum| Candidate {
            estimate: problem.conclude(minimum),
            ln_likelihood: problem.ln_likelihood(minimum, scale),
        })
        .collect()
}

/// Residuals of an estimate in assumed standard deviations, of observations with all channels.
///
/// They are stretched by what the parameters take up of them.
pub(super) fn residuals(trace: &Trace, columns: &Columns, estimate: &Estimate) -> Vec<Vec3> {
    let observations = trace.observations.len();
    let unknowns = 5.0;
    let samples = 3.0 * observations as f32;
    if !estimate.sigma_rho_d.is_finite() || samples < 3.0 * unknowns {
        return Vec::new();
    }
    let stretch = (samples / (samples - unknowns)).sqrt();
    let mut residuals = Vec::with_capacity(observations);
    columns.specular(
        estimate.ndf as usize,
        Basis::Dielectric,
        estimate.alpha.ln(),
        |i, specular, _| {
            let observation = &trace.observations[i];
            let predicted = estimate.rho_d * columns.diffuse[i] + estimate.rho_s * specular;
            let residual = (observation.radiance - predicted) / deviation(observation) * stretch;
            if observation.variance.is_finite() && residual.is_finite() {
                residuals.push(residual);
            }
        },
    );
    residuals
}

/// The diffuse albedo beside a lobe that is given, where the data determine it.
pub(super) fn diffuse_beside(
    trace: &Trace,
    columns: &Columns,
    noise: &NoiseModel,
    (ndf, alpha, rho_s): (Ndf, f32, Vec3),
) -> Option<Vec3> {
    let problem = Problem::new(trace, columns, SpecularColour::Neutral, noise);
    let mut weights = vec![1.0; problem.precisions.len()];
    let mut known = None;
    for _ in 0..ROUNDS {
        let mut normal = Normal {
            size: 3,
            ..Normal::default()
        };
        problem.columns.specular(
            ndf as usize,
            Basis::Dielectric,
            alpha.ln(),
            |i, specular, _| {
                let rest = problem.observed(i) - (rho_s * specular).as_dvec3();
                normal.add_diffuse(
                    &(problem.precisions[i].0 * weights[i]),
                    problem.diffuse(i),
                    rest,
                );
            },
        );
        if normal.yy == 0.0 {
            return None;
        }
        let (x, _) = normal.solve();
        let rho_d = DVec3::new(x[0], x[1], x[2]);
        let squares = problem.squares(ndf, alpha.ln(), rho_d, rho_s.as_dvec3());
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

/// A point's data and model.
struct Problem<'a> {
    trace: &'a Trace,
    columns: &'a Columns,
    colour: SpecularColour,
    noise: &'a NoiseModel,
    /// `[observations]` inverse covariance and number of usable channels.
    precisions: Vec<(DMat3, u32)>,
}

/// The best parameters under one NDF.
struct Minimum {
    ndf: Ndf,
    ln_alpha: f32,
    rho_d: DVec3,
    rho_s: DVec3,
    /// `[observations]` weights by the residuals' tails.
    weights: Vec<f64>,
    /// `[observations]` squared distances of the residuals.
    squares: Vec<f64>,
    /// Scale of the squared distances.
    scale: f64,
}

impl<'a> Problem<'a> {
    fn new(
        trace: &'a Trace,
        columns: &'a Columns,
        colour: SpecularColour,
        noise: &'a NoiseModel,
    ) -> Self {
        let observations = trace.observations.iter();
        Self {
            trace,
            columns,
            colour,
            noise,
            precisions: observations.map(|o| noise.precision(o)).collect(),
        }
    }

    fn observed(&self, i: usize) -> DVec3 {
        self.trace.observations[i].radiance.as_dvec3()
    }

    fn diffuse(&self, i: usize) -> DVec3 {
        self.columns.diffuse[i].as_dvec3()
    }

    /// Usable channels of all observations.
    fn samples(&self) -> usize {
        self.precisions.iter().map(|(_, k)| *k as usize).sum()
    }

    /// Albedos and alpha.
    fn unknowns(&self) -> usize {
        self.albedos() + 1
    }

    fn albedos(&self) -> usize {
        match self.colour {
            SpecularColour::Neutral => 4,
            SpecularColour::Rgb => 6,
        }
    }

    /// The normal equations' part that no lobe enters.
    fn fixed(&self, weights: &[f64]) -> Normal {
        let mut normal = Normal {
            size: self.albedos(),
            ..Normal::default()
        };
        for (i, ((p, _), w)) in self.precisions.iter().zip(weights).enumerate() {
            normal.add_diffuse(&(*p * *w), self.diffuse(i), self.observed(i));
        }
        normal
    }

    /// The albedos at one roughness, and their weighted squared residual.
    fn project(
        &self,
        ndf: Ndf,
        ln_alpha: f32,
        fixed: &Normal,
        weights: &[f64],
    ) -> ([f64; UNKNOWNS], f64) {
        let mut normal = *fixed;
        self.columns.specular(
            ndf as usize,
            Basis::Dielectric,
            ln_alpha,
            |i, specular, _| {
                let p = self.precisions[i].0 * weights[i];
                let (diffuse, specular, observed) =
                    (self.diffuse(i), specular.as_dvec3(), self.observed(i));
                match self.colour {
                    SpecularColour::Neutral => normal.add_neutral(&p, diffuse, specular, observed),
                    SpecularColour::Rgb => normal.add_coloured(&p, diffuse, specular, observed),
                }
            },
        );
        normal.solve()
    }

    /// The smallest residual over alpha under one NDF, weights and scale in step with it.
    fn minimise(&self, ndf: Ndf) -> Minimum {
        let even = vec![1.0; self.precisions.len()];
        let (mut minimum, mut weights) = self.minimise_weighted(ndf, even);
        for _ in 0..ROUNDS {
            (minimum, weights) = self.minimise_weighted(ndf, weights);
        }
        minimum
    }

    /// The smallest residual by given weights, and the weights that its residuals ask for.
    fn minimise_weighted(&self, ndf: Ndf, weights: Vec<f64>) -> (Minimum, Vec<f64>) {
        let fixed = self.fixed(&weights);
        let ln_alpha =
            minimise_over_alpha(|ln_alpha| self.project(ndf, ln_alpha, &fixed, &weights).1);
        let (x, _) = self.project(ndf, ln_alpha, &fixed, &weights);
        let rho_d = DVec3::new(x[0], x[1], x[2]);
        let rho_s = match self.colour {
            SpecularColour::Neutral => DVec3::splat(x[3]),
            SpecularColour::Rgb => DVec3::new(x[3], x[4], x[5]),
        };
        let squares = self.squares(ndf, ln_alpha, rho_d, rho_s);
        let (next, scale) = self.reweigh(&squares, &weights, self.unknowns());
        let minimum = Minimum {
            ndf,
            ln_alpha,
            rho_d,
            rho_s,
            weights,
            squares,
            scale,
        };
        (minimum, next)
    }

    /// `[observations]` squared distances `rᵀ P r` of the residuals.
    fn squares(&self, ndf: Ndf, ln_alpha: f32, rho_d: DVec3, rho_s: DVec3) -> Vec<f64> {
        let mut squares = Vec::with_capacity(self.precisions.len());
        self.columns.specular(
            ndf as usize,
            Basis::Dielectric,
            ln_alpha,
            |i, specular, _| {
                let r = self.observed(i) - rho_d * self.diffuse(i) - rho_s * specular.as_dvec3();
                squares.push(r.dot(self.precisions[i].0 * r));
            },
        );
        squares
    }

    /// Student's weights of squared distances, and their scale, found in turns from the last weights.
    fn reweigh(&self, squares: &[f64], weights: &[f64], unknowns: usize) -> (Vec<f64>, f64) {
        let samples = self.samples() as f64;
        let mut weights = weights.to_vec();
        let mut scale = 1.0;
        for _ in 0..3 {
            let sum: f64 = squares.iter().zip(&weights).map(|(q, w)| q * w).sum();
            let freedom = samples - (unknowns as f64).min(samples - 1.0) + PRIOR_RESIDUALS;
            scale = (sum + PRIOR_RESIDUALS) / freedom;
            if self.noise.is_known {
                scale = scale.max(1.0);
            }
            for ((w, q), (_, k)) in weights.iter_mut().zip(squares).zip(&self.precisions) {
                *w = (NU + f64::from(*k)) / (NU + q / scale);
            }
        }
        (weights, scale)
    }

    /// Of Student's t at a scale that the NDFs share.
    fn ln_likelihood(&self, minimum: &Minimum, scale: f64) -> f64 {
        let terms = minimum.squares.iter().zip(&self.precisions);
        terms
            .map(|(q, (_, k))| -0.5 * (NU + f64::from(*k)) * (q / (NU * scale)).ln_1p())
            .sum()
    }

    /// Error bars and verdict.
    fn conclude(&self, minimum: &Minimum) -> Estimate {
        // Student's information is (ν + k)/(ν + k + 2) of the normal's; the weights have mean 1.
        let spread = minimum.scale * (NU + 5.0) / (NU + 3.0);
        let covariance = self.covariance(minimum);
        let sigma = covariance.map(|variance| (variance * spread).sqrt() as f32);

        let alpha = minimum.ln_alpha.exp();
        let (low, high) = Columns::ln_range();
        let at_bound = minimum.ln_alpha - low < 1e-3 || high - minimum.ln_alpha < 1e-3;
        let sigma_ln_alpha = f64::from(sigma[6]);
        // A lobe that may as well not be there has no roughness, however well noise fits into one.
        let rho_s = minimum.rho_s.as_vec3();
        let is_seen = (0..3).any(|c| rho_s[c] > sigma[3 + c]);
        let is_known = sigma_ln_alpha.is_finite() && sigma_ln_alpha <= LARGEST_SIGMA_LN_ALPHA;
        let status = if !(is_seen && is_known) {
            Status::Unidentifiable
        } else if at_bound {
            Status::AlphaAtBound
        } else {
            Status::Converged
        };
        Estimate {
            rho_d: minimum.rho_d.as_vec3(),
            rho_s,
            alpha,
            ndf: minimum.ndf,
            sigma_rho_d: Vec3::new(sigma[0], sigma[1], sigma[2]),
            sigma_rho_s: sigma[3].max(sigma[4]).max(sigma[5]),
            sigma_alpha: alpha * sigma[6],
            frames: self.trace.frames(),
            residual: self.relative_residual(minimum),
            status,
        }
    }

    /// Variances of (rho_d RGB, rho_s RGB, ln alpha): the diagonal of the inverse Fisher
    /// information `Jᵀ W J` at unit scale; infinite where the data say nothing. A specular albedo of
    /// zero leaves alpha undetermined.
    fn covariance(&self, minimum: &Minimum) -> [f64; 7] {
        let neutral = self.colour == SpecularColour::Neutral;
        // Columns: rho_d (3), rho_s (1 or 3), ln alpha.
        let size = self.unknowns();
        let mut information = vec![vec![0.0; size]; size];
        self.columns.specular(
            minimum.ndf as usize,
            Basis::Dielectric,
            minimum.ln_alpha,
            |i, specular, slope| {
                let (diffuse, specular) = (self.diffuse(i), specular.as_dvec3());
                let mut jacobian = [DVec3::ZERO; 7];
                for (c, axis) in DVec3::AXES.into_iter().enumerate() {
                    jacobian[c] = axis * diffuse[c];
                    if neutral {
                        jacobian[3][c] = specular[c];
                    } else {
                        jacobian[3 + c] = axis * specular[c];
                    }
                }
                jacobian[size - 1] = minimum.rho_s * slope.as_dvec3();
                let p = self.precisions[i].0 * minimum.weights[i];
                for a in 0..size {
                    let weighted = p * jacobian[a];
                    for b in 0..size {
                        information[a][b] += weighted.dot(jacobian[b]);
                    }
                }
            },
        );
        let variances = inverse_diagonal(information);
        let mut full = [f64::INFINITY; 7];
        full[..3].copy_from_slice(&variances[..3]);
        full[6] = variances[size - 1];
        for c in 0..3 {
            full[3 + c] = variances[if neutral { 3 } else { 3 + c }];
        }
        full
    }

    /// Root-mean-square residual over the root-mean-square observation, channels in use.
    fn relative_residual(&self, minimum: &Minimum) -> f32 {
        let (mut squares, mut total) = (0.0, 0.0);
        self.columns.specular(
            minimum.ndf as usize,
            Basis::Dielectric,
            minimum.ln_alpha,
            |i, specular, _| {
                let observed = self.observed(i);
                let predicted =
                    minimum.rho_d * self.diffuse(i) + minimum.rho_s * specular.as_dvec3();
                for c in 0..3 {
                    if self.precisions[i].0.col(c)[c] > 0.0 {
                        squares += (observed[c] - predicted[c]).powi(2);
                        total += observed[c].powi(2);
                    }
                }
            },
        );
        if total > 0.0 {
            (squares / total).sqrt() as f32
        } else {
            0.0
        }
    }
}

/// The `ln alpha` of the smallest value: the best of the grid, then golden sections about it. The
/// grid is finer than an objective's own scale, so no minimum hides in it.
pub(super) fn minimise_over_alpha(value: impl Fn(f32) -> f64) -> f32 {
    let grid: Vec<f64> = (0..ROUGHNESSES).map(|k| value(roughness(k).ln())).collect();
    let best = (0..ROUGHNESSES)
        .min_by(|&a, &b| grid[a].total_cmp(&grid[b]))
        .unwrap_or(0);
    let low = roughness(best.saturating_sub(1)).ln();
    let high = roughness((best + 1).min(ROUGHNESSES - 1)).ln();
    golden_section(low, high, value)
}

/// The place of the smallest value in a bracket, to 1e-4, by golden sections. The ends count.
fn golden_section(mut low: f32, mut high: f32, value: impl Fn(f32) -> f64) -> f32 {
    const RATIO: f32 = 0.618_034;
    let ends = [(low, value(low)), (high, value(high))];
    let (mut a, mut b) = (high - RATIO * (high - low), low + RATIO * (high - low));
    let (mut at_a, mut at_b) = (value(a), value(b));
    while high - low > 1e-4 {
        if at_a < at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - RATIO * (high - low);
            at_a = value(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + RATIO * (high - low);
            at_b = value(b);
        }
    }
    let inside = if at_a < at_b { (a, at_a) } else { (b, at_b) };
    ends.into_iter()
        .fold(inside, |best, end| if end.1 < best.1 { end } else { best })
        .0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn golden_section_finds_inner_and_end_minima() {
        assert!((golden_section(-1.0, 2.0, |x| f64::from(x - 0.3).powi(2)) - 0.3).abs() < 2e-4);
        assert_eq!(golden_section(-1.0, 2.0, f64::from), -1.0);
    }
}
