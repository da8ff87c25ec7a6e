//! Native units: the drive as its vendor describes it, addressed by its own registers.

use super::answer::ModbusAnswer;
use super::ask::{BitTable, ModbusRequest, PackedBits, WordTable};
use super::refusal;
use crate::domain::address::{Address, DataTable};
use crate::domain::native::{NativeAsk, NativeOutcome, NativeRefusal};
use crate::profile::model::Model;
use crate::wire::exception;

/// The request that `ask` makes to a drive of `model`. 04 is served as 03 where a drive has no input registers of its own.
///
/// # Errors
/// 01: a native unit has only the functions 03, 04, 06, 08 and 10 hex, those of bits where its drive has such, and of 08
/// only what the drive serves.
pub fn ask_of(model: &Model, ask: ModbusRequest) -> Result<NativeAsk, u8> {
    let has = |table| {
        model
            .registers
            .iter()
            .any(|register| register.address.table() == table)
    };
    match ask {
        ModbusRequest::ReadWords {
            table,
            address,
            count,
        } => {
            let is_input = table == WordTable::Input && has(DataTable::Input);
            let table = if is_input {
                DataTable::Input
            } else {
                DataTable::Holding
            };
            Ok(NativeAsk::Read {
                address: Address::new(table, address),
                count,
            })
        }
        ModbusRequest::ReadBits {
            table,
            address,
            count,
        } => {
            let table = match table {
                BitTable::Coils => DataTable::Coil,
                BitTable::Discrete => DataTable::Discrete,
            };
            let read = NativeAsk::Read {
                address: Address::new(table, address),
                count,
            };
            has(table)
                .then_some(read)
                .ok_or(exception::ILLEGAL_FUNCTION)
        }
        ModbusRequest::WriteCoil { .. } | ModbusRequest::WriteCoils { .. }
            if !has(DataTable::Coil) =>
        {
            Err(exception::ILLEGAL_FUNCTION)
        }
        ModbusRequest::WriteCoil { address, on } => Ok(NativeAsk::Write {
            address: Address::new(DataTable::Coil, address),
            values: vec![on.into()],
        }),
        ModbusRequest::WriteCoils { address, values } => Ok(NativeAsk::Write {
            address: Address::new(DataTable::Coil, address),
            values: bits(&values),
        }),
        ModbusRequest::LoopTest { data } => Ok(NativeAsk::Loop { data }),
        ModbusRequest::WriteWord { address, value } => Ok(NativeAsk::Write {
            address: address.into(),
            values: vec![value],
        }),
        ModbusRequest::WriteWords { address, values } => Ok(NativeAsk::Write {
            address: address.into(),
            values,
        }),
        _ => Err(exception::ILLEGAL_FUNCTION),
    }
}

/// The answer to the client for `outcome`: 04 if the drive refused, its own exception unchanged, 0B if it did not
/// answer in time, 0A if it cannot be reached, 06 if the request may be repeated later.
#[must_use]
pub fn answer_of(outcome: &NativeOutcome) -> ModbusAnswer<'_> {
    ModbusAnswer::Exception(match outcome {
        NativeOutcome::Words(words) => return ModbusAnswer::Words(words),
        NativeOutcome::Written => return ModbusAnswer::Written,
        NativeOutcome::KeptOldValue(_) => exception::SERVER_DEVICE_FAILURE,
        NativeOutcome::DriveException { code, .. } => *code,
        NativeOutcome::Refused(why) => exception_of(*why),
        NativeOutcome::Superseded => exception::SERVER_DEVICE_BUSY,
        NativeOutcome::NoReply | NativeOutcome::Expired => exception::GATEWAY_TARGET_FAILED,
    })
}

/// Whether `ask` orders a drive of `model` to stop or to coast, by writing its run command.
#[must_use]
pub fn is_stop(model: &Model, ask: &ModbusRequest) -> bool {
    let (address, values) = match ask {
        ModbusRequest::WriteWord { address, value } => (Address::holding(*address), vec![*value]),
        ModbusRequest::WriteWords { address, values } => {
            (Address::holding(*address), values.clone())
        }
        ModbusRequest::WriteCoil { address, on } => (
            Address::new(DataTable::Coil, *address),
            vec![u16::from(*on)],
        ),
        ModbusRequest::WriteCoils { address, values } => {
            (Address::new(DataTable::Coil, *address), bits(values))
        }
        _ => return false,
    };
    let mut written = address.onwards().zip(values);
    written.any(|(address, value)| model.stops_at(address, value))
}

