//! Trips of drives that count them, and of drives that show them.

use super::*;
use crate::profile::model::{Register, RegisterRole};
use crate::vendors::testing::{model, with_status};

const COUNT: u16 = 0x0112;
const RECORD: [u16; 4] = [7, 2500, 31, 540];

fn at(ms: u64) -> MonoTime {
    MonoTime::from_millis(ms)
}

fn watch(count: u16) -> TripWatch {
    let mut watch = seen_once(count);
    assert_eq!(watch.one(COUNT, &[count], at(0)), None, "read again");
    watch
}

fn seen_once(count: u16) -> TripWatch {
    let mut watch = TripWatch::new(&model());
    assert_eq!(
        watch.one(COUNT, &[count], at(0)),
        None,
        "the first reading is the baseline"
    );
    watch
}

fn trips(event: Option<TripEvent>) -> (u16, Option<u16>) {
    match event.expect("an event").kind {
        TripEventKind::Tripped { trips, record } => (trips, record.code),
        TripEventKind::Cleared => panic!("cleared"),
    }
}

impl TripWatch {
    /// The one event that these words bring at most.
    fn one(&mut self, address: u16, words: &[u16], now: MonoTime) -> Option<TripEvent> {
        let mut events = self.take(address.into(), words, now);
        assert!(events.len() <= 1, "{events:?}");
        events.pop()
    }
}

#[test]
fn a_rise_is_read_as_a_record_between_two_equal_counts() {
    let mut watch = watch(3);
    assert_eq!(watch.one(COUNT, &[4], at(1)), None);
    assert_eq!(
        (watch.view().active, watch.wants()),
        (Some(true), Some((Address::holding(0x0113), 4)))
    );
    assert_eq!(watch.one(0x0113, &RECORD, at(2)), None);
    assert_eq!(watch.wants(), Some((Address::holding(COUNT), 1)));
    assert_eq!(trips(watch.one(COUNT, &[4], at(3))), (1, Some(7)));
    assert_eq!((watch.wants(), watch.view().seen), (None, 1));
    assert_eq!(
        watch.view().last.as_ref().unwrap().words[1],
        (Address::holding(0x0114), 2500)
    );
    assert_eq!(watch.one(COUNT, &[4], at(4)), None, "reported once");
}

#[test]
fn a_record_that_does_not_belong_to_its_count_is_read_again() {
    let mut watch = watch(3);
    watch.one(COUNT, &[4], at(1));
    watch.one(0x0113, &RECORD, at(2));
    assert_eq!(watch.one(COUNT, &[6], at(3)), None);
    watch.one(0x0113, &RECORD, at(4));
    assert_eq!(trips(watch.one(COUNT, &[6], at(5))), (3, Some(7)));
}

#[test]
fn a_drive_that_trips_on_and_on_is_reported_all_the_same() {
    let mut watch = watch(0);
    let events = (1..20).filter_map(|count| {
        watch.one(0x0113, &RECORD, at(2));
        watch.one(COUNT, &[count], at(3))
    });
    assert!(events.count() > 0);
}

#[test]
fn a_fall_that_holds_is_a_new_baseline() {
    let mut watch = watch(9);
    for second in 1..=10 {
        assert_eq!(watch.one(COUNT, &[2], at(second * 1000)), None);
        assert_eq!(
            (watch.wants(), watch.baseline().count),
            (None, Some(9)),
            "{second}"
        );
    }
    assert_eq!(watch.one(COUNT, &[2], at(11_000)), None);
    assert_eq!((watch.wants(), watch.baseline().count), (None, Some(2)));
    watch.one(COUNT, &[3], at(12_000));
    assert!(watch.wants().is_some());
}

