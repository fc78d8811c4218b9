//! The commands as a user meets them: a furnace, the same bytes from any number of threads, a render
//! that is killed and goes on, and what is said about bad input.

#![expect(clippy::unwrap_used, reason = "a test may stop at once")]

mod command;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use command::{succeeds, text, turnlight};
use turnlight::export::PointTable;
use turnlight::image::{RgbImage, write_exr};
use turnlight::mesh::{sphere, write_ply};

/// Every file of the folders that hold results, with its bytes; names relative to `folder`.
fn results(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for part in ["images", "masks"] {
        for entry in std::fs::read_dir(folder.join(part)).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(folder).unwrap().to_owned();
            files.insert(name, std::fs::read(path).unwrap());
        }
    }
    files
}

/// A scene of one shipped mesh in a shipped light, small, with `material` lines and `frames`.
fn write_scene(folder: &Path, mesh: &str, probe: &str, material: &str, frames: usize) -> PathBuf {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let place = |name: &str| {
        let shipped = scenes.join(name);
        text(if shipped.exists() {
            &shipped
        } else {
            Path::new(name)
        })
        .to_owned()
    };
    let scene = format!(
        "[object]\nmesh = '{}'\n[material]\n{material}\n[probe]\nimage = '{}'\n\
         [camera]\nwidth = 32\nheight = 32\nfov_x_deg = 32.0\n\
         position = [0.0, 1.37, 3.76]\nlook_at = [0.0, 0.0, 0.0]\n\
         [turntable]\nframes = {frames}\n",
        place(&format!("meshes/{mesh}")),
        place(probe),
    );
    let path = folder.join("scene.toml");
    std::fs::write(&path, scene).unwrap();
    path
}

const PLASTIC: &str = "ndf = 'ggx'\nalpha = 0.2\nrho_d = [0.4, 0.3, 0.2]\nrho_s = 2.35";

#[test]
fn white_furnace_returns_one() {
    // A plate that reflects everything, in light of radiance one from everywhere.
    let folder = tempfile::tempdir().unwrap();
    let plate = folder.path().join("plate.obj");
    std::fs::write(
        &plate,
        "v -9 0 -9\nv -9 0 9\nv 9 0 9\nv 9 0 -9\nf 1 2 3 4\n",
    )
    .unwrap();
    let probe = folder.path().join("white.exr");
    write_exr(&probe, &RgbImage::constant(8, 4, [1.0; 3])).unwrap();
    let material = "ndf = 'ggx'\nalpha = 0.5\nrho_d = 1.0\nrho_s = 0.0";
    let scene = write_scene(folder.path(), "absent", text(&probe), material, 1);
    let scene_text = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(&scene, scene_text.replace("meshes/absent", text(&plate))).unwrap();
    let out = folder.path().join("out");
    let run = turnlight(&["render", text(&scene), "--out", text(&out), "--spp", "256"]);
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stderr)
    );
    let image = RgbImage::read(&out.join("images/0000.exr")).unwrap();
    // Pixels at the plate's rim see past it.
    let mask = turnlight::image::Mask::read(&out.join("masks/0000.png")).unwrap();
    let lit: Vec<f32> = (image.pixels.iter().zip(&mask.pixels))
        .filter(|(_, coverage)| **coverage == 255)
        .map(|(pixel, _)| pixel[1])
        .collect();
    assert!(
        lit.len() > 800,
        "the plate fills the image: {} pixels",
        lit.len()
    );
    let mean = lit.iter().sum::<f32>() / lit.len() as f32;
    assert!((mean - 1.0).abs() < 1e-3, "mean {mean}");
    let farthest = lit.iter().map(|v| (v - 1.0).abs()).fold(0.0, f32::max);
    assert!(farthest < 0.05, "one pixel is off by {farthest}");
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), "cup.ply", "probes/courtyard.exr", PLASTIC, 6);
    let at = |name: &str, threads: &str| folder.path().join(format!("{name}{threads}"));
    for threads in ["1", "2", "5"] {
        let capture = at("capture", threads);
        let words = [
            "render",
            text(&scene),
            "--out",
            text(&capture),
            "--spp",
            "8",
        ];
        succeeds(&[&words[..], &["--threads", threads]].concat());
        let fit = at("fit", threads);
        let words = [
            "fit",
            text(&capture),
            "--out",
            text(&fit),
            "--threads",
            threads,
        ];
        succeeds(&words);
    }
    for threads in ["2", "5"] {
        assert!(
            results(&at("capture", "1")) == results(&at("capture", threads)),
            "{threads}"
        );
        let points = |t: &str| std::fs::read(at("fit", t).join("points.npz")).unwrap();
        assert!(
            points("1") == points(threads),
            "{threads} threads fit otherwise"
        );
    }
}

