//! One page about a light: what is in it, which way it stands, and what it can tell about roughness.

use std::fmt::Write;
use std::io;
use std::path::Path;

use glam::{Mat3, Vec3};
use maud::{Markup, PreEscaped, html};

use super::document::document;
use super::{ReportError, embed};
use crate::estimate::{CapturePlan, FORECAST_ALPHAS, Forecast, Lamp, UNKNOWN};
use crate::geometry::latlong_from_direction;
use crate::image::{RgbImage, ToneCurve, viridis, write_atomically};
use crate::probe::{Environment, Inspection};

/// Width of the map on the page, pixels.
const MAP_WIDTH: usize = 960;
/// Side of the mirror ball, pixels.
const BALL: usize = 300;

/// What the page shows.
pub struct ProbePage<'a> {
    /// The probe's file.
    pub path: &'a Path,
    /// The light.
    pub environment: &'a Environment,
    /// What is in it.
    pub inspection: &'a Inspection,
    /// What was repaired on loading; empty if nothing was.
    pub repairs: &'a str,
    /// Texels that `probe merge` found saturated in every exposure, if its mask is there.
    pub clipped_texels: Option<usize>,
    /// What is going to be photographed.
    pub plan: &'a CapturePlan,
    /// What can be known.
    pub forecast: &'a Forecast,
    /// The lamp that helps most, and what can be known with it.
    pub lamp: (&'a Lamp, &'a Forecast),
}

/// Writes the page.
pub fn write_probe_page(page: &ProbePage<'_>, out: &Path) -> Result<(), ReportError> {
    let write = |source| ReportError::Write {
        path: out.to_owned(),
        source,
    };
    let html = markup(page).map_err(write)?;
    write_atomically(out, |file| io::Write::write_all(file, html.as_bytes())).map_err(write)
}

fn markup(page: &ProbePage<'_>) -> io::Result<String> {
    let inspection = page.inspection;
    // The mean at a fifth of white: rooms are seen, lamps burn out.
    let curve = ToneCurve {
        exposure: 0.2 / inspection.mean.max(f64::MIN_POSITIVE),
    };
    let turned = page.environment.turned(Mat3::IDENTITY);
    let look = |direction: Vec3| turned.radiance(Vec3::ZERO, direction).to_array();
    let map = RgbImage::from_fn(MAP_WIDTH, MAP_WIDTH / 2, |x, y| {
        let uv = glam::Vec2::new(
            (x as f32 + 0.5) / MAP_WIDTH as f32,
            (y as f32 + 0.5) / (MAP_WIDTH / 2) as f32,
        );
        look(crate::geometry::direction_from_latlong(uv))
    });
    let map = embed::radiance(&map, curve)?;
    let ball = embed::radiance(&mirror_ball(page.plan.wo, look), curve)?;
    let name = page.path.display().to_string();
    let content = html! {
        h1 { "Light probe " (name) }
        (verdict(page))
        h2 { "The map, with the world's axes and the brightest sources" }
        div.over { img src=(map) width=(MAP_WIDTH) height=(MAP_WIDTH / 2); (PreEscaped(overlay(page))) }
        h2 { "As a mirror ball, seen from the camera" }
        figure {
            img src=(ball) width=(BALL) height=(BALL);
            figcaption {
                "Hold a mirror ball (a ladle, a Christmas bauble) where the object will stand: the photograph must "
                "show the lamps where this picture does. If they are mirrored left to right, the map is; if they are "
                "turned, give " code { "[probe] rotation_deg" } "."
            }
        }
        h2 { "Figures" }
        table {
            tr { td { "Resolution" } td { (inspection.width) " × " (inspection.height) ", "
                (format!("{:.2}° a texel", 360.0 / inspection.width as f64)) } }
            tr { td { "Range" } td { (format!("{:.2e}", inspection.range())) " from the darkest hundredth ("
                (format!("{:.3e}", inspection.dark)) ") to the peak (" (format!("{:.3e}", inspection.peak)) ")" } }
            tr { td { "Mean luminance" } td { (format!("{:.4e}", inspection.mean)) } }
            tr { td { "Texels without light" } td { (inspection.black_texels) } }
            tr { td { "Repaired on loading" } td { @if page.repairs.is_empty() { "nothing" } @else { (page.repairs) } } }
            tr { td { "Saturated in every exposure" } td { @match page.clipped_texels {
                Some(count) => { (count) " texels, by the mask of the merge" }
                None => "unknown: no mask of a merge lies beside the probe",
            } } }
        }
        h2 { "Sources: patches above four times the mean" }
        (sources(inspection))
        h2 { "What roughness this light reveals" }
        p {
            "Expected standard deviation of ln alpha (0.1 is 10 %) of a single point at the bound of Cramér and Rao, by "
            "elevation of its normal, over one turn of " (page.plan.frames) " frames with "
            (format!("{:.2} %", 100.0 * page.plan.noise)) " noise, rho_d " (page.plan.rho_d) ", rho_s " (page.plan.rho_s)
            ", GGX, open convex surface. Above " (UNKNOWN) " roughness counts as unknown."
        }
        (forecast(page.forecast))
        h2 { "Where to put a lamp" }
        p { (place(page.lamp.0)) }
        (forecast(page.lamp.1))
    };
    Ok(document(&format!("light probe {name}"), &content))
}

