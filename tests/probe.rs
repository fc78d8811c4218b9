//! `turnlight probe` as a user meets it: from photographs to a light, and what is said about bad input.

#![expect(clippy::unwrap_used, reason = "a test may stop at once")]

mod command;
mod photographs;

use std::io::Cursor;
use std::path::{Path, PathBuf};

use command::{succeeds, text, turnlight};
use image::{ImageFormat, RgbImage as Bytes};
use photographs::{dng, with_exif};
use turnlight::image::{Exposure, Mask, RgbImage, read_exr_channels, srgb_encode, write_exr};

/// Files of the folder `shared/data` beside the repository, or `None` where there is none.
fn shared(name: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = root.parent()?.join("shared/data").join(name);
    path.exists().then_some(path)
}

/// sRGB photographs of a ramp over three decades, four times as long each.
fn bracket(folder: &Path, count: u32, kind: ImageFormat) -> Vec<PathBuf> {
    (0..count)
        .map(|j| {
            let image = Bytes::from_fn(96, 48, |x, y| {
                let radiance = 10f64.powf(f64::from(x) / 32.0 - 1.0) * (1.0 + 0.01 * f64::from(y));
                let exposure = 4f64.powi(j as i32) / 64.0;
                let v = (255.0 * srgb_encode((radiance * exposure).min(1.0))).round() as u8;
                image::Rgb([v, v, v / 2])
            });
            let mut file = Cursor::new(Vec::new());
            image.write_to(&mut file, kind).unwrap();
            let (bytes, name) = if kind == ImageFormat::Jpeg {
                (
                    with_exif(&file.into_inner(), (4u32.pow(j), 64)),
                    format!("{j}.jpg"),
                )
            } else {
                (file.into_inner(), format!("{j}.png"))
            };
            let path = folder.join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        })
        .collect()
}

fn merge(images: &[PathBuf], out: &Path, more: &[&str]) -> std::process::Output {
    let mut words = vec!["probe", "merge"];
    words.extend(images.iter().map(|p| text(p)));
    words.extend(["--out", text(out)]);
    words.extend(more);
    turnlight(&words)
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn exif_tells_the_exposures_and_everything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let images = bracket(folder.path(), 5, ImageFormat::Jpeg);
    let exif = Exposure::read(&images[2]).unwrap();
    assert_eq!(
        (exif.seconds, exif.f_number, exif.iso),
        (Some(0.25), Some(4.0), Some(200.0))
    );
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    let run = merge(&images, &out.join("probe.exr"), &[]);
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stderr)
    );
    assert_eq!(
        names(&out),
        [
            "probe.clipped.png",
            "probe.exr",
            "probe.ghosts.png",
            "probe.merge.json",
            "probe.response.csv",
            "probe.variance.exr"
        ]
    );
    let probe = RgbImage::read(&out.join("probe.exr")).unwrap();
    // Unit: one white a second at f/1 and ISO 100; f/4 at ISO 200 takes an eighth.
    let ratio: Vec<f64> = (10..80)
        .map(|x| {
            let truth = 10f64.powf(x as f64 / 32.0 - 1.0) * 1.24 * 8.0;
            f64::from(probe.pixels[24 * 96 + x][0]) / truth
        })
        .collect();
    let mut sorted = ratio.clone();
    sorted.sort_unstable_by(f64::total_cmp);
    assert!((sorted[35] - 1.0).abs() < 0.02, "{sorted:?}");
    let (_, _, planes) = read_exr_channels(&out.join("probe.variance.exr")).unwrap();
    assert_eq!(planes.len(), 3);
    let mask = Mask::read(&out.join("probe.clipped.png")).unwrap();
    assert!(mask.pixels[0] == 0 && mask.pixels[24 * 96 + 95] == 255);

    // The response found serves again.
    let response = out.join("probe.response.csv");
    let run = merge(
        &images,
        &out.join("again.exr"),
        &["--response", text(&response)],
    );
    assert!(
        run.status.success(),
        "{}",
        String::from_utf8_lossy(&run.stderr)
    );
}

