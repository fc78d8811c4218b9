//! A whole turntable sequence, written as a capture folder.
//!
//! The folder is what photographs would give (`capture.toml`, `images/`, `masks/`, `mesh.ply`,
//! `probe.exr`), plus `truth/`, from which it can be rendered again. Files appear whole or not at
//! all, and a frame's image is written last: it marks the frame as done.

use std::ops::Range;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{FrameSettings, RenderStats, Stage, expose, pixel_centres, render_frame};
use crate::image::{ImageError, write_atomically, write_exr, write_exr_channels};
use crate::mesh::{MeshError, write_ply};
use crate::scene::{Capture, CaptureFrame, ObjectSource, ProbeSource, Scene};

/// How a sequence is rendered and where it goes.
#[derive(Clone, Debug)]
pub struct SequenceSettings {
    /// Capture folder.
    pub out: PathBuf,
    /// Sampling of every frame.
    pub frame: FrameSettings,
    /// Which frames to render; `None` for all.
    pub frames: Option<Range<usize>>,
    /// Whether to go on with a folder that a run with the same settings has begun.
    pub resume: bool,
    /// Whether to write depth, normal and triangle at pixel centres to `aovs/`.
    pub aovs: bool,
}

/// Why a sequence could not be rendered.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// A file cannot be read again.
    #[error("{}: cannot be read: {source}; did it move during the run?", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// An image could not be written.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The mesh could not be written.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A file or folder could not be written.
    #[error("{}: cannot be written: {source}; check the disk and the permissions", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The folder holds a capture already.
    #[error("{}: holds a capture already; add --resume to finish it, or choose another --out", .0.display())]
    Exists(PathBuf),
    /// A file that the scene is read from would be written over.
    #[error("{}: is read by the scene, and --out would write over it; choose another --out", .0.display())]
    OverInput(PathBuf),
    /// The folder was begun with other settings.
    #[error(
        "{}: was begun with other settings ({key}: {begun} there, {asked} now); \
         repeat those, or choose another --out", path.display()
    )]
    Differs {
        /// `render.toml` of the folder.
        path: PathBuf,
        /// What differs.
        key: &'static str,
        /// Value in the folder.
        begun: String,
        /// Value asked for.
        asked: String,
    },
    /// `--frames` names frames that the turntable does not have.
    #[error("--frames {}..{}: the turntable has frames 0..{count}", asked.start, asked.end)]
    Frames {
        /// Range asked for.
        asked: Range<usize>,
        /// Frames there are.
        count: usize,
    },
}

/// What decides the pixels of a sequence: kept in `render.toml`, and compared before resuming.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Provenance {
    turnlight: String,
    scene: String,
    mesh: String,
    probe: String,
    /// Of all maps of the material together.
    maps: String,
    sampling: String,
    bounces: u32,
    seed: u64,
}

/// Renders a scene's sequence. `on_frame` hears of every frame as it is done (or found done).
pub fn render_sequence(
    scene: &Scene,
    stage: &Stage,
    settings: &SequenceSettings,
    on_frame: &(dyn Fn(usize) + Sync),
) -> Result<RenderStats, RenderError> {
    let count = scene.angles.len();
    let frames = settings.frames.clone().unwrap_or(0..count);
    if frames.start >= frames.end || frames.end > count {
        return Err(RenderError::Frames {
            asked: frames,
            count,
        });
    }

    write_surroundings(scene, stage, settings)?;

    // Frames and the pixels in them share one pool, so both many small and few large frames keep
    // every thread busy. No more frames are begun than there are threads: memory holds one for each.
    let render = |number: usize| -> Result<RenderStats, RenderError> {
        let image_path = frame_path(&settings.out, "images", number, "exr");
        let aov_path = frame_path(&settings.out, "aovs", number, "exr");
        let done = image_path.exists() && (!settings.aovs || aov_path.exists());
        if settings.resume && done {
            on_frame(number);
            return Ok(RenderStats::default());
        }
        let angle = scene.angles[number];
        let mut frame = render_frame(stage, number as u32, angle, &settings.frame);
        if let Some(sensor) = &scene.sensor {
            expose(
                &mut frame.radiance,
                sensor,
                1.0,
                settings.frame.seed,
                number as u32,
            );
        }
        if settings.aovs {
            let (width, height) = (frame.mask.width, frame.mask.height);
            write_exr_channels(&aov_path, width, height, &pixel_centres(stage, angle))?;
        }
        frame
            .mask
            .write(&frame_path(&settings.out, "masks", number, "png"))?;
        write_exr(&image_path, &frame.radiance)?;
        on_frame(number);
        Ok(frame.stats)
    };
    let mut stats = RenderStats::default();
    let numbers: Vec<usize> = frames.collect();
    for together in numbers.chunks(rayon::current_num_threads()) {
        let done: Vec<RenderStats> = together
            .par_iter()
            .map(|&number| render(number))
            .collect::<Result<_, RenderError>>()?;
        done.into_iter().for_each(|s| stats += s);
    }
    stats.patches_explored += stage.patches.explored();
    Ok(stats)
}

