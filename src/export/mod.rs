//! Results and scenes in the formats of other programs: NumPy and Mitsuba 3.

mod error;
mod files;
mod fit_folder;
mod mitsuba;
mod ndf_table;
mod npz;
mod points;

pub use error::ExportError;
pub use fit_folder::FitFolder;
pub use mitsuba::export_mitsuba;
pub use ndf_table::NdfTable;
pub use points::PointTable;
