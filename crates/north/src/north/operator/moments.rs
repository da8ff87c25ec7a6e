//! How old an order of the page may be. The gateway hands out moments again and again, and an order names the newest
//! that the page has seen: it was sent after that. One that was delayed as a whole, in a proxy or a suspended browser,
//! therefore names an old moment.

use crate::domain::time::MonoTime;
use crate::guard::COMMAND_DEADLINE;
use crate::north::seal::SecretSeal;
use std::fmt;
use std::time::Duration;

/// How often listeners are handed a new moment.
pub const EVERY: Duration = Duration::from_millis(500);
/// An order that names an older moment is not carried out. It can be delayed unnoticed for this long.
pub const AGE_MAX: Duration = EVERY.saturating_add(COMMAND_DEADLINE);

const NANOS_PER_MS: u64 = 1_000_000;

/// The moments of this process. No one else can forge one, so an order can only name what its sender has seen.
#[derive(Clone, Debug)]
pub struct SealedMoments(SecretSeal);

/// Why an order may be too old. Only a stop is carried out then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OrderAge {
    /// The order names no moment.
    Unnamed,
    /// The order names a moment that this process has not handed out.
    Unknown,
    /// The moment that it names is so old.
    Since(Duration),
    /// The order did not arrive in one piece: its body ended this long after its head.
    Torn(Duration),
}

impl SealedMoments {
    /// The moments of a process with this key, which must be random and used for nothing else.
    #[must_use]
    pub fn new(key: u128) -> Self {
        Self(SecretSeal::new(key))
    }

    /// The text of `now`.
    #[must_use]
    pub fn at(&self, now: MonoTime) -> String {
        self.0.text(now.as_nanos() / NANOS_PER_MS)
    }

    /// Checks whether an order that names this moment, began to arrive at `begun` and had arrived at `now` may have
    /// been delayed.
    ///
    /// # Errors
    /// Why it may have been.
    pub fn review(
        &self,
        named: Option<&[u8]>,
        begun: MonoTime,
        now: MonoTime,
    ) -> Result<(), OrderAge> {
        if now.since(begun) > COMMAND_DEADLINE {
            return Err(OrderAge::Torn(now.since(begun)));
        }
        let known = self
            .0
            .number(named.ok_or(OrderAge::Unnamed)?)
            .ok_or(OrderAge::Unknown)?;
        let age = now.since(MonoTime::from_millis(known));
        if age > AGE_MAX {
            Err(OrderAge::Since(age))
        } else {
            Ok(())
        }
    }
}

impl fmt::Display for OrderAge {
    /// For people: why, and what to do.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let most = AGE_MAX.as_secs_f32();
        let deadline = COMMAND_DEADLINE.as_secs_f32();
        match self {
            Self::Unnamed => f.write_str(
                "the order does not say how old it may be: name the newest `moment` of /api/v1/events or /api/v1/session in the \
                 header Vfd-Moment",
            ),
            Self::Unknown => f.write_str(
                "the gateway has restarted since the order was sent: look at the drive, and send the order again if you still want it",
            ),
            Self::Since(age) => write!(
                f,
                "the order may have waited for {:.1} s on its way, and at most {most:.1} s are allowed: look at the drive, and send \
                 the order again if you still want it",
                age.as_secs_f32()
            ),
            Self::Torn(time) => write!(
                f,
                "the order took {:.1} s to arrive, and at most {deadline:.1} s are allowed: look at the drive, and send the order \
                 again if you still want it",
                time.as_secs_f32()
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: MonoTime = MonoTime::from_millis(100_000);
    const SHORT: Duration = Duration::from_millis(1);

    fn review(moments: &SealedMoments, named: &str) -> Result<(), OrderAge> {
        moments.review(Some(named.as_bytes()), NOW, NOW)
    }

    #[test]
    fn an_order_is_as_old_as_the_moment_that_it_names() {
        let moments = SealedMoments::new(7);
        let named = |age| moments.at(NOW.before(age));
        for age in [Duration::ZERO, SHORT, EVERY, AGE_MAX] {
            assert_eq!(review(&moments, &named(age)), Ok(()), "{age:?}");
        }
        for age in [AGE_MAX + SHORT, Duration::from_secs(30)] {
            assert_eq!(review(&moments, &named(age)), Err(OrderAge::Since(age)));
        }
        let text = OrderAge::Since(Duration::from_millis(31_240)).to_string();
        assert!(
            text.starts_with(
                "the order may have waited for 31.2 s on its way, and at most 1.5 s are allowed"
            ),
            "{text}"
        );
    }

    #[test]
    fn a_moment_is_never_reported_as_a_later_one() {
        let moments = SealedMoments::new(7);
        let now = NOW + Duration::from_nanos(999_999);
        assert_eq!(moments.at(now), moments.at(NOW));
        let named = moments.at(now);
        let later = NOW + AGE_MAX + SHORT;
        assert_eq!(
            moments.review(Some(named.as_bytes()), later, later),
            Err(OrderAge::Since(AGE_MAX + SHORT))
        );
    }

    #[test]
    fn a_moment_of_another_process_or_one_that_was_guessed_is_not_known() {
        let moments = SealedMoments::new(7);
        let other = SealedMoments::new(8);
        let seen = moments.at(NOW.before(AGE_MAX + SHORT));
        let (_, code) = seen.split_once('-').unwrap();
        for named in [
            other.at(NOW),
            format!("100000-{code}"),
            "100000".to_owned(),
            String::new(),
            "\u{0}".to_owned(),
        ] {
            assert_eq!(review(&moments, &named), Err(OrderAge::Unknown), "{named}");
        }
        assert!(
            OrderAge::Unknown
                .to_string()
                .starts_with("the gateway has restarted since")
        );
        assert_eq!(moments.review(None, NOW, NOW), Err(OrderAge::Unnamed));
        assert_eq!(
            moments.review(Some(b"\xFF"), NOW, NOW),
            Err(OrderAge::Unknown)
        );
    }

    #[test]
    fn an_order_that_does_not_come_in_one_piece_is_old_whatever_it_names() {
        let moments = SealedMoments::new(7);
        let named = moments.at(NOW);
        let whole = |begun| moments.review(Some(named.as_bytes()), begun, NOW);
        assert_eq!(whole(NOW.before(COMMAND_DEADLINE)), Ok(()));
        let longer = COMMAND_DEADLINE + SHORT;
        assert_eq!(whole(NOW.before(longer)), Err(OrderAge::Torn(longer)));
    }
}
