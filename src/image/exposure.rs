//! How long a photograph was exposed, from its EXIF.
//!
//! ```text
//! exposure = t · S/100 / N²,   t seconds, S the ISO speed, N the f-number
//! ```

use std::{
    io::{BufReader, Read, Seek, SeekFrom},
    path::Path,
};

use ::exif::{Exif, In, Reader, Tag, Value};

use super::{Fault, ImageError, read::read_file, read::without_panic};

/// What EXIF says about a photograph's exposure; nothing of it is more than a claim.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Exposure {
    /// Seconds, > 0.
    pub seconds: Option<f64>,
    /// f-number, > 0.
    pub f_number: Option<f64>,
    /// ISO speed, > 0.
    pub iso: Option<f64>,
}

impl Exposure {
    /// Reads it; empty where the file has no EXIF. A field that is present but not a positive number is an error.
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        read_file(path, read)
    }
}

/// EXIF lies in the first bytes of photographs; damaged ones may claim it anywhere.
const MOST_BYTES: u64 = 1 << 32;

fn read(mut file: BufReader<std::fs::File>) -> Result<Exposure, Fault> {
    let bytes = file.seek(SeekFrom::End(0)).map_err(Fault::damaged)?;
    file.rewind().map_err(Fault::damaged)?;
    if bytes > MOST_BYTES {
        return Err(Fault::new(
            format!("has {bytes} bytes, too many to look for EXIF"),
            "give the times with --times",
        ));
    }
    let mut magic = [0; 12];
    let length = file.read(&mut magic).map_err(Fault::damaged)?;
    file.rewind().map_err(Fault::damaged)?;
    if !holds_exif(&magic[..length]) {
        return Ok(Exposure::default());
    }
    without_panic(|| match Reader::new().read_from_container(&mut file) {
        Ok(exif) => Ok(Exposure {
            seconds: positive(&exif, Tag::ExposureTime)?,
            f_number: positive(&exif, Tag::FNumber)?,
            iso: positive(&exif, Tag::PhotographicSensitivity)?,
        }),
        Err(::exif::Error::NotFound(_) | ::exif::Error::BlankValue(_)) => Ok(Exposure::default()),
        Err(error) => Err(Fault::new(
            format!("its EXIF cannot be read: {error}"),
            "give the times with --times",
        )),
    })
}

/// JPEG, PNG and TIFF (raw files among them).
fn holds_exif(magic: &[u8]) -> bool {
    [&b"\xff\xd8"[..], b"\x89PNG", b"II*\0", b"MM\0*"]
        .iter()
        .any(|start| magic.starts_with(start))
}

fn positive(exif: &Exif, tag: Tag) -> Result<Option<f64>, Fault> {
    let Some(field) = exif.get_field(tag, In::PRIMARY) else {
        return Ok(None);
    };
    let number = match &field.value {
        Value::Rational(values) => values.first().map(::exif::Rational::to_f64),
        Value::Short(values) => values.first().map(|&v| f64::from(v)),
        Value::Long(values) => values.first().map(|&v| f64::from(v)),
        Value::Float(values) => values.first().map(|&v| f64::from(v)),
        Value::Double(values) => values.first().copied(),
        _ => None,
    };
    match number {
        Some(number) if number.is_finite() && number > 0.0 => Ok(Some(number)),
        _ => Err(Fault::new(
            format!("EXIF {tag} = {}: must be > 0", field.display_value()),
            "give the times with --times",
        )),
    }
}
