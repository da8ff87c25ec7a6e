//! The rules between the keys of `[run]`.

use super::once;
use crate::domain::problem::Problem;
use crate::profile::file::{FormWord, Order, RunFile};
use crate::profile::model::{BitMeaning, Role};
use crate::profile::reader::{Given, Place, Written};
use crate::profile::register::RegisterFile;
use crate::profile::words::{BIT_MEANINGS, word_for};

/// Most words of a reset sequence.
const RESET_WORDS_MAX: usize = 8;

/// Bits with which the motor turns.
const TURNING: [BitMeaning; 4] = [BitMeaning::Run, BitMeaning::RunForward, BitMeaning::RunReverse, BitMeaning::Jog];

pub(super) fn check(run: &RunFile, place: &Place, registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    let called = |word: &u16| format!("the word {}", shown(*word, run));
    once(run.words().map(|(_, word)| word), called, "a word that no other run command has", problems);
    forbidden_words_are_no_commands(run, problems);
    reset_is_framed(run, place, problems);
    match run.form.as_ref().map(|form| form.value) {
        None => {}
        Some(FormWord::Values) => values_have_no_bits(run, problems),
        Some(FormWord::Bits) => bits_are_sound(run, place, problems),
    }
    commands_are_taken(place, registers, problems);
}

/// `word` as the file would best write it.
fn shown(word: u16, run: &RunFile) -> String {
    match run.form.as_ref().map(|form| form.value) {
        Some(FormWord::Bits) => format!("0x{word:04X}"),
        Some(FormWord::Values) | None => word.to_string(),
    }
}

/// No command is a word that must never be written.
fn forbidden_words_are_no_commands(run: &RunFile, problems: &mut Vec<Problem>) {
    for Written { value: never, place } in run.never.iter().filter_map(|fact| fact.value.as_ref()) {
        if let Some((_, word)) = run.words().find(|(_, word)| word.value == *never) {
            let what = format!("the word {} is the command {}", shown(*never, run), word.place.key);
            problems.push(place.problem(what).right("a word that is no command"));
        }
    }
}

/// A reset starts with a stop and never carries an order to run; with bits it ends with a stop, so that the reset bit is
/// taken back.
fn reset_is_framed(run: &RunFile, place: &Place, problems: &mut Vec<Problem>) {
    let Some(reset) = run.reset.as_ref() else {
        if let Given::Usable(sequence) = &run.reset_sequence {
            problems.push(sequence.place.problem("there is no `reset` to write").right("a word for `reset`"));
        }
        return;
    };
    let (Some(reset), Some(stop)) = (&reset.value, &run.stop.value) else { return };
    let (reset, stop) = (reset.value, stop.value);
    let ends_with_stop = run.form.as_ref().is_some_and(|form| form.value == FormWord::Bits);
    let mut example = vec![shown(stop, run), shown(reset, run)];
    example.extend(ends_with_stop.then(|| shown(stop, run)));
    let right = format!("[{}], or up to {RESET_WORDS_MAX} words with nothing else in them", example.join(", "));
    match &run.reset_sequence {
        Given::LeftOut => {
            let what = "`reset_sequence` is left out, and `reset` is given";
            problems.push(place.missing("reset_sequence").problem(what).right(right));
        }
        Given::Unusable => {}
        Given::Usable(sequence) => {
            let words: Vec<u16> = sequence.value.iter().map(|word| word.value).collect();
            let framed = words.first() == Some(&stop) && (!ends_with_stop || words.last() == Some(&stop));
            let only = words.iter().all(|word| *word == stop || *word == reset) && words.contains(&reset);
            if !(framed && only && words.len() <= RESET_WORDS_MAX) {
                let end = if ends_with_stop { " and ends with one" } else { "" };
                let what = format!("a reset starts with a stop{end}, and nothing but stop and reset is in it");
                problems.push(sequence.place.problem(what).right(right));
            }
        }
    }
}

