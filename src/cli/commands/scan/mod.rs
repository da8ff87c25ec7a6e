//! `scan`: finds drives on an unused line, names their models if it can tell, and prints a configuration to start from.
//! It only reads.

#[cfg(test)]
mod confusion_tests;
mod report;
#[cfg(test)]
mod tests;

use crate::cli::tools::link_args::LinkArgs;
use crate::cli::tools::own_models::ModelDirs;
use crate::cli::tools::progress::seconds;
use crate::cli::tools::scanning::{ScanOutcome, scanned};
use crate::cli::tools::{CommandFailure, input, log::complain, print};
use crate::config;
use crate::daemon::host::clock;
use crate::daemon::lines::tool_line::ToolPort;
use crate::daemon::scan::ADVICE;
use crate::daemon::scan::plan::{self, ScanOptions, ScanPlan, setting_text};
use crate::domain::calendar;
use crate::domain::link::LinkSettings;
use report::ScanReport;
use std::path::PathBuf;
use std::time::Duration;

/// Arguments of `scan`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The line: a serial port such as /dev/ttyUSB0, or a serial device server such as tcp://10.0.0.7:4001
    #[arg(long, value_name = "PORT", value_parser = config::serial_port_address)]
    port: config::PortAddress,
    /// Stations to ask, such as 1-32 or 1,3,7-9
    #[arg(long, value_name = "NUMBERS", default_value = "1-32", value_parser = parsed_stations)]
    stations: StationList,
    /// Try every speed, parity and number of stop bits that a drive can be set to, not only factory settings, or a usual one where a
    /// model has no known factory setting. Takes long;
    /// the expected time is printed first
    #[arg(long)]
    all_settings: bool,
    /// Try these speeds only, in bit/s, such as 9600,19200
    #[arg(long, value_name = "BAUDS", value_delimiter = ',', value_parser = clap::value_parser!(u32).range(300..=1_000_000))]
    baud: Vec<u32>,
    #[command(flatten)]
    link: LinkArgs,
    /// Use Modbus ASCII frames instead of RTU
    #[arg(long)]
    ascii: bool,
    /// Reply time-out in seconds; default: what the models need
    #[arg(long, value_name = "SECONDS", value_parser = patience)]
    seconds_per_station: Option<Duration>,
    /// Only print what would be tried and how long it takes
    #[arg(long)]
    dry_run: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Write the configuration to this file instead of printing it; never overwrites a file
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    own: ModelDirs,
}

#[derive(Clone, Debug)]
struct StationList(Vec<u8>);

fn parsed_stations(text: &str) -> Result<StationList, String> {
    plan::stations(text).map(StationList)
}

fn patience(text: &str) -> Result<Duration, String> {
    let seconds = text
        .parse::<f64>()
        .ok()
        .filter(|seconds| (0.02..=10.0).contains(seconds));
    seconds
        .map(Duration::from_secs_f64)
        .ok_or_else(|| format!("{text} is not a time from 0.02 to 10 seconds"))
}

/// Looks for drives until everything was tried, or Ctrl-C. What was found by then is printed either way.
pub fn scan(args: &Args) -> Result<(), CommandFailure> {
    let catalog = input::catalog_with(&args.own)?;
    let models: Vec<_> = catalog
        .ids()
        .filter_map(|id| catalog.find(id).cloned())
        .collect();
    let is_network = matches!(args.port, config::PortAddress::Tcp { .. });
    let wish = ScanOptions {
        everything: args.all_settings,
        bauds: args.baud.clone(),
        parity: args.link.parity(),
        stop_bits: args.link.stop_bits,
        is_ascii: args.ascii,
        is_network,
        timeout: args.seconds_per_station,
    };
    may_be_wanted(args, is_network)?;
    let plan = ScanPlan::new(&models, args.stations.0.clone(), &wish);
    if plan.settings.is_empty() {
        return Err(CommandFailure::wrong(
            "no model has such settings: nothing to try",
        ));
    }
    complain(announcement(args, &plan).as_bytes());
    if args.dry_run {
        return Ok(());
    }
    let link = plan
        .settings
        .first()
        .map_or(LinkSettings::DEFAULT, |setting| setting.link);
    let port = ToolPort {
        address: args.port.clone(),
        link,
        direction: args.link.direction(),
    };
    let ScanOutcome {
        findings,
        ended,
        echoes,
        late,
    } = scanned(&plan, port)?;
    if ended.is_err() && findings.drives.is_empty() {
        return ended;
    }
    let date = calendar::day(clock::wall());
    let scan = ScanReport {
        port: &args.port,
        plan: &plan,
        findings: &findings,
        echoes,
        date: &date,
    };
    print_results(args, &scan, late)?;
    ended?;
    match (findings.is_complete, findings.drives.is_empty()) {
        (false, _) => Err(CommandFailure::failed(
            "interrupted before everything was tried; found so far",
        )),
        (true, true) => Err(CommandFailure::failed(ADVICE)),
        (true, false) => Ok(()),
    }
}

/// What can be said against the arguments before anything is tried.
fn may_be_wanted(args: &Args, is_network: bool) -> Result<(), CommandFailure> {
    if is_network && (args.all_settings || !args.baud.is_empty() || args.link.is_given()) {
        return Err(CommandFailure::wrong(
            "a serial device server sets the line itself: set it there, and scan without settings",
        ));
    }
    if let Some(out) = args.out.as_deref().filter(|out| out.exists()) {
        return Err(CommandFailure::wrong(format!(
            "{} already exists and is not overwritten",
            out.display()
        )));
    }
    Ok(())
}

/// Prints the results where they belong.
fn print_results(args: &Args, scan: &ScanReport<'_>, late: u64) -> Result<(), CommandFailure> {
    if late > 0 {
        let hint = "ask again with a longer --seconds-per-station";
        complain(format!("{late} frames arrived too late to count: {hint}\n").as_bytes());
    }
    let configuration = scan.configuration();
    if let (Some(out), Some(text)) = (&args.out, &configuration) {
        write_new(out, text)?;
        complain(format!("the configuration is in {}\n", out.display()).as_bytes());
    }
    if args.json {
        return print(&format!("{}\n", scan.json()));
    }
    complain(scan.table().as_bytes());
    match configuration {
        Some(text) if args.out.is_none() => print(&text),
        _ => Ok(()),
    }
}

fn write_new(path: &std::path::Path, text: &str) -> Result<(), CommandFailure> {
    use std::io::Write;
    let file = std::fs::OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(path);
    let written = file.and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|error| CommandFailure::failed(format!("{}: {error}", path.display())))
}

fn announcement(args: &Args, plan: &ScanPlan) -> String {
    let (silent, additional) = plan.duration();
    let settings: Vec<_> = plan.settings.iter().map(setting_text).collect();
    let settings = match args.port {
        config::PortAddress::Tcp { .. } | config::PortAddress::ModbusTcp { .. } => {
            "with the setting of the device server".to_owned()
        }
        config::PortAddress::Device(_) => format!("at {}", settings.join(", ")),
    };
    let stations = plan.stations.len();
    format!(
        "{}: {stations} station{} {settings}; about {} if no drive answers, up to {} more if all do. Only reads\n",
        args.port,
        if stations == 1 { "" } else { "s" },
        seconds(silent),
        seconds(additional),
    )
}
