//! A point's data and model, and the weights of its observations.

use glam::{BVec3, DMat3, DVec3};

use super::Estimate;
use super::columns::Columns;
use super::fresnel_model::DIELECTRICS;
use super::least_squares::UNKNOWNS;
use super::lobe_form::{LobeForm, MOST_PARAMETERS};
use super::noise::NoiseModel;
use crate::brdf::Ndf;
use crate::traces::Trace;

/// What is known of a point's scale of residuals before it is fitted, as a number of channels'
/// residuals of scale 1: it steadies points with few observations.
const PRIOR_RESIDUALS: f64 = 6.0;

/// An NDF and the linear parameters of its lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Model {
    pub(super) ndf: Ndf,
    pub(super) form: LobeForm,
    /// Index of refraction; none where the Fresnel term is Schlick's.
    pub(super) eta: Option<f32>,
}

impl Model {
    /// Albedos and alpha.
    pub(super) fn unknowns(self) -> usize {
        3 + self.form.size() + 1
    }

    /// The models, and those that have one of further dielectrics in the place of another.
    pub(super) fn with_dielectrics(models: &[Self], further: &[usize]) -> Vec<Self> {
        let mut all = models.to_vec();
        for number in further {
            for model in models {
                let form = model.form.of_dielectric(*number);
                let other = form.map(|form| Self {
                    form,
                    eta: Some(DIELECTRICS[*number].eta),
                    ..*model
                });
                all.extend(other.filter(|other| !all.contains(other)));
            }
        }
        all
    }

    /// Writes the lobe's linear parameters into an estimate.
    pub(super) fn put(self, lobe: &[f64; MOST_PARAMETERS], estimate: &mut Estimate) {
        (estimate.rho_s, estimate.f90) = self.form.values(lobe);
        estimate.eta = self.eta;
        estimate.ndf = self.ndf;
    }
}

/// A point's data and columns.
pub(super) struct Problem<'a> {
    pub(super) trace: &'a Trace,
    pub(super) columns: &'a Columns,
    pub(super) noise: &'a NoiseModel,
    /// `[observations]` inverse covariance and number of usable channels, none of them saturated.
    pub(super) precisions: Vec<(DMat3, u32)>,
    /// Observations with a saturated channel.
    pub(super) saturated: Vec<usize>,
    /// `[saturated]` inverse covariance and number of channels by the set of bounds that are active (bit
    /// c: channel c).
    bounded: Vec<[(DMat3, u32); 8]>,
}

/// Which bounds are active, one an observation with saturated channels.
pub(super) type ActiveBounds = Vec<BVec3>;

/// The best albedos at one roughness.
#[derive(Clone, Debug, Default)]
pub(super) struct Solution {
    pub(super) rho_d: DVec3,
    pub(super) lobe: [f64; MOST_PARAMETERS],
    /// Weighted squared residual.
    pub(super) value: f64,
    /// Bounds that the model would be darker than.
    pub(super) active: ActiveBounds,
}

impl Solution {
    pub(super) fn new(x: &[f64; UNKNOWNS], value: f64, active: ActiveBounds) -> Self {
        Self {
            rho_d: DVec3::new(x[0], x[1], x[2]),
            lobe: [x[3], x[4], x[5], x[6]],
            value,
            active,
        }
    }

    /// All albedos in a row.
    pub(super) fn albedos(&self) -> [f64; UNKNOWNS] {
        let (d, s) = (self.rho_d, self.lobe);
        [d.x, d.y, d.z, s[0], s[1], s[2], s[3]]
    }
}

impl<'a> Problem<'a> {
    pub(super) fn new(trace: &'a Trace, columns: &'a Columns, noise: &'a NoiseModel) -> Self {
        let observations = trace.observations.iter();
        let by_bounds = |observation| {
            std::array::from_fn(|set| {
                let active = BVec3::new(set & 1 != 0, set & 2 != 0, set & 4 != 0);
                noise.precision(observation, active)
            })
        };
        let saturated = observations.clone().filter(|o| o.saturated.any());
        Self {
            trace,
            columns,
            noise,
            bounded: saturated.map(by_bounds).collect(),
            precisions: observations
                .map(|o| noise.precision(o, BVec3::FALSE))
                .collect(),
            saturated: (0..trace.observations.len())
                .filter(|&i| trace.observations[i].saturated.any())
                .collect(),
        }
    }

    /// Inverse covariance and number of channels of a saturated observation, by its place among them,
    /// under active bounds.
    pub(super) fn bounded(&self, place: usize, active: BVec3) -> (DMat3, u32) {
        self.bounded[place][active.bitmask() as usize]
    }

    pub(super) fn observed(&self, i: usize) -> DVec3 {
        self.trace.observations[i].radiance.as_dvec3()
    }

    pub(super) fn diffuse(&self, i: usize) -> DVec3 {
        self.columns.diffuse[i].as_dvec3()
    }

    /// Usable channels of all observations, saturated ones not counted.
    pub(super) fn samples(&self) -> usize {
        self.precisions.iter().map(|(_, k)| *k as usize).sum()
    }

    /// `[observations]` inverse covariance and number of channels, active bounds included.
    pub(super) fn precisions(&self, active: &ActiveBounds) -> Vec<(DMat3, u32)> {
        let mut precisions = self.precisions.clone();
        for (place, (&i, active)) in self.saturated.iter().zip(active).enumerate() {
            precisions[i] = self.bounded(place, *active);
        }
        precisions
    }

    /// `[observations]` squared distances `rᵀ P r` of the residuals, and their channels.
    pub(super) fn squares(
        &self,
        model: Model,
        ln_alpha: f64,
        solution: &Solution,
    ) -> Vec<(f64, u32)> {
        let m = model.form.size();
        let jacobian = model
            .form
            .jacobian(self.columns, model.ndf, ln_alpha as f32);
        self.precisions(&solution.active)
            .into_iter()
            .enumerate()
            .map(|(i, (p, k))| {
                let r = self.observed(i) - self.predicted(i, &jacobian[i * m..][..m], solution);
                (r.dot(p * r), k)
            })
            .collect()
    }

    /// What an estimate shows in observation `i`.
    pub(super) fn predicted(&self, i: usize, jacobian: &[DVec3], solution: &Solution) -> DVec3 {
        let lobe = jacobian.iter().zip(&solution.lobe);
        solution.rho_d * self.diffuse(i) + lobe.map(|(j, v)| *j * *v).sum::<DVec3>()
    }

    /// Student's weights of squared distances, and their scale, found in turns from the last weights.
    pub(super) fn reweigh(
        &self,
        squares: &[(f64, u32)],
        weights: &[f64],
        unknowns: usize,
    ) -> (Vec<f64>, f64) {
        let samples = self.samples() as f64;
        let mut weights = weights.to_vec();
        let mut scale = 1.0;
        for _ in 0..3 {
            let sum: f64 = squares.iter().zip(&weights).map(|((q, _), w)| q * w).sum();
            let freedom = samples - (unknowns as f64).min(samples - 1.0) + PRIOR_RESIDUALS;
            scale = (sum + PRIOR_RESIDUALS) / freedom;
            if self.noise.is_known {
                scale = scale.max(1.0);
            }
            for (w, (q, k)) in weights.iter_mut().zip(squares) {
                *w = self.noise.weight(q / scale, *k);
            }
        }
        (weights, scale)
    }
}
