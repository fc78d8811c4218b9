//! PLY (Turk 1994): a text header that declares elements and their properties, then their values as
//! text or binary.
//!
//! Read here rather than by a crate for three reasons: NaN in text files has to arrive to be
//! reported, a header's counts have to be held against the file's length before anything is
//! allocated, and a million vertices should not each become a table of named values.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3, Vec3};

use super::Surface;
use super::error::Fault;

const TRUNCATED: &str = "the file ends here; it is truncated, copy or export it again";

/// Names of texture coordinates, in the pairs that exporters use.
pub(super) const UV_NAMES: [[&str; 2]; 3] = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]];

/// Names whose integer values are colours: 0..255 is stored as 0..1.
const COLOR_NAMES: [&str; 4] = ["red", "green", "blue", "alpha"];

#[derive(Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

struct Property {
    name: String,
    /// The type of a list's length; none for a single value.
    length: Option<Scalar>,
    value: Scalar,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
    /// Where the values start.
    body: usize,
}

/// Reads a PLY file's `vertex` and `face` elements.
pub(super) fn read(bytes: &[u8]) -> Result<Surface, Fault> {
    let header = read_header(bytes)?;
    let vertices = header
        .elements
        .iter()
        .find(|e| e.name == "vertex")
        .map_or(0, |e| e.count);
    let mut values = Values {
        encoding: header.encoding,
        rest: &bytes[header.body..],
    };
    let mut surface = Surface::default();
    let (mut seen_vertices, mut seen_faces) = (false, false);
    for element in &header.elements {
        values.check_room_for(element)?;
        match element.name.as_str() {
            "vertex" => {
                read_vertices(&mut values, element, &mut surface)?;
                seen_vertices = true;
            }
            "face" => {
                read_faces(&mut values, element, vertices, &mut surface)?;
                seen_faces = true;
            }
            _ => skip(&mut values, element)?,
        }
        if seen_vertices && seen_faces {
            return Ok(surface);
        }
    }
    let (missing, remedy) = if seen_vertices {
        (
            "face",
            "a point cloud or strips; mesh it, and export triangles",
        )
    } else {
        ("vertex", "not a mesh; export it again")
    };
    Err(Fault::new(
        "header",
        format!("element {missing} is missing: {remedy}"),
    ))
}

fn read_header(bytes: &[u8]) -> Result<Header, Fault> {
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    let mut body = 0;
    for number in 1.. {
        let rest = &bytes[body..];
        let Some(end) = rest.iter().position(|&byte| byte == b'\n') else {
            return Err(Fault::new(
                format!("header line {number}"),
                format!("no `end_header`: {TRUNCATED}"),
            ));
        };
        body += end + 1;
        let line = String::from_utf8_lossy(&rest[..end]);
        let words: Vec<&str> = line.split_whitespace().collect();
        let fault = |problem: &str| {
            let shown: String = line.trim().chars().take(60).collect();
            Err(Fault::new(
                format!("header line {number}"),
                format!("`{shown}`: {problem}"),
            ))
        };
        match (number, words.as_slice()) {
            (1, ["ply"]) => {}
            (1, _) => return fault("expected `ply`; this is not a PLY file"),
            (_, ["format", name, _]) => {
                encoding = match *name {
                    "ascii" => Some(Encoding::Ascii),
                    "binary_little_endian" => Some(Encoding::LittleEndian),
                    "binary_big_endian" => Some(Encoding::BigEndian),
                    _ => return fault("expected ascii, binary_little_endian or binary_big_endian"),
                }
            }
            (_, []) | (_, ["comment" | "obj_info", ..]) => {}
            (_, ["element", name, count]) => {
                let Ok(count) = count.parse() else {
                    return fault("the count must be a whole number");
                };
                if elements.iter().any(|e| e.name == *name) {
                    return fault("this element is declared twice");
                }
                let name = (*name).to_owned();
                elements.push(Element {
                    name,
                    count,
                    properties: Vec::new(),
                });
            }
            (_, ["property", kind @ .., name]) => {
                let Some(element) = elements.last_mut() else {
                    return fault("a property needs an element before it");
                };
                let (length, value) = match kind {
                    [value] => (None, Scalar::named(value)),
                    ["list", length, value] => match Scalar::named(length) {
                        Some(length) => (Some(length), Scalar::named(value)),
                        None => (None, None),
                    },
                    _ => (None, None),
                };
                let Some(value) = value else {
                    return fault("unknown type; expected e.g. `float x` or `list uchar int name`");
                };
                if element.properties.iter().any(|p| p.name == *name) {
                    return fault("this property is declared twice");
                }
                element.properties.push(Property {
                    name: (*name).to_owned(),
                    length,
                    value,
                });
            }
            (_, ["end_header"]) => break,
            _ => return fault("not a PLY header line"),
        }
    }
    let encoding = encoding.ok_or_else(|| Fault::new("header", "the `format` line is missing"))?;
    Ok(Header {
        encoding,
        elements,
        body,
    })
}

