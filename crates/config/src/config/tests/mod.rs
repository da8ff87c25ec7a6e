//! The configuration as a whole: good files, every rule broken once, many rules broken at once, garbage.

mod change;
mod control;
mod control_keys;
mod edit;
mod framing;
mod http;
mod line_plan;
mod listener_tls;
mod models;
mod mqtt;
mod native;
mod network;
mod ownership;
mod points;
mod ports;
mod qualified;
mod standby;
mod titles;
mod units;
mod upgrades;
mod watchdog;

use super::*;
use crate::domain::link::{Framing, Interface, LinkSettings, Parity};
use crate::vendors;
use proptest::prelude::*;
use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

pub(super) const MINIMAL: &str = r#"
[[line]]
name = "hall-1"
port = "/dev/ttyUSB0"
[[line.drive]]
name = "pump-1"
model = "hyundai-n700"
station = 1
[[modbus_tcp]]
listen = "127.0.0.1:1502"
"#;

/// A file with every table: a drive that both sides may command, and one that nobody may.
pub(super) const CONTROLLED: &str = r#"
[gateway]
name = "plant-a"
data_dir = "/var/lib/vfd-gateway"
[journal]
max_size = "10MB"
[[line]]
name = "hall-1"
port = "/dev/ttyUSB0"
[[line.drive]]
name = "pump-1"
model = "hyundai-n700"
station = 1
[line.drive.control]
from = ["mqtt", "modbus-tcp"]
frequency_hz = { min = 5.0, max = 50.0 }
on_commander_lost = "stop"
lost_after = "30s"
on_shutdown = "hold"
[line.drive.native]
write = ["F007"]
[[line.drive]]
name = "pump-2"
model = "hyundai-n700"
station = 2
[mqtt]
broker = "mqtt://127.0.0.1"
[[modbus_tcp]]
listen = "127.0.0.1:1502"
write = ["127.0.0.1/32"]
[http]
listen = "127.0.0.1:8080"
"#;

/// Two lines of one drive each behind one listener, with units.
const TWO_LINES: &str = r#"
[[line]]
name = "hall-1"
port = "/dev/ttyUSB0"
[[line.drive]]
name = "pump-1"
model = "hyundai-n700"
station = 1
unit = 1
[[line]]
name = "hall-2"
port = "/dev/ttyUSB1"
[[line.drive]]
name = "pump-2"
model = "hyundai-n700"
station = 1
unit = 2
[[modbus_tcp]]
listen = "127.0.0.1:1502"
"#;

/// `text` with `from`, which stands in it, replaced by `to`.
pub(super) fn with(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "{from}");
    text.replacen(from, to, 1)
}

/// `MINIMAL` with `lines` added to the drive.
pub(super) fn drive_with(lines: &str) -> String {
    with(MINIMAL, "station = 1\n", &format!("station = 1\n{lines}\n"))
}

/// `MINIMAL` with `lines` added to the line.
fn line_with(lines: &str) -> String {
    with(
        MINIMAL,
        "port = \"/dev/ttyUSB0\"\n",
        &format!("port = \"/dev/ttyUSB0\"\n{lines}\n"),
    )
}

/// `MINIMAL` with `lines` added to the listener.
fn listener_with(lines: &str) -> String {
    format!("{MINIMAL}{lines}\n")
}

/// The built-in models, one that differs in its link settings, and one that differs in what it can do.
fn catalog() -> Catalog {
    let acme = [
        (
            "acme-one.toml",
            include_str!("../../../../../tests/golden/config/acme-one.toml"),
        ),
        (
            "acme-two.toml",
            include_str!("../../../../../tests/golden/config/acme-two.toml"),
        ),
    ];
    vendors::catalog().with_texts(acme).unwrap()
}

fn good(text: &str) -> Config {
    load(text, &catalog()).unwrap_or_else(|problems| panic!("{}", shown(text, &problems)))
}

