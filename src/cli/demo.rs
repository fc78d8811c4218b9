//! `turnlight demo`: the whole job on a scene that ships with the program.
//!
//! Render a painted head on a turntable with sensor noise, fit it, render the estimate, compare,
//! and write one page about it. The scene is compiled in, so the demo runs from anywhere.

use std::path::Path;
use std::time::Instant;

use clap::Parser;
use serde_json::json;

use super::arguments::{Cli, Command, Common, Demo, Sampling};
use super::failure::Failure;
use super::fit::fit_capture;
use super::progress::{note, say, write_stats};
use super::render::{sequence, sequence_settings};
use super::reproduce::fitted_scene;
use crate::compare::compare_sequences;
use crate::image::write_atomically;
use crate::report::write_report;
use crate::scene::{Capture, Scene};

/// The shipped scene, file by file, in the layout of `scenes/`.
const FILES: [(&str, &[u8]); 3] = [
    (
        "suzanne-painted/scene.toml",
        include_bytes!("../../scenes/suzanne-painted/scene.toml"),
    ),
    (
        "meshes/suzanne-painted.ply",
        include_bytes!("../../scenes/meshes/suzanne-painted.ply"),
    ),
    (
        "probes/courtyard.exr",
        include_bytes!("../../scenes/probes/courtyard.exr"),
    ),
];

pub(super) fn run(arguments: &Demo, common: &Common) -> Result<(), Failure> {
    let out = &arguments.out;
    let started = Instant::now();
    let lap = |step: &str| {
        note(
            common,
            &format!("{:5.1} s  {step}", started.elapsed().as_secs_f64()),
        );
    };

    for (name, bytes) in FILES {
        let path = out.join("scenes").join(name);
        write_file(&path, bytes)?;
    }
    let scene = Scene::load(out.join("scenes/suzanne-painted/scene.toml"))?;
    let (capture_folder, fit_folder) = (out.join("capture"), out.join("fit"));
    let reproduced = out.join("reproduced");
    let sampling = Sampling {
        target_error: None,
        no_skip: Vec::new(),
        spp: 100,
        max_depth: 6,
        seed: 0,
        frames: None,
        resume: true,
    };

    lap("rendering the turntable sequence");
    sequence(
        &scene,
        &sequence_settings(&sampling, &capture_folder, false),
        common,
    )?;

    lap("fitting every vertex");
    let capture = Capture::load(&capture_folder)?;
    let choices = default_choices(&capture_folder, &fit_folder)?;
    fit_capture(&capture, &capture_folder, &fit_folder, &choices, common)?;

    lap("rendering the estimate");
    // A reproduction depends on the fit, so it is made anew.
    remove(&reproduced)?;
    let estimate = fitted_scene(&fit_folder)?;
    sequence(
        &estimate,
        &sequence_settings(&sampling, &reproduced, false),
        common,
    )?;

    lap("comparing");
    let errors = compare_sequences(&capture_folder, &reproduced, None)?;
    say(&errors.to_string());

    lap("writing the report");
    let page = out.join("report.html");
    write_report(&fit_folder, Some(&reproduced), &page)?;
    let seconds = started.elapsed().as_secs_f64();
    note(
        common,
        &format!("{seconds:5.1} s  done: open {}", page.display()),
    );
    write_stats(common, &json!({ "seconds": seconds, "comparison": errors }))
}

/// What `turnlight fit CAPTURE --out FIT` would choose.
fn default_choices(capture: &Path, out: &Path) -> Result<super::arguments::FitChoices, Failure> {
    let typed: [&std::ffi::OsStr; 5] = [
        "turnlight".as_ref(),
        "fit".as_ref(),
        capture.as_os_str(),
        "--out".as_ref(),
        out.as_os_str(),
    ];
    match Cli::try_parse_from(typed)
        .map_err(anyhow::Error::from)?
        .command
    {
        Command::Fit(fit) => Ok(fit.choices),
        _ => Err(Failure::Input(anyhow::anyhow!(
            "the fit command changed its name"
        ))),
    }
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    let write = || {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        write_atomically(path, |file| std::io::Write::write_all(file, bytes))
    };
    write().map_err(|source| Failure::write(path, source))
}

fn remove(folder: &Path) -> Result<(), Failure> {
    match std::fs::remove_dir_all(folder) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(Failure::write(folder, source))
        }
        _ => Ok(()),
    }
}
