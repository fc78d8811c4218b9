//! A fit folder: arrays for programs, maps for artists, and a scene that renders the estimate.

use std::path::Path;

use glam::Vec3;

use super::files::write_atomically;
use super::{ExportError, PointTable};
use crate::brdf::Appearance;
use crate::image::{Channel, write_exr_channels};
use crate::mesh::{Mesh, TexelGrid, write_ply};
use crate::scene::{
    Capture, MapSource, MaterialSource, ObjectSource, ProbeSource, Scene, SpecularSource,
};

/// Texels by which charts grow over their seams, so that bilinear look-ups see no background.
const SEAM_PADDING: u32 = 8;

/// What goes into a fit folder.
pub struct FitFolder<'a> {
    /// What was fitted.
    pub capture: &'a Capture,
    /// Its mesh.
    pub mesh: &'a Mesh,
    /// The estimates.
    pub table: &'a PointTable,
    /// `[N]` what each point is rendered with.
    pub appearance: &'a [Appearance],
    /// Where the points stand in texture space, if they are texels.
    pub grid: Option<&'a TexelGrid>,
    /// Index of refraction of the Fresnel term; none where it is Schlick's, with `rho_s` as F0.
    pub eta: Option<f32>,
}

impl FitFolder<'_> {
    /// Writes `points.npz`, `mesh.ply`, `scene.toml`, and `maps/*.exr` where the points are texels.
    pub fn write(&self, out: &Path) -> Result<(), ExportError> {
        let maps = out.join("maps");
        let folder = if self.grid.is_some() { &maps } else { out };
        std::fs::create_dir_all(folder).map_err(|error| ExportError::file(folder, error))?;
        self.table.write_npz(&out.join("points.npz"))?;

        let mut mesh = self.mesh.clone();
        mesh.attributes.clear();
        let material = match self.grid {
            Some(grid) => self.write_maps(grid, &maps)?,
            None => self.add_properties(&mut mesh),
        };
        // With its own copy of the light, the folder renders wherever it is moved.
        let source = &self.capture.probe.image;
        let probe = out
            .join("probe")
            .with_extension(source.extension().unwrap_or_default());
        let light = std::fs::read(source).map_err(|error| ExportError::file(source, error))?;
        write_atomically(&probe, |file| std::io::Write::write_all(file, &light))?;
        let path = out.join("mesh.ply");
        write_ply(&path, &mesh)?;
        let scene = Scene {
            object: ObjectSource {
                mesh: path,
                object_from_file: Default::default(),
                flat: !self.mesh.smooth,
            },
            material,
            probe: ProbeSource {
                image: probe,
                ..self.capture.probe
            },
            camera: self.capture.camera,
            turn: self.capture.turn,
            angles: self.capture.frames.iter().map(|f| f.angle).collect(),
            sensor: None,
        };
        let path = out.join("scene.toml");
        let text = scene.to_toml(out);
        write_atomically(&path, |file| {
            std::io::Write::write_all(file, text.as_bytes())
        })
    }

    /// What the specular albedo is called.
    fn specular_name(&self) -> &'static str {
        if self.eta.is_some() { "rho_s" } else { "f0" }
    }

    /// The estimates as vertex properties.
    fn add_properties(&self, mesh: &mut Mesh) -> MaterialSource {
        let mut property = |name: String, value: &dyn Fn(&Appearance) -> f32| {
            let values = self.appearance.iter().map(value).collect();
            mesh.attributes.insert(name, values);
        };
        for (c, suffix) in ["r", "g", "b"].into_iter().enumerate() {
            property(format!("rho_d_{suffix}"), &|look| look.rho_d[c]);
            property(format!("{}_{suffix}", self.specular_name()), &|look| {
                look.rho_s[c]
            });
        }
        if self.eta.is_none() {
            property("f90".to_owned(), &|look| look.f90);
        }
        property("alpha".to_owned(), &|look| look.alpha);
        property("ggx".to_owned(), &|look| look.ggx);
        MaterialSource {
            ggx: MapSource::Vertex("ggx".to_owned()),
            alpha: MapSource::Vertex("alpha".to_owned()),
            rho_d: MapSource::Vertex("rho_d".to_owned()),
            specular: match self.eta {
                Some(eta) => SpecularSource::Dielectric {
                    eta,
                    rho_s: MapSource::Vertex("rho_s".to_owned()),
                },
                None => SpecularSource::Schlick {
                    f0: MapSource::Vertex("f0".to_owned()),
                    f90: MapSource::Vertex("f90".to_owned()),
                },
            },
        }
    }

    /// The estimates as images, seams padded.
    fn write_maps(&self, grid: &TexelGrid, maps: &Path) -> Result<MaterialSource, ExportError> {
        let write = |name: &str, names: &[&str], values: Vec<Vec3>| {
            let path = maps.join(name).with_extension("exr");
            let values: Vec<[f32; 3]> = values.iter().map(Vec3::to_array).collect();
            let map = grid.map(&values, [0.0; 3], SEAM_PADDING);
            let channels: Vec<Channel> = names
                .iter()
                .enumerate()
                .map(|(c, name)| Channel {
                    name: (*name).to_owned(),
                    samples: map.iter().map(|texel| texel[c]).collect(),
                })
                .collect();
            let side = grid.resolution as usize;
            write_exr_channels(&path, side, side, &channels)?;
            Ok::<_, ExportError>(path)
        };
        const RGB: [&str; 3] = ["R", "G", "B"];
        let rows = |values: &[[f32; 3]]| values.iter().map(|v| Vec3::from(*v)).collect();
        let gray = |values: &[f32]| values.iter().map(|v| Vec3::splat(*v)).collect();
        let look =
            |value: &dyn Fn(&Appearance) -> Vec3| self.appearance.iter().map(value).collect();
        let rho_d = write("rho_d", &RGB, look(&|a| a.rho_d))?;
        let albedo = write(self.specular_name(), &RGB, look(&|a| a.rho_s))?;
        let alpha = write("alpha", &["Y"], look(&|a| Vec3::splat(a.alpha)))?;
        let ggx = write("ggx", &["Y"], look(&|a| Vec3::splat(a.ggx)))?;
        write("sigma_rho_d", &RGB, rows(&self.table.sigma_rho_d))?;
        write("sigma_rho_s", &["Y"], gray(&self.table.sigma_rho_s))?;
        write("sigma_alpha", &["Y"], gray(&self.table.sigma_alpha))?;
        Ok(MaterialSource {
            ggx: MapSource::Texture(ggx),
            alpha: MapSource::Texture(alpha),
            rho_d: MapSource::Texture(rho_d),
            specular: match self.eta {
                Some(eta) => SpecularSource::Dielectric {
                    eta,
                    rho_s: MapSource::Texture(albedo),
                },
                None => SpecularSource::Schlick {
                    f0: MapSource::Texture(albedo),
                    f90: MapSource::Texture(write("f90", &["Y"], look(&|a| Vec3::splat(a.f90)))?),
                },
            },
        })
    }
}
