//! A second gateway on the same lines: every rule broken once, and all of them at once.

use super::*;
use crate::config::change::ConfigChange;
use crate::domain::ids::Name;
use crate::domain::standby::{OnGatewayLost, StandbyPair};
use crate::line::standby::StandbyTimes;

const SECTION: &str = "[standby]\nhalf = \"a\"\npartner = \"b\"\n";
const WORDS: &str = "one of \"stop\" (the motor is stopped by its ramp), \"coast\" (the output is cut off, the motor coasts), \
                     \"hold\" (no action: a running motor keeps running), \"adopt\" (a running motor keeps running for \
                     `lost_after`, then `on_commander_lost` follows)";

/// `CONTROLLED` with `section`, `lines` in its line, and `control` in its control section.
fn pair_of(section: &str, lines: &str, control: &str) -> String {
    let text = with(CONTROLLED, "[[line]]\n", &format!("{section}[[line]]\n"));
    let text = with(
        &text,
        "name = \"hall-1\"\n",
        &format!("name = \"hall-1\"\n{lines}\n"),
    );
    with(
        &text,
        "on_shutdown = \"hold\"\n",
        &format!("on_shutdown = \"hold\"\n{control}\n"),
    )
}

fn pair() -> String {
    pair_of(SECTION, "standby = true", "on_gateway_lost = \"stop\"")
}

#[test]
fn a_pair_gets_its_defaults() {
    let config = good(&pair());
    assert!(config.warnings.is_empty(), "{:?}", config.warnings);
    let (half, partner) = (Name::new("a").unwrap(), Name::new("b").unwrap());
    let expected = StandbyPair {
        half,
        partner,
        rank: 0,
        take_over_after: None,
    };
    assert_eq!(config.standby.as_ref(), Some(&expected));
    assert_eq!(config.lines[0].standby.as_ref(), Some(&expected));
    let control = config.lines[0].drives[0].control.as_ref().unwrap();
    assert_eq!(control.on_gateway_lost, Some(OnGatewayLost::Stop));
    let alone = good(CONTROLLED);
    assert_eq!((&alone.standby, &alone.lines[0].standby), (&None, &None));
    assert_eq!(
        alone.lines[0].drives[0]
            .control
            .as_ref()
            .unwrap()
            .on_gateway_lost,
        None
    );
}

#[test]
fn every_word_and_every_number_of_the_pair_is_taken() {
    for action in OnGatewayLost::ALL {
        let text = with(
            &pair(),
            "on_gateway_lost = \"stop\"",
            &format!("on_gateway_lost = \"{}\"", action.keyword()),
        );
        let config = good(&text);
        assert_eq!(
            config.lines[0].drives[0]
                .control
                .as_ref()
                .unwrap()
                .on_gateway_lost,
            Some(action)
        );
    }
    let section = "[standby]\nhalf = \"North_1.left-row\"\npartner = \"b\"\nrank = 7\ntake_over_after = \"10min\"\n";
    let config = good(&with(&pair(), SECTION, section));
    let pair = config.standby.unwrap();
    assert_eq!(
        (pair.rank, pair.take_over_after),
        (7, Some(Duration::from_secs(600)))
    );
    assert_eq!(
        line_plan_times(&config.lines[0]).take_over_after,
        Duration::from_millis(603_500)
    );
}

fn line_plan_times(line: &LineSettings) -> StandbyTimes {
    crate::config::line_plan::standby_times(line, line.standby.as_ref().unwrap())
}

#[test]
fn the_two_have_names_of_their_own() {
    only(
        &with(&pair(), "partner = \"b\"", "partner = \"a\""),
        "standby.partner: `a` is the name of this gateway itself; the `half` of the other gateway",
    );
    let right = "1 to 16 characters a-z, A-Z, 0-9, \"-\", \"_\" or \".\", not only dots";
    for bad in ["", "seventeen-letters", "a b", "a/b"] {
        only(
            &with(&pair(), "half = \"a\"", &format!("half = \"{bad}\"")),
            &format!("standby.half: `{bad}` is not valid; {right}"),
        );
    }
    only(
        &with(&pair(), "half = \"a\"\n", ""),
        &format!("standby.half: `half` is missing; {right}"),
    );
    only(
        &with(&pair(), "partner = \"b\"\n", ""),
        &format!("standby.partner: `partner` is missing; {right}"),
    );
    only(
        &with(&pair(), "half = \"a\"", "half = \"a\"\nrank = 8"),
        "standby.rank: 8 is out of range; a whole number from 0 to 7",
    );
}

