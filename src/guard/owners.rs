//! A few commanders that something is remembered of.

use crate::domain::command::Owner;
use crate::domain::time::MonoTime;

/// Most commanders that are remembered. One that is forgotten for it has to command stop again before it starts, or its
/// held order to reset acts once more.
const OWNERS_MAX: usize = 64;

/// Commanders in the order in which they came, each until a moment. There is a bound: the one that has been there for
/// longest makes room.
#[derive(Debug, Default)]
pub(super) struct Owners {
    owners: Vec<(Owner, MonoTime)>,
}

impl Owners {
    pub(super) fn has(&self, owner: Owner) -> bool {
        self.owners.iter().any(|(it, _)| *it == owner)
    }

    pub(super) const fn is_empty(&self) -> bool {
        self.owners.is_empty()
    }

    /// Remembers `owner` until `until`, whatever was known of it.
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

    /// Forgets those whose moment has passed at `now`.
    pub(super) fn forget_past(&mut self, now: MonoTime) {
        self.owners.retain(|(_, until)| *until > now);
    }

    pub(super) fn clear(&mut self) {
        self.owners.clear();
    }
}
