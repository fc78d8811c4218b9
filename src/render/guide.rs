//! Where one surface point should send its samples.
//!
//! ```text
//! L = rho_d/π [I(n) − M n] + ∫ [ V f E + (1 − V) f L' − c f_d E ] (n·ω)+ dω,   f = f_d + f_s
//! ```
//!
//! The diffuse answer of an open point comes from a table without noise, less the patches of light that
//! are mostly hidden from here: those are left out (`c = 0` there, else 1), their irradiance being
//! linear in the normal, `M n`. What remains to be sampled is small: the lobe where the light is seen,
//! hidden light that is seen after all, seen light that is hidden, and the object's own light. Three
//! techniques share the samples, in proportion to what each is expected to find: patches of light,
//! weighed by normal, lobe and blockage; blocked cells of the direction map, for light from the object
//! itself; and visible normals of the lobe. One direction is drawn from their mixture (balance
//! heuristic, Veach 1997).

use glam::{Mat3, Vec2, Vec3};

use super::patches::{CELLS, DOUBT, Patch, SIDE, cell_middle};
use crate::brdf::Dichromatic;
use crate::geometry::{Frame, Local, direction_from_octahedral, octahedral_from_direction};
use crate::probe::{Environment, LightClusters, TurnedLight};

/// Patches of light: more follow the light closer and take longer to weigh.
pub(super) const LIGHTS: usize = CELLS;
/// Share of a technique at least, if it can find anything: keeps weights bounded where the
/// expectation is wrong.
const SMALLEST_SHARE: f32 = 0.05;
/// Share of the unoccluded light from which on a patch of light is worth a ray of its own. The shadow
/// of a lamp is sharper than the cells of the direction map: without this ray, lamps that are seen
/// through a gap made most of the noise of concave objects.
const WORTH_A_RAY: f32 = 0.02;
/// Cosine between the normals of a guide and of a point that it still serves, and that angle, radians.
const SAME_FACING: f32 = 0.995;
const SAME_FACING_ANGLE: f32 = 0.1;
/// How far above the horizon a patch of light must lie whole to be left out, radians: more than the
/// angle of [`SAME_FACING`].
const CLEAR: f32 = 0.12;

/// The light of one frame as the guides see it, object frame.
pub(super) struct FrameLight<'a> {
    clusters: &'a LightClusters,
    pub(super) light: TurnedLight<'a>,
    probe_from_object: Mat3,
    object_from_probe: Mat3,
    /// `[patch of light]`
    directions: [[f32; LIGHTS]; 3],
    flux: [f32; LIGHTS],
    spread2: [f32; LIGHTS],
    radius: [f32; LIGHTS],
    moments: Vec<Mat3>,
    cell: [u16; LIGHTS],
    /// Mean radiance, summed over RGB.
    mean: f32,
}

impl<'a> FrameLight<'a> {
    pub(super) fn new(
        environment: &'a Environment,
        clusters: &'a LightClusters,
        world_from_object: Mat3,
    ) -> Self {
        let probe_from_object = environment.world_from_probe().transpose() * world_from_object;
        let mut frame_light = Self {
            clusters,
            light: environment.turned(world_from_object),
            probe_from_object,
            object_from_probe: probe_from_object.transpose(),
            directions: [[0.0; LIGHTS], [0.0; LIGHTS], [1.0; LIGHTS]],
            flux: [0.0; LIGHTS],
            spread2: [0.0; LIGHTS],
            radius: [0.0; LIGHTS],
            moments: vec![Mat3::ZERO; LIGHTS],
            cell: [0; LIGHTS],
            mean: 0.0,
        };
        for k in 0..clusters.len().min(LIGHTS) {
            let patch = clusters.patch(k);
            let direction = frame_light.object_from_probe * patch.direction;
            for (axis, values) in frame_light.directions.iter_mut().enumerate() {
                values[k] = direction[axis];
            }
            frame_light.flux[k] = patch.flux;
            frame_light.spread2[k] = patch.spread2;
            frame_light.radius[k] = patch.radius;
            frame_light.moments[k] = frame_light.object_from_probe * patch.moments;
            frame_light.cell[k] = cell_of(direction) as u16;
            frame_light.mean += patch.flux / (4.0 * std::f32::consts::PI);
        }
        frame_light
    }
}

