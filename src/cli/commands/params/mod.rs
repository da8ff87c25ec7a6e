//! `params`: the parameters of a drive to a file, the difference between two, and back to the drive.

mod diff;
mod file;
mod live;
mod restore;
mod walk;

use crate::cli::tools::own_gateway::{DriveArgs, OwnGateway, ToolAccess};
use crate::cli::tools::setup::table;
use crate::cli::tools::{CommandFailure, log::complain, print, socket};
use crate::config;
use crate::daemon::service::signals::told_to_end;
use crate::domain::ids::Name;
use diff::{ParameterDifference, differences};
use file::ParameterDump;
use live::GatewayDrive;
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How often a drive on a port is polled while its parameters are read or written.
const POLL: Duration = Duration::from_millis(500);

/// Arguments of `params`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    action: ParamsAction,
}

#[derive(Debug, clap::Subcommand)]
enum ParamsAction {
    /// Read all parameters of the drive, and write them to a file or print them
    ///
    /// Reads the parameters that its model lists and, where the model has a rule for the addresses of its groups, every
    /// number of each group that the drive answers, at standstill. The head of the file says what is missing.
    Dump(DumpArgs),
    /// Compare two files, or a file with the drive as it is now
    Diff(DiffArgs),
    /// Write a file back to a drive: shows the changes, asks, writes at standstill, reads each value back
    ///
    /// Writes only what differs. Station, speed and similar settings, and those that decide which source commands the
    /// motor, are written only with --with-link, and last. The first refusal ends it.
    Restore(RestoreArgs),
}

#[derive(Debug, clap::Args)]
struct DriveSelection {
    #[command(flatten)]
    place: socket::SocketArgs,
    /// Use a port directly, without a gateway: a serial port or tcp://HOST:PORT, with --model and --station
    #[arg(long, value_name = "PORT", value_parser = config::port_address)]
    port: Option<config::PortAddress>,
    #[command(flatten)]
    on_port: DriveArgs,
}

