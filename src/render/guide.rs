//! Where one surface point should send its samples.
//!
//! ```text
//! L = rho_d/π [I(n) − M n] + b T_s(n, ω_o) + ∫ [ V f E + (1 − V) f L' − (c f_d + b f_s) E ] (n·ω)+ dω
//! ```
//!
//! The diffuse answer of an open point, `f = f_d + f_s`, comes from a table without noise, less the
//! patches of light that are mostly hidden from here: those are left out (`c = 0` there, else 1), their
//! irradiance being linear in the normal, `M n`. The lobe's answer comes from tables too where there
//! are any and most of the light in the lobe is seen (`b = 1`, else 0). What remains to be sampled is
//! small: hidden light that is seen after all, seen light that is hidden, and the object's own light;
//! and the lobe, where it is not from a table. Three
//! techniques share the samples, in proportion to what each is expected to find: patches of light,
//! weighed by normal, lobe and blockage; blocked cells of the direction map, for light from the object
//! itself; and visible normals of the lobe. One direction is drawn from their mixture (balance
//! heuristic, Veach 1997).

use glam::{Mat3, Vec2, Vec3};

use super::direction_map::{
    CELL_RADIUS, CELL_SPREAD2, CELLS, cell_middle, cell_of, density_in_cell, direction_in,
};
use super::expected_lobe::{ExpectedLobe, Places, SAME_FACING, Surface};
use super::frame_light::FrameLight;
use super::patches::{DOUBT, Patch};
use super::weights::{PLACES, Weights, sum_of};
use crate::brdf::Dichromatic;
use crate::geometry::Local;

/// Patches of light: more follow the light closer and take longer to weigh.
pub(super) const LIGHTS: usize = PLACES;
/// Share of a technique at least, if it can find anything: keeps weights bounded where the
/// expectation is wrong.
const SMALLEST_SHARE: f32 = 0.05;
/// Share of the unoccluded light from which on a patch of light is worth a ray of its own. The shadow
/// of a lamp is sharper than the cells of the direction map: without this ray, lamps that are seen
/// through a gap made most of the noise of concave objects.
const WORTH_A_RAY: f32 = 0.02;
/// Share of it from which on a patch of light is worth asking what the spot knows.
const WORTH_ASKING: f32 = 0.002;
/// How far above the horizon a patch of light must lie whole to be left out, radians: more than the
/// angle of [`SAME_FACING`].
const CLEAR: f32 = 0.12;

/// The cells of the direction map as places to weigh.
pub(super) fn cells_as_places() -> Places {
    let mut places = Places::NOWHERE;
    for cell in 0..CELLS {
        places.set(cell, cell_middle(cell), CELL_SPREAD2, CELL_RADIUS);
    }
    places
}

/// What a guide is asked to look for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted {
    /// Whether paths go on: light of the object itself.
    pub(super) indirect: bool,
    /// Whether there is a table of the lobe's answer, so that it need not be sampled.
    pub(super) lobe_table: bool,
}

/// Where samples of one surface point go.
#[derive(Clone)]
pub(super) struct Guide {
    /// Normal that the guide was made for.
    normal: Vec3,
    /// Whether it was made for a diffuse part, and for a lobe.
    parts: [bool; 2],
    /// `∫ E ω dω` of the light left out of the table's answer, one column a channel.
    hidden_moments: Mat3,
    /// `[patch of light]` whether it is left out.
    hidden: [bool; LIGHTS],
    /// Whether the lobe's answer is to come from a table.
    pub(super) lobe_tabulated: bool,
    /// What the samples are expected to find, summed over RGB.
    pub(super) expected: f32,
    /// Shares of light patches, of blocked cells and of the lobe; they sum to 1.
    shares: [f32; 3],
    lights: Weights,
    cells: Weights,
}

