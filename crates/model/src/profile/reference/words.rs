//! The words of model files with their meanings, and the introduction of the reference.

use super::Words;

/// The table that stands for every fact.
pub(super) const FACT: &str = "fact";

pub(super) const INTRODUCTION: &str = "# Model files: every key

What a file that describes a drive model may contain. A test makes this page from the program: it names every key that is
read. [Adding a drive from its manual](../deploy/adding-a-drive.md) is the guide with an example; `models check` reports all
mistakes of a file at once, and `models show MODEL --toml` prints a complete one.

The second column says what a key is that is left out; empty where that needs no saying. Times are text with their unit
(`\"500ms\"`, `\"2s\"`), words of 16 bits are numbers, best written as `0x0400`. `NAME` is a name that you choose.
";

pub(super) const LIKE: &str = "
## A file that begins from another model

With `like` a file takes over everything that it does not say itself, except `id` and `title`; the vendor may be another one.
Rows of the lists below that both files have are told apart by their key, and the file's own row takes the place of the other
one. Every other list, and every fact, is replaced as a whole; tables that are no facts are merged key by key. What is taken
over keeps its documents and is graded again: a document of the other model makes a fact `sibling` at best. A document of the
other model that covers this one too is declared again, with the same title and kind, and with both models in `of`.

| rows of | are told apart by |
| --- | --- |
";

