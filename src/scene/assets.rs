//! From checked plans to the things themselves: mesh, light and maps read from their files.

use std::path::PathBuf;

use super::plan::{ObjectSource, ProbeSource};
use crate::image::{ImageError, RgbImage};
use crate::mesh::{LoadOptions, Mesh, MeshError, MeshReport};
use crate::probe::{Environment, ProbeError, ProbeReport};

/// Why a file that a scene names cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum AssetError {
    /// The mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// An image.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The light probe's texels.
    #[error("{}: {source}", path.display())]
    Probe {
        /// The probe's image.
        path: PathBuf,
        /// What is wrong with it.
        source: ProbeError,
    },
    /// A map is looked up by UV, and the mesh has none.
    #[error(
        "material.{key} = \"{}\": {} has no texture coordinates; \
         unwrap it, or give the parameter by vertices (\"vertex:NAME\")", map.display(), mesh.display()
    )]
    NoTextureCoordinates {
        /// The parameter.
        key: &'static str,
        /// Its map.
        map: PathBuf,
        /// The mesh.
        mesh: PathBuf,
    },
    /// A parameter names a vertex property that the mesh lacks.
    #[error(
        "material.{key}: {} has no vertex property `{property}`; it has {}",
        mesh.display(),
        if known.is_empty() { "none".to_owned() } else { known.join(", ") }
    )]
    NoVertexProperty {
        /// The parameter.
        key: &'static str,
        /// What it names.
        property: String,
        /// What there is.
        known: Vec<String>,
        /// The mesh.
        mesh: PathBuf,
    },
    /// A parameter is NaN or infinite somewhere.
    #[error(
        "{}: {place} is NaN or infinite, and material.{key} is read from it; \
         fill it with a number, or write the file again", path.display()
    )]
    NotFinite {
        /// The parameter.
        key: &'static str,
        /// Its map, or the mesh.
        path: PathBuf,
        /// The first such texel, or how many vertices.
        place: String,
    },
}

impl ObjectSource {
    /// Reads, repairs and places the mesh; the report says what was repaired.
    pub fn load(&self) -> Result<(Mesh, MeshReport), AssetError> {
        Ok(Mesh::load(
            &self.mesh,
            &self.object_from_file,
            LoadOptions { flat: self.flat },
        )?)
    }
}

impl ProbeSource {
    /// Reads and repairs the light probe; the report says what was repaired.
    pub fn load(&self) -> Result<(Environment, ProbeReport), AssetError> {
        let image = RgbImage::read(&self.image)?;
        Environment::new(image, self.rotation).map_err(|source| AssetError::Probe {
            path: self.image.clone(),
            source,
        })
    }
}
