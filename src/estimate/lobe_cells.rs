//! Specular sums over light nodes, for every roughness and both NDFs at once.
//!
//! ```text
//! T_s(alpha) = G1(ω_o)/(4 cos θ_o) · Σ_j Φ_j F(ω_i·ω_h) · D(θ_h; alpha) · G1(θ_i; alpha)
//! ```
//!
//! with `Φ_j` the flux of node j; its cosine cancels against the BRDF's. A node enters `D` by the angle
//! of its half vector alone and `G1` by its own angle, and both are smooth in `ln tan θ_h` and
//! `√cos θ_i`. So a node's flux is laid into a grid over these two, cubically over the angle of the half
//! vector and linearly over its own, and the grid is weighed once, place by place by the tabulated `G1` of
//! all roughnesses and ring by ring by their `D`: sixteen additions a node instead of 56 evaluations of the
//! lobe.
//!
//! A node has a width, and stands at two places, which have the first two moments of its patch's `θ_h²`:
//! the error of `D` is then of fourth order in the node's width.

use std::ops::Range;

use glam::{Vec3, Vec3A};

use super::columns::{ROUGHNESSES, roughness};
use super::fresnel_model::FresnelModel;
use super::lobe_weights::weigh_all;
use crate::brdf::{Alpha, Ndf};
use crate::geometry::Local;

/// Places over the half vector's angle: steps of 7 %. Beckmann's lobe falls by e² in a step of 13 % where
/// it is a thousandth of its peak, which cubics do not follow.
pub(super) const RINGS: usize = 128;
/// Places over `√cos θ_i`, close enough for masking to be linear between them: within 0.1 %.
pub(super) const PLACES: usize = 24;
/// Cells of the grid.
const CELLS: usize = RINGS * PLACES;
/// Angle, radians, below which half vectors count as equal: the narrowest lobe is four times as wide.
const INNERMOST: f32 = 0.0025;
/// Steepest half vector, as a tangent: beyond 83°, Beckmann's density is zero and GGX's level.
const STEEPEST: f32 = 8.0;
const SMALLEST_COS2: f32 = 1.0 / (1.0 + STEEPEST * STEEPEST);

/// Nodes that are laid together.
const BATCH: usize = 16;
/// Largest number of Fresnel terms.
const MOST_BASES: usize = 4;

/// Step of the rings in `½ ln(tan² θ_h + INNERMOST²)`; the last but one is at [`STEEPEST`].
fn step() -> f32 {
    (STEEPEST / INNERMOST).ln() / (RINGS - 2) as f32
}

/// `tan² θ_h` of a ring.
pub(super) fn tan2_of(ring: f32) -> f32 {
    (2.0 * (INNERMOST.ln() + ring * step())).exp() - INNERMOST * INNERMOST
}

/// `cos θ_i` of a place.
pub(super) fn cos_of(place: usize) -> f32 {
    let root = place as f32 / (PLACES - 1) as f32;
    root * root
}

/// Where light falls: the first place of each ring, and one past the last.
#[derive(Default)]
pub(super) struct Lit {
    first: Vec<u8>,
    end: Vec<u8>,
}

impl Lit {
    /// The places of a ring.
    #[inline]
    pub(super) fn places(&self, ring: usize) -> Range<usize> {
        usize::from(self.first[ring])..usize::from(self.end[ring])
    }

    fn clear(&mut self) {
        self.first.clear();
        self.first.resize(RINGS, PLACES as u8);
        self.end.clear();
        self.end.resize(RINGS, 0);
    }

    /// Two places from `first` in four rings.
    #[inline]
    fn add(&mut self, ring: usize, first: usize) {
        for lit in &mut self.first[ring..][..4] {
            *lit = (*lit).min(first as u8);
        }
        for end in &mut self.end[ring..][..4] {
            *end = (*end).max(first as u8 + 2);
        }
    }
}

/// Nodes side by side.
#[derive(Default)]
struct Batch {
    count: usize,
    /// Squared sine of the half vector's angle to the normal.
    sin2_h: [f32; BATCH],
    /// Variance of the half vectors, per axis.
    variance_h: [f32; BATCH],
    /// Cosine of the node's own angle.
    cos_i: [f32; BATCH],
    /// Cosine between half vector and node.
    cos_d: [f32; BATCH],
    flux: [Vec3A; BATCH],
}

