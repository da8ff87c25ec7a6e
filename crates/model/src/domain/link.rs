//! Settings of a serial line and the time its characters take.

use super::ids::Station;
use std::fmt;
use std::time::Duration;

/// Parity bit of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Parity {
    /// No parity bit.
    None,
    /// Even number of ones.
    Even,
    /// Odd number of ones.
    Odd,
}

/// What the line is physically.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Interface {
    /// A bus with up to 32 stations, half duplex.
    Rs485,
    /// One drive, point to point: no broadcast, no direction control.
    Rs232,
}

/// Who switches the direction of an RS-485 adapter: to transmit while a frame is sent, to receive otherwise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum DirectionControl {
    /// The adapter itself, as USB adapters and serial device servers do.
    #[default]
    Adapter,
    /// The driver of the port, through RTS.
    Kernel,
    /// The gateway, through RTS.
    Rts,
}

/// The kind of a port, as far as character times are concerned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PortKind {
    /// A serial device: no reply can arrive sooner than its characters take on the wire.
    Serial,
    /// A pseudo-terminal or a network connection: bytes may arrive at any moment.
    Virtual,
}

/// What to do on a line whose adapter echoes what is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EchoPolicy {
    /// The line is down until the echo is gone.
    Refuse,
    /// Our own bytes are removed from the received data.
    Strip,
}

/// How frames are delimited on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Framing {
    /// Binary, delimited by length and silence.
    Rtu,
    /// Hexadecimal text between ':' and CR LF.
    Ascii,
    /// Modbus TCP: behind a header (MBAP) with the frame's length and the identifier of its transaction.
    Mbap,
}

impl Framing {
    /// Whether a reply carries the number of its request. Then a late reply can be mistaken for no other one, and a copy
    /// of a request for no reply.
    #[must_use]
    pub const fn identifies_replies(self) -> bool {
        matches!(self, Self::Mbap)
    }

    /// Whether frames are made of characters that take their time on a wire.
    #[must_use]
    pub const fn has_characters(self) -> bool {
        !matches!(self, Self::Mbap)
    }
}

/// Speed and character format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LinkSettings {
    /// Bits per second, never 0.
    pub baud: u32,
    /// 7 or 8.
    pub data_bits: u8,
    /// Parity bit.
    pub parity: Parity,
    /// 1 or 2.
    pub stop_bits: u8,
}

impl LinkSettings {
    /// 9600 bit/s, 8 data bits, no parity, 1 stop bit.
    pub const DEFAULT: Self = Self {
        baud: 9600,
        data_bits: 8,
        parity: Parity::None,
        stop_bits: 1,
    };

    /// Bits that one character takes on the wire: start, data, parity, stop.
    #[must_use]
    pub const fn bits_per_char(&self) -> u32 {
        let parity = match self.parity {
            Parity::None => 0,
            Parity::Even | Parity::Odd => 1,
        };
        1 + self.data_bits as u32 + parity + self.stop_bits as u32
    }

    /// Time that `chars` characters take, rounded up to a nanosecond.
    #[must_use]
    pub fn chars(&self, chars: f64) -> Duration {
        let bits = chars * f64::from(self.bits_per_char());
        Duration::from_nanos((bits * 1e9 / f64::from(self.baud.max(1))).ceil() as u64)
    }

    /// Time that `bytes` consecutive bytes take.
    #[must_use]
    pub fn bytes(&self, bytes: usize) -> Duration {
        let bits = bytes as u64 * u64::from(self.bits_per_char());
        Duration::from_nanos((bits * 1_000_000_000).div_ceil(u64::from(self.baud.max(1))))
    }
}

impl fmt::Display for LinkSettings {
    /// In the usual notation: `9600 8N1`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parity = match self.parity {
            Parity::None => 'N',
            Parity::Even => 'E',
            Parity::Odd => 'O',
        };
        write!(
            f,
            "{} {}{}{}",
            self.baud, self.data_bits, parity, self.stop_bits
        )
    }
}

/// How a line is wired according to the configuration: what to check first when no drive answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wiring {
    /// The device or address by which the line is reached, as the configuration writes it.
    pub port: String,
    /// Speed and character format; without meaning where there are no characters.
    pub link: LinkSettings,
    /// How frames are delimited.
    pub framing: Framing,
    /// The station numbers of its drives, in order.
    pub stations: Vec<Station>,
}

impl Wiring {
    /// Speed and character format; `None` where there are no characters.
    #[must_use]
    pub fn characters(&self) -> Option<LinkSettings> {
        self.framing.has_characters().then_some(self.link)
    }
}

impl Default for Wiring {
    /// A line of which nothing is configured.
    fn default() -> Self {
        Self {
            port: String::new(),
            link: LinkSettings::DEFAULT,
            framing: Framing::Rtu,
            stations: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn character_times_are_those_of_the_n700_manual() {
        let link = LinkSettings::DEFAULT;
        assert_eq!(link.bits_per_char(), 10);
        assert_eq!(link.chars(4.5), Duration::from_nanos(4_687_500));
        assert_eq!(link.bytes(8), Duration::from_nanos(8_333_334));
        let even = LinkSettings {
            baud: 19_200,
            parity: Parity::Even,
            ..link
        };
        assert_eq!(even.chars(4.5), Duration::from_nanos(2_578_125));
        assert_eq!(even.to_string(), "19200 8E1");
    }
}