/// Each bit as a word, 0 or 1.
fn bits(values: &PackedBits) -> Vec<u16> {
    (0..values.count())
        .filter_map(|place| values.get(place))
        .map(u16::from)
        .collect()
}

const fn exception_of(why: NativeRefusal) -> u8 {
    match why {
        NativeRefusal::NoSuchUnit | NativeRefusal::LineDown | NativeRefusal::Standby => {
            exception::GATEWAY_PATH_UNAVAILABLE
        }
        NativeRefusal::Guard(reason) => refusal::exception_of(reason),
        NativeRefusal::TooManyFrames => exception::ILLEGAL_DATA_VALUE,
        NativeRefusal::QueueFull => exception::SERVER_DEVICE_BUSY,
    }
}

#[cfg(test)]
mod tests {
    use super::super::request::parse;
    use super::super::testing;
    use super::*;
    use crate::domain::command::Reason;

    fn ask(pdu: &[u8]) -> ModbusRequest {
        parse(pdu).unwrap()
    }

    #[test]
    fn reads_and_register_writes_are_native_and_nothing_else() {
        let model = testing::description().model;
        let read = NativeAsk::Read {
            address: 0x0101_u16.into(),
            count: 2,
        };
        assert_eq!(ask_of(&model, ask(&[3, 1, 1, 0, 2])), Ok(read.clone()));
        assert_eq!(ask_of(&model, ask(&[4, 1, 1, 0, 2])), Ok(read));
        let write = NativeAsk::Write {
            address: 2_u16.into(),
            values: vec![1],
        };
        assert_eq!(ask_of(&model, ask(&[6, 0, 2, 0, 1])), Ok(write.clone()));
        assert_eq!(ask_of(&model, ask(&[0x10, 0, 2, 0, 1, 2, 0, 1])), Ok(write));
        assert_eq!(
            ask_of(&model, ask(&[8, 0, 0, 0xA5, 0x37])),
            Ok(NativeAsk::Loop { data: 0xA537 })
        );
        for other in [
            &[1, 0, 0, 0, 1][..],
            &[2, 0, 0, 0, 1],
            &[5, 0, 0, 0, 0],
            &[0x0F, 0, 0, 0, 1, 1, 1],
            &[0x16, 0, 2, 0, 0, 0, 0],
            &[0x17, 0, 0, 0, 1, 0, 2, 0, 1, 2, 0, 0],
            &[0x2B, 0x0E, 1, 0],
        ] {
            assert_eq!(ask_of(&model, ask(other)), Err(1), "{other:?}");
        }
    }

    #[test]
    fn a_drive_with_coils_and_inputs_serves_their_functions() {
        let text = include_str!("../../../../../tests/golden/models/coils.toml");
        let model = crate::profile::check::model(text).unwrap();
        let at = |table, number| Address::new(table, number);
        let read = |table, number, count| {
            Ok(NativeAsk::Read {
                address: at(table, number),
                count,
            })
        };
        assert_eq!(
            ask_of(&model, ask(&[1, 0, 0, 0, 9])),
            read(DataTable::Coil, 0, 9)
        );
        assert_eq!(
            ask_of(&model, ask(&[2, 0, 1, 0, 1])),
            read(DataTable::Discrete, 1, 1)
        );
        assert_eq!(
            ask_of(&model, ask(&[3, 0, 1, 0, 1])),
            read(DataTable::Holding, 1, 1)
        );
        assert_eq!(
            ask_of(&model, ask(&[4, 0x10, 0, 0, 2])),
            read(DataTable::Input, 0x1000, 2)
        );
        let write = |number, values| {
            Ok(NativeAsk::Write {
                address: at(DataTable::Coil, number),
                values,
            })
        };
        assert_eq!(ask_of(&model, ask(&[5, 0, 1, 0xFF, 0])), write(1, vec![1]));
        assert_eq!(
            ask_of(&model, ask(&[0x0F, 0, 0, 0, 2, 1, 0b10])),
            write(0, vec![0, 1])
        );
        for (pdu, stops) in [
            (&[5, 0, 0, 0, 0][..], true),
            (&[5, 0, 0, 0xFF, 0], false),
            (&[5, 0, 4, 0xFF, 0], true),
            (&[5, 0, 1, 0, 0], false),
            (&[0x0F, 0, 0, 0, 2, 1, 0b10], true),
            (&[0x0F, 0, 0, 0, 2, 1, 0b11], false),
            (&[6, 0, 0, 0, 0], false),
        ] {
            assert_eq!(is_stop(&model, &ask(pdu)), stops, "{pdu:?}");
        }
    }

