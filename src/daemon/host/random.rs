//! Secrets that are made when needed and never stored.

use ring::rand::{SecureRandom, SystemRandom};
use std::hash::{BuildHasher, RandomState};

/// An unpredictable number, a new one each time.
#[must_use]
pub fn secret() -> u128 {
    let mut bytes = [0; 16];
    if SystemRandom::new().fill(&mut bytes).is_ok() {
        return u128::from_le_bytes(bytes);
    }
    // Hash tables of the standard library are keyed at random, too.
    let keyed = RandomState::new();
    u128::from(keyed.hash_one(0_u8)) << 64 | u128::from(keyed.hash_one(1_u8))
}
