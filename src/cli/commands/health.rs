//! `health`: asks the running gateway whether it is ready, or only whether it is alive.

use crate::cli::tools::socket::{
    self, SocketRequest, connect, document, exchange, exchange_bytes, unreachable, within,
};
use crate::cli::tools::unseen::unseen_row;
use crate::cli::tools::{CommandFailure, WordTone, print, toned};
use crate::north::api::{
    BrokerHealthDocument, DriveHealthDocument, FailSafeDocument, HealthDocument,
    HostHealthDocument, JournalHealthDocument, LineHealthDocument, OversizedDocument, PassedOn,
    RefusedRegisterDocument,
};
use crate::north::titles::{PlantTitles, labelled};
use axum::http::{StatusCode, Uri};
use serde_json::json;
use std::fmt::{self, Display, Write};
use std::path::PathBuf;
use std::time::Duration;
use tokio::net::TcpStream;

/// Longest time for the whole request: a container's health check does not wait longer either.
const PATIENCE: Duration = Duration::from_secs(5);
/// The path of the readiness answer.
const PATH: &str = "/api/v1/health";
/// The path of the liveness answer.
const ALIVE: &str = "/healthz";

/// Arguments of `health`.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    place: socket::SocketArgs,
    /// Ask over HTTP instead, at an address such as http://127.0.0.1:8080
    #[arg(long, value_name = "URL", conflicts_with_all = ["socket", "config"])]
    url: Option<Uri>,
    /// Ask only whether it is alive: it answers, and no line thread hangs. For supervisors that restart the gateway: lines
    /// or a broker that are down do not count
    #[arg(long, conflicts_with = "json")]
    alive: bool,
    /// Ask only whether it is the one that sends: on every line that it shares with another gateway and can use, and on at
    /// least one. For keepalived and the like
    #[arg(long, conflicts_with_all = ["alive", "json"])]
    active: bool,
    /// Print the gateway's JSON
    #[arg(long)]
    json: bool,
}

/// Prints a line for each line and drive, and fails unless the gateway is ready, has read something of each drive and no
/// motor may run unseen; or fails unless it is alive, or active.
pub fn health(args: &Args) -> Result<(), CommandFailure> {
    let place = match &args.url {
        Some(url) => HealthSource::Url(HealthUrl::new(url)?),
        None => HealthSource::Socket(args.place.path()?),
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(CommandFailure::failed)?;
    let failed = |reason: String| CommandFailure::failed(format!("gateway at {place}: {reason}"));
    if args.alive {
        return print(&runtime.block_on(sign_of_life(&place)).map_err(failed)?);
    }
    let health = runtime.block_on(ask(&place)).map_err(failed)?;
    if args.active {
        return print(&format!("{}\n", active(&health.known).map_err(failed)?));
    }
    print(&if args.json {
        format!("{}\n", json!(health))
    } else {
        report(&health.known)
    })?;
    let health = health.known;
    why_not_in_order(&health).map_or(Ok(()), |why| Err(failed(why)))
}

/// Why the gateway or a drive is not in order, the worst first; `None` if all are.
fn why_not_in_order(health: &HealthDocument) -> Option<String> {
    let named = |what: &str, drives: Vec<&str>| {
        (!drives.is_empty()).then(|| format!("{what} {}", drives.join(", ")))
    };
    let not_ready = || (!health.ready).then(|| "not ready".to_owned());
    named("a motor may still run unseen: go to", unseen(health))
        .or_else(not_ready)
        .or_else(|| named("nothing was ever read of", never_read(health)))
        .or_else(|| essential_refused(health))
}

/// The drives that are out of sight and may still run.
fn unseen(health: &HealthDocument) -> Vec<&str> {
    let drives = health.drives.iter();
    drives
        .filter(|drive| drive.may_still_run)
        .map(|drive| &*drive.name)
        .collect()
}

/// The drives of which nothing was read since the start, on lines on which this gateway sends.
fn never_read(health: &HealthDocument) -> Vec<&str> {
    let listens = |drive: &DriveHealthDocument| {
        let mut lines = health.lines.iter();
        lines.any(|line| line.name == drive.line && role(line) == Some("listening"))
    };
    let drives = health.drives.iter();
    drives
        .filter(|drive| drive.was_read == Some(false) && !listens(drive))
        .map(|drive| &*drive.name)
        .collect()
}

/// The role of the gateway on `line`; `None` if it does not share it.
fn role(line: &LineHealthDocument) -> Option<&str> {
    line.standby.as_ref().map(|standby| &*standby.role)
}

/// Where the gateway is reached.
enum HealthSource {
    Socket(PathBuf),
    Url(HealthUrl),
}

impl Display for HealthSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Socket(path) => path.display().fmt(f),
            Self::Url(url) => write!(f, "{}:{}", url.host, url.port),
        }
    }
}

