//! `watch`: registers or named values of one drive, again and again: a table on a terminal, else a line when something
//! changes.

mod view;

use crate::cli::tools::CommandFailure;
use crate::cli::tools::client::{NoAnswer, UnitClient};
use crate::cli::tools::log::complain;
use crate::cli::tools::reading::{ReadRequest, ReadSelection, ShownValue};
use crate::daemon::host::clock;
use crate::daemon::service::signals::told_to_end;
use crate::domain::time::MonoTime;
use serde_json::json;
use std::io::{self, Write};
use std::ops::RangeInclusive;
use std::pin::pin;
use std::time::Duration;
use tokio::time::{MissedTickBehavior, interval};
use view::TerminalView;

/// Arguments of `watch`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    what: ReadSelection,
    /// Interval, such as 500ms or 2s
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = every)]
    every: Duration,
    /// Print every reading, not only changes
    #[arg(long)]
    all: bool,
    /// Print lines on a terminal too, instead of redrawing a table
    #[arg(long)]
    plain: bool,
}

impl Args {
    /// Whether there is no gateway between.
    pub const fn is_straight(&self) -> bool {
        self.what.is_straight()
    }

    /// Whether it is a table: on a terminal, unless lines are requested.
    fn is_table(&self) -> bool {
        !self.plain && !self.all && !self.what.json && TerminalView::is_possible()
    }
}

/// Sensible intervals: as fast as a person could want, up to a day.
const EVERY: RangeInclusive<Duration> = Duration::from_millis(10)..=Duration::from_secs(24 * 3600);

fn every(text: &str) -> Result<Duration, String> {
    let (number, unit) = text.split_at(
        text.find(|c: char| !c.is_ascii_digit())
            .unwrap_or(text.len()),
    );
    let millis = match unit {
        "ms" => 1,
        "s" => 1000,
        "min" => 60_000,
        _ => 0,
    };
    let time = number
        .parse::<u32>()
        .ok()
        .map(|number| Duration::from_millis(u64::from(number) * millis));
    time.filter(|time| EVERY.contains(time))
        .ok_or_else(|| "a time from 10ms to a day, such as 500ms or 2s".to_owned())
}

/// Reads until SIGINT or SIGTERM, or until the output has no reader. A failure is reported once and then retried; only
/// the first attempt must succeed in connecting.
pub fn watch(args: &Args) -> Result<(), CommandFailure> {
    let asked = args.what.asked()?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    runtime.block_on(async {
        let mut stop_signal = pin!(told_to_end().map_err(CommandFailure::failed)?);
        let mut reached = tokio::select! {
            () = &mut stop_signal => return Ok(()),
            reached = args.what.reach() => reached?,
        };
        let ended = tokio::select! {
            () = &mut stop_signal => Ok(()),
            ended = show(args, &asked, &mut reached.client) => ended,
        };
        reached.close().await;
        ended
    })
}

async fn show(
    args: &Args,
    asked: &ReadRequest,
    client: &mut UnitClient,
) -> Result<(), CommandFailure> {
    let mut ticks = interval(args.every);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    if args.is_table() {
        // Before the terminal is taken, so that an immediate failure can be read.
        let first = asked.read(client).await?;
        let mut view = TerminalView::open(args.what.title())?;
        view.values(first, clock::now());
        loop {
            view.draw(clock::now())?;
            ticks.tick().await;
            match asked.read(client).await {
                Ok(values) => view.values(values, clock::now()),
                Err(error) => view.trouble(&error.to_string()),
            }
        }
    }
    let mut screen = WatchScreen {
        args,
        begun: clock::now(),
        last: None,
        complaint: None,
    };
    loop {
        ticks.tick().await;
        if !screen.print_changes(client, asked).await? {
            return Ok(());
        }
    }
}

/// What was last printed.
struct WatchScreen<'a> {
    args: &'a Args,
    begun: MonoTime,
    last: Option<Vec<ShownValue>>,
    complaint: Option<String>,
}

impl WatchScreen<'_> {
    /// Reads once and prints what has changed. Returns whether the output still has a reader.
    async fn print_changes(
        &mut self,
        client: &mut UnitClient,
        asked: &ReadRequest,
    ) -> Result<bool, CommandFailure> {
        match asked.read(client).await {
            Ok(values) => {
                self.complaint = None;
                let lines = self.lines(&values);
                self.last = Some(values);
                put(&lines)
            }
            Err(NoAnswer::Unreachable(reason))
                if self.last.is_none() && self.complaint.is_none() =>
            {
                Err(CommandFailure::failed(reason))
            }
            Err(error) => {
                let text = error.to_string();
                if self.complaint.as_ref() != Some(&text) {
                    complain(format!("{text}; trying again\n").as_bytes());
                    self.complaint = Some(text);
                }
                Ok(true)
            }
        }
    }

    fn lines(&self, values: &[ShownValue]) -> String {
        let seconds = clock::now().since(self.begun).as_secs_f64();
        let was = |at: usize| self.last.as_ref().and_then(|last| last.get(at));
        let is_new = |(at, value): &(usize, &ShownValue)| self.args.all || was(*at) != Some(*value);
        let line = |(_, value): (usize, &ShownValue)| {
            if !self.args.what.json {
                return format!("{seconds:9.1} s  {}  {}\n", value.label, value.text());
            }
            let mut json = value.json();
            json["seconds"] = json!((seconds * 1000.0).round() / 1000.0);
            format!("{json}\n")
        };
        values.iter().enumerate().filter(is_new).map(line).collect()
    }
}

/// Prints at once. Returns whether the output still has a reader.
fn put(text: &str) -> Result<bool, CommandFailure> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(CommandFailure::failed(error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_a_unit_and_a_sensible_size() {
        assert_eq!(every("500ms"), Ok(Duration::from_millis(500)));
        assert_eq!(every("2s"), Ok(Duration::from_secs(2)));
        assert_eq!(every("5min"), Ok(Duration::from_secs(300)));
        for wrong in [
            "",
            "1",
            "s",
            "0s",
            "9ms",
            "2days",
            "99999999999999s",
            "1441min",
            "-1s",
            "1.5s",
        ] {
            assert!(every(wrong).is_err(), "{wrong}");
        }
    }
}
