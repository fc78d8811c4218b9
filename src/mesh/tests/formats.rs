//! The same shape comes out of every format, at any size and place.

use glam::DQuat;

use super::*;

#[test]
fn every_format_gives_the_same_geometry() {
    let surface = sphere(3);
    let expected = corners(&surface.clone().into_mesh().unwrap());
    let folder = written(&surface);
    for (extension, _) in encoded(&surface) {
        let (mesh, report) = load(&folder.path().join(format!("shape.{extension}"))).unwrap();
        assert_sound(&mesh);
        assert_eq!(mesh.triangles.len(), 72, "{extension}");
        for (found, expected) in corners(&mesh).iter().zip(&expected) {
            assert!(
                found.distance(*expected) < 3e-7,
                "{extension}: {found} is not {expected}"
            );
        }
        assert!(report.is_closed(), "{extension}: {report}");
        assert_eq!(
            (report.components, report.inverted, report.normals_repaired),
            (1, 0, 0)
        );
        assert_eq!(mesh.smooth, !extension.eq_ignore_ascii_case("stl"));
    }
}

#[test]
fn every_format_gives_the_same_normals_and_uvs() {
    let surface = sphere(3);
    let folder = written(&surface);
    for extension in ["ply", "obj", "glb"] {
        let (mesh, report) = load(&folder.path().join(format!("shape.{extension}"))).unwrap();
        assert_eq!(report.normals_taken, mesh.positions.len());
        let uvs = mesh.uvs.as_ref().unwrap();
        for (triangle, expected) in mesh.triangles.iter().zip(&surface.triangles) {
            for (found, expected) in triangle.iter().zip(expected) {
                let (found, expected) = (*found as usize, *expected as usize);
                let normal = surface.normals.as_ref().unwrap()[expected];
                assert!(mesh.normals[found].distance(normal) < 1e-6, "{extension}");
                assert!(uvs[found].distance(surface.uvs.as_ref().unwrap()[expected]) < 1e-6);
            }
        }
    }
}

#[test]
fn binary_ply_of_either_endianness_equals_text() {
    let surface = tetrahedron();
    let folder = written(&surface);
    let (expected, _) = load(&folder.path().join("shape.ply")).unwrap();
    for (name, big) in [("binary_big_endian", true), ("binary_little_endian", false)] {
        let mut bytes = format!(
            "ply\r\nformat {name} 1.0\r\nobj_info none\r\nelement vertex 4\r\nproperty uchar red\r\n\
             property double x\r\nproperty float y\r\nproperty double z\r\n\
             property list uchar short junk\r\nelement junk 2\r\nproperty short a\r\n\
             element face 4\r\nproperty uchar flag\r\nproperty list uint ushort vertex_indices\r\n\
             end_header\r\n"
        )
        .into_bytes();
        let mut put = |mut word: Vec<u8>| {
            if big {
                word.reverse();
            }
            bytes.extend(word);
        };
        for p in &surface.positions {
            put(vec![51]);
            put(p.x.to_le_bytes().to_vec());
            put((p.y as f32).to_le_bytes().to_vec());
            put(p.z.to_le_bytes().to_vec());
            put(vec![2]);
            put(vec![9, 9]);
            put(vec![9, 9]);
        }
        put(vec![0; 4]);
        for triangle in &surface.triangles {
            put(vec![7]);
            put(3u32.to_le_bytes().to_vec());
            triangle
                .iter()
                .for_each(|v| put((*v as u16).to_le_bytes().to_vec()));
        }
        let path = folder.path().join("binary.ply");
        std::fs::write(&path, bytes).unwrap();
        let (mesh, _) = load(&path).unwrap();
        assert_eq!(mesh.positions, expected.positions, "{name}");
        assert_eq!(mesh.triangles, expected.triangles, "{name}");
        assert_eq!(mesh.attributes["red"], vec![0.2; 4], "a colour of 51/255");
    }
}

#[test]
fn mesh_frame_forgets_size_and_place() {
    let reference = sphere(6).into_mesh().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("moved.ply");
    for size in [1e-6, 1.0, 1e6] {
        for distance in [0.0, 1e6] {
            let mut surface = sphere(6);
            let place = 2.0 * size * distance * DVec3::new(1.0, -0.5, 0.25);
            surface
                .positions
                .iter_mut()
                .for_each(|p| *p = place + size * *p);
            std::fs::write(&path, ply_text(&surface)).unwrap();
            let (mesh, report) = load(&path).unwrap();
            assert_eq!(
                mesh.triangles, reference.triangles,
                "size {size}, distance {distance}"
            );
            assert!((mesh.scale / size - 1.0).abs() < 1e-9);
            assert!(report.is_closed(), "{report}");
            for (found, expected) in mesh.positions.iter().zip(&reference.positions) {
                assert!(
                    found.distance(*expected) < 1e-6,
                    "size {size}, distance {distance}"
                );
            }
        }
    }
}

