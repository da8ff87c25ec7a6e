//! Sentences about the head of a model file and about the line.

use super::Section;
use super::words::FACT;

pub(super) const FILE: &[Section] = &[
    Section {
        table: "",
        says: "These keys come before the first table.",
        keys: &[
            (
                "id",
                "",
                "The name of the model, `vendor-model`; what `model = ` says in a configuration.",
            ),
            (
                "like",
                "",
                "The `id` of another model that this file begins from: then it says only what differs. See \
                 [below](#a-file-that-begins-from-another-model).",
            ),
            (
                "without",
                "",
                "With `like`: what is left out of the other model, as `\"watchdog\"`, `\"run.coast\"`, `\"register.torque\"` or \
                 `\"trip.7\"`.",
            ),
            ("vendor", "", "The maker's name."),
            ("title", "", "The product's name."),
            (
                "functions",
                "",
                "The function codes that the drive serves, in decimal or as `0x10`.",
            ),
        ],
    },
    Section {
        table: FACT,
        says: "A fact is a table that says where its content comes from: `{ value = 3.5, confidence = \"manual\", source = \
               \"UM 9.2\" }`. The tables below say which of them are facts; each row of a list of facts is one.",
        keys: &[
            (
                "confidence",
                "",
                "How sure the fact is; no better than the document of its source allows.",
            ),
            (
                "source",
                "",
                "The short name of a document of `[documents]`, a space, and the place in it. With `default`: the reason.",
            ),
            (
                "also",
                "none",
                "A second, independent source: a place in another document, neither of which was made from the other. It makes \
                 the fact no surer; `check --verbose` and `models check` say which of stop, forward and setpoint have one.",
            ),
        ],
    },
    Section {
        table: "documents",
        says: "The documents that facts cite, each under a short name of your choice.",
        keys: &[
            (
                "NAME",
                "",
                "The title, of a manual of this very model; or a table with the keys below.",
            ),
            ("NAME.title", "", "The title."),
            (
                "NAME.kind",
                "",
                "What the document is. It decides how sure its facts may be.",
            ),
            (
                "NAME.of",
                "this model",
                "The models that it is about, this one by its `id`. What it says of others is `sibling` here.",
            ),
            (
                "NAME.made_from",
                "not known",
                "The short name of the document that it was made from: the two are no two sources.",
            ),
        ],
    },
];

