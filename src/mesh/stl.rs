//! STL: triangles that share nothing, as text (`solid` … `endsolid`) or binary (84 + 50 n bytes).
//!
//! Corners at exactly the same position are welded; the facet normals, which writers often leave
//! zero, are ignored in favour of the winding, and the mesh is shaded flat.

use std::collections::HashMap;

use glam::DVec3;

use super::Surface;
use super::error::Fault;

const HEADER_BYTES: usize = 84;
const FACET_BYTES: usize = 50;

/// Reads an STL file of either kind.
pub(super) fn read(bytes: &[u8]) -> Result<Surface, Fault> {
    let counted = bytes.get(80..HEADER_BYTES).map(|count| {
        let count = u32::from_le_bytes([count[0], count[1], count[2], count[3]]) as usize;
        (
            count,
            HEADER_BYTES.saturating_add(count.saturating_mul(FACET_BYTES)),
        )
    });
    // Some binary files begin with the word `solid` too; only they have the length they announce.
    let is_text = bytes.trim_ascii_start().starts_with(b"solid")
        && counted.is_none_or(|(_, length)| length != bytes.len());
    let corners = match counted {
        _ if is_text => text_corners(bytes)?,
        Some((count, length)) if length <= bytes.len() => {
            binary_corners(&bytes[HEADER_BYTES..], count)
        }
        Some((count, length)) => {
            return Err(Fault::new(
                "header",
                format!(
                    "{count} triangles need {length} bytes, but the file has {}; \
                     it is truncated or not an STL",
                    bytes.len()
                ),
            ));
        }
        None => {
            return Err(Fault::new(
                "header",
                format!(
                    "{} bytes are too few; the file is truncated or not an STL",
                    bytes.len()
                ),
            ));
        }
    };
    Ok(weld(&corners))
}

fn binary_corners(facets: &[u8], count: usize) -> Vec<[DVec3; 3]> {
    let number = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let corner = |b: &[u8]| DVec3::new(number(&b[0..]), number(&b[4..]), number(&b[8..]));
    facets
        .chunks_exact(FACET_BYTES)
        .take(count)
        .map(|facet| {
            [
                corner(&facet[12..]),
                corner(&facet[24..]),
                corner(&facet[36..]),
            ]
        })
        .collect()
}

fn text_corners(bytes: &[u8]) -> Result<Vec<[DVec3; 3]>, Fault> {
    let mut triangles = Vec::new();
    let mut loop_corners: Vec<DVec3> = Vec::new();
    let mut open = false;
    for (number, line) in (1..).zip(bytes.split(|&byte| byte == b'\n')) {
        let line = String::from_utf8_lossy(line).to_ascii_lowercase();
        let mut words = line.split_ascii_whitespace();
        let fault = |problem: String| Fault::new(format!("line {number}"), problem);
        match words.next() {
            Some("solid") => open = true,
            Some("endsolid") => open = false,
            Some("outer") => loop_corners.clear(),
            Some("vertex") => {
                let numbers: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
                let [x, y, z] = numbers[..] else {
                    return Err(fault(format!("`{}`: expected `vertex x y z`", line.trim())));
                };
                loop_corners.push(DVec3::new(x, y, z));
            }
            Some("endloop") => {
                let [a, b, c] = loop_corners[..] else {
                    let count = loop_corners.len();
                    return Err(fault(format!("a facet of {count} corners; STL has three")));
                };
                triangles.push([a, b, c]);
            }
            _ => {}
        }
    }
    if open {
        return Err(Fault::new(
            "end of file",
            "`endsolid` is missing; the file is truncated",
        ));
    }
    Ok(triangles)
}

fn weld(triangles: &[[DVec3; 3]]) -> Surface {
    let mut surface = Surface {
        flat: true,
        ..Surface::default()
    };
    let mut vertex_at = HashMap::new();
    for corners in triangles {
        let triangle = corners.map(|corner| {
            // Adding zero makes −0 equal to 0.
            let bits = (corner + DVec3::ZERO).to_array().map(f64::to_bits);
            *vertex_at.entry(bits).or_insert_with(|| {
                surface.positions.push(corner);
                surface.positions.len() as u32 - 1
            })
        });
        surface.triangles.push(triangle);
    }
    surface
}
