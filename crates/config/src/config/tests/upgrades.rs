//! A configuration that was right yesterday is right today: what a model no longer needs, has proven since or knows by now is
//! a warning, as is every key that has no effect. What changes what may move a motor is an error.

use super::super::*;
use super::{CONTROLLED, catalog, drive_with, with};
use crate::domain::problem::Problem;

/// The file with a useless key; the key, as the warning names it.
struct Useless {
    text: String,
    key: &'static str,
}

fn control_with(lines: &str) -> String {
    with(
        CONTROLLED,
        "on_shutdown = \"hold\"\n",
        &format!("on_shutdown = \"hold\"\n{lines}\n"),
    )
}

fn listener_with(lines: &str) -> String {
    with(
        CONTROLLED,
        "[http]",
        &format!("[[modbus_tcp]]\nlisten = \"127.0.0.1:1503\"\n{lines}\n[http]"),
    )
}

fn mqtt_with(lines: &str) -> String {
    with(
        CONTROLLED,
        "broker = \"mqtt://127.0.0.1\"\n",
        &format!("broker = \"mqtt://127.0.0.1\"\n{lines}\n"),
    )
}

fn line_with(lines: &str) -> String {
    with(
        CONTROLLED,
        "port = \"/dev/ttyUSB0\"\n",
        &format!("{lines}\n"),
    )
}

/// A register of one's own.
fn register_at(address: &str) -> String {
    format!(
        "[[line.drive.register]]\nname = 'mine'\ntitle = 'Mine'\naddress = {address}\nunit = '-'\naccess = 'read'\n\
         poll = 'slow'\n"
    )
}

/// Configurations of 0.7.0 and 0.8.0, each with one key that does nothing.
fn useless() -> Vec<Useless> {
    let second = |lines: &str| {
        with(
            CONTROLLED,
            "station = 2\n",
            &format!("station = 2\n{lines}\n"),
        )
    };
    let of = |key, text: String| Useless { text, key };
    vec![
        // What a model has proven since, does not have, or does not need.
        of(
            "line[0].drive[0].control.accept_unverified[0]",
            control_with("accept_unverified = ['reset']"),
        ),
        of(
            "line[0].drive[0].control.accept_unverified[0]",
            control_with("accept_unverified = ['release']"),
        ),
        of(
            "line[0].drive[0].control.allow_release",
            control_with("allow_release = true"),
        ),
        of(
            "line[0].drive[0].control.failsafe_confirm_timeout",
            control_with("failsafe_confirm_timeout = '5s'"),
        ),
        of(
            "line[0].drive[1].rated_current_a",
            second("rated_current_a = 7.5"),
        ),
        of(
            "line[0].drive[1].rated_voltage_v",
            second("rated_voltage_v = 400"),
        ),
        of(
            "line[0].drive[1].register[0].address",
            second(&register_at("0x020C")),
        ),
        of(
            "line[0].drive[1].register[0].address",
            second(&register_at("0x0101")),
        ),
        of(
            "line[0].drive[1].dead_bands.gone",
            second("dead_bands = { gone = 1 }"),
        ),
        of(
            "line[0].drive[1].decimals.trip_count",
            second("decimals = { trip_count = 1 }"),
        ),
        // What has no effect beside other keys.
        of(
            "line[0].drive[0].control.reverse_below_hz",
            control_with("reverse_below_hz = 2.0"),
        ),
        of(
            "line[0].drive[0].control.commands",
            with(&control_with("commands = 'plain'"), "\"mqtt\", ", ""),
        ),
        of(
            "line[0].drive[0].control.from[2]",
            with(CONTROLLED, "\"modbus-tcp\"]", "\"modbus-tcp\", \"mqtt\"]"),
        ),
        of(
            "line[0].drive[0].native.write[1]",
            with(CONTROLLED, "[\"F007\"]", "[\"F007\", \"0x020C\"]"),
        ),
        of(
            "line[0].drive[1].native",
            second("[line.drive.native]\nwrite = ['F007']"),
        ),
        of(
            "line[0].rs485",
            line_with("port = 'tcp://10.0.0.7:4001'\nrs485 = 'kernel'"),
        ),
        of(
            "line[0].low_latency",
            line_with("port = 'tcp://10.0.0.7:4001'\nlow_latency = true"),
        ),
        // Lists without takers.
        of(
            "modbus_tcp[1].write",
            listener_with("units = [2, 102]\nwrite = ['127.0.0.1/32']"),
        ),
        of("modbus_tcp[1].units[1]", listener_with("units = [1, 77]")),
        of(
            "modbus_tcp[1].lines[1]",
            listener_with("lines = ['hall-1', 'hall-1']"),
        ),
        of(
            "modbus_tcp[1].reads_renew",
            listener_with("reads_renew = true"),
        ),
        of(
            "http.users[0]",
            format!(
                "{CONTROLLED}[[http.users]]\nname = 'anna'\npassword_hash_file = '/run/hash'\n"
            ),
        ),
        of(
            "mqtt.also_at[0]",
            mqtt_with("also_at = ['mqtt://127.0.0.1:1883']"),
        ),
        of(
            "mqtt.allow_plain_password",
            mqtt_with("allow_plain_password = true"),
        ),
        of("mqtt.publish[1]", mqtt_with("publish = ['state', 'state']")),
        of(
            "mqtt.response_prefix",
            mqtt_with("version = 4\nresponse_prefix = 'answers'"),
        ),
        of(
            "mqtt.alive_topic",
            mqtt_with("lease = 'explicit'\nalive_topic = 'a/b'"),
        ),
        of(
            "journal",
            with(CONTROLLED, "data_dir = \"/var/lib/vfd-gateway\"\n", ""),
        ),
        of(
            "gateway.model_dirs[1]",
            with(
                CONTROLLED,
                "[gateway]\n",
                "[gateway]\nmodel_dirs = ['/m', '/m']\n",
            ),
        ),
    ]
}

