//! `write`: one register or command of one drive, through a running gateway or directly on a port. After a run command
//! it stays and supervises the drive.

mod start_words;

use crate::cli::tools::client::{LEASE_LEFT, NoAnswer, UnitClient, address, reason};
use crate::cli::tools::log::complain;
use crate::cli::tools::order::{WriteOrder, frequency};
use crate::cli::tools::stopping::{CONFIRMED, stop};
use crate::cli::tools::straight_write::{StraightOptions, arm, extra};
use crate::cli::tools::target::DriveTarget;
use crate::cli::tools::told_to_stop::told_to_stop;
use crate::cli::tools::{CommandFailure, print};
use crate::domain::address::DataTable;
use crate::north::modbus::address as map;
use crate::north::modbus::uniform::run;
use start_words::models_that_run;
use std::pin::{Pin, pin};
use std::time::Duration;
use tokio::time::sleep;

/// Longest time between two renewals of a lease.
const RENEW_MAX: Duration = Duration::from_secs(1);
/// Shortest time between two renewals, for leases of a second or less.
const RENEW_MIN: Duration = Duration::from_millis(100);
/// The value of word 18 if it is not known.
const NOT_KNOWN: u16 = u16::MAX;

/// Arguments of `write`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    target: DriveTarget,
    /// Register by its number on the wire (0x0201 or 513); or `run` or `frequency`, with a uniform unit
    register: String,
    /// The word; for `run` one of forward, reverse, stop, coast, reset, release, take; for `frequency` hertz, such as 42.5
    value: String,
    /// The unit is a uniform one; `run` and `frequency` imply it
    #[arg(long)]
    uniform: bool,
    /// Exit after a run command, although the fail-safe action follows when the lease ends
    #[arg(long)]
    once: bool,
    #[command(flatten)]
    straight: StraightOptions,
}

impl Args {
    /// Whether there is no gateway between.
    pub const fn is_straight(&self) -> bool {
        self.target.is_straight()
    }
}

