//! Parameters without gaps, to render with.
//!
//! Estimates stand alone: a point that saw no highlight has a lobe with an error bar as wide as
//! itself. To reproduce the object in another light such a point does better with its neighbours'
//! lobe, and with the diffuse albedo that its own observations ask for beside *that* lobe.

use glam::{Vec3, Vec4};

use super::columns::Columns;
use super::fresnel_model::PAPER_ETA;
use super::{Estimate, Status};
use crate::brdf::{Appearance, Ndf};

/// A specular albedo below this reflects 0.2 % of the light face on (eta 1.3): nobody sees its lobe.
const MATTE: f32 = 0.1;

/// Whether a diffuse albedo is worth more than the neighbours': every channel known to 25 % or to
/// 0.02, one standard deviation.
pub(super) fn is_precise(rho_d: Vec3, sigma: Vec3) -> bool {
    sigma.cmplt((0.25 * rho_d).max(Vec3::splat(0.02))).all()
}

impl Estimate {
    /// Whether a point's own lobe is worth more than its neighbours': alpha known to 25 % and rho_s to
    /// 50 %, one standard deviation, stretched where few frames tell or the model fits them badly. Beyond, the product of the two fits
    /// the frames that were seen, and either may be wrong by orders of magnitude in another light. Where
    /// the specular albedo is firmly next to nothing, alpha does not matter. An estimator without error
    /// bars is taken at its word.
    pub fn lobe_is_known(&self) -> bool {
        let without_bars = self.sigma_alpha.is_infinite() && self.sigma_rho_s.is_infinite();
        let rho_s = self.rho_s.max_element();
        let stretch = self.stretch();
        let sigma_ln_alpha = stretch * self.sigma_alpha / self.alpha;
        let precise = sigma_ln_alpha < 0.25 && stretch * self.sigma_rho_s < 0.5 * rho_s;
        // Where the search ends, an error bar has only one side: a lobe narrower than the light's texels
        // fits a firefly as well as anything.
        let (narrowest, _) = Columns::ln_range();
        let inside = self.alpha.ln() - 3.0 * sigma_ln_alpha > narrowest;
        let matte = {
            let same = self.under(Some(PAPER_ETA));
            same.rho_s.max_element() + 2.0 * same.sigma_rho_s < MATTE
        };
        match self.status {
            Status::Converged => without_bars || precise && inside || matte,
            Status::AlphaAtBound => without_bars || matte,
            Status::Unidentifiable => matte,
            _ => false,
        }
    }

    /// How much wider than a normal deviate's a 95 % interval is where as few frames tell as here:
    /// Student's quantile with three frames' degrees of freedom taken up (Cornish and Fisher's expansion).
    /// Pixels of one frame share its light, so they count once; a pooled lobe has frames enough.
    ///
    /// Residuals beyond the noise are the model's, which a frame's pixels share, too: of `k` pixels a frame they
    /// widen the error bar by `√(1 + k (m² − 1))` of a misfit `m`, not by `m`. For the few that a vertex has,
    /// that is about `m²`, of which the error bar has one `m`.
    ///
    /// Without the first, one point of five frames, a firefly in one, lent a mirror to its neighbours, and the
    /// demo's reproduction lost 1.5 dB; without the second, another did, and it lost 1.0 dB.
    fn stretch(&self) -> f32 {
        let freedom = self.frames.saturating_sub(3) as f32;
        if self.material.is_some() {
            1.0
        } else if freedom < 2.0 {
            f32::INFINITY
        } else {
            self.misfit * (1.0 + 1.21 / freedom + 1.44 / (freedom * freedom))
        }
    }

    /// Whether a point's own diffuse albedo is worth more than its neighbours'.
    pub fn diffuse_is_known(&self) -> bool {
        let without_bars = self.sigma_rho_d.cmpeq(Vec3::INFINITY).all();
        let fitted = matches!(
            self.status,
            Status::Converged | Status::Unidentifiable | Status::AlphaAtBound
        );
        fitted && (without_bars || is_precise(self.rho_d, self.sigma_rho_d))
    }
}

