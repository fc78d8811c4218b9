//! Small photographs with EXIF, and a raw file, written by hand.

#![allow(dead_code, reason = "no test needs them all")]

/// A directory of TIFF, little-endian, at offset 8: entries `(tag, kind, values as bytes)` in the order of their
/// tags; what is longer than four bytes follows, then `rest`, whose offset fills the entry of tag `points`.
fn tiff(entries: &[(u16, u16, Vec<u8>)], points: u16, rest: &[u8]) -> Vec<u8> {
    let size = |kind: u16| [0, 1, 1, 2, 4, 8][usize::from(kind)];
    let mut file = b"II*\0\x08\0\0\0".to_vec();
    file.extend((entries.len() as u16).to_le_bytes());
    let mut after = 8 + 2 + 12 * entries.len() + 4;
    let mut following: Vec<u8> = Vec::new();
    let end = after
        + entries
            .iter()
            .map(|e| if e.2.len() > 4 { e.2.len() } else { 0 })
            .sum::<usize>();
    for (tag, kind, value) in entries {
        file.extend(tag.to_le_bytes());
        file.extend(kind.to_le_bytes());
        file.extend(((value.len() / size(*kind)) as u32).to_le_bytes());
        if *tag == points {
            file.extend((end as u32).to_le_bytes());
        } else if value.len() > 4 {
            file.extend((after as u32).to_le_bytes());
            after += value.len();
            following.extend(value);
        } else {
            file.extend(value);
            file.extend(vec![0; 4 - value.len()]);
        }
    }
    file.extend([0; 4]);
    file.extend(following);
    file.extend(rest);
    file
}

fn short(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn long(value: u32) -> Vec<u8> {
    value.to_le_bytes().to_vec()
}

/// A JPEG with an EXIF block that claims an exposure of `seconds` (a fraction), f/4 and ISO 200.
pub(crate) fn with_exif(jpeg: &[u8], seconds: (u32, u32)) -> Vec<u8> {
    let rational = |a: u32, b: u32| [long(a), long(b)].concat();
    // The EXIF directory follows the first; its offsets are relative to the whole.
    let first = 8 + 2 + 12 + 4;
    let mut inner = Vec::new();
    inner.extend(3u16.to_le_bytes());
    let values = first + 2 + 3 * 12 + 4;
    for (tag, kind, value) in [
        (0x829au16, 5u16, values as u32),
        (0x829d, 5, values as u32 + 8),
        (0x8827, 3, 200),
    ] {
        inner.extend(tag.to_le_bytes());
        inner.extend(kind.to_le_bytes());
        inner.extend(1u32.to_le_bytes());
        inner.extend(value.to_le_bytes());
    }
    inner.extend([0; 4]);
    inner.extend(rational(seconds.0, seconds.1));
    inner.extend(rational(4, 1));
    with_block(jpeg, &tiff(&[(0x8769, 4, long(0))], 0x8769, &inner))
}

/// A JPEG whose EXIF says how the camera was held, 1 to 8.
pub(crate) fn jpeg_held(jpeg: &[u8], number: u16) -> Vec<u8> {
    with_block(jpeg, &tiff(&[(ORIENTATION, 3, short(&[number]))], 0, &[]))
}

/// EXIF's tag of how the camera was held.
const ORIENTATION: u16 = 274;

fn with_block(jpeg: &[u8], block: &[u8]) -> Vec<u8> {
    let mut file = vec![0xff, 0xd8, 0xff, 0xe1];
    file.extend(((2 + 6 + block.len()) as u16).to_be_bytes());
    file.extend(b"Exif\0\0");
    file.extend(block);
    file.extend(&jpeg[2..]);
    file
}

/// A TIFF of 8 bits that says how the camera was held, 1 to 8.
pub(crate) fn tiff_of(image: &image::RgbImage, number: u16) -> Vec<u8> {
    let (width, height) = (image.width() as u16, image.height() as u16);
    let bytes = image.as_raw();
    let entries = [
        (256, 3, short(&[width])),
        (257, 3, short(&[height])),
        (258, 3, short(&[8, 8, 8])),
        (259, 3, short(&[1])),
        (262, 3, short(&[2])),
        (273, 4, long(0)),
        (ORIENTATION, 3, short(&[number])),
        (277, 3, short(&[3])),
        (278, 3, short(&[height])),
        (279, 4, long(bytes.len() as u32)),
    ];
    tiff(&entries, 273, bytes)
}

/// A DNG of 16 bits, RGGB, black 1000, white 17000, whose mosaic is `value(column, row)`.
pub(crate) fn dng(width: u16, height: u16, value: impl Fn(u16, u16) -> u16) -> Vec<u8> {
    dng_held(width, height, 1, value)
}

/// The same, of a camera held as EXIF's `number` says.
pub(crate) fn dng_held(
    width: u16,
    height: u16,
    number: u16,
    value: impl Fn(u16, u16) -> u16,
) -> Vec<u8> {
    let mosaic: Vec<u16> = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| value(x, y))
        .collect();
    let bytes = short(&mosaic);
    let entries = [
        (254, 4, long(0)),
        (256, 3, short(&[width])),
        (257, 3, short(&[height])),
        (258, 3, short(&[16])),
        (259, 3, short(&[1])),
        (262, 3, short(&[32803])),
        (271, 2, b"Test\0".to_vec()),
        (272, 2, b"Camera\0".to_vec()),
        (273, 4, long(0)),
        (ORIENTATION, 3, short(&[number])),
        (277, 3, short(&[1])),
        (278, 3, short(&[height])),
        (279, 4, long(bytes.len() as u32)),
        (33421, 3, short(&[2, 2])),
        (33422, 1, vec![0, 1, 1, 2]),
        (50706, 1, vec![1, 4, 0, 0]),
        (50708, 2, b"Test Camera\0".to_vec()),
        (50714, 3, short(&[1000])),
        (50717, 3, short(&[17000])),
    ];
    tiff(&entries, 273, &bytes)
}