/// What to do, in sentences.
fn verdict(page: &ProbePage<'_>) -> Markup {
    let cut = page
        .inspection
        .sources
        .iter()
        .filter(|s| s.plateau_texels.is_some())
        .count();
    let glare = page
        .inspection
        .sources
        .iter()
        .filter(|s| s.halo.is_some())
        .count();
    let lost: Vec<String> = (FORECAST_ALPHAS.iter().enumerate())
        .filter(|(k, _)| page.forecast.unknown(*k) > 0.25)
        .map(|(k, alpha)| format!("{alpha} ({:.0} %)", 100.0 * page.forecast.unknown(k)))
        .collect();
    html! {
        ul {
            @if page.clipped_texels.is_some_and(|n| n > 0) || cut > 0 {
                li { b { "Sources look saturated. " } "Their radiance is too low, so highlights will come out with too high a specular "
                    "albedo or too great a roughness. Take shorter exposures, or a neutral-density filter, and merge again." }
            } @else { li { "No source looks saturated." } }
            @if glare > 0 {
                li { b { "Glare about " (glare) " sources. " } "Light scattered in the lens looks like a wide dim lamp; clean the lens and shade it." }
            } @else { li { "No glare was noticed." } }
            @if lost.is_empty() {
                li { "Roughness can be told for at least three quarters of the normals at every roughness tried." }
            } @else {
                li { b { "Roughness will stay unknown " } "for this share of the normals at alpha " (lost.join(", "))
                    ": they see no highlight that changes enough. Put a lamp where the last section says, or expect the status "
                    code { "unidentifiable" } "." }
            }
        }
    }
}

/// Axes, a grid of 30° and the sources over the map.
fn overlay(page: &ProbePage<'_>) -> String {
    let (width, height) = (MAP_WIDTH as f32, (MAP_WIDTH / 2) as f32);
    let place = |direction: Vec3| {
        let uv = latlong_from_direction(direction);
        (uv.x * width, uv.y * height)
    };
    let mut lines = String::new();
    for i in 1..12 {
        let x = width * i as f32 / 12.0;
        let _ = write!(
            lines,
            r##"<path d="M{x} 0V{height}" stroke="#fff" stroke-opacity=".18"/>"##
        );
    }
    for i in 1..6 {
        let y = height * i as f32 / 6.0;
        let _ = write!(
            lines,
            r##"<path d="M0 {y}H{width}" stroke="#fff" stroke-opacity=".18"/>"##
        );
    }
    let mut label = |x: f32, y: f32, text: &str, colour: &str| {
        let _ = write!(
            lines,
            r##"<text x="{x:.1}" y="{y:.1}" style="fill:{colour};font-weight:bold;paint-order:stroke;stroke:#000;stroke-width:2px" text-anchor="middle">{text}</text>"##
        );
    };
    for (axis, name) in [
        (Vec3::X, "+X"),
        (-Vec3::X, "−X"),
        (Vec3::Z, "+Z"),
        // Just inside the left edge, where the seam is.
        (Vec3::new(0.06, 0.0, -1.0), "−Z"),
        (Vec3::new(0.0, 1.0, 0.06), "+Y"),
        (Vec3::new(0.0, -1.0, 0.06), "−Y"),
    ] {
        let (x, y) = place(axis.normalize());
        label(x, y + 4.0, name, "#fff");
    }
    let (x, y) = place(page.plan.wo);
    label(x, y + 4.0, "camera", "#7df");
    for (i, source) in page.inspection.sources.iter().enumerate() {
        let (x, y) = place(Vec3::from(source.direction));
        label(x, y - 8.0, &format!("{}", i + 1), "#fd6");
    }
    for source in &page.inspection.sources {
        let (x, y) = place(Vec3::from(source.direction));
        let radius = (source.radius_deg as f32 * width / 360.0).max(5.0);
        let _ = write!(
            lines,
            r##"<circle cx="{x:.1}" cy="{y:.1}" r="{radius:.1}" stroke="#fd6"/>"##
        );
    }
    let (x, y) = place(page.lamp.0.direction);
    let _ = write!(
        lines,
        r##"<path d="M{:.1} {y:.1}h16M{x:.1} {:.1}v16" stroke="#f6f" stroke-width="2"/>"##,
        x - 8.0,
        y - 8.0
    );
    format!(
        r#"<svg viewBox="0 0 {width} {height}" width="{width}" height="{height}">{lines}</svg>"#
    )
}

