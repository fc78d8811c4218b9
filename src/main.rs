//! The `turnlight` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    turnlight::cli::run(std::env::args_os())
}
