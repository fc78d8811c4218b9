//! Which NDF each point has, by the evidence of all.
//!
//! A point that sees little of its highlight cannot tell Beckmann from GGX: noise decides. But an
//! object has few materials. The share π of points that are GGX is found from all points' likelihoods
//! (expectation maximisation), and a point is GGX if `π L_ggx > (1 − π) L_beckmann`. A point of firm
//! evidence is not moved: π lies in [1/(N + 2), (N + 1)/(N + 2)].

use super::full::Candidate;
use crate::brdf::Ndf;

/// Rounds of expectation maximisation.
const ROUNDS: usize = 50;

/// The share of GGX that makes the candidates' likelihoods largest, or ½ if no point has a choice.
pub(super) fn share_of_ggx(points: &[Vec<Candidate>]) -> f64 {
    let ratios: Vec<f64> = points.iter().filter_map(|p| ln_ratio(p)).collect();
    let mut share: f64 = 0.5;
    for _ in 0..ROUNDS {
        let posteriors = ratios.iter().map(|ratio| {
            let odds = (share / (1.0 - share)).ln() + ratio;
            1.0 / (1.0 + (-odds).exp())
        });
        share = (posteriors.sum::<f64>() + 1.0) / (ratios.len() + 2) as f64;
    }
    share
}

/// The more probable candidate, given the share of GGX.
pub(super) fn choose(candidates: &[Candidate], share_of_ggx: f64) -> &Candidate {
    match ln_ratio(candidates) {
        None => &candidates[0],
        Some(ratio) => {
            let ggx = ratio + (share_of_ggx / (1.0 - share_of_ggx)).ln() >= 0.0;
            &candidates[if ggx { Ndf::Ggx } else { Ndf::Beckmann } as usize]
        }
    }
}

/// `ln L_ggx − ln L_beckmann`, where both were tried.
fn ln_ratio(candidates: &[Candidate]) -> Option<f64> {
    match candidates {
        [beckmann, ggx] => Some(ggx.ln_likelihood - beckmann.ln_likelihood),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::{Estimate, Status};

    fn point(ln_ratio: f64) -> Vec<Candidate> {
        let candidate = |ndf, ln_likelihood| Candidate {
            estimate: Estimate {
                ndf,
                ..Estimate::without_data(Status::Converged, 9)
            },
            ln_likelihood,
        };
        vec![candidate(Ndf::Beckmann, 0.0), candidate(Ndf::Ggx, ln_ratio)]
    }

    #[test]
    fn weak_evidence_follows_the_object_and_firm_evidence_does_not() {
        let mut points: Vec<_> = (0..100).map(|i| point(f64::from(i % 7) - 1.5)).collect();
        points.push(point(-30.0));
        let share = share_of_ggx(&points);
        assert!(share > 0.8, "{share}");
        assert_eq!(choose(&points[0], share).estimate.ndf, Ndf::Ggx);
        assert_eq!(choose(&points[100], share).estimate.ndf, Ndf::Beckmann);
    }

    #[test]
    fn two_materials_are_both_kept() {
        let points: Vec<_> = (0..100)
            .map(|i| point(if i < 30 { -8.0 } else { 8.0 }))
            .collect();
        let share = share_of_ggx(&points);
        assert!((share - 0.7).abs() < 0.02, "{share}");
        let ggx = points
            .iter()
            .filter(|p| choose(p, share).estimate.ndf == Ndf::Ggx);
        assert_eq!(ggx.count(), 70);
    }
}
