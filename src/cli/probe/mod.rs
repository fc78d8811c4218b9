//! `turnlight probe`: from the probe's photographs to a light that can be trusted.

mod arguments;
mod inspect;
mod matching;
mod merge;

pub(super) use arguments::Probe;

use super::arguments::Common;
use super::failure::Failure;

pub(super) fn run(probe: &Probe, common: &Common) -> Result<(), Failure> {
    match probe {
        Probe::Merge(arguments) => merge::run(arguments, common),
        Probe::Match(arguments) => matching::run(arguments, common),
        Probe::Inspect(arguments) => inspect::run(arguments, common),
    }
}
