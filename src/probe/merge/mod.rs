//! Exposure brackets → radiance.
//!
//! ```text
//! v_j = f⁻¹(t_j L) + noise,      L̂ = Σ_j t_j x_j/σ_j² / Σ_j t_j²/σ_j²,   x_j = f(v_j)
//! σ²(x) = a x + b + q(x)²/12 + (c x)²
//! ```
//!
//! `v` the stored sample, `f` the response ([`Response`]), `t` the exposure, `L` the radiance. The
//! weights are the inverse variances of `x_j/t_j` at the merged radiance, not at the sample itself,
//! which would favour samples that noise made dark; with shot noise alone this is the maximum-likelihood
//! `Σ x / Σ t` (Hanji et al. 2020). Radiance is in units of one sample white per unit of exposure.

mod align;
mod combine;
mod debevec;
mod error;
mod fraction;
mod noise;
mod pixels;
mod response;
mod robertson;
mod times;

#[cfg(test)]
mod laws;
#[cfg(test)]
mod shift_laws;

use std::path::PathBuf;

pub use error::MergeError;
pub use noise::Noise;
pub use response::Response;

use crate::image::{Depth, Mask, RgbImage};
use pixels::Pixels;

/// One photograph of a bracket.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Where it came from.
    pub name: PathBuf,
    /// Samples as stored, 0 black and 1 the file's white.
    pub samples: RgbImage,
    /// What the file held.
    pub depth: Depth,
    /// Claimed exposure: seconds, times ISO/100, over the f-number squared where those are known.
    pub exposure: f64,
}

/// How samples become linear.
#[derive(Clone, Debug, PartialEq)]
pub enum Curve {
    /// Linear where the samples follow the exposures, else Debevec and Malik's.
    Auto,
    /// They are linear.
    Linear,
    /// Debevec and Malik 1997, with smoothness.
    Debevec,
    /// Robertson, Borman and Stevenson 2003.
    Robertson,
    /// One that is known.
    Known(Response),
}

/// What a merge may choose.
#[derive(Clone, Debug, PartialEq)]
pub struct MergeSettings {
    /// How samples become linear.
    pub curve: Curve,
    /// Samples at or above this are saturated, 0..1 of white.
    pub saturation: f32,
    /// Whether exposures are refined from overlaps.
    pub refine: bool,
    /// Whether small shifts are undone, to fractions of a pixel. Columns of an image twice as wide as high go
    /// round: it is taken for a full turn.
    pub align: bool,
}

impl Default for MergeSettings {
    fn default() -> Self {
        Self {
            curve: Curve::Auto,
            saturation: 0.98,
            refine: true,
            align: true,
        }
    }
}

/// What was found out about a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameRecord {
    /// Where it came from.
    pub name: PathBuf,
    /// Exposure as claimed.
    pub claimed: f64,
    /// Exposure as refined from overlaps, the same mean logarithm over all frames.
    pub exposure: f64,
    /// Whether an overlap with another frame tells the exposure; else it is the claim.
    pub overlaps: bool,
    /// Columns and rows by which the frame was moved, pixels.
    pub shift: [f64; 2],
    /// Texels with a saturated channel.
    pub saturated: usize,
    /// Texels left out because the other frames disagree.
    pub ghosts: usize,
}

/// A bracket made one.
#[derive(Clone, Debug)]
pub struct Merged {
    /// Radiance, linear RGB; where every exposure is saturated, the lower bound.
    pub radiance: RgbImage,
    /// Variance of the radiance, by channel; infinite where it is only a lower bound.
    pub variance: RgbImage,
    /// 255 where a channel is saturated in every exposure.
    pub clipped: Mask,
    /// 255 where a frame was left out because the others disagree.
    pub ghosts: Mask,
    /// The response.
    pub response: Response,
    /// Whether the samples were taken as linear.
    pub linear: bool,
    /// The noise found.
    pub noise: Noise,
    /// Frames from the shortest to the longest exposure.
    pub frames: Vec<FrameRecord>,
}

