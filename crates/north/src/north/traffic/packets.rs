//! From a frame as the gateway reports it to a packet that network analysers understand.

use super::pcapng::{self, CaptureHeader, CapturePacket, PacketDirection};
use crate::domain::calendar;
use crate::domain::link::Framing;
use crate::domain::version::PROGRAM_VERSION;
use crate::north::api::{FrameDocument, TrafficLineDocument};
use crate::toml_file::words::SHOWN_FRAMINGS;

/// The dissector for RTU frames.
const RTU: &str = "mbrtu";
/// The dissector for Modbus TCP.
const MODBUS_TCP: &str = "mbtcp";
/// The dissector for text. Frames of ASCII lines are text: there is no dissector for those.
const TEXT: &str = "data-text-lines";
/// The dissector for unknown bytes.
const BYTES: &str = "data";

/// A frame as the gateway reports it, ready for a packet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PacketFrame {
    /// Microseconds since 1970-01-01 UTC.
    pub unix_us: u64,
    /// Its direction.
    pub direction: PacketDirection,
    /// Whether it is a request to a drive.
    pub is_for_a_drive: bool,
    /// The name of its dissector.
    pub protocol: &'static str,
    /// The bytes.
    pub bytes: Vec<u8>,
    /// Its description in words.
    pub comment: String,
}

impl PacketFrame {
    /// The content of `frame`, of a line with this framing; `None` if it cannot be parsed.
    #[must_use]
    pub fn of(frame: &FrameDocument, framing: Framing) -> Option<Self> {
        let kind = &*frame.kind;
        let bytes = unhex(&frame.bytes)?;
        let protocol = match (kind, framing) {
            ("noise", _) => BYTES,
            (_, Framing::Rtu) => RTU,
            (_, Framing::Ascii) => TEXT,
            (_, Framing::Mbap) => MODBUS_TCP,
        };
        let direction = if kind == "request" {
            PacketDirection::Out
        } else {
            PacketDirection::In
        };
        let unix_us = unix_us(&frame.at)?;
        let is_for_a_drive = is_for_a_drive(kind);
        Some(Self {
            unix_us,
            direction,
            is_for_a_drive,
            protocol,
            bytes,
            comment: comment(frame),
        })
    }

    /// The frame as a packet, with `dropped` packets lost before it.
    #[must_use]
    pub fn packet(&self, dropped: u64) -> CapturePacket<'_> {
        let Self {
            unix_us,
            direction,
            is_for_a_drive,
            protocol,
            bytes,
            comment,
        } = self;
        let unix_us = *unix_us;
        let direction = *direction;
        let is_for_a_drive = *is_for_a_drive;
        CapturePacket {
            unix_us,
            direction,
            is_for_a_drive,
            protocol,
            bytes,
            comment,
            dropped,
        }
    }
}

/// The framing of `line`, as the gateway describes a line before its traffic; RTU if it has an unknown word for it.
#[must_use]
pub fn framing_of(line: &TrafficLineDocument) -> Framing {
    let known = SHOWN_FRAMINGS
        .iter()
        .find(|(word, _)| line.framing == *word);
    known.map_or(Framing::Rtu, |(_, framing)| *framing)
}

/// The beginning of a file with the frames of `line`, as the gateway describes a line before its traffic; `host` is the
/// machine and its system.
#[must_use]
pub fn beginning_of(line: &TrafficLineDocument, host: (&str, &str)) -> Vec<u8> {
    let drives = line.drives.iter().map(|drive| {
        format!(
            "{} {} at station {}",
            drive.model, drive.name, drive.station
        )
    });
    let link = match &line.link {
        Some(link) => format!("{link} "),
        None => String::new(),
    };
    let description = [format!("{}, {link}{}", line.port, line.framing)]
        .into_iter()
        .chain(drives);
    pcapng::beginning(&CaptureHeader {
        hardware: host.0,
        os: host.1,
        application: &format!("vfd-gateway {PROGRAM_VERSION}"),
        line: &line.line,
        description: &description.collect::<Vec<_>>().join(", "),
        baud: line.baud.unwrap_or(0).into(),
    })
}

fn is_for_a_drive(kind: &str) -> bool {
    matches!(kind, "request" | "echo" | "other_master")
}

