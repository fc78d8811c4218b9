//! Folders that turnlight writes and reads again: fits, and sequences that were interrupted.

use std::path::Path;

use turnlight::export::PointTable;
use turnlight::render::{
    FrameSettings, PathCount, SequenceSettings, Skips, Stage, render_sequence,
};
use turnlight::report::write_report;
use turnlight::scene::Scene;

use super::mutate::Form;
use super::room::FLAT;
use super::scenes::named;
use super::{Outcome, Parser, fuzz, seeds};

/// A fit folder with everything but what is damaged.
fn fit_folder(folder: &Path) {
    named(folder);
    let material = "ndf = \"ggx\"\nalpha = \"vertex:rough\"\nrho_d = 0.5\nrho_s = 1.0";
    std::fs::write(folder.join("scene.toml"), seeds::scene_of(material)).unwrap();
    std::fs::write(folder.join("mesh.ply"), seeds::ply_text(&[("rough", 0.2)])).unwrap();
    std::fs::write(folder.join("points.npz"), &seeds::points()[0]).unwrap();
    std::fs::write(folder.join("fit.toml"), &seeds::record()[0]).unwrap();
}

fn report(path: &Path) -> Outcome {
    let folder = path.parent().unwrap();
    write_report(folder, None, &folder.join("report.html")).map_err(|e| e.to_string())
}

#[test]
fn points_npz_is_read_or_refused() {
    let read = |path: &Path| {
        let table = PointTable::read_npz(path).map_err(|e| e.to_string())?;
        assert!(
            table.status.len() == table.len() && table.borrowed.len() == table.len(),
            "lengths"
        );
        report(path)
    };
    fuzz(
        Parser {
            name: "points",
            file: "points.npz",
            form: Form::Zip,
            seeds: seeds::points(),
            room: FLAT,
            inputs: 3_000,
        },
        fit_folder,
        read,
    );
}

#[test]
fn fit_toml_is_read_or_refused() {
    fuzz(
        Parser {
            name: "record",
            file: "fit.toml",
            form: Form::Text,
            seeds: seeds::record(),
            room: FLAT,
            inputs: 400,
        },
        fit_folder,
        report,
    );
}

/// A scene, and its sequence in `out` whose first frame is there already: nothing is rendered.
fn begun(folder: &Path) {
    named(folder);
    let material = "ndf = \"ggx\"\nalpha = 0.2\nrho_d = 0.5\nrho_s = 1.0";
    std::fs::write(folder.join("scene.toml"), seeds::scene_of(material)).unwrap();
    std::fs::create_dir_all(folder.join("out/images")).unwrap();
    std::fs::write(folder.join("out/images/0000.exr"), "").unwrap();
}

/// Goes on with the sequence in a folder.
fn go_on(stage: &Stage, out: &Path) -> Outcome {
    let settings = SequenceSettings {
        out: out.to_owned(),
        frame: FrameSettings {
            paths: PathCount::PerPixel(1),
            bounces: 1,
            seed: 0,
            skips: Skips::ALL,
        },
        frames: Some(0..1),
        resume: true,
        aovs: false,
    };
    render_sequence(stage.scene(), stage, &settings, &|_| ())
        .map(drop)
        .map_err(|e| e.to_string())
}

#[test]
fn render_toml_is_read_or_refused() {
    // What a run with the same settings has written is a sound seed.
    let first = tempfile::tempdir().unwrap();
    begun(first.path());
    let (stage, _) = Stage::load(&Scene::load(first.path()).unwrap()).unwrap();
    go_on(&stage, &first.path().join("out")).unwrap();
    let written = std::fs::read(first.path().join("out/render.toml")).unwrap();
    fuzz(
        Parser {
            name: "provenance",
            file: "out/render.toml",
            form: Form::Text,
            seeds: vec![written],
            room: FLAT,
            inputs: 200,
        },
        begun,
        |path| go_on(&stage, path.parent().unwrap()),
    );
}
