//! [`Scene`] and [`Capture`] as text that reads back as the same data.

use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::{Component, Path, PathBuf};

use glam::{DVec3, Vec3};
use toml::Value;

use super::{
    Capture, MapSource, MaterialSource, ObjectSource, ProbeSource, Scene, Sensor, SpecularSource,
};
use crate::geometry::Turn;
use crate::rig::{Camera, Intrinsics, Lens};

/// TOML text in the making; paths become relative to `folder` where they share a part with it.
struct Writer<'a> {
    text: String,
    folder: &'a Path,
}

impl Scene {
    /// The text of `scene.toml` for the folder `relative_to`.
    pub fn to_toml(&self, relative_to: &Path) -> String {
        let mut writer = Writer {
            text: String::new(),
            folder: relative_to,
        };
        writer.object(&self.object);
        writer.material(&self.material);
        writer.probe(&self.probe);
        writer.camera(&self.camera);
        writer.turntable(&self.turn);
        writer.angles(&self.angles);
        writer.sensor(self.sensor.as_ref());
        writer.text
    }
}

impl Capture {
    /// The text of `capture.toml` for the folder `relative_to`.
    pub fn to_toml(&self, relative_to: &Path) -> String {
        let mut writer = Writer {
            text: String::new(),
            folder: relative_to,
        };
        writer.object(&self.object);
        writer.probe(&self.probe);
        writer.camera(&self.camera);
        writer.turntable(&self.turn);
        writer.sensor(self.sensor.as_ref());
        for frame in &self.frames {
            writer.line("\n[[frames]]");
            writer.path("image", &frame.image);
            if let Some(mask) = &frame.mask {
                writer.path("mask", mask);
            }
            writer.set("angle_deg", degrees(frame.angle));
            if frame.exposure != 1.0 {
                writer.set("exposure", float(frame.exposure));
            }
        }
        writer.text
    }
}

/// The sections that a calibration or an import knows, to be completed to a scene or a capture.
#[derive(Debug)]
pub struct RigSections<'a> {
    /// Comment lines at the top.
    pub remarks: &'a [String],
    /// Intrinsics.
    pub lens: &'a Lens,
    /// Its place, if known; a comment asks for it otherwise.
    pub camera: Option<&'a Camera>,
    /// Axis and centre, if known.
    pub turn: Option<&'a Turn>,
    /// Images and angles in radians; `[[frames]]` of a capture.
    pub frames: &'a [(PathBuf, f64)],
}

impl RigSections<'_> {
    /// The text for a file in the folder `relative_to`.
    pub fn to_toml(&self, relative_to: &Path) -> String {
        let mut writer = Writer {
            text: String::new(),
            folder: relative_to,
        };
        for line in self.remarks.iter().flat_map(|remark| remark.lines()) {
            writer.line(&format!("# {line}"));
        }
        writer.lens(self.lens);
        match self.camera {
            Some(camera) => writer.place(camera),
            None => writer.line("# position = [x, y, z] and look_at = [x, y, z]: not known yet"),
        }
        if let Some(turn) = self.turn {
            writer.turntable(turn);
        }
        for (image, angle) in self.frames {
            writer.line("\n[[frames]]");
            writer.path("image", image);
            writer.set("angle_deg", degrees(*angle));
        }
        writer.text
    }
}

