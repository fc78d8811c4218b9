//! Neighbouring entries of the lobe's table, from one cut through the light.
//!
//! ```text
//! Q(n) = ∫ E(ω) F(ω·h) D(n·h; alpha) G1(ω; alpha) dω,   h = (ω + v)/|ω + v|
//! ⟨D⟩ = D + ½ σ² ∇²D  (GGX),   ⟨D⟩ = D at alpha² + 2σ²  (Beckmann: a Gaussian stays one)
//! ```
//!
//! A node of the light's quadtree stands for its patch: by the direction in the middle of its light, with
//! `D` averaged over half vectors of the patch's variance `σ²` per axis, and the cosine, which the
//! horizon cuts, over a strip of the patch's width. Errors are then of fourth order in the patch's
//! width, where the patch's light spreads alike in all directions. Half vectors and reflectances depend
//! on the view alone, so all entries of a block and a view share them.

use std::f32::consts::{FRAC_1_PI, LOG2_E};

use glam::{Vec3, Vec3A};

use crate::brdf::{Alpha, Ndf, dielectric, schlick_weight};
use crate::probe::LightPyramid;

/// Entries along a block's side: eight cells, and what the stencil of four reaches over.
pub(super) const SIDE: usize = 11;
/// Entries of a block.
const ENTRIES: usize = SIDE * SIDE;
/// The same, filled up to whole vectors.
const PADDED: usize = ENTRIES.next_multiple_of(16);
/// Variance of a node's half vectors, per axis, over their squared distance to the lobe plus alpha²:
/// nodes above it are split, whatever their light. At 0.1 errors are twenty times as large.
const WIDEST: f32 = 0.05;
/// How many times its spread a node may reach from its middle.
const REACH: f32 = 2.5;

/// What the tables are made for: a lobe's shape, and the Fresnel terms that it is linear in.
#[derive(Clone, Copy, Debug)]
pub(super) struct LobeShape {
    pub(super) ndf: Ndf,
    pub(super) alpha: Alpha,
    /// Of a dielectric; `None` for Schlick's two terms, `1 − s` and `s`.
    pub(super) eta: Option<f32>,
    /// The same variance ratio times a node's share of the light in the lobe: nodes above it are split.
    /// Their number goes with its inverse square root; without it, it took five times as many nodes to
    /// the same error.
    pub(super) finest_share: f32,
}

impl LobeShape {
    /// Number of Fresnel terms.
    pub(super) fn terms(&self) -> usize {
        if self.eta.is_some() { 1 } else { 2 }
    }

    fn reflectances(&self, cos: f32) -> [f32; 2] {
        match self.eta {
            Some(eta) => [dielectric(cos, eta), 0.0],
            None => {
                let s = schlick_weight(cos);
                [1.0 - s, s]
            }
        }
    }
}

/// A light node as a view sees it.
struct Node {
    half: Vec3,
    wi: Vec3,
    /// Variance of the half vectors of its light, radian² per axis.
    variance: f32,
    /// Half the width of the strip of the variance of its directions.
    half_width: f32,
    /// `[term]` flux times reflectance.
    flux: [Vec3; 2],
}

/// Values of the entries.
type Values = [f32; PADDED];
/// `[axis]` normals of the entries.
type Normals = [Values; 3];

/// `[term][row][column]` `Q` for the view `view`, at the normals `[row][column]`, all unit, world frame.
pub(super) fn block(
    pyramid: &LightPyramid,
    shape: &LobeShape,
    view: Vec3,
    entries: &[Vec3; ENTRIES],
) -> Box<[Vec3A]> {
    let middle = entries[ENTRIES / 2];
    let reach = |reach: f32, n: &Vec3| reach.max((*n - middle).length());
    let radius = entries.iter().fold(0.0, reach);
    let nodes = cut(pyramid, shape, view, (middle, radius));
    let mut normals: Normals = [[0.0; PADDED]; 3];
    for (axis, values) in normals.iter_mut().enumerate() {
        for (value, entry) in values.iter_mut().zip(entries) {
            *value = entry[axis];
        }
    }
    let entry = |sums: &[Values; 3], k: usize| Vec3A::new(sums[0][k], sums[1][k], sums[2][k]);
    let listed = |sums: &[Values; 3]| (0..ENTRIES).map(|k| entry(sums, k)).collect::<Vec<_>>();
    if shape.eta.is_some() {
        let sums: [_; 1] = sum(&nodes, &normals, shape);
        listed(&sums[0]).into()
    } else {
        let sums: [_; 2] = sum(&nodes, &normals, shape);
        sums.iter().flat_map(listed).collect()
    }
}

/// A node on its way into the cut.
struct Candidate {
    index: u32,
    node: Node,
    /// Variance of its half vectors over their squared distance to the lobe plus alpha².
    wideness: f32,
    /// What it sends into the lobe at most, and about what it sends into the middle's, summed over RGB.
    light: [f32; 2],
}

