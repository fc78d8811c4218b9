//! The exported files: their structure, and what is refused.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3, Vec2, Vec3};

use super::*;
use crate::brdf::Ndf;
use crate::geometry::{Similarity, Turn};
use crate::rig::Intrinsics;
use crate::scene::{MapSource, MaterialSource, ObjectSource, ProbeSource, SpecularSource};

fn tetrahedron() -> Mesh {
    let positions = [
        Vec3::ONE,
        Vec3::new(-1.0, -1.0, 1.0),
        Vec3::new(-1.0, 1.0, -1.0),
        Vec3::new(1.0, -1.0, -1.0),
    ];
    let four = |x: f32| vec![x, 0.5, 0.25, 2.0];
    let names = ["alpha", "kd_r", "kd_g", "kd_b"];
    Mesh {
        positions: positions.to_vec(),
        normals: positions.iter().map(|p| p.normalize()).collect(),
        uvs: Some(vec![Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE]),
        attributes: names
            .iter()
            .map(|name| ((*name).to_owned(), four(0.125)))
            .collect(),
        triangles: vec![[0, 1, 3], [0, 2, 1], [0, 3, 2], [1, 2, 3]],
        smooth: true,
        origin: DVec3::new(10.0, 0.0, 0.0),
        scale: 2.0,
    }
}

fn scene() -> Scene {
    let intrinsics = Intrinsics::from_fov_x(64, 48, 0.5);
    let position = DVec3::new(0.0, 1.0, 8.0);
    Scene {
        object: ObjectSource {
            mesh: "mesh.ply".into(),
            object_from_file: Similarity::default(),
            flat: false,
        },
        material: MaterialSource {
            ggx: Ndf::Ggx.into(),
            alpha: MapSource::Constant(0.2),
            rho_d: MapSource::Constant(Vec3::new(0.4, 0.3, 0.9)),
            specular: SpecularSource::Dielectric {
                eta: 1.3,
                rho_s: MapSource::Constant(Vec3::splat(2.35)),
            },
        },
        probe: ProbeSource {
            image: "probe.exr".into(),
            rotation: 0.0,
        },
        camera: Camera::looking_at(
            (64, 48),
            intrinsics,
            Distortion::default(),
            position,
            DVec3::ZERO,
            DVec3::Y,
        )
        .unwrap(),
        turn: Turn {
            axis: DVec3::Y,
            center: DVec3::new(10.0, 0.0, 0.0),
        },
        angles: vec![0.0],
        sensor: None,
    }
}

/// Exports and returns `scene.xml` and `mesh.ply`.
fn export(scene: &Scene, mesh: &Mesh) -> Result<(String, Vec<u8>), String> {
    let folder = tempfile::tempdir().unwrap();
    let probe = RgbImage {
        width: 2,
        height: 1,
        pixels: vec![[1.0; 3]; 2],
    };
    export_mitsuba(scene, mesh, &probe, folder.path()).map_err(|error| error.to_string())?;
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    Ok((
        String::from_utf8(read("scene.xml")).unwrap(),
        read("mesh.ply"),
    ))
}

#[test]
fn scene_names_its_parameters_and_files() {
    let (xml, ply) = export(&scene(), &tetrahedron()).unwrap();
    for expected in [
        r#"<default name="angle_deg" value="0"/>"#,
        r#"<default name="sampler" value="multijitter"/>"#,
        r#"<default name="width" value="64"/>"#,
        r#"<rotate x="0.0" y="1.0" z="0.0" angle="$angle_deg"/>"#,
        r#"<translate x="-10.0" y="0.0" z="0.0"/>"#,
        r#"<rgb name="color" value="0.8, 0.6, 1.8"/>"#,
        r#"<rgb name="color" value="4.7, 4.7, 4.7"/>"#,
        r#"<string name="distribution" value="ggx"/>"#,
    ] {
        assert!(xml.contains(expected), "{expected}\n{xml}");
    }
    assert_eq!(xml.matches("blendbsdf").count(), 1);
    assert!(!xml.contains("face_normals"));
    // Object frame: origin + scale × mesh frame.
    let body = ply
        .windows(11)
        .position(|window| window == b"end_header\n")
        .unwrap()
        + 11;
    let float =
        |i: usize| f32::from_le_bytes(ply[body + 4 * i..body + 4 * i + 4].try_into().unwrap());
    assert_eq!([float(0), float(1), float(2)], [12.0, 2.0, 2.0]);
    assert_eq!(ply.len(), body + 4 * 8 * 4 + 4 * 13);
}

