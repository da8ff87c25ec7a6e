//! Signed-in users. A session is identified by a digest of its id, so that nothing stored here opens one.

use crate::domain::ids::CommanderName;
use crate::domain::time::MonoTime;
use std::collections::HashMap;
use std::time::Duration;

/// Most sessions at once: a few people with a few screens each. Beyond that the least recently used one ends.
pub const SESSIONS_MAX: usize = 64;
/// A session ends after this time without use: a shift and some more.
pub const IDLE_MAX: Duration = Duration::from_secs(12 * 3600);
/// A session ends this long after the sign-in, however much it is used.
pub const LIFE_MAX: Duration = Duration::from_secs(7 * 24 * 3600);

/// A digest of a session's id.
pub type Key = [u8; 32];

/// All sessions.
#[derive(Debug, Default)]
pub struct UserSessions {
    open: HashMap<Key, UserSession>,
}

#[derive(Debug)]
struct UserSession {
    user: CommanderName,
    opened: MonoTime,
    used: MonoTime,
}

impl UserSession {
    fn is_over(&self, now: MonoTime) -> bool {
        now.since(self.used) >= IDLE_MAX || now.since(self.opened) >= LIFE_MAX
    }
}

impl UserSessions {
    /// `user` has signed in at `now`, and is identified by `key` from now on.
    pub fn open(&mut self, now: MonoTime, key: Key, user: CommanderName) {
        self.open.retain(|_, session| !session.is_over(now));
        if self.open.len() >= SESSIONS_MAX {
            let oldest = self
                .open
                .iter()
                .min_by_key(|(_, session)| session.used)
                .map(|(key, _)| *key);
            oldest.and_then(|oldest| self.open.remove(&oldest));
        }
        self.open.insert(
            key,
            UserSession {
                user,
                opened: now,
                used: now,
            },
        );
    }

    /// The user identified by `key` at `now`. Looking does not keep the session alive.
    #[must_use]
    pub fn user(&self, now: MonoTime, key: &Key) -> Option<CommanderName> {
        self.open
            .get(key)
            .filter(|session| !session.is_over(now))
            .map(|session| session.user)
    }

    /// The user identified by `key` at `now`, for a request that commands: it keeps the session alive.
    pub fn used(&mut self, now: MonoTime, key: &Key) -> Option<CommanderName> {
        let session = self
            .open
            .get_mut(key)
            .filter(|session| !session.is_over(now))?;
        session.used = now;
        Some(session.user)
    }

    /// Ends a session.
    pub fn close(&mut self, key: &Key) {
        self.open.remove(key);
    }

    /// Ends the sessions of all users that `stays` does not name.
    pub fn keep(&mut self, stays: impl Fn(CommanderName) -> bool) {
        self.open.retain(|_, session| stays(session.user));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: Duration = Duration::from_secs(3600);

    fn anna() -> CommanderName {
        CommanderName::new("anna").unwrap()
    }

    fn key(number: u8) -> Key {
        [number; 32]
    }

    fn at(hours: u32) -> MonoTime {
        MonoTime::from_millis(5) + HOUR * hours
    }

    #[test]
    fn a_session_ends_when_it_is_not_used() {
        let mut sessions = UserSessions::default();
        sessions.open(at(0), key(1), anna());
        let last = MonoTime::from_millis(4) + IDLE_MAX;
        assert_eq!(sessions.user(last, &key(1)), Some(anna()));
        assert_eq!(
            sessions.user(at(12), &key(1)),
            None,
            "to look has not kept it"
        );
        assert_eq!(sessions.used(last, &key(1)), Some(anna()));
        assert_eq!(sessions.user(at(23), &key(1)), Some(anna()));
        assert_eq!(sessions.used(at(24), &key(1)), None, "it never comes back");
        assert_eq!(sessions.user(at(0), &key(2)), None);
    }

    #[test]
    fn no_session_lives_for_ever() {
        let mut sessions = UserSessions::default();
        sessions.open(at(0), key(1), anna());
        for hour in 0..7 * 24 {
            assert_eq!(sessions.used(at(hour), &key(1)), Some(anna()), "{hour}");
        }
        assert_eq!(sessions.used(at(7 * 24), &key(1)), None);
    }

    #[test]
    fn anyone_who_signs_out_or_is_gone_has_none() {
        let mut sessions = UserSessions::default();
        let bob = CommanderName::new("bob").unwrap();
        for (number, user) in [(1, anna()), (2, anna()), (3, bob)] {
            sessions.open(at(0), key(number), user);
        }
        sessions.close(&key(1));
        assert_eq!(
            (sessions.user(at(0), &key(1)), sessions.user(at(0), &key(2))),
            (None, Some(anna()))
        );
        sessions.keep(|user| user != anna());
        assert_eq!(
            (sessions.user(at(0), &key(2)), sessions.user(at(0), &key(3))),
            (None, Some(bob))
        );
    }

    #[test]
    fn the_one_that_was_used_longest_ago_gives_way() {
        let mut sessions = UserSessions::default();
        let most = u8::try_from(SESSIONS_MAX).unwrap();
        for number in 0..most {
            sessions.open(MonoTime::from_millis(number.into()), key(number), anna());
        }
        sessions.used(MonoTime::from_millis(100), &key(0));
        sessions.open(MonoTime::from_millis(101), key(most), anna());
        let is_there = |number| {
            sessions
                .user(MonoTime::from_millis(101), &key(number))
                .is_some()
        };
        assert_eq!(
            (is_there(0), is_there(1), is_there(2), is_there(most)),
            (true, false, true, true)
        );
        assert_eq!(sessions.open.len(), SESSIONS_MAX);
    }
}
