//! A bounded set of owners, each remembered for a time.

use crate::domain::command::Owner;
use crate::domain::time::MonoTime;

/// Maximum number of owners. One that is evicted has to command stop again before it starts, or its held order to reset
/// acts once more.
const OWNERS_MAX: usize = 64;

/// Owners in order of insertion, each with an expiry. The set is bounded: the oldest makes room.
#[derive(Debug, Default)]
pub(super) struct OwnerSet {
    owners: Vec<(Owner, MonoTime)>,
}

impl OwnerSet {
    pub(super) fn has(&self, owner: Owner) -> bool {
        self.owners.iter().any(|(it, _)| *it == owner)
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.owners.is_empty()
    }

    /// Remembers `owner` until `until`, replacing an earlier entry.
    pub(super) fn add(&mut self, owner: Owner, until: MonoTime) {
        if let Some((_, known)) = self.owners.iter_mut().find(|(it, _)| *it == owner) {
            *known = until;
            return;
        }
        if self.owners.len() >= OWNERS_MAX {
            self.owners.remove(0);
        }
        self.owners.push((owner, until));
    }

    pub(super) fn remove(&mut self, owner: Owner) {
        self.owners.retain(|(it, _)| *it != owner);
    }

    /// Removes the owners that have expired at `now`.
    fn forget_past(&mut self, now: MonoTime) {
        self.owners.retain(|(_, until)| *until > now);
    }

    /// Whether `owner` is remembered at `now`; if so, it is from then on until `until`.
    pub(super) fn renew(&mut self, owner: Owner, until: MonoTime, now: MonoTime) -> bool {
        self.forget_past(now);
        let has = self.has(owner);
        if has {
            self.add(owner, until);
        }
        has
    }

    pub(super) fn clear(&mut self) {
        self.owners.clear();
    }
}
