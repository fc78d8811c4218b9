//! What is typed.

use std::ops::Range;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};

use crate::estimate::FresnelModel;
use crate::render::Skip;

/// Measures what an object's surface is made of from a turntable video and a light probe.
#[derive(Debug, Parser)]
#[command(name = "turnlight", version, propagate_version = true)]
pub(super) struct Cli {
    #[command(subcommand)]
    pub(super) command: Command,
    #[command(flatten)]
    pub(super) common: Common,
}

/// Options of every command.
#[derive(Args, Debug, Default)]
pub(super) struct Common {
    /// Threads to use; all cores unless given. Results do not depend on it.
    #[arg(long, global = true, value_parser = threads)]
    pub(super) threads: Option<usize>,
    /// Write counters and timings to this JSON file.
    #[arg(long, global = true, value_name = "FILE.json")]
    pub(super) stats: Option<PathBuf>,
    /// Say nothing but errors and results.
    #[arg(long, global = true)]
    pub(super) quiet: bool,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// The whole job on the shipped scene: render, fit, reproduce, compare, report.
    Demo(Demo),
    /// Render a turntable sequence of a scene.toml into a capture folder.
    Render(Render),
    /// Find object and turntable from the object's outlines in a capture.
    Register(Register),
    /// Recover the material of a capture (a folder with capture.toml).
    Fit(Fit),
    /// Render the estimate of a fit, in the capture's light or another.
    Reproduce(Reproduce),
    /// Errors between two images or two sequences: PSNR, SSIM, relative MSE.
    Compare(Compare),
    /// Hand a scene or a fit to other programs.
    Export(Export),
    /// From the light probe's photographs to a light that can be trusted.
    #[command(subcommand)]
    Probe(super::probe::Probe),
    /// One self-contained HTML page about a fit.
    Report(Report),
    /// The lens from chessboard photographs, or cameras from other programs' files.
    #[command(subcommand)]
    Camera(super::camera::Camera),
}

#[derive(Args, Debug)]
pub(super) struct Demo {
    /// Folder for everything the demo makes.
    #[arg(long, default_value = "turnlight-demo")]
    pub(super) out: PathBuf,
}

/// How images are sampled.
#[derive(Args, Clone, Debug)]
pub(super) struct Sampling {
    /// Paths per pixel.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    pub(super) spp: u32,
    /// As many paths as each part of a frame needs for this relative RMSE, 0.001 to 1; instead of
    /// --spp.
    #[arg(long, conflicts_with = "spp", value_parser = relative_error, value_name = "E")]
    pub(super) target_error: Option<f32>,
    /// Do what is not needed all the same, to see what it costs: background, proven-open, negligible,
    /// zero-lobes, explored, smooth; several with commas.
    #[arg(long, value_parser = skip, value_delimiter = ',', value_name = "NAME")]
    pub(super) no_skip: Vec<Skip>,
    /// Longest path in edges, as renderers count: 2 is direct light only, 3 one interreflection.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(2..=1024))]
    pub(super) max_depth: u32,
    /// Seed of all random choices.
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,
    /// Only these frames, A..B with B excluded.
    #[arg(long, value_parser = frame_range, value_name = "A..B")]
    pub(super) frames: Option<Range<usize>>,
    /// Go on where an interrupted run with the same settings stopped.
    #[arg(long)]
    pub(super) resume: bool,
}

#[derive(Args, Debug)]
pub(super) struct Render {
    /// scene.toml, or the folder that holds it.
    pub(super) scene: PathBuf,
    /// Capture folder to write.
    #[arg(long)]
    pub(super) out: PathBuf,
    #[command(flatten)]
    pub(super) sampling: Sampling,
    /// Also write depth, normal and triangle at pixel centres to aovs/.
    #[arg(long)]
    pub(super) aovs: bool,
}