/// Where frame `number` of a capture is kept.
fn frame_path(out: &Path, folder: &str, number: usize, extension: &str) -> PathBuf {
    out.join(folder).join(format!("{number:04}.{extension}"))
}

/// Writes everything but the frames, after checking that the folder is new or goes on as it began.
fn write_surroundings(
    scene: &Scene,
    stage: &Stage,
    settings: &SequenceSettings,
) -> Result<(), RenderError> {
    let out = &settings.out;
    let truth = out.join("truth");
    for folder in [out.join("images"), out.join("masks"), truth.clone()] {
        make_folder(&folder)?;
    }
    if settings.aovs {
        make_folder(&out.join("aovs"))?;
    }

    // The same scene, with its files in the folder.
    let probe = ProbeSource {
        image: out.join("probe.exr"),
        rotation: scene.probe.rotation,
    };
    let (material, maps) = scene.material.with_maps_in(&truth);
    let in_truth = Scene {
        object: placed(truth.join("mesh.ply"), stage),
        material,
        probe: probe.clone(),
        ..scene.clone()
    };
    let scene_text = in_truth.to_toml(&truth);

    let inputs = [&scene.object.mesh, &scene.probe.image];
    let inputs = inputs.into_iter().chain(maps.iter().map(|(from, _)| from));
    let mut written = vec![
        out.join("mesh.ply"),
        probe.image.clone(),
        truth.join("mesh.ply"),
    ];
    written.extend(maps.iter().map(|(_, to)| to.clone()));
    refuse_to_write_over(inputs, &written)?;

    let maps: Vec<(PathBuf, Vec<u8>)> = maps
        .into_iter()
        .map(|(from, to)| Ok((to, read(&from)?)))
        .collect::<Result<_, RenderError>>()?;
    let map_bytes: Vec<u8> = maps.iter().flat_map(|(_, bytes)| bytes).copied().collect();

    let provenance = Provenance {
        turnlight: env!("CARGO_PKG_VERSION").to_owned(),
        scene: digest(scene_text.as_bytes()),
        mesh: digest(&read(&scene.object.mesh)?),
        probe: digest(&read(&scene.probe.image)?),
        maps: digest(&map_bytes),
        sampling: format!("{}{}", settings.frame.paths, settings.frame.skips),
        bounces: settings.frame.bounces,
        seed: settings.frame.seed,
    };
    check_provenance(out, &provenance, settings)?;

    // The capture's mesh carries no material; the truth's has the vertex properties too.
    let mut bare = stage.mesh.clone();
    bare.attributes.clear();
    write_ply(&out.join("mesh.ply"), &bare)?;
    write_ply(&truth.join("mesh.ply"), &stage.mesh)?;
    if has_extension(&scene.probe.image, "exr") {
        write_bytes(&probe.image, &read(&scene.probe.image)?)?;
    } else {
        write_exr(&probe.image, stage.environment.image())?;
    }
    for (to, bytes) in maps {
        write_bytes(&to, &bytes)?;
    }
    write_bytes(&truth.join("scene.toml"), scene_text.as_bytes())?;

    let frames = scene
        .angles
        .iter()
        .enumerate()
        .map(|(number, &angle)| CaptureFrame {
            image: frame_path(out, "images", number, "exr"),
            mask: Some(frame_path(out, "masks", number, "png")),
            angle,
            exposure: 1.0,
        });
    let capture = Capture {
        object: placed(out.join("mesh.ply"), stage),
        probe,
        camera: scene.camera,
        turn: scene.turn,
        frames: frames.collect(),
        sensor: scene.sensor,
    };
    write_bytes(&out.join("capture.toml"), capture.to_toml(out).as_bytes())?;
    let text = toml::to_string(&provenance).unwrap_or_default();
    write_bytes(&out.join("render.toml"), text.as_bytes())
}