#[test]
fn maps_become_attributes_and_blends() {
    let mut scene = scene();
    scene.material.ggx = MapSource::Constant(0.3);
    scene.material.alpha = MapSource::Vertex("alpha".into());
    scene.material.rho_d = MapSource::Vertex("kd".into());
    let mut mesh = tetrahedron();
    mesh.smooth = false;
    let (xml, ply) = export(&scene, &mesh).unwrap();
    assert_eq!(xml.matches("blendbsdf").count(), 2);
    assert!(
        xml.contains(r#"<string name="name" value="vertex_rho_d"/>"#),
        "{xml}"
    );
    assert!(xml.contains(r#"<boolean name="face_normals" value="true"/>"#));
    let header = String::from_utf8_lossy(&ply);
    let names = "property float t\nproperty float alpha_0\nproperty float rho_d_0\nproperty float rho_d_1\n";
    assert!(header.contains(names) && !header.contains("nx"));
}

#[test]
fn one_vertex_property_makes_a_neutral_colour() {
    let mut scene = scene();
    scene.material.rho_d = MapSource::Vertex("alpha".into());
    let (_, ply) = export(&scene, &tetrahedron()).unwrap();
    let body = ply
        .windows(11)
        .position(|window| window == b"end_header\n")
        .unwrap()
        + 11;
    let row: Vec<f32> = ply[body..body + 44]
        .chunks(4)
        .map(|bytes| f32::from_le_bytes(bytes.try_into().unwrap()))
        .collect();
    // The albedo 0.125 over the diffuse lobe's share of one half.
    assert_eq!(row[8..], [0.25; 3]);
}

#[test]
fn what_mitsuba_cannot_do_is_refused_by_name() {
    let mesh = tetrahedron();
    let error = |change: &dyn Fn(&mut Scene), mesh: &Mesh| {
        let mut scene = scene();
        change(&mut scene);
        export(&scene, mesh).unwrap_err()
    };
    let schlick = |scene: &mut Scene| {
        let f0 = MapSource::Constant(Vec3::ONE);
        scene.material.specular = SpecularSource::Schlick {
            f0,
            f90: MapSource::Constant(1.0),
        };
    };
    assert!(error(&schlick, &mesh).contains("Schlick"));
    assert!(error(&|scene| scene.camera.distortion.k1 = 0.1, &mesh).contains("camera.distortion"));
    assert!(error(&|scene| scene.camera.intrinsics.fy *= 1.01, &mesh).contains("camera.fy"));
    let vertex = |scene: &mut Scene| scene.material.alpha = MapSource::Vertex("rough".into());
    let found = error(&vertex, &mesh);
    assert!(
        found.contains("vertex property rough; it has alpha, kd_b"),
        "{found}"
    );
    let bare = Mesh {
        uvs: None,
        attributes: BTreeMap::new(),
        ..tetrahedron()
    };
    let texture = |scene: &mut Scene| scene.material.alpha = MapSource::Texture("a.exr".into());
    assert!(error(&texture, &bare).contains("alpha: the mesh has no texture coordinates"));
}

#[test]
fn rolled_camera_keeps_its_up() {
    let mut scene = scene();
    scene.camera.world_from_camera *= DMat3::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let (xml, _) = export(&scene, &tetrahedron()).unwrap();
    let up = xml
        .split("up=\"")
        .nth(1)
        .and_then(|rest| rest.split('"').next())
        .unwrap();
    let up: Vec<f64> = up.split(", ").map(|x| x.parse().unwrap()).collect();
    assert!((up[0].abs() - 1.0).abs() < 1e-12, "{up:?}");
}
