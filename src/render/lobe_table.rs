//! What the lobe of an open point reflects: tables over the mirror direction, one for each of some views.
//!
//! ```text
//! T_s(v, r) = G1(v)/(4 n·v) Q(v, n),   n = (r + v)/|r + v|
//! Q(v, n) = ∫ E(ω) F(ω·h) D(n·h; alpha) G1(ω; alpha) dω,   h = (ω + v)/|ω + v|
//! ```
//!
//! Camera and light stand still in the world frame, so one set of tables serves every frame. Views form a
//! lattice of triangles over the directions that the camera looks along; at a fixed mirror direction the
//! lobe changes slowly with the view, and the three nearest tables are mixed linearly, after division by
//! what a lobe in uniform light would do. In each table `Q` is a smooth function of the normal, which
//! lies on the stereographic plane about the view: there is no crease, not even where the surface is
//! seen edge on. Blocks of entries are made when a path first looks there, each from its own place
//! alone, so the result does not depend on the order.

use std::sync::OnceLock;

use glam::{Vec2, Vec3, Vec3A};

use super::lobe_block::{LobeShape, SIDE, block};
use crate::brdf::{Alpha, Ndf, dielectric};
use crate::geometry::{Frame, Local, lagrange};
use crate::probe::LightPyramid;

/// Narrowest lobe that a table is worth its entries for.
const NARROWEST: f32 = 0.03;
/// Distance of entries over alpha, radians between normals seen face on; half of that edge on.
const SPACING: f32 = 0.4;
/// The same for the widest lobes: the cosine of light across the horizon is no smoother.
const WIDEST_SPACING: f32 = 0.06;
/// Roughness below which a lobe is narrow: its entries are many, and cost most.
const NARROW: f32 = 0.1;
/// Distance of views, radians, for narrow lobes and others: the largest share of what error is left, in
/// the median 0.05 % and 0.03 %; twice as far, four times that.
const VIEW_SPACING: [f32; 2] = [0.08, 0.06];
/// [`LobeShape::finest_share`] for narrow lobes and others: errors of 0.05 % in the median.
const FINEST_SHARE: [f32; 2] = [1e-4, 3e-5];
/// Cosine to the view below which tables are not asked: a mirror direction nearly opposite to the view
/// belongs to different normals for neighbouring views. At 0.12, 1 % of points were off by up to 30 %.
const GRAZING: f32 = 0.15;
/// Largest distance from the plane's middle of the normals in a table, as tan θ/2: edge on.
const EDGE: f32 = 1.0;
/// Cells along a block's side.
const CELLS: usize = SIDE - 3;

/// The tables.
#[derive(Debug)]
pub(super) struct LobeTable {
    pyramid: LightPyramid,
    shape: LobeShape,
    /// Distance of lattice points on the stereographic plane, where half an angle is about its tangent.
    lattice_step: f32,
    /// Reflectance of the Fresnel terms face on.
    face_on: [f32; 2],
    /// The direction to the camera in the middle of the lattice.
    middle: Frame,
    /// Lattice points along a side.
    across: usize,
    views: Vec<OnceLock<Box<ViewTable>>>,
}

/// The table of one view.
#[derive(Debug)]
struct ViewTable {
    view: Frame,
    blocks: Vec<OnceLock<Box<[Vec3A]>>>,
}

