//! Decodes a write to a drive's own registers into an order, so that every way to run a motor is reviewed as such.

use super::bases::FrequencyBases;
use crate::domain::address::Address;
use crate::domain::command::{Direction, GoOrder, Order, Reason, RegisterWrite};
use crate::domain::frequency::Hertz;
use crate::profile::model::{Model, OrderKind, OrderedWord, Register, RegisterRole};

/// The meaning of one word of a write.
enum DecodedPart {
    Run(RunPart),
    Direction(Direction),
    Frequency(Result<(Hertz, Option<Direction>), Reason>),
    Register(RegisterWrite),
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum RunPart {
    Stop,
    Go(Direction),
    Coast,
    Reset,
    EndReset,
    Release,
}

/// The order that `values`, written from `address` on, stand for on `model`.
///
/// A stop or a cut-off in a block takes precedence over everything else in it.
///
/// # Errors
/// [`Reason::NotListed`] for an address that the model does not know as writable, [`Reason::NotAllowed`] for a register
/// that decides whom the motor obeys or moves it by another way, [`Reason::NotUnderstood`] for a run value that is not
/// exactly one known command, [`Reason::OutsideRange`] for a word that the register does not take,
/// [`Reason::HalfAValue`] for one word of two, [`Reason::Conflict`] for parts that exclude each other.
pub fn order(model: &Model, address: Address, values: &[u16]) -> Result<Order, Reason> {
    order_on(model, &FrequencyBases::default(), address, values)
}

/// The order in a write of `values` from `address` on, for a drive whose frequencies are fractions of `bases`. A stop
/// beside a setpoint of unknown meaning is a stop.
///
/// # Errors
/// As for [`order`]; also [`Reason::FullScaleUnknown`].
pub fn order_on(
    model: &Model,
    bases: &FrequencyBases,
    address: Address,
    values: &[u16],
) -> Result<Order, Reason> {
    let mut run = None;
    let mut direction = None;
    let mut frequency = None;
    let mut registers = Vec::new();
    let addresses =
        std::iter::successors(Some(address), |address| Some(model.next_address(*address)));
    let mut words = addresses.zip(values);
    while let Some((address, value)) = words.next() {
        if let Some(register) = model
            .writable_at(address)
            .filter(|register| register.form.pair.is_some())
        {
            let (_, second) = words.next().ok_or(Reason::HalfAValue)?;
            match pair(register, [*value, *second])? {
                DecodedPart::Frequency(hertz) => frequency = Some(hertz),
                DecodedPart::Register(write) => registers.push(write),
                DecodedPart::Run(_) | DecodedPart::Direction(_) => {}
            }
            continue;
        }
        match part(model, bases, address, *value)? {
            DecodedPart::Run(part) => run = Some(together(run, part)?),
            DecodedPart::Direction(given) => direction = Some(given),
            DecodedPart::Frequency(hertz) => frequency = Some(hertz),
            DecodedPart::Register(write) => registers.push(write),
        }
    }
    let alone = registers.is_empty();
    let frequency = match frequency.transpose() {
        Err(_) if run == Some(RunPart::Stop) => None,
        known => known?,
    };
    let (frequency, sign) = frequency.unzip();
    let sign = sign.flatten();
    if frequency.is_some() && matches!(run, Some(RunPart::Go(_))) && model.turns_by_sign() {
        direction = Some(sign.unwrap_or(Direction::Forward));
    }
    // The direction is part of an order to run, and where a model has it, an order to run is none without it.
    let is_half = match run {
        Some(RunPart::Go(_)) => direction.is_none() && has_direction(model),
        Some(RunPart::Stop | RunPart::Coast) => false,
        _ => direction.is_some(),
    };
    if is_half {
        return Err(Reason::NotUnderstood);
    }
    match run {
        Some(RunPart::Stop) if alone => Ok(Order::Stop {
            setpoint: frequency,
        }),
        Some(RunPart::Coast) if alone => Ok(Order::Coast),
        Some(RunPart::Reset) if alone && frequency.is_none() => Ok(Order::Reset),
        Some(RunPart::Release) if alone && frequency.is_none() => Ok(Order::Release),
        Some(RunPart::Stop | RunPart::Coast | RunPart::Reset | RunPart::Release) => {
            Err(Reason::Conflict)
        }
        Some(RunPart::Go(by_word)) => go(registers, frequency, Some(direction.unwrap_or(by_word))),
        Some(RunPart::EndReset) if alone && frequency.is_none() => Ok(Order::EndReset),
        Some(RunPart::EndReset) | None => Ok(match go(registers, frequency, None)? {
            Order::Go(go) => Order::Go(go.with_sign(sign)),
            other => other,
        }),
    }
}

/// Whether the model allows `write` as a plain register write, once it is listed.
///
/// # Errors
/// As for [`order`]; also [`Reason::NotAllowed`] for the registers that commands are written to.
pub fn register(model: &Model, write: RegisterWrite) -> Result<(), Reason> {
    let of_two = model
        .writable_at(write.address)
        .filter(|register| register.form.pair.is_some());
    let part = match (of_two, write.second) {
        (Some(register), Some(second)) => pair(register, [write.value, second])?,
        (None, None) => part(
            model,
            &FrequencyBases::default(),
            write.address,
            write.value,
        )?,
        (Some(_), None) | (None, Some(_)) => return Err(Reason::HalfAValue),
    };
    match part {
        DecodedPart::Register(_) => Ok(()),
        DecodedPart::Run(_) | DecodedPart::Direction(_) | DecodedPart::Frequency(_) => {
            Err(Reason::NotAllowed)
        }
    }
}

fn go(
    registers: Vec<RegisterWrite>,
    frequency: Option<Hertz>,
    run: Option<Direction>,
) -> Result<Order, Reason> {
    GoOrder::new(registers, frequency, run)
        .map(Order::Go)
        .ok_or(Reason::TooManyFrames)
}

fn part(
    model: &Model,
    bases: &FrequencyBases,
    address: Address,
    value: u16,
) -> Result<DecodedPart, Reason> {
    if model.second_word_at(address).is_some() {
        return Err(Reason::HalfAValue);
    }
    let register = model
        .writable_at(address)
        .or_else(|| model.stored_twin(address));
    let register = register.or_else(|| model.in_ram_at(address));
    let register = register
        .filter(|register| register.access.can_write())
        .ok_or(Reason::NotListed)?;
    let is_twin = register.address != address;
    match register.role {
        _ if register.back_door.is_some() => Err(Reason::NotAllowed),
        _ if register.form.pair.is_some() => Err(Reason::HalfAValue),
        // A setpoint goes to its form in RAM wherever a client writes it.
        Some(RegisterRole::FrequencyCommand) if model.ram_form(register) == Some(address) => Ok(
            DecodedPart::Frequency(signed_frequency(model, register, bases, value)),
        ),
        Some(role) if is_twin && role.is_guarded() => Err(Reason::NotAllowed),
        Some(RegisterRole::RunCommand | RegisterRole::Order) => {
            order_part(model, register.address, value).ok_or(Reason::NotUnderstood)
        }
        Some(RegisterRole::FrequencyCommand) => Ok(DecodedPart::Frequency(signed_frequency(
            model, register, bases, value,
        ))),
        Some(role) if role.is_guarded() => Err(Reason::NotAllowed),
        _ if !register.takes(value) => Err(Reason::OutsideRange),
        _ => Ok(DecodedPart::Register(RegisterWrite::new(address, value))),
    }
}

/// The frequency that `value` orders, and the direction, if the drive turns by its sign.
fn signed_frequency(
    model: &Model,
    register: &Register,
    bases: &FrequencyBases,
    value: u16,
) -> Result<(Hertz, Option<Direction>), Reason> {
    if !model.turns_by_sign() {
        return Ok((frequency(register, bases, value)?, None));
    }
    let number = value.cast_signed();
    let direction = match number {
        0 => None,
        1.. => Some(Direction::Forward),
        _ => Some(Direction::Reverse),
    };
    Ok((
        frequency(register, bases, number.unsigned_abs())?,
        direction,
    ))
}

/// The frequency that `value` orders. It must lead back to the same word, so that what is sent is what was written.
fn frequency(register: &Register, bases: &FrequencyBases, value: u16) -> Result<Hertz, Reason> {
    if register.is_exact() && !register.signed {
        return Ok(Hertz::from_word(value, register.scale));
    }
    let known = |address| bases.word(address);
    if register
        .form
        .bases()
        .any(|address| known(address).is_none())
    {
        return Err(Reason::FullScaleUnknown);
    }
    let hertz = register
        .frequency(value, known)
        .ok_or(Reason::NotUnderstood)?;
    let anywhere = (Hertz::ZERO, Hertz::from_millihertz(u32::MAX));
    let is_same = register.word_of(hertz, anywhere, known) == Some(value);
    if is_same {
        Ok(hertz)
    } else {
        Err(Reason::BetweenSteps)
    }
}

/// The meaning of both words of a value.
fn pair(register: &Register, words: [u16; 2]) -> Result<DecodedPart, Reason> {
    match register.role {
        _ if register.back_door.is_some() => Err(Reason::NotAllowed),
        Some(RegisterRole::FrequencyCommand) => Ok(DecodedPart::Frequency(Ok((
            frequency_of_pair(register, words)?,
            None,
        )))),
        Some(role) if role.is_guarded() => Err(Reason::NotAllowed),
        _ if !register.takes_both(words) => Err(Reason::OutsideRange),
        _ => Ok(DecodedPart::Register(RegisterWrite::pair(
            register.address,
            words,
        ))),
    }
}

/// The frequency that both words of a setpoint order. It must lead back to the same words.
fn frequency_of_pair(register: &Register, words: [u16; 2]) -> Result<Hertz, Reason> {
    let number = register
        .number(|address| address.word_in(register.address, &words))
        .ok_or(Reason::NotUnderstood)?;
    let hertz = register
        .magnitude(number, |_| None)
        .ok_or(Reason::OutsideRange)?;
    if register.pair_of(hertz) == Some(words) {
        Ok(hertz)
    } else {
        Err(Reason::BetweenSteps)
    }
}

/// What `value` orders in the register at `address`, which takes orders.
fn order_part(model: &Model, address: Address, value: u16) -> Option<DecodedPart> {
    if let Some(words) = model.direction_at(address) {
        let direction = match value {
            it if it == words.forward => Direction::Forward,
            it if Some(it) == words.reverse => Direction::Reverse,
            _ => return None,
        };
        return Some(DecodedPart::Direction(direction));
    }
    let kind = model
        .orders_at(address)
        .find(|(_, fact)| fact.value == value)
        .map(|(kind, _)| kind);
    let clears = || {
        let clear = model.reset_clears()?;
        ((clear.address, clear.value) == (address, value)).then_some(RunPart::EndReset)
    };
    let part = match kind {
        Some(OrderKind::Stop) => RunPart::Stop,
        Some(OrderKind::Forward) => RunPart::Go(Direction::Forward),
        Some(OrderKind::Reverse) => RunPart::Go(Direction::Reverse),
        Some(OrderKind::Coast) => RunPart::Coast,
        Some(OrderKind::Reset) => RunPart::Reset,
        Some(OrderKind::Release) => RunPart::Release,
        None => clears().or_else(|| other_word(model, address, value))?,
    };
    Some(DecodedPart::Run(part))
}

/// What the run command `value` orders although it is not the word of an order: a word of zeros.
fn other_word(model: &Model, address: Address, value: u16) -> Option<RunPart> {
    if !model.takes_run_commands(address) {
        return None;
    }
    let run = model.run.as_ref()?;
    Some(match run.order_in(value)? {
        OrderedWord::Stop => RunPart::Stop,
        OrderedWord::Coast => RunPart::Coast,
        OrderedWord::Release => RunPart::Release,
        OrderedWord::Reset | OrderedWord::Go(_) => return None,
    })
}

/// The order of two words for different registers in one block: a stop counts before all others, a cleared reset orders
/// nothing.
///
/// # Errors
/// [`Reason::Conflict`]
fn together(first: Option<RunPart>, second: RunPart) -> Result<RunPart, Reason> {
    let Some(first) = first else {
        return Ok(second);
    };
    let both = [first, second];
    for stops in [RunPart::Stop, RunPart::Coast] {
        if both.contains(&stops) {
            return Ok(stops);
        }
    }
    match both {
        [RunPart::EndReset, other] | [other, RunPart::EndReset] => Ok(other),
        [one, other] if one == other => Ok(one),
        _ => Err(Reason::Conflict),
    }
}

fn has_direction(model: &Model) -> bool {
    model
        .run
        .as_ref()
        .is_some_and(|run| run.places.direction.is_some() || run.places.by_sign)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vendors::testing::model;

    fn run(direction: Direction) -> Order {
        Order::Go(GoOrder::new(Vec::new(), None, Some(direction)).unwrap())
    }

    #[test]
    fn each_run_value_is_exactly_one_order() {
        let model = model();
        let orders = [
            (0, Ok(Order::Stop { setpoint: None })),
            (1, Ok(run(Direction::Forward))),
            (2, Ok(run(Direction::Reverse))),
            (3, Ok(Order::Coast)),
            (4, Ok(Order::Reset)),
            (5, Err(Reason::NotUnderstood)),
            (0x0101, Err(Reason::NotUnderstood)),
        ];
        for (value, expected) in orders {
            assert_eq!(
                order(&model, 0x0002_u16.into(), &[value]),
                expected,
                "{value}"
            );
        }
    }

    #[test]
    fn registers_and_back_doors_are_distinguished() {
        let model = model();
        let setpoint = GoOrder::new(Vec::new(), Some(Hertz::from_centihertz(6000)), None).unwrap();
        assert_eq!(
            order(&model, 0x0004_u16.into(), &[6000]),
            Ok(Order::Go(setpoint))
        );
        let ramp = GoOrder::new(vec![RegisterWrite::new(0x020C_u16, 100)], None, None).unwrap();
        assert_eq!(
            order(&model, 0x020C_u16.into(), &[100]),
            Ok(Order::Go(ramp))
        );
        assert_eq!(
            order(&model, 0x0211_u16.into(), &[3]),
            Err(Reason::NotAllowed),
            "F010 frequency source"
        );
        assert_eq!(
            order(&model, 0x0212_u16.into(), &[1]),
            Err(Reason::NotAllowed),
            "F011 run source"
        );
        assert_eq!(
            order(&model, 0x0201_u16.into(), &[6000]),
            Err(Reason::NotListed),
            "F001 is not writable"
        );
        assert_eq!(
            order(&model, 0x0002_u16.into(), &[1, 0]),
            Err(Reason::NotListed),
            "0x0003 is not known"
        );
        assert_eq!(
            order(&model, 0x1234_u16.into(), &[1]),
            Err(Reason::NotListed)
        );
    }
    #[test]
    fn the_sign_of_a_setpoint_is_the_direction_where_a_drive_turns_by_it() {
        let mut model = model();
        model.run.as_mut().unwrap().places.by_sign = true;
        for register in model
            .registers
            .iter_mut()
            .filter(|it| it.role == Some(RegisterRole::FrequencyCommand))
        {
            register.address = 0x0003_u16.into();
            register.signed = true;
            register.form.sign_is_direction = true;
        }
        model.registers.sort_by_key(|it| it.address);
        let go = |run, toward| {
            let go = GoOrder::new(Vec::new(), Some(Hertz::from_centihertz(3000)), run).unwrap();
            Ok(Order::Go(go.with_sign(toward)))
        };
        let (forward, reverse) = (Direction::Forward, Direction::Reverse);
        let below = (-3000_i16).cast_unsigned();
        let at = |address: u16, words: &[u16]| order(&model, address.into(), words);
        assert_eq!(at(2, &[1, 3000]), go(Some(forward), None));
        assert_eq!(at(2, &[1, below]), go(Some(reverse), None));
        assert_eq!(at(3, &[3000]), go(None, Some(forward)));
        assert_eq!(at(3, &[below]), go(None, Some(reverse)));
        assert_eq!(
            at(2, &[1]),
            Err(Reason::NotUnderstood),
            "it says no direction"
        );
        assert_eq!(
            at(3, &[0x8000]),
            Err(Reason::NotUnderstood),
            "it has no magnitude in the register"
        );
        assert_eq!(
            at(2, &[0, below]),
            Ok(Order::Stop {
                setpoint: Some(Hertz::from_centihertz(3000))
            })
        );
        let zero = GoOrder::new(Vec::new(), Some(Hertz::ZERO), None).unwrap();
        assert_eq!(at(3, &[0]), Ok(Order::Go(zero)));
    }

    #[test]
    fn a_stored_twin_counts_as_its_register() {
        let mut model = model();
        let exists = crate::vendors::testing::fact(15);
        assert_eq!(
            order(&model, 0x820C_u16.into(), &[100]),
            Err(Reason::NotListed),
            "the model has no twins"
        );
        model.quirks.stored_alias_bit = Some(exists);
        let ramp = GoOrder::new(vec![RegisterWrite::new(0x820C_u16, 100)], None, None).unwrap();
        assert_eq!(
            order(&model, 0x820C_u16.into(), &[100]),
            Ok(Order::Go(ramp))
        );
        for guarded in [0x8002, 0x8004, 0x8211, 0x8212] {
            assert_eq!(
                order(&model, guarded.into(), &[1]),
                Err(Reason::NotAllowed),
                "{guarded:04X}"
            );
        }
    }

    #[test]
    fn a_back_door_stays_shut_and_a_range_is_kept() {
        let mut model = model();
        for register in model
            .registers
            .iter_mut()
            .filter(|register| register.access.can_write())
        {
            match register.address.number() {
                0x020C => register.back_door = Some("another way in".to_owned()),
                0x020E => register.range = Some(1..=30_000),
                _ => {}
            }
        }
        assert_eq!(
            order(&model, 0x020C_u16.into(), &[100]),
            Err(Reason::NotAllowed)
        );
        assert_eq!(
            order(&model, 0x020E_u16.into(), &[0]),
            Err(Reason::OutsideRange)
        );
        assert!(order(&model, 0x020E_u16.into(), &[1]).is_ok());
    }
}
