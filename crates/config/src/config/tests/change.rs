//! What a reload would do, as a table: a text is changed, and the difference reported.

use super::{CONTROLLED, TWO_LINES, good, with};
use crate::config::change::ConfigChange;

/// A second line with a drive of its own.
const THIRD: &str = "[[line]]\nname = \"hall-0\"\nport = \"/dev/ttyUSB9\"\n[[line.drive]]\nname = \"pump-0\"\n\
                     model = \"hyundai-n700\"\nstation = 1\nunit = 9\n";

fn between(old: &str, new: &str) -> ConfigChange {
    ConfigChange::between(&good(old), &good(new))
}

fn change_texts(change: &ConfigChange) -> Vec<String> {
    change.notes.iter().map(ToString::to_string).collect()
}

#[test]
fn what_differs_is_reported_and_nothing_else() {
    let table: &[(&str, &str, &[&str])] = &[
        ("hall-1\"", "hall-1\"", &[]),
        (
            "[gateway]",
            "[gateway]\non_removal = \"stop\"",
            &["gateway: changed"],
        ),
        ("[gateway]", "[gateway]\non_removal = \"refuse\"", &[]),
        (
            "lost_after = \"30s\"",
            "lost_after = \"20s\"",
            &["line hall-1: changed", "drive pump-1: changed"],
        ),
        (
            "/dev/ttyUSB0\"",
            "/dev/ttyUSB1\"",
            &["line hall-1: changed"],
        ),
        (
            "/dev/ttyUSB0\"",
            "/dev/ttyUSB0\"\nbaud = 19200",
            &["line hall-1: changed"],
        ),
        (
            "name = \"pump-2\"",
            "name = \"pump-3\"",
            &[
                "line hall-1: changed",
                "drive pump-3: added",
                "drive pump-2: removed",
            ],
        ),
        (
            "name = \"hall-1\"",
            "name = \"hall-2\"",
            &[
                "line hall-2: added",
                "line hall-1: removed",
                "drive pump-1: changed",
                "drive pump-2: changed",
            ],
        ),
        (
            "broker = \"mqtt://127.0.0.1\"",
            "broker = \"mqtt://127.0.0.2\"",
            &["mqtt: changed"],
        ),
        (
            "127.0.0.1:1502",
            "127.0.0.1:1503",
            &[
                "modbus_tcp 127.0.0.1:1503: added",
                "modbus_tcp 127.0.0.1:1502: removed",
            ],
        ),
        (
            "write = [\"127.0.0.1/32\"]",
            "write = [\"127.0.0.0/8\"]",
            &["modbus_tcp 127.0.0.1:1502: changed"],
        ),
        (
            "[http]\nlisten = \"127.0.0.1:8080\"\n",
            "",
            &["http: removed"],
        ),
        ("127.0.0.1:8080", "127.0.0.1:8081", &["http: changed"]),
    ];
    for (old, new, right) in table {
        let change = between(CONTROLLED, &with(CONTROLLED, old, new));
        assert_eq!(change_texts(&change), *right, "{old} -> {new}");
        let back = between(&with(CONTROLLED, old, new), CONTROLLED);
        assert_eq!(back.notes.is_empty(), right.is_empty(), "{new} -> {old}");
    }
}

#[test]
fn a_serial_master_is_told_by_its_name() {
    let master = |name: &str, more: &str| {
        let keys = "port = '/dev/ttyS9'\nbaud = 9600\nparity = 'none'\nlines = ['hall-1']";
        format!("\n[[modbus_rtu]]\nname = '{name}'\n{keys}\n{more}\n")
    };
    let with = |master: &str| format!("{TWO_LINES}{master}");
    let panel = with(&master("panel", ""));
    assert_eq!(
        change_texts(&between(TWO_LINES, &panel)),
        ["modbus_rtu panel: added"]
    );
    assert_eq!(
        change_texts(&between(&panel, TWO_LINES)),
        ["modbus_rtu panel: removed"]
    );
    for more in ["cached = true", "units = [101]", "answer_within = '200ms'"] {
        assert_eq!(
            change_texts(&between(&panel, &with(&master("panel", more)))),
            ["modbus_rtu panel: changed"],
            "{more}"
        );
    }
    let renamed = change_texts(&between(&panel, &with(&master("plc", ""))));
    assert_eq!(
        renamed,
        ["modbus_rtu plc: added", "modbus_rtu panel: removed"]
    );
    // Its line has another place in the file.
    let moved = change_texts(&between(&panel, &format!("{THIRD}{panel}")));
    assert_eq!(moved, ["line hall-0: added", "drive pump-0: added"]);
}

#[test]
fn a_line_goes_on_wherever_it_stands_in_the_file() {
    let both = between(TWO_LINES, &format!("{THIRD}{TWO_LINES}"));
    assert_eq!(
        (both.continues, both.ended),
        (vec![None, Some(0), Some(1)], vec![])
    );
    let back = between(&format!("{THIRD}{TWO_LINES}"), TWO_LINES);
    assert_eq!(
        (back.continues, back.ended),
        (vec![Some(1), Some(2)], vec![0])
    );
    let changed = with(
        TWO_LINES,
        "name = \"pump-2\"",
        "poll = \"2s\"\nname = \"pump-2\"",
    );
    let changed = between(TWO_LINES, &changed);
    assert_eq!(
        (&changed.continues, &changed.ended),
        (&vec![Some(0), None], &vec![1])
    );
    assert_eq!(
        change_texts(&changed),
        ["line hall-2: changed", "drive pump-2: changed"]
    );
    let old = good(TWO_LINES);
    assert_eq!(changed.leaving(&old).collect::<Vec<_>>(), [(1, "pump-2")]);
}

#[test]
fn a_listener_keeps_its_socket_by_its_address_and_its_lines_by_their_names() {
    let listed = with(
        TWO_LINES,
        "[[modbus_tcp]]",
        "[[modbus_tcp]]\nlines = [\"hall-1\", \"hall-2\"]",
    );
    let moved = between(&listed, &format!("{THIRD}{listed}"));
    assert_eq!(moved.listeners, [Some(0)]);
    assert!(
        !change_texts(&moved)
            .iter()
            .any(|it| it.starts_with("modbus_tcp")),
        "{:?}",
        moved.notes
    );
    let one_less = with(&listed, "\"hall-1\", \"hall-2\"", "\"hall-2\"");
    assert_eq!(
        change_texts(&between(&listed, &one_less)),
        ["modbus_tcp 127.0.0.1:1502: changed"]
    );
    let added = format!("[[modbus_tcp]]\nlisten = \"127.0.0.1:1600\"\n{TWO_LINES}");
    assert_eq!(between(TWO_LINES, &added).listeners, [None, Some(0)]);
}

#[test]
fn name_and_directory_take_a_restart() {
    let named = with(CONTROLLED, "plant-a", "plant-b");
    assert_eq!(between(CONTROLLED, &named).needs_restart, ["gateway.name"]);
    let placed = with(CONTROLLED, "/var/lib/vfd-gateway", "/var/lib/other");
    assert_eq!(
        between(CONTROLLED, &placed).needs_restart,
        ["gateway.data_dir"]
    );
    let larger = with(CONTROLLED, "10MB", "20MB");
    assert_eq!(
        between(CONTROLLED, &larger).needs_restart,
        ["journal.max_size"]
    );
    assert!(between(CONTROLLED, CONTROLLED).needs_restart.is_empty());
}
