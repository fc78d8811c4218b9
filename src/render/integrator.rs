//! One path, guided by where light and blockers are.
//!
//! ```text
//! L(x, ω_o) = ∫ f(ω_i, ω_o; x) [ V E(ω_i) + (1 − V) L(x', −ω_i) ] (n·ω_i)+ dω_i          (Eq. 4)
//! ```
//!
//! At each surface interaction the diffuse answer of an open point comes from a table, the lobe's too
//! where the camera sees it, and one direction is drawn for the rest (see [`super::guide`]); where it
//! meets the object again, the path goes on there. Where nothing of the object rises above the surface
//! the tables have it all, and only what smooth shading sees below the surface may need a ray (see
//! [`super::lune`]). The camera's own ray sees no background.

use std::f32::consts::FRAC_1_PI;

use glam::{Mat3, Vec2, Vec3};

use super::expected_lobe::Surface;
use super::frame_light::FrameLight;
use super::guide::{Guide, Wanted};
use super::lune::Lune;
use super::patches::Patches;
use super::{RenderStats, Skip, Skips, Stage};
use crate::accel::Hit;
use crate::brdf::{Dichromatic, Fresnel};
use crate::geometry::{Frame, Local, Ray};
use crate::sampling::{SobolPath, as_points, cosine_hemisphere};

/// Where what is left to sample is expected to be a smaller part of the pixel than this, it is
/// sampled with a probability in proportion.
const NEGLIGIBLE: f32 = 0.1;
/// The smallest such probability: bounds what a wrong expectation costs.
const SMALLEST_SURVIVAL: f32 = 0.1;
/// Probability, over the lune's squared angle, that what an open point's lune hides is asked for: its
/// light is about that share of the point's, and twice it where the light is low.
const LUNE_SURVIVAL: f32 = 3.0;

/// A frame as the integrator sees it.
pub(super) struct Illuminated<'a> {
    pub(super) stage: &'a Stage,
    pub(super) light: FrameLight<'a>,
    pub(super) world_from_object: Mat3,
    pub(super) patches: &'a Patches,
    /// Largest number of surface interactions: 1 is direct light only.
    pub(super) bounces: u32,
    pub(super) skips: Skips,
}

/// Guides of the camera's hits in one pixel, by patch. Later samples of the pixel use the guide that
/// the first hit on their patch was given, if they face alike.
#[derive(Default)]
pub(super) struct PixelGuides {
    known: Vec<(u32, Guide)>,
}

impl PixelGuides {
    /// Guides kept; a pixel that sees more patches than this weighs them again.
    const KEPT: usize = 4;
}

