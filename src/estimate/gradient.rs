//! The paper's estimator, to the letter: the row to beat.
//!
//! Step 1 (Eq. 5–8): temporal gradients of observation and specular trace, the diffuse gradient
//! taken as zero; the NDF is fitted unnormalised, so that its scale absorbs rho_s, and the NDF with
//! the smaller residual is kept. Step 2 (Eq. 10): albedos by non-negative least squares. No noise
//! weights, no self-shadowing; incident directions within 0.5π of the mirror direction.
//!
//! Left open by the paper and chosen here: gradients are forward differences between neighbouring
//! frames in which the point is seen; the residual is summed over R, G and B with one scale for
//! all, as its specular albedo is neutral.

use glam::Vec3;

use super::columns::{Columns, ROUGHNESSES, roughness};
use super::full::golden_section;
use super::separable::{Gram, solve};
use super::{Estimate, FitSettings, SpecularColour, Status};
use crate::brdf::Ndf;
use crate::traces::Trace;

/// Fits one point, given its columns. The paper has no error bars: they are infinite.
pub(super) fn estimate(trace: &Trace, columns: &Columns, settings: &FitSettings) -> Estimate {
    let frames = trace.observations.len() as u32;
    if frames == 0 {
        return Estimate::without_data(Status::Unseen, 0);
    }
    let neighbours: Vec<usize> = (1..trace.observations.len())
        .filter(|&i| trace.observations[i].frame == trace.observations[i - 1].frame + 1)
        .collect();
    if neighbours.len() < 2 {
        return Estimate::without_data(Status::TooFewSamples, frames);
    }

    // Step 1: the lobe whose gradient, scaled, is nearest to the observed gradient.
    let residual = |ndf: Ndf, ln_alpha: f32| {
        let mut specular = vec![Vec3::ZERO; trace.observations.len()];
        columns.specular(ndf as usize, ln_alpha, |i, value, _| specular[i] = value);
        let (mut ss, mut st, mut tt) = (0.0, 0.0, 0.0);
        for &i in &neighbours {
            let modelled = (specular[i] - specular[i - 1]).as_dvec3();
            let observed =
                (trace.observations[i].radiance - trace.observations[i - 1].radiance).as_dvec3();
            ss += modelled.length_squared();
            st += modelled.dot(observed);
            tt += observed.length_squared();
        }
        if ss > 0.0 && st > 0.0 {
            tt - st * st / ss
        } else {
            tt
        }
    };
    let candidates = Ndf::ALL
        .into_iter()
        .filter(|&ndf| settings.ndf.is_none_or(|n| n == ndf));
    let best = candidates
        .map(|ndf| {
            let grid: Vec<f64> = (0..ROUGHNESSES)
                .map(|k| residual(ndf, roughness(k).ln()))
                .collect();
            let k = (0..ROUGHNESSES)
                .min_by(|&a, &b| grid[a].total_cmp(&grid[b]))
                .unwrap_or(0);
            let low = roughness(k.saturating_sub(1)).ln();
            let high = roughness((k + 1).min(ROUGHNESSES - 1)).ln();
            let ln_alpha = golden_section(low, high, |x| residual(ndf, x));
            (ndf, ln_alpha, residual(ndf, ln_alpha))
        })
        .min_by(|a, b| a.2.total_cmp(&b.2));
    let Some((ndf, ln_alpha, _)) = best else {
        return Estimate::without_data(Status::TooFewSamples, frames);
    };

    // Step 2: albedos by unweighted NNLS.
    let mut grams = [Gram::default(); 3];
    columns.specular(ndf as usize, ln_alpha, |i, specular, _| {
        for (c, gram) in grams.iter_mut().enumerate() {
            gram.add(
                1.0,
                f64::from(columns.diffuse[i][c]),
                f64::from(specular[c]),
                f64::from(trace.observations[i].radiance[c]),
            );
        }
    });
    let albedos = solve(&grams, SpecularColour::Neutral);
    let total: f64 = grams.iter().map(|g| g.tt).sum();
    let to_vec = |v: [f64; 3]| Vec3::new(v[0] as f32, v[1] as f32, v[2] as f32);
    let (low, high) = Columns::ln_range();
    let at_bound = ln_alpha - low < 1e-3 || high - ln_alpha < 1e-3;
    Estimate {
        rho_d: to_vec(albedos.rho_d),
        rho_s: to_vec(albedos.rho_s),
        alpha: ln_alpha.exp(),
        ndf,
        residual: if total > 0.0 {
            (albedos.objective / total).sqrt() as f32
        } else {
            0.0
        },
        status: if at_bound {
            Status::AlphaAtBound
        } else {
            Status::Converged
        },
        ..Estimate::without_data(Status::Converged, frames)
    }
}
