//! `enable`: sets on a drive what it needs to obey the bus, after a person has seen old and new values.

use crate::cli::tools::consent::ask_for_consent;
use crate::cli::tools::setup::{self, items, judge, report, text, word_with_meaning};
use crate::cli::tools::{CommandFailure, print, socket};
use serde_json::Value;

/// Arguments of `enable`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the drive, as in the gateway's configuration
    drive: String,
    #[command(flatten)]
    place: socket::SocketArgs,
    /// Do not ask
    #[arg(long)]
    yes: bool,
}

/// Sets what differs. The exit code says what was found afterwards.
pub fn enable(args: &Args) -> Result<(), CommandFailure> {
    let drive = setup::SetupDrive::new(&args.drive, &args.place)?;
    let before = drive.look()?;
    if setup::is_another_drive(&before)
        || items(&before).any(|item| item["result"] == "not_answered")
    {
        print(&report(&before))?;
        judge(&before)?;
    }
    let wrong: Vec<_> = items(&before)
        .filter(|item| item["result"] == "wrong")
        .collect();
    if wrong.is_empty() {
        print(&format!(
            "{}nothing to set over the line\n",
            report(&before)
        ))?;
        return judge(&before);
    }
    let changes = setup::table(wrong.iter().map(|item| change(item)));
    print(&format!(
        "drive {}, at standstill:\n{changes}",
        text(&before, "drive")
    ))?;
    if !args.yes {
        ask_for_consent()?;
    }
    let address = |item: &&Value| {
        item["address"]
            .as_u64()
            .and_then(|address| u16::try_from(address).ok())
    };
    let answer = drive.set(&wrong.iter().filter_map(address).collect::<Vec<_>>())?;
    print(&format!("{}\n", setup::outcome(&answer)))?;
    let after = drive.look()?;
    print(&report(&after))?;
    judge(&after)
}

/// Name, old word, and new word.
fn change(item: &Value) -> [String; 3] {
    let new = item["wanted"]
        .as_array()
        .and_then(|wanted| wanted.first())
        .map_or_else(|| "?".to_owned(), word_with_meaning);
    [
        text(item, "what").to_owned(),
        text(item, "text").to_owned(),
        format!("{} -> {new}", word_with_meaning(&item["found"])),
    ]
}