#[test]
fn a_useless_key_is_a_warning_and_the_gateway_starts() {
    for Useless { text, key } in useless() {
        let config = match load(&text, &catalog()) {
            Ok(config) => config,
            Err(problems) => panic!(
                "{key} keeps the gateway from starting: {}",
                super::shown(&text, &problems)
            ),
        };
        let keys: Vec<_> = config.warnings.iter().map(|it| it.key.as_str()).collect();
        assert!(keys.contains(&key), "{key}: {keys:?}");
        assert!(
            config
                .warnings
                .iter()
                .all(|it| it.is_warning && it.right.is_some()),
            "{:?}",
            config.warnings
        );
    }
    assert_eq!(load(CONTROLLED, &catalog()).unwrap().warnings, []);
}

#[test]
fn what_changes_what_may_move_a_motor_stays_an_error() {
    let native = |register: &str| {
        with(
            CONTROLLED,
            "[\"F007\"]",
            &format!("[\"F007\", \"{register}\"]"),
        )
    };
    for (key, text) in [
        (
            "line[0].drive[0].control.require_watchdog",
            control_with("require_watchdog = true"),
        ),
        (
            "line[0].drive[0].control.watchdog",
            control_with("watchdog = '2s'"),
        ),
        (
            "line[0].drive[0].control.directions",
            control_with("directions = []"),
        ),
        (
            "line[0].drive[0].control.frequency_hz.max",
            with(CONTROLLED, "max = 50.0", "max = 50.001"),
        ),
        (
            "line[0].drive[0].control.from[0]",
            with(CONTROLLED, "[mqtt]\nbroker = \"mqtt://127.0.0.1\"\n", ""),
        ),
        ("line[0].drive[0].native.write[1]", native("F001")),
        ("line[0].drive[0].native.write[1]", native("F010")),
        ("line[0].drive[0].native.write[1]", native("0x7777")),
        (
            "line[0].drive[0].register[0].address",
            drive_with(&register_at("0x0211")),
        ),
        (
            "modbus_tcp[0].write[1]",
            with(
                CONTROLLED,
                "[\"127.0.0.1/32\"]",
                "['127.0.0.1/32', '10.0.0.1/32']",
            ),
        ),
    ] {
        let problems = load(&text, &catalog()).expect_err(key);
        let is_it = |it: &Problem| it.key == key && !it.is_warning;
        assert!(
            problems.iter().any(is_it),
            "{key}: {}",
            super::shown(&text, &problems)
        );
    }
}

#[test]
fn a_register_that_the_model_knows_by_now_stays_as_the_configuration_describes_it() {
    let extra = |address| drive_with(&register_at(address));
    let at = |text: &str, address| {
        let config = load(text, &catalog()).unwrap();
        config.lines[0].drives[0]
            .model
            .register_at(address)
            .unwrap()
            .name
            .clone()
    };
    let of_vf_s15 = |text: &str| with(text, "hyundai-n700", "toshiba-vf-s15");
    assert_eq!(at(&of_vf_s15(&extra("0xFE27")), 0xFE27), "mine");
    assert_eq!(
        at(&extra("0x0101"), 0x0101),
        "output_frequency",
        "the gateway itself reads that one"
    );
}

#[test]
fn a_choice_that_moves_a_motor_is_never_guessed() {
    let fail_safes = "one of \"stop\" (the motor is stopped by its ramp), \"coast\" (the output is cut off, the motor \
                      coasts), \"hold\" (no action: a running motor keeps running)";
    for (from, to, right) in [
        (
            "on_commander_lost = \"stop\"",
            "on_commander_lost = \"halt\"",
            fail_safes,
        ),
        (
            "on_shutdown = \"hold\"",
            "on_shutdown = \"holt\"",
            fail_safes,
        ),
        (
            "on_shutdown = \"hold\"\n",
            "on_shutdown = \"hold\"\ndirections = ['revers']\n",
            "\"reverse\" (the motor may",
        ),
        (
            "on_shutdown = \"hold\"\n",
            "on_shutdown = \"hold\"\nownership = 'an'\n",
            "\"any\" (control passes",
        ),
        (
            "on_shutdown = \"hold\"\n",
            "on_shutdown = \"hold\"\nlease = 'sesion'\n",
            "\"explicit\" (control lasts only",
        ),
        (
            "on_shutdown = \"hold\"\n",
            "on_shutdown = \"hold\"\ncommands = 'plan'\n",
            "\"strict\" (RUN over MQTT only",
        ),
        (
            "[gateway]\n",
            "[gateway]\non_removal = 'stopp'\n",
            "\"refuse\" (the reload is refused, the motor keeps running)",
        ),
        (
            "\"mqtt\", \"modbus-tcp\"]",
            "\"mqqt\", \"modbus-tcp\"]",
            "\"page\" (users of `[http]` command",
        ),
    ] {
        let problems = load(&with(CONTROLLED, from, to), &catalog()).unwrap_err();
        let reported = problems
            .iter()
            .filter(|it| it.what.ends_with("is not an allowed value"));
        let rights: Vec<_> = reported.map(|it| it.right.clone().unwrap()).collect();
        assert!(
            rights.len() == 1 && rights[0].contains(right) && rights[0].starts_with("one of "),
            "{rights:?}"
        );
    }
}
