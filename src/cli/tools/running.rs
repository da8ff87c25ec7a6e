//! Runs the gateway in this process, for `run`, and for `init` at its end.

use super::{CommandFailure, input};
use crate::daemon::service::reload::ConfigOrigin;
use crate::daemon::service::run as daemon;
use crate::daemon::service::signals::told_to_end;
use crate::domain::version::PROGRAM_VERSION;
use rustix::system::uname;
use std::path::Path;
use std::sync::Arc;

/// Runs the gateway with the configuration in `file` until SIGINT or SIGTERM.
pub fn run(file: &Path) -> Result<(), CommandFailure> {
    let config = input::configuration(file)?;
    let read_from = file.to_owned();
    let read = move || input::configuration(&read_from).map_err(|failure| failure.to_string());
    let judged_in = file.to_owned();
    let judge =
        move |text: &str| input::judged(&judged_in, text).map_err(|failure| failure.to_string());
    let load = ConfigOrigin {
        file: file.to_owned(),
        read: Arc::new(read),
        judge: Arc::new(judge),
    };
    let mut end = Ok(());
    let started = daemon::run(&config, Some(load), async |running| {
        let stop_signal = match told_to_end() {
            Ok(stop_signal) => stop_signal,
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
        tracing::info!(gateway = name, version = PROGRAM_VERSION, "running");
        for address in &running.listening {
            tracing::info!(%address, "Modbus TCP");
        }
        if let Some(address) = running.http {
            tracing::info!(%address, "HTTP");
        }
        stop_signal.await;
        tracing::info!("shutdown requested");
    });
    started.map_err(CommandFailure::failed)?;
    end.map_err(CommandFailure::failed)
}
