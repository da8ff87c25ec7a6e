//! `usage`: shows what drives have used, in all and on each day, or sets the sums of one back to 0.

use crate::cli::tools::consent::ask_for_consent;
use crate::cli::tools::data_dir::DataDirArgs;
use crate::cli::tools::setup::unknown;
use crate::cli::tools::socket::{self, SocketRequest};
use crate::cli::tools::{CommandFailure, print};
use crate::daemon::http::socket::SOCKET_NAME;
use crate::daemon::journal::days::{DayRow, columns, each_day};
use crate::daemon::journal::file_in;
use crate::daemon::journal::reader::connect;
use crate::domain::ids::Name;
use crate::north::api::{UsageDocument, UsageResetDocument};
use crate::north::titles::{PlantTitles, labelled};
use axum::http::StatusCode;
use serde_json::json;
use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::time::Duration;

/// Days that are shown of each drive by default.
const DAYS_USUAL: usize = 14;
/// Longest time for the gateway's answer.
const PATIENCE: Duration = Duration::from_secs(10);

/// Arguments of `usage`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Name of the drive; default: all drives
    drive: Option<String>,
    #[command(flatten)]
    place: DataDirArgs,
    /// The newest days of each drive, at most this many; default: 14, or all with --csv and --json
    #[arg(long, value_name = "N")]
    days: Option<usize>,
    /// Print one JSON object per day
    #[arg(long, conflicts_with_all = ["csv", "reset"])]
    json: bool,
    /// Print CSV
    #[arg(long, conflicts_with = "reset")]
    csv: bool,
    /// Set energy, running hours, starts and trips of the drive back to 0, for a new motor or drive. Days stay
    #[arg(long, requires = "drive", conflicts_with = "days")]
    reset: bool,
    /// Do not ask
    #[arg(long, requires = "reset")]
    yes: bool,
}

/// Prints the days of each drive, oldest first, or resets the sums of one.
pub fn usage(args: &Args) -> Result<(), CommandFailure> {
    let (directory, titles) = args.place.read()?;
    match (&args.drive, args.reset) {
        (Some(drive), true) => reset(&directory, drive, args.yes),
        _ => show(&directory, &titles, args),
    }
}

fn show(directory: &Path, titles: &PlantTitles, args: &Args) -> Result<(), CommandFailure> {
    let path = file_in(directory);
    if !path.exists() {
        return Err(CommandFailure::failed(format!(
            "{}: there is no journal",
            path.display()
        )));
    }
    let failed =
        |error: rusqlite::Error| CommandFailure::failed(format!("{}: {error}", path.display()));
    let most = args.days.unwrap_or(if args.csv || args.json {
        usize::MAX
    } else {
        DAYS_USUAL
    });
    let mut drives: BTreeMap<String, VecDeque<DayRow>> = BTreeMap::new();
    let connection = connect(&path).map_err(failed)?;
    each_day(&connection, args.drive.as_deref(), |row| {
        let days = drives.entry(row.drive.clone()).or_default();
        days.push_back(row);
        if days.len() > most {
            days.pop_front();
        }
    })
    .map_err(failed)?;
    if args.csv {
        print(&columns(titles))?;
    } else if drives.is_empty() && !args.json {
        return print("no usage recorded yet\n");
    }
    for (drive, days) in &drives {
        let shown: String = match (args.csv, args.json) {
            (true, _) => days.iter().map(|day| day.in_csv(titles)).collect(),
            (_, true) => days
                .iter()
                .map(|day| json!(day.document()).to_string() + "\n")
                .collect(),
            _ => table(&labelled(drive, titles.drives.get(drive)), days),
        };
        print(&shown)?;
    }
    Ok(())
}

/// The days of one drive for people, below its label.
fn table(label: &str, days: &VecDeque<DayRow>) -> String {
    let mut text =
        format!("{label}\n  day         energy kWh  from     running h  starts  trips\n");
    for day in days {
        let row = day.document();
        let energy = row.energy_kwh;
        let energy = energy.map_or_else(|| "-".to_owned(), |energy| format!("{energy:.2}"));
        text += &format!(
            "  {}  {energy:>10}  {:7}  {:>9.2}  {:>6}  {:>5}\n",
            row.day,
            row.energy_from.as_deref().unwrap_or("-"),
            row.running_hours,
            row.starts,
            row.trips
        );
    }
    text
}

