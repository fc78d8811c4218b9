//! `turnlight camera import`.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DQuat, DVec3};
use serde_json::json;

use super::{Import, Up, folder_of, overlay};
use crate::cli::arguments::Common;
use crate::cli::failure::Failure;
use crate::cli::outputs::check_outputs;
use crate::cli::progress::{note, say, write_stats, write_text};
use crate::geometry::Turn;
use crate::rig::{Camera, ImportChoices, Imported, Orbit, fit_orbit, import};
use crate::scene::RigSections;

/// A camera that stands still before a turntable, world +Y up.
struct Placed {
    camera: Camera,
    turn: Option<Turn>,
    frames: Vec<(PathBuf, f64)>,
    /// The turn from the file's world to turnlight's.
    world_from_file: DQuat,
}

pub(super) fn run(arguments: &Import, common: &Common) -> Result<(), Failure> {
    check_outputs([
        ("--out", Some(arguments.out.as_path())),
        ("--overlay", arguments.overlay.as_deref()),
    ])?;
    let choices = ImportChoices {
        camera: arguments.camera,
        size: arguments.size,
        keys: arguments.keys.clone(),
    };
    let imported = import(&arguments.source, &choices)?;
    let mut remarks = vec![format!(
        "turnlight camera import: {} ({})",
        arguments.source.display(),
        imported.format
    )];
    let mut statistics = json!({ "format": imported.format, "frames": imported.shots.len() });
    let placed = if arguments.lens_only || imported.shots.is_empty() {
        None
    } else {
        Some(place(arguments, &imported, &mut remarks, &mut statistics)?)
    };
    if let Some(placed) = &placed {
        remarks.extend(object_remark(placed.world_from_file));
    }
    let turn = placed.as_ref().and_then(|placed| placed.turn.as_ref());
    let text = RigSections {
        remarks: &remarks,
        lens: &imported.lens,
        camera: placed.as_ref().map(|placed| &placed.camera),
        turn,
        frames: placed.as_ref().map_or(&[], |placed| &placed.frames),
    }
    .to_toml(folder_of(&arguments.out));
    if let (Some(mesh), Some(out)) = (&arguments.mesh, &arguments.overlay) {
        let Some(placed) = &placed else {
            return Err(Failure::Input(anyhow::anyhow!(
                "{}: --overlay needs a pose, and the file has none",
                arguments.source.display()
            )));
        };
        let photograph = image_folder(arguments, &imported).join(&imported.shots[0].image);
        overlay::write(
            out,
            mesh,
            &photograph,
            &placed.camera,
            placed.world_from_file,
        )?;
    }
    write_text(&arguments.out, &text)?;
    remarks.iter().for_each(|remark| say(remark));
    note(
        common,
        &format!(
            "{}: written; add {} to make it a capture.toml",
            arguments.out.display(),
            if turn.is_some() {
                "[object] and [probe]"
            } else {
                "the missing sections"
            }
        ),
    );
    write_stats(common, &statistics)
}

/// The camera in turnlight's world, from one pose or from a turntable's.
fn place(
    arguments: &Import,
    imported: &Imported,
    remarks: &mut Vec<String>,
    statistics: &mut serde_json::Value,
) -> Result<Placed, Failure> {
    let poses: Vec<DAffine3> = imported
        .shots
        .iter()
        .map(|shot| shot.object_from_camera)
        .collect();
    let orbit = if poses.len() == 1 {
        None
    } else {
        Some(fit_orbit(&poses).map_err(|error| {
            let source = arguments.source.display();
            Failure::Data(anyhow::anyhow!("{source}: {error}"))
        })?)
    };
    if let Some(Orbit { errors, .. }) = &orbit {
        remarks.push(format!(
            "{} poses; left between them and a turntable: {:.4}° and {:.4} % of the camera's distance from the \
             axis, root mean square; worst frame {}: {:.4}°, {:.4} %",
            poses.len(),
            errors.rotation.to_degrees(),
            100.0 * errors.position,
            imported.shots[errors.worst_frame].image.display(),
            errors.worst_rotation.to_degrees(),
            100.0 * errors.worst_position,
        ));
        statistics["rotation_error_deg"] = json!(errors.rotation.to_degrees());
        statistics["position_error_of_distance"] = json!(errors.position);
    }
    let file_from_camera = orbit
        .as_ref()
        .map_or(poses[0], |orbit| orbit.world_from_camera);
    let up = up(arguments, imported, orbit.as_ref())?;
    let world_from_file = upright(up);
    let matrix = DMat3::from_quat(world_from_file);
    let pose = DAffine3::from_mat3(matrix) * file_from_camera;
    let camera = imported
        .lens
        .camera(pose.translation, pose.matrix3.z_axis, pose.matrix3.y_axis)
        .map_err(|error| anyhow::anyhow!("{}: {error}", arguments.source.display()))?;
    let turn = orbit.as_ref().map(|orbit| Turn {
        axis: matrix * orbit.turn.axis,
        center: matrix * orbit.turn.center,
    });
    let folder = image_folder(arguments, imported);
    let frames = orbit.as_ref().map_or_else(Vec::new, |orbit| {
        imported
            .shots
            .iter()
            .zip(&orbit.angles)
            .map(|(shot, angle)| (folder.join(&shot.image), *angle))
            .collect()
    });
    Ok(Placed {
        camera,
        turn,
        frames,
        world_from_file,
    })
}

/// What COLMAP's names are relative to; other formats' names come resolved.
fn image_folder(arguments: &Import, imported: &Imported) -> PathBuf {
    if !imported.format.starts_with("COLMAP") {
        return PathBuf::new();
    }
    if let Some(folder) = &arguments.images {
        return folder.clone();
    }
    let source = &arguments.source;
    let folder = if source.is_dir() {
        source
    } else {
        source.parent().unwrap_or(Path::new(""))
    };
    let images = folder.join("images");
    if images.is_dir() {
        images
    } else {
        folder.to_owned()
    }
}

/// The file's direction that becomes +Y.
fn up(arguments: &Import, imported: &Imported, orbit: Option<&Orbit>) -> Result<DVec3, Failure> {
    Ok(match (arguments.up, orbit) {
        (Some(Up::X), _) => DVec3::X,
        (Some(Up::Y), _) => DVec3::Y,
        (Some(Up::Z), _) => DVec3::Z,
        (Some(Up::MinusX), _) => -DVec3::X,
        (Some(Up::MinusY), _) => -DVec3::Y,
        (Some(Up::MinusZ), _) => -DVec3::Z,
        (Some(Up::Axis), Some(orbit)) => orbit.turn.axis,
        (Some(Up::Axis), None) => {
            return Err(Failure::Input(anyhow::anyhow!(
                "--up axis: one pose has no turntable's axis; name x, y or z"
            )));
        }
        (None, _) => imported.up.unwrap_or(DVec3::Y),
    })
}

/// The shortest turn that takes `up` to +Y.
fn upright(up: DVec3) -> DQuat {
    DQuat::from_rotation_arc(up, DVec3::Y)
}

/// How to turn a mesh that stands in the file's coordinates.
fn object_remark(world_from_file: DQuat) -> Option<String> {
    let turn = world_from_file.to_scaled_axis();
    if turn.length() < 1e-12 {
        return None;
    }
    let degrees = turn
        .to_array()
        .map(|radians| format!("{:?}", (radians.to_degrees() * 1e9).round() / 1e9));
    Some(format!(
        "the file's world was turned to have +Y up; for a mesh in its coordinates write in [object]:\n\
         rotation = [{}]",
        degrees.join(", ")
    ))
}
