//! A turntable with a shipped object, its masks, and how far a result is from the truth.

use glam::{DQuat, DVec2, DVec3};
use std::path::Path;

use crate::accel::Accel;
use crate::geometry::{Similarity, Turn};
use crate::image::{Mask, RgbImage};
use crate::mesh::{LoadOptions, Mesh, Surface};
use crate::rig::registration::*;
use crate::rig::{Camera, Distortion, Intrinsics, View};

/// A camera, an object and its turntable, and how they look.
pub(super) struct Rig {
    pub(super) camera: Camera,
    load: Box<dyn Fn(&Similarity) -> Mesh + Sync>,
    pub(super) mesh: Mesh,
    accel: Accel,
    pub(super) truth: Placement,
}

pub(super) fn shipped(name: &'static str) -> Box<dyn Fn(&Similarity) -> Mesh + Sync> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes");
    Box::new(move |pose| {
        Mesh::load(&folder.join(name), pose, LoadOptions::default())
            .unwrap()
            .0
    })
}

pub(super) fn made(surface: fn() -> Surface) -> Box<dyn Fn(&Similarity) -> Mesh + Sync> {
    Box::new(move |pose| {
        Mesh::from_surface(surface(), pose, LoadOptions::default(), Path::new("made"))
            .unwrap()
            .0
    })
}

impl Rig {
    pub(super) fn new(
        load: Box<dyn Fn(&Similarity) -> Mesh + Sync>,
        pixels: usize,
        frames: usize,
    ) -> Self {
        let mesh = load(&Similarity::default());
        let accel = Accel::build(&mesh.positions, &mesh.triangles);
        let camera = Camera::looking_at(
            (pixels, pixels),
            Intrinsics::from_fov_x(pixels, pixels, 32f64.to_radians()),
            Distortion::default(),
            DVec3::new(0.0, 1.37, 3.76),
            DVec3::ZERO,
            DVec3::Y,
        );
        let angle = |t| std::f64::consts::TAU * t as f64 / frames as f64;
        Self {
            camera: camera.unwrap(),
            load,
            mesh,
            accel,
            truth: Placement {
                object_from_file: Similarity::default(),
                turn: Turn {
                    axis: DVec3::Y,
                    center: DVec3::ZERO,
                },
                angles: (0..frames).map(angle).collect(),
            },
        }
    }

    /// The masks by their contract: covered shares, by 64 points spread evenly over each pixel, or 255 for
    /// whole pixels, by 8 × 8 points up to its corners.
    pub(super) fn masks(&self, whole: bool) -> Vec<Mask> {
        (0..self.truth.angles.len())
            .map(|frame| self.mask(frame, whole))
            .collect()
    }

    pub(super) fn mask(&self, frame: usize, whole: bool) -> Mask {
        const SIDE: usize = 8;
        let pose = &self.truth.object_from_file;
        let mesh_from_file = pose.affine() * self.mesh.object_from_mesh();
        let view = View::new(
            &self.camera,
            &self.truth.turn,
            self.truth.angles[frame],
            mesh_from_file,
        );
        let (width, height) = (self.camera.width, self.camera.height);
        let meets = |x: f64, y: f64| {
            self.accel
                .occluded(&view.ray(DVec2::new(x, y)), f32::INFINITY)
        };
        let corners: Vec<bool> = (0..(width + 1) * (height + 1))
            .map(|i| meets((i % (width + 1)) as f64, (i / (width + 1)) as f64))
            .collect();
        let pixels = (0..width * height).map(|i| {
            let (x, y) = (i % width, i / width);
            // Only the border's pixels, and thin parts, need more than their surroundings' corners.
            let around = (0..4).flat_map(|dy| (0..4).map(move |dx| (x + dx, y + dy)));
            let near = around
                .filter(|(x, y)| *x > 0 && *y > 0 && *x <= width + 1 && *y <= height + 1)
                .map(|(x, y)| corners[(y - 1) * (width + 1) + x - 1]);
            let (mut all, mut any) = (true, false);
            near.for_each(|corner| (all, any) = (all && corner, any || corner));
            if all || !any {
                return 255 * u8::from(all);
            }
            let mut shift = Random(i as u64);
            let (u, v) = (shift.uniform(), shift.uniform());
            let hits = (0..SIDE * SIDE).filter(|k| {
                let place = if whole {
                    DVec2::new((k % SIDE) as f64, (k / SIDE) as f64) / (SIDE - 1) as f64
                } else {
                    // The R2 sequence (Roberts 2018), shifted at random.
                    let k = *k as f64;
                    DVec2::new(
                        (u + 0.754_877_666_246_692_8 * k).fract(),
                        (v + 0.569_840_290_998_053_3 * k).fract(),
                    )
                };
                meets(x as f64 + place.x, y as f64 + place.y)
            });
            let hits = hits.count();
            if whole {
                255 * u8::from(hits == SIDE * SIDE)
            } else {
                ((hits * 255) / (SIDE * SIDE)) as u8
            }
        });
        Mask {
            width,
            height,
            pixels: pixels.collect(),
        }
    }

