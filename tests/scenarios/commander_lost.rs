//! A client that stops responding loses control, and the declared action runs.

use crate::support::{MQTT, Rig, RigOptions, STOP, control, plc, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Origin, Outcome, Owner, Reason, RunIntent};
use vfd_gateway::domain::control::FailSafe;
use vfd_gateway::domain::ids::{DriveIndex, Station};
use vfd_gateway::domain::link::PortKind;
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::gateway::{DriveNote, LineInput};

const RUN: u16 = 0x0002;
/// The longest exchange with the silence before the next one here, time-outs aside.
const BOUND: Duration = Duration::from_millis(30);

fn running(action: FailSafe, on_shutdown: FailSafe) -> Rig {
    let settings = vfd_gateway::domain::control::ControlSettings {
        on_commander_lost: action,
        on_shutdown,
        ..control()
    };
    let mut rig = Rig::new(&RigOptions {
        control: Some(settings),
        ..RigOptions::controlled()
    });
    assert_eq!(
        rig.commanded(MQTT, run(Direction::Forward, Some(3000))).0,
        Outcome::Acknowledged
    );
    rig
}

#[test]
fn the_declared_action_starts_when_the_lease_ends() {
    for (action, value) in [
        (FailSafe::Stop, Some(0)),
        (FailSafe::Coast, Some(3)),
        (FailSafe::Hold, None),
    ] {
        let mut rig = running(action, FailSafe::Hold);
        let (_, until) = rig.view(0).control.unwrap().lease.unwrap();
        rig.run_until(until + BOUND, |_, _| {});
        let frames: Vec<_> = rig
            .sent
            .iter()
            .filter(|sent| sent.frame[1] == 6 && sent.frame[3] == 2)
            .collect();
        assert_eq!(
            rig.written(RUN),
            [Some(1), value].into_iter().flatten().collect::<Vec<_>>()
        );
        if value.is_some() {
            let at = frames.last().unwrap().at;
            assert!(
                at >= until && at.since(until) <= BOUND,
                "{action:?}: {:?}",
                at.since(until)
            );
        }
        let lost = DriveNote::CommanderLost {
            owner: Owner::Mqtt,
            action,
        };
        assert!(
            rig.notes.iter().any(|(_, note)| *note == lost),
            "{:?}",
            rig.notes
        );
        let control = rig.view(0).control.unwrap();
        assert_eq!(
            (
                control.lease,
                control.start_inhibited,
                control.failsafe.is_some()
            ),
            (None, true, true)
        );
        rig.pass(Duration::from_secs(60));
        assert_eq!(
            rig.output(1),
            if action == FailSafe::Hold { 3000 } else { 0 }
        );
    }
}

#[test]
fn heartbeats_keep_the_lease_and_only_those_of_the_owner() {
    let mut rig = running(FailSafe::Stop, FailSafe::Stop);
    for _ in 0..10 {
        rig.pass(Duration::from_secs(1));
        rig.core.handle(rig.now, LineInput::PathAlive(Owner::Mqtt));
    }
    assert_eq!(rig.written(RUN), [1]);
    for _ in 0..5 {
        rig.pass(Duration::from_secs(1));
        rig.core.handle(rig.now, LineInput::PathAlive(plc(1).owner));
        rig.command(plc(1), 0, Order::Renew);
        rig.read(3, 0, 0x0101, 1);
    }
    assert_eq!(rig.written(RUN), [1, 0]);
}

#[test]
fn a_sparkplug_host_keeps_control_by_its_own_heartbeats_alone() {
    const HOST: Origin = Origin {
        owner: Owner::Sparkplug,
        ..MQTT
    };
    let mut rig = Rig::new(&RigOptions::controlled());
    assert_eq!(
        rig.commanded(HOST, run(Direction::Forward, Some(3000))).0,
        Outcome::Acknowledged
    );
    for _ in 0..10 {
        rig.pass(Duration::from_secs(1));
        rig.core
            .handle(rig.now, LineInput::PathAlive(Owner::Sparkplug));
    }
    assert_eq!(rig.written(RUN), [1]);
    assert_eq!(
        rig.commanded(MQTT, setpoint(1000)),
        (Outcome::Refused, Reason::OtherOwner)
    );
    // The host is gone, while the path of the gateway's own topics is open.
    rig.live(Duration::from_secs(5));
    assert_eq!(rig.written(RUN), [1, 0]);
    let action = FailSafe::Stop;
    assert!(rig.notes.iter().any(|(_, note)| *note
        == DriveNote::CommanderLost {
            owner: Owner::Sparkplug,
            action
        }));
    let read_only = vfd_gateway::domain::control::ControlSettings {
        from_sparkplug: false,
        ..control()
    };
    let mut rig = Rig::new(&RigOptions {
        control: Some(read_only),
        ..RigOptions::controlled()
    });
    assert_eq!(
        rig.commanded(HOST, STOP),
        (Outcome::Refused, Reason::NotFromHere)
    );
}

