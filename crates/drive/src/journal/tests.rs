//! What waits to be written: each attempt in one row, equal ones together, the newest when there is no room.

use super::audit::{AuditRows, LostCounts, OPEN_MAX, RowChange, WAITING_MAX};
use super::book::{EVENTS_MAX, JournalBook};
use super::merge::SHARES_MAX;
use super::record::AuditRecord;
use super::*;
use crate::domain::command::{GoOrder, Order, Outcome, Owner, Reason, Report};
use crate::domain::control::FailSafe;
use crate::domain::frequency::Hertz;
use crate::domain::ids::{CommanderName, DriveIndex, Name, UnitId};
use crate::domain::time::{MonoTime, WallTime};
use crate::drive::description::{DriveDescription, DriveRatings, DriveRef, PointSettings};
use crate::drive::plan::PollPace;
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{TripEvent, TripEventKind, TripRecord};
use crate::profile::model::{CodeText, Confidence, Model, RegisterRole, WordOrder};
use crate::vendors;
use serde_json::Value;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, LazyLock};
use std::time::Duration;

fn at(millis: u64) -> MonoTime {
    MonoTime::from_millis(millis)
}

fn label(at: MonoTime) -> WallTime {
    WallTime {
        unix_ms: (at.as_nanos() / 1_000_000) as i64,
    }
}

static MODEL: LazyLock<Arc<Model>> =
    LazyLock::new(|| vendors::catalog().find("hyundai-n700").unwrap().clone());

fn drive(called: &str) -> DriveDescription {
    let name = |text| Name::new(text).unwrap();
    DriveDescription {
        place: DriveRef {
            line: 0,
            drive: DriveIndex(0),
        },
        name: name(called),
        line: name("hall"),
        model: Arc::clone(&MODEL),
        unit: UnitId::new(1).unwrap(),
        uniform_unit: UnitId::new(101).unwrap(),
        group: None,
        pace: PollPace::new(Duration::from_millis(500), 1.0),
        ratings: DriveRatings::default(),
        control: None,
        points: PointSettings::default(),
    }
}

fn attempt(id: u64, order: Order, report: Option<Report>) -> WriteAttempt {
    WriteAttempt {
        id: AttemptId(id),
        owner: Owner::Mqtt,
        tried: TriedWrite::Order(order),
        report,
    }
}

fn setpoint(hertz: u32) -> Order {
    let frequency = Some(Hertz::from_millihertz(hertz * 1000));
    Order::Go(GoOrder::new(Vec::new(), frequency, None).unwrap())
}

fn stop() -> Order {
    Order::Stop { setpoint: None }
}

/// A book and what a journal would hold of its audit.
#[derive(Default)]
struct Rig {
    book: JournalBook,
    rows: BTreeMap<u64, AuditRecord>,
}

impl Rig {
    fn tell(&mut self, millis: u64, entry: JournalEntry) {
        self.book
            .take(1, &drive("pump-1"), at(millis), entry, &label);
    }

    fn write(&mut self) {
        for (number, change) in self.book.audit.waiting() {
            match change {
                RowChange::Put(record) => drop(self.rows.insert(number, record.clone())),
                RowChange::Remove => assert!(
                    self.rows.remove(&number).is_some(),
                    "row {number} was never there"
                ),
            }
        }
        self.book.written();
    }

    /// What was tried, the outcome, and the count.
    fn shown(&self) -> Vec<(String, Option<Outcome>, u64)> {
        self.rows
            .values()
            .map(|it| (it.tried.clone(), it.report.map(|it| it.outcome), it.count))
            .collect()
    }

    fn counted(&self) -> u64 {
        self.rows.values().map(|record| record.count).sum()
    }
}

#[test]
fn an_attempt_is_one_row_whether_its_end_comes_before_or_after_the_first_write() {
    for writes_between in [false, true] {
        let mut rig = Rig::default();
        rig.tell(0, JournalEntry::Attempt(attempt(1, setpoint(30), None)));
        if writes_between {
            rig.write();
            assert_eq!(rig.shown(), [("30.00 Hz".to_owned(), None, 1)]);
        }
        let report = Report::new(Outcome::Confirmed, Reason::None);
        rig.tell(
            5,
            JournalEntry::Ended {
                attempt: AttemptId(1),
                report,
            },
        );
        // Reported twice by mistake, or never begun: ignored.
        rig.tell(
            6,
            JournalEntry::Ended {
                attempt: AttemptId(1),
                report,
            },
        );
        rig.tell(
            6,
            JournalEntry::Ended {
                attempt: AttemptId(2),
                report,
            },
        );
        rig.write();
        assert_eq!(
            rig.shown(),
            [("30.00 Hz".to_owned(), Some(Outcome::Confirmed), 1)]
        );
    }
}

