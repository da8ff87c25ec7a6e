//! From a client's PDU to its request, or to the exact exception that answers it.

use super::ask::{BitTable, ModbusRequest, PackedBits, WordTable};
use super::function as client;
use crate::wire::exception;
use crate::wire::pdu::{self, function};

/// Number of registers, and of bits, that can be addressed.
const ADDRESS_SPACE: u32 = 0x1_0000;
/// Most bits that one read may ask for (V1.1b3, 6.1).
const MAX_READ_BITS: u16 = 2000;
/// Most bits that one write may carry (V1.1b3, 6.11).
const MAX_WRITE_BITS: u16 = 1968;
/// Most words that a write may carry that also reads (V1.1b3, 6.17).
const MAX_READ_WRITE_WORDS: u16 = 121;

/// The request in `pdu`. Whether the unit supports it is not known here.
///
/// The order of the checks is that of the state diagrams of the Modbus application protocol V1.1b3
/// (section 6): function, then form and quantity, then address.
///
/// # Errors
/// The exception code of the answer: 01 for a function that no unit has, 03 for a length, quantity, byte count or
/// coil value that is wrong, 02 for a range that passes 0xFFFF.
pub fn parse(pdu: &[u8]) -> Result<ModbusRequest, u8> {
    let (code, data) = pdu.split_first().ok_or(exception::ILLEGAL_FUNCTION)?;
    match *code {
        client::READ_COILS => read_bits(data, BitTable::Coils),
        client::READ_DISCRETE => read_bits(data, BitTable::Discrete),
        function::READ_HOLDING => read_words(data, WordTable::Holding),
        function::READ_INPUT => read_words(data, WordTable::Input),
        function::DIAGNOSTICS => loop_test(data),
        client::WRITE_COIL => write_coil(data),
        function::WRITE_SINGLE => write_word(data),
        client::WRITE_COILS => write_coils(data),
        function::WRITE_MULTIPLE => write_words(data),
        client::MASK_WRITE => mask_word(data),
        client::READ_WRITE => read_write(data),
        client::ENCAPSULATED => identify(data),
        _ => Err(exception::ILLEGAL_FUNCTION),
    }
}

fn read_bits(data: &[u8], table: BitTable) -> Result<ModbusRequest, u8> {
    let (address, count, []) = split_head(data)? else {
        return Err(exception::ILLEGAL_DATA_VALUE);
    };
    check_range(address, count, MAX_READ_BITS)?;
    Ok(ModbusRequest::ReadBits {
        table,
        address,
        count,
    })
}

fn read_words(data: &[u8], table: WordTable) -> Result<ModbusRequest, u8> {
    let (address, count, []) = split_head(data)? else {
        return Err(exception::ILLEGAL_DATA_VALUE);
    };
    check_range(address, count, pdu::MAX_READ_WORDS)?;
    Ok(ModbusRequest::ReadWords {
        table,
        address,
        count,
    })
}

/// The sub-functions other than the loop test concern a device's own counters, which no unit has.
fn loop_test(data: &[u8]) -> Result<ModbusRequest, u8> {
    match split_head(data)? {
        (0, data, []) => Ok(ModbusRequest::LoopTest { data }),
        (0, ..) => Err(exception::ILLEGAL_DATA_VALUE),
        _ => Err(exception::ILLEGAL_FUNCTION),
    }
}

fn write_coil(data: &[u8]) -> Result<ModbusRequest, u8> {
    match split_head(data)? {
        (address, client::COIL_ON, []) => Ok(ModbusRequest::WriteCoil { address, on: true }),
        (address, 0, []) => Ok(ModbusRequest::WriteCoil { address, on: false }),
        _ => Err(exception::ILLEGAL_DATA_VALUE),
    }
}

fn write_word(data: &[u8]) -> Result<ModbusRequest, u8> {
    let (address, value, []) = split_head(data)? else {
        return Err(exception::ILLEGAL_DATA_VALUE);
    };
    Ok(ModbusRequest::WriteWord { address, value })
}

fn write_coils(data: &[u8]) -> Result<ModbusRequest, u8> {
    let (address, count, [bytes, values @ ..]) = split_head(data)? else {
        return Err(exception::ILLEGAL_DATA_VALUE);
    };
    if usize::from(*bytes) != values.len() {
        return Err(exception::ILLEGAL_DATA_VALUE);
    }
    let values = PackedBits::new(values, count).ok_or(exception::ILLEGAL_DATA_VALUE)?;
    check_range(address, count, MAX_WRITE_BITS)?;
    Ok(ModbusRequest::WriteCoils { address, values })
}