/// Bits have a meaning only where words are built of them.
fn values_have_no_bits(run: &RunFile, problems: &mut Vec<Problem>) {
    let places = run.bits.iter().map(|bit| &bit.place).chain(run.priority.usable().map(|written| &written.place));
    let problem = |place: &Place| place.problem("each word is one command, so its bits mean nothing by themselves");
    problems.extend(places.map(|place| problem(place).right("leave it out, or form = \"bits\"")));
}

/// Every command consists of bits that are declared, and of none that orders something else.
fn bits_are_sound(run: &RunFile, place: &Place, problems: &mut Vec<Problem>) {
    if run.bits.is_empty() {
        let problem = place.missing("bit").problem("no bit is declared, and form is \"bits\"");
        problems.push(problem.right("`[[run.bit]]` for every bit that a command has"));
        return;
    }
    let bits = run.bits.iter().filter_map(|bit| bit.bit.as_ref());
    once(bits, |bit| format!("bit {bit}"), "a bit that is declared once", problems);
    let declared = run.bits.iter().map(|bit| Some(1_u16 << bit.bit.as_ref()?.value));
    let declared = declared.collect::<Option<Vec<_>>>().map(|bits| bits.into_iter().fold(0, |all, bit| all | bit));
    let priority = run.priority.usable();
    for written in run.words().map(|(_, word)| word).chain(priority) {
        bits_are_declared(written, declared, problems);
    }
    for (order, word) in run.words() {
        orders_one_thing(order, word, run, problems);
        if let Some(priority) = priority.filter(|it| order != Order::Release && word.value & it.value != it.value) {
            let what = format!("0x{:04X} has not all bits of `priority`", word.value);
            problems.push(word.place.problem(what).right(format!("0x{:04X}", word.value | priority.value)));
        }
    }
}

fn bits_are_declared(word: &Written<u16>, declared: Option<u16>, problems: &mut Vec<Problem>) {
    let Some(declared) = declared else { return };
    let unknown = word.value & !declared;
    if unknown != 0 {
        let what = format!("0x{:04X} has a bit that is not declared: {}", word.value, unknown.trailing_zeros());
        problems.push(word.place.problem(what).right("a `[[run.bit]]` for it, or a word without it"));
    }
}

/// No command but forward and reverse turns the motor, none turns it both ways, and a stop does nothing but stop.
fn orders_one_thing(order: Order, word: &Written<u16>, run: &RunFile, problems: &mut Vec<Problem>) {
    let has = |meaning: BitMeaning| {
        let is_set = |bit: u8| word.value >> bit & 1 == 1;
        let mut bits = run.bits.iter().filter_map(|bit| Some((bit.bit.as_ref()?.value, bit.meaning.as_ref()?.value)));
        bits.any(|(bit, it)| it == meaning && is_set(bit))
    };
    let also: &[BitMeaning] = match order {
        Order::Forward | Order::Reverse => {
            if has(BitMeaning::RunForward) && has(BitMeaning::RunReverse) {
                let what = format!("0x{:04X} orders forward and reverse at once", word.value);
                problems.push(word.place.problem(what).right("one direction"));
            }
            return;
        }
        Order::Stop => &[BitMeaning::Trip, BitMeaning::Reset],
        Order::Coast | Order::Reset | Order::Release => &[],
    };
    for meaning in TURNING.iter().chain(also).filter(|meaning| has(**meaning)) {
        let what = format!("0x{:04X} has the bit `{}`", word.value, word_for(&BIT_MEANINGS, meaning));
        problems.push(word.place.problem(what).right("a word without it"));
    }
}

/// Some register takes the run commands.
fn commands_are_taken(run: &Place, registers: &[RegisterFile], problems: &mut Vec<Problem>) {
    let may_be = |register: &RegisterFile| match &register.role {
        Given::LeftOut => false,
        Given::Unusable => true,
        Given::Usable(role) => role.value == Role::RunCommand,
    };
    if !registers.iter().any(may_be) {
        let problem = run.problem("no register takes the run commands");
        problems.push(problem.right("a register with `role = \"run-command\"`"));
    }
}