#[test]
fn equal_refusals_share_a_row_for_a_second() {
    let mut rig = Rig::default();
    let refused = |reason| Some(Report::refused(reason));
    for millis in [0, 1, 999, 1000, 1001] {
        rig.tell(
            millis,
            JournalEntry::Attempt(attempt(
                millis,
                setpoint(60),
                refused(Reason::OutsideLimits),
            )),
        );
        if millis == 1 {
            rig.write();
        }
    }
    rig.tell(
        1001,
        JournalEntry::Attempt(attempt(7, setpoint(61), refused(Reason::OutsideLimits))),
    );
    rig.tell(
        1001,
        JournalEntry::Attempt(attempt(8, setpoint(60), refused(Reason::Tripped))),
    );
    rig.write();
    let counts: Vec<_> = rig
        .shown()
        .into_iter()
        .map(|(tried, _, count)| (tried, count))
        .collect();
    let right = [
        ("60.00 Hz", 3),
        ("60.00 Hz", 2),
        ("61.00 Hz", 1),
        ("60.00 Hz", 1),
    ];
    assert_eq!(
        counts,
        right.map(|(tried, count)| (tried.to_owned(), count))
    );
}

#[test]
fn a_slider_that_is_dragged_is_one_row_a_second() {
    for write_each in [1, 3, 1000] {
        let mut rig = Rig::default();
        for number in 0..100_u64 {
            rig.tell(
                number,
                JournalEntry::Attempt(attempt(number, setpoint(number as u32), None)),
            );
            if number % write_each == 0 {
                rig.write();
            }
            if number > 0 {
                let report = Report::new(Outcome::Superseded, Reason::Newer);
                rig.tell(
                    number,
                    JournalEntry::Ended {
                        attempt: AttemptId(number - 1),
                        report,
                    },
                );
            }
        }
        let report = Report::new(Outcome::Confirmed, Reason::None);
        rig.tell(
            101,
            JournalEntry::Ended {
                attempt: AttemptId(99),
                report,
            },
        );
        rig.write();
        let superseded = ("98.00 Hz".to_owned(), Some(Outcome::Superseded), 99);
        assert_eq!(
            rig.shown(),
            [
                superseded,
                ("99.00 Hz".to_owned(), Some(Outcome::Confirmed), 1)
            ],
            "{write_each}"
        );
    }
}

#[test]
fn others_and_other_orders_share_no_row() {
    let mut rig = Rig::default();
    let superseded = Report::new(Outcome::Superseded, Reason::Newer);
    let run = GoOrder::new(
        Vec::new(),
        None,
        Some(crate::domain::command::Direction::Forward),
    )
    .unwrap();
    for (number, order) in [
        (1, stop()),
        (2, stop()),
        (3, Order::Go(run.clone())),
        (4, Order::Go(run)),
    ] {
        rig.tell(0, JournalEntry::Attempt(attempt(number, order, None)));
        rig.tell(
            0,
            JournalEntry::Ended {
                attempt: AttemptId(number),
                report: superseded,
            },
        );
    }
    let refused = Some(Report::refused(Reason::Tripped));
    for (owner, source) in [(Owner::Mqtt, 2), (Owner::Local, 3)] {
        let attempt = WriteAttempt {
            owner,
            ..attempt(1, stop(), refused)
        };
        rig.book.attempt(source, None, at(0), &attempt, &label);
    }
    rig.write();
    assert_eq!(rig.rows.len(), 6);
    assert!(rig.rows.values().all(|record| record.count == 1));
}

