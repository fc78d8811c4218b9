//! Wavefront OBJ: `v`, `vt`, `vn` and `f` lines; everything else (materials, groups, curves) is
//! passed over.
//!
//! A face's corner names a position, a texture coordinate and a normal separately. Each triple that
//! occurs becomes one vertex, so that seams and creases stay split.

use std::borrow::Cow;
use std::collections::HashMap;

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::Surface;
use super::error::Fault;

/// Indices into the lists of `v`, `vt` and `vn` lines.
type Corner = (u32, Option<u32>, Option<u32>);

#[derive(Default)]
struct Lists {
    positions: Vec<DVec3>,
    /// Colours that follow positions, a common extension.
    colors: Vec<Option<Vec3>>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
}

/// Reads an OBJ file.
pub(super) fn read(bytes: &[u8]) -> Result<Surface, Fault> {
    let mut lists = Lists::default();
    let mut vertex_of: HashMap<Corner, u32> = HashMap::new();
    let mut corners: Vec<Corner> = Vec::new();
    let mut face = Vec::new();
    let mut surface = Surface::default();
    for (number, line) in logical_lines(bytes) {
        let mut words = line.split_ascii_whitespace();
        let fault = |problem: String| Fault::new(format!("line {number}"), problem);
        match words.next() {
            Some("v") => {
                let numbers = numbers(words, 3).map_err(fault)?;
                lists.positions.push(DVec3::from_slice(&numbers));
                lists
                    .colors
                    .push(numbers.get(3..6).map(|c| DVec3::from_slice(c).as_vec3()));
            }
            Some("vt") => {
                // One number is a 1-D texture. OBJ's v points up, a mesh's down.
                let numbers = numbers(words, 1).map_err(fault)?;
                let up = numbers.get(1).copied().unwrap_or(0.0);
                lists.uvs.push(DVec2::new(numbers[0], 1.0 - up).as_vec2());
            }
            Some("vn") => {
                let numbers = numbers(words, 3).map_err(fault)?;
                lists.normals.push(DVec3::from_slice(&numbers).as_vec3());
            }
            Some("f") => {
                face.clear();
                for word in words {
                    let corner = lists.corner(word).map_err(fault)?;
                    let vertex = *vertex_of.entry(corner).or_insert(corners.len() as u32);
                    if vertex as usize == corners.len() {
                        corners.push(corner);
                    }
                    face.push(vertex);
                }
                surface.add_face(&face);
            }
            _ => {}
        }
    }
    if lists.positions.is_empty() {
        return Err(Fault::new(
            "file",
            "has no `v` line; it is empty, truncated or not an OBJ",
        ));
    }
    lists.fill(&mut surface, &corners);
    Ok(surface)
}

/// Lines with their numbers from 1; a backslash at the end joins the next line on.
fn logical_lines(bytes: &[u8]) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut physical = bytes.split(|&byte| byte == b'\n').enumerate();
    std::iter::from_fn(move || {
        let (index, line) = physical.next()?;
        let mut line = String::from_utf8_lossy(line.trim_ascii_end());
        while let Some(joined) = line.strip_suffix('\\') {
            let mut joined = joined.to_owned();
            joined.push(' ');
            if let Some((_, next)) = physical.next() {
                joined.push_str(&String::from_utf8_lossy(next.trim_ascii_end()));
            }
            line = Cow::Owned(joined);
        }
        Some((index + 1, line))
    })
}

/// The numbers up to a comment, of which `least` must be there.
fn numbers<'a>(words: impl Iterator<Item = &'a str>, least: usize) -> Result<Vec<f64>, String> {
    let numbers = words
        .take_while(|word| !word.starts_with('#'))
        .map(|word| {
            word.parse::<f64>()
                .map_err(|_| format!("`{word}` is not a number"))
        })
        .collect::<Result<Vec<_>, _>>()?;
    if numbers.len() < least {
        return Err(format!(
            "{} numbers where at least {least} are needed; the line may be truncated",
            numbers.len()
        ));
    }
    Ok(numbers)
}

impl Lists {
    /// Reads `7`, `7/3`, `7//2` or `7/3/2`; negative numbers count back from the newest line.
    fn corner(&self, word: &str) -> Result<Corner, String> {
        let mut parts = word.split('/');
        let mut part = |kind: &str, length: usize| {
            let text = parts.next().unwrap_or("");
            if text.is_empty() {
                return Ok(None);
            }
            let named: i64 = text
                .parse()
                .map_err(|_| format!("face corner `{word}` is not a number"))?;
            let index = if named > 0 {
                named - 1
            } else {
                named.saturating_add(length as i64)
            };
            if named == 0 || index < 0 || index >= length as i64 {
                return Err(format!(
                    "face corner `{word}`: {kind} index {named}: there are {length} `{kind}` lines \
                     so far, numbered from 1; export the mesh again, it is inconsistent"
                ));
            }
            u32::try_from(index)
                .map(Some)
                .map_err(|_| format!("index {named} is too large"))
        };
        let position = part("v", self.positions.len())?
            .ok_or_else(|| format!("face corner `{word}` names no position"))?;
        Ok((
            position,
            part("vt", self.uvs.len())?,
            part("vn", self.normals.len())?,
        ))
    }

    /// Gathers the corners' values.
    fn fill(&self, surface: &mut Surface, corners: &[Corner]) {
        surface.positions = corners
            .iter()
            .map(|c| self.positions[c.0 as usize])
            .collect();
        if corners.iter().any(|corner| corner.1.is_some()) {
            let uv = |c: &Corner| c.1.map_or(Vec2::NAN, |i| self.uvs[i as usize]);
            surface.uvs = Some(corners.iter().map(uv).collect());
        }
        if corners.iter().any(|corner| corner.2.is_some()) {
            let normal = |c: &Corner| c.2.map_or(Vec3::ZERO, |i| self.normals[i as usize]);
            surface.normals = Some(corners.iter().map(normal).collect());
        }
        let colors: Option<Vec<Vec3>> = corners
            .iter()
            .map(|corner| self.colors[corner.0 as usize])
            .collect();
        if let Some(colors) = colors.filter(|colors| !colors.is_empty()) {
            for (channel, name) in ["red", "green", "blue"].into_iter().enumerate() {
                let values = colors.iter().map(|color| color[channel]).collect();
                surface.attributes.insert(name.to_owned(), values);
            }
        }
    }
}
