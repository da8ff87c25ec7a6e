//! Sentences about registers.

use super::Section;

pub(super) const REGISTERS: &[Section] = &[Section {
    table: "register",
    says: "One register. Leave out what is not documented. Rows are told apart by `name`.",
    keys: &[
        (
            "name",
            "",
            "Its name, unique in the file; what topics, `read` and `write` call it.",
        ),
        ("title", "", "A description."),
        ("code", "none", "The vendor's code, as `F007`."),
        (
            "address",
            "that of `code`",
            "The address as it is sent on the wire, counted from 0. Required unless `[codes]` gives it.",
        ),
        (
            "table",
            "`holding`",
            "The table of the Modbus data model that the address is in. `functions` lists the ones that read and write it. A coil or a discrete input is 0 or 1.",
        ),
        ("unit", "", "The unit of the value; `-` for none."),
        ("access", "", "What the documents say can be done with it."),
        (
            "role",
            "none",
            "What the gateway uses it for. A role belongs to one register, except `trip-history`.",
        ),
        ("poll", "on request only", "How often it is read."),
        (
            "memory",
            "not known, treated as `stored`",
            "Where a written value is kept.",
        ),
        (
            "scale",
            "1",
            "Raw steps in one unit: with 100 a raw 4250 is 42.50. Or a ratio: value = raw x per / steps.",
        ),
        ("scale.steps", "", "Raw steps."),
        ("scale.per", "", "The number of units that they are."),
        (
            "signed",
            "false",
            "Whether the number is in two's complement. Required with `not_stated = [\"sign\"]`: below half of the range both readings agree.",
        ),
        (
            "range",
            "not known",
            "The least and the greatest value that the drive takes, in the unit: `[0.1, 600.0]`.",
        ),
        (
            "plausible",
            "none",
            "What it shows of every drive of this model, in the unit: `[150, 900]`. Until it was seen in this range after the drive came into sight, no reading of the drive is shown as good, and every order but a stop is refused (`implausible`): the addresses may be off by one, or the drive another one.",
        ),
        (
            "values",
            "none",
            "The meanings of its words: `{ \"0\" = \"panel\", \"2\" = \"bus\" }`.",
        ),
        ("values.NAME", "", "The meaning of this word, in decimal."),
        (
            "back_door",
            "none",
            "Why no client may ever write it: it is another way to move the motor, or widens its limits.",
        ),
        (
            "link",
            "false",
            "Whether it decides how the drive is reached: station, speed, format. `params restore` writes it last, and only on request.",
        ),
        (
            "not_stated",
            "none",
            "What of this row its source does not state, so that it is not proven.",
        ),
        (
            "deaf_after",
            "none",
            "How long the drive hears nothing after this register was written. A stop is tried at once and sent again then.",
        ),
        (
            "no_reply",
            "false",
            "The drive never answers a write of this register, as of one that restarts it. It is written once; its outcome is read \
             when the time of `deaf_after` is over. Of all orders only `reset` may be written there.",
        ),
        (
            "words",
            "1",
            "2 for a 32-bit value, which takes this address and the next. Both words are read in one frame. Only a setpoint may be written: both words in one frame of function 10 hex.",
        ),
        (
            "word_order",
            "required with `words = 2`",
            "The order of the two words.",
        ),
        (
            "mask",
            "the whole word",
            "The bits that hold the number, neighbours; it is shifted down. Registers may share an address if their masks do not overlap and they are only read.",
        ),
        (
            "exponent_mask",
            "none",
            "Beside `mask`: at most 3 bits with a power of ten: value = number x 10^exponent / scale.",
        ),
        (
            "full_scale",
            "none",
            "The value is a fraction: from + raw / steps x (of - from). In place of `scale`.",
        ),
        (
            "full_scale.steps",
            "",
            "The raw number that stands for the whole.",
        ),
        (
            "full_scale.of",
            "",
            "The name of the readable register in the same unit that holds the whole, or `\"configured\"`: the drive's key `full_scale_hz`.",
        ),
        (
            "full_scale.parameter",
            "none",
            "Beside `of = \"configured\"`: the drive's own parameter that holds the whole, as a person looks for it.",
        ),
        (
            "full_scale.from",
            "0",
            "The name of the register that holds the value of a raw 0.",
        ),
        (
            "scale_by",
            "none",
            "The steps per unit depend on another register. In place of `scale`.",
        ),
        ("scale_by.register", "", "The name of that register."),
        (
            "scale_by.steps",
            "",
            "Steps per unit by its word: `{ \"0\" = 1, \"1\" = 10 }`. With another word there is no value.",
        ),
        (
            "scale_by.steps.NAME",
            "",
            "The steps per unit with this word, in decimal.",
        ),
        (
            "plus",
            "none",
            "Further words that are added, as MWh to kWh.",
        ),
        ("plus.address", "", "The address of the word."),
        ("plus.scale", "1", "Its steps, as `scale`."),
        ("plus.scale.steps", "", "Raw steps."),
        ("plus.scale.per", "", "The number of units that they are."),
        (
            "direction",
            "none",
            "Of a signed output frequency, frequency command or frequency setting: the sign is the direction, and the magnitude is shown. With `not_stated = [\"sign\"]` only a number below 0 shows a direction.",
        ),
    ],
}];
