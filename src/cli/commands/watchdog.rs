//! `watchdog`: shows how a drive monitors its communication, or sets it, after a person has seen old and new values.

use crate::cli::tools::consent::ask_for_consent;
use crate::cli::tools::setup::{self, found_word, outcome, text_or_unknown};
use crate::cli::tools::{CommandFailure, print, socket};
use crate::north::api::SetupDocument;
use crate::toml_file::values::parse_duration;
use std::time::Duration;

/// Arguments of `watchdog`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the drive, as in the gateway's configuration
    drive: String,
    #[command(flatten)]
    place: socket::SocketArgs,
    /// Set it to this time, such as 5s, or off
    #[arg(long, value_name = "TIME", value_parser = time)]
    set: Option<WatchdogTime>,
    /// Do not ask
    #[arg(long)]
    yes: bool,
}

/// What the watchdog is set to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WatchdogTime {
    Off,
    After(Duration),
}

fn time(text: &str) -> Result<WatchdogTime, String> {
    if text.eq_ignore_ascii_case("off") {
        return Ok(WatchdogTime::Off);
    }
    let time = parse_duration(text).filter(|time| !time.is_zero());
    time.map(WatchdogTime::After)
        .ok_or_else(|| "a time such as 5s or 2500ms, or off, is expected".to_owned())
}

/// Shows it, or sets it and shows it. It fails unless it is on, or off if that was requested.
pub fn watchdog(args: &Args) -> Result<(), CommandFailure> {
    let drive = setup::SetupDrive::new(&args.drive, &args.place)?;
    let before = drive.read_settings()?.known;
    let watchdog = before.watchdog.as_ref();
    let settable = watchdog.filter(|it| it.state == "on" || it.state == "off");
    let (Some(wanted), Some(watchdog)) = (args.set, settable) else {
        print(&setup::watchdog(watchdog))?;
        return judge(&before, "on");
    };
    let name = &before.drive;
    let what = text_or_unknown(watchdog.what.as_deref());
    let (old, new) = (found_word(&watchdog.seen), called(wanted));
    print(&format!(
        "drive {name}, at standstill:\n  {what}  {old} -> {new}\n"
    ))?;
    if !args.yes {
        ask_for_consent()?;
    }
    let answer = drive.set_watchdog(match wanted {
        WatchdogTime::Off => None,
        WatchdogTime::After(time) => Some(time),
    })?;
    print(&format!("{}\n", outcome(&answer)))?;
    let after = drive.read_settings()?.known;
    print(&setup::watchdog(after.watchdog.as_ref()))?;
    if !matches!(&*answer.outcome, "confirmed" | "acknowledged") {
        return Err(CommandFailure::failed(format!(
            "{name}: {}",
            outcome(&answer)
        )));
    }
    judge(
        &after,
        if wanted == WatchdogTime::Off {
            "off"
        } else {
            "on"
        },
    )
}

fn called(time: WatchdogTime) -> String {
    match time {
        WatchdogTime::Off => "off".to_owned(),
        WatchdogTime::After(time) => format!("{} s", time.as_secs_f64()),
    }
}

fn judge(seen: &SetupDocument, wanted: &str) -> Result<(), CommandFailure> {
    let why = match &seen.watchdog {
        Some(watchdog) if watchdog.state == *wanted => return Ok(()),
        Some(watchdog) if watchdog.state == "off" => "its watchdog is off",
        Some(watchdog) if watchdog.state == "on" => "its watchdog is on",
        Some(_) => "its watchdog could not be read",
        None => "no watchdog is known for this model",
    };
    Err(CommandFailure::failed(format!("{}: {why}", seen.drive)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_time_has_its_unit() {
        assert_eq!(time("5s"), Ok(WatchdogTime::After(Duration::from_secs(5))));
        assert_eq!(
            time("2500ms"),
            Ok(WatchdogTime::After(Duration::from_millis(2500)))
        );
        assert_eq!(time("OFF"), Ok(WatchdogTime::Off));
        assert!(
            ["0s", "5", "-1s", "2.5s", ""]
                .into_iter()
                .all(|wrong| time(wrong).is_err())
        );
    }

    #[test]
    fn what_was_not_wanted_is_a_failure() {
        let seen = |state: Option<&str>| {
            let watchdog = state.map(|state| json!({ "state": state }));
            serde_json::from_value(json!({ "drive": "d", "watchdog": watchdog })).unwrap()
        };
        assert!(judge(&seen(Some("on")), "on").is_ok() && judge(&seen(Some("off")), "off").is_ok());
        for (state, said) in [
            (Some("off"), "d: its watchdog is off"),
            (Some("not_answered"), "d: its watchdog could not be read"),
            (None, "d: no watchdog is known for this model"),
        ] {
            assert_eq!(judge(&seen(state), "on").unwrap_err().message, said);
        }
    }
}
