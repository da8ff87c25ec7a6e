//! A line's side of the journal: its rows are sent there, and final answers wait a moment for theirs.

use crate::daemon::exchange::answers::{HeldAnswer, LineNews};
use crate::daemon::exchange::inbox::LineMessage;
use crate::daemon::host::clock;
use crate::daemon::journal::JournalSource;
use crate::domain::command::Order;
use crate::domain::ids::{AskerId, DriveIndex, Ticket};
use crate::domain::native::NativeAsk;
use crate::drive::decode;
use crate::journal::{EntryToKeep, RowNumber};
use crate::profile::model::Model;
use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;

/// Longest time that an answer waits for its row. The timers of the north sides may add a millisecond or two.
const HOLD: Duration = Duration::from_millis(18);
/// Most requests whose answers are to wait. Far more than may be unanswered; beyond that, answers do not wait.
const ASKED_MAX: usize = 8192;

/// The rows of one line, and its answers that wait for them.
#[derive(Debug)]
pub struct LineRows {
    source: JournalSource,
    /// The newest row of the line.
    newest: RowNumber,
    /// Requests that write, except stops: an answer to a stop never waits.
    asked: HashSet<(AskerId, Ticket)>,
    held: Vec<HeldAnswer>,
}

impl LineRows {
    /// A line without rows so far.
    #[must_use]
    pub fn new(source: JournalSource) -> Self {
        Self {
            source,
            newest: RowNumber::default(),
            asked: HashSet::new(),
            held: Vec::new(),
        }
    }

    /// The line's handle to the journal.
    #[must_use]
    pub const fn source(&self) -> &JournalSource {
        &self.source
    }

    /// Keeps a row of the line.
    pub fn keep(&mut self, keep: EntryToKeep) {
        self.newest = keep.row;
        self.source.keep(keep);
    }

    /// Notes a message to the line. `model` is that of a drive on it.
    pub fn note<'m>(
        &mut self,
        message: &LineMessage,
        model: impl FnOnce(DriveIndex) -> Option<&'m Arc<Model>>,
    ) {
        let waits = match message {
            LineMessage::Command(it) if !it.order.is_stop() => Some((it.asker, it.ticket)),
            LineMessage::Native(it) | LineMessage::NativeStop(it) => match &it.ask {
                NativeAsk::Write { address, values } => {
                    let order = model(it.drive)
                        .and_then(|model| decode::order(model, *address, values).ok());
                    (!order.as_ref().is_some_and(Order::is_stop)).then_some((it.asker, it.ticket))
                }
                NativeAsk::Read { .. } | NativeAsk::Loop { .. } => None,
            },
            LineMessage::AskerGone(gone) => {
                self.asked.retain(|(asker, _)| asker != gone);
                None
            }
            _ => None,
        };
        if self.asked.len() < ASKED_MAX {
            self.asked.extend(waits);
        }
    }

    /// Holds `news` back if it has to wait for a row; otherwise returns it.
    pub fn hold(&mut self, news: LineNews) -> Option<LineNews> {
        let key = match &news {
            LineNews::Native(answer) => (answer.asker, answer.ticket),
            LineNews::Command(answer) if answer.is_final => (answer.asker, answer.ticket),
            _ => return Some(news),
        };
        let waits = self.asked.remove(&key)
            && !self.source.origin().has_kept(self.newest)
            && self.source.is_sound();
        if !waits {
            return Some(news);
        }
        let origin = Arc::clone(self.source.origin());
        self.held.push(HeldAnswer {
            origin,
            row: self.newest,
            until: clock::now() + HOLD,
            news,
        });
        None
    }

    /// Answers that wait.
    pub fn held(&mut self) -> impl Iterator<Item = HeldAnswer> + use<> {
        std::mem::take(&mut self.held).into_iter()
    }
}