impl Writer<'_> {
    fn line(&mut self, line: &str) {
        self.text.push_str(
            line.strip_prefix('\n')
                .filter(|_| self.text.is_empty())
                .unwrap_or(line),
        );
        self.text.push('\n');
    }

    fn set(&mut self, key: &str, value: impl std::fmt::Display) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.text, "{key} = {value}");
    }

    fn path(&mut self, key: &str, path: &Path) {
        self.set(key, quoted(&relative(path, self.folder)));
    }

    fn object(&mut self, object: &ObjectSource) {
        self.line("\n[object]");
        self.path("mesh", &object.mesh);
        if object.flat {
            self.set("flat", true);
        }
        let pose = &object.object_from_file;
        if pose.scale != 1.0 {
            self.set("scale", float(pose.scale));
        }
        let rotation = pose.rotation.to_scaled_axis();
        if rotation != DVec3::ZERO {
            let [x, y, z] = rotation.to_array().map(degrees);
            self.set("rotation", format!("[{x}, {y}, {z}]"));
        }
        if pose.translation != DVec3::ZERO {
            self.set("translation", vector(pose.translation));
        }
    }

    fn material(&mut self, material: &MaterialSource) {
        self.line("\n[material]");
        let name = match material.ggx {
            MapSource::Constant(0.0) => Some("beckmann"),
            MapSource::Constant(1.0) => Some("ggx"),
            _ => None,
        };
        match name {
            Some(name) => self.set("ndf", quoted(name)),
            None => self.scalar("ndf", &material.ggx),
        }
        self.scalar("alpha", &material.alpha);
        self.colour("rho_d", &material.rho_d);
        match &material.specular {
            SpecularSource::Dielectric { eta, rho_s } => {
                self.colour("rho_s", rho_s);
                self.set("eta", single(*eta));
            }
            SpecularSource::Schlick { f0, f90 } => {
                self.set("fresnel", quoted("schlick"));
                self.colour("f0", f0);
                self.scalar("f90", f90);
            }
        }
    }

    fn scalar(&mut self, key: &str, map: &MapSource<f32>) {
        self.map(key, map, |x| single(*x));
    }

    fn colour(&mut self, key: &str, map: &MapSource<Vec3>) {
        self.map(key, map, |c| {
            if c.x == c.y && c.y == c.z {
                return single(c.x);
            }
            format!("[{}, {}, {}]", single(c.x), single(c.y), single(c.z))
        });
    }

    fn map<T>(&mut self, key: &str, map: &MapSource<T>, constant: impl Fn(&T) -> String) {
        match map {
            MapSource::Constant(value) => self.set(key, constant(value)),
            MapSource::Texture(path) => self.path(key, path),
            MapSource::Vertex(name) => self.set(key, quoted(&format!("vertex:{name}"))),
        }
    }

    fn probe(&mut self, probe: &ProbeSource) {
        self.line("\n[probe]");
        self.path("image", &probe.image);
        self.set("rotation_deg", degrees(probe.rotation));
    }

    fn camera(&mut self, camera: &Camera) {
        self.lens(&Lens::of(camera));
        self.place(camera);
    }

    fn lens(&mut self, lens: &Lens) {
        self.line("\n[camera]");
        self.set("width", lens.width);
        self.set("height", lens.height);
        let k = &lens.intrinsics;
        let fov_x = 2.0 * (0.5 * lens.width as f64 / k.fx).atan();
        let simple = Intrinsics::from_fov_x(lens.width, lens.height, fov_x);
        let alike = (k.fx - simple.fx).abs().max((k.fy - simple.fy).abs()) <= 1e-12 * k.fx;
        if alike && (k.cx, k.cy) == (simple.cx, simple.cy) {
            self.set("fov_x_deg", degrees(fov_x));
        } else {
            for (key, pixels) in [("fx", k.fx), ("fy", k.fy), ("cx", k.cx), ("cy", k.cy)] {
                self.set(key, float(pixels));
            }
        }
        let d = &lens.distortion;
        let distortion = [d.k1, d.k2, d.p1, d.p2, d.k3];
        if distortion != [0.0; 5] {
            self.set(
                "distortion",
                format!("[{}]", distortion.map(float).join(", ")),
            );
        }
    }

    fn place(&mut self, camera: &Camera) {
        // One step ahead, a step as long as the coordinates so that none of its digits is lost.
        let axes = &camera.world_from_camera;
        let (right, down, forward) = (axes.x_axis, axes.y_axis, axes.z_axis);
        let step = camera.position.abs().max_element().max(1.0);
        self.set("position", vector(camera.position));
        self.set("look_at", vector(camera.position + step * forward));
        // A camera without roll has a level right axis and its head up; others need their up, and so does
        // one that looks so steeply that +Y and the rounded view hardly tell right from left.
        let steep = forward.x.hypot(forward.z) < 1e-3;
        if right.y.abs() > 1e-12 || down.y >= 0.0 || steep {
            self.set("up", vector(-down));
        }
    }

    fn turntable(&mut self, turn: &Turn) {
        self.line("\n[turntable]");
        self.set("axis", vector(turn.axis));
        self.set("center", vector(turn.center));
    }

    fn angles(&mut self, angles: &[f64]) {
        let step = TAU / angles.len().max(1) as f64;
        if angles
            .iter()
            .enumerate()
            .all(|(i, angle)| (angle - step * i as f64).abs() < 1e-14)
        {
            self.set("frames", angles.len());
        } else {
            let all: Vec<String> = angles.iter().map(|&angle| degrees(angle)).collect();
            self.set("angles_deg", format!("[{}]", all.join(", ")));
        }
    }

    fn sensor(&mut self, sensor: Option<&Sensor>) {
        let Some(sensor) = sensor else { return };
        self.line("\n[sensor]");
        self.set("full_well_electrons", float(sensor.full_well_electrons));
        self.set("read_noise_electrons", float(sensor.read_noise_electrons));
        self.set("bits", sensor.bits);
        self.set("exposure", float(sensor.exposure));
    }
}

/// Shortest text that reads back as the same number; Rust's debug form is valid TOML.
fn float(x: f64) -> String {
    format!("{x:?}")
}

fn single(x: f32) -> String {
    format!("{x:?}")
}

fn vector(v: DVec3) -> String {
    format!("[{}]", v.to_array().map(float).join(", "))
}

/// Radians as degrees, short where the short form reads back within rounding (5.0, not
/// 5.000000000000001).
fn degrees(radians: f64) -> String {
    let exact = radians.to_degrees();
    let short = (exact * 1e9).round() / 1e9;
    let loss = (short.to_radians() - radians).abs();
    float(if loss <= 4.0 * f64::EPSILON * radians.abs() {
        short
    } else {
        exact
    })
}

fn quoted(text: &str) -> String {
    Value::from(text).to_string()
}

/// `path` as seen from `folder`, with forward slashes; absolute where only the root is shared.
fn relative(path: &Path, folder: &Path) -> String {
    let (path, folder) = (normal(path), normal(folder));
    let shared = path
        .components()
        .zip(folder.components())
        .take_while(|(a, b)| a == b)
        .count();
    let roots = path
        .components()
        .take_while(|part| !matches!(part, Component::Normal(_)))
        .count();
    if shared <= roots {
        return path.to_string_lossy().into_owned();
    }
    let up = folder.components().skip(shared).map(|_| "..".into());
    let down = path
        .components()
        .skip(shared)
        .map(|part| part.as_os_str().to_string_lossy());
    up.chain(down).collect::<Vec<_>>().join("/")
}

/// Absolute, without `.` and `..` (by name alone, whatever the links).
fn normal(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let mut normal = PathBuf::new();
    for part in absolute.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir => {
                normal.pop();
            }
            other => normal.push(other),
        }
    }
    normal
}
