//! Laws of the readers and writers together.

use std::{
    fs,
    io::Cursor,
    path::{Path, PathBuf},
};

use ::exr::{
    meta::attribute::IntegerBounds,
    prelude::{
        AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image,
        ImageAttributes, Layer, LayerAttributes, Layers, LineOrder, SmallVec, Vec2, WritableImage,
        f16,
    },
};
use proptest::prelude::*;

use super::*;

/// Files of the folder `shared/data` beside the repository, or `None` where there is none.
fn shared(name: &str) -> Option<PathBuf> {
    let repository = std::env::var("CARGO_MANIFEST_DIR").ok()?;
    let path = Path::new(&repository)
        .parent()?
        .join("shared/data")
        .join(name);
    path.exists().then_some(path)
}

fn awkward() -> RgbImage {
    let values = [f32::NAN, f32::INFINITY, -1.5, 0.0, -0.0, 1e-40, 3.2e38, 0.1];
    RgbImage::from_fn(37, 21, |x, y| {
        std::array::from_fn(|c| values[(x + 3 * y + 5 * c) % values.len()])
    })
}

fn bits(image: &RgbImage) -> Vec<u32> {
    image
        .pixels
        .as_flattened()
        .iter()
        .map(|x| x.to_bits())
        .collect()
}

fn layer(
    name: &str,
    size: Vec2<usize>,
    position: Vec2<i32>,
    encoding: Encoding,
    channels: &[(&str, FlatSamples)],
) -> Layer<AnyChannels<FlatSamples>> {
    let list: SmallVec<[AnyChannel<FlatSamples>; 4]> = channels
        .iter()
        .map(|(name, samples)| AnyChannel::new(*name, samples.clone()))
        .collect();
    let attributes = LayerAttributes::named(name).with_position(position);
    Layer::new(size, attributes, encoding, AnyChannels::sort(list))
}

fn write_layers(path: &Path, display: IntegerBounds, layers: Vec<Layer<AnyChannels<FlatSamples>>>) {
    let layers: Layers<AnyChannels<FlatSamples>> = layers.into_iter().collect();
    let image = Image {
        attributes: ImageAttributes::new(display),
        layer_data: layers,
    };
    image.write().to_file(path).unwrap();
}

const PLAIN: Encoding = Encoding {
    compression: Compression::ZIP1,
    blocks: Blocks::ScanLines,
    line_order: LineOrder::Increasing,
};

fn ramp(count: usize, start: f32) -> FlatSamples {
    FlatSamples::F32((0..count).map(|i| start + i as f32).collect())
}

#[test]
fn exr_returns_every_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    write_exr(&path, &awkward()).unwrap();
    let back = RgbImage::read(&path).unwrap();
    assert_eq!((back.width, back.height), (37, 21));
    assert_eq!(bits(&back), bits(&awkward()));
}

#[test]
fn exr_of_equal_images_has_equal_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let image = RgbImage::from_fn(200, 130, |x, y| [x as f32, y as f32, (x as f32).sin()]);
    let write = |name: &str| {
        write_exr(&folder.path().join(name), &image).unwrap();
        fs::read(folder.path().join(name)).unwrap()
    };
    assert_eq!(write("a.exr"), write("b.exr"));
}

#[test]
fn exr_channels_come_back_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let plane = |name: &str, start: f32| Channel {
        name: name.to_owned(),
        samples: (0..6).map(|i| start + i as f32).collect(),
    };
    let channels = [
        plane("alpha", 0.0),
        plane("depth.Z", 10.0),
        plane("normal.X", 20.0),
    ];
    write_exr_channels(&path, 3, 2, &channels).unwrap();
    assert_eq!(read_exr_channels(&path).unwrap(), (3, 2, channels.to_vec()));
    let error = RgbImage::read(&path).unwrap_err().to_string();
    assert!(
        error.contains("a.exr") && error.contains("alpha, depth.Z, normal.X"),
        "{error}"
    );
    // A lone channel is a grey image: a map of one parameter.
    write_exr_channels(&path, 3, 2, &channels[..1]).unwrap();
    assert_eq!(RgbImage::read(&path).unwrap().pixels[5], [5.0; 3]);
}

#[test]
fn exr_with_wrong_channels_is_refused_and_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let plane = |count| Channel {
        name: "Z".to_owned(),
        samples: vec![0.0; count],
    };
    for (channels, width) in [
        (vec![plane(3)], 2),
        (vec![plane(2), plane(2)], 2),
        (vec![], 2),
        (vec![plane(0)], 0),
    ] {
        assert!(write_exr_channels(&path, width, 1, &channels).is_err());
        assert!(!path.exists());
    }
}

