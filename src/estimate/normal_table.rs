//! All of a point's normal equations, diffuse albedos and lobe, at every roughness from sums made once.

use glam::{DMat3, DVec3, Vec3};

use super::columns::{Columns, ROUGHNESSES};
use super::least_squares::{Normal, UNKNOWNS};
use super::lobe_form::{LobeForm, MOST_PARAMETERS};
use super::lobe_table::{LobeTable, Stencil, TAPS};
use crate::brdf::Ndf;

/// The whole of a point's normal equations under one NDF and form of the lobe.
#[derive(Clone, Debug)]
pub(super) struct NormalTable {
    pub(super) lobe: LobeTable,
    /// The diffuse albedos' part.
    pub(super) diffuse: Normal,
    /// `[node][parameter][channel]` products of the lobe's traces with the diffuse ones.
    cross: Vec<f64>,
}

/// A point's observations, channel by channel, for sums.
pub(super) struct Samples {
    /// `[channel][observation]` observed.
    observed: [Vec<f64>; 3],
    /// `[channel][observation]` diffuse trace.
    diffuse: [Vec<f64>; 3],
    /// `[pair][observation]` precision, of the pairs of channels that are not independent.
    precision: Vec<((usize, usize), Vec<f64>)>,
}

impl Samples {
    /// Observations, diffuse traces and precisions of a point.
    pub(super) fn new(
        observed: impl Iterator<Item = DVec3> + Clone,
        diffuse: impl Iterator<Item = DVec3> + Clone,
        precision: impl Iterator<Item = DMat3> + Clone,
    ) -> Self {
        let channel = |values: &mut dyn Iterator<Item = DVec3>, c: usize| {
            values.map(|v| v[c]).collect::<Vec<f64>>()
        };
        let pairs = (0..3).flat_map(|c| (0..3).map(move |d| (c, d)));
        let entries = pairs.map(|(c, d)| {
            let entries: Vec<f64> = precision.clone().map(|p| p.col(d)[c]).collect();
            ((c, d), entries)
        });
        Self {
            observed: [0, 1, 2].map(|c| channel(&mut observed.clone(), c)),
            diffuse: [0, 1, 2].map(|c| channel(&mut diffuse.clone(), c)),
            precision: entries
                .filter(|((c, d), p)| c == d || p.iter().any(|v| *v != 0.0))
                .collect(),
        }
    }
}

/// `Σ a b`, in four lanes: the order of addition is fixed.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 4];
    let (fours, rest) = a.as_chunks::<4>();
    let (other_fours, other_rest) = b.as_chunks::<4>();
    for (x, y) in fours.iter().zip(other_fours) {
        for lane in 0..4 {
            lanes[lane] += x[lane] * y[lane];
        }
    }
    let tail: f64 = rest.iter().zip(other_rest).map(|(x, y)| x * y).sum();
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]) + tail
}

