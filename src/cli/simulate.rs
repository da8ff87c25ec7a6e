//! `simulate`: drives on a pseudo-terminal, for people who have no hardware at hand.

use super::{Failure, input, print};
use crate::daemon::pty::Pty;
use crate::daemon::{run::told_to_end, simulator};
use crate::domain::ids::Station;
use crate::domain::link::{LinkSettings, Parity};
use crate::domain::time::MonoTime;
use crate::profile::model::Model;
use crate::sim::{BadRequest, BusOptions, DriveOptions, FaultPlan, Pacing, SimBus, SimDrive};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Cause number of the trips. Any will do: what the numbers mean is not known for every model.
const TRIP_CAUSE: u16 = 1;

/// Arguments of `simulate`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model of the drives; `models` lists them
    #[arg(long)]
    model: String,
    /// Station of a drive; repeat it for several drives
    #[arg(long = "station", value_name = "N", default_values_t = [1])]
    stations: Vec<u8>,
    /// A name for the pseudo-terminal, made as a symbolic link
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
    /// Speed in bit/s; default: the model's factory setting
    #[arg(long)]
    baud: Option<u32>,
    /// Parity; default: the model's factory setting
    #[arg(long, value_enum)]
    parity: Option<ParityArg>,
    /// Stop bits; default: the model's factory setting
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=2))]
    stop_bits: Option<u8>,
    /// Milliseconds that the drives take from the end of a request to the start of the reply
    #[arg(long, value_name = "MS", default_value_t = 2)]
    turnaround_ms: u64,
    /// What goes wrong, per mille of all replies: noise=5,lost=2,late=3,cut=1,flip=2,foreign=1
    #[arg(long, value_name = "PLAN", default_value = "")]
    faults: FaultPlan,
    /// Seed of the faults: the same seed gives the same faults
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trip every drive each so many seconds; the trip count and the newest record show it
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..))]
    trip_every: Option<u64>,
    /// Answer at once, without character times
    #[arg(long)]
    unpaced: bool,
    /// Answer requests that the drive cannot serve with an exception, also where the model lists none
    #[arg(long)]
    exceptions: bool,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum ParityArg {
    None,
    Even,
    Odd,
}

/// Plays the drives until SIGINT or SIGTERM.
pub fn simulate(args: &Args) -> Result<(), Failure> {
    let model = input::model(&args.model)?;
    let stations = model.link.stations.value.clone();
    if let Some(wrong) = args.stations.iter().find(|station| !stations.contains(station)) {
        let (first, last) = (stations.start(), stations.end());
        return Err(Failure::wrong(format!("station {wrong} is outside {first} to {last} of {}", model.id)));
    }
    if let Some(twice) =
        args.stations.iter().enumerate().find_map(|(at, n)| args.stations[..at].contains(n).then_some(n))
    {
        return Err(Failure::wrong(format!("station {twice} is named twice")));
    }
    let mut pty = Pty::new().map_err(Failure::failed)?;
    if let Some(link) = &args.link {
        pty.link_as(link).map_err(|error| Failure::failed(format!("{}: {error}", link.display())))?;
    }
    let link = link_of(args, &model);
    let mut bus = bus_of(args, &model, link);
    let announcement = format!(
        "{} at {} on {}, station{} {}\n",
        model.id,
        link,
        args.link.as_deref().unwrap_or(pty.path()).display(),
        if args.stations.len() == 1 { "" } else { "s" },
        args.stations.iter().map(u8::to_string).collect::<Vec<_>>().join(", ")
    );
    play_until_told(&pty, &mut bus, &announcement, args.trip_every.map(Duration::from_secs))
}

fn link_of(args: &Args, model: &Model) -> LinkSettings {
    let factory = model.link.default.value;
    LinkSettings {
        baud: args.baud.unwrap_or(factory.baud),
        data_bits: factory.data_bits,
        parity: args.parity.map_or(factory.parity, |parity| match parity {
            ParityArg::None => Parity::None,
            ParityArg::Even => Parity::Even,
            ParityArg::Odd => Parity::Odd,
        }),
        stop_bits: args.stop_bits.unwrap_or(factory.stop_bits),
    }
}

fn bus_of(args: &Args, model: &Arc<Model>, link: LinkSettings) -> SimBus {
    let options = BusOptions {
        pacing: if args.unpaced { Pacing::None } else { Pacing::CharacterTimes },
        turnaround: Duration::from_millis(args.turnaround_ms),
        silence: None,
        faults: args.faults,
    };
    let mut bus = SimBus::new(link, options, args.seed);
    for station in &args.stations {
        let bad_request = if args.exceptions { BadRequest::Exception } else { BadRequest::AsDocumented };
        let options = DriveOptions { bad_request, ..DriveOptions::default() };
        bus.connect(Station(*station), SimDrive::new(Arc::clone(model), options));
    }
    bus
}

fn play_until_told(
    pty: &Pty,
    bus: &mut SimBus,
    announcement: &str,
    trip_every: Option<Duration>,
) -> Result<(), Failure> {
    let mut next_trip = None;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(Failure::failed)?;
    let told = {
        let _on_runtime = runtime.enter();
        told_to_end().map_err(Failure::failed)?
    };
    print(announcement)?;
    let trip = |bus: &mut SimBus, now| trip_when_due(bus, now, trip_every, &mut next_trip);
    simulator::play_beside(pty, bus, trip, || runtime.block_on(told)).map_err(Failure::failed)?;
    let report = bus.report();
    tracing::info!(requests = report.requests_heard, replies = report.replies_sent, "simulation ended");
    Ok(())
}

/// Trips every drive once `every` has passed since the last time, or since the start.
fn trip_when_due(bus: &mut SimBus, now: MonoTime, every: Option<Duration>, next: &mut Option<MonoTime>) {
    let Some(every) = every else { return };
    let due = *next.get_or_insert(now + every);
    if now < due {
        return;
    }
    *next = Some(due + every);
    for station in bus.stations().collect::<Vec<_>>() {
        if let Some(drive) = bus.drive_mut(station) {
            drive.trip(now, TRIP_CAUSE);
        }
    }
}
