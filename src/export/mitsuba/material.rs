//! The dichromatic model from Mitsuba's stock plugins.
//!
//! ```text
//! f = (1 − w) [rho_d/(1 − w)]/π + w [rho_s/w] D G F / (4 cos cos),    w = ½
//! ```
//!
//! `blendbsdf(w, diffuse, roughconductor)`: a conductor with `k = 0` reflects as a dielectric does,
//! its masking is the separable one, and its colours may exceed 1 where they are `unbounded` or
//! `raw`. A share of GGX is one more `blendbsdf` of two conductors.

use glam::Vec3;

use super::ply::Attribute;
use super::xml::Xml;
use crate::brdf::Alpha;
use crate::export::ExportError;
use crate::image::RgbImage;
use crate::mesh::Mesh;
use crate::scene::{MapSource, MaterialSource, SpecularSource};

/// Share of the specular lobe in the blend, and so in Mitsuba's choice of what to sample.
const SPECULAR_SHARE: f32 = 0.5;

/// A parameter as Mitsuba will see it.
enum Value {
    /// The same everywhere, neutral.
    Number(f32),
    /// The same everywhere, linear RGB without bounds.
    Colour(Vec3),
    /// An EXR file.
    Texture(String),
    /// A vertex attribute, `vertex_NAME`.
    Attribute(&'static str),
}

/// The material's parameters, and the files and vertex properties that go with them.
pub(super) struct Material {
    ggx: Value,
    alpha: Value,
    diffuse: Value,
    specular: Value,
    eta: f32,
    /// EXR files by name.
    pub(super) textures: Vec<(String, RgbImage)>,
    /// Vertex properties for the PLY file.
    pub(super) attributes: Vec<Attribute>,
}

impl Material {
    /// Translates the material; colours come out divided by their lobe's share.
    pub(super) fn new(source: &MaterialSource, mesh: &Mesh) -> Result<Self, ExportError> {
        let SpecularSource::Dielectric { eta, rho_s } = &source.specular else {
            return Err(ExportError::Unsupported {
                key: "material.fresnel",
                lacks: "exact counterpart to Schlick's reflectance with free f0 and f90 (its principled plugin differs)",
                remedy: "fit with fresnel = \"dielectric\", or export to glTF",
            });
        };
        let mut maps = Maps {
            mesh,
            textures: Vec::new(),
            attributes: Vec::new(),
        };
        let albedo = |share: f32| move |x: f32| x.max(0.0) / share;
        Ok(Self {
            ggx: maps.scalar("ndf", "ggx", &source.ggx, |x| x.clamp(0.0, 1.0))?,
            alpha: maps.scalar("alpha", "alpha", &source.alpha, |x| {
                Alpha::saturating(x).get()
            })?,
            diffuse: maps.colour("rho_d", &source.rho_d, albedo(1.0 - SPECULAR_SHARE))?,
            specular: maps.colour("rho_s", rho_s, albedo(SPECULAR_SHARE))?,
            eta: *eta,
            textures: maps.textures,
            attributes: maps.attributes,
        })
    }

    /// The `bsdf` element.
    pub(super) fn write(&self, xml: &mut Xml) {
        xml.open("bsdf", &[("type", "blendbsdf")]);
        Value::Number(SPECULAR_SHARE).write(xml, "weight");
        xml.open("bsdf", &[("type", "diffuse")]);
        self.diffuse.write(xml, "reflectance");
        xml.close();
        match &self.ggx {
            Value::Number(share) if *share <= 0.0 => self.conductor(xml, "beckmann"),
            Value::Number(share) if *share >= 1.0 => self.conductor(xml, "ggx"),
            share => {
                xml.open("bsdf", &[("type", "blendbsdf")]);
                share.write(xml, "weight");
                self.conductor(xml, "beckmann");
                self.conductor(xml, "ggx");
                xml.close();
            }
        }
        xml.close();
    }

