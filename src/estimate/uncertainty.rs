//! How well a minimum is determined, and what stands in the way where it is not.
//!
//! The Fisher information `JᵀWJ` describes the minimum's own parabola. Over the wide errors of single
//! points in `ln alpha` the objective is no parabola, and there may be a second minimum. So the variance
//! of `ln alpha` is the second moment about the estimate of its profile likelihood,
//!
//! ```text
//! σ² = ∫ (x − x̂)² L(x) dx / ∫ L(x) dx,    L(x) = exp(−½ (S(x) − S(x̂)) / s)
//! ```
//!
//! with S the least weighted squared residual at `x = ln alpha` and s its scale. The albedos move with x
//! along the profile, the specular one by large factors where lobes are broad, and their variances are
//! those at a given x and what this movement adds.

use glam::{DMat3, Vec3};

use super::columns::{ROUGHNESSES, roughness};
use super::fresnel_model::{DIELECTRICS, PAPER_ETA};
use super::full::Minimum;
use super::least_squares::{UNKNOWNS, inverse_diagonal};
use super::lobe_form::LobeForm;
use super::normal_table::NormalTable;
use super::{Reason, Status};
use crate::brdf::dielectric;

/// A standard deviation of `ln alpha` above this says that the data do not determine alpha: the
/// 68 % interval then spans more than a factor of 2.7.
pub(super) const LARGEST_SIGMA_LN_ALPHA: f64 = 0.5;

/// A lobe that these data cannot tell from none, of unit specular albedo, is not seen: its information
/// leaves a standard deviation above this.
const LARGEST_UNIT_SIGMA: f64 = 0.5;

/// What a lobe of free height and width takes from `−2 ln L` by chance once in a hundred times: χ² of two
/// degrees of freedom.
const CHANCE_GAIN: f64 = 9.21;

/// Fewer frames than this show no highlight pass: two albedos and a lobe's height, place and width.
const FEWEST_FRAMES: u32 = 5;

/// Standard deviations of a minimum's parameters.
pub(super) struct Deviations {
    pub(super) rho_d: Vec3,
    /// Of each of the lobe's linear parameters; infinite where the data do not determine it.
    pub(super) lobe: Vec<f64>,
    pub(super) ln_alpha: f64,
    /// By the minimum's own parabola.
    pub(super) local_ln_alpha: f64,
}

impl Deviations {
    pub(super) fn of(minimum: &Minimum<'_, '_>, table: &NormalTable, spread: f64) -> Self {
        let m = minimum.objective.model.form.size();
        let lobe = &minimum.solution.lobe[..m];
        let lowest = minimum.solution.value;
        let profile = Profile {
            ln_alpha: minimum.ln_alpha,
            albedos: &minimum.solution.albedos(),
            grid: &(minimum.grid.iter())
                .map(|(x, v)| (*x, (v - lowest) / spread))
                .collect::<Vec<_>>(),
            information: table.information(minimum.ln_alpha, lobe),
            spread,
        };
        let deviations = profile.deviations(3, |x| {
            let solution = minimum.objective.solve(x);
            ((solution.value - lowest) / spread, solution.albedos())
        });
        let sigma = |c: usize| deviations.albedos[c] as f32;
        Self {
            rho_d: Vec3::new(sigma(0), sigma(1), sigma(2)),
            lobe: deviations.albedos[3..3 + m].to_vec(),
            ln_alpha: deviations.ln_alpha,
            local_ln_alpha: deviations.local_ln_alpha,
        }
    }
}

/// What is known of a profile likelihood about its minimum.
pub(super) struct Profile<'a> {
    /// Place of the minimum.
    pub(super) ln_alpha: f64,
    /// The albedos there; those of the diffuse part, if it is asked about, come first.
    pub(super) albedos: &'a [f64; UNKNOWNS],
    /// (ln alpha, `−2 ln L` above the minimum) over the grid.
    pub(super) grid: &'a [(f64, f64)],
    /// Fisher information of (albedos, ln alpha).
    pub(super) information: Vec<Vec<f64>>,
    /// What the information's inverse is to be multiplied by.
    pub(super) spread: f64,
}

/// Standard deviations over a profile.
pub(super) struct ProfileDeviations {
    pub(super) albedos: [f64; UNKNOWNS],
    pub(super) ln_alpha: f64,
    pub(super) local_ln_alpha: f64,
}