    /// Another place of object and turntable, up to 20° and a tenth of the size from here.
    pub(super) fn placed_at_random(mut self, random: &mut Random) -> Self {
        let amount = |random: &mut Random, most: f64| most * random.uniform() * random.direction();
        let pose = &mut self.truth.object_from_file;
        pose.rotation = DQuat::from_scaled_axis(amount(random, 20f64.to_radians()));
        pose.translation = amount(random, 0.1);
        let tilt = DQuat::from_scaled_axis(amount(random, 20f64.to_radians()));
        self.truth.turn.axis = (tilt * DVec3::Y).normalize();
        self.truth.turn.center = amount(random, 0.1);
        self
    }

    /// A photograph under a lamp at the camera's left, before a dark wall: means over 4 × 4 points of each pixel.
    pub(super) fn lit(&self, frame: usize) -> RgbImage {
        const SIDE: usize = 4;
        let pose = &self.truth.object_from_file;
        let mesh_from_file = pose.affine() * self.mesh.object_from_mesh();
        let angle = self.truth.angles[frame];
        let view = View::new(&self.camera, &self.truth.turn, angle, mesh_from_file);
        RgbImage::from_fn(self.camera.width, self.camera.height, |x, y| {
            let mut sum = 0.0;
            for k in 0..SIDE * SIDE {
                let inside = DVec2::new((k % SIDE) as f64, (k / SIDE) as f64) + 0.5;
                let ray = view.ray(DVec2::new(x as f64, y as f64) + inside / SIDE as f64);
                let lamp = view.ray(DVec2::new(0.0, 0.5 * y as f64)).direction;
                sum += match self.accel.closest_hit(&ray, f32::INFINITY) {
                    Some(hit) => {
                        let normal = self.mesh.geometric_normal(hit.triangle);
                        0.25 + 0.7 * normal.dot(-lamp).abs()
                    }
                    None => 0.05,
                };
            }
            [sum / (SIDE * SIDE) as f32; 3]
        })
    }

    pub(super) fn register(
        &self,
        start: &Placement,
        masks: &[Mask],
        settings: &Settings,
    ) -> Result<Registered, RegistrationError> {
        let border = MaskBorder::of(&masks.iter().collect::<Vec<_>>());
        let observe = |mask| Observed::new(Some((mask, border)), None);
        let observed: Vec<Observed> = masks.iter().map(observe).collect();
        self.register_observed(start, &observed, settings)
    }

    pub(super) fn register_observed(
        &self,
        start: &Placement,
        observed: &[Observed],
        settings: &Settings,
    ) -> Result<Registered, RegistrationError> {
        let mesh = (self.load)(&start.object_from_file);
        let accel = Accel::build(&mesh.positions, &mesh.triangles);
        register(&mesh, &accel, &self.camera, start, observed, settings)
    }

    /// The truth, off by `degrees` and a share of the object's diameter, in pose and turntable.
    pub(super) fn off(&self, random: &mut Random, degrees: f64, share: f64) -> Placement {
        let shift = share * 2.0 * f64::from(self.mesh.bounding_radius()) * self.mesh.scale;
        let truth = &self.truth;
        let mut start = truth.clone();
        let turn =
            |random: &mut Random| DQuat::from_axis_angle(random.direction(), degrees.to_radians());
        start.object_from_file.rotation = turn(random) * truth.object_from_file.rotation;
        start.object_from_file.translation += shift * random.direction();
        let axis = truth.turn.axis;
        let tilt = axis.cross(random.direction()).normalize();
        start.turn.axis = DQuat::from_axis_angle(tilt, degrees.to_radians()) * axis;
        start.turn.center += shift * axis.cross(random.direction()).normalize();
        start
    }

    /// How far a placement is from the truth.
    pub(super) fn errors(&self, found: &Placement) -> Errors {
        let truth = &self.truth;
        let turned = found.object_from_file.rotation * truth.object_from_file.rotation.inverse();
        let world = |placement: &Placement, frame: usize, point: DVec3| {
            let placed = placement.object_from_file.affine().transform_point3(point);
            placement
                .turn
                .world_from_object(placement.angles[frame])
                .transform_point3(placed)
        };
        let mut pixels: Vec<f64> = Vec::new();
        for frame in 0..truth.angles.len() {
            pixels.extend(self.mesh.positions.iter().map(|&position| {
                let point = self.mesh.to_object(position);
                let pixel =
                    |placement| self.camera.project(world(placement, frame, point)).unwrap();
                pixel(found).distance(pixel(truth))
            }));
        }
        let square = pixels.iter().map(|p| p * p).sum::<f64>() / pixels.len() as f64;
        Errors {
            turn: turned.to_scaled_axis(),
            axis: found.turn.axis.angle_between(truth.turn.axis).to_degrees(),
            rms: square.sqrt(),
            most: pixels.into_iter().fold(0.0, f64::max),
        }
    }

