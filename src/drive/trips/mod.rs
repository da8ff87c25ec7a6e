//! Trips of a drive: what shows them is watched, and each is told once, with its record.
//!
//! * A drive that only counts its trips: a rise by n is n trips, a fall is a new baseline. The record is read between two
//!   equal counts, so that it belongs to the count.
//! * A drive that shows whether a trip holds, by a flag or by the trip's number: each time it begins to hold is a trip,
//!   and so is another number while it holds.
//!
//! What was told is remembered beyond the life of the gateway, as a [`TripBaseline`]: what goes beyond it is told, also
//! if it came while nobody looked. Where nothing can be remembered, what held already when the drive was first seen is no
//! news: its record is read and shown, and not told as an event.

mod places;
#[cfg(test)]
mod tests;

use super::view::{TripEvent, TripEventKind, TripRecord, TripView};
use crate::domain::time::MonoTime;
use crate::profile::model::Model;
use places::{Places, Seen, Source};

/// How often a record is read anew because the count went on rising meanwhile, or because it was not answered. After
/// that the trips are told with what there is: they must not wait for ever.
const READS_MAX: u8 = 4;

/// Up to where the trips of a drive were told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TripBaseline {
    /// The drive's own count; nothing where it does not count, or was not read yet.
    pub count: Option<u16>,
    /// Whether a trip held that was told, if that was known.
    pub held: Option<bool>,
    /// The vendor's number of the trip that held last, if it was read.
    pub code: Option<u16>,
}

/// The trips of one drive.
#[derive(Clone, Debug, Default)]
pub struct TripWatch {
    places: Option<Places>,
    view: TripView,
    /// The count up to which everything was told.
    told: Option<u16>,
    /// Whether a trip held when that was last known and told, also before the drive was out of sight.
    held: Option<bool>,
    /// The vendor's number of the trip that was told or shown last.
    code: Option<u16>,
    /// What was told outlives the gateway: what is not remembered was never told.
    is_remembered: bool,
    reading: Option<Reading>,
    /// A reset was acknowledged; the next count tells whether it holds.
    reset_acknowledged: bool,
}

/// A record that is being read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Reading {
    /// The count that the record must belong to, on a drive that counts.
    count: Option<u16>,
    /// How many of the record's reads have come.
    parts: usize,
    words: Vec<(u16, u16)>,
    tries: u8,
    /// The trip is to be told when the record is there.
    is_news: bool,
}

