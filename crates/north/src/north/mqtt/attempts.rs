//! How a message that attempted a write but gave no command is recorded in the journal.

use super::topics::InputAddress;
use crate::journal::TriedWrite;
use crate::north::broker::tried_text;

/// What a payload that is no order attempts at `place`; an empty one attempts nothing.
pub(super) fn of_text(place: InputAddress<'_>, topic: &str, payload: &[u8]) -> Option<TriedWrite> {
    (place.input.is_attempt() && !payload.is_empty()).then(|| text(topic, payload))
}

/// A message that is no order, as received, shortened: the last levels of its topic, and its payload.
pub(super) fn text(topic: &str, payload: &[u8]) -> TriedWrite {
    const TOPIC_CHARS: usize = 80;
    /// More than are shown, so that a character cut in half is not.
    const PAYLOAD_BYTES: usize = 256;
    let start = payload.get(..PAYLOAD_BYTES).unwrap_or(payload);
    let skipped = topic.chars().count().saturating_sub(TOPIC_CHARS);
    let topic: String = topic.chars().skip(skipped).collect();
    let payload = String::from_utf8_lossy(start);
    tried_text(&topic, &payload)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_kept_as_it_came_but_short_and_on_one_line() {
        let shown = |topic: &str, payload: &[u8]| match text(topic, payload) {
            TriedWrite::Text(text) => text,
            other => panic!("{other:?}"),
        };
        assert_eq!(
            shown("drive/pump/run/set", b"start\n1"),
            "drive/pump/run/set: start 1"
        );
        assert_eq!(shown("a", &[0xFF, b'x']), "a: \u{FFFD}x");
        let long = shown(&"t".repeat(60_000), "\u{FC}".repeat(60_000).as_bytes());
        assert!(
            long.chars().count() < 140 && long.ends_with('\u{2026}'),
            "{long}"
        );
    }
}
