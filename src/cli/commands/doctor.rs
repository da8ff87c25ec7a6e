//! `doctor`: observes the lines of the running gateway for a while and reports what is wrong with them.

use crate::cli::tools::socket::{self, SocketRequest};
use crate::cli::tools::{CommandFailure, WordTone, log, print, toned};
use crate::daemon::http::report::SPAN_SECONDS;
use crate::daemon::http::socket::SOCKET_NAME;
use crate::north::api::{
    AdviceDocument, DriveReportDocument, ErrorDocument, FindingDocument, HealthDocument,
    LineReportDocument, PassedOn,
};
use crate::north::finding::FindingSign;
use crate::north::titles::labelled;
use axum::http::StatusCode;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::{IsTerminal, stderr};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tokio::time::interval;

/// Longest time for an answer that needs no waiting, and the allowance beyond the observed span.
const PATIENCE: Duration = Duration::from_secs(5);
/// Lines that are watched at once.
const AT_ONCE: usize = 8;
/// What the doctor names of a drive beside its frames: a motor that does not do what was ordered.
const OF_MOTION: [FindingSign; 6] = [
    FindingSign::MayStillRun,
    FindingSign::NotEffective,
    FindingSign::OutputOutside,
    FindingSign::StoppedElsewhere,
    FindingSign::CommanderLost,
    FindingSign::FailSafe,
];
/// Cells of the progress bar.
const BAR_CELLS: u64 = 30;

/// The report of a line.
type WatchedLine = PassedOn<LineReportDocument>;
/// A finding of the gateway.
type PrintedFinding = PassedOn<FindingDocument>;

/// Arguments of `doctor`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    place: socket::SocketArgs,
    /// The gateway's data directory, with its socket
    #[arg(long, value_name = "DIR", conflicts_with_all = ["config", "socket"])]
    data_dir: Option<PathBuf>,
    /// Only this line, by its name in the gateway's configuration
    #[arg(long, value_name = "NAME")]
    line: Option<String>,
    /// How long to observe
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u64).range(SPAN_SECONDS))]
    seconds: u64,
    /// Print the gateway's JSON
    #[arg(long)]
    json: bool,
}

/// Prints a report of each line, and what is wrong with the gateway itself. It fails if there is a problem.
pub fn doctor(args: &Args) -> Result<(), CommandFailure> {
    let socket = match &args.data_dir {
        Some(directory) => directory.join(SOCKET_NAME),
        None => args.place.path()?,
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    let reports = runtime.block_on(watch(&socket, args))?;
    let advice = runtime.block_on(advice(&socket));
    let (own, drives) = (own_findings(&advice), of_motion(&advice, &reports));
    print(&if args.json {
        format!(
            "{}\n",
            json!({ "lines": reports, "drives": drives, "gateway": own })
        )
    } else {
        format!(
            "{}{}{}",
            text(&reports),
            section("drives", &drives),
            section("gateway", &own)
        )
    })?;
    let of_lines = reports.iter().flat_map(|report| &report.known.verdict);
    let others = drives.iter().chain(&own).map(|finding| &finding.known);
    match of_lines
        .chain(others)
        .filter(|finding| finding.severity == "problem")
        .count()
    {
        0 => Ok(()),
        1 => Err(CommandFailure::failed("one problem was found")),
        problems => Err(CommandFailure::failed(format!(
            "{problems} problems were found"
        ))),
    }
}

/// The reports of all requested lines, in the order of the configuration.
async fn watch(socket: &Path, args: &Args) -> Result<Vec<WatchedLine>, CommandFailure> {
    let failed = |reason: String| {
        CommandFailure::failed(format!("gateway at {}: {reason}", socket.display()))
    };
    let health: HealthDocument = fetch_document(socket, "/api/v1/health", PATIENCE)
        .await
        .map_err(failed)?;
    let lines = health.lines.iter();
    let all: Vec<_> = lines.map(|line| line.name.to_string()).collect();
    let wanted: Vec<_> = all
        .iter()
        .filter(|name| args.line.as_ref().is_none_or(|line| line == *name))
        .collect();
    if let (true, Some(line)) = (wanted.is_empty(), &args.line) {
        return Err(CommandFailure::wrong(format!(
            "no line is called {line}; the lines are: {}",
            all.join(", ")
        )));
    }
    let mut reports = Vec::with_capacity(wanted.len());
    for some in wanted.chunks(AT_ONCE) {
        let asked = some.iter().map(|name| {
            let socket = socket.to_owned();
            let path = format!("/api/v1/lines/{name}/report?seconds={}", args.seconds);
            let patience = PATIENCE + Duration::from_secs(args.seconds);
            tokio::spawn(async move { fetch_document(&socket, &path, patience).await })
        });
        let asked: Vec<_> = asked.collect();
        let progress = tokio::spawn(progress(args.seconds));
        for answer in asked {
            reports.push(
                answer
                    .await
                    .map_err(CommandFailure::failed)?
                    .map_err(failed)?,
            );
        }
        progress.abort();
        print_progress("\r\x1b[K");
    }
    Ok(reports)
}

/// What the gateway finds wrong at present. Empty if its version does not report it.
async fn advice(socket: &Path) -> Vec<PrintedFinding> {
    let answer = fetch_document(socket, "/api/v1/advice", PATIENCE).await;
    answer
        .map(|AdviceDocument { advice }| advice)
        .unwrap_or_default()
}

/// What is wrong with the gateway itself: its broker, its journal, its socket.
fn own_findings(advice: &[PrintedFinding]) -> Vec<&PrintedFinding> {
    advice
        .iter()
        .filter(|PassedOn { known, .. }| known.line.is_none() && known.drive.is_none())
        .collect()
}

/// What the motors on the watched lines do that was not ordered. What their frames show is in the reports.
fn of_motion<'a>(advice: &'a [PrintedFinding], reports: &[WatchedLine]) -> Vec<&'a PrintedFinding> {
    let is_watched = |finding: &FindingDocument| {
        let mut lines = reports.iter().map(|report| &*report.known.line);
        lines.any(|line| finding.line.as_deref() == Some(line))
    };
    let is_of_motion =
        |finding: &FindingDocument| OF_MOTION.iter().any(|it| finding.sign == it.keyword());
    advice
        .iter()
        .filter(|finding| is_of_motion(&finding.known) && is_watched(&finding.known))
        .collect()
}

