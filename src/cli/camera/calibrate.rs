//! `turnlight camera calibrate`.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::anyhow;
use rayon::prelude::*;
use serde_json::json;

use super::{COEFFICIENTS, Calibrate, folder_of};
use crate::cli::arguments::Common;
use crate::cli::failure::Failure;
use crate::cli::outputs::check_outputs;
use crate::cli::progress::{bar, note, say, write_stats, write_text};
use crate::image::RgbImage;
use crate::rig::{Board, BoardView, Calibration, CornerFile, Stop, calibrate};
use crate::scene::RigSections;

/// Photographs in memory at once: of 50 megapixels each, these are 3 GB.
const AT_ONCE: usize = 4;
/// Endings of files that are photographs when they stand in a folder.
const PHOTOGRAPHS: [&str; 7] = ["jpg", "jpeg", "png", "tif", "tiff", "exr", "hdr"];

pub(super) fn run(arguments: &Calibrate, common: &Common) -> Result<(), Failure> {
    check_outputs([
        ("--out", Some(arguments.out.as_path())),
        ("--report", arguments.report.as_deref()),
        ("--write-corners", arguments.write_corners.as_deref()),
    ])?;
    let seen = match (&arguments.corners, arguments.board) {
        (Some(file), _) => CornerFile::load(file)?,
        (None, Some(board)) => look(board, &photographs(&arguments.photographs)?, common)?,
        (None, None) => {
            return Err(Failure::Input(anyhow!(
                "--board: missing; give the inner corners of the board, such as --board 9x6"
            )));
        }
    };
    let size = (seen.width, seen.height);
    let found = calibrate(size, &seen.views, arguments.distortion.0)
        .map_err(|error| Failure::Data(error.into()))?;

    let remarks = remarks(&found);
    let text = RigSections {
        remarks: &remarks,
        lens: &found.lens,
        camera: None,
        turn: None,
        frames: &[],
    }
    .to_toml(folder_of(&arguments.out));
    if let Some(path) = &arguments.write_corners {
        write_text(path, &seen.to_json())?;
    }
    let report = report(&found);
    if let Some(path) = &arguments.report {
        let text = serde_json::to_string_pretty(&report).map_err(anyhow::Error::from)?;
        write_text(path, &text)?;
    }
    write_text(&arguments.out, &text)?;
    say(&table(&found));
    for fit in found.photographs.iter().filter(|fit| fit.outlier) {
        note(
            common,
            &format!(
                "note: {} disagrees with the others ({:.2} pixels, worst corner {:.2}): look for blur, a bent board or \
                 a wrong corner, and calibrate again without it",
                fit.name, fit.rms, fit.worst
            ),
        );
    }
    // Half of the cells: boards that fill less leave the distortion of the rest to extrapolation.
    if found.coverage < 0.5 {
        note(
            common,
            &format!(
                "note: the corners cover {:.0} % of the image; photograph the board near its edges, too",
                100.0 * found.coverage
            ),
        );
    }
    note(common, &format!("{}: written", arguments.out.display()));
    write_stats(common, &report)
}

/// The photographs named, folders opened, in the order of their names.
fn photographs(named: &[PathBuf]) -> Result<Vec<PathBuf>, Failure> {
    let mut all = Vec::new();
    for path in named {
        if !path.is_dir() {
            all.push(path.clone());
            continue;
        }
        let unreadable = |error: std::io::Error| {
            anyhow!(
                "{}: {error}; check the path and its permissions",
                path.display()
            )
        };
        let mut inside = Vec::new();
        for entry in std::fs::read_dir(path).map_err(unreadable)? {
            let file = entry.map_err(unreadable)?.path();
            let ending = file
                .extension()
                .map(|e| e.to_string_lossy().to_ascii_lowercase());
            if file.is_file() && ending.is_some_and(|e| PHOTOGRAPHS.contains(&e.as_str())) {
                inside.push(file);
            }
        }
        if inside.is_empty() {
            return Err(Failure::Input(anyhow!(
                "{}: no photographs here; name a folder of {} files",
                path.display(),
                PHOTOGRAPHS.join(", ")
            )));
        }
        inside.sort();
        all.extend(inside);
    }
    Ok(all)
}

