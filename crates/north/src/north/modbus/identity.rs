//! Device identification (2B/0E hex): who this gateway is.

use crate::domain::version::{PROGRAM_NAME, PROGRAM_VERSION};
use crate::wire::exception;

/// The basic objects by their numbers: vendor name, product code, revision.
const OBJECTS: [&str; 3] = [PROGRAM_NAME, PROGRAM_NAME, PROGRAM_VERSION];

/// The basic objects only, as a stream or one by one (V1.1b3, 6.21).
const CONFORMITY: u8 = 0x81;
const TRANSPORT: u8 = super::function::DEVICE_IDENTIFICATION;
/// Access to a single object. Below it are streams of basic, regular and extended objects.
const SINGLE: u8 = 4;

/// What follows the function code of the answer: access, conformity, more to follow (0), next object (0), number of
/// objects, and number, length and text of each.
///
/// A request for more than the basic objects returns those, and a stream from an object that does not exist begins at
/// the first, as the standard requires.
///
/// # Errors
/// 02 for a single object that does not exist, 03 for an unknown access.
pub fn read(access: u8, object: u8) -> Result<Vec<u8>, u8> {
    let is_there = usize::from(object) < OBJECTS.len();
    let (first, last) = match access {
        1..SINGLE if is_there => (object, OBJECTS.len() as u8),
        1..SINGLE => (0, OBJECTS.len() as u8),
        SINGLE if is_there => (object, object + 1),
        SINGLE => return Err(exception::ILLEGAL_DATA_ADDRESS),
        _ => return Err(exception::ILLEGAL_DATA_VALUE),
    };
    let mut out = vec![TRANSPORT, access, CONFORMITY, 0, 0, last - first];
    for number in first..last {
        let text = OBJECTS
            .get(usize::from(number))
            .copied()
            .unwrap_or_default();
        out.extend([number, text.len() as u8]);
        out.extend_from_slice(text.as_bytes());
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn objects(from: usize) -> Vec<u8> {
        let mut out = Vec::new();
        for (number, text) in OBJECTS.iter().enumerate().skip(from) {
            out.extend([number as u8, text.len() as u8]);
            out.extend(text.bytes());
        }
        out
    }

    #[test]
    fn streams_hold_the_basic_objects() {
        for access in [1, 2, 3] {
            let all = [&[0x0E, access, 0x81, 0, 0, 3][..], &objects(0)].concat();
            assert_eq!(read(access, 0).unwrap(), all);
            assert_eq!(
                read(access, 3).unwrap(),
                all,
                "not there: from the beginning"
            );
            assert_eq!(read(access, 0xFF).unwrap(), all);
            assert_eq!(
                read(access, 2).unwrap(),
                [&[0x0E, access, 0x81, 0, 0, 1][..], &objects(2)].concat()
            );
        }
        assert!(objects(0).starts_with(b"\x00\x0bvfd-gateway"));
        assert!(read(1, 0).unwrap().ends_with(PROGRAM_VERSION.as_bytes()));
    }

    #[test]
    fn single_objects_are_there_or_not() {
        let vendor = [&[0x0E, 4, 0x81, 0, 0, 1, 0, 11][..], b"vfd-gateway"].concat();
        assert_eq!(read(4, 0).unwrap(), vendor);
        assert_eq!(read(4, 3), Err(2));
        assert_eq!(read(4, 0x80), Err(2));
    }

    #[test]
    fn another_access_is_no_value() {
        for access in [0, 5, 0x81, 0xFF] {
            assert_eq!(read(access, 0), Err(3));
        }
    }
}
