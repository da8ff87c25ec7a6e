//! Unit 255, the gateway itself: its counters, all its drives in short, STOP for all of them, and its identity. Unit 0
//! reads the same and writes nothing, so that a write that a client intends as a broadcast never becomes one.

use super::ask::{BitTable, ModbusRequest};
use super::identity;
use super::taken::{RequestAction, RequestContext};
use super::uniform::{self, ABSENT, UniformUnit};
use super::words::WordBuffer;
use crate::domain::command::Reason;
use crate::domain::report::{LineReport, LineState};
use crate::domain::standby::LineRole;
use crate::drive::view::DriveView;
use crate::wire::exception;
use std::sync::Arc;

/// The unit of the gateway itself.
pub const UNIT: u8 = 255;
/// The unit that the standard reserves for broadcasts.
pub const BROADCAST: u8 = 0;
/// The coil that stops all.
pub const STOP_ALL: u16 = 0;

/// Words about the gateway, from 0 on.
pub(super) const HEAD_WORDS: u16 = 16;
/// The first word of the first line.
pub(super) const LINES: u16 = 100;
/// Words of each line.
pub(super) const LINE_WORDS: u16 = 16;
/// The first word of the first drive.
pub(super) const DRIVES: u16 = 1000;
/// Most lines that have words: the last one may not overlap the words of the drives.
pub(super) const LINES_MAX: u16 = (DRIVES - LINES) / LINE_WORDS;
/// Words of each drive.
pub(super) const DRIVE_WORDS: u16 = 8;
/// The words of a drive in terms of the uniform map: status bits, run state, output frequency, setpoint, trip code,
/// current, age, trips that are kept.
const DRIVE_COLUMNS: [u16; DRIVE_WORDS as usize] = [1, 2, 4, 5, 3, 6, 12, 13];

/// What a listener serves of the gateway. Lines and drives are numbered as in the configuration, whichever listener
/// serves them, so that an address means the same at every listener.
pub trait ServedGateway {
    /// Number of lines.
    fn lines(&self) -> usize;
    /// The line at this place; `None` if this listener does not serve it.
    fn line(&self, place: usize) -> Option<LineReport>;
    /// Number of drives.
    fn drives(&self) -> usize;
    /// The drive at this place with its view; `None` if this listener does not serve it.
    fn drive(&self, place: usize) -> Option<(&UniformUnit, Arc<DriveView>)>;
    /// The gateway's role on the line of that drive; `None` if it is the only gateway there.
    fn standby(&self, place: usize) -> Option<LineRole>;
}

/// What `ask` means to `unit`, which is [`UNIT`] or [`BROADCAST`]. Words are filled into `words`.
pub fn take(
    unit: u8,
    ask: &ModbusRequest,
    gateway: &impl ServedGateway,
    present: &RequestContext,
    words: &mut WordBuffer,
) -> RequestAction {
    match ask {
        ModbusRequest::ReadWords { address, count, .. } => {
            read(*address, *count, gateway, present, words)
        }
        ModbusRequest::ReadBits {
            table: BitTable::Coils,
            address: STOP_ALL,
            count: 1,
        } => RequestAction::Bits { bits: 0, count: 1 },
        ModbusRequest::ReadBits {
            table: BitTable::Coils,
            ..
        } => RequestAction::Exception(exception::ILLEGAL_DATA_ADDRESS),
        ModbusRequest::LoopTest { .. } => RequestAction::Nothing,
        ModbusRequest::Identify { access, object } => identity::read(*access, *object)
            .map_or_else(RequestAction::Exception, RequestAction::Identity),
        ModbusRequest::WriteCoil { address, on } if unit == UNIT => coil(*address, 1, *on),
        ModbusRequest::WriteCoils { address, values } if unit == UNIT => {
            coil(*address, values.count(), values.get(0) == Some(true))
        }
        _ if !ask.writes() => RequestAction::Exception(exception::ILLEGAL_FUNCTION),
        _ if unit == BROADCAST => RequestAction::Refused(Reason::NotAllowed),
        _ => RequestAction::Refused(Reason::NotCapable),
    }
}

/// Whether `ask` orders all drives to stop.
#[must_use]
pub fn is_stop(unit: u8, ask: &ModbusRequest) -> bool {
    let on = match ask {
        ModbusRequest::WriteCoil {
            address: STOP_ALL,
            on,
        } => *on,
        ModbusRequest::WriteCoils {
            address: STOP_ALL,
            values,
        } => values.count() == 1 && values.get(0) == Some(true),
        _ => false,
    };
    on && unit == UNIT
}

fn coil(address: u16, count: u16, on: bool) -> RequestAction {
    match (address, count, on) {
        (STOP_ALL, 1, true) => RequestAction::StopAll,
        (STOP_ALL, 1, false) => RequestAction::Nothing,
        _ => RequestAction::Refused(Reason::NotListed),
    }
}

