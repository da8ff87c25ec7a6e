//! The role of a gateway on a line, for those who need it with every request.

use crate::domain::standby::LineRole;
use std::sync::atomic::{AtomicU8, Ordering};

/// The present role; none on a line without another gateway.
#[derive(Debug, Default)]
pub struct SharedRole(AtomicU8);

const ALONE: u8 = 0;
const LISTENING: u8 = 1;
const ACTIVE: u8 = 2;

impl SharedRole {
    /// The present role.
    #[must_use]
    pub fn get(&self) -> Option<LineRole> {
        match self.0.load(Ordering::Relaxed) {
            LISTENING => Some(LineRole::Listening),
            ACTIVE => Some(LineRole::Active),
            _ => None,
        }
    }

    /// Sets it.
    pub fn set(&self, role: Option<LineRole>) {
        let number = match role {
            None => ALONE,
            Some(LineRole::Listening) => LISTENING,
            Some(LineRole::Active) => ACTIVE,
        };
        self.0.store(number, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_role_comes_back() {
        let shared = SharedRole::default();
        assert_eq!(shared.get(), None);
        for role in LineRole::ALL.map(Some).into_iter().chain([None]) {
            shared.set(role);
            assert_eq!(shared.get(), role);
        }
    }
}
