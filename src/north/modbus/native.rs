//! Native units: the drive as its vendor describes it, addressed by its own registers.

use super::answer::Answer;
use super::ask::Ask;
use super::refusal;
use crate::domain::address::Address;
use crate::domain::native::{NativeAsk, NativeOutcome, Refusal};
use crate::profile::model::Model;
use crate::wire::exception;

/// The request that `ask` makes to a drive. 04 is served as 03, because drives have no input registers of their own.
///
/// # Errors
/// 01: a native unit has only the functions 03, 04, 06, 08 and 10 hex; and of 08 only what the drive serves.
pub fn ask_of(ask: Ask) -> Result<NativeAsk, u8> {
    match ask {
        Ask::ReadWords { address, count, .. } => Ok(NativeAsk::Read { address: address.into(), count }),
        Ask::LoopTest { data } => Ok(NativeAsk::Loop { data }),
        Ask::WriteWord { address, value } => Ok(NativeAsk::Write { address: address.into(), values: vec![value] }),
        Ask::WriteWords { address, values } => Ok(NativeAsk::Write { address: address.into(), values }),
        _ => Err(exception::ILLEGAL_FUNCTION),
    }
}

/// The answer to the client for `outcome`: 04 if the drive refused, its own exception unchanged, 0B if it did not
/// answer in time, 0A if it cannot be reached, 06 if the request may be repeated later.
#[must_use]
pub fn answer_of(outcome: &NativeOutcome) -> Answer<'_> {
    Answer::Exception(match outcome {
        NativeOutcome::Words(words) => return Answer::Words(words),
        NativeOutcome::Written => return Answer::Written,
        NativeOutcome::KeptOldValue(_) => exception::SERVER_DEVICE_FAILURE,
        NativeOutcome::DriveException(code) => *code,
        NativeOutcome::Refused(why) => exception_of(*why),
        NativeOutcome::Superseded => exception::SERVER_DEVICE_BUSY,
        NativeOutcome::NoReply | NativeOutcome::Expired => exception::GATEWAY_TARGET_FAILED,
    })
}

/// Whether `ask` orders a drive of `model` to stop or to coast, by writing its run command.
#[must_use]
pub fn is_stop(model: &Model, ask: &Ask) -> bool {
    let (address, values) = match ask {
        Ask::WriteWord { address, value } => (*address, std::slice::from_ref(value)),
        Ask::WriteWords { address, values } => (*address, values.as_slice()),
        _ => return false,
    };
    let mut written = Address::from(address).onwards().zip(values);
    written.any(|(address, value)| model.stops_at(address, *value))
}

const fn exception_of(why: Refusal) -> u8 {
    match why {
        Refusal::NoSuchUnit | Refusal::LineDown => exception::GATEWAY_PATH_UNAVAILABLE,
        Refusal::Guard(reason) => refusal::exception_of(reason),
        Refusal::TooManyFrames => exception::ILLEGAL_DATA_VALUE,
        Refusal::QueueFull => exception::SERVER_DEVICE_BUSY,
    }
}

#[cfg(test)]
mod tests {
    use super::super::request::parse;
    use super::super::testing;
    use super::*;
    use crate::domain::command::Reason;

    fn ask(pdu: &[u8]) -> Ask {
        parse(pdu).unwrap()
    }

    #[test]
    fn reads_and_register_writes_are_native_and_nothing_else() {
        let read = NativeAsk::Read { address: 0x0101_u16.into(), count: 2 };
        assert_eq!(ask_of(ask(&[3, 1, 1, 0, 2])), Ok(read.clone()));
        assert_eq!(ask_of(ask(&[4, 1, 1, 0, 2])), Ok(read));
        let write = NativeAsk::Write { address: 2_u16.into(), values: vec![1] };
        assert_eq!(ask_of(ask(&[6, 0, 2, 0, 1])), Ok(write.clone()));
        assert_eq!(ask_of(ask(&[0x10, 0, 2, 0, 1, 2, 0, 1])), Ok(write));
        assert_eq!(ask_of(ask(&[8, 0, 0, 0xA5, 0x37])), Ok(NativeAsk::Loop { data: 0xA537 }));
        for other in [
            &[1, 0, 0, 0, 1][..],
            &[2, 0, 0, 0, 1],
            &[5, 0, 0, 0, 0],
            &[0x0F, 0, 0, 0, 1, 1, 1],
            &[0x16, 0, 2, 0, 0, 0, 0],
            &[0x17, 0, 0, 0, 1, 0, 2, 0, 1, 2, 0, 0],
            &[0x2B, 0x0E, 1, 0],
        ] {
            assert_eq!(ask_of(ask(other)), Err(1), "{other:?}");
        }
    }

    #[test]
    fn every_outcome_is_one_answer() {
        assert_eq!(answer_of(&NativeOutcome::Words([1, 2].into())), Answer::Words(&[1, 2]));
        assert_eq!(answer_of(&NativeOutcome::Written), Answer::Written);
        for (outcome, code) in [
            (NativeOutcome::KeptOldValue(7), 4),
            (NativeOutcome::DriveException(2), 2),
            (NativeOutcome::DriveException(0x21), 0x21),
            (NativeOutcome::Refused(Refusal::NoSuchUnit), 0x0A),
            (NativeOutcome::Refused(Refusal::LineDown), 0x0A),
            (NativeOutcome::Refused(Refusal::Guard(Reason::ReadOnly)), 1),
            (NativeOutcome::Refused(Refusal::Guard(Reason::NotListed)), 2),
            (NativeOutcome::Refused(Refusal::Guard(Reason::OutsideLimits)), 3),
            (NativeOutcome::Refused(Refusal::Guard(Reason::OtherOwner)), 6),
            (NativeOutcome::Refused(Refusal::TooManyFrames), 3),
            (NativeOutcome::Refused(Refusal::QueueFull), 6),
            (NativeOutcome::Superseded, 6),
            (NativeOutcome::NoReply, 0x0B),
            (NativeOutcome::Expired, 0x0B),
        ] {
            assert_eq!(answer_of(&outcome), Answer::Exception(code), "{outcome:?}");
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
        let write = |word: u16| Ask::WriteWord { address: 0x2000, value: word };
        for (text, stop, forward) in [
            (include_str!("../../../tests/golden/models/zero-ignored.toml"), 0x043C, 0x047C),
            (include_str!("../../../tests/golden/models/zero-nothing.toml"), 0x0001, 0x0012),
            (include_str!("../../../tests/golden/models/zero-coast.toml"), 0x0006, 0x0007),
        ] {
            let mut model = check::model(text).unwrap();
            for (word, stops) in [(0, true), (stop, true), (forward, false), (stop | forward | 0x8000, false)] {
                assert_eq!(is_stop(&model, &write(word)), stops, "{}: {word:04X}", model.id);
            }
            model.run.as_mut().unwrap().zero = None;
            assert!(!is_stop(&model, &write(0)), "{}", model.id);
        }
    }
}
