//! Every key of the configuration in one table, and every key that is known but not served.

/// A table of the configuration file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Section {
    /// The file itself.
    Root,
    /// `[gateway]`
    Gateway,
    /// `[journal]`
    Journal,
    /// `[[line]]`
    Line,
    /// `[[line.drive]]`
    Drive,
    /// `[[line.drive.register]]`
    Register,
    /// `[line.drive.control]`
    Control,
    /// `[line.drive.native]`
    Native,
    /// `[mqtt]`
    Mqtt,
    /// `[mqtt.sparkplug]`
    Sparkplug,
    /// `[[modbus_tcp]]`
    ModbusTcp,
    /// `[modbus_tcp.tls]`
    ModbusTls,
    /// `[http]`
    Http,
    /// `[[http.users]]`
    HttpUser,
    /// `[http.tls]`
    HttpTls,
}

impl Section {
    /// All sections, outer before inner.
    pub const ALL: [Self; 15] = [
        Self::Root,
        Self::Gateway,
        Self::Journal,
        Self::Line,
        Self::Drive,
        Self::Register,
        Self::Control,
        Self::Native,
        Self::Mqtt,
        Self::Sparkplug,
        Self::ModbusTcp,
        Self::ModbusTls,
        Self::Http,
        Self::HttpUser,
        Self::HttpTls,
    ];