#[test]
fn threads_leave_every_byte_of_a_merge_alone() {
    let folder = tempfile::tempdir().unwrap();
    let images = bracket(folder.path(), 4, ImageFormat::Png);
    let times = ["--times", "1/64,1/16,1/4,1"];
    for threads in ["1", "3"] {
        let out = folder.path().join(format!("{threads}.exr"));
        let run = merge(
            &images,
            &out,
            &[&times[..], &["--threads", threads]].concat(),
        );
        assert!(
            run.status.success(),
            "{}",
            String::from_utf8_lossy(&run.stderr)
        );
    }
    for suffix in [
        "exr",
        "variance.exr",
        "clipped.png",
        "ghosts.png",
        "response.csv",
    ] {
        let read = |n: &str| std::fs::read(folder.path().join(format!("{n}.{suffix}"))).unwrap();
        assert!(read("1") == read("3"), "{suffix}");
    }
}

#[test]
fn bad_brackets_exit_with_2_a_name_and_nothing_written() {
    let folder = tempfile::tempdir().unwrap();
    let images = bracket(folder.path(), 3, ImageFormat::Png);
    let small = folder.path().join("small.png");
    Bytes::new(5, 5).save(&small).unwrap();
    let short = folder.path().join("short.png");
    let bytes = std::fs::read(&images[0]).unwrap();
    std::fs::write(&short, &bytes[..bytes.len() / 2]).unwrap();
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    let first = images[0].clone();
    for (images, more, words) in [
        (images.clone(), vec![], ["0.png", "ExposureTime", "--times"]),
        (
            images.clone(),
            vec!["--times", "1,2"],
            ["2 values", "3 images", "order"],
        ),
        (
            images.clone(),
            vec!["--times", "1,-2,3"],
            ["-2", "seconds", "> 0"],
        ),
        (
            images.clone(),
            vec!["--times", "1,1,1"],
            ["exposure", "different", "--times"],
        ),
        (
            vec![first.clone(), small],
            vec!["--times", "1,2"],
            ["small.png", "5 × 5", "96 × 48"],
        ),
        (
            vec![first.clone(), short],
            vec!["--times", "1,2"],
            ["short.png", "check", ";"],
        ),
        (
            vec![first.clone(), folder.path().join("absent.png")],
            vec!["--times", "1,2"],
            ["absent.png", "check", "path"],
        ),
        (
            images,
            vec!["--times", "1,2,3", "--response", "nothing.csv"],
            ["nothing.csv", "give", ";"],
        ),
    ] {
        let run = merge(&images, &out.join("probe.exr"), &more);
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(2), "{said}");
        assert!(
            words.iter().all(|w| said.contains(w)),
            "{words:?} in: {said}"
        );
        assert!(names(&out).is_empty());
    }
    // Outputs that cannot be are refused before anything is read; nothing is written over what is read.
    let times = ["--times", "1,2,3"];
    let images = bracket(folder.path(), 3, ImageFormat::Png);
    let absent = folder.path().join("absent/probe.exr");
    let read = folder.path().join("read.exr");
    write_exr(&read, &RgbImage::constant(96, 48, [0.1; 3])).unwrap();
    for (images, name, said) in [
        (&images, out.join("probe.png"), "ends in .exr"),
        (&images, out.with_extension("exr"), "is a folder"),
        (&images, absent, "there is no folder"),
        (&vec![read.clone(); 3], read.clone(), "it is read"),
    ] {
        if said == "is a folder" {
            std::fs::create_dir(&name).unwrap();
        }
        let run = merge(images, &name, &times);
        let told = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(2), "{told}");
        assert!(told.contains("--out") && told.contains(said), "{told}");
        assert!(names(&out).is_empty());
    }
    // Nor what goes beside the image.
    let beside = out.join("probe.response.csv");
    std::fs::create_dir(&beside).unwrap();
    let run = merge(&images, &out.join("probe.exr"), &times);
    let told = String::from_utf8_lossy(&run.stderr).into_owned();
    assert_eq!(run.status.code(), Some(2), "{told}");
    assert!(told.contains("probe.response.csv: is a folder"), "{told}");
    std::fs::remove_dir(&beside).unwrap();
    assert!(names(&out).is_empty());
    // Half of a JPEG is no exposure, though its decoder would fill it with grey.
    let jpegs = bracket(folder.path(), 3, ImageFormat::Jpeg);
    let bytes = std::fs::read(&jpegs[1]).unwrap();
    std::fs::write(&jpegs[1], &bytes[..bytes.len() / 2]).unwrap();
    let run = merge(&jpegs, &out.join("probe.exr"), &times);
    let told = String::from_utf8_lossy(&run.stderr).into_owned();
    assert_eq!(run.status.code(), Some(2), "{told}");
    let said = "ends before its picture does; check that the file is complete";
    assert!(told.contains(said), "{told}");
    assert!(names(&out).is_empty());
    // Without times: a file that is no photograph is not asked for its EXIF.
    let text_file = folder.path().join("text.jpg");
    std::fs::write(&text_file, "hello").unwrap();
    let run = merge(&[text_file, images[0].clone()], &out.join("probe.exr"), &[]);
    let told = String::from_utf8_lossy(&run.stderr).into_owned();
    assert_eq!(run.status.code(), Some(2), "{told}");
    assert!(told.contains("text.jpg: is not an image"), "{told}");

    // Times in the wrong order: the data do not allow it.
    let images = bracket(folder.path(), 3, ImageFormat::Png);
    let run = merge(&images, &out.join("probe.exr"), &["--times", "9,3,1"]);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(
        run.status.code() == Some(1) && said.contains("order of the files"),
        "{said}"
    );
    assert!(names(&out).is_empty());
}

