//! What the north sides hand to a journal, where there is one.

use super::clock;
use super::journal;
use super::shared::Current;
use crate::drive::description::DriveRef;
use crate::journal::Attempt;
use std::fmt::Debug;
use std::sync::Arc;

/// A journal as the north sides see it. No call waits.
pub trait NorthJournal: Debug + Send + Sync {
    /// Keeps an attempt to write that no line saw; nothing for the drive: it was for all, or for none that exists. Its
    /// report is there. Ids count within each side, and no end follows.
    fn keep(&self, drive: Option<DriveRef>, attempt: Attempt);
    /// The broker has the event with this number.
    fn event_taken(&self, seq: u64);
    /// The MQTT side wants the first events with higher numbers that no broker has. It is answered once, with
    /// [`News::Events`](super::answers::News::Events): at once if there are any, else when there is one. A later want
    /// takes the place of one that is not answered.
    fn want_events(&self, after: u64);
}

/// The journal, if there is one. Without it, attempts are dropped and events are not asked for.
pub type Journal = Option<Arc<dyn NorthJournal>>;

/// The way of one north side, whose attempts are counted from 1, to the journal.
#[derive(Debug)]
struct Side {
    journal: Arc<journal::Journal>,
    current: Current,
    source: u64,
}

/// The way of another north side to `journal`; `current` knows the names of drives.
#[must_use]
pub fn side(journal: Option<&Arc<journal::Journal>>, current: &Current) -> Journal {
    let journal = Arc::clone(journal?);
    let source = journal.next_source();
    Some(Arc::new(Side { journal, current: current.clone(), source }))
}

impl NorthJournal for Side {
    fn keep(&self, drive: Option<DriveRef>, attempt: Attempt) {
        let shared = self.current.load();
        let known = drive.and_then(|place| shared.drives.iter().find(|it| it.description.place == place));
        self.journal.refused(self.source, known.map(|it| &it.description.name), clock::now(), attempt);
    }

    fn event_taken(&self, seq: u64) {
        self.journal.event_taken(seq);
    }

    fn want_events(&self, after: u64) {
        self.journal.want_events(after);
    }
}
