//! The object's materials: how many, and which point is of which.
//!
//! A mixture of M lobes, each point of one of them. Points are assigned and lobes are found anew in
//! turns, and a lobe is added as long as that lowers the criterion (Schwarz 1978)
//!
//! ```text
//! Σ_i min_m [ρ(S_i(lobe_m) − min S_i) − 2 ln π_m]  +  M (k + 2) ln N
//! ```
//!
//! with k the lobe's linear parameters, and alpha, NDF and share the rest. What a point's own best lobe
//! would gain enters through Student's `ρ(d) = (ν + k) ln(1 + d/ν)`, so that points which no material
//! explains, such as those at its borders, found none of their own. A point that says little of its lobe
//! goes with its neighbours (Potts 1952).

use rayon::prelude::*;

use super::object::group;
use super::profile::GroupLobe;
use super::{Estimate, Model, PointProfile};

/// No more materials than this: an object of which every point differs is not one for this pooling.
const MOST_MATERIALS: usize = 16;

/// Degrees of freedom of the deviances' tails.
const NU: f64 = 10.0;

/// A point whose deviance from its material is above this may found another: χ² of two degrees of
/// freedom exceeds it once in 400.
const SUSPICIOUS: f64 = 12.0;

/// Points that may found a material, and points that are asked what it would gain them.
const FOUNDERS: usize = 48;
const ASKED: usize = 2048;

/// Rounds of assignment; they settle in three to six.
const ROUNDS: usize = 12;

/// What a neighbour of another material costs: half of what evidence of e² to 1 does.
const BORDER: f64 = 1.0;

/// Rounds of neighbours' say.
const SWEEPS: usize = 4;

/// A material's lobe, and the share of points that are of it.
#[derive(Clone, Copy)]
struct Component {
    lobe: GroupLobe,
    share: f64,
}

/// Materials, and which point has which.
struct Segmentation {
    components: Vec<Component>,
    /// `[N]`; none without data.
    labels: Vec<Option<u32>>,
    criterion: f64,
}

/// Gives every point with data its material's lobe; returns the number of materials.
pub(super) fn pool(
    models: &[Model],
    profiles: &[Option<PointProfile>],
    neighbours: &[Vec<u32>],
    estimates: &mut [Estimate],
) -> u32 {
    let Some(lobe) = group(models, profiles, |_| 1.0).best(models) else {
        return 0;
    };
    let whole = vec![Component { lobe, share: 1.0 }];
    let mut best = settle(models, profiles, whole);
    while best.components.len() < MOST_MATERIALS {
        let Some(founder) = founder(models, profiles, &best) else {
            break;
        };
        let mut components = best.components.clone();
        let share = 1.0 / (components.len() + 1) as f64;
        components.push(Component {
            lobe: founder,
            share,
        });
        let next = settle(models, profiles, components);
        if next.criterion >= best.criterion {
            break;
        }
        best = next;
    }

    // Neighbours have a say, and the lobes are found once more.
    smooth_labels(profiles, neighbours, &mut best);
    let lobes = regroup(models, profiles, &best.labels, best.components.len());
    estimates
        .par_iter_mut()
        .zip(profiles)
        .zip(&best.labels)
        .for_each(|((estimate, profile), label)| {
            let lobe = label.and_then(|label| lobes[label as usize]);
            if let (Some(profile), Some(lobe)) = (profile, lobe) {
                profile.adopt(&lobe, models, estimate);
                estimate.material = *label;
            }
        });
    best.components.len() as u32
}

/// Student's measure of a deviance.
fn measure(deviance: f64, parameters: usize) -> f64 {
    (NU + parameters as f64) * (deviance / NU).ln_1p()
}

/// What a point costs in a material.
fn cost(profile: &PointProfile, component: &Component) -> f64 {
    let deviance = profile.deviance(&component.lobe);
    measure(deviance, component.lobe.size + 1) - 2.0 * component.share.ln()
}

/// The cheapest of costs, and its place.
fn cheapest(costs: impl Iterator<Item = f64>) -> (usize, f64) {
    costs.enumerate().fold((0, f64::INFINITY), |best, next| {
        if next.1 < best.1 { next } else { best }
    })
}

/// Each material's lobe by its points; none without any.
fn regroup(
    models: &[Model],
    profiles: &[Option<PointProfile>],
    labels: &[Option<u32>],
    materials: usize,
) -> Vec<Option<GroupLobe>> {
    (0..materials as u32)
        .map(|m| {
            let member = |i: usize| f64::from(u8::from(labels[i] == Some(m)));
            group(models, profiles, member).best(models)
        })
        .collect()
}