/// The values after the header, taken one by one.
struct Values<'a> {
    encoding: Encoding,
    rest: &'a [u8],
}

impl Values<'_> {
    /// Refuses counts that the rest of the file cannot hold.
    fn check_room_for(&self, element: &Element) -> Result<(), Fault> {
        let smallest = element
            .properties
            .iter()
            .map(|p| match self.encoding {
                Encoding::Ascii => 2, // one digit, one separator
                _ => p.length.unwrap_or(p.value).bytes(),
            })
            .sum::<usize>();
        // The last separator of a text file may be missing.
        if element.count.saturating_mul(smallest) > self.rest.len().saturating_add(1) {
            let Element { name, count, .. } = element;
            let rest = self.rest.len();
            return Err(Fault::new(
                format!("element {name}"),
                format!("count {count} does not fit into the {rest} bytes left: {TRUNCATED}"),
            ));
        }
        Ok(())
    }

    /// The next value; none at the end of the file or where a word is not a number.
    fn next(&mut self, scalar: Scalar) -> Option<f64> {
        match self.encoding {
            Encoding::Ascii => {
                let start = self
                    .rest
                    .iter()
                    .position(|byte| !byte.is_ascii_whitespace())?;
                let word = &self.rest[start..];
                let end = word
                    .iter()
                    .position(u8::is_ascii_whitespace)
                    .unwrap_or(word.len());
                self.rest = &word[end..];
                std::str::from_utf8(&word[..end]).ok()?.parse().ok()
            }
            Encoding::LittleEndian => self.next_binary(scalar, false),
            Encoding::BigEndian => self.next_binary(scalar, true),
        }
    }

    fn next_binary(&mut self, scalar: Scalar, big_endian: bool) -> Option<f64> {
        let (head, rest) = self.rest.split_at_checked(scalar.bytes())?;
        self.rest = rest;
        let mut word = [0u8; 8];
        word[..head.len()].copy_from_slice(head);
        if big_endian {
            word[..head.len()].reverse();
        }
        let bits = u64::from_le_bytes(word);
        Some(match scalar {
            Scalar::I8 => f64::from(bits as i8),
            Scalar::U8 => f64::from(bits as u8),
            Scalar::I16 => f64::from(bits as i16),
            Scalar::U16 => f64::from(bits as u16),
            Scalar::I32 => f64::from(bits as i32),
            Scalar::U32 => f64::from(bits as u32),
            Scalar::F32 => f64::from(f32::from_bits(bits as u32)),
            Scalar::F64 => f64::from_bits(bits),
        })
    }

    fn next_of(
        &mut self,
        element: &Element,
        row: usize,
        name: &str,
        s: Scalar,
    ) -> Result<f64, Fault> {
        self.next(s).ok_or_else(|| {
            let problem = if self.rest.is_empty() {
                TRUNCATED
            } else {
                "not a number"
            };
            Fault::new(format!("{} {row}: {name}", element.name), problem)
        })
    }

    /// The next list's length.
    fn next_length(&mut self, element: &Element, row: usize, p: &Property) -> Result<usize, Fault> {
        let Some(scalar) = p.length else { return Ok(1) };
        let length = self.next_of(element, row, &p.name, scalar)?;
        if length >= 0.0 && length.fract() == 0.0 && length <= self.rest.len() as f64 {
            return Ok(length as usize);
        }
        Err(Fault::new(
            format!("{} {row}: {}", element.name, p.name),
            format!("list of {length} values: {TRUNCATED}"),
        ))
    }
}