    #[test]
    fn every_outcome_is_one_answer() {
        assert_eq!(
            answer_of(&NativeOutcome::Words([1, 2].into())),
            ModbusAnswer::Words(&[1, 2])
        );
        assert_eq!(answer_of(&NativeOutcome::Written), ModbusAnswer::Written);
        for (outcome, code) in [
            (NativeOutcome::KeptOldValue(7), 4),
            (
                NativeOutcome::DriveException {
                    code: 2,
                    reason: Reason::DriveException,
                },
                2,
            ),
            (
                NativeOutcome::DriveException {
                    code: 0x21,
                    reason: Reason::DriveBusy,
                },
                0x21,
            ),
            (NativeOutcome::Refused(NativeRefusal::NoSuchUnit), 0x0A),
            (NativeOutcome::Refused(NativeRefusal::LineDown), 0x0A),
            (
                NativeOutcome::Refused(NativeRefusal::Guard(Reason::ReadOnly)),
                1,
            ),
            (
                NativeOutcome::Refused(NativeRefusal::Guard(Reason::NotListed)),
                2,
            ),
            (
                NativeOutcome::Refused(NativeRefusal::Guard(Reason::OutsideLimits)),
                3,
            ),
            (
                NativeOutcome::Refused(NativeRefusal::Guard(Reason::OtherOwner)),
                6,
            ),
            (NativeOutcome::Refused(NativeRefusal::TooManyFrames), 3),
            (NativeOutcome::Refused(NativeRefusal::QueueFull), 6),
            (NativeOutcome::Superseded, 6),
            (NativeOutcome::NoReply, 0x0B),
            (NativeOutcome::Expired, 0x0B),
        ] {
            assert_eq!(
                answer_of(&outcome),
                ModbusAnswer::Exception(code),
                "{outcome:?}"
            );
        }
    }

    #[test]
    fn a_stop_is_known_by_the_run_command_alone() {
        let model = testing::description().model;
        for (pdu, stops) in [
            (&[6, 0, 2, 0, 0][..], true),
            (&[6, 0, 2, 0, 3], true),
            (&[6, 0, 2, 0, 1], false),
            (&[6, 0, 4, 0, 0], false),
            (&[0x10, 0, 1, 0, 2, 4, 0, 9, 0, 0], true),
            (&[0x10, 0, 3, 0, 2, 4, 0, 0, 0, 0], false),
            (&[0x10, 0, 1, 0, 1, 2, 0, 0], false),
            (&[3, 0, 2, 0, 1], false),
        ] {
            assert_eq!(is_stop(&model, &ask(pdu)), stops, "{pdu:?}");
        }
    }

    #[test]
    fn a_zero_is_a_stop_where_the_model_says_what_the_drive_makes_of_it() {
        use crate::profile::check;
        let write = |word: u16| ModbusRequest::WriteWord {
            address: 0x2000,
            value: word,
        };
        for (text, stop, forward) in [
            (
                include_str!("../../../../../tests/golden/models/zero-ignored.toml"),
                0x043C,
                0x047C,
            ),
            (
                include_str!("../../../../../tests/golden/models/zero-nothing.toml"),
                0x0001,
                0x0012,
            ),
            (
                include_str!("../../../../../tests/golden/models/zero-coast.toml"),
                0x0006,
                0x0007,
            ),
        ] {
            let mut model = check::model(text).unwrap();
            for (word, stops) in [
                (0, true),
                (stop, true),
                (forward, false),
                (stop | forward | 0x8000, false),
            ] {
                assert_eq!(
                    is_stop(&model, &write(word)),
                    stops,
                    "{}: {word:04X}",
                    model.id
                );
            }
            model.run.as_mut().unwrap().zero = None;
            assert!(!is_stop(&model, &write(0)), "{}", model.id);
        }
    }
}