/// The cell of the direction map that holds a direction.
#[inline]
fn cell_of(direction: Vec3) -> usize {
    let place = octahedral_from_direction(direction) * SIDE as f32;
    let index = |x: f32| (x as usize).min(SIDE - 1);
    index(place.y) * SIDE + index(place.x)
}

/// Middles of the cells, `[axis][cell]`.
pub(super) struct CellMiddles([[f32; CELLS]; 3]);

impl CellMiddles {
    pub(super) fn new() -> Self {
        let mut middles = [[0.0; CELLS]; 3];
        for cell in 0..CELLS {
            let middle = cell_middle(cell);
            for (axis, coordinates) in middles.iter_mut().enumerate() {
                coordinates[cell] = middle[axis];
            }
        }
        Self(middles)
    }
}

/// Where samples of one surface point go.
#[derive(Clone)]
pub(super) struct Guide {
    /// Normal that the guide was made for.
    normal: Vec3,
    /// `∫ E ω dω` of the light left out of the table's answer, one column a channel.
    hidden_moments: Mat3,
    /// `[patch of light]` whether it is left out.
    hidden: [bool; LIGHTS],
    /// What the samples are expected to find, summed over RGB.
    pub(super) expected: f32,
    /// Shares of light patches, of blocked cells and of the lobe; they sum to 1.
    shares: [f32; 3],
    lights: Weights,
    cells: Weights,
}

/// The surface that a guide is for.
pub(super) struct Surface<'a> {
    pub(super) frame: Frame,
    pub(super) wo: Local,
    pub(super) brdf: &'a Dichromatic,
}

