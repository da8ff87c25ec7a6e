//! The lesson of each command.

use super::Lesson;

/// The meaning of most exit codes.
const EXITS: &str = "0 done, 1 failed, 2 wrong usage or configuration";

const fn lesson(
    command: &'static str,
    about: &'static str,
    examples: &'static [(&'static str, &'static str)],
) -> Lesson {
    Lesson { command, about, examples, exits: EXITS }
}

impl Lesson {
    const fn exits(self, exits: &'static str) -> Self {
        Self { exits, ..self }
    }
}

/// One for each command and sub-command, and the program itself.
pub(super) const LESSONS: &[Lesson] = &[
    lesson(
        "",
        "A configuration is a TOML file; `check` tells of all its mistakes at once. Words: a gateway owns lines, a line has \
         drives, a drive has a station number on its line and units on Modbus TCP.",
        &[
            ("vfd-gateway demo", "everything at once on this machine, without hardware"),
            ("vfd-gateway check -c vfd-gateway.toml", "is it right, and what will it cost"),
            ("vfd-gateway run -c vfd-gateway.toml", "the gateway"),
        ],
    ),
    lesson(
        "demo",
        "It needs nothing but this program: drives are played, the broker runs inside, everything listens on 127.0.0.1. It \
         prints the addresses and three lines to try in another terminal. Enter trips a drive; Ctrl-C stops the drives and \
         ends it. If the broker is lost, the drives are stopped within 5 s.",
        &[
            ("vfd-gateway demo", "Modbus TCP on port 1502, HTTP on 8080"),
            ("vfd-gateway demo --port 0 --http-port 0", "on whatever ports are free"),
        ],
    ),
    lesson(
        "run",
        "SIGINT and SIGTERM end it, after the action that `on_shutdown` names for each drive that is under control; SIGHUP \
         takes the file anew. The log goes to stderr; RUST_LOG=vfd_gateway=trace shows every frame.",
        &[
            ("vfd-gateway run -c /etc/vfd-gateway.toml", "until it is ended"),
            ("vfd-gateway --log-format json run -c vfd-gateway.toml", "with a log for programs"),
        ],
    ),
    lesson(
        "check",
        "It opens no port and sends nothing. Use of the line is in per cent of its time; ages and the time until a stop \
         starts are upper bounds in ms or s.",
        &[("vfd-gateway check -c vfd-gateway.toml", "all problems with their lines, or what each line will cost")],
    )
    .exits("0 the file is right, 1 failed, 2 it has problems"),
    lesson(
        "models",
        "A model file says of each fact where it comes from and how sure it is; what no document of this very model states \
         is unproven.",
        &[
            ("vfd-gateway models", "the list"),
            ("vfd-gateway models --model-dir models list", "with your own"),
        ],
    ),
    lesson(
        "models list",
        "",
        &[("vfd-gateway models list --json", "for a script: identifiers, framings, what can be ordered")],
    ),
    lesson(
        "models show",
        "Addresses are those on the wire, counted from 0; a value is the word divided by its scale.",
        &[("vfd-gateway models show MODEL", "registers, units, access, trips, sources of one model of the list")],
    ),
    lesson(
        "models check",
        "",
        &[("vfd-gateway models check my-drive.toml", "problems with their lines, or what of it is unproven")],
    )
    .exits("0 the file is right, 1 failed, 2 it has problems"),
    lesson(
        "simulate",
        "The port is printed at the start. Characters take the time that they take on a real line. It ends with Ctrl-C.",
        &[
            ("vfd-gateway simulate --model MODEL --station 1 --station 2 --link /tmp/vfd-line", "two drives on one line"),
            ("vfd-gateway simulate --model MODEL --tcp 127.0.0.1:4001", "as behind a serial device server"),
            ("vfd-gateway simulate --model MODEL --faults noise=50,lost=20,late=20", "a bad line, per mille of replies"),
        ],
    ),
    lesson(
        "health",
        "It asks over the socket in the gateway's data directory, or over HTTP.",
        &[
            ("vfd-gateway health -c vfd-gateway.toml", "each line and drive in words"),
            ("vfd-gateway health --url http://127.0.0.1:8080 --json", "for a script"),
            ("vfd-gateway health --alive", "for the health check of a container, or another supervisor"),
        ],
    )
    .exits("0 ready (with --alive: alive), 1 not, or not reached, 2 wrong usage or configuration"),
    lesson(
        "reload",
        "Lines that are the same in both files go on, with their leases and clients.",
        &[("vfd-gateway reload -c vfd-gateway.toml", "what has changed, or why nothing has")],
    )
    .exits("0 taken, 1 refused or not reached, 2 the file has problems"),
    lesson(
        "journal",
        "Times are in UTC. The gateway may run meanwhile.",
        &[
            ("vfd-gateway journal trips --drive pump-1 --since 7d", "the trips of a week"),
            ("vfd-gateway journal audit --since 2026-01-31 --csv", "who ordered what, for a spreadsheet"),
        ],
    ),
    lesson(
        "verify",
        "It reads from the drive itself, now, and changes nothing. What can only be seen at the drive is listed.",
        &[("vfd-gateway verify pump-1 -c vfd-gateway.toml", "wanted and found of each setting")],
    )
    .exits("0 all is right, 1 something is wrong or not answered, 2 wrong usage or configuration"),
    lesson(
        "enable",
        "Only at standstill, on a drive with a control section. Each setting is shown old and new, asked about, written \
         once and read back.",
        &[
            ("vfd-gateway enable pump-1 -c vfd-gateway.toml", "asks before it writes"),
            ("vfd-gateway enable pump-1 -c vfd-gateway.toml --yes", "does not ask, for a script"),
        ],
    )
    .exits("0 all is right afterwards, 1 something is not, 2 wrong usage or configuration"),
    lesson(
        "watchdog",
        "The time without a request after which the drive itself acts. It is set at standstill only.",
        &[
            ("vfd-gateway watchdog pump-1 -c vfd-gateway.toml", "what it is"),
            ("vfd-gateway watchdog pump-1 --set 15s -c vfd-gateway.toml", "sets it, after asking"),
        ],
    )
    .exits("0 it is on, 1 it is off or not known, 2 wrong usage or configuration"),
    lesson(
        "read",
        "Registers are shown as words, in decimal and hexadecimal; those of a uniform unit by name, in Hz, A, V, kW, %, \
         degC, h or s. A value that is not known is shown as not available.",
        &[
            ("vfd-gateway read --unit 1 0x0101 --count 2", "two registers as the vendor numbers them"),
            ("vfd-gateway read --unit 101 --uniform", "all that the uniform unit has"),
            ("vfd-gateway read --unit 101 --uniform output_frequency --json", "one value for a script"),
        ],
    )
    .exits("0 done, 1 not reached or refused by an exception, 2 wrong usage"),
    lesson(
        "write",
        "After `run forward`, `reverse` or `take` it stays and holds control; Ctrl-C stops the drive. Have somebody at the \
         hard-wired emergency stop.",
        &[
            ("vfd-gateway write --unit 101 frequency 12.5", "the setpoint in Hz"),
            ("vfd-gateway write --unit 101 run stop", "stops, and lifts a start inhibit"),
            ("vfd-gateway write --unit 101 run forward", "runs until Ctrl-C"),
            ("vfd-gateway write --unit 1 0x020C 100", "a register that the configuration lists"),
        ],
    )
    .exits("0 done, 1 refused or not reached, 2 wrong usage"),
    lesson(
        "watch",
        "",
        &[
            ("vfd-gateway watch --unit 101 --uniform", "everything that changes, until Ctrl-C"),
            ("vfd-gateway watch --unit 1 0x0101 --every 500ms --all", "one register, twice a second"),
        ],
    )
    .exits("0 ended by Ctrl-C, 1 not reached, 2 wrong usage"),
    lesson(
        "map",
        "Each unit of each drive, and the gateway's own: addresses from 0 as they are sent, and counted from 1 behind the \
         digit of the table (40001), with functions, access, steps, units, meanings. What is written depends on the \
         control sections and on who may write.",
        &[
            ("vfd-gateway map -c vfd-gateway.toml --format md > map.md", "to be read and printed"),
            ("vfd-gateway map -c vfd-gateway.toml --format csv > map.csv", "for a spreadsheet or the import of tags"),
            ("vfd-gateway map -c vfd-gateway.toml --unit 101 --json", "one unit for a script"),
        ],
    )
    .exits("0 done, 1 failed, 2 wrong usage or configuration, or no Modbus TCP in it"),
    lesson(
        "completions",
        "",
        &[
            ("source <(vfd-gateway completions bash)", "for this terminal"),
            ("vfd-gateway completions fish > ~/.config/fish/completions/vfd-gateway.fish", "for good"),
        ],
    ),
    lesson(
        "man",
        "",
        &[
            ("vfd-gateway man | man -l -", "the page of the program"),
            ("vfd-gateway man --dir /usr/local/share/man/man1", "the pages of all commands, as vfd-gateway-COMMAND.1"),
        ],
    ),
    lesson(
        "scan",
        "The line must be silent: with another master on it, or a gateway that has the port open, it refuses. 32 stations at \
         the settings of the factories take minutes; how long is said before. Times are in seconds, speeds in bit/s.",
        &[
            ("vfd-gateway scan --port /dev/ttyUSB0", "who is there, and a configuration to start from"),
            ("vfd-gateway scan --port tcp://10.0.0.7:4001 --stations 1-8 --out vfd-gateway.toml", "behind a device server"),
            ("vfd-gateway scan --port /dev/ttyUSB0 --all-settings --dry-run", "how long everything would take"),
        ],
    ),
    lesson(
        "params",
        "Parameters are those that the drive's model knows, by the vendor's codes.",
        &[
            ("vfd-gateway params dump pump-1 --out pump-1.params.toml", "a copy before anything is changed"),
            ("vfd-gateway params restore pump-1.params.toml --dry-run", "what would be written back"),
        ],
    ),
    lesson(
        "params dump",
        "It only reads.",
        &[
            ("vfd-gateway params dump pump-1 -c vfd-gateway.toml --out pump-1.params.toml", "through the running gateway"),
            ("vfd-gateway params dump --port /dev/ttyUSB0 --model MODEL --station 1", "straight on a port"),
        ],
    ),
    lesson(
        "params diff",
        "It only reads.",
        &[
            ("vfd-gateway params diff old.params.toml new.params.toml", "what differs between two files"),
            ("vfd-gateway params diff old.params.toml live -c vfd-gateway.toml", "between a file and the drive"),
        ],
    ),
    lesson(
        "params restore",
        "At standstill only. Stored parameters live in a memory that endures a limited number of writes.",
        &[
            ("vfd-gateway params restore pump-1.params.toml -c vfd-gateway.toml --dry-run", "what would change"),
            ("vfd-gateway params restore pump-1.params.toml -c vfd-gateway.toml", "after asking, with read-back"),
        ],
    ),
    lesson(
        "doctor",
        "It asks nothing of the line: it looks at what goes over it anyway. Shares are per mille of the exchanges, times in ms.",
        &[
            ("vfd-gateway doctor -c vfd-gateway.toml", "all lines, for 30 s"),
            ("vfd-gateway doctor --line hall-1 --seconds 120 --json", "one line, for a script"),
        ],
    )
    .exits("0 no problem, 1 a problem or not reached, 2 wrong usage or configuration"),
    lesson(
        "capture",
        "It sends nothing. Times are those at which the gateway sent or received; Ctrl-C ends it.",
        &[
            ("vfd-gateway capture --line hall-1 --out hall-1.pcapng --seconds 60", "a minute of one line"),
            ("vfd-gateway capture --out - | wireshark -k -i -", "live, where there is one line"),
        ],
    ),
    lesson(
        "password",
        "The hash is argon2id; what was typed is kept nowhere.",
        &[("vfd-gateway password > anna.hash", "asks twice, for `password_hash_file`")],
    ),
];
