//! When to connect again, and whether another client uses our identifier.
//!
//! A broker closes the connection of a client when another one connects with the same identifier. With MQTT 5 it gives
//! the reason. With 3.1.1 it just closes, and two clients that reconnect at once would take turns for ever.

use super::backoff::{BackOff, ConnectionEnding, SETTLED_LIFE};
use super::incident::{BrokenConnection, EndCause};
use std::time::Duration;

/// A connection that is closed sooner than this may have been closed for a rival that reconnected.
const SHORT_LIFE: Duration = Duration::from_secs(5);
/// This many short connections in a row, while the broker was always reachable, are no accident.
const SHORT_LIVES: u32 = 5;
/// This many short connections in a row cannot be a broker that restarts repeatedly either.
const SHORT_LIVES_MAX: u32 = 16;
/// If a connection lasts this long after a rival was only suspected, the broker probably had restarted. Together with
/// the longest wait before it that is less than 5 s.
const UNSUSPECTED_LIFE: Duration = Duration::from_millis(2_400);

/// How a client with our identifier was noticed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClientRival {
    /// The broker reported it.
    Reported,
    /// The broker closes each connection shortly after accepting it.
    Suspected,
}

/// What follows from the end of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RetryDecision {
    /// How long to wait.
    pub wait: Duration,
    /// The rival for which it ended, if any.
    pub rival: Option<ClientRival>,
}

/// What is concluded from the ends of the connections so far.
#[derive(Debug)]
pub struct RetryState {
    back_off: BackOff,
    /// Short connections in a row.
    short_lives: u32,
    rival: Option<ClientRival>,
}

impl RetryState {
    /// Starts without connections.
    pub fn new(seed: u64) -> Self {
        Self {
            back_off: BackOff::new(seed),
            short_lives: 0,
            rival: None,
        }
    }

    /// Handles the end of a connection that lived for `life` after the broker had accepted it; `None` if it had not.
    pub fn after(&mut self, broken: &BrokenConnection, life: Option<Duration>) -> RetryDecision {
        let rival = life.and_then(|life| self.rival_behind(broken.cause, life));
        let ended = match (rival, life) {
            (Some(_), _) if !self.may_be_restarts(rival) => {
                ConnectionEnding::Contested(life.unwrap_or_default())
            }
            (Some(_), _) => ConnectionEnding::Suspected(life.unwrap_or_default()),
            (None, None) if broken.cause == EndCause::Gone => ConnectionEnding::Away,
            (None, Some(life)) if matches!(broken.cause, EndCause::Gone | EndCause::TooLarge) => {
                ConnectionEnding::Closed(life)
            }
            (None, _) => ConnectionEnding::Broken(life.unwrap_or_default()),
        };
        if ended == ConnectionEnding::Away {
            self.short_lives = 0;
        }
        self.rival = if self.rival == Some(ClientRival::Reported) {
            self.rival
        } else {
            rival.or(self.rival)
        };
        RetryDecision {
            wait: self.back_off.wait_after(ended),
            rival,
        }
    }

    /// Whether what looks like `rival` may be a broker that has restarted a few times.
    fn may_be_restarts(&self, rival: Option<ClientRival>) -> bool {
        rival == Some(ClientRival::Suspected) && self.short_lives <= SHORT_LIVES_MAX
    }

    fn rival_behind(&mut self, cause: EndCause, life: Duration) -> Option<ClientRival> {
        // Rivals that both wait take turns at longer intervals.
        let short = if self.short_lives >= SHORT_LIVES {
            SETTLED_LIFE
        } else {
            SHORT_LIFE
        };
        let is_short = cause == EndCause::Gone && life < short;
        self.short_lives = if is_short {
            self.short_lives.saturating_add(1)
        } else {
            0
        };
        match cause {
            EndCause::TakenOver => Some(ClientRival::Reported),
            _ => (self.short_lives >= SHORT_LIVES).then_some(ClientRival::Suspected),
        }
    }

