//! COLMAP's `cameras.bin` and `images.bin`: little-endian, counts before lists, names ended by a zero.

use super::colmap::{FileCamera, FileImage, MODELS};
use super::{ImportProblem, Parsed};

/// Bytes not yet read.
struct Bytes<'a> {
    rest: &'a [u8],
    /// Length of the whole.
    all: usize,
}

impl<'a> Bytes<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self {
            rest: bytes,
            all: bytes.len(),
        }
    }

    fn ends(&self, what: &str) -> ImportProblem {
        ImportProblem::damaged(
            format!("byte {}", self.all - self.rest.len()),
            format!("the file ends within {what}"),
        )
    }

    fn skip(&mut self, count: usize, what: &str) -> Parsed<&'a [u8]> {
        let (taken, rest) = self
            .rest
            .split_at_checked(count)
            .ok_or_else(|| self.ends(what))?;
        self.rest = rest;
        Ok(taken)
    }

    fn take<const N: usize>(&mut self, what: &str) -> Parsed<[u8; N]> {
        let mut taken = [0; N];
        taken.copy_from_slice(self.skip(N, what)?);
        Ok(taken)
    }

    fn u32(&mut self, what: &str) -> Parsed<u32> {
        self.take(what).map(u32::from_le_bytes)
    }

    fn u64(&mut self, what: &str) -> Parsed<u64> {
        self.take(what).map(u64::from_le_bytes)
    }

    fn number(&mut self, what: &str) -> Parsed<f64> {
        self.take(what).map(f64::from_le_bytes)
    }

    fn numbers<const N: usize>(&mut self, what: &str) -> Parsed<[f64; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.number(what)?;
        }
        Ok(numbers)
    }

    /// How many records follow, none of which is shorter than `least` bytes: a count that the file cannot
    /// hold is refused before anything is kept.
    fn count(&mut self, what: &str, least: usize) -> Parsed<usize> {
        let place = format!("byte {}", self.all - self.rest.len());
        let count = self.u64(what)?;
        let most = self.rest.len() / least;
        usize::try_from(count)
            .ok()
            .filter(|count| *count <= most)
            .ok_or_else(|| {
                let reason = format!("{count} {what}, but room for {most} at most");
                ImportProblem::damaged(place, reason)
            })
    }

    fn end(&self) -> Parsed<()> {
        if self.rest.is_empty() {
            return Ok(());
        }
        let place = format!("byte {}", self.all - self.rest.len());
        let reason = format!("{} bytes after the last record", self.rest.len());
        Err(ImportProblem::damaged(place, reason))
    }
}

/// Reads `cameras.bin`.
pub(super) fn cameras(bytes: &[u8]) -> Parsed<Vec<FileCamera>> {
    let mut bytes = Bytes::new(bytes);
    let count = bytes.count("cameras", 24 + 3 * 8)?;
    let mut cameras = Vec::new();
    for i in 0..count {
        let what = format!("camera record {i}");
        let id = bytes.u32(&what)?;
        let number = bytes.u32(&what)?;
        let (width, height) = (bytes.u64(&what)? as f64, bytes.u64(&what)? as f64);
        let model = usize::try_from(number).unwrap_or(usize::MAX);
        let Some((_, parameters)) = MODELS.get(model) else {
            let requirement = format!("a COLMAP model, 0 to {}", MODELS.len() - 1);
            return Err(ImportProblem::value(
                format!("camera {id}: model"),
                number as i32,
                requirement,
            ));
        };
        let parameters = (0..*parameters)
            .map(|_| bytes.number(&what))
            .collect::<Parsed<Vec<f64>>>()?;
        cameras.push(FileCamera {
            id,
            model,
            width,
            height,
            parameters,
        });
    }
    bytes.end()?;
    Ok(cameras)
}

/// Reads `images.bin`; the points seen are passed over.
pub(super) fn images(bytes: &[u8]) -> Parsed<Vec<FileImage>> {
    let mut bytes = Bytes::new(bytes);
    let count = bytes.count("images", 4 + 7 * 8 + 4 + 1 + 8)?;
    let mut images = Vec::new();
    for i in 0..count {
        let what = format!("image record {i}");
        let id = bytes.u32(&what)?;
        let quaternion = bytes.numbers(&what)?;
        let translation = bytes.numbers(&what)?;
        let camera = bytes.u32(&what)?;
        let length = bytes.rest.iter().position(|byte| *byte == 0);
        let length = length.ok_or_else(|| bytes.ends(&format!("the name of {what}")))?;
        let name = String::from_utf8_lossy(bytes.skip(length, &what)?).into_owned();
        bytes.skip(1, &what)?;
        let points = bytes.count(&format!("points of {what}"), 24)?;
        bytes.skip(points * 24, &what)?;
        images.push(FileImage {
            id,
            quaternion,
            translation,
            camera,
            name,
        });
    }
    bytes.end()?;
    Ok(images)
}