/// One line for each problem: `line:col key: what; right`, with the word `warning` before what keeps nothing from starting.
fn shown(text: &str, problems: &[Problem]) -> String {
    let mut shown = String::new();
    for problem in problems {
        let (line, column) = problem.place_in(text);
        let right = problem.right.as_deref().unwrap_or("-");
        let warning = if problem.is_warning { "warning: " } else { "" };
        writeln!(
            shown,
            "{line}:{column} {warning}{}: {}; {right}",
            problem.key, problem.what
        )
        .unwrap();
    }
    shown
}

/// A problem without its place: `key: what; right`.
fn problem_text(problem: &Problem) -> String {
    format!(
        "{}: {}; {}",
        problem.key,
        problem.what,
        problem.right.as_deref().unwrap_or("-")
    )
}

/// The problems of `text`, without their places.
pub(super) fn problems(text: &str) -> Vec<String> {
    let problems =
        load(text, &catalog()).map_or_else(|problems| problems, |config| config.warnings);
    problems.iter().map(problem_text).collect()
}

/// `text` has exactly one problem.
#[track_caller]
fn only(text: &str, expected: &str) {
    assert_eq!(problems(text), [expected]);
}

#[test]
fn settings_are_distinguished_by_what_they_say_and_not_by_how() {
    let catalog = vendors::catalog();
    let digest = |text: &str| load(text, &catalog).unwrap().digest;
    let first = digest(MINIMAL);
    let other_order = MINIMAL.replace(
        "name = \"hall-1\"\nport = \"/dev/ttyUSB0\"",
        "# the hall\nport   = '/dev/ttyUSB0'\nname = \"hall-1\"",
    );
    assert_ne!(other_order, MINIMAL);
    assert_eq!(digest(&other_order), first);
    assert_ne!(
        digest(&MINIMAL.replace("station = 1", "station = 2")),
        first
    );
}

#[test]
fn a_minimal_file_gets_its_defaults() {
    let config = good(MINIMAL);
    assert_eq!(config.gateway.name, None);
    let line = &config.lines[0];
    assert_eq!(
        (line.name.as_str(), &line.port),
        ("hall-1", &PortAddress::Device("/dev/ttyUSB0".into()))
    );
    assert_eq!(
        line.link,
        LinkSettings {
            baud: 9600,
            data_bits: 8,
            parity: Parity::None,
            stop_bits: 1
        }
    );
    assert_eq!(
        (line.framing, line.interface, line.silence),
        (Framing::Rtu, Interface::Rs485, LineSilence::Auto)
    );
    assert_eq!(
        (line.min_request_gap, line.reply_timeout),
        (Duration::ZERO, None)
    );
    let drive = &line.drives[0];
    assert_eq!(
        (drive.name.as_str(), drive.model.id.as_str()),
        ("pump-1", "hyundai-n700")
    );
    assert_eq!((drive.station.0, drive.unit.get()), (1, 1));
    assert_eq!(
        (drive.poll, drive.reply_timeout),
        (Duration::from_millis(500), None)
    );
    assert_eq!(drive.max_lateness, drive.model.timing.max_lateness.value);
    let listener = &config.listeners[0];
    assert_eq!(
        (listener.listen.port(), &listener.allow, &listener.lines),
        (1502, &None, &None)
    );
    assert!(listener.serves(0));
}

