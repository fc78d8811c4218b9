//! Tabulated NDFs beside the parametric ones they were fitted with.

use std::fmt::Write;

use glam::Vec3;
use maud::{Markup, PreEscaped, html};

use super::charts::short;
use crate::brdf::{Alpha, Ndf};
use crate::export::NdfTable;
use crate::geometry::Local;

/// Groups that are shown: the largest.
const SHOWN: usize = 6;
/// Size of a plot in CSS pixels, with room for labels at the bottom.
const SIZE: (f32, f32) = (320.0, 200.0);
const FOOT: f32 = 18.0;
/// Densities below this share of the largest are left out: four decades.
const LEAST: f32 = 1e-4;

/// A plot for each of the largest groups.
pub(super) fn densities_of(table: &NdfTable) -> Markup {
    let mut groups: Vec<usize> = (0..table.len()).collect();
    groups.sort_by_key(|&m| std::cmp::Reverse(table.points[m]));
    groups.truncate(SHOWN);
    html! {
        h2 { "Densities of microfacet normals" }
        p {
            "Over the half angle, both axes logarithmic. Dots with bars of one standard deviation: tabulated, any "
            "density that never rises. Line: the parametric lobe. " (table.len()) " in all, in ndf.npz."
        }
        @for m in groups {
            figure {
                (PreEscaped(plot(table, m)))
                figcaption {
                    (table.points[m]) " points; " @if table.ndf[m] == 1 { "GGX" } @else { "Beckmann" }
                    ", alpha " (short(table.alpha[m])) ", integral " (short(table.integral[m]))
                }
            }
        }
    }
}

fn plot(table: &NdfTable, m: usize) -> String {
    let (density, sigma) = table.group(m);
    let ndf = if table.ndf[m] == 1 {
        Ndf::Ggx
    } else {
        Ndf::Beckmann
    };
    let alpha = Alpha::saturating(table.alpha[m]);
    let parametric = |theta: f32| {
        let wm = Local(Vec3::new(theta.sin(), 0.0, theta.cos()));
        ndf.density(wm, alpha)
    };
    let low_x = table.theta.first().copied().unwrap_or(0.01).max(1e-4);
    let high_x = table
        .theta
        .last()
        .copied()
        .unwrap_or(1.0)
        .max(1.001 * low_x);
    let highest = density
        .iter()
        .copied()
        .chain([parametric(low_x)])
        .filter(|v| v.is_finite())
        .fold(f32::MIN_POSITIVE, f32::max);
    let x = |theta: f32| SIZE.0 * (theta / low_x).ln() / (high_x / low_x).ln();
    let y = |value: f32| {
        let share = (value / highest).max(LEAST).ln() / LEAST.ln();
        4.0 + (SIZE.1 - FOOT - 8.0) * share
    };
    let mut marks = String::new();
    for (theta, (density, sigma)) in table.theta.iter().zip(density.iter().zip(sigma)) {
        if density.is_finite() && sigma.is_finite() && *density > LEAST * highest {
            let x = x(theta.max(low_x));
            let _ = write!(
                marks,
                r##"<circle cx="{x:.1}" cy="{:.1}" r="2.5"/><line x1="{x:.1}" x2="{x:.1}" y1="{:.1}" y2="{:.1}" stroke="#35618f"/>"##,
                y(*density),
                y(density + sigma),
                y(density - sigma),
            );
        }
    }
    let mut line = String::new();
    for i in 0..=100 {
        let theta = low_x * (high_x / low_x).powf(i as f32 / 100.0);
        let value = parametric(theta);
        if value > LEAST * highest {
            let _ = write!(line, "{:.1},{:.1} ", x(theta), y(value));
        }
    }
    let (width, height) = SIZE;
    format!(
        r#"<svg viewBox="0 0 {width} {height}" width="{width}" height="{height}"><polyline points="{line}"/>{marks}<text x="0" y="{foot}">{}°</text><text x="{width}" y="{foot}" text-anchor="end">{}°</text><text x="{width}" y="14" text-anchor="end">top {}/sr</text></svg>"#,
        short(low_x.to_degrees()),
        short(high_x.to_degrees()),
        short(highest),
        foot = height - 4.0,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plots_hold_no_number_that_is_not_finite() {
        let table = NdfTable {
            theta: vec![0.01, 0.1, 1.0],
            density: vec![9.0, f32::NAN, 0.0],
            sigma: vec![0.1, f32::INFINITY, f32::INFINITY],
            integral: vec![1.0],
            alpha: vec![0.1],
            ndf: vec![1],
            points: vec![3],
            group: vec![0, -1],
        };
        let svg = densities_of(&table).into_string();
        assert!(
            svg.contains("circle") && !svg.contains("NaN") && !svg.contains("inf"),
            "{svg}"
        );
    }
}
