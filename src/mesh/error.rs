//! What can be wrong with a mesh file, said so that its owner can put it right.

use std::io;
use std::path::PathBuf;

use super::MeshReport;

/// Why a mesh could not be loaded, written or asked for its texels.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The file cannot be opened or read.
    #[error("{}: cannot be read: {source}; check the path and its permissions", path.display())]
    Read {
        /// The mesh file, or a buffer it names.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file name ends in nothing that is known.
    #[error(
        "{}: extension `{extension}` is not a known mesh format; use ply, obj, gltf, glb or stl",
        path.display()
    )]
    Extension {
        /// The mesh file.
        path: PathBuf,
        /// As typed; empty where the name has none.
        extension: String,
    },
    /// The content breaks its format, or refers to what is not there.
    #[error("{}: {field}: {problem}", path.display())]
    Content {
        /// The mesh file.
        path: PathBuf,
        /// Where in it: `line 7`, `face 12`, `element vertex`.
        field: String,
        /// The offending value and the remedy.
        problem: String,
    },
    /// No triangle survived the repair.
    #[error(
        "{}: no triangle is left after repair ({}); check that the export contains a surface",
        path.display(),
        report.in_one_line()
    )]
    Empty {
        /// The mesh file.
        path: PathBuf,
        /// What was dropped.
        report: Box<MeshReport>,
    },
    /// Texels were asked of a mesh that has no texture coordinates.
    #[error(
        "the mesh has no texture coordinates; unwrap it, or work on vertices instead of texels"
    )]
    NoTextureCoordinates,
    /// The charts made for a mesh do not fit the map.
    #[error(
        "texel resolution = {resolution}: no texture layout could be made for the mesh, which has none: \
         {problem}; choose more texels, or work on vertices"
    )]
    Charts {
        /// Texels along one side.
        resolution: u32,
        /// Why not.
        problem: String,
    },
    /// A texel grid of no or too many texels was asked for.
    #[error("texel resolution = {resolution}: must be from 1 to 16384; choose e.g. 512")]
    Resolution {
        /// Texels along one side.
        resolution: u32,
    },
    /// The file cannot be written.
    #[error("{}: cannot be written: {source}; check the folder and the free space", path.display())]
    Write {
        /// The file to be written.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// An attribute's name would be misread when the file is loaded again.
    #[error(
        "{}: attribute `{name}`: a PLY property is one printable word and none of \
         x y z nx ny nz s t u v texture_u texture_v; rename it",
        path.display()
    )]
    AttributeName {
        /// The file to be written.
        path: PathBuf,
        /// The attribute's name.
        name: String,
    },
}

/// A fault in a file's content, before the file's name is known.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) field: String,
    pub(super) problem: String,
}

impl Fault {
    pub(super) fn new(field: impl Into<String>, problem: impl Into<String>) -> Self {
        Self {
            field: field.into(),
            problem: problem.into(),
        }
    }

    /// Face `face` (from 0) names vertex `index`, but there are only `vertices`.
    pub(super) fn index(face: usize, index: impl std::fmt::Display, vertices: usize) -> Self {
        Self::new(
            format!("face {face}: index {index}"),
            format!("the file has {vertices} vertices; export the mesh again, it is inconsistent"),
        )
    }

    pub(super) fn in_file(self, path: &std::path::Path) -> MeshError {
        MeshError::Content {
            path: path.to_path_buf(),
            field: self.field,
            problem: self.problem,
        }
    }
}