    fn conductor(&self, xml: &mut Xml, distribution: &str) {
        xml.open("bsdf", &[("type", "roughconductor")]);
        xml.value("string", "distribution", distribution);
        self.alpha.write(xml, "alpha");
        xml.value("float", "eta", &format!("{:?}", self.eta));
        xml.value("float", "k", "0");
        self.specular.write(xml, "specular_reflectance");
        xml.close();
    }
}

impl Value {
    /// The parameter called `name` of the plugin being written.
    fn write(&self, xml: &mut Xml, name: &str) {
        match self {
            Self::Number(x) => xml.value("float", name, &format!("{x:?}")),
            Self::Colour(c) => {
                // `rgb` alone is refused above 1.
                let rgb = c.to_array().map(|x| format!("{x:?}")).join(", ");
                xml.open("texture", &[("type", "srgb"), ("name", name)]);
                xml.value("rgb", "color", &rgb);
                xml.value("boolean", "unbounded", "true");
                xml.close();
            }
            Self::Texture(file) => {
                xml.open("texture", &[("type", "bitmap"), ("name", name)]);
                xml.value("string", "filename", file);
                xml.value("boolean", "raw", "true");
                xml.close();
            }
            Self::Attribute(attribute) => {
                xml.open("texture", &[("type", "mesh_attribute"), ("name", name)]);
                xml.value("string", "name", &format!("vertex_{attribute}"));
                xml.close();
            }
        }
    }
}

/// Gathers textures and vertex properties while parameters are translated.
struct Maps<'a> {
    mesh: &'a Mesh,
    textures: Vec<(String, RgbImage)>,
    attributes: Vec<Attribute>,
}

impl Maps<'_> {
    /// A neutral parameter, read at `key` and called `name`, each value through `convert`.
    fn scalar(
        &mut self,
        key: &'static str,
        name: &'static str,
        source: &MapSource<f32>,
        convert: impl Fn(f32) -> f32,
    ) -> Result<Value, ExportError> {
        match source {
            MapSource::Constant(x) => Ok(Value::Number(convert(*x))),
            MapSource::Texture(path) => {
                let mut image = self.texture(key, path)?;
                image
                    .pixels
                    .iter_mut()
                    .for_each(|pixel| *pixel = [convert(pixel[0]); 3]);
                Ok(self.keep(name, image))
            }
            MapSource::Vertex(property) => {
                let samples = self
                    .property(key, property)?
                    .iter()
                    .map(|&x| convert(x))
                    .collect();
                self.attributes.push(Attribute {
                    name,
                    components: 1,
                    samples,
                });
                Ok(Value::Attribute(name))
            }
        }
    }

    /// A colour, read at `key` and called so, each channel through `convert`.
    fn colour(
        &mut self,
        key: &'static str,
        source: &MapSource<Vec3>,
        convert: impl Fn(f32) -> f32,
    ) -> Result<Value, ExportError> {
        match source {
            MapSource::Constant(c) => {
                Ok(Value::Colour(Vec3::from_array(c.to_array().map(convert))))
            }
            MapSource::Texture(path) => {
                let mut image = self.texture(key, path)?;
                image
                    .pixels
                    .iter_mut()
                    .for_each(|pixel| *pixel = pixel.map(&convert));
                Ok(self.keep(key, image))
            }
            MapSource::Vertex(property) => {
                // One property is neutral; three with suffixes are RGB.
                let suffixes = if self.mesh.attributes.contains_key(property) {
                    [""; 3]
                } else {
                    ["_r", "_g", "_b"]
                };
                let [r, g, b] =
                    suffixes.map(|suffix| self.property(key, &format!("{property}{suffix}")));
                let (r, g, b) = (r?, g?, b?);
                let samples = (0..r.len())
                    .flat_map(|v| [r[v], g[v], b[v]])
                    .map(convert)
                    .collect();
                self.attributes.push(Attribute {
                    name: key,
                    components: 3,
                    samples,
                });
                Ok(Value::Attribute(key))
            }
        }
    }

    fn keep(&mut self, name: &str, image: RgbImage) -> Value {
        let file = format!("{name}.exr");
        self.textures.push((file.clone(), image));
        Value::Texture(file)
    }

    fn texture(&self, key: &'static str, path: &std::path::Path) -> Result<RgbImage, ExportError> {
        if self.mesh.uvs.is_some() {
            return Ok(RgbImage::read(path)?);
        }
        let remedy = "unwrap the mesh, or give the parameter by vertex".to_owned();
        Err(ExportError::Mesh {
            key,
            lacks: "texture coordinates".to_owned(),
            remedy,
        })
    }

    fn property(&self, key: &'static str, name: &str) -> Result<&[f32], ExportError> {
        let all = &self.mesh.attributes;
        all.get(name).map(Vec::as_slice).ok_or_else(|| {
            let known = all
                .keys()
                .map(String::as_str)
                .collect::<Vec<_>>()
                .join(", ");
            let remedy = if known.is_empty() {
                "it has none".to_owned()
            } else {
                format!("it has {known}")
            };
            ExportError::Mesh {
                key,
                lacks: format!("vertex property {name}"),
                remedy,
            }
        })
    }
}
