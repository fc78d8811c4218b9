//! Where one surface point should send its samples.
//!
//! ```text
//! L = c · rho_d/π I(n) + ∫ [ V f E + (1 − V) f L' − c f_d E ] (n·ω)+ dω,   f = f_d + f_s
//! ```
//!
//! for any constant `c`. With `c = 1` the diffuse answer of an open point comes from a table without
//! noise, and what is left to sample is the lobe where the light is seen and the loss where it is not;
//! `c = 0` suits points in hollows. Three techniques share the samples, in proportion to what each is
//! expected to find: patches of light, weighed by normal, lobe and blockage; blocked cells of the
//! direction map, for light from the object itself; and visible normals of the lobe. One direction is
//! drawn from their mixture (balance heuristic, Veach 1997).

use glam::{Mat3, Vec2, Vec3};

use super::patches::{CELLS, Patch, SIDE};
use crate::brdf::Dichromatic;
use crate::geometry::{Frame, Local, direction_from_octahedral, octahedral_from_direction};
use crate::probe::{Environment, LightClusters, TurnedLight};

/// Patches of light: more follow the light closer and take longer to weigh.
pub(super) const LIGHTS: usize = 256;
/// Share of a technique at least, if it can find anything: keeps weights bounded where the
/// expectation is wrong.
const SMALLEST_SHARE: f32 = 0.05;
/// Beyond this blocked share of the hemisphere the open part is sampled instead of the loss.
const CLOSED: f32 = 0.4;

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
            cell: [0; LIGHTS],
            mean: 0.0,
        };
        for k in 0..clusters.len().min(LIGHTS) {
            let (direction, flux, spread2) = clusters.patch(k);
            let direction = frame_light.object_from_probe * direction;
            for (axis, values) in frame_light.directions.iter_mut().enumerate() {
                values[k] = direction[axis];
            }
            frame_light.flux[k] = flux;
            frame_light.spread2[k] = spread2;
            frame_light.cell[k] = cell_of(direction) as u16;
            frame_light.mean += flux / (4.0 * std::f32::consts::PI);
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
            let corner = Vec2::new((cell % SIDE) as f32, (cell / SIDE) as f32);
            let middle = direction_from_octahedral((corner + 0.5) / SIDE as f32);
            for axis in 0..3 {
                middles[axis][cell] = middle[axis];
            }
        }
        Self(middles)
    }
}

/// Where samples of one surface point go.
#[derive(Clone)]
pub(super) struct Guide {
    /// Whether the diffuse answer of an open point is taken from the table (`c`).
    pub(super) control: bool,
    /// What the samples are expected to find, summed over RGB.
    pub(super) expected: f32,
    /// Shares of light patches, of blocked cells and of the lobe; they sum to 1.
    shares: [f32; 3],
    /// Running sums of weights.
    light_ends: [f32; LIGHTS],
    cell_ends: [f32; CELLS],
}

/// The surface that a guide is for.
pub(super) struct Surface<'a> {
    pub(super) frame: Frame,
    pub(super) wo: Local,
    pub(super) brdf: &'a Dichromatic,
}

