//! What a write to a uniform unit orders.

use super::super::ask::{ModbusRequest, PackedBits};
use super::address;
use crate::domain::command::{Direction, GoOrder, Order, Reason, RunIntent};
use crate::domain::frequency::Hertz;
use crate::drive::view::ControlView;

/// Values of the run command register.
pub mod run {
    /// Decelerate and stop.
    pub const STOP: u16 = 0;
    /// Run forward.
    pub const FORWARD: u16 = 1;
    /// Run in reverse.
    pub const REVERSE: u16 = 2;
    /// Cut the output off.
    pub const COAST: u16 = 3;
    /// Reset a trip.
    pub const RESET: u16 = 4;
    /// Hand control back to panel or terminals.
    pub const RELEASE: u16 = 5;
    /// Take control over from its owner.
    pub const TAKE: u16 = 6;
}

/// The order in `ask`; `None` if it orders nothing. `control` holds what words 256 and 257 read.
///
/// One request is one order. A stop wins over everything else in the request:
///
/// * A setpoint beside STOP is sent with it; beside COAST it is not taken, because none follows what is not effective, nor
///   beside a reset, which moves nothing.
/// * Among coils, off on 0 or 1 is STOP unless the other of them is on in the same request; coil 3 is STOP
///   whatever else the request contains; and a request that stops does not reset.
///
/// # Errors
/// `not_capable` if `ask` does not write; `not_listed` outside of what can be written; `not_understood` for an unknown
/// run value; `conflict` for both directions at once, a reset together with RUN, or a release or take-over together
/// with a setpoint; `setpoint_unknown` for a mask on an unknown setpoint.
pub(super) fn order_in(
    ask: &ModbusRequest,
    control: Option<&ControlView>,
) -> Result<Option<Order>, Reason> {
    match ask {
        ModbusRequest::WriteCoil { address, on } => coils(*address, 1, |_| Some(*on)),
        ModbusRequest::WriteCoils { address, values } => coils_of(*address, values),
        ModbusRequest::WriteWord { address, value } => words(*address, std::slice::from_ref(value)),
        ModbusRequest::WriteWords { address, values }
        | ModbusRequest::ReadWriteWords {
            address, values, ..
        } => words(*address, values),
        ModbusRequest::MaskWord { address, and, or } => masked(*address, *and, *or, control),
        ModbusRequest::ReadBits { .. }
        | ModbusRequest::ReadWords { .. }
        | ModbusRequest::LoopTest { .. }
        | ModbusRequest::Identify { .. } => Err(Reason::NotCapable),
    }
}

fn words(first: u16, values: &[u16]) -> Result<Option<Order>, Reason> {
    let mut command = None;
    let mut setpoint = None;
    for (offset, value) in (0..).zip(values) {
        match first.checked_add(offset) {
            Some(address::RUN) => command = Some(*value),
            Some(address::SETPOINT) => setpoint = Some(Hertz::from_centihertz(*value)),
            Some(address::RENEW) => {}
            _ => return Err(Reason::NotListed),
        }
    }
    let order = match command {
        None => setpoint.map_or(Some(Order::Renew), |setpoint| go(Some(setpoint), None)),
        Some(run::STOP) => Some(Order::Stop { setpoint }),
        Some(run::FORWARD) => go(setpoint, Some(Direction::Forward)),
        Some(run::REVERSE) => go(setpoint, Some(Direction::Reverse)),
        Some(run::COAST) => Some(Order::Coast),
        Some(run::RESET) => Some(Order::Reset),
        Some(run::RELEASE) if setpoint.is_none() => Some(Order::Release),
        Some(run::TAKE) if setpoint.is_none() => Some(Order::Take),
        Some(run::RELEASE | run::TAKE) => return Err(Reason::Conflict),
        Some(_) => return Err(Reason::NotUnderstood),
    };
    Ok(order)
}

fn go(setpoint: Option<Hertz>, direction: Option<Direction>) -> Option<Order> {
    GoOrder::new(Vec::new(), setpoint, direction).map(Order::Go)
}

/// A mask counts as a write of its result on the word that is read back.
fn masked(
    register: u16,
    and: u16,
    or: u16,
    control: Option<&ControlView>,
) -> Result<Option<Order>, Reason> {
    let old = match register {
        address::RUN => control.map_or(run::STOP, |control| run_word(control.intent)),
        // No bit of the old word is kept.
        address::SETPOINT if and == 0 => 0,
        address::SETPOINT => {
            let setpoint = control.and_then(|control| control.setpoint?.centihertz());
            setpoint.ok_or(Reason::SetpointUnknown)?
        }
        _ => 0,
    };
    words(register, &[(old & and) | (or & !and)])
}

/// The intent as word 256 reads it.
pub(super) const fn run_word(intent: RunIntent) -> u16 {
    match intent {
        RunIntent::Stop => run::STOP,
        RunIntent::Run(Direction::Forward) => run::FORWARD,
        RunIntent::Run(Direction::Reverse) => run::REVERSE,
        RunIntent::Coast => run::COAST,
    }
}

