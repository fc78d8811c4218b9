//! The photographs of the tutorial that `turnlight render` does not take: see `scenes/tutorial/README.md`.
//!
//! ```text
//! cargo run --release --example tutorial-card -- FOLDER
//! ```
#![expect(clippy::print_stdout, reason = "it says what it wrote")]

mod card;
#[path = "../../tests/photographs/mod.rs"]
mod photographs;

use std::path::{Path, PathBuf};

use turnlight::image::RgbImage;
use turnlight::scene::Scene;

fn main() -> anyhow::Result<()> {
    let folder = std::env::args_os()
        .nth(1)
        .map_or_else(|| PathBuf::from("tutorial/card"), PathBuf::from);
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let scene = Scene::load(scenes.join("tutorial"))?;
    let light = RgbImage::read(&scene.probe.image)?;
    card::write(&folder, &light, &scene.camera)?;
    println!(
        "{}: written; centres of the chart's corner patches: {}",
        folder.display(),
        card::CHART_CORNERS
    );
    Ok(())
}
