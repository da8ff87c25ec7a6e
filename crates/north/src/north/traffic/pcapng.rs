//! Blocks of a pcapng file (draft-ietf-opsawg-pcapng), each of which is complete in itself: a file that ends after any
//! of them is valid.
//!
//! Only three kinds of blocks are needed, so a library would be more to maintain than this.

/// Packets are PDUs that each name their protocol, so that no setting is needed to read them.
const LINKTYPE_WIRESHARK_UPPER_PDU: u16 = 252;

/// The numbers used as ports of drives, and of their master.
const DRIVE_PORT: u32 = 502;
const MASTER_PORT: u32 = 50_000;

/// Numbers of options.
mod option {
    pub const END: u16 = 0;
    pub const COMMENT: u16 = 1;
    pub const SECTION_HARDWARE: u16 = 2;
    pub const SECTION_OS: u16 = 3;
    pub const SECTION_APPLICATION: u16 = 4;
    pub const INTERFACE_NAME: u16 = 2;
    pub const INTERFACE_DESCRIPTION: u16 = 3;
    pub const INTERFACE_SPEED: u16 = 8;
    pub const INTERFACE_TIME_RESOLUTION: u16 = 9;
    pub const PACKET_FLAGS: u16 = 2;
    pub const PACKET_DROPPED: u16 = 4;
}

/// The origin of a capture.
#[derive(Clone, Debug)]
pub struct CaptureHeader<'h> {
    /// The machine, if known.
    pub hardware: &'h str,
    /// The system.
    pub os: &'h str,
    /// The program with its version.
    pub application: &'h str,
    /// The line.
    pub line: &'h str,
    /// A description of the line.
    pub description: &'h str,
    /// Its speed in bit/s.
    pub baud: u64,
}

/// The direction of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketDirection {
    /// To the line.
    Out,
    /// From the line.
    In,
}

/// One packet.
#[derive(Clone, Debug)]
pub struct CapturePacket<'p> {
    /// Microseconds since 1970-01-01 UTC.
    pub unix_us: u64,
    /// Its direction.
    pub direction: PacketDirection,
    /// Whether it is a request to a drive, from any master.
    pub is_for_a_drive: bool,
    /// The name of its protocol's dissector.
    pub protocol: &'p str,
    /// The bytes.
    pub bytes: &'p [u8],
    /// Its description in words.
    pub comment: &'p str,
    /// Packets that were lost before it.
    pub dropped: u64,
}

/// The beginning of a file: its section and the one interface in it.
#[must_use]
pub fn beginning(header: &CaptureHeader<'_>) -> Vec<u8> {
    const BYTE_ORDER: u32 = 0x1A2B_3C4D;
    const LENGTH_UNKNOWN: u64 = u64::MAX;
    const NO_LIMIT: u32 = 0;
    let mut section = Vec::new();
    section.extend(BYTE_ORDER.to_le_bytes());
    section.extend([1, 0, 0, 0]);
    section.extend(LENGTH_UNKNOWN.to_le_bytes());
    put_option(
        &mut section,
        option::SECTION_HARDWARE,
        header.hardware.as_bytes(),
    );
    put_option(&mut section, option::SECTION_OS, header.os.as_bytes());
    put_option(
        &mut section,
        option::SECTION_APPLICATION,
        header.application.as_bytes(),
    );
    put_option(&mut section, option::END, &[]);
    let mut interface = Vec::new();
    interface.extend(LINKTYPE_WIRESHARK_UPPER_PDU.to_le_bytes());
    interface.extend([0, 0]);
    interface.extend(NO_LIMIT.to_le_bytes());
    put_option(
        &mut interface,
        option::INTERFACE_NAME,
        header.line.as_bytes(),
    );
    put_option(
        &mut interface,
        option::INTERFACE_DESCRIPTION,
        header.description.as_bytes(),
    );
    put_option(
        &mut interface,
        option::INTERFACE_SPEED,
        &header.baud.to_le_bytes(),
    );
    put_option(&mut interface, option::INTERFACE_TIME_RESOLUTION, &[6]);
    put_option(&mut interface, option::END, &[]);
    let mut out = block(0x0A0D_0D0A, &section);
    out.extend(block(1, &interface));
    out
}

/// One packet as a block.
#[must_use]
pub fn packet(packet: &CapturePacket<'_>) -> Vec<u8> {
    let data = upper_pdu(packet);
    let length = u32::try_from(data.len()).unwrap_or(u32::MAX).to_le_bytes();
    let mut body = Vec::with_capacity(data.len() + packet.comment.len() + 64);
    body.extend([0; 4]);
    body.extend(((packet.unix_us >> 32) as u32).to_le_bytes());
    body.extend((packet.unix_us as u32).to_le_bytes());
    body.extend(length);
    body.extend(length);
    put_padded(&mut body, &data);
    let flags: u32 = match packet.direction {
        PacketDirection::In => 1,
        PacketDirection::Out => 2,
    };
    put_option(&mut body, option::COMMENT, packet.comment.as_bytes());
    put_option(&mut body, option::PACKET_FLAGS, &flags.to_le_bytes());
    if packet.dropped > 0 {
        put_option(
            &mut body,
            option::PACKET_DROPPED,
            &packet.dropped.to_le_bytes(),
        );
    }
    put_option(&mut body, option::END, &[]);
    block(6, &body)
}

