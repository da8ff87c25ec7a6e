//! Trips of a drive that only counts them.

use super::{READS_MAX, RecordReading, TripWatch};
use crate::domain::time::MonoTime;
use crate::drive::doubt::READ_AGAIN_AFTER;
use crate::drive::view::TripEvent;

/// A count that rises by more at once is read again before it is believed: it may be the answer to another request.
const TRIPS_AT_ONCE: u16 = 16;

impl TripWatch {
    /// The drive has counted this many trips.
    pub(super) fn take_count(&mut self, count: u16, now: MonoTime, events: &mut Vec<TripEvent>) {
        let is_first = self.reported.is_none();
        let known = *self.reported.get_or_insert(count);
        if count == u16::MAX && known != count {
            // An erased memory, or a read that was answered with nothing.
            return;
        }
        let is_usual = self.reported_is_sure && !self.fall.has_fallen() && self.doubted.is_none();
        let most = if is_usual { TRIPS_AT_ONCE } else { 1 };
        let Some(reported) = self.fall.base(count.into(), known.into(), now) else {
            return;
        };
        let reported = u16::try_from(reported).unwrap_or(known);
        if reported < known {
            // The rise up to the fall is reported with its own count.
            events.extend(self.tell_unread());
        }
        self.reported = Some(reported);
        if self.is_doubted(count, reported, most, now) {
            return;
        }
        self.reported_is_sure |= !is_first && count == reported;
        if count > reported.saturating_add(most) && !self.reported_is_sure && self.reading.is_none()
        {
            // The count that was read twice is the baseline.
            self.reported = Some(count);
            self.view.count = Some(count);
            self.reported_is_sure = true;
            return;
        }
        if count == reported
            && let Some(reading) = self.reading.take_if(|reading| !reading.is_sure)
        {
            // A rise that only one reading has shown.
            self.view.active = reading.was_active;
        }
        if count <= reported {
            events.extend(self.tell_unread());
            self.reported = Some(count);
            self.view.count = Some(count);
            if self.reset_acknowledged {
                events.extend(self.clear(now));
            }
            return;
        }
        self.take_rise(count, now, events);
    }

    /// The count has risen to `count`: a trip has happened, whose record is read until it belongs to that count.
    fn take_rise(&mut self, count: u16, now: MonoTime, events: &mut Vec<TripEvent>) {
        // A listener reads no record: the trip before keeps its own time and count.
        if self
            .reading
            .as_ref()
            .is_some_and(|it| it.is_news && it.is_sure && it.count.is_some_and(|was| was < count))
        {
            events.extend(self.end_reading(false));
        }
        let parts = self.places.as_ref().map_or(0, |places| places.record.len());
        let mut reading = self
            .reading
            .take()
            .unwrap_or_else(|| self.new_reading(true, now));
        self.view.count = Some(count);
        self.view.active = Some(true);
        self.reset_acknowledged = false;
        reading.is_sure |= reading.count == Some(count);
        let is_whole = reading.parts >= parts;
        let belongs = reading.count == Some(count) || parts == 0;
        let is_worn_out = reading.tries >= READS_MAX;
        if reading.count != Some(count) && !is_worn_out {
            let tries = reading.tries + u8::from(is_whole && reading.count.is_some());
            reading = RecordReading {
                count: Some(count),
                tries,
                is_news: true,
                parts: 0,
                words: Vec::new(),
                ..reading
            };
            reading.code = None;
        }
        self.reading = Some(reading);
        if (is_whole && belongs) || is_worn_out {
            events.extend(self.end_reading(!is_worn_out));
        }
    }

    /// Whether `count`, which is not below `reported`, the count reported so far, has to be read again before it is
    /// believed.
    fn is_doubted(&mut self, count: u16, reported: u16, most: u16, now: MonoTime) -> bool {
        let is_usual = count.saturating_sub(reported) <= most;
        let is_known = self
            .reading
            .as_ref()
            .is_some_and(|reading| reading.count == Some(count));
        let since = self
            .doubted
            .filter(|(doubted, _)| *doubted == count)
            .map(|(_, since)| since);
        if is_usual || is_known || since.is_some_and(|since| now.since(since) >= READ_AGAIN_AFTER) {
            self.doubted = None;
            return false;
        }
        self.doubted = Some((count, since.unwrap_or(now)));
        true
    }
}
