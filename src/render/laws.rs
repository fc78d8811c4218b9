//! The guided paths against plain ones: no table, no light sampling, nothing known about blockers.

use std::path::Path;

use glam::{DVec2, DVec3, Mat3, Vec2, Vec3};

use super::frame_light::FrameLight;
use super::integrator::{Illuminated, PixelGuides};
use super::{FrameSettings, PathCount, RenderStats, Skip, Skips, Stage, render_frame};
use crate::accel::Hit;
use crate::geometry::{Frame, Ray};
use crate::image::{RgbImage, write_exr};
use crate::probe::TurnedLight;
use crate::sampling::{SobolPath, as_points};
use crate::scene::Scene;

/// A soft lamp and a sky, by texel of 32 × 16.
fn lamp_and_sky(x: f32, y: f32) -> [f32; 3] {
    let lamp = (-0.15 * ((x - 9.0).powi(2) + (y - 4.0).powi(2))).exp();
    [
        0.4 + 9.0 * lamp,
        0.5 + 7.0 * lamp,
        0.2 + 0.03 * x + 5.0 * lamp,
    ]
}

/// Few pixels, filled by the object.
const CLOSE: &str = "width = 6\nheight = 6\nfov_x_deg = 26.0";

/// A shipped mesh under a light, seen from above.
fn stage(mesh: &str, material: &str, light: fn(f32, f32) -> [f32; 3], camera: &str) -> Stage {
    let folder = tempfile::tempdir().unwrap();
    // Of so many texels, light that is hidden is left out of the table.
    let pixels = (0..256 * 128)
        .map(|i| light((i % 256) as f32 / 8.0, (i / 256) as f32 / 8.0))
        .collect();
    let probe = folder.path().join("probe.exr");
    write_exr(
        &probe,
        &RgbImage {
            width: 256,
            height: 128,
            pixels,
        },
    )
    .unwrap();
    let mesh = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("scenes/meshes")
        .join(mesh);
    let path = folder.path().join("scene.toml");
    std::fs::write(
        &path,
        format!(
            "[object]\nmesh = '{}'\n[material]\n{material}\n[probe]\nimage = '{}'\n\
             [camera]\n{camera}\nposition = [0.6, 2.4, 3.0]\n\
             look_at = [0.0, 0.0, 0.0]\n[turntable]\nframes = 3\n",
            mesh.display(),
            probe.display()
        ),
    )
    .unwrap();
    Stage::load(&Scene::load(&path).unwrap()).unwrap().0
}

/// Eq. 4 by drawing from the BRDF alone.
fn plain_radiance(
    stage: &Stage,
    light: &TurnedLight<'_>,
    mut ray: Ray,
    mut hit: Hit,
    bounces: u32,
    path: &mut SobolPath,
) -> Vec3 {
    let mut throughput = Vec3::ONE;
    for _ in 0..bounces {
        let barycentric = Vec2::new(hit.u, hit.v);
        let frame = Frame::about(stage.mesh.normal_at(hit.triangle, barycentric));
        let wo = frame.to_local(-ray.direction);
        let brdf = stage.material.at(&stage.mesh, hit.triangle, barycentric);
        let (u, other) = as_points(path.next_4d());
        let Some(sample) = brdf.sample(wo, other.x, u) else {
            return Vec3::ZERO;
        };
        throughput *= sample.weight;
        let position = stage.mesh.position_at(hit.triangle, barycentric);
        let side = stage.mesh.geometric_normal(hit.triangle);
        ray = Ray::leaving(position, side, frame.from_local(sample.wi));
        match stage.accel.closest_hit(&ray, f32::INFINITY) {
            None => return throughput * light.radiance(position, ray.direction),
            Some(next) => hit = next,
        }
    }
    Vec3::ZERO
}

/// Mean of a channel's samples and the variance of that mean.
#[derive(Default)]
struct Mean {
    count: f64,
    sum: DVec3,
    squares: DVec3,
}

impl Mean {
    fn add(&mut self, sample: Vec3) {
        let sample = sample.as_dvec3();
        self.count += 1.0;
        self.sum += sample;
        self.squares += sample * sample;
    }

    fn mean_and_variance(&self) -> (DVec3, DVec3) {
        let mean = self.sum / self.count;
        (mean, (self.squares / self.count - mean * mean) / self.count)
    }
}

