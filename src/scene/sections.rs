//! The sections that scenes and captures share, and the frames of a capture.

use std::f64::consts::TAU;
use std::path::Path;

use glam::{DQuat, DVec3};
use toml::Value;

use super::error::Problem;
use super::section::{Checked, FINITE, NON_NEGATIVE, POSITIVE, Range, Section};
use super::{CaptureFrame, ObjectSource, ProbeSource, Sensor};
use crate::geometry::{Similarity, Turn};
use crate::rig::{Camera, CameraError, Distortion, Intrinsics};

const OBJECT_KEYS: [&str; 5] = ["mesh", "scale", "rotation", "translation", "flat"];
const PROBE_KEYS: [&str; 2] = ["image", "rotation_deg"];
const CAMERA_KEYS: [&str; 11] = [
    "width",
    "height",
    "fov_x_deg",
    "fx",
    "fy",
    "cx",
    "cy",
    "distortion",
    "position",
    "look_at",
    "up",
];
const TURNTABLE_KEYS: [&str; 4] = ["axis", "center", "frames", "angles_deg"];
const SENSOR_KEYS: [&str; 4] = [
    "full_well_electrons",
    "read_noise_electrons",
    "bits",
    "exposure",
];
const FRAME_KEYS: [&str; 4] = ["image", "mask", "angle_deg", "exposure"];

/// Pixels on a side.
const LARGEST_IMAGE: i64 = 65536;
/// Frames of a turn: more than a century of video, yet no danger to memory.
const MOST_FRAMES: i64 = 1_000_000;

const FIELD_OF_VIEW: Range = Range {
    holds: |x| x > 0.0 && x < 180.0,
    requirement: "between 0 and 180",
};
const ROTATION: Range = Range {
    holds: |x| x.abs() <= 360.0,
    requirement: "within ±360; rotation is a vector, axis times angle in degrees",
};
const FRAME_EXPOSURE: Range = Range {
    holds: |x| x > 0.0,
    requirement: "> 0; check the EXIF import",
};

/// Where the object stands, and the angles that a scene asks for.
pub(super) struct Turntable {
    pub(super) turn: Turn,
    /// Radians.
    pub(super) angles: Option<Vec<f64>>,
}

/// Reads `[object]`.
pub(super) fn object(top: &Section<'_>, folder: &Path) -> Checked<ObjectSource> {
    let section = need(top, "object", &OBJECT_KEYS, "mesh")?;
    let rotation = section
        .array::<3>("rotation", ROTATION)?
        .unwrap_or_default()
        .map(f64::to_radians);
    Ok(ObjectSource {
        mesh: section.need_file(
            "mesh",
            folder,
            "the name of a glb, gltf, obj, ply or stl file",
        )?,
        object_from_file: Similarity {
            scale: section.number("scale", POSITIVE)?.unwrap_or(1.0),
            rotation: DQuat::from_scaled_axis(DVec3::from_array(rotation)),
            translation: section.vector("translation")?.unwrap_or(DVec3::ZERO),
        },
        flat: section.boolean("flat")?.unwrap_or(false),
    })
}

/// Reads `[probe]`.
pub(super) fn probe(top: &Section<'_>, folder: &Path) -> Checked<ProbeSource> {
    let section = need(top, "probe", &PROBE_KEYS, "image")?;
    Ok(ProbeSource {
        image: section.need_file(
            "image",
            folder,
            "the name of a lat-long HDR image (exr or hdr)",
        )?,
        rotation: section
            .number("rotation_deg", FINITE)?
            .unwrap_or(0.0)
            .to_radians(),
    })
}

/// Reads `[camera]`.
pub(super) fn camera(top: &Section<'_>) -> Checked<Camera> {
    let section = need(
        top,
        "camera",
        &CAMERA_KEYS,
        "width, height, fov_x_deg, position and look_at",
    )?;
    let width = section.need_count("width", 1, LARGEST_IMAGE)? as usize;
    let height = section.need_count("height", 1, LARGEST_IMAGE)? as usize;
    let intrinsics = intrinsics(&section, width, height)?;
    let [k1, k2, p1, p2, k3] = section
        .array::<5>("distortion", FINITE)?
        .unwrap_or_default();
    let distortion = Distortion { k1, k2, p1, p2, k3 };
    let (position, look_at) = (
        section.need_vector("position")?,
        section.need_vector("look_at")?,
    );
    let up = section.direction("up")?.unwrap_or(DVec3::Y);
    Camera::looking_at(
        (width, height),
        intrinsics,
        distortion,
        position,
        look_at,
        up,
    )
    .map_err(|error| camera_problem(&section, error))
}

