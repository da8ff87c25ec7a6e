//! A gateway for one tool and one drive, in the tool's own process and for as long as the tool runs: the same lines and the
//! same guard as in a running gateway, so that the same rules apply directly on a port. It opens no network port: the tool
//! commands it over a pair of sockets, and its local socket is in a directory that only its owner may enter.

use super::CommandFailure;
use super::input;
use super::link_args::LinkArgs;
use super::own_models::ModelDirs;
use crate::config::PortAddress;
use crate::daemon::exchange::shared::CurrentPlant;
use crate::daemon::http::socket::SOCKET_NAME;
use crate::daemon::lines::tool_line::ToolPort;
use crate::daemon::service::run;
use crate::daemon::service::start_error::StartError;
use crate::domain::control::ControlAction;
use crate::domain::ids::Name;
use crate::domain::link::{Framing, LinkSettings};
use crate::domain::report::LineReport;
use crate::drive::snapshot::DrivePresence;
use crate::profile::catalog::Catalog;
use crate::profile::model::{FactorySetting, Model};
use crate::toml_file::words::{PARITIES, word_for};
use serde_json::json;
use std::fmt::Write;
use std::os::unix::fs::DirBuilderExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::sync::{mpsc, oneshot};
use tokio::time::{Instant, sleep};

/// Longest time until all listeners are open.
const STARTS_WITHIN: Duration = Duration::from_secs(10);
/// Longest time until the drive has answered for the first time.
const ANSWERS_WITHIN: Duration = Duration::from_secs(8);
/// The interval at which this is checked.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// Units of the drive on Modbus TCP: its own registers, and the uniform ones.
pub const UNIT: u8 = 1;
/// See [`UNIT`].
pub const UNIFORM_UNIT: u8 = 101;

/// Which drive is on the port, and how the line is set.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct DriveArgs {
    /// Model of the drive on the port; `models` lists them
    #[arg(long, value_name = "MODEL")]
    model: Option<String>,
    /// Station of the drive on the port
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=247))]
    station: Option<u8>,
    /// Speed of the line in bit/s; default: as the model leaves the factory, if that is known
    #[arg(long)]
    baud: Option<u32>,
    #[command(flatten)]
    link: LinkArgs,
    /// Frames of text (Modbus ASCII) instead of binary ones
    #[arg(long)]
    ascii: bool,
    /// The output frequency that stands for 100 % at the drive, for models whose values are fractions of it
    #[arg(long, value_name = "HZ")]
    full_scale_hz: Option<f64>,
    /// The adapter sends back what is sent
    #[arg(long)]
    echo: bool,
    #[command(flatten)]
    own: ModelDirs,
}

impl DriveArgs {
    /// The drive of `model` at `station` of a line that is set to `link`.
    #[must_use]
    pub fn of(model: &str, station: u8, link: LinkSettings, own: ModelDirs) -> Self {
        Self {
            model: Some(model.to_owned()),
            station: Some(station),
            baud: Some(link.baud),
            link: LinkArgs::of(link),
            own,
            ..Self::default()
        }
    }

    /// The station of the drive, if one is given.
    #[must_use]
    pub const fn station(&self) -> Option<u8> {
        self.station
    }

    /// The model of the drive.
    ///
    /// # Errors
    /// None is given, or there is none of this name.
    pub fn model(&self) -> Result<Arc<Model>, CommandFailure> {
        let id = self
            .model
            .as_deref()
            .ok_or_else(|| CommandFailure::wrong("directly on a port, --model is needed"))?;
        input::model(id, &self.own)
    }

    /// The known models, with those in the given directories.
    ///
    /// # Errors
    /// Problems of their files, and what cannot be read.
    pub fn catalog(&self) -> Result<Catalog, CommandFailure> {
        input::catalog_with(&self.own)
    }
}

/// What the tool may do with the drive, and how often it is read.
#[derive(Clone, Debug, Default)]
pub struct ToolAccess {
    /// The control section, without its head; `None`: nothing may be written.
    pub control: String,
    /// The tool may start the motor, or change its setpoint.
    pub moves: bool,
    /// Unproven facts that the person accepts.
    pub accept_unverified: Vec<String>,
    /// Registers that may be written.
    pub native_write: Vec<u16>,
    /// How often the drive is polled; `None`: once.
    pub poll: Option<Duration>,
}

