//! The content of a reply, given the request that it answers, and the remains of a damaged one.

use super::frame::{FrameText, KnownDrive, OpenRequest};
use super::register::{in_text, place, values};
use super::request::function_text;
use crate::domain::address::Address;
use crate::domain::link::Framing;
use crate::domain::traffic::FramePurpose;
use crate::wire::exception::{self, ILLEGAL_FUNCTION};
use crate::wire::framing;
use crate::wire::pdu::{self, FUNCTION_ERROR, Reply, Request, function};

/// The content of `pdu` of `drive`, as far as known in answer to what was `asked`.
pub(super) fn reply_text(
    drive: Option<&KnownDrive>,
    pdu: &[u8],
    asked: Option<&OpenRequest>,
) -> FrameText {
    if let [code, exception] = *pdu
        && code & function::EXCEPTION_BIT != 0
    {
        return refusal(drive, exception, asked);
    }
    let request = asked.and_then(|asked| Request::decode(&asked.pdu));
    match request.and_then(|request| Some((request.reply_in(pdu)?, request))) {
        Some((Reply::Words(words), Request::Read { address, .. })) => {
            let values = values(drive, address, &words);
            FrameText {
                text: in_text(&values, " ", false),
                exception: None,
                values,
            }
        }
        Some((Reply::Holds { value: held }, Request::WriteSingle { address, value })) => {
            let values = values(drive, address, &[held]);
            let kept = if held == value {
                "written: "
            } else {
                "not taken, the drive holds "
            };
            FrameText {
                text: format!("{kept}{}", in_text(&values, " = ", true)),
                exception: None,
                values,
            }
        }
        Some((Reply::Echo, Request::Loopback { .. })) => FrameText::text("the loop test came back"),
        Some((
            Reply::Echo,
            Request::WriteMultiple {
                address,
                values: words,
            },
        )) => {
            let values = values(drive, address, &words);
            FrameText {
                text: format!("written: {}", in_text(&values, " = ", true)),
                exception: None,
                values,
            }
        }
        _ => alone(drive, pdu),
    }
}

/// The content of a reply whose request is not known.
fn alone(drive: Option<&KnownDrive>, pdu: &[u8]) -> FrameText {
    match *pdu {
        [
            function::READ_HOLDING | function::READ_INPUT,
            bytes,
            ref data @ ..,
        ] if usize::from(bytes) == data.len() => {
            let words: Vec<_> = pdu::words(data)
                .iter()
                .map(|word| format!("0x{word:04X}"))
                .collect();
            let noun = if words.len() == 1 { "word" } else { "words" };
            FrameText::text(format!(
                "{} {noun} of unknown registers: {}",
                words.len(),
                words.join(" ")
            ))
        }
        [function::WRITE_SINGLE, high, low, value_high, value_low] => {
            let address = Address::holding(u16::from_be_bytes([high, low]));
            let value = u16::from_be_bytes([value_high, value_low]);
            let values = values(drive, address, &[value]);
            FrameText {
                text: format!("after a write: {}", in_text(&values, " = ", true)),
                exception: None,
                values,
            }
        }
        [function::WRITE_MULTIPLE, high, low, count_high, count_low] => {
            let address = Address::holding(u16::from_be_bytes([high, low]));
            let count = u16::from_be_bytes([count_high, count_low]);
            FrameText::text(format!(
                "after a write of {count} words from {} on",
                place(drive, address)
            ))
        }
        [function::DIAGNOSTICS, 0, 0, high, low] => FrameText::text(format!(
            "a loop test came back with 0x{:04X}",
            u16::from_be_bytes([high, low])
        )),
        [code, ..] => FrameText::text(format!("reply to {}", function_text(code))),
        [] => FrameText::text("no function"),
    }
}

/// An exception, in the vendor's words if there are any.
fn refusal(drive: Option<&KnownDrive>, code: u8, asked: Option<&OpenRequest>) -> FrameText {
    let own = drive
        .and_then(|drive| drive.model.exception_text(code))
        .map(|own| own.text.as_str());
    let words = own
        .or(exception::name(code))
        .unwrap_or("no document names it");
    let is_wanted = asked.is_some_and(|asked| {
        matches!(asked.why, Some(FramePurpose::Barrier | FramePurpose::Trial))
            && matches!(code, ILLEGAL_FUNCTION | FUNCTION_ERROR)
    });
    let wanted = if is_wanted { ", as it should be" } else { "" };
    FrameText {
        text: format!("exception 0x{code:02X}: {words}{wanted}"),
        exception: Some(code),
        values: Vec::new(),
    }
}

/// What bytes that form no frame may be left over from.
pub(super) fn damaged(framing: Framing, bytes: &[u8], asked: Option<&OpenRequest>) -> String {
    let count = bytes.len();
    let nothing = || match count {
        1 => "1 byte that makes no frame".to_owned(),
        _ => format!("{count} bytes that make no frame"),
    };
    match framing {
        Framing::Mbap => format!("{count} bytes that make no Modbus TCP message"),
        Framing::Ascii => match bytes {
            [b':', .., b'\r', b'\n'] => {
                format!("a damaged frame: {count} characters whose check is wrong")
            }
            [b':', ..] => format!("{count} characters of a frame that did not end"),
            _ => nothing(),
        },
        Framing::Rtu => {
            let begun = asked.filter(|asked| {
                let code = asked.pdu.first().copied();
                matches!(bytes, [station, first, ..] if *station == asked.station && Some(first & 0x7F) == code)
            });
            let Some(asked) = begun else { return nothing() };
            let is_exception = bytes[1] & function::EXCEPTION_BIT != 0;
            let due = match Request::decode(&asked.pdu) {
                Some(request) if !is_exception => {
                    framing::adu_bytes(framing, request.reply_pdu_bytes())
                }
                _ => framing::adu_bytes(framing, 2),
            };
            match count.cmp(&due) {
                std::cmp::Ordering::Less => format!("a damaged reply: {count} of {due} bytes"),
                std::cmp::Ordering::Equal => {
                    format!("a damaged reply: {count} bytes whose check is wrong")
                }
                std::cmp::Ordering::Greater => {
                    format!("a damaged reply: {count} bytes in the place of {due}")
                }
            }
        }
    }
}