/// Assigns points and finds lobes in turns, and rates the outcome. Materials without points vanish.
fn settle(
    models: &[Model],
    profiles: &[Option<PointProfile>],
    mut components: Vec<Component>,
) -> Segmentation {
    let mut labels: Vec<Option<u32>> = Vec::new();
    let mut costs: Vec<f64> = Vec::new();
    let points = profiles.iter().flatten().count().max(1) as f64;
    for _ in 0..ROUNDS {
        let assigned: Vec<(Option<u32>, f64)> = profiles
            .par_iter()
            .map(|profile| match profile {
                Some(profile) => {
                    let (m, cost) = cheapest(components.iter().map(|c| cost(profile, c)));
                    (Some(m as u32), cost)
                }
                None => (None, 0.0),
            })
            .collect();
        let next: Vec<Option<u32>> = assigned.iter().map(|a| a.0).collect();
        costs = assigned.iter().map(|a| a.1).collect();
        if next == labels {
            break;
        }
        labels = next;
        let lobes = regroup(models, profiles, &labels, components.len());
        components = (0u32..)
            .zip(lobes)
            .filter_map(|(m, lobe)| {
                let members = labels.iter().filter(|label| **label == Some(m)).count();
                Some(Component {
                    lobe: lobe?,
                    share: members as f64 / points,
                })
            })
            .collect();
    }
    let parameters: usize = components.iter().map(|c| c.lobe.size + 3).sum();
    Segmentation {
        criterion: costs.iter().sum::<f64>() + parameters as f64 * points.ln(),
        components,
        labels,
    }
}

/// The lobe of a single point that would gain most if it were a material.
fn founder(
    models: &[Model],
    profiles: &[Option<PointProfile>],
    segmentation: &Segmentation,
) -> Option<GroupLobe> {
    let components = &segmentation.components;
    let own = |i: usize| {
        let label = segmentation.labels[i]? as usize;
        let profile = profiles[i].as_ref()?;
        Some((profile, cost(profile, &components[label])))
    };
    let suspicious: Vec<usize> = (0..profiles.len())
        .into_par_iter()
        .filter(|&i| {
            let label = segmentation.labels[i].map(|label| label as usize);
            profiles[i]
                .as_ref()
                .zip(label)
                .is_some_and(|(p, m)| p.deviance(&components[m].lobe) > SUSPICIOUS)
        })
        .collect();
    let step = |count: usize, wanted: usize| count.div_ceil(wanted).max(1);
    let asked: Vec<(&PointProfile, f64)> = suspicious
        .iter()
        .step_by(step(suspicious.len(), ASKED))
        .filter_map(|&i| own(i))
        .collect();
    let share = 1.0 / (components.len() + 1) as f64;
    let rated: Vec<(f64, Option<GroupLobe>)> = suspicious
        .par_iter()
        .step_by(step(suspicious.len(), FOUNDERS))
        .map(|&i| {
            let lobe = group(models, &profiles[i..=i], |_| 1.0).best(models);
            let gain = lobe.map_or(0.0, |lobe| {
                let component = Component { lobe, share };
                let gains = asked
                    .iter()
                    .map(|(profile, now)| (now - cost(profile, &component)).max(0.0));
                gains.sum()
            });
            (gain, lobe)
        })
        .collect();
    let mut best = (0.0, None);
    for candidate in rated {
        if candidate.0 > best.0 {
            best = candidate;
        }
    }
    best.1
}

/// Each point's cheapest material when every neighbour of another costs something; point after point, a
/// few times over.
fn smooth_labels(
    profiles: &[Option<PointProfile>],
    neighbours: &[Vec<u32>],
    segmentation: &mut Segmentation,
) {
    let components = &segmentation.components;
    let costs: Vec<Vec<f64>> = profiles
        .par_iter()
        .map(|profile| {
            let costs = |p: &PointProfile| components.iter().map(|c| cost(p, c)).collect();
            profile.as_ref().map_or_else(Vec::new, costs)
        })
        .collect();
    let labels = &mut segmentation.labels;
    for _ in 0..SWEEPS {
        for i in 0..labels.len() {
            if labels[i].is_none() {
                continue;
            }
            let with_borders = costs[i].iter().enumerate().map(|(m, cost)| {
                let others = neighbours[i]
                    .iter()
                    .filter(|&&j| labels[j as usize].is_some_and(|other| other as usize != m));
                cost + 2.0 * BORDER * others.count() as f64
            });
            labels[i] = Some(cheapest(with_borders).0 as u32);
        }
    }
}
