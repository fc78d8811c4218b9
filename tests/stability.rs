//! Nothing that can be photographed or modelled makes turnlight panic or lose its numbers: finite and
//! right within noise, or refused by name.
//!
//! The mesh's repairs are laws of `src/mesh/tests`, the lobe's own numbers those of `brdf_laws`, and a capture
//! that is masked whole one of `pipeline`; here are the whole renderer and the whole fit.

#![expect(clippy::unwrap_used, reason = "a test may stop at once")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Instant;

use glam::{DVec3, Vec3};
use proptest::prelude::*;
use tempfile::TempDir;
use turnlight::export::PointTable;
use turnlight::image::{RgbImage, write_exr};
use turnlight::mesh::{Surface, cup, sphere};
use turnlight::render::{FrameSettings, RenderedFrame, Sampling, Skips, Stage, render_frame};
use turnlight::scene::Scene;

const WHITE: &str = "ndf = 'ggx'\nalpha = 0.5\nrho_d = 1.0\nrho_s = 0.0";
const PLASTIC: &str = "ndf = 'ggx'\nalpha = 0.2\nrho_d = [0.4, 0.3, 0.2]\nrho_s = 2.35";

/// Where a camera stands, what it looks at, and how wide it sees.
#[derive(Clone, Copy, Debug)]
struct Seen {
    position: DVec3,
    look_at: DVec3,
    fov_x_deg: f64,
    /// Columns and rows.
    side: usize,
}

/// The unit sphere fills most of it.
const FROM_ABOVE: Seen = Seen {
    position: DVec3::new(0.0, 1.37, 3.76),
    look_at: DVec3::ZERO,
    fov_x_deg: 32.0,
    side: 24,
};

/// A folder with a scene of one mesh in one light.
struct Setup {
    folder: TempDir,
    mesh: String,
    material: String,
    seen: Seen,
    /// Further lines: of `[object]`, and whole sections.
    object: String,
    sections: String,
}

impl Setup {
    fn new(surface: &Surface, probe: &RgbImage, material: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("mesh.ply"), double_ply(surface)).unwrap();
        write_exr(&folder.path().join("probe.exr"), probe).unwrap();
        Self {
            folder,
            mesh: "mesh.ply".to_owned(),
            material: material.to_owned(),
            seen: FROM_ABOVE,
            object: String::new(),
            sections: "[turntable]\nframes = 1\n".to_owned(),
        }
    }

    fn write(&self) -> PathBuf {
        let Seen {
            position,
            look_at,
            fov_x_deg,
            side,
        } = self.seen;
        let text = format!(
            "[object]\nmesh = '{}'\n{}\n[material]\n{}\n[probe]\nimage = 'probe.exr'\n[camera]\n\
             width = {side}\nheight = {side}\nfov_x_deg = {fov_x_deg:?}\n\
             position = {:?}\nlook_at = {:?}\n{}",
            self.mesh,
            self.object,
            self.material,
            position.to_array(),
            look_at.to_array(),
            self.sections
        );
        let path = self.folder.path().join("scene.toml");
        std::fs::write(&path, text).unwrap();
        path
    }

    fn stage(&self) -> Result<(Stage, Vec<String>), String> {
        let scene = Scene::load(self.write()).map_err(|e| e.to_string())?;
        Stage::load(&scene).map_err(|e| e.to_string())
    }

    fn render(&self, samples_per_pixel: u32, bounces: u32) -> RenderedFrame {
        let (stage, _) = self.stage().unwrap();
        let frame = render_frame(
            &stage,
            0,
            0.0,
            &FrameSettings {
                sampling: Sampling::PerPixel(samples_per_pixel),
                bounces,
                seed: 7,
                skips: Skips::ALL,
            },
        );
        let numbers = frame.radiance.pixels.as_flattened();
        assert!(numbers.iter().all(|v| v.is_finite()), "{}", self.material);
        frame
    }
}

/// A binary file in double precision, without normals.
fn double_ply(surface: &Surface) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
         property double z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        surface.positions.len(),
        surface.triangles.len()
    )
    .into_bytes();
    for position in &surface.positions {
        bytes.extend(position.to_array().into_iter().flat_map(f64::to_le_bytes));
    }
    for triangle in &surface.triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes
}

