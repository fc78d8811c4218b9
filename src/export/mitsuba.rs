//! A scene for Mitsuba 3 (3.9) that renders the same image.
//!
//! `OUT/scene.xml` refers to `mesh.ply` (object frame), `probe.exr` and one EXR a texture map.
//! Its parameters are `angle_deg`, `spp`, `max_depth`, `sampler`, `width` and `height`:
//!
//! ```text
//! mitsuba -m llvm_ad_rgb -D angle_deg=30 -D spp=256 scene.xml
//! ```
//!
//! What differs between the two renderers is translated here and nowhere else:
//!
//! * the probe has rows on the poles ([`probe`]);
//! * `f = (1 − w) f_diffuse + w f_conductor` with `w = ½`, whose colours are divided by their
//!   share, and a conductor at `k = 0`, which is a dielectric's reflectance ([`material`]);
//! * the camera looks along +Z with x to the *left*, hence is given by `lookat`.
//!
//! The sensor's noise stays out: Mitsuba's image is the radiance.

mod material;
mod ply;
mod probe;
mod xml;

use std::path::Path;

use glam::DVec3;

use self::material::Material;
use self::xml::Xml;
use super::ExportError;
use super::files::write_atomically;
use crate::image::{RgbImage, write_exr};
use crate::mesh::Mesh;
use crate::rig::{Camera, Distortion};
use crate::scene::Scene;

/// Samples a pixel unless the command line says otherwise; Mitsuba rounds it up to a grid.
const SPP: u32 = 64;
/// Longest path in Mitsuba's count, whose 2 is direct light alone.
const MAX_DEPTH: u32 = 4;

/// Writes `scene.xml`, `mesh.ply`, `probe.exr` and the material's maps to the folder `out`.
///
/// `mesh` is the scene's mesh with its pose applied (object frame), `probe` the scene's probe,
/// cleaned and not yet turned by its `rotation_deg`.
///
/// # Errors
/// The scene has a distorted or anamorphic camera or Schlick's Fresnel reflectance; a map needs
/// UVs or vertex properties that the mesh lacks; a file cannot be read or written.
pub fn export_mitsuba(
    scene: &Scene,
    mesh: &Mesh,
    probe: &RgbImage,
    out: &Path,
) -> Result<(), ExportError> {
    check_camera(&scene.camera)?;
    let material = Material::new(&scene.material, mesh)?;
    std::fs::create_dir_all(out).map_err(|error| ExportError::file(out, error))?;
    for (name, image) in &material.textures {
        write_exr(&out.join(name), image)?;
    }
    write_exr(&out.join("probe.exr"), &probe::with_rows_on_poles(probe))?;
    write_atomically(&out.join("mesh.ply"), |file| {
        ply::write(file, mesh, &material.attributes)
    })?;
    // Last, so that a scene.xml in place means that its files are, too.
    let text = scene_xml(scene, mesh, &material);
    write_atomically(&out.join("scene.xml"), |file| {
        std::io::Write::write_all(file, text.as_bytes())
    })
}

/// Refuses cameras that Mitsuba's `perspective` cannot be.
fn check_camera(camera: &Camera) -> Result<(), ExportError> {
    if camera.distortion != Distortion::default() {
        let remedy = "undistort the photographs and set distortion to zeros";
        return Err(ExportError::Unsupported {
            key: "camera.distortion",
            lacks: "lens distortion",
            remedy,
        });
    }
    // A hundredth of a pixel at the image's edge cannot be seen.
    let k = &camera.intrinsics;
    let shift = (k.fy / k.fx - 1.0).abs() * camera.height as f64;
    if shift > 0.01 {
        let remedy = "resample the photographs to square pixels, fx = fy";
        return Err(ExportError::Unsupported {
            key: "camera.fy",
            lacks: "pixels that are not square",
            remedy,
        });
    }
    Ok(())
}