#[test]
fn a_count_that_comes_back_was_never_lower() {
    for zeros in [1, 3, 9, 20] {
        let mut watch = watch(5);
        for second in 1..=zeros {
            assert_eq!(watch.one(COUNT, &[0], at(second * 1000)), None);
        }
        for second in zeros + 1..zeros + 5 {
            assert_eq!(watch.one(COUNT, &[5], at(second * 1000)), None);
            assert_eq!(
                (watch.wants(), watch.view().seen, watch.baseline().count),
                (None, 0, Some(5)),
                "{zeros}"
            );
        }
        watch.one(COUNT, &[6], at(40_000));
        watch.one(0x0113, &RECORD, at(40_001));
        assert_eq!(
            trips(watch.one(COUNT, &[6], at(40_002))),
            (1, Some(7)),
            "{zeros}"
        );
    }
}

#[test]
fn a_rise_by_more_than_one_behind_a_fall_is_read_again_later() {
    let mut watch = watch(5);
    watch.one(COUNT, &[0], at(1000));
    for ms in [2000, 2500, 2999] {
        assert_eq!(watch.one(COUNT, &[8], at(ms)), None);
        assert_eq!((watch.wants(), watch.view().active), (None, None), "{ms}");
    }
    watch.one(COUNT, &[8], at(3000));
    watch.one(0x0113, &RECORD, at(3001));
    assert_eq!(trips(watch.one(COUNT, &[8], at(3002))), (3, Some(7)));
}

#[test]
fn a_count_of_ones_is_none() {
    let mut watch = watch(5);
    for second in 1..30 {
        assert_eq!(watch.one(COUNT, &[u16::MAX], at(second * 1000)), None);
    }
    assert_eq!(
        (watch.wants(), watch.view().count, watch.baseline().count),
        (None, Some(5), Some(5))
    );
}

#[test]
fn a_count_that_jumps_is_reported_only_when_it_was_read_again() {
    let mut watch = watch(9);
    assert_eq!(watch.one(COUNT, &[9], at(1)), None);
    assert_eq!(watch.one(COUNT, &[22_720], at(2)), None);
    assert_eq!((watch.wants(), watch.view().active), (None, None));
    // It was the answer to something else.
    assert_eq!(watch.one(COUNT, &[9], at(3)), None);
    assert_eq!(
        (watch.wants(), watch.view().seen, watch.baseline().count),
        (None, 0, Some(9))
    );
    // It was none: the record is read as always.
    watch.one(COUNT, &[9 + 17], at(4));
    assert_eq!(watch.one(COUNT, &[9 + 17], at(1004)), None);
    assert_eq!(watch.wants(), Some((Address::holding(0x0113), 4)));
    watch.one(0x0113, &RECORD, at(1005));
    assert_eq!(trips(watch.one(COUNT, &[9 + 17], at(1006))), (17, Some(7)));
}

#[test]
fn of_a_wrong_first_count_no_trip_is_made() {
    for right in [5, 22_720] {
        let mut watch = seen_once(0);
        for ms in [1, 1001] {
            assert_eq!(watch.one(COUNT, &[right], at(ms)), None);
        }
        assert_eq!(
            (watch.wants(), watch.baseline().count, watch.view().active),
            (None, Some(right), None)
        );
    }
}

#[test]
fn a_rise_that_the_next_reading_takes_back_is_no_trip() {
    let mut watch = watch(5);
    watch.one(COUNT, &[5], at(1));
    assert_eq!(watch.one(COUNT, &[6], at(2)), None);
    watch.one(0x0113, &RECORD, at(3));
    assert_eq!(watch.one(COUNT, &[5], at(4)), None);
    assert_eq!(
        (watch.wants(), watch.view().active, watch.view().seen),
        (None, None, 0)
    );
}

