//! Small sound files of every kind, for damage to begin from.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer,
    LayerAttributes, LineOrder, SmallVec, Vec2, WritableImage, f16,
};
use image::{DynamicImage, ImageFormat, Rgb32FImage};
use turnlight::export::PointTable;
use turnlight::mesh::{LoadOptions, Mesh, write_ply};

/// What a tetrahedron's vertices are: position, normal, texture coordinate.
const CORNERS: [[f32; 8]; 4] = [
    [1.0, 1.0, 1.0, 0.577, 0.577, 0.577, 0.0, 0.0],
    [1.0, -1.0, -1.0, 0.577, -0.577, -0.577, 1.0, 0.0],
    [-1.0, 1.0, -1.0, -0.577, 0.577, -0.577, 0.0, 1.0],
    [-1.0, -1.0, 1.0, -0.577, -0.577, 0.577, 1.0, 1.0],
];
const FACES: [[u32; 3]; 4] = [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]];

/// The bytes that `write` leaves in a file called `name`.
fn written(name: &str, write: impl FnOnce(&Path)) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write(&path);
    std::fs::read(path).unwrap()
}

fn ply_header(format: &str, number: &str, more: &[&str]) -> String {
    let mut text = format!("ply\nformat {format} 1.0\ncomment by hand\nelement vertex 4\n");
    for name in ["x", "y", "z", "nx", "ny", "nz", "s", "t"]
        .iter()
        .chain(more)
    {
        text += &format!("property {number} {name}\n");
    }
    text + "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
}

/// A text PLY whose vertices have the further properties `more`, each of one value.
pub(crate) fn ply_text(more: &[(&str, f32)]) -> Vec<u8> {
    let names: Vec<&str> = more.iter().map(|(name, _)| *name).collect();
    let mut text = ply_header("ascii", "float", &names);
    for corner in CORNERS {
        let values: Vec<String> = corner
            .iter()
            .chain(more.iter().map(|(_, value)| value))
            .map(f32::to_string)
            .collect();
        text += &format!("{}\n", values.join(" "));
    }
    for [a, b, c] in FACES {
        text += &format!("3 {a} {b} {c}\n");
    }
    text.into_bytes()
}

pub(crate) fn ply() -> Vec<Vec<u8>> {
    let mut big = ply_header("binary_big_endian", "double", &["red"]).into_bytes();
    for corner in CORNERS {
        for value in corner.iter().chain([&0.5]) {
            big.extend(f64::from(*value).to_be_bytes());
        }
    }
    for face in FACES {
        big.push(3);
        big.extend(face.into_iter().flat_map(u32::to_be_bytes));
    }
    let little = written("a.ply", |path| {
        let source = path.with_extension("b.ply");
        std::fs::write(&source, &big).unwrap();
        let (mesh, _) = Mesh::load(&source, &Default::default(), LoadOptions::default()).unwrap();
        write_ply(path, &mesh).unwrap();
    });
    let lists = "ply\nformat ascii 1.0\nelement camera 1\nproperty float x\nproperty list uchar float k\n\
        element vertex 4\nproperty float x\nproperty float y\nproperty list uchar int seen\nproperty int z\n\
        property uchar red\nelement face 2\nproperty list uint8 uint32 vertex_index\nproperty int part\n\
        end_header\n0.5 2 1 1\n0 0 1 7 0 255\n1 0 0 0 9\n1 1 2 3 4 0 9\n0 1 0 0 9\n4 0 1 2 3 1\n3 0 1 3 2\n";
    vec![ply_text(&[("alpha", 0.2)]), big, little, lists.into()]
}

pub(crate) fn obj() -> Vec<Vec<u8>> {
    let mut text = String::from("# by hand\nmtllib a.mtl\no shape\n");
    for [x, y, z, nx, ny, nz, u, v] in CORNERS {
        text += &format!("v {x} {y} {z}\nvn {nx} {ny} {nz}\nvt {u} {v}\n");
    }
    for face in FACES {
        let [a, b, c] = face.map(|v| v + 1);
        text += &format!("f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}\n");
    }
    let plain = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 \\\n0 0 0 1\nv 0 1 0 1 1 1\nf -4 -3 -2 -1\nf 1//  2 3\n";
    vec![text.into(), plain.replace("1//  2", "1 2").into()]
}