/// A square plate of half-width `half` that looks up.
fn plate(half: f64) -> Surface {
    let corner = |x: f64, z: f64| DVec3::new(x * half, 0.0, z * half);
    Surface {
        positions: vec![
            corner(-1.0, -1.0),
            corner(-1.0, 1.0),
            corner(1.0, 1.0),
            corner(1.0, -1.0),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Surface::default()
    }
}

/// The plate of half-width 1 in `count`² squares.
fn tiles(count: u32) -> Surface {
    let side = count + 1;
    let place = |i: u32| 2.0 * f64::from(i) / f64::from(count) - 1.0;
    let square = |i: u32| {
        let a = i / count * side + i % count;
        [[a, a + side, a + 1], [a + 1, a + side, a + side + 1]]
    };
    Surface {
        positions: (0..side * side)
            .map(|v| DVec3::new(place(v % side), 0.0, place(v / side)))
            .collect(),
        triangles: (0..count * count).flat_map(square).collect(),
        ..Surface::default()
    }
}

fn grey(width: usize, height: usize, value: f32) -> RgbImage {
    RgbImage::constant(width, height, [value; 3])
}

/// A lamp a thousand times as bright as the sky, which is brighter above than below.
fn lamp_and_sky() -> RgbImage {
    RgbImage::from_fn(32, 16, |x, y| match (x, y) {
        (5..7, 4) => [1000.0, 900.0, 700.0],
        _ => [0.5, 0.6, 0.7].map(|c: f32| c * (1.0 - y as f32 / 20.0)),
    })
}

/// Mean and its standard error of the green channel over pixels that the object covers whole.
fn inside(frame: &RenderedFrame) -> (f64, f64) {
    let values: Vec<f64> = (frame.radiance.pixels.iter().zip(&frame.mask.pixels))
        .filter(|(_, coverage)| **coverage == 255)
        .map(|(pixel, _)| f64::from(pixel[1]))
        .collect();
    assert!(values.len() > 20, "{} pixels inside", values.len());
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, (variance / count).sqrt())
}

/// Root mean square of the difference of two images over that of the first.
fn difference(a: &RenderedFrame, b: &RenderedFrame) -> f64 {
    let (a, b) = (
        a.radiance.pixels.as_flattened(),
        b.radiance.pixels.as_flattened(),
    );
    let squares = a
        .iter()
        .zip(b)
        .map(|(x, y)| f64::from(x - y).powi(2))
        .sum::<f64>();
    let scale = a.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>();
    assert!(scale > 0.0 && a.len() == b.len());
    (squares / scale).sqrt()
}

// Material and view.

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]

    #[test]
    fn any_roughness_renders_finite(
        alpha in prop_oneof![Just(1e-3), Just(1.0), (-3.0..0.0f64).prop_map(|e| 10f64.powf(e))],
        ndf in prop::sample::select(vec!["ggx", "beckmann"]),
        bounces in 1u32..4,
    ) {
        let material = format!("ndf = '{ndf}'\nalpha = {alpha:?}\nrho_d = 0.3\nrho_s = 2.35");
        let (mean, _) = inside(&Setup::new(&cup(), &lamp_and_sky(), &material).render(2, bounces));
        // The lamp's light is 30 at most on a surface that faces it.
        prop_assert!(mean > 0.0 && mean < 100.0, "{mean}");
    }
}

/// Every pixel sees the plate at this angle above the horizon.
fn grazing(elevation_deg: f64) -> Seen {
    let elevation = elevation_deg.to_radians();
    Seen {
        position: 4.0 * DVec3::new(0.0, elevation.sin(), elevation.cos()),
        look_at: DVec3::ZERO,
        // A third of the plate's apparent height.
        fov_x_deg: elevation_deg.min(60.0) / 6.0,
        side: 16,
    }
}

#[test]
fn white_furnace_returns_one_at_any_angle() {
    for elevation in [0.01, 0.1, 1.0, 10.0, 60.0] {
        let mut setup = Setup::new(&plate(1.0), &grey(8, 4, 1.0), WHITE);
        setup.seen = grazing(elevation);
        let (mean, _) = inside(&setup.render(64, 1));
        assert!((mean - 1.0).abs() < 1e-3, "{elevation}°: {mean}");
    }
}

