//! `turnlight register` as a user meets it: from a rough pose to one that `fit` can use, and what is said
//! about input that does not allow it.

#![expect(clippy::unwrap_used, reason = "a test may stop at once")]

mod command;

use std::path::{Path, PathBuf};

use command::{succeeds, text, turnlight};
use turnlight::image::Mask;
use turnlight::scene::Capture;

const FRAMES: usize = 8;
const SIDE: usize = 96;

/// A rendered capture of a shipped mesh, and in its folder `rough.toml`: the same, but off by some degrees.
fn rendered(folder: &Path, mesh: &str) -> PathBuf {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let scene = format!(
        "[object]\nmesh = '{}'\n[material]\nndf = 'ggx'\nalpha = 0.3\nrho_d = [0.4, 0.3, 0.2]\nrho_s = 2.35\n\
         [probe]\nimage = '{}'\n[camera]\nwidth = {SIDE}\nheight = {SIDE}\nfov_x_deg = 32.0\n\
         position = [0.0, 1.37, 3.76]\nlook_at = [0.0, 0.0, 0.0]\n[turntable]\nframes = {FRAMES}\n\
         [sensor]\nfull_well_electrons = 30000.0\nread_noise_electrons = 5.0\nbits = 14\nexposure = 0.3\n",
        text(&scenes.join("meshes").join(mesh)),
        text(&scenes.join("probes/courtyard.exr")),
    );
    let path = folder.join("scene.toml");
    std::fs::write(&path, scene).unwrap();
    let capture = folder.join("capture");
    succeeds(&[
        "render",
        text(&path),
        "--out",
        text(&capture),
        "--spp",
        "16",
        "--quiet",
    ]);
    let sound = std::fs::read_to_string(capture.join("capture.toml")).unwrap();
    let rough = sound
        .replace(
            "mesh = \"mesh.ply\"",
            "mesh = \"mesh.ply\"\nrotation = [2.0, -3.0, 2.5]\ntranslation = [0.05, -0.06, 0.04]",
        )
        .replace("axis = [0.0, 1.0, 0.0]", "axis = [0.05, 1.0, -0.06]")
        .replace("center = [0.0, 0.0, 0.0]", "center = [-0.05, 0.0, 0.07]");
    assert!(
        rough.contains("rotation = [2.0")
            && rough.contains("axis = [0.05")
            && rough.contains("[-0.05")
    );
    std::fs::write(capture.join("rough.toml"), rough).unwrap();
    capture
}

/// Largest distance, pixels, between where two captures show points of the mesh.
fn apart(a: &Capture, b: &Capture) -> f64 {
    let (mesh, _) =
        turnlight::mesh::Mesh::load(&a.object.mesh, &Default::default(), Default::default())
            .unwrap();
    let mut most = 0.0f64;
    for (f, g) in a.frames.iter().zip(&b.frames) {
        for position in mesh.positions.iter().step_by(50) {
            let point = mesh.to_object(*position);
            let pixel = |capture: &Capture, angle: f64| {
                let placed = capture
                    .object
                    .object_from_file
                    .affine()
                    .transform_point3(point);
                let world = capture
                    .turn
                    .world_from_object(angle)
                    .transform_point3(placed);
                capture.camera.project(world).unwrap()
            };
            most = most.max(pixel(a, f.angle).distance(pixel(b, g.angle)));
        }
    }
    most
}

