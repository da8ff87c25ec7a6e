//! Proves by bits and fields that each run command does what its name says, and what a word of zeros does.

use super::keys::once;
use crate::domain::command::Direction;
use crate::domain::problem::Problem;
use crate::profile::file::{FieldFile, FormWord, RunFile};
use crate::profile::model::{BitMeaning, BitSense, OrderKind, WordEffect, WordSenses, ZeroWord};
use crate::profile::words::{BIT_MEANINGS, ZERO_WORDS};
use crate::toml_file::words::word_for;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};

/// Only words composed of bits may declare bits.
pub(super) fn values_have_no_bits(run: &RunFile, problems: &mut Vec<Problem>) {
    let bits = run.bits.iter().map(|bit| &bit.location);
    let fields = run.fields.iter().map(|field| &field.location);
    let places = bits
        .chain(fields)
        .chain(run.priority.valid().map(|written| &written.location));
    let problem = |location: &KeyLocation| {
        location.problem("each word is one command, so single bits have no meaning")
    };
    problems
        .extend(places.map(|location| problem(location).right("leave it out, or form = \"bits\"")));
}

/// Every command consists of declared bits and orders only what its name says.
pub(super) fn bits_are_sound(run: &RunFile, location: &KeyLocation, problems: &mut Vec<Problem>) {
    if run.bits.is_empty() && run.fields.is_empty() {
        let problem = location
            .missing("bit")
            .problem("no bit is declared, and form is \"bits\"");
        problems.push(problem.right("`[[run.bit]]` for every bit that a command uses"));
        return;
    }
    let bits = run.bits.iter().filter_map(|bit| bit.bit.as_ref());
    once(
        bits,
        |bit| format!("bit {bit}"),
        "a bit that is declared only once",
        problems,
    );
    fields_are_sound(run, problems);
    let declared = declared(run);
    let priority = run.priority.valid();
    for written in run.own_words().map(|(_, word)| word).chain(priority) {
        bits_are_declared(written, declared, problems);
    }
    for (order, word) in run.own_words() {
        values_are_listed(word, run, problems);
        orders_one_thing(order, word, run, problems);
        if let Some(priority) =
            priority.filter(|it| order != OrderKind::Release && word.value & it.value != it.value)
        {
            let what = format!("0x{:04X} lacks bits of `priority`", word.value);
            problems.push(word.location.problem(what).right(format!(
                "0x{:04X}, if the documents show that word, or another `priority`",
                word.value | priority.value
            )));
        }
    }
}

/// `word` consists of declared bits, and moves nothing.
pub(super) fn bits_order_nothing(
    word: &LocatedValue<u16>,
    run: &RunFile,
    problems: &mut Vec<Problem>,
) {
    bits_are_declared(word, declared(run), problems);
    values_are_listed(word, run, problems);
    let senses = run.senses();
    let moves = |meaning: BitMeaning| {
        meaning.turns()
            || matches!(
                meaning,
                BitMeaning::Trip | BitMeaning::Toggle | BitMeaning::Reset
            )
    };
    for sense in senses.held(word.value).filter(|sense| moves(sense.meaning)) {
        let (what, right) = explain_sense(sense, word.value);
        problems.push(word.location.problem(what).right(right));
    }
}

/// The bits that are declared; `None` if some of them are unusable.
pub(super) fn declared(run: &RunFile) -> Option<u16> {
    let bits = run
        .bits
        .iter()
        .map(|bit| Some(1_u16 << bit.bit.as_ref()?.value));
    let fields = run
        .fields
        .iter()
        .map(|field| Some(field.mask.as_ref()?.value));
    bits.chain(fields)
        .try_fold(0, |all, bits| Some(all | bits?))
}

/// Whether every bit and field is usable, so that what is not declared does not exist.
fn is_complete(run: &RunFile) -> bool {
    let is_usable = |field: &FieldFile| field.mask.is_some() && field.values.is_some();
    run.bits.iter().all(|bit| bit.sense().is_some()) && run.fields.iter().all(is_usable)
}

