//! The command line: `commands/` has one small file per command, `tools/` what several of them use, `help/` the texts of
//! `--help`. A command uses tools and no other command.

pub mod commands;
mod help;
pub mod tools;

use crate::domain::version::PROGRAM_VERSION;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use commands::{
    broker, capture, certificate, check, completions, demo, diagnose, doctor, enable, health, init,
    journal, man, map, models, params, password, qualify, read, reload, run, scan, simulate,
    standby, standstill, usage, verify, watch, watchdog, write,
};
use std::process::ExitCode;
use tools::log;
use tracing::Level;

/// Bridges variable-frequency drives on serial lines to Modbus TCP and MQTT.
///
/// Not a safety function: emergency stop and safe torque off are hard-wired.
#[derive(Debug, Parser)]
#[command(name = "vfd-gateway", version = PROGRAM_VERSION, arg_required_else_help = true)]
pub struct Cli {
    /// Format of log lines on stderr
    #[arg(long, global = true, value_enum, default_value_t = log::LogFormat::Text)]
    log_format: log::LogFormat,
    #[command(subcommand)]
    command: CliCommand,
}

#[derive(Debug, Subcommand)]
enum CliCommand {
    /// Try everything on this machine: simulated drives behind a gateway with Modbus TCP, MQTT and a broker
    ///
    /// It plays drives of several makers in two groups, on lines at real speed, with a page for the user demo, a journal in
    /// a temporary directory, and a trip of the last drive that is reset at its panel, so that each panel has something to show.
    /// Enter trips the first drive.
    Demo(demo::Args),
    /// Create a working configuration: finds the drives, asks for the rest, and writes the file
    Init(Box<init::Args>),
    /// Run the gateway
    Run(run::Args),
    /// Check a configuration: reports all problems at once, or the load of each line. Opens no port
    Check(check::Args),
    /// Find drives on an unused line, identify their models, and print a configuration to start from. Only reads
    ///
    /// Listens for 2 s first, and refuses a line with traffic or a port that a gateway has open. Tries factory settings
    /// first, others on request. Ctrl-C ends the scan and keeps what was found.
    Scan(scan::Args),
    /// Read all parameters of a drive to a file, compare two files, or write one back
    Params(params::Args),
    /// List and show drive models, or check a model file
    Models(models::Args),
    /// No drive yet? Simulate one or more on a pseudo-terminal
    Simulate(simulate::Args),
    /// Ask the running gateway whether it is ready; also for container health checks
    Health(health::Args),
    /// Observe the lines of the running gateway for a while, and report what is wrong and how to fix it
    Doctor(doctor::Args),
    /// Write a support archive: configuration without passwords, log, journal, reports, traffic
    Diagnose(diagnose::Args),
    /// Show which gateway sends on each line that two gateways share, or give lines to the other one
    Standby(standby::Args),
    /// Confirm that the motor of a drive that may still run stands, after you have looked. Sends nothing to the drive
    Standstill(standstill::Args),
    /// Reload the configuration of the running gateway atomically
    Reload(reload::Args),
    /// Show the journal: trips, commands and refusals, drives and lines going online and offline. The gateway may be running
    Journal(journal::Args),
    /// Show what drives have used: energy, running hours, starts and trips of each day. The gateway may be running
    Usage(usage::Args),
    /// Hash a password for a user of the page
    ///
    /// Prompts twice without echo, or reads one line from stdin if that is not a terminal.
    Password(password::Args),
    /// Make or renew a certificate for the page, with a local authority that phones can install
    Certificate(certificate::Args),
    /// Check the settings of a drive that make it obey the bus. Reads them from the drive, not from the last poll
    Verify(verify::Args),
    /// Change the settings of a drive so that it obeys the bus. At standstill only; shows old and new values first
    Enable(enable::Args),
    /// Try what the model leaves unproven, in front of the drive, one order at a time. Moves the motor
    ///
    /// Says what will be sent and what should be seen, asks, sends it through the guard, compares, and stops. Needs
    /// `qualify = true` in the drive's control section.
    Qualify(qualify::Args),
    /// Show or set the communication watchdog of a drive. Sets it at standstill only; shows old and new values first
    Watchdog(watchdog::Args),
    /// Read registers or named values of a drive, through a running gateway or directly on a port
    Read(read::Args),
    /// Write a register, a run command or a frequency of a drive, through a running gateway or directly on a port
    ///
    /// After a run command it keeps running and renews the lease until Ctrl-C, then stops the drive. Directly on a port
    /// the same guard applies, with the limits of --limits; but if this program is killed, nothing stops the motor.
    Write(write::Args),
    /// Read repeatedly: redraws a table on a terminal, otherwise prints a line when a value changes
    Watch(watch::Args),
    /// Record the traffic of a line for Wireshark, through a running gateway
    ///
    /// The file is pcapng and needs no settings: Wireshark decodes RTU frames as Modbus RTU, and each packet has a comment
    /// in plain words. Ctrl-C ends the recording.
    Capture(capture::Args),
    /// Print the Modbus maps of a configuration: each unit with its registers, units and meanings
    Map(map::Args),
    /// Print a shell completion script
    Completions(completions::Args),
    /// Print the manual page, or write the pages of all commands
    Man(man::Args),
    /// Run a small MQTT broker on loopback; exits when its standard input closes
    #[command(hide = true)]
    Broker(broker::Args),
}

