//! The command sections of a summary: run words, unproven actions, required settings.

use super::layout::{Row, choice, list, row};
use super::registers::name_at;
use crate::domain::control::ControlAction;
use crate::profile::model::{
    BitMeaning, CommitEffect, Model, OrderKind, OrderedWord, ResetWrite, RunBit, RunCommand,
    RunField, RunForm, SetupItem, StartStep, ZeroWord,
};
use crate::profile::words::{BIT_MEANINGS, NEEDED_FOR};
use crate::toml_file::values::duration_text;
use crate::toml_file::words::{INTERFACES, word_for};

pub(super) fn run_commands(model: &Model, run: &RunCommand) -> Vec<Row> {
    let mut rows = orders(model, run);
    rows.extend(directions(model, run));
    rows.extend(never_written(model, run));
    rows.extend(starts(model, run));
    rows.extend(reset(model, run));
    rows.extend(zero(run));
    if let RunForm::Bits {
        priority: priority @ 1..,
        ..
    } = run.form
    {
        rows.push(vec![
            "with all but release".to_owned(),
            shown(run, priority),
        ]);
    }
    rows
}

/// A run word as its documents write it.
fn shown(run: &RunCommand, word: u16) -> String {
    match run.form {
        RunForm::Values => word.to_string(),
        RunForm::Bits { .. } => format!("0x{word:04X}"),
    }
}

/// The word of the order `kind`, with its register if that is one of its own.
fn order_word(model: &Model, run: &RunCommand, kind: OrderKind, word: u16) -> String {
    let mut registers = run.places.registers.iter();
    match registers.find(|(it, _)| *it == kind) {
        Some((_, address)) => format!("{word} to {}", name_at(model, *address)),
        None => shown(run, word),
    }
}

/// The word of each order, and what a stop keeps of the word before.
fn orders(model: &Model, run: &RunCommand) -> Vec<Row> {
    let places = &run.places;
    let is_given = |kind: &OrderKind| {
        *kind != OrderKind::Reverse || (places.direction.is_none() && !places.by_sign)
    };
    let all = OrderKind::ALL
        .into_iter()
        .filter(is_given)
        .filter_map(|kind| Some((kind, run.word(kind)?)));
    let words = all.map(|(kind, fact)| {
        row(
            kind.keyword(),
            order_word(model, run, kind, fact.value),
            fact,
        )
    });
    let bits = [
        ("a stop keeps of a run word", run.stop_bits.keeps),
        ("a stop changes in it", run.stop_bits.drops),
    ];
    let of_a_stop = bits
        .into_iter()
        .filter(|(_, bits)| *bits != 0)
        .map(|(what, bits)| row(what, shown(run, bits), &run.stop));
    words.chain(of_a_stop).collect()
}

/// The direction, where it is not in the run word.
fn directions(model: &Model, run: &RunCommand) -> Vec<Row> {
    let places = &run.places;
    let by_word = places.direction.iter().map(|fact| {
        let words = &fact.value;
        let reverse = words
            .reverse
            .map_or(String::new(), |word| format!(", reverse {word}"));
        row(
            "direction",
            format!(
                "forward {}{reverse} to {}",
                words.forward,
                name_at(model, words.address)
            ),
            fact,
        )
    });
    let by_sign = run.reverse.iter().filter(|_| places.by_sign).map(|fact| {
        row(
            "reverse",
            format!("{} with a setpoint below 0", shown(run, fact.value)),
            fact,
        )
    });
    by_word.chain(by_sign).collect()
}

fn never_written(model: &Model, run: &RunCommand) -> Vec<Row> {
    let here = run
        .never
        .iter()
        .map(|fact| row("never written", shown(run, fact.value), fact));
    let elsewhere = run.places.never.iter().map(|(address, fact)| {
        row(
            "never written",
            format!("{} to {}", fact.value, name_at(model, *address)),
            fact,
        )
    });
    here.chain(elsewhere).collect()
}

