//! Every key of the configuration in one table, and every key that is known but not served.

/// A table of the configuration file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Section {
    /// The file itself.
    Root,
    /// `[gateway]`
    Gateway,
    /// `[[line]]`
    Line,
    /// `[[line.drive]]`
    Drive,
    /// `[[line.drive.register]]`
    Register,
    /// `[[modbus_tcp]]`
    ModbusTcp,
}

impl Section {
    /// All sections, outer before inner.
    pub const ALL: [Self; 6] = [Self::Root, Self::Gateway, Self::Line, Self::Drive, Self::Register, Self::ModbusTcp];

    /// The section's path as it stands in a header; empty for the file itself.
    #[must_use]
    pub const fn path(self) -> &'static str {
        match self {
            Self::Root => "",
            Self::Gateway => "gateway",
            Self::Line => "line",
            Self::Drive => "line.drive",
            Self::Register => "line.drive.register",
            Self::ModbusTcp => "modbus_tcp",
        }
    }
}

/// One key that the configuration may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key {
    /// Where it stands.
    pub section: Section,
    /// Its name.
    pub name: &'static str,
    /// What its value may be.
    pub kind: &'static str,
    /// What holds when it is left out; nothing if it must be given.
    pub default: Option<&'static str>,
    /// What it is for, in one line.
    pub about: &'static str,
}

/// One key that the product's description names but that this version does not serve. It is refused,
/// because an operator who wrote it would rely on something that is not there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotServed {
    /// Where it would stand.
    pub section: Section,
    /// Its name.
    pub name: &'static str,
    /// What holds instead, and what to do.
    pub instead: &'static str,
}

impl NotServed {
    /// The sentence that refuses the key.
    #[must_use]
    pub fn refusal(&self) -> String {
        format!(
            "`{}` is not served by this version, which is read-only; a key that would do nothing is refused",
            self.name
        )
    }
}

/// The keys of `section` that are known but not served.
pub fn not_served(section: Section) -> impl Iterator<Item = &'static NotServed> {
    NOT_SERVED.iter().filter(move |key| key.section == section)
}

const fn key(
    section: Section,
    name: &'static str,
    kind: &'static str,
    default: Option<&'static str>,
    about: &'static str,
) -> Key {
    Key { section, name, kind, default, about }
}

const fn refused(section: Section, name: &'static str, instead: &'static str) -> NotServed {
    NotServed { section, name, instead }
}

const FACTORY: Option<&str> = Some("the factory setting that the models of the line share");
const NOTHING_WRITTEN: &str = "leave it out; nothing is ever written to a drive";
const NOTHING_STORED: &str = "leave it out; nothing is stored on disk";
const NATIVE_UNITS_ONLY: &str = "leave it out; a drive is served at its `unit`, with its vendor's own registers";
const MODBUS_TCP_ONLY: &str = "leave it out; drives are reached through `[[modbus_tcp]]` only";