/// Finds the board in each photograph; those that do not show it are told and left out.
fn look(board: Board, paths: &[PathBuf], common: &Common) -> Result<CornerFile, Failure> {
    let bar = bar(common, "corners", paths.len());
    let mut size = None;
    let mut views: Vec<BoardView> = Vec::new();
    let mut complaints = Vec::new();
    for chunk in paths.chunks(AT_ONCE) {
        let found: Vec<_> = chunk
            .par_iter()
            .map(|path| {
                let photograph = RgbImage::read(path)?;
                let name = path.file_name().unwrap_or(path.as_os_str());
                let view = board.find(&name.to_string_lossy(), &photograph);
                bar.inc(1);
                Ok(((photograph.width, photograph.height), view))
            })
            .collect::<Result<_, Failure>>()?;
        for (path, (this, view)) in chunk.iter().zip(found) {
            let (first, all) = size.get_or_insert((path, this));
            if *all != this {
                return Err(Failure::Input(anyhow!(
                    "{}: size = {} × {}: must be {} × {} as of {}; photographs of one camera, neither cropped \
                     nor turned",
                    path.display(),
                    this.0,
                    this.1,
                    all.0,
                    all.1,
                    first.display()
                )));
            }
            match view {
                Ok(view) => views.push(view),
                Err(error) => complaints.push(format!("{}: {error}", path.display())),
            }
        }
    }
    bar.finish_and_clear();
    for complaint in &complaints {
        note(common, &format!("note: left out: {complaint}"));
    }
    match (size, complaints.first()) {
        (_, Some(complaint)) if views.is_empty() => Err(Failure::Data(anyhow!(
            "none of {} photographs shows the board; {complaint}",
            paths.len()
        ))),
        (Some((_, (width, height))), _) => Ok(CornerFile {
            width,
            height,
            views,
        }),
        (None, _) => Err(Failure::Input(anyhow!(
            "no photographs; name files or a folder of them"
        ))),
    }
}

fn remarks(found: &Calibration) -> Vec<String> {
    let mut remarks = vec![format!(
        "turnlight camera calibrate: {} photographs, root mean square {:.4} pixels",
        found.photographs.len(),
        found.rms
    )];
    let deviations = found
        .deviations()
        .map(|(name, _, sigma)| format!("{name} ± {sigma:.2e}"));
    remarks.push(format!("standard deviations: {}", deviations.join(", ")));
    remarks
}

fn table(found: &Calibration) -> String {
    let mut text = String::new();
    let width = found
        .photographs
        .iter()
        .map(|fit| fit.name.chars().count())
        .max();
    let width = width.unwrap_or(0).max("photograph".len());
    // Writing to a String cannot fail.
    let _ = writeln!(text, "{:width$}  corners  rms px  worst px", "photograph");
    for fit in &found.photographs {
        let mark = if fit.outlier { "  outlier" } else { "" };
        let _ = writeln!(
            text,
            "{:width$}  {:7}  {:6.3}  {:8.3}{mark}",
            fit.name, fit.corners, fit.rms, fit.worst
        );
    }
    for (name, value, sigma) in found.deviations() {
        if COEFFICIENTS.contains(&name) {
            let _ = writeln!(text, "{name} = {value:.5} ± {sigma:.5}");
        } else {
            let _ = writeln!(text, "{name} = {value:.3} ± {sigma:.3} pixels");
        }
    }
    let _ = write!(text, "root mean square {:.4} pixels", found.rms);
    text
}

fn report(found: &Calibration) -> serde_json::Value {
    let photographs: Vec<_> = found
        .photographs
        .iter()
        .map(|fit| {
            let pose = fit.camera_from_board;
            json!({
                "name": fit.name,
                "corners": fit.corners,
                "rms_px": fit.rms,
                "worst_px": fit.worst,
                "outlier": fit.outlier,
                "camera_from_board": {
                    "rotation_columns": pose.matrix3.to_cols_array_2d(),
                    "translation_squares": pose.translation.to_array(),
                },
            })
        })
        .collect();
    let parameters: serde_json::Map<String, serde_json::Value> = found
        .deviations()
        .into_iter()
        .map(|(name, value, sigma)| (name.to_owned(), json!({ "value": value, "sigma": sigma })))
        .collect();
    let stop = match found.stop {
        Stop::Converged => "converged",
        Stop::SmallStep => "small step",
        Stop::IterationLimit => "iteration limit",
    };
    json!({
        "width": found.lens.width,
        "height": found.lens.height,
        "first_pixel_centre": 0.5,
        "parameters": parameters,
        "rms_px": found.rms,
        "largest_tilt_deg": found.largest_tilt.to_degrees(),
        "coverage": found.coverage,
        "stop": stop,
        "steps": found.steps,
        "photographs": photographs,
    })
}
