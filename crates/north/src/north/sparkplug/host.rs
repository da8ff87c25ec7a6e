//! The primary host application, as its STATE messages describe it.

use crate::north::command_words::without_mark;
use serde_json::Value;

/// What a STATE message changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum HostChange {
    /// It is not understood, or older than what is known.
    Nothing,
    /// The host is online.
    Online,
    /// The host is offline.
    Offline,
}

/// The primary host, if one is configured.
#[derive(Debug)]
pub(super) struct PrimaryHost {
    is_awaited: bool,
    is_online: bool,
    /// Timestamp of the newest message on this connection.
    timestamp: Option<u64>,
    /// It says that it is online in a message that is this much older than one before, in milliseconds.
    behind_ms: Option<u64>,
}

impl PrimaryHost {
    pub(super) const fn new(is_awaited: bool) -> Self {
        Self {
            is_awaited,
            is_online: false,
            timestamp: None,
            behind_ms: None,
        }
    }

    /// A new connection: what was known no longer applies to this broker.
    pub(super) const fn forget(&mut self) {
        self.is_online = false;
        self.timestamp = None;
        self.behind_ms = None;
    }

    /// By how many milliseconds the message in which it says that it is online is older than one before, which is why it
    /// does not count: its clock was ahead then.
    pub(super) const fn behind_ms(&self) -> Option<u64> {
        self.behind_ms
    }

    /// Whether there is a host to publish to.
    pub(super) const fn is_there(&self) -> bool {
        self.is_online || !self.is_awaited
    }

    /// Takes a STATE message. One that is older than a previous one is the delayed will of an earlier session.
    pub(super) fn take(&mut self, payload: &[u8]) -> HostChange {
        let Some((is_online, timestamp)) = read(payload) else {
            return HostChange::Nothing;
        };
        if let Some(last) = self.timestamp.filter(|last| timestamp < *last) {
            if is_online && !self.is_online {
                self.behind_ms = Some(last - timestamp);
            }
            return HostChange::Nothing;
        }
        self.timestamp = Some(timestamp);
        self.behind_ms = None;
        let has_changed = std::mem::replace(&mut self.is_online, is_online) != is_online;
        match (has_changed, is_online) {
            (false, _) => HostChange::Nothing,
            (true, true) => HostChange::Online,
            (true, false) => HostChange::Offline,
        }
    }
}

fn read(payload: &[u8]) -> Option<(bool, u64)> {
    let state: Value = serde_json::from_slice(without_mark(payload)).ok()?;
    Some((
        state.get("online")?.as_bool()?,
        state.get("timestamp")?.as_u64()?,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(online: bool, timestamp: u64) -> Vec<u8> {
        format!(r#"{{"online":{online},"timestamp":{timestamp}}}"#).into_bytes()
    }

    /// tck-id-message-flow-edge-node-birth-publish-phid-wait-online and -wait-timestamp.
    #[test]
    fn an_older_state_than_the_last_one_changes_nothing() {
        let mut host = PrimaryHost::new(true);
        assert!(!host.is_there());
        assert_eq!(host.take(&state(true, 100)), HostChange::Online);
        assert_eq!(
            host.take(&state(false, 99)),
            HostChange::Nothing,
            "the delayed will of its former session"
        );
        assert!(host.is_there());
        assert_eq!(
            host.take(&state(false, 100)),
            HostChange::Offline,
            "its own will has the timestamp of its birth"
        );
        assert!(!host.is_there());
        assert_eq!(host.take(&state(true, 101)), HostChange::Online);
        host.forget();
        assert!(!host.is_there());
        assert_eq!(
            host.take(&state(true, 5)),
            HostChange::Online,
            "of another broker"
        );
    }

    #[test]
    fn a_host_whose_clock_was_ahead_is_reported_until_it_counts_again() {
        let mut host = PrimaryHost::new(true);
        host.take(&state(true, 7_200_000));
        host.take(&state(false, 7_200_000));
        assert_eq!(
            (host.take(&state(false, 10)), host.behind_ms()),
            (HostChange::Nothing, None),
            "a late will"
        );
        assert_eq!(
            (host.take(&state(true, 3_600_000)), host.behind_ms()),
            (HostChange::Nothing, Some(3_600_000))
        );
        assert!(!host.is_there());
        assert_eq!(
            (host.take(&state(true, 7_200_001)), host.behind_ms()),
            (HostChange::Online, None)
        );
        host.take(&state(true, 1));
        assert_eq!(host.behind_ms(), None, "it is there");
        host.take(&state(false, 7_200_001));
        host.take(&state(true, 1));
        host.forget();
        assert_eq!(host.behind_ms(), None);
    }

    #[test]
    fn what_is_no_state_changes_nothing() {
        let mut host = PrimaryHost::new(true);
        for bad in [
            &b"ONLINE"[..],
            b"",
            b"{}",
            b"[]",
            br#"{"online":1,"timestamp":2}"#,
            br#"{"online":true}"#,
            b"\xFF",
        ] {
            assert_eq!(host.take(bad), HostChange::Nothing);
        }
        assert!(!host.is_there() && PrimaryHost::new(false).is_there());
    }
}
