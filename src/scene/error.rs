//! What can be wrong with a scene file: always the file, the key, its value and a remedy.

use std::path::{Path, PathBuf};

/// A scene or capture file that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}{problem}", prefix(file, problem))]
pub struct SceneError {
    /// The file.
    pub file: PathBuf,
    /// What is wrong with it.
    pub problem: Box<Problem>,
}

/// What is wrong with a scene or capture file.
///
/// `key` is the full path of a key, such as `frames[3].exposure`.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// The file cannot be read.
    #[error("{source}; check the path and its permissions")]
    Read {
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not TOML.
    #[error("{line}:{column}: {message}; correct the TOML here")]
    Syntax {
        /// Line, from 1.
        line: usize,
        /// Column, from 1, in characters.
        column: usize,
        /// What the parser said.
        message: String,
    },
    /// A key that nothing reads.
    #[error("{key}: unknown key; {remedy}")]
    UnknownKey {
        /// The key.
        key: String,
        /// The nearest known key, or all of them.
        remedy: String,
    },
    /// A required key is absent.
    #[error("{key}: missing; add {remedy}")]
    Missing {
        /// The key.
        key: String,
        /// What to write.
        remedy: String,
    },
    /// A value of the wrong type or out of range.
    #[error("{key} = {value}: must be {requirement}")]
    Value {
        /// The key.
        key: String,
        /// Its value, as TOML.
        value: String,
        /// What is allowed, and a remedy where there is a likely one.
        requirement: String,
    },
    /// A key that may not stand beside another.
    #[error("{key}: contradicts {other}; remove {remove}")]
    Conflict {
        /// The key.
        key: String,
        /// What it contradicts.
        other: String,
        /// Which to remove.
        remove: String,
    },
    /// A file that the scene names does not exist.
    #[error("{key} = \"{value}\": no such file {}; paths are relative to the folder of this file", resolved.display())]
    MissingFile {
        /// The key.
        key: String,
        /// The path as written.
        value: String,
        /// The path looked for.
        resolved: PathBuf,
    },
}

/// `file: `, or `file:` where the problem goes on with line and column.
fn prefix(file: &Path, problem: &Problem) -> String {
    let gap = if matches!(problem, Problem::Syntax { .. }) {
        ""
    } else {
        " "
    };
    format!("{}:{gap}", file.display())
}

impl Problem {
    /// The problem as an error of `file`.
    pub(super) fn in_file(self, file: &Path) -> SceneError {
        SceneError {
            file: file.to_path_buf(),
            problem: Box::new(self),
        }
    }
}
