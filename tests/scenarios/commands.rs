//! Commands: who may order what, what is sent to the line, and what is reported to the client.

use crate::support::{MQTT, Rig, RigOptions, STOP, control, plc, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{
    Direction, GoOrder, Order, Outcome, Owner, Reason, RegisterWrite, Rights, RunIntent,
};
use vfd_gateway::domain::command::{OrderManner, Origin};
use vfd_gateway::domain::link::PortKind;
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome, NativeRefusal};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::gateway::{DriveNote, LineInput};
use vfd_gateway::sim::FaultPlan;

use Direction::{Forward, Reverse};

const RUN: u16 = 0x0002;
const FREQUENCY: u16 = 0x0004;

fn rig() -> Rig {
    Rig::new(&RigOptions::controlled())
}

fn register(address: u16, value: u16) -> Order {
    Order::Go(GoOrder::new(vec![RegisterWrite::new(address, value)], None, None).unwrap())
}

#[test]
fn a_setpoint_and_a_run_order_move_the_motor_and_are_reported_step_by_step() {
    let mut rig = rig();
    let ticket = rig.command(MQTT, 0, setpoint(4250));
    assert_eq!(rig.outcome_of(ticket), (Outcome::Confirmed, Reason::None));
    let stages: Vec<_> = rig
        .told(ticket)
        .iter()
        .map(|(outcome, ..)| *outcome)
        .collect();
    assert_eq!(stages, [Outcome::Acknowledged, Outcome::Confirmed]);
    assert_eq!(
        rig.commanded(MQTT, run(Forward, None)),
        (Outcome::Acknowledged, Reason::None)
    );
    rig.live(Duration::from_secs(20));
    assert_eq!(rig.output(1), 4250);
    assert_eq!(
        (rig.written(FREQUENCY), rig.written(RUN)),
        (vec![4250], vec![1])
    );
}

#[test]
fn who_lives_keeps_control() {
    let mut rig = rig();
    rig.commanded(MQTT, run(Forward, Some(3000)));
    rig.live(Duration::from_secs(30));
    assert_eq!(
        (rig.output(1), rig.view(0).run_state),
        (3000, RunState::Forward)
    );
    assert_eq!(rig.written(RUN), [1]);
}

/// If a port is reopened without a report that it was lost, the exchange on the wire is still lost.
#[test]
fn a_port_that_opens_again_never_repeats_a_run_order() {
    let mut rig = rig();
    rig.commanded(MQTT, setpoint(3000));
    let ticket = rig.command(MQTT, 0, run(Forward, None));
    while rig.written(RUN).is_empty() {
        assert!(rig.step(MonoTime::NEVER), "RUN is not sent");
    }
    rig.core
        .handle(rig.now, LineInput::PortUp(PortKind::Serial));
    rig.settle();
    assert_eq!(rig.outcome_of(ticket), (Outcome::Unknown, Reason::NoReply));
    rig.pass(Duration::from_secs(2));
    assert_eq!(rig.written(RUN), [1]);
}

#[test]
fn what_is_refused_puts_nothing_on_the_line() {
    let none = Rights {
        write: false,
        stop: false,
    };
    let cases: &[(Origin, Order, Reason)] = &[
        (MQTT, setpoint(5001), Reason::OutsideLimits),
        (MQTT, setpoint(499), Reason::OutsideLimits),
        (MQTT, run(Forward, Some(6000)), Reason::OutsideLimits),
        (MQTT, run(Forward, None), Reason::SetpointUnknown),
        (MQTT, Order::Reset, Reason::NotTripped),
        (MQTT, register(0x0211, 3), Reason::NotListed),
        (plc(1), run(Forward, Some(3000)), Reason::StartInhibited),
        (
            Origin {
                rights: none,
                ..plc(1)
            },
            STOP,
            Reason::NotAllowed,
        ),
        (
            Origin {
                rights: none,
                ..plc(1)
            },
            Order::Renew,
            Reason::NotAllowed,
        ),
    ];
    for (origin, order, reason) in cases {
        let mut rig = rig();
        if *reason == Reason::NotTripped {
            // A drive that has just run its motor is known not to be tripped.
            rig.commanded(MQTT, run(Forward, Some(1000)));
            rig.pass(Duration::from_secs(1));
            rig.sent.clear();
        }
        let (outcome, why) = rig.commanded(*origin, order.clone());
        assert_eq!((outcome, why), (Outcome::Refused, *reason), "{order:?}");
        assert!(
            rig.sent.iter().all(|sent| sent.frame[1] != 6),
            "{order:?}: {:02X?}",
            rig.frames()
        );
    }
}