    /// The placement turned about the mesh file's +Y as in the truth: for a body of revolution about it.
    pub(super) fn without_spin(&self, found: &Placement) -> Placement {
        let truth = self.truth.object_from_file.rotation;
        let mut placement = found.clone();
        let pose = &mut placement.object_from_file;
        let off = truth.inverse() * pose.rotation;
        pose.rotation *= DQuat::from_rotation_y(-2.0 * off.y.atan2(off.w));
        placement
    }

    /// Errors of all ten unknowns over their standard deviations.
    pub(super) fn scores(&self, found: &Registered) -> Vec<f64> {
        let (sigma, placement, truth) = (&found.sigma, &found.placement, &self.truth);
        let turn = placement.object_from_file.rotation * truth.object_from_file.rotation.inverse();
        let middle = DVec3::from_array(sigma.middle);
        let in_file = placement
            .object_from_file
            .affine()
            .inverse()
            .transform_point3(middle);
        let shift = middle - truth.object_from_file.affine().transform_point3(in_file);
        let tilt = DQuat::from_rotation_arc(truth.turn.axis, placement.turn.axis).to_scaled_axis();
        let (a, b) = (placement.turn.axis, truth.turn.axis);
        let near = placement.turn.center + a * (middle - placement.turn.center).dot(a);
        let along = (near - truth.turn.center).dot(a) / b.dot(a);
        let offset = near - (truth.turn.center + along * b);
        let across = sigma.across.map(DVec3::from_array);
        let mut scores: Vec<f64> = Vec::new();
        scores.extend(
            turn.to_scaled_axis()
                .to_array()
                .iter()
                .zip(sigma.rotation)
                .map(|(e, s)| e / s),
        );
        scores.extend(
            shift
                .to_array()
                .iter()
                .zip(sigma.translation)
                .map(|(e, s)| e / s),
        );
        scores.extend(across.iter().zip(sigma.axis).map(|(u, s)| u.dot(tilt) / s));
        scores.extend(
            across
                .iter()
                .zip(sigma.center)
                .map(|(u, s)| u.dot(offset) / s),
        );
        scores
    }
}

/// How far off a result is.
#[derive(Debug)]
pub(super) struct Errors {
    /// Of the object's pose: rotation vector, radians.
    pub(super) turn: DVec3,
    /// Degrees.
    pub(super) axis: f64,
    /// Vertices over all frames, pixels.
    pub(super) rms: f64,
    pub(super) most: f64,
}

/// Damages a mask: a share of its pixels is wrong, half of them strewn, half in discs on the border.
pub(super) fn damage(mask: &mut Mask, share: f64, random: &mut Random) {
    let count = share * mask.pixels.len() as f64;
    let (width, height) = (mask.width, mask.height);
    let mut wrong = 0;
    while (wrong as f64) < 0.5 * count {
        let at = (random.next() % mask.pixels.len() as u64) as usize;
        mask.pixels[at] = 255 - mask.pixels[at];
        wrong += 1;
    }
    let sound = mask.pixels.clone();
    let on_border = |i: &usize| {
        let neighbour = (i + 1).min(sound.len() - 1);
        (sound[*i] >= 128) != (sound[neighbour] >= 128)
    };
    // Strewn pixels have borders too; only those with a sound neighbourhood are taken.
    let border: Vec<usize> = (0..sound.len()).filter(on_border).collect();
    let mut wrong = 0;
    while (wrong as f64) < 0.5 * count {
        let at = border[(random.next() % border.len() as u64) as usize];
        let radius = 2.0 + 3.0 * random.uniform();
        let value = 255 * (random.next() & 1) as u8;
        for y in 0..height {
            for x in 0..width {
                let (dx, dy) = (
                    x as f64 - (at % width) as f64,
                    y as f64 - (at / width) as f64,
                );
                let pixel = &mut mask.pixels[y * width + x];
                if dx.hypot(dy) <= radius && pixel.abs_diff(value) > 127 {
                    *pixel = value;
                    wrong += 1;
                }
            }
        }
    }
}

/// SplitMix64.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(super) fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(super) fn direction(&mut self) -> DVec3 {
        loop {
            let v = DVec3::new(self.uniform(), self.uniform(), self.uniform()) * 2.0 - 1.0;
            if (0.01..1.0).contains(&v.length()) {
                return v.normalize();
            }
        }
    }
}