/// Asks the running gateway, because it continues from the sums that it holds.
fn reset(directory: &Path, drive: &str, yes: bool) -> Result<(), CommandFailure> {
    let name = Name::new(drive)
        .ok_or_else(|| CommandFailure::wrong(format!("`{drive}` is not a valid drive name")))?;
    if !yes {
        print(&format!(
            "energy, running hours, starts and trips of {name} restart at 0\n"
        ))?;
        ask_for_consent()?;
    }
    let socket = directory.join(SOCKET_NAME);
    let path = format!("/api/v1/drives/{name}/usage/reset");
    let question = SocketRequest::post(&path);
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    let at = socket.display();
    match runtime.block_on(socket::ask(&socket, question, PATIENCE)) {
        Ok((StatusCode::OK, answer)) => {
            let UsageResetDocument { before, .. } =
                socket::document(answer).map_err(CommandFailure::failed)?;
            print(&format!("{name} was at {}\n", words(&before)))
        }
        Ok((StatusCode::NOT_FOUND, answer)) => Err(CommandFailure::wrong(unknown(answer))),
        Ok((status, _)) => Err(CommandFailure::failed(format!(
            "gateway at {at}: it answers {status}"
        ))),
        Err(reason) => Err(CommandFailure::failed(format!("gateway at {at}: {reason}"))),
    }
}

/// Sums in words; those that the drive does not have are left out.
fn words(sums: &UsageDocument) -> String {
    let parts = [
        sums.energy_kwh.map(|energy| format!("{energy:?} kWh")),
        sums.running_hours.map(|hours| format!("{hours:?} h")),
        sums.starts.map(|starts| format!("{starts} starts")),
        sums.trips.map(|trips| format!("{trips} trips")),
    ];
    let known: Vec<_> = parts.into_iter().flatten().collect();
    known.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::usage::{EnergySource, UsageTotals};
    use crate::journal::days::{DayNumber, DayUsage};
    use crate::north::titles::PartTitle;

    fn day(energy_from: Option<EnergySource>) -> DayRow {
        let totals = UsageTotals {
            energy_mj: 5_400_000_000,
            running: Duration::from_secs(5400),
            starts: 3,
            trips: 1,
        };
        DayRow {
            drive: "pump-1".into(),
            day: DayNumber(20_000),
            usage: DayUsage {
                totals,
                energy_from,
            },
        }
    }

    #[test]
    fn a_day_is_shown_in_each_form() {
        let rows = VecDeque::from([day(Some(EnergySource::Counter)), day(None)]);
        let text = table("pump-1", &rows);
        let lines: Vec<_> = text
            .lines()
            .map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "))
            .collect();
        assert_eq!(lines[2], "2024-10-04 1.50 counter 1.50 3 1");
        assert_eq!(lines[3], "2024-10-04 - - 1.50 3 1", "no energy is known");
        let none = PlantTitles::default();
        assert_eq!(
            rows[0].in_csv(&none),
            "2024-10-04,pump-1,1.50,counter,1.50,3,1\n"
        );
        assert_eq!(rows[1].in_csv(&none), "2024-10-04,pump-1,,,1.50,3,1\n");
        let title = PartTitle::new("+Pumpe, \"Süd\"").unwrap();
        let titles = PlantTitles {
            drives: BTreeMap::from([("pump-1".to_owned(), title)]),
            ..PlantTitles::default()
        };
        assert_eq!(
            columns(&titles) + &rows[1].in_csv(&titles),
            "day,drive,energy_kwh,energy_from,running_hours,starts,trips,title\n\
             2024-10-04,pump-1,,,1.50,3,1,\"'+Pumpe, \"\"Süd\"\"\"\n"
        );
        assert_eq!(rows[1].document().energy_kwh, None);
    }

    #[test]
    fn sums_that_a_drive_does_not_have_are_left_out() {
        let sums = json!({ "energy_kwh": null, "running_hours": 1.5, "starts": 3, "trips": 0 });
        let sums = serde_json::from_value(sums).unwrap();
        assert_eq!(words(&sums), "1.5 h, 3 starts, 0 trips");
    }
}
