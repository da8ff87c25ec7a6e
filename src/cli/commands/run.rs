//! `run`: the daemon.

use crate::cli::tools::{CommandFailure, running};
use std::path::PathBuf;

/// Arguments of `run`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The configuration file
    #[arg(short, long, value_name = "FILE")]
    config: PathBuf,
}

/// Runs the gateway until SIGINT or SIGTERM.
pub fn run(args: &Args) -> Result<(), CommandFailure> {
    running::run(&args.config)
}
