//! The help text of each command.

use super::HelpText;

/// The meaning of most exit codes.
const EXITS: &str = "0 done, 1 failed, 2 wrong usage or configuration";

const fn help(
    command: &'static str,
    about: &'static str,
    examples: &'static [(&'static str, &'static str)],
) -> HelpText {
    HelpText {
        command,
        about,
        examples,
        exits: EXITS,
    }
}

impl HelpText {
    const fn exits(self, exits: &'static str) -> Self {
        Self { exits, ..self }
    }
}

/// One for each command and sub-command, and the program itself.
pub(super) const HELP_TEXTS: &[HelpText] = &[
    help(
        "",
        "The configuration is a TOML file; `check` reports all its problems at once. Terms: a gateway has lines, a line \
         has drives, a drive has a station number on its line and units on Modbus TCP.",
        &[
            ("vfd-gateway demo", "try everything on this machine, without hardware"),
            ("vfd-gateway check -c vfd-gateway.toml", "check the file and show the load of each line"),
            ("vfd-gateway run -c vfd-gateway.toml", "run the gateway"),
        ],
    ),
    help(
        "demo",
        "Needs only this program. It simulates four drives of four makers in two groups, includes \
         a broker, keeps a journal in a temporary directory that is removed at the end, and \
         listens on 127.0.0.1 only. It prints the addresses and three commands to try in another \
         terminal. Enter trips a drive; Ctrl-C stops the drives and exits. If the broker is lost, \
         the drives are stopped within 5 s.",
        &[
            ("vfd-gateway demo", "Modbus TCP on port 1502, HTTP on 8080"),
            ("vfd-gateway demo --port 0 --http-port 0", "on any free ports"),
        ],
    ),
    help(
        "init",
        "Lists the serial ports, looks for drives (this only reads), and asks for what it cannot \
         find out: names, who may reach the drives, who may command them, and what happens to the \
         motors when that client is lost. Nothing is written before the last answer, and no \
         configuration is overwritten. Every question has a flag; passwords are read from stdin.",
        &[
            ("vfd-gateway init", "ask everything, and write vfd-gateway.toml"),
            ("vfd-gateway init --port /dev/ttyUSB0 --ways page --command-from ''", "only watch, on the page of this host"),
        ],
    ),
    help(
        "run",
        "SIGINT and SIGTERM shut it down after the action that `on_shutdown` names for each drive under control; SIGHUP \
         reloads the file. The log goes to stderr; RUST_LOG=vfd_gateway=trace shows every frame.",
        &[
            ("vfd-gateway run -c /etc/vfd-gateway.toml", "run until a signal ends it"),
            ("vfd-gateway --log-format json run -c vfd-gateway.toml", "write the log as JSON"),
        ],
    ),
    help(
        "check",
        "Opens no port and sends nothing. Line load is in per cent of its time; ages and the time until a stop is sent \
         are upper bounds in ms or s.",
        &[("vfd-gateway check -c vfd-gateway.toml", "report all problems with their line numbers, or the load of each line")],
    )
    .exits("0 the file is valid, 1 failed, 2 it has problems"),
    help(
        "models",
        "A model file gives the source and confidence of each fact. A fact that no document of the model itself states is \
         unproven.",
        &[
            ("vfd-gateway models", "list the models"),
            ("vfd-gateway models --model-dir models list", "include your own models"),
        ],
    ),
    help(
        "models list",
        "",
        &[
            ("vfd-gateway models list --vendor MAKER", "the models of one maker"),
            ("vfd-gateway models list --json", "for a script: identifiers, framings, capabilities"),
        ],
    ),
    help(
        "models show",
        "Addresses are as sent on the wire, counted from 0; a value is the word divided by its scale.",
        &[
            ("vfd-gateway models show MODEL", "show registers, units, access, trips and sources of a model"),
            ("vfd-gateway models show MODEL --toml", "print it as a file, to start your own from"),
        ],
    ),
    help(
        "models check",
        "",
        &[("vfd-gateway models check my-drive.toml", "report problems with their line numbers, or list unproven facts")],
    )
    .exits("0 the file is valid, 1 failed, 2 it has problems"),
    help(
        "models new",
        "Asks for what a drive needs to be read, run and stopped, and for the place in the manual where each fact stands. With \
         --port it reads from the drive what you name, finds scales by what the panel shows, and writes nothing to it. Then it \
         does what `models check` does, and runs the model on a simulated drive.",
        &[
            ("vfd-gateway models new acme-flux-2", "ask, and write acme-flux-2.toml"),
            ("vfd-gateway models new acme-flux-2 --port /dev/ttyUSB0 --station 1 --baud 9600", "read from the drive meanwhile"),
            ("vfd-gateway models new acme-flux-2 --template config-acme.json", "begin from a template of wb-mqtt-serial"),
            ("vfd-gateway models new acme-flux-3 --like MODEL", "begin from another model, and state what differs by hand"),
            ("vfd-gateway models new acme-flux-2 --skeleton", "write a skeleton to fill by hand"),
        ],
    ),
    help(
        "simulate",
        "Prints the port at start. Characters take as long as on a real line. Ctrl-C ends it.",
        &[
            ("vfd-gateway simulate --model MODEL --station 1 --station 2 --link /tmp/vfd-line", "simulate two drives on one line"),
            ("vfd-gateway simulate --model MODEL --tcp 127.0.0.1:4001", "simulate a serial device server"),
            ("vfd-gateway simulate --model MODEL --faults noise=50,lost=20,late=20", "simulate a bad line; in per mille of replies"),
        ],
    ),
    help(
        "health",
        "Asks over the socket in the gateway's data directory, or over HTTP.",
        &[
            ("vfd-gateway health -c vfd-gateway.toml", "show each line and drive"),
            ("vfd-gateway health --url http://127.0.0.1:8080 --json", "for a script"),
            ("vfd-gateway health --alive", "for a container health check or another supervisor"),
            ("vfd-gateway health --active", "for keepalived, which moves the shared address to the \
                                             active gateway"),
        ],
    )
    .exits(
        "0 ready (with --alive: alive, with --active: active), 1 not ready, not reachable, or a motor may still run unseen, 2 wrong usage or configuration",
    ),
    help(
        "standby",
        "Two gateways may share a line (`[standby]` in the configuration): one sends, the other one listens and takes over.",
        &[
            ("vfd-gateway standby -c vfd-gateway.toml", "show on which lines this gateway sends"),
            ("vfd-gateway standby yield", "hand all lines over to the other gateway, before an \
                                           upgrade"),
        ],
    ),
    help(
        "standby status",
        "Asks over the socket in the gateway's data directory.",
        &[("vfd-gateway standby status --json", "for a script")],
    ),
    help(
        "standby yield",
        "Hands the line over to the other gateway and waits until that one is heard. Motors keep \
         running: their clients have `lost_after` to connect to the other gateway. If no other \
         gateway takes over, this one takes the line back after a while, does what \
         `on_gateway_lost` declares, and the command fails. If no line is named, lines on which \
         this gateway does not send or is alone are skipped.",
        &[
            ("vfd-gateway standby yield -c vfd-gateway.toml", "hand all lines over to the other gateway"),
            ("vfd-gateway standby yield hall-1", "hand one line over"),
        ],
    )
    .exits("0 handed over, or nothing to hand over; 1 not handed over or not reachable; 2 wrong usage, or no such line"),
    help(
        "standstill",
        "For a drive that is out of sight and was not seen at standstill. Shows what was last seen \
         of it and asks whether you have checked the motor. The audit records the confirmation. A \
         pending stop stays pending, and is sent when the drive is back.",
        &[("vfd-gateway standstill pump-1 -c vfd-gateway.toml", "confirm it, after you have gone to the drive")],
    )
    .exits("0 confirmed; 1 nothing to confirm, or not reachable; 2 wrong usage, or no such drive"),
    help(
        "diagnose",
        "The archive contains the configuration with stars in place of passwords, the newest lines \
         of the log, the newest rows of the journal, health, state and metrics, the report of each \
         line, and the traffic of the next seconds for Wireshark. With --config it also works \
         while the gateway does not run, with less in it. Names, addresses and host names stay in \
         it.",
        &[
            ("vfd-gateway diagnose", "record 10 s, and write vfd-gateway-diagnostics.tar.gz"),
            ("vfd-gateway diagnose -c vfd-gateway.toml --seconds 60 --out pump.tar.gz", "with a minute of traffic"),
        ],
    ),
    help(
        "reload",
        "Lines that are the same in both files continue, with their leases and clients.",
        &[("vfd-gateway reload -c vfd-gateway.toml", "reload, and show what has changed or why it was refused")],
    )
    .exits("0 reloaded, 1 refused or not reachable, 2 the file has problems"),
    help(
        "journal",
        "Times are in UTC. The gateway may be running.",
        &[
            ("vfd-gateway journal trips --drive pump-1 --since 7d", "show the trips of the last week"),
            ("vfd-gateway journal audit --since 2026-01-31 --csv", "list commands and their senders, for a spreadsheet"),
        ],
    ),
    help(
        "usage",
        "Energy comes from the drive's own counter if the model has one; otherwise it is summed \
         from the output power. Days are in UTC and are kept for a year. A reset is done by the \
         running gateway and is recorded in the audit.",
        &[
            ("vfd-gateway usage -c vfd-gateway.toml", "show the last two weeks of each drive"),
            ("vfd-gateway usage pump-1 --csv", "list all days of one drive, for a spreadsheet"),
            ("vfd-gateway usage pump-1 --reset", "restart at 0, with a new drive or motor"),
        ],
    ),
    help(
        "verify",
        "Reads from the drive and changes nothing. Lists what can only be checked at the drive itself.",
        &[("vfd-gateway verify pump-1 -c vfd-gateway.toml", "show the required and the present value of each setting")],
    )
    .exits("0 all settings are right, 1 one is wrong or was not answered, 2 wrong usage or configuration"),
    help(
        "enable",
        "At standstill only, on a drive with a control section. Shows the old and new value of each setting, asks, writes \
         it once and reads it back.",
        &[
            ("vfd-gateway enable pump-1 -c vfd-gateway.toml", "ask before writing"),
            ("vfd-gateway enable pump-1 -c vfd-gateway.toml --yes", "do not ask, for a script"),
        ],
    )
    .exits("0 all settings are right now, 1 one is not, 2 wrong usage or configuration"),
    help(
        "qualify",
        "Uncouple the motor or let it turn freely, and keep a hand on the hard-wired stop. What \
         you confirm is accepted for this drive only, until its model file or its identity \
         changes.",
        &[
            ("vfd-gateway qualify fan-1 -c vfd-gateway.toml --list", "show what is unproven and what was found"),
            ("vfd-gateway qualify fan-1 -c vfd-gateway.toml", "make the trials; Ctrl-C stops the motor"),
            ("vfd-gateway qualify fan-1 -c vfd-gateway.toml --report fan.json", "a file for the project, without names"),
        ],
    )
    .exits("0 all was as expected, 1 something was not, or the trials ended early, 2 wrong usage \
            or configuration"),
    help(
        "watchdog",
        "The watchdog is the time without a request after which the drive itself acts. It can be \
         set at standstill only.",
        &[
            ("vfd-gateway watchdog pump-1 -c vfd-gateway.toml", "show it"),
            ("vfd-gateway watchdog pump-1 --set 15s -c vfd-gateway.toml", "set it, after asking"),
        ],
    )
    .exits("0 it is on, 1 it is off or unknown, 2 wrong usage or configuration"),
    help(
        "read",
        "Shows registers as words, in decimal and hexadecimal; those of a uniform unit by name, in Hz, A, V, kW, %, degC, \
         h or s. Unknown values are shown as not available.",
        &[
            ("vfd-gateway read --unit 1 0x0101 --count 2", "read two registers by the vendor's numbers"),
            ("vfd-gateway read --unit 101 --uniform", "read all values of the uniform unit"),
            ("vfd-gateway read --unit 101 --uniform output_frequency --json", "read one value, for a script"),
        ],
    )
    .exits("0 done, 1 not reachable or refused by an exception, 2 wrong usage"),
    help(
        "write",
        "After `run forward`, `reverse` or `take` it keeps running and holds control; Ctrl-C stops the drive. Keep a person \
         at the hard-wired emergency stop.",
        &[
            ("vfd-gateway write --unit 101 frequency 12.5", "set the frequency in Hz"),
            ("vfd-gateway write --unit 101 run stop", "stop the drive, and clear a start inhibit"),
            ("vfd-gateway write --unit 101 run forward", "run until Ctrl-C"),
            ("vfd-gateway write --unit 1 0x020C 100", "write a register that the configuration lists"),
        ],
    )
    .exits("0 done, 1 refused or not reachable, 2 wrong usage"),
    help(
        "watch",
        "",
        &[
            ("vfd-gateway watch --unit 101 --uniform", "show every change, until Ctrl-C"),
            ("vfd-gateway watch --unit 1 0x0101 --every 500ms --all", "read one register twice a second"),
        ],
    )
    .exits("0 ended by Ctrl-C, 1 not reachable, 2 wrong usage"),
    help(
        "map",
        "Lists each unit of each drive, and the gateway's own: addresses counted from 0 as sent, and from 1 after the table \
         digit (40001), with functions, access, resolution, units and meanings. What can be written depends on the control \
         sections and on who may write.",
        &[
            ("vfd-gateway map -c vfd-gateway.toml --format md > map.md", "for reading and printing"),
            ("vfd-gateway map -c vfd-gateway.toml --format csv > map.csv", "for a spreadsheet or a tag import"),
            ("vfd-gateway map -c vfd-gateway.toml --unit 101 --json", "print one unit, for a script"),
        ],
    )
    .exits("0 done, 1 failed, 2 wrong usage or configuration, or Modbus TCP is not configured"),
    help(
        "completions",
        "",
        &[
            ("source <(vfd-gateway completions bash)", "complete in this terminal"),
            ("vfd-gateway completions fish > ~/.config/fish/completions/vfd-gateway.fish", "complete permanently"),
        ],
    ),
    help(
        "man",
        "",
        &[
            ("vfd-gateway man | man -l -", "show the page of the program"),
            ("vfd-gateway man --dir /usr/local/share/man/man1", "write the pages of all commands, as vfd-gateway-COMMAND.1"),
        ],
    ),
    help(
        "scan",
        "The line must be silent: the scan refuses to start while another master uses the line or a gateway has the port \
         open. 32 stations at factory settings take minutes; the expected time is printed first. Times are in seconds, \
         speeds in bit/s.",
        &[
            ("vfd-gateway scan --port /dev/ttyUSB0", "find drives, and print a configuration to start from"),
            ("vfd-gateway scan --port tcp://10.0.0.7:4001 --stations 1-8 --out vfd-gateway.toml", "scan behind a device server"),
            ("vfd-gateway scan --port /dev/ttyUSB0 --all-settings --dry-run", "show how long everything would take"),
        ],
    ),
    help(
        "params",
        "Parameters are those that the drive's model lists, by the vendor's codes.",
        &[
            ("vfd-gateway params dump pump-1 --out pump-1.params.toml", "save a copy before changing anything"),
            ("vfd-gateway params restore pump-1.params.toml --dry-run", "show what would be written back"),
        ],
    ),
    help(
        "params dump",
        "Only reads.",
        &[
            ("vfd-gateway params dump pump-1 -c vfd-gateway.toml --out pump-1.params.toml", "read through the running gateway"),
            ("vfd-gateway params dump --port /dev/ttyUSB0 --model MODEL --station 1", "read directly on a port"),
        ],
    ),
    help(
        "params diff",
        "Only reads.",
        &[
            ("vfd-gateway params diff old.params.toml new.params.toml", "compare two files"),
            ("vfd-gateway params diff old.params.toml live -c vfd-gateway.toml", "compare a file with the drive"),
        ],
    ),
    help(
        "params restore",
        "At standstill only. Parameters are stored in memory with a limited number of write cycles.",
        &[
            ("vfd-gateway params restore pump-1.params.toml -c vfd-gateway.toml --dry-run", "show what would change"),
            ("vfd-gateway params restore pump-1.params.toml -c vfd-gateway.toml", "write after asking, with read-back"),
        ],
    ),
    help(
        "doctor",
        "Sends nothing on the line: it observes the normal traffic. Shares are per mille of the exchanges, times in ms.",
        &[
            ("vfd-gateway doctor -c vfd-gateway.toml", "observe all lines for 30 s"),
            ("vfd-gateway doctor --line hall-1 --seconds 120 --json", "observe one line, for a script"),
        ],
    )
    .exits("0 no problem, 1 a problem or not reachable, 2 wrong usage or configuration"),
    help(
        "capture",
        "Sends nothing. Times are when the gateway sent or received; Ctrl-C ends the recording.",
        &[
            ("vfd-gateway capture --line hall-1 --out hall-1.pcapng --seconds 60", "record one line for a minute"),
            ("vfd-gateway capture --out - | wireshark -k -i -", "watch live, if there is only one line"),
        ],
    ),
    help(
        "password",
        "The hash is argon2id; the password itself is not stored.",
        &[("vfd-gateway password > anna.hash", "prompt twice; the file is for `password_hash_file`")],
    ),
    help(
        "certificate",
        "The authority is made once, and signs only for the names that it was made for, for .local \
         names and for private addresses. The gateway serves its certificate as /authority.crt.",
        &[
            (
                "vfd-gateway certificate --dir /etc/vfd-gateway/tls --name gateway.local --name 10.0.0.7",
                "make both, and show what to configure and to install",
            ),
            ("vfd-gateway certificate --dir /etc/vfd-gateway/tls", "renew the certificate, with the same names"),
            ("vfd-gateway certificate --dir /etc/vfd-gateway/tls --renew-within 60", "renew it only in its last 60 days, for a timer"),
        ],
    ),
];
