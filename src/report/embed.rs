//! Images inside the page, as data URIs.

use std::io;

use crate::image::{RgbImage, ToneCurve, encode_png, encode_png_bytes};

/// A radiance image after a tone curve.
pub(super) fn radiance(image: &RgbImage, curve: ToneCurve) -> io::Result<String> {
    Ok(data_uri(&encode_png(image, curve)?))
}

/// An image of display values.
pub(super) fn display(width: usize, height: usize, pixels: &[[u8; 3]]) -> io::Result<String> {
    Ok(data_uri(&encode_png_bytes(width, height, pixels)?))
}

/// A PNG as it stands.
pub(super) fn data_uri(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", base64(png))
}

/// RFC 4648, with padding.
fn base64(bytes: &[u8]) -> String {
    const ALPHABET: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let byte = |i: usize| u32::from(chunk.get(i).copied().unwrap_or(0));
        let group = byte(0) << 16 | byte(1) << 8 | byte(2);
        for place in 0..4 {
            if place > chunk.len() {
                text.push('=');
            } else {
                let letter = ALPHABET[(group >> (18 - 6 * place)) as usize & 63];
                text.push(char::from(letter));
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::base64;

    #[test]
    fn base64_gives_the_vectors_of_its_rfc() {
        for (plain, coded) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }
}
