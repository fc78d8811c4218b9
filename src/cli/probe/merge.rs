//! `turnlight probe merge`.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::arguments::Merge;
use crate::cli::arguments::Common;
use crate::cli::failure::Failure;
use crate::cli::outputs::{check_exr, check_kept, check_outputs};
use crate::cli::progress::{bar, note, say, write_stats, write_text};
use crate::image::{Channel, Depth, Exposure, RgbImage, write_exr, write_exr_channels};
use crate::probe::{Curve, Frame, MergeError, MergeSettings, Merged, Response, merge};

/// What is written beside the image.
const BESIDE: [&str; 5] = [
    "variance.exr",
    "clipped.png",
    "ghosts.png",
    "response.csv",
    "merge.json",
];

/// Exposures this far from their claims, relative, are told; EXIF's rounding makes 7 % (1/60 for 1/64).
const FAR_OFF: f64 = 0.15;

pub(super) fn run(arguments: &Merge, common: &Common) -> Result<(), Failure> {
    check_exr("--out", &arguments.out)?;
    let mut written = vec![arguments.out.clone()];
    written.extend(BESIDE.map(|suffix| beside(&arguments.out, suffix)));
    for file in &written {
        check_outputs([("--out", Some(file.as_path()))])?;
        check_kept("--out", file, arguments.images.iter().map(PathBuf::as_path))?;
    }
    let exposures = match &arguments.times {
        Some(times) if times.len() != arguments.images.len() => {
            return Err(Failure::Input(anyhow::anyhow!(
                "--times has {} values for {} images; give one a image, in their order",
                times.len(),
                arguments.images.len()
            )));
        }
        Some(times) => times.clone(),
        None => claimed(&arguments.images)?,
    };
    let settings = MergeSettings {
        curve: curve(&arguments.response)?,
        saturation: arguments.saturation,
        refine: !arguments.trust_times,
        align: !arguments.no_align,
    };
    let bar = bar(common, "reading", arguments.images.len());
    let mut frames = Vec::new();
    for (path, exposure) in arguments.images.iter().zip(exposures) {
        let (mut samples, depth) = RgbImage::read_samples(path)?;
        if depth == Depth::Float && arguments.white != 1.0 {
            for p in &mut samples.pixels {
                *p = p.map(|c| c / arguments.white);
            }
        }
        frames.push(Frame {
            name: path.clone(),
            samples,
            depth,
            exposure,
        });
        bar.inc(1);
    }
    bar.finish_and_clear();
    let merged = merge(frames, &settings).map_err(|error| {
        if error.is_about_data() {
            Failure::Data(error.into())
        } else {
            Failure::Input(error.into())
        }
    })?;

    let record = record(&merged);
    write(&arguments.out, &merged, &record)?;
    tell(&merged, common);
    write_stats(common, &record)
}

/// Exposures as EXIF claims them.
fn claimed(images: &[PathBuf]) -> Result<Vec<f64>, Failure> {
    let read: Vec<Exposure> = images
        .iter()
        .map(|path| Exposure::read(path))
        .collect::<Result<_, _>>()?;
    // ISO speed and f-number count where every image has them; one without would be off by stops.
    let lacks = |field: &str, has: &dyn Fn(&Exposure) -> bool| -> Result<bool, Failure> {
        let missing = read.iter().position(|e| !has(e));
        match missing {
            None => Ok(false),
            Some(_) if !read.iter().any(has) => Ok(true),
            Some(i) => Err(lack(&images[i], field)),
        }
    };
    if let Some(i) = read.iter().position(|e| e.seconds.is_none()) {
        // A file that is no image at all has more missing than EXIF.
        RgbImage::read_samples(&images[i])?;
        return Err(lack(&images[i], "ExposureTime"));
    }
    lacks("FNumber", &|e| e.f_number.is_some())?;
    lacks("PhotographicSensitivity", &|e| e.iso.is_some())?;
    Ok(read
        .iter()
        .map(|e| {
            let gain = e.iso.map_or(1.0, |iso| iso / 100.0);
            let aperture = e.f_number.map_or(1.0, |n| 1.0 / (n * n));
            e.seconds.unwrap_or(f64::NAN) * gain * aperture
        })
        .collect())
}

