//! `verify`: whether a drive is set so that it obeys the bus, read from the drive now.

use crate::cli::tools::{CommandFailure, print, setup, socket};

/// Arguments of `verify`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the drive, as in the gateway's configuration
    drive: String,
    #[command(flatten)]
    place: socket::SocketArgs,
    /// Print the gateway's JSON
    #[arg(long)]
    json: bool,
}

/// Prints the settings. It fails unless all of them are right and were answered.
pub fn verify(args: &Args) -> Result<(), CommandFailure> {
    let seen = setup::SetupDrive::new(&args.drive, &args.place)?.read_settings()?;
    print(&if args.json {
        format!("{}\n", serde_json::json!(seen))
    } else {
        setup::report(&seen.known)
    })?;
    setup::judge(&seen.known)
}