impl Illuminated<'_> {
    /// Radiance along a camera ray that met the object at `hit`, linear RGB: an estimate unbiased
    /// but for the tables' errors, which may be negative where the object hides light that the table holds.
    pub(super) fn radiance(
        &self,
        ray: Ray,
        hit: Hit,
        guides: &mut PixelGuides,
        path: &mut SobolPath,
        stats: &mut RenderStats,
    ) -> Vec3 {
        let stage = self.stage;
        let mesh = &stage.mesh;
        let (mut ray, mut hit) = (ray, hit);
        let mut radiance = Vec3::ZERO;
        let mut throughput = Vec3::ONE;
        // What the whole path is expected to bring, summed over RGB.
        let mut expected = 0.0;
        for bounce in 1..=self.bounces {
            // The surface here. Seen from behind its shading normal it is black.
            let barycentric = Vec2::new(hit.u, hit.v);
            let frame = Frame::about(mesh.normal_at(hit.triangle, barycentric));
            let wo = frame.to_local(-ray.direction);
            if wo.cos_theta() <= 0.0 {
                break;
            }
            stats.bounces += 1;
            let brdf = stage.material.at(mesh, hit.triangle, barycentric);
            let skip_zero = self.skips.has(Skip::ZeroLobes);
            if skip_zero && (brdf.rho_d == Vec3::ZERO || brdf.rho_s == Vec3::ZERO) {
                stats.zero_lobes += 1;
            }
            let surface = Surface {
                frame,
                wo,
                brdf: &brdf,
                matte: skip_zero && brdf.rho_s == Vec3::ZERO,
            };
            let (number, spot) = self.patches.of(hit.triangle);
            let patch = self.patches.get(number, mesh, &stage.accel);
            let go_on = bounce < self.bounces;
            let side = mesh.geometric_normal(hit.triangle);
            let position = mesh.position_at(hit.triangle, barycentric);
            let mut occluded = |direction: Vec3| {
                stats.shadow_rays += 1;
                stage
                    .accel
                    .occluded(&Ray::leaving(position, side, direction), f32::INFINITY)
            };
            let blockage = |direction: Vec3, cell: usize| {
                let place = (direction, cell);
                self.patches.blocked(patch, spot, place, mesh, &stage.accel)
            };
            let to_world = |direction: Vec3| (self.world_from_object * direction).normalize();
            let facing = to_world(frame.normal);
            let tabulated_lobe = || {
                let table = stage
                    .lobe
                    .as_ref()
                    .filter(|_| bounce == 1 && !surface.matte);
                let answer = table.and_then(|table| table.at(facing, to_world(-ray.direction)));
                match answer {
                    Some(terms) => Some(lobe_of(&brdf, terms)),
                    None => (brdf.rho_s == Vec3::ZERO).then_some(Vec3::ZERO),
                }
            };
            let diffuse_of = |irradiance: Vec3| {
                if brdf.rho_d == Vec3::ZERO && skip_zero {
                    Vec3::ZERO
                } else {
                    brdf.rho_d * FRAC_1_PI * irradiance
                }
            };

            // What tables tell, and one direction for the rest, if that matters.
            let from_above = side.dot(ray.direction) < 0.0;
            // Asked for by chance, a lamp that the triangle hides would be a black pixel now and then.
            let by_tables =
                patch.convex && from_above && !self.light.has_lamp_between(frame.normal, side);
            let open = by_tables.then(&tabulated_lobe).flatten();
            let (u, other) = as_points(path.next_4d());
            let (direction, wi, density, held);
            if let Some(lobe) = open {
                // Tables have it all but what the triangle itself hides.
                let tabulated = diffuse_of(stage.irradiance.at(facing)) + lobe;
                radiance += throughput * tabulated;
                if self.skips.has(Skip::ProvenOpen) {
                    stats.proven_open += 1;
                } else {
                    radiance -= throughput * self.hidden_above(&surface, side, position, u, stats);
                }
                let Some(lune) = Lune::between(frame.normal, side) else {
                    break;
                };
                let survival = if self.skips.has(Skip::Negligible) {
                    (LUNE_SURVIVAL * lune.width * lune.width).clamp(SMALLEST_SURVIVAL, 1.0)
                } else {
                    1.0
                };
                if other.y >= survival {
                    stats.negligible += 1;
                    break;
                }
                let drawn = lune.sample(u);
                (direction, density) = (drawn.0, survival * drawn.1);
                wi = frame.to_local(direction);
                held = Held::BOTH;
            } else {
                let (light, cells) = (&self.light, &stage.cells);
                let lobe_table = bounce == 1
                    && !surface.matte
                    && stage
                        .lobe
                        .as_ref()
                        .is_some_and(|table| table.serves(wo.0.z));
                let wanted = Wanted {
                    indirect: go_on,
                    lobe_table,
                };
                let own;
                let guide = if bounce == 1 {
                    guides.of(number, &surface, || {
                        let ask: Option<&mut dyn FnMut(Vec3) -> bool> = if patch.convex {
                            None
                        } else {
                            Some(&mut occluded)
                        };
                        Guide::new(&surface, patch, light, cells, wanted, &blockage, ask)
                    })
                } else {
                    own = Guide::new(&surface, patch, light, cells, wanted, &blockage, None);
                    &own
                };

                // The answer of an open point, less the light that is mostly hidden from here.
                let left_out = guide.left_out(frame.normal);
                let lobe = guide.lobe_tabulated.then(&tabulated_lobe).flatten();
                let tabulated = throughput
                    * (diffuse_of(stage.irradiance.at(facing) - left_out)
                        + lobe.unwrap_or(Vec3::ZERO));
                radiance += tabulated;
                let to_find = guide.expected * throughput.max_element();
                if bounce == 1 {
                    expected += tabulated.element_sum().max(0.0) + to_find;
                }

                let negligible =
                    to_find < NEGLIGIBLE * expected && self.skips.has(Skip::Negligible);
                let survival = if negligible {
                    (to_find / (NEGLIGIBLE * expected)).max(SMALLEST_SURVIVAL)
                } else {
                    1.0
                };
                if other.y >= survival {
                    stats.negligible += 1;
                    break;
                }
                let Some(sampled) = guide.sample(&surface, &self.light, u, other.x) else {
                    break;
                };
                direction = sampled;
                wi = frame.to_local(direction);
                if wi.0.z <= 0.0 {
                    break;
                }
                let drawn = guide.drawn(&surface, &self.light, direction, wi);
                density = survival * drawn.density;
                held = Held {
                    diffuse: !drawn.left_out,
                    lobe: lobe.is_some(),
                };
            }
            if density <= 0.0 || wi.0.z <= 0.0 {
                break;
            }
            let reflected = brdf.eval(wi, wo) * wi.0.z;
            let tabulated = held.part(&brdf, wi, reflected);

            // Is the light seen there, or the object?
            let next_ray = Ray::leaving(position, side, direction);
            let above = side.dot(direction) > 0.0 && from_above;
            let met = if patch.convex && above && self.skips.has(Skip::ProvenOpen) {
                stats.proven_open += 1;
                None
            } else if go_on {
                stats.closest_rays += 1;
                stage.accel.closest_hit(&next_ray, f32::INFINITY).map(Some)
            } else {
                stats.shadow_rays += 1;
                stage
                    .accel
                    .occluded(&next_ray, f32::INFINITY)
                    .then_some(None)
            };
            let light = |of: Vec3| {
                if of == Vec3::ZERO {
                    return Vec3::ZERO;
                }
                of * self.light.light.radiance(position, direction) / density
            };
            match met {
                None => {
                    radiance += throughput * light(reflected - tabulated);
                    break;
                }
                Some(next) => {
                    radiance -= throughput * light(tabulated);
                    let Some(next) = next else { break };
                    throughput *= reflected / density;
                    (ray, hit) = (next_ray, next);
                }
            }
        }
        radiance
    }

    /// What the tables hold of light above an open point's plane that is hidden all the same, estimated
    /// by one ray, linear RGB: nothing, if the plane is what it is taken for.
    fn hidden_above(
        &self,
        surface: &Surface<'_>,
        side: Vec3,
        position: Vec3,
        u: Vec2,
        stats: &mut RenderStats,
    ) -> Vec3 {
        let direction = Frame::about(side).from_local(cosine_hemisphere(u));
        let wi = surface.frame.to_local(direction);
        let density = FRAC_1_PI * side.dot(direction);
        if wi.0.z <= 0.0 || density <= 0.0 {
            return Vec3::ZERO;
        }
        stats.shadow_rays += 1;
        let ray = Ray::leaving(position, side, direction);
        if !self.stage.accel.occluded(&ray, f32::INFINITY) {
            return Vec3::ZERO;
        }
        let reflected = surface.brdf.eval(wi, surface.wo) * (wi.0.z / density);
        reflected * self.light.light.radiance(position, direction)
    }
}