#[test]
fn while_nothing_can_be_written_the_newest_is_kept_and_the_rest_is_counted() {
    let mut rig = Rig::default();
    let attempts = 3 * WAITING_MAX as u64;
    rig.tell(0, JournalEntry::Attempt(attempt(0, stop(), None)));
    for number in 1..=attempts {
        // Neither equal nor within a second, so that each is a row of its own.
        let tried = TriedWrite::Text(format!("no {number}"));
        let report = Some(Report::refused(Reason::NotUnderstood));
        rig.tell(
            0,
            JournalEntry::Attempt(WriteAttempt {
                tried,
                ..attempt(number, stop(), report)
            }),
        );
    }
    rig.tell(
        1,
        JournalEntry::Ended {
            attempt: AttemptId(0),
            report: Report::new(Outcome::Confirmed, Reason::None),
        },
    );
    let lost = rig.book.take_lost().attempts;
    rig.write();
    assert_eq!(rig.rows.len(), WAITING_MAX);
    assert_eq!(
        lost + rig.counted(),
        attempts + 1,
        "each is there or counted as lost"
    );
    assert_eq!(
        rig.shown()[0],
        ("stop".to_owned(), Some(Outcome::Confirmed), 1),
        "a stop gives way last"
    );
    assert_eq!(rig.shown()[WAITING_MAX - 1].0, format!("no {attempts}"));
    assert_eq!(rig.book.take_lost(), LostCounts::default());
}

#[test]
fn what_is_counted_together_and_gives_way_is_lost_once() {
    let mut rig = Rig::default();
    let equal = |id| {
        JournalEntry::Attempt(attempt(
            id,
            setpoint(60),
            Some(Report::refused(Reason::Tripped)),
        ))
    };
    (0..10).for_each(|id| rig.tell(0, equal(id)));
    rig.write();
    (10..15).for_each(|id| rig.tell(1, equal(id)));
    for number in 0..WAITING_MAX as u64 {
        let tried = TriedWrite::Text(format!("no {number}"));
        let report = Some(Report::refused(Reason::NotUnderstood));
        rig.tell(
            2,
            JournalEntry::Attempt(WriteAttempt {
                tried,
                ..attempt(number, stop(), report)
            }),
        );
    }
    assert_eq!(
        rig.book.take_lost(),
        LostCounts {
            attempts: 5,
            others: 0
        },
        "ten are in the journal"
    );
    (15..17).for_each(|id| rig.tell(3, equal(id)));
    let lost = rig.book.take_lost().attempts;
    rig.write();
    assert_eq!(rig.counted() + lost + 5, 17 + WAITING_MAX as u64);
}

#[test]
fn what_is_open_and_what_is_shared_is_bounded() {
    let mut audit = AuditRows::default();
    for number in 0..OPEN_MAX as u64 + 10 {
        let record =
            AuditRecord::of_attempt(label(at(0)), None, &attempt(number, setpoint(1), None));
        audit.add(at(0), record, Some((1, AttemptId(number))));
        audit.written();
    }
    let report = Report::new(Outcome::Confirmed, Reason::None);
    audit.end(at(0), (1, AttemptId(9)), report);
    assert!(audit.is_empty(), "the oldest are forgotten");
    audit.end(at(0), (1, AttemptId(10)), report);
    assert_eq!(audit.len(), 1);
    let mut rig = Rig::default();
    for round in 0..2 {
        for number in 0..SHARES_MAX as u64 + 1 {
            let tried = TriedWrite::Text(format!("no {number}"));
            let report = Some(Report::refused(Reason::NotUnderstood));
            rig.tell(
                round,
                JournalEntry::Attempt(WriteAttempt {
                    tried,
                    ..attempt(number, stop(), report)
                }),
            );
        }
    }
    assert!(
        rig.book.audit.len() > SHARES_MAX + 1,
        "the oldest is shared no more"
    );
}