impl Guide {
    /// Weighs the light for a surface on a patch. `indirect` tells whether paths go on; `occluded`,
    /// where it is worth it, whether the middle of a patch of light is hidden from this very point.
    pub(super) fn new(
        surface: &Surface<'_>,
        patch: &Patch,
        light: &FrameLight<'_>,
        middles: &CellMiddles,
        indirect: bool,
        occluded: Option<&mut dyn FnMut(Vec3) -> bool>,
    ) -> Self {
        let lobe = ExpectedLobe::new(surface);
        let (mut diffuse, mut specular) = ([0.0; CELLS], [0.0; CELLS]);

        lobe.expect(
            &light.directions,
            &light.spread2,
            &light.radius,
            &mut diffuse,
            &mut specular,
        );

        // What hides each patch of light; the few that matter most are asked for here.
        let mut blocked: [f32; LIGHTS] =
            std::array::from_fn(|k| patch.blocked[usize::from(light.cell[k])]);
        if let Some(occluded) = occluded {
            let open: [f32; LIGHTS] =
                std::array::from_fn(|k| (diffuse[k] + specular[k]) * light.flux[k]);
            let matters = WORTH_A_RAY * sum_of(&open);
            for k in 0..LIGHTS {
                if open[k] > matters {
                    let direction = Vec3::from([0, 1, 2].map(|axis| light.directions[axis][k]));
                    let here = f32::from(u8::from(occluded(direction)));
                    let told = here + (blocked[k] - here) * (light.radius[k] * 4.0).min(0.5);
                    blocked[k] = told.clamp(DOUBT, 1.0 - DOUBT);
                }
            }
        }

        // Light patches: the lobe where they are seen; the diffuse part where seen ones are not, and
        // hidden ones are.
        let normal = surface.frame.normal;
        let mut weights = [0.0; LIGHTS];
        let mut hidden = [false; LIGHTS];
        let mut hidden_moments = Mat3::ZERO;
        for k in 0..LIGHTS {
            let blocked = blocked[k];
            if blocked > 0.5 && light.clusters.has_small_texels() {
                let cos = (0..3)
                    .map(|axis| light.directions[axis][k] * normal[axis])
                    .sum::<f32>();
                hidden[k] = cos > light.radius[k] + CLEAR;
            }
            let wanted = if hidden[k] {
                hidden_moments += light.moments[k];
                1.0 - blocked
            } else {
                blocked
            };
            specular[k] *= (1.0 - blocked) * light.flux[k];
            weights[k] = diffuse[k] * wanted * light.flux[k] + specular[k];
        }
        let glints = sum_of(&specular);
        let lights = Weights::new(weights);

        // Blocked cells: what the object sends there is about its albedo times the mean light.
        let mut weights = [0.0; CELLS];
        if indirect {
            lobe.expect(
                &middles.0,
                &[CELL_SPREAD2; CELLS],
                &[CELL_RADIUS; CELLS],
                &mut diffuse,
                &mut specular,
            );
            let glow = light.mean * surface.brdf.rho_d.element_sum().clamp(0.1, 3.0) / 3.0;
            let scale = glow * 4.0 * std::f32::consts::PI / CELLS as f32;
            for cell in 0..CELLS {
                weights[cell] = (diffuse[cell] + specular[cell]) * patch.blocked[cell] * scale;
            }
        }
        let cells = Weights::new(weights);

        // The lobe takes half of what it could find; expectation over whole patches of light is poor
        // for narrow lobes.
        let lobes = if lobe.specular > 0.0 {
            0.5 * glints + 1e-30
        } else {
            0.0
        };
        let found = [lights.sum - lobes.min(0.5 * lights.sum), cells.sum, lobes];
        let mut guide = Self {
            normal,
            hidden_moments,
            hidden,
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
            Some((light.object_from_probe * direction).normalize())
        } else if choice < lights + cells {
            let (cell, x) = self.cells.invert(u.x);
            let corner = Vec2::new((cell % SIDE) as f32, (cell / SIDE) as f32);
            Some(direction_from_octahedral(
                (corner + Vec2::new(x, u.y)) / SIDE as f32,
            ))
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
    /// own did. A guide made for a black point has nothing to offer to others.
    #[inline]
    pub(super) fn serves(&self, normal: Vec3) -> bool {
        normal.dot(self.normal) > SAME_FACING && self.shares != [0.0; 3]
    }

    /// Irradiance of the light that is left out, which the table's answer holds, at a normal that the
    /// guide serves, linear RGB.
    #[inline]
    pub(super) fn left_out(&self, normal: Vec3) -> Vec3 {
        self.hidden_moments.transpose() * normal
    }

    /// Whether the light in a direction (unit, object frame) is left out.
    #[inline]
    pub(super) fn is_hidden(&self, light: &FrameLight<'_>, direction: Vec3) -> bool {
        self.hidden[light.clusters.of(light.probe_from_object * direction)]
    }

    /// Density with which [`Guide::sample`] returns `direction`, per steradian.
    #[inline]
    pub(super) fn density(
        &self,
        surface: &Surface<'_>,
        light: &FrameLight<'_>,
        direction: Vec3,
        wi: Local,
    ) -> f32 {
        let [lights, cells, lobe] = self.shares;
        let mut density = 0.0;
        if lights > 0.0 {
            let (k, within) = light.clusters.density(light.probe_from_object * direction);
            density += lights * self.lights.share(k) * within;
        }
        if cells > 0.0 {
            // A cell's square has area (2/SIDE)² on the octahedron |x| + |y| + |z| = 1, whose
            // area element in (x, y) covers |p|^-3 of solid angle.
            let p = 1.0 / direction.abs().element_sum();
            let solid_angle = 4.0 / CELLS as f32 * (1.0 / (p * p * p));
            density += cells * self.cells.share(cell_of(direction)) / solid_angle;
        }
        if lobe > 0.0 {
            density += lobe * surface.brdf.pdf_specular(wi, surface.wo);
        }
        density
    }
}

/// Squared spread of a cell of the direction map, radians².
const CELL_SPREAD2: f32 = 4.0 * std::f32::consts::PI / CELLS as f32 / 6.0;

/// How far from its middle a cell reaches, as a chord.
const CELL_RADIUS: f32 = 0.27;
/// What a patch of light that only reaches above the horizon counts, as a share of its reach. Without
/// it, the brightest texels were drawn once in millions where their patch's middle was just below.
const REACH: f32 = 0.1;

/// What a surface reflects of a patch of light, roughly.
struct ExpectedLobe {
    normal: Vec3,
    wo: Vec3,
    cos_o: f32,
    diffuse: f32,
    specular: f32,
    f0: f32,
    a2: f32,
}

impl ExpectedLobe {
    fn new(surface: &Surface<'_>) -> Self {
        let brdf = surface.brdf;
        let f0 = brdf.fresnel.eval(1.0).element_sum() / 3.0;
        Self {
            normal: surface.frame.normal,
            wo: surface.frame.from_local(surface.wo),
            cos_o: surface.wo.0.z.max(1e-3),
            diffuse: brdf.rho_d.element_sum() / (3.0 * std::f32::consts::PI),
            specular: brdf.rho_s.element_sum() / 3.0,
            f0,
            a2: brdf.alpha.get() * brdf.alpha.get(),
        }
    }

    /// Diffuse and specular `f cos` towards patches of light about `directions`, the lobe (taken for
    /// GGX's) widened by each patch's spread.
    #[inline]
    fn expect(
        &self,
        directions: &[[f32; LIGHTS]; 3],
        spread2: &[f32; LIGHTS],
        radius: &[f32; LIGHTS],
        diffuse: &mut [f32; LIGHTS],
        specular: &mut [f32; LIGHTS],
    ) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            #[expect(unsafe_code, reason = "the processor was just asked for AVX2")]
            // SAFETY: AVX2 is present.
            return unsafe { self.expect_avx2(directions, spread2, radius, diffuse, specular) };
        }
        self.expect_any(directions, spread2, radius, diffuse, specular);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn expect_avx2(
        &self,
        directions: &[[f32; LIGHTS]; 3],
        spread2: &[f32; LIGHTS],
        radius: &[f32; LIGHTS],
        diffuse: &mut [f32; LIGHTS],
        specular: &mut [f32; LIGHTS],
    ) {
        self.expect_any(directions, spread2, radius, diffuse, specular);
    }

    #[inline(always)]
    fn expect_any(
        &self,
        [x, y, z]: &[[f32; LIGHTS]; 3],
        spread2: &[f32; LIGHTS],
        radius: &[f32; LIGHTS],
        diffuse: &mut [f32; LIGHTS],
        specular: &mut [f32; LIGHTS],
    ) {
        let (n, o) = (self.normal, self.wo);
        let scale = self.specular / (4.0 * std::f32::consts::PI * self.cos_o);
        for k in 0..LIGHTS {
            let cos = x[k] * n.x + y[k] * n.y + z[k] * n.z;
            // A patch across the horizon still sends some light, and one whose middle is well below
            // may reach above it.
            let spread = spread2[k].sqrt();
            let lit = (0.5 * (cos + spread)).max(0.0).min(spread).max(cos);
            let lit = lit.max(REACH * (cos + radius[k] + SAME_FACING_ANGLE));
            let length2 = (2.0 + 2.0 * (x[k] * o.x + y[k] * o.y + z[k] * o.z)).max(1e-4);
            let along = cos + self.cos_o;
            let cos2 = (along * along / length2).min(1.0);
            let a2 = self.a2 + 0.5 * spread2[k] / length2;
            let q = 1.0 - cos2 + a2 * cos2;
            let m = 1.0 - 0.5 * length2.sqrt();
            let m2 = m * m;
            let fresnel = self.f0 + (1.0 - self.f0) * m2 * m2 * m;
            let masking = 2.0 * lit / (lit + (lit * lit + self.a2).sqrt() + 1e-6);
            diffuse[k] = self.diffuse * lit;
            specular[k] = scale * fresnel * masking * a2 / (q * q);
        }
    }
}

/// Weights to draw from, in groups, so that neither building nor searching is a long chain.
#[derive(Clone)]
struct Weights {
    each: [f32; LIGHTS],
    groups: [f32; GROUPS],
    sum: f32,
}

/// Groups of weights, and weights in a group.
const GROUPS: usize = 16;

impl Weights {
    fn new(each: [f32; LIGHTS]) -> Self {
        let groups = std::array::from_fn(|g| sum_of(&each[g * GROUPS..(g + 1) * GROUPS]));
        let sum = groups.iter().sum();
        Self { each, groups, sum }
    }