/// A mirror ball seen from far away in direction `wo`, +Y up.
fn mirror_ball(wo: Vec3, look: impl Fn(Vec3) -> [f32; 3]) -> RgbImage {
    let right = Vec3::Y.cross(wo).try_normalize().unwrap_or(Vec3::X);
    let up = wo.cross(right);
    RgbImage::from_fn(BALL, BALL, |column, row| {
        let x = 2.0 * (column as f32 + 0.5) / BALL as f32 - 1.0;
        let y = 1.0 - 2.0 * (row as f32 + 0.5) / BALL as f32;
        let square = x * x + y * y;
        if square >= 1.0 {
            return [0.0; 3];
        }
        let normal = right * x + up * y + wo * (1.0 - square).sqrt();
        look((2.0 * normal.dot(wo) * normal - wo).normalize())
    })
}

fn sources(inspection: &Inspection) -> Markup {
    if inspection.sources.is_empty() {
        return html! { p { "None: nothing is brighter than four times the mean. Even light shows no highlights." } };
    }
    html! {
        table {
            tr { th {} th { "direction x, y, z" } th { "azimuth, elevation" } th { "solid angle" } th { "radius" } th { "share of the light" }
                th { "peak" } th { "suspicion" } }
            @for (i, source) in inspection.sources.iter().enumerate() {
                @let d = Vec3::from(source.direction);
                tr {
                    td { (i + 1) }
                    td { (format!("{:+.3}, {:+.3}, {:+.3}", d.x, d.y, d.z)) }
                    td { (angles(d)) }
                    td { (format!("{:.2e} sr", source.solid_angle)) }
                    td { (format!("{:.2}°", source.radius_deg)) }
                    td { (format!("{:.1} %", 100.0 * source.flux_share)) }
                    td { (format!("{:.3e}", source.peak)) }
                    td {
                        @if let Some(n) = source.plateau_texels { (n) " of " (source.texels) " texels at one level: saturated? " }
                        @if let Some(halo) = source.halo { "a halo of " (format!("{halo:.1e}")) " of its peak: glare?" }
                    }
                }
            }
        }
        @if inspection.source_count > inspection.sources.len() {
            p { "and " (inspection.source_count - inspection.sources.len()) " smaller ones." }
        }
    }
}

/// Azimuth from +Z towards +X, and elevation, degrees.
fn angles(d: Vec3) -> String {
    let azimuth = d.x.atan2(d.z).to_degrees();
    let elevation = d.y.clamp(-1.0, 1.0).asin().to_degrees();
    format!("{azimuth:.0}°, {elevation:.0}°")
}

fn place(lamp: &Lamp) -> String {
    let d = lamp.direction;
    format!(
        "Of all directions, 10° apart, a lamp of {:.0}° across with a quarter of the present light helps most at azimuth and \
         elevation {} (direction {:+.2}, {:+.2}, {:+.2}; azimuth from +Z towards +X; the cross on the map). With it:",
        2.0 * lamp.radius.to_degrees(),
        angles(d),
        d.x,
        d.y,
        d.z
    )
}

/// A table of σ(ln alpha), coloured from 0.01 to 1.
fn forecast(forecast: &Forecast) -> Markup {
    html! {
        table {
            tr { th { "alpha" } th { "median" } th { "unknown" }
                @for elevation in &forecast.elevations { th { (format!("{elevation:.0}°")) } } }
            @for (k, alpha) in FORECAST_ALPHAS.iter().enumerate() {
                tr {
                    td { b { (alpha) } }
                    td { (figure(forecast.median(k))) }
                    td { (format!("{:.0} %", 100.0 * forecast.unknown(k))) }
                    @for sigma in &forecast.sigma[k] {
                        @match sigma {
                            None => td style="color:#999" { "–" },
                            Some(sigma) => {
                                @let [r, g, b] = viridis(1.0 - (sigma.clamp(0.01, 1.0).log10() + 2.0) / 2.0);
                                @let ink = if *sigma < 0.1 { "#222" } else { "#eee" };
                                td style=(format!("background:rgb({r},{g},{b});color:{ink};padding:.2em .4em")) { (figure(*sigma)) }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn figure(sigma: f64) -> String {
    if sigma < 10.0 {
        format!("{sigma:.3}")
    } else {
        "∞".to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ball_shows_what_lies_behind_the_camera_in_its_middle() {
        let wo = Vec3::new(0.0, 0.34, 0.94).normalize();
        let ball = mirror_ball(wo, |d| d.to_array());
        let middle = Vec3::from(ball.pixels[BALL / 2 * BALL + BALL / 2]);
        assert!(middle.dot(wo) > 0.999);
        // Right of the middle, the ball mirrors the camera's right.
        let right = Vec3::from(ball.pixels[BALL / 2 * BALL + 3 * BALL / 4]);
        assert!(right.x > 0.5, "{right}");
        assert_eq!(ball.pixels[0], [0.0; 3]);
    }
}