#[test]
fn the_example_file_resolves() {
    let config = good(&example());
    assert_eq!(config.gateway.name.unwrap().as_str(), "plant-a");
    let [pump_1, pump_2] = config.lines[0].drives.as_slice() else {
        panic!("two drives")
    };
    assert_eq!(pump_1.reply_timeout, Some(Duration::from_millis(300)));
    let added = pump_1.model.register_named("my_value").unwrap();
    assert_eq!(
        (added.address.number(), added.code.as_deref(), added.scale),
        (0x0333, Some("X123"), 10)
    );
    assert_eq!(pump_2.model.register_named("my_value"), None);
    assert_eq!((pump_2.unit.get(), pump_2.reply_timeout), (2, None));
    assert_eq!(config.listeners[0].lines, Some(vec![0]));
    assert_eq!(
        (pump_1.uniform_unit.get(), pump_2.uniform_unit.get()),
        (101, 102)
    );
    assert_eq!(
        pump_1.points.dead_bands,
        [("output_frequency".to_owned(), 0.05)]
    );
    assert_eq!(
        pump_1.control.as_ref().unwrap().native_write,
        [0x020C, 0x020E]
    );
    assert_eq!(pump_2.control, None);
    assert_eq!(
        config.mqtt.unwrap().broker.to_string(),
        "mqtts://broker.example:8883"
    );
    assert_eq!(config.http.unwrap().listen.port(), 8080);
}

#[test]
fn what_the_example_writes_is_the_default_where_it_says_so() {
    let text = example();
    let mut defaults = String::new();
    for line in text.lines() {
        let key = line.trim_start().split(" = ").next().unwrap_or_default();
        let is_default = [
            "restart_delay",
            "stop_effect_timeout",
            "stop_pending_for",
            "commands",
            "reverse_below_hz",
        ]
        .into_iter()
        .chain([
            "accept_unverified",
            "qualify",
            "allow_plain_password",
            "version",
            "prefix",
            "heartbeat",
            "keep_alive",
        ])
        .chain([
            "lease",
            "alive_topic",
            "probe_interval",
            "command_ttl",
            "uniform_unit",
            "client_id",
            "subscription_qos",
            "reads_renew",
            "cached",
        ]);
        if !is_default.into_iter().any(|it| it == key) {
            defaults += line;
            defaults += "\n";
        }
    }
    let mut written = good(&text);
    let left_out = good(&defaults);
    let mqtt = written.mqtt.as_mut().unwrap();
    assert_eq!(
        mqtt.client_id.take().as_deref(),
        Some("vfd-gateway-plant-a")
    );
    let sparkplug = mqtt.sparkplug.as_mut().unwrap();
    assert_eq!(
        sparkplug.client_id.take().as_deref(),
        Some("vfd-gateway-plant-a-sparkplug")
    );
    // What says the same in more words is another file.
    written.digest = left_out.digest;
    assert_eq!(written, left_out);
}

#[test]
fn a_drive_takes_the_reply_timeout_of_its_line_unless_it_says_otherwise() {
    let of_line = line_with("reply_timeout = \"300ms\"");
    assert_eq!(
        good(&of_line).lines[0].drives[0].reply_timeout,
        Some(Duration::from_millis(300))
    );
    let own = with(
        &of_line,
        "station = 1",
        "station = 1\nreply_timeout = \"200ms\"",
    );
    assert_eq!(
        good(&own).lines[0].drives[0].reply_timeout,
        Some(Duration::from_millis(200))
    );
    let auto = with(
        &of_line,
        "station = 1",
        "station = 1\nreply_timeout = \"auto\"",
    );
    assert_eq!(good(&auto).lines[0].drives[0].reply_timeout, None);
}

#[test]
fn many_mistakes_are_reported_at_once() {
    for (text, name) in [
        (
            include_str!("../../../../../tests/golden/config/ten_mistakes.toml"),
            "ten_mistakes",
        ),
        (
            include_str!("../../../../../tests/golden/config/serial_mistakes.toml"),
            "serial_mistakes",
        ),
    ] {
        let found = shown(text, &load(text, &catalog()).unwrap_err());
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join(format!("../../tests/golden/config/{name}.txt"));
        if std::env::var_os("UPDATE_GOLDEN").is_some() {
            std::fs::write(&path, &found).unwrap();
        }
        let expected = std::fs::read_to_string(&path).unwrap();
        assert_eq!(
            found,
            expected,
            "if this is meant: UPDATE_GOLDEN=1 writes {}",
            path.display()
        );
    }
}