#[test]
fn without_a_control_section_everything_is_refused() {
    let mut rig = Rig::new(&RigOptions {
        control: None,
        ..RigOptions::controlled()
    });
    for order in [
        STOP,
        Order::Coast,
        Order::Reset,
        Order::Renew,
        setpoint(1000),
        run(Forward, Some(1000)),
    ] {
        assert_eq!(
            rig.commanded(MQTT, order),
            (Outcome::Refused, Reason::ReadOnly)
        );
    }
}

#[test]
fn a_side_and_a_direction_that_are_not_named_are_refused() {
    let mut settings = control();
    settings.from_mqtt = false;
    settings.directions = vec![Forward];
    let mut rig = Rig::new(&RigOptions {
        control: Some(settings),
        ..RigOptions::controlled()
    });
    assert_eq!(
        rig.commanded(MQTT, STOP),
        (Outcome::Refused, Reason::NotFromHere)
    );
    rig.commanded(plc(1), STOP);
    assert_eq!(
        rig.commanded(plc(1), run(Reverse, Some(1000))),
        (Outcome::Refused, Reason::DirectionNotAllowed)
    );
}

#[test]
fn a_controller_acts_by_change_and_its_repeats_stay_off_the_line() {
    let mut rig = rig();
    assert_eq!(
        rig.commanded(plc(1), STOP),
        (Outcome::Confirmed, Reason::None),
        "the first stop is sent"
    );
    for _ in 0..5 {
        assert_eq!(
            rig.commanded(plc(1), STOP),
            (Outcome::Acknowledged, Reason::Unchanged)
        );
    }
    assert_eq!(
        rig.commanded(plc(1), run(Forward, Some(2000))).0,
        Outcome::Acknowledged
    );
    for _ in 0..20 {
        rig.pass(Duration::from_millis(500));
        let again = rig.commanded(plc(1), run(Forward, Some(2000)));
        assert_eq!(
            again,
            (Outcome::Acknowledged, Reason::Unchanged),
            "a repeat renews the lease"
        );
    }
    assert_eq!(
        (rig.written(RUN), rig.written(FREQUENCY)),
        (vec![0, 1], vec![2000])
    );
    rig.commanded(plc(1), run(Forward, Some(2500)));
    assert_eq!(
        (rig.written(RUN), rig.written(FREQUENCY)),
        (vec![0, 1], vec![2000, 2500]),
        "only what changes"
    );
}