#[test]
#[cfg(feature = "raw")]
fn raw_files_become_the_cameras_linear_rgb() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("flat.dng");
    // Red 0.25, green 0.5, blue 0.75 of the way from black to white.
    let level = |x: u16, y: u16| 1000 + 4000 * (1 + x % 2 + y % 2);
    std::fs::write(&path, dng(64, 48, level)).unwrap();
    let image = RgbImage::read(&path).unwrap();
    assert_eq!((image.width, image.height), (64, 48));
    for p in &image.pixels {
        for (c, expected) in p.iter().zip([0.25, 0.5, 0.75]) {
            assert!((c - expected).abs() < 1e-5, "{p:?}");
        }
    }
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() - 999]).unwrap();
    let error = RgbImage::read(&path).unwrap_err().to_string();
    assert!(error.contains("flat.dng"), "{error}");
}

#[test]
fn a_chart_is_matched_applied_and_nonsense_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    // The camera's patches, and what a camera of other primaries makes of them.
    let camera: Vec<[f64; 3]> = (0..12)
        .map(|i| [0, 1, 2].map(|c| 0.05 + 0.8 * f64::from((i * (c + 2) * 7) % 12) / 12.0))
        .collect();
    let other = |p: &[f64; 3]| {
        [
            0.6 * p[0] + 0.3 * p[1],
            0.2 * p[0] + 0.7 * p[1],
            0.1 * p[1] + 0.8 * p[2],
        ]
    };
    let list = |patches: &mut dyn Iterator<Item = [f64; 3]>| -> String {
        patches
            .map(|p| format!("{},{},{}\n", p[0], p[1], p[2]))
            .collect()
    };
    std::fs::write(file("camera.csv"), list(&mut camera.iter().copied())).unwrap();
    std::fs::write(file("probe.csv"), list(&mut camera.iter().map(other))).unwrap();
    let light = RgbImage::from_fn(8, 4, |x, y| {
        other(&camera[(x + y) % 12]).map(|c| 1e4 * c as f32)
    });
    write_exr(&file("light.exr"), &light).unwrap();
    let (probe, cam, out) = (file("probe.csv"), file("camera.csv"), file("match.toml"));
    let (light, matched) = (file("light.exr"), file("matched.exr"));
    succeeds(&[
        "probe",
        "match",
        text(&probe),
        text(&cam),
        "--out",
        text(&out),
        "--apply",
        text(&light),
        "--matched",
        text(&matched),
    ]);
    let matched = RgbImage::read(&matched).unwrap();
    for (i, p) in matched.pixels.iter().enumerate() {
        let truth = camera[(i % 8 + i / 8) % 12];
        for c in 0..3 {
            assert!(
                (f64::from(p[c]) / (1e4 * truth[c]) - 1.0).abs() < 1e-3,
                "{p:?} {truth:?}"
            );
        }
    }
    let record: toml::Table = toml::from_str(&std::fs::read_to_string(&out).unwrap()).unwrap();
    assert!(record["delta_e_mean"].as_float().unwrap() < 1e-3);

    std::fs::remove_file(&out).unwrap();
    for (text_, code, words) in [
        ("0.1,0.2\n", 2, ["bad.csv", "line 1", "must be"]),
        ("0.1,x,0.2\n", 2, ["bad.csv", "line 1", "must be a number"]),
        ("0.1,0.1,0.2\n", 1, ["1 patches", "12", "same"]),
        (
            &"0.1,0.1,0.1\n".repeat(12),
            1,
            ["one colour", "photograph", "chart"],
        ),
    ] {
        std::fs::write(file("bad.csv"), text_).unwrap();
        let run = turnlight(&[
            "probe",
            "match",
            text(&file("bad.csv")),
            text(&cam),
            "--out",
            text(&out),
        ]);
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(code), "{said}");
        assert!(
            words.iter().all(|w| said.contains(w)),
            "{words:?} in: {said}"
        );
        assert!(!out.exists());
    }
}

