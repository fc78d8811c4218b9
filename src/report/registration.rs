//! What a registration found, in words, as JSON and as a page.

use std::fmt::Write;
use std::io;
use std::path::Path;

use maud::{Markup, PreEscaped, html};
use serde_json::json;

use super::charts::line;
use super::document::document;
use super::overlay::LEGEND;
use super::{ReportError, embed};
use crate::image::write_atomically;
use crate::rig::registration::{FrameAgreement, MaskBorder, Registered, Settings, Stop};
use crate::scene::Capture;

/// Everything that the page says.
pub struct RegistrationPage<'a> {
    /// The capture.toml that was read.
    pub capture: &'a str,
    /// What was found, the camera held.
    pub registered: &'a Registered,
    /// The capture that is written.
    pub result: &'a Capture,
    /// What was refined.
    pub settings: &'a Settings,
    /// What the masks were taken for; `None` without masks.
    pub border: Option<MaskBorder>,
    /// What stayed as given, in words.
    pub held: &'a [&'static str],
}

/// A parameter, three numbers and their standard deviations in words.
struct Row {
    name: &'static str,
    value: String,
    sigma: String,
}

/// Overlays on the page: what disagrees most, then some of the rest.
const SHOWN: usize = 8;

impl RegistrationPage<'_> {
    /// The same as `register.json`: angles in degrees, infinite or missing numbers as null.
    pub fn json(&self) -> serde_json::Value {
        let (registered, sigma) = (self.registered, &self.registered.sigma);
        let pose = &self.result.object.object_from_file;
        let degrees = |x: f64| x.to_degrees();
        let frames: Vec<serde_json::Value> = (registered.frames.iter().zip(&self.result.frames))
            .map(|(frame, photograph)| {
                json!({
                    "image": name_of(&photograph.image),
                    "angle_deg": degrees(frame.angle),
                    "rms_pixels": frame.rms,
                    "within_a_pixel": frame.near,
                    "mask_overlap": frame.overlap,
                    "better_angle_by_deg": frame.angle_offset.map(degrees),
                    "better_angle_sigma_deg": frame.angle_sigma.map(degrees),
                    "disagrees": frame.disagrees,
                })
            })
            .collect();
        json!({
            "turnlight": env!("CARGO_PKG_VERSION"),
            "capture": self.capture,
            "settings": self.settings,
            "mask_border": self.border,
            "held": self.held,
            "undetermined": registered.unknown,
            "stop": registered.stop,
            "rounds": registered.rounds,
            "outline_sigma_pixels": registered.scale,
            "object": {
                "rotation_deg": pose.rotation.to_scaled_axis().to_array().map(degrees),
                "translation": pose.translation.to_array(),
                "scale": pose.scale,
                "sigma_rotation_deg": sigma.rotation.map(degrees),
                "sigma_translation_of_middle": sigma.translation,
                "middle": sigma.middle,
            },
            "turntable": {
                "axis": self.result.turn.axis.to_array(),
                "center": self.result.turn.center.to_array(),
                "across": sigma.across,
                "sigma_axis_deg": sigma.axis.map(degrees),
                "sigma_center": sigma.center,
            },
            "frames": frames,
        })
    }

    fn rows(&self) -> Vec<Row> {
        let pose = &self.result.object.object_from_file;
        let (turn, sigma) = (&self.result.turn, &self.registered.sigma);
        let triple = |v: [f64; 3], digits: usize| {
            let [x, y, z] = v.map(|c| format!("{c:.digits$}"));
            format!("[{x}, {y}, {z}]")
        };
        let deviations = |all: &[f64]| {
            let words: Vec<String> = all.iter().map(|s| deviation(*s)).collect();
            words.join(", ")
        };
        vec![
            Row {
                name: "object: rotation, degrees",
                value: triple(
                    pose.rotation
                        .to_scaled_axis()
                        .to_array()
                        .map(f64::to_degrees),
                    4,
                ),
                sigma: deviations(&sigma.rotation.map(f64::to_degrees)),
            },
            Row {
                name: "object: translation",
                value: triple(pose.translation.to_array(), 6),
                sigma: deviations(&sigma.translation),
            },
            Row {
                name: "turntable: axis, sigma in degrees",
                value: triple(turn.axis.to_array(), 6),
                sigma: deviations(&sigma.axis.map(f64::to_degrees)),
            },
            Row {
                name: "turntable: center",
                value: triple(turn.center.to_array(), 6),
                sigma: deviations(&sigma.center),
            },
        ]
    }

    fn disagreeing(&self) -> impl Iterator<Item = (usize, &FrameAgreement)> {
        let frames = self.registered.frames.iter().enumerate();
        frames.filter(|(_, frame)| !frame.disagrees.is_empty())
    }

    fn summary(&self) -> String {
        let registered = self.registered;
        let count = registered.frames.len();
        let ended = match registered.stop {
            Stop::Converged => "converged",
            Stop::IterationLimit => "did not settle",
        };
        format!(
            "{count} frames, outlines {:.3} pixels off (robust), {ended} in {} rounds; {} frames disagree",
            registered.scale,
            registered.rounds,
            self.disagreeing().count()
        )
    }
}

