//! `run`: the daemon.

use super::{Failure, input};
use crate::daemon::service::reload::Load;
use crate::daemon::service::run as daemon;
use crate::daemon::service::signals::told_to_end;
use rustix::system::uname;
use std::path::PathBuf;
use std::sync::Arc;

/// Arguments of `run`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The configuration file
    #[arg(short, long, value_name = "FILE")]
    pub config: PathBuf,
}

/// Runs the gateway until SIGINT or SIGTERM.
pub fn run(args: &Args) -> Result<(), Failure> {
    let config = input::configuration(&args.config)?;
    let file = args.config.clone();
    let read = move || input::configuration(&file).map_err(|failure| failure.to_string());
    let file = args.config.clone();
    let judge = move |text: &str| input::judged(&file, text).map_err(|failure| failure.to_string());
    let load = Load {
        file: args.config.clone(),
        read: Arc::new(read),
        judge: Arc::new(judge),
    };
    let mut end = Ok(());
    let started = daemon::run(&config, Some(load), async |running| {
        let told = match told_to_end() {
            Ok(told) => told,
            Err(error) => {
                end = Err(error);
                return;
            }
        };
        let host = || uname().nodename().to_string_lossy().into_owned();
        let name = config
            .gateway
            .name
            .as_ref()
            .map_or_else(host, ToString::to_string);
        tracing::info!(
            gateway = name,
            version = env!("CARGO_PKG_VERSION"),
            "running"
        );
        for address in &running.listening {
            tracing::info!(%address, "Modbus TCP");
        }
        if let Some(address) = running.http {
            tracing::info!(%address, "HTTP");
        }
        told.await;
        tracing::info!("shutdown requested");
    });
    started.map_err(Failure::failed)?;
    end.map_err(Failure::failed)
}