/// Where nodes are laid.
struct Laid {
    /// `[one of two places][node]` first of four rings, and `[ring]` Lagrange's weights.
    ring: [[i32; BATCH]; 2],
    across: [[[f32; BATCH]; 4]; 2],
    /// First of two places over the node's own angle, and the second one's weight.
    place: [i32; BATCH],
    along: [f32; BATCH],
    /// `[basis]` half the reflectance.
    half_reflectance: [[f32; BATCH]; MOST_BASES],
}

/// A light node, or a patch of the object, as a lobe sees it.
pub(super) struct InLobe {
    /// Squared sine of the half vector's angle to the normal.
    pub(super) sin2_h: f32,
    /// Variance of its half vectors, radian² per axis.
    pub(super) variance_h: f32,
    /// Cosine of its own angle, above the horizon.
    pub(super) cos_i: f32,
    /// Cosine between half vector and light.
    pub(super) cos_d: f32,
    /// Linear RGB.
    pub(super) flux: Vec3,
}

/// Light in the lobe of one observation.
pub(super) struct LobeCells {
    fresnel: FresnelModel,
    /// `[basis][cell]` flux, Fresnel included.
    cells: Vec<Vec3A>,
    lit: Lit,
    waiting: Batch,
}

impl Default for LobeCells {
    fn default() -> Self {
        let mut cells = Self {
            fresnel: FresnelModel::Schlick,
            cells: Vec::new(),
            lit: Lit::default(),
            waiting: Batch::default(),
        };
        cells.lit.clear();
        cells
    }
}

impl LobeCells {
    /// Empties the cells, for the terms of a Fresnel model.
    pub(super) fn clear(&mut self, fresnel: FresnelModel) {
        for basis in self.cells.chunks_exact_mut(CELLS) {
            for (number, ring) in basis.chunks_exact_mut(PLACES).enumerate() {
                let places = self.lit.places(number);
                if !places.is_empty() {
                    ring[places].fill(Vec3A::ZERO);
                }
            }
        }
        self.fresnel = fresnel;
        self.cells
            .resize(fresnel.bases().len() * CELLS, Vec3A::ZERO);
        self.lit.clear();
        self.waiting.count = 0;
    }

    /// Adds a node above the horizon.
    #[inline]
    pub(super) fn add(&mut self, node: &InLobe) {
        let batch = &mut self.waiting;
        let lane = batch.count;
        batch.sin2_h[lane] = node.sin2_h;
        batch.variance_h[lane] = node.variance_h;
        batch.cos_i[lane] = node.cos_i;
        batch.cos_d[lane] = node.cos_d;
        batch.flux[lane] = node.flux.into();
        batch.count += 1;
        if batch.count == BATCH {
            self.lay();
        }
    }