/// A field has neighbouring bits that nothing else uses, and says what 0 means.
fn fields_are_sound(run: &RunFile, problems: &mut Vec<Problem>) {
    let bits = run
        .bits
        .iter()
        .filter_map(|bit| Some((1_u16 << bit.bit.as_ref()?.value, &bit.location)));
    let mut taken: Vec<_> = bits.collect();
    for field in &run.fields {
        let Some(LocatedValue {
            value: mask,
            location,
        }) = field.mask.as_ref()
        else {
            continue;
        };
        let top = mask >> mask.trailing_zeros();
        if top & top.wrapping_add(1) != 0 || top == 1 {
            let what = format!("0x{mask:04X} is no field of neighbouring bits");
            problems.push(
                location
                    .problem(what)
                    .right("two or more neighbouring bits, as 0x0030; else `[[run.bit]]`"),
            );
        }
        if let Some((_, other)) = taken.iter().find(|(bits, _)| bits & mask != 0) {
            let what = format!("0x{mask:04X} has bits of {}", other.key);
            problems.push(
                location
                    .problem(what)
                    .right("bits that are declared only once"),
            );
        }
        taken.push((*mask, &field.location));
        let Some(values) = &field.values else {
            continue;
        };
        for (value, meaning) in values.iter().filter(|(value, _)| *value > top) {
            let what = format!("{value} does not fit into 0x{mask:04X}");
            problems.push(
                meaning
                    .location
                    .problem(what)
                    .right(format!("a value from 0 to {top}")),
            );
        }
        if values.iter().all(|(value, _)| *value != 0) {
            let problem = field.location.problem("`values` does not say what 0 means");
            problems.push(problem.right("`\"0\"`, which is `\"nothing\"` if it has no effect"));
        }
    }
}

pub(super) fn bits_are_declared(
    word: &LocatedValue<u16>,
    declared: Option<u16>,
    problems: &mut Vec<Problem>,
) {
    let Some(declared) = declared else { return };
    let unknown = word.value & !declared;
    if unknown != 0 {
        let what = format!(
            "0x{:04X} has an undeclared bit: {}",
            word.value,
            unknown.trailing_zeros()
        );
        problems.push(
            word.location
                .problem(what)
                .right("a `[[run.bit]]` with what the documents say of it, or a word without it"),
        );
    }
}

/// The meaning of each field in `word` is known.
fn values_are_listed(word: &LocatedValue<u16>, run: &RunFile, problems: &mut Vec<Problem>) {
    for field in &run.fields {
        let Some((mask, values)) = field.mask.as_ref().zip(field.values.as_ref()) else {
            continue;
        };
        let value = (word.value & mask.value) >> mask.value.trailing_zeros();
        if value != 0 && values.iter().all(|(known, _)| *known != value) {
            let what = format!(
                "0x{:04X} has {value} in the field 0x{:04X}",
                word.value, mask.value
            );
            problems.push(
                word.location
                    .problem(what)
                    .right("a value that the field lists"),
            );
        }
    }
}

/// What a command must not mean beside what it orders. Only forward and reverse turn the motor.
fn is_wrong(order: OrderKind, meaning: BitMeaning) -> bool {
    use BitMeaning::{Coast, DcBrake, Freeze, Ignored, Jog, QuickStop, Reset, Stop, Toggle, Trip};
    if matches!(meaning, Trip | Toggle | Ignored) {
        return true;
    }
    match order {
        OrderKind::Forward | OrderKind::Reverse => {
            matches!(
                meaning,
                Jog | Stop | QuickStop | DcBrake | Freeze | Coast | Reset
            )
        }
        OrderKind::Stop => {
            meaning.turns() || matches!(meaning, QuickStop | DcBrake | Freeze | Coast | Reset)
        }
        OrderKind::Coast => meaning.turns() || meaning == Reset,
        OrderKind::Reset | OrderKind::Release => meaning.turns(),
    }
}

