//! Every defect is mended and counted, or refused by name.

use super::*;

#[test]
fn zero_area_triangles_go() {
    let mut surface = tetrahedron();
    surface.positions.push(DVec3::new(1.0, 0.0, 0.0)); // the middle of the edge 0–1
    surface.triangles.extend([[0, 0, 1], [2, 2, 2], [0, 4, 1]]);
    let (mesh, report) = from_surface(surface).unwrap();
    assert_eq!((report.zero_area_triangles, mesh.triangles.len()), (3, 4));
    assert_eq!(mesh.positions.len(), 4);
    assert_sound(&mesh);
}

#[test]
fn triangles_that_rounding_collapses_go() {
    // Far smaller than an f32 step at the size of the mesh, though sound in f64.
    let mut surface = tetrahedron();
    let corner = surface.positions[0];
    surface
        .positions
        .extend([corner + 1e-12 * DVec3::X, corner + 1e-12 * DVec3::Y]);
    surface.triangles.push([0, 4, 5]);
    let (mesh, report) = from_surface(surface).unwrap();
    assert_eq!((report.zero_area_triangles, mesh.triangles.len()), (1, 4));
    assert_sound(&mesh);
}

#[test]
fn thin_but_sound_triangles_stay() {
    let positions = vec![DVec3::ZERO, DVec3::X, DVec3::new(0.5, 1e-5, 0.0), DVec3::Y];
    let surface = Surface {
        positions,
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Surface::default()
    };
    let (mesh, report) = from_surface(surface).unwrap();
    assert_eq!((report.zero_area_triangles, mesh.triangles.len()), (0, 2));
}

#[test]
fn duplicate_triangles_go_and_back_faces_stay() {
    let mut surface = tetrahedron();
    surface.positions.push(surface.positions[1]); // a seam's second copy of vertex 1
    surface.triangles.extend([[1, 2, 0], [2, 0, 4]]);
    let (mesh, report) = from_surface(surface).unwrap();
    assert_eq!((report.duplicate_triangles, mesh.triangles.len()), (2, 4));

    let sheet = Surface {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
        triangles: vec![[0, 1, 2], [0, 2, 1]],
        ..Surface::default()
    };
    let (mesh, report) = from_surface(sheet).unwrap();
    assert_eq!((report.duplicate_triangles, mesh.triangles.len()), (0, 2));
    assert_sound(&mesh);
}

#[test]
fn inverted_closed_meshes_are_turned_over_with_their_normals() {
    let mut surface = sphere(4);
    surface.triangles.iter_mut().for_each(|t| t.swap(0, 1));
    surface.normals.iter_mut().flatten().for_each(|n| *n = -*n);
    let (mesh, report) = from_surface(surface).unwrap();
    assert_eq!(
        (report.inverted, report.normals_flipped),
        (1, mesh.positions.len())
    );
    for triangle in 0..mesh.triangles.len() as u32 {
        let n = mesh.geometric_normal(triangle);
        let third = Vec2::splat(1.0 / 3.0);
        assert!(n.dot(mesh.position_at(triangle, third)) > 0.0);
        assert!(n.dot(mesh.normal_at(triangle, third)) > 0.9);
    }
}

#[test]
fn single_inverted_triangles_are_turned_back() {
    let mut surface = sphere(4);
    surface.triangles[17].swap(0, 1);
    let (mesh, report) = from_surface(surface).unwrap();
    assert_eq!(
        (report.inconsistent_edges, report.reoriented_triangles),
        (3, 1)
    );
    assert_eq!((report.inverted, report.is_closed()), (0, true));
    let (expected, _) = from_surface(sphere(4)).unwrap();
    assert_eq!(mesh.geometric_normal(17), expected.geometric_normal(17));
}

#[test]
fn open_meshes_follow_their_normals() {
    let mut surface = Surface {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
        triangles: vec![[0, 2, 1]],
        ..Surface::default()
    };
    surface.normals = Some(vec![Vec3::Z; 3]);
    let (mesh, report) = from_surface(surface).unwrap();
    assert_eq!((report.turned_to_normals, report.boundary_edges), (1, 3));
    assert_eq!(mesh.geometric_normal(0), Vec3::Z);
    assert_eq!(mesh.normals, [Vec3::Z; 3]);
}

#[test]
fn non_manifold_edges_and_components_are_counted() {
    let mut surface = tetrahedron();
    surface.positions.push(DVec3::new(3.0, 0.0, 0.0));
    surface.triangles.push([0, 1, 4]); // a fin
    let far = 5;
    surface
        .positions
        .extend([DVec3::X, DVec3::Y, DVec3::Z].map(|p| p + DVec3::splat(9.0)));
    surface.triangles.push([far, far + 1, far + 2]);
    let (mesh, report) = from_surface(surface).unwrap();
    assert_eq!((report.non_manifold_edges, report.boundary_edges), (1, 5));
    assert_eq!((report.components, report.is_closed()), (2, false));
    assert_sound(&mesh);
}