#[test]
fn text_that_is_no_toml_is_reported_with_its_place() {
    let text = with(MINIMAL, "station = 1", "station = = 1");
    let found = load(&text, &catalog()).unwrap_err();
    assert_eq!(found[0].place_in(&text), (8, 11), "{found:?}");
    assert!(found[0].what.starts_with("not valid TOML"), "{found:?}");
}

#[test]
fn a_file_needs_a_line_and_a_line_needs_a_drive() {
    only(
        "",
        "line: there is no line; `[[line]]` with `name`, `port` and at least one `[[line.drive]]`",
    );
    only(
        "[[line]]\nname = 'a'\nport = '/dev/ttyUSB0'",
        "line[0].drive: the line has no drive; `[[line.drive]]` with `name`, `model` and `station`",
    );
}

#[test]
fn a_model_must_be_known() {
    only(
        &with(MINIMAL, "hyundai-n700", "hyundai-n70"),
        "line[0].drive[0].model: there is no model `hyundai-n70`; \"hyundai-n700\"",
    );
    let found = problems(&with(MINIMAL, "hyundai-n700", "generic"));
    assert_eq!(found.len(), 1, "{found:?}");
    for said in [
        "there is no model `generic`",
        "`vfd-gateway models list`",
        "any Modbus device",
        "`model_dirs`",
    ] {
        assert!(found[0].contains(said), "no {said}: {}", found[0]);
    }
}

#[test]
fn a_station_is_in_the_models_range_and_stands_once_on_its_line() {
    let text = with(MINIMAL, "station = 1", "station = 33\nunit = 1");
    only(
        &text,
        "line[0].drive[0].station: station 33 cannot be set on hyundai-n700; 1 to 32",
    );
    let text = drive_with("[[line.drive]]\nname = 'pump-2'\nmodel = 'hyundai-n700'\nstation = 1");
    only(
        &text,
        "line[0].drive[1].station: drive `pump-1` and drive `pump-2` both use station 1; \
         a station that no other drive on the line uses",
    );
    good(TWO_LINES);
    for beyond in [0, 250] {
        let text = with(MINIMAL, "station = 1", &format!("station = {beyond}"));
        only(
            &text,
            &format!(
                "line[0].drive[0].station: station {beyond} cannot be set on hyundai-n700; 1 to 32"
            ),
        );
    }
}

#[test]
fn link_settings_are_possible_with_every_model() {
    let at = "is not possible with hyundai-n700 (drive `pump-1`)";
    only(
        &line_with("baud = 115200"),
        &format!("line[0].baud: baud 115200 {at}; one of 2400, 4800, 9600, 19200, 38400"),
    );
    only(
        &line_with("framing = 'ascii'"),
        &format!("line[0].framing: framing \"ascii\" {at}; only \"rtu\""),
    );
    only(
        &line_with("data_bits = 7"),
        "line[0].data_bits: RTU frames need 8 data bits; 8, or leave it out",
    );
    only(
        &line_with("stop_bits = 3"),
        "line[0].stop_bits: 3 is out of range; a whole number from 1 to 2",
    );
    only(
        &line_with("parity = 'evne'"),
        "line[0].parity: `evne` is not an allowed value; \"even\"",
    );
}

#[test]
fn what_every_model_lacks_is_said_of_each() {
    let other = "[[line.drive]]\nname = 'mixer'\nmodel = 'acme-one'\nstation = 2";
    let text = with(
        &line_with("parity = 'odd'\nbaud = 19200\nstop_bits = 1"),
        "station = 1\n",
        &format!("station = 1\n{other}\n"),
    );
    only(
        &text,
        "line[0].parity: parity \"odd\" is not possible with acme-one (drive `mixer`); only \"even\"",
    );
    let text = with(
        &text,
        "parity = 'odd'",
        "interface = 'rs232'\nparity = 'even'",
    );
    let found = problems(&text);
    assert_eq!(
        found,
        [
            "line[0].interface: RS-232 carries one drive, and this line has 2; \"rs485\", or a line for each drive",
            "line[0].interface: interface \"rs232\" is not possible with acme-one (drive `mixer`); only \"rs485\"",
        ]
    );
}