    /// Lays what waits, by the widest instructions that the machine has.
    fn lay(&mut self) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx512f")
            && std::arch::is_x86_feature_detected!("avx512vl")
        {
            #[expect(unsafe_code, reason = "the processor was just asked for AVX-512")]
            // SAFETY: it is present.
            return unsafe { self.lay_avx512() };
        } else if std::arch::is_x86_feature_detected!("avx2") {
            #[expect(unsafe_code, reason = "the processor was just asked for AVX2")]
            // SAFETY: it is present.
            return unsafe { self.lay_avx2() };
        }
        self.lay_any();
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl")]
    fn lay_avx512(&mut self) {
        self.lay_any();
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn lay_avx2(&mut self) {
        self.lay_any();
    }

    #[inline(always)]
    fn lay_any(&mut self) {
        let count = std::mem::take(&mut self.waiting.count);
        if count == 0 {
            return;
        }
        let laid = Laid::of(&self.waiting, self.fresnel);
        for lane in 0..count {
            let place = laid.place[lane] as usize;
            for (ring, across) in laid.ring.iter().zip(&laid.across) {
                let ring = ring[lane] as usize;
                self.lit.add(ring, place);
                for (cells, half) in
                    (self.cells.chunks_exact_mut(CELLS)).zip(&laid.half_reflectance)
                {
                    let cells = &mut cells[ring * PLACES + place..][..3 * PLACES + 2];
                    let flux = self.waiting.flux[lane] * half[lane];
                    let far = flux * laid.along[lane];
                    let near = flux - far;
                    for (i, across) in across.iter().enumerate() {
                        cells[i * PLACES] += near * across[lane];
                        cells[i * PLACES + 1] += far * across[lane];
                    }
                }
            }
        }
    }

    /// `[ndf][roughness]` of basis number `basis` for a view at `cos_o`, linear RGB.
    pub(super) fn sums(&mut self, basis: usize, cos_o: f32) -> [[Vec3; ROUGHNESSES]; 2] {
        self.lay();
        let sin_o = (1.0 - cos_o * cos_o).max(0.0).sqrt();
        let wo = Local(Vec3::new(sin_o, 0.0, cos_o));
        let mut sums = weigh_all(&self.cells[basis * CELLS..][..CELLS], &self.lit);
        for (ndf, sums) in Ndf::ALL.into_iter().zip(&mut sums) {
            for (k, sum) in sums.iter_mut().enumerate() {
                *sum *= 0.25 * ndf.masking_over_cos(wo, Alpha::saturating(roughness(k)));
            }
        }
        sums
    }
}

impl Laid {
    /// Lane by lane; those past the count hold old nodes.
    #[inline(always)]
    fn of(batch: &Batch, fresnel: FresnelModel) -> Self {
        let (per_step, first) = (1.0 / step(), INNERMOST.ln());
        let mut laid = Self {
            ring: [[0; BATCH]; 2],
            across: [[[0.0; BATCH]; 4]; 2],
            place: [0; BATCH],
            along: [0.0; BATCH],
            half_reflectance: [[0.0; BATCH]; MOST_BASES],
        };
        for (sign, (rings, across)) in [-1.0, 1.0]
            .into_iter()
            .zip(laid.ring.iter_mut().zip(&mut laid.across))
        {
            for lane in 0..BATCH {
                let variance = batch.variance_h[lane];
                let distance = (batch.sin2_h[lane] + variance).sqrt();
                let sin_h = (distance + sign * variance.sqrt()).min(1.0);
                let sin2_h = sin_h * sin_h;
                let tan2 = sin2_h / (1.0 - sin2_h).max(SMALLEST_COS2);
                let ring = (0.5 * ln(tan2 + INNERMOST * INNERMOST) - first) * per_step;
                let start = (ring as i32 - 1).clamp(0, RINGS as i32 - 4);
                // Lagrange's weights of four places.
                let a = ring - start as f32;
                let (b, c, d) = (a - 1.0, a - 2.0, a - 3.0);
                rings[lane] = start;
                across[0][lane] = -b * c * d / 6.0;
                across[1][lane] = a * c * d / 2.0;
                across[2][lane] = -a * b * d / 2.0;
                across[3][lane] = a * b * c / 6.0;
            }
        }
        for lane in 0..BATCH {
            let place = batch.cos_i[lane].min(1.0).sqrt() * (PLACES - 1) as f32;
            let first = (place as i32).clamp(0, PLACES as i32 - 2);
            laid.place[lane] = first;
            laid.along[lane] = place - first as f32;
        }
        for (half, &basis) in laid.half_reflectance.iter_mut().zip(fresnel.bases()) {
            for (half, &cos_d) in half.iter_mut().zip(&batch.cos_d) {
                *half = 0.5 * fresnel.reflectance(basis, cos_d);
            }
        }
        laid
    }
}

/// `ln x` of a positive normal number, to 1e-7 of 1 or of itself: `ln m = 2 artanh((m − 1)/(m + 1))` of a
/// mantissa in [√½, √2).
#[inline(always)]
fn ln(x: f32) -> f32 {
    /// Bits of √½.
    const LEAST: u32 = 0x3f35_04f3;
    let exponent = (x.to_bits().wrapping_sub(LEAST) as i32) >> 23;
    let mantissa = f32::from_bits(x.to_bits().wrapping_sub((exponent << 23) as u32));
    let t = (mantissa - 1.0) / (mantissa + 1.0);
    let t2 = t * t;
    let series = 1.0 + t2 * (1.0 / 3.0 + t2 * (0.2 + t2 * (1.0 / 7.0)));
    exponent as f32 * std::f32::consts::LN_2 + 2.0 * t * series
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn every_fresnel_term_has_room() {
        assert!(FresnelModel::Auto.bases().len() <= MOST_BASES);
    }

    #[test]
    fn logarithms_are_those() {
        for k in 0..4000 {
            let x = 1e-6 * 1.004f32.powi(k);
            assert!((ln(x) - x.ln()).abs() < 2e-7 * (1.0 + x.ln().abs()), "{x}");
        }
    }

    #[test]
    fn any_number_of_nodes_adds_up_whatever_is_left_of_others() {
        let node = |k: usize| InLobe {
            sin2_h: 0.01 + 0.02 * k as f32,
            variance_h: 1e-3,
            cos_i: 0.9 - 0.02 * k as f32,
            cos_d: 0.8,
            flux: Vec3::splat(1.0 + k as f32),
        };
        let fresnel = FresnelModel::Dielectric { eta: 1.3 };
        let mut cells = LobeCells::default();
        let mut sums = |nodes: Range<usize>| {
            cells.clear(fresnel);
            nodes.for_each(|k| cells.add(&node(k)));
            cells.sums(0, 0.7)
        };
        for count in [0, 1, BATCH - 1, BATCH, BATCH + 3] {
            let all = sums(0..count);
            let mut singly = [[Vec3::ZERO; ROUGHNESSES]; 2];
            for k in 0..count {
                let one = sums(k..k + 1);
                for (sum, one) in singly.as_flattened_mut().iter_mut().zip(one.as_flattened()) {
                    *sum += *one;
                }
            }
            for (all, singly) in all.as_flattened().iter().zip(singly.as_flattened()) {
                assert!((*all - *singly).length() <= 1e-4 * singly.length() + 1e-7);
            }
        }
    }

    proptest! {
        #[test]
        fn sums_are_the_brdf(cos_o in 0.2f32..1.0, x in -0.9f32..0.9, y in -0.9f32..0.9) {
            prop_assume!(x * x + y * y < 0.95);
            let wi = Local(Vec3::new(x, y, (1.0 - x * x - y * y).sqrt()));
            let wo = Local(Vec3::new((1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o));
            let wm = (wi.0 + wo.0).normalize();
            let mut cells = LobeCells::default();
            cells.clear(FresnelModel::Schlick);
            // Schlick's terms are then 3/4 and 1/4.
            let node = InLobe {
                sin2_h: wm.x * wm.x + wm.y * wm.y,
                variance_h: 0.0,
                cos_i: wi.0.z,
                cos_d: 1.0 - 0.25f32.powf(0.2),
                flux: Vec3::new(1.0, 2.0, 3.0) / 0.75,
            };
            cells.add(&node);
            let (sums, third) = (cells.sums(0, cos_o), cells.sums(1, cos_o));
            for ndf in Ndf::ALL {
                for k in 0..ROUGHNESSES {
                    let a = Alpha::saturating(roughness(k));
                    let shape = |wm: Local| 0.25 * ndf.density(wm, a)
                        * ndf.masking_over_cos(wi, a) * wi.0.z * ndf.masking_over_cos(wo, a);
                    let peak = 0.25 * ndf.density(Local(Vec3::Z), a) * ndf.masking_over_cos(wo, a);
                    let (exact, sum) = (shape(Local(wm)), sums[ndf as usize][k]);
                    // Relative in the lobe, and absolute in Beckmann's steep tail.
                    let bound = 5e-3 * exact + 5e-4 * peak;
                    prop_assert!((sum.x - exact).abs() <= bound, "{:?} {} {} {}", ndf, k, sum.x, exact);
                    prop_assert!((sum.z - 3.0 * sum.x).abs() <= 1e-4 * sum.z.abs() + 1e-4 * peak);
                    prop_assert!((third[ndf as usize][k] * 3.0 - sum).length() <= 1e-4 * (sum.length() + peak));
                }
            }
        }
    }
}
