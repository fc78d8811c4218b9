//! Which Fresnel terms a fit may choose from, as columns of a linear model.
//!
//! ```text
//! dielectric   rho_s F(c; eta)
//! Schlick      F0 (1 − s) + F90 s,   s = (1 − c)^5
//! ```
//!
//! Either is linear in its albedos, so that each term is a trace of its own.

use serde::Serialize;

use crate::brdf::{dielectric, schlick_weight};

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