#[test]
fn non_finite_vertices_take_their_triangles_along() {
    let mut surface = tetrahedron();
    surface
        .positions
        .extend([DVec3::NAN, DVec3::INFINITY, DVec3::splat(1e300)]);
    surface.triangles.extend([[0, 1, 4], [0, 5, 1], [6, 0, 1]]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nan.ply");
    std::fs::write(&path, ply_text(&surface)).unwrap();
    let (mesh, report) = load(&path).unwrap();
    assert_eq!(
        (report.non_finite_vertices, report.non_finite_triangles),
        (3, 3)
    );
    assert_eq!(report.components, 1);
    assert_sound(&mesh);
}

#[test]
fn bad_normals_are_recomputed() {
    let mut surface = sphere(4);
    let normals = surface.normals.as_mut().unwrap();
    let truth = normals.clone();
    normals[20] = Vec3::ZERO;
    normals[21] = Vec3::NAN;
    normals[22] = -normals[22];
    normals[23] *= 1e-15;
    let (mesh, report) = from_surface(surface).unwrap();
    assert_eq!(
        (report.normals_repaired, report.normals_taken),
        (3, mesh.positions.len() - 3)
    );
    for (found, expected) in mesh.normals.iter().zip(&truth) {
        assert!(found.dot(*expected) > 0.99, "{found} is not {expected}");
    }
}

#[test]
fn computed_normals_are_smooth_across_seams() {
    let mut surface = sphere(8);
    let truth = surface.normals.take().unwrap();
    let (mesh, report) = from_surface(surface).unwrap();
    assert_eq!(report.normals_computed, mesh.positions.len());
    for (found, expected) in mesh.normals.iter().zip(&truth) {
        assert!(found.dot(*expected) > 0.999, "{found} is not {expected}");
    }
    let weld = super::super::topology::weld(&mesh.positions);
    for (vertex, first) in weld.iter().enumerate() {
        assert_eq!(mesh.normals[vertex], mesh.normals[*first as usize]);
    }
}

#[test]
fn one_triangle_is_a_mesh() {
    let surface = Surface {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
        triangles: vec![[0, 1, 2]],
        ..Surface::default()
    };
    for (extension, bytes) in encoded(&surface) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("one.{extension}"));
        std::fs::write(&path, bytes).unwrap();
        let (mesh, report) = load(&path).unwrap();
        assert_sound(&mesh);
        assert_eq!(
            (
                mesh.triangles.len(),
                report.boundary_edges,
                report.components
            ),
            (1, 3, 1)
        );
        assert_eq!(mesh.geometric_normal(0), Vec3::Z, "{extension}");
    }
}

#[test]
fn a_million_triangles_load_quickly() {
    let mesh = sphere(354).into_mesh().unwrap();
    assert!(mesh.triangles.len() > 1_000_000);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("million.ply");
    write_ply(&path, &mesh).unwrap();
    let start = std::time::Instant::now();
    let (back, report) = load(&path).unwrap();
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{} triangles in {seconds:.2} s\n{report}",
        back.triangles.len()
    );
    assert!(report.is_closed());
    assert_eq!(back.triangles.len(), mesh.triangles.len());
    // Ten times what one slow core needs in a release build; something is quadratic if it fails.
    assert!(seconds < if cfg!(debug_assertions) { 100.0 } else { 20.0 });
}

#[test]
fn nothing_left_is_an_error_that_says_what_went() {
    let mut surface = tetrahedron();
    surface.positions[0] = DVec3::NAN;
    surface.positions[1] = surface.positions[2];
    let error = from_surface(surface).unwrap_err().to_string();
    assert!(
        error.contains("test surface") && error.contains("3 triangles using"),
        "{error}"
    );
    assert!(error.contains("1 zero-area"), "{error}");
}

#[test]
fn indices_out_of_range_are_refused_by_name() {
    let cases = [
        (
            "ply",
            "3 0 1 2\n",
            "3 0 900 2\n",
            ["face 0: index 900", "4 vertices"],
        ),
        (
            "ply",
            "3 0 1 2\n",
            "3 0 -1 2\n",
            ["face 0: index -1", "4 vertices"],
        ),
        (
            "obj",
            "f 1 2 3\n",
            "f 1 2 9\n",
            ["line 7: face corner `9`", "4 `v` lines"],
        ),
        (
            "obj",
            "f 1 2 3\n",
            "f 1 2 0\n",
            ["line 7: face corner `0`", "numbered from 1"],
        ),
    ];
    for (extension, good, bad, parts) in cases {
        let surface = tetrahedron();
        let text = if extension == "ply" {
            ply_text(&surface)
        } else {
            obj_text(&surface)
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("wrong.{extension}"));
        std::fs::write(&path, text.replacen(good, bad, 1)).unwrap();
        let error = load(&path).unwrap_err().to_string();
        assert!(error.contains(&format!("wrong.{extension}")), "{error}");
        assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    }
    let mut surface = tetrahedron();
    surface.triangles[2][1] = 77;
    let error = from_surface(surface.clone()).unwrap_err().to_string();
    assert!(error.contains("face 2: index 77"), "{error}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wrong.glb");
    std::fs::write(&path, glb(&surface)).unwrap();
    let error = load(&path).unwrap_err().to_string();
    assert!(
        error.contains("wrong.glb: nodes[1]") && error.contains("index 77"),
        "{error}"
    );
}