#[test]
fn a_drive_that_was_lost_starts_only_on_a_fresh_order() {
    let mut rig = Rig::new(&RigOptions::controlled());
    rig.commanded(plc(1), STOP);
    rig.commanded(plc(1), run(Direction::Forward, Some(3000)));
    rig.pass(Duration::from_secs(60));
    // The controller returns and continues writing what it wrote before.
    for _ in 0..3 {
        assert_eq!(
            rig.commanded(plc(1), run(Direction::Forward, Some(3000))),
            (Outcome::Refused, Reason::StartInhibited)
        );
    }
    // The drive is at rest, so nothing is sent; the controller has shown that it knows.
    assert_eq!(
        rig.commanded(plc(1), STOP),
        (Outcome::Acknowledged, Reason::Unchanged)
    );
    assert_eq!(
        rig.commanded(plc(1), run(Direction::Forward, Some(3000))).0,
        Outcome::Acknowledged
    );
}

#[test]
fn who_has_stopped_the_drive_has_nothing_to_lose() {
    let mut rig = running(FailSafe::Coast, FailSafe::Stop);
    rig.pass(Duration::from_secs(1));
    rig.commanded(MQTT, STOP);
    rig.core.handle(rig.now, LineInput::PathAlive(Owner::Mqtt));
    rig.pass(Duration::from_secs(60));
    // The ramp may take longer than the lease: then the declared action runs, and nothing after it.
    assert!(
        !rig.notes
            .iter()
            .any(|(_, note)| matches!(note, DriveNote::NotEffective)),
        "{:?}",
        rig.notes
    );
    assert_eq!(
        (rig.output(1), rig.view(0).control.unwrap().lease),
        (0, None)
    );
    assert_eq!(
        rig.commanded(plc(1), setpoint(1000)).0,
        Outcome::Confirmed,
        "control is free"
    );
}

#[test]
fn a_ramp_that_outlasts_the_lease_is_left_to_its_end() {
    let mut rig = running(FailSafe::Coast, FailSafe::Stop);
    rig.live(Duration::from_secs(8));
    assert_eq!(rig.commanded(MQTT, STOP).0, Outcome::Confirmed);
    rig.pass(Duration::from_millis(3500));
    assert!(rig.output(1) > 0, "it still ramps down");
    rig.pass(Duration::from_secs(30));
    assert_eq!(
        (rig.notes.len(), rig.written(RUN)),
        (0, vec![1, 0]),
        "{:?}",
        rig.notes
    );
}

#[test]
fn a_drive_that_coasted_to_standstill_is_free() {
    let mut rig = running(FailSafe::Stop, FailSafe::Stop);
    rig.pass(Duration::from_secs(1));
    assert_eq!(rig.commanded(MQTT, Order::Coast).0, Outcome::Confirmed);
    rig.pass(Duration::from_secs(30));
    assert_eq!(rig.notes, [], "nobody was lost");
    assert_eq!(
        (rig.written(RUN), rig.view(0).control.unwrap().lease),
        (vec![1, 3], None)
    );
}

#[test]
fn a_lease_ends_while_the_port_is_closed() {
    let mut rig = running(FailSafe::Stop, FailSafe::Stop);
    rig.core.handle(
        rig.now,
        LineInput::PortDown(vfd_gateway::domain::report::LineFault::Gone),
    );
    rig.pass(Duration::from_secs(10));
    assert!(
        rig.notes
            .iter()
            .any(|(_, note)| matches!(note, DriveNote::CommanderLost { .. })),
        "{:?}",
        rig.notes
    );
    assert!(rig.view(0).control.unwrap().stop_pending);
    rig.core
        .handle(rig.now, LineInput::PortUp(PortKind::Serial));
    rig.pass(Duration::from_secs(40));
    assert_eq!(
        (rig.output(1), rig.view(0).control.unwrap().stop_pending),
        (0, false)
    );
}

#[test]
fn what_waits_is_not_sent_for_a_commander_that_is_lost() {
    let mut rig = running(FailSafe::Hold, FailSafe::Hold);
    // The drive is silent, so that the setpoint has to wait until after the end of the lease.
    rig.bus.set_faults("lost=1000".parse().unwrap());
    rig.pass(Duration::from_millis(300));
    let ticket = rig.command_with(MQTT, 0, setpoint(4000), |command| {
        command.start_before = command.start_before + Duration::from_secs(60);
    });
    rig.pass(Duration::from_secs(10));
    rig.bus.set_faults(vfd_gateway::sim::FaultPlan::NONE);
    rig.pass(Duration::from_secs(60));
    assert!(
        matches!(
            rig.outcome_of(ticket).0,
            Outcome::Refused | Outcome::Unknown
        ),
        "{:?}",
        rig.told(ticket)
    );
    assert!(
        rig.written(0x0004)
            .iter()
            .filter(|value| **value == 4000)
            .count()
            <= 1
    );
}

