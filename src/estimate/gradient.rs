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

use glam::{DMat3, DVec3, Vec3};

use super::columns::Columns;
use super::fresnel_model::Basis;
use super::least_squares::Normal;
use super::search::minimise_over_alpha;
use super::{Estimate, FitSettings, Status};
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
        columns.specular(ndf as usize, Basis::Dielectric, ln_alpha, |i, value, _| {
            specular[i] = value
        });
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
            let ln_alpha = minimise_over_alpha(|x| residual(ndf, x));
            (ndf, ln_alpha, residual(ndf, ln_alpha))
        })
        .min_by(|a, b| a.2.total_cmp(&b.2));
    let Some((ndf, ln_alpha, _)) = best else {
        return Estimate::without_data(Status::TooFewSamples, frames);
    };

    // Step 2: albedos by unweighted NNLS.
    let mut normal = Normal {
        size: 4,
        ..Normal::default()
    };
    columns.specular(
        ndf as usize,
        Basis::Dielectric,
        ln_alpha,
        |i, specular, _| {
            let observed = trace.observations[i].radiance.as_dvec3();
            let (diffuse, specular) = (columns.diffuse[i].as_dvec3(), specular.as_dvec3());
            let [r, g, b] = DVec3::AXES;
            let jacobian = [r * diffuse.x, g * diffuse.y, b * diffuse.z, specular];
            normal.add(&DMat3::IDENTITY, &jacobian, observed);
        },
    );
    let (x, objective) = normal.solve();
    let (low, high) = Columns::ln_range();
    let at_bound = ln_alpha - low < 1e-3 || high - ln_alpha < 1e-3;
    Estimate {
        rho_d: DVec3::new(x[0], x[1], x[2]).as_vec3(),
        rho_s: Vec3::splat(x[3] as f32),
        eta: settings.fresnel.eta(),
        alpha: ln_alpha.exp(),
        ndf,
        residual: if normal.yy > 0.0 {
            (objective / normal.yy).sqrt() as f32
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
