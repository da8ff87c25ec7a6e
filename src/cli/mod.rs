//! The command line: one small file per command.

mod broker;
mod capture;
mod check;
mod client;
mod completions;
pub mod demo;
mod doctor;
mod enable;
mod failure;
mod health;
mod help;
pub mod input;
mod journal;
mod keyboard;
mod link_args;
pub mod log;
mod man;
mod map;
mod model_facts;
mod models;
mod output;
mod own_gateway;
pub mod own_models;
mod params;
mod password;
pub mod progress;
mod read;
mod reload;
mod run;
mod scan;
mod setup;
mod simulate;
mod socket;
mod start_words;
mod straight_write;
mod target;
mod verify;
mod view;
mod watch;
mod watchdog;
mod write;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
pub use failure::Failure;
pub use output::print;
use std::process::ExitCode;

/// Bridges variable-frequency drives on serial lines to Modbus TCP and MQTT.
///
/// Not a safety function: emergency stop and safe torque off are hard-wired.
#[derive(Debug, Parser)]
#[command(name = "vfd-gateway", version, arg_required_else_help = true)]
pub struct Cli {
    /// How log lines on stderr are written
    #[arg(long, global = true, value_enum, default_value_t = log::Format::Text)]
    log_format: log::Format,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Show everything at once on this machine alone: a simulated drive behind a gateway with Modbus TCP, MQTT and a broker
    Demo(demo::Args),
    /// Run the gateway
    Run(run::Args),
    /// Check a configuration: all problems at once, or what each line will cost. Opens nothing
    Check(check::Args),
    /// Find drives on a line that nobody uses, name their models, and print a configuration to start from. Only reads
    ///
    /// Listens for 2 s first, and refuses a line on which somebody talks or a port that a gateway has open. First the
    /// settings with which drives leave their factories, anything else on request. Ctrl-C ends it and keeps what was found.
    Scan(scan::Args),
    /// Read all parameters of a drive to a file, compare two files, or write one back
    Params(params::Args),
    /// List and show drive models, or check a model file
    Models(models::Args),
    /// Play one or more drives on a pseudo-terminal, for people who have no hardware at hand
    Simulate(simulate::Args),
    /// Ask the running gateway whether it is ready, for container health checks too
    Health(health::Args),
    /// Watch the lines of the running gateway for a while: what is wrong with each, and what to do about it
    Doctor(doctor::Args),
    /// Have the running gateway take its configuration file anew: whole, or not at all
    Reload(reload::Args),
    /// Show what the gateway has kept: trips, commands and refusals, comings and goings. It may run meanwhile
    Journal(journal::Args),
    /// Make the hash of a password for somebody who is to sign in on the page
    ///
    /// Asks for it twice without showing it, or reads one line from stdin if that is no terminal.
    Password(password::Args),
    /// Read from a drive whether it is set so that it obeys the bus; the settings themselves, not what was polled
    Verify(verify::Args),
    /// Set on a drive what it needs before it obeys the bus, at standstill, after showing old and new
    Enable(enable::Args),
    /// Show how a drive watches its communication, or set it at standstill, after showing old and new
    Watchdog(watchdog::Args),
    /// Read registers or named values of a drive, through a running gateway or straight on a port
    Read(read::Args),
    /// Write a register, a run command or a frequency of a drive, through a running gateway or straight on a port
    ///
    /// After a run command it stays, renews the lease until Ctrl-C, and then stops the drive. Straight on a port the same
    /// guard stands between, with the limits of --limits; but nobody is left to stop the motor if this program is killed.
    Write(write::Args),
    /// Read again and again: a table on a terminal that is drawn anew, else a line when something changes
    Watch(watch::Args),
    /// Write what goes over a line to a file for Wireshark, through a running gateway
    ///
    /// The file is pcapng and needs no setting: RTU frames are decoded as Modbus RTU, and each packet says in words what
    /// it is. It ends with Ctrl-C.
    Capture(capture::Args),
    /// Print every Modbus map of a configuration: each unit with its registers, numbers, units and meanings
    Map(map::Args),
    /// Print a script that lets a shell complete commands and options
    Completions(completions::Args),
    /// Print the manual page, or write those of all commands
    Man(man::Args),
    /// Run a small MQTT broker on loopback; ends with its standard input
    #[command(hide = true)]
    Broker(broker::Args),
}

impl Command {
    /// From which level on is logged, where nobody says otherwise. What a tool finds out, it says itself.
    const fn log_level(&self) -> &'static str {
        match self {
            Self::Scan(_) => "error",
            Self::Params(_) => "warn",
            Self::Read(args) if args.is_straight() => "warn",
            Self::Write(args) if args.is_straight() => "warn",
            Self::Watch(args) if args.is_straight() => "error",
            _ => "info",
        }
    }
}

/// The command line with all that `--help` and the manual say.
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
        Command::Demo(args) => demo::demo(&args),
        Command::Run(args) => run::run(&args),
        Command::Check(args) => check::check(&args),
        Command::Scan(args) => scan::scan(&args),
        Command::Params(args) => params::params(&args),
        Command::Models(args) => models::models(&args),
        Command::Simulate(args) => simulate::simulate(&args),
        Command::Health(args) => health::health(&args),
        Command::Doctor(args) => doctor::doctor(&args),
        Command::Reload(args) => reload::reload(&args),
        Command::Journal(args) => journal::journal(&args),
        Command::Password(args) => password::password(&args),
        Command::Verify(args) => verify::verify(&args),
        Command::Enable(args) => enable::enable(&args),
        Command::Watchdog(args) => watchdog::watchdog(&args),
        Command::Read(args) => read::read(&args),
        Command::Write(args) => write::write(&args),
        Command::Watch(args) => watch::watch(&args),
        Command::Capture(args) => capture::capture(&args),
        Command::Map(args) => map::map(&args),
        Command::Completions(args) => completions::completions(&args, command()),
        Command::Man(args) => man::man(&args, command()),
        Command::Broker(args) => broker::broker(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}
