//! OpenEXR: chooses channels of a layer, places its data window in the display window.
//!
//! Works on the crate's blocks rather than its images: the headers can then be judged before anything of the size
//! they claim is allocated, and decompression runs where a panic can be caught (the crate's own thread
//! pool would end the process).

use std::io::{self, Read, Seek, SeekFrom, Write};

use ::exr::{
    block::{
        UncompressedBlock,
        chunk::{Chunk, CompressedBlock},
    },
    meta::{MetaData, attribute::SampleType, header::Header},
    prelude::{
        AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer,
        LayerAttributes, LineOrder, SmallVec, Vec2, WritableImage, f16,
    },
};
use rayon::prelude::*;

use super::{
    Channel, Fault, RgbImage,
    read::{PACKED_MOST, check_size, without_panic},
};

/// The first bytes of every EXR file.
pub(super) const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

const TO_RGB: &str = "convert it to one layer of plain R, G, B channels";

/// How many blocks are decompressed before they are copied: enough for every core, small in memory.
const BATCH: usize = 64;

/// A layer and those of its channels that are wanted.
struct Selection {
    layer: usize,
    channels: Vec<usize>,
}

/// The display window; rows and columns outside the data window are 0.
struct Planes {
    width: usize,
    height: usize,
    /// One a channel of the selection.
    samples: Vec<Vec<f32>>,
}

/// The first layer with R, G and B (bare or under a common prefix, upper or lower case); else the first Y; else the first
/// layer with a single channel. The last two are grey.
pub(super) fn read_rgb(file: impl Read + Seek) -> Result<RgbImage, Fault> {
    let file = Layers::open(file)?;
    let selection = file.rgb().or_else(|| file.grey()).ok_or_else(|| {
        Fault::new(
            format!("holds no R, G, B or Y channels, only {}", file.names()),
            TO_RGB,
        )
    })?;
    let planes = file.planes(&[selection])?;
    let pixels = match &planes.samples[..] {
        [r, g, b] => r
            .iter()
            .zip(g)
            .zip(b)
            .map(|((&r, &g), &b)| [r, g, b])
            .collect(),
        [y] => y.iter().map(|&y| [y; 3]).collect(),
        _ => return Err(Fault::damaged("the channels do not belong together")),
    };
    Ok(RgbImage {
        width: planes.width,
        height: planes.height,
        pixels,
    })
}

/// Every channel of every flat layer; where there are several layers, named `LAYER.CHANNEL`.
pub(super) fn read_channels(file: impl Read + Seek) -> Result<(usize, usize, Vec<Channel>), Fault> {
    let file = Layers::open(file)?;
    let selections: Vec<Selection> = file
        .flat()
        .map(|(layer, header)| Selection {
            layer,
            channels: (0..header.channels.list.len()).collect(),
        })
        .collect();
    let names: Vec<String> = file
        .flat()
        .flat_map(|(_, header)| file.qualified(header))
        .collect();
    let planes = file.planes(&selections)?;
    let channels = names
        .into_iter()
        .zip(planes.samples)
        .map(|(name, samples)| Channel { name, samples })
        .collect();
    Ok((planes.width, planes.height, channels))
}

/// An EXR file whose headers have been read and found plausible.
struct Layers<R> {
    reader: ::exr::block::reader::Reader<R>,
    file_bytes: u64,
}

impl<R: Read + Seek> Layers<R> {
    fn open(mut file: R) -> Result<Self, Fault> {
        let file_bytes = file.seek(SeekFrom::End(0)).map_err(Fault::damaged)?;
        file.rewind().map_err(Fault::damaged)?;
        let reader = without_panic(|| ::exr::block::read(file, false).map_err(Fault::damaged))?;
        let layers = Self { reader, file_bytes };
        // Each block has an entry of 8 bytes in the offset table.
        let chunks = layers.headers().iter().try_fold(0u64, |sum, header| {
            sum.checked_add(header.chunk_count as u64)
        });
        if chunks.is_none_or(|chunks| chunks.saturating_mul(8) > file_bytes) {
            return Err(Fault::damaged("is shorter than its own table of contents"));
        }
        for (_, header) in layers.flat() {
            let bytes = header.channels.bytes_per_pixel;
            let display = header.shared_attributes.display_window.size;
            let tile = match header.blocks {
                ::exr::meta::BlockDescription::Tiles(tiles) => Some(tiles.tile_size),
                _ => None,
            };
            for size in [display, header.layer_size].into_iter().chain(tile) {
                check_size(size.x(), size.y(), bytes, file_bytes, PACKED_MOST)?;
            }
        }
        if layers.flat().next().is_none() {
            return Err(Fault::new("holds deep layers only", "flatten it first"));
        }
        Ok(layers)
    }

    fn headers(&self) -> &[Header] {
        self.reader.headers()
    }

    fn flat(&self) -> impl Iterator<Item = (usize, &Header)> {
        self.headers()
            .iter()
            .enumerate()
            .filter(|(_, header)| !header.deep)
    }

