//! Every key of the configuration in one table, and every key that is known but not served.

/// A table of the configuration file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ConfigSection {
    /// The file itself.
    Root,
    /// `[gateway]`
    Gateway,
    /// `[journal]`
    Journal,
    /// `[standby]`
    Standby,
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
    /// `[[modbus_rtu]]`
    ModbusRtu,
    /// `[http]`
    Http,
    /// `[[http.users]]`
    HttpUser,
    /// `[http.tls]`
    HttpTls,
}

impl ConfigSection {
    /// All sections, outer before inner.
    pub const ALL: [Self; 17] = [
        Self::Root,
        Self::Gateway,
        Self::Journal,
        Self::Standby,
        Self::Line,
        Self::Drive,
        Self::Register,
        Self::Control,
        Self::Native,
        Self::Mqtt,
        Self::Sparkplug,
        Self::ModbusTcp,
        Self::ModbusTls,
        Self::ModbusRtu,
        Self::Http,
        Self::HttpUser,
        Self::HttpTls,
    ];

    /// The section's path as in a header; empty for the file itself.
    #[must_use]
    pub const fn path(self) -> &'static str {
        match self {
            Self::Root => "",
            Self::Gateway => "gateway",
            Self::Journal => "journal",
            Self::Standby => "standby",
            Self::Line => "line",
            Self::Drive => "line.drive",
            Self::Register => "line.drive.register",
            Self::Control => "line.drive.control",
            Self::Native => "line.drive.native",
            Self::Mqtt => "mqtt",
            Self::Sparkplug => "mqtt.sparkplug",
            Self::ModbusTcp => "modbus_tcp",
            Self::ModbusTls => "modbus_tcp.tls",
            Self::ModbusRtu => "modbus_rtu",
            Self::Http => "http",
            Self::HttpUser => "http.users",
            Self::HttpTls => "http.tls",
        }
    }

    /// The header as in a file: in double brackets if the table may be repeated.
    #[must_use]
    pub fn header(self) -> String {
        match self {
            Self::Line
            | Self::Drive
            | Self::Register
            | Self::ModbusTcp
            | Self::ModbusRtu
            | Self::HttpUser => {
                format!("[[{}]]", self.path())
            }
            _ => format!("[{}]", self.path()),
        }
    }
}

/// One key that the configuration may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConfigKey {
    /// Its section.
    pub section: ConfigSection,
    /// Its name.
    pub name: &'static str,
    /// Its valid values.
    pub kind: &'static str,
    /// Its default; `None` if it is required.
    pub default: Option<&'static str>,
    /// Its purpose, in one line.
    pub about: &'static str,
}

/// A known key that this version does not support. It is refused, because an operator who wrote it would rely on
/// a missing function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotServed {
    /// Its section.
    pub section: ConfigSection,
    /// Its name.
    pub name: &'static str,
    /// The alternative.
    pub instead: &'static str,
}

impl NotServed {
    /// The message that refuses the key.
    #[must_use]
    pub fn refusal(&self) -> String {
        format!(
            "`{}` is not supported by this version; a key without effect is refused",
            self.name
        )
    }
}

/// The keys of `section` that are known but not supported.
pub fn not_served(section: ConfigSection) -> impl Iterator<Item = &'static NotServed> {
    NOT_SERVED.iter().filter(move |key| key.section == section)
}

const fn key(
    section: ConfigSection,
    name: &'static str,
    kind: &'static str,
    default: Option<&'static str>,
    about: &'static str,
) -> ConfigKey {
    ConfigKey {
        section,
        name,
        kind,
        default,
        about,
    }
}

const fn refused(section: ConfigSection, name: &'static str, instead: &'static str) -> NotServed {
    NotServed {
        section,
        name,
        instead,
    }
}

const FACTORY: Option<&str> =
    Some("the factory setting that the models of the line share, if there is one");
