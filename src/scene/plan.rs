//! The plain, checked data that scene files become.

use std::path::PathBuf;

use glam::Vec3;

use crate::brdf::Ndf;
use crate::geometry::{Similarity, Turn};
use crate::rig::Camera;

/// The object's mesh and how its coordinates become object coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectSource {
    /// Mesh file, resolved against the scene file's folder.
    pub mesh: PathBuf,
    /// Object frame from mesh file.
    pub object_from_file: Similarity,
}

/// One parameter over the surface.
#[derive(Clone, Debug, PartialEq)]
pub enum MapSource<T> {
    /// The same everywhere.
    Constant(T),
    /// An image looked up by UV (EXR: linear as stored; PNG: sRGB-decoded), bilinear, repeating.
    Texture(PathBuf),
    /// A vertex property of the mesh file, `"vertex:NAME"`; RGB reads `NAME_r NAME_g NAME_b`.
    Vertex(String),
}

/// The specular half of a material.
#[derive(Clone, Debug, PartialEq)]
pub enum SpecularSource {
    /// `fresnel = "dielectric"`: exact Fresnel at `eta`, times `rho_s`.
    Dielectric {
        /// Index of refraction, > 1.
        eta: f32,
        /// Specular albedo, linear RGB.
        rho_s: MapSource<Vec3>,
    },
    /// `fresnel = "schlick"`.
    Schlick {
        /// Reflectance at normal incidence, linear RGB.
        f0: MapSource<Vec3>,
        /// Reflectance at grazing.
        f90: MapSource<f32>,
    },
}

/// The material over the whole surface.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialSource {
    /// 0 Beckmann, 1 GGX (`ndf = "beckmann" | "ggx"`, or a map of the GGX share).
    pub ggx: MapSource<f32>,
    /// Roughness in [1e-3, 1].
    pub alpha: MapSource<f32>,
    /// Diffuse albedo, linear RGB.
    pub rho_d: MapSource<Vec3>,
    /// Specular lobe.
    pub specular: SpecularSource,
}

impl From<Ndf> for MapSource<f32> {
    fn from(ndf: Ndf) -> Self {
        Self::Constant(match ndf {
            Ndf::Beckmann => 0.0,
            Ndf::Ggx => 1.0,
        })
    }
}

/// The light probe.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeSource {
    /// Lat-long HDR image, resolved against the scene file's folder.
    pub image: PathBuf,
    /// Turn about +Y, radians, right-handed.
    pub rotation: f64,
}

/// A linear sensor: what turns radiance into stored numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sensor {
    /// Electrons at saturation.
    pub full_well_electrons: f64,
    /// Standard deviation of the read noise, electrons.
    pub read_noise_electrons: f64,
    /// Bits of the converter.
    pub bits: u32,
    /// Saturation is reached at radiance `1 / exposure`.
    pub exposure: f64,
}

/// What to render (`scene.toml`).
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Mesh and pose.
    pub object: ObjectSource,
    /// Reflectance.
    pub material: MaterialSource,
    /// Light.
    pub probe: ProbeSource,
    /// View.
    pub camera: Camera,
    /// Axis and centre.
    pub turn: Turn,
    /// `[frames]` angles of the object, radians.
    pub angles: Vec<f64>,
    /// Noise; `None` stores radiance as it is.
    pub sensor: Option<Sensor>,
}

/// One photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureFrame {
    /// Linear RGB image, resolved against the capture file's folder.
    pub image: PathBuf,
    /// Coverage of the object, 8 bit; `None` when the image needs none.
    pub mask: Option<PathBuf>,
    /// Angle of the object, radians.
    pub angle: f64,
    /// Multiplies the sensor's exposure; 1 unless the file says otherwise.
    pub exposure: f64,
}

/// What was photographed, or rendered (`capture.toml`): a scene without its material.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Mesh and pose.
    pub object: ObjectSource,
    /// Light.
    pub probe: ProbeSource,
    /// View.
    pub camera: Camera,
    /// Axis and centre.
    pub turn: Turn,
    /// The photographs, in order of time.
    pub frames: Vec<CaptureFrame>,
    /// Noise model of the photographs, if known.
    pub sensor: Option<Sensor>,
}