#[derive(Args, Debug)]
pub(super) struct Register {
    /// capture.toml with a rough pose, or the folder that holds it.
    pub(super) capture: PathBuf,
    /// Folder to write: capture.toml, register.json, register.html, overlays/; `registered` beside the
    /// capture.toml unless given.
    #[arg(long)]
    pub(super) out: Option<PathBuf>,
    /// Start from clicked pairs: a TOML file of mesh points and their pixels in one frame.
    #[arg(long, value_name = "FILE.toml")]
    pub(super) pairs: Option<PathBuf>,
    /// What is refined: the object's pose, the turntable's axis and centre too, or also every frame's angle.
    #[arg(long, value_enum, default_value = "turntable")]
    pub(super) refine: RefineName,
    /// What stays of camera and turntable, whose common motion no image shows.
    #[arg(long, value_enum, default_value = "camera")]
    pub(super) hold: HoldName,
    /// What masks mean: covered shares; 255 where the whole pixel is covered; 255 where its centre is.
    /// `auto`: shares if there are values between 0 and 255, else whole pixels.
    #[arg(long, value_enum, default_value = "auto")]
    pub(super) mask_border: MaskBorderName,
    /// Find the outlines in the photographs, whatever masks there are; frames without a mask always do.
    #[arg(long)]
    pub(super) no_masks: bool,
    /// Besides the masks, use the photographs' edges where the object stands before itself.
    #[arg(long, conflicts_with = "no_masks")]
    pub(super) edges: bool,
    /// How far off the outlines may be at the start, pixels; a fifth of the object unless given.
    #[arg(long, value_parser = pixels, value_name = "PIXELS")]
    pub(super) search: Option<f64>,
    /// Keep as given what the frames do not determine, such as the turn of a sphere.
    #[arg(long)]
    pub(super) keep_unknown: bool,
    /// Also replace the capture.toml that was read.
    #[arg(long)]
    pub(super) in_place: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum RefineName {
    Pose,
    Turntable,
    Angles,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum HoldName {
    Camera,
    Turntable,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum MaskBorderName {
    Auto,
    Coverage,
    Whole,
    Half,
}

#[derive(Args, Debug)]
pub(super) struct Fit {
    /// capture.toml, or the folder that holds it.
    pub(super) capture: PathBuf,
    /// Fit folder to write.
    #[arg(long)]
    pub(super) out: PathBuf,
    #[command(flatten)]
    pub(super) choices: FitChoices,
}

/// What a fit may choose.
#[derive(Args, Clone, Debug)]
pub(super) struct FitChoices {
    /// `full`: variable projection with error bars; `gradient`: the paper's method; `unknown-light`: the
    /// same, but the light is estimated, too, and of the probe only its mean radiance is used.
    #[arg(long, value_enum, default_value = "full")]
    pub(super) estimator: EstimatorName,
    /// Lobe shape; `auto` tries both and keeps the smaller residual; `tabulated` does so and also writes a
    /// density over the half angle without a formula to ndf.npz, best with `--pool material|object`.
    #[arg(long, value_enum, default_value = "auto")]
    pub(super) ndf: NdfName,
    /// Colour of the specular albedo: one value, one per channel, or whichever the evidence of all
    /// points asks for.
    #[arg(long, value_enum, default_value = "neutral")]
    pub(super) specular: SpecularName,
    /// Points that share a lobe; rho_d is always each one's own. `smooth`: neighbours whose data agree;
    /// `material`: all of a material, of which as many are found as the data ask for; `object`: all.
    #[arg(long, value_enum, default_value = "none")]
    pub(super) pool: PoolName,
    /// Fresnel term: `eta=X`, exact dielectric of index X; `schlick`, with F0 by channel and F90, for
    /// metals; `auto`, by the evidence of all points: a dielectric of index 1.3 to 1.8, or
    /// Schlick's, neutral or RGB.
    #[arg(long, default_value = "eta=1.3", value_parser = fresnel)]
    pub(super) fresnel: FresnelModel,
    /// Surface points: `vertices`, or `texels=N` for an N × N map; a mesh without UVs gets charts.
    #[arg(long, default_value = "vertices", value_parser = points)]
    pub(super) points: PointsChoice,
    /// Rounds of interreflection; 0 takes the object's own light as black.
    #[arg(long, default_value_t = 2)]
    pub(super) interreflections: u32,
    /// About how many light nodes an observation gets: more is slower and closer.
    #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(16..=1 << 20))]
    pub(super) light_nodes: u32,
    /// Half-angle, degrees, of the window about the mirror direction (`gradient` only).
    #[arg(long, default_value_t = 90.0)]
    pub(super) window: f32,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum EstimatorName {
    Full,
    Gradient,
    UnknownLight,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum NdfName {
    Auto,
    Beckmann,
    Ggx,
    Tabulated,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum SpecularName {
    Auto,
    Neutral,
    Rgb,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum PoolName {
    None,
    Smooth,
    Material,
    Object,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PointsChoice {
    Vertices,
    Texels(usize),
}

#[derive(Args, Debug)]
pub(super) struct Reproduce {
    /// Fit folder.
    pub(super) fit: PathBuf,
    /// Capture folder to write.
    #[arg(long)]
    pub(super) out: PathBuf,
    /// Another light probe; the capture's unless given.
    #[arg(long)]
    pub(super) probe: Option<PathBuf>,
    /// Turn of that probe about +Y, degrees.
    #[arg(long, default_value_t = 0.0, requires = "probe")]
    pub(super) probe_rotation: f64,
    #[command(flatten)]
    pub(super) sampling: Sampling,
}

#[derive(Args, Debug)]
pub(super) struct Compare {
    /// Reference: an image, a folder of images, or a capture (its folder, or capture.toml).
    pub(super) reference: PathBuf,
    /// What is compared with it, of the same kind.
    pub(super) test: PathBuf,
    /// Folder of masks; a capture's own unless given.
    #[arg(long)]
    pub(super) masks: Option<PathBuf>,
    /// Also write the figures to this JSON file.
    #[arg(long, value_name = "FILE")]
    pub(super) json: Option<PathBuf>,
}

#[derive(Args, Debug)]
pub(super) struct Export {
    /// Format.
    #[arg(value_enum)]
    pub(super) format: ExportFormat,
    /// Fit folder, or scene.toml (or its folder).
    pub(super) source: PathBuf,
    /// Folder to write.
    #[arg(long)]
    pub(super) out: PathBuf,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum ExportFormat {
    /// scene.xml for Mitsuba 3 with mesh, probe and maps; renders the same image.
    Mitsuba,
}

#[derive(Args, Debug)]
pub(super) struct Report {
    /// Fit folder.
    pub(super) fit: PathBuf,
    /// Reproduction to show beside the observation (a folder that `reproduce` wrote).
    #[arg(long)]
    pub(super) reproduced: Option<PathBuf>,
    /// Page to write.
    #[arg(long, default_value = "report.html")]
    pub(super) out: PathBuf,
}

fn threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n) if (1..=1024).contains(&n) => Ok(n),
        _ => Err("must be a number from 1 to 1024".to_owned()),
    }
}

fn skip(text: &str) -> Result<Skip, String> {
    let named = Skip::ALL.into_iter().find(|(_, name)| *name == text);
    let names = Skip::ALL.map(|(_, name)| name).join(", ");
    named
        .map(|(skip, _)| skip)
        .ok_or_else(|| format!("must be one of {names}"))
}

fn relative_error(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(error) if (0.001..=1.0).contains(&error) => Ok(error),
        _ => Err("must be from 0.001 (a thousandth) to 1".to_owned()),
    }
}

fn pixels(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(pixels) if (1.0..=65536.0).contains(&pixels) => Ok(pixels),
        _ => Err("must be from 1 to 65536 pixels".to_owned()),
    }
}

fn frame_range(text: &str) -> Result<Range<usize>, String> {
    let parse = |part: &str| part.parse::<usize>().ok();
    match text.split_once("..").map(|(a, b)| (parse(a), parse(b))) {
        Some((Some(a), Some(b))) if a < b => Ok(a..b),
        _ => Err("must be A..B with A < B, such as 0..12 for the first twelve".to_owned()),
    }
}

fn fresnel(text: &str) -> Result<FresnelModel, String> {
    match (text, text.strip_prefix("eta=").map(str::parse::<f32>)) {
        ("schlick", _) => Ok(FresnelModel::Schlick),
        ("auto", _) => Ok(FresnelModel::Auto),
        (_, Some(Ok(eta))) if eta > 1.0 && eta <= 4.0 => Ok(FresnelModel::Dielectric { eta }),
        _ => Err(
            "must be eta=X with X above 1 and at most 4, such as eta=1.3, or schlick, or auto"
                .to_owned(),
        ),
    }
}

fn points(text: &str) -> Result<PointsChoice, String> {
    if text == "vertices" {
        return Ok(PointsChoice::Vertices);
    }
    match text.strip_prefix("texels=").map(str::parse::<usize>) {
        Some(Ok(n)) if (1..=16384).contains(&n) => Ok(PointsChoice::Texels(n)),
        _ => Err("must be vertices, or texels=N with N from 1 to 16384".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn values_out_of_range_are_refused() {
        assert!(frame_range("3..3").is_err() && frame_range("a..2").is_err());
        assert_eq!(frame_range("3..5").unwrap(), 3..5);
        assert!(
            fresnel("1.3").is_err() && fresnel("eta=0.9").is_err() && fresnel("eta=nan").is_err()
        );
        assert!(points("texels=0").is_err() && points("texels=64") == Ok(PointsChoice::Texels(64)));
    }
}