#[test]
fn a_second_gateway_needs_a_section_and_the_section_a_line() {
    only(
        &with(&pair(), SECTION, ""),
        "line[0].standby: there is no `[standby]`, which names the two gateways of the line; `[standby]` with `half` and \
         `partner`, or leave it out",
    );
    let idle = with(&pair(), "standby = true\n", "standby = false\n");
    let found = problems(&idle);
    let none = "standby: has no effect: no line has `standby = true`; `standby = true` in each `[[line]]` that the other \
                gateway is on";
    let unused = "line[0].drive[0].control.on_gateway_lost: has no effect: the line has no second gateway; leave it out, or \
                  `standby = true` in the `[[line]]`";
    assert_eq!(found, [none, unused]);
    let config = good(&idle);
    assert_eq!(config.lines[0].standby, None);
    assert_eq!(
        config.lines[0].drives[0]
            .control
            .as_ref()
            .unwrap()
            .on_gateway_lost,
        None
    );
}

#[test]
fn nothing_is_assumed_about_a_running_drive() {
    only(
        &with(&pair(), "on_gateway_lost = \"stop\"\n", ""),
        &format!(
            "line[0].drive[0].control.on_gateway_lost: `on_gateway_lost` is missing: the line has a second gateway, which may \
             have ordered the drive to run; {WORDS}"
        ),
    );
    only(
        &with(
            &pair(),
            "on_gateway_lost = \"stop\"",
            "on_gateway_lost = \"continue\"",
        ),
        &format!(
            "line[0].drive[0].control.on_gateway_lost: `continue` is not an allowed value; {WORDS}"
        ),
    );
    // A drive without control needs none: it cannot be started from here.
    let text = line_with("standby = true");
    assert!(good(&format!("{SECTION}{text}")).lines[0].standby.is_some());
}

#[test]
fn a_coast_is_proven_or_accepted() {
    let coast = with(
        &pair(),
        "on_gateway_lost = \"stop\"",
        "on_gateway_lost = \"coast\"",
    );
    let of_commander = with(
        CONTROLLED,
        "on_commander_lost = \"stop\"",
        "on_commander_lost = \"coast\"",
    );
    for model in [
        "hyundai-n700",
        "hyundai-n100plus",
        "teco-e510",
        "frecon-fr500a",
        "toshiba-vf-s15",
    ] {
        let coast_problems = |text: &str| {
            let text = text
                .replace("hyundai-n700", model)
                .replace("write = [\"F007\"]", "write = []");
            problems(&text)
                .into_iter()
                .filter(|it| it.contains("coast"))
                .collect::<Vec<_>>()
        };
        let expected: Vec<_> = coast_problems(&of_commander)
            .iter()
            .map(|it| it.replace("on_commander_lost", "on_gateway_lost"))
            .collect();
        assert_eq!(coast_problems(&coast), expected, "{model}");
    }
    assert!(
        problems(&of_commander.replace("hyundai-n700", "toshiba-vf-s15"))
            .iter()
            .any(|it| it.contains("coast"))
    );
}

#[test]
fn a_drive_that_is_wired_is_not_promised_to_stop() {
    let bus = "on_gateway_lost = \"stop\"\nbus = \"frequency\"";
    let text = with(&pair(), "on_gateway_lost = \"stop\"", bus);
    let text = with(
        &text,
        "on_commander_lost = \"stop\"",
        "on_commander_lost = \"hold\"",
    );
    only(
        &text,
        "line[0].drive[0].control.on_gateway_lost: the drive is started and stopped elsewhere (bus = \"frequency\"), so this \
         cannot be relied on; \"hold\" or \"adopt\", or bus = \"both\"",
    );
    for good_word in ["hold", "adopt"] {
        good(&with(
            &text,
            "on_gateway_lost = \"stop\"",
            &format!("on_gateway_lost = \"{good_word}\""),
        ));
    }
}

#[test]
fn a_line_that_cannot_be_heard_has_no_second_gateway() {
    let right = "leave it out; two gateways need RS-485 at a serial device of each";
    let nothing = "line[0].standby: a second gateway would hear nothing";
    for (from, to, why) in [
        (
            "\"/dev/ttyUSB0\"",
            "\"tcp://10.0.0.7:4001\"",
            "a serial device server passes on only what its drives send",
        ),
        (
            "\"/dev/ttyUSB0\"",
            "\"modbus-tcp://10.0.0.7\"",
            "a Modbus TCP connection belongs to one client",
        ),
        (
            "standby = true",
            "standby = true\ninterface = \"rs232\"",
            "RS-232 connects two devices, not three",
        ),
    ] {
        let text = with(&pair(), from, to);
        let reported = problems(&text);
        assert!(
            reported.contains(&format!("{nothing}: {why}; {right}")),
            "{reported:?}"
        );
    }
    good(&with(
        &pair(),
        "standby = true",
        "standby = true\ninterface = \"rs485\"",
    ));
}

#[test]
fn the_station_of_the_gateways_is_no_drive() {
    let reported = problems(&with(&pair(), "station = 1\n", "station = 250\n"));
    let expected = "line[0].drive[0].station: the gateways of a line use station 250 for \
                    themselves; another station of the drive";
    assert!(
        reported.iter().any(|problem| problem == expected),
        "{reported:?}"
    );
}

