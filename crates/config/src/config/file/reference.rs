//! Makes the tables of `docs/configuration.md` from the declarations, and holds the example file to them.

use super::super::tests::{CONTROLLED, example, problems, with};
use super::control::{ControlFile, LimitsFile, NativeFile};
use super::drive::DriveFile;
use super::http::{HttpFile, HttpTlsFile, HttpUserFile};
use super::line::LineFile;
use super::listener::{ListenerFile, ListenerTlsFile};
use super::mqtt::{HomeAssistantFile, MqttFile, SparkplugFile};
use super::serial::SerialFile;
use super::{GatewayFile, GroupFile, JournalFile, StandbyFile};
use crate::profile::register::{RegisterFile, RegisterSource};
use crate::toml_file::declare::{DeclaredKey, DeclaredTable};

/// Keys that exclude another one, or that need what the example has not, so that it shows them in a comment only.
const EXCLUDED: [&str; 15] = [
    "password_env",
    "model_dirs",
    "rated_current_a",
    "rated_voltage_v",
    "full_scale_hz",
    "watchdog",
    "require_watchdog",
    "failsafe_confirm_timeout",
    "password_hash",
    "standby",
    "half",
    "partner",
    "rank",
    "take_over_after",
    "on_gateway_lost",
];

/// The keys of the file itself.
const OUTERMOST: [&str; 9] = [
    "gateway",
    "journal",
    "standby",
    "group",
    "line",
    "mqtt",
    "modbus_tcp",
    "modbus_rtu",
    "http",
];

/// The tables of a file.
fn declared() -> [DeclaredTable; 17] {
    [
        GatewayFile::declared(),
        JournalFile::declared(),
        StandbyFile::declared(),
        GroupFile::declared(),
        LineFile::declared(),
        DriveFile::declared(),
        registers(),
        ControlFile::declared(),
        NativeFile::declared(),
        MqttFile::declared(),
        SparkplugFile::declared(),
        ListenerFile::declared(),
        ListenerTlsFile::declared(),
        SerialFile::declared(),
        HttpFile::declared(),
        HttpUserFile::declared(),
        HttpTlsFile::declared(),
    ]
}

/// The names of all keys.
pub fn names() -> Vec<&'static str> {
    let tables = declared();
    let keys = tables.iter().flat_map(|table| &table.keys);
    keys.map(|key| key.name).collect()
}

/// Registers of the operator's own, of which the keys are declared for model files.
fn registers() -> DeclaredTable {
    let mut table = RegisterFile::declared(&RegisterSource::Configuration);
    table.header = "[[line.drive.register]]";
    // The others are keys of a model file only.
    table.keys.retain(|key| !key.valid.notation.is_empty());
    for key in &mut table.keys {
        if key.valid.is_required {
            key.default = None;
        }
    }
    table
}

/// How the reference writes a key.
fn row(key: &DeclaredKey) -> String {
    format!(
        "| `{}` | {} | {} | {} |\n",
        key.name,
        marked(&key.valid.notation),
        marked(key.default.as_deref().unwrap_or("required")),
        marked(&key.about)
    )
}

/// `text` with everything that is in quotes marked as code.
fn marked(text: &str) -> String {
    let parts = text.split('"').enumerate();
    parts
        .map(|(index, part)| {
            if index % 2 == 1 {
                format!("`\"{part}\"`")
            } else {
                part.to_owned()
            }
        })
        .collect()
}

/// The line between the heads of a table and its rows.
const RULE: &str = "| --- | --- | --- | --- |\n";

/// `document` with the rows of `table`.
fn with_rows(document: &str, table: &DeclaredTable) -> String {
    let header = format!("\n## `{}`\n", table.header);
    let (before, rest) = document.split_once(&header).unwrap();
    let end = rest.find("\n## ").unwrap_or(rest.len());
    let (section, after) = rest.split_at(end);
    let (introduction, written) = section.split_once(RULE).unwrap();
    let rest = written.lines().skip_while(|line| line.starts_with("| "));
    let rest: String = rest.map(|line| format!("{line}\n")).collect();
    let rows: String = table.keys.iter().map(row).collect();
    format!("{before}{header}{introduction}{RULE}{rows}{rest}{after}")
}

#[test]
fn the_reference_has_every_key_as_it_is_declared() {
    let path = format!("{}/../../docs/configuration.md", env!("CARGO_MANIFEST_DIR"));
    let written = std::fs::read_to_string(&path).unwrap();
    let found = declared().iter().fold(written.clone(), |document, table| {
        with_rows(&document, table)
    });
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, &found).unwrap();
        return;
    }
    assert!(
        found == written,
        "{path} is another one: UPDATE_GOLDEN=1 writes it"
    );
}

