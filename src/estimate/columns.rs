//! The forward model at one surface point: diffuse and specular traces for unit albedos.

use glam::{Mat3, Vec3};

use super::interreflection::Glow;
use super::light_cut::{LightCut, Lobe, to_object};
use super::lobe_sums::NodeArrays;
use super::visibility::Visibility;
use crate::brdf::dielectric;
use crate::probe::{LightNode, LightPyramid};
use crate::traces::{Observation, Trace};

/// Number of roughness values at which specular traces are computed.
pub(super) const ROUGHNESSES: usize = 28;
/// Ends of the range of roughness: below 0.01 a lobe is narrower than a probe's texels.
const RANGE: (f32, f32) = (0.01, 1.0);

/// Roughness number `k` of the grid, even in the logarithm. Steps of 19 % leave an error of cubic
/// interpolation of 1.3e-3 of a trace's peak (test
/// `traces_between_roughnesses_are_those_of_the_integral`).
pub(super) fn roughness(k: usize) -> f32 {
    RANGE.0 * (RANGE.1 / RANGE.0).powf(k as f32 / (ROUGHNESSES - 1) as f32)
}

/// The traces of a point for unit albedos, `[observations]`.
#[derive(Default)]
pub(super) struct Columns {
    /// `T_d`, linear RGB.
    pub(super) diffuse: Vec<Vec3>,
    /// `T_s`, `[ndf][observation · ROUGHNESSES + k]`, linear RGB.
    specular: [Vec<Vec3>; 2],
    /// `[observations]` variance of the normal over the pixel's patch, radian² per axis.
    normal_variance: Vec<f32>,
}

/// What a forward model takes into account.
pub(super) struct ForwardModel<'a> {
    /// The light's quadtree, world frame.
    pub(super) pyramid: &'a LightPyramid,
    /// Nodes for diffuse reflection, world frame.
    pub(super) diffuse_nodes: Vec<LightNode>,
    /// `[frames]` rotation of the object.
    pub(super) world_from_object: &'a [Mat3],
    /// Fresnel's index.
    pub(super) eta: f32,
    /// Budget of light nodes per observation.
    pub(super) light_nodes: usize,
    /// Cosine of the largest angle to the mirror direction, if directions are limited (the paper).
    pub(super) window_cos: Option<f32>,
    /// Whether the normals' variance over a pixel widens the lobe.
    pub(super) footprints: bool,
}

/// Light at a point from about one direction.
#[derive(Clone, Copy)]
pub(super) struct Arrival {
    /// Towards the light, unit, object frame.
    pub(super) direction: Vec3,
    /// Radiance × solid angle, linear RGB.
    pub(super) flux: Vec3,
}

/// Working memory, one a thread.
#[derive(Default)]
pub(super) struct Scratch {
    /// What arrives at a point in one frame, for diffuse reflection.
    arriving: Vec<Arrival>,
    /// Of this, what the object throws.
    glow: Vec<Arrival>,
    cut: LightCut,
    nodes: NodeArrays,
    sums: [Vec<Vec3>; 2],
}

impl<'a> ForwardModel<'a> {
    /// Number of static nodes for diffuse reflection. The cosine is smooth: 512 nodes leave 0.1 % in
    /// the median, 0.3 % in nine of ten (test `default_nodes_reach_their_stated_errors`).
    pub(super) const DIFFUSE_NODES: usize = 512;

    /// About `budget` nodes that serve every diffuse trace.
    pub(super) fn diffuse_nodes(pyramid: &LightPyramid, budget: usize) -> Vec<LightNode> {
        let mut cut = LightCut::default();
        cut.for_diffuse(pyramid, budget);
        cut.chosen
            .iter()
            .map(|&i| pyramid.nodes()[i as usize])
            .collect()
    }

