//! The content of a request.

use super::frame::{FrameText, KnownDrive};
use super::register::{in_text, place, values};
use crate::domain::address::{Address, DataTable};
use crate::profile::model::Barrier;
use crate::wire::pdu::{Request, function};

/// What `pdu` requests of `drive`.
pub(super) fn request_text(drive: Option<&KnownDrive>, pdu: &[u8]) -> FrameText {
    match Request::decode(pdu) {
        Some(Request::Read { address, count }) => {
            FrameText::text(read("read", drive, address, count))
        }
        Some(Request::WriteSingle { address, value }) => write(drive, address, &[value]),
        Some(Request::WriteMultiple { address, values }) => write(drive, address, &values),
        Some(Request::Loopback { data }) => {
            let is_refused = drive.is_some_and(|drive| refuses(drive, function::DIAGNOSTICS));
            let refused = if is_refused {
                ", which this model refuses"
            } else {
                ""
            };
            FrameText::text(format!("loop test with 0x{data:04X}{refused}"))
        }
        Some(Request::Unserved { .. }) | None => other(drive, pdu),
    }
}

fn read(verb: &str, drive: Option<&KnownDrive>, address: Address, count: u16) -> String {
    let words = if count == 1 { "word" } else { "words" };
    format!("{verb} {}, {count} {words}", place(drive, address))
}

fn write(drive: Option<&KnownDrive>, address: Address, words: &[u16]) -> FrameText {
    let values = values(drive, address, words);
    FrameText {
        text: format!("write {}", in_text(&values, " = ", true)),
        exception: None,
        values,
    }
}

fn other(drive: Option<&KnownDrive>, pdu: &[u8]) -> FrameText {
    let Some((&code, data)) = pdu.split_first() else {
        return FrameText::text("no function");
    };
    if let (function::READ_INPUT, [first, second, third, fourth]) = (code, data) {
        let address = Address::new(DataTable::Input, u16::from_be_bytes([*first, *second]));
        let count = u16::from_be_bytes([*third, *fourth]);
        return FrameText::text(read("read input", drive, address, count));
    }
    let refused = if drive.is_some_and(|drive| refuses(drive, code)) {
        ", which this model refuses"
    } else {
        ""
    };
    FrameText::text(format!("{}{refused}", function_text(code)))
}

fn refuses(drive: &KnownDrive, code: u8) -> bool {
    drive
        .model
        .barriers
        .iter()
        .any(|barrier| matches!(barrier, Barrier::Refused(refused) if refused.value == code))
}

/// `code` with its name in the standard (Modbus application protocol V1.1b3, section 6).
pub(super) fn function_text(code: u8) -> String {
    let name = match code {
        0x01 => "read coils",
        0x02 => "read discrete inputs",
        0x03 => "read holding registers",
        0x04 => "read input registers",
        0x05 => "write single coil",
        0x06 => "write single register",
        0x07 => "read exception status",
        0x08 => "diagnostics",
        0x0B => "communication event counter",
        0x0F => "write coils",
        0x10 => "write registers",
        0x11 => "report server id",
        0x16 => "mask write register",
        0x17 => "read and write registers",
        0x2B => "device identification",
        _ => return format!("function 0x{code:02X}"),
    };
    format!("function 0x{code:02X}, {name}")
}
