//! `broker`: a small MQTT broker for the demo and for experiments.

use crate::cli::tools::{CommandFailure, print};
use crate::daemon::mqtt::broker;
use crate::daemon::mqtt::broker_child::ANNOUNCEMENT;
use crate::daemon::service::signals::told_to_end;
use std::io::{self, Read};
use std::net::SocketAddr;
use tokio::sync::oneshot;

/// Arguments of `broker`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A loopback address; with port 0 a free port is found
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:1883")]
    listen: SocketAddr,
}

/// Runs the broker until SIGINT, SIGTERM or the end of standard input: a broker that another program started with a
/// pipe exits with it. To run it by itself without a terminal, give it an input that does not end.
pub fn broker(args: &Args) -> Result<(), CommandFailure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    let done = runtime.block_on(async {
        let stop_signal = told_to_end().map_err(CommandFailure::failed)?;
        let listening = broker::listen(args.listen)
            .await
            .map_err(CommandFailure::failed)?;
        let closed = input_closed().map_err(CommandFailure::failed)?;
        print(&format!("{ANNOUNCEMENT}{}\n", listening.address()))?;
        tokio::select! {
            () = listening.serve() => Err(CommandFailure::failed("the broker exited unexpectedly")),
            () = stop_signal => Ok(()),
            _ = closed => Ok(()),
        }
    });
    runtime.shutdown_background();
    done
}

/// Completes when standard input has ended. Its thread exits with the process.
fn input_closed() -> io::Result<oneshot::Receiver<()>> {
    let (sender, receiver) = oneshot::channel();
    std::thread::Builder::new()
        .name("input".to_owned())
        .spawn(move || {
            let mut buffer = [0; 256];
            while matches!(io::stdin().lock().read(&mut buffer), Ok(read) if read > 0) {}
            // The broker may have exited for another reason.
            let _ = sender.send(());
        })?;
    Ok(receiver)
}