#[test]
fn a_rough_capture_becomes_one_that_fit_reads() {
    let folder = tempfile::tempdir().unwrap();
    let capture = rendered(folder.path(), "suzanne.ply");
    let rough = capture.join("rough.toml");
    let before = std::fs::read(&rough).unwrap();
    let truth = Capture::load(&capture).unwrap();
    assert!(apart(&truth, &Capture::load(&rough).unwrap()) > 5.0);

    // The same bytes from any number of threads, beside the input, which stays.
    let at = |threads: &str| folder.path().join(format!("out{threads}"));
    for threads in ["1", "2", "5"] {
        let out = at(threads);
        succeeds(&[
            "register",
            text(&rough),
            "--out",
            text(&out),
            "--threads",
            threads,
        ]);
    }
    let written = |threads: &str, name: &str| std::fs::read(at(threads).join(name)).unwrap();
    for name in [
        "capture.toml",
        "register.json",
        "register.html",
        "overlays/0003.png",
    ] {
        assert!(
            written("1", name) == written("2", name) && written("1", name) == written("5", name),
            "{name}"
        );
    }
    assert_eq!(std::fs::read(&rough).unwrap(), before);

    // The pose, and what is said of it.
    let found = Capture::load(at("1")).unwrap();
    assert!(apart(&truth, &found) < 0.3, "{}", apart(&truth, &found));
    let json: serde_json::Value = serde_json::from_slice(&written("1", "register.json")).unwrap();
    assert_eq!(json["stop"], "converged");
    assert_eq!(json["mask_border"], "coverage");
    assert_eq!(json["frames"].as_array().unwrap().len(), FRAMES);
    assert!(json["object"]["sigma_rotation_deg"][0].as_f64().unwrap() < 0.05);
    let page = String::from_utf8(written("1", "register.html")).unwrap();
    assert!(page.contains("the camera&#39;s pose") || page.contains("the camera's pose"));

    // A fit from there, and the file replaced only when asked.
    let fit = folder.path().join("fit");
    succeeds(&[
        "fit",
        text(&at("1")),
        "--out",
        text(&fit),
        "--interreflections",
        "0",
        "--quiet",
    ]);
    let (copy, page) = (
        folder.path().join("again"),
        folder.path().join("report.html"),
    );
    succeeds(&[
        "reproduce",
        text(&fit),
        "--out",
        text(&copy),
        "--spp",
        "4",
        "--quiet",
    ]);
    succeeds(&[
        "report",
        text(&fit),
        "--reproduced",
        text(&copy),
        "--out",
        text(&page),
    ]);
    // Page and comparison find the photographs, which are in another folder than the registered capture.
    let page = std::fs::read_to_string(page).unwrap();
    assert!(!page.contains("cannot be shown") && page.contains("PSNR"));
    let figures = |reference: &Path| -> serde_json::Value {
        let json = folder.path().join("errors.json");
        let words = [
            "compare",
            text(reference),
            text(&copy),
            "--json",
            text(&json),
        ];
        succeeds(&words);
        serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap()
    };
    let registered = figures(&at("1"));
    assert_eq!(registered, figures(&capture));
    assert_eq!(registered, figures(&rough));
    assert_eq!(registered["frames"].as_array().unwrap().len(), FRAMES);
    let ratio = registered["overall"]["mean_ratio"].as_f64().unwrap();
    assert!((0.95..1.05).contains(&ratio), "{ratio}");

    // Photographs keep the names that the camera gave them; they are paired by their order.
    let named = folder.path().join("named");
    std::fs::create_dir(&named).unwrap();
    let mut text_ = std::fs::read_to_string(at("1").join("capture.toml")).unwrap();
    for t in 0..FRAMES {
        let (from, to) = (format!("{t:04}.exr"), format!("IMG_{}.exr", 9000 - t));
        std::fs::copy(capture.join("images").join(&from), named.join(&to)).unwrap();
        let path = format!("../capture/images/{from}");
        assert!(text_.contains(&path), "{text_}");
        text_ = text_.replace(&path, &format!("../named/{to}"));
    }
    std::fs::write(named.join("capture.toml"), text_).unwrap();
    let by_order = figures(&named);
    assert_eq!(by_order["overall"], registered["overall"]);
    assert_eq!(by_order["frames"][0]["name"], "IMG_9000.exr");
    let again = turnlight(&["register", text(&capture), "--out", text(&capture)]);
    assert_eq!(again.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&again.stderr).contains("would be written over"));
    succeeds(&[
        "register",
        text(&rough),
        "--in-place",
        "--hold",
        "turntable",
        "--quiet",
    ]);
    let replaced = Capture::load(&rough).unwrap();
    assert!(apart(&truth, &replaced) < 0.3);
    assert_eq!(replaced.turn.center, glam::DVec3::new(-0.05, 0.0, 0.07));
    assert!(capture.join("registered/capture.toml").exists());
}

