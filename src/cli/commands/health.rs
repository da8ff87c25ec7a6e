//! `health`: asks the running gateway whether it is ready, or only whether it is alive.

use crate::cli::tools::socket::{
    self, SocketRequest, connect, exchange, exchange_bytes, unreachable, within,
};
use crate::cli::tools::unseen::unseen_row;
use crate::cli::tools::{CommandFailure, WordTone, print, toned};
use axum::http::{StatusCode, Uri};
use serde_json::Value;
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
        return print(&format!("{}\n", active(&health).map_err(failed)?));
    }
    print(&if args.json {
        format!("{health}\n")
    } else {
        report(&health)
    })?;
    why_not_in_order(&health).map_or(Ok(()), |why| Err(failed(why)))
}

/// Why the gateway or a drive is not in order, the worst first; `None` if all are.
fn why_not_in_order(health: &Value) -> Option<String> {
    let named = |what: &str, drives: Vec<&str>| {
        (!drives.is_empty()).then(|| format!("{what} {}", drives.join(", ")))
    };
    let not_ready = || (health["ready"] != true).then(|| "not ready".to_owned());
    named("a motor may still run unseen: go to", unseen(health))
        .or_else(not_ready)
        .or_else(|| named("nothing was ever read of", never_read(health)))
        .or_else(|| essential_refused(health))
}

/// The drives that are out of sight and may still run.
fn unseen(health: &Value) -> Vec<&str> {
    let drives = health["drives"].as_array().into_iter().flatten();
    drives
        .filter(|drive| drive["may_still_run"] == true)
        .map(|drive| text_at(drive, "name"))
        .collect()
}