fn coils_of(first: u16, values: &PackedBits) -> Result<Option<Order>, Reason> {
    coils(first, values.count(), |place| values.get(place))
}

fn coils(
    first: u16,
    count: u16,
    value: impl Fn(u16) -> Option<bool>,
) -> Result<Option<Order>, Reason> {
    let end = first.checked_add(count).ok_or(Reason::NotListed)?;
    if end > address::COILS {
        return Err(Reason::NotListed);
    }
    // `None`: the request does not cover the coil.
    let coil = |coil: u16| {
        coil.checked_sub(first)
            .filter(|place| *place < count)
            .and_then(&value)
    };
    let forward = coil(address::FORWARD);
    let reverse = coil(address::REVERSE);
    let reset = coil(address::RESET);
    if coil(address::STOP) == Some(true) {
        return Ok(Some(Order::Stop { setpoint: None }));
    }
    match (forward, reverse, reset) {
        (Some(true), Some(true), _) | (Some(true), _, Some(true)) | (_, Some(true), Some(true)) => {
            Err(Reason::Conflict)
        }
        (Some(true), ..) => Ok(go(None, Some(Direction::Forward))),
        (_, Some(true), _) => Ok(go(None, Some(Direction::Reverse))),
        (Some(false), ..) | (_, Some(false), _) => Ok(Some(Order::Stop { setpoint: None })),
        (None, None, Some(true)) => Ok(Some(Order::Reset)),
        (None, None, Some(false)) => Ok(Some(Order::EndReset)),
        (None, None, None) => Ok(None),
    }
}

