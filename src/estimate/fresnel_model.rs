//! Which Fresnel terms a fit may choose from, as columns of a linear model.
//!
//! ```text
//! dielectric   rho_s F(c; eta)
//! Schlick      F0 (1 − s) + F90 s,   s = (1 − c)^5
//! ```
//!
//! Either is linear in its albedos, so that each term is a trace of its own.

use serde::Serialize;

use super::Estimate;
use crate::brdf::{dielectric, schlick_weight};

/// Index of refraction of the paper, and of the dielectric beside Schlick's term.
pub(super) const PAPER_ETA: f32 = 1.3;

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
    /// Either, by evidence.
    Auto {
        /// Index of refraction of the dielectric.
        eta: f32,
    },
}

/// A term of the specular model that is linear in an albedo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Basis {
    /// The exact dielectric.
    Dielectric,
    /// Schlick's reflectance at normal incidence, `1 − s`.
    Normal,
    /// Schlick's reflectance at grazing, `s`.
    Grazing,
}

impl FresnelModel {
    /// Index of refraction of the first of its terms; none where that is Schlick's.
    pub(super) fn eta(self) -> Option<f32> {
        match self {
            Self::Dielectric { eta } | Self::Auto { eta } => Some(eta),
            Self::Schlick => None,
        }
    }

    /// The terms for which traces are modelled, in the order of their columns.
    pub(super) fn bases(self) -> &'static [Basis] {
        match self {
            Self::Dielectric { .. } => &[Basis::Dielectric],
            Self::Schlick => &[Basis::Normal, Basis::Grazing],
            Self::Auto { .. } => &[Basis::Dielectric, Basis::Normal, Basis::Grazing],
        }
    }

    /// A term's reflectance at `cos_d = ω_i·ω_h` for an albedo of one.
    #[inline]
    pub(super) fn reflectance(self, basis: Basis, cos_d: f32) -> f32 {
        match (basis, self) {
            (Basis::Dielectric, Self::Dielectric { eta } | Self::Auto { eta }) => {
                dielectric(cos_d, eta)
            }
            (Basis::Dielectric, Self::Schlick) => 0.0,
            (Basis::Normal, _) => 1.0 - schlick_weight(cos_d),
            (Basis::Grazing, _) => schlick_weight(cos_d),
        }
    }
}

impl Estimate {
    /// The same lobe under another Fresnel term, a dielectric of index `eta` or Schlick's: of equal
    /// reflectance at normal incidence.
    pub(super) fn under(&self, eta: Option<f32>) -> Self {
        let mut same = *self;
        match (self.f90, eta) {
            (Some(_), Some(eta)) => {
                let normal = dielectric(1.0, eta);
                same.rho_s /= normal;
                same.sigma_rho_s /= normal;
                same.f90 = None;
            }
            (None, None) => {
                // A point without a lobe, or of a dielectric whose index nothing says: the paper's.
                let normal = dielectric(1.0, PAPER_ETA);
                same.f90 = Some(self.rho_s.max_element());
                same.rho_s *= normal;
                same.sigma_rho_s *= normal;
            }
            (Some(_), None) | (None, Some(_)) => {}
        }
        same
    }
}