pub(crate) fn stl() -> Vec<Vec<u8>> {
    let mut text = String::from("solid shape\n");
    let mut bytes = [&b"solid although binary"[..], &[b' '; 59]].concat();
    bytes.extend(4u32.to_le_bytes());
    for face in FACES {
        text += " facet normal 0 0 0\n  outer loop\n";
        bytes.extend([0; 12]);
        for corner in face.map(|v| CORNERS[v as usize]) {
            text += &format!("   vertex {} {} {}\n", corner[0], corner[1], corner[2]);
            bytes.extend(corner[..3].iter().flat_map(|x| x.to_le_bytes()));
        }
        text += "  endloop\n endfacet\n";
        bytes.extend([0; 2]);
    }
    vec![(text + "endsolid shape\n").into(), bytes]
}

/// The JSON of a glTF scene with its buffer's `uri` key, and the buffer.
fn gltf_parts(uri: &str) -> (String, Vec<u8>) {
    let mut buffer = Vec::new();
    for columns in [0..3, 3..6, 6..8] {
        for corner in CORNERS {
            buffer.extend(corner[columns.clone()].iter().flat_map(|x| x.to_le_bytes()));
        }
    }
    buffer.extend(
        FACES
            .as_flattened()
            .iter()
            .flat_map(|&v| (v as u16).to_le_bytes()),
    );
    // A sparse accessor replaces vertex 1 by itself.
    buffer.extend([1, 0]);
    buffer.extend(CORNERS[1][..3].iter().flat_map(|x| x.to_le_bytes()));
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
"nodes":[{{"translation":[0,1,0],"rotation":[0,0,0,1],"children":[1]}},{{"scale":[-1,1,1],"mesh":0}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2}},"indices":3,"mode":4}}]}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3","min":[-1,-1,-1],"max":[1,1,1],
"sparse":{{"count":1,"indices":{{"bufferView":4,"componentType":5121}},"values":{{"bufferView":5}}}}}},
{{"bufferView":1,"componentType":5126,"count":4,"type":"VEC3"}},
{{"bufferView":2,"componentType":5126,"count":4,"type":"VEC2"}},
{{"bufferView":3,"componentType":5123,"count":12,"type":"SCALAR"}}],
"bufferViews":[{{"buffer":0,"byteLength":48,"byteStride":12}},{{"buffer":0,"byteOffset":48,"byteLength":48}},
{{"buffer":0,"byteOffset":96,"byteLength":32}},{{"buffer":0,"byteOffset":128,"byteLength":24}},
{{"buffer":0,"byteOffset":152,"byteLength":1}},{{"buffer":0,"byteOffset":154,"byteLength":12}}],
"buffers":[{{{uri}"byteLength":{}}}]}}"#,
        buffer.len()
    );
    (json, buffer)
}

/// The buffer that [`gltf`] expects beside it.
pub(crate) const BUFFER: &str = "buffer.bin";

/// The content of [`BUFFER`].
pub(crate) fn gltf_buffer() -> Vec<u8> {
    gltf_parts("").1
}

pub(crate) fn gltf() -> Vec<Vec<u8>> {
    let buffer = gltf_parts("").1;
    let beside = gltf_parts(&format!(r#""uri":"{BUFFER}","#)).0;
    let inside = gltf_parts(&format!(
        r#""uri":"data:application/octet-stream;base64,{}","#,
        base64(&buffer)
    ));
    vec![beside.into(), inside.0.into()]
}

fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for chunk in bytes.chunks(3) {
        let word =
            chunk.iter().fold(0u32, |w, &b| (w << 8) | u32::from(b)) << (8 * (3 - chunk.len()));
        for letter in 0..4 {
            let six = (word >> (18 - 6 * letter)) as usize & 63;
            text.push(if letter <= chunk.len() {
                LETTERS[six] as char
            } else {
                '='
            });
        }
    }
    text
}

pub(crate) fn glb() -> Vec<Vec<u8>> {
    let (mut json, buffer) = gltf_parts("");
    while json.len() % 4 != 0 {
        json.push(' ');
    }
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + json.len() as u32 + buffer.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json.as_bytes()), (b"BIN\0", &buffer)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    vec![bytes]
}