impl Guide {
    /// Weighs the light for a surface on a patch. `blockage` knows better than the patch how likely a
    /// direction of a cell is blocked, and `occluded`, where it is worth it, whether the middle of a patch
    /// of light is hidden from this very point.
    pub(super) fn new(
        surface: &Surface<'_>,
        patch: &Patch,
        light: &FrameLight<'_>,
        cells: &Places,
        Wanted {
            indirect,
            lobe_table,
        }: Wanted,
        blockage: &dyn Fn(Vec3, usize) -> f32,
        mut occluded: Option<&mut dyn FnMut(Vec3) -> bool>,
    ) -> Self {
        let lobe = ExpectedLobe::new(surface);
        let mut reflected = lobe.expect(&light.places);

        // What hides each patch of light; the few that matter most are asked for here.
        let mut blocked: [f32; LIGHTS] =
            std::array::from_fn(|k| patch.blocked[usize::from(light.cell[k])]);
        if !patch.convex {
            let open: [f32; LIGHTS] = std::array::from_fn(|k| {
                (reflected.diffuse[k] + reflected.specular[k]) * light.flux[k]
            });
            let sum = sum_of(&open);
            for k in 0..LIGHTS {
                if open[k] <= WORTH_ASKING * sum {
                    continue;
                }
                let direction = light.places.direction(k);
                blocked[k] = blockage(direction, usize::from(light.cell[k]));
                if let Some(occluded) = &mut occluded
                    && open[k] > WORTH_A_RAY * sum
                {
                    let here = f32::from(u8::from(occluded(direction)));
                    let doubt = (light.places.radius[k] * 4.0).min(0.5);
                    let told = here + (blocked[k] - here) * doubt;
                    blocked[k] = told.clamp(DOUBT, 1.0 - DOUBT);
                }
            }
        }

        // How much of the lobe's light is seen.
        let (mut seen, mut unseen) = (0.0, 0.0);
        for (k, blocked) in blocked.iter().enumerate() {
            let light = reflected.specular[k] * light.flux[k];
            unseen += blocked * light;
            seen += (1.0 - blocked) * light;
        }
        let lobe_tabulated = lobe_table && seen > unseen;

        // Light patches: the lobe where they are seen, or are not if a table has it; the diffuse part
        // where seen ones are not, and hidden ones are.
        let normal = surface.frame.normal;
        let mut weights = [0.0; LIGHTS];
        let mut hidden = [false; LIGHTS];
        let mut hidden_moments = Mat3::ZERO;
        for k in 0..LIGHTS {
            let blocked = blocked[k];
            if blocked > 0.5 && light.clusters.has_small_texels() {
                let cos = light.places.direction(k).dot(normal);
                hidden[k] = cos > light.places.radius[k] + CLEAR;
            }
            let wanted = if hidden[k] {
                hidden_moments += light.moments[k];
                1.0 - blocked
            } else {
                blocked
            };
            let of_lobe = if lobe_tabulated {
                blocked
            } else {
                1.0 - blocked
            };
            reflected.specular[k] *= of_lobe * light.flux[k];
            weights[k] = reflected.diffuse[k] * wanted * light.flux[k] + reflected.specular[k];
        }
        let glints = sum_of(&reflected.specular);
        let lights = Weights::new(weights);

        // Blocked cells: what the object sends there is about its albedo times the mean light.
        let mut weights = [0.0; CELLS];
        let mut mirrored = 0.0;
        if indirect {
            let reflected = lobe.expect(cells);
            let scale = light.mean * lobe.albedo() * 4.0 * std::f32::consts::PI / CELLS as f32;
            for (cell, weight) in weights.iter_mut().enumerate() {
                let sent = patch.blocked[cell] * scale;
                *weight = (reflected.diffuse[cell] + reflected.specular[cell]) * sent;
                mirrored += reflected.specular[cell] * sent;
            }
        }
        let cells = Weights::new(weights);

        // The lobe takes half of what it could find, of the light and of the object; expectation over
        // whole patches of light and whole cells is poor for narrow lobes.
        let lobes = if lobe.specular > 0.0 {
            0.5 * (glints + mirrored) + 1e-30
        } else {
            0.0
        };
        let rest = |sum: f32, part: f32| sum - (0.5 * part).min(0.5 * sum);
        let found = [rest(lights.sum, glints), rest(cells.sum, mirrored), lobes];
        let mut guide = Self {
            normal,
            parts: parts_of(surface.brdf),
            hidden_moments,
            hidden,
            lobe_tabulated,
            expected: lights.sum + cells.sum,
            shares: [0.0; 3],
            lights,
            cells,
        };
        let sum: f32 = found.iter().sum();
        if sum > 0.0 {
            let shares = found.map(|f| {
                if f > 0.0 {
                    (f / sum).max(SMALLEST_SHARE)
                } else {
                    0.0
                }
            });
            let total: f32 = shares.iter().sum();
            guide.shares = shares.map(|s| s / total);
        }
        guide
    }