impl NormalTable {
    /// Sums over a point's observations.
    pub(super) fn new(columns: &Columns, ndf: Ndf, form: LobeForm, samples: &Samples) -> Self {
        let terms = form.terms();
        let m = terms.len();
        let mut diffuse = Normal {
            size: 3,
            ..Normal::default()
        };
        for ((c, d), p) in &samples.precision {
            let weigh =
                |values: &[f64]| -> Vec<f64> { p.iter().zip(values).map(|(p, v)| p * v).collect() };
            let (y, column) = (weigh(&samples.observed[*d]), weigh(&samples.diffuse[*d]));
            diffuse.yy += dot(&samples.observed[*c], &y);
            diffuse.b[*c] += dot(&samples.diffuse[*c], &y);
            diffuse.a[*c][*d] += dot(&samples.diffuse[*c], &column);
        }
        let mut table = Self {
            lobe: LobeTable::zero(m),
            diffuse,
            cross: vec![0.0; ROUGHNESSES * m * 3],
        };
        table.lobe.yy = diffuse.yy;

        // The traces of this node and of the three before it, `[trace][channel][observation]`, and this
        // one's times precision, `[trace][pair][observation]`.
        let n = samples.observed[0].len();
        let pairs = &samples.precision;
        let traces = form.traces();
        let mut ring: [Vec<f64>; TAPS] = std::array::from_fn(|_| vec![0.0; traces * 3 * n]);
        let mut weighted = vec![0.0; traces * pairs.len() * n];
        let row = |trace: usize, pair: usize| (trace * pairs.len() + pair) * n;
        for node in 0..ROUGHNESSES {
            let here = &mut ring[node % TAPS];
            for trace in 0..traces {
                for channel in 0..3 {
                    let values = &mut here[(trace * 3 + channel) * n..][..n];
                    form.node(columns, ndf, (trace, node, channel), values);
                }
                for (pair, ((_, d), p)) in pairs.iter().enumerate() {
                    let plain = &here[(trace * 3 + d) * n..][..n];
                    let weighted = &mut weighted[row(trace, pair)..][..n];
                    for ((w, p), s) in weighted.iter_mut().zip(p).zip(plain) {
                        *w = p * s;
                    }
                }
            }

            // Products with what is observed, with diffuse traces, and with this and earlier nodes.
            for (l, term) in terms.iter().enumerate() {
                for (pair, ((c, d), _)) in pairs.iter().enumerate() {
                    if !term.channels[*d] {
                        continue;
                    }
                    let weighted = &weighted[row(term.trace, pair)..][..n];
                    table.lobe.b[node * m + l] += dot(&samples.observed[*c], weighted);
                    table.cross[(node * m + l) * 3 + c] += dot(&samples.diffuse[*c], weighted);
                }
            }
            for lag in 0..TAPS.min(node + 1) {
                let there = &ring[(node - lag) % TAPS];
                for p in 0..traces {
                    for q in 0..traces {
                        for (pair, ((c, d), _)) in pairs.iter().enumerate() {
                            let plain = &there[(p * 3 + c) * n..][..n];
                            let product = dot(plain, &weighted[row(q, pair)..][..n]);
                            for (j, first) in terms.iter().enumerate() {
                                for (l, second) in terms.iter().enumerate() {
                                    if (first.trace, second.trace) == (p, q)
                                        && first.channels[*c]
                                        && second.channels[*d]
                                    {
                                        let index = table.lobe.band_index(node, lag, j, l);
                                        table.lobe.band[index] += product;
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
        table
    }

    /// All sums times a factor.
    pub(super) fn scaled(mut self, factor: f64) -> Self {
        self.diffuse.yy *= factor;
        self.lobe.yy *= factor;
        self.diffuse.b.iter_mut().for_each(|v| *v *= factor);
        self.diffuse
            .a
            .as_flattened_mut()
            .iter_mut()
            .for_each(|v| *v *= factor);
        let rest = [&mut self.lobe.b, &mut self.lobe.band, &mut self.cross];
        rest.into_iter().flatten().for_each(|v| *v *= factor);
        self
    }

    /// Normal equations of (rho_d, lobe) at `ln_alpha`.
    pub(super) fn at(&self, ln_alpha: f64) -> Normal {
        let m = self.lobe.size;
        let stencil = Stencil::at(ln_alpha);
        let mut normal = self.diffuse;
        normal.size = 3 + m;
        self.lobe.fill(&stencil, 3, &mut normal);
        for j in 0..m {
            for c in 0..3 {
                let entry = self.blend_cross(&stencil.value, stencil.first, j, c);
                normal.a[3 + j][c] = entry;
                normal.a[c][3 + j] = entry;
            }
        }
        normal
    }

    fn blend_cross(&self, weights: &[f64; TAPS], first: usize, j: usize, c: usize) -> f64 {
        let m = self.lobe.size;
        (first..)
            .zip(weights)
            .map(|(node, w)| w * self.cross[(node * m + j) * 3 + c])
            .sum()
    }

    /// Fisher information of (rho_d, lobe, ln alpha) at `ln_alpha` and `lobe`, at unit scale.
    pub(super) fn information(&self, ln_alpha: f64, lobe: &[f64]) -> Vec<Vec<f64>> {
        let m = self.lobe.size;
        let stencil = Stencil::at(ln_alpha);
        let inner = self.lobe.information(ln_alpha, lobe);
        let mut information = vec![vec![0.0; 4 + m]; 4 + m];
        for (row, diffuse) in information.iter_mut().zip(&self.diffuse.a[..3]) {
            row[..3].copy_from_slice(&diffuse[..3]);
        }
        let (last, first) = (3 + m, stencil.first);
        for (j, height) in lobe.iter().enumerate() {
            let entries = [0, 1, 2].map(|c| {
                let value = self.blend_cross(&stencil.value, first, j, c);
                let slope = self.blend_cross(&stencil.slope, first, j, c);
                (value, height * slope)
            });
            for (c, (value, slope)) in entries.into_iter().enumerate() {
                information[3 + j][c] = value;
                information[c][3 + j] = value;
                information[last][c] += slope;
                information[c][last] += slope;
            }
        }
        for (j, row) in inner.iter().enumerate() {
            information[3 + j][3..].copy_from_slice(row);
        }
        information
    }

    /// The lobe's part when the diffuse albedos in `free` follow it and the others stay zero, and what
    /// the diffuse albedos then are: `rho_d = own − response · lobe`.
    pub(super) fn eliminate(&self, free: [bool; 3]) -> (LobeTable, DiffuseBeside) {
        let alone = self.lobe_alone(free);
        let follows = |i: usize| (alone.inverse * self.column(i)).as_vec3();
        let [x, y, z] = [0, 1, 2].map(|c| alone.inverse.col(c)[c]);
        let beside = DiffuseBeside {
            own: alone.own,
            variance: DVec3::new(x, y, z),
            response: (0..ROUGHNESSES * self.lobe.size).map(follows).collect(),
        };
        (alone.lobe, beside)
    }

    /// The lobe's part when the diffuse albedos in `free` follow it and the others stay zero.
    pub(super) fn lobe_alone(&self, free: [bool; 3]) -> LobeAlone {
        let m = self.lobe.size;
        let inverse = inverse_of(&self.diffuse, free);
        let b = DVec3::new(self.diffuse.b[0], self.diffuse.b[1], self.diffuse.b[2]);
        let own = inverse * b;
        let mut lobe = self.lobe.clone();
        lobe.yy -= b.dot(own);
        for node in 0..ROUGHNESSES {
            for j in 0..m {
                let follows = inverse * self.column(node * m + j);
                lobe.b[node * m + j] -= b.dot(follows);
                for lag in 0..TAPS.min(node + 1) {
                    for l in 0..m {
                        let index = lobe.band_index(node, lag, l, j);
                        lobe.band[index] -= self.column((node - lag) * m + l).dot(follows);
                    }
                }
            }
        }
        LobeAlone { lobe, inverse, own }
    }

    /// Products of the diffuse traces with one of the lobe's, by node and parameter.
    fn column(&self, i: usize) -> DVec3 {
        DVec3::from_slice(&self.cross[3 * i..])
    }

    /// The diffuse albedos that follow a lobe, whatever their sign.
    pub(super) fn diffuse_beside(&self, alone: &LobeAlone, ln_alpha: f64, lobe: &[f64]) -> DVec3 {
        let stencil = Stencil::at(ln_alpha);
        let products = lobe.iter().enumerate().map(|(j, height)| {
            let at = |c| self.blend_cross(&stencil.value, stencil.first, j, c);
            *height * DVec3::new(at(0), at(1), at(2))
        });
        alone.own - alone.inverse * products.sum::<DVec3>()
    }
}

/// The lobe's part of a point's normal equations, the diffuse albedos following.
pub(super) struct LobeAlone {
    pub(super) lobe: LobeTable,
    /// Inverse of the diffuse albedos' own matrix.
    inverse: DMat3,
    /// The diffuse albedos without a lobe.
    own: DVec3,
}

/// Inverse of the diffuse albedos' normal matrix, rows and columns of those that are not free being
/// zero.
fn inverse_of(normal: &Normal, free: [bool; 3]) -> DMat3 {
    let mut matrix = DMat3::IDENTITY;
    let used = |c: usize| free[c] && normal.a[c][c] > 0.0;
    for c in (0..3).filter(|&c| used(c)) {
        for d in (0..3).filter(|&d| used(d)) {
            matrix.col_mut(d)[c] = normal.a[c][d];
        }
    }
    let mut inverse = matrix.inverse();
    for c in (0..3).filter(|&c| !used(c)) {
        inverse.col_mut(c)[c] = 0.0;
    }
    inverse
}

/// The diffuse albedos that go with a lobe.
#[derive(Clone, Debug)]
pub(super) struct DiffuseBeside {
    /// Without a lobe.
    own: DVec3,
    /// Their variances beside a lobe that is given, at unit scale.
    pub(super) variance: DVec3,
    /// `[node][parameter]` what a unit of the lobe takes from them.
    response: Vec<Vec3>,
}

impl DiffuseBeside {
    /// The diffuse albedos, ≥ 0, beside a lobe, and how they answer to each of its parameters.
    pub(super) fn at(&self, ln_alpha: f64, lobe: &[f64]) -> (DVec3, [DVec3; MOST_PARAMETERS]) {
        let stencil = Stencil::at(ln_alpha);
        let mut response = [DVec3::ZERO; MOST_PARAMETERS];
        for (j, response) in response.iter_mut().enumerate().take(lobe.len()) {
            *response = (stencil.first..)
                .zip(stencil.value)
                .map(|(node, w)| w * self.response[node * lobe.len() + j].as_dvec3())
                .sum();
        }
        let taken: DVec3 = response.iter().zip(lobe).map(|(r, v)| *r * *v).sum();
        ((self.own - taken).max(DVec3::ZERO), response)
    }
}

const _: () = assert!(UNKNOWNS >= 3 + MOST_PARAMETERS);
