//! What is kept, and what a restart may do: O9 and O14, and O1, O2, O11 across restarts.

use super::Checker;
use super::book::Book;
use super::log::What;
use super::tables::Kind;
use super::wire::Exchange;
use std::collections::HashMap;

/// A trip that a drive showed for this long in one run must be kept.
const SHOWN: u64 = 10_000_000_000;
/// And in so many replies. An unexplained frame makes the next eight replies doubtful (rule 53), and between those the
/// station may be left alone for long: a trip that is over by then is not reported. For the same reason two trips are
/// two only if as many replies between them show none, and a count is sure only after as many: three are the first,
/// one that confirms it and one beside the record.
const REPLIES: u32 = 11;

/// Something that is kept now.
#[derive(Clone, Copy, Debug)]
pub enum Kept {
    /// The number of trips, and the drive's own count after them.
    Trips { trips: u16, count: Option<u16> },
}

/// What the gateway knows of a drive at its start, as far as it affects what it may do.
#[derive(Clone, Copy, Debug, Default)]
pub struct Known {
    pub is_leased: bool,
    /// A stop is remembered, and whether it is a coast.
    pub stop: Option<bool>,
}

/// Trips of one drive: what it showed and what was kept.
#[derive(Debug, Default)]
pub struct Trips {
    /// How often the drive was tripped.
    made: u32,
    kept: u32,
    /// The count in its replies, since when, and the last that was kept.
    count: Option<(u16, u64)>,
    /// The highest count that was shown for long.
    sure_count: u16,
    /// How many replies have shown the count.
    count_replies: u32,
    kept_count: Option<u16>,
    /// A trip is shown: since when in this life.
    held_since: Option<u64>,
    held_replies: u32,
    /// Replies since then that showed no trip.
    clear_replies: u32,
    is_sure: bool,
    /// Trips that were shown for long.
    owed: u32,
}

/// Attempts of the present run, and whether each has its end.
pub type Attempts = HashMap<u64, bool>;

impl Checker {
    /// The drive was tripped while it was on.
    pub fn tripped(&mut self, drive: usize) {
        self.trips[drive].made += 1;
    }

    /// Something is kept now.
    pub fn kept(&mut self, at: u64, drive: usize, it: Kept) {
        let Kept::Trips { trips, count } = it;
        self.log.add(
            at,
            What::World,
            drive as u16,
            format!("kept: {it:?}").as_bytes(),
        );
        let book = &mut self.trips[drive];
        book.kept += u32::from(trips);
        let is_in_order = count.is_none() || book.kept_count < count;
        book.kept_count = count.or(book.kept_count);
        let most = book.count.map_or(book.made, |(count, _)| u32::from(count));
        if book.kept > most || !is_in_order {
            let text = format!("drive {drive} tripped {most} times: {book:?}");
            self.object("O9", || text);
        }
    }

    /// A client reads this number of trips.
    pub fn trips_shown(&mut self, drive: usize, total: u32) {
        if total > self.trips[drive].kept {
            let text = format!(
                "{total} trips of drive {drive} are shown: {:?}",
                self.trips[drive]
            );
            self.object("O9", || text);
        }
    }

    /// A reply was received: what it shows of trips.
    pub(super) fn shows_trips(&mut self, at: u64, drive: usize, exchange: &Exchange) {
        let word = |register: u16| {
            let offset = register
                .checked_sub(exchange.address)
                .filter(|it| *it < exchange.count)?;
            Some(exchange.words[usize::from(offset)])
        };
        let kind = self.line.drives[drive].kind;
        let book = &mut self.trips[drive];
        let holds = match kind {
            Kind::N700 => {
                let Some(count) = word(0x0112) else { return };
                match book.count {
                    Some((shown, since)) if shown == count => {
                        book.count_replies += 1;
                        if at > since + SHOWN && book.count_replies >= REPLIES {
                            book.sure_count = count;
                        }
                    }
                    _ => (book.count, book.count_replies) = (Some((count, at)), 1),
                }
                return;
            }
            Kind::E510 => word(0x2520).map(|word| word & 8 == 8),
            Kind::Fr500a => word(0x2100).map(|word| word == 6),
        };
        match holds {
            Some(true) => {
                book.clear_replies = 0;
                let since = *book.held_since.get_or_insert(at);
                book.held_replies += 1;
                if at > since + SHOWN && book.held_replies >= REPLIES && !book.is_sure {
                    book.is_sure = true;
                    book.owed += 1;
                }
            }
            Some(false) => {
                book.clear_replies += 1;
                if book.clear_replies >= REPLIES {
                    (book.held_since, book.held_replies, book.is_sure) = (None, 0, false);
                }
            }
            None => {}
        }
    }

