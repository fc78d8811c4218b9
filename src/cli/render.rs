//! `turnlight render`.

use std::time::Instant;

use serde_json::json;

use super::arguments::{Common, Render, Sampling};
use super::failure::Failure;
use super::progress::{bar, note, write_stats};
use crate::render::{
    FrameSettings, PathCount, RenderStats, SequenceSettings, Skips, Stage, render_sequence,
};
use crate::scene::Scene;

pub(super) fn run(arguments: &Render, common: &Common) -> Result<(), Failure> {
    let scene = Scene::load(&arguments.scene)?;
    let settings = sequence_settings(&arguments.sampling, &arguments.out, arguments.aovs);
    let started = Instant::now();
    let stats = sequence(&scene, &settings, common)?;
    let seconds = started.elapsed().as_secs_f64();
    note(
        common,
        &format!("{}: rendered in {seconds:.1} s", arguments.out.display()),
    );
    write_stats(common, &json!({ "seconds": seconds, "render": stats }))
}

/// The checked plan of a sequence.
pub(super) fn sequence_settings(
    sampling: &Sampling,
    out: &std::path::Path,
    aovs: bool,
) -> SequenceSettings {
    SequenceSettings {
        out: out.to_owned(),
        frame: FrameSettings {
            paths: match sampling.target_error {
                Some(error) => PathCount::TargetError(error),
                None => PathCount::PerPixel(sampling.spp),
            },
            // Edges of a path: the camera's, one between surfaces, and the light's.
            bounces: sampling.max_depth - 1,
            seed: sampling.seed,
            skips: sampling
                .no_skip
                .iter()
                .fold(Skips::ALL, |skips, &skip| skips.without(skip)),
        },
        frames: sampling.frames.clone(),
        resume: sampling.resume,
        aovs,
    }
}

/// Loads and renders a scene, with warnings and a progress bar.
pub(super) fn sequence(
    scene: &Scene,
    settings: &SequenceSettings,
    common: &Common,
) -> Result<RenderStats, Failure> {
    let (stage, warnings) = Stage::load(scene)?;
    warnings
        .iter()
        .for_each(|warning| note(common, &format!("note: {warning}")));
    let count = settings
        .frames
        .as_ref()
        .map_or(scene.angles.len(), ExactSizeIterator::len);
    let bar = bar(common, "rendering", count);
    let stats = render_sequence(scene, &stage, settings, &|_| bar.inc(1))?;
    bar.finish_and_clear();
    Ok(stats)
}