/// A command does what its name says, and nothing else.
pub(super) fn orders_one_thing(
    order: OrderKind,
    word: &LocatedValue<u16>,
    run: &RunFile,
    problems: &mut Vec<Problem>,
) {
    let senses = run.senses();
    let mut is_refused = false;
    for sense in senses
        .held(word.value)
        .filter(|sense| is_wrong(order, sense.meaning))
    {
        let (what, right) = explain_sense(sense, word.value);
        problems.push(word.location.problem(what).right(right));
        is_refused = true;
    }
    // That a word is another command's as well is reported already.
    let is_shared = run
        .own_words()
        .any(|(other, it)| other != order && it.value == word.value);
    if is_refused || is_shared || !is_complete(run) {
        return;
    }
    if senses.contradicts(word.value) {
        let what = format!("0x{:04X} orders forward and reverse at once", word.value);
        problems.push(word.location.problem(what).right("a single direction"));
        return;
    }
    let needed = match order {
        OrderKind::Forward => return runs(Direction::Forward, word, &senses, problems),
        OrderKind::Reverse => return runs(Direction::Reverse, word, &senses, problems),
        OrderKind::Release => return,
        // Without such a bit a motor stops because nothing runs it.
        OrderKind::Stop if !senses.exists(BitMeaning::Stop) => return,
        OrderKind::Stop => BitMeaning::Stop,
        OrderKind::Coast => BitMeaning::Coast,
        OrderKind::Reset => BitMeaning::Reset,
    };
    if !senses.has(word.value, needed) {
        let meaning = word_for(&BIT_MEANINGS, &needed);
        let what = format!("0x{:04X} does not mean `{meaning}`", word.value);
        let right = match senses.0.iter().find(|sense| sense.meaning == needed) {
            Some(sense) => {
                format!(
                    "0x{:04X}, if the documents show that word",
                    word.value & !sense.mask | sense.word
                )
            }
            None => format!("a `[[run.bit]]` with the meaning `{meaning}`"),
        };
        problems.push(word.location.problem(what).right(right));
    }
}

/// `word` runs the motor in `direction`.
fn runs(
    direction: Direction,
    word: &LocatedValue<u16>,
    senses: &WordSenses,
    problems: &mut Vec<Problem>,
) {
    let hex = format!("0x{:04X}", word.value);
    let turns = senses.held(word.value).any(|sense| sense.meaning.turns());
    let found = match senses.effect(word.value) {
        // Whom the drive obeys is no matter of what the word orders.
        WordEffect::Release if turns => senses.direction(word.value),
        WordEffect::Run(found) => found,
        _ => {
            let right = "a word with a bit that means `run`, `run-forward` or `run-reverse`";
            return problems.push(
                word.location
                    .problem(format!("{hex} does not run the motor"))
                    .right(right),
            );
        }
    };
    let (what, right) = match found {
        Some(found) if found == direction => return,
        None => (
            "does not say in which direction the motor runs",
            "a word that means `forward` or `reverse`",
        ),
        Some(Direction::Forward) => ("runs the motor forward", "a word that runs it in reverse"),
        Some(Direction::Reverse) => ("runs the motor in reverse", "a word that runs it forward"),
    };
    problems.push(word.location.problem(format!("{hex} {what}")).right(right));
}

/// Why `sense` holds with `word`, and what would be right.
fn explain_sense(sense: &BitSense, word: u16) -> (String, &'static str) {
    let meaning = word_for(&BIT_MEANINGS, &sense.meaning);
    let bit = sense.mask.trailing_zeros();
    match (sense.mask.is_power_of_two(), sense.is_inverted()) {
        (true, false) => (
            format!("0x{word:04X} has the bit `{meaning}`"),
            "a word without it",
        ),
        (true, true) => (
            format!("0x{word:04X} means `{meaning}`: bit {bit} is 0"),
            "a word with that bit",
        ),
        (false, _) => (
            format!(
                "0x{word:04X} means `{meaning}` in the field 0x{:04X}",
                sense.mask
            ),
            "another value in that field",
        ),
    }
}

