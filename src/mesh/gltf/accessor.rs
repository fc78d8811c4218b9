//! Buffers and accessors of a glTF file, with every reach checked.

use std::path::Path;

use gltf::accessor::DataType;
use gltf::buffer::{Source, View};
use gltf::{Accessor, Document};

use super::Fault;

/// The bytes of every buffer, at least as long as the file says.
pub(super) fn load_buffers(
    document: &Document,
    mut blob: Option<Vec<u8>>,
    folder: Option<&Path>,
) -> Result<Vec<Vec<u8>>, Fault> {
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let fault = |problem: String| Fault::new(format!("buffers[{}]", buffer.index()), problem);
        let bytes = match buffer.source() {
            Source::Bin => blob
                .take()
                .ok_or_else(|| fault("the binary part is missing".into()))?,
            Source::Uri(uri) if uri.starts_with("data:") => {
                gltf::buffer::Data::from_source(Source::Uri(uri), None)
                    .map_err(|error| fault(format!("data URI: {error}")))?
                    .0
            }
            Source::Uri(uri) if uri.contains("://") => {
                return Err(fault(format!(
                    "`{uri}`: only files beside the mesh can be read"
                )));
            }
            Source::Uri(uri) => {
                let name = percent_decoded(uri);
                std::fs::read(folder.unwrap_or(Path::new("")).join(&name)).map_err(|error| {
                    fault(format!(
                        "`{name}`: {error}; keep the buffer beside the glTF file"
                    ))
                })?
            }
        };
        if bytes.len() < buffer.length() {
            return Err(fault(format!(
                "has {} bytes of {}: it is truncated, copy it again",
                bytes.len(),
                buffer.length()
            )));
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}

fn percent_decoded(uri: &str) -> String {
    let mut decoded = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        let hex = tail
            .get(..2)
            .and_then(|pair| std::str::from_utf8(pair).ok());
        match hex.and_then(|pair| u8::from_str_radix(pair, 16).ok()) {
            Some(byte) if *first == b'%' => {
                decoded.push(byte);
                rest = &tail[2..];
            }
            _ => {
                decoded.push(*first);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&decoded).into_owned()
}

/// All numbers of an accessor of `components` numbers an element, normalised where it says so.
pub(super) fn numbers(
    accessor: &Accessor<'_>,
    components: usize,
    buffers: &[Vec<u8>],
) -> Result<Vec<f64>, String> {
    let found = accessor.dimensions().multiplicity();
    if found != components {
        return Err(format!("{found} components where {components} are needed"));
    }
    let view = accessor
        .view()
        .ok_or("an accessor without a buffer view is not supported")?;
    let scalar = ScalarKind {
        data_type: accessor.data_type(),
        normalized: accessor.normalized(),
    };
    let stride = view.stride().unwrap_or(components * scalar.bytes());
    let block = Block {
        offset: accessor.offset(),
        count: accessor.count(),
        stride,
        components,
    };
    let mut values = block.read(&view, scalar, buffers)?;

    // A sparse accessor replaces some elements.
    if let Some(sparse) = accessor.sparse() {
        use gltf::accessor::sparse::IndexType;
        let indices = sparse.indices();
        let index_kind = ScalarKind {
            data_type: match indices.index_type() {
                IndexType::U8 => DataType::U8,
                IndexType::U16 => DataType::U16,
                IndexType::U32 => DataType::U32,
            },
            normalized: false,
        };
        let count = sparse.count();
        let places = Block {
            offset: indices.offset(),
            count,
            stride: index_kind.bytes(),
            components: 1,
        }
        .read(&indices.view(), index_kind, buffers)?;
        let stride = components * scalar.bytes();
        let replacements = Block {
            offset: sparse.values().offset(),
            count,
            stride,
            components,
        }
        .read(&sparse.values().view(), scalar, buffers)?;
        for (place, replacement) in places.iter().zip(replacements.chunks_exact(components)) {
            let first = *place as usize * components;
            values
                .get_mut(first..first + components)
                .ok_or_else(|| format!("sparse index {place} is out of range"))?
                .copy_from_slice(replacement);
        }
    }
    Ok(values)
}

/// Where elements lie in a buffer view; offset and stride in bytes.
struct Block {
    offset: usize,
    count: usize,
    stride: usize,
    components: usize,
}

impl Block {
    fn read(
        &self,
        view: &View<'_>,
        scalar: ScalarKind,
        buffers: &[Vec<u8>],
    ) -> Result<Vec<f64>, String> {
        let element = self.components * scalar.bytes();
        let within = view
            .offset()
            .checked_add(view.length())
            .and_then(|end| buffers.get(view.buffer().index())?.get(view.offset()..end))
            .and_then(|bytes| bytes.get(self.offset..))
            .filter(|bytes| match self.count.checked_sub(1) {
                None => true,
                Some(last) => last
                    .checked_mul(self.stride.max(1))
                    .and_then(|start| start.checked_add(element))
                    .is_some_and(|end| end <= bytes.len()),
            })
            .ok_or_else(|| {
                format!(
                    "{} elements reach beyond bufferViews[{}]",
                    self.count,
                    view.index()
                )
            })?;
        Ok((0..self.count)
            .flat_map(|i| within[i * self.stride.max(1)..][..element].chunks_exact(scalar.bytes()))
            .map(|bytes| scalar.number(bytes))
            .collect())
    }
}

#[derive(Clone, Copy)]
struct ScalarKind {
    data_type: DataType,
    normalized: bool,
}

impl ScalarKind {
    fn bytes(self) -> usize {
        self.data_type.size()
    }

    /// The number in `bytes`, which are as many as the type has.
    fn number(self, bytes: &[u8]) -> f64 {
        let mut word = [0u8; 4];
        word[..bytes.len()].copy_from_slice(bytes);
        let bits = u32::from_le_bytes(word);
        let (number, largest) = match self.data_type {
            DataType::I8 => (f64::from(bits as i8), 127.0),
            DataType::U8 => (f64::from(bits as u8), 255.0),
            DataType::I16 => (f64::from(bits as i16), 32767.0),
            DataType::U16 => (f64::from(bits as u16), 65535.0),
            DataType::U32 => return f64::from(bits),
            DataType::F32 => return f64::from(f32::from_bits(bits)),
        };
        if self.normalized {
            (number / largest).max(-1.0)
        } else {
            number
        }
    }
}
