//! Writes the meshes of the shipped scenes that are made, not found: `meshes/sphere.ply`,
//! `meshes/cup.ply`, and `meshes/suzanne-painted.ply` from `meshes/suzanne.ply`.
//!
//! ```text
//! cargo run --release --example shapes             # into scenes/meshes
//! cargo run --release --example shapes -- FOLDER
//! ```

use std::path::PathBuf;

use glam::Vec3;
use turnlight::geometry::Similarity;
use turnlight::mesh::{LoadOptions, Mesh, Surface, cup, sphere, write_ply};

fn main() -> anyhow::Result<()> {
    let shipped = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes");
    let folder = std::env::args_os()
        .nth(1)
        .map_or_else(|| shipped.clone(), PathBuf::from);
    std::fs::create_dir_all(&folder)?;
    let shapes: [(&str, Surface); 2] = [("sphere.ply", sphere(25)), ("cup.ply", cup())];
    for (name, surface) in shapes {
        write_ply(&folder.join(name), &surface.into_mesh()?)?;
    }
    let (mut suzanne, _) = Mesh::load(
        &shipped.join("suzanne.ply"),
        &Similarity::default(),
        LoadOptions::default(),
    )?;
    paint(&mut suzanne);
    write_ply(&folder.join("suzanne-painted.ply"), &suzanne)?;
    Ok(())
}

/// Two materials by region, and a diffuse pattern: stripes around the head on a satin coat, spots
/// on a glossy one below the cheeks.
fn paint(mesh: &mut Mesh) {
    const SATIN: (f32, f32) = (0.3, 2.35);
    const GLOSSY: (f32, f32) = (0.12, 6.0);
    let smooth = |edge: f32, width: f32, x: f32| {
        let t = ((x - edge) / width + 0.5).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    let paint = |p: Vec3| {
        let glossy = p.y < -0.12;
        let rho_d = if glossy {
            let spots = (9.0 * p.x).sin() * (9.0 * p.y).sin() * (9.0 * p.z).cos();
            Vec3::new(0.12, 0.25, 0.45).lerp(Vec3::new(0.6, 0.55, 0.35), smooth(0.2, 0.3, spots))
        } else {
            let stripes = (14.0 * p.y + 2.0 * (3.0 * p.x).sin()).sin();
            Vec3::new(0.5, 0.16, 0.1).lerp(Vec3::new(0.55, 0.5, 0.4), smooth(0.0, 0.6, stripes))
        };
        (rho_d, if glossy { GLOSSY } else { SATIN })
    };
    let painted: Vec<(Vec3, (f32, f32))> = mesh.positions.iter().map(|p| paint(*p)).collect();
    for (c, name) in ["rho_d_r", "rho_d_g", "rho_d_b"].into_iter().enumerate() {
        let values = painted.iter().map(|(rho_d, _)| rho_d[c]).collect();
        mesh.attributes.insert(name.to_owned(), values);
    }
    mesh.attributes
        .insert("alpha".to_owned(), painted.iter().map(|p| p.1.0).collect());
    mesh.attributes
        .insert("rho_s".to_owned(), painted.iter().map(|p| p.1.1).collect());
}
