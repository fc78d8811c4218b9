//! What a mask of 0 and 255 says about an outline: each pixel is a bound.
//!
//! ```text
//! P(255) = ½ + arctan(z/s)/π,      z = (p − q)·n
//! ```
//!
//! `p` is a point of the outline, `n` its outward normal, and `q` what must lie inside for the pixel to be 255: its
//! centre, or the corner that is farthest out where the whole pixel must. A distance read off such a mask (see
//! `border`) is off by a tenth of a pixel, at random; but a pixel that is just inside beside one that is just outside
//! confines the outline to the little between them. The width `s` is the one under which the masks are likeliest. Wrong
//! pixels far from the outline pull on it with 1/z: they are outvoted.

use std::collections::BTreeMap;

use glam::DVec2;

use super::border::{MaskBorder, Observed};
use super::contour::ContourPoint;
use super::equations::Certainty;

/// Pixels this far from the outline are looked at; those beyond add nothing but their mistakes.
const BAND: f64 = 1.5;

/// Widths tried, pixels: a factor of √2 apart from the least one. At 0.01 a cup whose facets stand otherwise than the
/// mesh's is trusted so far that its errors are 1.2 predicted deviations; at 0.03 a head's are a half larger.
const LEAST_WIDTH: f64 = 0.02;
const WIDTHS: i32 = 13;

/// A pixel beside the outline.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bound {
    /// Number of the outline's point nearest to it.
    pub(super) point: usize,
    /// How far inside the outline it is, pixels: z.
    pub(super) margin: f64,
    /// Whether the mask says 255.
    pub(super) inside: bool,
}

/// The bounds that a frame's mask sets to its outer outline, by rows and columns; none if it holds shares.
pub(super) fn bounds(observed: &Observed, points: &[ContourPoint]) -> Vec<Bound> {
    let Some((border, width, height)) = observed.binary() else {
        return Vec::new();
    };
    // Every pixel listens to the nearest point.
    let mut nearest: BTreeMap<(usize, usize), (f64, Bound)> = BTreeMap::new();
    for (point, of) in points.iter().enumerate().filter(|(_, of)| of.outer) {
        let farthest_out = match border {
            MaskBorder::Whole => 0.5 * DVec2::new(of.outward.x.signum(), of.outward.y.signum()),
            MaskBorder::Half | MaskBorder::Coverage => DVec2::ZERO,
        };
        let middle = of.pixel - farthest_out;
        let within = |x: f64, n: usize| {
            let low = (x - BAND - 0.5).ceil().max(0.0) as usize;
            let high = (x + BAND + 0.5).floor().min(n as f64).max(0.0) as usize;
            low..high.max(low)
        };
        for y in within(middle.y, height) {
            for x in within(middle.x, width) {
                let inner = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) + farthest_out;
                let distance = inner.distance_squared(of.pixel);
                if distance > BAND * BAND {
                    continue;
                }
                let known = nearest.get(&(y, x)).map_or(f64::INFINITY, |(d, _)| *d);
                if distance < known {
                    let bound = Bound {
                        point,
                        margin: (of.pixel - inner).dot(of.outward),
                        inside: observed.covers(x, y) == Some(true),
                    };
                    nearest.insert((y, x), (distance, bound));
                }
            }
        }
    }
    nearest.into_values().map(|(_, bound)| bound).collect()
}

/// The width under which the masks are likeliest.
pub(super) fn width(bounds: &[Vec<Bound>]) -> f64 {
    let likelihood = |width: f64| -> f64 {
        (bounds.iter().flatten())
            .map(|bound| bound.share(width).ln())
            .sum()
    };
    (0..WIDTHS)
        .map(|i| LEAST_WIDTH * 2f64.powf(0.5 * f64::from(i)))
        .map(|width| (likelihood(width), width))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(LEAST_WIDTH, |(_, width)| width)
}

impl Bound {
    /// Probability of what the mask says.
    fn share(&self, width: f64) -> f64 {
        let z = if self.inside {
            self.margin
        } else {
            -self.margin
        };
        // Its complement is what has digits where z is far below 0.
        if z > 0.0 {
            1.0 - (width / z).atan() / std::f64::consts::PI
        } else {
            (width / -z).atan() / std::f64::consts::PI
        }
        .max(f64::MIN_POSITIVE)
    }

    /// Fisher's scoring: the distance by which the outline should move outward, as if measured, and its
    /// information, 1/pixel².
    pub(super) fn working(&self, width: f64) -> (f64, Certainty) {
        let share = self.share(width);
        let density = width / (std::f64::consts::PI * (width * width + self.margin * self.margin));
        let distance = (1.0 - share) / density;
        (
            if self.inside { distance } else { -distance },
            Certainty::Information(density * density / (share * (1.0 - share)).max(1e-12)),
        )
    }
}