/// `request to pump-1 (poll): read 0x0101 output frequency, 1 word`.
fn comment(frame: &FrameDocument) -> String {
    let between = if is_for_a_drive(&frame.kind) {
        "to"
    } else {
        "of"
    };
    let mut text = frame.kind.replace('_', " ");
    match (&frame.drive, frame.station) {
        (Some(drive), _) => text += &format!(" {between} {drive}"),
        (None, Some(station)) => text += &format!(" {between} station {station}"),
        (None, None) => {}
    }
    if let Some(why) = &frame.why {
        text += &format!(" ({why})");
    }
    format!("{text}: {}", frame.text)
}

fn unhex(text: &str) -> Option<Vec<u8>> {
    let digit = |byte: &u8| {
        char::from(*byte)
            .to_digit(16)
            .and_then(|digit| u8::try_from(digit).ok())
    };
    let pairs = text.as_bytes().chunks(2);
    pairs
        .map(|pair| {
            if let [high, low] = pair {
                Some(digit(high)? << 4 | digit(low)?)
            } else {
                None
            }
        })
        .collect()
}

/// `2026-01-31T08:00:00.250125Z` in microseconds since 1970-01-01 UTC.
fn unix_us(text: &str) -> Option<u64> {
    let (text, micros) = text
        .strip_suffix('Z')?
        .split_at_checked(text.len().checked_sub(4)?)?;
    let micros: u64 = micros.parse().ok()?;
    let millis = u64::try_from(calendar::parse(text)?.unix_ms).ok()?;
    Some(millis * 1000 + micros)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    /// The packet of a frame as it is read from the wire.
    fn packet_of(frame: &Value, framing: Framing) -> Option<PacketFrame> {
        PacketFrame::of(&serde_json::from_value(frame.clone()).ok()?, framing)
    }

    #[test]
    fn a_frame_becomes_a_packet() {
        let frame = json!({
            "at": "1970-01-01T00:00:01.002003Z", "kind": "request", "why": "poll", "bytes": "010301010001D436",
            "gap_ms": null, "station": 1, "drive": "pump-1", "function": 3, "text": "read 0x0101", "values": [],
        });
        let packet = packet_of(&frame, Framing::Rtu).unwrap();
        assert_eq!(
            (packet.unix_us, packet.direction, packet.protocol),
            (1_002_003, PacketDirection::Out, "mbrtu")
        );
        assert!(packet.is_for_a_drive);
        assert_eq!(packet.bytes, [1, 3, 1, 1, 0, 1, 0xD4, 0x36]);
        assert_eq!(packet.comment, "request to pump-1 (poll): read 0x0101");
        assert_eq!(
            packet_of(&frame, Framing::Ascii).unwrap().protocol,
            "data-text-lines"
        );
        let line = serde_json::from_value(json!({ "framing": "modbus-tcp" })).unwrap();
        assert_eq!(
            packet_of(&frame, framing_of(&line)).unwrap().protocol,
            "mbtcp"
        );
        let noise = json!({
            "at": "1970-01-01T00:00:00.000001Z", "kind": "noise", "bytes": "00", "station": null,
            "text": "1 byte that makes no frame",
        });
        let packet = packet_of(&noise, Framing::Rtu).unwrap();
        assert_eq!(
            (packet.unix_us, packet.direction, packet.protocol),
            (1, PacketDirection::In, "data")
        );
        assert_eq!(packet.comment, "noise: 1 byte that makes no frame");
        let other = json!({ "at": "1970-01-01T00:00:00.000001Z", "kind": "other_master", "bytes": "", "station": 9,
            "text": "x" });
        assert_eq!(
            packet_of(&other, Framing::Rtu).unwrap().comment,
            "other master to station 9: x"
        );
    }

    #[test]
    fn what_is_not_understood_is_none() {
        let good = json!({ "at": "1970-01-01T00:00:01.002003Z", "kind": "reply", "bytes": "0A", "text": "" });
        assert!(packet_of(&good, Framing::Rtu).is_some());
        for (key, wrong) in [
            ("at", "yesterday"),
            ("at", "1970-01-01T00:00:01.002Z"),
            ("bytes", "0"),
            ("bytes", "xy"),
        ] {
            let mut frame = good.clone();
            frame[key] = wrong.into();
            assert_eq!(packet_of(&frame, Framing::Rtu), None, "{key} {wrong}");
        }
        for key in ["at", "kind", "bytes"] {
            let mut frame = good.clone();
            frame[key] = Value::Null;
            assert_eq!(packet_of(&frame, Framing::Rtu), None, "{key}");
        }
    }
}
