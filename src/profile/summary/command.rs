//! The command sections of a summary: run words, unproven actions, required settings.

use super::layout::{Row, choice, list, row};
use super::registers::name_at;
use crate::domain::control::ControlAction;
use crate::profile::model::{
    BitMeaning, Model, OrderedWord, RunBit, RunCommand, RunField, RunForm, SetupItem, ZeroWord,
};
use crate::profile::words::{BIT_MEANINGS, NEEDED_FOR};
use crate::toml_file::words::{INTERFACES, word_for};

pub(super) fn run_commands(run: &RunCommand) -> Vec<Row> {
    let shown = |word: u16| match run.form {
        RunForm::Values => word.to_string(),
        RunForm::Bits { .. } => format!("0x{word:04X}"),
    };
    let all = [
        ("stop", Some(&run.stop)),
        ("forward", Some(&run.forward)),
        ("reverse", run.reverse.as_ref()),
        ("coast", run.coast.as_ref()),
        ("reset", run.reset.as_ref()),
        ("release", run.release.as_ref()),
    ];
    let mut rows: Vec<_> =
        all.into_iter().filter_map(|(name, fact)| Some(row(name, shown(fact?.value), fact?))).collect();
    rows.extend(run.never.iter().map(|fact| row("never written", shown(fact.value), fact)));
    if !run.reset_sequence.is_empty() {
        rows.push(vec!["a reset is".to_owned(), list(run.reset_sequence.iter().map(|word| shown(*word)))]);
    }
    rows.extend(zero(run));
    if let RunForm::Bits { priority: priority @ 1.., .. } = run.form {
        rows.push(vec!["with all but release".to_owned(), shown(priority)]);
    }
    rows
}

pub(super) fn run_bits(run: &RunCommand) -> Vec<Row> {
    let RunForm::Bits { bits, .. } = &run.form else { return Vec::new() };
    let text = |bit: &RunBit| {
        let when = if bit.is_inverted { " while 0" } else { "" };
        format!("{}{when}", word_for(&BIT_MEANINGS, &bit.meaning))
    };
    bits.iter().map(|bit| row(&bit.bit.value.to_string(), text(bit), &bit.bit)).collect()
}

pub(super) fn run_fields(run: &RunCommand) -> Vec<Row> {
    let RunForm::Bits { fields, .. } = &run.form else { return Vec::new() };
    let text = |(value, meaning): &(u16, Option<BitMeaning>)| {
        format!("{value} {}", meaning.map_or("nothing", |meaning| word_for(&BIT_MEANINGS, &meaning)))
    };
    let values = |field: &RunField| list(field.values.iter().map(text));
    fields.iter().map(|field| row(&format!("0x{:04X}", field.mask.value), values(field), &field.mask)).collect()
}

/// What a drive does with a word of zeros, and what the gateway makes of one that a client writes.
fn zero(run: &RunCommand) -> Vec<Row> {
    let Some(zero) = &run.zero else { return Vec::new() };
    let ordered = match run.order_in(0) {
        Some(OrderedWord::Coast) => "coast",
        Some(OrderedWord::Release) => "release",
        _ => "stop",
    };
    let text = match zero.value {
        ZeroWord::Stop => "stops the motor",
        ZeroWord::Coast => "lets the motor coast",
        ZeroWord::Nothing => "does nothing",
        ZeroWord::Ignored => "is ignored",
        ZeroWord::Release => "hands the motor to panel and terminals",
    };
    vec![row("the word 0", text, zero), vec!["0 from a client is".to_owned(), ordered.to_owned()]]
}

/// The actions that require acceptance in the configuration.
pub(super) fn unproven_actions(model: &Model, run: &RunCommand) -> Vec<Row> {
    let basic = model.unproven_basics().into_iter().map(|it| {
        let also = it.also.map(|also| format!("; also {also}")).unwrap_or_default();
        let source = format!("{}: {}{also}", it.what, it.source);
        vec![ControlAction::Basic.word().to_owned(), it.confidence.word().to_owned(), source]
    });
    let unproven = run
        .unproven()
        .map(|(action, fact)| vec![action.word().to_owned(), fact.confidence.word().to_owned(), fact.source.clone()]);
    let rows: Vec<_> = basic.chain(unproven).collect();
    if rows.is_empty() { vec![vec!["none".to_owned()]] } else { rows }
}

pub(super) fn setup(model: &Model) -> Vec<Row> {
    let rows = model.setup.iter().map(|item| {
        let setting = match item.address {
            Some(address) if item.mask != u16::MAX => {
                format!("{} & 0x{:04X} = {}", name_at(model, address), item.mask, choice(&item.values.value))
            }
            Some(address) => format!("{} = {}", name_at(model, address), choice(&item.values.value)),
            None => "at the drive".to_owned(),
        };
        let interface = item.interface.map_or("-", |interface| word_for(&INTERFACES, &interface));
        vec![
            item.what.clone(),
            item.text.clone(),
            setting,
            interface.to_owned(),
            item.values.confidence.word().to_owned(),
            item.values.source.clone(),
        ]
    });
    rows.collect()
}

/// The orders that are refused while a setting is wrong.
pub(super) fn needed(model: &Model) -> Vec<Row> {
    let needed = model.setup.iter().filter(|item| !item.needed_for.is_empty());
    let orders = |item: &SetupItem| list(item.needed_for.iter().map(|need| word_for(&NEEDED_FOR, need)));
    needed.map(|item| vec![item.what.clone(), orders(item)]).collect()
}

pub(super) fn identity(model: &Model) -> Vec<Row> {
    let Some(identity) = &model.identity else { return Vec::new() };
    let mask = if identity.mask == u16::MAX { String::new() } else { format!(" & 0x{:04X}", identity.mask) };
    let words = identity.values.value.iter().map(|word| format!("0x{word:04X}")).collect::<Vec<_>>().join(" or ");
    let mut rows =
        vec![row("register", format!("{}{mask} = {words}", name_at(model, identity.address)), &identity.values)];
    rows.extend(identity.others.iter().map(|(word, name)| vec![format!("0x{word:04X}"), name.clone()]));
    rows
}

pub(super) fn watchdog(model: &Model) -> Vec<Row> {
    let Some(watchdog) = &model.watchdog else { return Vec::new() };
    let time = format!("{}, off with {}", name_at(model, watchdog.time), watchdog.off.value);
    let mut rows = vec![row("time", time, &watchdog.off)];
    let words = |words: &[u16]| words.iter().map(u16::to_string).collect::<Vec<_>>().join(", ");
    let digit = watchdog.action_digit.map_or(String::new(), |digit| format!(", digit of {digit}"));
    let runs_on =
        format!("{digit}, runs on with {}, stops with {}", words(&watchdog.keeps_running), words(&watchdog.stops));
    rows.extend(watchdog.action.map(|action| vec!["reaction".to_owned(), name_at(model, action) + &runs_on]));
    rows
}
