//! The inner loop of the fit: specular sums over light nodes for every roughness and both NDFs.
//!
//! ```text
//! S(alpha) = Σ_j Φ_j F_j D(h_j; alpha) G1(i_j; alpha) · G1(o; alpha) / (4 cos θ_o)
//! ```
//!
//! with `Φ_j` the flux of node j. The node's cosine cancels against the BRDF's. Structure of
//! arrays, eight nodes abreast, compiled for AVX2 and for the baseline and chosen at run time.

use glam::Vec3;

use crate::brdf::{Alpha, Ndf};
use crate::geometry::Local;

/// Nodes side by side.
const LANES: usize = 8;
type Lane = [f32; LANES];

/// Eight nodes, by quantity. Empty places have no flux.
#[derive(Clone, Copy)]
struct Block {
    sin2_h: Lane,
    cos2_h: Lane,
    cos_i: Lane,
    sin2_i: Lane,
    flux: [Lane; 3],
}

/// Light nodes about one observation.
#[derive(Default)]
pub(super) struct NodeArrays {
    blocks: Vec<Block>,
    filled: usize,
}

impl NodeArrays {
    const EMPTY: Block = Block {
        sin2_h: [0.0; LANES],
        cos2_h: [1.0; LANES],
        cos_i: [1.0; LANES],
        sin2_i: [0.0; LANES],
        flux: [[0.0; LANES]; 3],
    };

    pub(super) fn clear(&mut self) {
        self.blocks.clear();
        self.filled = 0;
    }

    /// Adds a node above the horizon: squared sine of its half vector's angle to the normal,
    /// cosine of its own, and its flux times Fresnel reflectance.
    #[inline]
    pub(super) fn push(&mut self, sin2_h: f32, cos_i: f32, weighted_flux: Vec3) {
        let lane = self.filled % LANES;
        if lane == 0 {
            self.blocks.push(Self::EMPTY);
        }
        self.filled += 1;
        if let Some(block) = self.blocks.last_mut() {
            block.cos2_h[lane] = (1.0 - sin2_h).max(1e-6);
            block.sin2_h[lane] = sin2_h;
            block.cos_i[lane] = cos_i;
            block.sin2_i[lane] = (1.0 - cos_i * cos_i).max(0.0);
            for (array, value) in block.flux.iter_mut().zip(weighted_flux.to_array()) {
                array[lane] = value;
            }
        }
    }

    /// `sums[ndf][k]`, linear RGB, at roughness `alphas[k]` for a view at `cos_o`.
    pub(super) fn sums(&self, alphas: &[f32], cos_o: f32, sums: &mut [Vec<Vec3>; 2]) {
        sums.iter_mut().for_each(Vec::clear);
        let sin_o = (1.0 - cos_o * cos_o).max(0.0).sqrt();
        let wo = Local(Vec3::new(sin_o, 0.0, cos_o));
        for &alpha in alphas {
            let a = Alpha::saturating(alpha);
            for (ndf, sums) in Ndf::ALL.into_iter().zip(sums.iter_mut()) {
                let shape = match ndf {
                    Ndf::Ggx => dispatch_ggx(self, a.get()),
                    Ndf::Beckmann => dispatch_beckmann(self, a.get()),
                };
                sums.push(shape * (0.25 * ndf.masking_over_cos(wo, a)));
            }
        }
    }
}

/// Compiles a loop twice and calls the one that the machine runs best.
macro_rules! dispatch {
    ($name:ident, $wide:ident, $body:ident) => {
        #[inline]
        fn $name(nodes: &NodeArrays, alpha: f32) -> Vec3 {
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2") {
                #[expect(unsafe_code, reason = "the processor was just asked for AVX2")]
                // SAFETY: AVX2 is present.
                return unsafe { $wide(nodes, alpha) };
            }
            $body(nodes, alpha)
        }

        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2")]
        fn $wide(nodes: &NodeArrays, alpha: f32) -> Vec3 {
            $body(nodes, alpha)
        }
    };
}

dispatch!(dispatch_ggx, ggx_avx2, ggx);
dispatch!(dispatch_beckmann, beckmann_avx2, beckmann);

/// `Σ Φ D G1(i)`, GGX: `D G1(i) = α²/(π q²) · 2c/(c + √(c² + α² s²))`.
#[inline(always)]
fn ggx(nodes: &NodeArrays, alpha: f32) -> Vec3 {
    let a2 = alpha * alpha;
    let scale = 2.0 * a2 / std::f32::consts::PI;
    accumulate(nodes, |block, lane| {
        let q = block.sin2_h[lane] + a2 * block.cos2_h[lane];
        let c = block.cos_i[lane];
        let root = (c * c + a2 * block.sin2_i[lane]).sqrt();
        scale * c / (q * q * (c + root))
    })
}

