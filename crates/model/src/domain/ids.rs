//! Names and numbers that identify lines, drives, clients and requests.

use std::fmt;

/// A drive's number on its serial line (Modbus: server address). The valid range depends on the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Station(pub u8);

impl fmt::Display for Station {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// The number by which a drive is reached on the Modbus TCP side, 1 to 247.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct UnitId(u8);

impl UnitId {
    /// The lowest unit a drive may have.
    pub const MIN: u8 = 1;
    /// The highest unit a drive may have (Modbus application protocol V1.1b3, 4.1).
    pub const MAX: u8 = 247;

    /// The unit `number`. `None` outside 1 to 247.
    #[must_use]
    pub const fn new(number: u8) -> Option<Self> {
        if number >= Self::MIN && number <= Self::MAX {
            Some(Self(number))
        } else {
            None
        }
    }

    /// The number used in a frame.
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0
    }
}

impl fmt::Display for UnitId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// The name of a gateway, line or drive: 1 to 64 characters a-z, A-Z, 0-9, `-`, `_` or `.`, not only dots, so that it fits
/// into a topic, a URL and a file name as it is.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Name(String);

impl Name {
    /// The longest name, in characters.
    pub const MAX_CHARS: usize = 64;

    /// What makes a name, behind the number of its characters.
    pub const RULE: &str = "characters a-z, A-Z, 0-9, \"-\", \"_\" or \".\", not only dots";

    /// The name `text`. `None` if it is empty, too long, contains any other character, or is only dots, which mean
    /// another place in a URL and in a path.
    #[must_use]
    pub fn new(text: &str) -> Option<Self> {
        let fits = (1..=Self::MAX_CHARS).contains(&text.len())
            && text.bytes().any(|b| b != b'.')
            && text
                .bytes()
                .all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'_' | b'.'));
        fits.then(|| Self(text.to_owned()))
    }

    /// The name used where none is configured.
    #[must_use]
    pub fn fallback() -> Self {
        Self("gateway".to_owned())
    }

    /// The name as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// The name of a client that has command topics or a certificate of its own (a "commander"): 1 to 32 characters a-z, A-Z,
/// 0-9, `-`, `_` or `.`, not only dots. It is copied with every command.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CommanderName {
    /// Padded with zeros, which no name contains.
    text: [u8; Self::MAX_CHARS],
}

impl CommanderName {
    /// The longest name, in characters.
    pub const MAX_CHARS: usize = 32;

    /// The name `text`. `None` if it is empty, too long or contains any other character.
    #[must_use]
    pub fn new(text: &str) -> Option<Self> {
        let name = Name::new(text)?;
        let mut text = [0; Self::MAX_CHARS];
        text.get_mut(..name.as_str().len())?
            .copy_from_slice(name.as_str().as_bytes());
        Some(Self { text })
    }

    /// The name as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let end = self
            .text
            .iter()
            .position(|byte| *byte == 0)
            .unwrap_or(Self::MAX_CHARS);
        self.text
            .get(..end)
            .and_then(|text| std::str::from_utf8(text).ok())
            .unwrap_or_default()
    }
}

impl fmt::Display for CommanderName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.as_str().fmt(f)
    }
}

impl fmt::Debug for CommanderName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "CommanderName({:?})", self.as_str())
    }
}

/// A drive's place on its line, in the order of the configuration, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct DriveIndex(pub u16);

impl DriveIndex {
    /// The place as an index into a slice.
    #[must_use]
    pub const fn get(self) -> usize {
        self.0 as usize
    }
}

/// A source of native reads: one client connection. The line is shared fairly among askers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AskerId(pub u64);

impl AskerId {
    /// The MQTT side as a whole.
    pub const MQTT: Self = Self(0);
    /// The program's own tools as a whole. All numbers without a name are Modbus TCP connections, counted from 1.
    pub const LOCAL: Self = Self(u64::MAX);
    /// All users of the page as a whole.
    pub const PAGE: Self = Self(u64::MAX - 1);
    /// The Sparkplug side as a whole.
    pub const SPARKPLUG: Self = Self(u64::MAX - 2);
}

/// The number of one request of one asker, chosen by the asker and returned in the answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticket(pub u64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_fit_into_topics() {
        assert!(Name::new("pump-1_a.B").is_some() && Name::new("..a").is_some());
        for bad in [
            "",
            ".",
            "..",
            "...",
            "a/b",
            "a+",
            "#",
            "pump 1",
            "ü",
            &"x".repeat(65),
        ] {
            assert!(Name::new(bad).is_none(), "{bad}");
        }
    }

    #[test]
    fn commanders_have_short_names() {
        for good in ["a", "plc-2", &"x".repeat(32)] {
            let name = CommanderName::new(good).unwrap();
            assert_eq!((name.as_str(), name.to_string()), (good, good.to_owned()));
        }
        for bad in ["", "..", "a/b", "+", "\0", &"x".repeat(33)] {
            assert!(CommanderName::new(bad).is_none(), "{bad}");
        }
    }

    #[test]
    fn units_are_1_to_247() {
        assert!(UnitId::new(0).is_none() && UnitId::new(248).is_none());
        assert_eq!(UnitId::new(247).map(UnitId::get), Some(247));
    }
}
