//! `journal`: what the gateway has kept, read beside it while it runs.

use super::{Failure, input, print};
use crate::daemon::clock;
use crate::daemon::journal::file_in;
use crate::daemon::journal::reader::{Rows, Seen, connect};
use crate::domain::calendar::{parse, rfc3339};
use crate::domain::time::WallTime;
use crate::journal::{Row, Table};
use rusqlite::Connection;
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::iter::Peekable;
use std::path::PathBuf;

/// Rows that are shown unless it is said how many, or since when.
const LAST_USUAL: usize = 100;
/// Most rows that `--last` takes: they are held in memory.
const LAST_MAX: u64 = 1_000_000;
/// The columns of CSV.
const COLUMNS: &str = "table,number,at,kind,name,by,tried,outcome,reason,count,body\n";

/// Arguments of `journal`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// What is shown
    #[arg(value_enum, default_value_t = Which::All)]
    which: Which,
    /// The gateway's configuration file: the journal is in the data directory that it names
    #[arg(short, long, value_name = "FILE", conflicts_with = "data_dir")]
    config: Option<PathBuf>,
    /// The gateway's data directory
    #[arg(long, value_name = "DIR", default_value = "/var/lib/vfd-gateway")]
    data_dir: PathBuf,
    /// Only rows about this drive
    #[arg(long, value_name = "NAME")]
    drive: Option<String>,
    /// Only rows since a moment in UTC, such as 2026-01-31 or 2026-01-31T08:00, or since so long ago, such as 30min, 12h or 7d
    #[arg(long, value_name = "WHEN", value_parser = when)]
    since: Option<When>,
    /// Only the newest rows, so many; 100 if it is not said since when
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=LAST_MAX))]
    last: Option<u64>,
    /// Print a JSON object for each row
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Print a table for other programs
    #[arg(long)]
    csv: bool,
}

/// Which rows are shown.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Which {
    /// Trips and their clearings
    Trips,
    /// Attempts to write, and what was done without one
    Audit,
    /// Comings and goings of drives, lines and the gateway
    Availability,
    /// All of them
    All,
}

/// Since when.
#[derive(Clone, Copy, Debug)]
enum When {
    At(WallTime),
    Ago(i64),
}

fn when(text: &str) -> Result<When, String> {
    let ago = || {
        let (number, unit) = text.split_at(text.find(|c: char| !c.is_ascii_digit())?);
        let unit: i64 = match unit {
            "s" => 1_000,
            "min" => 60_000,
            "h" => 3_600_000,
            "d" => 86_400_000,
            _ => return None,
        };
        number.parse::<i64>().ok()?.checked_mul(unit).map(When::Ago)
    };
    let found = parse(text).map(When::At).or_else(ago);
    found.ok_or_else(|| "right is a moment such as 2026-01-31T08:00, or a time such as 30min, 12h or 7d".to_owned())
}

/// Prints the rows, oldest first.
pub fn journal(args: &Args) -> Result<(), Failure> {
    let path = match &args.config {
        Some(config) => file_in(&data_dir_of(config)?),
        None => file_in(&args.data_dir),
    };
    if !path.exists() {
        return Err(Failure::failed(format!("{}: there is no journal", path.display())));
    }
    let failed = |error: rusqlite::Error| Failure::failed(format!("{}: {error}", path.display()));
    let connection = connect(&path).map_err(failed)?;
    if args.csv {
        print(COLUMNS)?;
    }
    let last = args.last.map(|last| last as usize).or(args.since.is_none().then_some(LAST_USUAL));
    let mut newest = VecDeque::new();
    for found in Merged::new(&connection, args.which) {
        let found = found.map_err(failed)?;
        if !args.wants(&found.1) {
            continue;
        }
        match last {
            None => print(&args.shown(&found))?,
            Some(last) => {
                newest.push_back(found);
                if newest.len() > last {
                    newest.pop_front();
                }
            }
        }
    }
    newest.iter().try_for_each(|found| print(&args.shown(found)))
}