/// `Σ Φ D G1(i)`, Beckmann, with the rational G1.
#[inline(always)]
fn beckmann(nodes: &NodeArrays, alpha: f32) -> Vec3 {
    let a2 = alpha * alpha;
    let scale = 1.0 / (std::f32::consts::PI * a2);
    accumulate(nodes, |block, lane| {
        let cos2 = block.cos2_h[lane];
        let density = exp_negative(-block.sin2_h[lane] / (cos2 * a2)) * scale / (cos2 * cos2);
        let c = block.cos_i[lane];
        let b = c / (alpha * (block.sin2_i[lane] + 1e-12).sqrt());
        let b = if b < 1.6 { b } else { 1.6 };
        let masking = b * (3.535 + 2.181 * b) / (1.0 + b * (2.276 + b * 2.577));
        // The fit ends at b = 1.6 with 1.00005; beyond, nothing is masked.
        density * if masking < 1.0 { masking } else { 1.0 }
    })
}

/// Sums `flux · weight(block, lane)` in lanes, then across them in order.
#[inline(always)]
fn accumulate(nodes: &NodeArrays, weight: impl Fn(&Block, usize) -> f32) -> Vec3 {
    let mut sums = [[0.0f32; LANES]; 3];
    for block in &nodes.blocks {
        let weights: Lane = std::array::from_fn(|lane| weight(block, lane));
        for (sum, flux) in sums.iter_mut().zip(&block.flux) {
            for lane in 0..LANES {
                sum[lane] += weights[lane] * flux[lane];
            }
        }
    }
    Vec3::from(sums.map(|lanes| lanes.iter().sum()))
}

/// `exp(x)` for `x ≤ 0`, relative error below 5e-6 down to 1e-30, then 0: branch-free, so that the
/// loop around it vectorises. `2^z` is split at the nearest integer.
#[inline(always)]
fn exp_negative(x: f32) -> f32 {
    const FLOOR: f32 = f32::from_bits(2 << 23); // 2^-125
    const ROUND: f32 = 12_582_912.0; // 1.5 · 2^23: adding it rounds to an integer in the low bits.
    let z = x * std::f32::consts::LOG2_E;
    let z = if z < -125.0 { -125.0 } else { z };
    let shifted = z + ROUND;
    let f = z - (shifted - ROUND);
    let integer = shifted.to_bits().wrapping_sub(ROUND.to_bits());
    let power = f32::from_bits(integer.wrapping_add(127) << 23);
    // 2^f on [−½, ½], Taylor in f ln 2 to the sixth order.
    let t = f * std::f32::consts::LN_2;
    let series = 1.0
        + t * (1.0
            + t * (0.5
                + t * (1.0 / 6.0 + t * (1.0 / 24.0 + t * (1.0 / 120.0 + t * (1.0 / 720.0))))));
    // At the clamp the power is 2^-125; taking that away makes it an exact zero.
    series * power - FLOOR
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn exp_is_exp() {
        for i in 0..7000 {
            let x = -i as f32 / 100.0;
            let exact = f64::from(x).exp();
            assert!(
                (f64::from(exp_negative(x)) / exact - 1.0).abs() < 5e-6,
                "{x}"
            );
        }
    }

    proptest! {
        #[test]
        fn sums_are_the_brdf(cos_o in 0.2f32..1.0, x in -0.9f32..0.9, y in -0.9f32..0.9, k in 0usize..5) {
            prop_assume!(x * x + y * y < 0.95);
            let wi = Local(Vec3::new(x, y, (1.0 - x * x - y * y).sqrt()));
            let wo = Local(Vec3::new((1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o));
            let wm = (wi.0 + wo.0).normalize();
            let mut nodes = NodeArrays::default();
            nodes.clear();
            nodes.push(wm.x * wm.x + wm.y * wm.y, wi.0.z, Vec3::new(1.0, 2.0, 3.0));
            let alphas = [0.05, 0.1, 0.2, 0.5, 1.0];
            let mut sums = [Vec::new(), Vec::new()];
            nodes.sums(&alphas, cos_o, &mut sums);
            let a = Alpha::new(alphas[k]).unwrap();
            for (ndf, sums) in Ndf::ALL.into_iter().zip(&sums) {
                let exact = 0.25 * ndf.density(Local(wm), a)
                    * ndf.masking_over_cos(wi, a) * wi.0.z * ndf.masking_over_cos(wo, a);
                prop_assert!((sums[k].x - exact).abs() <= 2e-4 * exact + 1e-20, "{:?} {} {}", ndf, sums[k].x, exact);
                prop_assert!((sums[k].z - 3.0 * sums[k].x).abs() <= 1e-5 * sums[k].z);
            }
        }
    }
}