/// What is needed of a URL.
struct HealthUrl {
    host: String,
    port: u16,
}

impl HealthUrl {
    fn new(uri: &Uri) -> Result<Self, CommandFailure> {
        let is_plain = uri.scheme_str() == Some("http") && matches!(uri.path(), "" | "/");
        let host = match uri.host() {
            Some(host) if is_plain => host,
            _ => {
                return Err(CommandFailure::wrong(format!(
                    "{uri} is not an address such as http://127.0.0.1:8080"
                )));
            }
        };
        // A version 6 address is in brackets.
        let host = host
            .trim_start_matches('[')
            .trim_end_matches(']')
            .to_owned();
        Ok(Self {
            host,
            port: uri.port_u16().unwrap_or(80),
        })
    }

    async fn connect(&self) -> Result<TcpStream, String> {
        TcpStream::connect((self.host.as_str(), self.port))
            .await
            .map_err(unreachable)
    }
}

async fn ask(place: &HealthSource) -> Result<PassedOn<HealthDocument>, String> {
    let question = SocketRequest::get(PATH);
    let answer = match place {
        HealthSource::Url(url) => {
            within(PATIENCE, async {
                exchange(url.connect().await?, &url.host, question).await
            })
            .await
        }
        HealthSource::Socket(path) => socket::ask(path, question, PATIENCE).await,
    };
    match answer? {
        (StatusCode::OK, health) => document(health),
        (status, _) => Err(format!("{PATH} answers {status}")),
    }
}

/// The gateway's liveness answer. An error says why it is not alive.
async fn sign_of_life(place: &HealthSource) -> Result<String, String> {
    let question = SocketRequest::get(ALIVE);
    let answer = within(PATIENCE, async {
        match place {
            HealthSource::Url(url) => {
                exchange_bytes(url.connect().await?, &url.host, question).await
            }
            HealthSource::Socket(path) => {
                exchange_bytes(connect(path).await?, "localhost", question).await
            }
        }
    });
    match answer.await? {
        (StatusCode::OK, said) => Ok(String::from_utf8_lossy(&said).into_owned()),
        // It names the lines whose threads hang.
        (StatusCode::SERVICE_UNAVAILABLE, said) => {
            Err(String::from_utf8_lossy(&said).trim_end().to_owned())
        }
        (status, _) => Err(format!("{ALIVE} answers {status}")),
    }
}

/// Says that the gateway is the one that sends. An error says why it is not. Where it shares no line, it is alone and sends on
/// all of them.
fn active(health: &HealthDocument) -> Result<String, String> {
    let lines = &health.lines;
    let is_shared = lines.iter().any(|line| line.standby.is_some());
    let counts =
        |line: &&LineHealthDocument| line.state == "up" && (!is_shared || line.standby.is_some());
    let (sends, listens): (Vec<_>, Vec<_>) = lines
        .iter()
        .filter(counts)
        .partition(|line| !is_shared || role(line) == Some("active"));
    let names = |lines: &[&LineHealthDocument]| {
        let names: Vec<_> = lines.iter().map(|line| &*line.name).collect();
        names.join(", ")
    };
    match (sends.is_empty(), listens.is_empty()) {
        (false, true) => Ok(format!("active on {}", names(&sends))),
        (_, false) => Err(format!(
            "not active: it only listens on {}",
            names(&listens)
        )),
        (true, true) => Err("not active: no line can be used".to_owned()),
    }
}