/// The words that together are a reset.
fn reset(model: &Model, run: &RunCommand) -> Option<Row> {
    let writes = model.reset_writes();
    if writes.is_empty() {
        return None;
    }
    let kind = |write: &ResetWrite| {
        let clears = Some(write.address) != model.order_address(OrderKind::Stop);
        if write.resets || clears {
            OrderKind::Reset
        } else {
            OrderKind::Stop
        }
    };
    let text = |write: &ResetWrite| {
        let wait = if write.wait.is_zero() {
            String::new()
        } else {
            format!(" for {}", duration_text(write.wait))
        };
        order_word(model, run, kind(write), write.value) + &wait
    };
    Some(vec!["a reset is".to_owned(), list(writes.iter().map(text))])
}

/// The words before the run word, each with what must come after it.
fn starts(model: &Model, run: &RunCommand) -> Vec<Row> {
    let row_of = |step: &StartStep| {
        let word = step.write.value;
        let Some(until) = &step.until else {
            let text = format!("0x{word:04X}, then {}", duration_text(step.at_least));
            return row("before run", text, &step.write);
        };
        let words = choice(until.values.iter().map(|word| format!("0x{word:04X}")));
        let shown = format!(
            "{} & 0x{:04X} = {words}",
            name_at(model, until.address),
            until.mask
        );
        let least = if step.at_least.is_zero() {
            String::new()
        } else {
            format!("after {}, ", duration_text(step.at_least))
        };
        let within = duration_text(until.within);
        row(
            "before run",
            format!("0x{word:04X}, until {shown}, {least}at most {within}"),
            &step.write,
        )
    };
    let mut rows: Vec<_> = run.start.steps.iter().map(row_of).collect();
    let back = run.start.take_back.iter();
    rows.extend(back.map(|fact| {
        row(
            "a start is taken back by",
            format!("0x{:04X}", fact.value),
            fact,
        )
    }));
    rows
}

pub(super) fn run_bits(run: &RunCommand) -> Vec<Row> {
    let RunForm::Bits { bits, .. } = &run.form else {
        return Vec::new();
    };
    let text = |bit: &RunBit| {
        let when = if bit.is_inverted { " while 0" } else { "" };
        format!("{}{when}", word_for(&BIT_MEANINGS, &bit.meaning))
    };
    bits.iter()
        .map(|bit| row(&bit.bit.value.to_string(), text(bit), &bit.bit))
        .collect()
}

pub(super) fn run_fields(run: &RunCommand) -> Vec<Row> {
    let RunForm::Bits { fields, .. } = &run.form else {
        return Vec::new();
    };
    let text = |(value, meaning): &(u16, Option<BitMeaning>)| {
        format!(
            "{value} {}",
            meaning.map_or("nothing", |meaning| word_for(&BIT_MEANINGS, &meaning))
        )
    };
    let values = |field: &RunField| list(field.values.iter().map(text));
    fields
        .iter()
        .map(|field| {
            row(
                &format!("0x{:04X}", field.mask.value),
                values(field),
                &field.mask,
            )
        })
        .collect()
}

/// What a drive does with a word of zeros, and what the gateway makes of one that a client writes.
fn zero(run: &RunCommand) -> Vec<Row> {
    let Some(zero) = &run.zero else {
        return Vec::new();
    };
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
    vec![
        row("the word 0", text, zero),
        vec!["0 from a client is".to_owned(), ordered.to_owned()],
    ]
}

/// The actions that require acceptance in the configuration.
pub(super) fn unproven_actions(model: &Model, run: &RunCommand) -> Vec<Row> {
    let basic = model.unproven_basics().into_iter().map(|it| {
        let also = it
            .also
            .map(|also| format!("; also {also}"))
            .unwrap_or_default();
        let source = format!("{}: {}{also}", it.what, it.source);
        vec![
            ControlAction::Basic.keyword().to_owned(),
            it.confidence.keyword().to_owned(),
            source,
        ]
    });
    let unproven = run.unproven().map(|(action, fact)| {
        vec![
            action.keyword().to_owned(),
            fact.confidence.keyword().to_owned(),
            fact.source.clone(),
        ]
    });
    let rows: Vec<_> = basic.chain(unproven).collect();
    if rows.is_empty() {
        vec![vec!["none".to_owned()]]
    } else {
        rows
    }
}

