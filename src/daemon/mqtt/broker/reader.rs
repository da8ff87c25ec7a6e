//! Reads the bytes of a packet, and finds packets in the bytes of a connection.

use super::packet::{ProtocolFault, reason};

const SHORT: ProtocolFault = ProtocolFault::malformed("a packet that ends too soon");

/// The rest of a packet.
#[derive(Clone, Copy, Debug)]
pub struct PacketReader<'a> {
    rest: &'a [u8],
}

impl<'a> PacketReader<'a> {
    pub const fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    pub const fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// All remaining bytes.
    pub const fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// Returns an error if bytes remain.
    pub const fn end(&self) -> Result<(), ProtocolFault> {
        if self.rest.is_empty() {
            Ok(())
        } else {
            Err(ProtocolFault::malformed("bytes after the end of a packet"))
        }
    }

    /// The next `count` bytes alone.
    pub fn take(&mut self, count: usize) -> Result<Self, ProtocolFault> {
        Ok(Self {
            rest: self.bytes(count)?,
        })
    }

    pub fn byte(&mut self) -> Result<u8, ProtocolFault> {
        let (first, rest) = self.rest.split_first().ok_or(SHORT)?;
        self.rest = rest;
        Ok(*first)
    }

    pub fn two(&mut self) -> Result<u16, ProtocolFault> {
        let (bytes, rest) = self.rest.split_first_chunk().ok_or(SHORT)?;
        self.rest = rest;
        Ok(u16::from_be_bytes(*bytes))
    }

    pub fn four(&mut self) -> Result<u32, ProtocolFault> {
        let (bytes, rest) = self.rest.split_first_chunk().ok_or(SHORT)?;
        self.rest = rest;
        Ok(u32::from_be_bytes(*bytes))
    }

    /// A number in one to four bytes.
    pub fn variable(&mut self) -> Result<u32, ProtocolFault> {
        let (number, length) = variable(self.rest)?.ok_or(SHORT)?;
        self.bytes(length)?;
        Ok(number)
    }

    /// A packet identifier, which is never 0.
    pub fn packet_id(&mut self) -> Result<u16, ProtocolFault> {
        match self.two()? {
            0 => Err(ProtocolFault::protocol("packet identifier 0")),
            id => Ok(id),
        }
    }

    /// Bytes with a length prefix.
    pub fn binary(&mut self) -> Result<&'a [u8], ProtocolFault> {
        let length = self.two()?;
        self.bytes(usize::from(length))
    }

    /// Text with a length prefix.
    pub fn text(&mut self) -> Result<&'a str, ProtocolFault> {
        let text = str::from_utf8(self.binary()?)
            .map_err(|_| ProtocolFault::malformed("text that is not UTF-8"))?;
        if text.contains('\0') {
            Err(ProtocolFault::malformed("text with a NUL in it"))
        } else {
            Ok(text)
        }
    }

    fn bytes(&mut self, count: usize) -> Result<&'a [u8], ProtocolFault> {
        let (bytes, rest) = self.rest.split_at_checked(count).ok_or(SHORT)?;
        self.rest = rest;
        Ok(bytes)
    }
}

/// A packet among received bytes: its first byte, where its body begins, and where it ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FramedPacket {
    pub first: u8,
    pub body: usize,
    pub end: usize,
}

/// The packet with which `bytes` begin; `None` if it is incomplete. One longer than `max` bytes is an error even if
/// incomplete.
pub fn frame(bytes: &[u8], max: usize) -> Result<Option<FramedPacket>, ProtocolFault> {
    let Some((first, after)) = bytes.split_first() else {
        return Ok(None);
    };
    let Some((length, count)) = variable(after)? else {
        return Ok(None);
    };
    let body = 1 + count;
    let end = body + length as usize;
    if end > max {
        return Err(ProtocolFault {
            reason: reason::PACKET_TOO_LARGE,
            why: "a packet that is too large",
        });
    }
    Ok((bytes.len() >= end).then_some(FramedPacket {
        first: *first,
        body,
        end,
    }))
}

/// The number with which `bytes` begin, and its length; `None` if it is incomplete.
fn variable(bytes: &[u8]) -> Result<Option<(u32, usize)>, ProtocolFault> {
    let mut number = 0;
    for (at, byte) in bytes.iter().take(4).enumerate() {
        number |= u32::from(byte & 0x7F) << (7 * at);
        if byte & 0x80 == 0 {
            // Only the shortest form is allowed.
            let is_shortest = at == 0 || *byte != 0;
            return if is_shortest {
                Ok(Some((number, at + 1)))
            } else {
                Err(ProtocolFault::malformed(
                    "a length that is longer than it must be",
                ))
            };
        }
    }
    if bytes.len() < 4 {
        Ok(None)
    } else {
        Err(ProtocolFault::malformed("a length of more than four bytes"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_is_found_when_it_has_come_as_a_whole() {
        assert_eq!(frame(&[], 100), Ok(None));
        assert_eq!(frame(&[0x30], 100), Ok(None));
        assert_eq!(frame(&[0x30, 2, 0], 100), Ok(None));
        assert_eq!(
            frame(&[0x30, 2, 0, 0, 9], 100),
            Ok(Some(FramedPacket {
                first: 0x30,
                body: 2,
                end: 4
            }))
        );
        assert_eq!(frame(&[0x30, 0x80], 1000), Ok(None));
        let long = [&[0x30, 0x80, 1][..], &[0; 128]].concat();
        assert_eq!(
            frame(&long, 1000),
            Ok(Some(FramedPacket {
                first: 0x30,
                body: 3,
                end: 131
            }))
        );
    }

    #[test]
    fn a_packet_that_is_too_large_is_refused_before_it_has_come() {
        assert_eq!(
            frame(&[0x30, 99], 100).map_err(|it| it.reason),
            Err(reason::PACKET_TOO_LARGE)
        );
        assert!(frame(&[0x30, 98], 100).is_ok());
        for lengths in [
            &[0x30, 0x80, 0x80, 0x80, 0x80][..],
            &[0x30, 0xFF, 0xFF, 0xFF, 0xFF],
            &[0x30, 0x80, 0],
        ] {
            assert_eq!(
                frame(lengths, 100).map_err(|it| it.reason),
                Err(reason::MALFORMED),
                "{lengths:?}"
            );
        }
    }

    #[test]
    fn a_text_is_utf_8_without_nul() {
        assert_eq!(PacketReader::new(&[0, 2, b'a', b'b', 7]).text(), Ok("ab"));
        for wrong in [
            &[0, 1][..],
            &[0],
            &[0, 1, 0],
            &[0, 1, 0xFF],
            &[0, 3, 0xED, 0xA0, 0x80],
        ] {
            assert_eq!(
                PacketReader::new(wrong).text().map_err(|it| it.reason),
                Err(reason::MALFORMED),
                "{wrong:?}"
            );
        }
    }
}
