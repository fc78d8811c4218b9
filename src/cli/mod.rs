//! Arguments → checked plan → one function a subcommand.

mod arguments;
mod camera;
mod compare;
mod demo;
mod export;
mod failure;
mod fit;
mod outputs;
mod probe;
mod progress;
mod register;
mod render;
mod report;
mod reproduce;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;

use arguments::{Cli, Command};
use failure::Failure;
use outputs::check_outputs;

/// Runs the command line and says how it went: 0 done, 1 the data do not allow it, 2 usage or
/// unreadable input.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(error) => {
            let _ = error.print();
            return if error.use_stderr() {
                ExitCode::from(2)
            } else {
                ExitCode::SUCCESS
            };
        }
    };
    if let Some(threads) = cli.common.threads {
        // The pool can only be set once; a second call in one process keeps the first.
        let _ = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build_global();
    }
    let outcome = match check_outputs([("--stats", cli.common.stats.as_deref())]) {
        Ok(()) => dispatch(&cli),
        Err(failure) => Err(failure),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.tell(),
    }
}

fn dispatch(cli: &Cli) -> Result<(), Failure> {
    match &cli.command {
        Command::Demo(arguments) => demo::run(arguments, &cli.common),
        Command::Render(arguments) => render::run(arguments, &cli.common),
        Command::Register(arguments) => register::run(arguments, &cli.common),
        Command::Fit(arguments) => fit::run(arguments, &cli.common),
        Command::Reproduce(arguments) => reproduce::run(arguments, &cli.common),
        Command::Compare(arguments) => compare::run(arguments, &cli.common),
        Command::Export(arguments) => export::run(arguments, &cli.common),
        Command::Probe(probe) => probe::run(probe, &cli.common),
        Command::Report(arguments) => report::run(arguments, &cli.common),
        Command::Camera(command) => camera::run(command, &cli.common),
    }
}