/// Which parts of the reflected light from a direction the tables hold.
#[derive(Clone, Copy)]
struct Held {
    diffuse: bool,
    lobe: bool,
}

impl Held {
    const BOTH: Self = Self {
        diffuse: true,
        lobe: true,
    };

    /// Their part of `reflected`, `f cos` of a material towards `wi`.
    #[inline]
    fn part(self, brdf: &Dichromatic, wi: Local, reflected: Vec3) -> Vec3 {
        let diffuse = brdf.rho_d * (FRAC_1_PI * wi.0.z);
        match (self.diffuse, self.lobe) {
            (true, true) => reflected,
            (true, false) => diffuse,
            (false, true) => reflected - diffuse,
            (false, false) => Vec3::ZERO,
        }
    }
}

/// What a material's lobe reflects, from the table's Fresnel terms, linear RGB.
#[inline]
fn lobe_of(brdf: &Dichromatic, terms: [Vec3; 2]) -> Vec3 {
    let reflected = match brdf.fresnel {
        Fresnel::Dielectric { .. } => terms[0],
        Fresnel::Schlick { f0, f90 } => f0 * terms[0] + f90 * terms[1],
    };
    brdf.rho_s * reflected
}

impl PixelGuides {
    fn of(&mut self, patch: u32, surface: &Surface<'_>, make: impl FnOnce() -> Guide) -> &Guide {
        let serves = |(known, guide): &(u32, Guide)| {
            *known == patch && guide.serves(surface.frame.normal, surface.brdf)
        };
        let place = match self.known.iter().position(serves) {
            Some(place) => place,
            None => {
                if self.known.len() == Self::KEPT {
                    self.known.remove(0);
                }
                self.known.push((patch, make()));
                self.known.len() - 1
            }
        };
        &self.known[place].1
    }
}