fn skip(values: &mut Values<'_>, element: &Element) -> Result<(), Fault> {
    if element.properties.is_empty() {
        return Ok(());
    }
    for row in 0..element.count {
        for property in &element.properties {
            for _ in 0..values.next_length(element, row, property)? {
                values.next_of(element, row, &property.name, property.value)?;
            }
        }
    }
    Ok(())
}

/// The single-valued properties of an element, by name.
type Columns = BTreeMap<String, (Scalar, Vec<f64>)>;

/// Removes the named columns, if all of them are there.
fn take<const N: usize>(columns: &mut Columns, names: [&str; N]) -> Option<[Vec<f64>; N]> {
    let complete = names.iter().all(|name| columns.contains_key(*name));
    let column = |name| {
        columns
            .remove(name)
            .map(|(_, column)| column)
            .unwrap_or_default()
    };
    complete.then(|| names.map(column))
}

fn read_vertices(
    values: &mut Values<'_>,
    element: &Element,
    surface: &mut Surface,
) -> Result<(), Fault> {
    // One column a property; lists at vertices are read past.
    let mut columns: Vec<Vec<f64>> = element
        .properties
        .iter()
        .map(|p| Vec::with_capacity(if p.length.is_none() { element.count } else { 0 }))
        .collect();
    for row in 0..element.count {
        if element.properties.is_empty() {
            break;
        }
        for (property, column) in element.properties.iter().zip(&mut columns) {
            for _ in 0..values.next_length(element, row, property)? {
                let value = values.next_of(element, row, &property.name, property.value)?;
                if property.length.is_none() {
                    column.push(value);
                }
            }
        }
    }
    let mut named: Columns = element
        .properties
        .iter()
        .zip(columns)
        .filter(|(property, _)| property.length.is_none())
        .map(|(property, column)| (property.name.clone(), (property.value, column)))
        .collect();

    // Take what has a meaning; the rest are attributes.
    let Some([xs, ys, zs]) = take(&mut named, ["x", "y", "z"]) else {
        return Err(Fault::new(
            "element vertex",
            "properties x, y, z are missing",
        ));
    };
    surface.positions = (0..xs.len())
        .map(|i| DVec3::new(xs[i], ys[i], zs[i]))
        .collect();
    if let Some([nx, ny, nz]) = take(&mut named, ["nx", "ny", "nz"]) {
        let normal = |i: usize| Vec3::new(nx[i] as f32, ny[i] as f32, nz[i] as f32);
        surface.normals = Some((0..nx.len()).map(normal).collect());
    }
    if let Some([us, vs]) = UV_NAMES.iter().find_map(|names| take(&mut named, *names)) {
        // PLY's v points up, a mesh's down.
        let uv = |i: usize| DVec2::new(us[i], 1.0 - vs[i]).as_vec2();
        surface.uvs = Some((0..us.len()).map(uv).collect());
    }
    surface.attributes = named
        .into_iter()
        .map(|(name, (scalar, column))| {
            let unit = match scalar {
                Scalar::U8 if COLOR_NAMES.contains(&name.as_str()) => 255.0,
                Scalar::U16 if COLOR_NAMES.contains(&name.as_str()) => 65535.0,
                _ => 1.0,
            };
            (
                name,
                column
                    .into_iter()
                    .map(|value| (value / unit) as f32)
                    .collect(),
            )
        })
        .collect();
    Ok(())
}

fn read_faces(
    values: &mut Values<'_>,
    element: &Element,
    vertices: usize,
    surface: &mut Surface,
) -> Result<(), Fault> {
    let is_corners = |p: &Property| {
        p.length.is_some() && matches!(p.name.as_str(), "vertex_indices" | "vertex_index")
    };
    if !element.properties.iter().any(is_corners) {
        return Err(Fault::new(
            "element face",
            "property list vertex_indices is missing",
        ));
    }
    let mut corners: Vec<u32> = Vec::new();
    for row in 0..element.count {
        for property in &element.properties {
            let length = values.next_length(element, row, property)?;
            if !is_corners(property) {
                for _ in 0..length {
                    values.next_of(element, row, &property.name, property.value)?;
                }
                continue;
            }
            corners.clear();
            for _ in 0..length {
                let index = values.next_of(element, row, &property.name, property.value)?;
                if !(index >= 0.0 && index < vertices as f64 && index.fract() == 0.0) {
                    return Err(Fault::index(row, index, vertices));
                }
                corners.push(index as u32);
            }
            surface.add_face(&corners);
        }
    }
    Ok(())
}
