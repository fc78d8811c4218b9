//! From a file's text to [`Scene`] and [`Capture`].

use std::path::{Path, PathBuf};

use toml::Table;

use super::error::{Problem, SceneError};
use super::section::{Checked, Section};
use super::{Capture, Scene, material, sections};

const SCENE_KEYS: [&str; 6] = [
    "object",
    "material",
    "probe",
    "camera",
    "turntable",
    "sensor",
];
const CAPTURE_KEYS: [&str; 6] = ["object", "probe", "camera", "turntable", "sensor", "frames"];

impl Scene {
    /// Reads `scene.toml`, or the one in the folder `path`.
    ///
    /// # Errors
    /// The file or one it names does not exist, or a value is not allowed.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SceneError> {
        let file = file_in(path.as_ref(), "scene.toml");
        Self::parse(&read(&file)?, &file)
    }

    /// Reads the text of a scene file that stands, or will stand, at `file`.
    ///
    /// # Errors
    /// A file it names does not exist, or a value is not allowed.
    pub fn parse(text: &str, file: &Path) -> Result<Self, SceneError> {
        let table = syntax(text).map_err(|problem| problem.in_file(file))?;
        scene(&table, folder_of(file)).map_err(|problem| problem.in_file(file))
    }
}

impl Capture {
    /// Reads `capture.toml`, or the one in the folder `path`.
    ///
    /// # Errors
    /// The file or one it names does not exist, or a value is not allowed.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SceneError> {
        let file = file_in(path.as_ref(), "capture.toml");
        Self::parse(&read(&file)?, &file)
    }

    /// Reads the text of a capture file that stands, or will stand, at `file`.
    ///
    /// # Errors
    /// A file it names does not exist, or a value is not allowed.
    pub fn parse(text: &str, file: &Path) -> Result<Self, SceneError> {
        let table = syntax(text).map_err(|problem| problem.in_file(file))?;
        capture(&table, folder_of(file)).map_err(|problem| problem.in_file(file))
    }
}

fn scene(table: &Table, folder: &Path) -> Checked<Scene> {
    if table.contains_key("frames") {
        let other = "a scene, which has not been photographed".to_owned();
        let remove = "[[frames]], or name the file capture.toml".to_owned();
        return Err(Problem::Conflict {
            key: "frames".to_owned(),
            other,
            remove,
        });
    }
    let top = Section::new(String::new(), table, &SCENE_KEYS)?;
    let turntable = sections::turntable(&top)?;
    Ok(Scene {
        object: sections::object(&top, folder)?,
        material: material::read(&top, folder)?,
        probe: sections::probe(&top, folder)?,
        camera: sections::camera(&top)?,
        turn: turntable.turn,
        angles: turntable.angles.ok_or_else(|| Problem::Missing {
            key: "turntable".to_owned(),
            remedy: "frames = N (equally spaced over 360°) or angles_deg = [...]".to_owned(),
        })?,
        sensor: sections::sensor(&top)?,
    })
}

fn capture(table: &Table, folder: &Path) -> Checked<Capture> {
    if table.contains_key("material") {
        let other = "a capture, whose material is unknown".to_owned();
        let remove = "[material], or name the file scene.toml".to_owned();
        return Err(Problem::Conflict {
            key: "material".to_owned(),
            other,
            remove,
        });
    }
    let top = Section::new(String::new(), table, &CAPTURE_KEYS)?;
    let turntable = sections::turntable(&top)?;
    if turntable.angles.is_some() {
        let other = "frames[..].angle_deg, which says where the object stood".to_owned();
        let remove = "frames and angles_deg from [turntable]".to_owned();
        return Err(Problem::Conflict {
            key: "turntable".to_owned(),
            other,
            remove,
        });
    }
    Ok(Capture {
        object: sections::object(&top, folder)?,
        probe: sections::probe(&top, folder)?,
        camera: sections::camera(&top)?,
        turn: turntable.turn,
        frames: sections::frames(&top, folder)?,
        sensor: sections::sensor(&top)?,
    })
}

/// `path`, or the file called `name` in the folder `path`.
fn file_in(path: &Path, name: &str) -> PathBuf {
    if path.is_dir() {
        path.join(name)
    } else {
        path.to_path_buf()
    }
}

fn folder_of(file: &Path) -> &Path {
    file.parent().unwrap_or(Path::new(""))
}

pub(super) fn read(file: &Path) -> Result<String, SceneError> {
    std::fs::read_to_string(file).map_err(|source| Problem::Read { source }.in_file(file))
}

pub(super) fn syntax(text: &str) -> Checked<Table> {
    text.parse::<Table>().map_err(|error| {
        let start = error.span().map_or(0, |span| span.start).min(text.len());
        let before = text.get(..start).unwrap_or("");
        Problem::Syntax {
            line: before.matches('\n').count() + 1,
            column: before
                .rsplit('\n')
                .next()
                .map_or(0, |line| line.chars().count())
                + 1,
            message: error.message().replace('\n', ", "),
        }
    })
}