impl LobeTable {
    /// Tables, empty yet, for the directions to the camera, unit, world frame, of which `middle` is one
    /// in the midst; `None` where the lobe is too narrow or they spread too far.
    pub(super) fn new(
        pyramid: LightPyramid,
        (alpha, ndf, eta): (Alpha, Ndf, Option<f32>),
        middle: Vec3,
        views: impl Iterator<Item = Vec3>,
    ) -> Option<Self> {
        if alpha.get() < NARROWEST {
            return None;
        }
        let width = usize::from(alpha.get() >= NARROW);
        let shape = LobeShape {
            ndf,
            alpha,
            eta,
            finest_share: FINEST_SHARE[width],
        };
        let lattice_step = 0.5 * VIEW_SPACING[width];
        let middle = Frame::about(middle);
        let reach = views
            .map(|view| plane_from_direction(&middle, view).map(Vec2::length))
            .try_fold(0.0, |reach, length| Some(f32::max(reach, length?)))?;
        // The lattice's axes are skew: it takes 1 + 1/√3 as many steps along the first.
        let half = (1.58 * reach / lattice_step).ceil() as usize + 2;
        let across = 2 * half + 1;
        let face_on = match shape.eta {
            Some(eta) => [dielectric(1.0, eta), 0.0],
            None => [1.0, 0.0],
        };
        Some(Self {
            pyramid,
            shape,
            lattice_step,
            face_on,
            middle,
            across,
            views: (0..across * across).map(|_| OnceLock::new()).collect(),
        })
    }

    /// Whether the tables may know what a point reflects whose cosine to the view is `cos_o`.
    #[inline]
    pub(super) fn serves(&self, cos_o: f32) -> bool {
        cos_o >= GRAZING
    }

    /// `[term]` `T_s` of each Fresnel term for a surface facing `normal` seen from `wo`, unit, world
    /// frame, linear RGB; `None` where no table serves.
    #[inline]
    pub(super) fn at(&self, normal: Vec3, wo: Vec3) -> Option<[Vec3; 2]> {
        let cos_o = normal.dot(wo).min(1.0);
        if !self.serves(cos_o) {
            return None;
        }
        let mirror = 2.0 * cos_o * normal - wo;

        // The triangle of views about this one.
        let place = plane_from_direction(&self.middle, wo)? / self.lattice_step;
        let row = place.y * (2.0 / f32::sqrt(3.0));
        let origin = (self.across / 2) as f32;
        let skew = Vec2::new(place.x - 0.5 * row, row) + origin;
        let last = (self.across - 2) as f32;
        if !(skew.min_element() >= 0.0 && skew.max_element() < last) {
            return None;
        }
        let (column, row) = (skew.x as usize, skew.y as usize);
        let within = skew - Vec2::new(column as f32, row as f32);
        let first = row * self.across + column;
        let sum = within.x + within.y;
        let (nearest, third) = if sum < 1.0 {
            ((first, 1.0 - sum), (within.x, within.y))
        } else {
            let far = first + self.across + 1;
            ((far, sum - 1.0), (1.0 - within.y, 1.0 - within.x))
        };
        let corners = [
            nearest,
            (first + 1, third.0),
            (first + self.across, third.1),
        ];

        let mut answer = [Vec3A::ZERO; 2];
        for (number, share) in corners {
            let table = self.views[number].get_or_init(|| Box::new(self.view(number)));
            self.add(table, mirror, share, &mut answer)?;
        }
        let (sin_o, smooth) = ((1.0 - cos_o * cos_o).sqrt(), self.uniform(cos_o));
        let local = Local(Vec3::new(sin_o, 0.0, cos_o));
        let masking = self.shape.ndf.masking_over_cos(local, self.shape.alpha);
        Some([0, 1].map(|term| {
            let value = answer[term] * (0.25 * masking * smooth[term]);
            value.max(Vec3A::ZERO).into()
        }))
    }