fn write_words(data: &[u8]) -> Result<ModbusRequest, u8> {
    let (address, values) = block(data, pdu::MAX_WRITE_WORDS)?;
    check_address(address, values.len() as u16)?;
    Ok(ModbusRequest::WriteWords { address, values })
}

fn mask_word(data: &[u8]) -> Result<ModbusRequest, u8> {
    let (address, and, [high, low]) = split_head(data)? else {
        return Err(exception::ILLEGAL_DATA_VALUE);
    };
    Ok(ModbusRequest::MaskWord {
        address,
        and,
        or: u16::from_be_bytes([*high, *low]),
    })
}

fn read_write(data: &[u8]) -> Result<ModbusRequest, u8> {
    let (read_address, read_count, write) = split_head(data)?;
    check_quantity(read_count, pdu::MAX_READ_WORDS)?;
    let (address, values) = block(write, MAX_READ_WRITE_WORDS)?;
    check_address(read_address, read_count)?;
    check_address(address, values.len() as u16)?;
    Ok(ModbusRequest::ReadWriteWords {
        read_address,
        read_count,
        address,
        values,
    })
}

/// Other transports than device identification are functions of their own, which no unit has.
fn identify(data: &[u8]) -> Result<ModbusRequest, u8> {
    match *data {
        [client::DEVICE_IDENTIFICATION, access, object] => {
            Ok(ModbusRequest::Identify { access, object })
        }
        [] | [client::DEVICE_IDENTIFICATION, ..] => Err(exception::ILLEGAL_DATA_VALUE),
        _ => Err(exception::ILLEGAL_FUNCTION),
    }
}

/// First address and words of a block of at most `most` words; whether it passes 0xFFFF is not checked.
fn block(data: &[u8], most: u16) -> Result<(u16, Vec<u16>), u8> {
    let (address, count, [bytes, values @ ..]) = split_head(data)? else {
        return Err(exception::ILLEGAL_DATA_VALUE);
    };
    if usize::from(*bytes) != values.len() || values.len() != 2 * usize::from(count) {
        return Err(exception::ILLEGAL_DATA_VALUE);
    }
    check_quantity(count, most)?;
    Ok((address, pdu::words(values)))
}

/// The two words that nearly every request begins with, and what follows them.
fn split_head(data: &[u8]) -> Result<(u16, u16, &[u8]), u8> {
    let (head, tail) = data
        .split_first_chunk::<4>()
        .ok_or(exception::ILLEGAL_DATA_VALUE)?;
    Ok((
        u16::from_be_bytes([head[0], head[1]]),
        u16::from_be_bytes([head[2], head[3]]),
        tail,
    ))
}

fn check_range(address: u16, count: u16, most: u16) -> Result<(), u8> {
    check_quantity(count, most)?;
    check_address(address, count)
}

fn check_quantity(count: u16, most: u16) -> Result<(), u8> {
    if (1..=most).contains(&count) {
        Ok(())
    } else {
        Err(exception::ILLEGAL_DATA_VALUE)
    }
}

