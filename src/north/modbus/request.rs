//! From the PDU of a client to what is asked of a drive, or to the exact exception that answers it.

use crate::domain::native::NativeAsk;
use crate::wire::exception;
use crate::wire::pdu::{self, function};

/// Number of registers that can be addressed.
const ADDRESS_SPACE: u32 = 0x1_0000;

/// What `pdu` asks of a drive's own registers. 04 is served as 03, because the drives have no input registers.
///
/// The order of the checks is that of the state diagrams of the Modbus application protocol V1.1b3
/// (6.3, 6.4, 6.6, 6.12): function, then form and quantity, then address.
///
/// # Errors
/// The exception code of the answer: 01 for a function that is not served, 03 for a length, quantity
/// or byte count that is wrong, 02 for a range that passes 0xFFFF.
pub fn parse(pdu: &[u8]) -> Result<NativeAsk, u8> {
    let (code, data) = pdu.split_first().ok_or(exception::ILLEGAL_FUNCTION)?;
    match *code {
        function::READ_HOLDING | function::READ_INPUT => parse_read(data),
        function::WRITE_SINGLE => parse_write_single(data),
        function::WRITE_MULTIPLE => parse_write_multiple(data),
        _ => Err(exception::ILLEGAL_FUNCTION),
    }
}

fn parse_read(data: &[u8]) -> Result<NativeAsk, u8> {
    let (address, count, []) = split_head(data)? else { return Err(exception::ILLEGAL_DATA_VALUE) };
    check_range(address, count, pdu::MAX_READ_WORDS)?;
    Ok(NativeAsk::Read { address, count })
}

fn parse_write_single(data: &[u8]) -> Result<NativeAsk, u8> {
    let (address, value, []) = split_head(data)? else { return Err(exception::ILLEGAL_DATA_VALUE) };
    Ok(NativeAsk::Write { address, values: vec![value] })
}

fn parse_write_multiple(data: &[u8]) -> Result<NativeAsk, u8> {
    let (address, count, [bytes, values @ ..]) = split_head(data)? else { return Err(exception::ILLEGAL_DATA_VALUE) };
    if usize::from(*bytes) != values.len() || values.len() != 2 * usize::from(count) {
        return Err(exception::ILLEGAL_DATA_VALUE);
    }
    check_range(address, count, pdu::MAX_WRITE_WORDS)?;
    Ok(NativeAsk::Write { address, values: pdu::words(values) })
}

/// The two words with which every request begins, and what follows them.
fn split_head(data: &[u8]) -> Result<(u16, u16, &[u8]), u8> {
    let (head, tail) = data.split_first_chunk::<4>().ok_or(exception::ILLEGAL_DATA_VALUE)?;
    Ok((u16::from_be_bytes([head[0], head[1]]), u16::from_be_bytes([head[2], head[3]]), tail))
}

fn check_range(address: u16, count: u16, most: u16) -> Result<(), u8> {
    if !(1..=most).contains(&count) {
        return Err(exception::ILLEGAL_DATA_VALUE);
    }
    if u32::from(address) + u32::from(count) > ADDRESS_SPACE {
        return Err(exception::ILLEGAL_DATA_ADDRESS);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(address: u16, count: u16, bytes: u8, data: usize) -> Vec<u8> {
        let mut pdu = vec![0x10];
        pdu::put_words(&mut pdu, &[address, count]);
        pdu.push(bytes);
        pdu.extend(std::iter::repeat_n(0xAB, data));
        pdu
    }

    fn read(function: u8, address: u16, count: u16) -> Vec<u8> {
        let mut pdu = vec![function];
        pdu::put_words(&mut pdu, &[address, count]);
        pdu
    }

    #[test]
    fn reads_are_03_and_04() {
        for function in [3, 4] {
            for (address, count) in [(0, 1), (0x0101, 8), (0, 125), (0xFFFF, 1), (0xFF83, 125)] {
                assert_eq!(parse(&read(function, address, count)), Ok(NativeAsk::Read { address, count }));
            }
        }
    }

    #[test]
    fn a_wrong_quantity_is_03_and_told_before_a_wrong_address() {
        for function in [3, 4] {
            for (address, count) in [(0, 0), (0, 126), (0, 0xFFFF), (0xFFFF, 0), (0xFFFF, 126)] {
                assert_eq!(parse(&read(function, address, count)), Err(3), "{address} {count}");
            }
            for (address, count) in [(0xFFFF, 2), (0xFF84, 125)] {
                assert_eq!(parse(&read(function, address, count)), Err(2), "{address} {count}");
            }
        }
    }

    #[test]
    fn writes_are_06_and_10_hex() {
        let single = NativeAsk::Write { address: 0xFFFF, values: vec![0x1770] };
        assert_eq!(parse(&[6, 0xFF, 0xFF, 0x17, 0x70]), Ok(single));
        let pair = NativeAsk::Write { address: 4, values: vec![0xABAB, 0xABAB] };
        assert_eq!(parse(&block(4, 2, 4, 4)), Ok(pair));
        assert!(parse(&block(0xFF85, 123, 246, 246)).is_ok());
    }

    #[test]
    fn a_wrong_block_is_03_or_02() {
        for (count, bytes, data) in [
            (0, 0, 0),
            (124, 248, 248),
            (2, 3, 4),
            (2, 4, 3),
            (2, 4, 5),
            (2, 4, 0),
            (3, 4, 4),
            (1, 4, 4),
            (2, 5, 5),
            (0x8001, 2, 2),
        ] {
            assert_eq!(parse(&block(0, count, bytes, data)), Err(3), "{count} {bytes} {data}");
        }
        assert_eq!(parse(&block(0xFFFF, 2, 4, 4)), Err(2));
        assert_eq!(parse(&block(0xFF86, 123, 246, 246)), Err(2));
        assert_eq!(parse(&[0x10, 0, 4, 0, 2]), Err(3), "no byte count");
    }

    #[test]
    fn a_wrong_length_is_03() {
        for function in [3, 4, 6] {
            for length in (0..5).chain([6, 253]) {
                let mut pdu = read(function, 1, 1);
                pdu.resize(length.max(1), 0);
                if length != 5 {
                    assert_eq!(parse(&pdu), Err(3), "{function} {length}");
                }
            }
        }
    }

    #[test]
    fn every_other_function_is_01_whatever_its_form() {
        for function in (0..=255).filter(|function| ![3, 4, 6, 0x10].contains(function)) {
            assert_eq!(parse(&[function]), Err(1));
            assert_eq!(parse(&read(function, 0, 1)), Err(1));
        }
    }
}
