//! Which model each point has, by the evidence of all.
//!
//! A point that sees little of its highlight cannot tell Beckmann from GGX, or a tinted lobe from a
//! neutral one: noise decides. But an object has few materials. The share π_m of points of each model is
//! found from all points' likelihoods (expectation maximisation), and a point has the model of largest
//!
//! ```text
//! ln π_m + ln L_m − ½ k_m ln n      (Schwarz 1978: k_m unknowns, n samples)
//! ```
//!
//! A point of firm evidence is not moved: every π_m is at least 1/(N + M).

use super::full::Candidate;
use super::lobe_form::LobeForm;
use super::problem::Model;
use super::uncertainty::LARGEST_SIGMA_LN_ALPHA;
use super::{Estimate, Reason, Status};
use crate::brdf::Ndf;

/// Rounds of expectation maximisation.
const ROUNDS: usize = 50;

/// How common each model is.
#[derive(Clone, Debug)]
pub(super) struct Shares {
    models: Vec<(Model, f64)>,
}

impl Shares {
    /// All models alike.
    pub(super) fn even(models: &[Model]) -> Self {
        let share = 1.0 / models.len().max(1) as f64;
        Self {
            models: models.iter().map(|&model| (model, share)).collect(),
        }
    }

    /// The shares that make the candidates' likelihoods largest; of points with data.
    pub(super) fn of<'a>(models: &[Model], points: impl Iterator<Item = &'a [Candidate]>) -> Self {
        let scores: Vec<Vec<f64>> = points
            .filter(|candidates| candidates.len() == models.len())
            .map(|candidates| candidates.iter().map(score).collect())
            .collect();
        let mut shares = Self::even(models);
        for _ in 0..ROUNDS {
            let mut sums = vec![1.0; models.len()];
            for scores in &scores {
                for (sum, posterior) in sums.iter_mut().zip(shares.posteriors(scores)) {
                    *sum += posterior;
                }
            }
            let total: f64 = sums.iter().sum();
            for ((_, share), sum) in shares.models.iter_mut().zip(sums) {
                *share = sum / total;
            }
        }
        shares
    }

    /// The models of the form of the lobe that most points have.
    pub(super) fn of_commonest_form(&self) -> Vec<Model> {
        let share = |model: &Model| -> f64 {
            let same = self.models.iter().filter(|(m, _)| m.form == model.form);
            same.map(|(_, share)| share).sum()
        };
        let mut form = None;
        let mut most = f64::NEG_INFINITY;
        for (model, _) in &self.models {
            if share(model) > most {
                (most, form) = (share(model), Some(model.form));
            }
        }
        let models = self.models.iter().map(|(model, _)| *model);
        models.filter(|model| Some(model.form) == form).collect()
    }

    /// A coloured form of the Fresnel term that most points have, and its index of refraction: of
    /// Schlick's term if half of the points follow it, else of the commonest dielectric.
    pub(super) fn commonest_fresnel(&self) -> (LobeForm, Option<f32>) {
        let share = |is: &dyn Fn(&Model) -> bool| -> f64 {
            let those = self.models.iter().filter(|(model, _)| is(model));
            those.map(|(_, share)| share).sum()
        };
        let schlick = share(&|m| m.form.is_schlick()) >= 0.5;
        let mut most = f64::NEG_INFINITY;
        let mut commonest = (LobeForm::Schlick, None);
        for (model, _) in &self.models {
            let same = share(&|m| m.eta == model.eta);
            if model.form.is_schlick() == schlick && same > most {
                (most, commonest) = (same, (model.form.coloured(), model.eta));
            }
        }
        commonest
    }

    /// Probability of each candidate.
    pub(super) fn posteriors_of(&self, candidates: &[Candidate]) -> Vec<f64> {
        let scores: Vec<f64> = candidates.iter().map(score).collect();
        self.posteriors(&scores)
    }

    /// Probability of each model, given its score.
    fn posteriors(&self, scores: &[f64]) -> Vec<f64> {
        let weighted: Vec<f64> = self
            .models
            .iter()
            .zip(scores)
            .map(|((_, share), score)| share.ln() + score)
            .collect();
        let highest = weighted.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let odds: Vec<f64> = weighted.iter().map(|w| (w - highest).exp()).collect();
        let total: f64 = odds.iter().sum();
        odds.into_iter().map(|o| o / total).collect()
    }

    /// The most probable candidate.
    pub(super) fn choose<'a>(&self, candidates: &'a [Candidate]) -> Choice<'a> {
        let scores: Vec<f64> = candidates.iter().map(score).collect();
        let posteriors = if candidates.len() == self.models.len() {
            self.posteriors(&scores)
        } else {
            vec![1.0; candidates.len()]
        };
        let mut best = 0;
        for (i, p) in posteriors.iter().enumerate() {
            if *p > posteriors[best] {
                best = i;
            }
        }
        Choice {
            candidate: &candidates[best],
            estimate: conclude(candidates, &posteriors, best),
        }
    }
}