/// The file says what a word of zeros does if bits alone do not make that plain, and it agrees with commands and bits.
pub(super) fn zero_is_known(run: &RunFile, location: &KeyLocation, problems: &mut Vec<Problem>) {
    let senses = run.senses();
    let has_bits = run
        .form
        .as_ref()
        .is_some_and(|form| form.value == FormWord::Bits);
    let by_bits = (has_bits && is_complete(run)).then(|| by_bits(&senses));
    let Some(zero) = &run.zero else {
        if has_bits && let Some(why) = reason_for_zero(run) {
            let what = format!("`zero` is left out, and {why}");
            let word = by_bits.flatten().map_or_else(|| "...".to_owned(), quoted);
            let right = format!(
                "`zero = {{ value = {word}, ... }}`: what the documents say that the drive does with the word 0"
            );
            problems.push(location.missing("zero").problem(what).right(right));
        }
        return;
    };
    let Some(LocatedValue {
        value: stated,
        location,
    }) = &zero.value
    else {
        return;
    };
    if let Some((order, word)) = run.own_words().find(|(_, word)| word.value == 0) {
        let what = format!(
            "the word {} is the command {}",
            run.shown(0),
            word.location.key
        );
        match by_command(order) {
            Some(right) if right == *stated => {}
            Some(right) => problems.push(location.problem(what).right(quoted(right))),
            None => problems.push(location.problem(what).right("leave it out")),
        }
    }
    match by_bits {
        Some(Some(right)) if right != *stated => {
            problems.push(
                location
                    .problem("by its bits and fields the word 0 does something else")
                    .right(quoted(right)),
            );
        }
        Some(None) => {
            let problem = location
                .problem("by its bits and fields the word 0 moves the motor, or trips the drive");
            problems.push(problem.right("bits and fields with which 0 does neither"));
        }
        _ => {}
    }
}

fn quoted(zero: ZeroWord) -> String {
    format!("\"{}\"", word_for(&ZERO_WORDS, &zero))
}

/// Why the file must say what a word of zeros does; `None` if it need not.
fn reason_for_zero(run: &RunFile) -> Option<String> {
    if let Some(field) = run.fields.first() {
        return Some(format!("{} is a field", field.location.key));
    }
    let is_zero = |when: &OptionalKey<u8>| when.valid().is_some_and(|when| when.value == 0);
    if let Some(bit) = run.bits.iter().find(|bit| is_zero(&bit.when)) {
        return Some(format!("{} holds while it is 0", bit.location.key));
    }
    use BitMeaning::{DcBrake, Forward, Freeze, Ignored, QuickStop, Stop, Toggle};
    let is_new = |meaning: BitMeaning| {
        matches!(
            meaning,
            Stop | Forward | QuickStop | DcBrake | Freeze | Toggle | Ignored
        )
    };
    let bit = run
        .bits
        .iter()
        .find(|bit| bit.meaning.as_ref().is_some_and(|it| is_new(it.value)))?;
    let meaning = word_for(&BIT_MEANINGS, &bit.meaning.as_ref()?.value);
    Some(format!("{} means `{meaning}`", bit.location.key))
}

/// What a word of zeros does that is a command; `None` if nothing that the file can say.
const fn by_command(order: OrderKind) -> Option<ZeroWord> {
    match order {
        OrderKind::Stop => Some(ZeroWord::Stop),
        OrderKind::Coast => Some(ZeroWord::Coast),
        OrderKind::Release => Some(ZeroWord::Release),
        OrderKind::Forward | OrderKind::Reverse | OrderKind::Reset => None,
    }
}

/// What a word of zeros does by bits and fields; `None` if it moves the motor or trips the drive.
fn by_bits(senses: &WordSenses) -> Option<ZeroWord> {
    match senses.effect(0) {
        WordEffect::Ignored => Some(ZeroWord::Ignored),
        WordEffect::Release => Some(ZeroWord::Release),
        WordEffect::Coast => Some(ZeroWord::Coast),
        WordEffect::Stop => Some(ZeroWord::Stop),
        WordEffect::Nothing => Some(ZeroWord::Nothing),
        WordEffect::Trip | WordEffect::Run(_) | WordEffect::Turns => None,
    }
}