#[test]
fn clicked_pairs_replace_a_pose_that_is_not_known() {
    let folder = tempfile::tempdir().unwrap();
    let capture = rendered(folder.path(), "suzanne.ply");
    let truth = Capture::load(&capture).unwrap();
    // Points all over the head and where frame 2 shows them, to the pixel.
    let mut pairs = "frame = 2\n".to_owned();
    let (mesh, _) =
        turnlight::mesh::Mesh::load(&truth.object.mesh, &Default::default(), Default::default())
            .unwrap();
    for position in mesh.positions.iter().step_by(mesh.positions.len() / 8) {
        let point = mesh.to_object(*position);
        let world = truth
            .turn
            .world_from_object(truth.frames[2].angle)
            .transform_point3(point);
        let pixel = truth.camera.project(world).unwrap().round();
        pairs += &format!(
            "[[pairs]]\npoint = [{}, {}, {}]\npixel = [{}, {}]\n",
            point.x, point.y, point.z, pixel.x, pixel.y
        );
    }
    let file = folder.path().join("pairs.toml");
    std::fs::write(&file, &pairs).unwrap();
    let rough = capture.join("rough.toml");
    let lost = std::fs::read_to_string(&rough)
        .unwrap()
        .replace("[2.0, -3.0, 2.5]", "[100.0, 80.0, -40.0]");
    std::fs::write(&rough, lost).unwrap();
    let out = folder.path().join("out");
    let words = ["register", text(&rough), "--out", text(&out)];
    succeeds(&[&words[..], &["--pairs", text(&file)]].concat());
    let off = apart(&truth, &Capture::load(&out).unwrap());
    assert!(off < 0.3, "{off}");

    // What is wrong with pairs is said by file, key, value and remedy.
    let bad = folder.path().join("bad.toml");
    for (from, to, code, expected) in [
        (
            "frame = 2",
            "frame = 99",
            2,
            "frame = 99: the capture has frames 0 to 7",
        ),
        (
            "pixel",
            "pixle",
            2,
            "pairs[0].pixle: unknown key; did you mean pixel?",
        ),
        (
            "frame = 2\n",
            "frame = 2\n[[pairs]]\npoint = [0, 0, 0]\npixel = [9000, -9000]\n",
            1,
            "no pose",
        ),
    ] {
        std::fs::write(&bad, pairs.replacen(from, to, 1)).unwrap();
        let out = folder.path().join("none");
        let run = turnlight(&[
            "register",
            text(&rough),
            "--out",
            text(&out),
            "--pairs",
            text(&bad),
        ]);
        let said = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(code), "{said}");
        assert!(
            said.contains("bad.toml") && said.contains(expected),
            "{said}"
        );
        assert!(!out.exists());
    }
}

#[test]
fn input_that_does_not_allow_it_is_named_and_nothing_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let capture = rendered(folder.path(), "cup.ply");
    let mask = capture.join("masks/0003.png");
    let photograph = capture.join("images/0002.exr");
    let (good_mask, good_photograph) = (
        std::fs::read(&mask).unwrap(),
        std::fs::read(&photograph).unwrap(),
    );
    let small = Mask {
        width: 12,
        height: 9,
        pixels: vec![255; 108],
    };
    let run = |more: &[&str]| {
        let out = folder.path().join("out");
        let place = ["--out", text(&out)];
        let place = if more.contains(&"--out") {
            &[]
        } else {
            &place[..]
        };
        let run = turnlight(&[&["register", text(&capture)], place, more].concat());
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(!said.contains("panicked"), "{said}");
        let code = run.status.code().unwrap();
        assert!(code == 0 || !out.exists(), "{said}");
        (code, said)
    };

    // Masks and photographs: truncated, of another size, absent, blank.
    std::fs::write(&mask, &good_mask[..good_mask.len() / 2]).unwrap();
    let (code, said) = run(&[]);
    assert!(code == 2 && said.contains("0003.png"), "{code} {said}");
    small.write(&mask).unwrap();
    let (code, said) = run(&[]);
    assert!(
        code == 2 && said.contains("0003.png: is 12 x 9, the camera 96 x 96"),
        "{code} {said}"
    );
    std::fs::remove_file(&mask).unwrap();
    let (code, said) = run(&[]);
    assert!(
        code == 2 && said.contains("frames[3].mask") && said.contains("no such file"),
        "{code} {said}"
    );
    std::fs::write(&mask, &good_mask).unwrap();
    std::fs::write(&photograph, &good_photograph[..200]).unwrap();
    let (code, said) = run(&[]);
    assert!(code == 2 && said.contains("0002.exr"), "{code} {said}");
    std::fs::write(&photograph, &good_photograph).unwrap();

    // A place where no folder can be: told before the work.
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    let (code, said) = run(&["--out", text(&file.join("below"))]);
    assert!(code == 2 && said.contains("is a file; name"), "{said}");

    // A body of revolution: exit 1 and what helps, or as asked.
    let (code, said) = run(&[]);
    assert!(
        code == 1 && said.contains("turning the object about [0, 1, 0]"),
        "{code} {said}"
    );
    assert!(said.contains("--keep-unknown"), "{said}");
    let (code, said) = run(&["--search", "0"]);
    assert!(code == 2 && said.contains("1 to 65536"), "{code} {said}");
    let (code, said) = run(&["--keep-unknown"]);
    assert!(code == 0, "{code} {said}");
    std::fs::remove_dir_all(folder.path().join("out")).unwrap();

    for number in 0..FRAMES {
        let blank = Mask {
            width: SIDE,
            height: SIDE,
            pixels: vec![0; SIDE * SIDE],
        };
        blank
            .write(&capture.join(format!("masks/{number:04}.png")))
            .unwrap();
    }
    let (code, said) = run(&[]);
    assert!(
        code == 1 && said.contains("0000.png: no pixel"),
        "{code} {said}"
    );
}