#[test]
#[cfg(feature = "raw")]
fn a_real_chart_is_matched() {
    let Some(dng) = shared("captures/colorchart_dng/colorchart.dng") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("match.toml");
    succeeds(&[
        "probe",
        "match",
        text(&dng),
        "colorchecker",
        "--greys",
        "chart",
        "--probe-corners",
        "714,626,1250,616,1256,924,702,930",
        "--out",
        text(&out),
    ]);
    let record: toml::Table = toml::from_str(&std::fs::read_to_string(&out).unwrap()).unwrap();
    let mean = record["delta_e_mean"].as_float().unwrap();
    println!(
        "mean ΔE2000 {mean:.2}, left out {:?}",
        record["delta_e_mean_left_out"]
    );
    assert!(mean <= 2.0, "{mean}");
}

#[test]
fn the_page_holds_everything_and_is_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("probe.html");
    let figures = folder.path().join("probe.json");
    let probe = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/probes/interior.exr");
    succeeds(&[
        "probe",
        "inspect",
        text(&probe),
        "--out",
        text(&page),
        "--json",
        text(&figures),
    ]);
    let html = std::fs::read_to_string(&page).unwrap();
    for words in [
        "mirror ball",
        "Resolution",
        "Where to put a lamp",
        "data:image/png;base64,",
        "<circle",
    ] {
        assert!(html.contains(words), "{words}");
    }
    // Pictures are letters of all kinds.
    let pieces = html.split("base64,").enumerate();
    let words: String = pieces
        .map(|(i, piece)| {
            if i == 0 {
                piece
            } else {
                &piece[piece.find('"').unwrap()..]
            }
        })
        .collect();
    assert!(!words.contains("http") && !words.contains("NaN"));
    let figures: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&figures).unwrap()).unwrap();
    assert!(figures["inspection"]["source_count"].as_u64().unwrap() > 0);
    assert_eq!(figures["forecast"].as_array().unwrap().len(), 5);

    let run = turnlight(&[
        "probe",
        "inspect",
        "absent.exr",
        "--out",
        text(&folder.path().join("x.html")),
    ]);
    assert_eq!(run.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&run.stderr).contains("absent.exr"));
}

#[test]
fn what_is_no_light_probe_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (picture, page) = (folder.path().join("a.png"), folder.path().join("a.html"));
    let noise = |x: u32, y: u32| image::Rgb([(x * 7 + y * 13) as u8; 3]);
    Bytes::from_fn(64, 48, noise).save(&picture).unwrap();
    let run = turnlight(&["probe", "inspect", text(&picture), "--out", text(&page)]);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert_eq!(run.status.code(), Some(0), "{said}");
    for words in ["64 × 48", "twice as wide as high", "Bits8", "probe merge"] {
        assert!(said.contains(words), "{words} in: {said}");
    }
    // As a chart, it wants to be told where.
    let out = folder.path().join("match.toml");
    let run = turnlight(&[
        "probe",
        "match",
        text(&picture),
        "colorchecker",
        "--out",
        text(&out),
    ]);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert_eq!(run.status.code(), Some(2), "{said}");
    assert!(
        said.contains("is an image; say where its chart is with --probe-corners"),
        "{said}"
    );
    assert!(!out.exists());
}
