//! How polled registers are published: dead bands, heartbeats, decimals, and which topics there are at all.

use super::*;
use crate::north::mqtt::TopicTree;

fn drive(table: &str) -> String {
    with(
        CONTROLLED,
        "station = 1\n",
        &format!("station = 1\n{table}\n"),
    )
}

fn publishing(list: &str, table: &str) -> String {
    with(
        &drive(table),
        "[mqtt]\n",
        &format!("[mqtt]\npublish = {list}\n"),
    )
}

#[test]
fn dead_bands_are_those_of_polled_registers() {
    let bands = |table: &str| {
        with(
            CONTROLLED,
            "station = 1\n",
            &format!("station = 1\ndead_bands = {table}\n"),
        )
    };
    let config = good(&bands("{ output_frequency = 0.05, trip_count = 1 }"));
    let mut found = config.lines[0].drives[0].points.dead_bands.clone();
    found.sort_by(|one, other| one.0.cmp(&other.0));
    assert_eq!(
        found,
        [
            ("output_frequency".to_owned(), 0.05),
            ("trip_count".to_owned(), 1.0)
        ]
    );
    let at = "line[0].drive[0].dead_bands";
    only(
        &bands("{ output_freqency = 0.05 }"),
        &format!(
            "{at}.output_freqency: has no effect: no register `output_freqency` is polled; `output_frequency`"
        ),
    );
    only(
        &bands("{ acceleration_time = 1 }"),
        &format!(
            "{at}.acceleration_time: has no effect: no register `acceleration_time` is polled; \
             one of output_frequency, trip_count, frequency_setting, frequency_source, run_source"
        ),
    );
    for wrong in ["0", "-0.1", "inf"] {
        only(
            &bands(&format!("{{ output_frequency = {wrong} }}")),
            &format!(
                "{at}.output_frequency: {wrong} is out of range; a number from 0.000001 to 100000"
            ),
        );
    }
    only(
        &drive_with("dead_bands = { output_frequency = 0.05 }"),
        &format!(
            "{at}: has no effect: a dead band applies only to a broker, and there is no `[mqtt]`; \
             leave it out"
        ),
    );
}

#[test]
fn heartbeats_and_decimals_are_those_of_polled_registers() {
    let config = good(&drive(
        "heartbeats = { output_frequency = '5s' }\ndecimals = { output_frequency = 1, trip_count = 0 }",
    ));
    let points = &config.lines[0].drives[0].points;
    assert_eq!(
        points.heartbeats,
        [("output_frequency".to_owned(), Duration::from_secs(5))]
    );
    let mut decimals = points.decimals.clone();
    decimals.sort();
    assert_eq!(
        decimals,
        [
            ("output_frequency".to_owned(), 1),
            ("trip_count".to_owned(), 0)
        ]
    );
    let at = "line[0].drive[0]";
    for (table, problem) in [
        (
            "heartbeats = { output_freqency = '5s' }",
            "heartbeats.output_freqency: has no effect: no register `output_freqency` is polled; `output_frequency`",
        ),
        (
            "heartbeats = { output_frequency = '500ms' }",
            "heartbeats.output_frequency: 500ms is out of range; a time from \"1s\" to \"1h\"",
        ),
        (
            "decimals = { output_frequency = 3 }",
            "decimals.output_frequency: has no effect: `output_frequency` is not finer than 2 decimals; 0 to 2",
        ),
        (
            "decimals = { trip_count = 1 }",
            "decimals.trip_count: has no effect: `trip_count` is not finer than 0 decimals; leave it out",
        ),
        (
            "decimals = { output_frequency = -1 }",
            "decimals.output_frequency: -1 is out of range; a whole number from 0 to 9",
        ),
    ] {
        only(&drive(table), &format!("{at}.{problem}"));
    }
    let several = "dead_bands = { a = 1 }\nheartbeats = { b = '5s' }\ndecimals = { c = 1 }";
    assert_eq!(problems(&drive(several)).len(), 3, "all at once");
    only(
        &drive_with("heartbeats = { output_frequency = '5s' }"),
        &format!(
            "{at}.heartbeats: has no effect: a heartbeat applies only to a broker, and there is no \
             `[mqtt]`; leave it out"
        ),
    );
}

#[test]
fn what_is_published_is_listed() {
    let listed = |list: &str| good(&publishing(list, "")).mqtt.unwrap().session.publish;
    assert_eq!(
        good(CONTROLLED).mqtt.unwrap().session.publish,
        TopicTree::ALL
    );
    assert_eq!(listed("[]"), []);
    assert_eq!(
        listed("['values', 'state']"),
        [TopicTree::Values, TopicTree::State]
    );
    for (list, problem) in [
        (
            "['stat']",
            "mqtt.publish[0]: `stat` is not an allowed value; \"state\"",
        ),
        (
            "['history']",
            "mqtt.publish[0]: `history` is not an allowed value; one of \"state\", \"values\", \"param\", \"line\", \"info\"",
        ),
        (
            "['line', 'line']",
            "mqtt.publish[1]: \"line\" is listed twice; each once",
        ),
        (
            "'values'",
            "mqtt.publish: must be a list, not text; a list, each one of \"state\", \"values\", \"param\", \"line\", \"info\"",
        ),
    ] {
        only(&publishing(list, ""), problem);
    }
}

#[test]
fn a_table_about_topics_that_are_left_out_is_refused() {
    let refusal = |key: &str| {
        format!(
            "line[0].drive[0].{key}: has no effect: it is about topics that `publish` in `[mqtt]` leaves out; \
             leave it out, or add \"values\" there"
        )
    };
    let heartbeats = "heartbeats = { output_frequency = '5s' }";
    let bands = "dead_bands = { output_frequency = 0.1 }";
    let decimals = "decimals = { output_frequency = 1 }";
    only(&publishing("['state']", heartbeats), &refusal("heartbeats"));
    good(&publishing("['state']", bands));
    good(&publishing(
        "['values']",
        &format!("{heartbeats}\n{decimals}"),
    ));
    only(&publishing("['line']", bands), &refusal("dead_bands"));
    only(&publishing("['line']", decimals), &refusal("decimals"));
    good(&publishing("['line']\nkeep_telemetry = 10", bands));
}