#[test]
fn link_settings_that_the_models_do_not_share_must_be_given() {
    let text = drive_with("[[line.drive]]\nname = 'mixer'\nmodel = 'acme-one'\nstation = 2");
    let differ = "is left out, and the models of the line have different factory settings";
    assert_eq!(
        problems(&text),
        [
            format!(
                "line[0].baud: `baud` {differ}: hyundai-n700 9600, acme-one 19200; \
                 add `baud`, and set it on every drive: one of 9600, 19200"
            ),
            format!(
                "line[0].parity: `parity` {differ}: hyundai-n700 \"none\", acme-one \"even\"; \
                 add `parity`, and set it on every drive: only \"even\""
            ),
        ]
    );
    good(&with(
        &text,
        "port = \"/dev/ttyUSB0\"",
        "port = \"/dev/ttyUSB0\"\nbaud = 9600\nparity = \"even\"",
    ));
}

#[test]
fn names_and_ports_stand_once() {
    only(
        &with(TWO_LINES, "hall-2", "hall-1"),
        "line[1].name: the name `hall-1` is taken by line[0].name; a name that no other line uses",
    );
    only(
        &with(TWO_LINES, "pump-2", "pump-1"),
        "line[1].drive[0].name: the name `pump-1` is taken by line[0].drive[0].name; \
         a name that no other drive of the gateway uses",
    );
    only(
        &with(TWO_LINES, "/dev/ttyUSB1", "/dev//ttyUSB0"),
        "line[1].port: the port /dev//ttyUSB0 is taken by line[0].port; \
         a different port; drives on one bus belong to one line",
    );
}

#[test]
fn a_unit_belongs_to_one_drive_of_a_listener() {
    only(
        &with(TWO_LINES, "unit = 2", "unit = 1"),
        "line[1].drive[0].unit: drive `pump-1` and drive `pump-2` would both answer at unit 1; \
         unit = 2, which is free",
    );
    let apart = with(TWO_LINES, "unit = 2", "unit = 1")
        + "lines = ['hall-1']\n[[modbus_tcp]]\n\
                listen = '127.0.0.1:1503'\nlines = ['hall-2']";
    let config = good(&apart);
    assert!(config.listeners[1].serves(1) && !config.listeners[1].serves(0));
}

#[test]
fn a_unit_taken_by_a_station_on_the_same_line_is_reported() {
    let text = drive_with(
        "[[line.drive]]\nname = 'pump-2'\nmodel = 'hyundai-n700'\nstation = 2\nunit = 1",
    );
    only(
        &text,
        "line[0].drive[1].unit: drive `pump-1` and drive `pump-2` would both answer at unit 1; \
         unit = 2, which is free",
    );
}

#[test]
fn units_are_required_where_lines_share_a_listener() {
    let text = TWO_LINES
        .replace("unit = 1\n", "")
        .replace("unit = 2\n", "");
    let shared = "`unit` is left out, and the listener 127.0.0.1:1502 serves more than one line";
    assert_eq!(
        problems(&text),
        [
            format!("line[0].drive[0].unit: {shared}; unit = 1, which is free"),
            format!("line[1].drive[0].unit: {shared}; unit = 2, which is free"),
        ]
    );
    let found = problems(&with(&text, "station = 1", "station = \"1\""));
    assert_eq!(
        found.len(),
        3,
        "a wrong station does not hide the missing unit: {found:?}"
    );
}