/// Writes. After a run command it renews the lease until SIGINT, SIGTERM or SIGHUP, and then stops the drive.
pub fn write(args: &Args) -> Result<(), CommandFailure> {
    let order = order(args)?;
    if args.once && args.is_straight() && order.makes_run() {
        return Err(CommandFailure::wrong(
            "a write directly on a port ends at once, and then nothing supervises the motor: leave \
             out --once",
        ));
    }
    if !args.once
        && let Some(what) = &order.starts
    {
        return Err(CommandFailure::wrong(format!(
            "{} {what}, and no process would stay to hold control: {INSTEAD}",
            order.text
        )));
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    runtime.block_on(async {
        // Set up before the first frame, so that no signal leaves a running drive behind.
        let mut stop_signal = pin!(told_to_stop().map_err(CommandFailure::failed)?);
        let extra = extra(&args.target, &args.straight, &order)?;
        let mut reached = tokio::select! {
            () = &mut stop_signal => return Ok(()),
            reached = args.target.reach(order.is_uniform, &extra) => reached?,
        };
        let done = execute(args, &order, &mut reached.client, stop_signal).await;
        reached.close().await;
        done
    })
}

async fn execute(
    args: &Args,
    order: &WriteOrder,
    client: &mut UnitClient,
    mut stop_signal: Pin<&mut impl Future<Output = ()>>,
) -> Result<(), CommandFailure> {
    if !(order.makes_run() || order.takes()) || args.once {
        tokio::select! {
            sent = order.send(client) => sent?,
            () = &mut stop_signal => return Err(CommandFailure::failed(order.interrupted())),
        }
        if order.makes_run() || order.takes() || order.starts.is_some() {
            complain(b"warning: nothing renews the lease; the drive will run its fail-safe action when it expires\n");
        }
        let done = if order.stops() {
            CONFIRMED
        } else {
            "acknowledged by the drive, now or before"
        };
        return print(&format!("{}: {done}\n", order.text));
    }
    if args.is_straight() && order.makes_run() {
        arm(client, &args.straight).await?;
    }
    let Some(ours) = order.run(client).await? else {
        return print(&format!(
            "{}: acknowledged; there is nothing to hold\n",
            order.text
        ));
    };
    print(&format!(
        "{}: acknowledged; the lease is renewed until Ctrl-C, which stops the drive\n",
        order.text
    ))?;
    let lost = tokio::select! {
        () = &mut stop_signal => None,
        lost = renew_lease(client, ours) => Some(lost),
    };
    match lost {
        None => print(&format!("{}\n", stop(client).await?)),
        Some(failure) => Err(failure),
    }
}

/// The alternative if a word makes a motor run.
const INSTEAD: &str = "say `run forward`, `run reverse` or `run take` with the drive's uniform unit (its own + 100, if the \
                       configuration does not say otherwise), which stops the drive at Ctrl-C; or write it with --once, \
                       and the drive runs its fail-safe action when the lease ends";
/// The run commands by name.
const RUN_COMMANDS: [(&str, u16); 7] = [
    ("stop", run::STOP),
    ("forward", run::FORWARD),
    ("reverse", run::REVERSE),
    ("coast", run::COAST),
    ("reset", run::RESET),
    ("release", run::RELEASE),
    ("take", run::TAKE),
];

/// What the arguments say.
fn order(args: &Args) -> Result<WriteOrder, CommandFailure> {
    let register = args.register.as_str();
    let value = args.value.as_str();
    let text = format!("{register} {value}");
    let (address, word) = match register {
        "run" => (map::RUN, run_command(value)?),
        "frequency" => (map::SETPOINT, frequency(value)?),
        _ => (register_of(args, register)?, parse_register_word(value)?),
    };
    let is_uniform = args.uniform || matches!(register, "run" | "frequency");
    let starts = if is_uniform || args.is_straight() {
        None
    } else {
        starts(args, address, word)?
    };
    Ok(WriteOrder {
        address,
        word,
        is_uniform,
        text,
        starts,
    })
}

fn run_command(value: &str) -> Result<u16, CommandFailure> {
    let names = || RUN_COMMANDS.iter().map(|(name, _)| *name);
    let found = RUN_COMMANDS
        .iter()
        .find(|(name, _)| *name == value)
        .map(|(_, word)| *word);
    found.ok_or_else(|| {
        CommandFailure::wrong(format!(
            "{value} is not a run command; expected one of {}",
            names().collect::<Vec<_>>().join(", ")
        ))
    })
}

/// What `word` at `address` of a unit behind a gateway does if it makes a motor run, or takes it over: by the drive's
/// own run command, or at a uniform unit that was not given as one.
fn starts(args: &Args, address: u16, word: u16) -> Result<Option<String>, CommandFailure> {
    let catalog = args.target.catalog()?;
    let models = models_that_run(&catalog, address, word);
    Ok(match (address, word) {
        _ if !models.is_empty() => Some(format!("makes the motor of {} run", models.join(", "))),
        (map::RUN, run::FORWARD | run::REVERSE | run::TAKE) => {
            Some("makes a motor run at a uniform unit, or takes it over".to_owned())
        }
        _ => None,
    })
}

/// The addressed register; directly on a port also by its name or code.
fn register_of(args: &Args, register: &str) -> Result<u16, CommandFailure> {
    let model = args.target.model()?.filter(|_| !args.uniform);
    let named = model
        .as_ref()
        .and_then(|model| model.register_named(register));
    if let Some(other) = named.filter(|named| named.address.table() != DataTable::Holding) {
        let what = format!(
            "{} ({}) is not a holding register, and `write` writes no others",
            other.name, other.address
        );
        return Err(CommandFailure::wrong(what));
    }
    let named = named.map(|named| named.address.number());
    named.map_or_else(|| address(register).map_err(CommandFailure::wrong), Ok)
}

fn parse_register_word(value: &str) -> Result<u16, CommandFailure> {
    address(value).map_err(|_| {
        CommandFailure::wrong(format!(
            "{value} is not a 16-bit word: give a number from 0 to 65535, such as 5000"
        ))
    })
}

/// Renews the lease, again and again. It returns when the drive no longer runs by our command.
async fn renew_lease(client: &mut UnitClient, ours: u16) -> CommandFailure {
    let mut complaint = None;
    loop {
        let wait = match renew(client, ours).await {
            Ok(Some(left)) => {
                complaint = None;
                renew_after(left)
            }
            Ok(None) => {
                return CommandFailure::failed(format!(
                    "the drive no longer runs by this command{}",
                    reason(client).await
                ));
            }
            Err(NoAnswer::Exception(code @ (1..=3 | 6))) => {
                let text = NoAnswer::Exception(code);
                return CommandFailure::failed(format!(
                    "the lease is lost: {text}{}",
                    reason(client).await
                ));
            }
            Err(error) => {
                let text = error.to_string();
                if complaint.as_ref() != Some(&text) {
                    complain(
                        format!("{text}; trying again, but the fail-safe action follows if the lease ends\n")
                            .as_bytes(),
                    );
                    complaint = Some(text);
                }
                RENEW_MIN
            }
        };
        sleep(wait).await;
    }
}

/// Renews the lease if our command is still in force; `None` if it is not. Returns the remaining seconds.
async fn renew(client: &mut UnitClient, ours: u16) -> Result<Option<u16>, NoAnswer> {
    if client.read(map::RUN, 1).await? != [ours] {
        return Ok(None);
    }
    client.write(map::RENEW, 1).await?;
    Ok(client.read(LEASE_LEFT, 1).await?.first().copied())
}

/// A third of what is left, at most a second.
fn renew_after(left: u16) -> Duration {
    if left == NOT_KNOWN {
        return RENEW_MAX;
    }
    (Duration::from_secs(left.into()) / 3).clamp(RENEW_MIN, RENEW_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::model::RegisterRole;
    use clap::Parser;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    /// No server listens at the port of the discard service.
    const NOBODY: &str = "9";

    /// How `write` of `word` to `register` ends if no gateway listens: only what is not refused beforehand gets that
    /// far.
    fn end_of(register: u16, word: u16, more: &[&str]) -> CommandFailure {
        let register = format!("0x{register:04X}");
        let word = word.to_string();
        let line = [
            &["write", "--port", NOBODY, "--unit", "1", &register, &word],
            more,
        ]
        .concat();
        write(&Line::try_parse_from(line).unwrap().args).unwrap_err()
    }

    #[test]
    fn a_word_that_makes_a_motor_run_is_not_written_and_left_alone() {
        let catalog = crate::vendors::catalog();
        for model in crate::vendors::reviewed()
            .iter()
            .map(|id| catalog.find(id).unwrap())
        {
            let run = model.run.as_ref().unwrap();
            let register = model
                .register_for(RegisterRole::RunCommand)
                .unwrap()
                .address;
            let starts = [Some(&run.forward), run.reverse.as_ref()]
                .into_iter()
                .flatten()
                .map(|it| it.value);
            for word in starts {
                let refused = end_of(register.number(), word, &[]);
                assert_eq!(
                    refused.code,
                    crate::cli::tools::failure::WRONG_USAGE,
                    "{}: {}",
                    model.id,
                    refused.message
                );
                assert!(
                    refused.message.contains(&model.id),
                    "{}: {}",
                    model.id,
                    refused.message
                );
                assert!(
                    refused.message.contains("run forward"),
                    "{}",
                    refused.message
                );
                let once = end_of(register.number(), word, &["--once"]);
                assert!(
                    once.message.contains("cannot connect"),
                    "{}: {}",
                    model.id,
                    once.message
                );
            }
            let others = [
                Some(&run.stop),
                run.coast.as_ref(),
                run.reset.as_ref(),
                run.release.as_ref(),
            ];
            for word in others.into_iter().flatten().map(|it| it.value) {
                let sent = end_of(register.number(), word, &[]);
                assert!(
                    sent.message.contains("cannot connect"),
                    "{} {word}: {}",
                    model.id,
                    sent.message
                );
            }
        }
    }

    #[test]
    fn straight_on_a_port_no_word_is_written_where_commands_are() {
        let catalog = crate::vendors::catalog();
        for model in crate::vendors::reviewed()
            .iter()
            .map(|id| catalog.find(id).unwrap())
        {
            let register = model
                .register_for(RegisterRole::RunCommand)
                .unwrap()
                .address
                .number();
            let twin = model
                .quirks
                .stored_alias_bit
                .as_ref()
                .map(|bit| register | 1 << bit.value);
            let word = model.run.as_ref().unwrap().forward.value.to_string();
            let place = ["--port", "/dev/none"];
            for address in [Some(register), twin]
                .into_iter()
                .flatten()
                .map(|it| format!("0x{it:04X}"))
            {
                let drive = ["--model", &model.id, "--station", "1", &address, &word];
                let line = [&["write"], &place[..], &drive].concat();
                let refused = write(&Line::try_parse_from(line).unwrap().args).unwrap_err();
                assert_eq!(
                    refused.code,
                    crate::cli::tools::failure::WRONG_USAGE,
                    "{} {address}: {}",
                    model.id,
                    refused.message
                );
            }
        }
    }

    #[test]
    fn the_run_command_of_a_uniform_unit_is_known_without_the_flag() {
        for word in [1, 2, run::TAKE] {
            let refused = end_of(map::RUN, word, &[]);
            assert_eq!(
                refused.code,
                crate::cli::tools::failure::WRONG_USAGE,
                "{word}: {}",
                refused.message
            );
            assert!(refused.message.contains("uniform"), "{}", refused.message);
        }
        for word in [run::STOP, 3, 4, 5] {
            assert!(
                end_of(map::RUN, word, &[])
                    .message
                    .contains("cannot connect"),
                "{word}"
            );
        }
    }

    #[test]
    fn a_lease_is_renewed_three_times_before_it_ends_and_every_second() {
        for (left, millis) in [
            (0, 100),
            (1, 333),
            (2, 666),
            (3, 1000),
            (30, 1000),
            (NOT_KNOWN, 1000),
        ] {
            assert_eq!(renew_after(left).as_millis(), millis, "{left} s left");
        }
    }

    #[test]
    fn what_is_no_run_command_is_answered_with_those_there_are() {
        let failure = run_command("backwards").unwrap_err();
        for (name, word) in RUN_COMMANDS {
            assert_eq!(run_command(name).unwrap(), word);
            assert!(failure.message.contains(name), "{}", failure.message);
        }
    }
}