/// The bytes after tags that name their protocol. Tags are in network order.
fn upper_pdu(packet: &CapturePacket<'_>) -> Vec<u8> {
    const TAG_END: u16 = 0;
    const TAG_DISSECTOR_NAME: u16 = 12;
    const TAG_PORT_TYPE: u16 = 24;
    const TAG_SOURCE_PORT: u16 = 25;
    const TAG_DESTINATION_PORT: u16 = 26;
    const TCP: u32 = 2;
    let mut name = Vec::new();
    put_padded(&mut name, packet.protocol.as_bytes());
    // A serial line has no ports. A dissector that knows which one is a drive's distinguishes a request from its echo.
    let (from, to) = if packet.is_for_a_drive {
        (MASTER_PORT, DRIVE_PORT)
    } else {
        (DRIVE_PORT, MASTER_PORT)
    };
    let ports = [TCP, from, to].map(u32::to_be_bytes);
    let tags = [TAG_PORT_TYPE, TAG_SOURCE_PORT, TAG_DESTINATION_PORT]
        .into_iter()
        .zip(ports.iter().map(|it| &it[..]));
    let mut out = Vec::with_capacity(name.len() + packet.bytes.len() + 32);
    for (tag, value) in [(TAG_DISSECTOR_NAME, &name[..])]
        .into_iter()
        .chain(tags)
        .chain([(TAG_END, &[][..])])
    {
        out.extend(tag.to_be_bytes());
        out.extend(u16::try_from(value.len()).unwrap_or(u16::MAX).to_be_bytes());
        out.extend(value);
    }
    out.extend(packet.bytes);
    out
}

fn block(kind: u32, body: &[u8]) -> Vec<u8> {
    let length = u32::try_from(body.len() + 12)
        .unwrap_or(u32::MAX)
        .to_le_bytes();
    [&kind.to_le_bytes(), &length, body, &length].concat()
}

/// A text that is longer than an option can hold is cut off.
fn put_option(out: &mut Vec<u8>, code: u16, value: &[u8]) {
    let length = u16::try_from(value.len()).unwrap_or(u16::MAX);
    out.extend(code.to_le_bytes());
    out.extend(length.to_le_bytes());
    put_padded(out, value.get(..usize::from(length)).unwrap_or(value));
}

fn put_padded(out: &mut Vec<u8>, value: &[u8]) {
    out.extend(value);
    out.resize(out.len() + value.len().next_multiple_of(4) - value.len(), 0);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bytes of `text`, in which everything after a `#` is a comment.
    fn bytes(text: &str) -> Vec<u8> {
        let digits: String = text
            .lines()
            .map(|line| line.split('#').next().unwrap().replace(' ', ""))
            .collect();
        (0..digits.len())
            .step_by(2)
            .map(|at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap())
            .collect()
    }

    #[test]
    fn a_file_begins_with_its_section_and_its_interface() {
        let header = CaptureHeader {
            hardware: "x86",
            os: "Linux",
            application: "vfd",
            line: "a1",
            description: "9600 8N1",
            baud: 9600,
        };
        let golden = bytes(
            "0A0D0D0A 3C000000       # section header, 60 bytes
             4D3C2B1A 0100 0000      # byte order, version 1.0
             FFFFFFFF FFFFFFFF       # of unknown length
             0200 0300 78383600      # hardware x86
             0300 0500 4C696E75 78000000 # Linux
             0400 0300 76666400      # application vfd
             0000 0000 3C000000
             01000000 40000000       # interface, 64 bytes
             FC00 0000 00000000      # upper PDU, no limit
             0200 0200 61310000      # name a1
             0300 0800 39363030 20384E31
             0800 0800 80250000 00000000 # 9600 bit/s
             0900 0100 06000000      # microseconds
             0000 0000 40000000",
        );
        assert_eq!(beginning(&header), golden);
    }

    #[test]
    fn a_packet_names_its_protocol_and_has_its_moment() {
        let frame = [1, 3, 1, 1, 0, 1, 0xD4, 0x36];
        let mut request = CapturePacket {
            unix_us: 0x0006_1234_89AB_CDEF,
            direction: PacketDirection::Out,
            is_for_a_drive: true,
            protocol: "mbrtu",
            bytes: &frame,
            comment: "hey",
            dropped: 0,
        };
        let golden = bytes(
            "06000000 64000000       # enhanced packet, 100 bytes
             00000000                # of the first interface
             34120600 EFCDAB89       # its moment
             30000000 30000000       # 48 bytes
             000C 0008 6D627274 75000000 # dissector mbrtu
             0018 0004 00000002      # as if over TCP
             0019 0004 0000C350      # from a master
             001A 0004 000001F6      # to a drive
             0000 0000
             01030101 0001D436
             0100 0300 68657900      # the comment
             0200 0400 02000000      # outbound
             0000 0000 64000000",
        );
        assert_eq!(packet(&request), golden);
        request.direction = PacketDirection::In;
        request.dropped = 3;
        let lossy = packet(&request);
        let end = bytes("0200 0400 01000000 0400 0800 03000000 00000000 0000 0000 70000000");
        assert!(lossy.ends_with(&end), "{lossy:02X?}");
    }

    #[test]
    fn every_block_says_its_length_twice_and_is_padded() {
        for length in 0..9 {
            let bytes = vec![0xAA; length];
            let comment = "c".repeat(length);
            let one = CapturePacket {
                unix_us: 1,
                direction: PacketDirection::In,
                is_for_a_drive: false,
                protocol: "data",
                bytes: &bytes,
                comment: &comment,
                dropped: 0,
            };
            let block = packet(&one);
            let size = u32::try_from(block.len()).unwrap().to_le_bytes();
            assert_eq!(
                (block.len() % 4, &block[4..8], &block[block.len() - 4..]),
                (0, &size[..], &size[..])
            );
        }
        let long = "x".repeat(70_000);
        let one = CapturePacket {
            unix_us: 1,
            direction: PacketDirection::In,
            is_for_a_drive: false,
            protocol: "data",
            bytes: &[],
            comment: &long,
            dropped: 0,
        };
        assert!(packet(&one).len() < 66_000);
    }
}
