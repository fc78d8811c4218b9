//! The curve of a camera from greys of known reflectance.
//!
//! ```text
//! ln reflectance = h(ln sample),   h through the greys, monotone (Fritsch and Carlson 1980),
//!                                  straight beyond the ends
//! ```
//!
//! Straight in logarithms is a power law, which most curves nearly are.

use std::path::Path;

use super::{Chart, ColourError};
use crate::image::luminance;

/// Reflectance by sample, by channel.
#[derive(Clone, Debug, PartialEq)]
pub struct GreyCurve {
    /// `[channel]` knots (ln sample, ln reflectance, slope), samples growing.
    knots: [Vec<[f64; 3]>; 3],
}

/// Ratio of the channels of a grey patch at most, after the brightest is made white.
const GREY: f64 = 1.1;

/// Slopes of ln reflectance by ln sample: 2.6 is a display's, 1 is linear.
const SLOPES: (f64, f64) = (0.2, 6.0);

impl GreyCurve {
    /// Reads `reflectance,r,g,b` or `N5,r,g,b` (Munsell value 5) a line.
    pub fn read_csv(path: &Path) -> Result<Self, ColourError> {
        let fault = |fault: String| ColourError::File {
            path: path.to_owned(),
            fault,
        };
        let chart = Chart::read_csv(path)?;
        let mut greys = Vec::new();
        for patch in &chart.patches {
            let name = patch.name.trim();
            let munsell = name.strip_prefix(['N', 'n']).map(str::trim);
            let reflectance = match munsell {
                Some(value) => value.parse().ok().map(munsell_reflectance),
                None => name.parse().ok(),
            };
            match reflectance {
                Some(y) if y > 0.0 && y <= 1.5 => greys.push((y, patch.rgb)),
                _ => {
                    return Err(fault(format!(
                        "grey {name:?}: must be a reflectance from 0 to 1.5 or a Munsell value such as N5"
                    )));
                }
            }
        }
        Self::through(&greys).map_err(fault)
    }

    /// Through the patches that the camera's chart shows grey: within `GREY` of the hue of its brightest.
    pub fn of_chart(probe: &Chart, camera: &Chart) -> Result<Self, String> {
        let brightest = (camera.patches.iter())
            .max_by(|a, b| luminance(a.rgb).total_cmp(&luminance(b.rgb)))
            .map_or([1.0; 3], |p| p.rgb);
        let greys: Vec<(f64, [f64; 3])> = (probe.patches.iter().zip(&camera.patches))
            .filter_map(|(probe, camera)| {
                let balanced = [0, 1, 2].map(|c| camera.rgb[c] / brightest[c]);
                let low = balanced.iter().copied().fold(f64::INFINITY, f64::min);
                let high = balanced.iter().copied().fold(0.0, f64::max);
                let reflectance = luminance(camera.rgb);
                (reflectance > 0.0 && high < GREY * low).then_some((reflectance, probe.rgb))
            })
            .collect();
        Self::through(&greys)
    }

    /// Through greys `(reflectance, samples)`.
    pub fn through(greys: &[(f64, [f64; 3])]) -> Result<Self, String> {
        if greys.len() < 3 {
            return Err(format!(
                "holds {} greys: a curve needs at least 3; photograph more steps",
                greys.len()
            ));
        }
        let mut knots: [Vec<[f64; 3]>; 3] = Default::default();
        for (channel, knots) in knots.iter_mut().enumerate() {
            let mut points: Vec<(f64, f64)> = Vec::new();
            for (reflectance, rgb) in greys {
                if rgb[channel] <= 0.0 {
                    return Err(format!(
                        "grey of reflectance {reflectance}: sample = {}: must be > 0; leave it out",
                        rgb[channel]
                    ));
                }
                points.push((rgb[channel].ln(), reflectance.ln()));
            }
            points.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            for pair in points.windows(2) {
                let slope = (pair[1].1 - pair[0].1) / (pair[1].0 - pair[0].0);
                // NaN where two greys are one.
                if !(SLOPES.0..SLOPES.1).contains(&slope) {
                    return Err(format!(
                        "samples {:.4} and {:.4} stand for reflectances {:.4} and {:.4}: samples must grow \
                         with reflectance (power from {} to {}, here {slope:.2}); check the order of the greys, and \
                         that none is saturated",
                        pair[0].0.exp(),
                        pair[1].0.exp(),
                        pair[0].1.exp(),
                        pair[1].1.exp(),
                        SLOPES.0,
                        SLOPES.1
                    ));
                }
            }
            *knots = monotone(&points);
        }
        Ok(Self { knots })
    }

    /// The linear value of a sample; 0 for samples of at most 0.
    pub fn linearise(&self, channel: usize, sample: f64) -> f64 {
        if sample <= 0.0 {
            return 0.0;
        }
        let knots = &self.knots[channel];
        let x = sample.ln();
        let above = knots.partition_point(|k| k[0] <= x);
        let along = |[x0, y0, slope]: [f64; 3]| (y0 + slope * (x - x0)).exp();
        if above == 0 {
            return along(knots[0]);
        }
        if above == knots.len() {
            return along(knots[above - 1]);
        }
        // Hermite's cubic.
        let ([x0, y0, m0], [x1, y1, m1]) = (knots[above - 1], knots[above]);
        let width = x1 - x0;
        let t = (x - x0) / width;
        let (t2, t3) = (t * t, t * t * t);
        let y = (2.0 * t3 - 3.0 * t2 + 1.0) * y0
            + (t3 - 2.0 * t2 + t) * width * m0
            + (3.0 * t2 - 2.0 * t3) * y1
            + (t3 - t2) * width * m1;
        y.exp()
    }

    /// `[channel]` samples and reflectances of the greys.
    pub fn greys(&self) -> [Vec<[f64; 2]>; 3] {
        self.knots
            .each_ref()
            .map(|knots| knots.iter().map(|k| [k[0].exp(), k[1].exp()]).collect())
    }
}

/// Knots with slopes that keep the cubic monotone: the weighted harmonic mean of the secants.
fn monotone(points: &[(f64, f64)]) -> Vec<[f64; 3]> {
    let n = points.len();
    let width = |i: usize| points[i + 1].0 - points[i].0;
    let secant = |i: usize| (points[i + 1].1 - points[i].1) / width(i);
    (0..n)
        .map(|i| {
            let slope = if i == 0 {
                secant(0)
            } else if i == n - 1 {
                secant(n - 2)
            } else {
                let (a, b) = (2.0 * width(i) + width(i - 1), width(i) + 2.0 * width(i - 1));
                (a + b) / (a / secant(i - 1) + b / secant(i))
            };
            [points[i].0, points[i].1, slope]
        })
        .collect()
}

/// Luminous reflectance of a Munsell value (ASTM D1535-08, relative to a perfect diffuser).
fn munsell_reflectance(value: f64) -> f64 {
    let v = value;
    (1.1914 + (-0.22533 + (0.23352 + (-0.020484 + 0.000_819_39 * v) * v) * v) * v) * v / 100.0
}
