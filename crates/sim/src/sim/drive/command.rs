//! Meaning of a word in the run command register.

use crate::domain::address::Address;
use crate::profile::model::{
    BitMeaning, Model, OrderKind, RegisterRole, RunCommand, RunField, RunForm, ZeroWord,
};

/// The orders in a run command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct SimRunOrder {
    pub(super) motion: MotorMotion,
    /// The motor runs at the jog frequency.
    pub(super) jog: bool,
    pub(super) coast: bool,
    pub(super) trip: bool,
    pub(super) reset: bool,
    /// Returns control to panel and terminals.
    pub(super) release: bool,
    /// Makes the drive obey the bus whatever its source registers say.
    pub(super) bus_run: bool,
    /// Makes the drive take its frequency from the bus whatever its source registers say.
    pub(super) bus_frequency: bool,
    /// Everything else stays unchanged: the word is one command, not a set of states.
    pub(super) is_one_command: bool,
    /// The drive answers as if it had taken the word, and does nothing with it.
    pub(super) is_ignored: bool,
}

/// How the motor is ordered to turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum MotorMotion {
    /// Down to standstill.
    #[default]
    Stop,
    /// 1 forward, -1 reverse.
    Run(i64),
    /// The motion as before; in this direction if it runs and the word says one.
    Keep(Option<i64>),
    /// The other way round.
    Toggle,
    /// At the frequency that it has now.
    Freeze,
}

/// The orders in `word`, written to `address`; `None` if it has no meaning there.
pub(super) fn run_order_in(model: &Model, address: Address, word: u16) -> Option<SimRunOrder> {
    let run = model.run.as_ref()?;
    let is_own = model
        .register_for(RegisterRole::RunCommand)
        .is_some_and(|it| it.address == address);
    match &run.form {
        RunForm::Bits { bits, fields, .. } if is_own => {
            let mut meanings = Vec::new();
            for bit in 0..16 {
                let is_set = word & (1 << bit) != 0;
                match bits.iter().find(|it| u16::from(it.bit.value) == bit) {
                    Some(known) => {
                        meanings.extend((is_set != known.is_inverted).then_some(known.meaning))
                    }
                    None if is_set
                        && fields
                            .iter()
                            .all(|field| field.mask.value & (1 << bit) == 0) =>
                    {
                        return None;
                    }
                    None => {}
                }
            }
            for field in fields {
                meanings.extend(in_field(field, word)?);
            }
            let latches = bits.iter().any(|it| it.meaning == BitMeaning::Stop)
                || fields.iter().any(|field| {
                    field
                        .values
                        .iter()
                        .any(|(_, it)| *it == Some(BitMeaning::Stop))
                });
            states(run, &meanings, latches)
        }
        RunForm::Values | RunForm::Bits { .. } => match one_command(model, address, word) {
            None if word == 0 && is_own => zero_command(run),
            order => order,
        },
    }
}

/// The meaning of `word` in `field`, if it has one there; `None` if the value is not known.
fn in_field(field: &RunField, word: u16) -> Option<Option<BitMeaning>> {
    let mask = field.mask.value;
    let value = (0..16).filter(|bit| mask & (1 << bit) != 0).enumerate();
    let value = value.fold(0, |value, (place, bit)| value | (word >> bit & 1) << place);
    field
        .values
        .iter()
        .find(|(known, _)| *known == value)
        .map(|(_, meaning)| *meaning)
}

/// Whether the model's words can take control whatever the drive's source registers say.
pub(super) fn has_priority(run: &RunCommand) -> bool {
    let takes = |meaning| matches!(meaning, BitMeaning::BusRun | BitMeaning::BusFrequency);
    matches!(&run.form, RunForm::Bits { bits, .. } if bits.iter().any(|it| takes(it.meaning)))
}

