//! Which parameters of the lobe enter linearly: its albedos.

use glam::{DVec3, Vec3};

use super::columns::Columns;
use super::fresnel_model::{Basis, DIELECTRICS, FresnelModel, TENTH};
use super::{FitSettings, SpecularColour};
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
    /// `rho_s` of one of the [`DIELECTRICS`], one for all channels.
    NeutralOf(usize),
    /// The same, one a channel.
    RgbOf(usize),
    /// Schlick's Fresnel term: `F0`, one for all channels, and `F90`.
    NeutralSchlick,
    /// Schlick's Fresnel term: `F0`, one a channel, and `F90`.
    Schlick,
}

/// What a parameter multiplies: a trace, in some channels.
pub(super) struct Term {
    /// Index into [`LobeForm::traces`].
    pub(super) trace: usize,
    /// Channels it enters.
    pub(super) channels: [bool; 3],
}

const ALL: [bool; 3] = [true; 3];
const EACH: [[bool; 3]; 3] = [
    [true, false, false],
    [false, true, false],
    [false, false, true],
];

const fn term(trace: usize, channels: [bool; 3]) -> Term {
    Term { trace, channels }
}

impl LobeForm {
    /// What each parameter multiplies.
    pub(super) fn terms(self) -> &'static [Term] {
        match self {
            Self::Neutral | Self::NeutralOf(_) => &const { [term(0, ALL)] },
            Self::Rgb | Self::RgbOf(_) => {
                &const { [term(0, EACH[0]), term(0, EACH[1]), term(0, EACH[2])] }
            }
            Self::NeutralSchlick => &const { [term(0, ALL), term(1, ALL)] },
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

    /// Number of traces that the parameters multiply.
    pub(super) fn traces(self) -> usize {
        1 + usize::from(self.is_schlick())
    }

    /// One of those traces, as a mix of the columns that are modelled.
    fn mix(self, trace: usize) -> &'static [(Basis, f32)] {
        match self {
            Self::Neutral | Self::Rgb => &[(Basis::Dielectric, 1.0)],
            Self::NeutralOf(k) | Self::RgbOf(k) => &DIELECTRICS[k].mix,
            Self::NeutralSchlick | Self::Schlick if trace == 0 => &[(Basis::Normal, 1.0)],
            Self::NeutralSchlick | Self::Schlick => &[(Basis::Grazing, 1.0)],
        }
    }

    /// Whether the parameters are those of Schlick's Fresnel term.
    pub(super) fn is_schlick(self) -> bool {
        matches!(self, Self::NeutralSchlick | Self::Schlick)
    }

    /// Number of parameters that are specular albedos, before `F90`.
    pub(super) fn albedos(self) -> usize {
        self.size() - usize::from(self.is_schlick())
    }

    /// Number of parameters.
    pub(super) fn size(self) -> usize {
        self.terms().len()
    }

    /// One channel of a trace at roughness number `k`, `[observations]`, into `values`.
    pub(super) fn node(
        self,
        columns: &Columns,
        ndf: Ndf,
        (trace, k, channel): (usize, usize, usize),
        values: &mut [f64],
    ) {
        values.fill(0.0);
        for (basis, weight) in self.mix(trace) {
            let node = columns.node(ndf as usize, *basis, k, channel);
            for (value, node) in values.iter_mut().zip(node.unwrap_or_default()) {
                *value += f64::from(*weight * *node);
            }
        }
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
        let mixes = (0..self.traces()).map(|trace| (trace, self.mix(trace)));
        for (trace, (basis, weight)) in mixes.flat_map(|(t, mix)| mix.iter().map(move |m| (t, *m)))
        {
            let mut rows = jacobian.chunks_exact_mut(terms.len());
            let chosen = observations.clone();
            columns.specular_of(chosen, ndf as usize, basis, ln_alpha, |_, value, _| {
                let Some(row) = rows.next() else { return };
                for (entry, term) in row.iter_mut().zip(terms).filter(|(_, t)| t.trace == trace) {
                    for c in (0..3).filter(|&c| term.channels[c]) {
                        entry[c] += f64::from(weight * value[c]);
                    }
                }
            });
        }
        jacobian
    }

    /// Those that the settings allow.
    pub(super) fn allowed(settings: &FitSettings) -> Vec<Self> {
        let neutral = settings.specular != SpecularColour::Rgb;
        let coloured = settings.specular != SpecularColour::Neutral;
        let dielectrics = |neutral_form: Self, coloured_form: Self| {
            let forms = [(neutral, neutral_form), (coloured, coloured_form)];
            forms
                .into_iter()
                .filter_map(|(is, form)| is.then_some(form))
        };
        match settings.fresnel {
            FresnelModel::Dielectric { .. } => dielectrics(Self::Neutral, Self::Rgb).collect(),
            FresnelModel::Schlick => vec![Self::Schlick],
            FresnelModel::Auto => (0..DIELECTRICS.len())
                .step_by(TENTH)
                .flat_map(|k| dielectrics(Self::NeutralOf(k), Self::RgbOf(k)))
                .chain([Self::NeutralSchlick, Self::Schlick])
                .collect(),
        }
    }

    /// The same with another dielectric; none for another term.
    pub(super) fn of_dielectric(self, number: usize) -> Option<Self> {
        match self {
            Self::NeutralOf(_) => Some(Self::NeutralOf(number)),
            Self::RgbOf(_) => Some(Self::RgbOf(number)),
            _ => None,
        }
    }

    /// Index of refraction; none where the term is Schlick's.
    pub(super) fn eta(self, allowed: FresnelModel) -> Option<f32> {
        match self {
            Self::Neutral | Self::Rgb => allowed.eta(),
            Self::NeutralOf(k) | Self::RgbOf(k) => Some(DIELECTRICS[k].eta),
            Self::NeutralSchlick | Self::Schlick => None,
        }
    }

    /// The same with an albedo a channel.
    pub(super) fn coloured(self) -> Self {
        match self {
            Self::Neutral | Self::Rgb => Self::Rgb,
            Self::NeutralOf(k) | Self::RgbOf(k) => Self::RgbOf(k),
            Self::NeutralSchlick | Self::Schlick => Self::Schlick,
        }
    }

    /// Specular albedo, and `F90` under Schlick's term, of parameters.
    pub(super) fn values(self, lobe: &[f64; MOST_PARAMETERS]) -> (Vec3, Option<f32>) {
        let rho_s = if self.albedos() == 1 {
            Vec3::splat(lobe[0] as f32)
        } else {
            DVec3::from_slice(lobe).as_vec3()
        };
        let f90 = self.is_schlick().then(|| lobe[self.albedos()] as f32);
        (rho_s, f90)
    }

    /// The parameters of a lobe of given specular albedo and `F90`.
    pub(super) fn parameters(self, rho_s: Vec3, f90: Option<f32>) -> [f64; MOST_PARAMETERS] {
        let mut lobe = [0.0; MOST_PARAMETERS];
        for (value, albedo) in lobe[..self.albedos()].iter_mut().zip(rho_s.to_array()) {
            *value = f64::from(albedo);
        }
        if self.is_schlick() {
            lobe[self.albedos()] = f90.map_or(0.0, f64::from);
        }
        lobe
    }
}
