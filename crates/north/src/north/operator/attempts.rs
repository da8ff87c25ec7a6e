//! How often a sign-in may be attempted: with a wait that grows for each address, and a rate limit over all.

use crate::domain::time::MonoTime;
use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::time::Duration;

/// Failures of an address without a wait: people mistype.
const FREE: u32 = 3;
/// The first wait; each further failure doubles it.
const FIRST_WAIT: Duration = Duration::from_secs(1);
/// The longest wait of one address.
const WAIT_MAX: Duration = Duration::from_secs(300);
/// An address whose last failure is this long ago starts over.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(3600);
/// Most addresses that are remembered. Then the one whose failure is longest ago is forgotten.
const ADDRESSES_MAX: usize = 256;
/// Sign-ins at once over all addresses: each costs time and memory.
const BURST: u32 = 30;
/// The interval at which one more may be attempted.
const EVERY: Duration = Duration::from_secs(2);

/// The attempts so far.
#[derive(Debug)]
pub struct SignInAttempts {
    failures: HashMap<IpAddr, SignInFailures>,
    /// How many may be attempted at once, as of the moment beside it.
    left: u32,
    counted_at: MonoTime,
}

#[derive(Clone, Copy, Debug)]
struct SignInFailures {
    count: u32,
    last: MonoTime,
}

impl SignInFailures {
    fn wait(&self) -> Duration {
        match self.count.checked_sub(FREE) {
            None => Duration::ZERO,
            Some(doublings) => FIRST_WAIT
                .saturating_mul(1 << doublings.min(16))
                .min(WAIT_MAX),
        }
    }
}

impl Default for SignInAttempts {
    fn default() -> Self {
        Self {
            failures: HashMap::new(),
            left: BURST,
            counted_at: MonoTime::ZERO,
        }
    }
}

impl SignInAttempts {
    /// A client at `address` attempts to sign in at `now`. It counts as a failure until it has
    /// [succeeded](Self::succeeded), so that parallel attempts do not get around the limit.
    ///
    /// # Errors
    /// How long to wait first; nothing may be attempted until then, and asking does not make it longer.
    pub fn begin(&mut self, now: MonoTime, address: IpAddr) -> Result<(), Duration> {
        self.failures
            .retain(|_, failures| now.since(failures.last) < FORGOTTEN_AFTER);
        let of = whose(address);
        let before = self.failures.get(&of).copied();
        if let Some(failures) = before {
            let left = failures.wait().saturating_sub(now.since(failures.last));
            if !left.is_zero() {
                return Err(left);
            }
        }
        self.refill(now);
        self.left = self
            .left
            .checked_sub(1)
            .ok_or_else(|| EVERY.saturating_sub(now.since(self.counted_at)))?;
        if before.is_none() && self.failures.len() >= ADDRESSES_MAX {
            let oldest = self
                .failures
                .iter()
                .min_by_key(|(_, failures)| failures.last)
                .map(|(address, _)| *address);
            oldest.and_then(|oldest| self.failures.remove(&oldest));
        }
        let count = before
            .map_or(0, |failures| failures.count)
            .saturating_add(1);
        self.failures
            .insert(of, SignInFailures { count, last: now });
        Ok(())
    }

    /// An attempt from `address` failed at `now`: the next one waits from here on, however long the check took.
    pub fn failed(&mut self, now: MonoTime, address: IpAddr) {
        if let Some(failures) = self.failures.get_mut(&whose(address)) {
            failures.last = now;
        }
    }

    /// An attempt from `address` that had begun was successful.
    pub fn succeeded(&mut self, address: IpAddr) {
        self.failures.remove(&whose(address));
        self.left = (self.left + 1).min(BURST);
    }

    fn refill(&mut self, now: MonoTime) {
        let periods = now.since(self.counted_at).as_nanos() / EVERY.as_nanos();
        let periods = u32::try_from(periods).unwrap_or(u32::MAX);
        self.left = self.left.saturating_add(periods).min(BURST);
        self.counted_at = if self.left == BURST {
            now
        } else {
            self.counted_at + EVERY.saturating_mul(periods)
        };
    }
}