pub(super) const WORDS: &[Words] = &[
    Words {
        of: &["fact.confidence"],
        words: &[
            ("manual", "Stated in a manual of this very model. Proven."),
            (
                "second-source",
                "Stated in a second manual of this model, or in that of a firm which sells it under its own name. Proven.",
            ),
            (
                "third-party",
                "Stated for this model by others: a program, a map, a note from a site.",
            ),
            ("sibling", "Stated for another model of the family only."),
            ("inferred", "Follows from other facts; it was not observed."),
            (
                "default",
                "No source, a cautious choice. Under `[timing]` only.",
            ),
            (
                "configured",
                "Reserved for registers that a configuration adds; a file cannot use it.",
            ),
        ],
    },
    Words {
        of: &["documents.NAME.kind"],
        words: &[
            ("manual", "The maker's manual; at best `manual`."),
            (
                "addendum",
                "The maker's addition to a manual; at best `manual`.",
            ),
            (
                "distributor-manual",
                "The manual of a firm that sells the drive under another name; at best `second-source`.",
            ),
            (
                "program",
                "A program that talks to the drive; at best `third-party`.",
            ),
            (
                "register-map",
                "A list of registers made by others; at best `third-party`.",
            ),
            ("site-note", "Notes from one site; at best `third-party`."),
            (
                "commissioning-sheet",
                "The settings of drives at one site; at best `third-party`.",
            ),
            ("forum", "A public discussion; at best `third-party`."),
        ],
    },
    Words {
        of: &["write.refused"],
        words: &[
            ("exception", "An exception."),
            (
                "keeps-old-value",
                "A normal reply with the value that the drive kept. Not with `functions` that lack `0x06`.",
            ),
            (
                "echo-may-be-old",
                "An exception. The value in a normal reply may be the old one although the new one was taken; only reading back \
                 proves it.",
            ),
        ],
    },
    Words {
        of: &["exception.kind"],
        words: &[
            (
                "busy",
                "It cannot do it at the moment. A read is tried again, a stop until it is taken.",
            ),
            ("locked", "It is locked against it. Results name it."),
            (
                "in-trip",
                "It does not do it while a trip is active. Results name it.",
            ),
            (
                "damaged-frame",
                "The request reached it damaged. It counts as a damaged reply.",
            ),
        ],
    },
    Words {
        of: &["run.form"],
        words: &[
            ("values", "Each word is one command."),
            (
                "bits",
                "Each bit has a meaning of its own, see `[[run.bit]]`.",
            ),
        ],
    },
    Words {
        of: &["run.bit.meaning", "run.field.values.NAME"],
        words: &[
            ("nothing", "Nothing; in a field only."),
            (
                "run",
                "Run; without it the motor is ramped down, unless another bit means `stop`: then a run order stays until that.",
            ),
            (
                "reverse",
                "The direction is reverse; without it forward, unless another bit means `forward`.",
            ),
            (
                "forward",
                "The direction is forward; without it reverse, unless another bit means `reverse`.",
            ),
            ("run-forward", "Run forward."),
            ("run-reverse", "Run in reverse."),
            ("stop", "Ramp down and stop."),
            ("quick-stop", "Stop by the fast ramp."),
            ("dc-brake", "Stop by direct current."),
            ("freeze", "Keep the output frequency as it is."),
            ("toggle", "Change the direction. In no command."),
            (
                "ignored",
                "The drive does not take the word. In no command.",
            ),
            ("reset", "Reset a trip."),
            ("coast", "Cut the output off."),
            ("trip", "The drive trips. In no command."),
            ("jog", "Jog. In no command."),
            (
                "bus-run",
                "Run commands are taken from the bus whatever the settings say.",
            ),
            (
                "bus-frequency",
                "The frequency is taken from the bus whatever the settings say.",
            ),
            ("other", "Something that the gateway never orders."),
        ],
    },
    Words {
        of: &["run.reverse_by"],
        words: &[("sign", "By a setpoint below 0.")],
    },
    Words {
        of: &["run.zero"],
        words: &[
            ("stop", "The motor ramps down."),
            ("coast", "The motor coasts."),
            (
                "nothing",
                "The drive takes the word and goes on as it was ordered before.",
            ),
            ("ignored", "The drive does not take the word."),
            ("release", "Panel and terminals take over."),
        ],
    },
    Words {
        of: &["exception.kind"],
        words: &[
            (
                "busy",
                "Not now: a read is tried again after 0.2 s, a write never, a stop until it is taken.",
            ),
            ("locked", "It is locked against this."),
            ("in-trip", "It does not do this while a trip holds."),
            (
                "damaged-frame",
                "The request reached it damaged: as a damaged reply, after which none comes late.",
            ),
        ],
    },
    Words {
        of: &["read.holes"],
        words: &[
            ("refused", "An exception."),
            (
                "zero",
                "0. An answer proves no register, so that `scan` calls such a drive possible only.",
            ),
            ("read", "Something. An answer proves no register either."),
        ],
    },
    Words {
        of: &["setup.needed_for"],
        words: &[
            ("run", "RUN in either direction."),
            ("reverse", "RUN in reverse."),
            ("setpoint", "A setpoint."),
        ],
    },
    Words {
        of: &["status.flag"],
        words: &[
            ("running", "The output is active or ordered to be."),
            ("reverse", "The direction is reverse."),
            ("stopping", "The motor is ramped down to standstill."),
            ("tripped", "A trip is active."),
            ("alarm", "An alarm is active; the drive keeps running."),
            ("ready", "The drive would obey a run order."),
            ("bus-run", "Run commands are taken from the bus."),
            ("bus-frequency", "The frequency is taken from the bus."),
        ],
    },
    Words {
        of: &["codes.form"],
        words: &[
            ("hexadecimal", "The code is the address in hexadecimal."),
            (
                "linear",
                "Address = group x `group` + number x `number` + `offset`, in decimal; without `separator` a code is a number \
                 alone.",
            ),
        ],
    },
    Words {
        of: &[
            "register.table",
            "read.area.table",
            "write.block.table",
            "barrier.read.table",
        ],
        words: &[
            (
                "holding",
                "Holding registers: read by 03, written by 06 or 10 hex.",
            ),
            ("input", "Input registers: read by 04, never written."),
            ("coil", "Coils: bits, read by 01, written by 05 or 0F hex."),
            (
                "discrete",
                "Discrete inputs: bits, read by 02, never written.",
            ),
        ],
    },
    Words {
        of: &["register.role"],
        words: &[
            (
                "run-command",
                "Takes the words of `[run]`. Writable and not stored.",
            ),
            (
                "order",
                "Takes an order of `[run]` that names it, or the direction. Writable and not stored.",
            ),
            (
                "frequency-command",
                "Takes the setpoint. Writable, not stored, and in Hz if the drive is to take orders.",
            ),
            (
                "frequency-setting",
                "The setpoint as the drive holds it, if that is another register than the one that takes it.",
            ),
            (
                "output-frequency",
                "The output frequency. A drive that takes orders has one that is polled: it shows that a stop takes effect.",
            ),
            ("acceleration-time", "The time of the ramp up."),
            ("deceleration-time", "The time of the ramp down."),
            (
                "frequency-source",
                "Where the drive takes its setpoint from. Never written natively.",
            ),
            (
                "run-source",
                "Where the drive takes its run commands from. Never written natively.",
            ),
            (
                "trip-code",
                "The number of the trip that is active now, 0 for none.",
            ),
            (
                "trip-bits",
                "The trips that are active now, one bit each. May have two words.",
            ),
            (
                "trip-count",
                "How many trips there were. One more is a new trip.",
            ),
            (
                "trip-cause",
                "The number of the newest trip, also when it is over. It counts only while the flag `tripped` holds or the count rises.",
            ),
            ("trip-frequency", "The output frequency at the newest trip."),
            ("trip-current", "The output current at the newest trip."),
            (
                "trip-dc-link-voltage",
                "The DC link voltage at the newest trip.",
            ),
            ("output-current", "The output current."),
            ("output-voltage", "The output voltage."),
            ("dc-link-voltage", "The DC link voltage."),
            ("output-power", "The output power."),
            ("torque", "The torque."),
            ("temperature", "The temperature of the drive."),
            ("run-hours", "The hours that the motor has run."),
            (
                "energy",
                "The energy that the drive has counted, in kWh or MWh and polled. It is shown as what the drive has used; without such a register that is summed up from the output power.",
            ),
            (
                "trip-history",
                "The number of an older trip. Several registers may have it; the newest trip is at the lowest address.",
            ),
            (
                "warning-code",
                "The number of the warning that is active now, 0 for none.",
            ),
            (
                "warning-bits",
                "The warnings that are active now, one bit each. May have two words.",
            ),
        ],
    },
    Words {
        of: &["register.poll"],
        words: &[
            (
                "fast",
                "At the poll period of the drive: status, output frequency, trips.",
            ),
            (
                "second",
                "Once a second, or at the poll period if that is longer.",
            ),
            ("slow", "At four times the poll period."),
            (
                "minutely",
                "Once a minute: settings that are changed at the panel.",
            ),
            (
                "hourly",
                "Once an hour: what does not change while the drive is on.",
            ),
        ],
    },
    Words {
        of: &["register.memory"],
        words: &[
            ("ram", "Volatile: it may be written any number of times."),
            (
                "stored",
                "Kept without power: it wears out, so that it is written only if the configuration lists it.",
            ),
        ],
    },
    Words {
        of: &["register.not_stated"],
        words: &[
            ("reading", "That it can be read."),
            ("writing", "That it can be written."),
            ("scale", "Its scale."),
            ("sign", "How negative numbers are encoded."),
            ("memory", "Whether it is stored."),
            ("meaning", "What its words mean."),
        ],
    },
    Words {
        of: &["register.word_order"],
        words: &[
            (
                "high-first",
                "The word at the lower address is the high one.",
            ),
            ("low-first", "The word at the lower address is the low one."),
        ],
    },
];