    /// The open diffuse nodes at a point in frame `frame`.
    fn arriving(&self, frame: usize, visibility: &Visibility, arrivals: &mut Vec<Arrival>) {
        let rotation = &self.world_from_object[frame];
        arrivals.extend(self.diffuse_nodes.iter().filter_map(|node| {
            let direction = to_object(rotation, node.direction);
            let open = visibility.open(direction, node.spread);
            (open > 0.0).then_some(Arrival {
                direction,
                flux: node.flux * open,
            })
        }));
    }

    /// Irradiance of the light alone over π at a point of normal `normal` (object frame).
    pub(super) fn irradiance(
        &self,
        frame: usize,
        normal: Vec3,
        visibility: &Visibility,
        scratch: &mut Scratch,
    ) -> Vec3 {
        scratch.arriving.clear();
        self.arriving(frame, visibility, &mut scratch.arriving);
        irradiance(&scratch.arriving, normal, |_| true)
    }

    /// Light from below the surface itself never arrives; the paper's window may exclude more.
    #[inline]
    fn allowed(&self, wi: Vec3, geometric_normal: Vec3, mirror: Option<Vec3>) -> bool {
        wi.dot(geometric_normal) > 0.0
            && match (self.window_cos, mirror) {
                (Some(limit), Some(mirror)) => wi.dot(mirror) > limit,
                _ => true,
            }
    }

    /// Fills the traces of a point.
    pub(super) fn columns(
        &self,
        trace: &Trace,
        visibility: &Visibility,
        glow: Option<&Glow<'_>>,
        scratch: &mut Scratch,
        columns: &mut Columns,
    ) {
        columns.diffuse.clear();
        columns.normal_variance.clear();
        columns.specular.iter_mut().for_each(Vec::clear);
        let alphas: Vec<f32> = (0..ROUGHNESSES).map(roughness).collect();
        for frame in trace.observations.chunk_by(|a, b| a.frame == b.frame) {
            // What arrives at the point serves all its observations in a frame.
            let number = frame[0].frame as usize;
            scratch.glow.clear();
            if let Some(glow) = glow {
                glow.arriving(number, visibility, &mut scratch.glow);
            }
            scratch.arriving.clear();
            self.arriving(number, visibility, &mut scratch.arriving);
            scratch.arriving.extend_from_slice(&scratch.glow);
            for observation in frame {
                let (normal, side) = (observation.normal, observation.geometric_normal);
                let mirror = self.window_cos.map(|_| mirror(observation));
                columns
                    .diffuse
                    .push(irradiance(&scratch.arriving, normal, |wi| {
                        self.allowed(wi, side, mirror)
                    }));
                columns.normal_variance.push(if self.footprints {
                    observation.normal_variance
                } else {
                    0.0
                });
                self.gather(observation, visibility, mirror, scratch);
                let cos_o = normal.dot(observation.wo);
                scratch.nodes.sums(&alphas, cos_o, &mut scratch.sums);
                for (column, sums) in columns.specular.iter_mut().zip(&scratch.sums) {
                    column.extend_from_slice(sums);
                }
            }
        }
    }

    /// Collects the light nodes of one observation.
    fn gather(
        &self,
        observation: &Observation,
        visibility: &Visibility,
        mirror: Option<Vec3>,
        scratch: &mut Scratch,
    ) {
        let rotation = &self.world_from_object[observation.frame as usize];
        let (normal, wo) = (observation.normal, observation.wo);
        let lobe = Lobe {
            wo: *rotation * wo,
            normal: *rotation * normal,
            smallest_alpha: 0.5 * RANGE.0,
        };
        scratch.cut.for_lobe(self.pyramid, self.light_nodes, &lobe);
        scratch.nodes.clear();
        let eta = self.eta;
        let push = |nodes: &mut NodeArrays, wi: Vec3, flux: Vec3| {
            let cos_i = wi.dot(normal);
            if cos_i <= 0.0 {
                return;
            }
            let half = wi + wo;
            let length2 = half.length_squared();
            let sin2_h = half.cross(normal).length_squared() / length2;
            let cos_d = wi.dot(half) / length2.sqrt();
            nodes.push(sin2_h, cos_i, flux * dielectric(cos_d, eta));
        };
        for &index in &scratch.cut.chosen {
            let node = &self.pyramid.nodes()[index as usize];
            let wi = to_object(rotation, node.direction);
            if !self.allowed(wi, observation.geometric_normal, mirror) {
                continue;
            }
            let open = visibility.open(wi, node.spread);
            if open > 0.0 {
                push(&mut scratch.nodes, wi, node.flux * open);
            }
        }
        for arrival in &scratch.glow {
            if self.allowed(arrival.direction, observation.geometric_normal, mirror) {
                push(&mut scratch.nodes, arrival.direction, arrival.flux);
            }
        }
    }
}

