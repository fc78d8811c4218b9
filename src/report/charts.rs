//! Small charts as inline SVG.

use std::fmt::Write;

use crate::image::viridis;

/// Size of a chart in CSS pixels.
const SIZE: (f32, f32) = (320.0, 120.0);
/// Room for labels at the bottom.
const FOOT: f32 = 18.0;

/// A histogram of the finite values between `low` and `high`, `logarithmic` or even in the value.
pub(super) fn histogram(values: &[f32], low: f32, high: f32, logarithmic: bool) -> String {
    const BINS: usize = 40;
    let scale = |v: f32| {
        if logarithmic {
            v.max(f32::MIN_POSITIVE).ln()
        } else {
            v
        }
    };
    let (from, to) = (scale(low), scale(high));
    let mut counts = [0usize; BINS];
    for value in values.iter().filter(|v| v.is_finite()) {
        let t = ((scale(*value) - from) / (to - from)).clamp(0.0, 1.0);
        counts[((t * BINS as f32) as usize).min(BINS - 1)] += 1;
    }
    let highest = counts.iter().copied().max().unwrap_or(0).max(1) as f32;
    let width = SIZE.0 / BINS as f32;
    let mut bars = String::new();
    for (i, &count) in counts.iter().enumerate() {
        let height = (SIZE.1 - FOOT) * count as f32 / highest;
        let _ = write!(
            bars,
            r#"<rect x="{:.1}" y="{:.1}" width="{:.1}" height="{height:.1}"/>"#,
            i as f32 * width,
            SIZE.1 - FOOT - height,
            width - 1.0,
        );
    }
    frame(&bars, &short(low), &short(high))
}

/// A line through values in order.
pub(super) fn line(values: &[f64]) -> String {
    let finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let low = finite.iter().copied().fold(f64::INFINITY, f64::min);
    let high = finite.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let span = (high - low).max(1e-9);
    let mut points = String::new();
    for (i, value) in values.iter().enumerate().filter(|(_, v)| v.is_finite()) {
        let x = SIZE.0 as f64 * (i as f64 + 0.5) / values.len() as f64;
        let y = f64::from(SIZE.1 - FOOT) * (1.0 - 0.9 * (value - low) / span);
        let _ = write!(points, "{x:.1},{y:.1} ");
    }
    let label = if finite.is_empty() {
        "no finite value".to_owned()
    } else {
        format!("{low:.1} to {high:.1}")
    };
    frame(&format!(r#"<polyline points="{points}"/>"#), &label, "")
}

/// The colours of a view's scale from its lowest to its highest value.
pub(super) fn colour_bar() -> String {
    const STEPS: usize = 32;
    let mut cells = String::new();
    for i in 0..STEPS {
        let [r, g, b] = viridis(i as f64 / (STEPS - 1) as f64);
        let _ = write!(
            cells,
            r#"<rect x="{}" y="0" width="5" height="10" fill="rgb({r},{g},{b})"/>"#,
            4 * i
        );
    }
    let width = 4 * STEPS;
    format!(r#"<svg viewBox="0 0 {width} 10" width="{width}" height="10">{cells}</svg>"#)
}

fn frame(content: &str, left: &str, right: &str) -> String {
    let (width, height) = SIZE;
    format!(
        r#"<svg viewBox="0 0 {width} {height}" width="{width}" height="{height}">{content}<text x="0" y="{y}">{left}</text><text x="{width}" y="{y}" text-anchor="end">{right}</text></svg>"#,
        y = height - 4.0
    )
}

/// A number in few digits.
pub(super) fn short(value: f32) -> String {
    if value != 0.0 && (value.abs() < 0.01 || value.abs() >= 1000.0) {
        format!("{value:.1e}")
    } else {
        format!("{value:.3}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_hold_no_number_that_is_not_finite() {
        let values = [0.1, f32::NAN, f32::INFINITY, -1.0, 0.5];
        for svg in [
            histogram(&values, 0.01, 1.0, true),
            histogram(&[], 0.0, 1.0, false),
            line(&[30.0, f64::INFINITY, 31.0]),
            line(&[]),
        ] {
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }
}