/// The first register that a drive refuses to show although its run state or its trips are read there.
fn essential_refused(health: &HealthDocument) -> Option<String> {
    health.drives.iter().find_map(|drive| {
        let refused = drive.refused.iter().find(|it| it.essential)?;
        Some(format!(
            "drive {} refuses to show {} (exception {:02X})",
            drive.name,
            name_of(refused),
            refused.code
        ))
    })
}

/// The register's name, or else its address.
fn name_of(register: &RefusedRegisterDocument) -> &str {
    register.name.as_deref().unwrap_or(&register.register)
}

/// `seconds` in the two largest units of days, hours, minutes and seconds.
fn span(seconds: u64) -> String {
    match seconds {
        0..60 => format!("{seconds} s"),
        60..3600 => format!("{} min {} s", seconds / 60, seconds % 60),
        3600..86_400 => format!("{} h {} min", seconds / 3600, seconds / 60 % 60),
        _ => format!("{} d {} h", seconds / 86_400, seconds / 3600 % 24),
    }
}

/// A word for a state, in its colour.
fn state_of<'a>(word: &'a str, good: &[&'a str]) -> String {
    toned(
        if good.contains(&word) {
            WordTone::Good
        } else {
            WordTone::Problem
        },
        word,
    )
}

/// The reason of a state, to follow its word; empty if there is none.
fn followed(reason: Option<&str>) -> String {
    reason
        .map(|reason| format!(": {reason}"))
        .unwrap_or_default()
}

fn line_row(line: &LineHealthDocument, titles: &PlantTitles) -> String {
    // A line that is down says why itself.
    let suspicion = match &line.suspicion {
        Some(text) if line.reason.is_none() => format!("; {text}"),
        _ => String::new(),
    };
    let role = role(line)
        .map(|role| format!(", {role}"))
        .unwrap_or_default();
    format!(
        "line {}: {}{role}{}{suspicion}\n",
        labelled(&line.name, titles.lines.get(&*line.name)),
        state_of(&line.state, &["up"]),
        followed(line.reason.as_deref())
    )
}

/// What `side` does not publish because it is larger than the broker takes, a line each.
fn oversized(side: &str, all: &[OversizedDocument]) -> String {
    /// Lines that are shown.
    const LINES_MAX: usize = 8;
    let line = |it: &OversizedDocument| {
        format!(
            "{side}: {} is not published: it has {} bytes, and the broker accepts {}\n",
            it.topic, it.bytes, it.limit
        )
    };
    let more = all.len().saturating_sub(LINES_MAX);
    let more = if more > 0 {
        format!("{side}: and {more} more\n")
    } else {
        String::new()
    };
    all.iter().take(LINES_MAX).map(line).chain([more]).collect()
}

/// What is said of a drive.
fn drive_row(drive: &DriveHealthDocument, titles: &PlantTitles) -> String {
    let mut text = format!(
        "drive {} ({} on {}): {}, ",
        labelled(&drive.name, titles.drives.get(&*drive.name)),
        drive.model,
        drive.line,
        state_of(&drive.presence, &["online"])
    );
    text.push_str(&match &*drive.run_state {
        "tripped" => toned(WordTone::Problem, "tripped"),
        other => other.to_owned(),
    });
    text.push_str(&motion_of(drive));
    // Writing to a String cannot fail.
    if let Some(state) = &drive.watchdog {
        let _ = write!(text, ", its watchdog {}", state.replace('_', " "));
    }
    if let Some(warning) = &drive.warning {
        let _ = write!(text, ", {} {warning}", toned(WordTone::Notice, "warns:"));
    }
    if let Some(state) = &drive.undocumented_state {
        let label = toned(WordTone::Notice, "undocumented state:");
        let _ = write!(text, ", {label} {state}");
    }
    let refused: Vec<_> = drive.refused.iter().map(name_of).collect();
    if !refused.is_empty() {
        let label = toned(WordTone::Problem, "refuses to show");
        let _ = write!(text, ", {label} {}", refused.join(", "));
    }
    let site = drive.site.as_deref().unwrap_or_default();
    if !site.is_empty() {
        let _ = write!(text, ", qualified at the site: {}", site.join(", "));
    }
    text.push('\n');
    text
}