async fn fetch_document<T: DeserializeOwned>(
    socket: &Path,
    path: &str,
    patience: Duration,
) -> Result<T, String> {
    match socket::ask(socket, SocketRequest::get(path), patience).await? {
        (StatusCode::OK, answer) => socket::document(answer),
        (status, answer) => {
            let ErrorDocument { error } = socket::refusal(answer);
            Err(error.unwrap_or_else(|| format!("{path} answers {status}")))
        }
    }
}

/// Shows how much of the time has passed, until it is aborted.
async fn progress(seconds: u64) {
    let mut second = interval(Duration::from_secs(1));
    for passed in 0..=seconds {
        second.tick().await;
        print_progress(&bar(passed, seconds));
    }
}

fn bar(passed: u64, seconds: u64) -> String {
    let done = (passed * BAR_CELLS / seconds.max(1)) as usize;
    format!(
        "\r[{}{}] {passed} of {seconds} s",
        "#".repeat(done),
        ".".repeat(BAR_CELLS as usize - done)
    )
}

/// For a user at a terminal, besides the report.
fn print_progress(text: &str) {
    if stderr().is_terminal() {
        log::complain(text.as_bytes());
    }
}

/// `findings` below `title`; empty if there is none.
fn section(title: &str, findings: &[&PrintedFinding]) -> String {
    let rows = findings.iter().map(|finding| finding_row(&finding.known));
    if findings.is_empty() {
        String::new()
    } else {
        format!("\n{title}\n{}", rows.collect::<String>())
    }
}

fn finding_row(finding: &FindingDocument) -> String {
    let FindingDocument { severity, text, .. } = finding;
    let tone = match &**severity {
        "good" => WordTone::Good,
        "problem" => WordTone::Problem,
        _ => WordTone::Notice,
    };
    // The text of a report names its drive itself.
    let drive = match &finding.drive {
        Some(drive) if !text.starts_with(drive.as_str()) => {
            format!("{}: ", labelled(drive, finding.title.as_ref()))
        }
        _ => String::new(),
    };
    format!("  {}: {drive}{text}\n", toned(tone, severity))
}

/// The reports for people. Missing values are shown as `?` or `-`: another version may send less.
fn text(reports: &[WatchedLine]) -> String {
    let lines: Vec<_> = reports.iter().map(|report| line(&report.known)).collect();
    lines.join("\n")
}