#[cfg(test)]
mod tests {
    use crate::profile::check;
    use crate::profile::testing::{
        EVERYTHING, ZERO_COAST, ZERO_IGNORED, ZERO_NOTHING, each_is_told, each_is_told_of,
    };

    fn changed(text: &str, changes: &[(&str, &str)]) -> String {
        changes.iter().fold(text.to_owned(), |text, (from, to)| {
            assert!(text.contains(from), "{from}");
            text.replacen(from, to, 1)
        })
    }

    #[test]
    fn a_stop_stops() {
        let stop = "stop = { value = 0x043C";
        each_is_told_of(
            ZERO_IGNORED,
            &[
                (
                    stop,
                    "stop = { value = 0x003C",
                    "run.stop.value: 0x003C means `ignored`: bit 10 is 0 -> a word with that bit\n\
                     run.reset_sequence: a reset starts with a stop and ends with one, and contains only stop and \
                     reset -> [0x003C, 0x04BC, 0x003C], or up to 8 words of these only",
                ),
                (
                    "reset_sequence = [0x043C, 0x04BC, 0x043C]",
                    "reset_sequence = [0x043C, 0x04BC]",
                    "run.reset_sequence: a reset starts with a stop and ends with one, and contains only stop and \
                     reset -> [0x043C, 0x04BC, 0x043C], or up to 8 words of these only",
                ),
            ],
        );
        for (word, why) in [
            (0x047C_u16, "0x047C has the bit `run` -> a word without it"),
            (
                0x0438,
                "0x0438 means `dc-brake`: bit 2 is 0 -> a word with that bit",
            ),
            (
                0x0434,
                "0x0434 means `coast`: bit 3 is 0 -> a word with that bit",
            ),
            (
                0x042C,
                "0x042C means `quick-stop`: bit 4 is 0 -> a word with that bit",
            ),
            (
                0x041C,
                "0x041C means `freeze`: bit 5 is 0 -> a word with that bit",
            ),
            (0x053C, "0x053C has the bit `jog` -> a word without it"),
        ] {
            // Another word for the order to coast, and for those of the reset.
            let coast = "coast = { value = 0x0434, confidence = \"manual\", source = \"UM 4\" }\n";
            let text = changed(ZERO_IGNORED, &[(coast, "")]);
            let text = text.replace("0x043C", &format!("0x{word:04X}"));
            let found = told_of(&text);
            assert!(found.contains(&format!("run.stop.value: {why}")), "{found}");
        }
        // Where there is a bit for a stop, it alone stops the motor.
        let text = changed(
            ZERO_NOTHING,
            &[("stop = { value = 0x0001", "stop = { value = 0x0010")],
        );
        let text = text.replace("[0x0001, 0x0009, 0x0001]", "[0x0010, 0x0009, 0x0010]");
        assert_eq!(
            told_of(&text),
            "run.stop.value: 0x0010 does not mean `stop` -> 0x0011, if the documents show that word"
        );
    }

    #[test]
    fn a_run_order_runs_in_its_direction() {
        each_is_told_of(
            ZERO_COAST,
            &[
                (
                    "0x0007",
                    "0x0017",
                    "run.forward.value: 0x0017 has an undeclared bit: 4 -> \
                     a `[[run.bit]]` with what the documents say of it, or a word without it",
                ),
                (
                    "0x0007",
                    "0x0002",
                    "run.forward.value: 0x0002 does not run the motor -> a word with a bit that means `run`, `run-forward` or `run-reverse`",
                ),
                (
                    "0x0007",
                    "0x0005",
                    "run.forward.value: 0x0005 means `coast`: bit 1 is 0 -> a word with that bit",
                ),
                (
                    "0x0007",
                    "0x000F",
                    "run.forward.value: 0x000F has the bit `jog` -> a word without it",
                ),
            ],
        );
        // Forward and reverse are mixed up.
        let mixed = changed(
            ZERO_COAST,
            &[(
                "when = 0\nconfidence = \"manual\"\nsource = \"UM 4.1\"\n\n[[run.bit]]\nbit = 3",
                "confidence = \"manual\"\nsource = \"UM 4.1\"\n\n[[run.bit]]\nbit = 3",
            )],
        );
        assert_eq!(
            told_of(&mixed),
            "run.forward.value: 0x0007 runs the motor in reverse -> a word that runs it forward\n\
             run.reverse.value: 0x0003 runs the motor forward -> a word that runs it in reverse"
        );
        each_is_told_of(
            ZERO_NOTHING,
            &[
                (
                    "0x0012",
                    "0x0002",
                    "run.forward.value: 0x0002 does not say in which direction the motor runs -> a word that means `forward` or `reverse`",
                ),
                (
                    "0x0012",
                    "0x0032",
                    "run.forward.value: 0x0032 means `toggle` in the field 0x0030 -> another value in that field",
                ),
                (
                    "0x0012",
                    "0x0013",
                    "run.forward.value: 0x0013 has the bit `stop` -> a word without it",
                ),
            ],
        );
    }

