//! All points: visibility once, then rounds of fitting with the object's own light.

use std::borrow::Cow;

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;

use super::columns::Columns;
use super::forward_model::{ForwardModel, Scratch};
use super::gloss::Gloss;
use super::interreflection::{self, Glow};
use super::model_choice::Shares;
use super::noise::NoiseModel;
use super::pooling::{self, PointProfile};
use super::problem::Model;
use super::representatives::representatives;
use super::tabulated::{Known, TabulatedNdf, tabulate};
use super::unknown_light::{EstimatedLight, estimate_light};
use super::visibility::Visibility;
use super::{
    Estimate, Estimator, FitSettings, Pooling, Status, appearance, full, gradient, refraction,
};
use crate::accel::Accel;
use crate::brdf::Appearance;
use crate::probe::SplitLight;
use crate::traces::{Trace, TraceSet};

/// Points whose residuals measure the noise.
const NOISE_SAMPLE: usize = 512;
/// Frames of a point, evenly chosen, by which the object's own light is predicted. Its albedo is then known
/// to a per cent or two, and of the light on a point a tenth comes from others.
const FIRST_FRAMES: usize = 16;
/// How far the normals of pixels may spread that are joined, over the roughness: a lobe is then widened by
/// 4 %, which is known to a tenth of that.
const JOINED_SPREAD: f32 = 0.2;
/// And how far at most, radians: what is not known of a lobe so widened (`noise::FOOTPRINT_ERROR`) then stays
/// below 0.2 % of the light, far below a sensor's noise.
const LARGEST_SPREAD: f32 = 0.014;

/// What a fit cost and found, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FitStats {
    /// Points asked for.
    pub points: u64,
    /// Points seen at least once; only these are fitted.
    pub seen: u64,
    /// Points whose hemisphere is open, or was not asked for: no occlusion, no interreflection.
    pub open: u64,
    /// Points whose lobe the data do not determine well enough; they are rendered with their
    /// neighbours'.
    pub borrowed: u64,
    /// Materials found, where points were pooled by them.
    pub materials: u64,
    /// Rays traced for visibility.
    pub visibility_rays: u64,
    /// Observations for which traces were modelled, over all rounds.
    pub observations: u64,
}

/// What a fit found.
#[derive(Clone, Debug)]
pub struct Fit {
    /// `[N]` every point on its own.
    pub estimates: Vec<Estimate>,
    /// `[N]` parameters without gaps, to render with.
    pub appearance: Vec<Appearance>,
    /// Index of refraction of the appearance's Fresnel term; none where it is Schlick's.
    pub eta: Option<f32>,
    /// The light, where it was not taken as known.
    pub light: Option<EstimatedLight>,
    /// NDFs without a formula, where they were asked for.
    pub tabulated: Option<TabulatedNdf>,
    /// Counts.
    pub stats: FitStats,
}

/// Fits every point. Results come in the points' order and do not depend on the number of threads.
/// `neighbours` are the points beside each; `on_points` hears how many points are done.
pub fn fit(
    traces: &TraceSet,
    neighbours: &[Vec<u32>],
    light: &SplitLight,
    accel: &Accel,
    settings: &FitSettings,
    on_points: &(dyn Fn(usize) + Sync),
) -> Fit {
    let paper = settings.estimator != Estimator::Full;
    let estimated = match settings.estimator {
        Estimator::UnknownLight => Some(estimate_light(traces, light, settings)),
        Estimator::Full | Estimator::Gradient => None,
    };
    let split = estimated.as_ref().and_then(EstimatedLight::split);
    let light = split.as_ref().unwrap_or(light);
    let rotations = &traces.world_from_object;
    let model = ForwardModel::new(light, rotations, settings.fresnel, settings.light_nodes);
    let model = if paper {
        model.of_the_paper(settings.window)
    } else {
        model
    };
    let stats = FitStats {
        points: traces.traces.len() as u64,
        seen: count(traces.traces.iter(), |t| !t.observations.is_empty()),
        ..FitStats::default()
    };
    if paper {
        Fit {
            light: estimated,
            ..fit_by_gradient(traces, neighbours, &model, settings, stats, on_points)
        }
    } else {
        fit_in_full(
            traces, neighbours, &model, accel, settings, stats, on_points,
        )
    }
}

