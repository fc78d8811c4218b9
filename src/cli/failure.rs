//! How a command fails, and what the shell hears.

use std::path::Path;
use std::process::ExitCode;

use crate::image::ImageError;

/// A command's failure, by whose fault it is.
#[derive(Debug)]
pub(super) enum Failure {
    /// Usage, or input that cannot be read: exit 2.
    Input(anyhow::Error),
    /// The input is sound, but does not hold what was asked for: exit 1.
    Data(anyhow::Error),
}

impl Failure {
    /// Prints the chain of causes once, on standard error.
    #[expect(clippy::print_stderr, reason = "this is where the command line speaks")]
    pub(super) fn tell(&self) -> ExitCode {
        let (error, code) = match self {
            Self::Input(error) => (error, 2),
            Self::Data(error) => (error, 1),
        };
        let mut told = error.to_string();
        eprintln!("turnlight: {told}");
        // Wrappers often repeat their cause; say each thing once.
        for cause in error.chain().skip(1) {
            let cause = cause.to_string();
            if !told.contains(&cause) {
                eprintln!("  because: {cause}");
                told = cause;
            }
        }
        ExitCode::from(code)
    }

    /// A file that cannot be written.
    pub(super) fn write(path: &Path, source: std::io::Error) -> Self {
        Self::Input(anyhow::anyhow!(
            "{}: cannot be written: {source}; check the disk and the permissions",
            path.display()
        ))
    }
}

/// Errors of the library are about input unless said otherwise.
macro_rules! input_failure {
    ($($error:ty),+ $(,)?) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::Input(error.into())
            }
        })+
    };
}

input_failure!(
    anyhow::Error,
    ImageError,
    crate::compare::CompareError,
    crate::export::ExportError,
    crate::mesh::MeshError,
    crate::probe::MergeError,
    crate::render::RenderError,
    crate::rig::CornerFileError,
    crate::rig::ImportError,
    crate::report::ReportError,
    crate::scene::AssetError,
    crate::scene::SceneError,
    crate::traces::TraceError,
);