    #[test]
    fn a_coast_coasts_and_a_reset_resets() {
        each_is_told_of(
            ZERO_COAST,
            &[(
                "coast = { value = 0x0004",
                "coast = { value = 0x0002",
                "run.coast.value: 0x0002 does not mean `coast` -> 0x0000, if the documents show that word",
            )],
        );
        let text = ZERO_COAST.replace("0x0086", "0x0002");
        assert_eq!(
            told_of(&text),
            "run.reset.value: 0x0002 does not mean `reset` -> 0x0082, if the documents show that word"
        );
        each_is_told(&[(
            "meaning = \"coast\"",
            "meaning = \"other\"",
            "run.coast.value: 0xC800 does not mean `coast` -> a `[[run.bit]]` with the meaning `coast`",
        )]);
    }

    #[test]
    fn what_zero_does_is_said_and_agrees_with_the_bits() {
        let zero = |word: &str| {
            format!("zero = {{ value = \"{word}\", confidence = \"manual\", source = \"UM 4\" }}\n")
        };
        let models = [
            (ZERO_IGNORED, "ignored", "run.bit[0] holds while it is 0"),
            (ZERO_NOTHING, "nothing", "run.field[0] is a field"),
            (ZERO_COAST, "coast", "run.bit[1] holds while it is 0"),
        ];
        for (model, is, why) in models {
            let left_out = format!(
                "run.zero: `zero` is left out, and {why} -> `zero = {{ value = \"{is}\", ... }}`: what the documents say that the drive does with the word 0"
            );
            each_is_told_of(model, &[(&zero(is), "", &left_out)]);
            for other in ["stop", "coast", "nothing", "ignored", "release"]
                .into_iter()
                .filter(|other| *other != is)
            {
                let expected = format!(
                    "run.zero.value: by its bits and fields the word 0 does something else -> \"{is}\""
                );
                each_is_told_of(model, &[(&zero(is), &zero(other), &expected)]);
            }
        }
        // A stop of 0 is sound only where 0 stops.
        let text = changed(ZERO_COAST, &[("value = 0x0006", "value = 0x0000")])
            .replace("[0x0006, 0x0086, 0x0006]", "[0x0000, 0x0086, 0x0000]");
        assert_eq!(
            told_of(&text),
            "run.stop.value: 0x0000 means `coast`: bit 1 is 0 -> a word with that bit\n\
             run.zero.value: the word 0x0000 is the command run.stop.value -> \"stop\""
        );
        let turns = changed(
            ZERO_COAST,
            &[
                (
                    "bit = 0\nmeaning = \"run\"",
                    "bit = 0\nmeaning = \"run\"\nwhen = 0",
                ),
                (
                    "bit = 1\nmeaning = \"coast\"\nwhen = 0",
                    "bit = 1\nmeaning = \"coast\"",
                ),
            ],
        );
        let found = told_of(&turns);
        // A run order that stays would be turned round by a 0.
        let reversed = changed(
            ZERO_NOTHING,
            &[("\"0\" = \"nothing\"", "\"0\" = \"reverse\"")],
        );
        let expected = "run.zero.value: by its bits and fields the word 0 moves the motor, or trips the drive ->";
        assert!(
            told_of(&reversed).contains(expected),
            "{}",
            told_of(&reversed)
        );
        assert!(
            found.contains("run.zero.value: by its bits and fields the word 0 moves the motor, or trips the drive ->"),
            "{found}"
        );
    }