/// What a point is taken for.
pub(super) struct Choice<'a> {
    pub(super) candidate: &'a Candidate,
    /// The candidate's estimate, with what its rivals leave in doubt.
    pub(super) estimate: Estimate,
}

/// `ln L − ½ k ln n`.
fn score(candidate: &Candidate) -> f64 {
    candidate.ln_likelihood - candidate.model.unknowns() as f64 * candidate.penalty
}

/// The chosen estimate, its roughness as uncertain as the choice: rival models and the second minimum
/// count with their probability.
fn conclude(candidates: &[Candidate], posteriors: &[f64], best: usize) -> Estimate {
    let chosen = &candidates[best];
    let mut estimate = chosen.estimate;
    let likelihood = |ndf: Ndf| {
        let twin = |c: &&Candidate| c.model.form == chosen.model.form && c.model.ndf == ndf;
        candidates.iter().find(twin).map(|c| c.ln_likelihood)
    };
    if let (Some(ggx), Some(beckmann)) = (likelihood(Ndf::Ggx), likelihood(Ndf::Beckmann)) {
        estimate.ndf_evidence = (ggx - beckmann) as f32;
    }
    if !estimate.sigma_alpha.is_finite() {
        return estimate;
    }
    // Each parameter's variance: its own, and how far the others are away, by their probability.
    // Lobes of Schlick's term and of a dielectric have albedos and roughnesses of different kinds, and
    // stay out of each other's.
    let spread = |of: &dyn Fn(&Estimate) -> (f64, f64)| {
        let (centre, own) = of(&chosen.estimate);
        let mut variance = 0.0;
        for (candidate, posterior) in candidates.iter().zip(posteriors) {
            let alike = candidate.model.form.is_schlick() == chosen.model.form.is_schlick();
            let (value, sigma) = of(&if alike {
                candidate.estimate.under(chosen.model.eta)
            } else {
                chosen.estimate
            });
            variance += posterior
                * if sigma.is_finite() {
                    sigma * sigma + (value - centre).powi(2)
                } else {
                    own * own
                };
        }
        variance
    };
    let shape = |e: &Estimate| (f64::from(e.alpha.ln()), f64::from(e.sigma_alpha / e.alpha));
    let mut variance = spread(&shape);
    if estimate.second_evidence.is_finite() {
        let (x, sigma) = shape(&estimate);
        let odds = f64::from(estimate.second_evidence.min(0.0)).exp();
        let away = f64::from(estimate.second_alpha.ln()) - x;
        variance = variance.max(sigma * sigma + odds / (1.0 + odds) * away * away);
    }
    estimate.sigma_alpha = estimate.alpha * variance.sqrt() as f32;
    estimate.sigma_rho_s = (0..3)
        .map(|c| spread(&|e| (f64::from(e.rho_s[c]), f64::from(e.sigma_rho_s))))
        .fold(0.0, f64::max)
        .sqrt() as f32;
    for c in 0..3 {
        let of = |e: &Estimate| (f64::from(e.rho_d[c]), f64::from(e.sigma_rho_d[c]));
        estimate.sigma_rho_d[c] = spread(&of).sqrt() as f32;
    }
    let fitted = matches!(estimate.status, Status::Converged | Status::AlphaAtBound);
    if fitted && variance.sqrt() > LARGEST_SIGMA_LN_ALPHA {
        estimate.status = Status::Unidentifiable;
        estimate.reason = Reason::TwoMinima;
    }
    estimate
}