/// Every supported key, in the usual order of a file.
#[rustfmt::skip]
pub const KEYS: &[ConfigKey] = &[
    key(ConfigSection::Root, "gateway", "table", Some("empty"), "The gateway as a whole."),
    key(ConfigSection::Root, "journal", "table", Some("empty"), "The record of trips, commands, and drives and clients that come and go."),
    key(ConfigSection::Root, "standby", "table", Some("none: the only gateway on its lines"), "This gateway as one of two on the same lines."),
    key(ConfigSection::Root, "line", "tables, at least one", None, "One serial bus each."),
    key(ConfigSection::Root, "mqtt", "table", Some("no broker"), "The connection to an MQTT broker."),
    key(ConfigSection::Root, "modbus_tcp", "tables", Some("none"), "One Modbus TCP listener each."),
    key(ConfigSection::Root, "modbus_rtu", "tables", Some("none"), "One serial master each, to which the gateway is a slave."),
    key(ConfigSection::Root, "http", "table", Some("no listener"), "The HTTP listener."),

    key(ConfigSection::Gateway, "name", "name", Some("the host's name"), "The name of the gateway in messages and topics."),
    key(ConfigSection::Gateway, "data_dir", "absolute path", Some("none"), "The directory for the journal, the remembered state and the local command socket. If it is missing, `run` creates it in a directory of its own user; elsewhere the gateway says how to create it, and controls without it."),
    key(ConfigSection::Gateway, "on_removal", "\"refuse\" or \"stop\"", Some("\"refuse\""), "What a reload does if it would remove a drive that runs or is under control, or restart its line: refuse the reload, or stop the drive first."),
    key(ConfigSection::Gateway, "model_dirs", "list of absolute paths", Some("none"), "Directories with your own models (`*.toml`)."),

    key(ConfigSection::Journal, "max_size", "\"1MB\" to \"16GB\"", Some("\"64MB\""), "Maximum size of the journal file. When it is full, the oldest rows are deleted, trips last."),

    key(ConfigSection::Standby, "half", "name of up to 16 characters", None, "The name of this gateway in the pair."),
    key(ConfigSection::Standby, "partner", "name of up to 16 characters", None, "The name of the other gateway, for refusals and displays."),
    key(ConfigSection::Standby, "rank", "0 to 7", Some("0"), "By how many half seconds later than rank 0 it takes a line over. The gateways of a line must have different ranks."),
    key(ConfigSection::Standby, "take_over_after", "\"auto\", or \"1s\" to \"10min\"", Some("\"auto\""), "Silence of the line after which rank 0 takes it over; at least what the line needs, which `check` prints. It should be the same on both gateways."),

    key(ConfigSection::Line, "name", "name", None, "The name of the line; unique among the lines."),
    key(ConfigSection::Line, "port", "absolute path, \"tcp://host:port\", or \"modbus-tcp://host[:502]\"", None, "The serial device (preferably by id), a pseudo-terminal, a serial device server that forwards the frames, or a Modbus TCP server: a drive with an Ethernet port, or a converter before drives."),
    key(ConfigSection::Line, "baud", "bit/s", FACTORY, "Speed; every drive of the line must be set to it."),
    key(ConfigSection::Line, "data_bits", "7 or 8", Some("8; with ASCII framing the factory setting"), "Data bits of a character; 8 with RTU framing."),
    key(ConfigSection::Line, "parity", "\"none\", \"even\" or \"odd\"", FACTORY, "Parity bit of a character."),
    key(ConfigSection::Line, "stop_bits", "1 or 2", FACTORY, "Stop bits of a character."),
    key(ConfigSection::Line, "framing", "\"rtu\" or \"ascii\"", Some("\"rtu\""), "The framing of the line. Every model on the line must support it."),
    key(ConfigSection::Line, "interface", "\"rs485\" or \"rs232\"", Some("\"rs485\""), "The physical interface. RS-232 carries exactly one drive."),
    key(ConfigSection::Line, "echo", "\"refuse\" or \"strip\"", Some("\"refuse\""), "What to do if the adapter echoes what is sent: take the line down, or strip the echo."),
    key(ConfigSection::Line, "rs485", "\"adapter\", \"kernel\" or \"rts\"", Some("\"adapter\""), "What switches the direction of an RS-485 adapter: the adapter, its driver (TIOCSRS485), or the gateway with RTS."),
    key(ConfigSection::Line, "low_latency", "true or false", Some("true"), "Whether to ask the driver to deliver received bytes at once, if it can."),
    key(ConfigSection::Line, "silence", "\"auto\", or \"0ms\" to \"1s\"", Some("\"auto\""), "Silence between frames. It may be shorter than the models need only on a pseudo-terminal or `tcp://`."),
    key(ConfigSection::Line, "min_request_gap", "\"0ms\" to \"10s\"", Some("\"0ms\""), "Minimum time between the end of one exchange and the next request."),
    key(ConfigSection::Line, "reply_timeout", "\"auto\", or \"1ms\" to \"60s\"", Some("\"auto\""), "Maximum wait for a reply, for drives without a setting of their own."),
    key(ConfigSection::Line, "max_status_age", "\"100ms\" to \"1h\"", Some("\"5s\""), "Maximum age of the fast values if the drives are polled more often than the line can carry. A line that would exceed it is refused."),
    key(ConfigSection::Line, "standby", "true or false", Some("false"), "Whether the other gateway of `[standby]` is on the same RS-485 line. Then one of the two sends, and the other one only listens and takes over when the line is silent."),
    key(ConfigSection::Line, "drive", "tables, at least one", None, "One drive each."),

    key(ConfigSection::Drive, "name", "name", None, "The name of the drive; unique in the gateway."),
    key(ConfigSection::Drive, "model", "identifier of a model", None, "The drive model."),
    key(ConfigSection::Drive, "station", "number in the model's range; on `modbus-tcp://` 0 to 247, or 255", None, "The station number set on the drive, on `modbus-tcp://` its unit; unique on the line."),
    key(ConfigSection::Drive, "unit", "1 to 247", Some("the station, where a listener serves one line only"), "The unit at which Modbus TCP clients reach the drive's own registers."),
    key(ConfigSection::Drive, "uniform_unit", "1 to 247", Some("`unit` + 100"), "The unit at which they reach the uniform registers, the same for all models."),
    key(ConfigSection::Drive, "group", "name", Some("none"), "The group in which the page shows the drive, across lines: a machine or a hall."),
    key(ConfigSection::Drive, "poll", "\"10ms\" to \"1h\"", Some("\"500ms\""), "Period of the fast polls. Slow polls have four times that period."),
    key(ConfigSection::Drive, "reply_timeout", "\"auto\", or \"1ms\" to \"60s\"", Some("the line's"), "Maximum wait for a reply of this drive."),
    key(ConfigSection::Drive, "max_lateness", "\"10ms\" to \"60s\"", Some("the model's; on `tcp://` at least \"3s\""), "How long after a time-out a late reply may still arrive. Without effect on `modbus-tcp://`."),
    key(ConfigSection::Drive, "rated_current_a", "A, up to 100000", Some("shown in per cent"), "Rated current, for models that report the current as a percentage of it."),
    key(ConfigSection::Drive, "rated_voltage_v", "V, up to 100000", Some("shown in per cent"), "Rated voltage, for models that report the voltage as a percentage of it."),
    key(ConfigSection::Drive, "full_scale_hz", "Hz, up to 100000", Some("none: required where the model says so"), "The frequency of which setpoint and output frequency are fractions, as set at the drive, for models that cannot read it."),
    key(ConfigSection::Drive, "register", "tables", Some("none"), "Registers that the model does not list, declared by the operator."),
    key(ConfigSection::Drive, "dead_bands", "table: polled register = number", Some("none"), "Smaller changes, in the register's unit, are not published over MQTT before the heartbeat."),
    key(ConfigSection::Drive, "heartbeats", "table: polled register = \"1s\" to \"1h\"", Some("`heartbeat` of `[mqtt]`"), "Interval after which an unchanged value is published again, on its own topic."),
    key(ConfigSection::Drive, "decimals", "table: polled register = whole number", Some("all that the register has"), "Decimals of the values published over MQTT, from 0. Values are rounded, but never to zero."),
    key(ConfigSection::Drive, "control", "table", Some("read-only from everywhere"), "Who may command the drive, which commands, and what happens when the commander vanishes."),
    key(ConfigSection::Drive, "native", "table", Some("none"), "Native registers that may be written; needs `control`."),

    key(ConfigSection::Register, "name", "snake_case, new in the model", None, "The name of the value."),
    key(ConfigSection::Register, "title", "text", None, "A description in words."),
    key(ConfigSection::Register, "code", "text", Some("none"), "The vendor's own code."),
    key(ConfigSection::Register, "address", "0x0000 to 0xFFFF, new in the model", None, "Address as sent on the wire."),
    key(ConfigSection::Register, "table", "\"holding\", \"input\", \"coil\" or \"discrete\"", Some("holding"), "The table of the Modbus data model that it is in."),
    key(ConfigSection::Register, "unit", "unit of measure", None, "Unit of the value; \"-\" for a plain number."),
    key(ConfigSection::Register, "scale", "whole number from 1", Some("1"), "Raw steps per unit: 100 means that raw 5000 is 50.00."),
    key(ConfigSection::Register, "signed", "true or false", Some("false"), "Whether the raw word is in two's complement."),
    key(ConfigSection::Register, "access", "\"read\", \"write\" or \"read-write\"", None, "The access that the drive allows. Written only if `native` lists it."),
    key(ConfigSection::Register, "poll", "\"fast\" or \"slow\"", Some("read only when asked for"), "How often it is polled."),

    key(ConfigSection::Control, "from", "list of \"mqtt\", \"modbus-tcp\", \"page\", \"sparkplug\"", None, "The interfaces that accept commands; each must be enabled."),
    key(ConfigSection::Control, "frequency_hz", "{ min = Hz, max = Hz }", None, "Minimum and maximum setpoint. Values outside are refused, never clamped."),
    key(ConfigSection::Control, "directions", "list of \"forward\", \"reverse\"", Some("[\"forward\"]"), "The directions in which the motor may run."),
    key(ConfigSection::Control, "reverse_below_hz", "Hz", Some("0.0"), "A running motor may be reversed only at or below this output frequency. Only with both directions."),
    key(ConfigSection::Control, "on_commander_lost", "\"stop\", \"coast\" or \"hold\"", None, "The fail-safe action when the commander vanishes."),
    key(ConfigSection::Control, "lost_after", "\"1s\" to \"1h\", more than \"1s\"", None, "How long the commander may be silent before the fail-safe action. It must exceed the time a command may wait and, with a session lease, three probes."),
    key(ConfigSection::Control, "on_shutdown", "\"stop\", \"coast\" or \"hold\"", None, "The action when the gateway shuts down on request."),
    key(ConfigSection::Control, "on_output_outside", "\"alarm\" or \"stop\"", Some("\"alarm\""), "What happens when the motor runs by an order and its output is above `frequency_hz`, or stays away from the setpoint: only the alarm `output_outside_limits`, which refuses RUN and higher setpoints, or a stop as well."),
    key(ConfigSection::Control, "on_gateway_lost", "\"stop\", \"coast\", \"hold\" or \"adopt\"", Some("none: required on a line with `standby = true`"), "What happens to a drive that was ordered to run, when this gateway takes its line over: it is stopped by its ramp, its output is cut off, it goes on, or it goes on for `lost_after` so that its client can come back."),
    key(ConfigSection::Control, "accept_unverified", "list of \"basic\", \"reverse\", \"reset\", \"coast\", \"release\"", Some("[]"), "Actions that the model marks as unproven but that you accept. \"basic\" is stop, forward and the setpoint together."),
    key(ConfigSection::Control, "qualify", "true or false", Some("false"), "Whether `vfd-gateway qualify` may try what the model leaves unproven, one command at a time. For the day of the trials only."),
    key(ConfigSection::Control, "allow_release", "true or false", Some("false"), "Whether control may be returned to panel and terminals. A closed terminal may then start the motor."),
    key(ConfigSection::Control, "commands", "\"plain\" or \"strict\"", Some("\"plain\""), "Strict: RUN over MQTT only with `epoch` or `issued_at`."),
    key(ConfigSection::Control, "restart_delay", "\"0s\" to \"1min\"", Some("\"3s\""), "RUN over MQTT without `epoch` and `issued_at`, or from the page, is refused for this long after a stop, a trip, a lost lease or an outage; over MQTT at least 1.75 s more than `probe_interval`, from the page at least 2.5 s."),
    key(ConfigSection::Control, "stop_effect_timeout", "\"500ms\" to \"1min\"", Some("\"3s\""), "A stop without effect for this long raises an alarm."),
    key(ConfigSection::Control, "stop_pending_for", "\"1s\" to \"1h\"", Some("\"10min\""), "How long a stop waits for a drive that does not answer."),
    key(ConfigSection::Control, "bus", "\"both\", \"frequency\" or \"run\"", Some("\"both\""), "Which functions come over the bus; the others are wired to the drive. With \"frequency\" the drive is started and stopped elsewhere: a stop is sent, but may have no effect, and both fail-safe actions must be \"hold\"; `on_gateway_lost` too, or \"adopt\"."),
    key(ConfigSection::Control, "ownership", "\"one\" or \"any\"", Some("\"one\""), "Who may command while a client holds control: only that client, or every client with the rights."),
    key(ConfigSection::Control, "allow_take", "true or false", Some("false"), "Whether a client may take control from its holder. The drive keeps running as it is."),
    key(ConfigSection::Control, "lease", "\"session\" or \"explicit\"", Some("that of `[mqtt]`"), "What renews the lease over MQTT: a working path through the broker, or only commands and the lease topic."),
    key(ConfigSection::Control, "min_start_interval", "\"0s\" to \"1h\"", Some("\"0s\""), "Minimum time between two starts from standstill."),
    key(ConfigSection::Control, "watchdog", "\"100ms\" to \"1h\"", Some("unknown"), "The time-out to which the drive's own watchdog is set: more than twice the longest gap between frames, at most `lost_after`."),
    key(ConfigSection::Control, "require_watchdog", "true or false", Some("false"), "Allow RUN only while the drive's own watchdog was read as enabled and in order. For models where that is proven."),
    key(ConfigSection::Control, "failsafe_confirm_timeout", "\"1s\" to \"1min\"", Some("\"5s\""), "A fail-safe stop without effect for this long is left to the drive's own watchdog, if it was read as enabled: no more frames are sent."),

    key(ConfigSection::Native, "write", "list of codes, names or addresses", None, "The registers that may be written; none that `control` uses."),
    key(ConfigSection::Native, "stored_write_interval", "\"1s\" to \"24h\"", Some("\"10s\""), "Minimum time between two writes of a register that is stored, or not known to be in RAM."),
    key(ConfigSection::Native, "store", "true or false", Some("false"), "Whether each write is followed by the word that stores parameters, for models with `[commit.store]`: no more often than `stored_write_interval`."),

    key(ConfigSection::Mqtt, "broker", "\"mqtt://host:port\", \"mqtts://host:port\" or \"embedded\"", None, "The address of the broker. Ports 1883 and 8883 may be omitted. \"embedded\" is for trials only."),
    key(ConfigSection::Mqtt, "also_at", "list of \"mqtt://host:port\" or \"mqtts://host:port\"", Some("none"), "The other nodes of a cluster. Each time a connection ends, the next one is tried."),
    key(ConfigSection::Mqtt, "user", "text", Some("anonymous"), "The user name for the broker."),
    key(ConfigSection::Mqtt, "password_file", "absolute path", Some("no password"), "The file with the password."),
    key(ConfigSection::Mqtt, "password_env", "name", Some("no password"), "The environment variable with the password, instead of a file."),
    key(ConfigSection::Mqtt, "allow_plain_password", "true or false", Some("false"), "Whether user and password may be sent unencrypted, with `mqtt://`."),
    key(ConfigSection::Mqtt, "client_id", "text", Some("\"vfd-gateway-\" and the gateway's name"), "The client identifier at the broker. Each gateway of a pair adds a `-` and its `half`."),
    key(ConfigSection::Mqtt, "version", "5 or 4", Some("5"), "MQTT 5, or 4 for MQTT 3.1.1."),
    key(ConfigSection::Mqtt, "subscription_qos", "0 or 1", Some("1"), "The QoS of the command subscriptions."),
    key(ConfigSection::Mqtt, "prefix", "levels of a topic", Some("\"vfd\""), "The prefix of all topics, before the gateway's name."),
    key(ConfigSection::Mqtt, "heartbeat", "\"1s\" to \"1h\"", Some("\"60s\""), "Interval after which an unchanged value is published again."),
    key(ConfigSection::Mqtt, "keep_alive", "\"5s\" to \"10min\", whole seconds", Some("\"15s\""), "The keep-alive interval of MQTT."),
    key(ConfigSection::Mqtt, "lease", "\"session\" or \"explicit\"", Some("\"session\""), "What renews the lease: a working path through the broker, or only commands and the lease topic."),
    key(ConfigSection::Mqtt, "alive_topic", "topic, or \"\" for none", Some("\"homeassistant/status\""), "The topic where `offline` means that the commanders are gone. Only with a session lease."),
    key(ConfigSection::Mqtt, "probe_interval", "\"200ms\" to \"1min\"", Some("\"1s\""), "How often the path through the broker is probed. Three missing probes end the connection. At most 3.25 s where drives are commanded."),
    key(ConfigSection::Mqtt, "command_ttl", "\"100ms\" to \"1min\"", Some("\"1s\""), "How long a command without a time of its own may wait."),
    key(ConfigSection::Mqtt, "response_prefix", "levels of a topic", Some("no responses"), "The prefix of the response topics that a requester may name; MQTT 5 only."),
    key(ConfigSection::Mqtt, "keep_telemetry", "0 to 100000", Some("0: none"), "How many changes of run state, frequencies and measurements are kept while the broker is unreachable."),
    key(ConfigSection::Mqtt, "publish", "list of \"state\", \"values\", \"param\", \"line\", \"info\"", Some("all of them"), "Optional topics to publish."),
    key(ConfigSection::Mqtt, "home_assistant", "{ discovery = true or false, prefix = levels of a topic, devices = true or false, combined = [\"switch\", \"fan\"], page = URL }", Some("nothing is announced"), "Whether to announce drives and lines to Home Assistant; the discovery prefix, \"homeassistant\" by default; whether to announce whole devices instead of single entities, false by default; what each drive that may be commanded is announced as besides its buttons, nothing by default; and the address of the page, to which the devices lead."),
    key(ConfigSection::Mqtt, "ca_file", "absolute path", Some("what the system trusts"), "The certificate authority of the broker; with `mqtts://` only."),
    key(ConfigSection::Mqtt, "client_cert_file", "absolute path", Some("none"), "The gateway's own certificate; with `mqtts://` only."),
    key(ConfigSection::Mqtt, "client_key_file", "absolute path", Some("none"), "The key of that certificate."),

    key(ConfigSection::Mqtt, "sparkplug", "table", Some("none: no Sparkplug B"), "Sparkplug B for SCADA, on a separate connection to the same broker; needs `data_dir`."),

    key(ConfigSection::Sparkplug, "group", "one level of a topic", None, "The group of the edge node. The edge node is named like the gateway."),
    key(ConfigSection::Sparkplug, "primary_host", "one level of a topic", Some("none: waits for no host"), "The primary host. Births are sent only while it is online, and its presence renews session leases."),
    key(ConfigSection::Sparkplug, "client_id", "text", Some("that of `[mqtt]` followed by \"-sparkplug\""), "The client identifier at the broker. The gateways of a pair share it."),
    key(ConfigSection::Sparkplug, "max_command_age", "\"1s\" to \"5min\"", Some("\"10s\""), "Commands with an older timestamp are refused, except stops."),
    key(ConfigSection::Sparkplug, "keep_telemetry", "0 to 100000", Some("10000"), "How many changes of run state, frequencies and measurements are kept while no host is online. Changes of trips are always kept."),

    key(ConfigSection::ModbusTcp, "listen", "address:port", None, "Where clients connect."),
    key(ConfigSection::ModbusTcp, "allow", "list of networks", Some("all clients, which are on this host: required unless the address is loopback"), "Who may connect."),
    key(ConfigSection::ModbusTcp, "lines", "list of line names", Some("all lines"), "The lines whose drives this listener serves."),
    key(ConfigSection::ModbusTcp, "write", "list of networks inside `allow`", Some("[]: no client; with `tls` every client that may connect, according to its role"), "Who may command and write, if the drive allows it."),
    key(ConfigSection::ModbusTcp, "stop", "list of networks inside `allow`", Some("`write`"), "Who may stop. It must include every network in `write`."),
    key(ConfigSection::ModbusTcp, "reads_renew", "true or false", Some("false"), "Whether reads renew the lease of the client that controls a drive."),
    key(ConfigSection::ModbusTcp, "cached", "true or false", Some("false"), "Whether a native read of polled registers may be answered from memory, with words of one reply that are no older than their poll period and than the last order for the drive."),
    key(ConfigSection::ModbusTcp, "units", "list of units of its drives", Some("all of its lines"), "The units that this listener serves, native or uniform. 255, the gateway itself, is always served."),
    key(ConfigSection::ModbusTcp, "connections_max", "1 to 65536", Some("10,240 for all listeners, or fewer if the limit of open files is lower"), "Maximum number of clients, without those with `priority`. One more replaces the client that was idle longest."),
    key(ConfigSection::ModbusTcp, "priority", "list of networks inside `allow`", Some("[]: no client"), "Clients whose connections are never closed for others, and for which some connections are reserved."),
    key(ConfigSection::ModbusTcp, "idle_timeout", "\"1s\" to \"24h\", or \"0s\" for none", Some("\"10min\""), "A connection without a request is closed after this time."),
    key(ConfigSection::ModbusTcp, "keep_alive", "\"1s\" to \"2h\", whole seconds, or \"0s\" for none", Some("\"60s\""), "Interval of TCP keep-alive probes on an idle connection. A vanished client is noticed within twice that."),

    key(ConfigSection::ModbusTcp, "tls", "table", Some("none: connections are not encrypted"), "Modbus Security: TLS with certificates on both sides. A client without a valid certificate is refused."),

    key(ConfigSection::ModbusTls, "cert_file", "absolute path", None, "The certificate of the gateway, with its intermediate certificates."),
    key(ConfigSection::ModbusTls, "key_file", "absolute path", None, "The key of that certificate."),
    key(ConfigSection::ModbusTls, "client_ca_file", "absolute path", None, "The certificate authorities of the clients. Other clients are refused."),
    key(ConfigSection::ModbusTls, "roles", "table: role = list of \"write\", \"stop\"", None, "What each role may do besides reading. A role that is not listed may do nothing but read. \"\" is the role of certificates without one."),

    key(ConfigSection::ModbusRtu, "name", "name of up to 32 characters", None, "The name of the serial master as the owner of control, in messages and in the audit."),
    key(ConfigSection::ModbusRtu, "port", "absolute path, or \"tcp://host:port\"", None, "The port at which the master is connected; no line and no other master may use it."),
    key(ConfigSection::ModbusRtu, "baud", "bit/s", None, "Speed, as set at the master."),
    key(ConfigSection::ModbusRtu, "data_bits", "7 or 8", Some("8"), "Data bits of a character; 8 with RTU framing."),
    key(ConfigSection::ModbusRtu, "parity", "\"none\", \"even\" or \"odd\"", None, "Parity bit of a character."),
    key(ConfigSection::ModbusRtu, "stop_bits", "1 or 2", Some("1"), "Stop bits of a character."),
    key(ConfigSection::ModbusRtu, "framing", "\"rtu\" or \"ascii\"", Some("\"rtu\""), "The framing that the master uses."),
    key(ConfigSection::ModbusRtu, "rs485", "\"adapter\", \"kernel\" or \"rts\"", Some("\"adapter\""), "What switches the direction of an RS-485 adapter, as for a line."),
    key(ConfigSection::ModbusRtu, "low_latency", "true or false", Some("true"), "Whether to ask the driver to deliver received bytes at once, if it can."),
    key(ConfigSection::ModbusRtu, "lines", "list of line names", Some("all lines"), "The lines whose drives this master reaches."),
    key(ConfigSection::ModbusRtu, "units", "list of units of its drives", Some("all of its lines"), "The units that answer here, native or uniform. Any other unit gets no answer, because it may belong to another slave on the bus. 255, the gateway itself, always answers."),
    key(ConfigSection::ModbusRtu, "allow_write", "true or false", Some("false"), "Whether the master may command and write, if the drive allows it with \"modbus-tcp\" in `from`."),
    key(ConfigSection::ModbusRtu, "allow_stop", "true or false", Some("`allow_write`"), "Whether the master may stop. It must be true if `allow_write` is."),
    key(ConfigSection::ModbusRtu, "reads_renew", "true or false", Some("false"), "Whether reads renew the lease of the master on the drive that it controls."),
    key(ConfigSection::ModbusRtu, "cached", "true or false", Some("false"), "Whether a native read of polled registers may be answered from memory, as for Modbus TCP."),
    key(ConfigSection::ModbusRtu, "answer_within", "\"20ms\" to \"5s\"", Some("\"100ms\""), "Time from the end of a request within which an exception has been sent if the drive has not answered: 06 to a read, 0B to a write. Set it below the time-out of the master."),

    key(ConfigSection::Http, "listen", "address:port", None, "Where the page, /metrics, /healthz and /readyz are served."),
    key(ConfigSection::Http, "allow", "list of networks", Some("all clients, which are on this host: required unless the address is loopback"), "Who may connect and see everything."),
    key(ConfigSection::Http, "hosts", "list of host names", Some("none but the host's own and `localhost`"), "Additional host names for the gateway in browsers, without a port. IP addresses are always accepted."),
    key(ConfigSection::Http, "view", "\"anyone\" or \"signed-in\"", Some("\"anyone\""), "Who sees the drives on the page and below `/api/v1/`: every client in `allow`, or users who have signed in. `/healthz`, `/readyz` and `/metrics` stay open to `allow`."),
    key(ConfigSection::Http, "setup", "`true` or `false`", Some("`false`"), "Users with the role \"setup\" find drives and add lines in the page, which changes this file."),
    key(ConfigSection::Http, "users", "tables", Some("none: no commands from the page"), "Who may sign in and command. Requires `tls` unless the address is loopback."),
    key(ConfigSection::Http, "tls", "table", Some("none: connections are not encrypted"), "HTTPS instead of HTTP."),

    key(ConfigSection::HttpUser, "name", "name of up to 32 characters", None, "The name of the user, also in the audit."),
    key(ConfigSection::HttpUser, "password_hash", "argon2id hash", Some("`password_hash_file`"), "The password as `vfd-gateway password` prints it."),
    key(ConfigSection::HttpUser, "password_hash_file", "absolute path", Some("`password_hash`"), "The file with this text. One of the two is required."),
    key(ConfigSection::HttpUser, "role", "\"view\", \"operate\", \"maintain\" or \"setup\"", Some("\"maintain\""), "What the user may do: look; command drives; everything that a plant in service needs, as saving diagnostics; or, with `setup = true`, change the configuration as well."),
    key(ConfigSection::HttpUser, "groups", "list of groups of drives", Some("all drives"), "The groups whose drives the user may command. A stop works for all drives."),

    key(ConfigSection::HttpTls, "cert_file", "absolute path", None, "The certificate of the gateway, with its intermediate certificates."),
    key(ConfigSection::HttpTls, "key_file", "absolute path", None, "The key of that certificate."),
];