#[test]
fn a_setpoint_beside_a_stop_is_not_taken() {
    let mut rig = rig();
    let both = Order::Stop {
        setpoint: Some(vfd_gateway::domain::frequency::Hertz::from_centihertz(2000)),
    };
    assert_eq!(
        rig.commanded(plc(1), both.clone()),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(rig.view(0).control.unwrap().setpoint, None);
    assert_eq!(rig.commanded(plc(1), both).1, Reason::Unchanged);
    assert_eq!(rig.view(0).control.unwrap().setpoint, None);
    assert_eq!(
        (rig.written(RUN), rig.written(FREQUENCY)),
        (vec![0], vec![])
    );
}

#[test]
fn control_has_one_owner_and_a_stop_by_another_ends_it() {
    let mut rig = rig();
    rig.commanded(MQTT, run(Forward, Some(3000)));
    assert_eq!(
        rig.commanded(plc(1), setpoint(2000)),
        (Outcome::Refused, Reason::OtherOwner)
    );
    assert_eq!(
        rig.view(0).control.unwrap().lease.map(|(owner, _)| owner),
        Some(Owner::Mqtt)
    );
    assert_eq!(
        rig.commanded(plc(1), STOP),
        (Outcome::Confirmed, Reason::None)
    );
    let control = rig.view(0).control.unwrap();
    assert_eq!((control.lease, control.intent), (None, RunIntent::Stop));
    assert_eq!(
        rig.commanded(MQTT, run(Forward, None)),
        (Outcome::Refused, Reason::RestartDelay)
    );
    assert_eq!(
        rig.commanded(plc(2), run(Forward, Some(3000))),
        (Outcome::Refused, Reason::StartInhibited)
    );
    assert_eq!(
        rig.commanded(plc(1), run(Forward, Some(3000))).0,
        Outcome::Acknowledged,
        "who stopped may start"
    );
}

#[test]
fn a_refused_write_is_reported_with_the_value_that_the_drive_kept() {
    let mut rig = rig();
    // The drive takes its run commands from the panel.
    let now = rig.now;
    rig.bus
        .drive_mut(vfd_gateway::domain::ids::Station(1))
        .unwrap()
        .set_locally(now, 0x0212_u16.into(), 2);
    let ticket = rig.command(MQTT, 0, run(Forward, Some(3000)));
    assert_eq!(
        rig.outcome_of(ticket),
        (Outcome::Failed, Reason::KeptOldValue)
    );
    assert_eq!(
        rig.view(0).control.unwrap().intent,
        RunIntent::Stop,
        "what the drive refused is no intent"
    );
    assert_eq!(rig.reports.last().unwrap().1.report.held, Some(0));
}

#[test]
fn run_without_a_setpoint_tells_a_silent_drive_from_a_setting_outside_the_limits() {
    let mut rig = rig();
    let ticket = rig.command(MQTT, 0, run(Forward, None));
    assert_eq!(
        rig.outcome_of(ticket),
        (Outcome::Refused, Reason::SetpointUnknown)
    );
    assert_eq!(
        rig.notes.iter().map(|(_, note)| *note).collect::<Vec<_>>(),
        [DriveNote::SetpointOutside]
    );
    for faults in ["flip=1000", "lost=1000"] {
        rig.notes.clear();
        rig.bus.set_faults(faults.parse().unwrap());
        let ticket = rig.command(MQTT, 0, run(Forward, None));
        let (outcome, reason) = rig.outcome_of(ticket);
        assert!(
            matches!(reason, Reason::NoReply | Reason::Offline | Reason::TooLate),
            "{faults}: {reason:?}"
        );
        assert!(matches!(outcome, Outcome::Refused | Outcome::Expired));
        assert!(rig.notes.is_empty() && rig.written(RUN).is_empty());
    }
}

#[test]
fn a_lost_reply_is_reported_as_unknown_and_settled_by_reading() {
    for (order, last) in [
        (setpoint(2000), (Outcome::Confirmed, Reason::None)),
        (run(Forward, None), (Outcome::Unknown, Reason::NoReply)),
    ] {
        let mut rig = rig();
        rig.commanded(MQTT, setpoint(3000));
        rig.loses_reply_to = Some(6);
        let ticket = rig.command(MQTT, 0, order.clone());
        assert_eq!(rig.outcome_of(ticket), last, "{order:?}");
        assert_eq!(
            rig.written(RUN).len() + rig.written(FREQUENCY).len(),
            2,
            "no write is repeated"
        );
    }
}

/// The drive accepted 30 Hz, but its answer was lost. An order that is never sent does not make the earlier setpoint
/// count as in force again.
#[test]
fn after_a_lost_reply_the_setpoint_before_it_is_no_longer_in_force() {
    for is_read in [true, false] {
        let mut rig = rig();
        assert_eq!(rig.commanded(plc(1), setpoint(4000)).0, Outcome::Confirmed);
        if is_read {
            rig.loses_reply_to = Some(6);
        } else {
            rig.bus.set_faults("lost=1000".parse().unwrap());
        }
        let lost = rig.command(plc(1), 0, setpoint(3000));
        rig.pass(Duration::from_secs(2));
        rig.bus.set_faults(FaultPlan::NONE);
        rig.pass(Duration::from_secs(3));
        assert_eq!(
            rig.outcome_of(lost).0,
            if is_read {
                Outcome::Confirmed
            } else {
                Outcome::Unknown
            }
        );
        let never_sent = if is_read { 3000 } else { 3500 };
        rig.command_unsettled(plc(1), 0, setpoint(never_sent));
        rig.reopen();
        rig.pass(Duration::from_secs(3));
        assert_eq!(rig.commanded(plc(1), setpoint(4000)).0, Outcome::Confirmed);
        assert_eq!(rig.written(0x0004), [4000, 3000, 4000], "{is_read}");
    }
}

#[test]
fn a_command_past_its_deadline_never_reaches_the_wire() {
    let mut rig = rig();
    rig.commanded(MQTT, setpoint(3000));
    rig.sent.clear();
    rig.bus.set_faults("lost=1000".parse().unwrap());
    rig.pass(Duration::from_millis(250));
    let ticket = rig.command(MQTT, 0, setpoint(2000));
    // Every reply is lost, so the wire is busy and the station in doubt until the drive counts as offline.
    let (outcome, _) = rig.outcome_of(ticket);
    assert!(
        matches!(
            outcome,
            Outcome::Expired | Outcome::Unknown | Outcome::Refused
        ),
        "{outcome:?}"
    );
    let sent_at = rig
        .sent
        .iter()
        .find(|sent| sent.frame[1] == 6)
        .map(|sent| sent.at);
    let commanded_at = rig.reports.last().map(|(at, _)| *at).unwrap();
    assert!(
        sent_at.is_none_or(|at| at < commanded_at),
        "{:02X?}",
        rig.frames()
    );
}

#[test]
fn the_newest_setpoint_wins_and_the_line_stays_usable() {
    let mut rig = rig();
    let tickets: Vec<_> = (1000..1200)
        .map(|centihertz| rig.command(MQTT, 0, setpoint(centihertz)))
        .collect();
    let last = *tickets.last().unwrap();
    assert_eq!(rig.outcome_of(last).0, Outcome::Confirmed);
    let superseded = tickets
        .iter()
        .filter(|ticket| rig.told(**ticket).last().unwrap().1 == Reason::Newer)
        .count();
    assert!(superseded >= 197, "{superseded}");
    assert_eq!(rig.written(FREQUENCY).last(), Some(&1199));
    assert!(
        tickets
            .iter()
            .all(|ticket| rig.told(*ticket).iter().filter(|(.., last)| *last).count() == 1)
    );
}

#[test]
fn setpoints_leave_every_second_exchange_to_others() {
    let mut rig = rig();
    rig.read(7, 0, 0x0101, 1);
    for n in 0..40 {
        rig.command(MQTT, 0, setpoint(1000 + n));
        rig.read(7 + u64::from(n), 0, 0x0101 + (n % 2), 1);
        rig.step(rig.now + Duration::from_millis(50));
    }
    let starts: Vec<bool> = rig.sent.iter().map(|sent| sent.frame[1] == 6).collect();
    assert!(
        starts.windows(2).all(|pair| !(pair[0] && pair[1])),
        "two setpoints in a row"
    );
}

#[test]
fn a_running_motor_is_not_reversed_in_silence() {
    let mut rig = rig();
    rig.commanded(MQTT, run(Forward, Some(3000)));
    rig.pass(Duration::from_secs(1));
    assert_eq!(
        rig.commanded(MQTT, run(Reverse, None)),
        (Outcome::Refused, Reason::Reversal)
    );
    rig.commanded(MQTT, STOP);
    rig.pass(Duration::from_secs(40));
    assert_eq!(
        rig.commanded(MQTT, run(Reverse, None)).0,
        Outcome::Acknowledged
    );
    rig.pass(Duration::from_secs(2));
    assert!(rig.output(1) < 0);
}

#[test]
fn native_writes_are_reviewed_like_every_other_command() {
    let write = |rig: &mut Rig, address, values: &[u16]| {
        let ticket = rig.ask(
            1,
            0,
            NativeAsk::Write {
                address,
                values: values.to_vec(),
            },
        );
        rig.answer_to(ticket)
    };
    let refused = |reason| NativeOutcome::Refused(NativeRefusal::Guard(reason));
    let mut rig = rig();
    for (address, values, reason) in [
        (RUN, &[1][..], Reason::StartInhibited),
        (RUN, &[7], Reason::NotUnderstood),
        (FREQUENCY, &[6000], Reason::OutsideLimits),
        (0x0201, &[3000], Reason::NotListed),
        (0x0211, &[3], Reason::NotAllowed),
        (0x0203, &[1], Reason::NotListed),
    ] {
        assert_eq!(
            write(&mut rig, address.into(), values),
            refused(reason),
            "{address:04X}"
        );
    }
    assert!(rig.sent.iter().all(|sent| sent.frame[1] != 6));
    assert_eq!(write(&mut rig, RUN.into(), &[0]), NativeOutcome::Written);
    rig.pass(Duration::from_millis(200));
    assert_eq!(
        write(&mut rig, FREQUENCY.into(), &[3000]),
        NativeOutcome::Written
    );
    rig.pass(Duration::from_secs(1));
    assert_eq!(write(&mut rig, RUN.into(), &[1]), NativeOutcome::Written);
    assert_eq!(
        write(&mut rig, 0x020C_u16.into(), &[50]),
        NativeOutcome::Written,
        "F007 is listed"
    );
    rig.pass(Duration::from_secs(1));
    assert!(rig.output(1) > 0);
}

#[test]
fn an_epoch_or_a_moment_of_issue_lets_a_message_start_at_once() {
    let mut rig = rig();
    rig.commanded(MQTT, setpoint(2000));
    rig.commanded(MQTT, STOP);
    let epoch = rig.view(0).control.unwrap().epoch;
    for (named, reason) in [
        (Some(epoch - 1), Reason::StaleEpoch),
        (None, Reason::RestartDelay),
        (Some(epoch), Reason::None),
    ] {
        let ticket = rig.command_with(MQTT, 0, run(Forward, None), |command| command.epoch = named);
        assert_eq!(rig.outcome_of(ticket).1, reason, "{named:?}");
    }
}

/// What cancels an order to run without being a stop also cancels a RUN that waited before the gateway.
#[test]
fn a_run_that_was_sent_before_the_drive_was_away_does_not_start_it_when_it_is_back() {
    let mut rig = rig();
    rig.commanded(MQTT, setpoint(2000));
    let epoch = rig.view(0).control.unwrap().epoch;
    rig.reopen();
    rig.pass(Duration::from_secs(1));
    let tell = |rig: &mut Rig, named| {
        let ticket = rig.command_with(MQTT, 0, run(Forward, None), |command| command.epoch = named);
        rig.outcome_of(ticket).1
    };
    assert_eq!(tell(&mut rig, None), Reason::RestartDelay);
    assert_eq!(tell(&mut rig, Some(epoch)), Reason::StaleEpoch);
    let epoch = rig.view(0).control.unwrap().epoch;
    assert_eq!(tell(&mut rig, Some(epoch)), Reason::None);
}

#[test]
fn the_last_outcome_is_that_of_the_newest_command() {
    let mut rig = rig();
    rig.commanded(MQTT, run(Forward, Some(3000)));
    rig.live(Duration::from_secs(2));
    let stop = rig.command(plc(1), 0, STOP);
    let refused = rig.command(plc(1), 0, setpoint(2000));
    assert_eq!(rig.outcome_of(stop).0, Outcome::Confirmed);
    assert_eq!(
        rig.outcome_of(refused),
        (Outcome::Refused, Reason::StopPending)
    );
    assert_eq!(
        rig.view(0)
            .control
            .unwrap()
            .last
            .map(|report| report.reason),
        Some(Reason::StopPending)
    );
}

#[test]
fn messages_act_once_each_and_not_by_change() {
    let mut rig = rig();
    for _ in 0..3 {
        assert_eq!(rig.commanded(MQTT, setpoint(2000)).0, Outcome::Confirmed);
    }
    assert_eq!(rig.written(FREQUENCY), [2000, 2000, 2000]);
    assert_eq!(MQTT.manner, OrderManner::Once);
}
