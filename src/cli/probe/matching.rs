//! `turnlight probe match`.

use std::path::Path;

use super::arguments::{Corners, Match};
use crate::cli::arguments::Common;
use crate::cli::failure::Failure;
use crate::cli::outputs::{check_exr, check_kept, check_outputs};
use crate::cli::progress::{note, say, write_stats, write_text};
use crate::image::{Depth, Mask, RgbImage, write_exr};
use crate::probe::{Chart, ColourError, ColourMatch, GreyCurve, match_colours};

pub(super) fn run(arguments: &Match, common: &Common) -> Result<(), Failure> {
    // A curve speaks of stored samples; without one, pictures are taken as sRGB.
    let raw = arguments.greys.is_some();
    check_outputs([
        ("--out", Some(arguments.out.as_path())),
        ("--matched", arguments.matched.as_deref()),
    ])?;
    if let (Some(matched), Some(apply)) = (&arguments.matched, &arguments.apply) {
        check_exr("--matched", matched)?;
        check_kept("--matched", matched, [apply.as_path()])?;
    }
    let grid = arguments.grid;
    let corners = ("--probe-corners", arguments.probe_corners);
    let probe = chart(&arguments.probe, corners, grid, raw)?;
    let camera = if arguments.camera.as_os_str() == "colorchecker" {
        Chart::colorchecker()
    } else {
        let corners = ("--camera-corners", arguments.camera_corners);
        chart(&arguments.camera, corners, grid, false)?
    };
    let curve = match &arguments.greys {
        None => None,
        Some(greys) if greys.as_os_str() == "chart" => {
            Some(GreyCurve::of_chart(&probe, &camera).map_err(|fault| {
                Failure::Data(anyhow::anyhow!("--greys chart: the chart {fault}"))
            })?)
        }
        Some(greys) => Some(GreyCurve::read_csv(greys).map_err(failure)?),
    };
    let found =
        match_colours(&probe, &camera, curve, f64::from(arguments.limit)).map_err(failure)?;

    // The probe is read before anything is written.
    let converted = match (&arguments.apply, &arguments.matched) {
        (Some(apply), Some(matched)) => {
            // What `probe merge` found saturated stays so in other colours.
            let mask = apply.with_extension("clipped.png");
            let clipped = mask.exists().then(|| Mask::read(&mask)).transpose()?;
            Some((convert(apply, &found, common)?, clipped, matched))
        }
        _ => None,
    };
    let record = record(&found);
    let text = toml::to_string(&record).map_err(anyhow::Error::from)?;
    write_text(&arguments.out, &text)?;
    if let Some((image, clipped, path)) = converted {
        if let Some(clipped) = clipped {
            clipped.write(&path.with_extension("clipped.png"))?;
        }
        write_exr(path, &image)?;
    }
    say(&format!(
        "ΔE2000: mean {:.2}, of patches left out of their own fit {:.2}, worst {:.2} ({})",
        found.mean(),
        found.mean_without(),
        found.worst().map_or(0.0, |r| r.delta_e),
        found.worst().map_or("", |r| &r.name),
    ));
    for row in found.matrix {
        say(&format!("{:10.5} {:10.5} {:10.5}", row[0], row[1], row[2]));
    }
    write_stats(common, &record)
}

fn failure(error: ColourError) -> Failure {
    if error.is_about_data() {
        Failure::Data(error.into())
    } else {
        Failure::Input(error.into())
    }
}

/// A list of patches, or an image where corners are given.
fn chart(
    path: &Path,
    (option, corners): (&str, Option<Corners>),
    grid: (usize, usize),
    raw: bool,
) -> Result<Chart, Failure> {
    let Some(Corners(corners)) = corners else {
        let list = Chart::read_csv(path);
        // A picture is no list of patches: say how it is one.
        if list.is_err() && RgbImage::read_samples(path).is_ok() {
            return Err(Failure::Input(anyhow::anyhow!(
                "{}: is an image; say where its chart is with {option}",
                path.display()
            )));
        }
        return list.map_err(failure);
    };
    let (stored, depth) = RgbImage::read_samples(path)?;
    let integers = matches!(depth, Depth::Bits8 | Depth::Bits16);
    let image = if integers && !raw {
        RgbImage::read(path)?
    } else {
        stored
    };
    Chart::sample(path, &image, corners, grid, depth != Depth::Float).map_err(failure)
}

/// The probe in the camera's colours. Saturated colours may come out negative: they count as 0.
fn convert(path: &Path, found: &ColourMatch, common: &Common) -> Result<RgbImage, Failure> {
    let mut image = RgbImage::read(path)?;
    let mut negative = 0usize;
    for p in &mut image.pixels {
        let matched = found.apply(p.map(f64::from));
        negative += usize::from(matched.iter().any(|&c| c < 0.0));
        *p = matched.map(|c| c.max(0.0) as f32);
    }
    if negative > 0 {
        note(
            common,
            &format!(
                "note: {negative} texels have a channel below 0 in the camera's colours, set to 0"
            ),
        );
    }
    Ok(image)
}

fn record(found: &ColourMatch) -> toml::Table {
    use toml::Value;
    let numbers = |list: &[f64]| Value::Array(list.iter().map(|&x| Value::Float(x)).collect());
    let mut table = toml::Table::new();
    table.insert("turnlight".into(), env!("CARGO_PKG_VERSION").into());
    table.insert("delta_e_mean".into(), found.mean().into());
    table.insert("delta_e_mean_left_out".into(), found.mean_without().into());
    let rows = found.matrix.iter().map(|row| numbers(row)).collect();
    table.insert("camera_from_probe".into(), Value::Array(rows));
    if let Some(curve) = &found.curve {
        for (name, knots) in ["red", "green", "blue"].iter().zip(curve.greys()) {
            let knots = knots.iter().map(|k| numbers(k)).collect();
            table.insert(format!("curve_{name}"), Value::Array(knots));
        }
    }
    let patches = found.residuals.iter().map(|r| {
        let mut patch = toml::Table::new();
        patch.insert("name".into(), r.name.clone().into());
        patch.insert("matched".into(), numbers(&r.matched));
        patch.insert("camera".into(), numbers(&r.camera));
        patch.insert("delta_e".into(), r.delta_e.into());
        patch.insert("delta_e_left_out".into(), r.delta_e_without.into());
        Value::Table(patch)
    });
    table.insert("patches".into(), Value::Array(patches.collect()));
    table
}
