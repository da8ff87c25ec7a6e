//! From the outcome of a request to the response PDU.

use super::ask::ModbusRequest;
use super::function as client;
use crate::wire::exception;
use crate::wire::pdu::{self, MAX_PDU_BYTES, function};

/// The outcome of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModbusAnswer<'a> {
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
pub(super) struct ResponseForm {
    /// The requested function code; the response carries it.
    function: u8,
    success: SuccessContent,
}

/// The content of the response to a successful request.
#[derive(Clone, Copy, Debug)]
enum SuccessContent {
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
pub(super) enum ResponseBody<'a> {
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

impl ResponseForm {
    /// The form of the answer to `ask`.
    pub(super) fn of(ask: &ModbusRequest) -> Self {
        let success = match ask {
            ModbusRequest::ReadBits { count, .. } => SuccessContent::Bits(*count),
            ModbusRequest::ReadWords { count, .. }
            | ModbusRequest::ReadWriteWords {
                read_count: count, ..
            } => SuccessContent::Words(*count),
            ModbusRequest::LoopTest { data } => SuccessContent::Echo([0, *data]),
            ModbusRequest::WriteCoil { address, on } => {
                SuccessContent::Echo([*address, if *on { client::COIL_ON } else { 0 }])
            }
            ModbusRequest::WriteWord { address, value } => SuccessContent::Echo([*address, *value]),
            ModbusRequest::WriteCoils { address, values } => {
                SuccessContent::Echo([*address, values.count()])
            }
            ModbusRequest::WriteWords { address, values } => {
                SuccessContent::Echo([*address, values.len() as u16])
            }
            ModbusRequest::MaskWord { address, and, or } => {
                SuccessContent::Mask([*address, *and, *or])
            }
            ModbusRequest::Identify { .. } => SuccessContent::Identity,
        };
        Self {
            function: ask.function(),
            success,
        }
    }

