//! `turnlight export`.

use super::arguments::{Common, Export, ExportFormat};
use super::failure::Failure;
use super::progress::note;
use super::reproduce::fitted_scene;
use crate::export::export_mitsuba;
use crate::scene::Scene;

pub(super) fn run(arguments: &Export, common: &Common) -> Result<(), Failure> {
    let ExportFormat::Mitsuba = arguments.format;
    let is_fit = arguments.source.join("fit.toml").exists();
    let scene = if is_fit {
        fitted_scene(&arguments.source)?
    } else {
        Scene::load(&arguments.source)?
    };
    let (mesh, _) = scene.object.load()?;
    let (environment, _) = scene.probe.load()?;
    export_mitsuba(&scene, &mesh, environment.image(), &arguments.out)?;
    note(
        common,
        &format!("{}: open scene.xml in Mitsuba 3", arguments.out.display()),
    );
    Ok(())
}