/// Radiance of texel `i`: small and large numbers.
fn radiance(i: usize) -> f32 {
    ((i * 7919) % 1009) as f32 / 64.0
}

/// One flat layer of the named channels, half or float.
fn exr_file(names: &[&str], compression: Compression, blocks: Blocks, half: bool) -> Vec<u8> {
    let (width, height) = (12, 7);
    let plane = |c: usize| (0..width * height).map(move |i| radiance(i + 31 * c));
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = names
        .iter()
        .enumerate()
        .map(|(c, name)| {
            let samples = if half {
                FlatSamples::F16(plane(c).map(f16::from_f32).collect())
            } else {
                FlatSamples::F32(plane(c).collect())
            };
            AnyChannel::new(*name, samples)
        })
        .collect();
    let encoding = Encoding {
        compression,
        blocks,
        line_order: LineOrder::Increasing,
    };
    let size = Vec2(width, height);
    let layer = Layer::new(
        size,
        LayerAttributes::default(),
        encoding,
        AnyChannels::sort(channels),
    );
    let mut file = Cursor::new(Vec::new());
    Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut file)
        .unwrap();
    file.into_inner()
}

pub(crate) fn exr() -> Vec<Vec<u8>> {
    use Compression::{B44, DWAA, PIZ, PXR24, RLE, Uncompressed, ZIP16};
    let rgb = ["B", "G", "R"];
    let (lines, tiles) = (Blocks::ScanLines, Blocks::Tiles(Vec2(8, 8)));
    vec![
        exr_file(&rgb, Uncompressed, lines, false),
        exr_file(&rgb, ZIP16, lines, false),
        exr_file(&rgb, RLE, tiles, true),
        exr_file(&["Y"], PIZ, lines, true),
        exr_file(&rgb, PXR24, lines, false),
        exr_file(&rgb, B44, lines, true),
        exr_file(&["A", "B", "G", "R"], DWAA(None), lines, true),
    ]
}

/// A small map of one value for every parameter.
pub(crate) fn parameter_map() -> Vec<Vec<u8>> {
    vec![
        exr_file(
            &["B", "G", "R"],
            Compression::Uncompressed,
            Blocks::ScanLines,
            false,
        ),
        exr_file(&["Y"], Compression::Uncompressed, Blocks::ScanLines, true),
    ]
}

fn picture() -> DynamicImage {
    let samples = (0..16 * 8 * 3).map(|i| radiance(i) / 16.0).collect();
    DynamicImage::ImageRgb32F(Rgb32FImage::from_raw(16, 8, samples).unwrap())
}

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    image.write_to(&mut file, format).unwrap();
    file.into_inner()
}

pub(crate) fn hdr() -> Vec<Vec<u8>> {
    let packed = encoded(&picture(), ImageFormat::Hdr);
    let mut flat = b"#?RGBE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1.0\n\n-Y 2 +X 3\n".to_vec();
    flat.extend([128, 64, 32, 129].repeat(6));
    vec![packed, flat]
}

pub(crate) fn png() -> Vec<Vec<u8>> {
    let image = picture();
    [
        image.to_luma8().into(),
        image.to_rgba16().into(),
        image.to_rgb8().into(),
        DynamicImage::from(image.to_luma_alpha8()),
    ]
    .iter()
    .map(|image: &DynamicImage| encoded(image, ImageFormat::Png))
    .collect()
}

pub(crate) fn photographs() -> Vec<Vec<u8>> {
    let image = picture();
    vec![
        encoded(&image.to_rgb8().into(), ImageFormat::Jpeg),
        encoded(&image.to_luma8().into(), ImageFormat::Jpeg),
        encoded(&image, ImageFormat::Tiff),
        encoded(&image.to_rgb16().into(), ImageFormat::Tiff),
    ]
}