    #[test]
    fn where_each_word_is_a_command_zero_may_be_one() {
        let run =
            &EVERYTHING[EVERYTHING.find("[run]").unwrap()..EVERYTHING.find("[[status]]").unwrap()];
        let fact = |value: &str| {
            format!("{{ value = {value}, confidence = \"manual\", source = \"IM 5\" }}")
        };
        let with = |stop: &str, zero: &str| {
            let run_table = format!(
                "[run]\nform = \"values\"\nstop = {}\nforward = {}\nzero = {}\n\n",
                fact(stop),
                fact("1"),
                fact(zero)
            );
            EVERYTHING.replace(run, &run_table)
        };
        for (stop, zero) in [
            ("0", "\"stop\""),
            ("2", "\"nothing\""),
            ("2", "\"ignored\""),
            ("2", "\"coast\""),
            ("2", "\"stop\""),
        ] {
            check::model(&with(stop, zero)).unwrap();
        }
        assert_eq!(
            told_of(&with("0", "\"nothing\"")),
            "run.zero.value: the word 0 is the command run.stop.value -> \"stop\""
        );
    }

    #[test]
    fn fields_are_apart_and_complete() {
        let field = "mask = 0x0030\nvalues = { \"0\" = \"nothing\", \"1\" = \"forward\", \"2\" = \"reverse\", \"3\" = \"toggle\" }";
        let with = |mask: &str, values: &str| {
            told_of(&changed(
                ZERO_NOTHING,
                &[(field, &format!("mask = {mask}\nvalues = {{ {values} }}"))],
            ))
        };
        let all = "\"0\" = \"nothing\", \"1\" = \"forward\", \"2\" = \"reverse\"";
        for (mask, values, expected) in [
            (
                "0x0030",
                "\"1\" = \"forward\", \"2\" = \"reverse\"",
                "run.field[0]: `values` does not say what 0 means -> `\"0\"`, which is `\"nothing\"` if it has no effect",
            ),
            (
                "0x0030",
                "\"0\" = \"nothing\", \"1\" = \"forward\"",
                "run.reverse.value: 0x0022 has 2 in the field 0x0030 -> a value that the field lists",
            ),
            (
                "0x0031",
                all,
                "run.field[0].mask: 0x0031 is no field of neighbouring bits ->",
            ),
            (
                "0x0031",
                all,
                "run.field[0].mask: 0x0031 has bits of run.bit[0] ->",
            ),
            (
                "0x0010",
                all,
                "run.field[0].mask: 0x0010 is no field of neighbouring bits ->",
            ),
            (
                "0x0030",
                "\"0\" = \"nothing\", \"4\" = \"forward\"",
                "run.field[0].values.4: 4 does not fit into 0x0030 -> a value from 0 to 3",
            ),
            (
                "0x0030",
                "\"0\" = \"nothing\", \"01\" = \"forward\"",
                "run.field[0].values.01: `01` is not a register word ->",
            ),
            (
                "0x0030",
                "",
                "run.field[0].values: is empty -> the meaning of each value",
            ),
            (
                "0x0030",
                "\"0\" = \"nothing\", \"1\" = \"onward\"",
                "run.field[0].values.1: `onward` is not an allowed value -> \"forward\"",
            ),
        ] {
            let found = with(mask, values);
            assert!(found.contains(expected), "{mask} {values}: {found}");
        }
    }

    fn told_of(text: &str) -> String {
        let problems = check::model(text).unwrap_err();
        let line = |problem: &crate::domain::problem::Problem| {
            format!(
                "{}: {} -> {}",
                problem.key,
                problem.what,
                problem.right.as_deref().unwrap_or("-")
            )
        };
        problems.iter().map(line).collect::<Vec<_>>().join("\n")
    }
}