impl ToolAccess {
    /// A control section under which nothing ever moves, but parameters may be set at standstill.
    #[must_use]
    pub fn control_at_rest() -> String {
        control((1.0, 1.0), "forward", "hold")
    }
}

/// The text of a control section: limits in hertz, one direction, and what happens when the tool exits on purpose. If a
/// tool is lost, the drive is stopped.
#[must_use]
pub fn control(limits_hz: (f64, f64), direction: &str, on_shutdown: &str) -> String {
    let (least, most) = limits_hz;
    format!(
        "from = [\"modbus-tcp\"]\nfrequency_hz = {{ min = {least:?}, max = {most:?} }}\ndirections = [\"{direction}\"]\n\
         on_commander_lost = \"stop\"\nlost_after = \"5s\"\non_shutdown = \"{on_shutdown}\"\n"
    )
}

/// A gateway that exits with its tool.
#[derive(Debug)]
pub struct OwnGateway {
    directory: PrivateDirectory,
    connections: mpsc::Sender<UnixStream>,
    drive: Name,
    station: u8,
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<Result<(), StartError>>>,
}

/// A directory that only its owner may enter, removed on drop.
#[derive(Debug)]
pub struct PrivateDirectory(PathBuf);

impl PrivateDirectory {
    /// A new, empty directory.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn new() -> Result<Self, CommandFailure> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let of_session = std::env::var_os("XDG_RUNTIME_DIR")
            .map(PathBuf::from)
            .filter(|dir| dir.is_dir());
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("vfd-gateway-tool-{}-{number}", std::process::id());
        let path = of_session.unwrap_or_else(std::env::temp_dir).join(name);
        let made = std::fs::DirBuilder::new().mode(0o700).create(&path);
        made.map_err(|error| CommandFailure::failed(format!("{}: {error}", path.display())))?;
        Ok(Self(path))
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for PrivateDirectory {
    fn drop(&mut self) {
        // Leftovers do no harm.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

impl OwnGateway {
    /// Starts a gateway for the drive of `args` on `port`, and waits until it answers.
    ///
    /// # Errors
    /// The arguments do not go together, the port is in use (and by whom), or the drive does not answer.
    pub async fn start(
        port: &PortAddress,
        args: &DriveArgs,
        extra: &ToolAccess,
    ) -> Result<Self, CommandFailure> {
        let model = args.model()?;
        let station = args
            .station
            .ok_or_else(|| CommandFailure::wrong("directly on a port, --station is needed"))?;
        let directory = PrivateDirectory::new()?;
        let link = if port.is_serial_line() {
            link_of(args, &model)?
        } else {
            no_link_of(args)?
        };
        let text = text(port, args, link, station, &model, extra, &directory.0);
        let config = input::config_of(&text, &args.catalog()?)?;
        let line = config
            .lines
            .first()
            .ok_or_else(|| CommandFailure::failed("no line"))?;
        let drive = line
            .drives
            .first()
            .map_or_else(Name::fallback, |drive| drive.name.clone());
        let link = line.link;
        let tool_port = ToolPort {
            address: port.clone(),
            link,
            direction: line.direction,
        };
        tool_port.try_open("tool").await?;
        let (shows, shown) = oneshot::channel();
        let (end, ends) = oneshot::channel();
        let (connections, made) = mpsc::channel(1);
        let thread = std::thread::Builder::new()
            .name("gateway".to_owned())
            .spawn(move || {
                run::run_for_tool(
                    &config,
                    made,
                    async move |running: &run::RunningInfo<'_>| {
                        // The waiting task may have exited.
                        let _ = shows.send(running.shared.clone());
                        let _ = ends.await;
                    },
                )
            });
        let thread = thread.map_err(CommandFailure::failed)?;
        let started = tokio::time::timeout(STARTS_WITHIN, shown).await;
        let Ok(Ok(current)) = started else {
            return Err(CommandFailure::failed(why_not_started(thread)));
        };
        let own = Self {
            directory,
            connections,
            drive,
            station,
            end: Some(end),
            thread: Some(thread),
        };
        if let Err(why) = answers(&current).await {
            own.close().await;
            let at = if port.is_serial_line() {
                format!(" at {link}")
            } else {
                String::new()
            };
            return Err(CommandFailure::failed(format!(
                "station {station} on {port}{at}: {why}"
            )));
        }
        Ok(own)
    }

    /// Its local socket.
    #[must_use]
    pub fn socket(&self) -> PathBuf {
        self.directory.0.join(SOCKET_NAME)
    }

    /// The path for connections of Modbus clients: one end of a pair of sockets for each.
    #[must_use]
    pub fn connections(&self) -> mpsc::Sender<UnixStream> {
        self.connections.clone()
    }

    /// The drive's name.
    #[must_use]
    pub fn drive(&self) -> Name {
        self.drive.clone()
    }

    /// The drive's station number.
    #[must_use]
    pub const fn station(&self) -> u8 {
        self.station
    }

    /// Shuts it down, with the action that is declared for that, and releases the port.
    pub async fn close(mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            // Its error, if any, is in the log.
            let _ = tokio::task::spawn_blocking(move || thread.join()).await;
        }
    }
}

/// Why the gateway of `thread` does not answer.
fn why_not_started(thread: JoinHandle<Result<(), StartError>>) -> String {
    let ended = thread
        .is_finished()
        .then(|| thread.join().ok())
        .flatten()
        .and_then(Result::err);
    ended.map_or_else(|| "it does not start".to_owned(), |error| error.to_string())
}

/// Waits until the drive has answered.
async fn answers(current: &CurrentPlant) -> Result<(), String> {
    let until = Instant::now() + ANSWERS_WITHIN;
    loop {
        let shared = current.get();
        let presence = shared
            .drives
            .first()
            .map(|drive| drive.view.load().snapshot.presence);
        if presence == Some(DrivePresence::Online) {
            return Ok(());
        }
        let report = shared.lines.first().map(|line| line.report());
        if presence == Some(DrivePresence::Offline) || Instant::now() >= until {
            let down = report.as_ref().and_then(LineReport::down_reason);
            let why = down.or_else(|| Some(report?.suspicion?.to_string()));
            return Err(format!(
                "no answer{}",
                why.map(|why| format!(": {why}")).unwrap_or_default()
            ));
        }
        sleep(LOOK_EVERY).await;
    }
}

/// The settings of the line: as given, else as the model leaves the factory.
fn link_of(args: &DriveArgs, model: &Model) -> Result<LinkSettings, CommandFailure> {
    let framing = if args.ascii {
        Framing::Ascii
    } else {
        Framing::Rtu
    };
    let factory = model.link.factory_with(framing);
    let (given, of) = (
        (args.baud, args.link.parity(), args.link.stop_bits),
        |part: &str| {
            let why = match &model.link.default.value {
                FactorySetting::Ask(text) => {
                    format!("the factory setting of {} is not known: {text}", model.id)
                }
                FactorySetting::Set(settings) => format!(
                    "the factory setting of {} is ASCII frames at {settings}",
                    model.id
                ),
            };
            CommandFailure::wrong(format!("{part} is needed; {why}"))
        },
    );
    Ok(LinkSettings {
        baud: given
            .0
            .or(factory.map(|it| it.baud))
            .ok_or_else(|| of("--baud"))?,
        parity: given
            .1
            .or(factory.map(|it| it.parity))
            .ok_or_else(|| of("--parity"))?,
        stop_bits: given
            .2
            .or(factory.map(|it| it.stop_bits))
            .ok_or_else(|| of("--stop-bits"))?,
        data_bits: factory.map_or(8, |it| it.data_bits),
    })
}

/// Over Modbus TCP there are no settings of a line.
fn no_link_of(args: &DriveArgs) -> Result<LinkSettings, CommandFailure> {
    if args.baud.is_some() || args.link.is_given() || args.ascii || args.echo {
        return Err(CommandFailure::wrong(
            "Modbus TCP has no speed, characters or echo: leave these options out",
        ));
    }
    Ok(LinkSettings::DEFAULT)
}

/// The configuration of a gateway for one drive.
fn text(
    port: &PortAddress,
    args: &DriveArgs,
    link: LinkSettings,
    station: u8,
    model: &Model,
    extra: &ToolAccess,
    data_dir: &Path,
) -> String {
    let mut text = format!(
        "[gateway]\nname = \"tool\"\ndata_dir = {}\n\n[[line]]\nname = \"tool\"\nport = {}\n",
        json!(data_dir.display().to_string()),
        json!(port.to_string()),
    );
    if port.is_serial_line() {
        let LinkSettings {
            baud, stop_bits, ..
        } = link;
        let parity = word_for(&PARITIES, &link.parity);
        let _ = writeln!(
            text,
            "baud = {baud}\nparity = \"{parity}\"\nstop_bits = {stop_bits}"
        );
    }
    if matches!(port, PortAddress::Device(_)) {
        let _ = writeln!(text, "rs485 = \"{}\"", args.link.direction_word());
    }
    if args.ascii {
        let _ = writeln!(text, "framing = \"ascii\"\ndata_bits = {}", link.data_bits);
    }
    if args.echo {
        text.push_str("echo = \"strip\"\n");
    }
    let poll = extra.poll.unwrap_or(Duration::from_secs(3600)).as_millis();
    let _ = write!(
        text,
        "\n[[line.drive]]\nname = \"station-{station}\"\nmodel = \"{}\"\nstation = {station}\nunit = {UNIT}\n\
         uniform_unit = {UNIFORM_UNIT}\npoll = \"{poll}ms\"\n",
        model.id
    );
    if let Some(full_scale_hz) = args.full_scale_hz {
        let _ = writeln!(text, "full_scale_hz = {full_scale_hz:?}");
    }
    let mut write = "";
    if !extra.control.is_empty() {
        let _ = write!(text, "\n[line.drive.control]\n{}", extra.control);
        let _ = writeln!(
            text,
            "accept_unverified = {}",
            json!(accepted(model, extra))
        );
        write = "write = [\"127.0.0.1/32\"]\n";
    }
    if !extra.native_write.is_empty() {
        let registers: Vec<_> = extra
            .native_write
            .iter()
            .map(|address| format!("0x{address:04X}"))
            .collect();
        let _ = write!(
            text,
            "\n[line.drive.native]\nwrite = {}\n",
            json!(registers)
        );
    }
    // No server listens there: the section grants the tool its rights.
    let _ = write!(text, "\n[[modbus_tcp]]\nlisten = \"127.0.0.1:0\"\n{write}");
    text
}

/// The accepted unproven facts: those that the user names. If nothing can be moved, the facts that a stop rests on need
/// not be named.
fn accepted(model: &Model, extra: &ToolAccess) -> Vec<String> {
    let basic = ControlAction::Basic.keyword();
    let needs_no_naming = !extra.moves && !model.unproven_basics().is_empty();
    let mut words = extra.accept_unverified.clone();
    if needs_no_naming && !words.iter().any(|word| word == basic) {
        words.push(basic.to_owned());
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_model_has_a_gateway_that_reads_and_one_that_commands() {
        let catalog = crate::vendors::catalog();
        let port = PortAddress::Device(PathBuf::from("/dev/ttyUSB0"));
        for model in catalog.ids().map(|id| catalog.find(id).unwrap()) {
            let commands = control((5.0, 50.0), "forward", "stop");
            let basic = ControlAction::Basic.keyword().to_owned();
            let unproven = if model.unproven_basics().is_empty() {
                Vec::new()
            } else {
                vec![basic]
            };
            let ways = [
                (String::new(), false),
                (ToolAccess::control_at_rest(), false),
                (commands, true),
            ];
            let full_scale_hz = model.needs_full_scale().then_some(50.0);
            let args = DriveArgs {
                full_scale_hz,
                ..DriveArgs::default()
            };
            for (control, moves) in ways
                .into_iter()
                .take(if model.run.is_none() { 1 } else { 3 })
            {
                let poll = (!control.is_empty()).then_some(Duration::from_millis(500));
                let accept_unverified = if moves { unproven.clone() } else { Vec::new() };
                let extra = ToolAccess {
                    control,
                    moves,
                    accept_unverified,
                    poll,
                    native_write: Vec::new(),
                };
                let text = text(
                    &port,
                    &args,
                    model.link.played(),
                    1,
                    model,
                    &extra,
                    Path::new("/run/x"),
                );
                if let Err(failure) = input::config_of(&text, &catalog) {
                    panic!("{}: {failure}\n{text}", model.id);
                }
            }
        }
    }
}
