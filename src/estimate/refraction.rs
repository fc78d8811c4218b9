//! Which index of refraction an object's dielectrics have, between those that were tried.
//!
//! One point hardly tells its index, but all points of a material share it. Over the indices that were tried
//! the points' profile likelihoods add up to a function that is close to a parabola in `ln F0`, where `F0` is
//! the reflectance at normal incidence:
//!
//! ```text
//! S(eta) = Σ_i p_i ln L_i(eta),   p_i the probability that point i is one of these dielectrics
//! ```
//!
//! Its vertex, to a hundredth, is tried with the others.

use super::fresnel_model::{DIELECTRICS, TENTH, nearest_dielectric};
use super::full::Candidate;
use super::lobe_form::LobeForm;
use super::model_choice::Shares;
use super::problem::Model;
use crate::brdf::dielectric;

/// Dielectrics that fewer points than this share have are not refined: their vertex is noise.
const SMALLEST_SHARE: f64 = 0.05;

/// Numbers of the dielectrics to try besides `models`, given how some points fared under those.
pub(super) fn between<'a>(
    models: &[Model],
    points: impl Iterator<Item = &'a [Candidate]> + Clone,
) -> Vec<usize> {
    let tried: Vec<usize> = (0..DIELECTRICS.len()).step_by(TENTH).collect();
    let number = |model: &Model| match model.form {
        LobeForm::NeutralOf(k) | LobeForm::RgbOf(k) => Some(k / TENTH),
        LobeForm::Neutral | LobeForm::Rgb | LobeForm::NeutralSchlick | LobeForm::Schlick => None,
    };
    let numbers: Vec<Option<usize>> = models.iter().map(number).collect();
    if numbers.iter().flatten().count() == 0 {
        return Vec::new();
    }
    let points: Vec<&[Candidate]> = points.filter(|c| c.len() == models.len()).collect();
    let shares = Shares::of(models, points.iter().copied());
    let posteriors: Vec<Vec<f64>> = points.iter().map(|c| shares.posteriors_of(c)).collect();
    let mut share: Vec<f64> = vec![0.0; tried.len()];
    for posteriors in &posteriors {
        for (number, p) in numbers.iter().zip(posteriors) {
            if let Some(number) = number {
                share[*number] += p / points.len() as f64;
            }
        }
    }

    let mut found = Vec::new();
    while let Some(middle) = commonest(&share) {
        // The three tried about the commonest, within the range.
        let first = middle.saturating_sub(1).min(tried.len() - 3);
        let mut sums = [0.0; 3];
        for (candidates, posteriors) in points.iter().zip(&posteriors) {
            let near = |n: &Option<usize>| n.is_some_and(|n| (first..first + 3).contains(&n));
            let those = || (0..models.len()).filter(|&m| near(&numbers[m]));
            let Some(best) = those().max_by(|&a, &b| posteriors[a].total_cmp(&posteriors[b]))
            else {
                continue;
            };
            let probability: f64 = those().map(|m| posteriors[m]).sum();
            // The same NDF and colour under each index.
            let alike = |m: &usize| {
                models[*m].ndf == models[best].ndf
                    && models[*m].form.size() == models[best].form.size()
            };
            for m in those().filter(alike) {
                if let Some(number) = numbers[m] {
                    sums[number - first] += probability * candidates[m].ln_likelihood;
                }
            }
        }
        let eta = |i: usize| DIELECTRICS[tried[first + i]].eta;
        let place = |i: usize| f64::from(dielectric(1.0, eta(i)).ln());
        let vertex = vertex([0, 1, 2].map(place), sums).exp().sqrt();
        // F0 = ((eta − 1)/(eta + 1))².
        let eta = ((1.0 + vertex) / (1.0 - vertex)) as f32;
        let number = nearest_dielectric(eta);
        if !tried.contains(&number) {
            found.push(number);
        }
        share[first..first + 3].fill(0.0);
    }
    found
}

/// The largest share that counts.
fn commonest(share: &[f64]) -> Option<usize> {
    let best = (0..share.len()).max_by(|&a, &b| share[a].total_cmp(&share[b]))?;
    (share[best] >= SMALLEST_SHARE).then_some(best)
}

/// Where the parabola through three points is highest, within their range.
fn vertex(x: [f64; 3], y: [f64; 3]) -> f64 {
    let slope = |a: usize, b: usize| (y[b] - y[a]) / (x[b] - x[a]);
    let curvature = (slope(1, 2) - slope(0, 1)) / (x[2] - x[0]);
    if curvature < 0.0 {
        let middle = 0.5 * (x[0] + x[1]) - slope(0, 1) / (2.0 * curvature);
        middle.clamp(x[0], x[2])
    } else if y[0] > y[2] {
        x[0]
    } else {
        x[2]
    }
}

#[cfg(test)]
mod tests {
    use super::vertex;

    #[test]
    fn vertex_of_a_parabola_and_of_none() {
        let parabola = |x: f64| 3.0 - (x - 0.7).powi(2);
        let x = [0.0, 0.5, 1.2];
        assert!((vertex(x, x.map(parabola)) - 0.7).abs() < 1e-12);
        assert_eq!(vertex(x, x.map(|x| x * x)), 1.2);
        assert_eq!(vertex(x, x.map(|x| -x * x)), 0.0);
    }
}
