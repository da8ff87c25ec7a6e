//! `simulate`: drives on a pseudo-terminal or a TCP port, for users without hardware.

use crate::cli::tools::keyboard::EnterPresses;
use crate::cli::tools::own_models::ModelDirs;
use crate::cli::tools::{CommandFailure, input, print};
use crate::daemon::host::pty::Pty;
use crate::daemon::lines::simulated_end::{AtSpeed, LineEnd, TcpEnd};
use crate::daemon::lines::simulator;
use crate::daemon::service::signals::told_to_end;
use crate::domain::ids::Station;
use crate::domain::link::{Framing, LinkSettings, Parity};
use crate::domain::time::MonoTime;
use crate::profile::model::{FactorySetting, Model};
use crate::sim::{BadRequest, BusOptions, BusPacing, DriveOptions, FaultPlan, SimBus, SimDrive};
use crate::toml_file::words::{FRAMINGS, word_for};
use std::fmt::Display;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Cause number of the trips. Any number will do: its meaning is not known for every model.
const TRIP_CAUSE: u16 = 1;

/// Arguments of `simulate`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model of the drives; `models` lists them
    #[arg(long)]
    model: String,
    #[command(flatten)]
    own: ModelDirs,
    /// Station of a drive; repeat it for several drives
    #[arg(long = "station", value_name = "N", default_values_t = [1])]
    stations: Vec<u8>,
    /// Create a symbolic link to the pseudo-terminal at this path
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
    /// Listen on this address instead, like a serial device server
    #[arg(long, value_name = "ADDRESS", conflicts_with = "link")]
    tcp: Option<SocketAddr>,
    /// Speed in bit/s; default: the model's factory setting; if none is known, 9600, or the first that it lists
    #[arg(long)]
    baud: Option<u32>,
    /// Parity; default: the model's factory setting; if none is known, none, or the first that it lists
    #[arg(long, value_enum)]
    parity: Option<SimParityArg>,
    /// Stop bits; default: the model's factory setting; if none is known, 1, or the first that it lists
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=2))]
    stop_bits: Option<u8>,
    /// Framing; the model must support RTU or ASCII. modbus-tcp needs --tcp and plays each drive as a unit of a server
    #[arg(long, value_enum, default_value_t = FramingArg::Rtu)]
    framing: FramingArg,
    /// Data bits, 7 with ASCII framing only; default: the model's factory setting
    #[arg(long, value_parser = clap::value_parser!(u8).range(7..=8))]
    data_bits: Option<u8>,
    /// Time in milliseconds from the end of a request to the start of the reply
    #[arg(long, value_name = "MS", default_value_t = 2)]
    turnaround_ms: u64,
    /// Faults, in per mille of all replies: noise=5,lost=2,late=3,cut=1,flip=2,foreign=1,burst=1
    #[arg(long, value_name = "PLAN", default_value = "")]
    faults: FaultPlan,
    /// Seed of the faults; the same seed gives the same faults
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trip every drive at this interval in seconds; the trip count and the newest record show it
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..))]
    trip_every: Option<u64>,
    /// Trip every drive whenever Enter is pressed
    #[arg(long)]
    trip_on_enter: bool,
    /// Answer immediately, without character times
    #[arg(long)]
    unpaced: bool,
    /// Value of the registers that select the command source; default: the value under which drives obey the line
    #[arg(long, value_name = "WORD")]
    sources: Option<u16>,
    /// Answer unsupported requests with an exception, even where the model lists none
    #[arg(long)]
    exceptions: bool,
    /// Accept only what is sent at the drives' own speed and stop bits, as on a real line. A pseudo-terminal has no parity
    #[arg(long, conflicts_with = "tcp")]
    strict: bool,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum SimParityArg {
    None,
    Even,
    Odd,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum FramingArg {
    Rtu,
    Ascii,
    ModbusTcp,
}

/// Simulates the drives until SIGINT or SIGTERM.
pub fn simulate(args: &Args) -> Result<(), CommandFailure> {
    let model = input::model(&args.model, &args.own)?;
    let framing = framing_of(args)?;
    let link = link_of(args, &model, framing)?;
    check_stations(&args.stations, &model)?;
    let trips = TripSchedule::of(args)?;
    let mut bus = bus_of(args, &Arc::new(model.on(framing)), framing, link);
    let announcement = |place: &dyn Display| {
        format!(
            "{}{}{} on {place}, station{} {}\n",
            assumed(args, &model),
            model.id,
            match framing {
                Framing::Rtu => format!(" at {link}"),
                Framing::Ascii => format!(" at {link} ascii"),
                Framing::Mbap => String::new(),
            },
            if args.stations.len() == 1 { "" } else { "s" },
            args.stations
                .iter()
                .map(u8::to_string)
                .collect::<Vec<_>>()
                .join(", ")
        )
    };
    if let Some(address) = args.tcp {
        let end = TcpEnd::listen(address)
            .map_err(|error| CommandFailure::failed(format!("{address}: {error}")))?;
        let scheme = if framing == Framing::Mbap {
            "modbus-tcp"
        } else {
            "tcp"
        };
        let place = format!(
            "{scheme}://{}",
            end.address().map_err(CommandFailure::failed)?
        );
        return play_until_told(end, &mut bus, &announcement(&place), trips);
    }
    let mut pty = Pty::new().map_err(CommandFailure::failed)?;
    if let Some(link) = &args.link {
        pty.link_as(link)
            .map_err(|error| CommandFailure::failed(format!("{}: {error}", link.display())))?;
    }
    let place = args.link.as_deref().unwrap_or(pty.path()).display();
    let announcement = announcement(&place);
    if args.strict {
        let line = AtSpeed {
            pty: &pty,
            baud: link.baud,
            stop_bits: link.stop_bits,
        };
        return play_until_told(line, &mut bus, &announcement, trips);
    }
    play_until_told(&pty, &mut bus, &announcement, trips)
}

fn framing_of(args: &Args) -> Result<Framing, CommandFailure> {
    let framing = match args.framing {
        FramingArg::Rtu => Framing::Rtu,
        FramingArg::Ascii => Framing::Ascii,
        FramingArg::ModbusTcp => Framing::Mbap,
    };
    if framing == Framing::Mbap && args.tcp.is_none() {
        return Err(CommandFailure::wrong(
            "Modbus TCP needs an address to listen on: add `--tcp 127.0.0.1:1502`",
        ));
    }
    Ok(framing)
}

/// A drive of `model` can have each of `stations`, and none is named twice.
fn check_stations(stations: &[u8], model: &Model) -> Result<(), CommandFailure> {
    let possible = &model.link.stations.value;
    if let Some(wrong) = stations.iter().find(|station| !possible.contains(station)) {
        let first = possible.start();
        let last = possible.end();
        return Err(CommandFailure::wrong(format!(
            "station {wrong} is outside {first} to {last} of {}",
            model.id
        )));
    }
    if let Some(twice) = stations
        .iter()
        .enumerate()
        .find_map(|(at, n)| stations[..at].contains(n).then_some(n))
    {
        return Err(CommandFailure::wrong(format!(
            "station {twice} is given twice"
        )));
    }
    Ok(())
}

/// The settings of the line, if a drive of `model` supports its framing and data bits.
fn link_of(args: &Args, model: &Model, framing: Framing) -> Result<LinkSettings, CommandFailure> {
    if !framing.has_characters() {
        return Ok(LinkSettings::DEFAULT);
    }
    let factory = model.link.played();
    let data_bits = args.data_bits.unwrap_or(factory.data_bits);
    if !model.link.framings.value.contains(&framing) {
        let has: Vec<_> = model
            .link
            .framings
            .value
            .iter()
            .map(|framing| word_for(&FRAMINGS, framing))
            .collect();
        let what = format!(
            "{} has no framing {}, only {}",
            model.id,
            word_for(&FRAMINGS, &framing),
            has.join(", ")
        );
        return Err(CommandFailure::wrong(what));
    }
    if framing == Framing::Rtu && data_bits != 8 && args.data_bits.is_none() {
        return Err(CommandFailure::wrong(format!(
            "the factory setting of {} is ASCII frames at {factory}: add `--framing ascii`; or, if \
             it was set to RTU by hand, `--data-bits 8` with `--parity` and `--stop-bits`",
            model.id
        )));
    }
    if framing == Framing::Rtu && data_bits != 8 {
        return Err(CommandFailure::wrong(
            "RTU frames need 8 data bits; 7 go with `--framing ascii`",
        ));
    }
    if !model.link.data_bits.value.contains(&data_bits) {
        return Err(CommandFailure::wrong(format!(
            "{} cannot be set to {data_bits} data bits",
            model.id
        )));
    }
    Ok(LinkSettings {
        baud: args.baud.unwrap_or(factory.baud),
        data_bits,
        parity: args.parity.map_or(factory.parity, |parity| match parity {
            SimParityArg::None => Parity::None,
            SimParityArg::Even => Parity::Even,
            SimParityArg::Odd => Parity::Odd,
        }),
        stop_bits: args.stop_bits.unwrap_or(factory.stop_bits),
    })
}

/// What is said first where a setting was chosen that no document gives.
fn assumed(args: &Args, model: &Model) -> String {
    let all_given = args.framing == FramingArg::ModbusTcp
        || args.baud.is_some() && args.parity.is_some() && args.stop_bits.is_some();
    match &model.link.default.value {
        FactorySetting::Ask(text) if !all_given => format!(
            "the factory setting of {} is not known ({text}); without --baud, --parity and \
             --stop-bits, usual settings are used\n",
            model.id
        ),
        _ => String::new(),
    }
}

fn bus_of(args: &Args, model: &Arc<Model>, framing: Framing, link: LinkSettings) -> SimBus {
    let options = BusOptions {
        framing,
        pacing: if args.unpaced || !framing.has_characters() {
            BusPacing::None
        } else {
            BusPacing::CharacterTimes
        },
        turnaround: Duration::from_millis(args.turnaround_ms),
        faults: args.faults,
        ..BusOptions::default()
    };
    let mut bus = SimBus::new(link, options, args.seed);
    for station in &args.stations {
        let bad_request = if args.exceptions {
            BadRequest::Exception
        } else {
            BadRequest::AsDocumented
        };
        let options = DriveOptions {
            bad_request,
            sources_at_start: args.sources,
            ..DriveOptions::default()
        };
        bus.connect(Station(*station), SimDrive::new(Arc::clone(model), options));
    }
    bus
}

fn play_until_told(
    line: impl LineEnd + Send,
    bus: &mut SimBus,
    announcement: &str,
    mut trips: TripSchedule,
) -> Result<(), CommandFailure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    let stop_signal = {
        let _on_runtime = runtime.enter();
        told_to_end().map_err(CommandFailure::failed)?
    };
    print(announcement)?;
    let trip = |bus: &mut SimBus, now| trips.trip_if_due(bus, now);
    simulator::play_beside(line, bus, trip, || runtime.block_on(stop_signal))
        .map_err(CommandFailure::failed)?;
    let report = bus.report();
    tracing::info!(
        requests = report.requests_heard,
        replies = report.replies_sent,
        "simulation ended"
    );
    Ok(())
}

