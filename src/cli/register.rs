//! `turnlight register`: a rough pose in, the object's and the turntable's place out.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::json;

use super::arguments::{Common, HoldName, MaskBorderName, RefineName, Register};
use super::failure::Failure;
use super::outputs::check_folder;
use super::progress::{bar, note, say, write_stats, write_text};
use crate::accel::Accel;
use crate::image::{Mask, RgbImage};
use crate::report::{RegistrationPage, registration_text, write_overlay, write_registration_page};
use crate::rig::registration::{
    MaskBorder, Observed, Placement, Registered, RegistrationError, Settings, Stop,
    pose_from_pairs, register, with_turntable_held,
};
use crate::scene::{Capture, CaptureFrame, ClickedPairs};

pub(super) fn run(arguments: &Register, common: &Common) -> Result<(), Failure> {
    let started = Instant::now();
    let capture = Capture::load(&arguments.capture)?;
    let source = source_file(&arguments.capture);
    let out = arguments
        .out
        .clone()
        .unwrap_or_else(|| source.with_file_name("registered"));
    refuse_to_write_over(&source, &out)?;
    check_folder("--out", &out)?;

    // Where to begin: the capture's own numbers, or what suits the clicked pairs.
    let mut start = capture.clone();
    if let Some(file) = &arguments.pairs {
        start_from_pairs(&mut start, file, common)?;
    }
    let (mesh, report) = start.object.load()?;
    if !report.to_string().trim().is_empty() {
        let path = capture.object.mesh.display();
        note(
            common,
            &format!("note: {path}: {}", report.to_string().trim()),
        );
    }
    let accel = Accel::build(&mesh.positions, &mesh.triangles);

    // What was seen.
    let (observed, border) = observe(&capture, arguments, common)?;
    let settings = Settings {
        turntable: arguments.refine != RefineName::Pose,
        angles: arguments.refine == RefineName::Angles,
        inner: arguments.edges,
        search: arguments.search,
        keep_unknown: arguments.keep_unknown,
    };
    let placement = placement(&start);
    let camera = &capture.camera;
    let registered = register(&mesh, &accel, camera, &placement, &observed, &settings)
        .map_err(|error| refused(&source, error))?;
    if registered.stop == Stop::IterationLimit {
        note(
            common,
            "note: the matches of outlines and borders went on changing; look at the overlays",
        );
    }

    // Write: pictures first, the capture last, so that a folder with capture.toml is complete.
    let result = placed(&capture, &registered, arguments.hold);
    let page = RegistrationPage {
        capture: &source.display().to_string(),
        registered: &registered,
        result: &result,
        settings: &settings,
        border,
        held: &held(arguments),
    };
    write(&out, &capture, &page, common)?;
    if arguments.in_place {
        let folder = source.parent().unwrap_or(Path::new(""));
        write_text(&source, &result.to_toml(folder))?;
    }
    say(registration_text(&page).trim_end());
    let seconds = started.elapsed().as_secs_f64();
    note(
        common,
        &format!("{}: written; {seconds:.1} s", out.display()),
    );
    write_stats(
        common,
        &json!({ "seconds": seconds, "rounds": registered.rounds, "registration": page.json() }),
    )
}

/// The capture.toml that `path` means.
fn source_file(path: &Path) -> PathBuf {
    if path.is_dir() {
        path.join("capture.toml")
    } else {
        path.to_path_buf()
    }
}

/// The file that was read is replaced only by `--in-place`.
fn refuse_to_write_over(source: &Path, out: &Path) -> Result<(), Failure> {
    let written = out.join("capture.toml").canonicalize().ok();
    if written.is_some() && written == source.canonicalize().ok() {
        return Err(Failure::Input(anyhow::anyhow!(
            "--out {}: {} would be written over; choose another --out, or say --in-place",
            out.display(),
            source.display()
        )));
    }
    Ok(())
}

fn placement(capture: &Capture) -> Placement {
    Placement {
        object_from_file: capture.object.object_from_file,
        turn: capture.turn,
        angles: capture.frames.iter().map(|frame| frame.angle).collect(),
    }
}

/// Replaces the object's pose by the one that suits the clicked pairs.
fn start_from_pairs(capture: &mut Capture, file: &Path, common: &Common) -> Result<(), Failure> {
    let clicked = ClickedPairs::load(file)?;
    let count = capture.frames.len();
    let Some(frame) = capture.frames.get(clicked.frame) else {
        return Err(Failure::Input(anyhow::anyhow!(
            "{}: frame = {}: the capture has frames 0 to {}; give one of these",
            file.display(),
            clicked.frame,
            count - 1
        )));
    };
    let found = pose_from_pairs(
        &capture.camera,
        &placement(capture),
        frame.angle,
        &clicked.pairs,
    )
    .map_err(|error| Failure::Data(anyhow::anyhow!("{}: {error}", file.display())))?;
    capture.object.object_from_file = found.object_from_file;
    note(
        common,
        &format!(
            "{}: {} pairs, {:.2} pixels off in the root mean square",
            file.display(),
            clicked.pairs.len(),
            found.rms
        ),
    );
    if found.ambiguous {
        note(
            common,
            &format!(
                "note: {}: another pose suits the pairs nearly as well; add pairs off their plane",
                file.display()
            ),
        );
    }
    Ok(())
}