/// Files that the texts below name, all empty but for the mesh.
pub(crate) const NAMED: [&str; 3] = ["mesh.ply", "probe.exr", "map.exr"];

const COMMON: &str = "[object]\nmesh = \"mesh.ply\"\nscale = 2.5\nrotation = [0.0, 30.0, 0.0]\n\
    translation = [1.0, 0.0, -1e3]\n[probe]\nimage = \"probe.exr\"\nrotation_deg = 90.0\n[camera]\nwidth = 16\n\
    height = 12\nposition = [0.0, 1.5, 9.0]\nlook_at = [0.0, 0.0, 0.0]\n";
const LENS: &str = "fx = 20.0\nfy = 20.5\ncx = 8.0\ncy = 6.0\ndistortion = [0.1, 0.01, 0.0, 0.0, 0.0]\n\
    up = [0.1, 1.0, 0.0]\n";
const SENSOR: &str = "[sensor]\nfull_well_electrons = 30000.0\nread_noise_electrons = 5.0\nbits = 14\nexposure = 0.5\n";

/// A scene of `material` lines; it names [`NAMED`].
pub(crate) fn scene_of(material: &str) -> String {
    format!("{COMMON}fov_x_deg = 40.0\n[material]\n{material}\n[turntable]\nframes = 2\n")
}

pub(crate) fn scene() -> Vec<Vec<u8>> {
    let dielectric = "ndf = \"ggx\"\nalpha = 0.2\nrho_d = [0.4, 0.3, 0.2]\nrho_s = 2.35\neta = 1.4";
    let schlick = "ndf = \"vertex:share\"\nalpha = \"map.exr\"\nrho_d = 0.5\nfresnel = \"schlick\"\nf0 = 0.04\nf90 = 1.0";
    let other = format!(
        "{COMMON}{LENS}[material]\n{schlick}\n[turntable]\naxis = [0.0, 2.0, 0.1]\ncenter = [0.1, 0.0, 0.0]\n\
         angles_deg = [0.0, 45.5, 90]\n{SENSOR}"
    );
    vec![scene_of(dielectric).into(), other.into()]
}

pub(crate) fn capture() -> Vec<Vec<u8>> {
    let frames = "[[frames]]\nimage = \"probe.exr\"\nangle_deg = 0.0\n[[frames]]\nimage = \"probe.exr\"\n\
        mask = \"map.exr\"\nangle_deg = 5.0\nexposure = 0.5\n";
    vec![
        format!("{COMMON}fov_x_deg = 40.0\n{frames}").into(),
        format!("{COMMON}{LENS}[turntable]\naxis = [0.0, -1.0, 0.0]\n{SENSOR}{frames}").into(),
    ]
}

/// Clicked pairs.
pub(crate) fn pairs() -> Vec<Vec<u8>> {
    let points = "[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0.5]]";
    let inline = "pairs = [{ point = [0.1, 0, 0], pixel = [3, 4.5] }]\n";
    let pixels = [
        [32.0, 24.0],
        [50.1, 24.0],
        [32.0, 7.9],
        [32.0, 26.0],
        [51.0, 8.2],
    ];
    let mut text = format!("# {points}\nframe = 1\n");
    for (i, [u, v]) in pixels.iter().enumerate() {
        let bit = |b: usize| u8::from(i == b || i == 4);
        text += &format!(
            "[[pairs]]\npoint = [{}, {}, {}.0]\npixel = [{u}, {v}]\n",
            bit(1),
            bit(2),
            u8::from(i == 3)
        );
    }
    vec![text.into(), inline.into()]
}