    fn rgb(&self) -> Option<Selection> {
        self.flat().find_map(|(layer, header)| {
            rgb_channels(&channel_names(header)).map(|rgb| Selection {
                layer,
                channels: rgb.into(),
            })
        })
    }

    fn grey(&self) -> Option<Selection> {
        let luminance = |header: &Header| {
            // Y beside chroma (RY, BY) is a colour image that is not understood: refuse, not grey.
            let names = channel_names(header);
            let chroma = names.iter().any(|name| matches!(base(name), "RY" | "BY"));
            if chroma {
                None
            } else {
                names
                    .iter()
                    .position(|name| matches!(base(name), "Y" | "y"))
            }
        };
        let only = |header: &Header| (header.channels.list.len() == 1).then_some(0);
        self.flat()
            .find_map(|(layer, header)| Some((layer, luminance(header)?)))
            .or_else(|| {
                self.flat()
                    .find_map(|(layer, header)| Some((layer, only(header)?)))
            })
            .map(|(layer, channel)| Selection {
                layer,
                channels: vec![channel],
            })
    }

    /// Channel names, under their layer's name where the file has several layers.
    fn qualified(&self, header: &Header) -> Vec<String> {
        let layer = header
            .own_attributes
            .layer_name
            .as_ref()
            .map(ToString::to_string);
        let prefix = match layer {
            Some(layer) if self.headers().len() > 1 => format!("{layer}."),
            _ => String::new(),
        };
        channel_names(header)
            .into_iter()
            .map(|name| {
                if name.starts_with(&prefix) {
                    name
                } else {
                    format!("{prefix}{name}")
                }
            })
            .collect()
    }

    fn names(&self) -> String {
        let names: Vec<String> = self
            .flat()
            .flat_map(|(_, header)| self.qualified(header))
            .collect();
        names.join(", ")
    }

    fn planes(self, selections: &[Selection]) -> Result<Planes, Fault> {
        without_panic(|| self.decode(selections))
    }

    fn decode(self, selections: &[Selection]) -> Result<Planes, Fault> {
        for selection in selections {
            let channels = &self.headers()[selection.layer].channels.list;
            if channels
                .iter()
                .any(|channel| channel.sampling != Vec2(1, 1))
            {
                return Err(Fault::new(
                    "holds subsampled (luminance-chroma) channels",
                    TO_RGB,
                ));
            }
        }
        let file_bytes = self.file_bytes;
        let wanted = |layer| selections.iter().any(|selection| selection.layer == layer);

        // Read every compressed block before making room for pixels: a truncated file ends here.
        let reader = self
            .reader
            .filter_chunks(false, |_, tile, block| {
                wanted(block.layer) && tile.is_largest_resolution_level()
            })
            .map_err(Fault::damaged)?;
        let meta = ::exr::block::reader::ChunksReader::meta_data(&reader).clone();
        let mut chunks: Vec<Chunk> = Vec::new();
        let mut chunk_bytes = 0;
        for chunk in reader {
            let chunk = chunk.map_err(Fault::damaged)?;
            chunk_bytes += compressed(&chunk).len() as u64;
            if chunk_bytes > file_bytes {
                return Err(Fault::damaged("blocks overlap in the file"));
            }
            if !dwa_sizes_are_plausible(&meta, &chunk).map_err(Fault::damaged)? {
                return Err(Fault::damaged(
                    "a compressed block claims an impossible size",
                ));
            }
            chunks.push(chunk);
        }

        // Decompress some blocks at a time on all cores, then copy their rows.
        let window = meta.headers[0].shared_attributes.display_window;
        let (width, height) = (window.size.x(), window.size.y());
        let count = selections
            .iter()
            .map(|selection| selection.channels.len())
            .sum();
        let mut samples: Vec<Vec<f32>> = (0..count).map(|_| vec![0.0; width * height]).collect();
        let mut chunks = chunks.into_iter();
        loop {
            let batch: Vec<Chunk> = chunks.by_ref().take(BATCH).collect();
            if batch.is_empty() {
                return Ok(Planes {
                    width,
                    height,
                    samples,
                });
            }
            let blocks: Vec<_> = batch
                .into_par_iter()
                .map(|chunk| UncompressedBlock::decompress_chunk(chunk, &meta, false))
                .collect();
            for block in blocks {
                let block = block.map_err(Fault::damaged)?;
                copy_rows(&block, &meta, selections, &mut samples).map_err(Fault::damaged)?;
            }
        }
    }
}