/// Nodes that serve all entries within `radius` (a chord) of `middle`.
///
/// Nodes that are wide beside their distance are split; then those whose error, as a share of the light
/// in the lobe, still matters.
fn cut(
    pyramid: &LightPyramid,
    shape: &LobeShape,
    view: Vec3,
    (middle, radius): (Vec3, f32),
) -> Vec<Node> {
    let a2 = shape.alpha.get() * shape.alpha.get();
    let nodes = pyramid.nodes();
    let seen = |index: u32| -> Option<Candidate> {
        let node = &nodes[index as usize];
        if node.direction.dot(middle) + radius < -REACH * node.spread {
            return None;
        }
        let half = node.direction + view;
        let length2 = half.length_squared().max(1e-8);
        let half = half / length2.sqrt();
        let apart = (half - middle).length();
        let distance = (apart - radius).max(0.0);
        // Half of the light's in the plane of incidence, 1/(2 cos) of it across: the mean.
        let spread2 = node.spread * node.spread;
        let variance = spread2 * (0.0625 + 0.25 / length2);
        let reflectances = shape.reflectances((0.5 * length2.sqrt()).min(1.0));
        let flux = reflectances.map(|reflectance| node.flux * reflectance);
        let sum = (flux[0] + flux[1]).element_sum();
        let squares = [distance, apart].map(|d| d * d + a2);
        Some(Candidate {
            index,
            node: Node {
                half,
                wi: node.direction,
                // What texels leave may be wide beside a narrow lobe.
                variance: variance.min(0.1 * a2),
                half_width: (1.5 * spread2).sqrt().max(1e-6),
                flux,
            },
            wideness: variance / squares[0],
            light: squares.map(|square| sum / (square * square)),
        })
    };
    let children = |index: u32| {
        let node = &nodes[index as usize];
        node.first_child..node.first_child + node.children
    };
    let mut waiting: Vec<Candidate> = pyramid.roots().filter_map(|k| seen(k as u32)).collect();
    let mut coarse = Vec::new();
    let mut light = 0.0;
    while let Some(candidate) = waiting.pop() {
        let children = children(candidate.index);
        if candidate.wideness > WIDEST && !children.is_empty() {
            waiting.extend(children.filter_map(seen));
        } else {
            light += candidate.light[1];
            coarse.push(candidate);
        }
    }
    let bound = shape.finest_share * light;
    let mut cut = Vec::with_capacity(2 * coarse.len());
    while let Some(candidate) = coarse.pop() {
        let children = children(candidate.index);
        if candidate.wideness * candidate.light[0] > bound && !children.is_empty() {
            coarse.extend(children.filter_map(seen));
        } else {
            cut.push(candidate.node);
        }
    }
    cut
}