fn data_dir_of(config: &std::path::Path) -> Result<PathBuf, Failure> {
    input::configuration(config)?.gateway.data_dir.ok_or_else(|| {
        Failure::wrong(format!("{}: without `data_dir` in [gateway] there is no journal", config.display()))
    })
}

impl Args {
    /// Whether a row is shown. A damaged one always is: nobody knows what it was about.
    fn wants(&self, seen: &Seen) -> bool {
        let Seen::Sound(row) = seen else { return true };
        let is_about = self.drive.as_ref().is_none_or(|drive| row.name.as_ref() == Some(drive));
        let since = match self.since {
            None => return is_about,
            Some(When::At(at)) => at.unix_ms,
            Some(When::Ago(millis)) => clock::wall().unix_ms.saturating_sub(millis),
        };
        is_about && row.at.unix_ms >= since
    }

    fn shown(&self, (table, seen): &(Table, Seen)) -> String {
        let (table, number) = (table.name(), seen.number());
        match seen {
            Seen::Damaged(_) if self.json => {
                json!({ "table": table, "number": number, "damaged": true }).to_string() + "\n"
            }
            Seen::Damaged(_) if self.csv => format!("{table},{number},,damaged,,,,,,,\n"),
            Seen::Damaged(_) => format!("{:24} {table} {number} is damaged\n", "?"),
            Seen::Sound(row) => {
                let body: Value = serde_json::from_str(&row.body).unwrap_or(Value::Null);
                if self.json {
                    in_json(table, row, body)
                } else if self.csv {
                    in_csv(table, row, &body)
                } else {
                    in_words(row, &body)
                }
            }
        }
    }
}

fn in_json(table: &str, row: &Row, body: Value) -> String {
    let Row { number, at, kind, name, .. } = row;
    let row = json!({ "table": table, "number": number, "at": rfc3339(*at), "kind": kind, "name": name, "body": body });
    row.to_string() + "\n"
}

fn in_csv(table: &str, row: &Row, body: &Value) -> String {
    let word = |key: &str| match &body[key] {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    let name = row.name.clone().unwrap_or_default();
    let first = [table.to_owned(), row.number.to_string(), rfc3339(row.at), row.kind.clone(), name];
    let others = ["by", "tried", "outcome", "reason", "count"].map(word);
    let fields: Vec<_> = first.into_iter().chain(others).chain([row.body.clone()]).map(|it| quoted(&it)).collect();
    fields.join(",") + "\n"
}

/// As RFC 4180 has it. A text that a spreadsheet would take for a formula is marked as text.
fn quoted(field: &str) -> String {
    let mark = if field.starts_with(['=', '+', '-', '@']) { "'" } else { "" };
    if mark.is_empty() && !field.contains([',', '"', '\n', '\r']) {
        return field.to_owned();
    }
    format!("\"{mark}{}\"", field.replace('"', "\"\""))
}

fn in_words(row: &Row, body: &Value) -> String {
    let word = |key: &str| body[key].as_str().unwrap_or("?").to_owned();
    let name = row.name.as_deref().unwrap_or("gateway");
    let times = match body["count"].as_u64() {
        Some(count) if count > 1 => format!(" ({count} times)"),
        _ => String::new(),
    };
    let said = match row.kind.as_str() {
        "attempt" => {
            let outcome = body["outcome"].as_str().unwrap_or("no end is known");
            let reason = body["reason"].as_str().filter(|reason| *reason != "none");
            let reason = reason.map(|reason| format!(", {reason}")).unwrap_or_default();
            let holder = body["holder"].as_str().map(|holder| format!(" ({holder})")).unwrap_or_default();
            format!("{}: {}: {outcome}{reason}{holder}{times}", body["by"].as_str().unwrap_or("nobody"), word("tried"))
        }
        "failsafe" => format!("fail-safe action {}: {}", word("tried"), word("cause")),
        "lease" => lease(body, &word("by")),
        "stop_given_up" => "a stop was given up: the drive stayed away".to_owned(),
        "tripped" => {
            let text = body["text"].as_str().map(|text| format!(": {text}")).unwrap_or_default();
            let code = body["code"].as_u64().map_or_else(|| "?".to_owned(), |code| code.to_string());
            format!("tripped, code {code}{text} (event {})", row.number)
        }
        "cleared" => format!("the trip is cleared (event {})", row.number),
        _ => {
            let reason = body["reason"].as_str().map(|reason| format!(": {reason}")).unwrap_or_default();
            format!("{} {}{reason}", row.kind, word("state"))
        }
    };
    // What a client sent as text must not move the cursor of whoever reads it.
    let said: String = said.chars().map(|c| if c.is_control() { '?' } else { c }).collect();
    format!("{} {name} {said}\n", rfc3339(row.at))
}

/// How control changed hands, and who is it about.
fn lease(body: &Value, owner: &str) -> String {
    match body["state"].as_str().unwrap_or("?") {
        "opened" => format!("{owner} holds control"),
        "ended" => format!("{owner} does not hold control any more"),
        "taken_over" => format!("{owner} took control over from {}", body["from"].as_str().unwrap_or("?")),
        "orphaned" => format!("{owner} held control when the gateway ended, and is awaited"),
        "taken_up" => format!("{owner} is back and holds control"),
        state => format!("lease {state}: {owner}"),
    }
}

/// The rows of several tables by their moments. Each table stays in its own order, whatever the clock did.
struct Merged<'c>(Vec<(Table, Peekable<Rows<'c>>)>);