#[test]
fn a_trip_clears_by_an_acknowledged_reset_or_by_an_active_output() {
    for by_reset in [true, false] {
        let mut watch = watch(0);
        watch.one(COUNT, &[1], at(1));
        assert_eq!(
            watch.output_is_active(at(1)),
            None,
            "the output may be older than the trip"
        );
        watch.one(0x0113, &RECORD, at(2));
        watch.one(COUNT, &[1], at(3));
        assert_eq!(watch.one(COUNT, &[1], at(4)), None, "nobody reset it");
        let event = if by_reset {
            watch.reset_acknowledged();
            watch.one(COUNT, &[1], at(5))
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
    watch.one(COUNT, &[2], at(1));
    assert_eq!(trips(watch.lost_sight()), (1, None));
    assert_eq!((watch.view().active, watch.wants()), (None, None));
    assert_eq!(
        (watch.one(COUNT, &[2], at(9)), watch.wants()),
        (None, None),
        "reported once"
    );
}

#[test]
fn a_record_that_no_second_count_has_confirmed_is_not_reported_with_a_trip() {
    let mut watch = watch(1);
    watch.one(COUNT, &[3], at(1));
    watch.one(0x0113, &RECORD, at(2));
    assert_eq!(trips(watch.lost_sight()), (2, None));
    assert_eq!(watch.view().last.as_ref().unwrap().words, []);
    assert_eq!(watch.baseline().count, Some(3));
}

/// A drive with a status word whose bit 3 is the trip, and a record of four words.
fn flagged() -> TripWatch {
    TripWatch::new(&with_status())
}

const STATUS: u16 = 0x2100;
const TRIPPED: u16 = 0b1000;

#[test]
fn a_trip_that_begins_to_hold_is_reported_once_with_its_record() {
    let mut watch = flagged();
    assert_eq!(watch.one(STATUS, &[0], at(0)), None);
    assert_eq!(watch.one(STATUS, &[TRIPPED], at(1)), None);
    assert_eq!(
        (watch.view().active, watch.wants()),
        (Some(true), Some((Address::holding(0x0113), 4)))
    );
    assert_eq!(trips(watch.one(0x0113, &RECORD, at(2))), (1, Some(7)));
    assert_eq!(watch.one(STATUS, &[TRIPPED], at(3)), None, "reported once");
    assert_eq!(
        watch.output_is_active(at(3)),
        None,
        "the flag alone tells when it is over"
    );
    assert_eq!(
        watch.one(STATUS, &[0], at(4)).unwrap().kind,
        TripEventKind::Cleared
    );
    assert_eq!(watch.one(STATUS, &[0], at(5)), None);
}

#[test]
fn a_trip_that_held_before_the_drive_was_seen_is_shown_and_not_reported() {
    let mut watch = flagged();
    watch.one(STATUS, &[TRIPPED], at(0));
    assert_eq!(watch.one(0x0113, &RECORD, at(1)), None);
    assert_eq!(watch.view().last.as_ref().unwrap().code, Some(7));
    assert_eq!(
        watch.one(STATUS, &[0], at(2)).unwrap().kind,
        TripEventKind::Cleared
    );
}

#[test]
fn a_trip_that_is_gone_before_its_record_was_read_is_reported_all_the_same() {
    let mut watch = flagged();
    watch.one(STATUS, &[0], at(0));
    watch.one(STATUS, &[TRIPPED], at(1));
    let events = watch.take(STATUS.into(), &[0], at(2));
    assert_eq!(trips(events.first().cloned()), (1, None));
    assert_eq!(
        (events.len(), &events[1].kind, events[1].at),
        (2, &TripEventKind::Cleared, at(2))
    );
    assert_eq!(
        watch.baseline().held,
        Some(false),
        "the next one is reported, also after a start"
    );
    assert_eq!(watch.one(STATUS, &[0], at(3)), None);
}

#[test]
fn a_trip_that_came_while_the_drive_was_away_is_reported_and_one_that_stayed_is_not() {
    for (before, is_reported) in [(0, true), (TRIPPED, false)] {
        let mut watch = flagged();
        watch.one(STATUS, &[before], at(0));
        watch.one(0x0113, &RECORD, at(1));
        watch.lost_sight();
        assert_eq!(watch.view().active, None);
        watch.one(STATUS, &[TRIPPED], at(2));
        assert_eq!(
            watch.one(0x0113, &RECORD, at(3)).is_some(),
            is_reported,
            "{before}"
        );
    }
}

#[test]
fn a_trip_whose_record_was_not_read_before_the_drive_went_away_is_reported_at_once_and_only_once() {
    for back in [0, TRIPPED] {
        let mut watch = flagged();
        assert_eq!(reported(&mut watch, &[0, TRIPPED]), []);
        let event = watch.lost_sight().unwrap();
        assert_eq!((event.at, event.while_away), (at(1), false));
        assert_eq!((trips(Some(event)), watch.lost_sight()), ((1, None), None));
        let then: &[_] = if back == 0 {
            &[("cleared", at(0))]
        } else {
            &[]
        };
        assert_eq!(reported(&mut watch, &[back]), then);
        assert_eq!(watch.one(0x0113, &RECORD, at(4)), None, "reported once");
        let code = (back == TRIPPED).then_some(7);
        assert_eq!(
            (watch.view().seen, watch.view().last.as_ref().unwrap().code),
            (1, code),
            "shown all the same"
        );
    }
}

#[test]
fn a_number_that_was_read_beside_the_record_is_reported_with_a_trip_that_ends_unread() {
    let mut watch = flagged();
    reported(&mut watch, &[0, TRIPPED]);
    assert_eq!(watch.one(0x0113, &[7], at(2)), None);
    assert_eq!(
        trips(watch.take(STATUS.into(), &[0], at(3)).into_iter().next()),
        (1, Some(7))
    );
}

#[test]
fn what_nobody_will_read_any_more_is_reported_and_what_was_reported_is_not() {
    let mut watch = flagged();
    reported(&mut watch, &[0, TRIPPED]);
    assert_eq!(trips(watch.tell_unread()), (1, None));
    assert_eq!(
        (watch.tell_unread(), watch.view().active),
        (None, Some(true))
    );
    let mut watch = flagged();
    reported(&mut watch, &[TRIPPED]);
    assert_eq!(
        (watch.tell_unread(), watch.lost_sight()),
        (None, None),
        "it held before it was seen"
    );
}

#[test]
fn a_trip_that_was_found_on_return_or_at_the_start_came_while_the_drive_was_away() {
    let away = |events: Vec<TripEvent>| {
        events
            .iter()
            .map(|event| event.while_away)
            .collect::<Vec<_>>()
    };
    let mut watch = remembering(TripWatch::new(&model()), Some(3), None, None);
    for (readings, expected) in [([5, 5], true), ([6, 6], false)] {
        watch.one(COUNT, &readings[..1], at(0));
        watch.one(0x0113, &RECORD, at(1));
        assert_eq!(
            away(watch.take(COUNT.into(), &readings[1..], at(2))),
            [expected]
        );
    }
    watch.lost_sight();
    watch.one(COUNT, &[7], at(3));
    assert!(watch.lost_sight().unwrap().while_away);

    let mut watch = remembering(flagged(), None, Some(false), None);
    for expected in [true, false] {
        watch.one(STATUS, &[TRIPPED], at(0));
        assert_eq!(
            away(watch.take(0x0113_u16.into(), &RECORD, at(1))),
            [expected]
        );
        assert_eq!(away(watch.take(STATUS.into(), &[0], at(2))), [false]);
    }
    watch.one(STATUS, &[TRIPPED], at(3));
    assert!(!watch.lost_sight().unwrap().while_away);
    assert_eq!(
        away(watch.take(STATUS.into(), &[0], at(4))),
        [true],
        "it ended while the drive was away"
    );
}

/// What is reported after `readings` of the status, each a millisecond after the one before.
fn reported(watch: &mut TripWatch, readings: &[u16]) -> Vec<(&'static str, MonoTime)> {
    let mut events = Vec::new();
    for (status, now) in readings.iter().zip(0..) {
        events.extend(
            watch
                .take(STATUS.into(), &[*status], at(now))
                .into_iter()
                .map(|event| match event.kind {
                    TripEventKind::Tripped { .. } => ("tripped", event.at),
                    TripEventKind::Cleared => ("cleared", event.at),
                }),
        );
    }
    events
}

#[test]
fn a_trip_right_after_one_that_ended_unread_is_another_trip() {
    let mut watch = flagged();
    assert_eq!(
        reported(&mut watch, &[0, TRIPPED, 0, TRIPPED]),
        [("tripped", at(1)), ("cleared", at(2))]
    );
    assert_eq!(
        watch.wants(),
        Some((Address::holding(0x0113), 4)),
        "the record of the second"
    );
    watch.one(0x0113, &RECORD, at(4));
    assert_eq!(reported(&mut watch, &[TRIPPED, 0]), [("cleared", at(1))]);
    assert_eq!(watch.view().seen, 2);
}

#[test]
fn a_record_that_cannot_be_read_holds_no_trip_back() {
    for mut watch in [flagged(), watch(3)] {
        watch.one(STATUS, &[0], at(0));
        watch.one(STATUS, &[TRIPPED], at(1));
        watch.one(COUNT, &[4], at(1));
        let events: Vec<_> = (0..10).filter_map(|_| watch.read_failed()).collect();
        assert_eq!(events.len(), 1);
        assert_eq!(trips(events.into_iter().next()), (1, None));
        assert_eq!(watch.wants(), None);
    }
}

#[test]
fn another_number_while_a_trip_holds_is_another_trip() {
    let mut watch = flagged();
    watch.one(STATUS, &[0], at(0));
    watch.one(STATUS, &[TRIPPED], at(1));
    watch.one(0x0113, &RECORD, at(2));
    assert_eq!(watch.one(0x0113, &[7], at(3)), None, "the same number");
    assert_eq!(watch.one(0x0113, &[9], at(4)), None);
    assert_eq!(
        trips(watch.one(0x0113, &[9, 0, 0, 530], at(5))),
        (1, Some(9))
    );
}

#[test]
fn another_number_that_the_record_does_not_bear_out_was_read_wrongly() {
    let mut watch = flagged();
    watch.one(STATUS, &[0], at(0));
    watch.one(STATUS, &[TRIPPED], at(1));
    watch.one(0x0113, &RECORD, at(2));
    assert_eq!(watch.one(0x0113, &[0x5507], at(3)), None);
    assert!(watch.wants().is_some(), "the record is read");
    assert_eq!(watch.one(0x0113, &RECORD, at(4)), None);
    assert_eq!(
        (watch.wants(), watch.baseline().code),
        (None, Some(RECORD[0].into()))
    );
    assert_eq!(watch.one(0x0113, &[9], at(5)), None);
    assert_eq!(
        trips(watch.one(0x0113, &[9, 0, 0, 530], at(6))),
        (1, Some(9))
    );
}

fn remembering(
    watch: TripWatch,
    count: Option<u16>,
    held: Option<bool>,
    code: Option<u32>,
) -> TripWatch {
    watch.remembering(TripBaseline { count, held, code })
}

#[test]
fn what_was_counted_while_nobody_looked_is_reported_with_its_record() {
    let mut watch = remembering(TripWatch::new(&model()), Some(3), None, None);
    assert_eq!(watch.one(COUNT, &[5], at(0)), None);
    assert_eq!(watch.wants(), Some((Address::holding(0x0113), 4)));
    watch.one(0x0113, &RECORD, at(1));
    assert_eq!(watch.baseline().count, Some(3), "not reported yet");
    assert_eq!(trips(watch.one(COUNT, &[5], at(2))), (2, Some(7)));
    assert_eq!(
        watch.baseline(),
        TripBaseline {
            count: Some(5),
            held: None,
            code: Some(7)
        }
    );
    for (remembered, baseline) in [(Some(5), 5), (Some(9), 5), (None, 5)] {
        let mut watch = remembering(TripWatch::new(&model()), remembered, None, None);
        assert_eq!(watch.one(COUNT, &[5], at(0)), None);
        assert_eq!(
            (watch.one(COUNT, &[5], at(10_000)), watch.wants()),
            (None, None)
        );
        assert_eq!(
            watch.baseline().count,
            Some(baseline),
            "a fall is a new baseline"
        );
    }
}

#[test]
fn a_count_that_falls_before_the_record_was_read_takes_no_trip_with_it() {
    let mut watch = watch(3);
    watch.one(COUNT, &[5], at(1));
    assert_eq!(
        (watch.one(COUNT, &[0], at(2)), watch.wants()),
        (None, None),
        "it has to hold"
    );
    let event = watch.one(COUNT, &[0], at(10_002)).unwrap();
    assert_eq!(
        (event.count, trips(Some(event))),
        (Some(5), (2, None)),
        "with the count of then"
    );
    assert_eq!(
        (watch.baseline().count, watch.one(COUNT, &[0], at(10_003))),
        (Some(0), None)
    );
}

/// While another gateway of the line is active, polls are overheard and the record is not read.
#[test]
fn a_trip_behind_one_whose_record_was_not_read_has_its_own_time() {
    let of = |event: &TripEvent| {
        (
            event.count,
            event.at,
            event.while_away,
            trips(Some(event.clone())),
        )
    };
    let mut watch = remembering(TripWatch::new(&model()), Some(1), None, None);
    for ms in [0, 500, 6_000] {
        assert_eq!(watch.one(COUNT, &[2], at(ms)), None);
    }
    let first = watch.one(COUNT, &[3], at(6_500)).unwrap();
    assert_eq!(
        of(&first),
        (Some(2), at(0), true, (1, None)),
        "it is reported without its record"
    );
    watch.one(0x0113, &RECORD, at(6_600));
    let second = watch.one(COUNT, &[3], at(6_700)).unwrap();
    assert_eq!(of(&second), (Some(3), at(6_500), false, (1, Some(7))));
    assert_eq!(watch.view().seen, 2);

    let mut watch = remembering(flagged(), None, Some(false), None);
    watch.one(STATUS, &[TRIPPED], at(0));
    watch.one(0x0113, &[7], at(1));
    let first = watch.one(0x0113, &[9], at(6_500)).unwrap();
    assert_eq!(of(&first), (None, at(0), true, (1, Some(7))));
    let second = watch.one(0x0113, &[9, 0, 0, 530], at(6_600)).unwrap();
    assert_eq!(of(&second), (None, at(6_500), false, (1, Some(9))));
}

#[test]
fn a_trip_that_holds_at_start_is_reported_unless_it_was_reported_already() {
    for (held, code, is_reported) in [
        (None, None, true),
        (Some(false), None, true),
        (Some(false), Some(7), true),
        (Some(true), Some(7), false),
        (Some(true), None, false),
        (Some(true), Some(9), true),
    ] {
        let mut watch = remembering(flagged(), None, held, code);
        assert_eq!(watch.one(STATUS, &[TRIPPED], at(0)), None);
        assert_eq!(watch.baseline().held, held, "not reported yet");
        assert_eq!(
            watch.one(0x0113, &RECORD, at(1)).is_some(),
            is_reported,
            "{held:?} {code:?}"
        );
        assert_eq!(
            watch.baseline(),
            TripBaseline {
                count: None,
                held: Some(true),
                code: Some(7)
            }
        );
        assert_eq!(
            watch.one(STATUS, &[0], at(2)).unwrap().kind,
            TripEventKind::Cleared
        );
        assert_eq!(watch.baseline().held, Some(false));
    }
}

#[test]
fn the_end_of_a_trip_that_came_while_nobody_looked_is_reported() {
    let mut watch = remembering(flagged(), None, Some(true), Some(7));
    assert_eq!(
        watch.one(STATUS, &[0], at(0)).unwrap().kind,
        TripEventKind::Cleared
    );
    let mut watch = remembering(flagged(), None, Some(false), Some(7));
    assert_eq!(watch.one(STATUS, &[0], at(0)), None);
}

#[test]
fn another_trip_that_came_while_the_drive_was_away_is_reported() {
    let mut watch = flagged();
    watch.one(STATUS, &[0], at(0));
    watch.one(STATUS, &[TRIPPED], at(1));
    assert!(watch.one(0x0113, &RECORD, at(2)).is_some());
    watch.lost_sight();
    watch.one(STATUS, &[TRIPPED], at(3));
    assert_eq!(
        trips(watch.one(0x0113, &[9, 0, 0, 530], at(4))),
        (1, Some(9))
    );
}

#[test]
fn what_another_kind_of_drive_was_remembered_for_does_not_count() {
    let mut watch = remembering(flagged(), Some(3), Some(false), None);
    assert_eq!(watch.baseline().count, None);
    watch.one(STATUS, &[0], at(0));
    let mut watch = remembering(TripWatch::new(&model()), Some(3), Some(true), None);
    assert_eq!(
        (watch.baseline().held, watch.one(COUNT, &[3], at(0))),
        (None, None)
    );
}

#[test]
fn a_reading_that_may_be_another_drives_makes_no_trip_and_no_end_of_one_but_doubt() {
    let mut watch = flagged();
    watch.one(STATUS, &[0], at(0));
    watch.take_unsure(STATUS.into(), &[0]);
    assert!(!watch.is_contradicted());
    watch.take_unsure(STATUS.into(), &[TRIPPED]);
    assert_eq!(
        (watch.is_contradicted(), watch.view().active, watch.wants()),
        (true, Some(false), None)
    );
    watch.take_unsure(0x0113_u16.into(), &RECORD);
    assert!(
        watch.is_contradicted(),
        "another register tells nothing of it"
    );
    watch.one(STATUS, &[0], at(1));
    assert!(!watch.is_contradicted());
    watch.one(STATUS, &[TRIPPED], at(2));
    watch.take_unsure(STATUS.into(), &[0]);
    assert_eq!(
        (watch.is_contradicted(), watch.view().active),
        (true, Some(true))
    );
    watch.lost_sight();
    assert!(!watch.is_contradicted());
}

#[test]
fn a_trip_that_was_seen_before_the_readings_are_in_doubt_is_reported_without_its_record() {
    let mut watch = flagged();
    assert_eq!(watch.one(STATUS, &[0], at(0)), None);
    assert_eq!(
        watch.one(STATUS, &[TRIPPED], at(1)),
        None,
        "its record is read first"
    );
    assert_eq!(
        trips(watch.take_unsure(STATUS.into(), &[TRIPPED])),
        (1, None)
    );
    assert_eq!(
        (watch.take_unsure(STATUS.into(), &[TRIPPED]), watch.wants()),
        (None, None)
    );
    assert_eq!(watch.one(STATUS, &[TRIPPED], at(3)), None, "reported once");
}

#[test]
fn a_count_that_was_read_only_once_before_the_doubt_is_reported_when_it_was_read_again() {
    let mut watch = watch(3);
    assert_eq!(watch.one(COUNT, &[4], at(1)), None);
    assert_eq!(
        watch.take_unsure(COUNT.into(), &[4]),
        None,
        "perhaps the other drive's count"
    );
    watch.one(0x0113, &RECORD, at(3));
    assert_eq!(trips(watch.one(COUNT, &[4], at(4))), (1, Some(7)));
}

const BITS: u16 = 0x2200;

/// A drive that shows each trip as a bit of one word.
fn bits() -> TripWatch {
    let mut model = model();
    let shows_trips = |role| {
        matches!(
            role,
            RegisterRole::TripCause | RegisterRole::TripCount | RegisterRole::TripFrequency
        )
    };
    let shows_more = |role| {
        matches!(
            role,
            RegisterRole::TripCurrent | RegisterRole::TripDcLinkVoltage | RegisterRole::TripHistory
        )
    };
    model.registers.retain(|it| {
        it.role
            .is_none_or(|role| !shows_trips(role) && !shows_more(role))
    });
    let output = model
        .register_for(RegisterRole::OutputFrequency)
        .cloned()
        .unwrap();
    model.registers.push(Register {
        address: BITS.into(),
        role: Some(RegisterRole::TripBits),
        ..output
    });
    model.registers.sort_by_key(|register| register.address);
    TripWatch::new(&model)
}

/// The reading by a poll, and that of the record if one is wanted.
fn polled(watch: &mut TripWatch, word: u16, now: u64) -> Vec<TripEvent> {
    let mut events = watch.take(BITS.into(), &[word], at(now));
    if watch.wants().is_some() {
        events.extend(watch.take(BITS.into(), &[word], at(now + 1)));
    }
    events
}

#[test]
fn of_several_bits_at_once_the_lowest_is_the_code_and_all_are_kept() {
    let mut watch = bits();
    assert_eq!(polled(&mut watch, 0, 0), []);
    let events = polled(&mut watch, 0b1010_0000, 10);
    assert_eq!(trips(events.into_iter().next()), (1, Some(6)));
    assert_eq!(
        watch.view().last.as_ref().unwrap().words,
        [(BITS.into(), 0b1010_0000)]
    );
    assert_eq!(polled(&mut watch, 0b1010_0000, 20), [], "reported once");
    assert_eq!(polled(&mut watch, 0, 30)[0].kind, TripEventKind::Cleared);
}

#[test]
fn another_bit_while_one_is_set_is_another_trip() {
    let mut watch = bits();
    polled(&mut watch, 0, 0);
    assert_eq!(polled(&mut watch, 0b0001, 10).len(), 1);
    let events = polled(&mut watch, 0b1001, 20);
    assert_eq!(
        trips(events.into_iter().next()),
        (1, Some(1)),
        "the lowest bit is the code"
    );
    assert_eq!(
        (watch.view().seen, watch.baseline().code),
        (2, Some(0b1001))
    );
}

#[test]
fn a_bit_that_clears_is_no_trip_and_may_become_one_again() {
    let mut watch = bits();
    polled(&mut watch, 0, 0);
    polled(&mut watch, 0b1001, 10);
    assert_eq!(polled(&mut watch, 0b0001, 20), []);
    assert_eq!(
        polled(&mut watch, 0b1001, 30),
        [],
        "one reading is not enough to forget it"
    );
    assert_eq!(polled(&mut watch, 0b0001, 40), []);
    assert_eq!(polled(&mut watch, 0b0001, 50), []);
    assert_eq!(watch.baseline().code, Some(0b0001));
    assert_eq!(polled(&mut watch, 0b1001, 60).len(), 1, "it is set again");
}

#[test]
fn another_bit_that_the_record_does_not_show_was_misread() {
    let mut watch = bits();
    polled(&mut watch, 0, 0);
    polled(&mut watch, 0b0001, 10);
    assert_eq!(watch.one(BITS, &[0b0101], at(20)), None);
    assert!(watch.wants().is_some(), "it is read again");
    assert_eq!(
        (watch.one(BITS, &[0b0001], at(21)), watch.wants()),
        (None, None)
    );
    assert_eq!(watch.view().seen, 1);
}

#[test]
fn a_bit_that_was_set_while_the_gateway_was_not_running_is_another_trip() {
    for (known, is_another) in [(0b0001, true), (0b0101, false)] {
        let mut watch = remembering(bits(), None, Some(true), Some(known));
        assert_eq!(
            polled(&mut watch, 0b0101, 0).len(),
            usize::from(is_another),
            "{known:#b}"
        );
    }
}

#[test]
fn a_cause_without_the_flag_is_no_trip() {
    let mut watch = flagged();
    assert_eq!(watch.one(0x0113, &RECORD, at(0)), None, "of an old trip");
    assert_eq!((watch.view().active, watch.wants()), (None, None));
    assert_eq!(watch.one(STATUS, &[0], at(1)), None);
    assert_eq!(
        watch.one(0x0113, &[9, 0, 0, 530], at(2)),
        None,
        "nor is another number"
    );
    assert_eq!((watch.view().active, watch.view().seen), (Some(false), 0));
}

#[test]
fn bits_that_may_be_another_drives_are_not_believed() {
    let mut watch = bits();
    polled(&mut watch, 0, 0);
    assert_eq!(watch.take_unsure(BITS.into(), &[0b0100]), None);
    assert_eq!(
        (watch.is_contradicted(), watch.view().active, watch.wants()),
        (true, Some(false), None)
    );
    assert_eq!(polled(&mut watch, 0, 10), []);
    assert_eq!((watch.is_contradicted(), watch.view().seen), (false, 0));
}