fn one_command(model: &Model, address: Address, word: u16) -> Option<SimRunOrder> {
    let none = SimRunOrder {
        is_one_command: true,
        ..SimRunOrder::default()
    };
    let (kind, _) = model
        .orders_at(address)
        .find(|(_, fact)| fact.value == word)?;
    Some(match kind {
        OrderKind::Stop => none,
        OrderKind::Forward => SimRunOrder {
            motion: MotorMotion::Run(1),
            ..none
        },
        OrderKind::Reverse => SimRunOrder {
            motion: MotorMotion::Run(-1),
            ..none
        },
        OrderKind::Coast => SimRunOrder {
            coast: true,
            ..none
        },
        OrderKind::Reset => SimRunOrder {
            reset: true,
            ..none
        },
        OrderKind::Release => SimRunOrder {
            release: true,
            ..none
        },
    })
}

/// What a word of zeros does that is no command of its own.
fn zero_command(run: &RunCommand) -> Option<SimRunOrder> {
    let none = SimRunOrder {
        is_one_command: true,
        ..SimRunOrder::default()
    };
    Some(match run.zero.as_ref()?.value {
        ZeroWord::Stop => none,
        ZeroWord::Coast => SimRunOrder {
            coast: true,
            ..none
        },
        ZeroWord::Nothing => SimRunOrder {
            motion: MotorMotion::Keep(None),
            ..none
        },
        ZeroWord::Ignored => SimRunOrder {
            is_ignored: true,
            ..none
        },
        ZeroWord::Release => SimRunOrder {
            release: true,
            ..none
        },
    })
}

/// The orders of these states. If the drive `latches`, a run order stays until a stop.
fn states(run: &RunCommand, meanings: &[BitMeaning], latches: bool) -> Option<SimRunOrder> {
    use BitMeaning::{
        BusFrequency, BusRun, Coast, DcBrake, Forward, Freeze, Ignored, Jog, QuickStop, Reset,
        Reverse, Run, RunForward, RunReverse, Stop, Toggle, Trip,
    };
    let has = |meaning| meanings.contains(&meaning);
    if has(Ignored) {
        return Some(SimRunOrder {
            is_ignored: true,
            ..SimRunOrder::default()
        });
    }
    let stops = has(Stop) || has(QuickStop) || has(DcBrake);
    let forward = has(Forward) || has(RunForward);
    let reverse = has(Reverse) || has(RunReverse);
    let said = forward.then_some(1).or(reverse.then_some(-1));
    let turns = has(Run) || has(RunForward) || has(RunReverse) || has(Jog);
    let motion = match (stops, turns) {
        (true, _) => MotorMotion::Stop,
        _ if has(Coast) || has(Trip) => MotorMotion::Stop,
        _ if has(Freeze) => MotorMotion::Freeze,
        _ if has(Toggle) => MotorMotion::Toggle,
        // Both at once mean nothing to a motor that may turn.
        _ if forward && reverse && (turns || latches) => return None,
        (_, true) => MotorMotion::Run(said.unwrap_or_else(|| unsaid(run))),
        _ if latches => MotorMotion::Keep(said),
        _ => MotorMotion::Stop,
    };
    Some(SimRunOrder {
        motion,
        jog: has(Jog),
        coast: has(Coast),
        trip: has(Trip),
        reset: has(Reset),
        release: false,
        bus_run: has(BusRun),
        bus_frequency: has(BusFrequency),
        is_one_command: false,
        is_ignored: false,
    })
}

/// The direction of a word that says none: forward, unless only forward has a bit of its own.
fn unsaid(run: &RunCommand) -> i64 {
    let RunForm::Bits { bits, fields, .. } = &run.form else {
        return 1;
    };
    let of_bits = bits.iter().map(|bit| bit.meaning);
    let of_fields = fields
        .iter()
        .flat_map(|field| field.values.iter().filter_map(|(_, meaning)| *meaning));
    let known: Vec<_> = of_bits.chain(of_fields).collect();
    if known.contains(&BitMeaning::Forward) && !known.contains(&BitMeaning::Reverse) {
        -1
    } else {
        1
    }
}