fn count<T>(items: impl Iterator<Item = T>, is: impl Fn(&T) -> bool) -> u64 {
    items.filter(is).count() as u64
}

fn observations<'a>(traces: impl Iterator<Item = &'a Trace>) -> u64 {
    traces.map(|t| t.observations.len() as u64).sum()
}

/// Working memory of a thread.
fn memory() -> (Scratch, Columns) {
    (Scratch::default(), Columns::default())
}

/// The paper: one observation a frame, no self-shadowing.
fn fit_by_gradient(
    traces: &TraceSet,
    neighbours: &[Vec<u32>],
    model: &ForwardModel<'_>,
    settings: &FitSettings,
    mut stats: FitStats,
    on_points: &(dyn Fn(usize) + Sync),
) -> Fit {
    let estimates: Vec<Estimate> = traces
        .traces
        .par_iter()
        .map_init(memory, |(scratch, columns), trace| {
            let nearest = trace.nearest();
            model.columns(&nearest, &Visibility::Open, None, scratch, columns);
            on_points(1);
            gradient::estimate(&nearest, columns, settings)
        })
        .collect();
    stats.observations = traces.traces.iter().map(|t| u64::from(t.frames())).sum();
    let mut appearance = appearance::lobes(&estimates, neighbours);
    let rho_d: Vec<Option<Vec3>> = estimates
        .iter()
        .map(|e| e.diffuse_is_known().then_some(e.rho_d))
        .collect();
    appearance::complete(&mut appearance, &rho_d, neighbours);
    Fit {
        estimates,
        appearance,
        eta: settings.fresnel.eta(),
        tabulated: None,
        light: None,
        stats,
    }
}

