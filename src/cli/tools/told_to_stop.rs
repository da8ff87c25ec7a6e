//! The signals at which a command that moves a motor stops it.

use crate::daemon::service::signals::told_to_end;
use std::io;
use tokio::signal::unix::{SignalKind, signal};

/// Completes at SIGINT or SIGTERM. Also when the terminal is closed: Ctrl-C could no longer be pressed.
///
/// # Errors
/// The system refuses a handler.
pub fn told_to_stop() -> io::Result<impl Future<Output = ()>> {
    let stop_signal = told_to_end()?;
    let mut hangup = signal(SignalKind::hangup())?;
    Ok(async move {
        tokio::select! {
            () = stop_signal => {}
            _ = hangup.recv() => {}
        }
    })
}
