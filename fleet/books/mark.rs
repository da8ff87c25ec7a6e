//! The mark of an update: its number and when it was due, so that the receiver knows what is missing and how late it
//! is.

use super::shape::Update;
use std::time::Duration;
use vfd_gateway::domain::time::MonoTime;

/// How a marked document begins.
const DOCUMENT: &str = r#"{"fleet":{"seq":"#;
const DUE: &str = r#","due_us":"#;
const END: &str = "},";
const MICROS_PER_SECOND: u64 = 1_000_000;

/// What an update carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mark {
    /// Its number among those of its drive, from 0.
    pub number: u32,
    /// When it was due, in whole microseconds.
    pub due: MonoTime,
}

impl Mark {
    /// A mark for an update that is due at `due`.
    #[must_use]
    pub const fn new(number: u32, due: MonoTime) -> Self {
        Self {
            number,
            due: MonoTime::from_micros(due.as_nanos() / 1_000),
        }
    }

    /// The payload of an update with this mark. A document is `body`, a JSON object that is not empty, with one more
    /// member in front; a number is the mark alone, and as long as that of a value may be.
    #[must_use]
    pub fn on(self, update: Update, body: &[u8]) -> Vec<u8> {
        let number = self.number;
        let due = self.due.as_nanos() / 1_000;
        match update {
            Update::State => {
                let mut payload = format!("{DOCUMENT}{number}{DUE}{due}{END}").into_bytes();
                payload.extend_from_slice(body.strip_prefix(b"{").unwrap_or(body));
                payload
            }
            Update::Frequency => format!("{number}.{due}").into_bytes(),
        }
    }

    /// The mark of a payload; `None` if it has none.
    #[must_use]
    pub fn of(update: Update, payload: &[u8]) -> Option<Self> {
        let (number, due) = match update {
            Update::State => {
                let end = payload
                    .windows(END.len())
                    .take(100)
                    .position(|it| it == END.as_bytes())?;
                let text = std::str::from_utf8(payload.get(..end)?).ok()?;
                text.strip_prefix(DOCUMENT)?.split_once(DUE)?
            }
            Update::Frequency => std::str::from_utf8(payload).ok()?.split_once('.')?,
        };
        Some(Self {
            number: number.parse().ok()?,
            due: MonoTime::from_micros(due.parse().ok()?),
        })
    }

    /// How long ago it was due.
    #[must_use]
    pub fn age(self, now: MonoTime) -> Duration {
        now.since(self.due)
    }

    /// Whether it was due more than a second before `start`, and so belongs to an earlier simulation.
    #[must_use]
    pub fn is_older_than(self, start: MonoTime) -> bool {
        self.due.as_nanos() / 1_000 + MICROS_PER_SECOND < start.as_nanos() / 1_000
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    #[test]
    fn what_is_marked_is_found_again() {
        for number in [0, 7, u32::MAX] {
            let mark = Mark::new(number, MonoTime::from_micros(u64::from(number) * 3_333 + 1));
            for update in [Update::State, Update::Frequency] {
                assert_eq!(
                    Mark::of(update, &mark.on(update, br#"{"online":true}"#)),
                    Some(mark),
                    "{update:?}"
                );
            }
        }
    }

    #[test]
    fn a_marked_document_is_the_document_with_its_mark() {
        let mark = Mark::new(3, MonoTime::from_micros(1_000_000));
        let value: Value =
            serde_json::from_slice(&mark.on(Update::State, br#"{"online":true}"#)).unwrap();
        assert_eq!(
            (&value["online"], &value["fleet"]["seq"]),
            (&true.into(), &3.into())
        );
        let value = mark.on(Update::Frequency, b"ignored");
        assert!(String::from_utf8(value).unwrap().parse::<f64>().is_ok());
    }

    #[test]
    fn whatever_else_comes_has_no_mark() {
        for payload in [
            "",
            "{}",
            "online",
            "50.00x",
            r#"{"fleet":{"seq":1}}"#,
            r#"{"fleet":{"seq":1,"due_us":x},"a":1}"#,
        ] {
            assert_eq!(
                Mark::of(Update::State, payload.as_bytes()),
                None,
                "{payload}"
            );
        }
        assert_eq!(Mark::of(Update::Frequency, b"50"), None);
        assert_eq!(Mark::of(Update::Frequency, &[0xFF, b'.', b'1']), None);
        assert_eq!(Mark::of(Update::State, &[b'x'; 100_000]), None);
    }

    #[test]
    fn what_was_due_before_is_of_another_simulation() {
        let start = MonoTime::from_millis(60_000);
        assert!(Mark::new(0, MonoTime::from_millis(58_900)).is_older_than(start));
        assert!(!Mark::new(0, MonoTime::from_millis(59_100)).is_older_than(start));
        assert_eq!(
            Mark::new(0, MonoTime::from_millis(59_000)).age(start),
            Duration::from_secs(1)
        );
    }
}
