//! The default estimator: variable projection over alpha, both NDFs, and error bars.

use glam::Vec3;

use super::columns::{Columns, ROUGHNESSES, roughness};
use super::separable::{Albedos, Gram, solve};
use super::{Estimate, FitSettings, SpecularColour, Status};
use crate::brdf::Ndf;
use crate::traces::Trace;

/// A standard deviation of `ln alpha` above this says that the data do not determine alpha: the
/// 68 % interval then spans more than a factor of 2.7.
const LARGEST_SIGMA_LN_ALPHA: f64 = 0.5;

/// Fits one point, given its columns.
pub(super) fn estimate(
    trace: &Trace,
    columns: &Columns,
    settings: &FitSettings,
    noise_is_known: bool,
) -> Estimate {
    let problem = Problem {
        trace,
        columns,
        colour: settings.specular,
    };
    let frames = trace.frames();
    if frames == 0 {
        return Estimate::without_data(Status::Unseen, 0);
    }
    let samples = problem.samples();
    if samples == 0 {
        return Estimate::without_data(Status::Saturated, frames);
    }
    let unknowns = match settings.specular {
        SpecularColour::Neutral => 5,
        SpecularColour::Rgb => 7,
    };
    if samples < unknowns {
        return Estimate::without_data(Status::TooFewSamples, frames);
    }

    let candidates = Ndf::ALL
        .into_iter()
        .filter(|&ndf| settings.ndf.is_none_or(|n| n == ndf));
    let minimum = candidates
        .map(|ndf| problem.minimise(ndf))
        .min_by(|a, b| a.albedos.objective.total_cmp(&b.albedos.objective));
    match minimum {
        Some(minimum) => problem.conclude(&minimum, samples - unknowns, noise_is_known),
        None => Estimate::without_data(Status::TooFewSamples, frames),
    }
}

/// A point's data and model.
struct Problem<'a> {
    trace: &'a Trace,
    columns: &'a Columns,
    colour: SpecularColour,
}

/// The best parameters under one NDF.
struct Minimum {
    ndf: Ndf,
    ln_alpha: f32,
    albedos: Albedos,
}