fn check_address(address: u16, count: u16) -> Result<(), u8> {
    let end = u32::from(address) + u32::from(count);
    if end <= ADDRESS_SPACE {
        Ok(())
    } else {
        Err(exception::ILLEGAL_DATA_ADDRESS)
    }
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
                let table = if function == 3 {
                    WordTable::Holding
                } else {
                    WordTable::Input
                };
                assert_eq!(
                    parse(&read(function, address, count)),
                    Ok(ModbusRequest::ReadWords {
                        table,
                        address,
                        count
                    })
                );
            }
        }
    }

    #[test]
    fn a_wrong_quantity_is_03_and_reported_before_a_wrong_address() {
        for function in [3, 4] {
            for (address, count) in [(0, 0), (0, 126), (0, 0xFFFF), (0xFFFF, 0), (0xFFFF, 126)] {
                assert_eq!(
                    parse(&read(function, address, count)),
                    Err(3),
                    "{address} {count}"
                );
            }
            for (address, count) in [(0xFFFF, 2), (0xFF84, 125)] {
                assert_eq!(
                    parse(&read(function, address, count)),
                    Err(2),
                    "{address} {count}"
                );
            }
        }
    }

    #[test]
    fn writes_are_06_and_10_hex() {
        let single = ModbusRequest::WriteWord {
            address: 0xFFFF,
            value: 0x1770,
        };
        assert_eq!(parse(&[6, 0xFF, 0xFF, 0x17, 0x70]), Ok(single));
        let pair = ModbusRequest::WriteWords {
            address: 4,
            values: vec![0xABAB, 0xABAB],
        };
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
            assert_eq!(
                parse(&block(0, count, bytes, data)),
                Err(3),
                "{count} {bytes} {data}"
            );
        }
        assert_eq!(parse(&block(0xFFFF, 2, 4, 4)), Err(2));
        assert_eq!(parse(&block(0xFF86, 123, 246, 246)), Err(2));
        assert_eq!(parse(&[0x10, 0, 4, 0, 2]), Err(3), "no byte count");
    }

    #[test]
    fn a_wrong_length_is_03() {
        for function in [1, 2, 3, 4, 5, 6] {
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
    fn bits_are_01_and_02() {
        for (function, table) in [(1, BitTable::Coils), (2, BitTable::Discrete)] {
            for (address, count) in [(0, 1), (0xFFFF, 1), (0, 2000), (0xF830, 2000)] {
                assert_eq!(
                    parse(&read(function, address, count)),
                    Ok(ModbusRequest::ReadBits {
                        table,
                        address,
                        count
                    })
                );
            }
            for (address, count) in [(0, 0), (0, 2001), (0xFFFF, 2001), (0, 0xFFFF)] {
                assert_eq!(
                    parse(&read(function, address, count)),
                    Err(3),
                    "{address} {count}"
                );
            }
            for (address, count) in [(0xFFFF, 2), (0xF831, 2000)] {
                assert_eq!(
                    parse(&read(function, address, count)),
                    Err(2),
                    "{address} {count}"
                );
            }
        }
    }

    #[test]
    fn a_coil_is_on_or_off_and_nothing_else() {
        assert_eq!(
            parse(&[5, 0, 3, 0xFF, 0]),
            Ok(ModbusRequest::WriteCoil {
                address: 3,
                on: true
            })
        );
        assert_eq!(
            parse(&[5, 0xFF, 0xFF, 0, 0]),
            Ok(ModbusRequest::WriteCoil {
                address: 0xFFFF,
                on: false
            })
        );
        for value in [1, 0xFF, 0xFF01, 0x0100, 0xFFFF] {
            assert_eq!(parse(&read(5, 0, value)), Err(3), "{value}");
        }
    }

    #[test]
    fn coils_come_in_just_the_bytes_that_they_need() {
        let values = PackedBits::new(&[0xCD, 0x01], 10).unwrap();
        assert_eq!(
            parse(&[0x0F, 0, 0x13, 0, 10, 2, 0xCD, 1]),
            Ok(ModbusRequest::WriteCoils {
                address: 0x13,
                values
            })
        );
        let coils = |address: u16, count: u16, bytes: u8, data: usize| {
            let mut pdu = block(address, count, bytes, data);
            pdu[0] = 0x0F;
            parse(&pdu)
        };
        assert!(coils(0, 1968, 246, 246).is_ok() && coils(0xFFFF, 1, 1, 1).is_ok());
        for (count, bytes, data) in [
            (0, 0, 0),
            (1969, 247, 247),
            (9, 1, 1),
            (8, 2, 2),
            (8, 1, 2),
            (8, 2, 1),
            (8, 0, 0),
        ] {
            assert_eq!(
                coils(0, count, bytes, data),
                Err(3),
                "{count} {bytes} {data}"
            );
        }
        assert_eq!(coils(0xFFFF, 2, 1, 1), Err(2));
        assert_eq!(parse(&[0x0F, 0, 0, 0, 1]), Err(3), "no byte count");
    }

    #[test]
    fn masks_are_16_hex() {
        let mask = ModbusRequest::MaskWord {
            address: 4,
            and: 0xF2,
            or: 0x25,
        };
        assert_eq!(parse(&[0x16, 0, 4, 0, 0xF2, 0, 0x25]), Ok(mask));
        for wrong in [
            &[0x16][..],
            &[0x16, 0, 4, 0, 0xF2, 0],
            &[0x16, 0, 4, 0, 0xF2, 0, 0x25, 0],
        ] {
            assert_eq!(parse(wrong), Err(3));
        }
    }

    fn both(
        read: (u16, u16),
        write: (u16, u16),
        bytes: u8,
        data: usize,
    ) -> Result<ModbusRequest, u8> {
        let mut pdu = vec![0x17];
        pdu::put_words(&mut pdu, &[read.0, read.1, write.0, write.1]);
        pdu.push(bytes);
        pdu.extend(std::iter::repeat_n(0xAB, data));
        parse(&pdu)
    }

    #[test]
    fn a_write_that_also_reads_is_17_hex() {
        let ask = ModbusRequest::ReadWriteWords {
            read_address: 3,
            read_count: 6,
            address: 14,
            values: vec![0xABAB; 3],
        };
        assert_eq!(both((3, 6), (14, 3), 6, 6), Ok(ask));
        assert!(both((0xFF83, 125), (0xFF87, 121), 242, 242).is_ok());
        for (read, write, bytes, data) in [
            ((0, 0), (0, 1), 2, 2),
            ((0, 126), (0, 1), 2, 2),
            ((0, 1), (0, 0), 0, 0),
            ((0, 1), (0, 122), 244, 244),
            ((0, 1), (0, 1), 2, 3),
            ((0, 1), (0, 1), 3, 2),
            ((0, 1), (0, 2), 2, 2),
            ((0xFFFF, 126), (0, 1), 2, 2),
        ] {
            assert_eq!(
                both(read, write, bytes, data),
                Err(3),
                "{read:?} {write:?} {bytes} {data}"
            );
        }
        assert_eq!(both((0xFFFF, 2), (0, 1), 2, 2), Err(2));
        assert_eq!(both((0, 2), (0xFFFF, 2), 4, 4), Err(2));
        assert_eq!(
            parse(&[0x17, 0, 0, 0, 1, 0, 0, 0, 1]),
            Err(3),
            "no byte count"
        );
    }

    #[test]
    fn of_the_transports_only_device_identification_is_known() {
        assert_eq!(
            parse(&[0x2B, 0x0E, 1, 0]),
            Ok(ModbusRequest::Identify {
                access: 1,
                object: 0
            })
        );
        assert_eq!(
            parse(&[0x2B, 0x0E, 9, 0xFF]),
            Ok(ModbusRequest::Identify {
                access: 9,
                object: 0xFF
            })
        );
        for wrong in [
            &[0x2B][..],
            &[0x2B, 0x0E],
            &[0x2B, 0x0E, 1],
            &[0x2B, 0x0E, 1, 0, 0],
        ] {
            assert_eq!(parse(wrong), Err(3));
        }
        assert_eq!(parse(&[0x2B, 0x0D, 1, 0]), Err(1));
    }

    #[test]
    fn every_ask_knows_its_function() {
        for pdu in [
            &[1, 0, 0, 0, 1][..],
            &[2, 0, 0, 0, 1],
            &[3, 0, 0, 0, 1],
            &[4, 0, 0, 0, 1],
            &[5, 0, 0, 0, 0],
            &[6, 0, 0, 0, 1],
            &[8, 0, 0, 0xA5, 0x37],
            &[0x0F, 0, 0, 0, 1, 1, 1],
            &[0x10, 0, 0, 0, 1, 2, 0, 1],
            &[0x16, 0, 0, 0, 1, 0, 0],
            &[0x17, 0, 0, 0, 1, 0, 0, 0, 1, 2, 0, 1],
            &[0x2B, 0x0E, 1, 0],
        ] {
            let ask = parse(pdu).unwrap();
            assert_eq!(ask.function(), pdu[0]);
            assert_eq!(
                ask.writes(),
                [5, 6, 0x0F, 0x10, 0x16, 0x17].contains(&pdu[0])
            );
        }
    }

    #[test]
    fn of_the_diagnostics_only_the_loop_test_is_known() {
        assert_eq!(
            parse(&[8, 0, 0, 0xA5, 0x37]),
            Ok(ModbusRequest::LoopTest { data: 0xA537 })
        );
        assert_eq!(parse(&[8, 0, 1, 0, 0]), Err(1), "restart communications");
        for wrong in [&[8][..], &[8, 0, 0, 1], &[8, 0, 0, 1, 2, 3, 4]] {
            assert_eq!(parse(wrong), Err(3), "{wrong:?}");
        }
    }

    #[test]
    fn every_other_function_is_01_whatever_its_form() {
        let known = [1, 2, 3, 4, 5, 6, 8, 0x0F, 0x10, 0x16, 0x17, 0x2B];
        for function in (0..=255).filter(|function| !known.contains(function)) {
            assert_eq!(parse(&[function]), Err(1));
            assert_eq!(parse(&read(function, 0, 1)), Err(1));
        }
    }
}
