//! Writes the meshes of the shipped scenes, `meshes/sphere.ply` and `meshes/cup.ply`.
//!
//! ```text
//! cargo run --release --example shapes             # into scenes/meshes
//! cargo run --release --example shapes -- FOLDER
//! ```

use std::path::PathBuf;

use turnlight::mesh::{Surface, cup, sphere, write_ply};

fn main() -> anyhow::Result<()> {
    let shipped = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes");
    let folder = std::env::args_os().nth(1).map_or(shipped, PathBuf::from);
    std::fs::create_dir_all(&folder)?;
    let shapes: [(&str, Surface); 2] = [("sphere.ply", sphere(25)), ("cup.ply", cup())];
    for (name, surface) in shapes {
        write_ply(&folder.join(name), &surface.into_mesh()?)?;
    }
    Ok(())
}