#[test]
fn a_trip_is_worded_once_and_changes_what_is_remembered() {
    let mut rig = Rig::default();
    let record = TripRecord {
        at: at(90),
        code: Some(1),
        words: vec![(0x0111_u16.into(), 250), (0xEEEE_u16.into(), 7)],
    };
    let baseline = TripBaseline {
        count: Some(3),
        held: Some(true),
        code: Some(1),
    };
    let tripped = TripEvent {
        kind: TripEventKind::Tripped { trips: 2, record },
        count: Some(3),
        at: at(100),
        while_away: true,
    };
    rig.tell(100, JournalEntry::Trip(tripped, baseline));
    assert!(rig.book.has_trip());
    let event = rig.book.events().next().unwrap();
    assert_eq!(
        (event.kind, event.drive.as_str(), event.at),
        ("tripped", "pump-1", label(at(100)))
    );
    let body = Value::Object(event.body.clone());
    assert_eq!(
        (&body["at"], &body["trips"], &body["code"]),
        (&"1970-01-01T00:00:00.100Z".into(), &2.into(), &1.into())
    );
    assert_eq!(
        (&body["values"]["0xEEEE"]["value"], &body["while_away"]),
        (&7.into(), &true.into())
    );
    let memory: HashMap<_, _> = rig.book.memory().collect();
    let memory = memory[&Name::new("pump-1").unwrap()];
    assert_eq!(
        (memory.trips_total, memory.last_code, memory.trips),
        (2, Some(1), Some(baseline))
    );
    rig.write();
    assert!(rig.book.is_empty() && !rig.book.has_trip());
    for _ in 0..=EVENTS_MAX {
        let event = TripEvent {
            kind: TripEventKind::Cleared,
            count: None,
            at: at(0),
            while_away: false,
        };
        rig.tell(0, JournalEntry::Trip(event, baseline));
    }
    assert_eq!(
        (rig.book.events().count(), rig.book.take_lost()),
        (
            EVENTS_MAX,
            LostCounts {
                attempts: 0,
                others: 1
            }
        )
    );
}

