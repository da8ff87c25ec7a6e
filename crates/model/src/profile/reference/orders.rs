//! Sentences about orders, status, trips and settings.

use super::Section;

const RUN_REGISTER: &str = "the one for run commands";
const OWN_REGISTER: &str =
    "The name of the register that takes the word, if it has one of its own.";

pub(super) const ORDERS: &[Section] = &[
    Section {
        table: "run",
        says: "The words of run commands. They are written to the register with `role = \"run-command\"`. Without this table \
               the drive is only read.",
        keys: &[
            ("form", "", "How the words are built."),
            ("stop", "", "The word that ramps the motor down."),
            ("forward", "", "The word that runs the motor forward."),
            (
                "reverse",
                "no such order",
                "The word that runs the motor in reverse.",
            ),
            (
                "coast",
                "no such order",
                "The word that cuts the output off.",
            ),
            ("reset", "no such order", "The word that resets a trip."),
            (
                "release",
                "no such order",
                "The word that hands control back to panel and terminals.",
            ),
            ("stop.value", "", "The word."),
            ("stop.register", RUN_REGISTER, OWN_REGISTER),
            (
                "stop.keep",
                "none",
                "With `form = \"bits\"`: bits, as the direction, that the stop has as the last order to run had them. Without an \
                 order, or a direction that the drive shows, they are those of `value`.",
            ),
            (
                "stop.drop",
                "none",
                "With `form = \"bits\"`: bits, as the direction, that the stop changes although they do not run the motor, because \
                 the documents show that word. The key has no effect on what is sent.",
            ),
            ("forward.value", "", "The word."),
            ("forward.register", RUN_REGISTER, OWN_REGISTER),
            ("reverse.value", "", "The word."),
            ("reverse.register", RUN_REGISTER, OWN_REGISTER),
            ("coast.value", "", "The word."),
            ("coast.register", RUN_REGISTER, OWN_REGISTER),
            ("reset.value", "", "The word."),
            ("reset.register", RUN_REGISTER, OWN_REGISTER),
            ("release.value", "", "The word."),
            ("release.register", RUN_REGISTER, OWN_REGISTER),
            (
                "reset.clear",
                "nothing is cleared",
                "The word that is written to the reset's own register after the reset, whatever comes between.",
            ),
            (
                "direction",
                "part of the run word",
                "The direction, where it is written to a register of its own before the run word. `reverse` is then left out.",
            ),
            (
                "direction.register",
                "",
                "The name of that register, which is writable and takes nothing else.",
            ),
            ("direction.forward", "", "The word for forward."),
            (
                "direction.reverse",
                "no such order",
                "The word for reverse.",
            ),
            (
                "reverse_by",
                "a word of its own",
                "How reverse is ordered beside the word for forward. `reverse` is then left out.",
            ),
            (
                "take_back",
                "`stop`",
                "The word that takes back a start that the drive does not follow. Only beside `[[run.start]]`.",
            ),
            (
                "state",
                "no texts",
                "The states of the drive in the vendor's words, see `[[run.state]]`.",
            ),
            (
                "start",
                "the run word alone",
                "The words before the run word, see `[[run.start]]`.",
            ),
            (
                "reset_sequence",
                "required with a `reset` that has no register of its own",
                "The words of a reset in the order in which they are written: `stop` first, then only `reset` and `stop`; with \
                 bits `stop` is also the last, because it clears the reset bit. At most 8. A word may be a table with the keys below.",
            ),
            (
                "reset_sequence.register",
                "the one for run commands",
                "The name of the reset's own register, for `reset` and `clear`; `clear` is then the last word.",
            ),
            ("reset_sequence.value", "", "The word."),
            (
                "reset_sequence.wait",
                "none",
                "How long nothing is written after the word; at most 20 s together. A stop does not wait, and nothing of the \
                 reset follows it but what clears the word.",
            ),
            (
                "zero",
                "a stop, if `stop` is 0",
                "What the drive does with the word 0. Required where the meanings of bits leave it open. A 0 that a client writes is a \
                 coast where 0 coasts and `coast` is proven; otherwise it goes out as the stop word.",
            ),
            (
                "never",
                "none",
                "Words that are never written, whatever a client asks for.",
            ),
            ("never.value", "", "The word."),
            (
                "never.register",
                RUN_REGISTER,
                "The name of another register that takes orders, if it is forbidden there.",
            ),
            (
                "priority",
                "none",
                "Bits that every command but `release` contains: the drive obeys the bus whatever its settings say.",
            ),
        ],
    },
    Section {
        table: "run.bit",
        says: "With `form = \"bits\"`: every bit that a command uses. A word with a bit that is not listed is refused. A word \
               is as sure as its own `confidence` says: an example that shows several bits proves their sum only, so a word \
               that you compose of single bits is `inferred` unless the manual prints it. Rows are told apart by `bit`.",
        keys: &[
            ("bit", "", "Its number, 0 for the lowest."),
            ("meaning", "", "What it means while it holds."),
            (
                "when",
                "1",
                "The value of the bit with which the meaning holds: 0 for an enable with `meaning = \"coast\"`.",
            ),
        ],
    },
    Section {
        table: "run.field",
        says: "With `form = \"bits\"`: neighbouring bits that mean something together. A value that is not listed is never \
               ordered. Rows are told apart by `mask`.",
        keys: &[
            ("mask", "", "The bits, as `0x0030`."),
            (
                "values",
                "",
                "The meaning of each value, shifted down: `{ \"0\" = \"nothing\", \"1\" = \"forward\" }`. It names 0.",
            ),
            ("values.NAME", "", "The meaning of this value, in decimal."),
        ],
    },
    Section {
        table: "run.start",
        says: "The words that are written, in order, before the run word, to the same register. A drive that shows `running` \
               gets the run word only; one that already shows what the last of them must bring about, as while its motor still \
               ramps down, gets the run word only as well, or the last of them and the run word where the last is `stop`.",
        keys: &[
            ("write", "", "The word. It neither runs nor resets."),
            (
                "until",
                "only time must pass",
                "What the drive must show before the next word.",
            ),
            (
                "until.register",
                "",
                "The name of the readable register that shows it.",
            ),
            ("until.mask", "the whole word", "The bits that count."),
            (
                "until.values",
                "",
                "The masked words, one of which it must hold.",
            ),
            (
                "at_least",
                "`\"0s\"`, required without `until`",
                "How long after the write the register is read at the earliest; without `until`, when the next word follows. \
                 Where the last word has no `until`, all of them are `stop`: they go out while the motor may still ramp down.",
            ),
            (
                "within",
                "required with `until`",
                "How long the drive may take. If it takes longer, the start is taken back and has failed.",
            ),
        ],
    },
    Section {
        table: "run.state",
        says: "The states of the drive's own state machine in the vendor's words, as `not ready` or `switched on`. They are only \
               shown: in `drive_state` of the `state` over MQTT and of `/api/v1`, and beside the word on the page, by `read` and by \
               `watch`. A word that is none of them has no text.",
        keys: &[
            (
                "register",
                "",
                "The name of the polled register that shows all of them.",
            ),
            ("mask", "the whole word", "The bits that count."),
            ("value", "", "The masked word."),
            ("text", "", "The vendor's words for the state."),
        ],
    },
    Section {
        table: "setup",
        says: "The settings that the drive needs before it obeys the bus, in the order in which they are made. `check --verbose` and \
               `verify` print them, `enable` makes those that have a register. Rows are told apart by `what`.",
        keys: &[
            ("what", "", "The vendor's code, or the switch."),
            ("text", "", "The setting and what it must be, in words."),
            (
                "register",
                "set at the drive",
                "The name of its register, which is readable and writable.",
            ),
            (
                "mask",
                "the whole word",
                "The bits that `values` are compared with. A setting with a mask is not written.",
            ),
            (
                "values",
                "required with `register`",
                "The words that are right; `enable` writes the first one.",
            ),
            (
                "needed_for",
                "none",
                "Orders that have no effect while the register holds another word. It is read before such an order, which is \
                 refused with `precondition` while it differs. A stop is never refused.",
            ),
            ("interface", "all", "The only interface that it applies to."),
        ],
    },
    Section {
        table: "identity",
        says: "How a drive tells what it is. A drive that shows something else gets no order but a stop (`other_drive`).",
        keys: &[
            ("register", "", "The name of the register."),
            ("mask", "the whole word", "The bits that count."),
            (
                "values",
                "",
                "The masked words that drives of this model show.",
            ),
            (
                "others",
                "none",
                "Masked words of other drives with their names: `{ \"272\" = \"Acme Flux 3\" }`.",
            ),
            (
                "others.NAME",
                "",
                "The name of the drive that shows this word, in decimal.",
            ),
        ],
    },
    Section {
        table: "watchdog",
        says: "The drive's own watchdog: what it does when the bus is silent. `verify`, `require_watchdog` and an alarm rest on \
               it.",
        keys: &[
            (
                "register",
                "",
                "The name of the register that holds its time.",
            ),
            ("off", "", "The word of that register that switches it off."),
            (
                "action",
                "none",
                "The name of the register that holds what the drive does when the time is over.",
            ),
            (
                "action_digit",
                "the whole word",
                "If one decimal digit of `action` says it: the place of the digit, 1, 10, 100 or 1000.",
            ),
            (
                "keeps_running",
                "required with `action`",
                "The words of `action` with which the motor runs on, reported as `keeps_running`; `[]` if the \
                 documents say that there are none.",
            ),
            (
                "stops",
                "all other words in the `values` of `action`",
                "The words of `action` with which the drive stops the motor. A word in neither list is unknown, and the watchdog \
                 is then never reported as in order.",
            ),
        ],
    },
];