/// Merges a bracket.
pub fn merge(mut frames: Vec<Frame>, settings: &MergeSettings) -> Result<Merged, MergeError> {
    check(&frames)?;
    frames.sort_by(|a, b| {
        let by_time = a.exposure.total_cmp(&b.exposure);
        by_time.then_with(|| a.name.cmp(&b.name))
    });

    // Whole pixels are found from the order of samples, so before any response is known.
    let whole = if settings.align {
        align::shifts(&frames)
    } else {
        vec![(0, 0); frames.len()]
    };
    let claimed: Vec<f64> = frames.iter().map(|f| f.exposure).collect();
    let pixels = Pixels::choose(&frames, &whole, settings.saturation);

    // Response and exposures: each is found from the other, three times round. The exponent
    // that both could share stays with the claimed exposures.
    let depth = frames[0].depth;
    let linear = match settings.curve {
        Curve::Linear => true,
        Curve::Auto => {
            matches!(depth, Depth::Float | Depth::Raw) || times::looks_linear(&pixels, &claimed)?
        }
        _ => false,
    };
    let mut refined = times::Exposures::claimed(&claimed);
    let mut response = match &settings.curve {
        Curve::Known(response) => response.clone(),
        _ => Response::linear(),
    };
    let unknown = !linear && !matches!(settings.curve, Curve::Known(_));
    for _ in 0..3 {
        if unknown {
            response = match settings.curve {
                Curve::Robertson => robertson::response(&pixels, &refined.exposures)?,
                _ => debevec::response(&pixels, &refined.exposures)?,
            };
        }
        if settings.refine {
            refined = times::refine(&pixels, &response, &claimed, &refined.exposures, unknown);
        }
    }

    let noise = Noise::measure(&pixels, &response, &refined.exposures, depth);
    let shifts = if settings.align {
        fraction::refine(
            &frames,
            &whole,
            &response,
            &refined.exposures,
            settings.saturation,
        )
    } else {
        vec![[0.0; 2]; frames.len()]
    };
    let combined = combine::combine(
        &frames,
        &combine::Plan {
            shifts: &shifts,
            exposures: &refined.exposures,
            response: &response,
            noise: &noise,
            saturation: settings.saturation,
        },
    );
    let records = frames
        .iter()
        .enumerate()
        .map(|(j, frame)| FrameRecord {
            name: frame.name.clone(),
            claimed: claimed[j],
            exposure: refined.exposures[j],
            overlaps: refined.overlaps[j],
            shift: shifts[j],
            saturated: combined.saturated[j],
            ghosts: combined.left_out[j],
        })
        .collect();
    Ok(Merged {
        radiance: combined.radiance,
        variance: combined.variance,
        clipped: combined.clipped,
        ghosts: combined.ghosts,
        response,
        linear,
        noise,
        frames: records,
    })
}

/// Exposures whose radiances are numbers of single precision.
const EXPOSURES: std::ops::RangeInclusive<f64> = 1e-15..=1e15;

fn check(frames: &[Frame]) -> Result<(), MergeError> {
    let [first, others @ ..] = frames else {
        return Err(MergeError::TooFew { count: 0 });
    };
    if others.is_empty() {
        return Err(MergeError::TooFew { count: 1 });
    }
    let size = |frame: &Frame| (frame.samples.width, frame.samples.height);
    for frame in frames {
        if !EXPOSURES.contains(&frame.exposure) {
            return Err(MergeError::Exposure {
                name: frame.name.clone(),
                exposure: frame.exposure,
            });
        }
        if size(frame) != size(first) {
            return Err(MergeError::Size {
                name: frame.name.clone(),
                size: size(frame),
                first: first.name.clone(),
                expected: size(first),
            });
        }
        if frame.depth != first.depth {
            return Err(MergeError::Depth {
                name: frame.name.clone(),
                depth: frame.depth,
                first: first.name.clone(),
                expected: first.depth,
            });
        }
        if let Some(i) =
            (frame.samples.pixels.iter()).position(|p| p.iter().any(|c| !c.is_finite()))
        {
            return Err(MergeError::NotFinite {
                name: frame.name.clone(),
                column: i % frame.samples.width,
                row: i / frame.samples.width,
            });
        }
    }
    if frames.iter().all(|f| f.exposure == first.exposure) {
        return Err(MergeError::SameExposure {
            exposure: first.exposure,
        });
    }
    Ok(())
}