/// The words that follow writes of parameters.
pub(super) fn commit(model: &Model) -> Vec<Row> {
    let rows = model.commit.all().map(|fact| {
        let word = &fact.value;
        let does = match word.effect {
            CommitEffect::Apply => "they act only after",
            CommitEffect::Store => "they outlast the power only after",
        };
        let when = if word.at_standstill {
            ", at standstill alone"
        } else {
            ""
        };
        let unproven = if fact.confidence.is_proven() {
            ""
        } else {
            "; never sent: unproven"
        };
        row(
            does,
            format!(
                "{} in {}{when}{unproven}",
                word.value,
                name_at(model, word.address)
            ),
            fact,
        )
    });
    rows.collect()
}

pub(super) fn setup(model: &Model) -> Vec<Row> {
    let rows = model.setup.iter().map(|item| {
        let setting = match item.address {
            Some(address) if item.mask != u16::MAX => {
                format!(
                    "{} & 0x{:04X} = {}",
                    name_at(model, address),
                    item.mask,
                    choice(&item.values.value)
                )
            }
            Some(address) => format!(
                "{} = {}",
                name_at(model, address),
                choice(&item.values.value)
            ),
            None => "at the drive".to_owned(),
        };
        let interface = item
            .interface
            .map_or("-", |interface| word_for(&INTERFACES, &interface));
        vec![
            item.what.clone(),
            item.text.clone(),
            setting,
            interface.to_owned(),
            item.values.confidence.keyword().to_owned(),
            item.values.source.clone(),
        ]
    });
    rows.collect()
}

/// The orders that are refused while a setting is wrong.
pub(super) fn needed(model: &Model) -> Vec<Row> {
    let needed = model
        .setup
        .iter()
        .filter(|item| !item.needed_for.is_empty());
    let orders = |item: &SetupItem| {
        list(
            item.needed_for
                .iter()
                .map(|need| word_for(&NEEDED_FOR, need)),
        )
    };
    needed
        .map(|item| vec![item.what.clone(), orders(item)])
        .collect()
}

pub(super) fn identity(model: &Model) -> Vec<Row> {
    let Some(identity) = &model.identity else {
        return Vec::new();
    };
    let mask = if identity.mask == u16::MAX {
        String::new()
    } else {
        format!(" & 0x{:04X}", identity.mask)
    };
    let words = identity
        .values
        .value
        .iter()
        .map(|word| format!("0x{word:04X}"))
        .collect::<Vec<_>>()
        .join(" or ");
    let mut rows = vec![row(
        "register",
        format!("{}{mask} = {words}", name_at(model, identity.address)),
        &identity.values,
    )];
    rows.extend(
        identity
            .others
            .iter()
            .map(|(word, name)| vec![format!("0x{word:04X}"), name.clone()]),
    );
    rows
}

pub(super) fn watchdog(model: &Model) -> Vec<Row> {
    let Some(watchdog) = &model.watchdog else {
        return Vec::new();
    };
    let time = format!(
        "{}, off with {}",
        name_at(model, watchdog.time),
        watchdog.off.value
    );
    let mut rows = vec![row("time", time, &watchdog.off)];
    let words = |words: &[u16]| {
        words
            .iter()
            .map(u16::to_string)
            .collect::<Vec<_>>()
            .join(", ")
    };
    let digit = watchdog
        .action_digit
        .map_or(String::new(), |digit| format!(", digit of {digit}"));
    let runs_on = format!(
        "{digit}, runs on with {}, stops with {}",
        words(&watchdog.keeps_running),
        words(&watchdog.stops)
    );
    rows.extend(
        watchdog
            .action
            .map(|action| vec!["reaction".to_owned(), name_at(model, action) + &runs_on]),
    );
    rows
}
