//! Secrets that are made when they are needed and never kept.

use ring::rand::{SecureRandom, SystemRandom};
use std::hash::{BuildHasher, RandomState};

/// A number that no one else can know, and a new one each time.
#[must_use]
pub fn secret() -> u128 {
    let mut bytes = [0; 16];
    if SystemRandom::new().fill(&mut bytes).is_ok() {
        return u128::from_le_bytes(bytes);
    }
    // Tables of the standard library are keyed at random, too.
    let keyed = RandomState::new();
    u128::from(keyed.hash_one(0_u8)) << 64 | u128::from(keyed.hash_one(1_u8))
}