    /// The response to the client, or the code of its exception.
    ///
    /// A response that does not fit the request would be false, so it becomes exception 04.
    pub(super) fn judge<'a>(&self, answer: ModbusAnswer<'a>) -> Result<ResponseBody<'a>, u8> {
        match (answer, self.success) {
            (ModbusAnswer::Exception(code), _) => Err(code),
            (ModbusAnswer::Words(words), SuccessContent::Words(count))
                if words.len() == usize::from(count) =>
            {
                Ok(ResponseBody::Words(words))
            }
            (ModbusAnswer::Bits(bytes), SuccessContent::Bits(count))
                if bytes.len() == usize::from(count.div_ceil(8)) =>
            {
                Ok(ResponseBody::Bits { bytes, count })
            }
            // A drive's own bits come as words.
            (ModbusAnswer::Words(words), SuccessContent::Bits(count))
                if words.len() == usize::from(count) =>
            {
                Ok(ResponseBody::EachBit(words))
            }
            (ModbusAnswer::Written, SuccessContent::Echo(words)) => Ok(ResponseBody::Echo(words)),
            (ModbusAnswer::Written, SuccessContent::Mask(words)) => Ok(ResponseBody::Mask(words)),
            (ModbusAnswer::Identity(bytes), SuccessContent::Identity)
                if bytes.len() < MAX_PDU_BYTES =>
            {
                Ok(ResponseBody::Identity(bytes))
            }
            _ => Err(exception::SERVER_DEVICE_FAILURE),
        }
    }

    /// Appends the PDU of the answer to `out`.
    pub(super) fn encode(&self, out: &mut Vec<u8>, result: Result<ResponseBody<'_>, u8>) {
        match result {
            Ok(ResponseBody::Words(words)) => {
                out.extend([self.function, (words.len() * 2) as u8]);
                pdu::put_words(out, words);
            }
            Ok(ResponseBody::EachBit(words)) => {
                out.extend([self.function, words.len().div_ceil(8) as u8]);
                let byte = |eight: &[u16]| {
                    eight
                        .iter()
                        .rev()
                        .fold(0, |byte, bit| byte << 1 | u8::from(*bit != 0))
                };
                out.extend(words.chunks(8).map(byte));
            }
            Ok(ResponseBody::Bits { bytes, count }) => {
                out.extend([self.function, bytes.len() as u8]);
                put_bits(out, bytes, count);
            }
            Ok(ResponseBody::Echo(words)) => {
                out.push(self.function);
                pdu::put_words(out, &words);
            }
            Ok(ResponseBody::Mask(words)) => {
                out.push(self.function);
                pdu::put_words(out, &words);
            }
            Ok(ResponseBody::Identity(bytes)) => {
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

    fn pdu(request: &[u8], answer: ModbusAnswer<'_>) -> Vec<u8> {
        let form = ResponseForm::of(&parse(request).unwrap());
        let mut out = Vec::new();
        form.encode(&mut out, form.judge(answer));
        out
    }

    const READ_TWO: [u8; 5] = [3, 1, 1, 0, 2];

    #[test]
    fn words_are_answered_with_the_function_of_the_request() {
        let words = ModbusAnswer::Words(&[6000, 1]);
        assert_eq!(pdu(&READ_TWO, words), [3, 4, 0x17, 0x70, 0, 1]);
        assert_eq!(pdu(&[4, 1, 1, 0, 2], words), [4, 4, 0x17, 0x70, 0, 1]);
        assert_eq!(
            pdu(&[0x17, 1, 1, 0, 2, 0, 0, 0, 1, 2, 0, 1], words),
            [0x17, 4, 0x17, 0x70, 0, 1]
        );
        assert_eq!(
            pdu(&[3, 0, 0, 0, 125], ModbusAnswer::Words(&[7; 125])).len(),
            252
        );
    }

    #[test]
    fn bits_are_answered_in_bytes_and_padded_with_zeros() {
        assert_eq!(
            pdu(&[1, 0, 0, 0, 4], ModbusAnswer::Bits(&[0xFF])),
            [1, 1, 0x0F]
        );
        assert_eq!(
            pdu(&[2, 0, 0, 0, 8], ModbusAnswer::Bits(&[0xFF])),
            [2, 1, 0xFF]
        );
        assert_eq!(
            pdu(&[2, 0, 0, 0, 10], ModbusAnswer::Bits(&[0x35, 0xFE])),
            [2, 2, 0x35, 2]
        );
        assert_eq!(
            pdu(&[1, 0, 0, 7, 0xD0], ModbusAnswer::Bits(&[1; 250])).len(),
            252
        );
        let of_a_drive = ModbusAnswer::Words(&[1, 0, 1, 0, 0, 0, 0, 0, 1]);
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
            assert_eq!(pdu(request, ModbusAnswer::Written), answer);
            assert_eq!(
                pdu(request, ModbusAnswer::Exception(0x0B)),
                [request[0] | 0x80, 0x0B]
            );
        }
    }

    #[test]
    fn an_identity_is_passed_on_as_it_is() {
        assert_eq!(
            pdu(&[0x2B, 0x0E, 1, 0], ModbusAnswer::Identity(&[0x0E, 1])),
            [0x2B, 0x0E, 1]
        );
        assert_eq!(
            pdu(&[0x2B, 0x0E, 1, 0], ModbusAnswer::Identity(&[0; 253])),
            [0xAB, 4]
        );
    }

    #[test]
    fn an_answer_that_does_not_fit_is_never_passed_on() {
        for wrong in [
            ModbusAnswer::Words(&[6000]),
            ModbusAnswer::Words(&[0; 257]),
            ModbusAnswer::Bits(&[1]),
            ModbusAnswer::Written,
        ] {
            assert_eq!(pdu(&READ_TWO, wrong), [0x83, 4], "{wrong:?}");
        }
        assert_eq!(pdu(&READ_TWO, ModbusAnswer::Identity(&[])), [0x83, 4]);
        assert_eq!(pdu(&[6, 0, 0, 0, 1], ModbusAnswer::Words(&[1])), [0x86, 4]);
        assert_eq!(pdu(&[1, 0, 0, 0, 9], ModbusAnswer::Bits(&[1])), [0x81, 4]);
        assert_eq!(
            pdu(&[2, 0, 0, 0, 9], ModbusAnswer::Words(&[1, 1])),
            [0x82, 4]
        );
        assert_eq!(
            pdu(&[1, 0, 0, 0, 3], ModbusAnswer::Words(&[1, 0, 1, 0])),
            [0x81, 4]
        );
        assert_eq!(pdu(&[0x2B, 0x0E, 1, 0], ModbusAnswer::Written), [0xAB, 4]);
    }

    #[test]
    fn every_exception_is_passed_on() {
        for code in [1, 2, 3, 4, 6, 0x0A, 0x0B, 0x21] {
            for function in [1, 2, 3, 4] {
                assert_eq!(
                    pdu(&[function, 0, 0, 0, 1], ModbusAnswer::Exception(code)),
                    [function | 0x80, code]
                );
            }
        }
    }
}