#[test]
fn grazing_views_of_any_lobe_are_finite() {
    for alpha in [0.001, 0.1, 1.0] {
        for elevation in [0.01, 0.1, 1.0] {
            let material =
                format!("ndf = 'beckmann'\nalpha = {alpha:?}\nrho_d = 0.3\nrho_s = 2.35");
            let mut setup = Setup::new(&plate(1.0), &lamp_and_sky(), &material);
            setup.seen = grazing(elevation);
            let (mean, _) = inside(&setup.render(16, 1));
            assert!(mean > 0.0 && mean < 1e4, "{alpha} {elevation}°: {mean}");
        }
    }
}

#[test]
fn mirror_like_and_rough_lobes_gain_no_light() {
    for surface in [plate(1.0), sphere(24)] {
        for ndf in ["ggx", "beckmann"] {
            for alpha in [0.001, 0.01, 0.1, 0.4, 1.0] {
                let material = format!(
                    "ndf = '{ndf}'\nalpha = {alpha:?}\nrho_d = 0.0\nfresnel = 'schlick'\nf0 = 1.0\nf90 = 1.0"
                );
                let frame = Setup::new(&surface, &grey(8, 4, 1.0), &material).render(64, 1);
                let (mean, error) = inside(&frame);
                assert!(
                    mean < 1.0 + 4.0 * error + 1e-4,
                    "{ndf} {alpha}: {mean} ± {error}"
                );
                // A narrow lobe on a smooth surface loses next to nothing either.
                assert!(
                    alpha > 0.05 || mean > 0.98,
                    "{ndf} {alpha}: {mean} ± {error}"
                );
            }
        }
    }
}

// Light.

/// What a white plate under the sky of `probe` sends back, by brute force in double precision.
fn plate_under(probe: &RgbImage) -> f64 {
    let (environment, _) = turnlight::probe::Environment::new(probe.clone(), 0.0).unwrap();
    let light = environment.turned(glam::Mat3::IDENTITY);
    const STEPS: usize = 1500;
    let mut sum = 0.0;
    // Midpoints, equal in cos² and in longitude: each direction counts the same.
    for i in 0..STEPS {
        let cos = ((i as f64 + 0.5) / STEPS as f64).sqrt();
        let sin = (1.0 - cos * cos).sqrt();
        for j in 0..STEPS {
            let (y, x) = (std::f64::consts::TAU * (j as f64 + 0.5) / STEPS as f64).sin_cos();
            let wi = DVec3::new(sin * x, cos, sin * y).as_vec3();
            sum += f64::from(light.radiance(Vec3::ZERO, wi).y);
        }
    }
    sum / (STEPS * STEPS) as f64
}

#[test]
fn light_over_twelve_decades_is_summed_right() {
    // Texels from 1e-6 to 1e6 side by side, in no order.
    let wild = RgbImage::from_fn(16, 8, |x, y| {
        [10f32.powf(((x * 7 + y * 5) % 13) as f32 - 6.0); 3]
    });
    let mut one = grey(64, 32, 0.0);
    one.pixels[9 * 64 + 20] = [1e6; 3];
    for probe in [wild, one] {
        let expected = plate_under(&probe);
        for bounces in [1, 3] {
            let (mean, error) = inside(&Setup::new(&plate(9.0), &probe, WHITE).render(64, bounces));
            assert!(
                (mean - expected).abs() < 0.01 * expected + 4.0 * error,
                "{mean} ± {error}, expected {expected}"
            );
        }
        let frame = Setup::new(&cup(), &probe, PLASTIC).render(8, 3);
        assert!(inside(&frame).0 > 0.0);
    }
}

#[test]
fn image_scales_with_the_light() {
    let image = |factor: f32| {
        let mut probe = lamp_and_sky();
        probe
            .pixels
            .iter_mut()
            .for_each(|p| *p = p.map(|c| c * factor));
        let mut frame = Setup::new(&cup(), &probe, PLASTIC).render(8, 3);
        frame
            .radiance
            .pixels
            .iter_mut()
            .for_each(|p| *p = p.map(|c| c / factor));
        frame
    };
    let plain = image(1.0);
    for factor in [1e-9, 1e-6, 1e6] {
        let off = difference(&plain, &image(factor));
        assert!(off < 1e-3, "light × {factor}: {off}");
    }
}

#[test]
fn no_light_is_black() {
    for (width, height) in [(1, 1), (8, 4)] {
        let frame = Setup::new(&cup(), &grey(width, height, 0.0), PLASTIC).render(8, 3);
        assert!(frame.radiance.pixels.iter().all(|p| *p == [0.0; 3]));
    }
}