#[test]
fn a_killed_render_goes_on_without_losing_or_tearing_a_frame() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), "suzanne.ply", "probes/city.exr", PLASTIC, 24);
    let (whole, killed) = (folder.path().join("whole"), folder.path().join("killed"));
    let words = |out| {
        [
            "render",
            text(&scene),
            "--out",
            out,
            "--spp",
            "200",
            "--quiet",
        ]
    };
    assert!(turnlight(&words(text(&whole))).status.success());

    // Kill it when some frames are there, but not all.
    let mut run = Command::new(env!("CARGO_BIN_EXE_turnlight"))
        .args(words(text(&killed)))
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let count = || std::fs::read_dir(killed.join("images")).map_or(0, Iterator::count);
    let started = Instant::now();
    while count() < 3 && started.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(Duration::from_millis(2));
    }
    run.kill().unwrap();
    run.wait().unwrap();
    let done = results(&killed);
    assert!(
        !done.is_empty() && count() < 24,
        "killed in the middle: {} frames",
        count()
    );
    // Whatever stands under its final name is whole.
    let expected = results(&whole);
    let finished = done.iter().filter(|(name, _)| expected.contains_key(*name));
    for (name, bytes) in finished {
        assert!(expected[name] == *bytes, "{} is torn", name.display());
    }

    // Another run must not overwrite it unasked, nor go on with other settings.
    let again = turnlight(&words(text(&killed)));
    assert_eq!(again.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&again.stderr).contains("--resume"));
    let other = [
        "render",
        text(&scene),
        "--out",
        text(&killed),
        "--spp",
        "9",
        "--resume",
    ];
    assert!(
        String::from_utf8_lossy(&turnlight(&other).stderr)
            .contains("sampling: --spp 200 there, --spp 9 now")
    );

    let resumed = turnlight(&[&words(text(&killed))[..], &["--resume"]].concat());
    assert!(
        resumed.status.success(),
        "{}",
        String::from_utf8_lossy(&resumed.stderr)
    );
    let resumed = results(&killed);
    for (name, bytes) in &expected {
        assert!(
            resumed.get(name) == Some(bytes),
            "{} differs",
            name.display()
        );
    }
}

