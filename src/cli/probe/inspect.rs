//! `turnlight probe inspect`.

use glam::Vec3;
use serde_json::json;

use super::arguments::Inspect;
use crate::cli::arguments::Common;
use crate::cli::failure::Failure;
use crate::cli::outputs::check_outputs;
use crate::cli::progress::{note, say, write_stats, write_text};
use crate::estimate::{CapturePlan, FORECAST_ALPHAS, Forecast, Forecaster, Lamp};
use crate::image::{Depth, Mask, RgbImage};
use crate::probe::{Environment, Inspection, LightPyramid};
use crate::report::{ProbePage, write_probe_page};

/// The lamp that is tried: 4° across, a quarter of the present light.
const LAMP_RADIUS_DEG: f32 = 2.0;
const LAMP_SHARE: f32 = 0.25;

pub(super) fn run(arguments: &Inspect, common: &Common) -> Result<(), Failure> {
    check_outputs([
        ("--out", Some(arguments.out.as_path())),
        ("--json", arguments.json.as_deref()),
    ])?;
    let path = &arguments.probe;
    let (image, depth) = RgbImage::read_samples(path)?;
    let image = match depth {
        Depth::Bits8 | Depth::Bits16 => RgbImage::read(path)?,
        Depth::Float | Depth::Raw => image,
    };
    for doubt in doubts(&image, depth) {
        note(common, &format!("note: {}: {doubt}", path.display()));
    }
    let input = |reason: String| Failure::Input(anyhow::anyhow!("{}: {reason}", path.display()));
    let (environment, repaired) =
        Environment::new(image, f64::from(arguments.rotation).to_radians())
            .map_err(|error| input(error.to_string()))?;
    let repairs = repaired.to_string();
    if !repairs.is_empty() {
        note(common, &format!("note: {}: {repairs}", path.display()));
    }
    // What `probe merge` found saturated, where it lies beside the probe.
    let mask = path.with_extension("clipped.png");
    let clipped_texels = if mask.exists() {
        let mask = Mask::read(&mask)?;
        Some(mask.pixels.iter().filter(|&&m| m != 0).count())
    } else {
        None
    };

    let inspection = Inspection::of(&environment);
    let pyramid = LightPyramid::new(&environment);
    let (sin_e, cos_e) = arguments.elevation.to_radians().sin_cos();
    let (sin_a, cos_a) = arguments.azimuth.to_radians().sin_cos();
    let plan = CapturePlan {
        wo: Vec3::new(cos_e * sin_a, sin_e, cos_e * cos_a).normalize(),
        frames: arguments.frames,
        noise: arguments.noise,
        rho_d: arguments.rho_d,
        rho_s: arguments.rho_s,
        eta: 1.3,
    };
    let forecaster = Forecaster::new(&pyramid, plan);
    let forecast = forecaster.forecast();
    let lamp = forecaster.best_lamp(LAMP_RADIUS_DEG.to_radians(), LAMP_SHARE);

    let record = json!({
        "turnlight": env!("CARGO_PKG_VERSION"),
        "probe": path.display().to_string(),
        "repairs": repairs,
        "clipped_texels_of_merge": clipped_texels,
        "inspection": inspection,
        "forecast": figures(&forecast),
        "lamp": {
            "direction": lamp.0.direction.to_array(),
            "radius_deg": LAMP_RADIUS_DEG,
            "flux_share": LAMP_SHARE,
            "forecast": figures(&lamp.1),
        },
    });
    let page = ProbePage {
        path,
        environment: &environment,
        inspection: &inspection,
        repairs: &repairs,
        clipped_texels,
        plan: &plan,
        forecast: &forecast,
        lamp: (&lamp.0, &lamp.1),
    };
    write_probe_page(&page, &arguments.out)?;
    if let Some(file) = &arguments.json {
        let text = serde_json::to_string_pretty(&record).map_err(anyhow::Error::from)?;
        write_text(file, &text)?;
    }
    tell(&inspection, &forecast, &lamp);
    note(common, &format!("{}: written", arguments.out.display()));
    write_stats(common, &record)
}

/// What a light probe would not be.
fn doubts(image: &RgbImage, depth: Depth) -> Vec<String> {
    let mut doubts = Vec::new();
    if image.width != 2 * image.height {
        doubts.push(format!(
            "size = {} × {}: a lat-long map of the whole sphere is twice as wide as high; what this file holds is \
             stretched over the sphere",
            image.width, image.height
        ));
    }
    if depth != Depth::Float {
        doubts.push(format!(
            "samples = {depth:?}: a single photograph saturates at its lamps; merge exposures with `turnlight probe merge`"
        ));
    }
    doubts
}

/// JSON has no infinity: what cannot be known is null.
fn figures(forecast: &Forecast) -> serde_json::Value {
    let rows: Vec<serde_json::Value> = (FORECAST_ALPHAS.iter().enumerate())
        .map(|(k, alpha)| {
            json!({
                "alpha": alpha,
                "median_sigma_ln_alpha": forecast.median(k),
                "unknown_share": forecast.unknown(k),
                "elevations_deg": forecast.elevations,
                "sigma_ln_alpha": forecast.sigma[k],
            })
        })
        .collect();
    rows.into()
}

fn tell(inspection: &Inspection, forecast: &Forecast, (lamp, with): &(Lamp, Forecast)) {
    say(&format!(
        "{} × {}, range {:.1e}, {} sources",
        inspection.width,
        inspection.height,
        inspection.range(),
        inspection.source_count
    ));
    for source in &inspection.sources {
        let [x, y, z] = source.direction;
        let mut line = format!(
            "source at ({x:+.3}, {y:+.3}, {z:+.3}): radius {:.2}°, {:.1} % of the light, peak {:.3e}",
            source.radius_deg,
            100.0 * source.flux_share,
            source.peak
        );
        if let Some(texels) = source.plateau_texels {
            line.push_str(&format!(
                "; {texels} of {} texels look cut off",
                source.texels
            ));
        }
        if let Some(halo) = source.halo {
            line.push_str(&format!("; halo of {halo:.1e} of its peak"));
        }
        say(&line);
    }
    let percent = |x: f64| {
        if x.is_finite() {
            format!("{:.1} %", 100.0 * x)
        } else {
            "unknown".to_owned()
        }
    };
    for (k, alpha) in FORECAST_ALPHAS.iter().enumerate() {
        say(&format!(
            "alpha {alpha}: expected error {} in the median, {:.0} % of the normals unknown; with the lamp {}",
            percent(forecast.median(k)),
            100.0 * forecast.unknown(k),
            percent(with.median(k))
        ));
    }
    let d = lamp.direction;
    say(&format!(
        "a lamp of {} ° across helps most at ({:+.3}, {:+.3}, {:+.3})",
        2.0 * LAMP_RADIUS_DEG,
        d.x,
        d.y,
        d.z
    ));
}