/// Copies what lies inside the display window.
fn copy_rows(
    block: &UncompressedBlock,
    meta: &MetaData,
    selections: &[Selection],
    samples: &mut [Vec<f32>],
) -> ::exr::error::Result<()> {
    let header = &meta.headers[block.index.layer];
    let window = header.shared_attributes.display_window;
    let (width, height) = (window.size.x() as i64, window.size.y() as i64);
    let origin = header.own_attributes.layer_position;
    let left = i64::from(origin.x()) - i64::from(window.position.x());
    let top = i64::from(origin.y()) - i64::from(window.position.y());
    let first_plane: usize = selections
        .iter()
        .take_while(|selection| selection.layer != block.index.layer)
        .map(|selection| selection.channels.len())
        .sum();
    let Some(selection) = selections.iter().find(|s| s.layer == block.index.layer) else {
        return Ok(());
    };
    for line in block.lines(&header.channels) {
        let Some(slot) = selection
            .channels
            .iter()
            .position(|&c| c == line.location.channel)
        else {
            continue;
        };
        let y = top + line.location.position.y() as i64;
        if !(0..height).contains(&y) {
            continue;
        }
        let x = left + line.location.position.x() as i64;
        let row =
            &mut samples[first_plane + slot][(y * width) as usize..((y + 1) * width) as usize];
        let mut put = |i: usize, value: f32| {
            if let Some(sample) = usize::try_from(x + i as i64)
                .ok()
                .and_then(|x| row.get_mut(x))
            {
                *sample = value;
            }
        };
        match header.channels.list[line.location.channel].sample_type {
            SampleType::F16 => {
                for (i, value) in line.read_samples::<f16>().enumerate() {
                    put(i, value?.to_f32());
                }
            }
            SampleType::F32 => {
                for (i, value) in line.read_samples::<f32>().enumerate() {
                    put(i, value?);
                }
            }
            SampleType::U32 => {
                for (i, value) in line.read_samples::<u32>().enumerate() {
                    put(i, value? as f32);
                }
            }
        }
    }
    Ok(())
}

fn compressed(chunk: &Chunk) -> &[u8] {
    match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        CompressedBlock::DeepScanLine(_) | CompressedBlock::DeepTile(_) => &[],
    }
}

/// Whether the sizes that a DWAA or DWAB block claims for its parts could come from its pixels.
///
/// The exr crate (1.74) allocates what they say before it looks at the data, and a failed allocation
/// ends the process: one flipped bit in a file would do.
fn dwa_sizes_are_plausible(meta: &MetaData, chunk: &Chunk) -> ::exr::error::Result<bool> {
    let Some(header) = meta.headers.get(chunk.layer_index) else {
        return Ok(false);
    };
    if !matches!(
        header.compression,
        Compression::DWAA(_) | Compression::DWAB(_)
    ) {
        return Ok(true);
    }
    let tile = header.get_block_data_indices(&chunk.compressed_block)?;
    let size = header.get_absolute_block_pixel_coordinates(tile)?.size;
    let block = compressed(chunk);
    if block.len() == size.area() * header.channels.bytes_per_pixel {
        // Stored as it is, without these sizes.
        return Ok(true);
    }
    // Little-endian u64: 1 UNKNOWN bytes, 6 RLE bytes after zlib, 7 after run-length decoding,
    // 8 AC values, 9 DC values; 2 to 5 are compressed sizes, which the crate checks.
    const UNCOMPRESSED: [usize; 5] = [1, 6, 7, 8, 9];
    // Blocks of 8 × 8 reach past the edges; run lengths may double what they encode.
    let padded = (size.x() as u64 + 8).saturating_mul(size.y() as u64 + 8);
    let most = padded.saturating_mul(2 * header.channels.bytes_per_pixel as u64);
    Ok(UNCOMPRESSED.iter().all(|word| {
        let bytes = block
            .get(8 * word..8 * word + 8)
            .and_then(|bytes| bytes.try_into().ok());
        // The crate refuses a block too short for them.
        bytes.is_none_or(|bytes| u64::from_le_bytes(bytes) <= most)
    }))
}

fn channel_names(header: &Header) -> Vec<String> {
    header
        .channels
        .list
        .iter()
        .map(|channel| channel.name.to_string())
        .collect()
}

/// The part after the last dot.
fn base(name: &str) -> &str {
    name.rsplit('.').next().unwrap_or(name)
}

/// Positions of R, G, B under one prefix, the bare ones first.
fn rgb_channels(names: &[String]) -> Option<[usize; 3]> {
    let find = |prefix: &str, letter: &str| {
        names.iter().position(|name| {
            name.strip_prefix(prefix)
                .is_some_and(|rest| rest.eq_ignore_ascii_case(letter))
        })
    };
    let prefixes = names
        .iter()
        .map(|name| &name[..name.len() - base(name).len()]);
    std::iter::once("")
        .chain(prefixes)
        .find_map(|prefix| Some([find(prefix, "R")?, find(prefix, "G")?, find(prefix, "B")?]))
}

/// Writes float32 planes: one layer, ZIP blocks of 16 rows, increasing y. Equal input gives equal bytes.
pub(super) fn write_planes(
    writer: impl Write + Seek,
    (width, height): (usize, usize),
    planes: Vec<(&str, Vec<f32>)>,
) -> io::Result<()> {
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = planes
        .into_iter()
        .map(|(name, samples)| AnyChannel::new(name, FlatSamples::F32(samples)))
        .collect();
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let layer = Layer::new(
        (width, height),
        LayerAttributes::default(),
        encoding,
        AnyChannels::sort(channels),
    );
    Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(writer)
        .map_err(io::Error::other)
}
