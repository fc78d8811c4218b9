//! Corners found by another program, and those found here for another program.
//!
//! ```json
//! {
//!   "width": 640, "height": 480,
//!   "first_pixel_centre": 0.0,
//!   "photographs": [ { "name": "left01.jpg", "corners": [ [column, row, x, y], … ] } ]
//! }
//! ```
//!
//! `first_pixel_centre` says where the centre of the top left pixel lies: 0 as in OpenCV, 0.5 as in
//! turnlight and COLMAP. Columns and rows count squares of the board; halves are allowed.

use std::path::Path;

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::{BoardView, Corner};

/// The corners of several photographs of one camera.
#[derive(Clone, Debug, PartialEq)]
pub struct CornerFile {
    /// Columns of the photographs, pixels.
    pub width: usize,
    /// Rows of the photographs, pixels.
    pub height: usize,
    /// What was seen in each.
    pub views: Vec<BoardView>,
}

/// As it stands in the file.
#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Written {
    width: u32,
    height: u32,
    first_pixel_centre: f64,
    photographs: Vec<WrittenView>,
}

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct WrittenView {
    name: String,
    corners: Vec<[f64; 4]>,
}

/// What is wrong with a file of corners.
#[derive(Debug, thiserror::Error)]
pub enum CornerFileError {
    /// It cannot be read.
    #[error("{file}: {source}; check the path and its permissions")]
    Read {
        /// The file.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// It is not such a file.
    #[error(
        "{file}: {reason}; write width, height, first_pixel_centre and photographs as in `turnlight camera calibrate --help`"
    )]
    Syntax {
        /// The file.
        file: String,
        /// What the parser said, with line and column.
        reason: String,
    },
    /// A value is not allowed.
    #[error("{file}: {field} = {value}: must be {requirement}")]
    Value {
        /// The file.
        file: String,
        /// The field.
        field: String,
        /// Its value.
        value: f64,
        /// What is allowed.
        requirement: &'static str,
    },
}

impl CornerFile {
    /// Reads a file of corners.
    ///
    /// # Errors
    /// The file is unreadable, no such file, or a number is out of range.
    pub fn load(path: &Path) -> Result<Self, CornerFileError> {
        let file = path.display().to_string();
        match std::fs::read_to_string(path) {
            Ok(text) => Self::parse(&text, &file),
            Err(source) => Err(CornerFileError::Read { file, source }),
        }
    }

    fn parse(text: &str, file: &str) -> Result<Self, CornerFileError> {
        let written: Written =
            serde_json::from_str(text).map_err(|error| CornerFileError::Syntax {
                file: file.to_owned(),
                reason: error.to_string(),
            })?;
        let wrong = |field: String, value: f64, requirement| CornerFileError::Value {
            file: file.to_owned(),
            field,
            value,
            requirement,
        };
        for (field, side) in [("width", written.width), ("height", written.height)] {
            if !(1..=65536).contains(&side) {
                let requirement = "from 1 to 65536 pixels";
                return Err(wrong(field.to_owned(), f64::from(side), requirement));
            }
        }
        let centre = written.first_pixel_centre;
        if centre != 0.0 && centre != 0.5 {
            let requirement = "0 (as in OpenCV) or 0.5 (as in turnlight and COLMAP)";
            return Err(wrong("first_pixel_centre".to_owned(), centre, requirement));
        }
        let mut views = Vec::with_capacity(written.photographs.len());
        for (i, view) in written.photographs.into_iter().enumerate() {
            for (j, corner) in view.corners.iter().enumerate() {
                // Beyond a million, squares and pixels are mistakes, and their squares lose digits.
                if let Some(value) = corner.iter().find(|x| x.abs() > 1e6 || x.is_nan()) {
                    let field = format!("photographs[{i}].corners[{j}]");
                    return Err(wrong(field, *value, "within ±1e6"));
                }
            }
            let corner = |[column, row, x, y]: [f64; 4]| Corner {
                board: DVec2::new(column, row),
                pixel: DVec2::new(x, y) + (0.5 - centre),
            };
            views.push(BoardView {
                name: view.name,
                corners: view.corners.into_iter().map(corner).collect(),
            });
        }
        Ok(Self {
            width: written.width as usize,
            height: written.height as usize,
            views,
        })
    }

    /// The text of the file, pixels as turnlight counts them.
    pub fn to_json(&self) -> String {
        let corner = |c: &Corner| [c.board.x, c.board.y, c.pixel.x, c.pixel.y];
        let written = Written {
            width: self.width as u32,
            height: self.height as u32,
            first_pixel_centre: 0.5,
            photographs: self
                .views
                .iter()
                .map(|view| WrittenView {
                    name: view.name.clone(),
                    corners: view.corners.iter().map(corner).collect(),
                })
                .collect(),
        };
        // Strings and numbers always serialise.
        serde_json::to_string(&written).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"{"width": 640, "height": 480, "first_pixel_centre": 0.0,
        "photographs": [{"name": "a.jpg", "corners": [[0, 0, 10.25, 20], [1, 0, 30, 20.5]]}]}"#;

    #[test]
    fn what_is_written_reads_back() {
        let read = CornerFile::parse(TEXT, "c.json").unwrap();
        assert_eq!(read.views[0].corners[0].pixel, DVec2::new(10.75, 20.5));
        assert_eq!(CornerFile::parse(&read.to_json(), "c.json").unwrap(), read);
    }

    #[test]
    fn faults_are_named() {
        for (from, to, named) in [
            ("640", "0", "width = 0: must be"),
            ("0.0,", "1.0,", "first_pixel_centre = 1: must be 0"),
            (
                "20.5]",
                "1e9]",
                "photographs[0].corners[1] = 1000000000: must be",
            ),
            ("\"width\"", "\"widht\"", "unknown field `widht`"),
            (", 20.5]", "]", "line 2"),
        ] {
            assert!(TEXT.contains(from));
            let error = CornerFile::parse(&TEXT.replacen(from, to, 1), "c.json").unwrap_err();
            let error = error.to_string();
            assert!(
                error.starts_with("c.json: ") && error.contains(named),
                "{error}"
            );
        }
    }
}