#[test]
fn uncommanded_actions_and_availability_are_rows_too() {
    let mut rig = Rig::default();
    let owner = Some(Owner::Mqtt);
    rig.tell(
        0,
        JournalEntry::FailSafe {
            owner,
            action: FailSafe::Stop,
            cause: FailSafeCause::CommanderLost,
        },
    );
    rig.tell(0, JournalEntry::StopPending { coast: false });
    rig.tell(
        0,
        JournalEntry::StopOver {
            is_effective: false,
        },
    );
    rig.tell(0, JournalEntry::Presence(DrivePresence::Offline));
    rig.tell(0, JournalEntry::Presence(DrivePresence::Unknown));
    let rows: Vec<_> = rig
        .book
        .availability()
        .map(|row| (row.kind.as_str(), row.body.as_str()))
        .collect();
    assert_eq!(rows, [("drive", r#"{"state":"offline"}"#)]);
    rig.write();
    let rows: Vec<_> = rig.rows.values().map(|record| record.row(10)).collect();
    let shown: Vec<_> = rows
        .iter()
        .map(|row| (row.number, row.kind.as_str(), row.body.as_str()))
        .collect();
    let failsafe =
        r#"{"by":"mqtt","cause":"commander_lost","count":1,"stage":"due","tried":"stop"}"#;
    let given_up = r#"{"by":null,"count":1,"tried":"stop"}"#;
    assert_eq!(
        shown,
        [(11, "failsafe", failsafe), (12, "stop_given_up", given_up)]
    );
}

#[test]
fn what_is_not_needed_is_forgotten_unless_something_new_comes() {
    let mut rig = Rig::default();
    let name = Name::new("pump-1").unwrap();
    rig.tell(0, JournalEntry::StopPending { coast: false });
    rig.write();
    rig.book.forget(&name);
    assert_eq!(
        (rig.book.forgotten().collect::<Vec<_>>(), rig.book.len()),
        (vec![&name], 1)
    );
    rig.tell(1, JournalEntry::StopPending { coast: true });
    assert_eq!(
        (rig.book.forgotten().count(), rig.book.memory().count()),
        (0, 1)
    );
    rig.book.forget(&name);
    rig.write();
    assert!(rig.book.is_empty() && rig.book.all_memory().is_empty());
}

#[test]
fn changes_of_control_are_rows() {
    let mut rig = Rig::default();
    let by = |name: &str| Some(Owner::MqttBy(CommanderName::new(name).unwrap()));
    for owner in [by("a"), by("a"), by("b"), None, None, by("a")] {
        rig.tell(0, JournalEntry::Lease(owner));
    }
    rig.book.orphan_leases(at(1), label(at(1)));
    rig.tell(2, JournalEntry::Lease(by("a")));
    rig.write();
    let rows: Vec<_> = rig.rows.values().map(|record| record.row(0)).collect();
    assert!(
        rows.iter()
            .all(|row| row.kind == "lease" && row.name.as_deref() == Some("pump-1"))
    );
    let shown: Vec<_> = rows.iter().map(|row| row.body.as_str()).collect();
    let right = [
        r#"{"by":"mqtt a","state":"opened"}"#,
        r#"{"by":"mqtt b","from":"mqtt a","state":"taken_over"}"#,
        r#"{"by":"mqtt b","state":"ended"}"#,
        r#"{"by":"mqtt a","state":"opened"}"#,
        r#"{"by":"mqtt a","state":"orphaned"}"#,
        r#"{"by":"mqtt a","state":"taken_up"}"#,
    ];
    assert_eq!(shown, right);
}

#[test]
fn who_stood_in_the_way_is_in_the_row_and_another_one_makes_another_row() {
    let mut rig = Rig::default();
    for (id, holder) in [(1, Owner::Mqtt), (2, Owner::Mqtt), (3, Owner::Local)] {
        rig.tell(
            0,
            JournalEntry::Attempt(attempt(id, setpoint(30), Some(Report::held_by(holder)))),
        );
    }
    rig.write();
    let bodies: Vec<_> = rig.rows.values().map(|record| record.row(0).body).collect();
    assert_eq!(bodies.len(), 2);
    for (body, parts) in bodies.iter().zip([
        [r#""holder":"mqtt""#, r#""count":2"#],
        [r#""holder":"local""#, r#""count":1"#],
    ]) {
        assert!(parts.iter().all(|part| body.contains(part)), "{body}");
    }
}

#[test]
fn a_lease_of_an_earlier_life_is_marked_once() {
    let name = Name::new("pump-1").unwrap();
    let lease = Some(RememberedLease {
        owner: Owner::Mqtt,
        was_orphaned: false,
    });
    let memory = BTreeMap::from([(
        name.clone(),
        RememberedDrive {
            lease,
            ..RememberedDrive::default()
        },
    )]);
    let mut book = JournalBook::new(memory);
    book.orphan_leases(at(0), label(at(0)));
    assert!(
        book.memory()
            .all(|(_, memory)| memory.lease.unwrap().was_orphaned)
    );
    assert_eq!(book.written(), 2, "what is remembered, and the row of that");
    book.orphan_leases(at(0), label(at(0)));
    assert!(book.is_empty());
    book.touch_all();
    assert_eq!(book.len(), 1);
}

#[test]
fn of_trips_that_are_bits_all_texts_are_reported() {
    let mut drive = drive("fan");
    let mut model = Model::clone(&drive.model);
    let mut register = model.registers[0].clone();
    model.registers.clear();
    register.role = Some(RegisterRole::TripBits);
    let address = register.address;
    model.registers.push(register);
    let text = |code, text: &str| CodeText {
        code,
        text: text.to_owned(),
        confidence: Confidence::Manual,
        source: "IM 1".to_owned(),
    };
    model.trip_codes = vec![text(1, "overcurrent"), text(4, "overheated")];
    drive.model = Arc::new(model);
    let record = TripRecord {
        at: MonoTime::from_millis(1),
        code: Some(1),
        words: vec![(address, 0b10_1001)],
    };
    assert_eq!(
        trip::text_of(&drive, &record).as_deref(),
        Some("overcurrent; overheated; bit 5")
    );
    let two_words = |order: WordOrder| {
        let mut drive = drive.clone();
        let mut model = Model::clone(&drive.model);
        model.registers[0].form.pair = Some(order);
        drive.model = Arc::new(model);
        let [first, second] = order.words(0x0002_0001);
        let words = vec![(address, first), (address.saturating_add(1), second)];
        trip::text_of(
            &drive,
            &TripRecord {
                words,
                ..record.clone()
            },
        )
    };
    for order in [WordOrder::HighFirst, WordOrder::LowFirst] {
        assert_eq!(
            two_words(order).as_deref(),
            Some("overcurrent; bit 17"),
            "{order:?}"
        );
    }
    let unread = TripRecord {
        words: Vec::new(),
        ..record
    };
    assert_eq!(
        trip::text_of(&drive, &unread).as_deref(),
        Some("overcurrent"),
        "as far as it is known"
    );
}
