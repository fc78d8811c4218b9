//! The page itself.

use std::io;

use maud::{Markup, PreEscaped, html};

use super::charts::{colour_bar, histogram, line, short};
use super::densities::densities_of;
use super::document::document;
use super::views::{Legend, ParameterView, STATUS_COLOURS, difference, quantile};
use super::{Observation, ReportError, ShownFrame, embed};
use crate::compare::SequenceErrors;
use crate::export::{NdfTable, PointTable};
use crate::image::ToneCurve;

/// Names of the status codes and what they mean.
const STATUS: [(&str, &str); 6] = [
    (
        "converged",
        "a minimum inside the range of alpha, which the data determine",
    ),
    (
        "unidentifiable",
        "the data do not tell alpha, for the reasons below; the diffuse albedo may still be good",
    ),
    ("alpha at bound", "the best alpha is at an end of its range"),
    ("too few samples", "fewer usable samples than unknowns"),
    ("unseen", "never seen by the camera"),
    ("saturated", "every sample is saturated"),
];

/// Why a point's roughness is not told, by code less one.
const REASONS: [(&str, &str); 6] = [
    ("too few frames", "to tell a lobe from diffuse light"),
    (
        "no highlight",
        "a specular albedo of 1 would not be noticed in any frame",
    ),
    (
        "collinear",
        "what a lobe would show is, to the noise, a multiple of the diffuse light",
    ),
    (
        "lobe below noise",
        "a specular albedo of 1 would be noticed, and there is none above the noise",
    ),
    (
        "two minima",
        "two roughnesses, or Beckmann and GGX at different ones, explain the data about equally well",
    ),
    (
        "width undetermined",
        "a lobe is seen, but not how wide it is",
    ),
];

/// What the page shows.
pub(super) struct Page<'a> {
    /// `fit.toml`.
    pub(super) record: &'a toml::Table,
    pub(super) table: &'a PointTable,
    /// Tabulated NDFs, if there are any.
    pub(super) densities: Option<&'a NdfTable>,
    pub(super) observation: &'a Result<Observation, ReportError>,
    pub(super) views: &'a [ParameterView],
}

/// The page as one file.
pub(super) fn page(content: &Page<'_>) -> io::Result<String> {
    let Page {
        record,
        table,
        densities,
        observation,
        views,
    } = *content;
    let observed = observed(observation)?;
    let views = views
        .iter()
        .map(|view| Ok((view, embed::display(view.width, view.height, &view.pixels)?)))
        .collect::<io::Result<Vec<_>>>()?;
    let body = html! {
        h1 { "Material of a turntable capture" }
        @for key in ["capture", "points", "turnlight"] {
            @if let Some(value) = record.get(key).and_then(toml::Value::as_str) {
                div { b { (key) } ": " (value) }
            }
        }
        h2 { "Observed and reproduced" }
        (observed)
        h2 { "Parameters on the object" }
        p {
            "From the camera, and from behind. Where the data do not determine a value, the colour is "
            "that of the neighbours, as in the reproduction: " b { (filled_count(table)) } " of "
            (table.len()) " points were not seen, or show no highlight that tells their lobe."
        }
        @for (view, uri) in &views {
            figure {
                img src=(uri) width=(view.width) height=(view.height);
                figcaption { b { (view.title) } (legend(&view.legend)) }
            }
        }
        h2 { "How the points ended" }
        (status_counts(table))
        (reason_counts(table))
        h2 { "Parameters of the converged points" }
        (parameters(table))
        (fresnel_counts(table))
        @if let Some(densities) = densities { (densities_of(densities)) }
        h2 { "Settings, counters, seconds" }
        @for (name, value) in record {
            @if let Some(section) = value.as_table() { (settings(name, section)) }
        }
    };
    Ok(document("material of a capture", &body))
}

/// The observed frames with the comparison, or why they are not here.
fn observed(observation: &Result<Observation, ReportError>) -> io::Result<Markup> {
    let observation = match observation {
        Ok(observation) => observation,
        Err(error) => return Ok(html! { p { "The observation cannot be shown: " (error) } }),
    };
    let frames = frame_rows(&observation.frames, observation.errors.as_ref())?;
    Ok(html! {
        @if let Some(errors) = &observation.errors { (comparison(errors)) }
        @else { p { "No reproduction was given; see " code { "turnlight reproduce" } "." } }
        (frames)
    })
}

fn legend(legend: &Legend) -> Markup {
    match legend {
        Legend::Words(words) => html! { ": " (words) },
        Legend::Scale { low, high } => html! {
            div { (short(*low)) " " (PreEscaped(colour_bar())) " " (short(*high)) ", logarithmic" }
        },
    }
}

/// Points whose lobe is not their own in a reproduction.
fn filled_count(table: &PointTable) -> usize {
    table.borrowed.iter().filter(|&&b| b != 0).count()
}

fn comparison(errors: &SequenceErrors) -> Markup {
    let overall = &errors.overall;
    let psnr: Vec<f64> = errors
        .frames
        .iter()
        .map(|frame| frame.errors.psnr_db)
        .collect();
    html! {
        p {
            "Over the object's pixels of all " (errors.frames.len()) " frames: PSNR "
            b { (format!("{:.2}", overall.psnr_db)) } " dB, SSIM " b { (overall.ssim.map_or("–".to_owned(), |s| format!("{s:.4}"))) }
            ", relative MSE " b { (format!("{:.2e}", overall.rel_mse)) }
            ". The observation's own noise is part of these errors."
        }
        figure { (PreEscaped(line(&psnr))) figcaption { "PSNR by frame, dB" } }
    }
}