pub(super) const LINE: &[Section] = &[
    Section {
        table: "link",
        says: "The serial line: what can be set at the drive.",
        keys: &[
            (
                "default",
                "",
                "The factory setting, or `ask` alone where it differs by edition or no document states it.",
            ),
            (
                "default.ask",
                "",
                "What to read at the drive's panel. A configuration must then state `baud`, `parity` and `stop_bits` of the \
                 line, and `data_bits` with ASCII frames.",
            ),
            ("default.baud", "required without `ask`", "Speed in bit/s."),
            (
                "default.data_bits",
                "required without `ask`",
                "Data bits; 7 is a factory setting of ASCII frames.",
            ),
            ("default.parity", "required without `ask`", "Parity."),
            ("default.stop_bits", "required without `ask`", "Stop bits."),
            ("bauds", "", "The speeds in bit/s that can be set."),
            ("parities", "", "The parities that can be set."),
            ("stop_bits", "", "The stop bits that can be set."),
            ("data_bits", "", "The data bits that can be set."),
            ("framings", "", "The framings that the drive understands."),
            ("interfaces", "", "The interfaces that the drive has."),
            ("stations", "", "The station numbers that can be set."),
            ("stations.from", "", "The lowest."),
            ("stations.to", "", "The highest."),
            (
                "broadcast",
                "",
                "A documented broadcast. It is used for one thing only, a stop for every drive of a line.",
            ),
            (
                "broadcast.station",
                "",
                "The station number that addresses all drives.",
            ),
            (
                "broadcast.functions",
                "",
                "The functions that may be broadcast; each is in `functions`.",
            ),
        ],
    },
    Section {
        table: "timing",
        says: "Times on the line. Here, and only here, a fact may be a `default`.",
        keys: &[
            (
                "gap_chars",
                "",
                "Silence before and after each frame, in characters.",
            ),
            (
                "reply_timeout_cap",
                "",
                "How long a reply is waited for until response times have been measured.",
            ),
            (
                "processing_max",
                "not known",
                "The longest processing time of a request.",
            ),
            (
                "stored_write_max",
                "not known",
                "The longest processing time of a write to a stored register.",
            ),
            (
                "reply_delay_max",
                "not known",
                "The longest reply delay that can be set at the drive, on top of its processing time.",
            ),
            (
                "reply_char_bits",
                "as in requests",
                "Bits per character of the drive's replies, if they are more than in requests.",
            ),
            (
                "pause_after_write",
                "none",
                "How long the drive is left alone after its reply to a write. A stop waits for it too.",
            ),
            (
                "pause_after_stored_write",
                "as `pause_after_write`",
                "The same after a write to a stored register.",
            ),
            (
                "max_lateness",
                "",
                "How long after a time-out a late reply may still arrive.",
            ),
        ],
    },
    Section {
        table: "read",
        says: "The limits of reads.",
        keys: &[
            ("max_words", "", "Most words in one read."),
            (
                "max_words_ascii",
                "as `max_words`",
                "The same in ASCII frames.",
            ),
            (
                "boundary",
                "none",
                "A boundary that no read crosses: a change of the address's high byte.",
            ),
            (
                "max_bytes",
                "not known",
                "The longest frame in bytes, if the manual limits frames instead of words.",
            ),
            (
                "holes",
                "`refused`",
                "What a read of an address without a register shows.",
            ),
        ],
    },
    Section {
        table: "read.area",
        says: "Ranges of addresses with a limit of their own. No read crosses the edge of one. Rows are told apart by `from`.",
        keys: &[
            ("table", "`holding`", "The table that the addresses are in."),
            ("from", "", "The first address."),
            ("to", "", "The last address."),
            ("max_words", "", "Most words or bits in one read."),
        ],
    },
    Section {
        table: "write",
        says: "How writes behave.",
        keys: &[
            ("refused", "", "What a refused write looks like."),
            (
                "block",
                "one register in a frame",
                "Neighbouring registers that one frame of function 10 hex may write. If setpoint and run command are in it and \
                 the fact is proven, both are sent in one frame. Every register in it is writable.",
            ),
            (
                "block.table",
                "`holding`",
                "The table that it is in: `\"coil\"` for neighbouring coils, which function 0F hex writes.",
            ),
            ("block.address", "", "The first register."),
            (
                "block.count",
                "",
                "How many registers there are from it on.",
            ),
        ],
    },
    Section {
        table: "exception",
        says: "The vendor's texts for exception codes. Rows are told apart by `code`.",
        keys: &[
            ("code", "", "The code."),
            ("text", "", "Its meaning."),
            (
                "kind",
                "a refusal",
                "What the drive means by it. A write is never tried again for it.",
            ),
        ],
    },
    Section {
        table: "barrier",
        says: "Exchanges after which no late reply to an earlier request can follow, best first. A row has exactly one of \
               these keys.",
        keys: &[
            (
                "read",
                "",
                "A read. It proves something if its length differs from that of the read whose reply is missing, so two of \
                          different lengths are better than one.",
            ),
            ("read.table", "`holding`", "The table that it is in."),
            (
                "read.address",
                "",
                "The first register. All of them are readable.",
            ),
            ("read.count", "", "How many words."),
            (
                "loop_test",
                "",
                "The drive answers function 08, subfunction 0, with the data of the request: `loop_test = { confidence = ..., \
                 source = ... }`. `functions` lists `0x08`.",
            ),
            (
                "refused_function",
                "",
                "A function that the drive does not serve and refuses with exception 01. It is tried before it is relied on.",
            ),
        ],
    },
    Section {
        table: "quirks",
        says: "Deviations that registers cannot express. The list is closed.",
        keys: &[
            (
                "decimal_numbers",
                "no",
                "The last two places of an address count in decimal digits: 0x0010 follows 0x0009.",
            ),
            (
                "percent_of_rated",
                "no",
                "Current and voltage are in per cent of rated values, which the configuration of the drive states.",
            ),
            (
                "setpoint_before_run",
                "no",
                "The setpoint that the drive holds is not reliable: it is written before each RUN.",
            ),
            (
                "stored_alias_bit",
                "none",
                "An address with this bit set is the stored twin of the same register: written, never read.",
            ),
            (
                "ram_alias",
                "none",
                "A stored register has another address by which it is written in RAM. A setpoint goes there; `params` and `enable` \
                 write the register itself, native clients what they are allowed by `write`. Used only if proven.",
            ),
            (
                "ram_alias.mask",
                "",
                "The bits of an address that tell the register from its form in RAM.",
            ),
            (
                "ram_alias.from",
                "",
                "These bits of a register that has such a form.",
            ),
            (
                "ram_alias.to",
                "",
                "These bits of its form in RAM, at which no other register is.",
            ),
            (
                "ram_alias.readable",
                "false",
                "Whether the form in RAM can be read as well.",
            ),
            (
                "deaf_after_power_up",
                "not known",
                "How long the drive ignores requests after it was switched on.",
            ),
            (
                "deaf_after_reset",
                "not known",
                "How long the drive ignores requests after a reset.",
            ),
            (
                "pause_before_request",
                "none",
                "A pause that the drive needs before each request.",
            ),
        ],
    },
];
