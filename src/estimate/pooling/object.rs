//! One lobe for the whole object.

use rayon::prelude::*;

use super::{Estimate, Group, Model, PointProfile};

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

/// Gives every point with data the object's lobe.
pub(super) fn pool(
    models: &[Model],
    profiles: &[Option<PointProfile>],
    estimates: &mut [Estimate],
) {
    let Some(lobe) = group(models, profiles, |_| 1.0).best(models) else {
        return;
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