/// Whether `ask` presses the stop button, coil 3: that is an action each time, not a level that a controller holds.
#[must_use]
pub fn presses_stop(ask: &ModbusRequest) -> bool {
    match ask {
        ModbusRequest::WriteCoil { address, on } => *on && *address == address::STOP,
        ModbusRequest::WriteCoils { address, values } => {
            address::STOP
                .checked_sub(*address)
                .and_then(|place| values.get(place))
                == Some(true)
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::refusal::exception_of;
    use super::super::super::request::parse;
    use super::*;

    fn order(pdu: &[u8], control: Option<&ControlView>) -> Result<Option<Order>, u8> {
        order_in(&parse(pdu).unwrap(), control).map_err(exception_of)
    }

    fn block(function: u8, address: u16, values: &[u16]) -> Vec<u8> {
        let mut pdu = vec![function];
        if function == 0x17 {
            pdu.extend([0, 0, 0, 1]);
        }
        crate::wire::pdu::put_words(&mut pdu, &[address, values.len() as u16]);
        pdu.push((values.len() * 2) as u8);
        crate::wire::pdu::put_words(&mut pdu, values);
        pdu
    }

    const STOP: Order = Order::Stop { setpoint: None };
    const HZ: Hertz = Hertz::from_millihertz(42_500);

    fn runs(direction: Direction) -> Order {
        go(None, Some(direction)).unwrap()
    }

    #[test]
    fn one_word_is_one_order() {
        for (address, value, right) in [
            (256, 0, Ok(Some(STOP))),
            (256, 1, Ok(Some(runs(Direction::Forward)))),
            (256, 2, Ok(Some(runs(Direction::Reverse)))),
            (256, 3, Ok(Some(Order::Coast))),
            (256, 4, Ok(Some(Order::Reset))),
            (256, 5, Ok(Some(Order::Release))),
            (256, 6, Ok(Some(Order::Take))),
            (256, 7, Err(3)),
            (256, 0xFFFF, Err(3)),
            (257, 4250, Ok(go(Some(HZ), None))),
            (257, 0, Ok(go(Some(Hertz::ZERO), None))),
            (258, 0, Ok(Some(Order::Renew))),
            (258, 0xFFFF, Ok(Some(Order::Renew))),
            (259, 0, Err(2)),
            (255, 0, Err(2)),
            (1, 0, Err(2)),
        ] {
            let mut single = vec![6];
            crate::wire::pdu::put_words(&mut single, &[address, value]);
            assert_eq!(order(&single, None), right, "06 {address} {value}");
            assert_eq!(
                order(&block(0x10, address, &[value]), None),
                right,
                "10 {address} {value}"
            );
            assert_eq!(
                order(&block(0x17, address, &[value]), None),
                right,
                "17 {address} {value}"
            );
        }
    }

    #[test]
    fn one_block_is_one_order() {
        for (address, values, right) in [
            (
                256,
                &[1, 4250][..],
                Ok(go(Some(HZ), Some(Direction::Forward))),
            ),
            (
                256,
                &[2, 4250, 9],
                Ok(go(Some(HZ), Some(Direction::Reverse))),
            ),
            (
                256,
                &[0, 4250, 9],
                Ok(Some(Order::Stop { setpoint: Some(HZ) })),
            ),
            (256, &[3, 4250], Ok(Some(Order::Coast))),
            (256, &[4, 4250], Ok(Some(Order::Reset))),
            (256, &[4, 4250, 9], Ok(Some(Order::Reset))),
            (256, &[5, 4250], Err(3)),
            (256, &[6, 4250], Err(3)),
            (257, &[4250, 9], Ok(go(Some(HZ), None))),
            (256, &[0, 0, 0, 0], Err(2)),
            (255, &[0, 0], Err(2)),
            (0xFFFF, &[0], Err(2)),
        ] {
            assert_eq!(
                order(&block(0x10, address, values), None),
                right,
                "{address} {values:?}"
            );
        }
    }

    #[test]
    fn a_mask_is_a_write_of_what_it_makes_of_the_word_read_back() {
        let mut control = ControlView {
            intent: RunIntent::Run(Direction::Forward),
            ..ControlView::default()
        };
        let mask = |register: u16, and: u16, or: u16, control: &ControlView| {
            let mut pdu = vec![0x16];
            crate::wire::pdu::put_words(&mut pdu, &[register, and, or]);
            order(&pdu, Some(control))
        };
        assert_eq!(
            mask(256, 0xFFFF, 0, &control),
            Ok(Some(runs(Direction::Forward)))
        );
        assert_eq!(mask(256, 0xFFFE, 0, &control), Ok(Some(STOP)));
        assert_eq!(
            mask(256, 0xFFFC, 2, &control),
            Ok(Some(runs(Direction::Reverse)))
        );
        assert_eq!(mask(256, 0xFF00, 0xFF, &control), Err(3));
        assert_eq!(
            mask(257, 0xFFFF, 0, &control),
            Err(6),
            "no setpoint to mask"
        );
        assert_eq!(mask(257, 0, 4250, &control), Ok(go(Some(HZ), None)));
        control.setpoint = Some(Hertz::from_millihertz(40_000));
        assert_eq!(
            mask(257, 0xFF00, 0x9A, &control),
            Ok(go(Some(Hertz::from_centihertz(0x0F9A)), None))
        );
        assert_eq!(mask(258, 0, 0, &control), Ok(Some(Order::Renew)));
        assert_eq!(mask(259, 0, 0, &control), Err(2));
    }

    #[test]
    fn every_intent_reads_back_as_it_is_ordered() {
        for (intent, word) in [
            (RunIntent::Stop, 0),
            (RunIntent::Run(Direction::Forward), 1),
            (RunIntent::Run(Direction::Reverse), 2),
            (RunIntent::Coast, 3),
        ] {
            assert_eq!(run_word(intent), word);
        }
    }

    #[test]
    fn one_coil_acts_when_it_is_on_and_off_stops_where_it_would_run() {
        for (coil, on, right) in [
            (0, true, Ok(Some(runs(Direction::Forward)))),
            (1, true, Ok(Some(runs(Direction::Reverse)))),
            (2, true, Ok(Some(Order::Reset))),
            (3, true, Ok(Some(STOP))),
            (0, false, Ok(Some(STOP))),
            (1, false, Ok(Some(STOP))),
            (2, false, Ok(Some(Order::EndReset))),
            (3, false, Ok(None)),
            (4, true, Err(2)),
            (0xFFFF, false, Err(2)),
        ] {
            let ask = ModbusRequest::WriteCoil { address: coil, on };
            assert_eq!(
                order_in(&ask, None).map_err(exception_of),
                right,
                "{coil} {on}"
            );
        }
    }

    #[test]
    fn a_stop_wins_among_coils() {
        // First coil, number of coils, coils with the first in the lowest bit.
        for (first, count, bits, right) in [
            (0, 2, 0b01, Ok(Some(runs(Direction::Forward)))),
            (0, 2, 0b10, Ok(Some(runs(Direction::Reverse)))),
            (0, 2, 0b00, Ok(Some(STOP))),
            (0, 2, 0b11, Err(3)),
            (0, 4, 0b0001, Ok(Some(runs(Direction::Forward)))),
            (0, 4, 0b0000, Ok(Some(STOP))),
            (0, 4, 0b1000, Ok(Some(STOP))),
            (0, 4, 0b1011, Ok(Some(STOP))),
            (0, 4, 0b1101, Ok(Some(STOP))),
            (0, 4, 0b0101, Err(3)),
            (1, 2, 0b11, Err(3)),
            (0, 4, 0b0100, Ok(Some(STOP))),
            (2, 2, 0b01, Ok(Some(Order::Reset))),
            (2, 2, 0b11, Ok(Some(STOP))),
            (2, 2, 0b00, Ok(Some(Order::EndReset))),
            (0, 5, 0, Err(2)),
            (4, 1, 1, Err(2)),
        ] {
            let pdu = [0x0F, 0, first, 0, count, 1, bits];
            assert_eq!(order(&pdu, None), right, "{first} {count} {bits:04b}");
        }
    }
}