    /// Whether the present connection, which has lived for `life`, shows that a rival is gone. True once.
    pub fn is_settled(&mut self, life: Duration) -> bool {
        let least = if self.may_be_restarts(self.rival) {
            UNSUSPECTED_LIFE
        } else {
            SETTLED_LIFE
        };
        life >= least && self.rival.take().is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn broken(cause: EndCause) -> BrokenConnection {
        BrokenConnection {
            reason: String::new(),
            is_fresh: true,
            cause,
            is_unsent: false,
        }
    }

    fn ends(retry: &mut RetryState, cause: EndCause, life: Option<u32>) -> RetryDecision {
        retry.after(&broken(cause), life.map(|seconds| SECOND * seconds))
    }

    #[test]
    fn a_broker_that_names_the_rival_is_believed_at_once_and_waits_grow() {
        let mut retry = RetryState::new(1);
        let waits: Vec<_> = (0..6)
            .map(|_| {
                let next = ends(&mut retry, EndCause::TakenOver, Some(20));
                assert_eq!(next.rival, Some(ClientRival::Reported));
                next.wait
            })
            .collect();
        assert!(waits[0] < SECOND * 2 && waits[5] > SECOND * 20, "{waits:?}");
        assert!(
            !retry.is_settled(SECOND * 59)
                && retry.is_settled(SECOND * 60)
                && !retry.is_settled(SECOND * 61)
        );
    }

    #[test]
    fn five_short_lives_in_a_row_are_suspicious_until_one_lived_for_a_minute() {
        let mut retry = RetryState::new(2);
        for _ in 1..SHORT_LIVES {
            let next = ends(&mut retry, EndCause::Gone, Some(4));
            assert!(
                next.rival.is_none() && next.wait < SECOND,
                "the broker may be starting again: {next:?}"
            );
        }
        assert_eq!(
            ends(&mut retry, EndCause::Gone, Some(0)).rival,
            Some(ClientRival::Suspected)
        );
        assert_eq!(
            ends(&mut retry, EndCause::Gone, Some(59)).rival,
            Some(ClientRival::Suspected),
            "they take turns"
        );
        assert_eq!(ends(&mut retry, EndCause::Gone, Some(60)).rival, None);
        assert_eq!(
            ends(&mut retry, EndCause::Gone, Some(4)).rival,
            None,
            "counted from the start"
        );
    }

    #[test]
    fn a_broker_that_starts_again_twelve_times_is_no_rival_five_seconds_later() {
        for seed in 0..1_000 {
            let mut retry = RetryState::new(seed);
            let mut last = RetryDecision {
                wait: Duration::ZERO,
                rival: None,
            };
            for restart in 0..12_u32 {
                let life = Duration::from_millis(u64::from(restart) * 173 % 1_500);
                last = retry.after(&broken(EndCause::Gone), Some(life));
            }
            assert_eq!(
                last.rival,
                Some(ClientRival::Suspected),
                "nothing distinguishes it from one"
            );
            let until = SECOND * 5 - last.wait;
            assert!(
                retry.is_settled(until) && !retry.is_settled(until),
                "{seed}: {last:?}"
            );
        }
    }

    #[test]
    fn a_rival_that_was_named_is_one_until_a_connection_lived_for_a_minute() {
        let mut retry = RetryState::new(4);
        ends(&mut retry, EndCause::TakenOver, Some(20));
        for _ in 0..SHORT_LIVES {
            ends(&mut retry, EndCause::Gone, Some(1));
        }
        assert!(
            !retry.is_settled(SECOND * 59),
            "short lives speak for it as well"
        );
        assert!(retry.is_settled(SECOND * 60));
    }

    #[test]
    fn a_packet_that_is_too_large_is_no_rival_and_the_next_connection_comes_at_once() {
        let mut retry = RetryState::new(5);
        for _ in 0..30 {
            let next = ends(&mut retry, EndCause::TooLarge, Some(0));
            assert!(next.rival.is_none() && next.wait < SECOND, "{next:?}");
        }
    }

    #[test]
    fn a_broker_that_restarts_or_a_connection_that_breaks_otherwise_is_no_rival() {
        let mut retry = RetryState::new(3);
        for _ in 0..10 {
            for _ in 1..SHORT_LIVES {
                assert_eq!(ends(&mut retry, EndCause::Gone, Some(1)).rival, None);
            }
            let away = ends(&mut retry, EndCause::Gone, None);
            assert_eq!(away.rival, None, "there was none");
            assert!(away.wait < SECOND * 2);
        }
        for _ in 0..10 {
            assert_eq!(ends(&mut retry, EndCause::Other, Some(1)).rival, None);
            assert_eq!(ends(&mut retry, EndCause::Gone, Some(5)).rival, None);
        }
        assert!(!retry.is_settled(SECOND * 600));
    }
}