/// What is not as it was ordered.
fn motion_of(drive: &DriveHealthDocument) -> String {
    let mut parts = Vec::new();
    if drive.output_outside == Some(true) {
        parts.push("the output is outside the limits or far from the setpoint".to_owned());
    }
    if drive.stopped_elsewhere == Some(true) {
        parts.push("stopped elsewhere: only a new order starts it".to_owned());
    }
    if let Some(FailSafeDocument { action, stage, .. }) = &drive.failsafe {
        match &**stage {
            "due" => parts.push(format!(
                "the declared action ({action}) is due and nothing was sent"
            )),
            "sent" => parts.push(format!(
                "the declared action ({action}) was sent and shows no effect yet"
            )),
            "given_up" => parts.push(format!("the declared action ({action}) was given up")),
            _ => {}
        }
    }
    parts
        .iter()
        .map(|it| format!(", {}", toned(WordTone::Problem, it)))
        .collect()
}

/// What is said of the MQTT broker.
fn mqtt_rows(mqtt: &BrokerHealthDocument) -> String {
    let mut text = String::new();
    let rival = if mqtt.contested {
        "; another client has the same client identifier: give each its own, with `client_id`"
    } else {
        ""
    };
    let state = if mqtt.connected {
        "connected"
    } else {
        "not connected"
    };
    let _ = writeln!(
        text,
        "mqtt: {}{}{rival}",
        state_of(state, &["connected"]),
        followed(mqtt.reason.as_deref())
    );
    text.push_str(&oversized("mqtt", &mqtt.oversized));
    if let Some(topic) = &mqtt.clients_gone {
        let _ = writeln!(
            text,
            "mqtt: {topic} says that the clients of the broker are offline: control over MQTT ends \
             after `lost_after`"
        );
    }
    if mqtt.events_refused > 0 {
        let _ = writeln!(
            text,
            "mqtt: the broker refused {} trip events; see the log",
            mqtt.events_refused
        );
    }
    text
}

/// What is said of the Sparkplug hosts.
fn sparkplug_rows(sparkplug: &HostHealthDocument) -> String {
    let state = match (sparkplug.connected, sparkplug.host_awaited) {
        (true, _) => "published to its hosts",
        (false, true) if sparkplug.host_behind_ms.is_some() => {
            "waits for its primary host, whose STATE message is older than an earlier one: its \
             clock was ahead"
        }
        (false, true) => "waits for its primary host",
        (false, false) => "not connected",
    };
    let state = state_of(state, &["published to its hosts"]);
    format!(
        "sparkplug: {state}{}\n{}",
        followed(sparkplug.reason.as_deref()),
        oversized("sparkplug", &sparkplug.oversized)
    )
}

/// What is said of the journal.
fn journal_rows(journal: &JournalHealthDocument) -> String {
    let state = state_of(&journal.state, &["ok"]);
    let mut text = format!("journal: {state}{}\n", followed(journal.reason.as_deref()));
    if let Some(aside) = &journal.moved_aside {
        let _ = writeln!(text, "journal: a damaged journal was moved to {aside}");
    }
    if let Some(what) = &journal.replaced {
        let _ = writeln!(text, "journal: {what}");
    }
    text
}