/// The points' own lobes where they are known, their neighbours' elsewhere; `rho_d` stays zero. If no
/// point's lobe is known, all keep their own.
///
/// Means are of logarithms, by relative precision: an albedo whose error bar is small only beside its
/// own, far too large value does not spread.
pub(super) fn lobes(estimates: &[Estimate], neighbours: &[Vec<u32>]) -> Vec<Appearance> {
    let mut known: Vec<bool> = estimates.iter().map(Estimate::lobe_is_known).collect();
    if !known.contains(&true) {
        known.fill(true);
    }
    let relative = |sigma: f32, value: f32| {
        let ratio = sigma / value.max(f32::MIN_POSITIVE);
        if ratio.is_finite() {
            1.0 / (ratio * ratio).max(1e-6)
        } else {
            1.0
        }
    };
    const DARKEST: Vec3 = Vec3::splat(1e-4);
    let rho_s = fill(
        estimates.iter().map(|e| {
            let weight = relative(e.sigma_rho_s, e.rho_s.max_element());
            (e.rho_s.max(DARKEST).map(f32::ln), weight)
        }),
        &known,
        neighbours,
    );
    let shape = fill(
        estimates.iter().map(|e| {
            let f90 = e.f90.unwrap_or(1.0).max(DARKEST.x).ln();
            let value = Vec3::new(e.alpha.ln(), f32::from(e.ndf == Ndf::Ggx), f90);
            (value, relative(e.sigma_alpha, e.alpha))
        }),
        &known,
        neighbours,
    );
    rho_s
        .into_iter()
        .zip(shape)
        .map(|(rho_s, shape)| Appearance {
            rho_d: Vec3::ZERO,
            rho_s: rho_s.map(|v| v.exp()),
            f90: shape.z.exp(),
            alpha: shape.x.exp(),
            ggx: shape.y,
        })
        .collect()
}

/// Gives every point a diffuse albedo: its own where it has one, its neighbours' elsewhere.
pub(super) fn complete(looks: &mut [Appearance], rho_d: &[Option<Vec3>], neighbours: &[Vec<u32>]) {
    for (look, rho_d) in looks.iter_mut().zip(fill_diffuse(rho_d, neighbours)) {
        look.rho_d = rho_d;
    }
}

/// Diffuse albedos without gaps.
fn fill_diffuse(rho_d: &[Option<Vec3>], neighbours: &[Vec<u32>]) -> Vec<Vec3> {
    let known: Vec<bool> = rho_d.iter().map(Option::is_some).collect();
    fill(
        rho_d.iter().map(|value| (value.unwrap_or_default(), 1.0)),
        &known,
        neighbours,
    )
}

/// The mean by weight, or zero of nothing.
fn weighted_mean(values: impl Iterator<Item = (Vec3, f32)>) -> Vec3 {
    let sum = values.fold(Vec4::ZERO, |sum, (v, w)| sum + (v * w).extend(w));
    if sum.w > 0.0 {
        sum.truncate() / sum.w
    } else {
        Vec3::ZERO
    }
}

