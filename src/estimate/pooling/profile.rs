//! What points and groups of points say of a lobe.

use std::ops::Range;

use super::super::least_squares::UNKNOWNS;
use super::super::lobe_form::MOST_PARAMETERS;
use super::super::lobe_table::LobeTable;
use super::super::normal_table::{DiffuseBeside, NormalTable};
use super::super::problem::Model;
use super::super::search::Landscape;
use super::super::uncertainty::{LARGEST_SIGMA_LN_ALPHA, Profile, at_bound};
use super::super::{Estimate, Reason, Status};

/// A point's residuals as a function of its lobe, under every model: `[models]`.
#[derive(Clone, Debug)]
pub(in super::super) struct PointProfile {
    models: Vec<ModelProfile>,
    /// Its least deviance over all lobes.
    own: f64,
}

/// Under one model.
#[derive(Clone, Debug)]
struct ModelProfile {
    /// What is added to the squared residual to make it `−2 ln L`: NDFs have weights of their own.
    offset: f64,
    yy: f64,
    /// The other numbers of a [`LobeTable`]: seven digits of them are as good as their sums need.
    numbers: Box<[f32]>,
    beside: DiffuseBeside,
}

impl ModelProfile {
    fn table(&self, size: usize) -> LobeTable {
        let mut table = LobeTable::zero(size);
        table.add_numbers(self.yy, &self.numbers, 1.0);
        table
    }
}

impl PointProfile {
    /// From each model's sums (over their scale), estimate and `ln L`.
    pub(in super::super) fn new<'a>(
        candidates: impl Iterator<Item = (&'a NormalTable, &'a Estimate, f64)>,
    ) -> Self {
        let mut own = f64::INFINITY;
        let models = candidates
            .map(|(table, estimate, ln_likelihood)| {
                let free = estimate.rho_d.cmpgt(glam::Vec3::ZERO);
                let (lobe, beside) = table.eliminate([free.x, free.y, free.z]);
                let (_, least) = lobe.at(f64::from(estimate.alpha.ln())).solve();
                let profile = ModelProfile {
                    offset: -2.0 * ln_likelihood - least,
                    yy: lobe.yy,
                    numbers: lobe.numbers().map(|v| v as f32).collect(),
                    beside,
                };
                own = own.min(-2.0 * ln_likelihood);
                profile
            })
            .collect();
        Self { models, own }
    }

    /// `−2 ln L` of a lobe over that of the point's best.
    pub(super) fn deviance(&self, lobe: &GroupLobe) -> f64 {
        let profile = &self.models[lobe.model];
        let mut x = [0.0; UNKNOWNS];
        x[..lobe.size].copy_from_slice(&lobe.lobe[..lobe.size]);
        let value = profile.table(lobe.size).at(lobe.ln_alpha).objective(&x);
        (profile.offset + value - self.own).max(0.0)
    }

    /// Gives an estimate a lobe, and the diffuse albedos that go with it.
    pub(super) fn adopt(&self, lobe: &GroupLobe, models: &[Model], estimate: &mut Estimate) {
        let beside = &self.models[lobe.model].beside;
        let (rho_d, response) = beside.at(lobe.ln_alpha, &lobe.lobe[..lobe.size]);
        let mut variance = beside.variance;
        for (response, sigma) in response.iter().zip(&lobe.sigma_lobe) {
            if sigma.is_finite() {
                variance += *response * *response * *sigma * *sigma;
            }
        }
        let model = models[lobe.model];
        model.put(&lobe.lobe, estimate);
        estimate.rho_d = rho_d.as_vec3();
        // A channel that no observation bears on has no variance.
        let known = beside.variance.cmpgt(glam::DVec3::ZERO);
        let sigma = variance.map(f64::sqrt).as_vec3();
        let known = glam::BVec3::new(known.x, known.y, known.z);
        estimate.sigma_rho_d = glam::Vec3::select(known, sigma, estimate.sigma_rho_d);
        estimate.alpha = lobe.ln_alpha.exp() as f32;
        estimate.sigma_alpha = estimate.alpha * lobe.sigma_ln_alpha as f32;
        estimate.sigma_rho_s = lobe.sigma_lobe[..model.form.albedos()]
            .iter()
            .copied()
            .fold(0.0, f64::max) as f32;
        (estimate.status, estimate.reason) = lobe.verdict();
        estimate.second_alpha = f32::NAN;
        estimate.second_evidence = f32::NAN;
        estimate.ndf_evidence = lobe.ndf_evidence;
    }
}

/// What points say together.
#[derive(Clone, Debug)]
pub(super) struct Group {
    /// `[models]` and what makes each `−2 ln L`.
    tables: Vec<(LobeTable, f64)>,
    /// Points in it, by weight.
    pub(super) members: f64,
}