    /// Adds a share of one view's answer.
    #[inline]
    fn add(
        &self,
        table: &ViewTable,
        mirror: Vec3,
        share: f32,
        answer: &mut [Vec3A; 2],
    ) -> Option<()> {
        let axes = &table.view;
        let twice_half = mirror + axes.normal;
        let length = twice_half.length();
        // The normal (r + v)/|r + v|, projected from the point opposite to the view.
        let local = axes.to_local(twice_half).0;
        let place = Vec2::new(local.x, local.y) / (length + local.z);
        let step = 0.5 * self.spacing();
        let across = self.blocks_across();
        let cells = (place + EDGE) / (step * CELLS as f32);
        if !(cells.min_element() >= 0.0 && cells.max_element() < across as f32) {
            return None;
        }
        let (column, row) = (cells.x as usize, cells.y as usize);
        let number = row * across + column;
        let entries = table.blocks[number].get_or_init(|| self.block(table, number));

        let within = (cells - Vec2::new(column as f32, row as f32)) * CELLS as f32;
        let column = (within.x as usize).min(CELLS - 1);
        let row = (within.y as usize).min(CELLS - 1);
        let (along, down) = (
            lagrange(within.x - column as f32),
            lagrange(within.y - row as f32),
        );
        let first = row * SIDE + column;
        let smooth = self.uniform(0.5 * length);
        for term in 0..self.shape.terms() {
            let entries = &entries[term * SIDE * SIDE..][..SIDE * SIDE];
            let mut sum = Vec3A::ZERO;
            for (row, down) in down.into_iter().enumerate() {
                let four = &entries[first + row * SIDE..][..4];
                let row = four[0] * along[0] + four[1] * along[1];
                sum += (row + four[2] * along[2] + four[3] * along[3]) * down;
            }
            answer[term] += sum * (share / smooth[term]);
        }
        Some(())
    }

    /// About what `Q` is in uniform light, `F G1(v) n·v`, by Fresnel term: smooth, and never zero.
    #[inline]
    fn uniform(&self, cos: f32) -> [f32; 2] {
        let a2 = self.shape.alpha.get() * self.shape.alpha.get();
        let cos = cos.clamp(0.0, 1.0);
        let masked = cos * cos / (cos + (a2 + (1.0 - a2) * cos * cos).sqrt());
        let m = 1.0 - cos;
        let s = (m * m) * (m * m) * m;
        let terms = match self.shape.eta {
            Some(_) => [self.face_on[0] + (1.0 - self.face_on[0]) * s, 1.0],
            None => [1.0 - s, s + 0.02],
        };
        terms.map(|term| term * masked)
    }

    fn spacing(&self) -> f32 {
        (SPACING * self.shape.alpha.get()).min(WIDEST_SPACING)
    }

    /// Blocks along the plane's side.
    fn blocks_across(&self) -> usize {
        (2.0 * EDGE / (0.5 * self.spacing() * CELLS as f32)).ceil() as usize
    }

    /// The empty table of lattice point `number`.
    fn view(&self, number: usize) -> ViewTable {
        let origin = (self.across / 2) as f32;
        let row = (number / self.across) as f32 - origin;
        let column = (number % self.across) as f32 - origin;
        let place = Vec2::new(column + 0.5 * row, row * (0.5 * f32::sqrt(3.0)));
        let view = direction_from_plane(&self.middle, place * self.lattice_step);
        ViewTable {
            view: Frame::about(view),
            blocks: (0..self.blocks_across().pow(2))
                .map(|_| OnceLock::new())
                .collect(),
        }
    }

    /// Makes block `number` of a view.
    fn block(&self, table: &ViewTable, number: usize) -> Box<[Vec3A]> {
        let (across, step) = (self.blocks_across(), 0.5 * self.spacing());
        let first = Vec2::new((number % across) as f32, (number / across) as f32) * CELLS as f32;
        let entries = std::array::from_fn(|k| {
            // One entry before the first cell.
            let entry = Vec2::new((k % SIDE) as f32 - 1.0, (k / SIDE) as f32 - 1.0);
            direction_from_plane(&table.view, (first + entry) * step - EDGE)
        });
        block(&self.pyramid, &self.shape, table.view.normal, &entries)
    }
}

/// Stereographic projection about the frame's normal; `None` beyond a right angle.
#[inline]
fn plane_from_direction(frame: &Frame, direction: Vec3) -> Option<Vec2> {
    let local = frame.to_local(direction).0;
    (local.z > 0.0).then(|| Vec2::new(local.x, local.y) / (1.0 + local.z))
}

