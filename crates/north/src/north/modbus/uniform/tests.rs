//! The uniform unit as clients see it.

use super::super::request::parse;
use super::super::testing::{self, NOW};
use super::*;
use crate::domain::command::{Direction, Order, Outcome, Owner, Reason, Report, RunIntent};
use crate::domain::control::{ControlAction, FailSafe};
use crate::domain::fail_safe::{FailSafeCause, FailSafeRun};
use crate::domain::ids::CommanderName;
use crate::domain::standby::LineRole;
use crate::domain::time::MonoTime;
use crate::drive::snapshot::DrivePresence;
use crate::drive::view::{ControlView, KeptTrips, RunState, TripRecord};
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;

const CLIENT: Owner = Owner::ModbusTcp(IpAddr::V4(Ipv4Addr::new(10, 0, 0, 1)));
const OTHER: Owner = Owner::ModbusTcp(IpAddr::V4(Ipv4Addr::new(10, 0, 0, 2)));

fn present(now: MonoTime) -> RequestContext {
    RequestContext {
        now,
        uptime_s: 0x0001_0007,
        owner: CLIENT,
        standby: None,
    }
}

fn unit() -> UniformUnit {
    UniformUnit::new(&testing::description())
}

fn take(
    unit: &UniformUnit,
    pdu: &[u8],
    view: &DriveView,
    now: MonoTime,
) -> (RequestAction, Vec<u16>) {
    let mut words = WordBuffer::default();
    let taken = unit.take(&parse(pdu).unwrap(), view, &present(now), &mut words);
    (taken, words.as_slice().to_vec())
}

#[track_caller]
fn picture(unit: &UniformUnit, view: &DriveView, now: MonoTime) -> [u16; 32] {
    let (taken, words) = take(unit, &[4, 0, 0, 0, 32], view, now);
    assert_eq!(taken, RequestAction::Words);
    assert_eq!(
        take(unit, &[3, 0, 0, 0, 32], view, now).1,
        words,
        "03 reads what 04 reads"
    );
    words.try_into().unwrap()
}

fn word(address: u16, view: &DriveView) -> u16 {
    unit().word(address, view, &present(NOW)).unwrap()
}

const fn later(millis: u64) -> MonoTime {
    MonoTime::from_nanos(NOW.as_nanos() + millis * 1_000_000)
}

#[test]
fn a_fresh_picture_has_every_word() {
    #[rustfmt::skip]
    let right = [
        1, 0b0011_0011, 2, 0, 4250, 4250,
        123, 3800, 5401, 76, 985, (-70_i16).cast_unsigned(),
        0, 0, 0, 0b11_1111_1111,
        7, 0, 0, 0, 500, 5000,
        0, 40_000, 1234, 755, 0b1_0011,
        0, 0, 0, 0, 0,
    ];
    assert_eq!(picture(&unit(), &testing::view(), NOW), right);
}

#[test]
fn a_listener_shows_what_it_hears_and_says_that_it_listens() {
    let read = |standby, pdu: &[u8]| {
        let mut words = WordBuffer::default();
        let present = RequestContext {
            standby,
            ..present(NOW)
        };
        let taken = unit().take(&parse(pdu).unwrap(), &testing::view(), &present, &mut words);
        (taken, words.as_slice().to_vec())
    };
    for (standby, status, mask) in [
        (None, 0b0011_0011, 0b11_1111_1111),
        (Some(LineRole::Active), 0b0011_0011, 0b10_0011_1111_1111),
        (
            Some(LineRole::Listening),
            0b10_0000_0001_0011,
            0b10_0011_1111_1111,
        ),
    ] {
        let (_, words) = read(standby, &[4, 0, 0, 0, 16]);
        assert_eq!(
            (words[1], words[4], words[15]),
            (status, 4250, mask),
            "{standby:?}"
        );
        assert_eq!(
            read(standby, &[2, 0, 13, 0, 1]).0,
            RequestAction::Bits {
                bits: status >> 13,
                count: 1
            }
        );
    }
}

#[test]
fn a_stale_picture_has_no_measurement() {
    let stale = picture(&unit(), &testing::view(), later(3_000));
    let absent: Vec<usize> = (0..32)
        .filter(|place| [ABSENT, ABSENT_SIGNED].contains(&stale[*place]))
        .collect();
    assert_eq!(absent, [4, 5, 6, 7, 8, 9, 10, 11, 22, 23, 24, 25]);
    assert_eq!((stale[10], stale[11]), (ABSENT_SIGNED, ABSENT_SIGNED));
    assert_eq!(
        (stale[1], stale[12], stale[17]),
        (0b1_0010_0011, 300, alarm::STALE)
    );
    let fresh = picture(&unit(), &testing::view(), later(2_999));
    assert_eq!((fresh[4], fresh[12], fresh[17]), (4250, 299, 0));
}