    /// A direction (unit, object frame) from the mixture; `u` a well-spread point, `choice` picks the
    /// technique.
    #[inline]
    pub(super) fn sample(
        &self,
        surface: &Surface<'_>,
        light: &FrameLight<'_>,
        u: Vec2,
        choice: f32,
    ) -> Option<Vec3> {
        let [lights, cells, lobe] = self.shares;
        if choice < lights {
            let (k, x) = self.lights.invert(u.x);
            let direction = light.clusters.sample(k, Vec2::new(x, u.y), choice / lights);
            Some(light.to_object(direction))
        } else if choice < lights + cells {
            let (cell, x) = self.cells.invert(u.x);
            Some(direction_in(cell, Vec2::new(x, u.y)))
        } else if lobe > 0.0 {
            let wi = surface.brdf.sample_specular(
                surface.wo,
                ((choice - lights - cells) / lobe).clamp(0.0, 1.0),
                u,
            )?;
            Some(surface.frame.from_local(wi).normalize())
        } else {
            None
        }
    }

    /// Whether another point of the patch may use this guide: one that faces nearly as the guide's
    /// own did and reflects in the same ways. A guide made for a black point has nothing to offer.
    #[inline]
    pub(super) fn serves(&self, normal: Vec3, brdf: &Dichromatic) -> bool {
        normal.dot(self.normal) > SAME_FACING
            && self.parts == parts_of(brdf)
            && self.shares != [0.0; 3]
    }

    /// Irradiance of the light that is left out, which the table's answer holds, at a normal that the
    /// guide serves, linear RGB.
    #[inline]
    pub(super) fn left_out(&self, normal: Vec3) -> Vec3 {
        self.hidden_moments.transpose() * normal
    }

    /// What is known of a `direction` (unit, object frame), `wi` in the surface's own frame, that
    /// [`Guide::sample`] returned.
    #[inline]
    pub(super) fn drawn(
        &self,
        surface: &Surface<'_>,
        light: &FrameLight<'_>,
        direction: Vec3,
        wi: Local,
    ) -> Drawn {
        let [lights, cells, lobe] = self.shares;
        let (patch, within) = light.clusters.density(light.to_probe(direction));
        let mut density = 0.0;
        if lights > 0.0 {
            density += lights * self.lights.share(patch) * within;
        }
        if cells > 0.0 {
            density += cells * self.cells.share(cell_of(direction)) * density_in_cell(direction);
        }
        if lobe > 0.0 {
            density += lobe * surface.brdf.pdf_specular(wi, surface.wo);
        }
        Drawn {
            density,
            left_out: self.hidden[patch],
        }
    }
}

/// Whether a material has a diffuse part, and a lobe.
#[inline]
fn parts_of(brdf: &Dichromatic) -> [bool; 2] {
    [brdf.rho_d, brdf.rho_s].map(|albedo| albedo != Vec3::ZERO)
}

/// A direction of the mixture.
pub(super) struct Drawn {
    /// Of the mixture, per steradian.
    pub(super) density: f32,
    /// Whether the light there is left out of the table's answer.
    pub(super) left_out: bool,
}

#[cfg(test)]
mod tests {
    use glam::Mat3;

    use super::*;
    use crate::brdf::{Alpha, Fresnel};
    use crate::geometry::Frame;
    use crate::image::RgbImage;
    use crate::probe::{Environment, LightClusters};
    use crate::sampling::{SobolPath, as_points};

    /// A sky with a lamp, and a patch of which one side is blocked.
    fn surroundings() -> (Environment, Patch) {
        let mut pixels: Vec<[f32; 3]> = (0..64 * 32)
            .map(|i| [0.3 + 0.2 * ((i % 64) as f32 * 0.2).sin(), 0.4, 0.5])
            .collect();
        pixels[9 * 64 + 30] = [800.0, 700.0, 600.0];
        let image = RgbImage {
            width: 64,
            height: 32,
            pixels,
        };
        let patch = Patch::known(std::array::from_fn(|cell| {
            if cell_middle(cell).x > 0.3 {
                0.97
            } else {
                0.03
            }
        }));
        (Environment::new(image, 0.4).unwrap().0, patch)
    }