#[cfg(test)]
mod tests {
    use super::*;

    fn models() -> Vec<Model> {
        let form = LobeForm::Neutral;
        let eta = Some(1.3);
        Ndf::ALL.map(|ndf| Model { ndf, form, eta }).to_vec()
    }

    fn point(ln_ratio: f64) -> Vec<Candidate> {
        let candidate = |model: Model, ln_likelihood| Candidate {
            model,
            estimate: Estimate {
                ndf: model.ndf,
                alpha: 0.2,
                sigma_alpha: 0.002,
                ..Estimate::without_data(Status::Converged, 9)
            },
            ln_likelihood,
            penalty: 2.0,
            table: None,
        };
        let [beckmann, ggx] = [models()[0], models()[1]];
        vec![candidate(beckmann, 0.0), candidate(ggx, ln_ratio)]
    }

    fn shares(points: &[Vec<Candidate>]) -> Shares {
        Shares::of(&models(), points.iter().map(Vec::as_slice))
    }

    #[test]
    fn weak_evidence_follows_the_object_and_firm_evidence_does_not() {
        let mut points: Vec<_> = (0..100).map(|i| point(f64::from(i % 7) - 1.5)).collect();
        points.push(point(-30.0));
        let shares = shares(&points);
        assert!(shares.models[1].1 > 0.8, "{shares:?}");
        assert_eq!(shares.choose(&points[0]).estimate.ndf, Ndf::Ggx);
        assert_eq!(shares.choose(&points[100]).estimate.ndf, Ndf::Beckmann);
        assert_eq!(shares.choose(&points[100]).estimate.ndf_evidence, -30.0);
    }

    #[test]
    fn two_materials_are_both_kept() {
        let points: Vec<_> = (0..100)
            .map(|i| point(if i < 30 { -8.0 } else { 8.0 }))
            .collect();
        let shares = shares(&points);
        assert!((shares.models[1].1 - 0.7).abs() < 0.02, "{shares:?}");
        let ggx = points
            .iter()
            .filter(|p| shares.choose(p).estimate.ndf == Ndf::Ggx);
        assert_eq!(ggx.count(), 70);
    }

    #[test]
    fn a_rival_nearly_as_good_widens_the_error_bar() {
        let mut rivals = point(0.0);
        rivals[0].estimate.alpha = 0.3;
        let shares = Shares::even(&models());
        let sigma = shares.choose(&rivals).estimate.sigma_alpha;
        // Half of the time the truth is ln 1.5 away.
        assert!(
            (sigma / 0.3 - 1.5f32.ln() / 2f32.sqrt()).abs() < 0.01,
            "{sigma}"
        );
        let mut second = point(40.0);
        second[1].estimate.second_alpha = 0.6;
        second[1].estimate.second_evidence = -1.0;
        let choice = shares.choose(&second).estimate;
        assert!(choice.sigma_alpha > 0.5 * 0.2, "{choice:?}");
        assert_eq!(choice.reason, Reason::TwoMinima);
    }

    #[test]
    fn an_unknown_more_must_pay_for_itself() {
        let mut models = models();
        models[1].form = LobeForm::Rgb;
        for (gain, form) in [(3.0, LobeForm::Neutral), (5.0, LobeForm::Rgb)] {
            let mut point = point(gain);
            point[1].model = models[1];
            let chosen = Shares::even(&models).choose(&point).candidate.model.form;
            assert_eq!(chosen, form, "two unknowns more at a price of 2 each");
        }
    }
}