#[test]
fn exr_data_window_is_placed_in_the_display_window() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    // Display x 10..14, y -2..1; data x 12..17, y -4..0: crops right and above, pads left and below.
    let samples = |start| ramp(20, start);
    let channels = [
        ("R", samples(0.0)),
        ("G", samples(100.0)),
        ("B", samples(200.0)),
    ];
    let data = layer("", Vec2(5, 4), Vec2(12, -4), PLAIN, &channels);
    write_layers(&path, IntegerBounds::new((10, -2), (4, 3)), vec![data]);
    let image = RgbImage::read(&path).unwrap();
    assert_eq!((image.width, image.height), (4, 3));
    let red: Vec<f32> = image.pixels.iter().map(|p| p[0]).collect();
    assert_eq!(
        red,
        [
            0.0, 0.0, 10.0, 11.0, 0.0, 0.0, 15.0, 16.0, 0.0, 0.0, 0.0, 0.0
        ]
    );
    assert_eq!(image.pixels[3], [11.0, 111.0, 211.0]);
}

#[test]
fn exr_layouts_agree() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let size = Vec2(70, 45);
    let values = |c: usize| (0..size.area()).map(move |i| ((i * 7 + c * 31) % 256) as f32);
    let expected: Vec<[f32; 3]> = values(0)
        .zip(values(1))
        .zip(values(2))
        .map(|((r, g), b)| [r, g, b])
        .collect();
    let half = |c| FlatSamples::F16(values(c).map(f16::from_f32).collect());
    let float = |c| FlatSamples::F32(values(c).collect());
    let uint = |c| FlatSamples::U32(values(c).map(|x| x as u32).collect());
    use Compression::*;
    for compression in [Uncompressed, RLE, ZIP1, ZIP16, PIZ] {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(32, 16))] {
            for line_order in [LineOrder::Increasing, LineOrder::Decreasing] {
                let encoding = Encoding {
                    compression,
                    blocks,
                    line_order,
                };
                // Mixed sample types, channels under a prefix, alpha beside them.
                let channels = [
                    ("view.R", half(0)),
                    ("view.G", float(1)),
                    ("view.B", uint(2)),
                    ("view.A", half(1)),
                ];
                let layer = layer("", size, Vec2(0, 0), encoding, &channels);
                write_layers(&path, IntegerBounds::new((0, 0), size), vec![layer]);
                assert_eq!(
                    RgbImage::read(&path).unwrap().pixels,
                    expected,
                    "{encoding:?}"
                );
            }
        }
    }
}

#[test]
fn exr_takes_the_first_layer_with_rgb() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let size = Vec2(2, 2);
    let make = |name: &str, channels: &[(&str, FlatSamples)]| {
        layer(name, size, Vec2(0, 0), PLAIN, channels)
    };
    let rgb = |start: f32| {
        [
            ("B", ramp(4, start)),
            ("G", ramp(4, start)),
            ("R", ramp(4, start)),
        ]
    };
    let layers = vec![
        make("depth", &[("Z", ramp(4, 50.0))]),
        make("grey", &[("Y", ramp(4, 60.0))]),
        make("first", &rgb(10.0)),
        make("second", &rgb(20.0)),
    ];
    write_layers(&path, IntegerBounds::new((0, 0), size), layers.clone());
    assert_eq!(RgbImage::read(&path).unwrap().pixels[0], [10.0; 3]);
    let (_, _, channels) = read_exr_channels(&path).unwrap();
    let names: Vec<&str> = channels
        .iter()
        .map(|channel| channel.name.as_str())
        .collect();
    assert_eq!(names[..3], ["depth.Z", "grey.Y", "first.B"]);
    assert_eq!(channels[0].samples[3], 53.0);
    assert_eq!(channels[7].samples[0], 20.0);
    // Without RGB, luminance; Y beside chroma is not grey.
    write_layers(
        &path,
        IntegerBounds::new((0, 0), size),
        layers[..2].to_vec(),
    );
    assert_eq!(RgbImage::read(&path).unwrap().pixels[0], [60.0; 3]);
}

#[test]
fn png_decodes_srgb_unless_raw() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let eight = ::image::RgbaImage::from_raw(1, 1, vec![255, 128, 0, 7]).unwrap();
    eight.save(&path).unwrap();
    let close = |a: [f32; 3], b: [f32; 3]| (0..3).all(|c| (a[c] - b[c]).abs() < 1e-6);
    assert!(close(
        RgbImage::read(&path).unwrap().pixels[0],
        [1.0, 0.215_860_5, 0.0]
    ));
    assert!(close(
        RgbImage::read_raw(&path).unwrap().pixels[0],
        [1.0, 128.0 / 255.0, 0.0]
    ));
    let sixteen =
        ::image::ImageBuffer::<::image::Luma<u16>, _>::from_raw(2, 1, vec![65535, 32768]).unwrap();
    sixteen.save(&path).unwrap();
    let raw = RgbImage::read_raw(&path).unwrap();
    assert!(close(raw.pixels[1], [32768.0 / 65535.0; 3]));
    let linear = RgbImage::read(&path).unwrap();
    assert!(
        close(linear.pixels[1], [0.214_048_2; 3]),
        "{:?}",
        linear.pixels
    );
}