#[test]
fn a_listener_without_a_free_unit_is_reported_so() {
    let mut text = TWO_LINES
        .replace("unit = 2\n", "")
        .replace("unit = 1\n", "unit = 1\nuniform_unit = 2\n");
    for station in 2..=123 {
        let model = if station <= 32 {
            "hyundai-n700"
        } else {
            "acme-one"
        };
        let units = format!("unit = {}\nuniform_unit = {}", 2 * station - 1, 2 * station);
        let drive = format!("name = 'd{station}'\nmodel = '{model}'\nstation = {station}\n{units}");
        text = with(
            &text,
            "[[line]]\nname = \"hall-2\"",
            &format!("[[line.drive]]\n{drive}\n[[line]]\nname = \"hall-2\""),
        );
    }
    let line = "name = \"hall-1\"\nmax_status_age = '1h'\nbaud = 9600\nparity = 'even'";
    text = with(&text, "name = \"hall-1\"", line);
    only(
        &text,
        "line[1].drive[0].unit: `unit` is left out, and the listener 127.0.0.1:1502 serves more than one line; \
         a listener of its own for each line (`lines`): no unit is free",
    );
}

#[test]
fn a_drive_adds_registers_to_its_own_model_only() {
    let register = |address: &str| {
        format!(
            "[[line.drive.register]]\nname = 'bus_voltage'\ntitle = 'DC bus voltage'\naddress = {address}\n\
             unit = 'V'\naccess = 'read'"
        )
    };
    let config = good(&drive_with(&register("0x0F00")));
    assert!(
        config.lines[0].drives[0]
            .model
            .register_at(0x0F00)
            .is_some()
    );
    let found = problems(&drive_with(&register("0x0002")));
    assert!(
        found[0].starts_with("line[0].drive[0].register[0].address: address 0x0002 is taken by"),
        "{found:?}"
    );
    let found = problems(&drive_with("[[line.drive.register]]\nname = 'Bus'"));
    let keys: Vec<_> = found.iter().filter_map(|it| it.split(':').next()).collect();
    assert_eq!(keys.len(), 5, "{found:?}");
}

#[test]
fn a_listener_that_others_can_reach_says_who_may_connect() {
    let text = with(MINIMAL, "127.0.0.1:1502", "0.0.0.0:1502");
    only(
        &text,
        "modbus_tcp[0].allow: 0.0.0.0:1502 can be reached from other hosts, and `allow` does not restrict them; \
         allow = [\"10.0.0.0/24\"] with your own networks, or a loopback address",
    );
    good(&format!("{text}allow = ['10.0.0.0/24']\n"));
    good(&with(MINIMAL, "127.0.0.1:1502", "[::1]:1502"));
}

#[test]
fn networks_are_exact() {
    let at = "modbus_tcp[0].allow[0]";
    for (network, problem) in [
        (
            "10.0.0.0/33",
            "is no network; an address and its length: \"10.0.0.0/24\", \"fd00::/64\"",
        ),
        (
            "10.0.0.5",
            "has no length; \"10.0.0.5/32\" for this one host",
        ),
        (
            "10.0.0.5/24",
            "is a host inside a network; \"10.0.0.0/24\" for the network, \"10.0.0.5/32\" for the host",
        ),
    ] {
        only(
            &listener_with(&format!("allow = ['{network}']")),
            &format!("{at}: `{network}` {problem}"),
        );
    }
    let empty = "modbus_tcp[0].allow: an empty list allows no client; \
                 networks as \"10.0.0.0/24\", or no listener at all";
    only(&listener_with("allow = []"), empty);
}

#[test]
fn listeners_keep_out_of_each_others_way() {
    let second = |listen: &str| {
        listener_with(&format!(
            "allow = ['10.0.0.0/8']\n[[modbus_tcp]]\nlisten = '{listen}'\nallow = ['10.0.0.0/8']"
        ))
    };
    for taken in ["127.0.0.1:1502", "0.0.0.0:1502", "[::]:1502"] {
        only(
            &second(taken),
            &format!(
                "modbus_tcp[1].listen: {taken} is taken by the listener 127.0.0.1:1502; \
                 a different address or port"
            ),
        );
    }
    for free in ["127.0.0.1:1503", "10.0.0.1:1502", "[::1]:1502"] {
        good(&second(free));
    }
    let any = with(&second("127.0.0.1:0"), "127.0.0.1:1502", "127.0.0.1:0");
    assert_eq!(good(&any).listeners.len(), 2);
}

