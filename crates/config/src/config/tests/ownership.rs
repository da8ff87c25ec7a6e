//! Who may command while somebody holds control, what keeps a lease, and how often a drive is started and written.

use super::*;
use crate::domain::control::{ControlSettings, LeaseMode, Ownership};

const AT: &str = "line[0].drive[0].control";

fn control_with(lines: &str) -> String {
    with(
        CONTROLLED,
        "on_shutdown = \"hold\"\n",
        &format!("on_shutdown = \"hold\"\n{lines}\n"),
    )
}

fn control(text: &str) -> ControlSettings {
    good(text).lines[0].drives[0]
        .control
        .as_deref()
        .unwrap()
        .clone()
}

#[test]
fn ownership_and_interlocks_are_taken_as_written() {
    let found = control(&with(
        &control_with("ownership = 'any'\nallow_take = true\nmin_start_interval = '10min'"),
        "write = [\"F007\"]",
        "write = ['F007']\nstored_write_interval = '24h'",
    ));
    assert_eq!((found.ownership, found.allow_take), (Ownership::Any, true));
    assert_eq!(
        (
            found.min_start_interval.as_secs(),
            found.stored_write_interval.as_secs()
        ),
        (600, 86_400)
    );
    let reported = problems(&control_with("ownership = 'all'"));
    let words = "\"one\" (only the client that holds control commands), \"any\" (control passes to \
                 the client that commands last)";
    assert_eq!(
        reported,
        [format!(
            "{AT}.ownership: `all` is not an allowed value; one of {words}"
        )]
    );
    assert_eq!(
        problems(&control_with("min_start_interval = '2h'")).len(),
        1
    );
    let often = with(
        CONTROLLED,
        "write = [\"F007\"]",
        "write = ['F007']\nstored_write_interval = '500ms'",
    );
    assert_eq!(problems(&often).len(), 1);
}

/// `CONTROLLED` with these leases of the broker and of the first drive, where one is given.
fn leases(mqtt: Option<&str>, drive: Option<&str>) -> String {
    let line = |lease: Option<&str>| {
        lease
            .map(|lease| format!("lease = '{lease}'\n"))
            .unwrap_or_default()
    };
    let text = control_with(&line(drive));
    with(
        &text,
        "broker = \"mqtt://127.0.0.1\"\n",
        &format!("broker = \"mqtt://127.0.0.1\"\n{}", line(mqtt)),
    )
}

#[test]
fn a_drives_lease_goes_before_that_of_the_broker() {
    use LeaseMode::{Explicit, Session};
    for (mqtt, drive, lease) in [
        (None, None, Session),
        (Some("explicit"), None, Explicit),
        (None, Some("explicit"), Explicit),
        (Some("explicit"), Some("session"), Session),
    ] {
        let text = leases(mqtt, drive);
        assert_eq!(control(&text).lease, lease, "{mqtt:?} {drive:?}");
        // The way through the broker keeps leases if it keeps that of any drive.
        let found = good(&text).mqtt.unwrap();
        assert_eq!(
            (found.session.lease, found.session.alive_topic.is_some()),
            (lease, lease == Session),
            "{mqtt:?} {drive:?}"
        );
    }
    let reported = problems(&with(
        &leases(None, Some("explicit")),
        "broker =",
        "alive_topic = 'ha/status'\nbroker =",
    ));
    assert!(
        matches!(&reported[..], [one] if one.contains("has no effect: an explicit lease does not depend on a topic")),
        "{reported:?}"
    );
}

#[test]
fn a_lease_over_mqtt_needs_mqtt() {
    let text = with(
        &leases(None, Some("explicit")),
        "[\"mqtt\", \"modbus-tcp\"]",
        "['modbus-tcp']",
    );
    let reported = problems(&text);
    let what = format!(
        "{AT}.lease: concerns commands over MQTT and Sparkplug only, and `from` names neither \"mqtt\" nor \"sparkplug\"; leave it out"
    );
    assert_eq!(reported, [what]);
}

#[test]
fn an_explicit_lease_of_a_drive_is_not_held_to_the_probes() {
    let short = |drive| {
        with(
            &leases(None, drive),
            "lost_after = \"30s\"",
            "lost_after = '2s'",
        )
    };
    let reported = problems(&short(None));
    assert!(
        matches!(&reported[..], [one] if one.contains("is shorter than 3 probes")),
        "{reported:?}"
    );
    assert_eq!(control(&short(Some("explicit"))).lost_after.as_secs(), 2);
}