#[test]
fn one_texel_is_light_from_everywhere() {
    let (mean, _) = inside(&Setup::new(&plate(9.0), &grey(1, 1, 1.0), WHITE).render(64, 1));
    assert!((mean - 1.0).abs() < 1e-3, "{mean}");
}

#[test]
fn large_probes_light_as_small_ones() {
    // 1 + ½ cos θ on a white plate that looks up: 1 + ½ · ⅔. The largest is 4096 × 2048, 100 MB of floats.
    for (width, height) in [(64, 32), (4096, 2048)] {
        let cos = |y: usize| (std::f64::consts::PI * (y as f64 + 0.5) / height as f64).cos();
        let probe = RgbImage::from_fn(width, height, |_, y| [1.0 + 0.5 * cos(y) as f32; 3]);
        let (mean, _) = inside(&Setup::new(&plate(9.0), &probe, WHITE).render(64, 1));
        assert!(
            (mean / (4.0 / 3.0) - 1.0).abs() < 1e-3,
            "{width} × {height}: {mean}"
        );
    }
}

#[test]
fn broken_texels_are_mended_and_reported_or_refused_by_name() {
    let breaks = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0];
    for value in breaks {
        let mut probe = grey(32, 16, 1.0);
        probe.pixels[100] = [value; 3];
        let setup = Setup::new(&plate(9.0), &probe, WHITE);
        let (_, warnings) = setup.stage().unwrap();
        assert!(
            warnings
                .iter()
                .any(|w| w.contains("probe.exr") && w.contains("1 texels")),
            "{value}: {warnings:?}"
        );
        let (mean, _) = inside(&setup.render(16, 1));
        assert!(mean > 0.9 && mean < 1.001, "{value}: {mean}");
    }
    let mut ruined = grey(32, 16, 1.0);
    ruined.pixels[..100].fill([f32::NAN; 3]);
    let error = Setup::new(&plate(9.0), &ruined, WHITE)
        .stage()
        .err()
        .unwrap();
    assert!(
        error.contains("probe.exr") && error.contains("100 of 512"),
        "{error}"
    );
}

// Geometry.

/// `surface` in other units, moved.
fn placed(surface: &Surface, scale: f64, offset: DVec3) -> Surface {
    let positions = surface
        .positions
        .iter()
        .map(|p| *p * scale + offset)
        .collect();
    Surface {
        positions,
        ..surface.clone()
    }
}

/// The cup seen by a camera that goes where the cup goes.
fn seen_at(scale: f64, offset: DVec3) -> RenderedFrame {
    let mut setup = Setup::new(&placed(&cup(), scale, offset), &lamp_and_sky(), PLASTIC);
    setup.seen.position = setup.seen.position * scale + offset;
    setup.seen.look_at = setup.seen.look_at * scale + offset;
    setup.render(8, 3)
}

#[test]
fn size_leaves_the_image() {
    let plain = seen_at(1.0, DVec3::ZERO);
    for scale in [1e-6, 0.001, 39.37, 1e6] {
        let off = difference(&plain, &seen_at(scale, DVec3::ZERO));
        assert!(off < 1e-3, "scale {scale}: {off}");
    }
}