#[test]
fn guided_paths_agree_with_plain_paths() {
    const SAMPLES: u32 = 20_000;
    // (z² summed, number), and the mean difference in sum, over all pixels of a case.
    for (mesh, material, bounces) in [
        (
            "cup.ply",
            "ndf = 'ggx'\nalpha = 0.4\nrho_d = [0.8, 0.6, 0.5]\nrho_s = 2.35",
            1,
        ),
        (
            "cup.ply",
            "ndf = 'ggx'\nalpha = 0.4\nrho_d = [0.8, 0.6, 0.5]\nrho_s = 2.35",
            4,
        ),
        (
            "suzanne.ply",
            "ndf = 'beckmann'\nalpha = 0.3\nrho_d = [0.5, 0.3, 0.1]\nrho_s = 8.0",
            3,
        ),
        (
            "sphere.ply",
            "ndf = 'ggx'\nalpha = 0.25\nrho_d = 0.0\nrho_s = 2.35",
            2,
        ),
        (
            "suzanne.ply",
            "ndf = 'ggx'\nalpha = 0.3\nfresnel = 'schlick'\nrho_d = 0.2\nf0 = [0.9, 0.7, 0.3]\nf90 = 1.0",
            3,
        ),
    ] {
        let stage = stage(mesh, material, lamp_and_sky, CLOSE);
        let angle = 1.1;
        let view = stage.view(angle);
        let world_from_object: Mat3 = view.world_from_object();
        let illuminated = Illuminated {
            stage: &stage,
            light: FrameLight::new(&stage.environment, &stage.clusters, world_from_object),
            world_from_object,
            patches: &stage.patches,
            bounces,
            skips: Skips::ALL,
        };
        let light = stage.environment.turned(world_from_object);
        let (mut z2, mut count) = (0.0, 0.0);
        let (mut guided_sum, mut plain_sum, mut variance_sum) = (0.0, 0.0, 0.0);
        for pixel in 0..36u32 {
            let place = DVec2::new(f64::from(pixel % 6) + 0.5, f64::from(pixel / 6) + 0.5);
            if stage
                .accel
                .closest_hit(&view.ray(place), f32::INFINITY)
                .is_none()
            {
                continue;
            }
            // Independent numbers: each sample is another stream, so that variances are honest; and
            // another place in the pixel, so that guides serve other points than their own.
            let start = |seed: u64, index: u32| {
                let mut path = SobolPath::new(seed, pixel, index, 0);
                let [x, y, ..] = path.next_4d();
                let jitter = DVec2::new(f64::from(x), f64::from(y)) - 0.5;
                let ray = view.ray(place + 0.3 * jitter);
                let hit = stage.accel.closest_hit(&ray, f32::INFINITY);
                (path, ray, hit)
            };
            let mut guides = PixelGuides::default();
            let (mut guided, mut plain) = (Mean::default(), Mean::default());
            for index in 0..SAMPLES {
                let (mut path, ray, hit) = start(1, index);
                let mut stats = RenderStats::default();
                guided.add(hit.map_or(Vec3::ZERO, |hit| {
                    illuminated.radiance(ray, hit, &mut guides, &mut path, &mut stats)
                }));
                let (mut path, ray, hit) = start(2, index);
                plain.add(hit.map_or(Vec3::ZERO, |hit| {
                    plain_radiance(&stage, &light, ray, hit, bounces, &mut path)
                }));
            }
            let ((a, va), (b, vb)) = (guided.mean_and_variance(), plain.mean_and_variance());
            let z = (a - b) / (va + vb).max(DVec3::splat(1e-12)).map(f64::sqrt);
            // The channels move together: one of them, by turns.
            let channel = pixel as usize % 3;
            z2 += z[channel] * z[channel];
            count += 1.0;
            guided_sum += a.element_sum();
            plain_sum += b.element_sum();
            variance_sum += 3.0 * (va + vb).element_sum();
        }
        let difference = (guided_sum - plain_sum) / plain_sum;
        let sigma: f64 = f64::sqrt(variance_sum) / plain_sum;
        assert!(count >= 8.0, "{mesh}: the camera sees too little");
        // z² is about χ² of `count` degrees; four standard deviations.
        assert!(
            z2 < count + 4.0 * f64::sqrt(2.0 * count),
            "{mesh} {bounces}: z² {z2} over {count} pixels"
        );
        assert!(
            difference.abs() < 4.0 * sigma && sigma < 0.01,
            "{mesh} {bounces}: {difference} ± {sigma}"
        );
    }
}