/// Fills unknown values with the weighted mean of known neighbours, ring by ring; what no ring
/// reaches takes the mean of all known values.
fn fill(
    entries: impl Iterator<Item = (Vec3, f32)>,
    known: &[bool],
    neighbours: &[Vec<u32>],
) -> Vec<Vec3> {
    let mut entries: Vec<(Vec3, f32)> = entries.collect();
    let mut known = known.to_vec();
    let everywhere = weighted_mean(entries.iter().zip(&known).filter(|p| *p.1).map(|p| *p.0));
    let mut waiting: Vec<usize> = (0..known.len()).filter(|&i| !known[i]).collect();
    while !waiting.is_empty() {
        let reached: Vec<(usize, (Vec3, f32))> = waiting
            .iter()
            .filter_map(|&i| {
                let around = neighbours[i].iter().map(|&j| j as usize);
                let around: Vec<(Vec3, f32)> =
                    around.filter(|&j| known[j]).map(|j| entries[j]).collect();
                let weight = around.iter().map(|e| e.1).sum::<f32>() / around.len() as f32;
                (!around.is_empty()).then(|| (i, (weighted_mean(around.into_iter()), weight)))
            })
            .collect();
        if reached.is_empty() {
            waiting.iter().for_each(|&i| entries[i].0 = everywhere);
            break;
        }
        for &(i, entry) in &reached {
            entries[i] = entry;
            known[i] = true;
        }
        waiting.retain(|&i| !known[i]);
    }
    entries.into_iter().map(|(value, _)| value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_take_their_neighbours_and_islands_the_mean() {
        // 0 – 1 – 2 – 3 in a chain, 4 alone; 0 and 3 are known.
        let values = [Some(Vec3::ZERO), None, None, Some(Vec3::splat(2.0)), None];
        let neighbours = vec![vec![1], vec![0, 2], vec![1, 3], vec![2], vec![]];
        let filled = fill_diffuse(&values, &neighbours);
        assert_eq!(filled[1], Vec3::ZERO);
        assert_eq!(filled[2], Vec3::splat(2.0));
        assert_eq!(filled[4], Vec3::ONE);
    }

    #[test]
    fn a_wild_albedo_with_a_wide_bar_does_not_spread() {
        let known = |rho_s: f32, sigma: f32| Estimate {
            rho_s: Vec3::splat(rho_s),
            sigma_rho_s: sigma,
            alpha: 0.2,
            sigma_alpha: 0.01,
            sigma_rho_d: Vec3::splat(0.01),
            ..Estimate::without_data(Status::Converged, 36)
        };
        let estimates = [
            known(2.0, 0.02),
            Estimate::without_data(Status::Unseen, 0),
            known(40.0, 19.0),
        ];
        let neighbours = vec![vec![1], vec![0, 2], vec![1]];
        let filled = lobes(&estimates, &neighbours);
        assert!((filled[1].rho_s.x - 2.0).abs() < 0.1, "{:?}", filled[1]);
        assert!((filled[2].rho_s.x - 40.0).abs() < 1e-3, "known: its own");
    }

    #[test]
    fn few_frames_are_no_proof_of_a_lobe() {
        let seen_in = |frames| Estimate {
            rho_s: Vec3::splat(2.0),
            sigma_rho_s: 0.02,
            alpha: 0.2,
            sigma_alpha: 0.03,
            ..Estimate::without_data(Status::Converged, frames)
        };
        assert!(seen_in(36).lobe_is_known() && !seen_in(5).lobe_is_known());
        let pooled = Estimate {
            material: Some(0),
            ..seen_in(5)
        };
        assert!(pooled.lobe_is_known(), "its material has frames enough");
        let misfit = Estimate {
            misfit: 2.0,
            ..seen_in(9)
        };
        assert!(seen_in(9).lobe_is_known() && !misfit.lobe_is_known());
    }

    #[test]
    fn without_any_known_lobe_all_keep_their_own() {
        let matte = Estimate {
            alpha: 0.4,
            ..Estimate::without_data(Status::Unidentifiable, 9)
        };
        let looks = lobes(&[matte; 3], &[vec![1], vec![0, 2], vec![1]]);
        assert!(looks.iter().all(|look| look.rho_s.max_element() < 1e-3));
        assert!((looks[0].alpha - 0.4).abs() < 1e-6);
    }

    #[test]
    fn a_matte_point_beside_a_shiny_one_stays_matte() {
        let shiny = Estimate {
            rho_s: Vec3::splat(2.35),
            sigma_rho_s: 0.05,
            alpha: 0.2,
            sigma_alpha: 0.01,
            ..Estimate::without_data(Status::Converged, 9)
        };
        let matte = Estimate {
            sigma_rho_s: 0.02,
            ..Estimate::without_data(Status::Unidentifiable, 9)
        };
        let looks = lobes(&[shiny, matte], &[vec![1], vec![0]]);
        assert!(looks[1].rho_s.max_element() < 1e-3, "{:?}", looks[1]);
    }
}