#[test]
fn no_program_holds_the_line_while_it_is_suspended() {
    let switched = |by: &str| {
        with(
            &pair(),
            "standby = true",
            &format!("standby = true\nrs485 = \"{by}\""),
        )
    };
    only(
        &switched("rts"),
        "line[0].rs485: with a second gateway: a program that is suspended while it holds RTS keeps the other one from \
         sending; \"adapter\" or \"kernel\"",
    );
    good(&switched("kernel"));
    good(&with(&switched("rts"), "standby = true", "standby = false"));
}

#[test]
fn the_silence_is_no_shorter_than_the_line_needs() {
    let after = |time: &str| {
        with(
            &pair(),
            "partner = \"b\"\n",
            &format!("partner = \"b\"\ntake_over_after = \"{time}\"\n"),
        )
    };
    only(
        &after("2499ms"),
        "standby.take_over_after: after 2499ms the other gateway may still be sending on line `hall-1`, or waiting for a \
         reply there; at least \"2500ms\", or \"auto\"",
    );
    assert_eq!(good(&after("auto")).standby.unwrap().take_over_after, None);
    assert_eq!(
        good(&after("2500ms")).standby.unwrap().take_over_after,
        Some(Duration::from_millis(2500))
    );
    only(
        &after("900ms"),
        "standby.take_over_after: 900ms is out of range; \"auto\" or a time from \"1s\" to \"10min\"",
    );
    // A line that waits longer for its replies needs more, and what is named then is enough.
    let slow = with(
        &after("5s"),
        "standby = true",
        "standby = true\nreply_timeout = \"8s\"",
    );
    let [problem] = &problems(&slow)[..] else {
        panic!("{:?}", problems(&slow))
    };
    let least = problem
        .split("at least \"")
        .nth(1)
        .and_then(|it| it.split('"').next())
        .unwrap();
    assert!(problem.contains("line `hall-1`"), "{problem}");
    let given = good(&with(&slow, "\"5s\"", &format!("\"{least}\"")));
    let auto = good(&with(&slow, "\"5s\"", "\"auto\""));
    let (given, auto) = (
        line_plan_times(&given.lines[0]),
        line_plan_times(&auto.lines[0]),
    );
    assert_eq!(given.silent_at_most, auto.silent_at_most);
    assert!(
        given.silent_at_most > Duration::from_millis(8500),
        "{given:?}"
    );
    let added = given
        .take_over_after
        .checked_sub(auto.take_over_after)
        .unwrap();
    assert!(added < Duration::from_millis(1), "{given:?} {auto:?}");
    // Without a second gateway on it, a line needs nothing.
    let other = with(&slow, "standby = true", "standby = false");
    assert!(
        problems(&other)
            .iter()
            .all(|it| !it.contains("take_over_after"))
    );
}

#[test]
fn all_mistakes_are_told_at_once() {
    let section = "[standby]\nhalf = \"a\"\npartner = \"a\"\nrank = 9\ntake_over_after = \"soon\"\nname = \"x\"\n";
    let text = pair_of(section, "standby = true\ninterface = \"rs232\"", "");
    let reported = problems(&text);
    let keys: Vec<_> = reported
        .iter()
        .map(|it| it.split(": ").next().unwrap())
        .collect();
    let expected = [
        "standby.partner",
        "standby.rank",
        "standby.take_over_after",
        "standby.name",
        "line[0].standby",
        "line[0].interface",
        "line[0].drive[0].control.on_gateway_lost",
    ];
    assert!(
        expected.iter().all(|key| keys.contains(key)),
        "{reported:?}"
    );
}

#[test]
fn a_changed_pair_restarts_its_lines() {
    let both = format!(
        "{}[[line]]\nname = \"hall-2\"\nport = \"/dev/ttyUSB1\"\n[[line.drive]]\nname = \"fan\"\nmodel = \
         \"hyundai-n700\"\nstation = 1\nunit = 9\n",
        with(&pair(), "station = 1\n", "station = 1\nunit = 1\n")
            .replace("station = 2\n", "station = 2\nunit = 2\n")
    );
    let old = good(&both);
    for (from, to) in [
        ("rank", "rank = 1"),
        ("half", "half = \"c\""),
        ("after", "take_over_after = \"4s\""),
    ] {
        let new = match from {
            "half" => with(&both, "half = \"a\"", to),
            _ => with(&both, "half = \"a\"\n", &format!("half = \"a\"\n{to}\n")),
        };
        let change = ConfigChange::between(&old, &good(&new));
        assert_eq!(
            (&change.continues, &change.ended),
            (&vec![None, Some(1)], &vec![0]),
            "{to}"
        );
        let notes: Vec<_> = change.notes.iter().map(ToString::to_string).collect();
        assert_eq!(notes, ["standby: changed", "line hall-1: changed"]);
    }
    let alone = with(&both, "standby = true", "standby = false");
    let change = ConfigChange::between(&old, &good(&alone));
    assert_eq!(change.continues, [None, Some(1)]);
}