impl CliCommand {
    /// The default log level. A tool prints its results itself.
    const fn log_level(&self) -> Level {
        match self {
            // What `models new` runs is simulated: only what goes wrong is of interest.
            Self::Scan(_) | Self::Init(_) | Self::Models(_) => Level::ERROR,
            Self::Params(_) => Level::WARN,
            Self::Read(args) if args.is_straight() => Level::WARN,
            Self::Write(args) if args.is_straight() => Level::WARN,
            Self::Watch(args) if args.is_straight() => Level::ERROR,
            _ => Level::INFO,
        }
    }
}

/// The command line with everything that `--help` and the manual show.
fn command() -> clap::Command {
    help::complete(Cli::command())
}

/// The arguments of this process. Exits if they are wrong or ask for help.
fn parse() -> Cli {
    let matches = command().get_matches();
    Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit())
}

/// Runs the command that the arguments name.
#[must_use]
pub fn main() -> ExitCode {
    let cli = parse();
    let _last_lines = log::start(cli.log_format, cli.command.log_level());
    let done = match cli.command {
        CliCommand::Demo(args) => demo::demo(&args),
        CliCommand::Init(args) => init::init(&args),
        CliCommand::Run(args) => run::run(&args),
        CliCommand::Check(args) => check::check(&args),
        CliCommand::Scan(args) => scan::scan(&args),
        CliCommand::Params(args) => params::params(&args),
        CliCommand::Models(args) => models::models(&args),
        CliCommand::Simulate(args) => simulate::simulate(&args),
        CliCommand::Health(args) => health::health(&args),
        CliCommand::Doctor(args) => doctor::doctor(&args),
        CliCommand::Diagnose(args) => diagnose::diagnose(&args),
        CliCommand::Standby(args) => standby::standby(&args),
        CliCommand::Standstill(args) => standstill::standstill(&args),
        CliCommand::Reload(args) => reload::reload(&args),
        CliCommand::Journal(args) => journal::journal(&args),
        CliCommand::Usage(args) => usage::usage(&args),
        CliCommand::Password(args) => password::password(&args),
        CliCommand::Certificate(args) => certificate::certificate(&args),
        CliCommand::Verify(args) => verify::verify(&args),
        CliCommand::Enable(args) => enable::enable(&args),
        CliCommand::Qualify(args) => qualify::qualify(&args),
        CliCommand::Watchdog(args) => watchdog::watchdog(&args),
        CliCommand::Read(args) => read::read(&args),
        CliCommand::Write(args) => write::write(&args),
        CliCommand::Watch(args) => watch::watch(&args),
        CliCommand::Capture(args) => capture::capture(&args),
        CliCommand::Map(args) => map::map(&args),
        CliCommand::Completions(args) => completions::completions(&args, command()),
        CliCommand::Man(args) => man::man(&args, command()),
        CliCommand::Broker(args) => broker::broker(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}