/// `[term][channel]` sums over the nodes, by the widest instructions that the machine has.
fn sum<const TERMS: usize>(
    nodes: &[Node],
    normals: &Normals,
    shape: &LobeShape,
) -> [[Values; 3]; TERMS] {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx512f") {
        #[expect(unsafe_code, reason = "the processor was just asked for AVX-512")]
        // SAFETY: AVX-512 is present, and FMA is a part of it.
        return unsafe { sum_avx512(nodes, normals, shape) };
    } else if std::arch::is_x86_feature_detected!("avx2")
        && std::arch::is_x86_feature_detected!("fma")
    {
        #[expect(unsafe_code, reason = "the processor was just asked for AVX2 and FMA")]
        // SAFETY: AVX2 and FMA are present.
        return unsafe { sum_avx2(nodes, normals, shape) };
    }
    sum_any::<TERMS, false>(nodes, normals, shape)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn sum_avx512<const TERMS: usize>(
    nodes: &[Node],
    normals: &Normals,
    shape: &LobeShape,
) -> [[Values; 3]; TERMS] {
    sum_any::<TERMS, true>(nodes, normals, shape)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn sum_avx2<const TERMS: usize>(
    nodes: &[Node],
    normals: &Normals,
    shape: &LobeShape,
) -> [[Values; 3]; TERMS] {
    sum_any::<TERMS, true>(nodes, normals, shape)
}

#[inline(always)]
fn sum_any<const TERMS: usize, const FMA: bool>(
    nodes: &[Node],
    normals: &Normals,
    shape: &LobeShape,
) -> [[Values; 3]; TERMS] {
    let mut sums = [[[0.0; PADDED]; 3]; TERMS];
    for node in nodes {
        let weights = match shape.ndf {
            Ndf::Ggx => ggx::<FMA>(node, normals, shape.alpha.get()),
            Ndf::Beckmann => beckmann::<FMA>(node, normals, shape.alpha.get()),
        };
        for (sums, flux) in sums.iter_mut().zip(&node.flux) {
            for (sums, flux) in sums.iter_mut().zip(flux.to_array()) {
                for (sum, weight) in sums.iter_mut().zip(&weights) {
                    *sum = madd::<FMA>(flux, *weight, *sum);
                }
            }
        }
    }
    sums
}

/// `a b + c`; without the instruction, fusing it would be a call.
#[inline(always)]
fn madd<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// Squared sine of the half vector's angle, and half its squared chord: `1 − cos` without cancelling.
#[inline(always)]
fn sin2_and_rise<const FMA: bool>(half: Vec3, (x, y, z): (f32, f32, f32)) -> (f32, f32) {
    let (x, y, z) = (half.x - x, half.y - y, half.z - z);
    let rise = 0.5 * madd::<FMA>(x, x, madd::<FMA>(y, y, z * z));
    (rise * (2.0 - rise), rise)
}

/// Mean over the strip of half width `w` of the cosine where it is above the horizon.
#[inline(always)]
fn lit_cosine<const FMA: bool>(node: &Node, (x, y, z): (f32, f32, f32)) -> f32 {
    let (wi, w) = (node.wi, node.half_width);
    let cos = madd::<FMA>(wi.x, x, madd::<FMA>(wi.y, y, wi.z * z));
    let cut = (cos + w).max(0.0).min(2.0 * w);
    madd::<FMA>(cut, cut * (0.25 / w), (cos - w).max(0.0)).min(1.0)
}

/// `⟨D⟩ G1` of GGX.
#[inline(always)]
fn ggx<const FMA: bool>(node: &Node, normals: &Normals, alpha: f32) -> Values {
    let (a2, b) = (alpha * alpha, 1.0 - alpha * alpha);
    let scale = a2 * 2.0 * FRAC_1_PI;
    let mut weights = [0.0; PADDED];
    for (k, weight) in weights.iter_mut().enumerate() {
        let normal = (normals[0][k], normals[1][k], normals[2][k]);
        let (u, _) = sin2_and_rise::<FMA>(node.half, normal);
        let cos = lit_cosine::<FMA>(node, normal);
        let q = madd::<FMA>(b, u, a2);
        let masking = cos + madd::<FMA>(b, cos * cos, a2).sqrt();
        // One division for both: 1/q and 1/masking.
        let inverse = 1.0 / (q * masking);
        let over_q = inverse * masking;
        // The Laplacian on the sphere of a²/q² with q = a² + b u, u = sin²θ, over the same.
        let (first, second) = (madd::<FMA>(-6.0, u, 4.0), 12.0 * b * u * (1.0 - u));
        let bend = b * over_q * madd::<FMA>(second, over_q, -first);
        let widened = madd::<FMA>(node.variance, bend, 1.0);
        *weight = scale * cos * (inverse * over_q) * q * over_q * widened;
    }
    weights
}

/// `⟨D⟩ G1` of Beckmann.
#[inline(always)]
fn beckmann<const FMA: bool>(node: &Node, normals: &Normals, alpha: f32) -> Values {
    let a2 = alpha * alpha + 2.0 * node.variance;
    let (per_a2, scale) = (-LOG2_E / a2, FRAC_1_PI / a2);
    let mut weights = [0.0; PADDED];
    for (k, weight) in weights.iter_mut().enumerate() {
        let normal = (normals[0][k], normals[1][k], normals[2][k]);
        let (u, rise) = sin2_and_rise::<FMA>(node.half, normal);
        let cos_h = (1.0 - rise).max(1e-3);
        let over_cos2 = 1.0 / (cos_h * cos_h);
        let density = exp2::<FMA>(u * over_cos2 * per_a2) * (over_cos2 * over_cos2);
        let cos = lit_cosine::<FMA>(node, normal);
        let sin2 = (1.0 - cos * cos).max(1e-12);
        // The rational fit of G1, which is 1 from 1.6 on.
        let slope = (cos / (alpha * sin2.sqrt())).min(1.6);
        let above = slope * madd::<FMA>(2.181, slope, 3.535);
        let below = madd::<FMA>(slope, madd::<FMA>(2.577, slope, 2.276), 1.0);
        *weight = scale * density * (above / below).min(1.0);
    }
    weights
}

/// `2^x` for x ≤ 0, within 4e-7 of it (Taylor's series about the nearest whole number); below 2^-120 that.
#[inline(always)]
fn exp2<const FMA: bool>(x: f32) -> f32 {
    /// Adding it leaves no room for a fraction; the last bits of the sum are the whole number.
    const WHOLE: f32 = 12_582_912.0;
    let x = x.max(-120.0);
    let shifted = x + WHOLE;
    let t = (x - (shifted - WHOLE)) * std::f32::consts::LN_2;
    let series = madd::<FMA>(t, 1.0 / 720.0, 1.0 / 120.0);
    let series = madd::<FMA>(t, series, 1.0 / 24.0);
    let series = madd::<FMA>(t, series, 1.0 / 6.0);
    let series = madd::<FMA>(t, series, 0.5);
    let series = madd::<FMA>(t, series, 1.0);
    let series = madd::<FMA>(t, series, 1.0);
    // Two to a whole number is that number in the exponent's bits.
    let exponent = shifted
        .to_bits()
        .wrapping_sub(WHOLE.to_bits())
        .wrapping_add(127);
    series * f32::from_bits(exponent << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_two_are_those() {
        for k in 0..4000 {
            let x = -0.025 * k as f32;
            let (mine, exact) = (exp2::<false>(x), x.exp2());
            assert!((mine - exact).abs() < 4e-7 * exact, "{x}: {mine} {exact}");
        }
    }
}