fn line(report: &LineReportDocument) -> String {
    let rates = &report.rates;
    // A line over Modbus TCP has no speed and no characters.
    let link = match &report.link {
        Some(link) => format!("{link} on "),
        None => String::new(),
    };
    let mut text = format!(
        "line {} ({link}{}): {}, watched for {} s\n",
        report.line,
        report.port,
        report.state,
        number(report.observed_s)
    );
    let share =
        |share: Option<f64>| share.map_or("?".to_owned(), |share| format!("{:.2} %", share / 10.0));
    // Writing to a String cannot fail.
    let _ = writeln!(
        text,
        "  {} exchanges: {} good, {} silent, {} damaged; {} with frames that answer nothing",
        number(rates.exchanges),
        share(rates.good_per_mille),
        share(rates.silent_per_mille),
        share(rates.garbled_per_mille),
        share(rates.stray_per_mille)
    );
    for (count, what) in [
        (rates.noise_bytes, "bytes that form no frame"),
        (rates.foreign, "frames from stations that were not asked"),
        (rates.other_master, "requests from another master"),
        (rates.echoes, "echoes of our own frames"),
    ] {
        if count > 0 {
            let _ = writeln!(text, "  {count} {what}");
        }
    }
    text.push_str(&drives(&report.drives));
    text.extend(report.verdict.iter().map(finding_row));
    text
}

/// The drives as tables: their exchanges, and the times of their replies if there are any.
fn drives(drives: &[DriveReportDocument]) -> String {
    let mut text = table(&exchanges(drives));
    let times = reply_times(drives);
    if times.len() > 1 {
        text.push_str(&table(&times));
    }
    text
}

/// A header, and how often each drive was asked and answered.
fn exchanges(drives: &[DriveReportDocument]) -> Vec<Vec<String>> {
    let header = [
        "drive",
        "is",
        "station",
        "exchanges",
        "silent",
        "damaged",
        "late",
        "doubled",
    ]
    .map(str::to_owned);
    let counts = drives.iter().map(|drive| {
        vec![
            drive.name.to_string(),
            drive.presence.to_string(),
            number(drive.station),
            number(drive.exchanges),
            number(drive.silent),
            number(drive.damaged),
            number(drive.late),
            number(drive.doubled),
        ]
    });
    [header.to_vec()].into_iter().chain(counts).collect()
}

/// A header, and how long each drive took for each kind of reply.
fn reply_times(drives: &[DriveReportDocument]) -> Vec<Vec<String>> {
    let header = [
        "ms to a reply",
        "to a",
        "replies",
        "50 %",
        "90 %",
        "99 %",
        "99.9 %",
        "longest",
        "waited for",
        "suggested",
    ]
    .map(str::to_owned);
    let times = drives.iter().flat_map(|drive| {
        drive.replies.iter().map(|reply| {
            vec![
                drive.name.replace('_', " "),
                reply.class.replace('_', " "),
                number(reply.count),
                number(reply.p50_ms),
                number(reply.p90_ms),
                number(reply.p99_ms),
                number(reply.p999_ms),
                number(reply.max_ms),
                number(reply.timeout_ms),
                number(reply.suggested_timeout_ms),
            ]
        })
    });
    [header.to_vec()].into_iter().chain(times).collect()
}

fn number(number: Option<impl Into<Value>>) -> String {
    number.map_or_else(|| "-".to_owned(), |number| number.into().to_string())
}

