//! Detects the trips of a drive and reports each once, with its record.
//!
//! * A drive that only counts its trips: a rise by n is n trips, a fall that holds is a new baseline. The record is read
//!   between two equal counts, so that it belongs to the count. A rise by more than a few at once, or by more than one
//!   behind a fall, is read again later before it is believed, and a rise that the next reading does not confirm is ignored.
//! * A drive that shows whether a trip is active, by a flag or by the trip's number: each time it becomes active is a
//!   trip, and so is another number while it is active. Where each trip has a bit, so is another bit.
//!
//! A detected trip is always reported: if it ends or the drive goes offline before its record was read, it is reported
//! without one.
//!
//! What has been reported outlives the process as a [`TripBaseline`]: anything beyond it is reported, even if it
//! happened while the gateway was not running. Without that memory, a trip that was already active when the drive was
//! first seen is not reported as an event; its record is only read and shown.

mod baseline;
mod bits;
mod count;
mod places;
#[cfg(test)]
mod tests;

use super::doubt::CounterFallWatch;
use super::view::{TripEvent, TripEventKind, TripRecord, TripView};
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::Model;
pub use baseline::TripBaseline;
use places::{TripPlaces, TripReading, TripSource};
use std::time::Duration;

/// How often a record is read again because the count kept rising or the read was not answered. After that the trips
/// are reported with what is known, so that they do not wait forever.
const READS_MAX: u8 = 4;

/// How long another number waits for the record of the trip before it, which is reported without it then.
const UNREAD_AFTER: Duration = Duration::from_secs(2);

/// The trips of one drive.
#[derive(Clone, Debug, Default)]
pub struct TripWatch {
    places: Option<TripPlaces>,
    view: TripView,
    /// The count up to which everything has been reported.
    reported: Option<u16>,
    /// The count in `reported` was read more than once.
    reported_is_sure: bool,
    /// A reading of the count that is believed once it has been read again, and when it was first read.
    doubted: Option<(u16, MonoTime)>,
    /// Whether the count has fallen.
    fall: CounterFallWatch,
    /// Whether a trip was active when that was last known and reported, even before the drive went offline.
    held: Option<bool>,
    /// The vendor's number, or the bits, of the last trip reported or shown.
    code: Option<u32>,
    /// The vendor's number, or the bits, of the trip whose record is shown.
    shown: Option<u32>,
    /// Bits of `shown` that the last reading showed cleared.
    fading: u32,
    /// Whether the baseline outlives the process: then anything not in it was never reported.
    is_remembered: bool,
    /// Whether the trip source has been read since the start, or since the drive was offline.
    is_in_sight: bool,
    reading: Option<RecordReading>,
    /// A reset was acknowledged; the next count shows whether it had an effect.
    reset_acknowledged: bool,
    /// A reading that may be another drive's contradicts what is known.
    is_contradicted: bool,
}

/// A record that is being read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct RecordReading {
    /// The count that the record must belong to, on a drive that counts.
    count: Option<u16>,
    /// How many of the record's reads have arrived.
    parts: usize,
    words: Vec<(Address, u16)>,
    /// The vendor's number, or the bits, as seen beside the record.
    code: Option<u32>,
    tries: u8,
    /// The trip is to be reported once the record has been read.
    is_news: bool,
    /// When the trip was detected.
    seen_at: MonoTime,
    /// The trip was already there when the drive came online.
    while_away: bool,
    /// The count was read more than once.
    is_sure: bool,
    /// Whether a trip was active before, if known.
    was_active: Option<bool>,
    /// The number of the previous active trip, if this reading began because another number was seen.
    instead_of: Option<u32>,
}

