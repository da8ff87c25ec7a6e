//! `vfd-fleet`: many gateways on one broker, to find out how large it has to be. A separate program, so that the
//! gateway contains nothing of it.

mod books;
mod credentials;
mod plan;
mod play;
mod report;
mod specimen;

use clap::Parser;
use play::{Progress, Stage};
use std::path::PathBuf;
use std::process::ExitCode;
use vfd_gateway::cli::tools::own_models::ModelDirs;
use vfd_gateway::cli::tools::progress::ProgressBar;
use vfd_gateway::cli::tools::{CommandFailure, log, print};

/// The text of `--help` after the options.
const ABOUT: &str = "\
Every message carries a number, and consumers book what comes: at quality of service 1 nothing that the broker has \
acknowledged may be missing. An update that finds no room is left out when the next one is due, as a gateway does, so \
a broker that is too slow shows as a rate that is not held. Use a broker that is not needed otherwise, and a prefix of its own.

Examples:
  vfd-fleet --broker mqtt://127.0.0.1:1883 --gateways 1000 --drives 32
      a minute, 32,000 drives
  vfd-fleet --qos 1 --consumers 4 --reading shared --seconds 30
      consumers that share the work
  vfd-fleet --mqtt-version 4 --qos 1 --broker mqtt://n1:1883 --broker mqtt://n2:1883
      a cluster: stop a node meanwhile

Exit codes: 0 done, 1 not everybody was connected, or what was acknowledged is missing, 2 wrong usage";

