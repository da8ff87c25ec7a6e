//! Tests of the steps of orders.

use super::*;
use crate::profile::model::RegisterRole;
use crate::vendors::testing::{control, model, with_block, with_status};

fn hertz(centi: u16) -> Hertz {
    Hertz::from_centihertz(centi)
}

fn write(address: u16, value: u16, part: StepPart, shown: Vec<RegisterCondition>) -> WriteStep {
    WriteStep {
        address: address.into(),
        value,
        part,
        shown,
    }
}

fn one(address: u16, value: u16, part: StepPart, shown: Vec<RegisterCondition>) -> CommandStep {
    CommandStep::Write(vec![write(address, value, part, shown)])
}

fn run_forward() -> GoOrder {
    GoOrder::new(Vec::new(), None, Some(Direction::Forward)).unwrap()
}

#[test]
fn setpoint_goes_before_run() {
    let go = GoOrder::new(Vec::new(), Some(hertz(4250)), Some(Direction::Forward)).unwrap();
    let shown = RegisterCondition::holds(0x0201_u16.into(), vec![4250], SHOWN_WITHIN);
    let setpoint = one(0x0004, 4250, StepPart::Setpoint(hertz(4250)), vec![shown]);
    let run = one(0x0002, 1, StepPart::Run(Direction::Forward), vec![]);
    assert_eq!(
        of_go(&model(), &go, &control(), None, &FrequencyBases::default()).unwrap(),
        [setpoint, run]
    );
}

#[test]
fn setpoint_and_run_share_a_frame_where_the_model_allows_it() {
    let go = GoOrder::new(Vec::new(), Some(hertz(4250)), Some(Direction::Forward)).unwrap();
    let steps = of_go(
        &with_block(),
        &go,
        &control(),
        None,
        &FrequencyBases::default(),
    )
    .unwrap();
    let [CommandStep::Write(writes)] = &steps[..] else {
        panic!("{steps:?}")
    };
    let words: Vec<_> = writes
        .iter()
        .map(|write| (write.address.number(), write.value))
        .collect();
    assert_eq!(words, [(0x0002, 1), (0x0003, 4250)]);
}

#[test]
fn run_alone_looks_at_the_drives_own_setting_first() {
    let go = GoOrder::new(Vec::new(), None, Some(Direction::Reverse)).unwrap();
    let check = CommandStep::Check {
        address: 0x0201_u16.into(),
        least: 500,
        most: 5000,
        reason: Reason::SetpointUnknown,
    };
    let run = one(0x0002, 2, StepPart::Run(Direction::Reverse), vec![]);
    assert_eq!(
        of_go(
            &model(),
            &go,
            &control(),
            Some(hertz(3000)),
            &FrequencyBases::default()
        )
        .unwrap(),
        [check, run]
    );
}

#[test]
fn a_setpoint_that_cannot_be_relied_on_is_written_before_each_run() {
    let mut model = model();
    model
        .registers
        .retain(|register| register.role != Some(RegisterRole::FrequencySetting));
    assert_eq!(
        of_go(
            &model,
            &run_forward(),
            &control(),
            None,
            &FrequencyBases::default()
        ),
        Err(NoSteps::SetpointUnknown)
    );
    let steps = of_go(
        &model,
        &run_forward(),
        &control(),
        Some(hertz(3000)),
        &FrequencyBases::default(),
    )
    .unwrap();
    let setpoint = one(0x0004, 3000, StepPart::Setpoint(hertz(3000)), vec![]);
    assert_eq!(
        steps,
        [
            setpoint,
            one(0x0002, 1, StepPart::Run(Direction::Forward), vec![])
        ]
    );
}

#[test]
fn run_is_shown_by_the_status_word_where_there_is_one() {
    let steps = of_go(
        &with_status(),
        &run_forward(),
        &control(),
        None,
        &FrequencyBases::default(),
    )
    .unwrap();
    let [_, CommandStep::Write(writes)] = &steps[..] else {
        panic!("{steps:?}")
    };
    let [running, reverse] = &writes[0].shown[..] else {
        panic!("{writes:?}")
    };
    assert!(running.is_met(0b0001) && !running.is_met(0b0100));
    assert!(reverse.is_met(0b0001) && !reverse.is_met(0b0011));
}

#[test]
fn a_register_is_read_back() {
    let ramp = RegisterWrite::new(0x020C_u16, 100);
    let steps = of_go(
        &model(),
        &GoOrder::new(vec![ramp], None, None).unwrap(),
        &control(),
        None,
        &FrequencyBases::default(),
    )
    .unwrap();
    let shown = RegisterCondition::holds(0x020C_u16.into(), vec![100], Duration::ZERO);
    assert_eq!(steps, [one(0x020C, 100, StepPart::Register, vec![shown])]);
}

#[test]
fn a_reset_never_carries_a_run_order() {
    let reset = |value, ends, shown| {
        one(
            0x0002,
            value,
            StepPart::Reset {
                resets: value == 4,
                ends,
                is_seen: false,
            },
            shown,
        )
    };
    let still = RegisterCondition::holds(0x0101_u16.into(), vec![0], Duration::ZERO);
    let expected = [
        reset(0, false, vec![]),
        reset(4, false, vec![]),
        reset(0, true, vec![still]),
    ];
    assert_eq!(of_reset(&model()).unwrap(), expected);
}

#[test]
fn only_what_the_model_asks_for_is_set_up() {
    let mut model = model();
    assert_eq!(
        of_setup(&model, &[0x020C_u16.into()]),
        Err(NoSteps::NotCapable)
    );
    model.setup = crate::vendors::testing::setup();
    let steps = of_setup(&model, &[0x0212_u16.into(), 0x0211_u16.into()]).unwrap();
    let words = steps.iter().map(|step| match step {
        CommandStep::Write(writes) => (writes[0].address.number(), writes[0].value),
        other => panic!("{other:?}"),
    });
    assert_eq!(
        words.collect::<Vec<_>>(),
        [(0x0211, 3), (0x0212, 3)],
        "in the model's order"
    );
    assert_eq!(of_release(&model), Err(NoSteps::NotCapable));
}

#[test]
fn what_the_register_cannot_hold_is_refused() {
    let fine = GoOrder::new(Vec::new(), Some(Hertz::from_millihertz(42_505)), None).unwrap();
    assert_eq!(
        of_go(
            &model(),
            &fine,
            &control(),
            None,
            &FrequencyBases::default()
        ),
        Err(NoSteps::BetweenSteps)
    );
}