/// Reads every frame's mask or photograph.
fn observe(
    capture: &Capture,
    arguments: &Register,
    common: &Common,
) -> Result<(Vec<Observed>, Option<MaskBorder>), Failure> {
    let mask = |frame: &CaptureFrame| -> Result<Option<Mask>, Failure> {
        let Some(path) = frame.mask.as_ref().filter(|_| !arguments.no_masks) else {
            return Ok(None);
        };
        let mask = Mask::read(path)?;
        check_size(capture, path, mask.width, mask.height)?;
        Ok(Some(mask))
    };
    let masks: Vec<Option<Mask>> = capture.frames.iter().map(mask).collect::<Result<_, _>>()?;
    let present: Vec<&Mask> = masks.iter().flatten().collect();
    let blank = |mask: &&&Mask| mask.pixels.iter().all(|&p| p < 128);
    if !present.is_empty() && present.iter().filter(blank).count() == present.len() {
        let first = capture.frames.iter().find_map(|frame| frame.mask.as_ref());
        return Err(Failure::Data(anyhow::anyhow!(
            "{}: no pixel of it or any other mask is 128 or more; a mask is 255 where the object is: write \
             them again, or use the photographs with --no-masks",
            first
                .map(|path| path.display().to_string())
                .unwrap_or_default()
        )));
    }
    let border = match arguments.mask_border {
        MaskBorderName::Auto => MaskBorder::of(&present),
        MaskBorderName::Coverage => MaskBorder::Coverage,
        MaskBorderName::Whole => MaskBorder::Whole,
        MaskBorderName::Half => MaskBorder::Half,
    };
    let used = (!present.is_empty()).then_some(border);

    // Photographs are read even if only the overlays show them: what cannot be read is said first.
    let bar = bar(common, "reading", capture.frames.len());
    let mut observed = Vec::with_capacity(masks.len());
    for (frame, mask) in capture.frames.iter().zip(&masks) {
        let photograph = RgbImage::read(&frame.image)?;
        check_size(capture, &frame.image, photograph.width, photograph.height)?;
        let needed = mask.is_none() || arguments.edges;
        observed.push(Observed::new(
            mask.as_ref().map(|mask| (mask, border)),
            needed.then_some(&photograph),
        ));
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok((observed, used))
}

fn check_size(capture: &Capture, path: &Path, width: usize, height: usize) -> Result<(), Failure> {
    let camera = &capture.camera;
    if (width, height) == (camera.width, camera.height) {
        return Ok(());
    }
    Err(Failure::Input(anyhow::anyhow!(
        "{}: is {width} x {height}, the camera {} x {}; resize neither: correct [camera] or take the right file",
        path.display(),
        camera.width,
        camera.height
    )))
}

/// What the data do not allow, with what helps.
fn refused(source: &Path, error: RegistrationError) -> Failure {
    let remedy = match &error {
        RegistrationError::Undetermined { .. } => {
            "; a symmetric object, or too few angles: add frames, use edges inside the outline (--edges), \
             refine less (--refine pose), or keep that as given (--keep-unknown)"
        }
        RegistrationError::NoBorder { .. } => " (--pairs, --search)",
        RegistrationError::OutOfView => " (--pairs)",
    };
    Failure::Data(anyhow::anyhow!("{}: {error}{remedy}", source.display()))
}

/// What no image tells and stays as given.
fn held(arguments: &Register) -> Vec<&'static str> {
    let mut held = match arguments.hold {
        HoldName::Camera => vec!["the camera's pose", "the centre's place along the axis"],
        HoldName::Turntable => {
            vec!["the turntable's axis and centre (standard deviations are relative to the camera)"]
        }
    };
    held.push("the camera's lens");
    held.push("the object's scale");
    match arguments.refine {
        RefineName::Pose => held.push("the turntable and all angles, which are not refined"),
        RefineName::Turntable => held.push("all angles, which are not refined"),
        RefineName::Angles => held.push("the first frame's angle"),
    }
    held
}

/// The capture with what was found.
fn placed(capture: &Capture, registered: &Registered, hold: HoldName) -> Capture {
    let found = &registered.placement;
    let (camera, placement) = match hold {
        HoldName::Camera => (capture.camera, found.clone()),
        HoldName::Turntable => with_turntable_held(&capture.camera, found, &capture.turn),
    };
    let mut result = capture.clone();
    result.camera = camera;
    result.turn = placement.turn;
    result.object.object_from_file = placement.object_from_file;
    for (frame, angle) in result.frames.iter_mut().zip(&placement.angles) {
        frame.angle = *angle;
    }
    result
}

fn write(
    out: &Path,
    capture: &Capture,
    page: &RegistrationPage<'_>,
    common: &Common,
) -> Result<(), Failure> {
    let overlays = out.join("overlays");
    std::fs::create_dir_all(&overlays).map_err(|source| Failure::write(&overlays, source))?;
    let bar = bar(common, "overlays", capture.frames.len());
    for (number, (frame, agreement)) in capture
        .frames
        .iter()
        .zip(&page.registered.frames)
        .enumerate()
    {
        let photograph = RgbImage::read(&frame.image)?;
        let path = overlays.join(format!("{number:04}.png"));
        write_overlay(&path, &photograph, agreement)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    write_registration_page(&out.join("register.html"), &overlays, page)?;
    let text = serde_json::to_string_pretty(&page.json()).map_err(anyhow::Error::from)?;
    write_text(&out.join("register.json"), &text)?;
    write_text(&out.join("capture.toml"), &page.result.to_toml(out))
}
