//! One lobe for the whole object.

use rayon::prelude::*;

use super::profile::GroupLobe;
use super::{Estimate, Group, Model, PointProfile};
use crate::brdf::Ndf;

/// Points that are summed one after the other; the pieces' sums are added in order, so that no result
/// depends on the number of threads.
const PIECE: usize = 1024;

/// What the points whose `weight` is above zero say together.
pub(super) fn group(
    models: &[Model],
    profiles: &[Option<PointProfile>],
    weight: impl Fn(usize) -> f64 + Sync,
) -> Group {
    let pieces: Vec<Group> = profiles
        .par_chunks(PIECE)
        .enumerate()
        .map(|(piece, profiles)| {
            let mut group = Group::empty(models);
            for (i, profile) in profiles.iter().enumerate() {
                let weight = weight(piece * PIECE + i);
                if let Some(profile) = profile.as_ref().filter(|_| weight > 0.0) {
                    group.add(profile, weight);
                }
            }
            group
        })
        .collect();
    let mut whole = Group::empty(models);
    pieces.iter().for_each(|piece| whole.merge(piece));
    whole
}

/// Degrees of freedom of the tails of points' deviances.
const NU: f64 = 4.0;
/// Rounds of weights by the points' deviances.
const ROUNDS: usize = 8;

/// A lobe under one model, and what it leaves: `−2 ln L` of Student's t over the points' deviances.
fn lobe_of(
    model: usize,
    models: &[Model],
    profiles: &[Option<PointProfile>],
) -> Option<(GroupLobe, f64)> {
    let freedom = (models[model].form.size() + 1) as f64;
    let mut weights = vec![1.0; profiles.len()];
    let mut found = None;
    for _ in 0..ROUNDS {
        let whole = group(models, profiles, |i| weights[i]);
        let lobe = whole.best_among(models, model..model + 1)?;
        let deviances: Vec<f64> = profiles
            .par_iter()
            .map(|profile| profile.as_ref().map_or(0.0, |p| p.deviance(&lobe)))
            .collect();
        for (weight, deviance) in weights.iter_mut().zip(&deviances) {
            *weight = (NU + freedom) / (NU + deviance);
        }
        let score = |deviance: &f64| (NU + freedom) * (deviance / NU).ln_1p();
        found = Some((lobe, deviances.iter().map(score).sum()));
    }
    found
}

/// Gives every point with data the object's lobe.
///
/// Some points are not of the object's material, or are badly modelled: where two surfaces meet, or in a
/// pixel that shows a whole turn of the normal. Their deviances are hundreds, and would choose the lobe
/// for all. So points weigh as Student's t has it, and models are compared by it.
pub(super) fn pool(
    models: &[Model],
    profiles: &[Option<PointProfile>],
    estimates: &mut [Estimate],
) {
    let lobes: Vec<Option<(GroupLobe, f64)>> = (0..models.len())
        .map(|model| lobe_of(model, models, profiles))
        .collect();
    let best = lobes.iter().flatten().min_by(|a, b| a.1.total_cmp(&b.1));
    let Some((mut lobe, _)) = best.copied() else {
        return;
    };
    let form = models[lobe.model].form;
    let score = |ndf: Ndf| {
        let index = models.iter().position(|m| m.ndf == ndf && m.form == form)?;
        lobes[index].map(|(_, score)| score)
    };
    lobe.ndf_evidence = match (score(Ndf::Ggx), score(Ndf::Beckmann)) {
        (Some(ggx), Some(beckmann)) => (0.5 * (beckmann - ggx)) as f32,
        _ => f32::NAN,
    };
    estimates
        .par_iter_mut()
        .zip(profiles)
        .for_each(|(estimate, profile)| {
            if let Some(profile) = profile {
                profile.adopt(&lobe, models, estimate);
                estimate.material = Some(0);
            }
        });
}