/// Variable projection with visibility, noise weights and the object's own light.
fn fit_in_full(
    traces: &TraceSet,
    neighbours: &[Vec<u32>],
    model: &ForwardModel<'_>,
    accel: &Accel,
    settings: &FitSettings,
    mut stats: FitStats,
    on_points: &(dyn Fn(usize) + Sync),
) -> Fit {
    // What each point sees, for all frames at once. A point that is never seen still reflects
    // light onto others, but only if interreflection is asked for.
    let needed = |trace: &Trace| settings.interreflections > 0 || !trace.observations.is_empty();
    let (visibilities, rays): (Vec<Visibility>, Vec<u64>) = traces
        .traces
        .par_iter()
        .map(|trace| {
            if needed(trace) {
                let (position, normal) = trace.middle();
                Visibility::trace(accel, &traces.surface, position, normal)
            } else {
                (Visibility::Open, 0)
            }
        })
        .unzip();
    stats.visibility_rays = rays.iter().sum();
    stats.open = count(visibilities.iter(), |v| matches!(v, Visibility::Open));
    let concave = |index: usize| !visibilities[index].blocked().is_empty();
    let any_concave = (0..visibilities.len()).any(concave);

    // A first fit of some points by one observation a frame and a quarter of the light nodes, in rounds:
    // it predicts the object's own light, for which errors of some per cent do not matter.
    let coarse = model.with_nodes(settings.light_nodes / 4);
    let own_light = any_concave && settings.interreflections > 0;
    let gloss = own_light.then(|| Gloss::new(model.light, settings.fresnel));
    let normals: Vec<Vec3> = traces.traces.iter().map(|t| t.point.normal).collect();
    let direct = if own_light {
        irradiance(model, traces, &visibilities)
    } else {
        Vec::new()
    };
    let scene = gloss.as_ref().map(|gloss| interreflection::Scene {
        visibilities: &visibilities,
        normals: &normals,
        points_of_triangle: &traces.points_of_triangle,
        world_from_object: &traces.world_from_object,
        gloss,
        irradiance: &direct,
    });
    let models = settings.models();
    let even = Shares::even(&models);
    let mut noise = NoiseModel::independent(traces.noise_is_known);
    let mut glow = None;
    let sampled: Vec<Trace> = (traces.traces.iter())
        .map(|trace| trace.sample(FIRST_FRAMES))
        .collect();
    let stands = representatives(&sampled, neighbours);
    let mut first = vec![(Estimate::without_data(Status::Unseen, 0), Vec::new()); sampled.len()];
    let rounds = if own_light {
        settings.interreflections
    } else {
        1
    };
    for round in 0..rounds {
        // Later rounds change only what sees the object.
        let stands_for_itself = |index: usize| stands[index] as usize == index;
        let again = |index: usize| stands_for_itself(index) && (round == 0 || concave(index));
        let fitted = (0..sampled.len()).filter(|&index| again(index));
        stats.observations += observations(fitted.map(|index| &sampled[index]));
        first
            .par_iter_mut()
            .enumerate()
            .filter(|(index, _)| again(*index))
            .for_each_init(memory, |(scratch, columns), (index, first)| {
                let trace = &sampled[index];
                coarse.columns(trace, &visibilities[index], glow.as_ref(), scratch, columns);
                let candidates = full::estimate(trace, columns, &models, &noise);
                let choice = even.choose(&candidates);
                let residuals = full::residuals(trace, columns, choice.candidate);
                *first = (choice.estimate, residuals);
            });
        let residuals: Vec<Vec3> = first.iter().flat_map(|(_, r)| r).copied().collect();
        noise = NoiseModel::of_residuals(&residuals, traces.noise_is_known);
        if let Some(scene) = &scene {
            let eta = settings.fresnel.eta();
            let estimates: Vec<Estimate> = (stands.iter())
                .map(|&index| first[index as usize].0.under(eta))
                .collect();
            glow = Some(Glow::new(scene, &estimates, glow.as_ref()));
        }
    }

    // All observations, once, in that light. The noise of pixels that a sensor's model knows is
    // independent, so that those may be joined which a point's lobe cannot tell apart.
    let joined: Vec<Cow<'_, Trace>> = (traces.traces.par_iter().zip(&stands))
        .map(|(trace, &index)| {
            let least_alpha = least_alpha(&first[index as usize].0);
            let spread = (JOINED_SPREAD * least_alpha).min(LARGEST_SPREAD);
            let joined = traces.noise_is_known.then(|| trace.joined(spread));
            joined.map_or(Cow::Borrowed(trace), Cow::Owned)
        })
        .collect();

    // The noise that counts is that of the full model.
    let step = joined.len().div_ceil(NOISE_SAMPLE).max(1);
    let (residuals, some): (Vec<Vec<Vec3>>, Vec<Vec<full::Candidate>>) = joined
        .par_iter()
        .zip(&visibilities)
        .step_by(step)
        .map_init(memory, |(scratch, columns), (trace, visibility)| {
            model.columns(trace, visibility, glow.as_ref(), scratch, columns);
            let candidates = full::estimate(trace, columns, &models, &noise);
            let residuals = full::residuals(trace, columns, even.choose(&candidates).candidate);
            (residuals, candidates)
        })
        .unzip();
    noise = NoiseModel::of_residuals(&residuals.concat(), traces.noise_is_known);
    let further = refraction::between(&models, some.iter().map(Vec::as_slice));
    let models = Model::with_dielectrics(&models, &further);
    stats.observations += observations(joined.iter().map(Cow::as_ref).step_by(step));

    stats.observations += observations(joined.iter().map(Cow::as_ref));
    let pooled = settings.pool != Pooling::None;
    let candidates: Vec<Vec<full::Candidate>> = joined
        .par_iter()
        .zip(&visibilities)
        .map_init(memory, |(scratch, columns), (trace, visibility)| {
            model.columns(trace, visibility, glow.as_ref(), scratch, columns);
            on_points(1);
            let mut candidates = full::estimate(trace, columns, &models, &noise);
            if !pooled {
                candidates.iter_mut().for_each(|c| c.table = None);
            }
            candidates
        })
        .collect();
    let shares = Shares::of(&models, candidates.iter().map(Vec::as_slice));
    let mut estimates: Vec<Estimate> = candidates
        .iter()
        .map(|candidates| shares.choose(candidates).estimate)
        .collect();
    if pooled {
        stats.materials = pool_lobes(candidates, &shares, neighbours, settings, &mut estimates);
    }

    let tabulated = settings.tabulated.then(|| {
        let known = Known {
            traces,
            visibilities: &visibilities,
            model,
            glow: glow.as_ref(),
            noise: &noise,
            models: &models,
            estimates: &estimates,
        };
        tabulate(&known, settings.pool)
    });

    // Points without a lobe of their own get another, and an albedo that goes with it.
    // An object is rendered under the Fresnel term of most of its points.
    let (form, eta) = shares.commonest_fresnel();
    let alike: Vec<Estimate> = estimates.iter().map(|e| e.under(eta)).collect();
    let mut appearance = appearance::lobes(&alike, neighbours);
    stats.borrowed = count(estimates.iter(), |e| !e.lobe_is_known());
    let rho_d: Vec<Option<Vec3>> = alike
        .par_iter()
        .enumerate()
        .map_init(memory, |(scratch, columns), (index, estimate)| {
            if estimate.lobe_is_known() {
                return estimate.diffuse_is_known().then_some(estimate.rho_d);
            }
            let (trace, look) = (&sampled[index], &appearance[index]);
            coarse.columns(trace, &visibilities[index], glow.as_ref(), scratch, columns);
            full::diffuse_beside(trace, columns, &noise, look, form)
        })
        .collect();
    appearance::complete(&mut appearance, &rho_d, neighbours);
    Fit {
        estimates,
        appearance,
        eta,
        tabulated,
        light: None,
        stats,
    }
}