#[derive(Debug, clap::Args)]
struct DumpArgs {
    /// Name of the drive, as in the gateway's configuration
    #[arg(required_unless_present = "port")]
    drive: Option<String>,
    #[command(flatten)]
    of: DriveSelection,
    /// Write to this file instead of printing; never overwrites a file
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
struct DiffArgs {
    /// A file from `params dump`
    first: PathBuf,
    /// Another file, or `live` for the drive as it is now
    second: PathBuf,
    /// Name of the drive, for `live`; default: the one named in the file
    #[arg(long)]
    drive: Option<String>,
    #[command(flatten)]
    of: DriveSelection,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
struct RestoreArgs {
    /// A file from `params dump`
    file: PathBuf,
    /// Name of the drive; default: the one named in the file
    #[arg(long)]
    drive: Option<String>,
    #[command(flatten)]
    of: DriveSelection,
    /// Only show what would change
    #[arg(long)]
    dry_run: bool,
    /// Also write the settings that decide how the drive is reached and which source commands it, last
    #[arg(long)]
    with_link: bool,
    /// Do not ask
    #[arg(long)]
    yes: bool,
}

/// Dumps, compares or restores.
pub fn params(args: &Args) -> Result<(), CommandFailure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    runtime.block_on(async {
        let stop_signal = told_to_end().map_err(CommandFailure::failed)?;
        tokio::select! {
            done = act(&args.action) => done,
            () = stop_signal => Err(CommandFailure::failed("interrupted before it was done")),
        }
    })
}

async fn act(action: &ParamsAction) -> Result<(), CommandFailure> {
    match action {
        ParamsAction::Dump(args) => dump(args).await,
        ParamsAction::Diff(args) => compare(args).await,
        ParamsAction::Restore(args) => {
            let wanted = ParameterDump::read(&args.file)?;
            let reached = args
                .of
                .reach(args.drive.as_deref().or(Some(&wanted.drive)), true)
                .await?;
            let wish = restore::RestoreOptions {
                with_link: args.with_link,
                yes: args.yes,
                dry_run: args.dry_run,
            };
            let done = restore::restore(&wanted, &reached.live, wish).await;
            reached.close().await;
            done
        }
    }
}

/// A reachable drive, and the gateway that was started for that.
struct ReachedGateway {
    live: GatewayDrive,
    own: Option<OwnGateway>,
}

impl ReachedGateway {
    async fn close(self) {
        if let Some(own) = self.own {
            own.close().await;
        }
    }
}

impl DriveSelection {
    /// The drive called `drive` behind the gateway, or the one that the arguments name on a port.
    async fn reach(
        &self,
        drive: Option<&str>,
        writes: bool,
    ) -> Result<ReachedGateway, CommandFailure> {
        if let Some(port) = &self.port {
            let control = writes.then(ToolAccess::control_at_rest).unwrap_or_default();
            // The motor is known to be at standstill only while it is polled.
            let extra = ToolAccess {
                control,
                poll: Some(POLL),
                ..ToolAccess::default()
            };
            let own = OwnGateway::start(port, &self.on_port, &extra).await?;
            let live = GatewayDrive {
                socket: own.socket(),
                drive: own.drive(),
                station: Some(own.station()),
            };
            return Ok(ReachedGateway {
                live,
                own: Some(own),
            });
        }
        let name = drive.unwrap_or_default();
        let drive = Name::new(name)
            .ok_or_else(|| CommandFailure::wrong(format!("`{name}` is not a valid drive name")))?;
        Ok(ReachedGateway {
            live: GatewayDrive {
                socket: self.place.path()?,
                drive,
                station: None,
            },
            own: None,
        })
    }
}

async fn dump(args: &DumpArgs) -> Result<(), CommandFailure> {
    if let Some(out) = args.out.as_deref().filter(|out| out.exists()) {
        return Err(CommandFailure::wrong(format!(
            "{} already exists and is not overwritten",
            out.display()
        )));
    }
    let reached = args.of.reach(args.drive.as_deref(), false).await?;
    let dump = read_dump(&reached.live).await;
    reached.close().await;
    let dump = dump?;
    if !dump.unreadable.is_empty() {
        let rows = dump
            .unreadable
            .iter()
            .map(|it| [it.code.clone(), it.reason.clone()]);
        complain(format!("could not be read:\n{}", table(rows)).as_bytes());
    }
    if dump.parameters.is_empty() {
        return Err(CommandFailure::failed("the drive returned no parameter"));
    }
    let Some(out) = &args.out else {
        return print(&dump.text());
    };
    write_new(out, &dump.text())?;
    complain(
        format!(
            "{} parameters in {}\n",
            dump.parameters.len(),
            out.display()
        )
        .as_bytes(),
    );
    Ok(())
}

async fn read_dump(live: &GatewayDrive) -> Result<ParameterDump, CommandFailure> {
    let catalogue = live.catalogue().await?;
    let mut dump = live.dump(&catalogue.model, &catalogue.parameters).await?;
    // A drive that shows no parameter is not asked for more.
    if !dump.parameters.is_empty() {
        let there = catalogue
            .parameters
            .iter()
            .find(|known| dump.at(known.address).is_some())
            .cloned();
        live.dump_groups(&catalogue.groups, there.as_ref(), &mut dump)
            .await?;
    }
    dump.left_out.splice(..0, catalogue.left_out);
    Ok(dump)
}

async fn compare(args: &DiffArgs) -> Result<(), CommandFailure> {
    let is_live = |path: &Path| path.as_os_str() == "live";
    if is_live(&args.first) {
        return Err(CommandFailure::wrong(
            "the first is a file; only the second may be `live`",
        ));
    }
    let first = ParameterDump::read(&args.first)?;
    let second = if is_live(&args.second) {
        let reached = args
            .of
            .reach(args.drive.as_deref().or(Some(&first.drive)), false)
            .await?;
        let dump = read_dump(&reached.live).await;
        reached.close().await;
        dump?
    } else {
        ParameterDump::read(&args.second)?
    };
    if first.model != second.model {
        let first = &first.model;
        let second = &second.model;
        return Err(CommandFailure::wrong(format!(
            "the models {first} and {second} differ: the files cannot be compared"
        )));
    }
    let differences = differences(&first, &second);
    if args.json {
        let all: Vec<_> = differences.iter().map(ParameterDifference::json).collect();
        return print(&format!(
            "{}\n",
            json!({ "model": first.model, "differences": all })
        ));
    }
    if differences.is_empty() {
        return print("nothing differs\n");
    }
    print(&table(differences.iter().map(ParameterDifference::row)))
}

fn write_new(path: &Path, text: &str) -> Result<(), CommandFailure> {
    let file = std::fs::OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(path);
    let written = file.and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|error| CommandFailure::failed(format!("{}: {error}", path.display())))
}