    /// A write attempt is reported, or its end.
    pub fn attempt(&mut self, id: u64, has_ended: bool) {
        let known = self.attempts.len() as u64;
        if self.attempts.insert(id, has_ended).is_some() || id != known + 1 {
            self.object("O14", || format!("attempt {id} behind {known} others"));
        }
    }

    /// An attempt has ended.
    pub fn attempt_ended(&mut self, id: u64) {
        let before = self.attempts.insert(id, true);
        if before != Some(false) {
            self.object("O14", || format!("attempt {id} ends, before: {before:?}"));
        }
    }

    /// The gateway is killed.
    pub fn killed(&mut self, at: u64) {
        self.log.add(at, What::World, 0, b"the gateway is killed");
        self.attempts.clear();
        for trips in &mut self.trips {
            trips.held_since = None;
            trips.count = trips.count.map(|(count, _)| (count, at));
        }
        self.messages_forgotten();
        for drive in 0..self.trips.len() {
            let kept = self.trips[drive].kept;
            self.telling_starts_again(drive, kept);
        }
        for book in &mut self.books {
            book.orders
                .iter_mut()
                .for_each(|it| (it.is_void, it.is_over) = (true, true));
            book.fresh.clear();
            book.may_stop = None;
            book.stop_due = None;
            book.stopped_at = None;
        }
    }

    /// The next run begins; `known` is what it knows of each drive. A drive that is not remembered is left as it is.
    pub fn restarted(&mut self, at: u64, known: &[Known]) {
        for (drive, known) in known.iter().enumerate() {
            let text = format!("restarted: {known:?}");
            self.log.add(at, What::World, drive as u16, text.as_bytes());
            self.books[drive].restarted(*known);
        }
    }

    /// The gateway has ended: everything is accounted for.
    pub(super) fn check_kept(&mut self) {
        if let Some((id, _)) = self.attempts.iter().find(|(_, has_ended)| !**has_ended) {
            let text = format!("attempt {id} has no end");
            self.object("O14", || text);
        }
        for drive in 0..self.trips.len() {
            let book = &self.trips[drive];
            let shown = book.owed.max(book.sure_count.into());
            if book.kept < shown && self.keeps {
                let text = format!("drive {drive} showed a trip that is not kept: {book:?}");
                self.object("O9", || text);
            }
            self.check_told(drive, shown);
        }
    }
}

impl Book {
    fn restarted(&mut self, known: Known) {
        self.is_orphaned = known.is_leased;
        self.awaits_sight = true;
        self.is_running &= known.is_leased;
        self.remembered_stop = known.stop.is_some();
        self.stop.is_pending = known.stop.is_some();
        self.stop.echoed = false;
        self.stop.zeros = 0;
        self.zeros = 0;
        if let Some(coast) = known.stop {
            self.stop.is_coast = coast;
        }
    }

    /// The drive is seen for the first time in this run: from now on the declared action must happen.
    pub(super) fn is_seen(&mut self, at: u64, runs: bool, bound: u64) {
        if !runs && self.zeros > 0 {
            // At standstill already: nothing to do.
            self.awaits_sight = false;
            self.remembered_stop = false;
        }
        if !self.awaits_sight || !runs {
            return;
        }
        self.awaits_sight = false;
        self.sign_at = at;
        if std::mem::take(&mut self.remembered_stop) {
            self.stop_due = Some(at + bound);
        }
    }
}
