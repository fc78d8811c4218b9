//! Test support: single points of an object on a turntable, whose traces the forward model makes and
//! independent noise disturbs, seen as a camera that stands still sees them.

use std::sync::{Arc, LazyLock};

use glam::{BVec3, Mat3, Vec2, Vec3};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

use super::columns::Columns;
use super::forward_model::{ForwardModel, Scratch};
use super::fresnel_model::{FresnelModel, PAPER_ETA};
use super::half_angle::{self, STEPS};
use super::lobe_form::LobeForm;
use super::visibility::Visibility;
use super::{Estimate, Status};
use crate::brdf::Ndf;
use crate::image::RgbImage;
use crate::mesh::SurfacePoint;
use crate::probe::{Environment, SplitLight};
use crate::sampling::SobolPath;
use crate::traces::{Observation, SurfaceNormals, Trace, TraceSet};

const FRAMES: usize = 72;
const CAMERA: Vec3 = Vec3::new(0.0, 1.37, 3.76);
/// Metres; seen from the camera the object fills 14°.
const RADIUS: f32 = 0.5;
const SMALLEST_COS: f32 = 0.2;
/// Light nodes where data and fit share their columns: their error does not matter.
const SHARED_NODES: usize = 192;

/// What a point reflects with.
#[derive(Clone, Copy, Debug)]
pub(super) struct Material {
    pub(super) ndf: Ndf,
    pub(super) alpha: f32,
    pub(super) rho_d: Vec3,
    /// The lobe's linear parameters, of `form`.
    pub(super) lobe: [f64; 4],
    pub(super) form: LobeForm,
    /// Index of refraction, where the Fresnel term is a dielectric's.
    pub(super) eta: f32,
}

impl Material {
    /// A neutral lobe.
    pub(super) fn neutral(ndf: Ndf, alpha: f32, rho_s: f64) -> Self {
        Self {
            ndf,
            alpha,
            rho_d: Vec3::new(0.4, 0.3, 0.2),
            lobe: [rho_s, 0.0, 0.0, 0.0],
            form: LobeForm::Neutral,
            eta: PAPER_ETA,
        }
    }

    /// `rho_s` of plastic.
    pub(super) fn plastic(ndf: Ndf, alpha: f32) -> Self {
        Self::neutral(ndf, alpha, 2.35)
    }
}

/// A point that was seen.
pub(super) struct Point {
    pub(super) trace: Trace,
    pub(super) columns: Arc<Columns>,
    /// Under the material's own Fresnel term alone.
    pub(super) own_columns: Arc<Columns>,
    exact: Vec<Vec3>,
}

impl Point {
    /// The same point seen with other noise.
    pub(super) fn again(&self, seed: u64, noise: f32) -> Self {
        let mut random = Pcg64::new(u128::from(seed), 5);
        let mut trace = self.trace.clone();
        for (observation, exact) in trace.observations.iter_mut().zip(&self.exact) {
            let deviates = Vec3::from([0, 1, 2].map(|_| StandardNormal.sample(&mut random)));
            observation.radiance = *exact * (Vec3::ONE + noise * deviates);
            let deviation = noise * observation.radiance;
            observation.variance = deviation * deviation;
        }
        Self {
            trace,
            columns: Arc::clone(&self.columns),
            own_columns: Arc::clone(&self.own_columns),
            exact: self.exact.clone(),
        }
    }

    /// Saturates whatever is brighter than a share of the brightest sample.
    pub(super) fn saturate_above(&mut self, share: f64) {
        let observations = &mut self.trace.observations;
        let brightest = observations
            .iter()
            .map(|o| o.radiance.max_element())
            .fold(0.0, f32::max);
        let level = Vec3::splat(share as f32 * brightest);
        for observation in observations {
            observation.saturated = observation.radiance.cmpge(level);
            observation.radiance = observation.radiance.min(level);
        }
    }
}

/// A light and the poses of a turning object.
pub(super) struct Turntable {
    light: SplitLight,
    world_from_object: Vec<Mat3>,
}

/// The four shipped probes.
pub(super) static TURNTABLES: LazyLock<[Turntable; 4]> = LazyLock::new(|| {
    ["interior.exr", "courtyard.exr", "studio.exr", "city.exr"].map(Turntable::new)
});

impl Turntable {
    fn new(probe: &str) -> Self {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/probes");
        let image = RgbImage::read(&folder.join(probe)).unwrap();
        Self::under(image, FRAMES)
    }

    /// A turntable of `frames` frames in the light of an image.
    pub(super) fn under(image: RgbImage, frames: usize) -> Self {
        let angle = |frame: usize| std::f32::consts::TAU * frame as f32 / frames as f32;
        Self {
            light: SplitLight::new(&Environment::new(image, 0.0).unwrap().0),
            world_from_object: (0..frames)
                .map(|t| Mat3::from_rotation_y(angle(t)))
                .collect(),
        }
    }

