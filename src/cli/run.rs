//! `run`: the daemon.

use super::{Failure, input};
use crate::daemon::run::{self as daemon, told_to_end};
use std::path::PathBuf;

/// Arguments of `run`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The configuration file
    #[arg(short, long, value_name = "FILE")]
    config: PathBuf,
}

/// Runs the gateway until SIGINT or SIGTERM.
pub fn run(args: &Args) -> Result<(), Failure> {
    let config = input::configuration(&args.config)?;
    let mut end = Ok(());
    let started = daemon::run(&config, async |running| {
        let told = match told_to_end() {
            Ok(told) => told,
            Err(error) => {
                end = Err(error);
                return;
            }
        };
        for address in &running.listening {
            tracing::info!(%address, "Modbus TCP");
        }
        told.await;
        tracing::info!("told to end");
    });
    started.map_err(Failure::failed)?;
    end.map_err(Failure::failed)
}