/// `rows` with their columns under each other, the first two to the left and the rest, which are numbers, to the right.
fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        rows.iter()
            .filter_map(|row| row.get(column))
            .map(|cell| cell.chars().count())
            .max()
            .unwrap_or(0)
    };
    let widths: Vec<_> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells =
            row.iter()
                .zip(&widths)
                .enumerate()
                .map(|(column, (cell, width))| match column {
                    0 | 1 => format!("{cell:<width$}"),
                    _ => format!("{cell:>width$}"),
                });
        format!("  {}\n", cells.collect::<Vec<_>>().join("  ").trim_end())
    };
    rows.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A document as it is read from the wire.
    fn parsed<T: DeserializeOwned>(json: Value) -> T {
        serde_json::from_value(json).unwrap()
    }

    #[test]
    fn a_report_is_reported_as_tables_with_what_to_do() {
        let replies = json!([{ "class": "stored_write", "count": 7, "p50_ms": 4.25, "p90_ms": 5.0, "p99_ms": 6.0,
            "p999_ms": 7.0, "max_ms": 9.0, "timeout_ms": 500.0, "suggested_timeout_ms": null }]);
        let report = json!({ "line": "hall-1", "link": "9600 8N1", "port": "/dev/ttyUSB0", "state": "up", "observed_s": 30.0,
            "rates": { "exchanges": 200, "good_per_mille": 985.0, "silent_per_mille": 5.0, "garbled_per_mille": 10.0,
                "stray_per_mille": 0.0, "noise_bytes": 14, "foreign": 0, "other_master": 0, "echoes": 0 },
            "drives": [{ "name": "pump-1", "presence": "online", "station": 1, "exchanges": 200, "silent": 1, "damaged": 2,
                "late": 0, "doubled": 0, "replies": replies }],
            "verdict": [{ "severity": "problem", "text": "pump-1: check termination" }] });
        let right = "line hall-1 (9600 8N1 on /dev/ttyUSB0): up, watched for 30.0 s\n  \
            200 exchanges: 98.50 % good, 0.50 % silent, 1.00 % damaged; 0.00 % with frames that \
            answer nothing\n  \
            14 bytes that form no frame\n  \
            drive   is      station  exchanges  silent  damaged  late  doubled\n  \
            pump-1  online        1        200       1        2     0        0\n  \
            ms to a reply  to a          replies  50 %  90 %  99 %  99.9 %  longest  waited for  suggested\n  \
            pump-1         stored write        7  4.25   5.0   6.0     7.0      9.0       500.0          -\n  \
            problem: pump-1: check termination\n";
        assert_eq!(text(&[parsed(report)]), right);
    }

    #[test]
    fn what_is_wrong_with_the_gateway_itself_follows_the_lines() {
        let finding = json!({ "severity": "problem", "text": "the broker cannot be reached" });
        let advice = [parsed(finding)];
        let own = own_findings(&advice);
        assert_eq!(
            section("gateway", &own),
            "\ngateway\n  problem: the broker cannot be reached\n"
        );
        assert_eq!(section("gateway", &[]), "");
    }

    #[test]
    fn what_the_motors_of_the_watched_lines_do_unordered_is_named() {
        let finding = |line: &str, sign: &str| json!({ "severity": "problem", "sign": sign, "line": line, "drive": "pump-1", "text": "it turns" });
        let signs = [
            "may_still_run",
            "failsafe",
            "stopped_elsewhere",
            "output_outside",
            "tripped",
        ];
        let advice: Vec<_> = signs
            .iter()
            .flat_map(|sign| ["a", "b"].map(|line| parsed(finding(line, sign))))
            .collect();
        let found = of_motion(&advice, &[parsed(json!({ "line": "a" }))]);
        assert_eq!(
            found.iter().map(|it| &*it.known.sign).collect::<Vec<_>>(),
            signs[..4]
        );
        assert_eq!(
            section("drives", &found[..1]),
            "\ndrives\n  problem: pump-1: it turns\n"
        );
        let titled = json!({ "severity": "problem", "drive": "pump-1", "title": "مضخة", "text": "it turns" });
        assert_eq!(
            finding_row(&parsed(titled)),
            "  problem: pump-1 \"\u{2068}مضخة\u{2069}\": it turns\n"
        );
    }

    #[test]
    fn what_another_version_does_not_say_is_not_made_up() {
        let shown = text(&[parsed(json!({}))]);
        assert!(
            shown.starts_with("line ? (? on ?): ?, watched for - s\n"),
            "{shown}"
        );
        let report = json!({ "link": null, "port": "modbus-tcp://10.0.0.7:502" });
        let shown = line(&parsed(report));
        assert!(
            shown.starts_with("line ? (modbus-tcp://10.0.0.7:502): "),
            "{shown}"
        );
    }

    #[test]
    fn the_bar_is_full_at_the_end() {
        assert_eq!(bar(0, 30), format!("\r[{}] 0 of 30 s", ".".repeat(30)));
        assert_eq!(bar(30, 30), format!("\r[{}] 30 of 30 s", "#".repeat(30)));
        assert_eq!(
            bar(1, 2),
            format!("\r[{}{}] 1 of 2 s", "#".repeat(15), ".".repeat(15))
        );
    }
}