impl Profile<'_> {
    /// Deviations by `at`, which gives `−2 ln L` above the minimum and the albedos at a roughness. An
    /// albedo's variance is what it has at a given roughness, and how it moves with roughness over the
    /// profile. The first `diffuse` albedos keep their own scale as the roughness moves; a lobe's
    /// uncertainty is in proportion to its height.
    pub(super) fn deviations(
        self,
        diffuse: usize,
        at: impl Fn(f64) -> (f64, [f64; UNKNOWNS]),
    ) -> ProfileDeviations {
        let size = self.information.len() - 1;
        let given: Vec<Vec<f64>> = (self.information[..size].iter())
            .map(|row| row[..size].to_vec())
            .collect();
        let variances = inverse_diagonal(self.information.clone());
        let local = (variances[size] * self.spread).sqrt();
        let mut deviations = ProfileDeviations {
            albedos: [f64::INFINITY; UNKNOWNS],
            ln_alpha: local,
            local_ln_alpha: local,
        };
        for (sigma, variance) in deviations.albedos.iter_mut().zip(&variances[..size]) {
            *sigma = (variance * self.spread).sqrt();
        }
        if !local.is_finite() {
            return deviations;
        }
        let moments = self.moments(local, at);
        deviations.ln_alpha = moments.ln_alpha.sqrt();
        for (i, given) in inverse_diagonal(given).into_iter().enumerate() {
            let grows = if i < diffuse { 1.0 } else { moments.growth[i] };
            let variance = given * self.spread * grows + moments.albedos[i];
            if variance.is_finite() {
                deviations.albedos[i] = variance.sqrt();
            }
        }
        deviations
    }

    /// Second moments about the minimum: over the grid, and finely about the minimum, whose own parabola
    /// has deviation `local`.
    fn moments(&self, local: f64, at: impl Fn(f64) -> (f64, [f64; UNKNOWNS])) -> Moments {
        let (low, high) = range();
        // Half a deviation apart, out to five; beyond, the grid's places, and the ends of the range.
        const FINE: i32 = 10;
        let reach = 0.5 * f64::from(FINE) * local;
        let beyond = |x: f64| (x - self.ln_alpha).abs() > reach;
        let coarse = self.grid.iter().filter(|(x, _)| beyond(*x));
        let mut places: Vec<f64> = coarse.map(|place| place.0).collect();
        places.extend((-FINE..=FINE).map(|j| self.ln_alpha + 0.5 * f64::from(j) * local));
        places.extend([low, high].into_iter().filter(|end| !beyond(*end)));
        places.retain(|x| (low..=high).contains(x));
        places.sort_by(f64::total_cmp);
        places.dedup();

        let values: Vec<(f64, f64, [f64; UNKNOWNS])> = places
            .into_iter()
            .map(|x| {
                let (value, albedos) = at(x);
                (x, (-0.5 * value.max(0.0)).exp(), albedos)
            })
            .collect();
        let mut mass = 0.0;
        let mut moments = Moments::default();
        for pair in values.windows(2) {
            let width = 0.5 * (pair[1].0 - pair[0].0);
            for (x, likelihood, albedos) in pair {
                let weight = width * likelihood;
                mass += weight;
                moments.ln_alpha += weight * (x - self.ln_alpha).powi(2);
                for (i, (value, centre)) in albedos.iter().zip(self.albedos).enumerate() {
                    moments.albedos[i] += weight * (value - centre).powi(2);
                    if *centre > 0.0 {
                        moments.growth[i] += weight * (value / centre).powi(2);
                    }
                }
            }
        }
        if mass > 0.0 {
            moments.ln_alpha /= mass;
            moments.albedos.iter_mut().for_each(|m| *m /= mass);
            moments.growth.iter_mut().for_each(|m| *m /= mass);
        }
        for (growth, centre) in moments.growth.iter_mut().zip(self.albedos) {
            if *centre <= 0.0 {
                *growth = 1.0;
            }
        }
        moments
    }
}

/// Second moments of a profile likelihood about its minimum.
#[derive(Default)]
struct Moments {
    ln_alpha: f64,
    albedos: [f64; UNKNOWNS],
    /// Mean square of each albedo over that at the minimum.
    growth: [f64; UNKNOWNS],
}