/// A client with one IPv6 address has the whole network of 64 bits.
fn whose(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => Ipv6Addr::from_bits(address.to_bits() & (u128::MAX << 64)).into(),
        address @ IpAddr::V4(_) => address,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn host(last: u8) -> IpAddr {
        IpAddr::from([10, 0, 0, last])
    }

    fn second(seconds: u64) -> MonoTime {
        MonoTime::from_millis(1) + Duration::from_secs(seconds)
    }

    #[test]
    fn the_wait_grows_with_each_failure() {
        let mut attempts = SignInAttempts::default();
        let mut now = second(0);
        for _ in 0..FREE {
            assert_eq!(attempts.begin(now, host(1)), Ok(()));
        }
        for wait in [1, 2, 4, 8, 16, 32, 64, 128, 256, 300, 300] {
            let wait = Duration::from_secs(wait);
            assert_eq!(attempts.begin(now, host(1)), Err(wait));
            assert_eq!(
                attempts.begin(now, host(1)),
                Err(wait),
                "to ask makes it no longer"
            );
            assert_eq!(
                attempts.begin(now, host(2)),
                Ok(()),
                "the others do not wait for it"
            );
            attempts.succeeded(host(2));
            now = now + wait;
            assert_eq!(attempts.begin(now, host(1)), Ok(()));
        }
        assert!(attempts.begin(now + FORGOTTEN_AFTER, host(1)).is_ok());
        assert_eq!(attempts.failures[&host(1)].count, 1, "it starts over");
    }

    #[test]
    fn a_slow_host_makes_no_wait_shorter() {
        let mut attempts = SignInAttempts::default();
        for _ in 0..FREE {
            assert_eq!(attempts.begin(second(0), host(1)), Ok(()));
        }
        attempts.failed(second(5), host(1));
        attempts.failed(second(5), host(2));
        assert_eq!(attempts.begin(second(5), host(1)), Err(FIRST_WAIT));
        assert_eq!(attempts.begin(second(6), host(1)), Ok(()));
    }

    #[test]
    fn who_succeeds_is_not_held_up() {
        let mut attempts = SignInAttempts::default();
        for _ in 0..10 * BURST {
            assert_eq!(attempts.begin(second(0), host(1)), Ok(()));
            attempts.succeeded(host(1));
        }
    }

    #[test]
    fn all_addresses_together_are_held_up() {
        let mut attempts = SignInAttempts::default();
        for last in 0..BURST {
            assert_eq!(attempts.begin(second(10), host(last as u8)), Ok(()));
        }
        assert_eq!(attempts.begin(second(10), host(200)), Err(EVERY));
        assert_eq!(
            attempts.begin(second(11), host(200)),
            Err(Duration::from_secs(1))
        );
        assert_eq!(attempts.begin(second(12), host(200)), Ok(()));
        assert!(attempts.begin(second(12), host(201)).is_err());
        for last in 0..BURST {
            assert_eq!(
                attempts.begin(second(3000), host(100 + last as u8)),
                Ok(()),
                "a pause is made good for once"
            );
        }
        assert!(attempts.begin(second(3000), host(99)).is_err());
    }

    #[test]
    fn addresses_are_bounded_and_a_network_of_ipv6_is_one() {
        let mut attempts = SignInAttempts::default();
        for number in 0..2 * ADDRESSES_MAX as u32 {
            let address = IpAddr::from(number.to_be_bytes());
            assert_eq!(
                attempts.begin(second(u64::from(number) * 2), address),
                Ok(())
            );
        }
        assert_eq!(attempts.failures.len(), ADDRESSES_MAX);
        let mut attempts = SignInAttempts::default();
        for last in 0..FREE {
            assert!(
                attempts
                    .begin(second(0), format!("fd00::{last}").parse().unwrap())
                    .is_ok()
            );
        }
        assert!(
            attempts
                .begin(second(0), "fd00::99".parse().unwrap())
                .is_err()
        );
        assert!(
            attempts
                .begin(second(0), "fd00:0:0:1::99".parse().unwrap())
                .is_ok()
        );
        let mapped = "::ffff:10.0.0.7".parse().unwrap();
        (0..FREE).for_each(|_| attempts.begin(second(0), mapped).unwrap());
        assert!(
            attempts.begin(second(0), host(7)).is_err(),
            "a mapped address is the address itself"
        );
    }
}
