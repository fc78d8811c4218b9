//! Meshes: a file is read as its type promises, or refused.

use std::path::Path;

use glam::Vec3;
use turnlight::accel::Accel;
use turnlight::geometry::Ray;
use turnlight::mesh::{LoadOptions, Mesh};

use super::mutate::Form;
use super::room::FLAT;
use super::{Outcome, Parser, fuzz, seeds};

#[test]
fn ply_is_read_or_refused() {
    fuzz(
        Parser {
            name: "ply",
            file: "shape.ply",
            form: Form::Text,
            seeds: seeds::ply(),
            room: FLAT,
            inputs: 6_000,
        },
        |_| (),
        mesh,
    );
}

#[test]
fn obj_is_read_or_refused() {
    fuzz(
        Parser {
            name: "obj",
            file: "shape.obj",
            form: Form::Text,
            seeds: seeds::obj(),
            room: FLAT,
            inputs: 6_000,
        },
        |_| (),
        mesh,
    );
}

#[test]
fn stl_is_read_or_refused() {
    fuzz(
        Parser {
            name: "stl",
            file: "shape.stl",
            form: Form::Text,
            seeds: seeds::stl(),
            room: FLAT,
            inputs: 6_000,
        },
        |_| (),
        mesh,
    );
}

#[test]
fn gltf_is_read_or_refused() {
    let beside = |folder: &Path| {
        std::fs::write(folder.join(seeds::BUFFER), seeds::gltf_buffer()).unwrap();
    };
    fuzz(
        Parser {
            name: "gltf",
            file: "shape.gltf",
            form: Form::Text,
            seeds: seeds::gltf(),
            room: FLAT,
            inputs: 6_000,
        },
        beside,
        mesh,
    );
}

#[test]
fn glb_is_read_or_refused() {
    fuzz(
        Parser {
            name: "glb",
            file: "shape.glb",
            form: Form::Glb,
            seeds: seeds::glb(),
            room: FLAT,
            inputs: 6_000,
        },
        |_| (),
        mesh,
    );
}

/// A mesh is as its type promises, and rays can be asked of it.
fn mesh(path: &Path) -> Outcome {
    let (mesh, report) =
        Mesh::load(path, &Default::default(), LoadOptions::default()).map_err(|e| e.to_string())?;
    let _ = report.to_string();
    let vertices = mesh.positions.len();
    assert!(!mesh.triangles.is_empty(), "no triangle");
    assert!(
        mesh.triangles
            .as_flattened()
            .iter()
            .all(|&v| (v as usize) < vertices),
        "index out of range"
    );
    assert!(
        mesh.positions
            .iter()
            .all(|p| p.is_finite() && p.abs().max_element() <= 1.0),
        "a position outside the mesh frame"
    );
    assert!(
        mesh.normals.len() == vertices && mesh.normals.iter().all(|n| n.is_normalized()),
        "a normal that is no unit vector"
    );
    assert!(
        mesh.scale > 0.0 && mesh.scale.is_finite() && mesh.origin.is_finite(),
        "frame"
    );
    assert!(
        mesh.uvs
            .iter()
            .all(|uvs| uvs.len() == vertices && uvs.iter().all(|uv| uv.is_finite())),
        "texture coordinates"
    );
    assert!(
        mesh.attributes
            .values()
            .all(|values| values.len() == vertices),
        "attributes"
    );
    let areas = (0..mesh.triangles.len() as u32).map(|t| mesh.geometric_normal(t));
    assert!(
        areas.into_iter().all(|n| n.is_normalized()),
        "a triangle without area"
    );
    let accel = Accel::build(&mesh.positions, &mesh.triangles);
    for direction in [Vec3::NEG_Z, Vec3::X, Vec3::new(0.36, 0.48, 0.8)] {
        let ray = Ray {
            origin: -3.0 * direction,
            direction,
        };
        if let Some(hit) = accel.closest_hit(&ray, f32::INFINITY) {
            assert!((hit.triangle as usize) < mesh.triangles.len(), "hit");
        }
    }
    Ok(())
}