/// Ends of `ln alpha`.
fn range() -> (f64, f64) {
    let ln = |k: usize| f64::from(roughness(k).ln());
    (ln(0), ln(ROUGHNESSES - 1))
}

/// Whether a roughness is at an end of its range.
pub(super) fn at_bound(ln_alpha: f64) -> bool {
    let (low, high) = range();
    ln_alpha - low < 1e-3 || high - ln_alpha < 1e-3
}

/// Verdict on a minimum, and what stands in the way of a better one.
pub(super) fn verdict(
    minimum: &Minimum<'_, '_>,
    table: &NormalTable,
    deviations: &Deviations,
    spread: f64,
) -> (Status, Reason) {
    let m = minimum.objective.model.form.size();
    let lobe = &minimum.solution.lobe[..m];
    // A lobe that may as well not be there has no roughness, however well noise fits into one.
    let is_seen = lobe
        .iter()
        .zip(&deviations.lobe)
        .any(|(value, sigma)| value > sigma);
    let is_known = deviations.ln_alpha <= LARGEST_SIGMA_LN_ALPHA;
    if is_seen && is_known {
        let status = if at_bound(minimum.ln_alpha) {
            Status::AlphaAtBound
        } else {
            Status::Converged
        };
        return (status, Reason::None);
    }
    let unit = match minimum.objective.model.form {
        LobeForm::Neutral | LobeForm::Rgb => 1.0,
        // As much reflectance as a unit has of the paper's index.
        LobeForm::NeutralOf(k) | LobeForm::RgbOf(k) => {
            f64::from(dielectric(1.0, PAPER_ETA) / dielectric(1.0, DIELECTRICS[k].eta))
        }
        LobeForm::NeutralSchlick | LobeForm::Schlick => f64::from(dielectric(1.0, PAPER_ETA)),
    };
    let sight = Sight::of(table, minimum.ln_alpha, spread / (unit * unit));
    let reason = if minimum.objective.problem.trace.frames() < FEWEST_FRAMES {
        Reason::TooFewFrames
    } else if sight.beside_diffuse > LARGEST_UNIT_SIGMA {
        if sight.alone > LARGEST_UNIT_SIGMA {
            Reason::NoHighlight
        } else {
            Reason::Collinear
        }
    } else if gain(minimum, table, spread) < CHANCE_GAIN {
        Reason::LobeBelowNoise
    } else if deviations.local_ln_alpha <= LARGEST_SIGMA_LN_ALPHA {
        Reason::TwoMinima
    } else {
        Reason::WidthUndetermined
    };
    (Status::Unidentifiable, reason)
}

/// What the lobe takes from `−2 ln L`.
fn gain(minimum: &Minimum<'_, '_>, table: &NormalTable, spread: f64) -> f64 {
    (table.diffuse.solve().1 - minimum.solution.value) / spread
}

/// Standard deviation of a neutral specular albedo at one roughness.
struct Sight {
    /// Were the diffuse albedos known.
    alone: f64,
    /// As they are fitted with it.
    beside_diffuse: f64,
}

impl Sight {
    fn of(table: &NormalTable, ln_alpha: f64, spread: f64) -> Self {
        let normal = table.at(ln_alpha);
        let m = normal.size - 3;
        // One albedo for all parameters: products summed.
        let sum =
            |rows: std::ops::Range<usize>, c: usize| -> f64 { rows.map(|i| normal.a[i][c]).sum() };
        let alone: f64 = (3..3 + m).map(|c| sum(3..3 + m, c)).sum();
        let cross = glam::DVec3::from([0, 1, 2].map(|c| sum(3..3 + m, c)));
        let mut diffuse = DMat3::IDENTITY;
        for c in (0..3).filter(|&c| normal.a[c][c] > 0.0) {
            for d in (0..3).filter(|&d| normal.a[d][d] > 0.0) {
                diffuse.col_mut(d)[c] = normal.a[c][d];
            }
        }
        let beside = (alone - cross.dot(diffuse.inverse() * cross)).max(0.0);
        Self {
            alone: (spread / alone).sqrt(),
            beside_diffuse: (spread / beside).sqrt(),
        }
    }
}