/// The answer for people. Missing values are shown as `?`: another version may send less.
fn report(health: &HealthDocument) -> String {
    let drives = health.drives.iter();
    let titles = &health.titles;
    let mut text = format!(
        "gateway {}: version {}, up {}\n",
        labelled(&health.gateway, titles.gateway.as_ref()),
        health.version,
        span(health.uptime_seconds)
    );
    text.extend(health.lines.iter().map(|line| line_row(line, titles)));
    text.extend(
        drives
            .clone()
            .filter(|drive| drive.may_still_run)
            .map(|drive| unseen_row(drive, titles)),
    );
    text.extend(drives.map(|drive| drive_row(drive, titles)));
    text.extend(health.mqtt.as_ref().map(mqtt_rows));
    text.extend(health.sparkplug.as_ref().map(sparkplug_rows));
    text.extend(health.journal.as_ref().map(journal_rows));
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::de::DeserializeOwned;
    use serde_json::Value;

    /// A document as it is read from the wire.
    fn parsed<T: DeserializeOwned>(json: Value) -> T {
        serde_json::from_value(json).unwrap()
    }

    fn none() -> PlantTitles {
        PlantTitles::default()
    }

    #[test]
    fn titles_stand_behind_names_and_move_nothing() {
        let titles = json!({ "drives": { "pump-1": "مضخة 2" }, "gateway": "Werk\u{1b}[2J", "lines": { "hall-1": "Halle 1" } });
        let health = json!({
            "gateway": "plant-a",
            "lines": [{ "name": "hall-1", "state": "up" }],
            "drives": [{ "name": "pump-1", "may_still_run": true }],
            "titles": titles,
        });
        let shown = report(&parsed(health));
        for row in [
            "gateway plant-a \"Werk[2J\": version ",
            "line hall-1 \"Halle 1\": up\n",
            "drive pump-1 \"\u{2068}مضخة 2\u{2069}\" MAY STILL RUN",
            "drive pump-1 \"\u{2068}مضخة 2\u{2069}\" (? on ?): ",
        ] {
            assert!(shown.contains(row), "{shown}");
        }
        let sent = serde_json::to_string(&HealthDocument::default()).unwrap();
        assert!(!sent.contains("titles"), "{sent}");
    }

    #[test]
    fn spans_are_in_units_that_people_use() {
        let spans = [
            (59, "59 s"),
            (60, "1 min 0 s"),
            (3599, "59 min 59 s"),
            (86_399, "23 h 59 min"),
            (200_000, "2 d 7 h"),
        ];
        for (seconds, text) in spans {
            assert_eq!(span(seconds), text);
        }
    }

    /// A line in `state`, with the role on it if it is shared.
    fn line(name: &str, state: &str, role: Option<&str>) -> Value {
        let standby = role.map_or(Value::Null, |role| json!({ "role": role }));
        json!({ "name": name, "state": state, "standby": standby })
    }

    #[test]
    fn a_gateway_is_active_where_it_sends_on_each_line_that_it_can_use() {
        let (sends, listens) = (Some("active"), Some("listening"));
        for (lines, expected) in [
            (vec![line("a", "up", sends)], Ok("active on a")),
            (
                vec![line("a", "up", sends), line("b", "up", sends)],
                Ok("active on a, b"),
            ),
            (
                vec![line("a", "up", sends), line("b", "down", listens)],
                Ok("active on a"),
            ),
            (
                vec![line("a", "up", sends), line("own", "down", None)],
                Ok("active on a"),
            ),
            (vec![line("own", "up", None)], Ok("active on own")),
            (
                vec![line("a", "up", sends), line("b", "up", listens)],
                Err("not active: it only listens on b"),
            ),
            (
                vec![line("a", "up", listens), line("own", "up", None)],
                Err("not active: it only listens on a"),
            ),
            (
                vec![line("a", "down", listens), line("own", "up", None)],
                Err("not active: no line can be used"),
            ),
            (
                vec![line("own", "down", None)],
                Err("not active: no line can be used"),
            ),
            (vec![], Err("not active: no line can be used")),
        ] {
            let found = active(&parsed(json!({ "lines": lines })));
            assert_eq!(
                found,
                expected.map(str::to_owned).map_err(str::to_owned),
                "{lines:?}"
            );
        }
    }

    #[test]
    fn a_drive_of_which_nothing_was_ever_read_is_named_unless_this_gateway_only_listens() {
        let lines = [
            line("a", "up", Some("active")),
            line("b", "up", Some("listening")),
        ];
        let drive = |name: &str, line: &str, was_read: bool| json!({ "name": name, "line": line, "was_read": was_read });
        let old = json!({ "name": "of an earlier version", "line": "a" });
        let drives = [
            drive("one", "a", true),
            drive("two", "a", false),
            drive("three", "b", false),
            old,
        ];
        assert_eq!(
            never_read(&parsed(json!({ "lines": lines, "drives": drives }))),
            ["two"]
        );
        assert_eq!(never_read(&HealthDocument::default()), [""; 0]);
    }

    #[test]
    fn what_is_too_large_for_the_broker_is_named_with_size_and_limit() {
        let one = |n: u32| json!({ "topic": format!("vfd/a/{n}"), "bytes": 2500, "limit": 2000 });
        let health = json!({ "mqtt": { "connected": true, "oversized": [one(1)] } });
        let shown = report(&parsed(health));
        assert!(
            shown.contains(
                "mqtt: vfd/a/1 is not published: it has 2500 bytes, and the broker accepts 2000\n"
            ),
            "{shown}"
        );
        let many: Vec<_> = (0..11).map(one).collect();
        assert!(oversized("mqtt", &parsed::<Vec<_>>(json!(many))).ends_with("mqtt: and 3 more\n"));
    }

    #[test]
    fn a_drive_that_may_run_unseen_is_told_first_and_with_what_was_seen() {
        let drive =
            |seen: Value| json!({ "name": "pump-1", "may_still_run": true, "last_seen": seen });
        let seen =
            json!({ "run_state": "forward", "output_hz": 42.5, "at": "2026-01-02T03:04:05.678Z" });
        let row = "drive pump-1 MAY STILL RUN: last seen forward at 42.50 Hz, 2026-01-02T03:04:05.678Z; go to the drive\n";
        assert_eq!(unseen_row(&parsed(drive(seen)), &none()), row);
        assert_eq!(
            unseen_row(&parsed(drive(Value::Null)), &none()),
            "drive pump-1 MAY STILL RUN; go to the drive\n"
        );
        let drives = json!([{ "name": "fan-2" }, drive(Value::Null)]);
        let report = report(&parsed(json!({ "drives": drives })));
        assert!(
            report.find("MAY STILL RUN") < report.find("drive fan-2"),
            "{report}"
        );
    }

    #[test]
    fn a_gateway_whose_motor_may_run_unseen_is_not_in_order() {
        let health = |may_still_run: bool, ready: bool| {
            let drive =
                json!({ "name": "pump-1", "was_read": true, "may_still_run": may_still_run });
            parsed(json!({ "ready": ready, "drives": [drive] }))
        };
        assert_eq!(why_not_in_order(&health(false, true)), None);
        assert_eq!(
            why_not_in_order(&health(false, false)).as_deref(),
            Some("not ready")
        );
        for ready in [true, false] {
            let why = why_not_in_order(&health(true, ready)).unwrap();
            assert!(
                why.contains("may still run") && why.ends_with("go to pump-1"),
                "{why}"
            );
        }
    }

    #[test]
    fn what_a_drive_does_against_its_order_is_named() {
        let row = |key: &str, value: Value| drive_row(&parsed(json!({ key: value })), &none());
        assert!(row("output_outside", true.into()).contains("outside the limits"));
        assert!(row("stopped_elsewhere", true.into()).contains("stopped elsewhere"));
        let stage = |stage: &str| row("failsafe", json!({ "action": "stop", "stage": stage }));
        assert!(
            stage("due").contains("the declared action (stop) is due"),
            "{}",
            stage("due")
        );
        assert_eq!(stage("effective"), row("failsafe", Value::Null));
    }

    #[test]
    fn a_drive_that_does_not_show_its_run_state_is_not_in_order() {
        let register = |essential: bool| json!({ "name": "output", "register": "0x3001", "code": 2, "essential": essential });
        let health = |essential| {
            parsed(json!({ "drives": [{ "name": "a", "refused": [register(essential)] }] }))
        };
        assert_eq!(essential_refused(&health(false)), None);
        let why = "drive a refuses to show output (exception 02)";
        assert_eq!(essential_refused(&health(true)).as_deref(), Some(why));
        assert!(
            report(&health(false)).contains("refuses to show output"),
            "{}",
            report(&health(false))
        );
    }

    #[test]
    fn a_shared_line_is_shown_with_the_role() {
        assert_eq!(
            line_row(&parsed(line("a", "up", Some("listening"))), &none()),
            "line a: up, listening\n"
        );
        assert_eq!(
            line_row(&parsed(line("a", "up", None)), &none()),
            "line a: up\n"
        );
    }
}