/// Refuses to write a file that is also read, under whatever name.
fn refuse_to_write_over<'a>(
    read: impl Iterator<Item = &'a PathBuf>,
    written: &[PathBuf],
) -> Result<(), RenderError> {
    // What cannot be found is not there to be lost.
    let found = |path: &PathBuf| path.canonicalize().ok();
    let written: Vec<PathBuf> = written.iter().filter_map(found).collect();
    for path in read {
        if found(path).is_some_and(|path| written.contains(&path)) {
            return Err(RenderError::OverInput(path.clone()));
        }
    }
    Ok(())
}

/// A mesh that is written in the object frame needs no placing.
fn placed(mesh: PathBuf, stage: &Stage) -> ObjectSource {
    ObjectSource {
        mesh,
        object_from_file: Default::default(),
        flat: !stage.mesh.smooth,
    }
}

/// Refuses a folder that holds another capture, or this one when nobody asked to go on with it.
fn check_provenance(
    out: &Path,
    asked: &Provenance,
    settings: &SequenceSettings,
) -> Result<(), RenderError> {
    let path = out.join("render.toml");
    let Ok(text) = std::fs::read_to_string(&path) else {
        return Ok(());
    };
    // Ranges of frames may be rendered apart into one folder.
    if !settings.resume && settings.frames.is_none() {
        return Err(RenderError::Exists(out.to_owned()));
    }
    let Ok(begun) = toml::from_str::<Provenance>(&text) else {
        return Err(RenderError::Differs {
            path,
            key: "turnlight version",
            begun: "another".to_owned(),
            asked: asked.turnlight.clone(),
        });
    };
    let pairs = [
        (
            "turnlight version",
            begun.turnlight,
            asked.turnlight.clone(),
        ),
        ("scene", begun.scene, asked.scene.clone()),
        ("mesh", begun.mesh, asked.mesh.clone()),
        ("probe", begun.probe, asked.probe.clone()),
        ("maps", begun.maps, asked.maps.clone()),
        ("sampling", begun.sampling, asked.sampling.clone()),
        (
            "bounces",
            begun.bounces.to_string(),
            asked.bounces.to_string(),
        ),
        ("seed", begun.seed.to_string(), asked.seed.to_string()),
    ];
    match pairs.into_iter().find(|(_, begun, asked)| begun != asked) {
        Some((key, begun, asked)) => Err(RenderError::Differs {
            path,
            key,
            begun,
            asked,
        }),
        None => Ok(()),
    }
}

fn make_folder(path: &Path) -> Result<(), RenderError> {
    std::fs::create_dir_all(path).map_err(|source| RenderError::Write {
        path: path.into(),
        source,
    })
}

fn read(path: &Path) -> Result<Vec<u8>, RenderError> {
    std::fs::read(path).map_err(|source| RenderError::Read {
        path: path.into(),
        source,
    })
}

fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), RenderError> {
    write_atomically(path, |file| std::io::Write::write_all(file, bytes)).map_err(|source| {
        RenderError::Write {
            path: path.into(),
            source,
        }
    })
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// FNV-1a, 64 bit, as text: enough to notice that a file is not the one it was.
fn digest(bytes: &[u8]) -> String {
    let hash = bytes.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, &byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    });
    format!("{hash:016x}")
}
