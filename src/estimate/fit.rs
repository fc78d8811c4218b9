//! All points: visibility once, then rounds of fitting with the object's own light.

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;

use super::columns::{Columns, ForwardModel, Scratch};
use super::gloss::Gloss;
use super::interreflection::{self, Glow};
use super::visibility::Visibility;
use super::{Estimate, Estimator, FitSettings, Status, full, gradient};
use crate::accel::Accel;
use crate::mesh::Mesh;
use crate::probe::LightPyramid;
use crate::traces::{Trace, TraceSet};

/// What a fit cost and found, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FitStats {
    /// Points asked for.
    pub points: u64,
    /// Points seen at least once; only these are fitted.
    pub seen: u64,
    /// Points whose hemisphere is open: no occlusion, no interreflection.
    pub open: u64,
    /// Rays traced for visibility.
    pub visibility_rays: u64,
    /// Observations for which traces were modelled, over all rounds.
    pub observations: u64,
}

/// Fits every point. Points are independent given the object's own light; results come in their
/// order and do not depend on the number of threads. `on_points` hears how many points are done.
pub fn fit(
    traces: &TraceSet,
    pyramid: &LightPyramid,
    mesh: &Mesh,
    accel: &Accel,
    settings: &FitSettings,
    on_points: &(dyn Fn(usize) + Sync),
) -> (Vec<Estimate>, FitStats) {
    let mut stats = FitStats {
        points: traces.traces.len() as u64,
        ..FitStats::default()
    };
    let paper = settings.estimator == Estimator::Gradient;
    let model = ForwardModel {
        pyramid,
        diffuse_nodes: ForwardModel::diffuse_nodes(pyramid, ForwardModel::DIFFUSE_NODES),
        world_from_object: &traces.world_from_object,
        eta: settings.eta,
        light_nodes: settings.light_nodes,
        window_cos: paper.then(|| settings.window.cos()),
        footprints: !paper,
    };

    // What each point sees, for all frames at once. A point that is never seen still reflects
    // light onto others, but only if interreflection is asked for.
    let rounds = if paper { 0 } else { settings.interreflections };
    let needed = |trace: &Trace| !paper && (rounds > 0 || !trace.observations.is_empty());
    let (visibilities, rays): (Vec<Visibility>, Vec<u64>) = traces
        .traces
        .par_iter()
        .map(|trace| {
            if needed(trace) {
                let (position, normal) = trace.middle();
                Visibility::trace(mesh, accel, position, normal)
            } else {
                (Visibility::Open, 0)
            }
        })
        .unzip();
    stats.visibility_rays = rays.iter().sum();
    stats.seen = traces
        .traces
        .iter()
        .filter(|t| !t.observations.is_empty())
        .count() as u64;
    stats.open = visibilities
        .iter()
        .filter(|v| matches!(v, Visibility::Open))
        .count() as u64;
    let any_blocked = visibilities.iter().any(|v| !v.blocked().is_empty());

    let fresh = || (Scratch::default(), Columns::default());
    let fit_point =
        |trace: &Trace, index: usize, glow: Option<&Glow<'_>>, memory: &mut (Scratch, Columns)| {
            let (scratch, columns) = memory;
            model.columns(trace, &visibilities[index], glow, scratch, columns);
            match settings.estimator {
                Estimator::Full => full::estimate(trace, columns, settings, traces.noise_is_known),
                Estimator::Gradient => gradient::estimate(trace, columns, settings),
            }
        };

    // The object's own light, from albedos by one observation a frame: its error is that of a few
    // per cent of the light.
    let (gloss, direct, normals);
    let scene;
    let mut glow = None;
    if any_blocked && rounds > 0 {
        gloss = Gloss::new(pyramid, settings.eta);
        direct = irradiance(&model, traces, &visibilities);
        normals = traces
            .traces
            .iter()
            .map(|t| t.point.normal)
            .collect::<Vec<_>>();
        scene = interreflection::Scene {
            visibilities: &visibilities,
            normals: &normals,
            points_of_triangle: &traces.points_of_triangle,
            world_from_object: &traces.world_from_object,
            gloss: &gloss,
            irradiance: &direct,
        };
        let nearest: Vec<Trace> = traces.traces.iter().map(Trace::nearest).collect();
        let mut estimates = vec![Estimate::without_data(Status::Unseen, 0); nearest.len()];
        for round in 0..rounds {
            // Later rounds change only what sees the object.
            let again = |index: usize| round == 0 || !visibilities[index].blocked().is_empty();
            stats.observations += (0..nearest.len())
                .filter(|&index| again(index))
                .map(|index| nearest[index].observations.len() as u64)
                .sum::<u64>();
            estimates
                .par_iter_mut()
                .enumerate()
                .filter(|(index, _)| again(*index))
                .for_each_init(fresh, |memory, (index, estimate)| {
                    *estimate = fit_point(&nearest[index], index, glow.as_ref(), memory);
                });
            glow = Some(Glow::new(&scene, &estimates, glow.as_ref()));
        }
    }

    // All observations, once, in that light.
    stats.observations += traces
        .traces
        .iter()
        .map(|t| t.observations.len() as u64)
        .sum::<u64>();
    let estimates = traces
        .traces
        .par_iter()
        .enumerate()
        .map_init(fresh, |memory, (index, trace)| {
            let estimate = match settings.estimator {
                Estimator::Full => fit_point(trace, index, glow.as_ref(), memory),
                Estimator::Gradient => fit_point(&trace.nearest(), index, None, memory),
            };
            on_points(1);
            estimate
        })
        .collect();
    (estimates, stats)
}

/// Irradiance over π from the light alone, `[frame · points + point]`.
fn irradiance(
    model: &ForwardModel<'_>,
    traces: &TraceSet,
    visibilities: &[Visibility],
) -> Vec<Vec3> {
    let points = traces.traces.len();
    (0..points * traces.world_from_object.len())
        .into_par_iter()
        .map_init(Scratch::default, |scratch, i| {
            let (frame, point) = (i / points, i % points);
            let normal = traces.traces[point].point.normal;
            model.irradiance(frame, normal, &visibilities[point], scratch)
        })
        .collect()
}