/// The inverse of [`plane_from_direction`], everywhere on the sphere but opposite to the normal.
fn direction_from_plane(frame: &Frame, place: Vec2) -> Vec3 {
    let square = place.length_squared();
    let local = Vec3::new(2.0 * place.x, 2.0 * place.y, 1.0 - square) / (1.0 + square);
    frame.from_local(Local(local)).normalize()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::{DVec3, Mat3};
    use rayon::prelude::*;

    use super::*;
    use crate::brdf::{Dichromatic, Fresnel};
    use crate::geometry::direction_from_latlong;
    use crate::image::RgbImage;
    use crate::probe::Environment;
    use crate::sampling::{SobolPath, as_points};

    /// Directions, world frame, and the flux that comes from each: `parts` by `parts` a texel.
    fn light_of(environment: &Environment, parts: usize) -> Vec<(Vec3, Vec3)> {
        let light = environment.turned(Mat3::IDENTITY);
        let image = environment.image();
        let (width, height) = (parts * image.width, parts * image.height);
        let edge = |row: usize| (std::f64::consts::PI * row as f64 / height as f64).cos();
        (0..width * height)
            .into_par_iter()
            .map(|i| {
                let (column, row) = (i % width, i / width);
                let uv = Vec2::new(
                    (column as f32 + 0.5) / width as f32,
                    (row as f32 + 0.5) / height as f32,
                );
                let solid_angle =
                    std::f64::consts::TAU / width as f64 * (edge(row) - edge(row + 1));
                let direction = environment.world_from_probe() * direction_from_latlong(uv);
                let radiance = light.radiance(Vec3::ZERO, direction);
                (direction, radiance * solid_angle as f32)
            })
            .collect()
    }

    /// `∫ f_s E (n·ω)+ dω`, part by part of the texels.
    fn integral(light: &[(Vec3, Vec3)], lobe: &Dichromatic, normal: Vec3, view: Vec3) -> Vec3 {
        let frame = Frame::about(normal);
        let wo = frame.to_local(view);
        let mut sum = DVec3::ZERO;
        for (direction, flux) in light {
            let wi = frame.to_local(*direction);
            if wi.0.z > 0.0 {
                sum += (lobe.eval(wi, wo) * wi.0.z * *flux).as_dvec3();
            }
        }
        sum.as_vec3()
    }

    fn lobe(alpha: Alpha, ndf: Ndf, fresnel: Fresnel) -> Dichromatic {
        Dichromatic {
            rho_d: Vec3::ZERO,
            rho_s: Vec3::ONE,
            alpha,
            ggx: f32::from(u8::from(ndf == Ndf::Ggx)),
            fresnel,
        }
    }

    /// Views within 10° of a direction, and a normal that each sees, evenly over the image of a sphere.
    fn queries(middle: Vec3, count: u32) -> Vec<(Vec3, Vec3)> {
        let around = Frame::about(middle);
        let disc = |u: Vec2, radius: f32| {
            Vec2::from_angle(std::f32::consts::TAU * u.x) * (radius * u.y.sqrt())
        };
        (0..count)
            .map(|index| {
                let (u, other) = as_points(SobolPath::new(4, 0, 0, index).next_4d());
                let view = direction_from_plane(&around, disc(u, 0.087));
                let p = disc(other, (1.0 - GRAZING * GRAZING).sqrt() - 1e-4);
                let local = Local(p.extend((1.0 - p.length_squared()).sqrt()));
                (view, Frame::about(view).from_local(local))
            })
            .collect()
    }

    #[test]
    fn table_is_the_integral() {
        let middle = Vec3::new(0.2, 0.3, 0.9).normalize();
        let queries = queries(middle, 20);
        let probes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/probes");
        for name in ["interior.exr", "courtyard.exr", "city.exr", "studio.exr"] {
            let image = RgbImage::read(&probes.join(name)).unwrap();
            let (environment, _) = Environment::new(image, 0.3).unwrap();
            let pyramid = LightPyramid::new(&environment);
            let lights = [1, 2].map(|parts| light_of(&environment, parts));
            for (alpha, light) in [(0.05, &lights[1]), (0.2, &lights[0]), (0.5, &lights[0])] {
                for ndf in Ndf::ALL {
                    let alpha = Alpha::new(alpha).unwrap();
                    let lobe = lobe(alpha, ndf, Fresnel::PAPER);
                    let views = queries.iter().map(|(view, _)| *view);
                    let shape = (alpha, ndf, Some(1.3));
                    let table = LobeTable::new(pyramid.clone(), shape, middle, views).unwrap();
                    let pair = |(view, normal): &(Vec3, Vec3)| {
                        let exact = integral(light, &lobe, *normal, *view);
                        (table.at(*normal, *view).unwrap()[0], exact)
                    };
                    let pairs: Vec<(Vec3, Vec3)> = queries.par_iter().map(pair).collect();
                    // Where a point is darker than a tenth of the mean, its error is the mean's.
                    let sum: f32 = pairs.iter().map(|(_, exact)| exact.length()).sum();
                    let floor = 0.1 * sum / pairs.len() as f32;
                    let mut errors: Vec<f32> = pairs
                        .iter()
                        .map(|(found, exact)| (*found - exact).length() / (exact.length() + floor))
                        .collect();
                    errors.sort_by(f32::total_cmp);
                    let case = format!("{name}, {ndf:?}, {alpha:?}: {errors:?}");
                    assert!(errors[10] < 1.5e-3 && errors[17] < 0.01, "{case}");
                    assert!(errors[19] < 0.05, "{case}");
                }
            }
        }
    }

    #[test]
    fn uniform_light_gives_the_albedo_of_either_fresnel_term() {
        let image = RgbImage::constant(64, 32, [1.0, 2.0, 0.5]);
        let (environment, _) = Environment::new(image, 0.0).unwrap();
        let pyramid = LightPyramid::new(&environment);
        let light = light_of(&environment, 8);
        let middle = Vec3::new(-0.3, 0.5, 0.6).normalize();
        let (f0, f90) = (Vec3::new(0.9, 0.5, 0.3), 0.8);
        for alpha in [0.08, 0.3, 1.0] {
            for ndf in Ndf::ALL {
                let alpha = Alpha::new(alpha).unwrap();
                let lobe = lobe(alpha, ndf, Fresnel::Schlick { f0, f90 });
                let queries = queries(middle, 8);
                let views = queries.iter().map(|(view, _)| *view);
                let table =
                    LobeTable::new(pyramid.clone(), (alpha, ndf, None), middle, views).unwrap();
                for (view, normal) in queries {
                    let exact = integral(&light, &lobe, normal, view);
                    let terms = table.at(normal, view).unwrap();
                    let found = f0 * terms[0] + f90 * terms[1];
                    let error = (found - exact).length() / exact.length();
                    assert!(error < 0.01, "{ndf:?} {alpha:?}: {error}");
                }
            }
        }
    }

    #[test]
    fn narrow_lobes_have_no_table_and_no_view_is_too_far() {
        let image = RgbImage::constant(8, 4, [1.0; 3]);
        let (environment, _) = Environment::new(image, 0.0).unwrap();
        let pyramid = LightPyramid::new(&environment);
        let table = |alpha: f32, views: &[Vec3]| {
            let shape = (Alpha::new(alpha).unwrap(), Ndf::Ggx, Some(1.3));
            LobeTable::new(pyramid.clone(), shape, Vec3::Z, views.iter().copied())
        };
        assert!(table(0.01, &[Vec3::Z]).is_none());
        assert!(table(0.2, &[Vec3::Z, Vec3::NEG_Z]).is_none());
        let near = table(0.2, &[Vec3::Z]).unwrap();
        assert!(near.at(Vec3::Z, Vec3::Z).is_some());
        assert!(near.at(Vec3::X, Vec3::X).is_none());
        assert!(
            near.at(Vec3::Z, Vec3::new(0.995, 0.0, 0.1).normalize())
                .is_none()
        );
    }
}
