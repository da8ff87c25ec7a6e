//! Control sections: what they allow, what the model can do, and who could command at all.

use super::*;
use crate::domain::command::Direction;
use crate::domain::control::{
    BusFunctions, ControlAction, ControlSettings, FailSafe, LeaseMode, OnOutputOutside, Ownership,
    SiteEvidence,
};
use crate::domain::frequency::Hertz;
use crate::guard::COMMAND_DEADLINE;

const AT: &str = "line[0].drive[0].control";

/// `CONTROLLED` with `lines` added to the control section.
fn control_with(lines: &str) -> String {
    with(
        CONTROLLED,
        "on_shutdown = \"hold\"\n",
        &format!("on_shutdown = \"hold\"\n{lines}\n"),
    )
}

/// `CONTROLLED` with a drive of another model.
fn of_model(model: &str) -> String {
    let text = with(CONTROLLED, "[line.drive.native]\nwrite = [\"F007\"]\n", "");
    let text = with(
        &text,
        "[[line.drive]]\nname = \"pump-2\"\nmodel = \"hyundai-n700\"\nstation = 2\n",
        "",
    );
    with(&text, "hyundai-n700", model)
}

fn control(text: &str) -> ControlSettings {
    good(text).lines[0].drives[0]
        .control
        .as_deref()
        .unwrap()
        .clone()
}