fn lack(path: &Path, field: &str) -> Failure {
    Failure::Input(anyhow::anyhow!(
        "{}: EXIF {field} is missing; give the exposures with --times, in the order of the images",
        path.display()
    ))
}

fn curve(text: &str) -> Result<Curve, MergeError> {
    Ok(match text {
        "auto" => Curve::Auto,
        "linear" => Curve::Linear,
        "debevec" => Curve::Debevec,
        "robertson" => Curve::Robertson,
        "srgb" => Curve::Known(Response::srgb()),
        path => Curve::Known(Response::read_csv(Path::new(path))?),
    })
}

/// `STEM.SUFFIX` beside the output.
fn beside(out: &Path, suffix: &str) -> PathBuf {
    out.with_extension(suffix)
}

/// The image itself comes last: where it is, everything is.
fn write(out: &Path, merged: &Merged, record: &Value) -> Result<(), Failure> {
    let plane = |c: usize| merged.variance.pixels.iter().map(|p| p[c]).collect();
    let channels = ["variance.B", "variance.G", "variance.R"].map(str::to_owned);
    let channels: Vec<Channel> = channels
        .into_iter()
        .zip([2, 1, 0])
        .map(|(name, c)| Channel {
            name,
            samples: plane(c),
        })
        .collect();
    let (width, height) = (merged.variance.width, merged.variance.height);
    let [variance, clipped, ghosts, response, text] = BESIDE.map(|suffix| beside(out, suffix));
    write_exr_channels(&variance, width, height, &channels)?;
    merged.clipped.write(&clipped)?;
    merged.ghosts.write(&ghosts)?;
    write_text(&response, &merged.response.to_csv())?;
    let json = serde_json::to_string_pretty(record).map_err(anyhow::Error::from)?;
    write_text(&text, &json)?;
    Ok(write_exr(out, &merged.radiance)?)
}

fn record(merged: &Merged) -> Value {
    let frames: Vec<Value> = merged
        .frames
        .iter()
        .map(|f| {
            json!({
                "image": f.name.display().to_string(),
                "claimed_exposure": f.claimed,
                "exposure": f.exposure,
                "exposure_from_overlap": f.overlaps,
                "shift": f.shift,
                "saturated_texels": f.saturated,
                "left_out_texels": f.ghosts,
            })
        })
        .collect();
    let count = |mask: &crate::image::Mask| mask.pixels.iter().filter(|&&m| m != 0).count();
    json!({
        "turnlight": env!("CARGO_PKG_VERSION"),
        "width": merged.radiance.width,
        "height": merged.radiance.height,
        "linear": merged.linear,
        "noise": { "shot": merged.noise.shot, "read_variance": merged.noise.read },
        "clipped_texels": count(&merged.clipped),
        "ghost_texels": count(&merged.ghosts),
        "frames": frames,
    })
}

fn tell(merged: &Merged, common: &Common) {
    say("claimed      refined      change  saturated  left out  shift        image");
    for f in &merged.frames {
        let change = 100.0 * (f.exposure / f.claimed - 1.0);
        say(&format!(
            "{:<12.6} {:<12.6} {change:+5.1} %  {:>9}  {:>8}  {:>5.2},{:<5.2}  {}",
            f.claimed,
            f.exposure,
            f.saturated,
            f.ghosts,
            f.shift[0],
            f.shift[1],
            f.name.display()
        ));
        let name = f.name.display();
        if !f.overlaps {
            note(
                common,
                &format!("note: {name}: no overlap tells its exposure, so the claim was taken"),
            );
        } else if change.abs() > 100.0 * FAR_OFF {
            note(
                common,
                &format!(
                    "note: {name}: by its overlaps the exposure is {change:+.0} % off its claim; look at the file and \
                     its EXIF, or whether the light changed"
                ),
            );
        }
    }
    let clipped = merged.clipped.pixels.iter().filter(|&&m| m != 0).count();
    if clipped > 0 {
        note(
            common,
            &format!(
                "note: {clipped} texels are saturated in every exposure and hold lower bounds; \
                 add a shorter exposure or a neutral-density filter"
            ),
        );
    }
}
