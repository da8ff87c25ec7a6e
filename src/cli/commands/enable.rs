//! `enable`: sets on a drive what it needs to obey the bus, after a person has seen old and new values.

use crate::cli::tools::consent::ask_for_consent;
use crate::cli::tools::setup::{self, found_word, judge, report, word_with_meaning};
use crate::cli::tools::{CommandFailure, print, socket};
use crate::north::api::SetupItemDocument;

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
    let before = drive.read_settings()?.known;
    let items = before.items.iter();
    if setup::is_another_drive(&before) || items.clone().any(|item| item.result == "not_answered") {
        print(&report(&before))?;
        judge(&before)?;
    }
    let wrong: Vec<_> = items.filter(|item| item.result == "wrong").collect();
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
        before.drive
    ))?;
    if !args.yes {
        ask_for_consent()?;
    }
    let answer = drive.set(wrong.iter().filter_map(|item| item.address).collect())?;
    print(&format!("{}\n", setup::outcome(&answer)))?;
    let after = drive.read_settings()?.known;
    print(&report(&after))?;
    judge(&after)
}

/// Name, old word, and new word.
fn change(item: &SetupItemDocument) -> [String; 3] {
    let new = item
        .wanted
        .first()
        .map_or_else(|| "?".to_owned(), word_with_meaning);
    [
        item.what.to_string(),
        item.text.to_string(),
        format!("{} -> {new}", found_word(&item.seen)),
    ]
}
