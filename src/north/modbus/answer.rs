//! From what became of a request to the PDU that answers it.

use crate::domain::native::{NativeAsk, NativeOutcome, Refusal};
use crate::wire::exception;
use crate::wire::pdu::{self, function};

/// What an answer must keep of its request.
#[derive(Clone, Copy, Debug)]
pub(super) struct Form {
    /// The function code that was asked for; the answer carries it.
    function: u8,
    success: Success,
}

/// What the answer to a request that succeeds holds.
#[derive(Clone, Copy, Debug)]
enum Success {
    /// As many words as were asked for.
    Words(u16),
    /// The two words with which the write began: register and value, or register and quantity.
    Echo([u16; 2]),
}

/// What follows the function code of an answer that is no exception.
#[derive(Clone, Copy, Debug)]
pub(super) enum Body<'a> {
    /// Byte count and words.
    Words(&'a [u16]),
    /// The first two words of the request.
    Echo([u16; 2]),
}

impl Form {
    /// The form of the answer to `ask` that came with `function`.
    pub(super) fn of(function: u8, ask: &NativeAsk) -> Self {
        let success = match ask {
            NativeAsk::Read { count, .. } => Success::Words(*count),
            NativeAsk::Write { address, values } => Success::Echo([*address, second_word(function, values)]),
        };
        Self { function, success }
    }

    /// What the client gets, or the code of its exception (01 never allowed, 03 too many frames, 04 the
    /// drive refused, 06 not now, 0A no way to the drive, 0B no reply).
    ///
    /// An outcome that does not fit what was asked would be a false answer, so it is 04.
    pub(super) fn judge<'a>(&self, outcome: &'a NativeOutcome) -> Result<Body<'a>, u8> {
        match (outcome, self.success) {
            (NativeOutcome::Words(words), Success::Words(count)) if words.len() == usize::from(count) => {
                Ok(Body::Words(words))
            }
            (NativeOutcome::Written, Success::Echo(words)) => Ok(Body::Echo(words)),
            (NativeOutcome::Words(_) | NativeOutcome::Written | NativeOutcome::KeptOldValue(_), _) => {
                Err(exception::SERVER_DEVICE_FAILURE)
            }
            (NativeOutcome::DriveException(code), _) => Err(*code),
            (NativeOutcome::Refused(refusal), _) => Err(refusal_code(*refusal)),
            (NativeOutcome::Superseded, _) => Err(exception::SERVER_DEVICE_BUSY),
            (NativeOutcome::NoReply | NativeOutcome::Expired, _) => Err(exception::GATEWAY_TARGET_FAILED),
        }
    }

    /// Appends the PDU of the answer to `out`.
    pub(super) fn encode(&self, out: &mut Vec<u8>, result: Result<Body<'_>, u8>) {
        match result {
            Ok(Body::Words(words)) => {
                out.extend([self.function, (words.len() * 2) as u8]);
                pdu::put_words(out, words);
            }
            Ok(Body::Echo(words)) => {
                out.push(self.function);
                pdu::put_words(out, &words);
            }
            Err(code) => encode_exception(out, self.function, code),
        }
    }
}

/// Appends the PDU of the exception `code` to a request of `function`.
pub(super) fn encode_exception(out: &mut Vec<u8>, function: u8, code: u8) {
    out.extend([function | function::EXCEPTION_BIT, code]);
}

fn second_word(function: u8, values: &[u16]) -> u16 {
    match values {
        [value] if function == function::WRITE_SINGLE => *value,
        _ => values.len() as u16,
    }
}

const fn refusal_code(refusal: Refusal) -> u8 {
    match refusal {
        Refusal::NoSuchUnit | Refusal::LineDown => exception::GATEWAY_PATH_UNAVAILABLE,
        Refusal::Guard(_) => exception::ILLEGAL_FUNCTION,
        Refusal::TooManyFrames => exception::ILLEGAL_DATA_VALUE,
        Refusal::QueueFull => exception::SERVER_DEVICE_BUSY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pdu(function: u8, ask: &NativeAsk, outcome: &NativeOutcome) -> Vec<u8> {
        let form = Form::of(function, ask);
        let mut out = Vec::new();
        form.encode(&mut out, form.judge(outcome));
        out
    }

    const fn read(count: u16) -> NativeAsk {
        NativeAsk::Read { address: 0x0101, count }
    }

    fn write(values: &[u16]) -> NativeAsk {
        NativeAsk::Write { address: 0x0203, values: values.to_vec() }
    }

    #[test]
    fn words_are_answered_with_the_function_of_the_request() {
        let outcome = NativeOutcome::Words([6000, 1].into());
        assert_eq!(pdu(3, &read(2), &outcome), [3, 4, 0x17, 0x70, 0, 1]);
        assert_eq!(pdu(4, &read(2), &outcome), [4, 4, 0x17, 0x70, 0, 1]);
        assert_eq!(pdu(3, &read(125), &NativeOutcome::Words([7; 125].into())).len(), 252);
    }

    #[test]
    fn a_write_is_answered_with_its_first_words() {
        assert_eq!(pdu(6, &write(&[300]), &NativeOutcome::Written), [6, 2, 3, 1, 0x2C]);
        assert_eq!(pdu(0x10, &write(&[300]), &NativeOutcome::Written), [0x10, 2, 3, 0, 1]);
        assert_eq!(pdu(0x10, &write(&[300, 7]), &NativeOutcome::Written), [0x10, 2, 3, 0, 2]);
        assert_eq!(pdu(6, &write(&[300]), &NativeOutcome::KeptOldValue(100)), [0x86, 4]);
    }

    #[test]
    fn an_outcome_that_does_not_fit_is_never_passed_on() {
        let one = NativeOutcome::Words([6000].into());
        assert_eq!(pdu(3, &read(2), &one), [0x83, 4]);
        assert_eq!(pdu(6, &write(&[1]), &one), [0x86, 4]);
        assert_eq!(pdu(3, &read(1), &NativeOutcome::Words(vec![0; 257].into())), [0x83, 4]);
        assert_eq!(pdu(3, &read(1), &NativeOutcome::Written), [0x83, 4]);
    }

    #[test]
    fn every_other_end_is_one_exception() {
        for (outcome, code) in [
            (NativeOutcome::DriveException(0x02), 0x02),
            (NativeOutcome::DriveException(0x21), 0x21),
            (NativeOutcome::Refused(Refusal::NoSuchUnit), 0x0A),
            (NativeOutcome::Refused(Refusal::LineDown), 0x0A),
            (NativeOutcome::Refused(Refusal::Guard(crate::domain::command::Reason::ReadOnly)), 0x01),
            (NativeOutcome::Refused(Refusal::TooManyFrames), 0x03),
            (NativeOutcome::Refused(Refusal::QueueFull), 0x06),
            (NativeOutcome::NoReply, 0x0B),
            (NativeOutcome::Expired, 0x0B),
        ] {
            for (function, ask) in [(3, read(1)), (4, read(1)), (6, write(&[1])), (0x10, write(&[1]))] {
                assert_eq!(pdu(function, &ask, &outcome), [function | 0x80, code], "{outcome:?}");
            }
        }
    }
}