#[test]
fn a_drive_that_nobody_has_looked_at_reads_in_full() {
    let words = picture(&unit(), &DriveView::default(), NOW);
    assert_eq!((words[1], words[2], words[3]), (bit::STALE, 5, ABSENT));
    assert_eq!(
        (words[12], words[17]),
        (ABSENT, alarm::STALE | alarm::LINE_DOWN)
    );
    assert!(words[4..10].iter().all(|word| *word == ABSENT));
}

#[test]
fn a_drive_that_is_out_of_reach_is_offline() {
    let mut view = testing::view();
    view.snapshot.presence = DrivePresence::Offline;
    let words = picture(&unit(), &view, NOW);
    assert_eq!((words[1], words[2]), (0, 5), "nothing is known to run");
    let mut view = testing::view();
    view.line_is_up = false;
    let words = picture(&unit(), &view, NOW);
    assert_eq!((words[1], words[2], words[17]), (0, 5, alarm::LINE_DOWN));
}

#[test]
fn what_a_model_does_not_have_is_absent_and_not_reported() {
    let mut description = testing::description();
    let mut model = testing::model();
    model
        .registers
        .retain(|register| !register.access.can_read());
    description.model = Arc::new(model);
    description.control = None;
    let words = picture(&UniformUnit::new(&description), &testing::view(), NOW);
    #[rustfmt::skip]
    let right = [
        1, 0b11, 2, 0, ABSENT, ABSENT,
        ABSENT, ABSENT, ABSENT, ABSENT, ABSENT_SIGNED, ABSENT_SIGNED,
        ABSENT, ABSENT, ABSENT, 1,
        7, 0, 0, 0, ABSENT, ABSENT,
        ABSENT, ABSENT, ABSENT, ABSENT, 0,
        0, 0, 0, 0, 0,
    ];
    assert_eq!(words, right);
}

#[test]
fn a_measurement_in_another_unit_is_absent() {
    let mut description = testing::description();
    let mut model = testing::model();
    for register in &mut model.registers {
        if register.name == "output_current" {
            register.unit = crate::domain::units::UnitOfMeasure::Percent;
        }
    }
    description.model = Arc::new(model);
    let words = picture(&UniformUnit::new(&description), &testing::view(), NOW);
    assert_eq!((words[6], words[24]), (ABSENT, ABSENT));
}

#[test]
fn the_mask_holds_every_bit_that_can_be_set_without_control() {
    let description = crate::drive::description::DriveDescription {
        control: None,
        ..testing::description()
    };
    let words = picture(&UniformUnit::new(&description), &testing::view(), NOW);
    assert_eq!(
        words[15],
        bit::ONLINE | bit::RUNNING | bit::TRIPPED | bit::AT_SETPOINT | bit::STALE
    );
    assert_eq!(words[1] & !words[15], 0);
}

#[test]
fn each_run_state_has_its_number_and_bits() {
    for (state, number, bits) in [
        (RunState::Unknown, 0, 0),
        (RunState::Stopped, 1, 0),
        (RunState::Forward, 2, bit::RUNNING | bit::AT_SETPOINT),
        (
            RunState::Reverse,
            3,
            bit::RUNNING | bit::REVERSE | bit::AT_SETPOINT,
        ),
        (RunState::Tripped, 4, bit::TRIPPED),
        (RunState::Offline, 5, 0),
        (RunState::Running, 6, bit::RUNNING | bit::AT_SETPOINT),
        (RunState::Stopping, 7, bit::RUNNING | bit::AT_SETPOINT),
    ] {
        let mut view = testing::view();
        view.run_state = state;
        assert_eq!(
            (word(2, &view), word(1, &view)),
            (number, bits | bit::ONLINE | bit::ACCEPTS),
            "{state:?}"
        );
    }
}