#[test]
fn every_default_is_a_valid_value() {
    let inner = [HomeAssistantFile::declared(), LimitsFile::declared()];
    for table in declared().iter().chain(&inner) {
        for key in &table.keys {
            assert!(key.has_valid_default, "{} in {}", key.name, table.header);
        }
    }
}

/// The tables under `header` in a parsed file.
fn tables(file: &toml::Table, header: &str) -> Vec<toml::Table> {
    let mut found = vec![file.clone()];
    for name in header.trim_matches(['[', ']']).split('.') {
        let inner = found.iter().filter_map(|table| table.get(name));
        found = inner
            .flat_map(|value| match value {
                toml::Value::Array(tables) => tables
                    .iter()
                    .filter_map(|it| it.as_table().cloned())
                    .collect(),
                value => vec![value.as_table().unwrap().clone()],
            })
            .collect();
    }
    found
}

#[test]
fn the_example_file_has_every_key() {
    let text = example();
    let file: toml::Table = text.parse().unwrap();
    for key in OUTERMOST {
        let in_comment = EXCLUDED.contains(&key) && text.contains(&format!("# [{key}]"));
        assert!(file.contains_key(key) || in_comment, "{key}");
    }
    for table in declared() {
        for key in table.keys {
            let there = tables(&file, table.header)
                .iter()
                .any(|table| table.contains_key(key.name));
            let in_comment =
                EXCLUDED.contains(&key.name) && text.contains(&format!("# {} = ", key.name));
            assert!(there || in_comment, "{} in {}", key.name, table.header);
        }
    }
}

/// `CONTROLLED` with `line` in the first table under `header`.
fn with_line_in(header: &str, line: &str) -> String {
    let (before, after) = match header {
        "[[http.users]]" | "[http.tls]" | "[mqtt.sparkplug]" | "[[modbus_rtu]]" | "[standby]"
        | "[[group]]" => {
            return format!("{CONTROLLED}{header}\n{line}\n");
        }
        "[[line.drive.register]]" => ("[line.drive.native]", "[[line.drive.register]]\n"),
        "[modbus_tcp.tls]" => ("[http]", "[modbus_tcp.tls]\n"),
        _ => return with(CONTROLLED, header, &format!("{header}\n{line}")),
    };
    with(CONTROLLED, before, &format!("{after}{line}\n{before}"))
}

/// The keys that the message about an unknown key of `text` lists.
fn valid_keys(text: &str) -> Vec<String> {
    let found = problems(text);
    let unknown = found
        .iter()
        .find(|it| it.contains("unknown key `qqqqqqqqqqqq`"))
        .unwrap();
    let (_, listed) = unknown.split_once("one of ").unwrap();
    listed.split(", ").map(str::to_owned).collect()
}

#[test]
fn the_reader_takes_exactly_the_keys_of_the_table() {
    let line = "qqqqqqqqqqqq = 1";
    assert_eq!(valid_keys(&format!("{line}\n{CONTROLLED}")), OUTERMOST);
    for table in declared() {
        let mut listed = valid_keys(&with_line_in(table.header, line));
        let mut keys: Vec<_> = table.keys.iter().map(|key| key.name).collect();
        listed.sort_unstable();
        keys.sort_unstable();
        assert_eq!(listed, keys, "{}", table.header);
    }
}

#[test]
fn a_key_that_is_not_served_is_refused_with_its_own_words() {
    for table in declared() {
        for key in table.refused {
            let found = problems(&with_line_in(table.header, &format!("{} = true", key.name)));
            let why = key.what.map_or_else(
                || {
                    let name = key.name;
                    format!(
                        "`{name}` is not supported by this version; a key without effect is refused"
                    )
                },
                str::to_owned,
            );
            let what = format!("{why}; {}", key.instead);
            assert!(found.len() == 1 && found[0].ends_with(&what), "{found:?}");
        }
    }
}

#[test]
fn a_key_that_must_be_given_is_missed() {
    for table in declared() {
        for key in table.keys.iter().filter(|key| key.default.is_none()) {
            let text = with_line_in(table.header, "");
            let without: String = text
                .lines()
                .filter(|line| !line.starts_with(&format!("{} =", key.name)))
                .fold(String::new(), |text, line| text + line + "\n");
            if key.name != "drive" {
                let missing = format!("`{}` is missing", key.name);
                assert!(
                    problems(&without).iter().any(|it| it.contains(&missing)),
                    "{} in {}",
                    key.name,
                    table.header
                );
            }
        }
    }
}