    /// The section's path as it stands in a header; empty for the file itself.
    #[must_use]
    pub const fn path(self) -> &'static str {
        match self {
            Self::Root => "",
            Self::Gateway => "gateway",
            Self::Journal => "journal",
            Self::Line => "line",
            Self::Drive => "line.drive",
            Self::Register => "line.drive.register",
            Self::Control => "line.drive.control",
            Self::Native => "line.drive.native",
            Self::Mqtt => "mqtt",
            Self::Sparkplug => "mqtt.sparkplug",
            Self::ModbusTcp => "modbus_tcp",
            Self::ModbusTls => "modbus_tcp.tls",
            Self::Http => "http",
            Self::HttpUser => "http.users",
            Self::HttpTls => "http.tls",
        }
    }

    /// The header as it stands in a file: in double brackets where the table may stand more than once.
    #[must_use]
    pub fn header(self) -> String {
        match self {
            Self::Line | Self::Drive | Self::Register | Self::ModbusTcp | Self::HttpUser => {
                format!("[[{}]]", self.path())
            }
            _ => format!("[{}]", self.path()),
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
        format!("`{}` is not served by this version; a key that would do nothing is refused", self.name)
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
/// Every key that is served, in the order in which a file would have them.
#[rustfmt::skip]
pub const KEYS: &[Key] = &[
    key(Section::Root, "gateway", "table", Some("empty"), "The gateway as a whole."),
    key(Section::Root, "journal", "table", Some("empty"), "What is kept of trips, commands and comings and goings."),
    key(Section::Root, "line", "tables, at least one", None, "One serial bus each."),
    key(Section::Root, "mqtt", "table", Some("no broker"), "The connection to an MQTT broker."),
    key(Section::Root, "modbus_tcp", "tables", Some("none"), "One Modbus TCP listener each."),
    key(Section::Root, "http", "table", Some("no listener"), "The HTTP listener."),

    key(Section::Gateway, "name", "name", Some("the host's name"), "What the gateway is called in its messages and topics."),
    key(Section::Gateway, "data_dir", "absolute path", Some("none"), "The directory in which the gateway's tools reach it."),
    key(Section::Gateway, "on_removal", "\"refuse\" or \"stop\"", Some("\"refuse\""), "What a reload does about a drive that runs or is under control, if it would be removed or its line restarted: the reload is refused, or the drive stopped first."),
    key(Section::Gateway, "model_dirs", "list of absolute paths", Some("none"), "Directories whose `*.toml` files are models of your own."),

    key(Section::Journal, "max_size", "\"1MB\" to \"16GB\"", Some("\"64MB\""), "How large the journal's file may grow; then the oldest rows go, trips last."),

    key(Section::Line, "name", "name", None, "What the line is called; unique among the lines."),
    key(Section::Line, "port", "absolute path, or \"tcp://host:port\"", None, "The serial device, best by its id, or a pseudo-terminal; or a serial device server that passes the frames on."),
    key(Section::Line, "baud", "bit/s", FACTORY, "Speed; every drive of the line must be set to it."),
    key(Section::Line, "data_bits", "7 or 8", Some("8"), "Data bits of a character; 8 with RTU framing."),
    key(Section::Line, "parity", "\"none\", \"even\" or \"odd\"", FACTORY, "Parity bit of a character."),
    key(Section::Line, "stop_bits", "1 or 2", FACTORY, "Stop bits of a character."),
    key(Section::Line, "framing", "\"rtu\" or \"ascii\"", Some("\"rtu\""), "How frames are told apart; every model of the line must have it."),
    key(Section::Line, "interface", "\"rs485\" or \"rs232\"", Some("\"rs485\""), "What the line is physically; RS-232 carries exactly one drive."),
    key(Section::Line, "echo", "\"refuse\" or \"strip\"", Some("\"refuse\""), "What to do if the adapter sends back what is sent: the line is down, or our own bytes are taken out."),
    key(Section::Line, "rs485", "\"adapter\", \"kernel\" or \"rts\"", Some("\"adapter\""), "Who turns the direction of an RS-485 adapter: itself, its driver (TIOCSRS485), or the gateway by RTS."),
    key(Section::Line, "low_latency", "true or false", Some("true"), "Whether the driver is asked to hand over what it receives at once, where it can."),
    key(Section::Line, "silence", "\"auto\", or \"0ms\" to \"1s\"", Some("\"auto\""), "Silence between frames; shorter than the models need only on a pseudo-terminal or `tcp://`."),
    key(Section::Line, "min_request_gap", "\"0ms\" to \"10s\"", Some("\"0ms\""), "Least time between the end of one exchange and the next request."),
    key(Section::Line, "reply_timeout", "\"auto\", or \"1ms\" to \"60s\"", Some("\"auto\""), "Longest wait for a reply, for drives that have none of their own."),
    key(Section::Line, "max_status_age", "\"100ms\" to \"1h\"", Some("\"5s\""), "How old the fast values may become where the drives are polled more often than the line can carry; beyond that the line is refused."),
    key(Section::Line, "drive", "tables, at least one", None, "One drive each."),

    key(Section::Drive, "name", "name", None, "What the drive is called; unique over the gateway."),
    key(Section::Drive, "model", "identifier of a model", None, "The description that the drive is read by."),
    key(Section::Drive, "station", "number in the model's range", None, "The number that is set on the drive; unique on the line."),
    key(Section::Drive, "unit", "1 to 247", Some("the station, where a listener serves one line only"), "The unit at which Modbus TCP clients reach the drive's own registers."),
    key(Section::Drive, "uniform_unit", "1 to 247", Some("`unit` + 100"), "The unit at which they reach the registers that are the same for all models."),
    key(Section::Drive, "poll", "\"10ms\" to \"1h\"", Some("\"500ms\""), "Period of the fast polls; slow ones take four times that."),
    key(Section::Drive, "reply_timeout", "\"auto\", or \"1ms\" to \"60s\"", Some("the line's"), "Longest wait for a reply of this drive."),
    key(Section::Drive, "max_lateness", "\"10ms\" to \"60s\"", Some("the model's; on `tcp://` at least \"3s\""), "How long after a time-out a late reply may still come."),
    key(Section::Drive, "rated_current_a", "A, up to 100000", Some("shown in per cent"), "Rated current; for models that report the current in per cent of it."),
    key(Section::Drive, "rated_voltage_v", "V, up to 100000", Some("shown in per cent"), "Rated voltage; for models that report the voltage in per cent of it."),
    key(Section::Drive, "register", "tables", Some("none"), "Registers that the model does not list, stated by the operator."),
    key(Section::Drive, "dead_bands", "table: polled register = number", Some("none"), "Smaller changes, in the register's unit, are not published over MQTT before the heartbeat."),
    key(Section::Drive, "heartbeats", "table: polled register = \"1s\" to \"1h\"", Some("`heartbeat` of `[mqtt]`"), "A value that does not change is published again after this time, on the topic of its own."),
    key(Section::Drive, "decimals", "table: polled register = whole number", Some("all that the register has"), "Digits behind the decimal point of what is published over MQTT, from 0; rounded, but never to zero."),
    key(Section::Drive, "control", "table", Some("read-only from everywhere"), "Who may command the drive, what, and what happens when nobody does any more."),
    key(Section::Drive, "native", "table", Some("none"), "Registers of the vendor that may be written; needs `control`."),

    key(Section::Register, "name", "snake_case, new in the model", None, "What the value is called."),
    key(Section::Register, "title", "text", None, "What it is, in words."),
    key(Section::Register, "code", "text", Some("none"), "The vendor's own code."),
    key(Section::Register, "address", "0x0000 to 0xFFFF, new in the model", None, "Address as sent on the wire."),
    key(Section::Register, "unit", "unit of measure", None, "Unit of the value; \"-\" for a plain number."),
    key(Section::Register, "scale", "whole number from 1", Some("1"), "Raw steps per unit: 100 means that raw 5000 is 50.00."),
    key(Section::Register, "signed", "true or false", Some("false"), "Whether the raw word is two's complement."),
    key(Section::Register, "access", "\"read\", \"write\" or \"read-write\"", None, "What the drive allows; written only if `native` lists it."),
    key(Section::Register, "poll", "\"fast\" or \"slow\"", Some("read only when asked for"), "How often it is polled."),

    key(Section::Control, "from", "list of \"mqtt\", \"modbus-tcp\", \"page\", \"sparkplug\"", None, "The ways by which commands are taken; each must be open."),
    key(Section::Control, "frequency_hz", "{ min = Hz, max = Hz }", None, "Lowest and highest setpoint; what lies outside is refused, never clamped."),
    key(Section::Control, "directions", "list of \"forward\", \"reverse\"", Some("[\"forward\"]"), "The directions in which it may run."),
    key(Section::Control, "reverse_below_hz", "Hz", Some("0.0"), "Only at or below this output frequency may a running motor be ordered the other way; with both directions only."),
    key(Section::Control, "on_commander_lost", "\"stop\", \"coast\" or \"hold\"", None, "What is done when the commander falls silent."),
    key(Section::Control, "lost_after", "\"1s\" to \"1h\", more than \"1s\"", None, "How long it may be silent; more than a command may wait, and with a session lease at least three probes."),
    key(Section::Control, "on_shutdown", "\"stop\", \"coast\" or \"hold\"", None, "What is done when the gateway is ended on purpose."),
    key(Section::Control, "accept_unverified", "list of \"basic\", \"reverse\", \"reset\", \"coast\", \"release\"", Some("[]"), "Actions that the model marks as unproven and that are used all the same; \"basic\" is stop, forward and the setpoint together."),
    key(Section::Control, "allow_release", "true or false", Some("false"), "Whether control may be handed back to panel and terminals; a closed terminal may then start the motor."),
    key(Section::Control, "commands", "\"plain\" or \"strict\"", Some("\"plain\""), "Strict: RUN over MQTT only with `epoch` or `issued_at`."),
    key(Section::Control, "restart_delay", "\"0s\" to \"1min\"", Some("\"3s\""), "RUN over MQTT without `epoch` and `issued_at`, or from the page, is refused for this long after a stop, a trip, a lost lease or an outage; over MQTT at least 1.75 s more than `probe_interval`, from the page at least 2.5 s."),
    key(Section::Control, "stop_effect_timeout", "\"500ms\" to \"1min\"", Some("\"3s\""), "A stop that shows no effect for this long is an alarm."),
    key(Section::Control, "stop_pending_for", "\"1s\" to \"1h\"", Some("\"10min\""), "How long a stop waits for a drive that does not answer."),
    key(Section::Control, "ownership", "\"one\" or \"any\"", Some("\"one\""), "Who may command while somebody holds control: only that one, or whoever has the rights."),
    key(Section::Control, "allow_take", "true or false", Some("false"), "Whether control may be taken over from the one who holds it; the drive goes on as it is."),
    key(Section::Control, "lease", "\"session\" or \"explicit\"", Some("that of `[mqtt]`"), "What keeps control over MQTT: the way through the broker, or only commands and the lease topic."),
    key(Section::Control, "min_start_interval", "\"0s\" to \"1h\"", Some("\"0s\""), "Least time between two starts from standstill."),
    key(Section::Control, "watchdog", "\"100ms\" to \"1h\"", Some("nobody says"), "The time to which the drive's own watchdog is said to be set: more than twice the longest gap between frames, at most `lost_after`."),
    key(Section::Control, "require_watchdog", "true or false", Some("false"), "RUN only while the drive's own watchdog was read as on and in order; for models where that is proven."),
    key(Section::Control, "failsafe_confirm_timeout", "\"1s\" to \"1min\"", Some("\"5s\""), "A declared stop without effect for this long is left to the drive's own watchdog, where that was read as on: nothing more is sent."),

    key(Section::Native, "write", "list of codes, names or addresses", None, "The registers that may be written; none that `control` is about."),
    key(Section::Native, "stored_write_interval", "\"1s\" to \"24h\"", Some("\"10s\""), "Least time between two writes of a register that is stored, or not known to be RAM."),

    key(Section::Mqtt, "broker", "\"mqtt://host:port\", \"mqtts://host:port\" or \"embedded\"", None, "Where the broker is; ports 1883 and 8883 may be left out; embedded is for trying out."),
    key(Section::Mqtt, "also_at", "list of \"mqtt://host:port\" or \"mqtts://host:port\"", Some("none"), "The other nodes of a cluster; each time a connection ends the next one is tried."),
    key(Section::Mqtt, "user", "text", Some("anonymous"), "The gateway's user at the broker."),
    key(Section::Mqtt, "password_file", "absolute path", Some("no password"), "The file that holds the password."),
    key(Section::Mqtt, "password_env", "name", Some("no password"), "The environment variable that holds the password, instead of a file."),
    key(Section::Mqtt, "allow_plain_password", "true or false", Some("false"), "Whether user and password may cross the network in plain view, with `mqtt://`."),
    key(Section::Mqtt, "client_id", "text", Some("\"vfd-gateway-\" and the gateway's name"), "What the broker tells its clients apart by."),
    key(Section::Mqtt, "version", "5 or 4", Some("5"), "MQTT 5, or 4 for MQTT 3.1.1."),
    key(Section::Mqtt, "subscription_qos", "0 or 1", Some("1"), "The quality of service at which commands are subscribed."),
    key(Section::Mqtt, "prefix", "levels of a topic", Some("\"vfd\""), "What all topics begin with, before the gateway's name."),
    key(Section::Mqtt, "heartbeat", "\"1s\" to \"1h\"", Some("\"60s\""), "A value that does not change is published again after this time."),
    key(Section::Mqtt, "keep_alive", "\"5s\" to \"10min\", whole seconds", Some("\"15s\""), "The protocol's own sign of life."),
    key(Section::Mqtt, "lease", "\"session\" or \"explicit\"", Some("\"session\""), "What keeps control: the way through the broker, or only commands and the lease topic."),
    key(Section::Mqtt, "alive_topic", "topic, or \"\" for none", Some("\"homeassistant/status\""), "Where `offline` says that the commanders are gone; with a session lease only."),
    key(Section::Mqtt, "probe_interval", "\"200ms\" to \"1min\"", Some("\"1s\""), "How often the way through the broker is probed; three that stay out end the connection. At most 3.25 s where drives are commanded."),
    key(Section::Mqtt, "command_ttl", "\"100ms\" to \"1min\"", Some("\"1s\""), "How long a command that says nothing else may wait."),
    key(Section::Mqtt, "response_prefix", "levels of a topic", Some("no responses"), "Topics under which a requester may ask for the response; MQTT 5 only."),
    key(Section::Mqtt, "keep_telemetry", "0 to 100000", Some("0: none"), "How many changes of run state, frequencies and measurements are kept while the broker is away."),
    key(Section::Mqtt, "publish", "list of \"state\", \"values\", \"param\", \"line\", \"info\"", Some("all of them"), "What is published beside that which always is."),
    key(Section::Mqtt, "home_assistant", "{ discovery = true or false, prefix = levels of a topic, devices = true or false }", Some("nothing is announced"), "Whether drives and lines are announced to Home Assistant; where it looks, \"homeassistant\" if left out; and whether each device is announced as a whole instead of each entity, false if left out."),
    key(Section::Mqtt, "ca_file", "absolute path", Some("what the system trusts"), "The authority that signed the broker's certificate; with `mqtts://` only."),
    key(Section::Mqtt, "client_cert_file", "absolute path", Some("none"), "The gateway's own certificate; with `mqtts://` only."),
    key(Section::Mqtt, "client_key_file", "absolute path", Some("none"), "The key of that certificate."),

    key(Section::Mqtt, "sparkplug", "table", Some("none: nothing is said to hosts of Sparkplug B"), "Sparkplug B for SCADA, at the same broker by a connection of its own; needs `data_dir`."),

    key(Section::Sparkplug, "group", "one level of a topic", None, "The group of the edge node; the edge node is the gateway's name."),
    key(Section::Sparkplug, "primary_host", "one level of a topic", Some("none: nobody is waited for"), "The host without which nothing is born, and whose being online keeps session leases."),
    key(Section::Sparkplug, "client_id", "text", Some("that of `[mqtt]` with \"-sparkplug\" behind it"), "What the broker tells its clients apart by."),
    key(Section::Sparkplug, "max_command_age", "\"1s\" to \"5min\"", Some("\"10s\""), "A command with an older timestamp is refused; a stop never is."),
    key(Section::Sparkplug, "keep_telemetry", "0 to 100000", Some("10000"), "How many changes of run state, frequencies and measurements are kept while no host can be told; those of trips always are."),

    key(Section::ModbusTcp, "listen", "address:port", None, "Where clients connect."),
    key(Section::ModbusTcp, "allow", "list of networks", Some("anyone, which is this host: only a loopback address may go without"), "Who may connect."),
    key(Section::ModbusTcp, "lines", "list of line names", Some("all lines"), "The lines whose drives are served here."),
    key(Section::ModbusTcp, "write", "list of networks inside `allow`", Some("[]: nobody; with `tls` whoever may connect, as their roles say"), "Who may command and write, where the drive allows it."),
    key(Section::ModbusTcp, "stop", "list of networks inside `allow`", Some("`write`"), "Who may stop; it must hold whoever may write."),
    key(Section::ModbusTcp, "reads_renew", "true or false", Some("false"), "Whether reads of the one who controls a drive count as a sign of life."),
    key(Section::ModbusTcp, "units", "list of units of its drives", Some("all of its lines"), "The units that answer here, native or uniform; 255, the gateway itself, always does."),
    key(Section::ModbusTcp, "connections_max", "1 to 65536", Some("as many as there is room for: 10,240 for all listeners, or less by the system's limit of open files"), "Most clients at once, those with `priority` not counted; one more takes the place of the one that was silent for longest."),
    key(Section::ModbusTcp, "priority", "list of networks inside `allow`", Some("[]: nobody"), "Whose connections never give way to others, and for whom places are kept free."),
    key(Section::ModbusTcp, "idle_timeout", "\"1s\" to \"24h\", or \"0s\" for none", Some("\"10min\""), "A connection without a request is closed after this time."),
    key(Section::ModbusTcp, "keep_alive", "\"1s\" to \"2h\", whole seconds, or \"0s\" for none", Some("\"60s\""), "After this time of silence a client is asked whether it is still there; one that is gone is noticed within twice that."),

    key(Section::ModbusTcp, "tls", "table", Some("none: connections are not encrypted"), "Modbus Security: TLS with certificates on both sides; whoever has none that counts is not let in."),

    key(Section::ModbusTls, "cert_file", "absolute path", None, "The gateway's certificate, with those between it and its authority."),
    key(Section::ModbusTls, "key_file", "absolute path", None, "The key of that certificate."),
    key(Section::ModbusTls, "client_ca_file", "absolute path", None, "The authorities whose clients are let in; no others are."),
    key(Section::ModbusTls, "roles", "table: role = list of \"write\", \"stop\"", None, "What each role may do besides reading; a role that is not listed may nothing. \"\" is the role of certificates without one."),

    key(Section::Http, "listen", "address:port", None, "Where the page, /metrics, /healthz and /readyz are served."),
    key(Section::Http, "allow", "list of networks", Some("anyone, which is this host: only a loopback address may go without"), "Who may connect, and see everything."),
    key(Section::Http, "hosts", "list of host names", Some("none but the host's own and `localhost`"), "Further names by which browsers may call the gateway, without a port; addresses are always taken."),
    key(Section::Http, "users", "tables", Some("none: nothing is commanded from the page"), "Who may sign in and command; elsewhere than on loopback with `tls` only."),
    key(Section::Http, "tls", "table", Some("none: connections are not encrypted"), "HTTPS instead of HTTP."),

    key(Section::HttpUser, "name", "name of up to 32 characters", None, "What the user is called, in the audit too."),
    key(Section::HttpUser, "password_hash", "argon2id hash", Some("`password_hash_file`"), "The password as `vfd-gateway password` prints it."),
    key(Section::HttpUser, "password_hash_file", "absolute path", Some("`password_hash`"), "The file that holds this text; one of both is needed."),

    key(Section::HttpTls, "cert_file", "absolute path", None, "The gateway's certificate, with those between it and its authority."),
    key(Section::HttpTls, "key_file", "absolute path", None, "The key of that certificate."),
];

/// Every key that is known but refused.
#[rustfmt::skip]
pub const NOT_SERVED: &[NotServed] = &[
    refused(Section::Drive, "interlocks", "leave it out; `reverse_below_hz`, `min_start_interval` and `require_watchdog` in `[line.drive.control]` are the interlocks; what must not run together is wired or decided by the commander"),
    refused(Section::Drive, "lease", "leave it out; `lease` and `lost_after` stand in `[line.drive.control]`"),
    refused(Section::Drive, "max_status_age", "leave it out; the planned age of the values follows from `poll`"),

    refused(Section::ModbusTcp, "lease", "leave it out; leases of Modbus TCP are explicit: commands and `renew` keep them, and reads with `reads_renew`"),
];

#[cfg(test)]
mod tests {
    use super::super::tests::{CONTROLLED, example, problems, with};
    use super::*;

    /// Keys that exclude another one, or that need what the example has not, so that it shows them in a comment only.
    const EXCLUDED: [&str; 8] = [
        "password_env",
        "model_dirs",
        "rated_current_a",
        "rated_voltage_v",
        "watchdog",
        "require_watchdog",
        "failsafe_confirm_timeout",
        "password_hash",
    ];

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
        let text = example();
        let file: toml::Table = text.parse().unwrap();
        for key in KEYS {
            let there = tables(&file, key.section).iter().any(|table| table.contains_key(key.name));
            let in_comment = EXCLUDED.contains(&key.name) && text.contains(&format!("# {} = ", key.name));
            assert!(there || in_comment, "{} in [{}]", key.name, key.section.path());
        }
    }

    /// `CONTROLLED` with `line` in the first table of `section`.
    fn with_line_in(section: Section, line: &str) -> String {
        let (before, after) = match section {
            Section::Root => return format!("{line}\n{CONTROLLED}"),
            Section::HttpUser | Section::HttpTls | Section::Sparkplug => {
                return format!("{CONTROLLED}{}\n{line}\n", section.header());
            }
            Section::Register => ("[line.drive.native]", "[[line.drive.register]]\n"),
            Section::ModbusTls => ("[http]", "[modbus_tcp.tls]\n"),
            _ => return with(CONTROLLED, &section.header(), &format!("{}\n{line}", section.header())),
        };
        with(CONTROLLED, before, &format!("{after}{line}\n{before}"))
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
        let lease = not_served(Section::ModbusTcp).find(|key| key.name == "lease").unwrap();
        assert_eq!(lease.refusal(), "`lease` is not served by this version; a key that would do nothing is refused");
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
