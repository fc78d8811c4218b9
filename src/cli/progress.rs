//! Progress bars on a terminal, one-line notes on standard error; nothing with `--quiet`.

use std::io::IsTerminal;
use std::path::Path;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;

use super::arguments::Common;
use super::failure::Failure;
use crate::image::write_atomically;

/// A bar of `total` steps, hidden unless standard error is a terminal.
pub(super) fn bar(common: &Common, label: &'static str, total: usize) -> ProgressBar {
    let bar = ProgressBar::new(total as u64);
    if common.quiet || !std::io::stderr().is_terminal() {
        bar.set_draw_target(ProgressDrawTarget::hidden());
        return bar;
    }
    let template = "{msg:>10} [{bar:40}] {pos}/{len} {elapsed} elapsed, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_message(label);
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}

/// A line for the user.
#[expect(clippy::print_stderr, reason = "this is where the command line speaks")]
pub(super) fn note(common: &Common, text: &str) {
    if !common.quiet {
        eprintln!("{text}");
    }
}

/// A result for the user or the next program, on standard output.
#[expect(clippy::print_stdout, reason = "this is where the command line speaks")]
pub(super) fn say(text: &str) {
    println!("{text}");
}

/// Writes `--stats`, if asked for.
pub(super) fn write_stats(common: &Common, stats: &impl Serialize) -> Result<(), Failure> {
    let Some(path) = &common.stats else {
        return Ok(());
    };
    let text = serde_json::to_string_pretty(stats).map_err(anyhow::Error::from)?;
    write_text(path, &text)
}

/// Writes a text file, whole or not at all.
pub(super) fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    write_atomically(path, |file| {
        std::io::Write::write_all(file, text.as_bytes())
    })
    .map_err(|source| Failure::write(path, source))
}