/// Irradiance over π of what arrives from the directions that are allowed.
#[inline]
fn irradiance(arrivals: &[Arrival], normal: Vec3, allowed: impl Fn(Vec3) -> bool) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for arrival in arrivals {
        let cos = arrival.direction.dot(normal);
        if cos > 0.0 && allowed(arrival.direction) {
            sum += arrival.flux * cos;
        }
    }
    sum / std::f32::consts::PI
}

/// The direction that a mirror would reflect to the camera.
fn mirror(observation: &Observation) -> Vec3 {
    let (n, wo) = (observation.normal, observation.wo);
    2.0 * n.dot(wo) * n - wo
}

impl Columns {
    /// The specular trace at roughness `exp(ln_alpha)`, and its derivative by `ln_alpha`, one pair
    /// an observation.
    ///
    /// A pixel's patch whose normals vary by `σ²` per axis shows the lobe of roughness
    /// `√(alpha² + 2σ²)` (slope variances add; Tokuyoshi and Kaplanyan 2019). Between the grid's
    /// roughnesses the trace is interpolated by cubics in `ln alpha`.
    pub(super) fn specular(
        &self,
        ndf: usize,
        ln_alpha: f32,
        mut visit: impl FnMut(usize, Vec3, Vec3),
    ) {
        let alpha2 = (2.0 * ln_alpha).exp();
        let step = (RANGE.1 / RANGE.0).ln() / (ROUGHNESSES - 1) as f32;
        for (i, &variance) in self.normal_variance.iter().enumerate() {
            let widened = alpha2 + 2.0 * variance;
            let slope = alpha2 / widened;
            let place = (0.5 * widened.ln() - RANGE.0.ln()) / step;
            let x = place.clamp(0.0, (ROUGHNESSES - 1) as f32);
            // Beyond the grid the trace stays as it is at the end.
            let slope = if x == place { slope } else { 0.0 };
            let k = (x as usize).clamp(1, ROUGHNESSES - 3);
            let t = x - k as f32;
            let samples = &self.specular[ndf][i * ROUGHNESSES + k - 1..][..4];
            // Lagrange's cubic through the four neighbours at −1, 0, 1, 2.
            let (a, b, c, d) = (t + 1.0, t, t - 1.0, t - 2.0);
            let weights = [
                -b * c * d / 6.0,
                a * c * d / 2.0,
                -a * b * d / 2.0,
                a * b * c / 6.0,
            ];
            let slopes = [
                -(c * d + b * d + b * c) / 6.0,
                (c * d + a * d + a * c) / 2.0,
                -(b * d + a * d + a * b) / 2.0,
                (b * c + a * c + a * b) / 6.0,
            ];
            let blend = |w: [f32; 4]| -> Vec3 { samples.iter().zip(w).map(|(s, w)| *s * w).sum() };
            visit(i, blend(weights), blend(slopes) * (slope / step));
        }
    }

    /// Ends of `ln alpha`.
    pub(super) fn ln_range() -> (f32, f32) {
        (RANGE.0.ln(), RANGE.1.ln())
    }
}