impl TripWatch {
    /// The watch of a drive of `model`. It does nothing on a model that shows no trips.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        Self { places: Places::of(model), ..Self::default() }
    }

    /// The same, where `baseline` is what was told so far.
    #[must_use]
    pub fn remembering(self, baseline: TripBaseline) -> Self {
        let TripBaseline { count, held, code } = baseline;
        let counts = self.is_counted();
        Self { told: count.filter(|_| counts), held: held.filter(|_| !counts), code, is_remembered: true, ..self }
    }

    /// Up to where everything was told.
    #[must_use]
    pub const fn baseline(&self) -> TripBaseline {
        TripBaseline { count: self.told, held: self.held, code: self.code }
    }

    /// What is known.
    #[must_use]
    pub const fn view(&self) -> &TripView {
        &self.view
    }

    /// First register and number of words that should be read now, beside the polls.
    #[must_use]
    pub fn wants(&self) -> Option<(u16, u16)> {
        let (places, reading) = (self.places.as_ref()?, self.reading.as_ref()?);
        match (places.record.get(reading.parts), &places.source) {
            (Some(part), _) => Some(*part),
            (None, Source::Count(count)) => Some((*count, 1)),
            (None, _) => None,
        }
    }

    /// Takes the words that a read from `address` has brought at `now`, polls included.
    pub fn take(&mut self, address: u16, words: &[u16], now: MonoTime) -> Option<TripEvent> {
        let places = self.places.as_ref()?;
        let word = |register: u16| words.get(usize::from(register.checked_sub(address)?)).copied();
        let (seen, cause) = (places.source.seen(word), places.cause.and_then(word));
        let part = self.take_part(address, words, now);
        let shown = match seen {
            Some(Seen::Held(holds)) => self.take_held(holds, now),
            Some(Seen::Counted(count)) => self.take_count(count, now),
            None => None,
        };
        if let Some(code) = cause.filter(|_| part.is_none() && shown.is_none()) {
            self.take_code(code);
        }
        part.or(shown)
    }

    /// The drive turns its motor. One that only counts its trips is not tripped then.
    pub fn output_is_active(&mut self, now: MonoTime) -> Option<TripEvent> {
        // While a record is being read, a trip has just been counted: an older output proves nothing.
        if self.is_counted() && self.reading.is_none() { self.clear(now) } else { None }
    }

    /// The drive acknowledged a reset.
    pub fn reset_acknowledged(&mut self) {
        self.reset_acknowledged = self.view.active != Some(false);
    }

    /// The drive stopped answering: it may have lost its power, and with it the trip.
    pub fn lost_sight(&mut self) {
        self.view.active = None;
        self.reset_acknowledged = false;
        // A trip that was not told yet is news again when the drive is back and it still holds.
        self.reading = None;
    }

    /// The read that was wanted was not answered well at `now`.
    pub fn read_failed(&mut self, now: MonoTime) -> Option<TripEvent> {
        let reading = self.reading.as_mut()?;
        reading.tries += 1;
        if reading.tries < READS_MAX { None } else { self.tell_what_there_is(now) }
    }

    /// Takes one part of the record, if it is the one that is awaited.
    fn take_part(&mut self, address: u16, words: &[u16], now: MonoTime) -> Option<TripEvent> {
        let (places, reading) = (self.places.as_ref()?, self.reading.as_mut()?);
        let (first, count) = *places.record.get(reading.parts)?;
        if first != address || usize::from(count) != words.len() {
            return None;
        }
        reading.words.extend((address..).zip(words.iter().copied()));
        reading.parts += 1;
        let is_whole = reading.parts == places.record.len();
        if is_whole && reading.count.is_none() { self.tell_what_there_is(now) } else { None }
    }

    /// A trip holds or does not.
    fn take_held(&mut self, holds: bool, now: MonoTime) -> Option<TripEvent> {
        if holds {
            let is_new = self.view.active.replace(true) != Some(true);
            let was_told = self.held.unwrap_or(!self.is_remembered);
            return if is_new { self.begin(!was_told, now) } else { None };
        }
        if self.reading.as_ref().is_some_and(|reading| reading.is_news) {
            // It is gone before its record was read: it is told all the same, and its end with the next reading.
            return self.tell_what_there_is(now);
        }
        self.reading = None;
        let held_before = self.held.replace(false);
        if self.view.active.is_none() && held_before == Some(true) {
            self.view.active = Some(true);
        }
        self.clear(now)
    }

    /// Another number than the one that was told, while a trip holds, is another trip.
    fn take_code(&mut self, code: u16) {
        let last = self.view.last.as_ref().and_then(|last| last.code);
        let is_other = last.is_some_and(|last| code != 0 && code != last);
        if !self.is_counted() && self.view.active == Some(true) && self.reading.is_none() && is_other {
            self.reading = Some(Reading { is_news: true, ..Reading::default() });
        }
    }

    fn take_count(&mut self, count: u16, now: MonoTime) -> Option<TripEvent> {
        let before = self.view.count.replace(count);
        let told = *self.told.get_or_insert(count);
        if count <= told {
            self.told = Some(count);
            if self.reading.take().is_some() {
                // It was counted anew before the record was read: what had risen until then is told all the same.
                let trips = before.map_or(1, |before| before.saturating_sub(told).max(1));
                return Some(self.tell(trips, TripRecord { at: now, code: None, words: Vec::new() }, now));
            }
            return if self.reset_acknowledged { self.clear(now) } else { None };
        }
        self.view.active = Some(true);
        self.reset_acknowledged = false;
        let parts = self.places.as_ref().map_or(0, |places| places.record.len());
        let reading = self.reading.get_or_insert_with(|| Reading { is_news: true, ..Reading::default() });
        let is_whole = reading.parts >= parts;
        let belongs = reading.count == Some(count) || parts == 0;
        let is_worn_out = reading.tries >= READS_MAX;
        if (is_whole && belongs) || is_worn_out {
            return self.tell_what_there_is(now);
        }
        if reading.count != Some(count) {
            let tries = reading.tries + u8::from(is_whole && reading.count.is_some());
            *reading = Reading { count: Some(count), tries, is_news: true, ..Reading::default() };
        }
        None
    }

    /// A trip that holds begins to be read, or is told at once where the model has no record.
    fn begin(&mut self, is_news: bool, now: MonoTime) -> Option<TripEvent> {
        self.reading = Some(Reading { is_news, ..Reading::default() });
        let has_record = self.places.as_ref().is_some_and(|places| !places.record.is_empty());
        if has_record { None } else { self.tell_what_there_is(now) }
    }

    /// The reading is over: its record is shown and, if it is news, told.
    fn tell_what_there_is(&mut self, now: MonoTime) -> Option<TripEvent> {
        let (places, reading) = (self.places.as_ref()?, self.reading.take()?);
        let is_whole = reading.parts >= places.record.len() && reading.tries < READS_MAX;
        // Of a record that may belong to another trip nothing is kept.
        let words = if is_whole || reading.count.is_none() { reading.words } else { Vec::new() };
        let code = words.iter().find(|(address, _)| Some(*address) == places.cause).map(|(_, word)| *word);
        let is_other = matches!((code, self.code), (Some(code), Some(told)) if code != told && code != 0);
        let is_news = reading.is_news || (is_other && self.held == Some(true));
        let record = TripRecord { at: now, code, words };
        let trips = match (reading.count, self.told) {
            (Some(_), Some(told)) => self.view.count.map_or(1, |count| count.saturating_sub(told).max(1)),
            _ => 1,
        };
        if self.is_counted() {
            self.told = self.view.count;
        } else {
            self.held = Some(true);
        }
        if is_news {
            return Some(self.tell(trips, record, now));
        }
        self.code = code.or(self.code);
        self.view.last = Some(record);
        None
    }

    fn tell(&mut self, trips: u16, record: TripRecord, now: MonoTime) -> TripEvent {
        self.code = record.code;
        self.view.last = Some(record.clone());
        self.view.seen += u32::from(trips);
        TripEvent { kind: TripEventKind::Tripped { trips, record }, count: self.view.count, at: now }
    }

    fn is_counted(&self) -> bool {
        self.places.as_ref().is_some_and(|places| matches!(places.source, Source::Count(_)))
    }

    fn clear(&mut self, now: MonoTime) -> Option<TripEvent> {
        self.reset_acknowledged = false;
        let was_active = self.view.active.replace(false) == Some(true);
        was_active.then_some(TripEvent { kind: TripEventKind::Cleared, count: self.view.count, at: now })
    }
}