#[test]
fn float_formats_stay_linear() {
    let folder = tempfile::tempdir().unwrap();
    let pixels = vec![0.25f32, 0.5, 2.0, 1024.0, 0.0, 64.0];
    let image = ::image::Rgb32FImage::from_raw(2, 1, pixels.clone()).unwrap();
    for name in ["a.tiff", "a.hdr"] {
        let path = folder.path().join(name);
        image.save(&path).unwrap();
        let read = RgbImage::read(&path).unwrap();
        for (value, expected) in read.pixels.as_flattened().iter().zip(&pixels) {
            assert!(
                (value - expected).abs() <= 0.01 * expected.max(1.0),
                "{name}: {value} {expected}"
            );
        }
    }
    // The other signature in use.
    let path = folder.path().join("a.hdr");
    let file = fs::read(&path).unwrap();
    let body = file.strip_prefix(b"#?RADIANCE").unwrap();
    fs::write(&path, [b"#?RGBE", body].concat()).unwrap();
    assert_eq!(RgbImage::read(&path).unwrap().pixels[0], [0.25, 0.5, 2.0]);
}

#[test]
fn mask_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.png");
    let mask = Mask {
        width: 3,
        height: 2,
        pixels: vec![0, 255, 1, 254, 128, 255],
    };
    mask.write(&path).unwrap();
    assert_eq!(Mask::read(&path).unwrap(), mask);
}

#[test]
fn png_shows_the_tone_curve() {
    let image = RgbImage {
        width: 1,
        height: 1,
        pixels: vec![[0.107_930_2, 10.0, -1.0]],
    };
    let bytes = encode_png(&image, ToneCurve { exposure: 2.0 }).unwrap();
    let back = ::image::load_from_memory(&bytes).unwrap().to_rgb8();
    assert_eq!(back.get_pixel(0, 0).0, [128, 255, 0]);
}

#[test]
fn errors_name_the_file_and_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("absent.exr");
    let error = RgbImage::read(&path).unwrap_err().to_string();
    assert!(
        error.contains("absent.exr") && error.contains("check the path"),
        "{error}"
    );
    fs::write(&path, "no image at all").unwrap();
    let error = RgbImage::read(&path).unwrap_err().to_string();
    assert!(
        error.contains("known kind") && error.contains("give EXR"),
        "{error}"
    );
    assert!(
        RgbImage::read(folder.path())
            .unwrap_err()
            .to_string()
            .contains("folder")
    );
    let error = write_exr(&folder.path().join("no/a.exr"), &awkward())
        .unwrap_err()
        .to_string();
    assert!(error.contains("folder exists"), "{error}");
}

/// Valid small files of every kind.
fn samples() -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    let size = Vec2(40, 35);
    let noise = |c: u32| (0..1400u32).map(move |i| ((i * 7919 + c * 31) % 1009) as f32 / 64.0);
    use Compression::*;
    for compression in [
        Uncompressed,
        RLE,
        ZIP16,
        PIZ,
        PXR24,
        B44,
        DWAA(None),
        DWAB(None),
    ] {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 16))] {
            let encoding = Encoding {
                compression,
                blocks,
                line_order: LineOrder::Increasing,
            };
            let half = |c| FlatSamples::F16(noise(c).map(f16::from_f32).collect());
            let float = |c| FlatSamples::F32(noise(c).collect());
            let channels = [
                ("R", half(0)),
                ("G", half(1)),
                ("B", half(2)),
                ("A", float(3)),
            ];
            let path = folder.path().join("a.exr");
            let layer = layer("", size, Vec2(0, 0), encoding, &channels);
            write_layers(&path, IntegerBounds::new((0, 0), size), vec![layer]);
            files.push(fs::read(path).unwrap());
        }
    }
    let rgb = ::image::Rgb32FImage::from_raw(16, 16, noise(0).take(768).collect()).unwrap();
    let image = ::image::DynamicImage::ImageRgb32F(rgb);
    for (name, image) in [
        ("a.hdr", image.clone()),
        ("b.tiff", image.clone()),
        ("c.tiff", image.to_rgb16().into()),
        ("d.png", image.to_rgba16().into()),
        ("e.png", image.to_luma8().into()),
        ("f.jpg", image.to_rgb8().into()),
    ] {
        let path = folder.path().join(name);
        image.save(&path).unwrap();
        files.push(fs::read(path).unwrap());
    }
    files
}

