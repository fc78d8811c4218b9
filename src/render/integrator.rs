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
use super::patches::{Patch, Patches};
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

/// A surface that a path meets.
struct Interaction<'a> {
    surface: Surface<'a>,
    /// Its patch, what is known of that, and the spot within.
    number: u32,
    patch: &'a Patch,
    spot: u32,
    /// Normal of the triangle, and place on it.
    side: Vec3,
    position: Vec3,
    /// Normal and direction that it is seen from, unit, world frame.
    facing: Vec3,
    towards: Vec3,
    /// Whether it is seen from the triangle's own side.
    from_above: bool,
    /// Number on the path, from 1.
    bounce: u32,
}

/// What tables tell of an interaction, and the direction that the rest is asked of, if it matters.
struct Answer {
    /// Reflected radiance, linear RGB.
    tabulated: Vec3,
    next: Option<Next>,
}

/// A direction in which a path goes on.
struct Next {
    /// Unit, object frame and the surface's own.
    direction: Vec3,
    wi: Local,
    /// Per steradian, survival included.
    density: f32,
    held: Held,
}

/// What a path carries.
struct Carried {
    throughput: Vec3,
    /// What the whole path is expected to bring, summed over RGB.
    expected: f32,
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
        let (stage, mesh) = (self.stage, &self.stage.mesh);
        let (mut ray, mut hit) = (ray, hit);
        let mut radiance = Vec3::ZERO;
        let mut carried = Carried {
            throughput: Vec3::ONE,
            expected: 0.0,
        };
        for bounce in 1..=self.bounces {
            let barycentric = Vec2::new(hit.u, hit.v);
            let frame = Frame::about(mesh.normal_at(hit.triangle, barycentric));
            let wo = frame.to_local(-ray.direction);
            // Seen from behind its shading normal a surface is black.
            if wo.cos_theta() <= 0.0 {
                break;
            }
            stats.bounces += 1;
            let brdf = stage.material.at(mesh, hit.triangle, barycentric);
            let skip_zero = self.skips.has(Skip::ZeroLobes);
            if skip_zero && (brdf.rho_d == Vec3::ZERO || brdf.rho_s == Vec3::ZERO) {
                stats.zero_lobes += 1;
            }
            let (number, spot) = self.patches.of(hit.triangle);
            let side = mesh.geometric_normal(hit.triangle);
            let to_world = |direction: Vec3| (self.world_from_object * direction).normalize();
            let at = Interaction {
                surface: Surface {
                    frame,
                    wo,
                    brdf: &brdf,
                    matte: skip_zero && brdf.rho_s == Vec3::ZERO,
                },
                number,
                patch: self.patches.get(number, mesh, &stage.accel),
                spot,
                side,
                position: mesh.position_at(hit.triangle, barycentric),
                facing: to_world(frame.normal),
                towards: to_world(-ray.direction),
                from_above: side.dot(ray.direction) < 0.0,
                bounce,
            };

            // Asked for by chance, a lamp that the triangle hides would be a black pixel now and then.
            let by_tables = at.patch.convex
                && at.from_above
                && !self.light.has_lamp_between(frame.normal, side);
            let sample = as_points(path.next_4d());
            let lobe = by_tables.then(|| self.tabulated_lobe(&at)).flatten();
            let answer = match lobe {
                Some(lobe) => self.by_tables(&at, lobe, sample, stats),
                None => self.by_guide(&at, guides, sample, &mut carried, stats),
            };
            radiance += carried.throughput * answer.tabulated;
            let Some(next) = answer.next else { break };
            if next.density <= 0.0 || next.wi.0.z <= 0.0 {
                break;
            }
            let reflected = brdf.eval(next.wi, wo) * next.wi.0.z;
            let tabulated = next.held.part(&brdf, next.wi, reflected);

            // Is the light seen there, or the object?
            let light = |of: Vec3| {
                if of == Vec3::ZERO {
                    return Vec3::ZERO;
                }
                let light = self.light.light.radiance(at.position, next.direction);
                of * light / next.density
            };
            let next_ray = Ray::leaving(at.position, side, next.direction);
            match self.meets(&at, &next_ray, stats) {
                Met::Light => {
                    radiance += carried.throughput * light(reflected - tabulated);
                    break;
                }
                Met::Object(next_hit) => {
                    radiance -= carried.throughput * light(tabulated);
                    let Some(next_hit) = next_hit else { break };
                    carried.throughput *= reflected / next.density;
                    (ray, hit) = (next_ray, next_hit);
                }
            }
        }
        radiance
    }

    /// Tables have all of an open point's light but what the triangle itself hides.
    #[inline]
    fn by_tables(
        &self,
        at: &Interaction<'_>,
        lobe: Vec3,
        (u, other): (Vec2, Vec2),
        stats: &mut RenderStats,
    ) -> Answer {
        let irradiance = self.stage.irradiance.at(at.facing);
        let mut tabulated = self.diffuse_of(at.surface.brdf, irradiance) + lobe;
        if self.skips.has(Skip::ProvenOpen) {
            stats.proven_open += 1;
        } else {
            tabulated -= self.hidden_above(&at.surface, at.side, at.position, u, stats);
        }
        let normal = at.surface.frame.normal;
        let Some(lune) = Lune::between(normal, at.side) else {
            let next = None;
            return Answer { tabulated, next };
        };
        let survival = if self.skips.has(Skip::Negligible) {
            (LUNE_SURVIVAL * lune.width * lune.width).clamp(SMALLEST_SURVIVAL, 1.0)
        } else {
            1.0
        };
        let next = survives(survival, other.y, stats).then(|| {
            let (direction, density) = lune.sample(u);
            Next {
                direction,
                wi: at.surface.frame.to_local(direction),
                density: survival * density,
                held: Held::BOTH,
            }
        });
        Answer { tabulated, next }
    }

    /// The answer of an open point, less the light that is mostly hidden from here, and a direction that
    /// a guide draws for the rest.
    #[inline]
    fn by_guide(
        &self,
        at: &Interaction<'_>,
        guides: &mut PixelGuides,
        (u, other): (Vec2, Vec2),
        carried: &mut Carried,
        stats: &mut RenderStats,
    ) -> Answer {
        let (stage, surface) = (self.stage, &at.surface);
        let (mesh, accel) = (&stage.mesh, &stage.accel);
        let is_first = at.bounce == 1;
        let mut occluded = |direction: Vec3| {
            stats.shadow_rays += 1;
            let ray = Ray::leaving(at.position, at.side, direction);
            accel.occluded(&ray, f32::INFINITY)
        };
        let blockage = |direction: Vec3, cell: usize| {
            let place = (direction, cell);
            self.patches.blocked(at.patch, at.spot, place, mesh, accel)
        };
        let lobe_tables = stage.lobe.as_ref().filter(|_| is_first && !surface.matte);
        let wanted = Wanted {
            indirect: at.bounce < self.bounces,
            lobe_table: lobe_tables.is_some_and(|table| table.serves(surface.wo.0.z)),
        };
        let (light, cells) = (&self.light, &stage.cells);
        let own;
        let guide = if is_first {
            guides.of(at.number, surface, || {
                let ask: Option<&mut dyn FnMut(Vec3) -> bool> = if at.patch.convex {
                    None
                } else {
                    Some(&mut occluded)
                };
                Guide::new(surface, at.patch, light, cells, wanted, &blockage, ask)
            })
        } else {
            own = Guide::new(surface, at.patch, light, cells, wanted, &blockage, None);
            &own
        };

        let irradiance = stage.irradiance.at(at.facing) - guide.left_out(surface.frame.normal);
        let lobe = (guide.lobe_tabulated.then(|| self.tabulated_lobe(at))).flatten();
        let tabulated = self.diffuse_of(surface.brdf, irradiance) + lobe.unwrap_or(Vec3::ZERO);
        let to_find = guide.expected * carried.throughput.max_element();
        if is_first {
            let known = carried.throughput * tabulated;
            carried.expected += known.element_sum().max(0.0) + to_find;
        }

        let least = NEGLIGIBLE * carried.expected;
        let survival = if to_find < least && self.skips.has(Skip::Negligible) {
            (to_find / least).max(SMALLEST_SURVIVAL)
        } else {
            1.0
        };
        if !survives(survival, other.y, stats) {
            let next = None;
            return Answer { tabulated, next };
        }
        let sampled = guide.sample(surface, light, u, other.x);
        let above = sampled.map(|direction| (direction, surface.frame.to_local(direction)));
        let next = above.filter(|(_, wi)| wi.0.z > 0.0).map(|(direction, wi)| {
            let drawn = guide.drawn(surface, light, direction, wi);
            Next {
                direction,
                wi,
                density: survival * drawn.density,
                held: Held {
                    diffuse: !drawn.left_out,
                    lobe: lobe.is_some(),
                },
            }
        });
        Answer { tabulated, next }
    }

    /// What an open point's lobe reflects to the camera, linear RGB; `None` where no table knows.
    #[inline]
    fn tabulated_lobe(&self, at: &Interaction<'_>) -> Option<Vec3> {
        let brdf = at.surface.brdf;
        let table = self.stage.lobe.as_ref();
        let table = table.filter(|_| at.bounce == 1 && !at.surface.matte);
        match table.and_then(|table| table.at(at.facing, at.towards)) {
            Some(terms) => Some(lobe_of(brdf, terms)),
            None => (brdf.rho_s == Vec3::ZERO).then_some(Vec3::ZERO),
        }
    }

    /// What a material reflects diffusely of an irradiance, linear RGB.
    #[inline]
    fn diffuse_of(&self, brdf: &Dichromatic, irradiance: Vec3) -> Vec3 {
        if brdf.rho_d == Vec3::ZERO && self.skips.has(Skip::ZeroLobes) {
            Vec3::ZERO
        } else {
            brdf.rho_d * FRAC_1_PI * irradiance
        }
    }

    /// What a ray that leaves an interaction meets.
    #[inline]
    fn meets(&self, at: &Interaction<'_>, ray: &Ray, stats: &mut RenderStats) -> Met {
        let accel = &self.stage.accel;
        let above = at.side.dot(ray.direction) > 0.0 && at.from_above;
        if at.patch.convex && above && self.skips.has(Skip::ProvenOpen) {
            stats.proven_open += 1;
            Met::Light
        } else if at.bounce < self.bounces {
            stats.closest_rays += 1;
            let hit = accel.closest_hit(ray, f32::INFINITY);
            hit.map_or(Met::Light, |hit| Met::Object(Some(hit)))
        } else {
            stats.shadow_rays += 1;
            if accel.occluded(ray, f32::INFINITY) {
                Met::Object(None)
            } else {
                Met::Light
            }
        }
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

/// Whether a path goes on, by its probability and a uniform number.
#[inline]
fn survives(probability: f32, uniform: f32, stats: &mut RenderStats) -> bool {
    let survives = uniform < probability;
    stats.negligible += u64::from(!survives);
    survives
}

/// What a ray meets.
enum Met {
    Light,
    /// The object, and where if the path may go on.
    Object(Option<Hit>),
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
