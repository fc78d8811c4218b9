//! Files as wholes, with this module's errors.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;

use super::ExportError;

/// Writes `path` whole or not at all ([`crate::image::write_atomically`]).
pub(super) fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), ExportError> {
    crate::image::write_atomically(path, write).map_err(|error| ExportError::file(path, error))
}
