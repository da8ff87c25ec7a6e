//! Attempts to write that reach no line: they are answered with an exception here. A line records those that reach it.

use super::ask::ModbusRequest;
use super::function as client;
use crate::domain::command::{Reason, Report};
use crate::journal::TriedWrite;
use crate::wire::exception;
use std::fmt::Write;

/// An attempt of one client that reached no line.
#[derive(Clone, Debug, PartialEq)]
pub struct UnsentAttempt {
    /// The unit that was addressed.
    pub unit: u8,
    /// What was tried.
    pub tried: TriedWrite,
    /// Why it had no effect.
    pub report: Report,
}

/// How many words and bytes of one request are shown.
const SHOWN_MAX: usize = 16;

impl ModbusRequest {
    /// Text for what is attempted at `unit`, if it is not known to be an order or registers of a drive.
    #[must_use]
    pub fn tried(&self, unit: u8) -> TriedWrite {
        let mut text = format!("unit {unit}: function {:02X}", self.function());
        let at = |address: &u16| format!(" at {address}");
        text += &match self {
            Self::ReadBits { address, .. } | Self::ReadWords { address, .. } => at(address),
            Self::LoopTest { .. } | Self::Identify { .. } => String::new(),
            Self::WriteCoil { address, on } => format!("{}: {}", at(address), u8::from(*on)),
            Self::WriteWord { address, value } => format!("{}: {value}", at(address)),
            Self::WriteCoils { address, values } => {
                let bits = (0..values.count())
                    .filter_map(|place| values.get(place))
                    .map(u16::from);
                at(address) + &list(bits)
            }
            Self::WriteWords { address, values }
            | Self::ReadWriteWords {
                address, values, ..
            } => at(address) + &list(values.iter().copied()),
            Self::MaskWord { address, and, or } => {
                format!("{}: and {and:04X}, or {or:04X}", at(address))
            }
        };
        TriedWrite::Text(text)
    }
}

/// Text for what an invalid request attempts; `None` if its function does not write.
pub(super) fn of_pdu(unit: u8, pdu: &[u8]) -> Option<TriedWrite> {
    let code = *pdu.first()?;
    if !client::writes(code) {
        return None;
    }
    let mut text = format!("unit {unit}: bytes");
    for byte in pdu.iter().take(SHOWN_MAX) {
        // Writing to a text does not fail.
        let _ = write!(text, " {byte:02X}");
    }
    text += if pdu.len() > SHOWN_MAX {
        " \u{2026}"
    } else {
        ""
    };
    Some(TriedWrite::Text(text))
}

/// Why an invalid request is answered with the exception `code`.
pub(super) const fn reason_of(code: u8) -> Reason {
    match code {
        exception::ILLEGAL_DATA_ADDRESS => Reason::NotListed,
        _ => Reason::NotUnderstood,
    }
}

fn list(values: impl Iterator<Item = u16>) -> String {
    let mut text = String::from(":");
    for (count, value) in values.enumerate() {
        if count == SHOWN_MAX {
            return text + " \u{2026}";
        }
        let _ = write!(text, " {value}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::request::parse;
    use super::*;

    #[test]
    fn an_attempt_says_unit_function_address_and_values() {
        for (pdu, right) in [
            (&[5, 0, 2, 0xFF, 0][..], "unit 9: function 05 at 2: 1"),
            (&[6, 1, 0, 0, 7], "unit 9: function 06 at 256: 7"),
            (
                &[0x0F, 0, 0, 0, 3, 1, 0b101],
                "unit 9: function 0F at 0: 1 0 1",
            ),
            (
                &[0x10, 0, 4, 0, 2, 4, 0, 1, 0, 2],
                "unit 9: function 10 at 4: 1 2",
            ),
            (
                &[0x16, 0, 4, 0, 0xF2, 0, 0x25],
                "unit 9: function 16 at 4: and 00F2, or 0025",
            ),
            (
                &[0x17, 0, 0, 0, 1, 0, 8, 0, 1, 2, 0, 3],
                "unit 9: function 17 at 8: 3",
            ),
        ] {
            assert_eq!(
                parse(pdu).unwrap().tried(9),
                TriedWrite::Text(right.to_owned())
            );
        }
        let long = ModbusRequest::WriteWords {
            address: 0,
            values: vec![0xFFFF; 123],
        }
        .tried(9);
        assert!(matches!(long, TriedWrite::Text(text) if text.len() < 140));
    }

    #[test]
    fn what_is_wrong_in_itself_is_shown_in_bytes() {
        assert_eq!(
            of_pdu(7, &[6, 0, 1]),
            Some(TriedWrite::Text("unit 7: bytes 06 00 01".to_owned()))
        );
        assert_eq!(of_pdu(7, &[3, 0, 1]), None);
        assert_eq!(of_pdu(7, &[]), None);
        assert!(matches!(of_pdu(7, &[0x10; 253]), Some(TriedWrite::Text(text)) if text.len() < 70));
    }
}
