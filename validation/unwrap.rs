//! Gives a mesh the charts that `turnlight fit --points texels=N` makes, for `bench_inverse.py`.
//!
//! `unwrap IN N OUT.ply`: a mesh file, the texels along a side of the map, the mesh with texture
//! coordinates.

use std::path::Path;

use anyhow::{Context, Result, bail};
use turnlight::geometry::Similarity;
use turnlight::mesh::{LoadOptions, Mesh, write_ply};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [from, resolution, to] = arguments.as_slice() else {
        bail!("usage: unwrap IN N OUT.ply");
    };
    let resolution = resolution.parse().context("N must be a number of texels")?;
    let place = Similarity::default();
    let (mesh, _) = Mesh::load(Path::new(from), &place, LoadOptions::default())?;
    let (charted, _) = mesh.with_charts(resolution)?;
    write_ply(Path::new(to), &charted)?;
    Ok(())
}
