//! Whether a JPEG file holds its whole picture.
//!
//! Its decoder fills what is missing with grey and says nothing: half of an exposure, merged with whole ones, moved their
//! exposures by a half and came out as radiance.

use super::Fault;

const START_OF_IMAGE: u8 = 0xd8;
const END_OF_IMAGE: u8 = 0xd9;

/// Refuses a file that ends before its picture does. Files of other kinds pass.
pub(super) fn check_whole(file: &[u8]) -> Result<(), Fault> {
    let is_jpeg = file.starts_with(&[0xff, START_OF_IMAGE]);
    if !is_jpeg || has_end(&file[2..]) {
        return Ok(());
    }
    Err(Fault::damaged("ends before its picture does"))
}

/// Walks from marker to marker. Blocks are passed by their lengths, since a thumbnail within has an end of its own;
/// samples, which have no length, up to the next marker: in them `ff` is followed by 0, or by a restart's number.
fn has_end(mut rest: &[u8]) -> bool {
    loop {
        // What is no marker is padding, or samples after the header of a scan.
        let Some(at) = rest.iter().position(|&byte| byte == 0xff) else {
            return false;
        };
        rest = &rest[at..];
        let Some(fill) = rest.iter().position(|&byte| byte != 0xff) else {
            return false;
        };
        let marker = rest[fill];
        rest = &rest[fill + 1..];
        match marker {
            END_OF_IMAGE => return true,
            // Stuffed samples, and markers that stand alone.
            0x00 | 0x01 | 0xd0..=START_OF_IMAGE => {}
            _ => {
                let [high, low, ..] = *rest else {
                    return false;
                };
                let length = usize::from(u16::from_be_bytes([high, low])).max(2);
                let Some(after) = rest.get(length..) else {
                    return false;
                };
                rest = after;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use ::image::{DynamicImage, ImageFormat, Rgb, RgbImage};
    use proptest::prelude::*;

    use super::*;

    fn jpeg(seed: u32) -> Vec<u8> {
        let noise = |x: u32, y: u32| (x * 31 + y * 57 + seed).wrapping_mul(2_654_435_761);
        let image = RgbImage::from_fn(21, 13, |x, y| {
            let [r, g, b, _] = noise(x, y).to_le_bytes();
            Rgb([r, g, b])
        });
        let mut file = Cursor::new(Vec::new());
        DynamicImage::from(image)
            .write_to(&mut file, ImageFormat::Jpeg)
            .unwrap();
        file.into_inner()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn only_whole_files_are_whole(seed in any::<u32>()) {
            let file = jpeg(seed >> 8);
            prop_assert!(check_whole(&file).is_ok());
            for length in 2..file.len() {
                prop_assert!(check_whole(&file[..length]).is_err(), "{length} of {}", file.len());
            }
        }
    }

    #[test]
    fn the_end_of_a_thumbnail_is_not_the_picture_s() {
        let (file, thumbnail) = (jpeg(1), jpeg(2));
        let length = u16::try_from(thumbnail.len() + 2).unwrap();
        let mut with = vec![0xff, 0xd8, 0xff, 0xe1];
        with.extend(length.to_be_bytes());
        with.extend(&thumbnail);
        with.extend(&file[2..]);
        assert!(check_whole(&with).is_ok());
        assert!(check_whole(&with[..with.len() - 2]).is_err());
        // Cameras append previews and padding.
        with.extend([0; 40]);
        assert!(check_whole(&with).is_ok());
    }

    #[test]
    fn other_kinds_pass() {
        assert!(check_whole(b"").is_ok() && check_whole(b"\x89PNG").is_ok());
    }
}