/// When the drives trip.
struct TripSchedule {
    every: Option<Duration>,
    next: Option<MonoTime>,
    enter: Option<EnterPresses>,
}

impl TripSchedule {
    fn of(args: &Args) -> Result<Self, CommandFailure> {
        Ok(Self {
            every: args.trip_every.map(Duration::from_secs),
            next: None,
            enter: if args.trip_on_enter {
                Some(EnterPresses::listen().map_err(CommandFailure::failed)?)
            } else {
                None
            },
        })
    }

    /// Trips every drive if Enter was pressed, or the interval has passed since the last trip or since the start.
    fn trip_if_due(&mut self, bus: &mut SimBus, now: MonoTime) {
        let is_due = self.is_due(now);
        let was_pressed = self.enter.as_ref().is_some_and(EnterPresses::was_pressed);
        if !is_due && !was_pressed {
            return;
        }
        for station in bus.stations().collect::<Vec<_>>() {
            if let Some(drive) = bus.drive_mut(station) {
                drive.trip(now, TRIP_CAUSE);
            }
        }
    }

    fn is_due(&mut self, now: MonoTime) -> bool {
        let Some(every) = self.every else {
            return false;
        };
        let due = *self.next.get_or_insert(now + every);
        let is_due = now >= due;
        if is_due {
            self.next = Some(due + every);
        }
        is_due
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    fn settings(words: &str) -> Result<String, String> {
        let args = Line::parse_from(words.split(' ')).args;
        let model =
            input::model(&args.model, &args.own).unwrap_or_else(|failure| panic!("{failure}"));
        let framing = if matches!(args.framing, FramingArg::Ascii) {
            Framing::Ascii
        } else {
            Framing::Rtu
        };
        link_of(&args, &model, framing)
            .map(|link| link.to_string())
            .map_err(|failure| failure.to_string())
    }

    #[test]
    fn a_drive_with_ascii_frames_from_the_factory_says_what_to_add() {
        assert_eq!(
            settings("simulate --model delta-vfd-el --framing ascii"),
            Ok("9600 7N2".to_owned())
        );
        let error = settings("simulate --model delta-vfd-el").unwrap_err();
        assert!(
            error.contains("ASCII frames at 9600 7N2: add `--framing ascii`; or"),
            "{error}"
        );
        assert_eq!(
            settings("simulate --model delta-vfd-el --data-bits 8"),
            Ok("9600 8N2".to_owned())
        );
        let error = settings("simulate --model hyundai-n700 --data-bits 7").unwrap_err();
        assert!(error.contains("7 go with `--framing ascii`"), "{error}");
    }
}
