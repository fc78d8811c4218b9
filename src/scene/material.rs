//! `[material]`: parameters over the surface, and which Fresnel variant they belong to.

use std::path::Path;

use glam::Vec3;
use toml::Value;

use super::section::{Checked, NON_NEGATIVE, Range, Section, nearest};
use super::{MapSource, MaterialSource, SpecularSource};
use crate::brdf::{Alpha, Ndf};

const KEYS: [&str; 8] = [
    "ndf", "alpha", "rho_d", "rho_s", "eta", "fresnel", "f0", "f90",
];

const ALPHA: Range = Range {
    holds: |x| Alpha::new(x as f32).is_ok(),
    requirement: "in [0.001, 1]; alpha is the NDF's own parameter, the square of glTF's roughness",
};
const ETA: Range = Range {
    holds: |x| (x as f32) > 1.0 && x <= 4.0,
    requirement: "in (1, 4]; describe a metal by rho_s or fresnel = \"schlick\"",
};
const SHARE: Range = Range {
    holds: |x| (0.0..=1.0).contains(&x),
    requirement: "a share of GGX in [0, 1]",
};

/// The paper's index of refraction (Domon et al., after Eq. 2).
const PAPER_ETA: f64 = 1.3;

/// Reads `[material]` of a scene.
pub(super) fn read(top: &Section<'_>, folder: &Path) -> Checked<MaterialSource> {
    let section = top.section("material", &KEYS)?.ok_or_else(|| {
        top.missing(
            "material",
            "a section [material] with ndf, alpha, rho_d and rho_s",
        )
    })?;
    Ok(MaterialSource {
        ggx: ndf(&section, folder)?,
        alpha: need(
            &section,
            "alpha",
            "a number in [0.001, 1]",
            scalar(&section, "alpha", ALPHA, folder)?,
        )?,
        rho_d: need(
            &section,
            "rho_d",
            "[r, g, b] >= 0",
            colour(&section, "rho_d", folder)?,
        )?,
        specular: specular(&section, folder)?,
    })
}

/// Which lobe: a name, or the share of GGX.
fn ndf(section: &Section<'_>, folder: &Path) -> Checked<MapSource<f32>> {
    const NAMES: [&str; 2] = ["beckmann", "ggx"];
    let found = match section.value("ndf") {
        Some(Value::String(name)) if name == "beckmann" => Some(Ndf::Beckmann.into()),
        Some(Value::String(name)) if name == "ggx" => Some(Ndf::Ggx.into()),
        // A word that is neither a map nor a vertex property is a misspelt name.
        Some(value @ Value::String(name)) if !name.contains(['.', ':', '/']) => {
            let near = nearest(name, &NAMES)
                .map_or(String::new(), |near| format!("; did you mean \"{near}\"?"));
            return Err(section.wrong(
                "ndf",
                value,
                format!("\"beckmann\", \"ggx\" or a map of the GGX share{near}"),
            ));
        }
        _ => scalar(section, "ndf", SHARE, folder)?,
    };
    need(section, "ndf", "\"beckmann\" or \"ggx\"", found)
}

/// The lobe's strength, by Fresnel variant; keys of the other variant are refused.
fn specular(section: &Section<'_>, folder: &Path) -> Checked<SpecularSource> {
    match section.string("fresnel")? {
        None | Some("dielectric") => {
            for key in ["f0", "f90"] {
                section.refuse(
                    key,
                    "fresnel = \"dielectric\"",
                    &format!("{key}, or set fresnel = \"schlick\""),
                )?;
            }
            Ok(SpecularSource::Dielectric {
                eta: section.number("eta", ETA)?.unwrap_or(PAPER_ETA) as f32,
                rho_s: need(
                    section,
                    "rho_s",
                    "a number >= 0 (above 1 is normal)",
                    colour(section, "rho_s", folder)?,
                )?,
            })
        }
        Some("schlick") => {
            for key in ["eta", "rho_s"] {
                section.refuse(
                    key,
                    "fresnel = \"schlick\"",
                    &format!("{key} (f0 and f90 replace it)"),
                )?;
            }
            Ok(SpecularSource::Schlick {
                f0: need(
                    section,
                    "f0",
                    "[r, g, b] >= 0",
                    colour(section, "f0", folder)?,
                )?,
                f90: scalar(section, "f90", NON_NEGATIVE, folder)?
                    .unwrap_or(MapSource::Constant(1.0)),
            })
        }
        Some(other) => Err(section.wrong(
            "fresnel",
            &Value::from(other),
            "\"dielectric\" or \"schlick\"",
        )),
    }
}

fn need<T>(section: &Section<'_>, key: &str, remedy: &str, found: Option<T>) -> Checked<T> {
    found.ok_or_else(|| section.missing(key, remedy))
}

/// A neutral parameter over the surface.
fn scalar(
    section: &Section<'_>,
    key: &str,
    range: Range,
    folder: &Path,
) -> Checked<Option<MapSource<f32>>> {
    match section.value(key) {
        None => Ok(None),
        Some(Value::String(_)) => map(section, key, folder),
        Some(value) => section
            .checked(key, value, range)
            .and_then(|x| single(section, key, x))
            .map(MapSource::Constant)
            .map(Some),
    }
}

/// A colour over the surface: never negative, without an upper bound.
fn colour(section: &Section<'_>, key: &str, folder: &Path) -> Checked<Option<MapSource<Vec3>>> {
    let rgb = match section.value(key) {
        None => return Ok(None),
        Some(Value::String(_)) => return map(section, key, folder),
        Some(Value::Array(_)) => section.array::<3>(key, NON_NEGATIVE)?.unwrap_or_default(),
        Some(value @ (Value::Integer(_) | Value::Float(_))) => {
            [section.checked(key, value, NON_NEGATIVE)?; 3]
        }
        Some(other) => {
            return Err(section.wrong(
                key,
                other,
                "a number, [r, g, b], an image or \"vertex:NAME\"",
            ));
        }
    };
    let [r, g, b] = rgb.map(|x| single(section, key, x));
    Ok(Some(MapSource::Constant(Vec3::new(r?, g?, b?))))
}

/// `x` in single precision, if it fits.
fn single(section: &Section<'_>, key: &str, x: f64) -> Checked<f32> {
    let narrow = x as f32;
    if narrow.is_finite() {
        Ok(narrow)
    } else {
        Err(section.wrong(key, &Value::from(x), "below 3.4e38"))
    }
}

/// An image by UV or a vertex property.
fn map<T>(section: &Section<'_>, key: &str, folder: &Path) -> Checked<Option<MapSource<T>>> {
    let Some(text) = section.string(key)? else {
        return Ok(None);
    };
    match text.strip_prefix("vertex:") {
        None => Ok(section.file(key, folder)?.map(MapSource::Texture)),
        Some(name) if !name.is_empty() && !name.contains(char::is_whitespace) => {
            Ok(Some(MapSource::Vertex(name.to_owned())))
        }
        Some(_) => Err(section.wrong(
            key,
            &Value::from(text),
            "\"vertex:NAME\" with the name of a vertex property",
        )),
    }
}