#[test]
fn dark_light_gives_finite_pixels() {
    // All black; and one lamp below everything that the camera sees.
    let black: fn(f32, f32) -> [f32; 3] = |_, _| [0.0; 3];
    let below: fn(f32, f32) -> [f32; 3] = |x, y| {
        let lit = (4.0..6.0).contains(&x) && y > 14.0;
        [if lit { 50.0 } else { 0.0 }; 3]
    };
    for light in [black, below] {
        for bounces in [1, 3] {
            let material = "ndf = 'beckmann'\nalpha = 0.1\nrho_d = 0.5\nrho_s = 2.35";
            let stage = stage("cup.ply", material, light, CLOSE);
            let settings = FrameSettings {
                paths: PathCount::PerPixel(64),
                bounces,
                seed: 1,
                skips: Skips::ALL,
            };
            let frame = render_frame(&stage, 0, 0.0, &settings);
            let pixels = frame.radiance.pixels.iter().flatten();
            assert!(pixels.clone().all(|value| value.is_finite()));
            assert!(pixels.clone().all(|value| value.abs() < 50.0));
        }
    }
}

#[test]
fn skips_leave_the_image_alone() {
    let sky: fn(f32, f32) -> [f32; 3] = |x, y| {
        let lamp = if (4.0..6.0).contains(&x) && y < 4.0 {
            40.0
        } else {
            0.0
        };
        [0.5 + lamp, 0.4 + 0.2 * (x * 0.4).sin() + lamp, 0.6]
    };
    // A hollow, an open surface; both lobes, one, the other.
    let cases = [
        (
            "cup.ply",
            "ndf = 'ggx'\nalpha = 0.2\nrho_d = 0.5\nrho_s = 2.35",
        ),
        (
            "cup.ply",
            "ndf = 'ggx'\nalpha = 0.2\nrho_d = 0.5\nrho_s = 0.0",
        ),
        (
            "sphere.ply",
            "ndf = 'beckmann'\nalpha = 0.3\nrho_d = 0.0\nrho_s = 5.0",
        ),
    ];
    let mut counted = RenderStats::default();
    for (mesh, material) in cases {
        let camera = "width = 12\nheight = 12\nfov_x_deg = 60.0";
        let stage = stage(mesh, material, sky, camera);
        let render = |skips: Skips, seed: u64| {
            let settings = FrameSettings {
                paths: PathCount::PerPixel(16),
                bounces: 3,
                seed,
                skips,
            };
            render_frame(&stage, 0, 0.4, &settings)
        };
        let frame = render(Skips::ALL, 1);
        counted += frame.stats;
        for (skip, name) in Skip::ALL {
            let all_done = render(Skips::ALL.without(skip), 1);
            let work = |of: &RenderStats| match skip {
                Skip::Background => of.background_pixels,
                Skip::ProvenOpen => of.proven_open,
                Skip::Negligible => of.negligible,
                Skip::ZeroLobes => of.zero_lobes,
                Skip::Explored => 0,
                Skip::Smooth => of.smooth_pixels,
            };
            assert_eq!(
                work(&all_done.stats),
                0,
                "{name} is counted though it is off"
            );
            if !matches!(skip, Skip::Negligible | Skip::Smooth) {
                let again = all_done.stats.patches_explored > 0;
                assert_eq!(again, skip == Skip::Explored, "{name}: patches explored");
                assert!(
                    frame.radiance.pixels == all_done.radiance.pixels,
                    "{mesh}, {material}: {name} changes the image"
                );
                continue;
            }
            // These trade noise for time: the same image on average.
            let mean = |skips: Skips| -> Vec<f64> {
                let sum = |seed| -> f64 {
                    let image = render(skips, seed).radiance;
                    image.pixels.iter().flatten().map(|&x| f64::from(x)).sum()
                };
                (0..128).map(sum).collect()
            };
            let (on, off) = (mean(Skips::ALL), mean(Skips::ALL.without(skip)));
            // The same seeds: the differences tell.
            let differences: Vec<f64> = on.iter().zip(&off).map(|(a, b)| a - b).collect();
            let n = differences.len() as f64;
            let middle = differences.iter().sum::<f64>() / n;
            let variance = differences
                .iter()
                .map(|d| (d - middle).powi(2))
                .sum::<f64>()
                / (n - 1.0)
                / n;
            let scale = on.iter().sum::<f64>() / n;
            let (relative, sigma) = (middle / scale, variance.sqrt() / scale);
            assert!(
                relative.abs() < 4.0 * sigma + 1e-9 && sigma < 0.001,
                "{mesh}, {material}: {name} changes the mean by {relative} ± {sigma}"
            );
        }
    }
    // Each has something to skip here.
    assert!(counted.background_pixels > 0 && counted.proven_open > 0);
    assert!(counted.negligible > 0 && counted.zero_lobes > 0 && counted.smooth_pixels > 0);
}

