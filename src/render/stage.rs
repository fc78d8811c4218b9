//! Everything a frame needs in memory: mesh, rays, material, light, camera.

use glam::{DAffine3, DVec2, Vec3};

use super::expected_lobe::Places;
use super::guide::{LIGHTS, cells_as_places};
use super::lobe_table::LobeTable;
use super::patches::Patches;

use crate::accel::Accel;
use crate::mesh::Mesh;

use crate::probe::{Environment, Irradiance, LightClusters, LightPyramid};
use crate::rig::View;
use crate::scene::{AssetError, MaterialField, Scene};

/// A scene read into memory. Its geometry stands still; poses turn camera and light around it.
pub struct Stage {
    /// The object.
    pub mesh: Mesh,
    /// Ray queries against it, mesh frame.
    pub accel: Accel,
    /// Its material.
    pub material: MaterialField,
    /// The light, world frame.
    pub environment: Environment,
    /// The light in patches.
    pub(super) clusters: LightClusters,
    /// What open surfaces receive.
    pub(super) irradiance: Irradiance,
    /// What lobes of open surfaces reflect, if all are alike.
    pub(super) lobe: Option<LobeTable>,
    /// Where the object blocks its own light.
    pub(super) patches: Patches,
    /// The cells of the direction map.
    pub(super) cells: Places,
    scene: Scene,
}

impl Stage {
    /// Reads mesh, maps and probe. The strings are warnings for the user: what was repaired.
    pub fn load(scene: &Scene) -> Result<(Self, Vec<String>), AssetError> {
        let (mesh, mesh_report) = scene.object.load()?;
        let (environment, probe_report) = scene.probe.load()?;
        let material = MaterialField::load(&scene.material, &mesh, &scene.object.mesh)?;
        let accel = Accel::build(&mesh.positions, &mesh.triangles);
        let warnings = [
            (&scene.object.mesh, mesh_report.to_string()),
            (&scene.probe.image, probe_report.to_string()),
        ]
        .into_iter()
        .filter(|(_, report)| !report.trim().is_empty())
        .map(|(path, report)| format!("{}: {}", path.display(), report.trim()))
        .collect();
        let pyramid = LightPyramid::new(&environment);
        Ok((
            Self {
                clusters: LightClusters::new(&environment, LIGHTS),
                irradiance: Irradiance::new(&pyramid),
                lobe: lobe_table(pyramid, &material, scene),
                patches: Patches::new(&mesh),
                cells: cells_as_places(),
                mesh,
                accel,
                material,
                environment,
                scene: scene.clone(),
            },
            warnings,
        ))
    }

    /// The camera as the object sees it at a turntable angle (radians).
    pub fn view(&self, angle: f64) -> View {
        let object_from_mesh: DAffine3 = self.mesh.object_from_mesh();
        View::new(
            &self.scene.camera,
            &self.scene.turn,
            angle,
            object_from_mesh,
        )
    }

    /// What was read.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }
}

/// Tables of the material's lobe for all directions from which the camera looks.
fn lobe_table(pyramid: LightPyramid, material: &MaterialField, scene: &Scene) -> Option<LobeTable> {
    /// Places along each side of the image: between them lenses bend little.
    const PLACES: usize = 16;
    let lobe = material.uniform_lobe()?;
    let camera = &scene.camera;
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    let to_camera = |place: DVec2| -> Vec3 { -camera.direction(place * size).as_vec3() };
    let border = (0..=PLACES).flat_map(|k| {
        let along = k as f64 / PLACES as f64;
        [(along, 0.0), (along, 1.0), (0.0, along), (1.0, along)]
    });
    LobeTable::new(
        pyramid,
        lobe,
        to_camera(DVec2::splat(0.5)).normalize(),
        border.map(|(x, y)| to_camera(DVec2::new(x, y)).normalize()),
    )
}
