//! `transforms.json` of NeRF, instant-ngp and nerfstudio.
//!
//! A frame's `transform_matrix` takes camera coordinates with x right, y up, z backward to a world whose +Z
//! is up. The focal length is `fl_x`, or half the width over the tangent of half of `camera_angle_x`.
//! Everything but the matrix may stand at the top, for all frames, or in each frame.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3};
use serde_json::Value;

use super::{
    ImportChoices, ImportError, ImportProblem, Imported, Parsed, Shot, position, rotation, side,
};
use crate::image::RgbImage;
use crate::rig::{Distortion, Intrinsics, Lens};

/// A frame and, for what it leaves out, the top of the file.
struct Fields<'a> {
    frame: &'a Value,
    top: &'a Value,
    /// `frames[3].`
    name: String,
}

/// Reads the file at `path`, whose contents are `value`.
pub(super) fn read(
    path: &Path,
    value: &Value,
    choices: &ImportChoices,
) -> Result<Imported, ImportError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    from_value(value, folder, choices).map_err(|problem| problem.in_file(path))
}

fn from_value(value: &Value, folder: &Path, choices: &ImportChoices) -> Parsed<Imported> {
    let frames = match value.get("frames") {
        Some(Value::Array(frames)) if !frames.is_empty() => frames,
        _ => {
            let remedy = "a list of one frame or more, each with file_path and transform_matrix";
            return Err(ImportProblem::missing("frames", remedy));
        }
    };
    let mut first: Option<Lens> = None;
    let mut shots = Vec::with_capacity(frames.len());
    for (i, frame) in frames.iter().enumerate() {
        let fields = Fields {
            frame,
            top: value,
            name: format!("frames[{i}]."),
        };
        let image = fields.image(folder)?;
        // Where no size is given, only the first image is opened for it.
        let size = choices.size.or(first.map(|lens| (lens.width, lens.height)));
        let lens = fields.lens(&image, size)?;
        if *first.get_or_insert(lens) != lens {
            let requirement = "that of frames[0], since one camera stands before a turntable; \
                               import each camera's frames from a file of their own";
            return Err(ImportProblem::value(
                format!("frames[{i}]"),
                "another lens",
                requirement,
            ));
        }
        shots.push(Shot {
            image,
            object_from_camera: fields.pose()?,
        });
    }
    let lens = first.ok_or_else(|| ImportProblem::missing("frames", "one frame or more"))?;
    lens.check()
        .map_err(|error| ImportProblem::lens(&error, ""))?;
    Ok(Imported {
        format: "transforms.json",
        lens,
        shots,
        up: Some(DVec3::Z),
    })
}