    /// The weight that holds the quantile `u`, and where in it, in [0, 1).
    #[inline]
    fn invert(&self, u: f32) -> (usize, f32) {
        let mut rest = u * self.sum;
        let mut group = 0;
        while group + 1 < GROUPS && rest >= self.groups[group] {
            rest -= self.groups[group];
            group += 1;
        }
        let mut k = group * GROUPS;
        let last = k + GROUPS - 1;
        while k < last && rest >= self.each[k] {
            rest -= self.each[k];
            k += 1;
        }
        // Rounding may carry the last quantiles past the last weight.
        while k > 0 && self.each[k] == 0.0 {
            k -= 1;
        }
        let width = self.each[k];
        let place = if width > 0.0 { rest / width } else { 0.5 };
        (k, place.clamp(0.0, 1.0 - f32::EPSILON / 2.0))
    }

    /// Probability of weight `k`.
    #[inline]
    fn share(&self, k: usize) -> f32 {
        self.each[k] / self.sum
    }
}

/// Sum in eight lanes.
#[inline]
fn sum_of(values: &[f32]) -> f32 {
    let mut lanes = [0.0; 8];
    for eight in values.chunks_exact(8) {
        for (lane, value) in lanes.iter_mut().zip(eight) {
            *lane += value;
        }
    }
    lanes.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::{Alpha, Fresnel};
    use crate::image::RgbImage;
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
        let patch = Patch {
            blocked: std::array::from_fn(|cell| {
                if cell_middle(cell).x > 0.3 {
                    0.97
                } else {
                    0.03
                }
            }),
            convex: false,
        };
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
        let middles = CellMiddles::new();
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
                };
                let guide = Guide::new(&surface, &patch, &light, &middles, indirect, None);
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
                    let density = guide.density(&surface, &light, direction, wi);
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
        };
        let guide = Guide::new(&surface, &patch, &light, &CellMiddles::new(), true, None);
        assert_eq!(guide.expected, 0.0);
        assert!(
            guide
                .sample(&surface, &light, Vec2::splat(0.5), 0.5)
                .is_none()
        );
    }

    #[test]
    fn cells_reach_no_farther_than_stated() {
        for cell in 0..CELLS {
            for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                let corner = Vec2::new((cell % SIDE) as f32 + x, (cell / SIDE) as f32 + y);
                let corner = direction_from_octahedral(corner / SIDE as f32);
                assert!(
                    (corner - cell_middle(cell)).length() < CELL_RADIUS,
                    "{cell}"
                );
            }
        }
    }

    #[test]
    fn last_quantiles_never_reach_empty_weights() {
        for filled in 1..LIGHTS {
            let weight = |k: usize| {
                if k < filled {
                    0.1 + (k as f32 * 0.7).sin().abs()
                } else {
                    0.0
                }
            };
            let weights = Weights::new(std::array::from_fn(weight));
            for below in 1..64 {
                let u = 1.0 - below as f32 * f32::EPSILON / 2.0;
                assert!(weights.invert(u).0 < filled, "{filled} {below}");
            }
        }
    }

    #[test]
    fn weights_are_drawn_by_their_share() {
        let weights = Weights::new(std::array::from_fn(
            |k| if k % 3 == 0 { 0.0 } else { k as f32 },
        ));
        let n = 100_000;
        let mut counts = [0.0f32; LIGHTS];
        for i in 0..n {
            let (k, place) = weights.invert((i as f32 + 0.5) / n as f32);
            assert!((0.0..1.0).contains(&place));
            counts[k] += 1.0 / n as f32;
        }
        for (k, count) in counts.into_iter().enumerate() {
            assert!((count - weights.share(k)).abs() < 5e-5, "{k}");
        }
    }
}
