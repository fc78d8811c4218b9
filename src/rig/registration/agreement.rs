//! Which frames disagree with the rest.

use glam::DVec2;

use super::FrameAgreement;
use super::border::Observed;
use super::contour::Contours;
use crate::rig::View;

/// Places of the grid on which masks and mesh are compared, at most.
const GRID: usize = 1 << 16;

/// Pixels that both mask and mesh cover, over those that either does; on a grid of pixel centres. `None`
/// without a mask.
pub(super) fn overlap(
    contours: &Contours<'_>,
    view: &View,
    (width, height): (usize, usize),
    observed: &Observed,
) -> Option<f64> {
    let mut stride = 1;
    while width.div_ceil(stride) * height.div_ceil(stride) > GRID {
        stride += 1;
    }
    let (mut both, mut either) = (0u64, 0u64);
    for y in (stride / 2..height).step_by(stride) {
        for x in (stride / 2..width).step_by(stride) {
            let mask = observed.covers(x, y)?;
            let ray = view.ray(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
            let mesh = contours.meets(&ray);
            both += u64::from(mask && mesh);
            either += u64::from(mask || mesh);
        }
    }
    Some(if either == 0 {
        1.0
    } else {
        both as f64 / either as f64
    })
}

/// Says of each frame in what it disagrees with the others.
///
/// A frame disagrees where less of its outline than 0.9 times the median is within a pixel of a border,
/// where its distances are twice the median's and more than a third of a pixel, or where another angle
/// would suit it better by five standard deviations and a twentieth of a degree. On sound masks none of
/// these happens; a mask of another frame, or an angle off by a tenth of a degree, does.
pub(super) fn judged(mut frames: Vec<FrameAgreement>) -> Vec<FrameAgreement> {
    let median = |value: &dyn Fn(&FrameAgreement) -> f64| {
        let mut values: Vec<f64> = frames.iter().map(value).filter(|v| v.is_finite()).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    let (near, rms) = (median(&|f| f.near), median(&|f| f.rms));
    for frame in &mut frames {
        if frame.outline.is_empty() {
            frame.disagrees.push("the object is out of view".to_owned());
            continue;
        }
        if frame.near < 0.9 * near {
            frame.disagrees.push(format!(
                "{:.0} % of the outline is within a pixel of a border, {:.0} % in the median frame",
                100.0 * frame.near,
                100.0 * near
            ));
        }
        if frame.rms > 2.0 * rms && frame.rms > 1.0 / 3.0 {
            frame.disagrees.push(format!(
                "outline {:.2} pixels off, {rms:.2} in the median frame",
                frame.rms
            ));
        }
        if let (Some(offset), Some(sigma)) = (frame.angle_offset, frame.angle_sigma)
            && offset.abs() > 5.0 * sigma
            && offset.abs() > 0.05_f64.to_radians()
        {
            frame.disagrees.push(format!(
                "its angle would suit better {:+.3}° on",
                offset.to_degrees()
            ));
        }
    }
    frames
}
