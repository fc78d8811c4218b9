//! The plain, checked data that scene files become.

use std::path::{Path, PathBuf};

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
    /// Shade every triangle flat, whatever normals the file has.
    pub flat: bool,
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

impl<T: Clone> MapSource<T> {
    /// The same source with its image, if it has one, in `folder` under the parameter's name; the
    /// move is added to `moves`.
    fn moved(&self, folder: &Path, name: &str, moves: &mut Vec<(PathBuf, PathBuf)>) -> Self {
        let Self::Texture(from) = self else {
            return self.clone();
        };
        let extension = from.extension().unwrap_or_default();
        let to = folder.join(name).with_extension(extension);
        moves.push((from.clone(), to.clone()));
        Self::Texture(to)
    }
}

impl MaterialSource {
    /// The same material with its images in `folder`, and which file goes where.
    pub fn with_maps_in(&self, folder: &Path) -> (Self, Vec<(PathBuf, PathBuf)>) {
        let mut moves = Vec::new();
        let material = Self {
            ggx: self.ggx.moved(folder, "ndf", &mut moves),
            alpha: self.alpha.moved(folder, "alpha", &mut moves),
            rho_d: self.rho_d.moved(folder, "rho_d", &mut moves),
            specular: match &self.specular {
                SpecularSource::Dielectric { eta, rho_s } => SpecularSource::Dielectric {
                    eta: *eta,
                    rho_s: rho_s.moved(folder, "rho_s", &mut moves),
                },
                SpecularSource::Schlick { f0, f90 } => SpecularSource::Schlick {
                    f0: f0.moved(folder, "f0", &mut moves),
                    f90: f90.moved(folder, "f90", &mut moves),
                },
            },
        };
        (material, moves)
    }
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

impl Sensor {
    /// Variance of a stored value whose true radiance is `radiance`: shot, read and quantisation
    /// noise, in radiance squared. `exposure` multiplies the sensor's own.
    pub fn variance(&self, radiance: f64, exposure: f64) -> f64 {
        let exposure = self.exposure * exposure;
        let per_electron = 1.0 / (self.full_well_electrons * exposure);
        let electrons = radiance.max(0.0) / per_electron;
        let step = 1.0 / (((1u64 << self.bits) - 1) as f64 * exposure);
        (electrons + self.read_noise_electrons * self.read_noise_electrons)
            * per_electron
            * per_electron
            + step * step / 12.0
    }

    /// The stored value from which on a sample counts as saturated: half a step below the top.
    pub fn saturation(&self, exposure: f64) -> f64 {
        let steps = ((1u64 << self.bits) - 1) as f64;
        (1.0 - 0.5 / steps) / (self.exposure * exposure)
    }
}