    #[test]
    fn density_is_that_of_the_samples() {
        // The mean of 1/density over samples that fall into a part of the hemisphere is the part's
        // solid angle: each octant above the horizon has π/2.
        let (environment, patch) = surroundings();
        let clusters = LightClusters::new(&environment, LIGHTS);
        let turn = Mat3::from_rotation_y(0.8);
        let light = FrameLight::new(&environment, &clusters, turn);
        let cells = cells_as_places();
        for (alpha, rho_s, indirect) in [
            (0.2, 2.35, true),
            (0.05, 20.0, true),
            (0.4, 0.0, true),
            (0.3, 2.35, false),
        ] {
            {
                let brdf = Dichromatic {
                    rho_d: Vec3::new(0.4, 0.3, 0.2),
                    rho_s: Vec3::splat(rho_s),
                    alpha: Alpha::new(alpha).unwrap(),
                    ggx: 0.5,
                    fresnel: Fresnel::PAPER,
                };
                let frame = Frame::about(Vec3::new(0.2, 0.9, 0.3).normalize());
                let surface = Surface {
                    frame,
                    wo: Local(Vec3::new(0.5, 0.2, 0.8).normalize()),
                    brdf: &brdf,
                    matte: false,
                };
                let known = |_: Vec3, cell: usize| patch.blocked[cell];
                let wanted = Wanted {
                    indirect,
                    lobe_table: false,
                };
                let guide = Guide::new(&surface, &patch, &light, &cells, wanted, &known, None);
                let n = 1 << 16;
                let mut octants = [(0.0f64, 0.0f64); 4];
                for index in 0..n {
                    let (u, other) = as_points(SobolPath::new(5, 0, 0, index).next_4d());
                    let Some(direction) = guide.sample(&surface, &light, u, other.x) else {
                        continue;
                    };
                    let wi = frame.to_local(direction);
                    if wi.0.z <= 0.0 {
                        continue;
                    }
                    // The light is dim where it is sampled least; weigh by the cosine and the sky.
                    let density = guide.drawn(&surface, &light, direction, wi).density;
                    assert!(density > 0.0);
                    let value = f64::from(wi.0.z / density);
                    let octant =
                        &mut octants[usize::from(wi.0.x > 0.0) + 2 * usize::from(wi.0.y > 0.0)];
                    octant.0 += value;
                    octant.1 += value * value;
                }
                for (sum, squares) in octants {
                    let n = f64::from(n);
                    let mean = sum / n;
                    let sigma = ((squares / n - mean * mean) / n).sqrt();
                    let expected = std::f64::consts::PI / 4.0;
                    assert!(
                        (mean - expected).abs() < 4.0 * sigma + 1e-3 && sigma < 0.05,
                        "alpha {alpha} rho_s {rho_s}: {mean} ± {sigma}"
                    );
                }
            }
        }
    }

    #[test]
    fn black_surfaces_draw_nothing() {
        let (environment, patch) = surroundings();
        let clusters = LightClusters::new(&environment, LIGHTS);
        let light = FrameLight::new(&environment, &clusters, Mat3::IDENTITY);
        let brdf = Dichromatic {
            rho_d: Vec3::ZERO,
            rho_s: Vec3::ZERO,
            alpha: Alpha::MAX,
            ggx: 1.0,
            fresnel: Fresnel::PAPER,
        };
        let surface = Surface {
            frame: Frame::about(Vec3::Y),
            wo: Local(Vec3::Z),
            brdf: &brdf,
            matte: false,
        };
        let known = |_: Vec3, cell: usize| patch.blocked[cell];
        let guide = Guide::new(
            &surface,
            &patch,
            &light,
            &cells_as_places(),
            Wanted {
                indirect: true,
                lobe_table: false,
            },
            &known,
            None,
        );
        assert_eq!(guide.expected, 0.0);
        assert!(
            guide
                .sample(&surface, &light, Vec2::splat(0.5), 0.5)
                .is_none()
        );
    }
}