#[test]
fn a_listener_serves_lines_that_exist() {
    only(
        &listener_with("lines = ['hall-2']"),
        "modbus_tcp[0].lines[0]: there is no line `hall-2`; \"hall-1\"",
    );
    only(
        &listener_with("lines = ['x']"),
        "modbus_tcp[0].lines[0]: there is no line `x`; names of lines of this file: hall-1",
    );
    only(
        &listener_with("lines = ['hall-1', 'hall-1']"),
        "modbus_tcp[0].lines[1]: line `hall-1` is listed twice; each once",
    );
    only(
        &listener_with("lines = []"),
        "modbus_tcp[0].lines: an empty list of lines serves nothing; names of lines, or leave it out to serve all",
    );
}

#[test]
fn times_stay_in_their_range() {
    for (text, key, right) in [
        (
            drive_with("poll = '9ms'"),
            "drive[0].poll: 9ms",
            "a time from \"10ms\" to \"1h\"",
        ),
        (
            drive_with("poll = '2h'"),
            "drive[0].poll: 2h",
            "a time from \"10ms\" to \"1h\"",
        ),
        (
            drive_with("max_lateness = '61s'"),
            "drive[0].max_lateness: 61s",
            "a time from \"10ms\" to \"1min\"",
        ),
        (
            line_with("reply_timeout = '0ms'"),
            "reply_timeout: 0ms",
            "\"auto\" or a time from \"1ms\" to \"1min\"",
        ),
        (
            line_with("silence = '2s'"),
            "silence: 2s",
            "\"auto\" or a time from \"0ms\" to \"1s\"",
        ),
        (
            line_with("min_request_gap = '11s'"),
            "min_request_gap: 11s",
            "a time from \"0ms\" to \"10s\"",
        ),
    ] {
        only(&text, &format!("line[0].{key} is out of range; {right}"));
    }
    let fixed = good(&line_with("silence = '0ms'")).lines[0].silence;
    assert_eq!(fixed, LineSilence::Fixed(Duration::ZERO));
}

#[test]
fn an_unknown_key_is_refused_with_the_nearest() {
    only(
        &line_with("buad = 9600"),
        "line[0].buad: unknown key `buad`; `baud`",
    );
}

pub(super) fn example() -> String {
    std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../deploy/vfd-gateway.toml"),
    )
    .unwrap()
}

proptest! {
    #[test]
    fn any_text_is_taken_or_refused_with_a_reason(text in "\\PC*") {
        prop_assert!(!matches!(load(&text, &catalog()), Err(problems) if problems.is_empty()));
    }

    #[test]
    fn a_damaged_file_is_taken_or_refused_with_a_reason(cut in 0..100_usize, at in 0..100_usize, put in "[\\[\\]=\"'0-9a-z\n.#{},-]{0,6}") {
        let example = example();
        let whole: Vec<char> = example.lines().filter(|line| !line.trim_start().starts_with('#')).flat_map(|line| line.chars().chain(['\n'])).collect();
        let location = |share: usize| whole.len() * share / 100;
        let damaged: String = whole[..location(at)].iter().copied().chain(put.chars()).chain(whole[location(at)..].iter().copied()).collect();
        let truncated: String = whole[..location(cut)].iter().collect();
        for text in [damaged, truncated] {
            if let Err(problems) = load(&text, &catalog()) {
                prop_assert!(!problems.is_empty());
                for problem in problems {
                    let (line, column) = problem.place_in(&text);
                    prop_assert!(line > 0 && column > 0);
                }
            }
        }
    }
}