#[test]
fn target_errors_are_delivered() {
    let sky: fn(f32, f32) -> [f32; 3] = |x, y| {
        let lamp = (4.0..6.0).contains(&x) && y < 4.0;
        [0.5 + if lamp { 40.0 } else { 0.0 }; 3]
    };
    let material = "ndf = 'ggx'\nalpha = 0.3\nrho_d = 0.5\nrho_s = 2.35";
    let camera = "width = 40\nheight = 40\nfov_x_deg = 40.0";
    let stage = stage("cup.ply", material, sky, camera);
    let render = |paths: PathCount, seed: u64| {
        let settings = FrameSettings {
            paths,
            bounces: 2,
            seed,
            skips: Skips::ALL,
        };
        render_frame(&stage, 0, 0.4, &settings)
    };
    let truth = render(PathCount::PerPixel(8192), 1000).radiance.pixels;
    let object: Vec<&[f32; 3]> = truth
        .iter()
        .filter(|p| p.iter().sum::<f32>() > 1e-4)
        .collect();
    let sum: f32 = object.iter().copied().flatten().sum();
    let floor2 = (0.1 * sum / (3 * object.len()) as f32).powi(2);
    let asked = 0.05;
    let squared = |seed: u64| -> f32 {
        let image = render(PathCount::TargetError(asked), seed).radiance.pixels;
        let errors = truth.iter().flatten().zip(image.iter().flatten());
        let sum: f32 = errors
            .map(|(t, x)| (x - t).powi(2) / (t * t + floor2))
            .sum();
        sum / (3 * object.len()) as f32
    };
    let seeds = 16;
    let mean = (0..seeds).map(squared).sum::<f32>() / seeds as f32;
    let delivered = mean.sqrt() / asked;
    assert!((delivered - 1.0).abs() < 0.15, "{delivered}");
}

#[test]
fn target_errors_end_for_frames_of_nothing() {
    let sky: fn(f32, f32) -> [f32; 3] = |_, _| [1.0; 3];
    let black: fn(f32, f32) -> [f32; 3] = |_, _| [0.0; 3];
    let material = "ndf = 'ggx'\nalpha = 0.3\nrho_d = 0.5\nrho_s = 2.35";
    // One pixel; two, of which one may see nothing; no light.
    for (light, camera) in [
        (sky, "width = 1\nheight = 1\nfov_x_deg = 20.0"),
        (sky, "width = 2\nheight = 1\nfov_x_deg = 80.0"),
        (black, "width = 20\nheight = 20\nfov_x_deg = 40.0"),
    ] {
        let stage = stage("cup.ply", material, light, camera);
        let settings = FrameSettings {
            paths: PathCount::TargetError(0.02),
            bounces: 2,
            seed: 3,
            skips: Skips::ALL,
        };
        let frame = render_frame(&stage, 0, 0.4, &settings);
        let pixels = frame.radiance.pixels.as_flattened();
        assert!(pixels.iter().all(|x| x.is_finite()));
        let lit = light(0.0, 0.0)[0] > 0.0;
        // What has noise gets more than the least, and nothing gets the most.
        let paths = frame.stats.paths - frame.stats.pilot_paths;
        let each = paths as f64 / pixels.len() as f64 * 3.0;
        assert!(each < 1e5 && (!lit || each > 4.0), "{camera}: {each}");
    }
}