#[test]
fn truncated_files_name_themselves() {
    let surface = sphere(3);
    for (extension, bytes) in encoded(&surface) {
        // An OBJ that ends between two faces is a sound file; cut it among its vertices.
        for part in if extension == "obj" {
            [0.0, 0.1, 0.2]
        } else {
            [0.0, 0.5, 0.97]
        } {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join(format!("cut.{extension}"));
            std::fs::write(&path, &bytes[..(bytes.len() as f64 * part) as usize]).unwrap();
            let error = load(&path).unwrap_err().to_string();
            assert!(
                error.contains(&format!("cut.{extension}")),
                "{part}: {error}"
            );
        }
    }
}

#[test]
fn counts_beyond_the_file_are_refused_quickly() {
    let header = |count: &str| {
        format!(
            "ply\nformat binary_little_endian 1.0\nelement nothing 4000000000000000000\n\
             element vertex {count}\nproperty float x\nproperty float y\nproperty float z\n\
             element face 1\nproperty list uint int vertex_indices\nend_header\n"
        )
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("huge.ply");
    for count in ["4000000000", "18446744073709551615"] {
        let bytes = [header(count).as_bytes(), &[0; 1000]].concat();
        std::fs::write(&path, bytes).unwrap();
        let error = load(&path).unwrap_err().to_string();
        assert!(error.contains("huge.ply: element vertex: count"), "{error}");
    }
    let bytes = [header("1").as_bytes(), &[0; 12], &[255; 40]].concat();
    std::fs::write(&path, bytes).unwrap();
    let error = load(&path).unwrap_err().to_string();
    assert!(error.contains("face 0: vertex_indices"), "{error}");
    let path = folder.path().join("huge.stl");
    std::fs::write(&path, [255; 100]).unwrap();
    assert!(
        load(&path)
            .unwrap_err()
            .to_string()
            .contains("4294967295 triangles")
    );
}

#[test]
fn gltf_refuses_compression_cycles_and_missing_buffers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("odd.gltf");
    let asset = r#""asset":{"version":"2.0"},"scenes":[{"nodes":[0]}]"#;
    let cases = [
        (
            r#""extensionsRequired":["KHR_draco_mesh_compression"]"#,
            "`KHR_draco_mesh_compression` is not supported",
        ),
        (
            r#""nodes":[{"children":[1]},{"children":[0]}]"#,
            "nodes[0]: is a child twice",
        ),
        (
            r#""nodes":[{}],"buffers":[{"uri":"no%20such%FF.bin","byteLength":4}]"#,
            "buffers[0]: `no such",
        ),
        (
            r#""nodes":[{}],"buffers":[{"uri":"https://a.b/c","byteLength":4}]"#,
            "only files beside",
        ),
        (
            r#""nodes":[{}],"buffers":[{"uri":"data:application/octet-stream;base64,AAAA","byteLength":40}]"#,
            "of 40",
        ),
        (r#""nodes":[{}]"#, "no triangle is left"),
        (r#""nodes":[{"mesh":3}]"#, "glTF"),
        (
            r#""nodes":[{}],"meshes":[{"primitives":[{"attributes":{"POSITION":5}}]}]"#,
            "meshes[0]: accessor 5: the file has 0",
        ),
    ];
    for (content, expected) in cases {
        std::fs::write(&path, format!("{{{asset},{content}}}")).unwrap();
        let error = load(&path).unwrap_err().to_string();
        assert!(
            error.contains("odd.gltf") && error.contains(expected),
            "{error}"
        );
    }
}

#[test]
fn partial_uvs_are_left_out_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("half.obj");
    std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3\n").unwrap();
    let (mesh, report) = load(&path).unwrap();
    assert!(mesh.uvs.is_none());
    assert_eq!(report.missing_uvs, 1);
}

#[test]
fn unknown_extensions_and_missing_files_are_named() {
    let error = load(Path::new("cup.fbx")).unwrap_err().to_string();
    assert!(
        error.contains("cup.fbx") && error.contains("`fbx`"),
        "{error}"
    );
    let error = load(Path::new("no such.ply")).unwrap_err().to_string();
    assert!(error.contains("no such.ply: cannot be read"), "{error}");
    let place = Similarity {
        scale: 0.0,
        ..Similarity::default()
    };
    let result = Mesh::from_surface(
        tetrahedron(),
        &place,
        LoadOptions::default(),
        Path::new("a.ply"),
    );
    assert!(result.unwrap_err().to_string().contains("scale 0"));
}

#[test]
fn report_prints_a_line_for_each_finding() {
    let mut surface = tetrahedron();
    surface.triangles.push([0, 0, 1]);
    surface.positions.push(DVec3::ZERO);
    let (_, report) = from_surface(surface).unwrap();
    let expected = "1 connected pieces\n1 zero-area triangles dropped\n\
                    1 unreferenced vertices dropped\n4 normals computed\n";
    assert_eq!(report.to_string(), expected);
}
