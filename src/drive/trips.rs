//! Trips of a drive that only counts them: the count is watched, and each rise is read as a record.
//!
//! A rise by n is n trips, a fall is a new baseline (semantics: trips by count). The record is read between two equal
//! counts, so that it belongs to the count.

use super::view::{TripEvent, TripEventKind, TripRecord, TripView};
use crate::domain::time::MonoTime;
use crate::profile::model::{Model, Role};

/// How often a record is read anew because the count went on rising meanwhile. After that the trips are told without
/// a record of their own: they must not wait for ever.
const READS_MAX: u8 = 4;

/// Where the model shows its trips.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Places {
    count: u16,
    /// First register and number of words of the newest record.
    record: Option<(u16, u16)>,
    cause: Option<u16>,
}

/// The trips of one drive.
#[derive(Clone, Debug, Default)]
pub struct TripWatch {
    places: Option<Places>,
    view: TripView,
    /// The count up to which everything was told.
    told: Option<u16>,
    reading: Reading,
    /// A reset was acknowledged; the next count tells whether it holds.
    reset_acknowledged: bool,
}

/// What is read after a rise of the count.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
enum Reading {
    #[default]
    Nothing,
    /// The record, after the count was read as this.
    Record { count: u16, tries: u8 },
    /// The count again, after the record was read as this.
    Count { count: u16, words: Vec<u16>, tries: u8 },
}

impl TripWatch {
    /// The watch of a drive of `model`. It does nothing on a model without a trip count.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        let places = model.register_for(Role::TripCount).map(|count| Places {
            count: count.address,
            record: record_of(model),
            cause: model.register_for(Role::TripCause).map(|cause| cause.address),
        });
        Self { places, ..Self::default() }
    }

    /// What is known.
    #[must_use]
    pub const fn view(&self) -> &TripView {
        &self.view
    }

    /// First register and number of words that should be read now, beside the polls.
    #[must_use]
    pub fn wants(&self) -> Option<(u16, u16)> {
        let places = self.places.as_ref()?;
        match self.reading {
            Reading::Nothing => None,
            Reading::Record { .. } => places.record,
            Reading::Count { .. } => Some((places.count, 1)),
        }
    }

    /// Takes the words that a read from `address` has brought at `now`, polls included.
    pub fn take(&mut self, address: u16, words: &[u16], now: MonoTime) -> Option<TripEvent> {
        let places = self.places.as_ref()?;
        if let Reading::Record { count, tries } = self.reading
            && places.record == Some((address, u16::try_from(words.len()).unwrap_or(u16::MAX)))
        {
            self.reading = Reading::Count { count, words: words.to_vec(), tries };
            return None;
        }
        let offset = places.count.checked_sub(address)?;
        let count = *words.get(usize::from(offset))?;
        self.take_count(count, now)
    }

    /// The drive turns its motor: it is not tripped.
    pub fn output_is_active(&mut self, now: MonoTime) -> Option<TripEvent> {
        // While a record is being read, a trip has just been counted: an older output proves nothing.
        if self.reading == Reading::Nothing { self.clear(now) } else { None }
    }

    /// The drive acknowledged a reset.
    pub fn reset_acknowledged(&mut self) {
        self.reset_acknowledged = self.view.active != Some(false);
    }

    /// The drive stopped answering: it may have lost its power, and with it the trip.
    pub fn lost_sight(&mut self) {
        self.view.active = None;
        self.reading = Reading::Nothing;
        self.reset_acknowledged = false;
    }

    /// The read that was wanted was not answered well; it is not tried again before the next poll of the count.
    pub fn read_failed(&mut self) {
        self.reading = Reading::Nothing;
    }

    fn take_count(&mut self, count: u16, now: MonoTime) -> Option<TripEvent> {
        self.view.count = Some(count);
        let Some(told) = self.told else {
            self.told = Some(count);
            return None;
        };
        if count <= told {
            self.told = Some(count);
            self.reading = Reading::Nothing;
            return if self.reset_acknowledged { self.clear(now) } else { None };
        }
        self.view.active = Some(true);
        self.reset_acknowledged = false;
        let has_record = self.places.as_ref().is_some_and(|places| places.record.is_some());
        match std::mem::take(&mut self.reading) {
            Reading::Count { count: before, words, .. } if before == count => {
                Some(self.tripped(told, count, words, now))
            }
            Reading::Count { tries, .. } if tries + 1 >= READS_MAX => Some(self.tripped(told, count, Vec::new(), now)),
            Reading::Count { tries, .. } => {
                self.reading = Reading::Record { count, tries: tries + 1 };
                None
            }
            Reading::Nothing | Reading::Record { .. } if has_record => {
                self.reading = Reading::Record { count, tries: 0 };
                None
            }
            Reading::Nothing | Reading::Record { .. } => Some(self.tripped(told, count, Vec::new(), now)),
        }
    }

    fn tripped(&mut self, told: u16, count: u16, words: Vec<u16>, now: MonoTime) -> TripEvent {
        let places = self.places.as_ref();
        let first = places.and_then(|places| places.record).map_or(0, |(first, _)| first);
        let words: Vec<(u16, u16)> = (first..).zip(words).collect();
        let cause = places.and_then(|places| places.cause);
        let code = words.iter().find(|(address, _)| Some(*address) == cause).map(|(_, word)| *word);
        let record = TripRecord { at: now, code, words };
        let trips = count - told;
        self.told = Some(count);
        self.view.seen += u32::from(trips);
        self.view.last = Some(record.clone());
        TripEvent { kind: TripEventKind::Tripped { trips, record }, count: Some(count), at: now }
    }

    fn clear(&mut self, now: MonoTime) -> Option<TripEvent> {
        self.reset_acknowledged = false;
        let was_active = self.view.active.replace(false) == Some(true);
        was_active.then_some(TripEvent { kind: TripEventKind::Cleared, count: self.view.count, at: now })
    }
}