#[test]
fn at_setpoint_means_the_setpoint_that_was_ordered() {
    let ordered = Some(Hertz::from_centihertz(3000));
    for (intent, setpoint, near) in [
        (RunIntent::Run(Direction::Forward), ordered, false),
        (
            RunIntent::Run(Direction::Forward),
            Some(Hertz::from_centihertz(1000)),
            true,
        ),
        (RunIntent::Run(Direction::Forward), None, true),
        (RunIntent::Stop, ordered, true),
    ] {
        let mut view = testing::view();
        view.snapshot.take(0x0101_u16.into(), &[1000], NOW);
        view.snapshot.take(0x010A_u16.into(), &[100], NOW);
        view.control = Some(ControlView {
            intent,
            setpoint,
            ..ControlView::default()
        });
        assert_eq!(
            word(1, &view) & bit::AT_SETPOINT != 0,
            near,
            "{intent:?} {setpoint:?}: the drive's own setting is 10 Hz"
        );
    }
}

#[test]
fn at_setpoint_is_within_a_tenth_of_a_hertz() {
    for (output, setting, near) in [
        (4250, 424, true),
        (4250, 426, true),
        (4261, 425, false),
        (4239, 425, false),
    ] {
        let mut view = testing::view();
        view.snapshot.take(0x0101_u16.into(), &[output], NOW);
        view.snapshot.take(0x010A_u16.into(), &[setting], NOW);
        assert_eq!(
            word(1, &view) & bit::AT_SETPOINT != 0,
            near,
            "{output} {setting}"
        );
    }
}

#[test]
fn a_trip_is_shown_as_far_as_it_is_known() {
    let record = |code| {
        Some(TripRecord {
            at: NOW,
            code,
            words: Vec::new(),
        })
    };
    for (active, last, now_word) in [
        (Some(false), None, 0),
        (Some(false), record(Some(7)), 0),
        (Some(true), record(Some(7)), 7),
        (Some(true), record(None), ABSENT),
        (Some(true), record(Some(0)), ABSENT),
        (Some(true), None, ABSENT),
        (None, record(Some(7)), ABSENT),
    ] {
        let mut view = testing::view();
        view.trip.active = active;
        view.trip.last = last;
        assert_eq!(word(3, &view), now_word, "{:?}", view.trip);
        assert_eq!(word(1, &view) & bit::TRIPPED != 0, active == Some(true));
        assert_eq!(
            (word(13, &view), word(14, &view)),
            (0, 0),
            "none of it is kept yet"
        );
    }
}

#[test]
fn trips_are_counted_as_they_are_kept() {
    for (total, last_code, words) in [
        (0, None, (0, 0)),
        (3, Some(7), (3, 7)),
        (3, None, (3, ABSENT)),
        (65_534, Some(7), (65_534, 7)),
        (65_535, Some(7), (65_534, 7)),
        (u32::MAX, Some(7), (65_534, 7)),
    ] {
        let mut view = testing::view();
        view.trip_kept = KeptTrips {
            total,
            last_code,
            ..KeptTrips::default()
        };
        assert_eq!(
            (word(13, &view), word(14, &view)),
            words,
            "{total} {last_code:?}"
        );
    }
}

#[test]
fn a_warning_has_a_bit_that_only_drives_with_warnings_report() {
    let mut description = testing::description();
    let mut model = testing::model();
    let register = model
        .registers
        .iter_mut()
        .find(|it| it.name == "run_hours")
        .unwrap();
    register.role = Some(crate::profile::model::RegisterRole::WarningBits);
    register.form.mask = 0x00F0;
    let address = register.address;
    description.model = Arc::new(model);
    let shown = |word, now| {
        let mut view = testing::view();
        view.snapshot.take(address, &[word], NOW);
        let words = picture(&UniformUnit::new(&description), &view, now);
        (words[1] & bit::WARNING, words[15] & bit::WARNING)
    };
    assert_eq!(shown(0x0010, NOW), (bit::WARNING, bit::WARNING));
    assert_eq!(
        shown(0xFF0F, NOW),
        (0, bit::WARNING),
        "the other bits of the word are none of its own"
    );
    assert_eq!(shown(0x0010, later(600_000)), (0, bit::WARNING), "too old");
    assert_eq!(word(15, &testing::view()) & bit::WARNING, 0);
}

