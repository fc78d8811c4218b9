//! `turnlight report`.

use super::arguments::{Common, Report};
use super::failure::Failure;
use super::progress::note;
use crate::report::write_report;

pub(super) fn run(arguments: &Report, common: &Common) -> Result<(), Failure> {
    write_report(
        &arguments.fit,
        arguments.reproduced.as_deref(),
        &arguments.out,
    )?;
    note(common, &format!("{}: written", arguments.out.display()));
    Ok(())
}