/// Simulate many gateways on one broker: what it takes a second, how late messages come, and what is lost.
///
/// Each gateway has a connection of its own with the client, the topics and the document of the real one; consumers
/// check every message. It ends by itself and takes back what the broker keeps of it.
#[derive(Debug, Parser)]
#[command(name = "vfd-fleet", version, after_long_help = ABOUT)]
struct Args {
    /// Format of log lines on stderr
    #[arg(long, value_enum, default_value_t = log::LogFormat::Text)]
    log_format: log::LogFormat,
    /// The broker: mqtt://HOST:PORT or mqtts://HOST:PORT; repeat it for the nodes of a cluster, over which gateways spread
    #[arg(long = "broker", value_name = "URL", default_values_t = ["mqtt://127.0.0.1:1883".to_owned()])]
    brokers: Vec<String>,
    /// Where consumers connect, if elsewhere: behind a bridge, say; repeat it for several nodes
    #[arg(long = "consumer-broker", value_name = "URL")]
    consumer_brokers: Vec<String>,
    /// PEM file with the authorities to trust; default: those of the system
    #[arg(long, value_name = "FILE")]
    ca: Option<PathBuf>,
    /// File with a `user:password` on each line: every gateway is the user of its own name, gw-0001 and so on
    #[arg(long, value_name = "FILE")]
    credentials: Option<PathBuf>,
    /// Who the consumers are among the credentials
    #[arg(long, value_name = "USER", default_value = "historian")]
    consumer_user: String,
    /// Let passwords cross the network in plain view, with mqtt://
    #[arg(long)]
    allow_plain_password: bool,
    /// Version of MQTT
    #[arg(long, value_name = "4|5", default_value_t = 5, value_parser = clap::value_parser!(u8).range(4..=5))]
    mqtt_version: u8,
    /// First level of all topics; not that of a real plant
    #[arg(long, default_value = "vfd-fleet")]
    prefix: String,
    /// Gateways
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=60_000))]
    gateways: u32,
    /// Drives of each
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=100))]
    drives: u32,
    /// Model of the drives, whose document is published; default: the first that can be commanded
    #[arg(long, value_name = "MODEL")]
    model: Option<String>,
    #[command(flatten)]
    own: ModelDirs,
    /// What an update of a drive publishes
    #[arg(long, value_enum, default_value_t = UpdateArg::State)]
    update: UpdateArg,
    /// Updates of each drive in a second
    #[arg(long, value_name = "RATE", default_value_t = 1.0)]
    updates_per_second: f64,
    /// How long updates are sent
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=86_400))]
    seconds: u32,
    /// Longest time for what is on its way then
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(0..=3_600))]
    drain_seconds: u32,
    /// Quality of service of the updates; real gateways send values with 0, and trips and results that must not be lost with 1
    #[arg(long, value_name = "0|1", default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=1))]
    qos: u8,
    /// Do not have the broker keep the newest update of each drive
    #[arg(long)]
    no_retain: bool,
    /// Consumers; with quality of service 1 the broker keeps for them what comes while they are away
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=64))]
    consumers: u32,
    /// Who of several consumers gets what: each all, the broker deals it out ($share), or each its own gateways
    #[arg(long, value_enum, default_value_t = ReadingArg::All)]
    reading: ReadingArg,
    /// Gateways that connect in a second
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    connects_per_second: u32,
    /// Threads for the gateways; the consumers have one
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=64))]
    threads: u8,
    /// Tell what this process costs as well: the broker's, by its number; repeat it for several
    #[arg(long = "watch-pid", value_name = "PID")]
    watched: Vec<u32>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum UpdateArg {
    /// The document `state`: everything that is known of the drive
    State,
    /// The topic `frequency/output`: one number
    Frequency,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum ReadingArg {
    All,
    Shared,
    Split,
}

fn main() -> ExitCode {
    let args = Args::parse();
    let _last_lines = log::start(args.log_format, tracing::Level::ERROR);
    match simulate(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}

fn simulate(args: &Args) -> Result<(), CommandFailure> {
    let specimen = specimen::specimen(args)?;
    let plan = plan::plan(args, &specimen)?;
    let mut bar = ProgressBar::new(0);
    let outcome = play::run(plan.clone(), |progress| show(&mut bar, progress));
    bar.end();
    let outcome = outcome.map_err(CommandFailure::failed)?;
    let report = report::Report {
        plan: &plan,
        specimen: &specimen,
        outcome: &outcome,
    };
    print(&if args.json {
        format!("{:#}\n", report.json())
    } else {
        report.text()
    })?;
    match report.complaint() {
        Some(complaint) => Err(CommandFailure::failed(complaint)),
        None => Ok(()),
    }
}

fn show(bar: &mut ProgressBar, progress: &Progress) {
    let Progress {
        done, all, balance, ..
    } = progress;
    let what = match progress.stage {
        Stage::Subscribing => format!("consumers subscribe: {done} of {all}"),
        Stage::Connecting => format!("gateways connect: {done} of {all}"),
        Stage::Publishing => format!(
            "{done} of {all} s: {} sent, {} received",
            balance.sent, balance.received
        ),
        Stage::Draining => format!(
            "on its way: {} sent, {} received",
            balance.sent, balance.received
        ),
        Stage::Clearing => "retained messages are taken back".to_owned(),
    };
    let whole = |number: u64| usize::try_from(number).unwrap_or(usize::MAX);
    bar.of(whole(*all));
    bar.to(whole(*done), &what);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::play::Plan;
    use serde_json::Value;
    use vfd_gateway::daemon::mqtt::{BrokerKeeps, ConnectionSettings};

    fn typed(line: &str) -> Args {
        let words = std::iter::once("simulate").chain(line.split_whitespace());
        Args::try_parse_from(words).unwrap_or_else(|error| panic!("{line}: {error}"))
    }

    fn planned(line: &str) -> Result<Plan, CommandFailure> {
        let args = typed(line);
        plan::plan(&args, &specimen::specimen(&args)?)
    }

    fn ways(settings: &ConnectionSettings) -> Vec<u16> {
        std::iter::once(settings.port)
            .chain(settings.also_at.iter().map(|(_, port)| *port))
            .collect()
    }

    #[test]
    fn a_drive_of_each_model_of_the_demo_has_a_document_and_a_birth() {
        let ids = vfd_gateway::vendors::in_demo();
        assert!(ids.len() >= 4);
        for id in ids {
            let specimen = specimen::specimen(&typed(&format!("--drives 3 --model {id}")));
            let specimen = specimen.unwrap_or_else(|it| panic!("{id}: {it}"));
            let state: Value = serde_json::from_slice(&specimen.state).unwrap();
            let values = state["values"].as_object().unwrap();
            assert!(
                !values.is_empty() && values.values().all(|it| it["quality"] == "good"),
                "{id}: {state:#}"
            );
            let [all, documents] = specimen.births;
            assert!(
                all.bytes > documents.bytes && documents.messages >= 3,
                "{id}: {all:?}, {documents:?}"
            );
            assert!(specimen.expiry.is_some(), "{id}");
        }
    }

    #[test]
    fn the_guide_names_every_option() {
        let guide =
            std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/fleet.md")).unwrap();
        let command = <Args as clap::CommandFactory>::command();
        let unnamed = command
            .get_arguments()
            .filter_map(|it| it.get_long())
            .filter(|it| !guide.contains(&format!("`--{it}")));
        assert_eq!(unnamed.collect::<Vec<_>>(), [""; 0]);
    }

    #[test]
    fn a_hundred_drives_fit_on_lines() {
        for drives in [1, 32, 33, 100] {
            assert!(
                specimen::specimen(&typed(&format!("--drives {drives}"))).is_ok(),
                "{drives}"
            );
        }
    }

    #[test]
    fn gateways_spread_over_the_nodes_and_know_all_of_them() {
        let plan =
            planned("--gateways 4 --broker mqtt://a:1 --broker mqtt://b:2 --broker mqtt://c:3")
                .ok()
                .unwrap();
        let found: Vec<_> = plan.gateways.iter().map(ways).collect();
        assert_eq!(found, [[1, 2, 3], [2, 3, 1], [3, 1, 2], [1, 2, 3]]);
        let ids: std::collections::BTreeSet<_> = plan
            .gateways
            .iter()
            .chain(&plan.consumers)
            .map(|it| &it.client_id)
            .collect();
        assert_eq!(ids.len(), 5, "{ids:?}");
        assert_eq!(plan.consumers[0].keeps, BrokerKeeps::Nothing);
        let elsewhere =
            planned("--gateways 2 --qos 1 --consumer-broker mqtts://centre --consumers 2")
                .ok()
                .unwrap();
        assert_eq!(
            elsewhere
                .consumers
                .iter()
                .map(|it| (it.port, it.keeps))
                .collect::<Vec<_>>(),
            [(8883, BrokerKeeps::Session); 2]
        );
        assert!(elsewhere.consumers[0].tls.is_some() && elsewhere.gateways[0].tls.is_none());
        assert_eq!(
            (plan.shape.updates, elsewhere.shape.updates_of_all()),
            (60, 60 * 64)
        );
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_a_reason() {
        for (line, reason) in [
            ("--broker embedded", "embedded"),
            ("--broker tcp://a", "tcp://"),
            ("--broker mqtt://a --broker mqtts://b", "either all"),
            ("--updates-per-second 0", "--updates-per-second"),
            ("--updates-per-second nan", "--updates-per-second"),
            (
                "--updates-per-second 0.01 --seconds 5",
                "no drive has an update",
            ),
            ("--prefix a/+", "prefix"),
            ("--model nothing", "nothing"),
            ("--credentials /nowhere/users", "/nowhere/users"),
        ] {
            let refused = planned(line)
                .err()
                .unwrap_or_else(|| panic!("{line} is taken"));
            assert!(refused.to_string().contains(reason), "{line}: {refused}");
        }
    }
}