#[test]
fn control_is_shown_as_it_is() {
    let mut view = testing::view();
    let control = ControlView {
        start_inhibited: true,
        not_effective: true,
        failsafe: Some(FailSafeRun::due(
            FailSafe::Stop,
            FailSafeCause::CommanderLost,
            NOW,
        )),
        stop_pending: true,
        commands: 77,
        intent: RunIntent::Run(Direction::Reverse),
        setpoint: Some(Hertz::from_millihertz(42_500)),
        last: Some(Report::refused(Reason::OtherOwner)),
        ..ControlView::default()
    };
    view.control = Some(control);
    assert_eq!(word(1, &view), 0b0011_0011 | bit::INHIBITED | bit::PENDING);
    assert_eq!(word(17, &view), alarm::NOT_EFFECTIVE | alarm::FAIL_SAFE);
    let (taken, words) = take(&unit(), &[3, 1, 0, 0, 6], &view, NOW);
    let refused = [Outcome::Refused.number(), 77, Reason::OtherOwner.number()];
    assert_eq!(
        (taken, words),
        (RequestAction::Words, [&[2, 4250, 0][..], &refused].concat())
    );
    let (_, words) = take(&unit(), &[3, 1, 0, 0, 6], &testing::view(), NOW);
    assert_eq!(words, [0, ABSENT, 0, 0, 0, 0]);
    let none = DriveView {
        control: None,
        ..testing::view()
    };
    assert_eq!(take(&unit(), &[3, 1, 0, 0, 6], &none, NOW).1, words);
}

#[test]
fn a_lease_is_shown_with_what_is_left_of_it_and_whose_it_is() {
    for (lease, left, class) in [
        (None, 0, 0),
        (Some((Owner::Mqtt, later(30_000))), 30, 1),
        (Some((OTHER, later(29_999))), 29, 2),
        (
            Some((
                Owner::Page(CommanderName::new("anna").unwrap()),
                later(10_000),
            )),
            10,
            5,
        ),
        (Some((CLIENT, later(1))), 0, 3),
        (Some((CLIENT, NOW)), 0, 0),
        (Some((CLIENT, MonoTime::NEVER)), 65_534, 3),
    ] {
        let mut view = testing::view();
        view.control = Some(ControlView {
            lease,
            ..ControlView::default()
        });
        assert_eq!(
            (word(18, &view), word(258, &view), word(19, &view)),
            (left, left, class),
            "{lease:?}"
        );
        assert_eq!(word(1, &view) & bit::LEASED != 0, class != 0);
    }
}

#[test]
fn capabilities_are_what_model_and_control_allow() {
    let with = |change: &dyn Fn(&mut crate::domain::control::ControlSettings)| {
        let mut description = testing::description();
        let mut settings = testing::settings();
        change(&mut settings);
        description.control = Some(Arc::new(settings));
        picture(&UniformUnit::new(&description), &testing::view(), NOW)[26]
    };
    let forward = capability::FORWARD;
    let reverse = capability::REVERSE;
    let setpoint = capability::SETPOINT;
    assert_eq!(
        with(&|_| {}),
        forward | reverse | setpoint,
        "coast and reset are not proven"
    );
    assert_eq!(
        with(&|it| it.directions = vec![Direction::Forward]),
        forward | setpoint
    );
    let accepted = vec![ControlAction::Coast, ControlAction::Reset];
    assert_eq!(
        with(&|it| it.accept_unverified.clone_from(&accepted)),
        0b1_1111
    );
    assert_eq!(with(&|it| it.allow_take = true), 0b101_0011);
}

#[test]
fn limits_are_rounded_into_themselves() {
    let mut description = testing::description();
    let mut settings = testing::settings();
    settings.least = Hertz::from_millihertz(5_001);
    settings.most = Hertz::from_millihertz(50_009);
    description.control = Some(Arc::new(settings));
    let words = picture(&UniformUnit::new(&description), &testing::view(), NOW);
    assert_eq!((words[20], words[21]), (501, 5000));
}

#[test]
fn there_is_nothing_outside_of_the_map_and_no_partial_answer() {
    let unit = unit();
    let view = testing::view();
    for (pdu, right) in [
        (&[3, 0, 39, 0, 1][..], RequestAction::Words),
        (&[3, 1, 5, 0, 1], RequestAction::Words),
        (&[3, 0, 39, 0, 2], RequestAction::Exception(2)),
        (&[4, 0, 40, 0, 1], RequestAction::Exception(2)),
        (&[4, 1, 0, 0, 1], RequestAction::Exception(2)),
        (&[3, 0, 40, 0, 1], RequestAction::Exception(2)),
        (&[3, 0, 255, 0, 2], RequestAction::Exception(2)),
        (&[3, 1, 5, 0, 2], RequestAction::Exception(2)),
        (&[3, 0xFF, 0xFF, 0, 1], RequestAction::Exception(2)),
        (
            &[2, 0, 0, 0, 16],
            RequestAction::Bits {
                bits: 0b0011_0011,
                count: 16,
            },
        ),
        (
            &[2, 0, 4, 0, 2],
            RequestAction::Bits {
                bits: 0b0011,
                count: 2,
            },
        ),
        (&[2, 0, 15, 0, 2], RequestAction::Exception(2)),
        (&[2, 0xFF, 0xFF, 0, 1], RequestAction::Exception(2)),
        (&[1, 0, 0, 0, 4], RequestAction::Bits { bits: 0, count: 4 }),
        (&[1, 0, 0, 0, 5], RequestAction::Exception(2)),
        (&[0x2B, 0x0E, 1, 0], RequestAction::Exception(1)),
    ] {
        assert_eq!(take(&unit, pdu, &view, NOW).0, right, "{pdu:?}");
    }
}