/// Reads bytes as every kind of image; what comes out must be whole.
fn read_all(bytes: &[u8]) {
    use super::{exr, read::for_fuzz};
    for_fuzz(Cursor::new(bytes));
    if let Ok((width, height, channels)) = exr::read_channels(Cursor::new(bytes)) {
        assert!(
            channels
                .iter()
                .all(|channel| channel.samples.len() == width * height)
        );
    }
}

#[test]
fn truncated_files_are_errors_or_whole() {
    for file in samples() {
        for length in (0..file.len()).step_by(file.len() / 60 + 1) {
            read_all(&file[..length]);
        }
    }
}

#[test]
fn headers_that_claim_too_much_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hdr");
    for size in [
        "-Y 30000 +X 30000",
        "-Y 16000 +X 16000",
        "-Y 4294967295 +X 4294967295",
    ] {
        fs::write(
            &path,
            format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{size}\n"),
        )
        .unwrap();
        let error = RgbImage::read(&path).unwrap_err().to_string();
        let named = ["more than", "claims", "too large"]
            .iter()
            .any(|part| error.contains(part));
        assert!(named, "{error}");
    }
    // An EXR whose data and display windows grow to 2^20 × 2^20.
    let path = folder.path().join("a.exr");
    write_exr(&path, &awkward()).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4 + 8;
        bytes[at..at + 8].copy_from_slice(&[0xff, 0xff, 0x0f, 0, 0xff, 0xff, 0x0f, 0]);
    }
    fs::write(&path, bytes).unwrap();
    let error = RgbImage::read(&path).unwrap_err().to_string();
    assert!(error.contains("complete"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn damaged_files_never_panic(
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        near_start in any::<bool>(),
    ) {
        for mut file in samples() {
            let range = if near_start { file.len().min(400) } else { file.len() };
            for (index, value) in &edits {
                file[index.index(range)] = *value;
            }
            read_all(&file);
        }
    }

    #[test]
    fn random_bytes_never_panic(
        mut bytes in prop::collection::vec(any::<u8>(), 0..600),
        kind in 0usize..6,
    ) {
        let starts: [&[u8]; 6] = [
            b"", b"\x76\x2f\x31\x01\x02\0\0\0", b"#?RADIANCE\n\n-Y 8 +X 8\n", b"\x89PNG\r\n\x1a\n",
            b"II*\0\x08\0\0\0", b"\xff\xd8\xff",
        ];
        bytes.splice(0..0, starts[kind].iter().copied());
        read_all(&bytes);
    }
}

fn sums(image: &RgbImage) -> [f64; 3] {
    let sum = |c: usize| image.pixels.iter().map(|pixel| f64::from(pixel[c])).sum();
    std::array::from_fn(sum)
}

#[test]
fn real_probes_read_as_openexr_reads_them() {
    // Sums by OpenEXR 3.5.3's Python module.
    for (name, expected) in [
        (
            "blender_cc0/interior",
            [567_708.853_683, 501_115.989_945, 426_484.092_529],
        ),
        (
            "OrientationLatLong",
            [459_793.459_924, 479_596.786_291, 502_087.210_332],
        ),
    ] {
        let Some(path) = shared(&format!("probes/{name}.exr")) else {
            return;
        };
        let image = RgbImage::read(&path).unwrap();
        assert_eq!((image.width, image.height), (1024, 512));
        for (sum, expected) in sums(&image).iter().zip(expected) {
            assert!(
                (sum / expected - 1.0).abs() < 1e-9,
                "{name}: {sum} {expected}"
            );
        }
        let brightest = |pixel: &[f32; 3]| luminance(pixel.map(f64::from));
        let peak = image.pixels.iter().map(brightest).fold(0.0, f64::max);
        assert!(
            name != "blender_cc0/interior" || (peak / 3.2e4 - 1.0).abs() < 0.01,
            "{peak}"
        );
    }
}

#[test]
fn real_probes_are_read() {
    for name in [
        "city",
        "courtyard",
        "forest",
        "night",
        "studio",
        "sunrise",
        "sunset",
    ] {
        let Some(path) = shared(&format!("probes/blender_cc0/{name}.exr")) else {
            return;
        };
        let image = RgbImage::read(&path).unwrap();
        assert_eq!((image.width, image.height), (1024, 512));
        assert!(
            sums(&image).iter().all(|sum| sum.is_finite() && *sum > 0.0),
            "{name}"
        );
    }
    for name in ["apartment", "studio", "sunset"] {
        let Some(path) = shared(&format!("probes/pmndrs_1k/{name}.hdr")) else {
            return;
        };
        let image = RgbImage::read(&path).unwrap();
        assert_eq!((image.width, image.height), (1024, 512));
        assert!(
            image
                .pixels
                .as_flattened()
                .iter()
                .all(|x| x.is_finite() && *x >= 0.0),
            "{name}"
        );
    }
}
