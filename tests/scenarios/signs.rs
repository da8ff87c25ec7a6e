//! Values whose sign counts, with drives that show it as their documents say, whatever the model file says: in reverse the
//! output frequency is a magnitude that falls behind a stop, and a stop that was obeyed is effective after one frame.

use crate::support::families::{accepting, each, options_of, walked};
use crate::support::sheet::{place, sheets};
use crate::support::{MQTT, Rig, RigOptions, STOP, run};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::units::UnitOfMeasure;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::profile::model::{
    FactPart, Model, OrderKind, PollClass, Register, RegisterAccess, RegisterRole,
};
use vfd_gateway::vendors;

const SECOND: Duration = Duration::from_secs(1);
/// What a frequency in tenths or in fractions of a full scale may be off, in hertz.
const ROUNDED: f64 = 0.11;

/// What the sheet of `model` says of the sign of `register`: whether it has one, or both if that is not stated.
fn by_sheet(model: &Model, register: &Register) -> Vec<bool> {
    let Some(sheet) = sheets().into_iter().find(|sheet| sheet.id == model.id) else {
        return Vec::new();
    };
    let row = sheet
        .rows("register")
        .find(|row| place(row.text("at")).0 == register.address);
    row.map(|row| row.signs()).unwrap_or_default()
}

/// How drives of `model` may show reverse in their output frequency: by the sheet, and in both ways where neither it nor
/// the model states the sign.
fn ways(model: &Model) -> Vec<bool> {
    let Some(output) = model.register_for(RegisterRole::OutputFrequency) else {
        return Vec::new();
    };
    match by_sheet(model, output) {
        stated if !stated.is_empty() => stated,
        _ if output.not_stated.contains(&FactPart::Sign) => vec![true, false],
        _ => vec![output.signed],
    }
}

/// A drive that is a `model`, but for the sign of its output frequency.
fn rig(model: &Arc<Model>, signed: bool) -> Rig {
    let mut really = Model::clone(model);
    let output = really
        .registers
        .iter_mut()
        .find(|it| it.role == Some(RegisterRole::OutputFrequency));
    output.expect("it has one").signed = signed;
    Rig::new(&RigOptions {
        really: Some(Arc::new(really)),
        ..options_of(model, accepting())
    })
}

/// The output frequency as clients see it, in hertz.
fn shown(rig: &Rig, model: &Model) -> f64 {
    let output = model
        .register_for(RegisterRole::OutputFrequency)
        .expect("it has one");
    rig.view(0)
        .snapshot
        .value(output)
        .expect("it was read")
        .value
        .value()
}

#[test]
fn in_reverse_the_output_is_a_magnitude_and_a_stop_is_effective_at_once() {
    each(|model| {
        if model.run.is_none() || model.order(OrderKind::Reverse).is_none() {
            return;
        }
        for signed in ways(model) {
            let mut rig = rig(model, signed);
            let told = rig.commanded(MQTT, run(Direction::Reverse, Some(3000)));
            assert!(
                matches!(
                    told,
                    (Outcome::Confirmed | Outcome::Acknowledged, Reason::None)
                ),
                "{told:?}"
            );
            rig.live(SECOND * 8);
            let turning = shown(&rig, model);
            assert!(
                (turning - 30.0).abs() < ROUNDED,
                "signed: {signed}: {turning} Hz is shown"
            );
            assert_eq!(rig.view(0).run_state, RunState::Reverse, "signed: {signed}");
            rig.sent.clear();
            assert_eq!(
                rig.commanded(MQTT, STOP),
                (Outcome::Confirmed, Reason::None),
                "signed: {signed}"
            );
            rig.live(SECOND * 2);
            let slower = shown(&rig, model);
            assert!(
                slower < turning - 1.0,
                "signed: {signed}: {turning} Hz, and {slower} Hz behind the stop"
            );
            assert_eq!(
                rig.writes().len(),
                1,
                "signed: {signed}: {:X?}",
                rig.writes()
            );
        }
    });
}

/// Whether `register` is measured, and may well be below 0 in reverse, while braking or in the cold.
fn may_be_negative(register: &Register) -> bool {
    let is_live =
        register.poll.is_some_and(PollClass::is_live) && register.access == RegisterAccess::Read;
    let by_unit = matches!(
        register.unit,
        UnitOfMeasure::Rpm | UnitOfMeasure::NewtonMetre | UnitOfMeasure::Celsius
    );
    let by_role = matches!(
        register.role,
        Some(RegisterRole::Torque | RegisterRole::OutputPower)
    );
    // A frequency in hundredths of a hertz may use the upper half of its range.
    let is_plain = register.form.full_scale.is_none() && register.form.scale_by.is_none();
    let is_coarse = register.scale / register.form.per <= 50 && is_plain;
    let is_output = register.role == Some(RegisterRole::OutputFrequency) && is_coarse;
    is_live && (by_unit || by_role || is_output)
}

#[test]
fn a_value_that_may_be_negative_is_read_with_its_sign_unless_a_document_denies_it() {
    each(|model| {
        if vendors::catalog().find(&model.id).is_none() {
            return;
        }
        let in_doubt = model
            .registers
            .iter()
            .filter(|it| !it.signed && may_be_negative(it));
        let wrong: Vec<_> = in_doubt
            .filter(|it| by_sheet(model, it) != [false])
            .map(|it| &it.name)
            .collect();
        assert!(wrong.is_empty(), "{wrong:?}");
    });
    let doubtful = walked().iter().flat_map(|model| &model.registers);
    assert!(
        doubtful
            .filter(|it| it.not_stated.contains(&FactPart::Sign))
            .all(|it| it.signed)
    );
}