impl Problem<'_> {
    /// Inverse variance; 0 for a sample that tells nothing.
    fn weight(&self, i: usize, channel: usize) -> f64 {
        let variance = f64::from(self.trace.observations[i].variance[channel]);
        if variance.is_finite() && variance > 0.0 {
            1.0 / variance
        } else {
            0.0
        }
    }

    fn samples(&self) -> usize {
        let pairs = (0..self.trace.observations.len()).flat_map(|i| (0..3).map(move |c| (i, c)));
        pairs.filter(|&(i, c)| self.weight(i, c) > 0.0).count()
    }

    /// The albedos at one roughness.
    fn project(&self, ndf: Ndf, ln_alpha: f32) -> Albedos {
        let mut grams = [Gram::default(); 3];
        self.columns
            .specular(ndf as usize, ln_alpha, |i, specular, _| {
                let observed = self.trace.observations[i].radiance;
                let diffuse = self.columns.diffuse[i];
                for (c, gram) in grams.iter_mut().enumerate() {
                    gram.add(
                        self.weight(i, c),
                        f64::from(diffuse[c]),
                        f64::from(specular[c]),
                        f64::from(observed[c]),
                    );
                }
            });
        solve(&grams, self.colour)
    }

    /// The smallest residual over alpha: the best of the grid, then golden sections about it, on
    /// `ln alpha`. The grid is finer than the objective's own scale, so no minimum hides in it.
    fn minimise(&self, ndf: Ndf) -> Minimum {
        let value = |ln_alpha: f32| self.project(ndf, ln_alpha).objective;
        let grid: Vec<f64> = (0..ROUGHNESSES).map(|k| value(roughness(k).ln())).collect();
        let best = (0..ROUGHNESSES)
            .min_by(|&a, &b| grid[a].total_cmp(&grid[b]))
            .unwrap_or(0);
        let low = roughness(best.saturating_sub(1)).ln();
        let high = roughness((best + 1).min(ROUGHNESSES - 1)).ln();
        let ln_alpha = golden_section(low, high, value);
        Minimum {
            ndf,
            ln_alpha,
            albedos: self.project(ndf, ln_alpha),
        }
    }

    /// Error bars and verdict.
    fn conclude(&self, minimum: &Minimum, freedom: usize, noise_is_known: bool) -> Estimate {
        let Minimum {
            ndf,
            ln_alpha,
            albedos,
        } = minimum;
        let to_vec = |v: [f64; 3]| Vec3::new(v[0] as f32, v[1] as f32, v[2] as f32);
        let covariance = self.covariance(minimum);

        // Where the noise is known, residuals above it (a model that does not hold) widen the bars,
        // none below narrow them. Where it is not, the residuals give it; and the channels are taken
        // as one: a path tracer's noise is correlated 0.93 to 0.98 between them (measured in Mitsuba),
        // so an observation is one sample, not three, of three unknowns (diffuse, specular, alpha).
        let factor = if noise_is_known {
            (albedos.objective / freedom.max(1) as f64).max(1.0)
        } else {
            match self.trace.observations.len() {
                0..=3 => f64::INFINITY,
                observations => albedos.objective / (observations - 3) as f64,
            }
        };
        let sigma = covariance.map(|variance| (variance * factor).sqrt() as f32);

        let alpha = ln_alpha.exp();
        let (low, high) = Columns::ln_range();
        let at_bound = ln_alpha - low < 1e-3 || high - ln_alpha < 1e-3;
        let sigma_ln_alpha = f64::from(sigma[6]);
        let status = if !sigma_ln_alpha.is_finite() || sigma_ln_alpha > LARGEST_SIGMA_LN_ALPHA {
            Status::Unidentifiable
        } else if at_bound {
            Status::AlphaAtBound
        } else {
            Status::Converged
        };
        Estimate {
            rho_d: to_vec(albedos.rho_d),
            rho_s: to_vec(albedos.rho_s),
            alpha,
            ndf: *ndf,
            sigma_rho_d: Vec3::new(sigma[0], sigma[1], sigma[2]),
            sigma_rho_s: sigma[3].max(sigma[4]).max(sigma[5]),
            sigma_alpha: alpha * sigma[6],
            frames: self.trace.frames(),
            residual: self.relative_residual(minimum),
            status,
        }
    }

    /// Variances of (rho_d RGB, rho_s RGB, ln alpha): the diagonal of the inverse Fisher
    /// information `Jᵀ W J` for unit noise; infinite where the data say nothing. A specular albedo
    /// of zero leaves alpha undetermined.
    fn covariance(&self, minimum: &Minimum) -> [f64; 7] {
        let neutral = self.colour == SpecularColour::Neutral;
        let rho_s = minimum.albedos.rho_s;
        // Columns: rho_d (3), rho_s (1 or 3), ln alpha.
        let size = if neutral { 5 } else { 7 };
        let mut information = vec![vec![0.0; size]; size];
        self.columns.specular(
            minimum.ndf as usize,
            minimum.ln_alpha,
            |i, specular, slope| {
                for c in 0..3 {
                    let mut row = [0.0; 7];
                    row[c] = f64::from(self.columns.diffuse[i][c]);
                    row[if neutral { 3 } else { 3 + c }] = f64::from(specular[c]);
                    row[size - 1] = rho_s[c] * f64::from(slope[c]);
                    let w = self.weight(i, c);
                    for a in 0..size {
                        for b in 0..size {
                            information[a][b] += w * row[a] * row[b];
                        }
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

    fn relative_residual(&self, minimum: &Minimum) -> f32 {
        let (mut squares, mut total) = (0.0, 0.0);
        self.columns
            .specular(minimum.ndf as usize, minimum.ln_alpha, |i, specular, _| {
                let observation = &self.trace.observations[i];
                for c in 0..3 {
                    if self.weight(i, c) > 0.0 {
                        let predicted = minimum.albedos.rho_d[c]
                            * f64::from(self.columns.diffuse[i][c])
                            + minimum.albedos.rho_s[c] * f64::from(specular[c]);
                        squares += (f64::from(observation.radiance[c]) - predicted).powi(2);
                        total += f64::from(observation.radiance[c]).powi(2);
                    }
                }
            });
        if total > 0.0 {
            (squares / total).sqrt() as f32
        } else {
            0.0
        }
    }
}

/// The place of the smallest value in a bracket, to 1e-4, by golden sections. The ends count.
pub(super) fn golden_section(mut low: f32, mut high: f32, value: impl Fn(f32) -> f64) -> f32 {
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

/// Diagonal of the inverse of a symmetric positive semi-definite matrix; infinite for unknowns that
/// it does not determine.
///
/// Scaled to a unit diagonal first, then inverted by Gauss–Jordan steps on the largest remaining
/// pivot. A pivot below 1e-10 means that the column depends on the others to rounding: all
/// unknowns that take part are undetermined.
fn inverse_diagonal(matrix: Vec<Vec<f64>>) -> Vec<f64> {
    let n = matrix.len();
    let scale: Vec<f64> = (0..n).map(|i| matrix[i][i].max(0.0).sqrt()).collect();
    let known: Vec<usize> = (0..n).filter(|&i| scale[i] > 0.0).collect();
    let m = known.len();
    let mut a: Vec<Vec<f64>> = (0..m)
        .map(|i| {
            let row =
                (0..m).map(|j| matrix[known[i]][known[j]] / (scale[known[i]] * scale[known[j]]));
            row.chain((0..m).map(|j| if i == j { 1.0 } else { 0.0 }))
                .collect()
        })
        .collect();
    let mut open: Vec<usize> = (0..m).collect();
    let mut variances = vec![f64::INFINITY; n];
    while let Some(place) =
        (0..open.len()).max_by(|&x, &y| a[open[x]][open[x]].total_cmp(&a[open[y]][open[y]]))
    {
        let pivot = open.swap_remove(place);
        if a[pivot][pivot] < 1e-10 {
            // Everything still open, and whatever is coupled to it, is undetermined.
            open.push(pivot);
            for i in (0..m).filter(|i| !open.contains(i)) {
                if open.iter().all(|&j| a[i][j].abs() < 1e-6) {
                    variances[known[i]] = a[i][m + i] / (scale[known[i]] * scale[known[i]]);
                }
            }
            return variances;
        }
        let inverse = 1.0 / a[pivot][pivot];
        a[pivot].iter_mut().for_each(|v| *v *= inverse);
        let row = a[pivot].clone();
        for (i, other) in a.iter_mut().enumerate().filter(|(i, _)| *i != pivot) {
            let factor = other[pivot];
            debug_assert!(i != pivot);
            other
                .iter_mut()
                .zip(&row)
                .for_each(|(v, r)| *v -= factor * r);
        }
    }
    for i in 0..m {
        variances[known[i]] = a[i][m + i] / (scale[known[i]] * scale[known[i]]);
    }
    variances
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_diagonal_of_a_known_matrix() {
        let v = inverse_diagonal(vec![vec![4.0, 1.0], vec![1.0, 3.0]]);
        assert!((v[0] - 3.0 / 11.0).abs() < 1e-12 && (v[1] - 4.0 / 11.0).abs() < 1e-12);
    }

    #[test]
    fn dependent_unknowns_are_undetermined_and_others_are_not() {
        // Unknowns 0 and 1 only occur as a sum; 2 stands alone; 3 does not occur.
        let v = inverse_diagonal(vec![
            vec![1.0, 1.0, 0.0, 0.0],
            vec![1.0, 1.0, 0.0, 0.0],
            vec![0.0, 0.0, 4.0, 0.0],
            vec![0.0; 4],
        ]);
        assert!(v[0].is_infinite() && v[1].is_infinite() && v[3].is_infinite());
        assert!((v[2] - 0.25).abs() < 1e-12);
    }

    #[test]
    fn golden_section_finds_inner_and_end_minima() {
        assert!((golden_section(-1.0, 2.0, |x| f64::from(x - 0.3).powi(2)) - 0.3).abs() < 2e-4);
        assert_eq!(golden_section(-1.0, 2.0, f64::from), -1.0);
    }
}
