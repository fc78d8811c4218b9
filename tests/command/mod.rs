//! The command, as a user runs it.

use std::path::Path;
use std::process::{Command, Output};

/// Runs turnlight to its end.
pub(crate) fn turnlight(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_turnlight"))
        .args(words)
        .output()
        .unwrap()
}

/// Runs turnlight, which must succeed; what it said.
pub(crate) fn succeeds(words: &[&str]) -> String {
    let run = turnlight(words);
    let said = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success(), "{said}");
    said
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}
