//! `qualify`: leads a person in front of a drive through what its model leaves unproven, one order at a time, stop first.

mod gateway;
mod person;
mod report;
mod seen;
mod session;
mod texts;

use crate::cli::tools::told_to_stop::told_to_stop;
use crate::cli::tools::{CommandFailure, print, socket};
use crate::north::api::TrialDocument;
use gateway::TrialDrive;
use person::TypedLines;
use session::{TrialSession, TrialsEnd};
use std::io::{self, IsTerminal};
use std::path::PathBuf;
use std::pin::pin;

/// Arguments of `qualify`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the drive, as in the gateway's configuration
    drive: String,
    #[command(flatten)]
    place: socket::SocketArgs,
    /// Show what is unproven and what was found, and send nothing
    #[arg(long, conflicts_with_all = ["forget", "report"])]
    list: bool,
    /// Remove what was found at this drive
    #[arg(long, conflicts_with = "report")]
    forget: bool,
    /// Write what was found to a file without names and addresses, which may be sent to the project
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    /// Who makes the trials; the user of this shell by default
    #[arg(long, value_name = "NAME")]
    by: Option<String>,
    /// Do not ask before --forget
    #[arg(long, requires = "forget")]
    yes: bool,
}

/// Makes the trials, or shows, forgets or reports what was found.
pub fn qualify(args: &Args) -> Result<(), CommandFailure> {
    let gateway = TrialDrive::new(&args.drive, &args.place)?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    runtime.block_on(async {
        let document = gateway.read_trials().await?;
        if args.list {
            return print(&texts::list(&document));
        }
        if let Some(file) = &args.report {
            return report::write(file, &document);
        }
        let by = by(args);
        if args.forget {
            return forget(args, &gateway, &by).await;
        }
        run_trials(&gateway, &document, &by).await
    })
}

async fn run_trials(
    gateway: &TrialDrive,
    document: &TrialDocument,
    by: &str,
) -> Result<(), CommandFailure> {
    may_begin(document)?;
    // Handled before the first frame, so that no signal leaves a running motor behind.
    let mut stop_signal = pin!(told_to_stop().map_err(CommandFailure::failed)?);
    print(&texts::beginning(document))?;
    let mut session = TrialSession::new(
        gateway,
        TypedLines::listen().map_err(CommandFailure::failed)?,
        document,
        by,
    );
    let ended = tokio::select! {
        biased;
        () = &mut stop_signal => Err(TrialsEnd::Interrupted),
        ended = session.run() => ended,
    };
    // Whatever has happened: the last word is a stop. A second signal does not prevent it.
    let stopped = if session.has_sent {
        Some(gateway.stop_at_last().await)
    } else {
        None
    };
    print(&texts::summary(&session.found))?;
    if let Some(Err(failure)) = stopped {
        return Err(CommandFailure::failed(format!(
            "NOT KNOWN TO BE STOPPED, use the hard-wired stop: {failure}"
        )));
    }
    let is_against = session.found.iter().any(|found| found.is_contradicted());
    match ended {
        Ok(()) if is_against => Err(CommandFailure::failed(
            "something was not as expected; the motor is stopped",
        )),
        Ok(()) => print(
            "what was confirmed counts after `vfd-gateway reload`, or the next start; then remove `qualify`\n",
        ),
        Err(TrialsEnd::Quit) => Err(CommandFailure::failed(
            "ended at your request; the motor is stopped",
        )),
        Err(TrialsEnd::Interrupted) => {
            Err(CommandFailure::failed("interrupted; the motor is stopped"))
        }
        Err(TrialsEnd::NoInput) => Err(CommandFailure::failed(
            "the input has ended; the motor is stopped",
        )),
        Err(TrialsEnd::Failed(failure)) => Err(failure),
    }
}

/// Whether trials make sense at this drive, and a person is there to answer.
fn may_begin(document: &TrialDocument) -> Result<(), CommandFailure> {
    let TrialDocument { drive, model, .. } = document;
    if document.actions.is_empty() {
        return Err(CommandFailure::wrong(format!(
            "{drive}: everything that {model} can do is proven, so there is nothing to try"
        )));
    }
    if !document.controlled {
        return Err(CommandFailure::wrong(format!(
            "{drive} is read-only: trials need a control section with its limits"
        )));
    }
    if !document.qualify {
        return Err(CommandFailure::wrong(format!(
            "{drive} is not open to trials: set `qualify = true` in its control section, then `vfd-gateway reload`"
        )));
    }
    if let Some(why) = &document.not_identified {
        return Err(CommandFailure::failed(format!(
            "{drive}: its identity cannot be read: {why}"
        )));
    }
    if !io::stdin().is_terminal() {
        return Err(CommandFailure::wrong(
            "a person must answer at the keyboard, but stdin is not a terminal: run it in one \
             (`ssh -t`, `docker exec -it`)",
        ));
    }
    Ok(())
}

async fn forget(args: &Args, gateway: &TrialDrive, by: &str) -> Result<(), CommandFailure> {
    if !args.yes {
        if !io::stdin().is_terminal() {
            return Err(CommandFailure::wrong(
                "nothing was forgotten: there is no terminal to ask on; add --yes",
            ));
        }
        let mut person = TypedLines::listen().map_err(CommandFailure::failed)?;
        let answer = person
            .ask(&format!(
                "forget all that was found at {}? [y/N] ",
                args.drive
            ))
            .await?;
        if !answer.is_some_and(|answer| person::is_yes(&answer)) {
            return Err(CommandFailure::failed("nothing was forgotten"));
        }
    }
    gateway.forget(by).await?;
    print(
        "forgotten; what was accepted stays accepted until `vfd-gateway reload` or the next start, \
         for which the drive needs `qualify` or `accept_unverified`: see `check`\n",
    )
}

/// Who is at the keyboard, as far as the shell knows.
fn by(args: &Args) -> String {
    let named = args.by.clone();
    let shell = || {
        ["SUDO_USER", "USER", "LOGNAME"]
            .iter()
            .find_map(|key| std::env::var(key).ok())
    };
    let name: String = named
        .or_else(shell)
        .unwrap_or_default()
        .chars()
        .filter(|c| !c.is_control())
        .take(64)
        .collect();
    if name.trim().is_empty() {
        "unknown".to_owned()
    } else {
        name
    }
}
