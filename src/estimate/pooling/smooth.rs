//! Neighbours that agree share their evidence; edges between materials stay.
//!
//! A point's group grows ring by ring over the surface. A neighbour joins if the group with it explains
//! the data about as well as the two apart: the likelihood-ratio statistic
//! `min S(group + j) − min S(group) − min S(j)` is χ² of as many degrees of freedom as a lobe has
//! parameters if both are of one material (Wilks 1938).

use std::collections::BTreeSet;

use rayon::prelude::*;

use super::profile::GroupLobe;
use super::{Estimate, Group, Model, PointProfile};

/// Rings of neighbours that may join: two are some 18 points of a triangle mesh, which cuts errors to
/// about a quarter; more would smear texture.
const RINGS: usize = 2;

/// Quantiles at 99 % of χ² of 1 to 5 degrees of freedom.
const CHI2_99: [f64; 5] = [6.63, 9.21, 11.34, 13.28, 15.09];

/// Gives every point with data the lobe of the group that grows from it.
pub(super) fn pool(
    models: &[Model],
    profiles: &[Option<PointProfile>],
    neighbours: &[Vec<u32>],
    estimates: &mut [Estimate],
) {
    let alone: Vec<Option<GroupLobe>> = profiles
        .par_iter()
        .map(|profile| {
            let mut group = Group::empty(models);
            group.add(profile.as_ref()?, 1.0);
            group.best(models)
        })
        .collect();
    let pooled: Vec<Option<GroupLobe>> = (0..profiles.len())
        .into_par_iter()
        .map(|i| grow(i, models, profiles, neighbours, &alone))
        .collect();
    for ((estimate, profile), lobe) in estimates.iter_mut().zip(profiles).zip(&pooled) {
        if let (Some(profile), Some(lobe)) = (profile, lobe) {
            profile.adopt(lobe, models, estimate);
        }
    }
}

/// The lobe of the group about point `i`.
fn grow(
    i: usize,
    models: &[Model],
    profiles: &[Option<PointProfile>],
    neighbours: &[Vec<u32>],
    alone: &[Option<GroupLobe>],
) -> Option<GroupLobe> {
    let mut group = Group::empty(models);
    group.add(profiles[i].as_ref()?, 1.0);
    let mut best = alone[i]?;
    let mut asked = BTreeSet::from([i]);
    let mut rim = vec![i];
    for _ in 0..RINGS {
        let ring: BTreeSet<usize> = rim
            .iter()
            .flat_map(|&j| neighbours[j].iter().map(|&k| k as usize))
            .filter(|j| !asked.contains(j))
            .collect();
        rim.clear();
        for j in ring {
            asked.insert(j);
            let (Some(profile), Some(own)) = (&profiles[j], &alone[j]) else {
                continue;
            };
            let mut larger = group.clone();
            larger.add(profile, 1.0);
            let Some(together) = larger.best(models) else {
                continue;
            };
            let loss = together.deviance - best.deviance - own.deviance;
            if loss <= CHI2_99[together.size] {
                (group, best) = (larger, together);
                rim.push(j);
            }
        }
    }
    Some(best)
}
