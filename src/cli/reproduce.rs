//! `turnlight reproduce`: render the estimate.

use std::path::Path;

use super::arguments::{Common, Reproduce};
use super::failure::Failure;
use super::progress::note;
use super::render::{sequence, sequence_settings};
use crate::scene::{ProbeSource, Scene};

pub(super) fn run(arguments: &Reproduce, common: &Common) -> Result<(), Failure> {
    let mut scene = fitted_scene(&arguments.fit)?;
    if let Some(image) = &arguments.probe {
        scene.probe = ProbeSource {
            image: image.clone(),
            rotation: arguments.probe_rotation.to_radians(),
        };
    }
    let settings = sequence_settings(&arguments.sampling, &arguments.out, false);
    sequence(&scene, &settings, common)?;
    note(common, &format!("{}: reproduced", arguments.out.display()));
    Ok(())
}

/// The scene that a fit left behind: its estimate on the capture's mesh, in the capture's light.
pub(super) fn fitted_scene(fit: &Path) -> Result<Scene, Failure> {
    let path = fit.join("scene.toml");
    if !path.exists() {
        return Err(Failure::Input(anyhow::anyhow!(
            "{}: not found; give a folder that `turnlight fit` wrote",
            path.display()
        )));
    }
    Ok(Scene::load(&path)?)
}