fn deviation(sigma: f64) -> String {
    if sigma == 0.0 {
        "held".to_owned()
    } else if sigma.is_finite() {
        format!("{sigma:.1e}")
    } else {
        "undetermined".to_owned()
    }
}

fn name_of(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// What a registration found, in words.
pub fn registration_text(page: &RegistrationPage<'_>) -> String {
    let mut text = format!("{}: {}\n", page.capture, page.summary());
    // Writing to a String cannot fail.
    for row in page.rows() {
        let _ = writeln!(text, "  {}: {} sigma {}", row.name, row.value, row.sigma);
    }
    let _ = writeln!(text, "  held: {}", page.held.join(", "));
    for unknown in &page.registered.unknown {
        let _ = writeln!(text, "  undetermined, kept as given: {unknown}");
    }
    for (number, frame) in page.disagreeing() {
        let _ = writeln!(
            text,
            "  frame {number} disagrees: {}",
            frame.disagrees.join("; ")
        );
    }
    text
}

/// Writes the page to `out`; `overlays` holds a picture of every frame, `NNNN.png`.
pub fn write_registration_page(
    out: &Path,
    overlays: &Path,
    page: &RegistrationPage<'_>,
) -> Result<(), ReportError> {
    let failed = |source| ReportError::Write {
        path: out.to_owned(),
        source,
    };
    let html = render(overlays, page).map_err(failed)?;
    write_atomically(out, |file| io::Write::write_all(file, html.as_bytes())).map_err(failed)
}

fn render(overlays: &Path, page: &RegistrationPage<'_>) -> io::Result<String> {
    let frames = &page.registered.frames;
    let mut shown: Vec<usize> = page
        .disagreeing()
        .map(|(number, _)| number)
        .take(SHOWN / 2)
        .collect();
    let rest = SHOWN.min(frames.len()) - shown.len().min(frames.len());
    shown.extend((0..rest).map(|i| i * frames.len() / rest));
    shown.sort_unstable();
    shown.dedup();
    let pictures = shown
        .into_iter()
        .map(|number| {
            let png = std::fs::read(overlays.join(format!("{number:04}.png")))?;
            Ok((number, embed::data_uri(&png)))
        })
        .collect::<io::Result<Vec<(usize, String)>>>()?;
    let rms: Vec<f64> = frames.iter().map(|frame| frame.rms).collect();
    let content = html! {
        h1 { "Registration of a turntable capture" }
        div { b { "capture" } ": " (page.capture) }
        p { (page.summary()) "." }
        h2 { "Object and turntable" }
        table {
            tr { th { "parameter" } th { "value" } th { "standard deviation" } }
            @for row in page.rows() {
                tr { td { (row.name) } td { (row.value) } td { (row.sigma) } }
            }
        }
        p { "Held: " (page.held.join(", ")) "." }
        @for unknown in &page.registered.unknown {
            p { b { "Undetermined" } ", kept as given: " (unknown) "." }
        }
        h2 { "Frames" }
        figure {
            (PreEscaped(line(&rms)))
            figcaption { "distance of outline and border by frame, pixels, root mean square" }
        }
        @for (number, uri) in &pictures {
            figure {
                img src=(uri) width="512";
                figcaption { (name_of(&page.result.frames[*number].image)) }
            }
        }
        p { (LEGEND) "." }
        (table(page))
    };
    Ok(document("registration of a capture", &content))
}

fn table(page: &RegistrationPage<'_>) -> Markup {
    let number =
        |x: Option<f64>, digits: usize| x.map_or("–".to_owned(), |x| format!("{x:.digits$}"));
    html! {
        table {
            tr {
                th { "frame" } th { "angle, degrees" } th { "rms, pixels" } th { "within a pixel" }
                th { "overlap with the mask" } th { "better angle by, degrees" } th { "disagrees" }
            }
            @for (index, (frame, photograph)) in page.registered.frames.iter().zip(&page.result.frames).enumerate() {
                tr {
                    td { a href=(format!("overlays/{index:04}.png")) { (name_of(&photograph.image)) } }
                    td { (format!("{:.3}", frame.angle.to_degrees())) }
                    td { (number(Some(frame.rms).filter(|rms| rms.is_finite()), 3)) }
                    td { (format!("{:.1} %", 100.0 * frame.near)) }
                    td { (number(frame.overlap, 4)) }
                    td {
                        (number(frame.angle_offset.map(f64::to_degrees), 4)) " ± "
                        (number(frame.angle_sigma.map(f64::to_degrees), 4))
                    }
                    td { (frame.disagrees.join("; ")) }
                }
            }
        }
    }
}
