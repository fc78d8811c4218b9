//! Which parameters of the lobe enter linearly: its albedos.

use glam::{DVec3, Vec3};

use super::columns::Columns;
use super::fresnel_model::{Basis, FresnelModel};
use super::{Estimate, FitSettings, SpecularColour};
use crate::brdf::Ndf;

/// Largest number of a lobe's linear parameters.
pub(super) const MOST_PARAMETERS: usize = 4;

/// The linear parameters of a lobe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LobeForm {
    /// `rho_s`, one for all channels.
    Neutral,
    /// `rho_s`, one a channel.
    Rgb,
    /// Schlick's Fresnel term: `F0`, one a channel, and `F90`.
    Schlick,
}

/// What a parameter multiplies: a trace, in some channels.
pub(super) struct Term {
    /// Index into [`LobeForm::bases`].
    pub(super) basis: usize,
    /// Channels it enters.
    pub(super) channels: [bool; 3],
}

const ALL: [bool; 3] = [true; 3];
const EACH: [[bool; 3]; 3] = [
    [true, false, false],
    [false, true, false],
    [false, false, true],
];

const fn term(basis: usize, channels: [bool; 3]) -> Term {
    Term { basis, channels }
}

impl LobeForm {
    /// What each parameter multiplies.
    pub(super) fn terms(self) -> &'static [Term] {
        match self {
            Self::Neutral => &const { [term(0, ALL)] },
            Self::Rgb => &const { [term(0, EACH[0]), term(0, EACH[1]), term(0, EACH[2])] },
            Self::Schlick => {
                &const {
                    [
                        term(0, EACH[0]),
                        term(0, EACH[1]),
                        term(0, EACH[2]),
                        term(1, ALL),
                    ]
                }
            }
        }
    }

    /// The traces that the parameters multiply.
    pub(super) fn bases(self) -> &'static [Basis] {
        match self {
            Self::Neutral | Self::Rgb => &[Basis::Dielectric],
            Self::Schlick => &[Basis::Normal, Basis::Grazing],
        }
    }

    /// Number of parameters.
    pub(super) fn size(self) -> usize {
        self.terms().len()
    }

    /// A trace and its derivative by `ln_alpha`, one pair an observation.
    pub(super) fn visit(
        self,
        columns: &Columns,
        ndf: Ndf,
        basis: Basis,
        ln_alpha: f32,
        visit: impl FnMut(usize, Vec3, Vec3),
    ) {
        columns.specular(ndf as usize, basis, ln_alpha, visit);
    }

    /// `[observations][parameters]` derivative of what is seen by each parameter.
    pub(super) fn jacobian(self, columns: &Columns, ndf: Ndf, ln_alpha: f32) -> Vec<DVec3> {
        self.jacobian_of(0..columns.diffuse.len(), columns, ndf, ln_alpha)
    }

    /// The same, of some observations: `[place in observations][parameters]`.
    pub(super) fn jacobian_of(
        self,
        observations: impl ExactSizeIterator<Item = usize> + Clone,
        columns: &Columns,
        ndf: Ndf,
        ln_alpha: f32,
    ) -> Vec<DVec3> {
        let terms = self.terms();
        let mut jacobian = vec![DVec3::ZERO; observations.len() * terms.len()];
        for (index, &basis) in self.bases().iter().enumerate() {
            let mut rows = jacobian.chunks_exact_mut(terms.len());
            let chosen = observations.clone();
            columns.specular_of(chosen, ndf as usize, basis, ln_alpha, |_, value, _| {
                let Some(row) = rows.next() else { return };
                for (entry, term) in row.iter_mut().zip(terms).filter(|(_, t)| t.basis == index) {
                    for c in (0..3).filter(|&c| term.channels[c]) {
                        entry[c] = f64::from(value[c]);
                    }
                }
            });
        }
        jacobian
    }

    /// Those that the settings allow.
    pub(super) fn allowed(settings: &FitSettings) -> Vec<Self> {
        let mut forms = match (settings.fresnel, settings.specular) {
            (FresnelModel::Schlick, _) => Vec::new(),
            (_, SpecularColour::Auto) => vec![Self::Neutral, Self::Rgb],
            (_, SpecularColour::Neutral) => vec![Self::Neutral],
            (_, SpecularColour::Rgb) => vec![Self::Rgb],
        };
        if !matches!(settings.fresnel, FresnelModel::Dielectric { .. }) {
            forms.push(Self::Schlick);
        }
        forms
    }

    /// Writes parameters into an estimate.
    pub(super) fn put(self, lobe: &[f64; MOST_PARAMETERS], estimate: &mut Estimate) {
        estimate.rho_s = match self {
            Self::Neutral => Vec3::splat(lobe[0] as f32),
            Self::Rgb | Self::Schlick => DVec3::from_slice(lobe).as_vec3(),
        };
        estimate.f90 = match self {
            Self::Neutral | Self::Rgb => None,
            Self::Schlick => Some(lobe[3] as f32),
        };
    }

    /// The parameters that an estimate of this form has.
    pub(super) fn parameters(self, estimate: &Estimate) -> [f64; MOST_PARAMETERS] {
        let mut lobe = self.of_rho_s(estimate.rho_s);
        if self == Self::Schlick {
            lobe[3] = estimate.f90.map_or(0.0, f64::from);
        }
        lobe
    }

    /// The parameters of a lobe of given specular albedo.
    pub(super) fn of_rho_s(self, rho_s: Vec3) -> [f64; MOST_PARAMETERS] {
        let rho_s = rho_s.as_dvec3();
        match self {
            Self::Neutral => [rho_s.x, 0.0, 0.0, 0.0],
            Self::Rgb | Self::Schlick => [rho_s.x, rho_s.y, rho_s.z, 0.0],
        }
    }
}