#[test]
fn object_transform_is_applied_before_rounding() {
    let folder = written(&sphere(4));
    let path = folder.path().join("shape.ply");
    let place = Similarity {
        scale: 1e-3,
        rotation: DQuat::from_rotation_x(0.7),
        translation: DVec3::new(1e5, 2.0, -3.0),
    };
    let (plain, _) = load(&path).unwrap();
    let (moved, _) = Mesh::load(&path, &place, LoadOptions { flat: true }).unwrap();
    assert!(!moved.smooth);
    let error = |(found, p): (DVec3, DVec3)| found.distance(place.affine().transform_point3(p));
    let largest = corners(&moved)
        .into_iter()
        .zip(corners(&plain))
        .map(error)
        .fold(0.0, f64::max);
    assert!(largest < 3e-7 * place.scale, "{largest}");
    for (found, n) in moved.normals.iter().zip(&plain.normals) {
        assert!(found.distance(place.rotation.as_quat() * *n) < 1e-6);
    }
}

#[test]
fn written_ply_loads_as_the_same_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("written.ply");
    for origin in [
        DVec3::ZERO,
        DVec3::new(3.0, 0.0, 0.0),
        DVec3::new(0.0, 1e7, 0.0),
    ] {
        let mut mesh = cup().into_mesh().unwrap();
        mesh.origin = origin;
        let ramp = (0..mesh.positions.len())
            .map(|v| v as f32)
            .collect::<Vec<_>>();
        mesh.attributes.insert("alpha".into(), ramp.clone());
        write_ply(&path, &mesh).unwrap();
        let (back, report) = load(&path).unwrap();
        assert_eq!(back.triangles, mesh.triangles, "{report}");
        assert_eq!(back.attributes["alpha"], ramp);
        let close = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).all(|(a, b)| a.distance(*b) < 1e-6);
        assert!(close(&back.positions, &mesh.positions) && close(&back.normals, &mesh.normals));
        let uvs = back.uvs.unwrap().into_iter().zip(mesh.uvs.unwrap());
        assert!(uvs.into_iter().all(|(a, b)| a.distance(b) < 1e-6));
        assert!(back.origin.distance(origin) < 1e-6);
    }
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        1,
        "no part is left behind"
    );
}

#[test]
fn written_ply_refuses_what_it_cannot_give_back() {
    let mut mesh = tetrahedron().into_mesh().unwrap();
    mesh.attributes.insert("my alpha".into(), vec![0.0; 4]);
    let error = write_ply(Path::new("never.ply"), &mesh).unwrap_err();
    assert!(error.to_string().contains("`my alpha`"), "{error}");
    mesh.attributes.clear();
    let error = write_ply(Path::new("no such folder/never.ply"), &mesh).unwrap_err();
    assert!(error.to_string().contains("never.ply"), "{error}");
}

#[test]
fn obj_reads_polygons_negative_indices_colors_and_joined_lines() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("quad.obj");
    let text = "mtllib none.mtl\r\nv 0 0 0 1 0 0\r\nv 1 0 0 0 1 0\r\nv 1 1 0 0 0 1\r\n\
                v 0 1 0 1 1 1 # white\r\nvt 0.25 0.75\r\nusemtl paint\r\n\
                f 1/1 -3/1 \\\r\n 3/1 4/-1\r\nf 1 2\r\n";
    std::fs::write(&path, text).unwrap();
    let (mesh, report) = load(&path).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(
        (
            report.polygons_split,
            report.short_faces,
            report.boundary_edges
        ),
        (1, 1, 4)
    );
    assert_eq!(mesh.attributes["green"], [0.0, 1.0, 0.0, 1.0]);
    assert_eq!(mesh.uvs.unwrap()[0], Vec2::new(0.25, 0.25));
}

#[test]
fn shared_meshes_load() {
    let names = [
        ("meshes/spot/spot_triangulated.obj", 5_856, true),
        ("meshes/bob/bob_tri.obj", 10_688, true),
        ("meshes/khronos_suzanne/Suzanne.gltf", 3_936, false),
        ("meshes/waterbottle/WaterBottle.gltf", 4_510, false),
        ("meshes/flighthelmet/FlightHelmet.gltf", 94_722, false),
    ];
    for (name, triangles, watertight) in names {
        let Some(path) = shared(name) else { continue };
        let start = std::time::Instant::now();
        let (mesh, report) = load(&path).unwrap();
        println!("{name}: {:?}\n{report}", start.elapsed());
        assert_sound(&mesh);
        assert!(mesh.uvs.is_some() && mesh.smooth);
        let dropped = report.zero_area_triangles + report.duplicate_triangles;
        assert_eq!(mesh.triangles.len() + dropped, triangles, "{name}");
        assert!(!watertight || report.is_closed(), "{name}: {report}");
    }
}