fn seconds(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

#[test]
fn a_control_section_gets_its_defaults() {
    assert_eq!(
        control(CONTROLLED),
        ControlSettings {
            from_mqtt: true,
            from_modbus_tcp: true,
            from_page: false,
            from_sparkplug: false,
            bus: BusFunctions::Both,
            least: Hertz::from_millihertz(5000),
            most: Hertz::from_millihertz(50_000),
            directions: vec![Direction::Forward],
            reverse_below: Hertz::ZERO,
            on_commander_lost: FailSafe::Stop,
            lost_after: seconds(30),
            on_shutdown: FailSafe::Hold,
            on_output_outside: OnOutputOutside::Alarm,
            accept_unverified: Vec::new(),
            site: SiteEvidence::default(),
            qualify: false,
            allow_release: false,
            strict: false,
            restart_delay: seconds(3),
            stop_effect_timeout: seconds(3),
            stop_pending_for: seconds(600),
            native_write: vec![0x020C],
            ownership: Ownership::One,
            allow_take: false,
            lease: LeaseMode::Session,
            min_start_interval: Duration::ZERO,
            stored_write_interval: seconds(10),
            stores_native_writes: false,
            require_watchdog: false,
            watchdog: None,
            on_gateway_lost: None,
            failsafe_confirm_timeout: seconds(5),
        }
    );
    assert_eq!(
        good(CONTROLLED).lines[0].drives[1].control,
        None,
        "read-only from everywhere"
    );
}

/// Whether a configuration is made of `text`, whatever is reported of it.
fn is_made(text: &str) -> bool {
    let mut problems = Vec::new();
    let file = ConfigFile::read(text, &mut problems).unwrap();
    let models = KnownModels {
        catalog: &catalog(),
        are_all: true,
        site: Ok(&QualifiedResults::default()),
    };
    resolve::resolve(&file, models, &mut problems).is_some()
}

#[test]
fn nothing_is_made_of_an_invalid_value() {
    assert!(is_made(CONTROLLED));
    let from = "from = [\"mqtt\", \"modbus-tcp\"]";
    assert!(!is_made(&with(CONTROLLED, from, "from = ['fax']")));
    assert!(!is_made(&control_with("accept_unverified = ['all']")));
    assert!(!is_made(&control_with("directions = []")));
    let topic = "[mqtt]\nlease = 'explicit'\nalive_topic = '#'\n";
    assert!(!is_made(&with(CONTROLLED, "[mqtt]\n", topic)));
}

#[test]
fn a_wired_stop_is_promised_by_nobody() {
    let bus = |word: &str| {
        with(
            CONTROLLED,
            "lost_after",
            &format!("bus = '{word}'\nlost_after"),
        )
    };
    assert_eq!(
        good(&bus("run")).lines[0].drives[0]
            .control
            .as_ref()
            .unwrap()
            .bus,
        BusFunctions::Run
    );
    let held = bus("frequency").replace(
        "on_commander_lost = \"stop\"",
        "on_commander_lost = \"hold\"",
    );
    assert_eq!(
        good(&held).lines[0].drives[0].control.as_ref().unwrap().bus,
        BusFunctions::Frequency
    );
    let found = problems(&bus("frequency"));
    assert!(
        found
            .iter()
            .any(|it| it.contains("so this cannot be relied on; \"hold\"")),
        "{found:?}"
    );
}

#[test]
fn a_drive_that_may_be_commanded_is_looked_at() {
    let poll = |poll: &str| {
        with(
            CONTROLLED,
            "station = 1\n",
            &format!("station = 1\npoll = '{poll}'\n"),
        )
    };
    assert_eq!(good(&poll("5s")).lines[0].drives[0].poll, seconds(5));
    let reported = problems(&poll("6s"));
    assert_eq!(
        reported,
        ["line[0].drive[0].poll: too slow for a drive with a control section; at most \"5s\""]
    );
}

#[test]
fn a_control_section_takes_what_is_written() {
    let found = control(&with(
        &control_with(
            "directions = ['reverse', 'forward']\nreverse_below_hz = 1.5\ncommands = 'strict'\nrestart_delay = '0s'\n\
             stop_effect_timeout = '500ms'\nstop_pending_for = '1h'",
        ),
        "on_commander_lost = \"stop\"",
        "on_commander_lost = \"coast\"",
    ));
    assert_eq!(found.directions, [Direction::Reverse, Direction::Forward]);
    assert_eq!(
        (found.reverse_below, found.strict),
        (Hertz::from_millihertz(1500), true)
    );
    assert_eq!(
        (found.restart_delay, found.stop_pending_for),
        (Duration::ZERO, seconds(3600))
    );
    assert_eq!(
        (found.on_commander_lost, found.stop_effect_timeout),
        (FailSafe::Coast, Duration::from_millis(500))
    );
    let one_way = control(&with(
        CONTROLLED,
        "[\"mqtt\", \"modbus-tcp\"]",
        "['modbus-tcp']",
    ));
    assert!(one_way.from_modbus_tcp && !one_way.from_mqtt);
}

const FAIL_SAFES: &str = "one of \"stop\" (the motor is stopped by its ramp), \"coast\" (the output is cut off, the motor \
                          coasts), \"hold\" (no action: a running motor keeps running)";

#[test]
fn what_must_be_chosen_has_no_default() {
    for (line, key, right) in [
        (
            "from = [\"mqtt\", \"modbus-tcp\"]\n",
            "from",
            "a list, each one of \"mqtt\" (clients of the broker in `[mqtt]` command), \"modbus-tcp\" (clients of a \
             `[[modbus_tcp]]` command, as far as its `write` lets them), \"page\" (users of `[http]` command from the page), \
             \"sparkplug\" (hosts of Sparkplug B command)",
        ),
        (
            "frequency_hz = { min = 5.0, max = 50.0 }\n",
            "frequency_hz",
            "a table `frequency_hz`",
        ),
        (
            "on_commander_lost = \"stop\"\n",
            "on_commander_lost",
            FAIL_SAFES,
        ),
        (
            "lost_after = \"30s\"\n",
            "lost_after",
            "a time from \"1s\" to \"1h\"",
        ),
        ("on_shutdown = \"hold\"\n", "on_shutdown", FAIL_SAFES),
    ] {
        only(
            &with(CONTROLLED, line, ""),
            &format!("{AT}.{key}: `{key}` is missing; {right}"),
        );
    }
}

#[test]
fn somebody_commands_and_nobody_twice() {
    let from = |list: &str| with(CONTROLLED, "[\"mqtt\", \"modbus-tcp\"]", list);
    let found = problems(&from("[]"));
    let empty = format!(
        "{AT}.from: an empty list allows no commands; \"mqtt\", \"modbus-tcp\", \"page\", \"sparkplug\" or several of them, or no control section"
    );
    assert_eq!(found[0], empty);
    assert!(
        found[1].starts_with(
            "modbus_tcp[0].write: has no effect: no drive that is served here takes commands"
        ),
        "{found:?}"
    );
    only(
        &from("['mqtt', 'modbus-tcp', 'mqtt']"),
        &format!("{AT}.from[2]: \"mqtt\" is listed twice; each once"),
    );
    let found = problems(&from("['mqtt', 'modbustcp']"));
    assert!(
        found[0].starts_with(&format!(
            "{AT}.from[1]: `modbustcp` is not an allowed value; one of \"mqtt\" ("
        )),
        "{found:?}"
    );
}

#[test]
fn a_way_that_is_closed_is_not_named() {
    let mqtt = "[mqtt]\nbroker = \"mqtt://127.0.0.1\"\n";
    only(
        &with(CONTROLLED, mqtt, ""),
        &format!(
            "{AT}.from[0]: commands from \"mqtt\" are impossible: there is no `[mqtt]`; \
             `[mqtt]` with `broker`, or leave it out"
        ),
    );
    let nobody = format!(
        "{AT}.from[1]: commands from \"modbus-tcp\" are impossible: no listener of line `hall-1` allows any client to write; \
         `write = [\"10.0.0.10/32\"]` in a `[[modbus_tcp]]`, or leave it out"
    );
    only(
        &with(CONTROLLED, "write = [\"127.0.0.1/32\"]\n", ""),
        &nobody,
    );
    only(
        &with(CONTROLLED, "write = [\"127.0.0.1/32\"]\n", "write = []\n"),
        &nobody,
    );
    only(
        &with(
            CONTROLLED,
            "[[modbus_tcp]]\nlisten = \"127.0.0.1:1502\"\nwrite = [\"127.0.0.1/32\"]\n",
            "",
        ),
        &nobody,
    );
    let other = "[[line]]\nname = 'hall-2'\nport = '/dev/ttyUSB1'\n[[line.drive]]\nname = 'fan'\n\
                 model = 'hyundai-n700'\nstation = 1\n[mqtt]";
    let elsewhere = with(
        &with(CONTROLLED, "[mqtt]", other),
        "write = [\"127",
        "lines = ['hall-2']\nwrite = [\"127",
    );
    assert_eq!(problems(&elsewhere)[0], nobody);
    assert_eq!(
        problems(&elsewhere).len(),
        2,
        "and that right to write is for nothing"
    );
}

#[test]
fn what_concerns_mqtt_only_is_not_there_without_it() {
    let text = with(
        &control_with("commands = 'plain'\nrestart_delay = '5s'"),
        "\"mqtt\", ",
        "",
    );
    let at = |key: &str| {
        format!(
            "{AT}.{key}: concerns commands over MQTT and Sparkplug only, and `from` names neither \"mqtt\" nor \"sparkplug\"; leave it out"
        )
    };
    let neither = "concerns commands over MQTT, Sparkplug and from the page only, and `from` names none of them; leave it out";
    assert_eq!(
        problems(&text),
        [at("commands"), format!("{AT}.restart_delay: {neither}")]
    );
    let by_page = with(&text, "[\"modbus-tcp\"]", "['page']");
    assert!(
        !problems(&by_page)
            .iter()
            .any(|it| it.contains("restart_delay"))
    );
}

#[test]
fn a_run_that_waited_unnoticed_at_the_broker_is_distinguished_from_one_after_a_stop() {
    let text = |control: &str, mqtt: &str| {
        with(
            &control_with(control),
            "[mqtt]\n",
            &format!("[mqtt]\n{mqtt}\n"),
        )
    };
    only(
        &text("restart_delay = '2s'", ""),
        &format!(
            "{AT}.restart_delay: 2s is too short to distinguish a RUN that waited at the broker \
             from one that was sent after the stop: with `probe_interval` = \"1s\" a RUN may wait \
             1750ms before that is noticed; at least \"2750ms\", or leave it out"
        ),
    );
    only(
        &text("", "probe_interval = '10s'"),
        "mqtt.probe_interval: a command could wait 10750ms at the broker before that is noticed, \
         so no RUN could be accepted for more than 5s after a stop; at most \"3250ms\"",
    );
    for (keys, mqtt, millis) in [
        ("", "", 3_000),
        ("", "probe_interval = '3250ms'", 5_000),
        ("", "probe_interval = '200ms'", 3_000),
        ("restart_delay = '2750ms'", "", 2_750),
        ("restart_delay = '2s'", "probe_interval = '250ms'", 2_000),
        ("restart_delay = '0s'\ncommands = 'strict'", "", 0),
    ] {
        let found = good(&text(keys, mqtt));
        let control = found.lines[0].drives[0].control.as_ref().unwrap();
        assert_eq!(
            control.restart_delay,
            Duration::from_millis(millis),
            "{keys} {mqtt}"
        );
    }
}

#[test]
fn a_run_of_the_page_that_waited_unnoticed_is_distinguished_from_one_after_a_stop() {
    let text = |delay: &str| {
        let text = control_with(&format!("restart_delay = '{delay}'"));
        with(&text, "\"mqtt\", \"modbus-tcp\"", "'page'")
    };
    let of_the_delay = |delay: &str| {
        let mut all = problems(&text(delay));
        all.retain(|it| it.contains("restart_delay"));
        all
    };
    let too_short = format!(
        "{AT}.restart_delay: 2s is too short to distinguish a RUN of the page that waited on its \
         way from one that was sent after the stop: a RUN may wait 1500ms before that is noticed; \
         at least \"2500ms\", or leave it out"
    );
    assert_eq!(of_the_delay("2s"), [too_short]);
    assert!(of_the_delay("2500ms").is_empty());
}

#[test]
fn limits_are_setpoints_that_the_drive_can_be_given() {
    let limits = |min: &str, max: &str| {
        with(
            CONTROLLED,
            "min = 5.0, max = 50.0",
            &format!("min = {min}, max = {max}"),
        )
    };
    let settable = "a frequency that `frequency_command` can represent";
    for (min, max, problem) in [
        (
            "50.1",
            "50.0",
            "min: the lowest frequency, 50.10 Hz, is above the highest, 50.00 Hz; at most 50.00"
                .to_owned(),
        ),
        (
            "0.0",
            "0.0",
            "max: a drive with a maximum of 0 Hz never turns; more than 0".to_owned(),
        ),
        (
            "5.005",
            "50",
            format!("min: 5.005 Hz is finer than the register's steps of 1/100; {settable}"),
        ),
        (
            "5.0",
            "655.36",
            format!("max: 655.36 Hz is outside 0.00 to 655.35; {settable}"),
        ),
        (
            "5.00001",
            "50",
            "min: 5.00001 is finer than 0.001 Hz; at most three decimals".to_owned(),
        ),
        (
            "-1",
            "50",
            "min: -1 is out of range; a number from 0 to 10000".to_owned(),
        ),
        (
            "nan",
            "50",
            "min: nan is out of range; a number from 0 to 10000".to_owned(),
        ),
        (
            "'5'",
            "50",
            "min: must be a number, not text; a number from 0 to 10000".to_owned(),
        ),
    ] {
        only(&limits(min, max), &format!("{AT}.frequency_hz.{problem}"));
    }
    assert_eq!(
        control(&limits("0", "655.35")).most,
        Hertz::from_millihertz(655_350)
    );
    assert_eq!(
        control(&limits("50.0", "50.0")).least,
        Hertz::from_millihertz(50_000)
    );
    let found = problems(&with(CONTROLLED, "min = 5.0, max", "mni = 5.0, max"));
    assert_eq!(
        found,
        [
            format!("{AT}.frequency_hz.min: `min` is missing; a number from 0 to 10000"),
            format!("{AT}.frequency_hz.mni: unknown key `mni`; `min`"),
        ]
    );
}

#[test]
fn directions_and_reversal_go_together() {
    only(
        &control_with("directions = []"),
        &format!(
            "{AT}.directions: an empty list lets the drive run in no direction; \"forward\", \"reverse\" or both"
        ),
    );
    only(
        &control_with("directions = ['forward', 'forward']"),
        &format!("{AT}.directions[1]: \"forward\" is listed twice; each once"),
    );
    for one in [
        "",
        "directions = ['forward']\n",
        "directions = ['reverse']\n",
    ] {
        only(
            &control_with(&format!("{one}reverse_below_hz = 0.0")),
            &format!(
                "{AT}.reverse_below_hz: there is nothing to reverse: `directions` allows one direction only; \
                 leave it out, or directions = [\"forward\", \"reverse\"]"
            ),
        );
    }
}

#[test]
fn a_model_that_cannot_be_commanded_has_no_control_section() {
    let text = of_model("acme-one").replace("\"hold\"", "\"coast\"");
    only(
        &text,
        &format!(
            "{AT}: acme-one cannot be controlled: its description has no run commands; \
             leave `control` out; the drive is then read-only"
        ),
    );
}

#[test]
fn control_needs_registers_to_command_by() {
    let acme = include_str!("../../../../../tests/golden/config/acme-two.toml");
    for (from, to, why) in [
        (
            "unit = \"Hz\"\naccess = \"read-write\"",
            "unit = \"%\"\naccess = \"read-write\"".to_owned(),
            "its frequency command is not in Hz",
        ),
        (
            "role = \"frequency-command\"\n",
            String::new(),
            "its description has no registers for run and frequency commands",
        ),
    ] {
        let catalog =
            Catalog::from_texts([("acme-two.toml", with(acme, from, &to).as_str())]).unwrap();
        let found = load(&of_model("acme-two"), &catalog).unwrap_err();
        let what = format!("acme-two cannot be controlled: {why}");
        assert_eq!(
            found.iter().map(|it| it.what.as_str()).collect::<Vec<_>>(),
            [what]
        );
    }
}

#[test]
fn a_drive_whose_stop_is_unproven_takes_no_orders_until_that_is_accepted() {
    let acme = include_str!("../../../../../tests/golden/config/acme-two.toml");
    let stop = "stop = { value = 0, confidence = \"manual\"";
    let run_register = "role = \"run-command\"\nconfidence = \"manual\"";
    let outcome = |from: &str, to: &str, lines: &str| {
        let catalog =
            Catalog::from_texts([("acme-two.toml", with(acme, from, to).as_str())]).unwrap();
        let text = with(
            &of_model("acme-two"),
            "on_shutdown = \"hold\"\n",
            &format!("on_shutdown = \"hold\"\n{lines}\n"),
        );
        load(&text, &catalog)
            .map(drop)
            .map_err(|problems| problems.iter().map(problem_text).collect::<Vec<_>>())
    };
    let inferred = stop.replace("manual", "inferred");
    let error = |what: &str, list: &str| {
        Err(vec![format!(
            "{AT}.accept_unverified: acme-two takes no orders: no manual of it proves {what}; \
             accept_unverified = [{list}] once you have seen a stop work, or no control section; the drive is then read-only"
        )])
    };
    assert_eq!(
        outcome(stop, &inferred, ""),
        error("stop (inferred)", "\"basic\"")
    );
    assert_eq!(
        outcome(stop, &inferred, "accept_unverified = ['reset']"),
        error("stop (inferred)", "\"basic\", \"reset\""),
        "the line is the whole line"
    );
    let sibling = run_register.replace("manual", "sibling");
    assert_eq!(
        outcome(run_register, &sibling, ""),
        error("the run command's register (sibling)", "\"basic\"")
    );
    for accepted in [
        "accept_unverified = ['basic']",
        "accept_unverified = ['reset', 'basic']",
    ] {
        assert_eq!(outcome(stop, &inferred, accepted), Ok(()), "{accepted}");
        assert_eq!(
            outcome(run_register, &sibling, accepted),
            Ok(()),
            "{accepted}"
        );
    }
}

#[test]
fn every_built_in_model_names_the_line_with_which_it_takes_orders() {
    let catalog = crate::vendors::catalog();
    for id in catalog.ids() {
        let model = catalog.find(id).unwrap();
        let unproven = !model.unproven_basics().is_empty();
        let text = with(CONTROLLED, "[line.drive.native]\nwrite = [\"F007\"]\n", "");
        let full_scale = if model.needs_full_scale() {
            "\nfull_scale_hz = 50.0"
        } else {
            ""
        };
        let drive = format!("model = '{id}'\nstation = 1{full_scale}");
        let text = with(&text, "model = \"hyundai-n700\"\nstation = 1", &drive);
        let line = "accept_unverified = [\"basic\"]";
        let found: Vec<_> = load(&text, &catalog).map_or_else(|it| it, |_| Vec::new());
        let named: Vec<_> = found
            .iter()
            .filter(|it| it.key == format!("{AT}.accept_unverified"))
            .collect();
        assert_eq!(named.len(), usize::from(unproven), "{id}: {found:?}");
        assert!(
            named
                .iter()
                .all(|it| it.right.as_deref().unwrap().starts_with(line)),
            "{id}: {named:?}"
        );
    }
}

#[test]
fn the_deadline_of_a_command_is_that_of_the_slowest_way() {
    let deadline = |text: &str| {
        let config = good(text);
        command_deadline(
            config.lines[0].drives[0].control.as_ref().unwrap(),
            config.mqtt.as_ref(),
        )
    };
    let ttl = |ttl: &str| {
        with(
            CONTROLLED,
            "[mqtt]\n",
            &format!("[mqtt]\ncommand_ttl = '{ttl}'\n"),
        )
    };
    assert_eq!(deadline(&ttl("5s")), seconds(5));
    assert_eq!(deadline(&ttl("100ms")), COMMAND_DEADLINE);
    assert_eq!(
        deadline(&with(&ttl("5s"), "\"mqtt\", ", "")),
        COMMAND_DEADLINE
    );
    let by_mqtt = with(
        &with(&ttl("100ms"), ", \"modbus-tcp\"", ""),
        "write = [\"127.0.0.1/32\"]",
        "",
    );
    assert_eq!(deadline(&by_mqtt), Duration::from_millis(100));
}

#[test]
fn what_a_model_cannot_do_is_refused_by_name() {
    let text = of_model("acme-two")
        .replace("\"hold\"", "\"coast\"")
        .replace("\"stop\"", "\"coast\"");
    let no_coast = |key: &str| format!("{AT}.{key}: acme-two has no coast; \"stop\" or \"hold\"");
    assert_eq!(
        problems(&text),
        [no_coast("on_commander_lost"), no_coast("on_shutdown")]
    );
    only(
        &with(&of_model("acme-two"), "min = 5.0", "min = 5.05"),
        &format!(
            "{AT}.frequency_hz.min: 5.05 Hz is finer than the register's steps of 1/10; \
             a frequency that `frequency_command` can represent"
        ),
    );
}

#[test]
fn what_is_unproven_is_off_until_it_is_accepted() {
    let two = |lines: &str| {
        with(
            &of_model("acme-two"),
            "on_shutdown = \"hold\"\n",
            &format!("on_shutdown = \"hold\"\n{lines}\n"),
        )
    };
    only(
        &two("directions = ['forward', 'reverse']"),
        &format!(
            "{AT}.directions[1]: reverse is unproven for acme-two (sibling); \
             leave it out, or accept_unverified = [\"reverse\"] once you have seen it work"
        ),
    );
    let accepted =
        two("directions = ['forward', 'reverse']\naccept_unverified = ['reverse', 'reset']");
    assert_eq!(
        control(&accepted).accept_unverified,
        [ControlAction::Reverse, ControlAction::Reset]
    );
}

#[test]
fn an_acceptance_accepts_something() {
    let two = with(
        &of_model("acme-two"),
        "on_shutdown = \"hold\"\n",
        "on_shutdown = \"hold\"\naccept_unverified = [X]\n",
    );
    for (list, problem) in [
        (
            "'coast'",
            "[0]: acme-two has no coast, so there is nothing to accept; leave it out",
        ),
        (
            "'reverse'",
            "[0]: `directions` does not allow \"reverse\", so there is nothing to accept; leave it out",
        ),
        (
            "'reset', 'reset'",
            "[1]: \"reset\" is listed twice; each once",
        ),
        (
            "'rest'",
            "[0]: `rest` is not an allowed value; one of \"basic\" (stopping, running forward and setting the frequency), \
             \"reverse\" (running in reverse), \"reset\" (resetting a trip), \"coast\" (cutting the output off), \"release\" (handing control back to panel and terminals)",
        ),
    ] {
        only(
            &with(&two, "[X]", &format!("[{list}]")),
            &format!("{AT}.accept_unverified{problem}"),
        );
    }
    for (action, at) in [("reverse", 0), ("reset", 1), ("coast", 2)] {
        let problem = format!(
            "{AT}.accept_unverified[{at}]: {action} is proven for hyundai-n700 (manual), so there is nothing to accept; \
             leave it out"
        );
        let found = problems(&control_with(
            "accept_unverified = ['reverse', 'reset', 'coast']",
        ));
        assert_eq!(found[at], problem);
    }
    assert_eq!(
        control(&control_with("accept_unverified = []")).accept_unverified,
        []
    );
}

#[test]
fn a_lease_outlasts_commands_and_probes() {
    let lost_after = |time: &str, mqtt: &str| {
        with(
            &with(CONTROLLED, "\"30s\"", &format!("\"{time}\"")),
            "[mqtt]\n",
            &format!("[mqtt]\n{mqtt}\n"),
        )
    };
    let at = format!("{AT}.lost_after");
    only(
        &lost_after("1s", "probe_interval = '200ms'"),
        &format!(
            "{at}: a lease of 1s is not longer than the deadline of a command, 1s; a longer time, as \"5s\""
        ),
    );
    only(
        &lost_after("2s", ""),
        &format!(
            "{at}: a session lease of 2s is shorter than 3 probes of the way through the broker, 3s; \
             at least \"3s\", or a shorter `probe_interval`"
        ),
    );
    only(
        &lost_after("10s", "command_ttl = '10s'"),
        &format!(
            "{at}: a lease of 10s is not longer than `command_ttl`, 10s; more than \"10s\", or a shorter `command_ttl`"
        ),
    );
    for (time, mqtt) in [
        ("3s", ""),
        ("2s", "probe_interval = '500ms'"),
        ("2s", "lease = 'explicit'"),
    ] {
        good(&lost_after(time, mqtt));
    }
    let without = with(&lost_after("2s", "command_ttl = '1min'"), "\"mqtt\", ", "");
    assert_eq!(
        control(&without).lost_after,
        seconds(2),
        "the broker's times concern those who come by it"
    );
}

#[test]
fn times_of_control_stay_in_their_range() {
    for (text, problem) in [
        (
            with(CONTROLLED, "30s", "999ms"),
            "lost_after: 999ms is out of range; a time from \"1s\" to \"1h\"",
        ),
        (
            with(CONTROLLED, "30s", "2h"),
            "lost_after: 2h is out of range; a time from \"1s\" to \"1h\"",
        ),
        (
            control_with("restart_delay = '61s'"),
            "restart_delay: 61s is out of range; a time from \"0ms\" to \"1min\"",
        ),
        (
            control_with("stop_effect_timeout = '499ms'"),
            "stop_effect_timeout: 499ms is out of range; a time from \"500ms\" to \"1min\"",
        ),
        (
            control_with("stop_pending_for = '0s'"),
            "stop_pending_for: 0s is out of range; a time from \"1s\" to \"1h\"",
        ),
    ] {
        only(&text, &format!("{AT}.{problem}"));
    }
}

#[test]
fn a_control_section_of_an_unknown_model_is_checked_as_far_as_it_goes() {
    let text = with(
        CONTROLLED,
        "model = \"hyundai-n700\"",
        "model = \"hyundai-n70\"",
    )
    .replace("max = 50.0", "max = 1.0");
    assert_eq!(
        problems(&text),
        [
            "line[0].drive[0].model: there is no model `hyundai-n70`; \"hyundai-n700\"".to_owned(),
            format!(
                "{AT}.frequency_hz.min: the lowest frequency, 5.00 Hz, is above the highest, 1.00 Hz; at most 1.00"
            ),
        ]
    );
}

proptest! {
    #[test]
    fn any_limits_are_exact_or_refused(min in "[0-9]{1,5}(\\.[0-9]{0,5})?", max in "[0-9]{1,5}(\\.[0-9]{1,5})?") {
        let text = with(CONTROLLED, "min = 5.0, max = 50.0", &format!("min = {min}, max = {max}"));
        if let Ok(config) = load(&text, &catalog()) {
            let control = config.lines[0].drives[0].control.clone().unwrap();
            prop_assert!(control.least <= control.most && control.most > Hertz::ZERO);
            for (limit, written) in [(control.least, min), (control.most, max)] {
                prop_assert_eq!(limit.as_f64(), written.parse::<f64>().unwrap());
                prop_assert!(limit.to_word(100).is_some());
            }
        }
    }
}
