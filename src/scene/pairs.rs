//! `pairs.toml`: points of the mesh and the pixels where a frame shows them, clicked by hand.
//!
//! ```toml
//! frame = 0                       # in which frame; the first unless given
//! [[pairs]]
//! point = [0.12, 0.53, 0.81]      # in the mesh file's coordinates
//! pixel = [281.5, 143.0]          # column and row; the centre of the top left pixel is 0.5, 0.5
//! ```

use std::path::Path;

use glam::DVec2;

use super::error::SceneError;
use super::load::{read, syntax};
use super::section::{Checked, FINITE, Section};
use crate::rig::registration::Clicked;

const KEYS: [&str; 2] = ["frame", "pairs"];
const PAIR_KEYS: [&str; 2] = ["point", "pixel"];

/// Frames are counted by whole numbers that a capture can have.
const LAST_FRAME: i64 = 999_999;

/// Pairs of points and pixels, all of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ClickedPairs {
    /// Index of the frame.
    pub frame: usize,
    /// One pair or more.
    pub pairs: Vec<Clicked>,
}

impl ClickedPairs {
    /// Reads a file of pairs.
    ///
    /// # Errors
    /// The file cannot be read, or a value is not allowed.
    pub fn load(file: &Path) -> Result<Self, SceneError> {
        Self::parse(&read(file)?, file)
    }

    /// Reads the text of such a file that stands at `file`.
    ///
    /// # Errors
    /// A value is not allowed.
    pub fn parse(text: &str, file: &Path) -> Result<Self, SceneError> {
        let table = syntax(text).map_err(|problem| problem.in_file(file))?;
        pairs(&table).map_err(|problem| problem.in_file(file))
    }
}

fn pairs(table: &toml::Table) -> Checked<ClickedPairs> {
    let top = Section::new(String::new(), table, &KEYS)?;
    let sections = top.sections("pairs", &PAIR_KEYS)?;
    if sections.is_empty() {
        return Err(top.missing(
            "pairs",
            "a section [[pairs]] with point = [x, y, z] and pixel = [column, row] for every pair",
        ));
    }
    let one = |section: &Section<'_>| {
        let pixel = section
            .array::<2>("pixel", FINITE)?
            .ok_or_else(|| section.missing("pixel", "[column, row]"))?;
        Ok(Clicked {
            point: section.need_vector("point")?,
            pixel: DVec2::from_array(pixel),
        })
    };
    Ok(ClickedPairs {
        frame: top.count("frame", 0, LAST_FRAME)?.unwrap_or(0) as usize,
        pairs: sections.iter().map(one).collect::<Checked<_>>()?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    const PAIRS: &str = "frame = 2\n[[pairs]]\npoint = [0.1, 2, -3.5]\npixel = [10, 20.5]\n";

    fn parse(text: &str) -> Result<ClickedPairs, String> {
        ClickedPairs::parse(text, Path::new("pairs.toml")).map_err(|error| error.to_string())
    }

    #[test]
    fn pairs_are_read() {
        let read = parse(PAIRS).unwrap();
        assert_eq!(read.frame, 2);
        let (point, pixel) = (DVec3::new(0.1, 2.0, -3.5), DVec2::new(10.0, 20.5));
        assert_eq!(read.pairs, [Clicked { point, pixel }]);
        assert_eq!(parse(&PAIRS.replace("frame = 2", "")).unwrap().frame, 0);
    }

    #[test]
    fn every_error_names_file_key_value_and_remedy() {
        for (from, to, expected) in [
            (
                "pixel = [10",
                "pixle = [10",
                "pairs.toml: pairs[0].pixle: unknown key; did you mean pixel?",
            ),
            (
                "pixel = [10, 20.5]",
                "",
                "pairs.toml: pairs[0].pixel: missing; add [column, row]",
            ),
            (
                "[10, 20.5]",
                "[10]",
                "pairs.toml: pairs[0].pixel = [10]: must be an array of 2 numbers",
            ),
            (
                "[10, 20.5]",
                "[nan, 1]",
                "pairs.toml: pairs[0].pixel[0] = nan: must be a finite number",
            ),
            (
                "frame = 2",
                "frame = -1",
                "pairs.toml: frame = -1: must be a whole number from 0 to 999999",
            ),
            ("frame = 2", "frame = ", "pairs.toml:1:"),
        ] {
            let error = parse(&PAIRS.replace(from, to)).unwrap_err();
            assert!(error.starts_with(expected), "{error}");
        }
        assert!(
            parse("frame = 1")
                .unwrap_err()
                .contains("pairs: missing; add a section [[pairs]]")
        );
    }
}