/// The text of `scene.xml`.
fn scene_xml(scene: &Scene, mesh: &Mesh, material: &Material) -> String {
    let mut xml = Xml::default();
    xml.open("scene", &[("version", "3.0.0")]);
    let defaults = [
        ("angle_deg", "0".to_owned()),
        ("spp", SPP.to_string()),
        ("max_depth", MAX_DEPTH.to_string()),
        ("sampler", "multijitter".to_owned()),
        ("width", scene.camera.width.to_string()),
        ("height", scene.camera.height.to_string()),
    ];
    for (name, value) in &defaults {
        xml.leaf("default", &[("name", name), ("value", value)]);
    }

    xml.open("integrator", &[("type", "path")]);
    xml.value("integer", "max_depth", "$max_depth");
    xml.value("integer", "rr_depth", "1000");
    xml.value("boolean", "hide_emitters", "true");
    xml.close();

    sensor(&mut xml, scene, mesh);

    xml.open("emitter", &[("type", "envmap")]);
    xml.value("string", "filename", "probe.exr");
    xml.open("transform", &[("name", "to_world")]);
    let angle = xml::number(scene.probe.rotation.to_degrees());
    xml.leaf("rotate", &[("y", "1"), ("angle", &angle)]);
    xml.close();
    xml.close();

    xml.open("shape", &[("type", "ply")]);
    xml.value("string", "filename", "mesh.ply");
    if !mesh.smooth {
        xml.value("boolean", "face_normals", "true");
    }
    turn(&mut xml, scene);
    material.write(&mut xml);
    xml.close();
    xml.close();
    xml.finish()
}

/// Camera, film and sampler.
fn sensor(xml: &mut Xml, scene: &Scene, mesh: &Mesh) {
    let camera = &scene.camera;
    let k = &camera.intrinsics;
    let (width, height) = (camera.width as f64, camera.height as f64);
    let fov_x = 2.0 * (0.5 * width / k.fx).atan();
    let (near, far) = clip_distances(scene, mesh);
    xml.open("sensor", &[("type", "perspective")]);
    xml.value("string", "fov_axis", "x");
    xml.value("float", "fov", &xml::number(fov_x.to_degrees()));
    // The principal point is at (W (½ − x), H (½ − y)).
    xml.value(
        "float",
        "principal_point_offset_x",
        &xml::number(0.5 - k.cx / width),
    );
    xml.value(
        "float",
        "principal_point_offset_y",
        &xml::number(0.5 - k.cy / height),
    );
    xml.value("float", "near_clip", &xml::number(near));
    xml.value("float", "far_clip", &xml::number(far));

    // The target as far as the turntable, so that rounding turns the view least.
    let [down, forward] = [
        camera.world_from_camera.y_axis,
        camera.world_from_camera.z_axis,
    ];
    let distance = (scene.turn.center - camera.position).length();
    let target = camera.position + forward * if distance > 0.0 { distance } else { 1.0 };
    xml.open("transform", &[("name", "to_world")]);
    let [origin, target, up] = [camera.position, target, -down].map(triple);
    xml.leaf(
        "lookat",
        &[("origin", &origin), ("target", &target), ("up", &up)],
    );
    xml.close();

    xml.open("sampler", &[("type", "$sampler")]);
    xml.value("integer", "sample_count", "$spp");
    xml.close();
    xml.open("film", &[("type", "hdrfilm")]);
    xml.value("integer", "width", "$width");
    xml.value("integer", "height", "$height");
    xml.value("string", "pixel_format", "rgb");
    xml.value("string", "component_format", "float32");
    xml.leaf("rfilter", &[("type", "box")]);
    xml.close();
    xml.close();
}

/// The object's turn by `$angle_deg`: to the centre, about the axis, and back.
fn turn(xml: &mut Xml, scene: &Scene) {
    let translate = |xml: &mut Xml, by: DVec3| {
        let [x, y, z] = by.to_array().map(xml::number);
        xml.leaf("translate", &[("x", &x), ("y", &y), ("z", &z)]);
    };
    xml.open("transform", &[("name", "to_world")]);
    translate(xml, -scene.turn.center);
    let [x, y, z] = scene.turn.axis.to_array().map(xml::number);
    xml.leaf(
        "rotate",
        &[("x", &x), ("y", &y), ("z", &z), ("angle", "$angle_deg")],
    );
    translate(xml, scene.turn.center);
    xml.close();
}

/// Distances that the object stays between at every angle, with room to spare: Mitsuba cuts off
/// what lies outside them.
fn clip_distances(scene: &Scene, mesh: &Mesh) -> (f64, f64) {
    let center = scene.turn.center;
    let radius = mesh
        .positions
        .iter()
        .map(|p| (mesh.origin + mesh.scale * p.as_dvec3() - center).length())
        .fold(0.0, f64::max);
    let distance = (scene.camera.position - center).length();
    let far = 2.0 * (distance + radius);
    // 1e-5: at most 1e5 between near and far, which f32 resolves.
    ((0.5 * (distance - radius)).max(1e-5 * far), far)
}

fn triple(v: DVec3) -> String {
    v.to_array().map(xml::number).join(", ")
}

#[cfg(test)]
mod tests;
