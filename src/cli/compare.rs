//! `turnlight compare`.

use super::arguments::{Common, Compare};
use super::failure::Failure;
use super::outputs::check_outputs;
use super::progress::{say, write_stats, write_text};
use crate::compare::compare_sequences;

pub(super) fn run(arguments: &Compare, common: &Common) -> Result<(), Failure> {
    check_outputs([("--json", arguments.json.as_deref())])?;
    let errors = compare_sequences(
        &arguments.reference,
        &arguments.test,
        arguments.masks.as_deref(),
    )?;
    say(&errors.to_string());
    if let Some(path) = &arguments.json {
        let text = serde_json::to_string_pretty(&errors).map_err(anyhow::Error::from)?;
        write_text(path, &text)?;
    }
    write_stats(common, &errors)
}