fn read(
    address: u16,
    count: u16,
    gateway: &impl ServedGateway,
    present: &RequestContext,
    words: &mut WordBuffer,
) -> RequestAction {
    // The words of one drive are read from one view.
    let mut drive = None;
    let is_filled = words.fill(address, count, |address| {
        if let Some(offset) = address.checked_sub(DRIVES) {
            let place = usize::from(offset / DRIVE_WORDS);
            if drive.as_ref().is_none_or(|(held, _)| *held != place) {
                drive = Some((place, drive_words(place, gateway, present)?));
            }
            drive
                .as_ref()
                .and_then(|(_, row)| row.get(usize::from(offset % DRIVE_WORDS)).copied())
        } else if let Some(offset) = address.checked_sub(LINES) {
            line_word(offset, gateway)
        } else {
            (address < HEAD_WORDS).then(|| head_word(address, gateway, present))
        }
    });
    if is_filled {
        RequestAction::Words
    } else {
        RequestAction::Exception(exception::ILLEGAL_DATA_ADDRESS)
    }
}

fn head_word(address: u16, gateway: &impl ServedGateway, present: &RequestContext) -> u16 {
    match address {
        0 => uniform::MAP_VERSION,
        1 => low(present.uptime_s.into()),
        2 => count_word(gateway.lines()),
        3 => count_word(gateway.drives()),
        4 => high(present.uptime_s.into()),
        5 => low(present.uptime_s.into()),
        _ => 0,
    }
}

/// A line that is not served here is absent. There are words for 56 lines.
fn line_word(offset: u16, gateway: &impl ServedGateway) -> Option<u16> {
    let place = usize::from(offset / LINE_WORDS);
    let column = offset % LINE_WORDS;
    if place >= gateway.lines() {
        return None;
    }
    if place >= usize::from(LINES_MAX) {
        return None;
    }
    let Some(report) = gateway.line(place) else {
        return Some(ABSENT);
    };
    let counters = &report.counters;
    Some(match column {
        0 => u16::from(report.state == LineState::Up),
        1 => high(counters.requests),
        2 => low(counters.requests),
        3 => high(counters.replies),
        4 => low(counters.replies),
        5 => high(counters.silent),
        6 => low(counters.silent),
        7 => high(counters.garbled),
        8 => low(counters.garbled),
        9 => high(counters.exceptions),
        10 => low(counters.exceptions),
        11 => high(counters.strays),
        12 => low(counters.strays),
        13 => low(counters.port_downs),
        14 => low(counters.queue_full),
        _ => 0,
    })
}

/// A drive that is not served here is absent; one that does not exist has no words.
fn drive_words(
    place: usize,
    gateway: &impl ServedGateway,
    present: &RequestContext,
) -> Option<[u16; DRIVE_WORDS as usize]> {
    if place >= gateway.drives() {
        return None;
    }
    let Some((unit, view)) = gateway.drive(place) else {
        return Some([ABSENT; DRIVE_WORDS as usize]);
    };
    let present = RequestContext {
        standby: gateway.standby(place),
        ..*present
    };
    Some(DRIVE_COLUMNS.map(|address| unit.word(address, &view, &present).unwrap_or(ABSENT)))
}

fn count_word(count: usize) -> u16 {
    u16::try_from(count).unwrap_or(u16::MAX)
}

/// The high word of the low half of a counter, which wraps.
const fn high(counter: u64) -> u16 {
    (counter >> 16 & 0xFFFF) as u16
}

const fn low(counter: u64) -> u16 {
    (counter & 0xFFFF) as u16
}

#[cfg(test)]
mod tests {
    use super::super::refusal::exception_of;
    use super::super::request::parse;
    use super::super::testing::{self, NOW};
    use super::*;
    use crate::domain::command::Owner;
    use crate::domain::report::LineCounters;

    /// Three lines and drives; the second of each is not served.
    struct Plant {
        unit: UniformUnit,
        view: Arc<DriveView>,
    }

    impl Plant {
        fn new() -> Self {
            Self {
                unit: UniformUnit::new(&testing::description()),
                view: Arc::new(testing::view()),
            }
        }
    }

    impl ServedGateway for Plant {
        fn lines(&self) -> usize {
            3
        }

        fn line(&self, place: usize) -> Option<LineReport> {
            let counters = LineCounters {
                requests: 0x0001_0002_0003_0004,
                replies: 5,
                silent: 0x0006_0007,
                garbled: 8,
                exceptions: 9,
                strays: 10,
                port_downs: 11,
                queue_full: 12,
                ..LineCounters::default()
            };
            (place != 1).then_some(LineReport {
                state: LineState::Up,
                counters,
                ..LineReport::default()
            })
        }

        fn drives(&self) -> usize {
            3
        }

        fn drive(&self, place: usize) -> Option<(&UniformUnit, Arc<DriveView>)> {
            (place != 1).then(|| (&self.unit, Arc::clone(&self.view)))
        }

        fn standby(&self, place: usize) -> Option<LineRole> {
            [None, None, Some(LineRole::Listening)]
                .get(place)
                .copied()
                .flatten()
        }
    }

