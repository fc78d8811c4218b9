//! The lobe over the cells of [`super::lobe_cells`], for every roughness and both NDFs.

use std::sync::LazyLock;

use glam::{Vec3, Vec3A};

use super::columns::{ROUGHNESSES, roughness};
use super::lobe_cells::{Lit, PLACES, RINGS, cos_of, tan2_of};
use crate::brdf::{Alpha, Ndf};
use crate::geometry::Local;

/// Roughnesses side by side, which one pass over the cells sums: with three channels, as many sums as
/// registers hold.
const LANES: usize = 16;
/// Passes over the cells for all roughnesses.
const PASSES: usize = ROUGHNESSES.div_ceil(LANES);

/// The lobe over the grid, `D G1(ω_i)`: a product of what rings and places have, by roughness.
struct Weights {
    /// `[ring]` `D`.
    rings: Vec<[f32; LANES]>,
    /// `[place]` `G1(ω_i)`.
    places: [[f32; LANES]; PLACES],
}

/// `[ndf][pass]`; zero past the last roughness.
static WEIGHTS: LazyLock<[[Weights; PASSES]; 2]> = LazyLock::new(|| {
    let density = |ndf: Ndf, ring: usize, alpha: Alpha| {
        let tan2 = tan2_of(ring as f32).max(0.0);
        ndf.density(Local(Vec3::new(tan2.sqrt(), 0.0, 1.0).normalize()), alpha)
    };
    let masking = |ndf: Ndf, place: usize, alpha: Alpha| {
        let cos_i = cos_of(place).max(1e-5);
        let wi = Local(Vec3::new((1.0 - cos_i * cos_i).sqrt(), 0.0, cos_i));
        ndf.masking_over_cos(wi, alpha) * cos_i
    };
    Ndf::ALL.map(|ndf| {
        std::array::from_fn(|pass| {
            let lanes = |of: &dyn Fn(Alpha) -> f32| {
                std::array::from_fn(|lane| {
                    let k = pass * LANES + lane;
                    let alpha = (k < ROUGHNESSES).then(|| Alpha::saturating(roughness(k)));
                    alpha.map_or(0.0, of)
                })
            };
            Weights {
                rings: (0..RINGS)
                    .map(|ring| lanes(&|alpha| density(ndf, ring, alpha)))
                    .collect(),
                places: std::array::from_fn(|place| lanes(&|alpha| masking(ndf, place, alpha))),
            }
        })
    })
});

/// `[ndf][roughness]` `Σ cell · D G1(ω_i)`, linear RGB.
pub(super) fn weigh_all(cells: &[Vec3A], lit: &Lit) -> [[Vec3; ROUGHNESSES]; 2] {
    Ndf::ALL.map(|ndf| {
        let passes = WEIGHTS[ndf as usize].each_ref();
        let sums = passes.map(|weights| weigh(cells, lit, weights));
        std::array::from_fn(|k| {
            let channels = sums[k / LANES];
            Vec3::from(channels.map(|channel| channel[k % LANES]))
        })
    })
}

/// Sums by channel and lane.
type Sums = [[f32; LANES]; 3];

/// `Σ cell · weight`, by the widest instructions that the machine has.
fn weigh(cells: &[Vec3A], lit: &Lit, weights: &Weights) -> Sums {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx512f") {
        #[expect(unsafe_code, reason = "the processor was just asked for AVX-512")]
        // SAFETY: AVX-512 is present, and FMA is a part of it.
        return unsafe { weigh_avx512(cells, lit, weights) };
    } else if std::arch::is_x86_feature_detected!("avx2")
        && std::arch::is_x86_feature_detected!("fma")
    {
        #[expect(unsafe_code, reason = "the processor was just asked for AVX2 and FMA")]
        // SAFETY: both are present.
        return unsafe { weigh_avx2(cells, lit, weights) };
    }
    weigh_by(cells, lit, weights, |sum, light, weight| {
        sum + light * weight
    })
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn weigh_avx512(cells: &[Vec3A], lit: &Lit, weights: &Weights) -> Sums {
    weigh_by(cells, lit, weights, |sum, light, weight| {
        light.mul_add(weight, sum)
    })
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn weigh_avx2(cells: &[Vec3A], lit: &Lit, weights: &Weights) -> Sums {
    weigh_by(cells, lit, weights, |sum, light, weight| {
        light.mul_add(weight, sum)
    })
}

#[inline(always)]
fn weigh_by(
    cells: &[Vec3A],
    lit: &Lit,
    weights: &Weights,
    add: impl Fn(f32, f32, f32) -> f32,
) -> Sums {
    let mut sums = [[0.0; LANES]; 3];
    let rings = cells.chunks_exact(PLACES).zip(&weights.rings).enumerate();
    for (number, (ring, density)) in rings {
        let places = lit.places(number);
        if places.is_empty() {
            continue;
        }
        let (mut r, mut g, mut b) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for (cell, masking) in ring[places.clone()].iter().zip(&weights.places[places]) {
            for lane in 0..LANES {
                r[lane] = add(r[lane], cell.x, masking[lane]);
                g[lane] = add(g[lane], cell.y, masking[lane]);
                b[lane] = add(b[lane], cell.z, masking[lane]);
            }
        }
        for (sum, inner) in sums.iter_mut().zip([r, g, b]) {
            for lane in 0..LANES {
                sum[lane] = add(sum[lane], inner[lane], density[lane]);
            }
        }
    }
    sums
}
