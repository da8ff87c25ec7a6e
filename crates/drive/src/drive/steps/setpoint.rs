//! How a setpoint is written, alone or before the run word, and how the drive shows it.

use super::{CommandStep, NoSteps, RegisterCondition, SHOWN_WITHIN, StepPart, WriteStep};
use crate::domain::command::{Direction, GoOrder, Reason};
use crate::domain::control::ControlSettings;
use crate::domain::frequency::Hertz;
use crate::drive::bases::FrequencyBases;
use crate::profile::model::{Model, Register, RegisterRole};

/// The write of a setpoint: one word, or both words of a pair. On a drive that turns by its sign, it is below 0 for reverse.
pub(super) fn setpoint(
    model: &Model,
    frequency: Hertz,
    toward: Direction,
    control: &ControlSettings,
    bases: &FrequencyBases,
) -> Result<Vec<WriteStep>, NoSteps> {
    let register = model
        .register_for(RegisterRole::FrequencyCommand)
        .ok_or(NoSteps::NotCapable)?;
    let write = |address, value, shown: &Option<RegisterCondition>| WriteStep {
        address,
        value,
        part: StepPart::Setpoint(frequency),
        shown: shown.clone().into_iter().collect(),
    };
    if register.form.pair.is_some() {
        let [first, second] = register.pair_of(frequency).ok_or(NoSteps::BetweenSteps)?;
        let next = register.address.checked_add(1).ok_or(NoSteps::NotCapable)?;
        let shown = model
            .setting_register()
            .and_then(|setting| shows(setting, frequency));
        return Ok(vec![
            write(register.address, first, &shown),
            write(next, second, &shown),
        ]);
    }
    let known = |address| bases.word(address);
    let value = register
        .word_of(frequency, (control.least, control.most), known)
        .ok_or(NoSteps::BetweenSteps)?;
    let signed = |word: u16| match toward {
        Direction::Reverse if model.turns_by_sign() => word.wrapping_neg(),
        Direction::Forward | Direction::Reverse => word,
    };
    let shown = model.setting_register().and_then(|setting| {
        if setting.form.pair.is_some() {
            return shows(setting, frequency);
        }
        let words = setpoint_words(register, setting, frequency, value, bases)?;
        Some(RegisterCondition::holds(
            setting.address,
            words.into_iter().map(signed).collect(),
            SHOWN_WITHIN,
        ))
    });
    Ok(vec![write(
        model.cyclic_address(register),
        signed(value),
        &shown,
    )])
}

/// The effect that `setting` shows `frequency`; `None` if it does not hold it exactly.
fn shows(setting: &Register, frequency: Hertz) -> Option<RegisterCondition> {
    if let Some([first, second]) = setting.pair_of(frequency) {
        let condition = RegisterCondition::holds(setting.address, vec![first], SHOWN_WITHIN);
        return Some(RegisterCondition {
            second: Some(second),
            ..condition
        });
    }
    if setting.form.pair.is_some() || !setting.is_exact() {
        return None;
    }
    let word = frequency.to_word(setting.scale)?;
    Some(RegisterCondition::holds(
        setting.address,
        vec![word],
        SHOWN_WITHIN,
    ))
}

/// The words with which `setting` may show `frequency` once `register` has been given `value`.
fn setpoint_words(
    register: &Register,
    setting: &Register,
    frequency: Hertz,
    value: u16,
    bases: &FrequencyBases,
) -> Option<Vec<u16>> {
    if register.is_exact() && setting.is_exact() {
        return Some(vec![frequency.to_word(setting.scale)?]);
    }
    if register.scale == setting.scale && register.form == setting.form {
        return Some(vec![value]);
    }
    let words = setting.words_like(register, value, |address| bases.word(address));
    Some(words).filter(|words| !words.is_empty())
}

/// The setpoint that is sent with RUN; `None` if the drive's own is checked instead.
pub(super) fn setpoint_of_run(
    model: &Model,
    go: &GoOrder,
    last: Option<Hertz>,
) -> Result<Option<Hertz>, NoSteps> {
    // A range of words can be checked, a range of pairs is not; a sign that orders the direction is given again.
    let is_checked = model
        .setting_register()
        .is_some_and(|setting| setting.form.pair.is_none());
    let must_be_given =
        model.quirks.setpoint_before_run.is_some() || !is_checked || model.turns_by_sign();
    match go.frequency() {
        Some(frequency) => Ok(Some(frequency)),
        None if must_be_given => last.map(Some).ok_or(NoSteps::SetpointUnknown),
        None => Ok(None),
    }
}

pub(super) fn setpoint_and_run(
    model: &Model,
    setpoint: Vec<WriteStep>,
    run: WriteStep,
) -> Vec<CommandStep> {
    let setpoint = match <[WriteStep; 1]>::try_from(setpoint) {
        Ok([setpoint]) => setpoint,
        Err(pair) => return vec![CommandStep::Write(pair), CommandStep::Write(vec![run])],
    };
    let low = setpoint.address.min(run.address);
    let high = setpoint.address.max(run.address);
    let block = model
        .write
        .block
        .as_ref()
        .filter(|block| block.count.confidence.is_proven());
    let in_one_frame = block.is_some_and(|block| {
        let end = block.address.saturating_add(block.count.value);
        low.checked_add(1) == Some(high)
            && (block.address..end).contains(&low)
            && (block.address..end).contains(&high)
    });
    match (in_one_frame, setpoint.address == low) {
        (true, true) => vec![CommandStep::Write(vec![setpoint, run])],
        (true, false) => vec![CommandStep::Write(vec![run, setpoint])],
        (false, _) => vec![
            CommandStep::Write(vec![setpoint]),
            CommandStep::Write(vec![run]),
        ],
    }
}

/// The drive's own setting must lie within the limits: least rounded up, most rounded down to its steps.
pub(super) fn check_setting(
    model: &Model,
    control: &ControlSettings,
    bases: &FrequencyBases,
) -> Result<CommandStep, NoSteps> {
    let setting = model.setting_register().ok_or(NoSteps::NotCapable)?;
    let words = setting.words_within((control.least, control.most), |address| bases.word(address));
    let (least, most) = words.ok_or(NoSteps::BetweenSteps)?;
    Ok(CommandStep::Check {
        address: setting.address,
        least,
        most,
        reason: Reason::SetpointUnknown,
    })
}
