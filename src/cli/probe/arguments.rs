//! What is typed after `turnlight probe`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

#[derive(Debug, Subcommand)]
pub(in crate::cli) enum Probe {
    /// Exposure brackets (JPEG, PNG, TIFF, EXR, raw) → linear HDR EXR, with variance and masks beside it.
    Merge(Merge),
    /// Match the probe's colours to the camera's from a chart seen by both.
    Match(Match),
    /// One page about a probe: sources, clipping, glare, and what roughness it can reveal.
    Inspect(Inspect),
}

#[derive(Args, Debug)]
pub(in crate::cli) struct Merge {
    /// The exposures, 2 to 100 images of one size, in any order.
    #[arg(required = true, num_args = 2..=100)]
    pub(super) images: Vec<PathBuf>,
    /// HDR image to write; STEM.variance.exr, STEM.clipped.png, STEM.ghosts.png, STEM.response.csv and
    /// STEM.merge.json go beside it.
    #[arg(long)]
    pub(super) out: PathBuf,
    /// Exposures in the order of the images, seconds or fractions: 1/2000,1/500,1/125. EXIF's times,
    /// ISO speeds and f-numbers unless given.
    #[arg(long, value_delimiter = ',', value_parser = exposure, value_name = "LIST")]
    pub(super) times: Option<Vec<f64>>,
    /// How samples become linear: auto (linear where they follow the exposures, else debevec), linear,
    /// debevec, robertson, srgb, or a response.csv that an earlier merge wrote.
    #[arg(long, default_value = "auto", value_name = "CURVE")]
    pub(super) response: String,
    /// Samples from this share of white on are saturated, 0.5 to 1.
    #[arg(long, default_value_t = 0.98, value_parser = saturation)]
    pub(super) saturation: f32,
    /// White of linear float images; integers and raw files have their own.
    #[arg(long, default_value_t = 1.0, value_parser = positive)]
    pub(super) white: f32,
    /// Take the exposures as they are claimed.
    #[arg(long)]
    pub(super) trust_times: bool,
    /// Do not undo shifts between the images. Else they are found to fractions of a pixel; columns of images twice
    /// as wide as high go round.
    #[arg(long)]
    pub(super) no_align: bool,
}

#[derive(Args, Debug)]
pub(in crate::cli) struct Match {
    /// The chart as the probe's camera sees it: an image (with --probe-corners) or a CSV of patches,
    /// `name,r,g,b` or `r,g,b` a line.
    pub(super) probe: PathBuf,
    /// The chart as the object's camera sees it, of the same patches in the same order; or
    /// `colorchecker`, the linear sRGB values of the ColorChecker Classic.
    pub(super) camera: PathBuf,
    /// Corners of the probe image's chart: centres of its first, last-of-first-row, last and
    /// first-of-last-row patch, pixels: x,y,x,y,x,y,x,y.
    #[arg(long, value_parser = corners, value_name = "X,Y,…")]
    pub(super) probe_corners: Option<Corners>,
    /// The same for the camera's image.
    #[arg(long, value_parser = corners, value_name = "X,Y,…")]
    pub(super) camera_corners: Option<Corners>,
    /// Columns and rows of the chart.
    #[arg(long, default_value = "6x4", value_parser = grid, value_name = "CxR")]
    pub(super) grid: (usize, usize),
    /// Greys seen by the probe's camera, for its curve: `reflectance,r,g,b` a line (or a Munsell value such as
    /// N5), or `chart` for the grey patches of the chart itself. Linear (pictures: sRGB) unless given.
    #[arg(long, value_name = "CSV|chart")]
    pub(super) greys: Option<PathBuf>,
    /// The match, as TOML.
    #[arg(long)]
    pub(super) out: PathBuf,
    /// Probe to convert to the camera's colours.
    #[arg(long, requires = "matched", value_name = "EXR")]
    pub(super) apply: Option<PathBuf>,
    /// Where the converted probe goes.
    #[arg(long, requires = "apply", value_name = "EXR")]
    pub(super) matched: Option<PathBuf>,
    /// Largest mean ΔE2000 that is accepted.
    #[arg(long, default_value_t = 6.0, value_parser = positive)]
    pub(super) limit: f32,
}

