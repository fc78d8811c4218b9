//! LDR-FLIP: how visible the difference is when two images are shown in turn.
//!
//! ```text
//! ΔE = ΔE_c ^ (1 − ΔE_f)
//! ```
//!
//! `ΔE_c`: colour difference after the eye's contrast sensitivity; `ΔE_f`: difference of edges and
//! points (Andersson et al. 2020, *FLIP: A Difference Evaluator for Alternating Images*; their
//! constants).

use std::f64::consts::{PI, SQRT_2};

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::convolve::{Edge, Plane, gaussian};

/// Pixels per degree: 0.7 m from a screen of 3840 pixels on 0.7 m, as published.
const PPD: f64 = 0.7 * 3840.0 / 0.7 * PI / 180.0;

/// Contrast sensitivity as sums of `a √(π/b) exp(−π² d²/b)`, d in degrees (Table 1): achromatic,
/// red-green, blue-yellow.
const SENSITIVITY: [[(f64, f64); 2]; 3] = [
    [(1.0, 0.0047), (0.0, 1e-5)],
    [(1.0, 0.0053), (0.0, 1e-5)],
    [(34.1, 0.04), (13.5, 0.025)],
];

/// Width of the feature detectors, degrees.
const FEATURE_WIDTH: f64 = 0.082;
/// Exponents of colour and feature differences.
const COLOUR_EXPONENT: f64 = 0.7;
const FEATURE_EXPONENT: f64 = 0.5;
/// Colour differences up to `KNEE` of the largest are mapped to [0, KNEE_VALUE].
const KNEE: f64 = 0.4;
const KNEE_VALUE: f64 = 0.95;

/// The two colours in gamut that are farthest apart.
const GREEN: [f64; 3] = [0.0, 1.0, 0.0];
const BLUE: [f64; 3] = [0.0, 0.0, 1.0];

/// Sum of ΔE over the compared pixels of two images of linear RGB in [0, 1].
pub(super) fn flip_sum(reference: &Shown<'_>, test: &Shown<'_>, compared: &[bool]) -> f64 {
    let colours = Colours::new();
    let (r, t) = (Seen::new(reference, &colours), Seen::new(test, &colours));
    let largest = hyab(colours.hunt_lab(GREEN), colours.hunt_lab(BLUE)).powf(COLOUR_EXPONENT);
    let error = |i: usize| {
        let colour = redistribute(hyab(r.lab[i], t.lab[i]).powf(COLOUR_EXPONENT), largest);
        let edge = (r.edges[i] - t.edges[i]).abs();
        let point = (r.points[i] - t.points[i]).abs();
        let feature = (edge.max(point) / SQRT_2).powf(FEATURE_EXPONENT);
        colour.powf(1.0 - feature)
    };
    (0..compared.len())
        .filter(|&i| compared[i])
        .map(error)
        .sum()
}

/// Linear RGB in [0, 1] as the screen emits it.
pub(super) struct Shown<'a> {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pixels: &'a [[f64; 3]],
}

/// What the eye makes of an image.
struct Seen {
    /// CIELAB, Hunt-adjusted, after contrast sensitivity.
    lab: Vec<[f64; 3]>,
    edges: Vec<f64>,
    points: Vec<f64>,
}

impl Seen {
    fn new(image: &Shown<'_>, colours: &Colours) -> Self {
        let opponent: Vec<[f64; 3]> = image.pixels.iter().map(|&rgb| colours.ycxcz(rgb)).collect();
        let plane = |value: &dyn Fn(&[f64; 3]) -> f64| Plane {
            width: image.width,
            height: image.height,
            values: opponent.iter().map(value).collect(),
        };

        // Blur each opponent channel by its contrast sensitivity, compare in a uniform space.
        let filtered: [Vec<f64>; 3] =
            std::array::from_fn(|c| filter(&plane(&|p| p[c]), SENSITIVITY[c]));
        let lab = (0..opponent.len())
            .into_par_iter()
            .map(|i| {
                let rgb = colours.rgb_from_ycxcz([filtered[0][i], filtered[1][i], filtered[2][i]]);
                colours.hunt_lab(rgb.map(|x| x.clamp(0.0, 1.0)))
            })
            .collect();

        // Find edges and points in the unfiltered luminance.
        let luminance = plane(&|p| (p[0] + 16.0) / 116.0);
        let sigma = 0.5 * FEATURE_WIDTH * PPD;
        let radius = (3.0 * sigma).ceil() as i32;
        let smooth = gaussian(sigma, radius as usize);
        let detector = |shape: &dyn Fn(f64) -> f64| {
            let weight = |x: i32| {
                let x = f64::from(x) / sigma;
                shape(x) * (-0.5 * x * x).exp()
            };
            unit_halves((-radius..=radius).map(weight).collect())
        };
        let strength = |kernel: &[f64]| -> Vec<f64> {
            let across = luminance.convolve(kernel, &smooth, Edge::Repeat).values;
            let down = luminance.convolve(&smooth, kernel, Edge::Repeat).values;
            across.iter().zip(&down).map(|(x, y)| x.hypot(*y)).collect()
        };
        let edges = strength(&detector(&|x| -x));
        let points = strength(&detector(&|x| x * x - 1.0));
        Self { lab, edges, points }
    }
}