#[test]
fn place_leaves_the_image() {
    let plain = seen_at(1.0, DVec3::ZERO);
    for (scale, direction) in [
        (1.0, DVec3::new(1.0, -0.7, 0.3)),
        (1.0, DVec3::NEG_Z),
        (1e-6, DVec3::Y),
        (1e6, DVec3::new(-0.3, 0.2, 1.0)),
    ] {
        // A million sizes of the cup, which is 2 across; the camera goes along.
        let offset = 2e6 * scale * direction;
        let off = difference(&plain, &seen_at(scale, offset));
        assert!(off < 1e-3, "camera along, scale {scale} {direction}: {off}");

        // The file's place is taken back by the scene.
        let mut setup = Setup::new(&placed(&cup(), scale, offset), &lamp_and_sky(), PLASTIC);
        let back = (-offset / scale).to_array();
        setup.object = format!("scale = {:?}\ntranslation = {back:?}", 1.0 / scale);
        let off = difference(&plain, &setup.render(8, 3));
        assert!(off < 1e-3, "taken back, scale {scale} {direction}: {off}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn any_size_and_place_leave_the_image(
        exponent in -6.0..6.0f64, far in 0.0..6.3f64, x in -1.0..1.0f64, y in -1.0..1.0f64, z in -1.0..1.0f64,
    ) {
        let scale = 10f64.powf(exponent);
        let offset = scale * 10f64.powf(far) * DVec3::new(x, y, z);
        let off = difference(&seen_at(1.0, DVec3::ZERO), &seen_at(scale, offset));
        prop_assert!(off < 1e-3, "{off}");
    }
}

#[test]
fn defects_that_are_mended_leave_the_image() {
    let clean = sphere(12);
    let image = |surface: &Surface| Setup::new(surface, &lamp_and_sky(), PLASTIC).render(4, 2);
    let plain = image(&clean);
    let stray = clean.positions.len() as u32;
    let add = |triangles: &[[u32; 3]], positions: &[DVec3]| {
        let mut surface = clean.clone();
        surface.triangles.extend(triangles);
        surface.positions.extend(positions);
        surface
    };
    let inside_out = |triangles: &mut [[u32; 3]]| triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let mut one_inverted = clean.clone();
    inside_out(&mut one_inverted.triangles[100..101]);
    let mut inverted = clean.clone();
    inside_out(&mut inverted.triangles);
    let [a, b, _] = clean.triangles[50];
    for (defect, surface) in [
        ("zero-area", add(&[[a, b, b], [a, a, a]], &[])),
        ("duplicate", add(&clean.triangles[10..30], &[])),
        ("one inverted", one_inverted),
        ("all inverted", inverted),
        ("NaN vertex", add(&[[a, b, stray]], &[DVec3::NAN])),
        (
            "infinite vertex",
            add(&[[a, b, stray]], &[DVec3::new(0.0, f64::INFINITY, 0.0)]),
        ),
        ("stray vertex", add(&[], &[DVec3::splat(1e9)])),
    ] {
        let off = difference(&plain, &image(&surface));
        assert!(off < 1e-3, "{defect}: {off}");
    }
}

#[test]
fn surfaces_that_are_no_solid_render_finite() {
    let ball = sphere(12);
    let half = ball.triangles.len() / 2;
    let open = Surface {
        triangles: ball.triangles[..half].to_vec(),
        ..ball.clone()
    };
    let mut finned = ball.clone();
    finned.triangles.push([
        ball.triangles[60][0],
        ball.triangles[60][1],
        ball.positions.len() as u32,
    ]);
    finned
        .positions
        .push(1.5 * ball.positions[ball.triangles[60][0] as usize]);
    let triangle = Surface {
        positions: vec![
            DVec3::new(-1.0, -1.0, 0.0),
            DVec3::new(1.0, -1.0, 0.0),
            DVec3::Y,
        ],
        triangles: vec![[0, 1, 2]],
        ..Surface::default()
    };
    // Two sheets in one place, and a needle whose height is a millionth of its length.
    let mut double = plate(1.0);
    double.triangles.extend([[0, 2, 1], [0, 3, 2]]);
    let mut needle = triangle.clone();
    needle.positions.push(DVec3::new(0.0, -1.0 - 2e-6, 0.0));
    needle.triangles.push([1, 0, 3]);
    for (kind, surface) in [
        ("open", open),
        ("non-manifold", finned),
        ("one triangle", triangle),
        ("two-sided sheet", double),
        ("needle", needle),
    ] {
        let (mean, _) = inside(&Setup::new(&surface, &lamp_and_sky(), PLASTIC).render(4, 3));
        assert!(mean > 0.0 && mean < 100.0, "{kind}: {mean}");
    }
}

#[test]
fn a_million_triangles_render_as_a_sphere() {
    let surface = sphere(354);
    assert!(surface.triangles.len() > 1_000_000);
    let setup = Setup::new(&surface, &grey(8, 4, 1.0), WHITE);
    let started = Instant::now();
    let (mean, _) = inside(&setup.render(4, 1));
    let seconds = started.elapsed().as_secs_f64();
    assert!((mean - 1.0).abs() < 1e-3, "{mean}");
    // Ten times what one slow core needs in a release build; something is quadratic if it fails.
    assert!(
        seconds < if cfg!(debug_assertions) { 200.0 } else { 20.0 },
        "{seconds} s"
    );
}

// The fit.

fn turnlight(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_turnlight"))
        .args(words)
        .output()
        .unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Renders `setup` and fits it; the points, of which every number is finite or says that nothing is known.
fn fitted(setup: &Setup) -> PointTable {
    let (capture, fit) = (
        setup.folder.path().join("capture"),
        setup.folder.path().join("fit"),
    );
    let run = turnlight(&[
        "render",
        text(&setup.write()),
        "--out",
        text(&capture),
        "--spp",
        "16",
        "--quiet",
    ]);
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stderr)
    );
    let run = turnlight(&["fit", text(&capture), "--out", text(&fit), "--quiet"]);
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success() && !said.contains("panicked"), "{said}");
    let table = PointTable::read_npz(&fit.join("points.npz")).unwrap();
    for i in 0..table.len() {
        let known = [table.rho_d[i], table.rho_s[i]];
        assert!(
            known
                .as_flattened()
                .iter()
                .all(|v| v.is_finite() && *v >= 0.0)
                && table.alpha[i] > 0.0
                && table.alpha[i] <= 1.0
                && !table.sigma_alpha[i].is_nan()
                && !table.sigma_rho_s[i].is_nan()
                && table.sigma_rho_d[i].iter().all(|v| !v.is_nan())
                && table.residual[i].is_finite()
                && (0..=5).contains(&table.status[i]),
            "point {i} of status {}",
            table.status[i]
        );
    }
    // The estimate can be rendered.
    let again = setup.folder.path().join("again");
    let run = turnlight(&[
        "reproduce",
        text(&fit),
        "--out",
        text(&again),
        "--spp",
        "1",
        "--quiet",
    ]);
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stderr)
    );
    let image = RgbImage::read(&again.join("images/0000.exr")).unwrap();
    assert!(image.pixels.as_flattened().iter().all(|v| v.is_finite()));
    table
}

