//! A point's diffuse and specular traces for unit albedos, at every roughness of a grid and between.

use glam::Vec3;

use super::fresnel_model::Basis;
use super::lobe_table::Stencil;

/// Number of roughness values at which specular traces are computed.
pub(super) const ROUGHNESSES: usize = 28;
/// Ends of the range of roughness: below 0.01 a lobe is narrower than a probe's texels.
pub(super) const RANGE: (f32, f32) = (0.01, 1.0);

/// Roughness number `k` of the grid, even in the logarithm. Steps of 19 % leave an error of cubic
/// interpolation of 1.3e-3 of a trace's peak (test
/// `traces_between_roughnesses_are_those_of_the_integral`).
pub(super) fn roughness(k: usize) -> f32 {
    RANGE.0 * (RANGE.1 / RANGE.0).powf(k as f32 / (ROUGHNESSES - 1) as f32)
}

/// Step of the grid in `ln alpha`.
pub(super) fn ln_step() -> f64 {
    (f64::from(RANGE.1) / f64::from(RANGE.0)).ln() / (ROUGHNESSES - 1) as f64
}

/// The traces of a point for unit albedos, `[observations]`.
#[derive(Default)]
pub(super) struct Columns {
    /// `T_d`, linear RGB.
    pub(super) diffuse: Vec<Vec3>,
    /// `T_s`, `[ndf][basis]`, each `[(k · 3 + channel) · observations + observation]` with roughness number
    /// k, as widened by the pixel's curved patch.
    specular: [[Vec<f32>; 4]; 2],
    /// Terms of the specular model, by column.
    bases: &'static [Basis],
    /// Number of observations.
    observations: usize,
}

impl Columns {
    /// Ready for another point of so many observations.
    pub(super) fn clear(&mut self, bases: &'static [Basis], observations: usize) {
        self.diffuse.clear();
        for by_basis in &mut self.specular {
            for column in &mut by_basis[..bases.len()] {
                column.clear();
                column.resize(3 * ROUGHNESSES * observations, 0.0);
            }
        }
        self.bases = bases;
        self.observations = observations;
    }

    /// Writes a lobe's traces in one observation.
    pub(super) fn put(
        &mut self,
        ndf: usize,
        basis: usize,
        observation: usize,
        lobe: &[Vec3; ROUGHNESSES],
    ) {
        let rows = self.specular[ndf][basis].chunks_exact_mut(self.observations);
        let values = lobe.iter().flat_map(Vec3::as_ref);
        rows.zip(values)
            .for_each(|(row, value)| row[observation] = *value);
    }

    /// A term of the specular trace at roughness number `k`, one channel of all observations; none if it
    /// was not modelled.
    pub(super) fn node(
        &self,
        ndf: usize,
        basis: Basis,
        k: usize,
        channel: usize,
    ) -> Option<&[f32]> {
        let column = self.bases.iter().position(|b| *b == basis)?;
        let n = self.observations;
        Some(&self.specular[ndf][column][(k * 3 + channel) * n..][..n])
    }

    /// A term of the specular trace at roughness `exp(ln_alpha)`, and its derivative by `ln_alpha`, one
    /// pair an observation, by cubics through the grid's. A term that was not modelled is zero.
    pub(super) fn specular(
        &self,
        ndf: usize,
        basis: Basis,
        ln_alpha: f32,
        visit: impl FnMut(usize, Vec3, Vec3),
    ) {
        self.specular_of(0..self.diffuse.len(), ndf, basis, ln_alpha, visit);
    }

    /// The same, of some observations.
    pub(super) fn specular_of(
        &self,
        observations: impl Iterator<Item = usize>,
        ndf: usize,
        basis: Basis,
        ln_alpha: f32,
        mut visit: impl FnMut(usize, Vec3, Vec3),
    ) {
        let Some(column) = self.bases.iter().position(|b| *b == basis) else {
            observations.for_each(|i| visit(i, Vec3::ZERO, Vec3::ZERO));
            return;
        };
        let Stencil {
            first,
            value,
            slope,
        } = Stencil::at(f64::from(ln_alpha));
        let [value, slope] = [value, slope].map(|weights| weights.map(|weight| weight as f32));
        let n = self.observations;
        let nodes = &self.specular[ndf][column][3 * first * n..];
        for i in observations {
            let blend = |weights: &[f32; 4]| {
                let channel = |c: usize| -> f32 {
                    let taps = weights.iter().enumerate();
                    taps.map(|(tap, w)| w * nodes[(3 * tap + c) * n + i]).sum()
                };
                Vec3::new(channel(0), channel(1), channel(2))
            };
            visit(i, blend(&value), blend(&slope));
        }
    }

    /// Ends of `ln alpha`.
    pub(super) fn ln_range() -> (f32, f32) {
        (RANGE.0.ln(), RANGE.1.ln())
    }
}
