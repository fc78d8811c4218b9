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
//! all roughnesses and ring by ring by their `D`: eight additions a node instead of 56 evaluations of the
//! lobe.

use std::ops::Range;
use std::sync::LazyLock;

use glam::{Vec3, Vec3A};

use super::columns::{ROUGHNESSES, roughness};
use crate::brdf::{Alpha, Ndf};
use crate::geometry::Local;

/// Places over the half vector's angle: steps of 7 %. Beckmann's lobe falls by e² in a step of 13 % where
/// it is a thousandth of its peak, which cubics do not follow.
const RINGS: usize = 128;
/// Places over `√cos θ_i`, close enough for masking to be linear between them: within 0.1 %.
const PLACES: usize = 24;
/// Cells of the grid.
const CELLS: usize = RINGS * PLACES;
/// Angle, radians, below which half vectors count as equal: the narrowest lobe is four times as wide.
const INNERMOST: f32 = 0.0025;

/// Steepest half vector, as a tangent: beyond 83°, Beckmann's density is zero and GGX's level.
const STEEPEST: f32 = 8.0;
const SMALLEST_COS2: f32 = 1.0 / (1.0 + STEEPEST * STEEPEST);
/// Variance of a node over its squared distance to the normal below which it is a point: its error is
/// then at most eight times as large, for the tail of GGX.
const NARROW: f32 = 1e-4;

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
        let root = place as f32 / (PLACES - 1) as f32;
        let cos_i = (root * root).max(1e-5);
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

/// Step of the rings in `½ ln(tan² θ_h + INNERMOST²)`; the last but one is at [`STEEPEST`].
fn step() -> f32 {
    (STEEPEST / INNERMOST).ln() / (RINGS - 2) as f32
}

/// `tan² θ_h` of a ring.
fn tan2_of(ring: f32) -> f32 {
    (2.0 * (INNERMOST.ln() + ring * step())).exp() - INNERMOST * INNERMOST
}

/// Places of a ring on which no light falls.
const DARK: Range<u32> = PLACES as u32..0;

fn as_places(lit: &Range<u32>) -> Range<usize> {
    lit.start.min(lit.end) as usize..lit.end as usize
}

/// Light in the lobe of one observation.
#[derive(Default)]
pub(super) struct LobeCells {
    /// `[basis][cell]` flux, Fresnel included.
    cells: Vec<Vec3A>,
    /// `[ring]` first and last place of what is lit.
    lit: Vec<Range<u32>>,
    /// 1 over the step of the rings, and the first of them.
    rings: (f32, f32),
}

impl LobeCells {
    /// Empties the cells of `bases` Fresnel terms.
    pub(super) fn clear(&mut self, bases: usize) {
        for basis in self.cells.chunks_exact_mut(CELLS) {
            for (ring, lit) in basis.chunks_exact_mut(PLACES).zip(&self.lit) {
                ring[as_places(lit)].fill(Vec3A::ZERO);
            }
        }
        self.cells.resize(bases * CELLS, Vec3A::ZERO);
        self.lit.clear();
        self.lit.resize(RINGS, DARK);
        self.rings = (1.0 / step(), INNERMOST.ln());
    }

    /// Adds a node above the horizon: squared sine of its half vector's angle to the normal and the
    /// variance of its half vectors per axis, cosine of its own angle, its flux, and the reflectance of
    /// each basis.
    ///
    /// A node that is wide beside its distance to the normal stands at two places, which have the first
    /// two moments of its patch's `θ_h²`: the error of `D` is then of fourth order in the node's width.
    #[inline]
    pub(super) fn add(
        &mut self,
        (sin2_h, variance_h): (f32, f32),
        cos_i: f32,
        flux: Vec3,
        reflectances: impl Iterator<Item = f32> + Clone,
    ) {
        if variance_h < NARROW * (sin2_h + INNERMOST * INNERMOST) {
            self.add_at(sin2_h, cos_i, flux, reflectances);
        } else {
            let (distance, deviation) = ((sin2_h + variance_h).sqrt(), variance_h.sqrt());
            for place in [distance - deviation, (distance + deviation).min(1.0)] {
                self.add_at(place * place, cos_i, 0.5 * flux, reflectances.clone());
            }
        }
    }

