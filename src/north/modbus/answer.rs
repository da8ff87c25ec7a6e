//! From the outcome of a request to the response PDU.

use super::ask::Ask;
use super::function as client;
use crate::wire::exception;
use crate::wire::pdu::{self, MAX_PDU_BYTES, function};

/// The outcome of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer<'a> {
    /// The words that were read: as many as were requested.
    Words(&'a [u16]),
    /// The bits that were read, the first in the lowest bit of the first byte: as many bytes as they need.
    Bits(&'a [u8]),
    /// Written.
    Written,
    /// What follows the function code in the answer to 2B/0E hex.
    Identity(&'a [u8]),
    /// The exception with this code.
    Exception(u8),
}

/// What a response must keep of its request.
#[derive(Clone, Copy, Debug)]
pub(super) struct Form {
    /// The requested function code; the response carries it.
    function: u8,
    success: Success,
}

/// The content of the response to a successful request.
#[derive(Clone, Copy, Debug)]
enum Success {
    /// As many words as were requested.
    Words(u16),
    /// As many bits as were requested.
    Bits(u16),
    /// The two words with which the write began: address and value, or address and quantity.
    Echo([u16; 2]),
    /// Address and both masks.
    Mask([u16; 3]),
    /// Objects.
    Identity,
}

/// What follows the function code in a response that is not an exception.
#[derive(Clone, Copy, Debug)]
pub(super) enum Body<'a> {
    /// Byte count and words.
    Words(&'a [u16]),
    /// Byte count and bits, each 0 or 1 in a word of its own.
    EachBit(&'a [u16]),
    /// Byte count and bits.
    Bits { bytes: &'a [u8], count: u16 },
    /// The first two words of the request.
    Echo([u16; 2]),
    /// The three words of the request.
    Mask([u16; 3]),
    /// The bytes as they are.
    Identity(&'a [u8]),
}

impl Form {
    /// The form of the answer to `ask`.
    pub(super) fn of(ask: &Ask) -> Self {
        let success = match ask {
            Ask::ReadBits { count, .. } => Success::Bits(*count),
            Ask::ReadWords { count, .. }
            | Ask::ReadWriteWords {
                read_count: count, ..
            } => Success::Words(*count),
            Ask::LoopTest { data } => Success::Echo([0, *data]),
            Ask::WriteCoil { address, on } => {
                Success::Echo([*address, if *on { client::COIL_ON } else { 0 }])
            }
            Ask::WriteWord { address, value } => Success::Echo([*address, *value]),
            Ask::WriteCoils { address, values } => Success::Echo([*address, values.count()]),
            Ask::WriteWords { address, values } => Success::Echo([*address, values.len() as u16]),
            Ask::MaskWord { address, and, or } => Success::Mask([*address, *and, *or]),
            Ask::Identify { .. } => Success::Identity,
        };
        Self {
            function: ask.function(),
            success,
        }
    }

    /// The response to the client, or the code of its exception.
    ///
    /// A response that does not fit the request would be false, so it becomes exception 04.
    pub(super) fn judge<'a>(&self, answer: Answer<'a>) -> Result<Body<'a>, u8> {
        match (answer, self.success) {
            (Answer::Exception(code), _) => Err(code),
            (Answer::Words(words), Success::Words(count)) if words.len() == usize::from(count) => {
                Ok(Body::Words(words))
            }
            (Answer::Bits(bytes), Success::Bits(count))
                if bytes.len() == usize::from(count.div_ceil(8)) =>
            {
                Ok(Body::Bits { bytes, count })
            }
            // A drive's own bits come as words.
            (Answer::Words(words), Success::Bits(count)) if words.len() == usize::from(count) => {
                Ok(Body::EachBit(words))
            }
            (Answer::Written, Success::Echo(words)) => Ok(Body::Echo(words)),
            (Answer::Written, Success::Mask(words)) => Ok(Body::Mask(words)),
            (Answer::Identity(bytes), Success::Identity) if bytes.len() < MAX_PDU_BYTES => {
                Ok(Body::Identity(bytes))
            }
            _ => Err(exception::SERVER_DEVICE_FAILURE),
        }
    }

    /// Appends the PDU of the answer to `out`.
    pub(super) fn encode(&self, out: &mut Vec<u8>, result: Result<Body<'_>, u8>) {
        match result {
            Ok(Body::Words(words)) => {
                out.extend([self.function, (words.len() * 2) as u8]);
                pdu::put_words(out, words);
            }
            Ok(Body::EachBit(words)) => {
                out.extend([self.function, words.len().div_ceil(8) as u8]);
                let byte = |eight: &[u16]| {
                    eight
                        .iter()
                        .rev()
                        .fold(0, |byte, bit| byte << 1 | u8::from(*bit != 0))
                };
                out.extend(words.chunks(8).map(byte));
            }
            Ok(Body::Bits { bytes, count }) => {
                out.extend([self.function, bytes.len() as u8]);
                put_bits(out, bytes, count);
            }
            Ok(Body::Echo(words)) => {
                out.push(self.function);
                pdu::put_words(out, &words);
            }
            Ok(Body::Mask(words)) => {
                out.push(self.function);
                pdu::put_words(out, &words);
            }
            Ok(Body::Identity(bytes)) => {
                out.push(self.function);
                out.extend_from_slice(bytes);
            }
            Err(code) => encode_exception(out, self.function, code),
        }
    }
}

/// Appends the PDU of the exception `code` to a request of `function`.
pub(super) fn encode_exception(out: &mut Vec<u8>, function: u8, code: u8) {
    out.extend([function | function::EXCEPTION_BIT, code]);
}

/// The bits after the last one are zeros (V1.1b3, 6.1).
fn put_bits(out: &mut Vec<u8>, bytes: &[u8], count: u16) {
    out.extend_from_slice(bytes);
    if !count.is_multiple_of(8)
        && let Some(last) = out.last_mut()
    {
        *last &= (1 << (count % 8)) - 1;
    }
}

#[cfg(test)]
mod tests {
    use super::super::request::parse;
    use super::*;

    fn pdu(request: &[u8], answer: Answer<'_>) -> Vec<u8> {
        let form = Form::of(&parse(request).unwrap());
        let mut out = Vec::new();
        form.encode(&mut out, form.judge(answer));
        out
    }

    const READ_TWO: [u8; 5] = [3, 1, 1, 0, 2];

    #[test]
    fn words_are_answered_with_the_function_of_the_request() {
        let words = Answer::Words(&[6000, 1]);
        assert_eq!(pdu(&READ_TWO, words), [3, 4, 0x17, 0x70, 0, 1]);
        assert_eq!(pdu(&[4, 1, 1, 0, 2], words), [4, 4, 0x17, 0x70, 0, 1]);
        assert_eq!(
            pdu(&[0x17, 1, 1, 0, 2, 0, 0, 0, 1, 2, 0, 1], words),
            [0x17, 4, 0x17, 0x70, 0, 1]
        );
        assert_eq!(pdu(&[3, 0, 0, 0, 125], Answer::Words(&[7; 125])).len(), 252);
    }

    #[test]
    fn bits_are_answered_in_bytes_and_padded_with_zeros() {
        assert_eq!(pdu(&[1, 0, 0, 0, 4], Answer::Bits(&[0xFF])), [1, 1, 0x0F]);
        assert_eq!(pdu(&[2, 0, 0, 0, 8], Answer::Bits(&[0xFF])), [2, 1, 0xFF]);
        assert_eq!(
            pdu(&[2, 0, 0, 0, 10], Answer::Bits(&[0x35, 0xFE])),
            [2, 2, 0x35, 2]
        );
        assert_eq!(pdu(&[1, 0, 0, 7, 0xD0], Answer::Bits(&[1; 250])).len(), 252);
        let of_a_drive = Answer::Words(&[1, 0, 1, 0, 0, 0, 0, 0, 1]);
        assert_eq!(pdu(&[1, 0, 0, 0, 9], of_a_drive), [1, 2, 0b101, 1]);
    }

    #[test]
    fn a_write_is_answered_with_its_first_words() {
        for (request, answer) in [
            (&[6, 2, 3, 1, 0x2C][..], &[6, 2, 3, 1, 0x2C][..]),
            (&[5, 0, 3, 0xFF, 0], &[5, 0, 3, 0xFF, 0]),
            (&[5, 0, 3, 0, 0], &[5, 0, 3, 0, 0]),
            (&[0x0F, 0, 0, 0, 10, 2, 1, 0], &[0x0F, 0, 0, 0, 10]),
            (&[0x10, 2, 3, 0, 1, 2, 1, 0x2C], &[0x10, 2, 3, 0, 1]),
            (&[0x10, 2, 3, 0, 2, 4, 1, 0x2C, 0, 7], &[0x10, 2, 3, 0, 2]),
            (
                &[0x16, 0, 4, 0, 0xF2, 0, 0x25],
                &[0x16, 0, 4, 0, 0xF2, 0, 0x25],
            ),
        ] {
            assert_eq!(pdu(request, Answer::Written), answer);
            assert_eq!(
                pdu(request, Answer::Exception(0x0B)),
                [request[0] | 0x80, 0x0B]
            );
        }
    }

    #[test]
    fn an_identity_is_passed_on_as_it_is() {
        assert_eq!(
            pdu(&[0x2B, 0x0E, 1, 0], Answer::Identity(&[0x0E, 1])),
            [0x2B, 0x0E, 1]
        );
        assert_eq!(
            pdu(&[0x2B, 0x0E, 1, 0], Answer::Identity(&[0; 253])),
            [0xAB, 4]
        );
    }

    #[test]
    fn an_answer_that_does_not_fit_is_never_passed_on() {
        for wrong in [
            Answer::Words(&[6000]),
            Answer::Words(&[0; 257]),
            Answer::Bits(&[1]),
            Answer::Written,
        ] {
            assert_eq!(pdu(&READ_TWO, wrong), [0x83, 4], "{wrong:?}");
        }
        assert_eq!(pdu(&READ_TWO, Answer::Identity(&[])), [0x83, 4]);
        assert_eq!(pdu(&[6, 0, 0, 0, 1], Answer::Words(&[1])), [0x86, 4]);
        assert_eq!(pdu(&[1, 0, 0, 0, 9], Answer::Bits(&[1])), [0x81, 4]);
        assert_eq!(pdu(&[2, 0, 0, 0, 9], Answer::Words(&[1, 1])), [0x82, 4]);
        assert_eq!(
            pdu(&[1, 0, 0, 0, 3], Answer::Words(&[1, 0, 1, 0])),
            [0x81, 4]
        );
        assert_eq!(pdu(&[0x2B, 0x0E, 1, 0], Answer::Written), [0xAB, 4]);
    }

    #[test]
    fn every_exception_is_passed_on() {
        for code in [1, 2, 3, 4, 6, 0x0A, 0x0B, 0x21] {
            for function in [1, 2, 3, 4] {
                assert_eq!(
                    pdu(&[function, 0, 0, 0, 1], Answer::Exception(code)),
                    [function | 0x80, code]
                );
            }
        }
    }
}