/// A group's lobe.
#[derive(Clone, Copy, Debug)]
pub(super) struct GroupLobe {
    /// Index of the model.
    pub(super) model: usize,
    pub(super) size: usize,
    pub(super) ln_alpha: f64,
    pub(super) lobe: [f64; MOST_PARAMETERS],
    /// `−2 ln L` of all members.
    pub(super) deviance: f64,
    sigma_ln_alpha: f64,
    sigma_lobe: [f64; MOST_PARAMETERS],
    /// `ln L_ggx − ln L_beckmann`.
    pub(super) ndf_evidence: f32,
}

impl GroupLobe {
    fn verdict(&self) -> (Status, Reason) {
        let values = self.lobe[..self.size].iter();
        if !values.zip(&self.sigma_lobe).any(|(v, s)| v > s) {
            return (Status::Unidentifiable, Reason::LobeBelowNoise);
        }
        if self.sigma_ln_alpha.is_nan() || self.sigma_ln_alpha > LARGEST_SIGMA_LN_ALPHA {
            return (Status::Unidentifiable, Reason::WidthUndetermined);
        }
        if at_bound(self.ln_alpha) {
            return (Status::AlphaAtBound, Reason::None);
        }
        (Status::Converged, Reason::None)
    }
}

impl Group {
    /// A group of nobody.
    pub(super) fn empty(models: &[Model]) -> Self {
        let tables = models.iter().map(|m| (LobeTable::zero(m.form.size()), 0.0));
        Self {
            tables: tables.collect(),
            members: 0.0,
        }
    }

    /// Takes a point in, with a weight.
    pub(super) fn add(&mut self, point: &PointProfile, weight: f64) {
        for ((table, offset), profile) in self.tables.iter_mut().zip(&point.models) {
            table.add_numbers(profile.yy, &profile.numbers, weight);
            *offset += weight * profile.offset;
        }
        self.members += weight;
    }

    /// Takes another group in.
    pub(super) fn merge(&mut self, other: &Self) {
        for ((table, offset), (more, constant)) in self.tables.iter_mut().zip(&other.tables) {
            table.add(more);
            *offset += constant;
        }
        self.members += other.members;
    }

    /// The lobe of least deviance over models, alpha and albedos; none of nobody.
    pub(super) fn best(&self, models: &[Model]) -> Option<GroupLobe> {
        self.best_among(models, 0..models.len())
    }

    /// The same over some of the models.
    pub(super) fn best_among(&self, models: &[Model], among: Range<usize>) -> Option<GroupLobe> {
        if self.members == 0.0 {
            return None;
        }
        let mut least = vec![f64::INFINITY; models.len()];
        let mut best: Option<GroupLobe> = None;
        let mut grids = Vec::with_capacity(models.len());
        for (index, (table, offset)) in self.tables.iter().enumerate() {
            if !among.contains(&index) {
                grids.push(Vec::new());
                continue;
            }
            let value = |x: f64| table.at(x).solve().1;
            let landscape = Landscape::survey(value);
            let (ln_alpha, lowest) = landscape.minima[0];
            least[index] = offset + lowest;
            grids.push(landscape.grid);
            if best.as_ref().is_none_or(|b| least[index] < b.deviance) {
                let (x, _) = table.at(ln_alpha).solve();
                best = Some(GroupLobe {
                    model: index,
                    size: table.size,
                    ln_alpha,
                    lobe: std::array::from_fn(|j| x[j]),
                    deviance: least[index],
                    sigma_ln_alpha: f64::INFINITY,
                    sigma_lobe: [f64::INFINITY; MOST_PARAMETERS],
                    ndf_evidence: f32::NAN,
                });
            }
        }
        let mut best = best?;
        let form = models[best.model].form;
        let of = |ndf| {
            let index = models.iter().position(|m| m.ndf == ndf && m.form == form);
            index.map(|i| least[i])
        };
        if let (Some(ggx), Some(beckmann)) =
            (of(crate::brdf::Ndf::Ggx), of(crate::brdf::Ndf::Beckmann))
        {
            // Infinite where only one was asked for.
            best.ndf_evidence = (0.5 * (beckmann - ggx)) as f32;
        }
        self.put_deviations(&mut best, &grids);
        Some(best)
    }

    fn put_deviations(&self, best: &mut GroupLobe, grids: &[Vec<(f64, f64)>]) {
        let (table, offset) = &self.tables[best.model];
        let lowest = best.deviance - offset;
        let grid: Vec<(f64, f64)> = (grids[best.model].iter())
            .map(|(x, v)| (*x, v - lowest))
            .collect();
        let mut albedos = [0.0; UNKNOWNS];
        albedos[..best.size].copy_from_slice(&best.lobe[..best.size]);
        let profile = Profile {
            ln_alpha: best.ln_alpha,
            albedos: &albedos,
            grid: &grid,
            information: table.information(best.ln_alpha, &best.lobe[..best.size]),
            spread: 1.0,
        };
        let deviations = profile.deviations(0, |x| {
            let (albedos, value) = table.at(x).solve();
            (value - lowest, albedos)
        });
        best.sigma_ln_alpha = deviations.ln_alpha;
        best.sigma_lobe[..best.size].copy_from_slice(&deviations.albedos[..best.size]);
    }
}
