//! Which Fresnel terms a fit may choose from, as columns of a linear model.
//!
//! ```text
//! dielectric   rho_s F(c; eta)
//! Schlick      F0 (1 − s) + F90 s,   s = (1 − c)^5
//! ```
//!
//! Either is linear in its albedos, so that each term is a trace of its own. A dielectric of another index
//! needs none: up to 87° its reflectance is a mix of those of index 1.3 and 1.5 and of Schlick's two terms
//! to 1e-3; without that of index 1.5 the best mix is off by 7 % at 75° (index 1.8).

use std::sync::LazyLock;

use glam::{DMat4, DVec4};
use serde::Serialize;

use super::Estimate;
use crate::brdf::{dielectric, schlick_weight};

/// Index of refraction of the paper, and of the first of the dielectrics to choose from.
pub(super) const PAPER_ETA: f32 = 1.3;
/// Index of refraction of plastics and glass.
const PLASTIC_ETA: f32 = 1.5;

/// A dielectric to choose.
pub(super) struct Dielectric {
    /// Index of refraction.
    pub(super) eta: f32,
    /// Its reflectance as a mix of the terms that are modelled.
    pub(super) mix: Vec<(Basis, f32)>,
}

/// Indices of refraction between one tenth and the next.
pub(super) const TENTH: usize = 10;

/// The dielectrics to choose from: of index 1.3 to 1.8, in hundredths. Only those of tenths are tried at
/// first; half a tenth off, alpha's error would be 1.6 times as large, so [`super::refraction`] looks between.
pub(super) static DIELECTRICS: LazyLock<Vec<Dielectric>> = LazyLock::new(|| {
    let eta = |k: usize| (13 * TENTH + k) as f32 / (10 * TENTH) as f32;
    (0..=5 * TENTH).map(|k| Dielectric::new(eta(k))).collect()
});

/// Number of the nearest of [`DIELECTRICS`].
pub(super) fn nearest_dielectric(eta: f32) -> usize {
    let place = (eta - PAPER_ETA) * 10.0 * TENTH as f32;
    (place.round().max(0.0) as usize).min(5 * TENTH)
}

impl Dielectric {
    /// The mix of least squares of the relative error over 0 to 87°.
    fn new(eta: f32) -> Self {
        const BASES: [Basis; 4] = [
            Basis::Dielectric,
            Basis::Plastic,
            Basis::Normal,
            Basis::Grazing,
        ];
        let (mut a, mut b) = (DMat4::ZERO, DVec4::ZERO);
        for step in 0..348 {
            let cos = (0.25 * step as f32).to_radians().cos();
            let exact = f64::from(dielectric(cos, eta));
            let terms = BASES.map(|basis| f64::from(FresnelModel::Auto.reflectance(basis, cos)));
            let row = DVec4::from_array(terms) / exact;
            a += DMat4::from_cols(row * row.x, row * row.y, row * row.z, row * row.w);
            b += row;
        }
        let weights = (a.inverse() * b).as_vec4().to_array();
        Self {
            eta,
            // What is left after rounding of terms that a dielectric does not need stays out.
            mix: (BASES.into_iter().zip(weights))
                .map(|(basis, weight)| (basis, (1e6 * weight).round() / 1e6))
                .filter(|(_, weight)| *weight != 0.0)
                .collect(),
        }
    }
}

/// The Fresnel terms that a fit may choose from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FresnelModel {
    /// An exact dielectric.
    Dielectric {
        /// Index of refraction.
        eta: f32,
    },
    /// Schlick's approximation with free ends, for metals.
    Schlick,
    /// By evidence: a dielectric of index 1.3 to 1.8, or Schlick's with free ends, neutral or RGB.
    Auto,
}

/// A term of the specular model that is linear in an albedo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Basis {
    /// The exact dielectric, of the settings' index or the paper's.
    Dielectric,
    /// The exact dielectric of index 1.5.
    Plastic,
    /// Schlick's reflectance at normal incidence, `1 − s`.
    Normal,
    /// Schlick's reflectance at grazing, `s`.
    Grazing,
}

impl FresnelModel {
    /// Index of refraction of the first of its terms; none where that is Schlick's.
    pub(super) fn eta(self) -> Option<f32> {
        match self {
            Self::Dielectric { eta } => Some(eta),
            Self::Auto => Some(PAPER_ETA),
            Self::Schlick => None,
        }
    }

    /// The terms for which traces are modelled, in the order of their columns.
    pub(super) fn bases(self) -> &'static [Basis] {
        match self {
            Self::Dielectric { .. } => &[Basis::Dielectric],
            Self::Schlick => &[Basis::Normal, Basis::Grazing],
            Self::Auto => &[
                Basis::Dielectric,
                Basis::Plastic,
                Basis::Normal,
                Basis::Grazing,
            ],
        }
    }

    /// A term's reflectance at `cos_d = ω_i·ω_h` for an albedo of one.
    #[inline]
    pub(super) fn reflectance(self, basis: Basis, cos_d: f32) -> f32 {
        match basis {
            Basis::Dielectric => self.eta().map_or(0.0, |eta| dielectric(cos_d, eta)),
            Basis::Plastic => dielectric(cos_d, PLASTIC_ETA),
            Basis::Normal => 1.0 - schlick_weight(cos_d),
            Basis::Grazing => schlick_weight(cos_d),
        }
    }
}

impl Estimate {
    /// The same lobe under another Fresnel term, a dielectric of index `eta` or Schlick's: of equal
    /// reflectance at normal incidence.
    pub(super) fn under(&self, eta: Option<f32>) -> Self {
        let mut same = *self;
        let normal = |eta: Option<f32>| eta.map_or(1.0, |eta| dielectric(1.0, eta));
        let ratio = normal(self.eta) / normal(eta);
        same.rho_s *= ratio;
        same.sigma_rho_s *= ratio;
        same.eta = eta;
        same.f90 = match (eta, self.eta) {
            (Some(_), _) => None,
            // At grazing every dielectric reflects all.
            (None, Some(_)) => Some(self.rho_s.max_element()),
            (None, None) => self.f90,
        };
        same
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dielectrics_are_mixes_of_the_terms_that_are_modelled() {
        for dielectric_of in DIELECTRICS.iter() {
            for degrees in 0..87 {
                let cos = (degrees as f32).to_radians().cos();
                let terms = dielectric_of.mix.iter();
                let mix: f32 = terms
                    .map(|(basis, weight)| weight * FresnelModel::Auto.reflectance(*basis, cos))
                    .sum();
                let exact = dielectric(cos, dielectric_of.eta);
                assert!((mix / exact - 1.0).abs() < 1e-3, "{degrees}: {mix} {exact}");
            }
        }
    }
}
