//! CIELAB, and the colour difference ΔE2000 (CIE 142; Sharma, Wu and Dalal 2005, Eq. 2–22).

use std::f64::consts::{PI, TAU};

/// A colour in CIELAB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lab {
    /// Lightness, 0 to 100.
    pub l: f64,
    /// Green to red.
    pub a: f64,
    /// Blue to yellow.
    pub b: f64,
}

/// XYZ of linear Rec. 709 RGB.
pub(super) fn xyz([r, g, b]: [f64; 3]) -> [f64; 3] {
    [
        0.412_456 * r + 0.357_576 * g + 0.180_437 * b,
        0.212_673 * r + 0.715_152 * g + 0.072_175 * b,
        0.019_334 * r + 0.119_192 * g + 0.950_304 * b,
    ]
}

impl Lab {
    /// From linear RGB beside a white of XYZ `white`.
    pub(super) fn of(rgb: [f64; 3], white: [f64; 3]) -> Self {
        let colour = xyz(rgb);
        let [x, y, z] = [0, 1, 2].map(|i| compress(colour[i] / white[i]));
        Self {
            l: 116.0 * y - 16.0,
            a: 500.0 * (x - y),
            b: 200.0 * (y - z),
        }
    }

    /// The three as a list.
    pub(super) fn list(self) -> [f64; 3] {
        [self.l, self.a, self.b]
    }
}

fn compress(t: f64) -> f64 {
    const EDGE: f64 = 6.0 / 29.0;
    if t > EDGE * EDGE * EDGE {
        t.cbrt()
    } else {
        t / (3.0 * EDGE * EDGE) + 4.0 / 29.0
    }
}

/// ΔE2000 with all weights 1.
pub fn delta_e_2000(p: Lab, q: Lab) -> f64 {
    let chroma = |c: &Lab| c.a.hypot(c.b);
    let seventh = |c: f64| {
        let c7 = c.powi(7);
        (c7 / (c7 + 25f64.powi(7))).sqrt()
    };
    let g = 0.5 * (1.0 - seventh(0.5 * (chroma(&p) + chroma(&q))));
    let polar = |c: &Lab| {
        let a = (1.0 + g) * c.a;
        let hue = if a == 0.0 && c.b == 0.0 {
            0.0
        } else {
            c.b.atan2(a).rem_euclid(TAU)
        };
        (a.hypot(c.b), hue)
    };
    let ((c1, h1), (c2, h2)) = (polar(&p), polar(&q));
    let grey = c1 * c2 == 0.0;

    let difference = if grey {
        0.0
    } else {
        (h2 - h1 + PI).rem_euclid(TAU) - PI
    };
    let dl = q.l - p.l;
    let dc = c2 - c1;
    let dh = 2.0 * (c1 * c2).sqrt() * (0.5 * difference).sin();

    let l = 0.5 * (p.l + q.l);
    let c = 0.5 * (c1 + c2);
    let h = if grey {
        h1 + h2
    } else if (h1 - h2).abs() <= PI {
        0.5 * (h1 + h2)
    } else if h1 + h2 < TAU {
        0.5 * (h1 + h2 + TAU)
    } else {
        0.5 * (h1 + h2 - TAU)
    };
    let t = 1.0 - 0.17 * (h - PI / 6.0).cos()
        + 0.24 * (2.0 * h).cos()
        + 0.32 * (3.0 * h + PI / 30.0).cos()
        - 0.20 * (4.0 * h - 63f64.to_radians()).cos();
    let turn = 30f64.to_radians() * (-((h.to_degrees() - 275.0) / 25.0).powi(2)).exp();
    let l50 = (l - 50.0) * (l - 50.0);
    let sl = 1.0 + 0.015 * l50 / (20.0 + l50).sqrt();
    let sc = 1.0 + 0.045 * c;
    let sh = 1.0 + 0.015 * c * t;
    let rt = -2.0 * seventh(c) * (2.0 * turn).sin();
    let (dl, dc, dh) = (dl / sl, dc / sc, dh / sh);
    (dl * dl + dc * dc + dh * dh + rt * dc * dh).max(0.0).sqrt()
}
