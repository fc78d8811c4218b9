//! The material over the surface, its maps in memory.

use std::ops::{Add, Mul};
use std::path::Path;

use glam::{Vec2, Vec3};

use super::AssetError;
use super::plan::{MapSource, MaterialSource, SpecularSource};
use crate::brdf::{Alpha, Dichromatic, Fresnel, Ndf};
use crate::image::RgbImage;
use crate::mesh::Mesh;

/// A parameter over the surface, ready to be looked up.
#[derive(Clone, Debug)]
enum Map<T> {
    Constant(T),
    Texture(RgbImage),
    Vertex(Vec<T>),
}

/// A value that maps can hold.
trait Value: Copy + Mul<f32, Output = Self> + Add<Output = Self> {
    fn from_rgb(rgb: Vec3) -> Self;
    fn is_finite(self) -> bool;
    fn read_vertex(mesh: &Mesh, name: &str) -> Result<Vec<Self>, String>;
}

impl Value for f32 {
    fn from_rgb(rgb: Vec3) -> Self {
        rgb.x
    }
    fn is_finite(self) -> bool {
        self.is_finite()
    }
    fn read_vertex(mesh: &Mesh, name: &str) -> Result<Vec<Self>, String> {
        mesh.attributes
            .get(name)
            .cloned()
            .ok_or_else(|| name.to_owned())
    }
}

impl Value for Vec3 {
    fn from_rgb(rgb: Vec3) -> Self {
        rgb
    }
    fn is_finite(self) -> bool {
        Vec3::is_finite(self)
    }
    fn read_vertex(mesh: &Mesh, name: &str) -> Result<Vec<Self>, String> {
        // One property is neutral; three with suffixes are RGB.
        if let Some(neutral) = mesh.attributes.get(name) {
            return Ok(neutral.iter().map(|&v| Vec3::splat(v)).collect());
        }
        let channel = |suffix: &str| {
            let full = format!("{name}_{suffix}");
            mesh.attributes.get(&full).ok_or(full)
        };
        let (r, g, b) = (channel("r")?, channel("g")?, channel("b")?);
        Ok(r.iter()
            .zip(g)
            .zip(b)
            .map(|((&r, &g), &b)| Vec3::new(r, g, b))
            .collect())
    }
}

impl<T: Value> Map<T> {
    fn load(
        source: &MapSource<T>,
        key: &'static str,
        mesh: &Mesh,
        mesh_path: &Path,
    ) -> Result<Self, AssetError> {
        let not_finite = |path: &Path, place: String| AssetError::NotFinite {
            key,
            path: path.to_path_buf(),
            place,
        };
        match source {
            MapSource::Constant(value) => Ok(Self::Constant(*value)),
            MapSource::Texture(path) => {
                if mesh.uvs.is_none() {
                    return Err(AssetError::NoTextureCoordinates {
                        key,
                        map: path.clone(),
                        mesh: mesh_path.to_path_buf(),
                    });
                }
                let image = RgbImage::read(path)?;
                let finite = |&texel: &[f32; 3]| T::from_rgb(texel.into()).is_finite();
                match image.pixels.iter().position(|texel| !finite(texel)) {
                    None => Ok(Self::Texture(image)),
                    Some(i) => {
                        let (x, y) = (i % image.width, i / image.width);
                        Err(not_finite(path, format!("texel ({x}, {y})")))
                    }
                }
            }
            MapSource::Vertex(name) => {
                let values =
                    T::read_vertex(mesh, name).map_err(|missing| AssetError::NoVertexProperty {
                        key,
                        property: missing,
                        known: mesh.attributes.keys().cloned().collect(),
                        mesh: mesh_path.to_path_buf(),
                    })?;
                match values.iter().filter(|value| !value.is_finite()).count() {
                    0 => Ok(Self::Vertex(values)),
                    broken => {
                        let place =
                            format!("property `{name}` at {broken} of {} vertices", values.len());
                        Err(not_finite(mesh_path, place))
                    }
                }
            }
        }
    }

    #[inline]
    fn at(&self, mesh: &Mesh, triangle: u32, barycentric: Vec2) -> T {
        match self {
            Self::Constant(value) => *value,
            Self::Texture(image) => {
                let uv = mesh.uv_at(triangle, barycentric).unwrap_or(Vec2::ZERO);
                T::from_rgb(image.bilinear(f64::from(uv.x), f64::from(uv.y)).into())
            }
            Self::Vertex(values) => mesh.interpolate(values, triangle, barycentric),
        }
    }
}

