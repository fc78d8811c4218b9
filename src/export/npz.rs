//! Arrays in a zip file, as `numpy.savez` writes and `numpy.load` reads them.

use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Seek, Write};
use std::path::{Path, PathBuf};

use npyz::{AutoSerialize, Deserialize, NpyFile, Order, TypeStr, WriterBuilder};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

use super::ExportError;

/// Writes float32 and int32 arrays one after the other.
pub(super) struct ArrayWriter<W: Write + Seek> {
    zip: ZipWriter<W>,
}

impl<W: Write + Seek> ArrayWriter<W> {
    /// Starts the zip file in `file`.
    pub(super) fn new(file: W) -> Self {
        Self {
            zip: ZipWriter::new(file),
        }
    }

    /// `[N, 3]` float32.
    pub(super) fn rgb(&mut self, name: &str, samples: &[[f32; 3]]) -> io::Result<()> {
        self.array(name, &[samples.len() as u64, 3], samples.as_flattened())
    }

    /// `[M, columns]` float32, row after row.
    pub(super) fn rows(&mut self, name: &str, columns: usize, samples: &[f32]) -> io::Result<()> {
        let rows = samples.len().checked_div(columns).unwrap_or(0);
        self.array(name, &[rows as u64, columns as u64], samples)
    }

    /// `[N]` float32.
    pub(super) fn floats(&mut self, name: &str, samples: &[f32]) -> io::Result<()> {
        self.array(name, &[samples.len() as u64], samples)
    }

    /// `[N]` int32.
    pub(super) fn integers(&mut self, name: &str, samples: &[i32]) -> io::Result<()> {
        self.array(name, &[samples.len() as u64], samples)
    }

    /// Ends the zip file.
    pub(super) fn finish(self) -> io::Result<()> {
        self.zip.finish()?;
        Ok(())
    }

    fn array<T: AutoSerialize + Copy>(
        &mut self,
        name: &str,
        shape: &[u64],
        samples: &[T],
    ) -> io::Result<()> {
        // A fixed time, so that equal tables give equal bytes.
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .last_modified_time(DateTime::default())
            .large_file(size_of_val(samples) as u64 > u64::from(u32::MAX) / 2);
        self.zip
            .start_file(npyz::npz::file_name_from_array_name(name), options)?;
        let mut array = npyz::WriteOptions::new()
            .default_dtype()
            .shape(shape)
            .writer(&mut self.zip)
            .begin_nd()?;
        array.extend(samples.iter().copied())?;
        array.finish()
    }
}

/// Reads arrays by name, refusing other types and shapes.
pub(super) struct ArrayReader {
    zip: ZipArchive<BufReader<File>>,
    path: PathBuf,
}

/// An element type of `points.npz`, by NumPy's name.
pub(super) trait Element: Deserialize {
    /// NumPy's name of the type.
    const NAME: &'static str;
}

impl Element for f32 {
    const NAME: &'static str = "float32";
}

impl Element for i32 {
    const NAME: &'static str = "int32";
}

impl ArrayReader {
    /// Opens the zip file.
    pub(super) fn open(path: &Path) -> Result<Self, ExportError> {
        let wrap = |error: &dyn std::fmt::Display| ExportError::file(path, error);
        let file = File::open(path).map_err(|error| wrap(&error))?;
        let zip = ZipArchive::new(BufReader::new(file)).map_err(|error| wrap(&error))?;
        Ok(Self {
            zip,
            path: path.to_path_buf(),
        })
    }

    /// `[N, 3]` float32.
    pub(super) fn rgb(&mut self, name: &'static str) -> Result<Vec<[f32; 3]>, ExportError> {
        let samples = self.array::<f32>(name, Some(3))?;
        Ok(samples.as_chunks::<3>().0.to_vec())
    }

    /// `[M, columns]` float32, row after row.
    pub(super) fn rows(
        &mut self,
        name: &'static str,
        columns: usize,
    ) -> Result<Vec<f32>, ExportError> {
        self.array(name, Some(columns as u64))
    }

    /// `[N]` of `T`.
    pub(super) fn column<T: Element>(&mut self, name: &'static str) -> Result<Vec<T>, ExportError> {
        self.array(name, None)
    }