impl<'c> Merged<'c> {
    fn new(connection: &'c Connection, which: Which) -> Self {
        let tables: &[Table] = match which {
            Which::Trips => &[Table::Event],
            Which::Audit => &[Table::Audit],
            Which::Availability => &[Table::Availability],
            Which::All => &Table::ALL,
        };
        Self(tables.iter().map(|table| (*table, Rows::after(connection, *table, 0).peekable())).collect())
    }
}

impl Iterator for Merged<'_> {
    type Item = Result<(Table, Seen), rusqlite::Error>;

    fn next(&mut self) -> Option<Self::Item> {
        let moment = |rows: &mut Peekable<Rows<'_>>| match rows.peek()? {
            Ok(Seen::Sound(row)) => Some(row.at.unix_ms),
            // At once: no moment is known, and an error ends everything.
            Ok(Seen::Damaged(_)) | Err(_) => Some(i64::MIN),
        };
        let moments = self.0.iter_mut().enumerate().filter_map(|(place, (_, rows))| Some((moment(rows)?, place)));
        let (_, place) = moments.min()?;
        let (table, rows) = self.0.get_mut(place)?;
        rows.next().map(|seen| seen.map(|seen| (*table, seen)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_survives_what_clients_send() {
        let table = [("a", "a"), ("a,b", "\"a,b\""), ("say \"no\"", "\"say \"\"no\"\"\""), ("=1+1", "\"'=1+1\"")];
        for (field, right) in table {
            assert_eq!(quoted(field), right);
        }
    }

    #[test]
    fn moments_and_times_are_told_apart() {
        assert!(matches!(when("2026-01-31T08:00"), Ok(When::At(_))));
        assert!(matches!(when("7d"), Ok(When::Ago(604_800_000))));
        for wrong in ["", "7", "d", "7 d", "7w", "99999999999999999999d", "9223372036854775807d"] {
            assert!(when(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn rows_have_words_and_no_control_characters() {
        let at = WallTime { unix_ms: 0 };
        let attempt =
            json!({ "by": "mqtt", "tried": "run\u{1b}[2J", "outcome": "refused", "reason": "tripped", "count": 3 });
        let row = Row::new(at, "attempt", Some("pump-1"), &attempt);
        let said = in_words(&row, &attempt);
        assert_eq!(said, "1970-01-01T00:00:00.000Z pump-1 mqtt: run?[2J: refused, tripped (3 times)\n");
        let down = json!({ "state": "down", "reason": "the port is gone" });
        let said = in_words(&Row::new(at, "line", Some("hall-1"), &down), &down);
        assert_eq!(said, "1970-01-01T00:00:00.000Z hall-1 line down: the port is gone\n");
    }
}