impl TripWatch {
    /// The watch of a drive of `model`. It does nothing on a model that shows no trips.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        Self {
            places: TripPlaces::of(model),
            ..Self::default()
        }
    }

    /// The watch with `baseline` as what has been reported so far.
    #[must_use]
    pub fn remembering(self, baseline: TripBaseline) -> Self {
        let TripBaseline { count, held, code } = baseline;
        let (reported, held) = if self.is_counted() {
            (count, None)
        } else {
            (None, held)
        };
        Self {
            reported,
            reported_is_sure: reported.is_some(),
            held,
            code,
            is_remembered: true,
            ..self
        }
    }

    /// Up to where everything has been reported.
    #[must_use]
    pub const fn baseline(&self) -> TripBaseline {
        TripBaseline {
            count: self.reported,
            held: self.held,
            code: self.code,
        }
    }

    /// The current view.
    #[must_use]
    pub const fn view(&self) -> &TripView {
        &self.view
    }

    /// First register and number of words to be read now, in addition to the polls; `None` if none.
    #[must_use]
    pub fn wants(&self) -> Option<(Address, u16)> {
        if self.doubted.is_some() || self.fall.is_doubted() {
            // The next polls tell.
            return None;
        }
        let places = self.places.as_ref()?;
        let reading = self.reading.as_ref()?;
        match (places.record.get(reading.parts), &places.source) {
            (Some(part), _) => Some(*part),
            (None, TripSource::Count(count)) => Some((*count, 1)),
            (None, _) => None,
        }
    }

    /// Takes the words that a read from `address` has brought at `now`, polls included. They may tell of a trip and of
    /// its end.
    pub fn take(&mut self, address: Address, words: &[u16], now: MonoTime) -> Vec<TripEvent> {
        let Some(places) = &self.places else {
            return Vec::new();
        };
        let word = |register: Address| register.word_in(address, words);
        let seen = places.source.seen(word);
        let cause = places.cause.and_then(|cause| cause.code(word));
        let mut events = Vec::from_iter(self.take_part(address, words));
        match seen {
            Some(TripReading::Held(true)) => events.extend(self.take_held(now)),
            Some(TripReading::Held(false)) => self.take_released(now, &mut events),
            Some(TripReading::Counted(count)) => self.take_count(count, now, &mut events),
            None => {}
        }
        self.is_in_sight |= seen.is_some();
        self.is_contradicted &= seen.is_none();
        if let Some(code) = cause.filter(|code| *code != 0 && events.is_empty()) {
            events.extend(self.take_code(code, now));
        }
        events
    }

    /// Takes words that may be another drive's: of trips they tell nothing, except that what is known may not be so. A
    /// trip that was seen before is reported without its record, which cannot be read now. A count that was read only
    /// once may have been the other drive's already; it is read again afterwards.
    pub fn take_unsure(&mut self, address: Address, words: &[u16]) -> Option<TripEvent> {
        let places = self.places.as_ref()?;
        let word = |register: Address| register.word_in(address, words);
        if let (Some(TripReading::Held(held)), Some(active)) =
            (places.source.seen(word), self.view.active)
        {
            self.is_contradicted = held != active;
        }
        let was_seen = self
            .reading
            .as_ref()
            .is_some_and(|reading| reading.is_news && (reading.count.is_none() || reading.is_sure));
        if was_seen {
            self.end_reading(false)
        } else {
            None
        }
    }

    /// Whether a reading that may be another drive's contradicts what is known.
    #[must_use]
    pub const fn is_contradicted(&self) -> bool {
        self.is_contradicted
    }

    /// The output is active. A drive that only counts its trips is then not tripped.
    pub fn output_is_active(&mut self, now: MonoTime) -> Option<TripEvent> {
        // While a record is being read, a trip has just been counted: an older output proves nothing.
        if self.is_counted() && self.reading.is_none() {
            self.clear(now)
        } else {
            None
        }
    }

    /// The drive acknowledged a reset.
    pub fn reset_acknowledged(&mut self) {
        self.reset_acknowledged = self.view.active != Some(false);
    }

    /// The drive stopped answering: it may have lost its power, and with it the trip.
    pub fn lost_sight(&mut self) -> Option<TripEvent> {
        let event = self.tell_unread();
        self.view.active = None;
        self.reset_acknowledged = false;
        self.is_in_sight = false;
        self.is_contradicted = false;
        self.doubted = None;
        self.fall = CounterFallWatch::default();
        event
    }

    /// The record can no longer be read: a new trip is reported without it.
    pub fn tell_unread(&mut self) -> Option<TripEvent> {
        if self.reading.as_ref()?.is_news {
            return self.end_reading(false);
        }
        self.reading = None;
        None
    }

    /// The wanted read failed.
    pub fn read_failed(&mut self) -> Option<TripEvent> {
        let reading = self.reading.as_mut()?;
        reading.tries += 1;
        if reading.tries < READS_MAX {
            None
        } else {
            self.end_reading(false)
        }
    }

    /// Takes one part of the record, if it is the one that is awaited.
    fn take_part(&mut self, address: Address, words: &[u16]) -> Option<TripEvent> {
        let (places, reading) = (self.places.as_ref()?, self.reading.as_mut()?);
        let (first, count) = *places.record.get(reading.parts)?;
        if first != address || usize::from(count) != words.len() {
            return None;
        }
        reading
            .words
            .extend(address.onwards().zip(words.iter().copied()));
        reading.parts += 1;
        let is_whole = reading.parts == places.record.len();
        if is_whole && reading.count.is_none() {
            self.end_reading(true)
        } else {
            None
        }
    }

    /// A trip is active.
    fn take_held(&mut self, now: MonoTime) -> Option<TripEvent> {
        let is_new = self.view.active.replace(true) != Some(true);
        let was_reported = self.held.unwrap_or(!self.is_remembered);
        if is_new {
            self.begin(!was_reported, now)
        } else {
            None
        }
    }

    /// No trip is active. One that ended before its record was read is reported anyway.
    fn take_released(&mut self, now: MonoTime, events: &mut Vec<TripEvent>) {
        events.extend(self.tell_unread());
        let held_before = self.held.replace(false);
        if self.view.active.is_none() && held_before == Some(true) {
            self.view.active = Some(true);
        }
        events.extend(self.clear(now));
    }

    /// The number or the bits of a trip were seen. While one is active, another number or bit is another trip.
    fn take_code(&mut self, code: u32, now: MonoTime) -> Option<TripEvent> {
        if self.is_counted() || self.view.active != Some(true) {
            return None;
        }
        self.forget_cleared(code);
        let waits = |it: &RecordReading| {
            it.is_news && now.since(it.seen_at) >= UNREAD_AFTER && self.is_another(code, it.code)
        };
        let event = if self.reading.as_ref().is_some_and(waits) {
            self.end_reading(false)
        } else {
            None
        };
        let last = self.shown;
        if self.reading.is_none() && self.is_another(code, last) {
            self.reading = Some(RecordReading {
                instead_of: last,
                ..self.new_reading(true, now)
            });
        }
        if let Some(reading) = &mut self.reading {
            reading.code = Some(code);
        }
        event
    }

    /// Begins to read the record of an active trip, or reports it at once if the model has no record.
    fn begin(&mut self, is_news: bool, now: MonoTime) -> Option<TripEvent> {
        self.reading = Some(self.new_reading(is_news, now));
        let has_record = self
            .places
            .as_ref()
            .is_some_and(|places| !places.record.is_empty());
        if has_record {
            None
        } else {
            self.end_reading(true)
        }
    }

    fn new_reading(&self, is_news: bool, now: MonoTime) -> RecordReading {
        let was_active = self.view.active;
        RecordReading {
            is_news,
            seen_at: now,
            while_away: !self.is_in_sight,
            was_active,
            ..RecordReading::default()
        }
    }

    /// Ends the reading: its record is shown and, if new, reported. `is_sure`: the record is the trip's own.
    fn end_reading(&mut self, is_sure: bool) -> Option<TripEvent> {
        let places = self.places.as_ref()?;
        let reading = self.reading.take()?;
        // A record that may belong to another trip is discarded.
        let words = if is_sure || reading.count.is_none() {
            reading.words
        } else {
            Vec::new()
        };
        let word = |register| {
            words
                .iter()
                .find(|(address, _)| *address == register)
                .map(|(_, word)| *word)
        };
        let cause = places.cause.and_then(|cause| cause.code(word));
        if cause
            .zip(reading.instead_of)
            .is_some_and(|(cause, before)| !places.is_another(cause, before))
        {
            // The record shows the trip that was active: the other number, or bit, was misread.
            return None;
        }
        let code = cause.filter(|code| *code != 0).or(reading.code);
        let is_other = code.is_some_and(|code| self.is_another(code, self.code));
        let is_news = reading.is_news || (is_other && self.held == Some(true));
        let number = code.and_then(|code| places.code(code));
        let record = TripRecord {
            at: reading.seen_at,
            code: number,
            words,
        };
        self.shown = code;
        self.fading = 0;
        let trips = match (reading.count, self.reported) {
            (Some(_), Some(reported)) => self
                .view
                .count
                .map_or(1, |count| count.saturating_sub(reported).max(1)),
            _ => 1,
        };
        if self.is_counted() {
            self.reported = self.view.count;
            self.reported_is_sure = true;
        } else {
            self.held = Some(true);
        }
        self.code = if is_news { code } else { code.or(self.code) };
        self.view.last = Some(record.clone());
        if !is_news {
            return None;
        }
        self.view.seen += u32::from(trips);
        let kind = TripEventKind::Tripped { trips, record };
        Some(TripEvent {
            kind,
            count: self.view.count,
            at: reading.seen_at,
            while_away: reading.while_away,
        })
    }

    fn is_counted(&self) -> bool {
        self.places
            .as_ref()
            .is_some_and(|places| matches!(places.source, TripSource::Count(_)))
    }

    fn clear(&mut self, now: MonoTime) -> Option<TripEvent> {
        self.reset_acknowledged = false;
        let was_active = self.view.active.replace(false) == Some(true);
        let while_away = !self.is_in_sight;
        was_active.then_some(TripEvent {
            kind: TripEventKind::Cleared,
            count: self.view.count,
            at: now,
            while_away,
        })
    }
}
