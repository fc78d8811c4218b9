//! `turnlight report`.

use super::arguments::{Common, Report};
use super::failure::Failure;
use super::outputs::check_outputs;
use super::progress::note;
use crate::report::write_report;

pub(super) fn run(arguments: &Report, common: &Common) -> Result<(), Failure> {
    check_outputs([("--out", Some(arguments.out.as_path()))])?;
    write_report(
        &arguments.fit,
        arguments.reproduced.as_deref(),
        &arguments.out,
    )?;
    note(common, &format!("{}: written", arguments.out.display()));
    Ok(())
}