    /// `[N]` of `T`, or none if the file has no such array.
    pub(super) fn column_if_any<T: Element>(
        &mut self,
        name: &'static str,
    ) -> Result<Option<Vec<T>>, ExportError> {
        match self.column(name) {
            Err(ExportError::MissingArray { .. }) => Ok(None),
            found => found.map(Some),
        }
    }

    /// The samples, row after row, of an array `[N]` or `[N, columns]`.
    fn array<T: Element>(
        &mut self,
        name: &'static str,
        columns: Option<u64>,
    ) -> Result<Vec<T>, ExportError> {
        let path = self.path.clone();
        let broken =
            |error: &dyn std::fmt::Display| ExportError::file(&path, format!("{name}: {error}"));
        let Some(index) = self
            .zip
            .index_for_name(&npyz::npz::file_name_from_array_name(name))
        else {
            return Err(ExportError::MissingArray { path, name });
        };
        let entry = self.zip.by_index(index).map_err(|error| broken(&error))?;
        let (start, rest) = checked_start(entry).map_err(|error| broken(&error))?;
        let array = NpyFile::new(Cursor::new(start).chain(rest)).map_err(|error| broken(&error))?;

        // Type, number of axes, columns and order must be those written.
        let expected = format!(
            "{} [N{}]",
            T::NAME,
            columns.map_or(String::new(), |n| format!(", {n}"))
        );
        let axes_fit = match (array.shape(), columns) {
            ([_], None) => true,
            ([_, found], Some(columns)) => *found == columns && array.order() == Order::C,
            _ => false,
        };
        let found = format!(
            "{} {:?}{}",
            type_name(&array.dtype()),
            array.shape(),
            if array.order() == Order::Fortran {
                " in Fortran order"
            } else {
                ""
            }
        );
        let length: u64 = array.shape().iter().product();
        let samples = match array.data::<T>() {
            Ok(samples) if axes_fit => samples,
            _ => {
                return Err(ExportError::Array {
                    path,
                    name,
                    found,
                    expected,
                });
            }
        };
        // Grown as data come: the length in a damaged header is not to be allocated.
        let mut values = Vec::new();
        for sample in samples {
            values.push(sample.map_err(|error| broken(&error))?);
        }
        if values.len() as u64 == length {
            Ok(values)
        } else {
            Err(broken(&"ends early"))
        }
    }
}

/// The first bytes of an array, and the rest, unless its header claims more than NumPy ever writes.
///
/// The npyz crate (0.9) allocates what the header's length says before it reads it.
fn checked_start<R: Read>(mut array: R) -> io::Result<(Vec<u8>, R)> {
    const LONGEST_HEADER: u32 = 1 << 16;
    // Magic, version; from version 2 on the header's length has four bytes.
    let mut start = Vec::new();
    array.by_ref().take(12).read_to_end(&mut start)?;
    if let [_, _, _, _, _, _, version, _, a, b, c, d] = start[..]
        && version >= 2
        && let length = u32::from_le_bytes([a, b, c, d])
        && length > LONGEST_HEADER
    {
        return Err(io::Error::new(
            io::ErrorKind::InvalidData,
            format!("claims a header of {length} bytes; write the file again"),
        ));
    }
    Ok((start, array))
}

/// NumPy's name of the two types written here, else the code in the file.
fn type_name(dtype: &npyz::DType) -> String {
    let is = |code: &str| {
        code.parse::<TypeStr>()
            .is_ok_and(|plain| matches!(dtype, npyz::DType::Plain(found) if *found == plain))
    };
    match () {
        () if is("<f4") => f32::NAME.to_owned(),
        () if is("<i4") => i32::NAME.to_owned(),
        () => dtype.descr(),
    }
}

/// Refuses an array of another length than the table's.
pub(super) fn expect_length(
    path: &Path,
    name: &'static str,
    length: usize,
    wanted: usize,
) -> Result<(), ExportError> {
    if length == wanted {
        return Ok(());
    }
    let (found, expected) = (
        format!("[{length}]"),
        format!("[{wanted}] like the other arrays"),
    );
    Err(ExportError::Array {
        path: path.to_path_buf(),
        name,
        found,
        expected,
    })
}