/// How many points ended with each status.
fn endings(table: &PointTable) -> [usize; 6] {
    let mut counts = [0; 6];
    table
        .status
        .iter()
        .for_each(|&code| counts[code as usize] += 1);
    counts
}

fn turning(probe: &RgbImage, frames: usize, sensor: &str) -> Setup {
    let mut setup = Setup::new(&sphere(6), probe, PLASTIC);
    setup.sections = format!("[turntable]\nframes = {frames}\n{sensor}");
    setup
}

#[test]
fn few_frames_are_fitted_with_a_status() {
    for frames in [1, 2] {
        let [.., unseen, _] = endings(&fitted(&turning(&lamp_and_sky(), frames, "")));
        assert!(
            unseen > 10,
            "{frames} frames: half of the sphere is never seen"
        );
    }
}

#[test]
fn saturated_samples_are_no_data() {
    let sensor = "[sensor]\nfull_well_electrons = 30000.0\nread_noise_electrons = 5.0\nbits = 12\nexposure = 1e6\n";
    let [converged, unidentifiable, at_bound, few, unseen, saturated] =
        endings(&fitted(&turning(&lamp_and_sky(), 6, sensor)));
    assert_eq!(
        (converged, unidentifiable, at_bound, few),
        (0, 0, 0, 0),
        "{unseen} unseen"
    );
    assert!(saturated > 50, "{saturated} saturated, {unseen} unseen");
}

#[test]
fn collinear_traces_are_mostly_unidentifiable() {
    // A plate seen from straight above in light from everywhere: neither answer ever changes, and they are
    // multiples of each other.
    let mut setup = Setup::new(&tiles(8), &grey(1, 1, 1.0), PLASTIC);
    setup.seen.position = DVec3::new(0.0, 40.0, 0.0);
    setup.seen.fov_x_deg = 3.0;
    setup.sections = "up = [0.0, 0.0, 1.0]\n[turntable]\nframes = 6\n".to_owned();
    let [converged, unidentifiable, at_bound, ..] = endings(&fitted(&setup));
    // Noise fits a lobe now and then: at this seed one point of 79.
    assert!(
        unidentifiable > 25 * (converged + at_bound),
        "{unidentifiable}, {converged} converged, {at_bound} at the bound of alpha"
    );
}

#[test]
fn darkness_tells_nothing() {
    let [converged, unidentifiable, at_bound, ..] =
        endings(&fitted(&turning(&grey(4, 2, 0.0), 3, "")));
    assert_eq!(
        (converged, at_bound),
        (0, 0),
        "{unidentifiable} unidentifiable"
    );
}