fn frame_rows(frames: &[ShownFrame], errors: Option<&SequenceErrors>) -> io::Result<Markup> {
    let exposure = errors.map_or_else(|| exposure_of(frames), |errors| errors.exposure);
    let curve = ToneCurve { exposure };
    let mut rows = Vec::new();
    for frame in frames {
        let mut images = vec![("observed", embed::radiance(&frame.observed, curve)?)];
        if let Some(reproduced) = &frame.reproduced {
            images.push(("reproduced", embed::radiance(reproduced, curve)?));
            if let Some(difference) = difference(&frame.observed, reproduced) {
                images.push(("difference × 8", embed::radiance(&difference, curve)?));
            }
        }
        rows.push((frame, images));
    }
    Ok(html! {
        @for (frame, images) in &rows {
            div {
                @for (title, uri) in images {
                    figure {
                        img src=(uri) width=(frame.observed.width) height=(frame.observed.height);
                        figcaption { (frame.name) ", " (title) }
                    }
                }
            }
        }
    })
}

/// Maps the 99th percentile of the brightest channel to white.
fn exposure_of(frames: &[ShownFrame]) -> f64 {
    let mut peaks: Vec<f32> = frames
        .iter()
        .flat_map(|frame| frame.observed.pixels.iter())
        .map(|p| p[0].max(p[1]).max(p[2]))
        .filter(|&v| v > 0.0)
        .collect();
    let white = quantile(&mut peaks, 0.99);
    if white > 0.0 {
        1.0 / f64::from(white)
    } else {
        1.0
    }
}

fn status_counts(table: &PointTable) -> Markup {
    html! {
        table {
            @for (code, (name, meaning)) in STATUS.iter().enumerate() {
                @let count = table.status.iter().filter(|&&s| s == code as i32).count();
                @let [r, g, b] = STATUS_COLOURS[code];
                tr {
                    td { span.dot style=(format!("background:rgb({r},{g},{b})")) {} (name) }
                    td { (count) }
                    td { (meaning) }
                }
            }
        }
    }
}

/// Fresnel terms of the converged points, with how many.
fn fresnel_counts(table: &PointTable) -> Markup {
    let converged = || (0..table.len()).filter(|&i| table.status[i] == 0);
    let schlick = converged().filter(|&i| table.fresnel[i] == 1).count();
    let mut indices: Vec<f32> = converged()
        .filter(|&i| table.fresnel[i] == 0)
        .map(|i| table.eta[i])
        .filter(|eta| eta.is_finite())
        .collect();
    indices.sort_unstable_by(f32::total_cmp);
    html! {
        table {
            @for same in indices.chunk_by(|a, b| a == b) {
                tr { td { "dielectric of index " (same[0]) } td { (same.len()) } td { "converged points" } }
            }
            @if schlick > 0 {
                tr { td { "Schlick's Fresnel term" } td { (schlick) } td { "converged points" } }
            }
        }
    }
}

/// Reasons that points have, with how many.
fn reason_counts(table: &PointTable) -> Markup {
    let count = |code: usize| table.reason.iter().filter(|&&r| r == code as i32).count();
    html! {
        @if (1..=REASONS.len()).any(|code| count(code) > 0) {
            table {
                @for (code, (name, meaning)) in (1..).zip(REASONS) {
                    @if count(code) > 0 {
                        tr { td { (name) } td { (count(code)) } td { (meaning) } }
                    }
                }
            }
        }
    }
}

fn parameters(table: &PointTable) -> Markup {
    let converged: Vec<usize> = (0..table.len()).filter(|&i| table.status[i] == 0).collect();
    let select = |value: &dyn Fn(usize) -> f32| -> Vec<f32> {
        converged.iter().map(|&i| value(i)).collect()
    };
    let rows: [(&str, Vec<f32>); 8] = [
        ("rho_d red", select(&|i| table.rho_d[i][0])),
        ("rho_d green", select(&|i| table.rho_d[i][1])),
        ("rho_d blue", select(&|i| table.rho_d[i][2])),
        ("rho_s", select(&|i| table.rho_s[i][1])),
        ("alpha", select(&|i| table.alpha[i])),
        (
            "sigma of alpha / alpha",
            select(&|i| table.sigma_alpha[i] / table.alpha[i]),
        ),
        ("share of GGX", select(&|i| table.ndf[i] as f32)),
        ("relative residual", select(&|i| table.residual[i])),
    ];
    let strongest = quantile(&mut rows[3].1.clone(), 0.98).max(0.1);
    html! {
        table {
            tr { th { "parameter" } th { "lower quartile" } th { "median" } th { "upper quartile" } }
            @for (name, values) in &rows {
                tr {
                    td { (name) }
                    @for share in [0.25, 0.5, 0.75] { td { (short(quantile(&mut values.clone(), share))) } }
                }
            }
        }
        figure { (PreEscaped(histogram(&rows[4].1, 0.01, 1.0, true))) figcaption { "alpha" } }
        figure { (PreEscaped(histogram(&rows[3].1, 0.0, strongest, false))) figcaption { "rho_s" } }
        figure { (PreEscaped(histogram(&rows[7].1, 0.001, 1.0, true))) figcaption { "relative residual" } }
    }
}

fn settings(name: &str, section: &toml::Table) -> Markup {
    html! {
        h3 { (name) }
        table {
            @for (key, value) in section {
                tr { td { (key) } td { (value.to_string()) } }
            }
        }
    }
}
