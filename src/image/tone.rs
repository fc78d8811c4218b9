//! From linear radiance to what a screen shows.
//!
//! ```text
//! display = srgb_encode(clamp(exposure · radiance, 0, 1))
//! ```
//!
//! The one tone curve of reports and of the display-referred errors: no shoulder, so that a pixel that
//! is right in radiance is right on screen, and equal errors stay comparable between images.

/// sRGB's luma weights, which are Rec. 709's.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Exposure, then sRGB, clamped to [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToneCurve {
    /// Factor on radiance; radiance `1 / exposure` is the brightest that is shown.
    pub exposure: f64,
}

impl Default for ToneCurve {
    fn default() -> Self {
        Self { exposure: 1.0 }
    }
}

impl ToneCurve {
    /// Linear light on the screen, in [0, 1]; NaN stays NaN.
    pub fn linear(self, radiance: f32) -> f64 {
        (f64::from(radiance) * self.exposure).clamp(0.0, 1.0)
    }

    /// Display value of a radiance, in [0, 1]; NaN stays NaN.
    pub fn display(self, radiance: f32) -> f64 {
        srgb_encode(self.linear(radiance))
    }

    /// Display value in 8 bits; NaN becomes 0.
    pub fn byte(self, radiance: f32) -> u8 {
        (self.display(radiance) * 255.0).round() as u8
    }
}

/// Luminance of linear RGB, or luma of encoded RGB (Rec. 709).
pub fn luminance(rgb: [f64; 3]) -> f64 {
    LUMINANCE[0] * rgb[0] + LUMINANCE[1] * rgb[1] + LUMINANCE[2] * rgb[2]
}

/// Display value from linear light (IEC 61966-2-1).
pub fn srgb_encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

/// Linear light from display value (IEC 61966-2-1).
pub fn srgb_decode(display: f64) -> f64 {
    if display <= 0.040_45 {
        display / 12.92
    } else {
        ((display + 0.055) / 1.055).powf(2.4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_decode_inverts_encode() {
        for i in 0..=1000 {
            let x = f64::from(i) / 1000.0;
            assert!((srgb_decode(srgb_encode(x)) - x).abs() < 1e-7, "{x}");
        }
        assert!((srgb_encode(0.18) - 0.461_356).abs() < 1e-6);
    }

    #[test]
    fn tone_curve_clamps_at_one_over_exposure() {
        let curve = ToneCurve { exposure: 4.0 };
        assert_eq!(curve.byte(0.25), 255);
        assert_eq!(curve.byte(f32::INFINITY), 255);
        assert_eq!(curve.byte(-1.0), 0);
        assert_eq!(curve.byte(f32::NAN), 0);
        assert_eq!(curve.byte(0.25 * 0.215_860_5), 128);
    }
}