impl Fields<'_> {
    fn value(&self, key: &str) -> Option<(String, &Value)> {
        match self.frame.get(key) {
            Some(value) => Some((format!("{}{key}", self.name), value)),
            None => self.top.get(key).map(|value| (key.to_owned(), value)),
        }
    }

    fn number(&self, key: &str) -> Parsed<Option<f64>> {
        let Some((name, value)) = self.value(key) else {
            return Ok(None);
        };
        match value.as_f64() {
            Some(number) => Ok(Some(number)),
            None => Err(ImportProblem::value(name, brief(value), "a number")),
        }
    }

    /// The image named, which NeRF's own scenes write without `.png`.
    fn image(&self, folder: &Path) -> Parsed<PathBuf> {
        let field = format!("{}file_path", self.name);
        let Some(value) = self.frame.get("file_path") else {
            return Err(ImportProblem::missing(field, "name the frame's image"));
        };
        let Some(text) = value.as_str().filter(|text| !text.is_empty()) else {
            return Err(ImportProblem::value(
                field,
                brief(value),
                "the name of an image",
            ));
        };
        let path = folder.join(text.strip_prefix("./").unwrap_or(text));
        Ok(if path.extension().is_none() {
            path.with_extension("png")
        } else {
            path
        })
    }

    fn lens(&self, image: &Path, size: Option<(usize, usize)>) -> Parsed<Lens> {
        if let Some((name, value)) = self.value("camera_model")
            && ![
                "OPENCV",
                "PINHOLE",
                "SIMPLE_PINHOLE",
                "SIMPLE_RADIAL",
                "RADIAL",
            ]
            .map(Some)
            .contains(&value.as_str())
        {
            let requirement = "OPENCV, PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL or RADIAL; undistort the images first";
            return Err(ImportProblem::value(name, brief(value), requirement));
        }
        if let Some(k4) = self.number("k4")?.filter(|k4| *k4 != 0.0) {
            let requirement = "0: turnlight's lens has k1, k2, p1, p2, k3";
            return Err(ImportProblem::value("k4", k4, requirement));
        }
        let (width, height) = match (self.number("w")?, self.number("h")?, size) {
            (Some(w), Some(h), _) => (side("w", w)?, side("h", h)?),
            (_, _, Some(size)) => size,
            _ => image_size(image)?,
        };
        let (w, h) = (width as f64, height as f64);
        let from_angle = |side: f64, angle: f64| 0.5 * side / (0.5 * angle).tan();
        let angle = |key: &str| {
            let angle = self.number(key)?;
            match angle.filter(|angle| !(*angle > 0.0 && *angle < std::f64::consts::PI)) {
                Some(wrong) => Err(ImportProblem::value(key, wrong, "radians between 0 and π")),
                None => Ok(angle),
            }
        };
        let fx = self
            .number("fl_x")?
            .or(angle("camera_angle_x")?.map(|angle| from_angle(w, angle)))
            .ok_or_else(|| {
                ImportProblem::missing(
                    "fl_x",
                    "or camera_angle_x, the width's field of view in radians",
                )
            })?;
        let fy = self
            .number("fl_y")?
            .or(angle("camera_angle_y")?.map(|angle| from_angle(h, angle)))
            .unwrap_or(fx);
        let number_or = |key: &str, otherwise: f64| Ok(self.number(key)?.unwrap_or(otherwise));
        Ok(Lens {
            width,
            height,
            intrinsics: Intrinsics {
                fx,
                fy,
                cx: number_or("cx", 0.5 * w)?,
                cy: number_or("cy", 0.5 * h)?,
            },
            distortion: Distortion {
                k1: number_or("k1", 0.0)?,
                k2: number_or("k2", 0.0)?,
                p1: number_or("p1", 0.0)?,
                p2: number_or("p2", 0.0)?,
                k3: number_or("k3", 0.0)?,
            },
        })
    }

    fn pose(&self) -> Parsed<DAffine3> {
        let field = format!("{}transform_matrix", self.name);
        let Some(value) = self.frame.get("transform_matrix") else {
            return Err(ImportProblem::missing(
                field,
                "the frame's 4 × 4 matrix, world from camera",
            ));
        };
        let wrong = || {
            let requirement = "four rows of four numbers (or three), row by row";
            ImportProblem::value(&field, brief(value), requirement)
        };
        let rows = value
            .as_array()
            .filter(|rows| rows.len() == 3 || rows.len() == 4);
        let mut columns = [DVec3::ZERO; 4];
        for (i, row) in rows.ok_or_else(wrong)?.iter().take(3).enumerate() {
            let row = row.as_array().filter(|row| row.len() == 4);
            for (column, number) in columns.iter_mut().zip(row.ok_or_else(wrong)?) {
                column[i] = number.as_f64().ok_or_else(wrong)?;
            }
        }
        let [right, up, backward, place] = columns;
        Ok(DAffine3 {
            matrix3: rotation(&field, DMat3::from_cols(right, -up, -backward))?,
            translation: position(&field, place)?,
        })
    }
}

fn image_size(image: &Path) -> Parsed<(usize, usize)> {
    RgbImage::read(image)
        .map(|image| (image.width, image.height))
        .map_err(|error| {
            let remedy = format!("give the images' size with --size WIDTHxHEIGHT ({error})");
            ImportProblem::missing("w and h", remedy)
        })
}

/// A value as JSON, cut where it is long.
fn brief(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(60) {
        Some((cut, _)) => format!("{}…", &text[..cut]),
        None => text,
    }
}