    #[inline]
    fn add_at(
        &mut self,
        sin2_h: f32,
        cos_i: f32,
        flux: Vec3,
        reflectances: impl Iterator<Item = f32>,
    ) {
        let (per_step, first) = self.rings;
        let tan2 = sin2_h / (1.0 - sin2_h).max(SMALLEST_COS2);
        let ring = (0.5 * (tan2 + INNERMOST * INNERMOST).ln() - first) * per_step;
        let (ring, across) = lagrange(ring, RINGS);
        let place = cos_i.min(1.0).sqrt() * (PLACES - 1) as f32;
        let first = (place as usize).min(PLACES - 2);
        let along = place - first as f32;
        for lit in &mut self.lit[ring..][..4] {
            *lit = lit.start.min(first as u32)..lit.end.max(first as u32 + 2);
        }
        let flux = Vec3A::from(flux);
        for (cells, reflectance) in self.cells.chunks_exact_mut(CELLS).zip(reflectances) {
            let flux = flux * reflectance;
            for (i, across) in across.into_iter().enumerate() {
                let cells = &mut cells[(ring + i) * PLACES + first..][..2];
                let (flux, far) = (flux * across, flux * (across * along));
                cells[0] += flux - far;
                cells[1] += far;
            }
        }
    }

    /// `[ndf][roughness]` of basis number `basis` for a view at `cos_o`, linear RGB.
    pub(super) fn sums(&self, basis: usize, cos_o: f32) -> [[Vec3; ROUGHNESSES]; 2] {
        let sin_o = (1.0 - cos_o * cos_o).max(0.0).sqrt();
        let wo = Local(Vec3::new(sin_o, 0.0, cos_o));
        let cells = &self.cells[basis * CELLS..][..CELLS];
        Ndf::ALL.map(|ndf| {
            let passes = WEIGHTS[ndf as usize].each_ref();
            let sums = passes.map(|weights| weigh(cells, &self.lit, weights));
            std::array::from_fn(|k| {
                let [r, g, b] = sums[k / LANES].map(|channel| channel[k % LANES]);
                let masking = ndf.masking_over_cos(wo, Alpha::saturating(roughness(k)));
                Vec3::new(r, g, b) * (0.25 * masking)
            })
        })
    }
}

/// The first of four places about `x` among `count`, and Lagrange's weights for them.
#[inline]
fn lagrange(x: f32, count: usize) -> (usize, [f32; 4]) {
    let first = (x as usize).saturating_sub(1).min(count - 4);
    let t = x - first as f32;
    let (a, b, c, d) = (t, t - 1.0, t - 2.0, t - 3.0);
    (
        first,
        [
            -b * c * d / 6.0,
            a * c * d / 2.0,
            -a * b * d / 2.0,
            a * b * c / 6.0,
        ],
    )
}

/// Sums by channel and lane.
type Sums = [[f32; LANES]; 3];

/// `Σ cell · weight`, by the widest instructions that the machine has.
fn weigh(cells: &[Vec3A], lit: &[Range<u32>], weights: &Weights) -> Sums {
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
fn weigh_avx512(cells: &[Vec3A], lit: &[Range<u32>], weights: &Weights) -> Sums {
    weigh_by(cells, lit, weights, |sum, light, weight| {
        light.mul_add(weight, sum)
    })
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn weigh_avx2(cells: &[Vec3A], lit: &[Range<u32>], weights: &Weights) -> Sums {
    weigh_by(cells, lit, weights, |sum, light, weight| {
        light.mul_add(weight, sum)
    })
}

#[inline(always)]
fn weigh_by(
    cells: &[Vec3A],
    lit: &[Range<u32>],
    weights: &Weights,
    add: impl Fn(f32, f32, f32) -> f32,
) -> Sums {
    let mut sums = [[0.0; LANES]; 3];
    let rings = cells.chunks_exact(PLACES).zip(lit).zip(&weights.rings);
    for ((ring, lit), density) in rings.filter(|((_, lit), _)| !lit.is_empty()) {
        let places = as_places(lit);
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sums_are_the_brdf(cos_o in 0.2f32..1.0, x in -0.9f32..0.9, y in -0.9f32..0.9) {
            prop_assume!(x * x + y * y < 0.95);
            let wi = Local(Vec3::new(x, y, (1.0 - x * x - y * y).sqrt()));
            let wo = Local(Vec3::new((1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o));
            let wm = (wi.0 + wo.0).normalize();
            let mut cells = LobeCells::default();
            cells.clear(2);
            let reflectances = [1.0, 0.25].into_iter();
            let sin2_h = wm.x * wm.x + wm.y * wm.y;
            cells.add((sin2_h, 0.0), wi.0.z, Vec3::new(1.0, 2.0, 3.0), reflectances);
            let (sums, quarter) = (cells.sums(0, cos_o), cells.sums(1, cos_o));
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
                    prop_assert!((quarter[ndf as usize][k] * 4.0 - sum).length() <= 1e-4 * (sum.length() + peak));
                }
            }
        }
    }
}