#[test]
fn a_parameter_takes_no_control() {
    let mut rig = Rig::new(&RigOptions::controlled());
    let now = rig.now;
    let drive = rig.bus.drive_mut(Station(1)).unwrap();
    for pdu in [[6, 0, 4, 0x0B, 0xB8], [6, 0, 2, 0, 1]] {
        drive.obey(now, &pdu);
    }
    rig.pass(Duration::from_secs(2));
    let ramp = vfd_gateway::domain::command::RegisterWrite::new(0x020C_u16, 50);
    let go = vfd_gateway::domain::command::GoOrder::new(vec![ramp], None, None).unwrap();
    assert_eq!(rig.commanded(MQTT, Order::Go(go)).0, Outcome::Confirmed);
    assert_eq!(rig.view(0).control.unwrap().lease, None);
    rig.pass(Duration::from_secs(10));
    assert!(
        rig.written(RUN).is_empty(),
        "a drive that somebody else runs is left alone"
    );
}

#[test]
fn a_drive_out_of_sight_is_stopped_as_soon_as_it_is_back() {
    let mut rig = running(FailSafe::Stop, FailSafe::Stop);
    rig.bus.set_faults("lost=1000".parse().unwrap());
    rig.pass(Duration::from_secs(10));
    assert!(rig.view(0).control.unwrap().stop_pending);
    rig.bus.set_faults(vfd_gateway::sim::FaultPlan::NONE);
    rig.pass(Duration::from_secs(40));
    assert_eq!(
        (rig.output(1), rig.view(0).control.unwrap().stop_pending),
        (0, false)
    );
}

#[test]
fn the_end_of_the_gateway_is_an_action_of_its_own() {
    for (action, written) in [
        (FailSafe::Stop, vec![1, 0]),
        (FailSafe::Coast, vec![1, 3]),
        (FailSafe::Hold, vec![1]),
    ] {
        let mut rig = running(FailSafe::Stop, action);
        rig.pass(Duration::from_secs(1));
        rig.core.handle(rig.now, LineInput::Shutdown);
        rig.settle();
        assert_eq!(rig.core.is_at_rest(), action == FailSafe::Hold);
        assert_eq!(
            rig.commanded(MQTT, setpoint(1000)),
            (Outcome::Refused, Reason::ShuttingDown)
        );
        let limit = rig.now + Duration::from_secs(2);
        while !rig.core.is_at_rest() && rig.now < limit {
            rig.step(limit);
        }
        assert!(rig.core.is_at_rest());
        assert_eq!(rig.written(RUN), written);
    }
}

#[test]
fn the_end_of_the_gateway_tells_a_stop_that_was_never_sent_from_one_without_effect() {
    for (is_line_down, was_sent) in [(true, false), (false, true)] {
        let mut rig = running(FailSafe::Stop, FailSafe::Stop);
        if is_line_down {
            rig.close(LineFault::Gone);
        } else {
            rig.bus.set_faults("lost=1000".parse().unwrap());
        }
        rig.core.handle(rig.now, LineInput::Shutdown);
        rig.settle();
        rig.pass(Duration::from_secs(1));
        let open: Vec<_> = rig.core.open_stops().collect();
        assert_eq!(
            open,
            [(DriveIndex(0), was_sent)],
            "line down: {is_line_down}"
        );
    }
}

#[test]
fn the_gateway_never_invents_motion() {
    // A drive that another party runs is left alone, at start, after silence and after a lost port.
    let mut rig = Rig::new(&RigOptions::controlled());
    let now = rig.now;
    let drive = rig.bus.drive_mut(Station(1)).unwrap();
    for pdu in [[6, 0, 4, 0x0B, 0xB8], [6, 0, 2, 0, 1]] {
        drive.obey(now, &pdu);
    }
    rig.pass(Duration::from_secs(20));
    rig.core.handle(
        rig.now,
        LineInput::PortDown(vfd_gateway::domain::report::LineFault::Gone),
    );
    rig.pass(Duration::from_secs(5));
    rig.core
        .handle(rig.now, LineInput::PortUp(PortKind::Serial));
    rig.pass(Duration::from_secs(20));
    assert!(
        rig.sent.iter().all(|sent| sent.frame[1] != 6),
        "nothing was written"
    );
    assert_eq!(rig.output(1), 3000);
    assert_eq!(
        rig.view(0).run_state,
        vfd_gateway::drive::view::RunState::Running
    );
    assert_eq!(rig.view(0).control.unwrap().intent, RunIntent::Stop);
}