    /// Point number `index` of a sphere: what is seen of it with independent relative noise.
    pub(super) fn point(&self, index: u32, material: &Material, noise: f32) -> Point {
        let [u, v, ..] = SobolPath::new(17, 0, 0, index).next_4d();
        let y = 2.0 * v - 1.0;
        let (sin, cos) = (std::f32::consts::TAU * u).sin_cos();
        let normal = Vec3::new((1.0 - y * y).sqrt() * cos, y, (1.0 - y * y).sqrt() * sin);
        self.point_with_normal(normal, u64::from(index), material, noise)
    }

    /// The point of a sphere with a given normal.
    pub(super) fn point_with_normal(
        &self,
        normal: Vec3,
        seed: u64,
        material: &Material,
        noise: f32,
    ) -> Point {
        self.point_of_pixels(&[normal], seed, material, noise, SHARED_NODES)
    }

    /// The point of a sphere about which pixels have given normals.
    pub(super) fn point_of_pixels(
        &self,
        normals: &[Vec3],
        seed: u64,
        material: &Material,
        noise: f32,
        light_nodes: usize,
    ) -> Point {
        let observe = |(frame, rotation): (usize, &Mat3), normal: Vec3| {
            let position = RADIUS * normal;
            let wo = (rotation.transpose() * CAMERA - position).normalize();
            (wo.dot(normal) > SMALLEST_COS).then_some(Observation {
                frame: frame as u32,
                radiance: Vec3::ZERO,
                variance: Vec3::ONE,
                saturated: BVec3::FALSE,
                position,
                wo,
                normal,
                geometric_normal: normal,
                normal_variance: 0.0,
            })
        };
        let frames = self.world_from_object.iter().enumerate();
        let pixels = |frame| normals.iter().filter_map(move |&n| observe(frame, n));
        let trace = Trace {
            point: SurfacePoint {
                position: RADIUS * normals[0],
                normal: normals[0],
                triangle: 0,
                barycentric: Vec2::ZERO,
                uv: None,
            },
            observations: frames.flat_map(pixels).collect(),
        };
        let columns = Arc::new(self.columns(&trace, FresnelModel::Auto, light_nodes));
        let own_columns = if material.eta == PAPER_ETA {
            Arc::clone(&columns)
        } else {
            let eta = material.eta;
            Arc::new(self.columns(&trace, FresnelModel::Dielectric { eta }, light_nodes))
        };
        let form = material.form;
        let jacobian = form.jacobian(&own_columns, material.ndf, material.alpha.ln());
        let exact = (0..trace.observations.len()).map(|i| {
            let lobe = jacobian[i * form.size()..]
                .iter()
                .zip(&material.lobe[..form.size()]);
            let specular: glam::DVec3 = lobe.map(|(j, v)| *j * *v).sum();
            material.rho_d * columns.diffuse[i] + specular.as_vec3()
        });
        let exact = exact.collect();
        let clean = Point {
            trace,
            columns,
            own_columns,
            exact,
        };
        clean.again(seed, noise)
    }

    /// The poses, without a point.
    pub(super) fn traces(&self) -> TraceSet {
        TraceSet {
            traces: Vec::new(),
            world_from_object: self.world_from_object.clone(),
            points_of_triangle: Vec::new(),
            surface: SurfaceNormals::default(),
            noise_is_known: true,
        }
    }

    /// What the point shows of each half angle under a material's Fresnel term and masking.
    pub(super) fn half_angle(&self, trace: &Trace, material: &Material) -> Vec<[Vec3; STEPS]> {
        let fresnel = FresnelModel::Dielectric { eta: material.eta };
        let model = ForwardModel::new(&self.light, &self.world_from_object, fresnel, 512);
        let (rho_s, f90) = material.form.values(&material.lobe);
        let lobe = Estimate {
            rho_s,
            f90,
            eta: f90.is_none().then_some(material.eta),
            alpha: material.alpha,
            ndf: material.ndf,
            ..Estimate::without_data(Status::Converged, 0)
        };
        let mut scratch = half_angle::Scratch::default();
        let open = &Visibility::Open;
        half_angle::columns(&model, trace, open, None, &lobe, &mut scratch)
    }

    /// The columns of a trace of an open point.
    pub(super) fn columns(
        &self,
        trace: &Trace,
        fresnel: FresnelModel,
        light_nodes: usize,
    ) -> Columns {
        let rotations = &self.world_from_object;
        let model = ForwardModel::new(&self.light, rotations, fresnel, light_nodes);
        let mut columns = Columns::default();
        let mut scratch = Scratch::default();
        model.columns(trace, &Visibility::Open, None, &mut scratch, &mut columns);
        columns
    }
}