/// Estimates at the four vertices of the mesh.
pub(crate) fn points() -> Vec<Vec<u8>> {
    let table = PointTable {
        position: CORNERS.map(|c| [c[0], c[1], c[2]]).into(),
        normal: CORNERS.map(|c| [c[3], c[4], c[5]]).into(),
        rho_d: vec![[0.4, 0.3, 0.2]; 4],
        rho_s: vec![[2.0; 3]; 4],
        f90: vec![1.0; 4],
        eta: vec![1.3; 4],
        fresnel: vec![0; 4],
        alpha: vec![0.05, 0.1, 0.2, 0.4],
        ndf: vec![0, 1, 0, 1],
        sigma_rho_d: vec![[0.01; 3]; 4],
        sigma_rho_s: vec![0.1; 4],
        sigma_alpha: vec![0.01, 0.02, 0.03, f32::INFINITY],
        frames: vec![9; 4],
        residual: vec![0.01; 4],
        status: vec![0, 1, 2, 4],
        ndf_evidence: vec![3.0, -1.0, f32::NAN, 0.5],
        second_alpha: vec![f32::NAN, 0.4, 0.1, f32::NAN],
        second_evidence: vec![f32::NAN, -2.0, -7.0, f32::NAN],
        reason: vec![0, 2, 5, 0],
        material: vec![0, 1, -1, 0],
        borrowed: vec![0, 1, 0, 1],
        texel: vec![0, 1, 0, 1],
    };
    vec![written("points.npz", |path| table.write_npz(path).unwrap())]
}

/// `fit.toml`, whose capture has been moved away.
pub(crate) fn record() -> Vec<Vec<u8>> {
    vec![
        "turnlight = \"0.1.0\"\ncapture = \"gone\"\npoints = \"vertices\"\n[settings]\nestimator = \"full\"\n\
         [timings]\nload = 0.1\nfit = 2.5\n[traces]\npixels = 100\n[status]\nconverged = 3\n"
            .into(),
    ]
}

/// Rows of a camera's pose on a circle about +Z, world from camera: right, up, backward, and place.
fn pose_rows(angle: f64) -> [[f64; 4]; 3] {
    let (s, c) = angle.sin_cos();
    [
        [-s, 0.0, c, 4.0 * c],
        [c, 0.0, s, 4.0 * s],
        [0.0, 1.0, 0.0, 0.5],
    ]
}

pub(crate) fn transforms() -> Vec<u8> {
    let frame = |i: u32| {
        let [a, b, c] = pose_rows(0.7 * f64::from(i));
        let matrix = [a, b, c, [0.0, 0.0, 0.0, 1.0]];
        serde_json::json!({ "file_path": format!("./images/{i}.png"), "transform_matrix": matrix })
    };
    let frames: Vec<_> = (0..5).map(frame).collect();
    let value = serde_json::json!({
        "camera_model": "OPENCV", "w": 640, "h": 480, "fl_x": 500.5, "fl_y": 501.0, "cx": 320.0, "cy": 240.5,
        "k1": -0.1, "k2": 0.01, "p1": 1e-4, "p2": -1e-4, "k3": 0.0, "k4": 0.0, "frames": frames,
    });
    serde_json::to_vec_pretty(&value).unwrap()
}

pub(crate) fn opencv_json() -> Vec<u8> {
    let matrix = |rows: u32, columns: u32, numbers: &[f64]| serde_json::json!({"type_id": "opencv-matrix", "rows": rows, "cols": columns, "dt": "d", "data": numbers});
    let value = serde_json::json!({
        "image_width": 640, "image_height": 480,
        "camera_matrix": matrix(3, 3, &[500.5, 0.0, 319.5, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0]),
        "distortion_coefficients": matrix(5, 1, &[-0.1, 0.01, 1e-4, -1e-4, 0.0]),
    });
    serde_json::to_vec_pretty(&value).unwrap()
}

pub(crate) fn opencv_yaml() -> Vec<u8> {
    b"%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   \
      dt: d\n   data: [ 500.5, 0., 319.5, 0.,\n       501., 240., 0., 0., 1. ]\ndistortion_model: plumb_bob\n\
      distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   \
      data: [ -0.1, 0.01, 1.0e-04, -1.0e-04, 0. ]\n"
        .to_vec()
}