/// Every key that is served, in the order in which a file would have them.
#[rustfmt::skip]
pub const KEYS: &[Key] = &[
    key(Section::Root, "gateway", "table", Some("empty"), "The gateway as a whole."),
    key(Section::Root, "line", "tables, at least one", None, "One serial bus each."),
    key(Section::Root, "modbus_tcp", "tables", Some("none"), "One Modbus TCP listener each."),

    key(Section::Gateway, "name", "name", Some("the host's name"), "What the gateway is called in its messages."),

    key(Section::Line, "name", "name", None, "What the line is called; unique among the lines."),
    key(Section::Line, "port", "absolute path", None, "The serial device, best by its id, or a pseudo-terminal."),
    key(Section::Line, "baud", "bit/s", FACTORY, "Speed; every drive of the line must be set to it."),
    key(Section::Line, "data_bits", "7 or 8", Some("8"), "Data bits of a character; 8 with RTU framing."),
    key(Section::Line, "parity", "\"none\", \"even\" or \"odd\"", FACTORY, "Parity bit of a character."),
    key(Section::Line, "stop_bits", "1 or 2", FACTORY, "Stop bits of a character."),
    key(Section::Line, "framing", "\"rtu\" or \"ascii\"", Some("\"rtu\""), "How frames are told apart; every model of the line must have it."),
    key(Section::Line, "interface", "\"rs485\" or \"rs232\"", Some("\"rs485\""), "What the line is physically; RS-232 carries exactly one drive."),
    key(Section::Line, "silence", "\"auto\", or \"0ms\" to \"1s\"", Some("\"auto\""), "Silence between frames; shorter than the models need only on a pseudo-terminal."),
    key(Section::Line, "min_request_gap", "\"0ms\" to \"10s\"", Some("\"0ms\""), "Least time between the end of one exchange and the next request."),
    key(Section::Line, "reply_timeout", "\"auto\", or \"1ms\" to \"60s\"", Some("\"auto\""), "Longest wait for a reply, for drives that have none of their own."),
    key(Section::Line, "drive", "tables, at least one", None, "One drive each."),

    key(Section::Drive, "name", "name", None, "What the drive is called; unique over the gateway."),
    key(Section::Drive, "model", "identifier of a model", None, "The description that the drive is read by."),
    key(Section::Drive, "station", "number in the model's range", None, "The number that is set on the drive; unique on the line."),
    key(Section::Drive, "unit", "1 to 247", Some("the station, where a listener serves one line only"), "The unit at which Modbus TCP clients reach the drive."),
    key(Section::Drive, "poll", "\"10ms\" to \"1h\"", Some("\"500ms\""), "Period of the fast polls; slow ones take four times that."),
    key(Section::Drive, "reply_timeout", "\"auto\", or \"1ms\" to \"60s\"", Some("the line's"), "Longest wait for a reply of this drive."),
    key(Section::Drive, "max_lateness", "\"10ms\" to \"60s\"", Some("the model's"), "How long after a time-out a late reply may still come."),
    key(Section::Drive, "register", "tables", Some("none"), "Registers that the model does not list, stated by the operator."),

    key(Section::Register, "name", "snake_case, new in the model", None, "What the value is called."),
    key(Section::Register, "title", "text", None, "What it is, in words."),
    key(Section::Register, "code", "text", Some("none"), "The vendor's own code."),
    key(Section::Register, "address", "0x0000 to 0xFFFF, new in the model", None, "Address as sent on the wire."),
    key(Section::Register, "unit", "unit of measure", None, "Unit of the value; \"-\" for a plain number."),
    key(Section::Register, "scale", "whole number from 1", Some("1"), "Raw steps per unit: 100 means that raw 5000 is 50.00."),
    key(Section::Register, "signed", "true or false", Some("false"), "Whether the raw word is two's complement."),
    key(Section::Register, "access", "\"read\", \"write\" or \"read-write\"", None, "What the drive allows; the gateway only reads."),
    key(Section::Register, "poll", "\"fast\" or \"slow\"", Some("read only when asked for"), "How often it is polled."),

    key(Section::ModbusTcp, "listen", "address:port", None, "Where clients connect."),
    key(Section::ModbusTcp, "allow", "list of networks", Some("anyone, which is this host: only a loopback address may go without"), "Who may connect."),
    key(Section::ModbusTcp, "lines", "list of line names", Some("all lines"), "The lines whose drives are served here."),
];

/// Every key that is known but refused.
#[rustfmt::skip]
pub const NOT_SERVED: &[NotServed] = &[
    refused(Section::Root, "mqtt", MODBUS_TCP_ONLY),
    refused(Section::Root, "http", MODBUS_TCP_ONLY),

    refused(Section::Gateway, "data_dir", NOTHING_STORED),
    refused(Section::Gateway, "model_dirs", "leave it out; registers that a model lacks go into `[[line.drive.register]]`"),

    refused(Section::Line, "rs485", "leave it out; the adapter or its driver must turn the direction by itself"),

    refused(Section::Drive, "control", NOTHING_WRITTEN),
    refused(Section::Drive, "native", NOTHING_WRITTEN),
    refused(Section::Drive, "interlocks", NOTHING_WRITTEN),
    refused(Section::Drive, "lease", NOTHING_WRITTEN),
    refused(Section::Drive, "uniform_unit", NATIVE_UNITS_ONLY),
    refused(Section::Drive, "rated_current_a", NATIVE_UNITS_ONLY),
    refused(Section::Drive, "dead_bands", MODBUS_TCP_ONLY),
    refused(Section::Drive, "max_status_age", "leave it out; the planned age of the values follows from `poll`"),

    refused(Section::ModbusTcp, "write", NOTHING_WRITTEN),
    refused(Section::ModbusTcp, "stop", NOTHING_WRITTEN),
    refused(Section::ModbusTcp, "lease", NOTHING_WRITTEN),
    refused(Section::ModbusTcp, "reads_renew", NOTHING_WRITTEN),
    refused(Section::ModbusTcp, "tls", "leave it out; connections are not encrypted, so `allow` only networks that you trust"),
];