/// A field of view, or the four numbers of a calibration.
fn intrinsics(section: &Section<'_>, width: usize, height: usize) -> Checked<Intrinsics> {
    const PIXELS: [&str; 4] = ["fx", "fy", "cx", "cy"];
    if let Some(degrees) = section.number("fov_x_deg", FIELD_OF_VIEW)? {
        let other = section.key("fov_x_deg");
        for key in PIXELS {
            section.refuse(key, &other, "fov_x_deg, or fx, fy, cx and cy")?;
        }
        return Ok(Intrinsics::from_fov_x(width, height, degrees.to_radians()));
    }
    if !PIXELS.iter().any(|key| section.has(key)) {
        return Err(section.missing(
            "fov_x_deg",
            "fov_x_deg = 32.0, or fx, fy, cx and cy in pixels",
        ));
    }
    Ok(Intrinsics {
        fx: section.need_number("fx", POSITIVE)?,
        fy: section.need_number("fy", POSITIVE)?,
        cx: section.need_number("cx", FINITE)?,
        cy: section.need_number("cy", FINITE)?,
    })
}

/// A camera's own complaint, under its key.
fn camera_problem(section: &Section<'_>, error: CameraError) -> Problem {
    match error {
        CameraError::View {
            position,
            look_at,
            problem,
        } => Problem::Value {
            key: section.key("look_at"),
            value: look_at.to_string(),
            requirement: format!(
                "in front of position = {position}: the view direction is {problem}; move one of them, or set up"
            ),
        },
        CameraError::Value {
            field,
            value,
            requirement,
        } => Problem::Value {
            key: section.key(field),
            value: value.to_string(),
            requirement: requirement.to_owned(),
        },
    }
}

/// Reads `[turntable]`, which may be absent.
pub(super) fn turntable(top: &Section<'_>) -> Checked<Turntable> {
    let Some(section) = top.section("turntable", &TURNTABLE_KEYS)? else {
        return Ok(Turntable {
            turn: Turn {
                axis: DVec3::Y,
                center: DVec3::ZERO,
            },
            angles: None,
        });
    };
    let turn = Turn {
        axis: section.direction("axis")?.unwrap_or(DVec3::Y),
        center: section.vector("center")?.unwrap_or(DVec3::ZERO),
    };
    let angles = match (
        section.count("frames", 1, MOST_FRAMES)?,
        section.numbers("angles_deg", FINITE)?,
    ) {
        (Some(_), Some(_)) => {
            let key = section.key("angles_deg");
            let (other, remove) = (section.key("frames"), "one of the two".to_owned());
            return Err(Problem::Conflict { key, other, remove });
        }
        (Some(frames), None) => Some(
            (0..frames)
                .map(|i| TAU * i as f64 / frames as f64)
                .collect(),
        ),
        (None, Some(degrees)) if degrees.is_empty() => {
            return Err(section.wrong(
                "angles_deg",
                &Value::Array(Vec::new()),
                "one angle or more",
            ));
        }
        (None, degrees) => degrees.map(|all| all.into_iter().map(f64::to_radians).collect()),
    };
    Ok(Turntable { turn, angles })
}

/// Reads `[sensor]`, which may be absent.
pub(super) fn sensor(top: &Section<'_>) -> Checked<Option<Sensor>> {
    let Some(section) = top.section("sensor", &SENSOR_KEYS)? else {
        return Ok(None);
    };
    Ok(Some(Sensor {
        full_well_electrons: section.need_number("full_well_electrons", POSITIVE)?,
        read_noise_electrons: section.need_number("read_noise_electrons", NON_NEGATIVE)?,
        bits: section.need_count("bits", 1, 32)? as u32,
        exposure: section.number("exposure", POSITIVE)?.unwrap_or(1.0),
    }))
}

/// Reads `[[frames]]`, one at least.
pub(super) fn frames(top: &Section<'_>, folder: &Path) -> Checked<Vec<CaptureFrame>> {
    let frames = top.sections("frames", &FRAME_KEYS)?;
    if frames.is_empty() {
        return Err(top.missing(
            "frames",
            "a section [[frames]] with image and angle_deg for every photograph",
        ));
    }
    let one = |section: &Section<'_>| {
        Ok(CaptureFrame {
            image: section.need_file("image", folder, "the name of a linear RGB image")?,
            mask: section.file("mask", folder)?,
            angle: section.need_number("angle_deg", FINITE)?.to_radians(),
            exposure: section.number("exposure", FRAME_EXPOSURE)?.unwrap_or(1.0),
        })
    };
    frames.iter().map(one).collect()
}

fn need<'a>(top: &Section<'a>, key: &str, known: &[&str], contents: &str) -> Checked<Section<'a>> {
    top.section(key, known)?
        .ok_or_else(|| top.missing(key, format!("a section [{key}] with {contents}")))
}