impl Guide {
    /// Weighs the light for a surface on a patch. `indirect` tells whether paths go on.
    pub(super) fn new(
        surface: &Surface<'_>,
        patch: &Patch,
        light: &FrameLight<'_>,
        middles: &CellMiddles,
        indirect: bool,
    ) -> Self {
        let control = patch.closed < CLOSED;
        let lobe = ExpectedLobe::new(surface);
        let mut blocked = [0.0; LIGHTS];
        for (blocked, &cell) in blocked.iter_mut().zip(&light.cell) {
            *blocked = patch.blocked[usize::from(cell)];
        }

        // Light patches: the lobe where they are seen, the diffuse part where they are not (or the
        // other way round without control).
        let mut diffuse = [0.0; LIGHTS];
        let mut specular = [0.0; LIGHTS];
        for k in 0..LIGHTS {
            let [x, y, z] = [0, 1, 2].map(|axis| light.directions[axis][k]);
            let (d, s) = lobe.expect(x, y, z, light.spread2[k]);
            let wanted = if control { blocked[k] } else { 1.0 - blocked[k] };
            diffuse[k] = d * wanted * light.flux[k];
            specular[k] = s * (1.0 - blocked[k]) * light.flux[k];
        }
        let mut guide = Self {
            control,
            expected: 0.0,
            shares: [0.0; 3],
            light_ends: [0.0; LIGHTS],
            cell_ends: [0.0; CELLS],
        };
        let (mut lights, mut glints) = (0.0, 0.0);
        for k in 0..LIGHTS {
            lights += diffuse[k] + specular[k];
            glints += specular[k];
            guide.light_ends[k] = lights;
        }

        // Blocked cells: what the object sends there is about its albedo times the mean light.
        let mut cells = 0.0;
        if indirect {
            let glow = light.mean * surface.brdf.rho_d.element_sum().clamp(0.1, 3.0) / 3.0;
            let mut weights = [0.0; CELLS];
            for cell in 0..CELLS {
                let [x, y, z] = [0, 1, 2].map(|axis| middles.0[axis][cell]);
                let (d, s) = lobe.expect(x, y, z, CELL_SPREAD2);
                weights[cell] = (d + s) * patch.blocked[cell];
            }
            let scale = glow * 4.0 * std::f32::consts::PI / CELLS as f32;
            for cell in 0..CELLS {
                cells += weights[cell] * scale;
                guide.cell_ends[cell] = cells;
            }
        }

        // The lobe takes half of what it could find; expectation over whole patches of light is poor
        // for narrow lobes.
        let lobes = if lobe.specular > 0.0 { 0.5 * glints + 1e-30 } else { 0.0 };
        let found = [lights - lobes.min(0.5 * lights), cells, lobes];
        guide.expected = lights + cells;
        let sum: f32 = found.iter().sum();
        if sum > 0.0 {
            let shares = found.map(|f| if f > 0.0 { (f / sum).max(SMALLEST_SHARE) } else { 0.0 });
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
            let (k, x) = invert(&self.light_ends, u.x);
            let direction = light.clusters.sample(k, Vec2::new(x, u.y), choice / lights);
            Some((light.object_from_probe * direction).normalize())
        } else if choice < lights + cells {
            let (cell, x) = invert(&self.cell_ends, u.x);
            let corner = Vec2::new((cell % SIDE) as f32, (cell / SIDE) as f32);
            Some(direction_from_octahedral(
                (corner + Vec2::new(x, u.y)) / SIDE as f32,
            ))
        } else if lobe > 0.0 {
            let wi = surface.brdf.sample_specular(surface.wo, ((choice - lights - cells) / lobe).clamp(0.0, 1.0), u)?;
            Some(surface.frame.from_local(wi).normalize())
        } else {
            None
        }
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
            density += lights * share(&self.light_ends, k) * within;
        }
        if cells > 0.0 {
            // A cell's square has area (2/SIDE)² on the octahedron |x| + |y| + |z| = 1, whose
            // area element in (x, y) covers |p|^-3 of solid angle.
            let p = 1.0 / direction.abs().element_sum();
            let solid_angle = 4.0 / CELLS as f32 * (1.0 / (p * p * p));
            density += cells * share(&self.cell_ends, cell_of(direction)) / solid_angle;
        }
        if lobe > 0.0 {
            density += lobe * surface.brdf.pdf_specular(wi, surface.wo);
        }
        density
    }
}

/// Squared spread of a cell of the direction map, radians².
const CELL_SPREAD2: f32 = 4.0 * std::f32::consts::PI / CELLS as f32 / 6.0;

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

    /// Diffuse and specular `f cos` towards a patch, the lobe (taken for GGX's) widened by the
    /// patch's spread.
    #[inline(always)]
    fn expect(&self, x: f32, y: f32, z: f32, spread2: f32) -> (f32, f32) {
        let spread = spread2.sqrt();
        let cos = x * self.normal.x + y * self.normal.y + z * self.normal.z;
        // A patch across the horizon still sends some light.
        let lit = (0.5 * (cos + spread)).clamp(0.0, spread).max(cos);
        let length2 = (2.0 + 2.0 * (x * self.wo.x + y * self.wo.y + z * self.wo.z)).max(1e-4);
        let along = cos + self.cos_o;
        let cos2 = (along * along / length2).min(1.0);
        let a2 = self.a2 + 0.5 * spread2 / length2;
        let q = 1.0 - cos2 + a2 * cos2;
        let m = 1.0 - 0.5 * length2.sqrt();
        let m2 = m * m;
        let fresnel = self.f0 + (1.0 - self.f0) * m2 * m2 * m;
        let masking = 2.0 * lit / (lit + (lit * lit + self.a2).sqrt() + 1e-6);
        let shape = a2 / (std::f32::consts::PI * q * q);
        (
            self.diffuse * lit,
            self.specular * fresnel * masking * shape / (4.0 * self.cos_o),
        )
    }
}

/// The interval of rising sums that holds the quantile `u`, and where in it.
#[inline]
fn invert(ends: &[f32], u: f32) -> (usize, f32) {
    let wanted = u * ends[ends.len() - 1];
    let i = ends.partition_point(|&end| end <= wanted).min(ends.len() - 1);
    let low = if i == 0 { 0.0 } else { ends[i - 1] };
    let width = ends[i] - low;
    let place = if width > 0.0 { (wanted - low) / width } else { 0.5 };
    (i, place.clamp(0.0, 1.0 - f32::EPSILON / 2.0))
}

/// Probability of interval `i`.
#[inline]
fn share(ends: &[f32], i: usize) -> f32 {
    let low = if i == 0 { 0.0 } else { ends[i - 1] };
    (ends[i] - low) / ends[ends.len() - 1]
}