#[cfg(test)]
mod tests {
    use super::super::tests::{MINIMAL, drive_with, example, problems, with};
    use super::*;

    /// The tables of `section` in a parsed file.
    fn tables(file: &toml::Table, section: Section) -> Vec<toml::Table> {
        let mut found = vec![file.clone()];
        for name in section.path().split('.').filter(|name| !name.is_empty()) {
            let inner = found.iter().filter_map(|table| table.get(name));
            found = inner
                .flat_map(|value| match value {
                    toml::Value::Array(tables) => tables.iter().filter_map(|it| it.as_table().cloned()).collect(),
                    value => vec![value.as_table().unwrap().clone()],
                })
                .collect();
        }
        found
    }

    #[test]
    fn the_example_file_has_every_key() {
        let file: toml::Table = example().parse().unwrap();
        for key in KEYS {
            let there = tables(&file, key.section).iter().any(|table| table.contains_key(key.name));
            assert!(there, "{} in [{}]", key.name, key.section.path());
        }
    }

    /// `MINIMAL` with `line` in the first table of `section`.
    fn with_line_in(section: Section, line: &str) -> String {
        let header = |header: &str| with(MINIMAL, header, &format!("{header}\n{line}"));
        match section {
            Section::Root => format!("{line}\n{MINIMAL}"),
            Section::Gateway => format!("[gateway]\n{line}\n{MINIMAL}"),
            Section::Line => header("[[line]]"),
            Section::Drive => header("[[line.drive]]"),
            Section::Register => drive_with(&format!("[[line.drive.register]]\n{line}")),
            Section::ModbusTcp => header("[[modbus_tcp]]"),
        }
    }

    #[test]
    fn the_reader_takes_exactly_the_keys_of_the_table() {
        for section in Section::ALL {
            let found = problems(&with_line_in(section, "qqqqqqqqqqqq = 1"));
            let unknown = found.iter().find(|it| it.contains("there is no key `qqqqqqqqqqqq`")).unwrap();
            let (_, listed) = unknown.split_once("one of ").unwrap();
            let mut listed: Vec<_> = listed.split(", ").collect();
            let keys = KEYS.iter().filter(|key| key.section == section);
            let mut table: Vec<_> = keys.map(|key| key.name).collect();
            listed.sort_unstable();
            table.sort_unstable();
            assert_eq!(listed, table, "[{}]", section.path());
        }
    }

    #[test]
    fn a_key_that_is_not_served_is_refused_with_its_own_words() {
        for key in NOT_SERVED {
            let found = problems(&with_line_in(key.section, &format!("{} = true", key.name)));
            let what = format!("{}; {}", key.refusal(), key.instead);
            assert!(found.len() == 1 && found[0].ends_with(&what), "{found:?}");
        }
        let control = not_served(Section::Drive).find(|key| key.name == "control").unwrap();
        assert_eq!(
            control.refusal(),
            "`control` is not served by this version, which is read-only; a key that would do nothing is refused"
        );
    }

    #[test]
    fn a_key_that_must_be_given_is_missed() {
        for key in KEYS.iter().filter(|key| key.default.is_none() && key.section != Section::Root) {
            let text = with_line_in(key.section, "");
            let without: String = text
                .lines()
                .filter(|line| !line.starts_with(&format!("{} =", key.name)))
                .fold(String::new(), |text, line| text + line + "\n");
            if key.name != "drive" {
                let missing = format!("`{}` is missing", key.name);
                assert!(
                    problems(&without).iter().any(|it| it.contains(&missing)),
                    "{} in [{}]",
                    key.name,
                    key.section.path()
                );
            }
        }
    }
}