/// The registers of the newest record: those with its roles, if they follow each other and fit into one read.
fn record_of(model: &Model) -> Option<(u16, u16)> {
    let roles = [Role::TripCause, Role::TripFrequency, Role::TripCurrent, Role::TripDcLinkVoltage];
    let addresses = || roles.iter().filter_map(|role| model.register_for(*role)).map(|register| register.address);
    let (first, last) = (addresses().min()?, addresses().max()?);
    let count = last - first + 1;
    let is_whole = usize::from(count) == addresses().count() && count <= model.words_in_one_read(first);
    is_whole.then_some((first, count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::testing::model;

    const COUNT: u16 = 0x0112;
    const RECORD: [u16; 4] = [7, 2500, 31, 540];

    fn at(ms: u64) -> MonoTime {
        MonoTime::from_millis(ms)
    }

    fn watch(count: u16) -> TripWatch {
        let mut watch = TripWatch::new(&model());
        assert_eq!(watch.take(COUNT, &[count], at(0)), None, "the first reading is the baseline");
        watch
    }

    fn trips(event: Option<TripEvent>) -> (u16, Option<u16>) {
        match event.expect("an event").kind {
            TripEventKind::Tripped { trips, record } => (trips, record.code),
            TripEventKind::Cleared => panic!("cleared"),
        }
    }

    #[test]
    fn a_rise_is_read_as_a_record_between_two_equal_counts() {
        let mut watch = watch(3);
        assert_eq!(watch.take(COUNT, &[4], at(1)), None);
        assert_eq!((watch.view().active, watch.wants()), (Some(true), Some((0x0113, 4))));
        assert_eq!(watch.take(0x0113, &RECORD, at(2)), None);
        assert_eq!(watch.wants(), Some((COUNT, 1)));
        assert_eq!(trips(watch.take(COUNT, &[4], at(3))), (1, Some(7)));
        assert_eq!((watch.wants(), watch.view().seen), (None, 1));
        assert_eq!(watch.view().last.as_ref().unwrap().words[1], (0x0114, 2500));
        assert_eq!(watch.take(COUNT, &[4], at(4)), None, "told once");
    }

    #[test]
    fn a_record_that_does_not_belong_to_its_count_is_read_anew() {
        let mut watch = watch(3);
        watch.take(COUNT, &[4], at(1));
        watch.take(0x0113, &RECORD, at(2));
        assert_eq!(watch.take(COUNT, &[6], at(3)), None);
        watch.take(0x0113, &RECORD, at(4));
        assert_eq!(trips(watch.take(COUNT, &[6], at(5))), (3, Some(7)));
    }

    #[test]
    fn a_drive_that_trips_on_and_on_is_told_all_the_same() {
        let mut watch = watch(0);
        let events = (1..20).filter_map(|count| {
            watch.take(0x0113, &RECORD, at(2));
            watch.take(COUNT, &[count], at(3))
        });
        assert!(events.count() > 0);
    }

    #[test]
    fn a_fall_is_a_new_baseline() {
        let mut watch = watch(9);
        assert_eq!(watch.take(COUNT, &[2], at(1)), None);
        assert_eq!(watch.wants(), None);
        watch.take(COUNT, &[3], at(2));
        assert!(watch.wants().is_some());
    }

    #[test]
    fn a_trip_clears_by_an_acknowledged_reset_or_by_an_active_output() {
        for by_reset in [true, false] {
            let mut watch = watch(0);
            watch.take(COUNT, &[1], at(1));
            assert_eq!(watch.output_is_active(at(1)), None, "the output may be older than the trip");
            watch.take(0x0113, &RECORD, at(2));
            watch.take(COUNT, &[1], at(3));
            assert_eq!(watch.take(COUNT, &[1], at(4)), None, "nobody reset it");
            let event = if by_reset {
                watch.reset_acknowledged();
                watch.take(COUNT, &[1], at(5))
            } else {
                watch.output_is_active(at(5))
            };
            assert_eq!(event.unwrap().kind, TripEventKind::Cleared);
            assert_eq!(watch.view().active, Some(false));
        }
    }

    #[test]
    fn whether_it_is_tripped_is_unknown_at_start_and_after_it_was_away() {
        let mut watch = watch(1);
        assert_eq!(watch.view().active, None);
        watch.take(COUNT, &[2], at(1));
        watch.lost_sight();
        assert_eq!(watch.view().active, None);
        // The trip that was not read before it went away is read when it is back.
        assert_eq!(watch.take(COUNT, &[2], at(9)), None);
        assert!(watch.wants().is_some());
    }
}