/// Every key that is known but refused.
#[rustfmt::skip]
pub const NOT_SERVED: &[NotServed] = &[
    refused(ConfigSection::Drive, "interlocks", "leave it out; `reverse_below_hz`, `min_start_interval` and `require_watchdog` in `[line.drive.control]` are the interlocks; what must not run together is wired or decided by the commander"),
    refused(ConfigSection::Drive, "lease", "leave it out; `lease` and `lost_after` are in `[line.drive.control]`"),
    refused(ConfigSection::Drive, "max_status_age", "leave it out; the planned age of the values follows from `poll`"),

    refused(ConfigSection::ModbusTcp, "lease", "leave it out; leases of Modbus TCP are explicit: commands and `renew` keep them, and reads with `reads_renew`"),
];

#[cfg(test)]
mod tests {
    use super::super::tests::{CONTROLLED, example, problems, with};
    use super::*;

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

    /// The tables of `section` in a parsed file.
    fn tables(file: &toml::Table, section: ConfigSection) -> Vec<toml::Table> {
        let mut found = vec![file.clone()];
        for name in section.path().split('.').filter(|name| !name.is_empty()) {
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
        for key in KEYS {
            let there = tables(&file, key.section)
                .iter()
                .any(|table| table.contains_key(key.name));
            let in_comment =
                EXCLUDED.contains(&key.name) && text.contains(&format!("# {} = ", key.name));
            assert!(
                there || in_comment,
                "{} in [{}]",
                key.name,
                key.section.path()
            );
        }
    }

    /// `CONTROLLED` with `line` in the first table of `section`.
    fn with_line_in(section: ConfigSection, line: &str) -> String {
        let (before, after) = match section {
            ConfigSection::Root => return format!("{line}\n{CONTROLLED}"),
            ConfigSection::HttpUser
            | ConfigSection::HttpTls
            | ConfigSection::Sparkplug
            | ConfigSection::ModbusRtu
            | ConfigSection::Standby => {
                return format!("{CONTROLLED}{}\n{line}\n", section.header());
            }
            ConfigSection::Register => ("[line.drive.native]", "[[line.drive.register]]\n"),
            ConfigSection::ModbusTls => ("[http]", "[modbus_tcp.tls]\n"),
            _ => {
                return with(
                    CONTROLLED,
                    &section.header(),
                    &format!("{}\n{line}", section.header()),
                );
            }
        };
        with(CONTROLLED, before, &format!("{after}{line}\n{before}"))
    }

    #[test]
    fn the_reader_takes_exactly_the_keys_of_the_table() {
        for section in ConfigSection::ALL {
            let found = problems(&with_line_in(section, "qqqqqqqqqqqq = 1"));
            let unknown = found
                .iter()
                .find(|it| it.contains("unknown key `qqqqqqqqqqqq`"))
                .unwrap();
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
        let lease = not_served(ConfigSection::ModbusTcp)
            .find(|key| key.name == "lease")
            .unwrap();
        assert_eq!(
            lease.refusal(),
            "`lease` is not supported by this version; a key without effect is refused"
        );
    }

    #[test]
    fn a_key_that_must_be_given_is_missed() {
        for key in KEYS
            .iter()
            .filter(|key| key.default.is_none() && key.section != ConfigSection::Root)
        {
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
