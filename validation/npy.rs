//! NumPy arrays of float32, in and out.

use std::fs::File;
use std::io::{BufReader, BufWriter};

use anyhow::{Context, Result, ensure};
use npyz::{NpyFile, WriterBuilder};

/// Values in row order, and the shape, of a C-ordered float32 array.
pub(crate) fn read(path: &str) -> Result<(Vec<f32>, Vec<u64>)> {
    let file = File::open(path).with_context(|| path.to_owned())?;
    let array = NpyFile::new(BufReader::new(file)).with_context(|| path.to_owned())?;
    ensure!(
        array.order() == npyz::Order::C,
        "{path}: must be in C order"
    );
    let shape = array.shape().to_vec();
    let values = array.into_vec().with_context(|| path.to_owned())?;
    Ok((values, shape))
}

/// Writes a float32 array of this shape.
pub(crate) fn write(
    path: &str,
    shape: &[u64],
    values: impl IntoIterator<Item = f32>,
) -> Result<()> {
    let file = File::create(path).with_context(|| path.to_owned())?;
    let mut writer = npyz::WriteOptions::new()
        .default_dtype()
        .shape(shape)
        .writer(BufWriter::new(file))
        .begin_nd()?;
    writer.extend(values)?;
    writer.finish().with_context(|| path.to_owned())
}