/// The least roughness, within two standard deviations, that a first estimate leaves.
fn least_alpha(estimate: &Estimate) -> f32 {
    estimate.alpha * (-2.0 * estimate.sigma_alpha / estimate.alpha).exp()
}

/// Pools lobes of the form that most points have; returns the number of materials, if they were counted.
fn pool_lobes(
    candidates: Vec<Vec<full::Candidate>>,
    shares: &Shares,
    neighbours: &[Vec<u32>],
    settings: &FitSettings,
    estimates: &mut [Estimate],
) -> u64 {
    let models = shares.of_commonest_form();
    let profiles: Vec<Option<PointProfile>> = candidates
        .into_par_iter()
        .map(|candidates| {
            let tables: Vec<_> = candidates
                .iter()
                .filter(|c| models.contains(&c.model))
                .filter_map(|c| Some((c.table.as_ref()?, &c.estimate, c.ln_likelihood)))
                .collect();
            (tables.len() == models.len()).then(|| PointProfile::new(tables.into_iter()))
        })
        .collect();
    let materials = pooling::pool(settings.pool, &models, &profiles, neighbours, estimates);
    materials.map_or(0, u64::from)
}

/// Irradiance over π from the light alone, `[point · frames + frame]`.
fn irradiance(
    model: &ForwardModel<'_>,
    traces: &TraceSet,
    visibilities: &[Visibility],
) -> Vec<Vec3> {
    let frames = traces.world_from_object.len();
    (0..frames * traces.traces.len())
        .into_par_iter()
        .map_init(Scratch::default, |scratch, i| {
            let (point, frame) = (i / frames, i % frames);
            let normal = traces.traces[point].point.normal;
            model.irradiance(frame, normal, &visibilities[point], scratch)
        })
        .collect()
}