/// The drives of which nothing was read since the start, on lines on which this gateway sends.
fn never_read(health: &Value) -> Vec<&str> {
    let items = |key: &str| health[key].as_array().into_iter().flatten();
    let listens = |drive: &Value| {
        items("lines")
            .any(|line| line["name"] == drive["line"] && line["standby"]["role"] == "listening")
    };
    let unread = items("drives").filter(|drive| drive["was_read"] == false && !listens(drive));
    unread
        .map(|drive| drive["name"].as_str().unwrap_or("?"))
        .collect()
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

async fn ask(place: &HealthSource) -> Result<Value, String> {
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
        (StatusCode::OK, health) => Ok(health),
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

/// That the gateway is the one that sends. An error says why it is not. Where it shares no line, it is alone and sends on
/// all of them.
fn active(health: &Value) -> Result<String, String> {
    let lines = health["lines"]
        .as_array()
        .map(Vec::as_slice)
        .unwrap_or_default();
    let is_shared = lines.iter().any(|line| !line["standby"].is_null());
    let counts =
        |line: &&Value| line["state"] == "up" && (!is_shared || !line["standby"].is_null());
    let name = |line: &Value| line["name"].as_str().unwrap_or("?").to_owned();
    let (sends, listens): (Vec<_>, Vec<_>) = lines
        .iter()
        .filter(counts)
        .partition(|line| !is_shared || line["standby"]["role"] == "active");
    let names = |lines: &[&Value]| {
        lines
            .iter()
            .map(|line| name(line))
            .collect::<Vec<_>>()
            .join(", ")
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
fn essential_refused(health: &Value) -> Option<String> {
    let drives = health["drives"].as_array()?;
    drives.iter().find_map(|drive| {
        let refused = drive["refused"]
            .as_array()?
            .iter()
            .find(|it| it["essential"] == true)?;
        let name = refused["name"]
            .as_str()
            .or(refused["register"].as_str())
            .unwrap_or("?");
        let code = refused["code"].as_u64().unwrap_or(0);
        Some(format!(
            "drive {} refuses to show {name} (exception {code:02X})",
            drive["name"].as_str().unwrap_or("?")
        ))
    })
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
fn reason_of(part: &Value) -> String {
    part["reason"]
        .as_str()
        .map(|reason| format!(": {reason}"))
        .unwrap_or_default()
}

fn line_row(line: &Value) -> String {
    let word = |key: &str| line[key].as_str().unwrap_or("?");
    // A line that is down says why itself.
    let suspicion = match line["suspicion"].as_str() {
        Some(text) if line["reason"].is_null() => format!("; {text}"),
        _ => String::new(),
    };
    let role = line["standby"]["role"]
        .as_str()
        .map(|role| format!(", {role}"))
        .unwrap_or_default();
    format!(
        "line {}: {}{role}{}{suspicion}\n",
        word("name"),
        state_of(word("state"), &["up"]),
        reason_of(line)
    )
}

/// What `side` does not publish because it is larger than the broker takes, a line each.
fn oversized(side: &str, health: &Value) -> String {
    /// Lines that are shown.
    const LINES_MAX: usize = 8;
    let all = health["oversized"]
        .as_array()
        .map(Vec::as_slice)
        .unwrap_or_default();
    let line = |it: &Value| {
        let topic = it["topic"].as_str().unwrap_or("?");
        format!(
            "{side}: {topic} is not published: {} bytes, and the broker takes {}\n",
            it["bytes"], it["limit"]
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

/// The text at `key`.
fn text_at<'a>(of: &'a Value, key: &str) -> &'a str {
    of[key].as_str().unwrap_or("?")
}

/// What is said of a drive.
fn drive_row(drive: &Value) -> String {
    let name = text_at(drive, "name");
    let line = text_at(drive, "line");
    let model = text_at(drive, "model");
    let presence = state_of(text_at(drive, "presence"), &["online"]);
    let run_state = match text_at(drive, "run_state") {
        "tripped" => toned(WordTone::Problem, "tripped"),
        other => other.to_owned(),
    };
    let watchdog = drive["watchdog"]
        .as_str()
        .map(|state| format!(", its watchdog {}", state.replace('_', " ")));
    let watchdog = watchdog.unwrap_or_default();
    let warning = drive["warning"].as_str();
    let warning = warning
        .map(|text| format!(", {} {text}", toned(WordTone::Notice, "warns:")))
        .unwrap_or_default();
    let refused: Vec<_> = drive["refused"].as_array().into_iter().flatten().collect();
    let refused: Vec<_> = refused
        .iter()
        .filter_map(|it| it["name"].as_str().or(it["register"].as_str()))
        .collect();
    let refused = if refused.is_empty() {
        String::new()
    } else {
        format!(
            ", {} {}",
            toned(WordTone::Problem, "refuses to show"),
            refused.join(", ")
        )
    };
    let state = drive["undocumented_state"].as_str();
    let state = state
        .map(|text| {
            format!(
                ", {} {text}",
                toned(WordTone::Notice, "undocumented state:")
            )
        })
        .unwrap_or_default();
    let motion = motion_of(drive);
    let site: Vec<_> = drive["site"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    let site = if site.is_empty() {
        String::new()
    } else {
        format!(", qualified at the site: {}", site.join(", "))
    };
    format!(
        "drive {name} ({model} on {line}): {presence}, {run_state}{motion}{watchdog}{warning}{state}{refused}{site}\n"
    )
}

/// What is not as it was ordered.
fn motion_of(drive: &Value) -> String {
    let action = text_at(&drive["failsafe"], "action");
    let came = match drive["failsafe"]["stage"].as_str() {
        Some("due") => format!("the declared action ({action}) is due and nothing was sent"),
        Some("sent") => format!("the declared action ({action}) was sent and shows no effect yet"),
        Some("given_up") => format!("the declared action ({action}) was given up"),
        _ => String::new(),
    };
    let is = |key: &str, text: &str| {
        if drive[key] == true {
            text.to_owned()
        } else {
            String::new()
        }
    };
    let outside = is(
        "output_outside",
        "its output is outside the limits or far from the setpoint",
    );
    let parts = [
        outside,
        is(
            "stopped_elsewhere",
            "stopped elsewhere: only a new order starts it",
        ),
        came,
    ];
    parts
        .iter()
        .filter(|it| !it.is_empty())
        .map(|it| format!(", {}", toned(WordTone::Problem, it)))
        .collect()
}

/// What is said of the MQTT broker; empty without one.
fn mqtt_rows(mqtt: &Value) -> String {
    let Some(connected) = mqtt["connected"].as_bool() else {
        return String::new();
    };
    let mut text = String::new();
    let rival = if mqtt["contested"] == true {
        "; another client has the same client identifier: give each its own, with `client_id`"
    } else {
        ""
    };
    let lost = reason_of(mqtt);
    let _ = writeln!(
        text,
        "mqtt: {}{lost}{rival}",
        state_of(
            if connected {
                "connected"
            } else {
                "not connected"
            },
            &["connected"]
        )
    );
    text.push_str(&oversized("mqtt", mqtt));
    if let Some(topic) = mqtt["clients_gone"].as_str() {
        let _ = writeln!(
            text,
            "mqtt: {topic} says that the clients of the broker are offline: what MQTT holds is given up after \
             `lost_after`"
        );
    }
    if let Some(refused) = mqtt["events_refused"]
        .as_u64()
        .filter(|refused| *refused > 0)
    {
        let _ = writeln!(
            text,
            "mqtt: the broker refused {refused} trip events; see the log"
        );
    }
    text
}

/// The answer for people. Missing values are shown as `?`: another version may send less.
fn report(health: &Value) -> String {
    let items = |key: &str| health[key].as_array().into_iter().flatten();
    let mut text = String::new();
    let uptime = span(health["uptime_seconds"].as_u64().unwrap_or(0));
    let _ = writeln!(
        text,
        "gateway {}: version {}, up {uptime}",
        text_at(health, "gateway"),
        text_at(health, "version")
    );
    text.extend(items("lines").map(line_row));
    text.extend(
        items("drives")
            .filter(|drive| drive["may_still_run"] == true)
            .map(unseen_row),
    );
    text.extend(items("drives").map(drive_row));
    text.push_str(&mqtt_rows(&health["mqtt"]));
    if let Some(connected) = health["sparkplug"]["connected"].as_bool() {
        let state = match (connected, health["sparkplug"]["host_awaited"] == true) {
            (true, _) => "published to its hosts",
            (false, true) if health["sparkplug"]["host_behind_ms"].is_u64() => {
                "waits for its primary host, whose STATE message is older than one before: its clock was ahead"
            }
            (false, true) => "waits for its primary host",
            (false, false) => "not connected",
        };
        let state = state_of(state, &["published to its hosts"]);
        let _ = writeln!(
            text,
            "sparkplug: {state}{}",
            reason_of(&health["sparkplug"])
        );
        text.push_str(&oversized("sparkplug", &health["sparkplug"]));
    }
    if let Some(state) = health["journal"]["state"].as_str() {
        let state = state_of(state, &["ok"]);
        let _ = writeln!(text, "journal: {state}{}", reason_of(&health["journal"]));
        if let Some(aside) = health["journal"]["moved_aside"].as_str() {
            let _ = writeln!(text, "journal: a damaged journal was moved to {aside}");
        }
        if let Some(what) = health["journal"]["replaced"].as_str() {
            let _ = writeln!(text, "journal: {what}");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let standby = role.map_or(Value::Null, |role| serde_json::json!({ "role": role }));
        serde_json::json!({ "name": name, "state": state, "standby": standby })
    }

    #[test]
    fn a_gateway_is_active_where_it_sends_on_each_line_that_it_can_use() {
        let (sends, listens) = (Some("active"), Some("listening"));
        for (lines, told) in [
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
            let found = active(&serde_json::json!({ "lines": lines }));
            assert_eq!(
                found,
                told.map(str::to_owned).map_err(str::to_owned),
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
        let drive = |name: &str, line: &str, was_read: bool| serde_json::json!({ "name": name, "line": line, "was_read": was_read });
        let old = serde_json::json!({ "name": "of an earlier version", "line": "a" });
        let drives = [
            drive("one", "a", true),
            drive("two", "a", false),
            drive("three", "b", false),
            old,
        ];
        assert_eq!(
            never_read(&serde_json::json!({ "lines": lines, "drives": drives })),
            ["two"]
        );
        assert_eq!(never_read(&serde_json::json!({})), [""; 0]);
    }

    #[test]
    fn what_is_too_large_for_the_broker_is_named_with_size_and_limit() {
        let one = |n: u32| serde_json::json!({ "topic": format!("vfd/a/{n}"), "bytes": 2500, "limit": 2000 });
        let health = serde_json::json!({ "mqtt": { "connected": true, "oversized": [one(1)] } });
        let shown = report(&health);
        assert!(
            shown.contains(
                "mqtt: vfd/a/1 is not published: 2500 bytes, and the broker takes 2000\n"
            ),
            "{shown}"
        );
        let many: Vec<_> = (0..11).map(one).collect();
        assert!(
            oversized("mqtt", &serde_json::json!({ "oversized": many }))
                .ends_with("mqtt: and 3 more\n")
        );
    }

    #[test]
    fn a_drive_that_may_run_unseen_is_told_first_and_with_what_was_seen() {
        let drive = |seen: Value| serde_json::json!({ "name": "pump-1", "may_still_run": true, "last_seen": seen });
        let seen = serde_json::json!({ "run_state": "forward", "output_hz": 42.5, "at": "2026-01-02T03:04:05.678Z" });
        let told = "drive pump-1 MAY STILL RUN: last seen forward at 42.50 Hz, 2026-01-02T03:04:05.678Z; go to the drive\n";
        assert_eq!(unseen_row(&drive(seen)), told);
        assert_eq!(
            unseen_row(&drive(Value::Null)),
            "drive pump-1 MAY STILL RUN; go to the drive\n"
        );
        let report =
            report(&serde_json::json!({ "drives": [{ "name": "fan-2" }, drive(Value::Null)] }));
        assert!(
            report.find("MAY STILL RUN") < report.find("drive fan-2"),
            "{report}"
        );
    }

    #[test]
    fn a_gateway_whose_motor_may_run_unseen_is_not_in_order() {
        let health = |may_still_run: bool, ready: bool| {
            let drive = serde_json::json!({ "name": "pump-1", "was_read": true, "may_still_run": may_still_run });
            serde_json::json!({ "ready": ready, "drives": [drive] })
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
        let told = |key: &str, value: Value| drive_row(&serde_json::json!({ key: value }));
        assert!(told("output_outside", true.into()).contains("outside the limits"));
        assert!(told("stopped_elsewhere", true.into()).contains("stopped elsewhere"));
        let stage = |stage: &str| {
            told(
                "failsafe",
                serde_json::json!({ "action": "stop", "stage": stage }),
            )
        };
        assert!(
            stage("due").contains("the declared action (stop) is due"),
            "{}",
            stage("due")
        );
        assert_eq!(stage("effective"), told("failsafe", Value::Null));
    }

    #[test]
    fn a_drive_that_does_not_show_its_run_state_is_not_in_order() {
        let register = |essential: bool| serde_json::json!({ "name": "output", "register": "0x3001", "code": 2, "essential": essential });
        let health = |essential| serde_json::json!({ "drives": [{ "name": "a", "refused": [register(essential)] }] });
        assert_eq!(essential_refused(&health(false)), None);
        let told = "drive a refuses to show output (exception 02)";
        assert_eq!(essential_refused(&health(true)).as_deref(), Some(told));
        assert!(
            report(&health(false)).contains("refuses to show output"),
            "{}",
            report(&health(false))
        );
    }

    #[test]
    fn a_shared_line_is_shown_with_the_role() {
        assert_eq!(
            line_row(&line("a", "up", Some("listening"))),
            "line a: up, listening\n"
        );
        assert_eq!(line_row(&line("a", "up", None)), "line a: up\n");
    }
}