#[test]
fn bad_input_is_named_with_its_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), "sphere.ply", "probes/city.exr", PLASTIC, 2);
    let good = std::fs::read_to_string(&scene).unwrap();
    let broken = folder.path().join("broken.ply");
    std::fs::write(&broken, "ply\nformat ascii 1.0\nelement vertex 3\n").unwrap();
    let torn = folder.path().join("torn.exr");
    std::fs::write(&torn, b"v/1\x01\x02\0\0\0chann").unwrap();
    let sphere = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes/sphere.ply");
    let city = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/probes/city.exr");
    // What is changed in the scene, and what the message must hold: file, field, value or remedy.
    let cases: [(&str, &str, &[&str]); 9] = [
        (
            "alpha = 0.2",
            "alpha = 2.0",
            &["scene.toml", "material.alpha", "2"],
        ),
        (
            "alpha = 0.2",
            "alhpa = 0.2",
            &["scene.toml", "material.alhpa", "alpha"],
        ),
        (
            "fov_x_deg = 32.0",
            "fov_x_deg = 190.0",
            &["camera.fov_x_deg", "190"],
        ),
        ("frames = 2", "frames = 0", &["turntable.frames", "0"]),
        ("frames = 2", "frames = ", &["scene.toml:", "TOML"]),
        (
            "look_at = [0.0, 0.0, 0.0]",
            "look_at = [0.0, 1.37, 3.76]",
            &["camera.look_at", "position"],
        ),
        (
            "rho_d = [0.4, 0.3, 0.2]",
            "rho_d = 'vertex:paint'",
            &["rho_d", "paint", "none"],
        ),
        (text(&sphere), text(&broken), &["broken.ply"]),
        (text(&city), text(&torn), &["torn.exr"]),
    ];
    for (from, to, expected) in cases {
        assert!(good.contains(from), "{from}");
        std::fs::write(&scene, good.replace(from, to)).unwrap();
        let out = folder.path().join("out");
        let run = turnlight(&["render", text(&scene), "--out", text(&out), "--spp", "1"]);
        let said = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(2), "{to}: {said}");
        assert!(!out.exists(), "{to}: something was written");
        for word in expected {
            assert!(said.contains(word), "{to}: {said:?} does not say {word:?}");
        }
        assert!(!said.contains("panicked"), "{said}");
    }
}

#[test]
fn a_capture_that_shows_nothing_of_the_object_exits_with_1() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), "sphere.ply", "probes/city.exr", PLASTIC, 2);
    let capture = folder.path().join("capture");
    let words = [
        "render",
        text(&scene),
        "--out",
        text(&capture),
        "--spp",
        "1",
        "--quiet",
    ];
    assert!(turnlight(&words).status.success());
    let masks = results(&capture)
        .into_keys()
        .filter(|name| name.starts_with("masks"));
    for mask in masks {
        let empty = turnlight::image::Mask {
            width: 32,
            height: 32,
            pixels: vec![0; 1024],
        };
        empty.write(&capture.join(mask)).unwrap();
    }
    let fit = folder.path().join("fit");
    let run = turnlight(&["fit", text(&capture), "--out", text(&fit)]);
    assert_eq!(run.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&run.stderr).contains("no surface point is seen"));
    assert!(!fit.exists());
}

/// The shipped sphere as a file without texture coordinates.
fn bare_sphere(path: &Path) {
    let mut mesh = sphere(25).into_mesh().unwrap();
    mesh.uvs = None;
    write_ply(path, &mesh).unwrap();
}

/// Median of what is finite.
fn median(values: impl Iterator<Item = f32>) -> f32 {
    let mut values: Vec<f32> = values.filter(|v| v.is_finite()).collect();
    values.sort_by(f32::total_cmp);
    values[values.len() / 2]
}