/// Convolves with a sum of two Gaussians that together weigh 1.
fn filter(plane: &Plane, terms: [(f64, f64); 2]) -> Vec<f64> {
    // One radius for all channels: that of the widest.
    let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * PPD).ceil() as usize;
    let blur = |(a, b): (f64, f64)| {
        let sigma = (b / (2.0 * PI * PI)).sqrt() * PPD;
        // The weight a sampled Gaussian has before it is normalised.
        let sum: f64 = (-(radius as i32)..=radius as i32)
            .map(|x| (-0.5 * (f64::from(x) / sigma).powi(2)).exp())
            .sum();
        let kernel = gaussian(sigma, radius);
        (
            a * (PI / b).sqrt() * sum * sum,
            plane.convolve(&kernel, &kernel, Edge::Repeat).values,
        )
    };
    if terms[1].0 == 0.0 {
        return blur(terms[0]).1;
    }
    let ((w0, first), (w1, second)) = (blur(terms[0]), blur(terms[1]));
    first
        .iter()
        .zip(&second)
        .map(|(a, b)| (w0 * a + w1 * b) / (w0 + w1))
        .collect()
}

/// Scales positive weights to sum to 1 and negative ones to −1.
fn unit_halves(kernel: Vec<f64>) -> Vec<f64> {
    let positive: f64 = kernel.iter().filter(|w| **w > 0.0).sum();
    let negative: f64 = -kernel.iter().filter(|w| **w < 0.0).sum::<f64>();
    kernel
        .into_iter()
        .map(|w| if w > 0.0 { w / positive } else { w / negative })
        .collect()
}

fn redistribute(difference: f64, largest: f64) -> f64 {
    let knee = KNEE * largest;
    if difference < knee {
        KNEE_VALUE / knee * difference
    } else {
        KNEE_VALUE + (difference - knee) / (largest - knee) * (1.0 - KNEE_VALUE)
    }
}

/// City-block distance in lightness, Euclidean in colour.
fn hyab(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// The spaces of colour, from linear sRGB.
struct Colours {
    xyz_from_rgb: DMat3,
    rgb_from_xyz: DMat3,
    white: DVec3,
}

impl Colours {
    /// sRGB's primaries and white, exact.
    fn new() -> Self {
        let xyz_from_rgb = DMat3::from_cols_array(&[
            10_135_552.0 / 24_577_794.0,
            2_613_072.0 / 12_288_897.0,
            1_425_312.0 / 73_733_382.0,
            8_788_810.0 / 24_577_794.0,
            8_788_810.0 / 12_288_897.0,
            8_788_810.0 / 73_733_382.0,
            4_435_075.0 / 24_577_794.0,
            887_015.0 / 12_288_897.0,
            70_074_185.0 / 73_733_382.0,
        ]);
        Self {
            xyz_from_rgb,
            rgb_from_xyz: xyz_from_rgb.inverse(),
            white: xyz_from_rgb * DVec3::ONE,
        }
    }

    /// CIELAB with colourfulness scaled by lightness (Hunt effect).
    fn hunt_lab(&self, rgb: [f64; 3]) -> [f64; 3] {
        const DELTA: f64 = 6.0 / 29.0;
        let [x, y, z] = self.relative_xyz(rgb).map(|t| {
            if t > DELTA.powi(3) {
                t.cbrt()
            } else {
                t / (3.0 * DELTA * DELTA) + 4.0 / 29.0
            }
        });
        let lightness = 116.0 * y - 16.0;
        [
            lightness,
            0.01 * lightness * 500.0 * (x - y),
            0.01 * lightness * 200.0 * (y - z),
        ]
    }

    /// Linearised CIELAB, in which the contrast sensitivities are given.
    fn ycxcz(&self, rgb: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.relative_xyz(rgb);
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    }

    fn rgb_from_ycxcz(&self, [luma, cx, cz]: [f64; 3]) -> [f64; 3] {
        let y = (luma + 16.0) / 116.0;
        let xyz = DVec3::new(y + cx / 500.0, y, y - cz / 200.0) * self.white;
        (self.rgb_from_xyz * xyz).to_array()
    }

    /// XYZ over that of white.
    fn relative_xyz(&self, rgb: [f64; 3]) -> [f64; 3] {
        (self.xyz_from_rgb * DVec3::from(rgb) / self.white).to_array()
    }
}