    fn asked(unit: u8, pdu: &[u8]) -> (RequestAction, Vec<u16>) {
        let present = RequestContext {
            now: NOW,
            uptime_s: 0x0001_0007,
            owner: Owner::Mqtt,
            standby: None,
        };
        let mut words = WordBuffer::default();
        let ask = parse(pdu).unwrap();
        let taken = match take(unit, &ask, &Plant::new(), &present, &mut words) {
            RequestAction::Refused(reason) if ask.writes() => {
                RequestAction::Exception(exception_of(reason))
            }
            taken => taken,
        };
        (taken, words.as_slice().to_vec())
    }

    #[test]
    fn the_gateway_is_read_as_unit_255_and_0() {
        for unit in [UNIT, BROADCAST] {
            for function in [3, 4] {
                let (taken, words) = asked(unit, &[function, 0, 0, 0, 16]);
                assert_eq!(taken, RequestAction::Words);
                assert_eq!(words, [&[1, 7, 3, 3, 1, 7][..], &[0; 10]].concat());
            }
        }
    }

    #[test]
    fn each_line_has_its_counters() {
        let (taken, words) = asked(UNIT, &[3, 0, 100, 0, 48]);
        assert_eq!(taken, RequestAction::Words);
        let served = [1, 3, 4, 0, 5, 6, 7, 0, 8, 0, 9, 0, 10, 11, 12, 0];
        assert_eq!(words, [served, [ABSENT; 16], served].concat());
    }

    #[test]
    fn each_drive_has_its_words_in_the_order_of_the_file() {
        let (taken, words) = asked(UNIT, &[4, 0x03, 0xE8, 0, 24]);
        assert_eq!(taken, RequestAction::Words);
        let served = [0b0011_0011, 2, 4250, 4250, 0, 123, 0, 0];
        let heard = [0b10_0000_0001_0011, 2, 4250, 4250, 0, 123, 0, 0];
        assert_eq!(words, [served, [ABSENT; 8], heard].concat());
        assert_eq!(asked(UNIT, &[3, 0x03, 0xEA, 0, 1]).1, [4250]);
    }

    #[test]
    fn there_is_nothing_else() {
        for (address, count) in [
            (15, 2),
            (16, 1),
            (99, 1),
            (99, 2),
            (147, 2),
            (148, 1),
            (999, 1),
            (1023, 2),
            (1024, 1),
            (0xFFFF, 1),
        ] {
            let [high, low] = u16::to_be_bytes(address);
            assert_eq!(
                asked(UNIT, &[3, high, low, 0, count]).0,
                RequestAction::Exception(2),
                "{address} {count}"
            );
        }
        for pdu in [
            &[1, 0, 0, 0, 2][..],
            &[1, 0, 1, 0, 1],
            &[5, 0, 1, 0xFF, 0],
            &[0x0F, 0, 0, 0, 2, 1, 1],
        ] {
            assert_eq!(asked(UNIT, pdu).0, RequestAction::Exception(2), "{pdu:?}");
        }
        for pdu in [
            &[2, 0, 0, 0, 1][..],
            &[6, 0, 0, 0, 1],
            &[0x10, 0, 0, 0, 1, 2, 0, 1],
            &[0x16, 0, 0, 0, 0, 0, 0],
            &[0x17, 0, 0, 0, 1, 0, 0, 0, 1, 2, 0, 1],
        ] {
            assert_eq!(asked(UNIT, pdu).0, RequestAction::Exception(1), "{pdu:?}");
        }
    }

    #[test]
    fn one_coil_stops_all_and_never_as_a_broadcast() {
        for (pdu, right) in [
            (&[5, 0, 0, 0xFF, 0][..], RequestAction::StopAll),
            (&[5, 0, 0, 0, 0], RequestAction::Nothing),
            (&[0x0F, 0, 0, 0, 1, 1, 1], RequestAction::StopAll),
            (&[0x0F, 0, 0, 0, 1, 1, 0], RequestAction::Nothing),
        ] {
            let ask = parse(pdu).unwrap();
            assert_eq!(is_stop(UNIT, &ask), right == RequestAction::StopAll);
            assert!(!is_stop(BROADCAST, &ask));
            assert_eq!(asked(UNIT, pdu).0, right, "{pdu:?}");
            assert_eq!(
                asked(BROADCAST, pdu).0,
                RequestAction::Exception(1),
                "{pdu:?}"
            );
        }
        for unit in [UNIT, BROADCAST] {
            assert_eq!(
                asked(unit, &[1, 0, 0, 0, 1]).0,
                RequestAction::Bits { bits: 0, count: 1 }
            );
        }
    }

    #[test]
    fn the_gateway_says_who_it_is() {
        for unit in [UNIT, BROADCAST] {
            assert_eq!(
                asked(unit, &[0x2B, 0x0E, 4, 0]).0,
                RequestAction::Identity(identity::read(4, 0).unwrap())
            );
            assert_eq!(
                asked(unit, &[0x2B, 0x0E, 4, 9]).0,
                RequestAction::Exception(2)
            );
            assert_eq!(
                asked(unit, &[0x2B, 0x0E, 9, 0]).0,
                RequestAction::Exception(3)
            );
        }
    }
}