pub(super) const STATES: &[Section] = &[
    Section {
        table: "commit",
        says: "The words by which the drive takes over or stores what was written to its parameters, where it does not do so by \
               itself. Each is written by the gateway alone, to a register with `back_door`, and never with a setpoint or a run \
               command. How long the drive hears nothing afterwards is `deaf_after` of the register. A word that is not proven is \
               never sent.",
        keys: &[
            (
                "apply",
                "written parameters act at once",
                "Parameters act only after this word. It follows every write of one.",
            ),
            ("apply.register", "", "The name of its register."),
            ("apply.value", "", "The word."),
            (
                "apply.at_standstill",
                "no",
                "It is not sent while the motor may turn, and neither is what it would take over.",
            ),
            (
                "store",
                "written parameters are stored by their `memory`",
                "Parameters outlast the drive's power only after this word, which applies them too. It follows `enable`, \
                 `watchdog` and, once, all of `params restore`; native writes only with `store = true` in \
                 `[line.drive.native]`. It wears out a memory: `stored_write_interval` holds for it.",
            ),
            ("store.register", "", "The name of its register."),
            ("store.value", "", "The word."),
            ("store.at_standstill", "no", "As for `apply`."),
        ],
    },
    Section {
        table: "status",
        says: "States that a register shows. Rows are told apart by `flag`.",
        keys: &[
            ("flag", "", "The state."),
            ("register", "", "The name of the register, which is polled."),
            ("mask", "the whole word", "The bits that count."),
            ("values", "", "The masked words with which the state holds."),
            (
                "clear",
                "",
                "Masked words with which it does not hold, beside the `values` of the other states of the same bits, the \
                 `values` of the register and `[[run.state]]`. Of a single bit, and of `ready`, `bus-run` and \
                 `bus-frequency`, all other words count as such. A word that is named nowhere proves nothing: it ends no \
                 stop and clears no trip.",
            ),
            (
                "others_clear",
                "no",
                "A document says that it does not hold with any other word.",
            ),
        ],
    },
    Section {
        table: "trip",
        says: "The vendor's texts for trips. `code` for a register with role `trip-code` or `trip-cause`, `bit` for one with \
               role `trip-bits`. Rows are told apart by `code` or `bit`.",
        keys: &[
            ("code", "required without `bit`", "The number of the trip."),
            (
                "bit",
                "",
                "The bit of the trip, 0 for the lowest; up to 31 where the register has two words.",
            ),
            ("text", "", "Its meaning."),
        ],
    },
    Section {
        table: "warning",
        says: "The vendor's texts for warnings, as `[[trip]]`. A warning is shown and does nothing else.",
        keys: &[
            (
                "code",
                "required without `bit`",
                "The number of the warning.",
            ),
            ("bit", "", "The bit of the warning, 0 for the lowest."),
            ("text", "", "Its meaning."),
        ],
    },
    Section {
        table: "codes",
        says: "How the vendor's codes go together with addresses. Registers that break the rule are reported; one that states \
               its `code` may leave out `address`. Either `groups` or `form`.",
        keys: &[
            ("form", "", "The rule, unless it is `groups`."),
            (
                "groups",
                "",
                "A code is the name of a group and a number in decimal; the address is the group's high byte and the number: \
                 with `{ F = 0x01 }` `F08` is 0x0108.",
            ),
            (
                "groups.NAME",
                "",
                "The high byte of the group. Upper and lower case are different groups.",
            ),
            (
                "ends",
                "all numbers",
                "Groups in which the rule ends at a number: codes beyond it may be anywhere.",
            ),
            (
                "ends.NAME",
                "",
                "The last number of the group that follows the rule.",
            ),
            (
                "separator",
                "none",
                "The text between group and number, as the `.` of `P.01`.",
            ),
            (
                "group",
                "100",
                "With `form = \"linear\"` and a separator: addresses from one group to the next.",
            ),
            (
                "number",
                "1",
                "With `form = \"linear\"`: addresses from one number to the next.",
            ),
            (
                "offset",
                "0",
                "With `form = \"linear\"`: the address of number 0 in group 0, often -1.",
            ),
        ],
    },
];