#[test]
fn texels_of_a_mesh_without_charts_recover_its_material() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    bare_sphere(&at("bare.ply"));
    let scene = write_scene(folder.path(), "absent", "probes/interior.exr", PLASTIC, 24);
    let written = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(&scene, written.replace("meshes/absent", "bare.ply")).unwrap();
    let (capture, fit, again) = (at("capture"), at("fit"), at("again"));
    let render = ["render", text(&scene), "--out", text(&capture)];
    succeeds(&[&render[..], &["--spp", "256", "--max-depth", "2"]].concat());
    let words = [
        "fit",
        text(&capture),
        "--out",
        text(&fit),
        "--points",
        "texels=48",
    ];
    let told = succeeds(&words);
    assert!(
        told.contains("mesh.ply: has no texture coordinates"),
        "{told}"
    );

    // The estimate, of texels that a third of the frames see.
    let table = PointTable::read_npz(&fit.join("points.npz")).unwrap();
    assert!(
        table
            .texel
            .windows(2)
            .all(|pair| 0 <= pair[0] && pair[0] < pair[1])
    );
    let seen: Vec<usize> = (0..table.len()).filter(|&i| table.frames[i] >= 8).collect();
    assert!(seen.len() > 300, "{} of {}", seen.len(), table.len());
    let of = |value: &dyn Fn(usize) -> f32, truth: f32| {
        median(seen.iter().map(|&i| (value(i) / truth - 1.0).abs()))
    };
    let alpha = of(&|i| table.alpha[i], 0.2);
    let rho_d = of(&|i| table.rho_d[i][1], 0.3);
    let rho_s = of(&|i| table.rho_s[i][1], 2.35);
    println!(
        "{} texels: alpha {alpha:.4}, rho_d {rho_d:.4}, rho_s {rho_s:.4}",
        seen.len()
    );
    assert!(
        alpha < 0.04 && rho_d < 0.005 && rho_s < 0.03,
        "{alpha} {rho_d} {rho_s}"
    );

    // Maps hold it, their seams padded: no texel beside a chart is black.
    let map = RgbImage::read(&fit.join("maps/rho_d.exr")).unwrap();
    assert_eq!((map.width, map.height), (48, 48));
    for name in [
        "alpha",
        "rho_s",
        "ggx",
        "sigma_alpha",
        "sigma_rho_d",
        "sigma_rho_s",
    ] {
        assert!(fit.join(format!("maps/{name}.exr")).exists(), "{name}");
    }
    for &texel in &table.texel {
        let (x, y) = (texel as usize % 48, texel as usize / 48);
        for dy in 0..3 {
            for dx in 0..3 {
                let beside = (y + dy).checked_sub(1).zip((x + dx).checked_sub(1));
                let Some((y, x)) = beside.filter(|(y, x)| *y < 48 && *x < 48) else {
                    continue;
                };
                assert!(map.pixels[y * 48 + x][0] > 0.1, "({x}, {y})");
            }
        }
    }

    // The mesh that lies beside them renders and reports them.
    let words = [
        "reproduce",
        text(&fit),
        "--out",
        text(&again),
        "--spp",
        "64",
    ];
    succeeds(&[&words[..], &["--max-depth", "2"]].concat());
    let figures = at("compare.json");
    succeeds(&[
        "compare",
        text(&capture),
        text(&again),
        "--json",
        text(&figures),
    ]);
    let figures: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&figures).unwrap()).unwrap();
    let overall = &figures["overall"];
    println!("{overall}");
    assert!(overall["psnr_db"].as_f64().unwrap() > 40.0, "{overall}");
    assert!(
        (overall["mean_ratio"].as_f64().unwrap() - 1.0).abs() < 0.01,
        "{overall}"
    );
    succeeds(&["report", text(&fit), "--out", text(&at("report.html"))]);
    succeeds(&[
        "export",
        "mitsuba",
        text(&fit),
        "--out",
        text(&at("mitsuba")),
    ]);

    // Too few texels for the charts: the file, the value and the remedy.
    let out = at("other");
    let run = turnlight(&[
        "fit",
        text(&capture),
        "--out",
        text(&out),
        "--points",
        "texels=4",
    ]);
    let said = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(2), "{said}");
    for word in ["mesh.ply", "resolution = 4", "choose more texels"] {
        assert!(said.contains(word), "{said}");
    }
    assert!(!out.exists());
}

#[test]
fn a_render_never_writes_over_its_own_scene() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = folder.path().join("mesh.ply");
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/meshes/cup.ply");
    std::fs::copy(&shipped, &mesh).unwrap();
    let scene = write_scene(folder.path(), "cup.ply", "probes/courtyard.exr", PLASTIC, 1);
    let written = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(&scene, written.replace(text(&shipped), "mesh.ply")).unwrap();
    let before = std::fs::read(&mesh).unwrap();
    let run = turnlight(&[
        "render",
        text(&scene),
        "--out",
        text(folder.path()),
        "--spp",
        "1",
    ]);
    let said = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(2), "{said}");
    assert!(
        said.contains("mesh.ply") && said.contains("choose another --out"),
        "{said}"
    );
    assert_eq!(std::fs::read(&mesh).unwrap(), before);
    assert!(!folder.path().join("probe.exr").exists());
}
