//! Numbers that the gateway hands out and gets back: each is followed by a code that is made with a secret key, so that
//! no one else can forge one, whatever others they have read.

use blake2::Blake2sMac;
use blake2::digest::consts::U16;
use blake2::digest::{FixedOutput, KeyInit, Update};
use std::fmt;

/// Bytes of a key of the code.
const KEY_BYTES: usize = 32;

/// A secret key, and what it seals. What another key sealed is not recognized.
#[derive(Clone)]
pub(super) struct SecretSeal {
    key: [u8; KEY_BYTES],
}

impl SecretSeal {
    /// The seal with this key, which must be random and used for nothing else.
    pub(super) fn new(key: u128) -> Self {
        let mut padded = [0; KEY_BYTES];
        for (to, from) in padded.iter_mut().zip(key.to_le_bytes()) {
            *to = from;
        }
        Self { key: padded }
    }

    /// `number` with its code.
    pub(super) fn text(&self, number: u64) -> String {
        let mut code = Blake2sMac::<U16>::new(&self.key.into());
        code.update(&number.to_le_bytes());
        format!(
            "{number}-{:032x}",
            u128::from_be_bytes(code.finalize_fixed().into())
        )
    }

    /// The number that `text` seals; `None` unless [`text`](Self::text) has written it with this key.
    pub(super) fn number(&self, text: &[u8]) -> Option<u64> {
        let (number, _) = std::str::from_utf8(text).ok()?.split_once('-')?;
        let number = number.parse().ok()?;
        is_equal(self.text(number).as_bytes(), text).then_some(number)
    }
}

impl fmt::Debug for SecretSeal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Seal")
    }
}

/// Compares in constant time.
fn is_equal(one: &[u8], other: &[u8]) -> bool {
    let differences = one
        .iter()
        .zip(other)
        .fold(0, |all, (one, other)| all | (one ^ other));
    one.len() == other.len() && differences == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_sealed_is_known_again_by_the_same_key_alone() {
        let seal = SecretSeal::new(7);
        let other = SecretSeal::new(8);
        for number in [0, 1, 12, u64::MAX] {
            let text = seal.text(number);
            assert_eq!(seal.number(text.as_bytes()), Some(number), "{text}");
            assert_eq!(other.number(text.as_bytes()), None, "{text}");
        }
        assert_ne!(
            seal.text(1).split_once('-').unwrap().1,
            seal.text(2).split_once('-').unwrap().1
        );
        assert_eq!(format!("{seal:?}"), "Seal", "the key is shown nowhere");
    }

    #[test]
    fn a_text_that_was_changed_is_not_known() {
        let seal = SecretSeal::new(u128::MAX);
        let text = seal.text(41);
        for place in 0..text.len() {
            for byte in [b'0', b'7', b'f', b'-', b' ', 0xFF] {
                let mut changed = text.clone().into_bytes();
                if std::mem::replace(&mut changed[place], byte) != byte {
                    assert_eq!(seal.number(&changed), None, "{place} {byte}");
                }
            }
        }
        let (number, code) = text.split_once('-').unwrap();
        let longer = [
            format!("0{text}"),
            format!("+{text}"),
            format!("{text}0"),
            format!("{text}-"),
        ];
        let shorter = [
            number.to_owned(),
            format!("{number}-"),
            format!("-{code}"),
            code.to_owned(),
            String::new(),
        ];
        for wrong in longer.iter().chain(&shorter) {
            assert_eq!(seal.number(wrong.as_bytes()), None, "{wrong}");
        }
    }
}