pub(crate) fn opencv_xml() -> Vec<u8> {
    b"<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_width>640</image_width>\n<image_height>480</image_height>\n\
      <camera_matrix type_id=\"opencv-matrix\">\n  <rows>3</rows>\n  <cols>3</cols>\n  <dt>d</dt>\n  <data>\n    \
      500.5 0. 319.5 0. 501. 240. 0. 0. 1.</data></camera_matrix>\n<distortion_coefficients type_id=\"opencv-matrix\">\
      <rows>4</rows><cols>1</cols><dt>d</dt><data>\n -0.1 0.01 1e-4 -1e-4</data></distortion_coefficients>\n\
      </opencv_storage>\n"
        .to_vec()
}

/// COLMAP's quaternion (w, x, y, z) and translation of a camera turned about +Y, four units away.
fn colmap_pose(i: u32) -> [f64; 7] {
    let (s, c) = (0.25 * f64::from(i)).sin_cos();
    [c, 0.0, s, 0.0, 0.0, 0.2, 4.0]
}

/// `cameras.txt` and `images.txt`.
pub(crate) fn colmap_text() -> [Vec<u8>; 2] {
    let cameras = "# Camera list\n1 OPENCV 640 480 500.5 501 320 240.5 -0.1 0.01 1e-4 -1e-4\n";
    let mut images = "# Image list\n".to_owned();
    for i in 0..5 {
        let pose = colmap_pose(i).map(|x| format!("{x:?}")).join(" ");
        images += &format!("{} {pose} 1 {i:02}.jpg\n1.5 2.5 -1 3.0 4.0 7\n", i + 1);
    }
    [cameras.into(), images.into()]
}

/// `cameras.bin` and `images.bin`.
pub(crate) fn colmap_binary() -> [Vec<u8>; 2] {
    let mut cameras = 1u64.to_le_bytes().to_vec();
    cameras.extend([1u32, 4].map(u32::to_le_bytes).as_flattened());
    cameras.extend([640u64, 480].map(u64::to_le_bytes).as_flattened());
    let lens = [500.5f64, 501.0, 320.0, 240.5, -0.1, 0.01, 1e-4, -1e-4];
    cameras.extend(lens.map(f64::to_le_bytes).as_flattened());
    let mut images = 5u64.to_le_bytes().to_vec();
    for i in 0..5u32 {
        images.extend((i + 1).to_le_bytes());
        images.extend(colmap_pose(i).map(f64::to_le_bytes).as_flattened());
        images.extend(1u32.to_le_bytes());
        images.extend(format!("{i:02}.jpg\0").as_bytes());
        images.extend(1u64.to_le_bytes());
        images.extend([1.5f64, 2.5].map(f64::to_le_bytes).as_flattened());
        images.extend(u64::MAX.to_le_bytes());
    }
    [cameras, images]
}

/// Four views of a board of 4 × 3 corners through a pinhole.
pub(crate) fn corners() -> Vec<u8> {
    let view = |i: u32| {
        let (s, c) = (0.3 + 0.2 * f64::from(i)).sin_cos();
        let corner = |j: u32| {
            let (u, v) = (f64::from(j % 4), f64::from(j / 4));
            // Tilted about x in one half of the views and about y in the other.
            let (x, y, z) = if i.is_multiple_of(2) {
                (u - 1.5, (v - 1.0) * c, 6.0 + (v - 1.0) * s)
            } else {
                ((u - 1.5) * c, v - 1.0, 6.0 + (u - 1.5) * s)
            };
            [u, v, 320.0 + 500.0 * x / z, 240.0 + 500.0 * y / z]
        };
        let corners: Vec<[f64; 4]> = (0..12).map(corner).collect();
        serde_json::json!({ "name": format!("{i}.png"), "corners": corners })
    };
    let photographs: Vec<_> = (0..4).map(view).collect();
    let value = serde_json::json!({
        "width": 640, "height": 480, "first_pixel_centre": 0.5, "photographs": photographs,
    });
    serde_json::to_vec(&value).unwrap()
}