#[test]
fn coils_read_back_the_direction_that_is_ordered() {
    for (intent, bits) in [
        (RunIntent::Stop, 0),
        (RunIntent::Run(Direction::Forward), 1),
        (RunIntent::Run(Direction::Reverse), 2),
        (RunIntent::Coast, 0),
    ] {
        let mut view = testing::view();
        view.control = Some(ControlView {
            intent,
            ..ControlView::default()
        });
        assert_eq!(
            take(&unit(), &[1, 0, 0, 0, 4], &view, NOW).0,
            RequestAction::Bits { bits, count: 4 }
        );
    }
}

const WRITES: [&[u8]; 6] = [
    &[5, 0, 0, 0, 0],
    &[6, 1, 0, 0, 0],
    &[0x0F, 0, 0, 0, 2, 1, 0],
    &[0x10, 1, 0, 0, 1, 2, 0, 0],
    &[0x16, 1, 0, 0, 0, 0, 0],
    &[0x17, 1, 0, 0, 6, 1, 0, 0, 1, 2, 0, 0],
];

#[test]
fn a_write_is_an_order_where_there_is_control_and_never_allowed_elsewhere() {
    let without = crate::drive::description::DriveDescription {
        control: None,
        ..testing::description()
    };
    let with = unit();
    let without = UniformUnit::new(&without);
    for pdu in WRITES {
        let stop = RequestAction::Order(Order::Stop { setpoint: None });
        assert_eq!(take(&with, pdu, &testing::view(), NOW).0, stop, "{pdu:?}");
        assert_eq!(
            take(&without, pdu, &testing::view(), NOW).0,
            RequestAction::Refused(Reason::ReadOnly),
            "{pdu:?}"
        );
        let ask = parse(pdu).unwrap();
        assert!(with.is_stop(&ask, &testing::view()) && !without.is_stop(&ask, &testing::view()));
    }
    assert!(!with.is_stop(&parse(&[6, 1, 0, 0, 1]).unwrap(), &testing::view()));
    assert!(
        with.is_stop(&parse(&[6, 1, 0, 0, 3]).unwrap(), &testing::view()),
        "so does coasting"
    );
    assert!(!with.is_stop(&parse(&[3, 1, 0, 0, 1]).unwrap(), &testing::view()));
}

#[test]
fn a_write_that_cannot_also_read_orders_nothing() {
    let pdu = [0x17, 0, 40, 0, 1, 1, 0, 0, 1, 2, 0, 1];
    assert_eq!(
        take(&unit(), &pdu, &testing::view(), NOW).0,
        RequestAction::Refused(Reason::NotListed)
    );
}

#[test]
fn a_write_that_orders_nothing_is_done_at_once() {
    assert_eq!(
        take(&unit(), &[5, 0, 3, 0, 0], &testing::view(), NOW).0,
        RequestAction::Nothing
    );
}

#[test]
fn what_the_drive_has_used_stands_in_two_words_each() {
    let (unit, present) = (
        unit(),
        RequestContext {
            now: NOW,
            uptime_s: 0,
            owner: Owner::Mqtt,
            standby: None,
        },
    );
    let words = |view: &DriveView| {
        (32..40)
            .map(|address| unit.word(address, view, &present).unwrap())
            .collect::<Vec<_>>()
    };
    assert_eq!(words(&testing::view()), [1, 0x1170, 0, 15, 1, 0x1170, 0, 2]);
    assert_eq!(words(&DriveView::default()), [ABSENT; 8], "not known");
    let mut most = testing::view();
    most.usage.totals.energy_mj = u64::MAX;
    assert_eq!(
        words(&most)[..2],
        [0xFFFF, 0xFFFE],
        "it does not wrap, and is not absent"
    );
}
