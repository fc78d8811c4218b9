//! COLMAP's `cameras.txt` and `images.txt`: a record a line, fields between blanks, `#` begins a comment.

use super::colmap::{FileCamera, FileImage, MODELS};
use super::{ImportProblem, Parsed};

/// The fields of a line, and where it stands.
struct Line<'a> {
    number: usize,
    fields: std::str::SplitWhitespace<'a>,
}

impl<'a> Line<'a> {
    fn place(&self) -> String {
        format!("line {}", self.number)
    }

    fn field(&mut self, name: &str) -> Parsed<&'a str> {
        let place = self.place();
        self.fields
            .next()
            .ok_or_else(|| ImportProblem::damaged(place, format!("{name} is missing")))
    }

    fn parse<T: std::str::FromStr>(&mut self, name: &str, kind: &str) -> Parsed<T> {
        let text = self.field(name)?;
        text.parse().map_err(|_| {
            let field = format!("line {}: {name}", self.number);
            ImportProblem::value(field, brief(text), kind)
        })
    }
}

fn brief(text: &str) -> String {
    text.chars().take(40).collect()
}

fn text(bytes: &[u8]) -> Parsed<&str> {
    std::str::from_utf8(bytes).map_err(|error| {
        ImportProblem::damaged(format!("byte {}", error.valid_up_to()), "not text in UTF-8")
    })
}

fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.trim()))
        .filter(|(_, line)| !line.starts_with('#'))
}

/// Reads `cameras.txt`.
pub(super) fn cameras(bytes: &[u8]) -> Parsed<Vec<FileCamera>> {
    let records = lines(text(bytes)?).filter(|(_, line)| !line.is_empty());
    let camera = |(number, line): (usize, &str)| {
        let mut line = Line {
            number,
            fields: line.split_whitespace(),
        };
        let id = line.parse("CAMERA_ID", "a whole number")?;
        let name = line.field("MODEL")?;
        let model = MODELS
            .iter()
            .position(|(model, _)| *model == name)
            .ok_or_else(|| {
                let known = MODELS.map(|(model, _)| model).join(", ");
                let field = format!("line {number}: MODEL");
                ImportProblem::value(field, brief(name), format!("one of {known}"))
            })?;
        let width = f64::from(line.parse::<u32>("WIDTH", "a whole number")?);
        let height = f64::from(line.parse::<u32>("HEIGHT", "a whole number")?);
        let parameters = (0..MODELS[model].1)
            .map(|i| line.parse(&format!("PARAMS[{i}]"), "a number"))
            .collect::<Parsed<Vec<f64>>>()?;
        if line.fields.next().is_some() {
            let reason = format!("more than the {} parameters of {name}", parameters.len());
            return Err(ImportProblem::damaged(line.place(), reason));
        }
        Ok(FileCamera {
            id,
            model,
            width,
            height,
            parameters,
        })
    };
    records.map(camera).collect()
}

/// Reads `images.txt`: two lines an image, the second of which, the points seen, may be empty.
pub(super) fn images(bytes: &[u8]) -> Parsed<Vec<FileImage>> {
    let mut records = lines(text(bytes)?);
    let mut images = Vec::new();
    while let Some((number, line)) = records.next() {
        if line.is_empty() {
            continue;
        }
        let mut line = Line {
            number,
            fields: line.split_whitespace(),
        };
        let id = line.parse("IMAGE_ID", "a whole number")?;
        let mut quaternion = [0.0; 4];
        for (value, name) in quaternion.iter_mut().zip(["QW", "QX", "QY", "QZ"]) {
            *value = line.parse(name, "a number")?;
        }
        let mut translation = [0.0; 3];
        for (value, name) in translation.iter_mut().zip(["TX", "TY", "TZ"]) {
            *value = line.parse(name, "a number")?;
        }
        let camera = line.parse("CAMERA_ID", "a whole number")?;
        // Names may hold blanks.
        let name = line.fields.by_ref().collect::<Vec<_>>().join(" ");
        if name.is_empty() {
            return Err(ImportProblem::damaged(line.place(), "NAME is missing"));
        }
        images.push(FileImage {
            id,
            quaternion,
            translation,
            camera,
            name,
        });
        let points = records
            .next()
            .map_or(0, |(_, line)| line.split_whitespace().count());
        if !points.is_multiple_of(3) {
            let place = format!("line {}", number + 1);
            let reason = format!("{points} numbers, but a point has three: X, Y, POINT3D_ID");
            return Err(ImportProblem::damaged(place, reason));
        }
    }
    Ok(images)
}