/// The material of the whole object.
#[derive(Clone, Debug)]
pub struct MaterialField {
    ggx: Map<f32>,
    alpha: Map<f32>,
    rho_d: Map<Vec3>,
    specular: SpecularField,
}

#[derive(Clone, Debug)]
enum SpecularField {
    Dielectric { eta: f32, rho_s: Map<Vec3> },
    Schlick { f0: Map<Vec3>, f90: Map<f32> },
}

impl MaterialField {
    /// Reads the maps; the mesh must have what they are looked up by, and every value be finite.
    /// `mesh_path` names the mesh in errors.
    pub fn load(
        source: &MaterialSource,
        mesh: &Mesh,
        mesh_path: &Path,
    ) -> Result<Self, AssetError> {
        Ok(Self {
            ggx: Map::load(&source.ggx, "ndf", mesh, mesh_path)?,
            alpha: Map::load(&source.alpha, "alpha", mesh, mesh_path)?,
            rho_d: Map::load(&source.rho_d, "rho_d", mesh, mesh_path)?,
            specular: match &source.specular {
                SpecularSource::Dielectric { eta, rho_s } => SpecularField::Dielectric {
                    eta: *eta,
                    rho_s: Map::load(rho_s, "rho_s", mesh, mesh_path)?,
                },
                SpecularSource::Schlick { f0, f90 } => SpecularField::Schlick {
                    f0: Map::load(f0, "f0", mesh, mesh_path)?,
                    f90: Map::load(f90, "f90", mesh, mesh_path)?,
                },
            },
        })
    }

    /// Whether a texture may vary within a pixel, however small.
    pub fn has_textures(&self) -> bool {
        fn is_texture<T>(map: &Map<T>) -> bool {
            matches!(map, Map::Texture(_))
        }
        is_texture(&self.ggx)
            || is_texture(&self.alpha)
            || is_texture(&self.rho_d)
            || match &self.specular {
                SpecularField::Dielectric { rho_s, .. } => is_texture(rho_s),
                SpecularField::Schlick { f0, f90 } => is_texture(f0) || is_texture(f90),
            }
    }

    /// Roughness, lobe and index of refraction (`None` under Schlick's Fresnel term), if the whole
    /// object has the same; and if that is not a mixture of lobes.
    pub fn uniform_lobe(&self) -> Option<(Alpha, Ndf, Option<f32>)> {
        let (Map::Constant(alpha), Map::Constant(ggx)) = (&self.alpha, &self.ggx) else {
            return None;
        };
        let ndf = match *ggx {
            ggx if ggx <= 0.0 => Ndf::Beckmann,
            ggx if ggx >= 1.0 => Ndf::Ggx,
            _ => return None,
        };
        let eta = match &self.specular {
            SpecularField::Dielectric { eta, .. } => Some(*eta),
            SpecularField::Schlick { .. } => None,
        };
        Some((Alpha::saturating(*alpha), ndf, eta))
    }

    /// The material at a point of a triangle of the mesh it was loaded for. Values of maps outside
    /// their range take the nearest one inside.
    #[inline]
    pub fn at(&self, mesh: &Mesh, triangle: u32, barycentric: Vec2) -> Dichromatic {
        let (rho_s, fresnel) = match &self.specular {
            SpecularField::Dielectric { eta, rho_s } => (
                rho_s.at(mesh, triangle, barycentric).max(Vec3::ZERO),
                Fresnel::Dielectric { eta: *eta },
            ),
            SpecularField::Schlick { f0, f90 } => {
                let f0 = f0.at(mesh, triangle, barycentric).max(Vec3::ZERO);
                let f90 = f90.at(mesh, triangle, barycentric).max(0.0);
                (Vec3::ONE, Fresnel::Schlick { f0, f90 })
            }
        };
        Dichromatic {
            rho_d: self.rho_d.at(mesh, triangle, barycentric).max(Vec3::ZERO),
            rho_s,
            alpha: Alpha::saturating(self.alpha.at(mesh, triangle, barycentric)),
            ggx: self.ggx.at(mesh, triangle, barycentric).clamp(0.0, 1.0),
            fresnel,
        }
    }
}
