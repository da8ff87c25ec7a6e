//! The words that take over or store what was written to parameters: which one follows an order, and whether it may.

use super::interlocks::StartInterlocks;
use crate::domain::command::{GoOrder, Reason, Report};
use crate::domain::control::ControlSettings;
use crate::domain::time::MonoTime;
use crate::drive::steps::{self, CommandStep};
use crate::profile::model::{CommitEffect, CommitWord, Model};

/// The word that follows what a client writes to registers by `go`, while the motor `may_turn`; `None` if it needs none.
///
/// # Errors
/// Why it may not be sent now. Then nothing is written: what was written would not act, or would be lost unseen.
pub(super) fn after_write(
    model: &Model,
    interlocks: &StartInterlocks,
    go: &GoOrder,
    control: &ControlSettings,
    may_turn: bool,
    now: MonoTime,
) -> Result<Option<CommitWord>, Report> {
    let effect = if control.stores_native_writes {
        CommitEffect::Store
    } else {
        CommitEffect::Apply
    };
    if go.registers().is_empty() {
        return Ok(None);
    }
    let Some(word) = model.commit(effect) else {
        return Ok(None);
    };
    // The drive may be deaf afterwards, and an order to move must not wait for that.
    if go.run().is_some() || go.frequency().is_some() {
        return Err(Report::refused(Reason::Conflict));
    }
    if word.at_standstill && may_turn {
        return Err(Report::refused(Reason::Moving));
    }
    may_wear(interlocks, word, control, now)?;
    Ok(Some(word.clone()))
}

/// The word that follows what a person at the host sets, at standstill.
pub(super) fn after_setup(
    model: &Model,
    interlocks: &StartInterlocks,
    control: &ControlSettings,
    now: MonoTime,
) -> Result<Option<CommitWord>, Report> {
    let Some(word) = model.last_commit() else {
        return Ok(None);
    };
    may_wear(interlocks, word, control, now)?;
    Ok(Some(word.clone()))
}

/// The word of `model` that takes over or stores parameters, if `go` writes one.
pub(super) fn written_by(go: &GoOrder, model: &Model) -> Option<CommitWord> {
    let [write] = go.registers() else { return None };
    model.commit_at(write.address, write.value).cloned()
}

/// Adds `word` behind `steps`, and remembers that it wears out the drive's memory if it does.
pub(super) fn append(
    steps: &mut Vec<CommandStep>,
    word: Option<&CommitWord>,
    interlocks: &mut StartInterlocks,
    now: MonoTime,
) {
    if let Some(word) = word {
        steps.push(steps::of_commit(word));
        interlocks.stored(word, now);
    }
}

/// Whether `word` wears out the drive's memory no faster than is allowed.
pub(super) fn may_wear(
    interlocks: &StartInterlocks,
    word: &CommitWord,
    control: &ControlSettings,
    now: MonoTime,
) -> Result<(), Report> {
    let is_worn = interlocks.was_written_within(control.stored_write_interval, word.address, now);
    if is_worn {
        Err(Report::refused(Reason::WrittenTooOften))
    } else {
        Ok(())
    }
}