#[derive(Args, Debug)]
pub(in crate::cli) struct Inspect {
    /// The probe: a lat-long HDR image.
    pub(super) probe: PathBuf,
    /// Page to write.
    #[arg(long, default_value = "probe.html")]
    pub(super) out: PathBuf,
    /// Also write the figures to this JSON file.
    #[arg(long, value_name = "FILE")]
    pub(super) json: Option<PathBuf>,
    /// Noise of a sample, relative to the mean radiance of the trace.
    #[arg(long, default_value_t = 0.01, value_parser = share)]
    pub(super) noise: f32,
    /// Frames of the turn.
    #[arg(long, default_value_t = 72, value_parser = clap::value_parser!(u32).range(2..=10_000))]
    pub(super) frames: u32,
    /// Camera's height above the turntable's plane as seen from the object, degrees.
    #[arg(long, default_value_t = 20.0, value_parser = elevation, allow_negative_numbers = true)]
    pub(super) elevation: f32,
    /// Camera's direction about +Y from +Z towards +X, degrees.
    #[arg(long, default_value_t = 0.0, value_parser = degrees, allow_negative_numbers = true)]
    pub(super) azimuth: f32,
    /// Diffuse albedo to plan for.
    #[arg(long, default_value_t = 0.3, value_parser = share)]
    pub(super) rho_d: f32,
    /// Specular albedo to plan for; 2.35 is a plastic under eta = 1.3.
    #[arg(long, default_value_t = 2.35, value_parser = positive)]
    pub(super) rho_s: f32,
    /// Turn of the probe about +Y, degrees.
    #[arg(long, default_value_t = 0.0, value_parser = degrees, allow_negative_numbers = true)]
    pub(super) rotation: f32,
}

/// Centres of the four corner patches, pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corners(pub(super) [[f64; 2]; 4]);

fn number(text: &str) -> Option<f64> {
    let value = match text.split_once('/') {
        Some((a, b)) => a.trim().parse::<f64>().ok()? / b.trim().parse::<f64>().ok()?,
        None => text.trim().parse().ok()?,
    };
    value.is_finite().then_some(value)
}

fn exposure(text: &str) -> Result<f64, String> {
    // Beyond these, radiances are no longer numbers of single precision.
    let found = number(text).filter(|t| (1e-9..=1e9).contains(t));
    found.ok_or_else(|| "must be seconds > 0 (1e-9 to 1e9), such as 0.004 or 1/250".to_owned())
}

fn within(text: &str, low: f64, high: f64) -> Result<f32, String> {
    let found = number(text).filter(|x| (low..=high).contains(x));
    found
        .map(|x| x as f32)
        .ok_or_else(|| format!("must be a number from {low} to {high}"))
}

fn saturation(text: &str) -> Result<f32, String> {
    within(text, 0.5, 1.0)
}

fn share(text: &str) -> Result<f32, String> {
    within(text, 1e-6, 1.0)
}

fn positive(text: &str) -> Result<f32, String> {
    within(text, 1e-6, 1e6)
}

fn elevation(text: &str) -> Result<f32, String> {
    within(text, -89.0, 89.0)
}

fn degrees(text: &str) -> Result<f32, String> {
    within(text, -360.0, 360.0)
}

fn grid(text: &str) -> Result<(usize, usize), String> {
    let parse = |part: &str| part.parse().ok().filter(|n| (1..=100).contains(n));
    match text.split_once('x').map(|(a, b)| (parse(a), parse(b))) {
        Some((Some(columns), Some(rows))) if columns > 1 && rows > 1 => Ok((columns, rows)),
        _ => Err("must be COLUMNSxROWS, each from 2 to 100, such as 6x4".to_owned()),
    }
}

fn corners(text: &str) -> Result<Corners, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(number).collect();
    match numbers[..] {
        [a, b, c, d, e, f, g, h] => Ok(Corners([[a, b], [c, d], [e, f], [g, h]])),
        _ => Err("must be eight numbers: x,y of the four corner patches".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_refused() {
        assert_eq!(exposure("1/8"), Ok(0.125));
        for wrong in ["0", "-1", "1/0", "nan", "a", "1/"] {
            assert!(exposure(wrong).is_err(), "{wrong}");
        }
        assert!(grid("6x4") == Ok((6, 4)) && grid("1x4").is_err() && grid("6").is_err());
        assert!(corners("1,2,3,4,5,6,7,8").is_ok() && corners("1,2,3").is_err());
        assert!(saturation("0.4").is_err() && saturation("0.9").is_ok());
    }
}
