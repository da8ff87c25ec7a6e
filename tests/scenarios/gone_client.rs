//! When a client leaves, its requests and orders that have not begun are dropped; an accepted STOP stays.

use crate::support::{MQTT, PROOF, Rig, RigOptions, STOP, control, plc, run, setpoint};
use std::time::Duration;
use vfd_gateway::domain::command::Direction::{Forward, Reverse};
use vfd_gateway::domain::command::{Order, Origin, Outcome, Reason, RunIntent};
use vfd_gateway::domain::frequency::Hertz;
use vfd_gateway::domain::ids::{AskerId, Station, Ticket};
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome, NativeRefusal};
use vfd_gateway::gateway::LineInput;

const RUN: u16 = 0x0002;
const FREQUENCY: u16 = 0x0004;
const GONE: u64 = 7;
const WITHDRAWN: [(Outcome, Reason, bool); 1] = [(Outcome::Refused, Reason::CommanderLost, true)];

/// A drive that the controller may start, and a wire that is busy with a long read of another client.
fn busy_line() -> Rig {
    let mut rig = Rig::new(&RigOptions {
        poll: Duration::from_secs(3600),
        ..RigOptions::controlled()
    });
    rig.commanded(plc(1), STOP);
    busy(&mut rig);
    rig
}

fn busy(rig: &mut Rig) {
    rig.read(1, 0, PROOF, 8);
    while rig
        .sent
        .last()
        .is_none_or(|sent| sent.pdu != [3, 0x30, 0, 0, 8])
    {
        rig.pass(Duration::from_millis(1));
    }
    rig.sent.clear();
}

fn order(rig: &mut Rig, asker: u64, origin: Origin, order: Order) -> Ticket {
    rig.command_with(origin, 0, order, |command| command.asker = AskerId(asker))
}

fn leaves(rig: &mut Rig) {
    rig.core
        .handle(rig.now, LineInput::AskerGone(AskerId(GONE)));
    rig.settle();
}

#[test]
fn a_client_that_is_gone_takes_its_run_and_setpoint_along() {
    for what in [run(Forward, Some(3000)), run(Forward, None), setpoint(3000)] {
        let mut rig = busy_line();
        let ticket = order(&mut rig, GONE, plc(1), what.clone());
        leaves(&mut rig);
        assert_eq!(rig.told(ticket), WITHDRAWN, "{what:?}");
        rig.pass(Duration::from_secs(2));
        assert_eq!(rig.writes(), Vec::<Vec<u8>>::new(), "{what:?}");
        let control = rig.view(0).control.unwrap();
        assert_eq!(
            (control.intent, control.setpoint),
            (RunIntent::Stop, None),
            "{what:?}"
        );
        assert_eq!(
            (control.command_pending, rig.core.counters().withdrawn),
            (false, 1)
        );
        assert_eq!(
            control.last.map(|report| report.reason),
            Some(Reason::CommanderLost)
        );
    }
}

#[test]
fn control_is_free_again_once_the_drive_is_seen_at_standstill() {
    let mut rig = Rig::new(&RigOptions::controlled());
    rig.commanded(plc(1), STOP);
    rig.pass(Duration::from_secs(1));
    busy(&mut rig);
    order(&mut rig, GONE, plc(1), run(Forward, Some(3000)));
    assert!(rig.view(0).control.unwrap().lease.is_some());
    leaves(&mut rig);
    rig.pass(Duration::from_millis(300));
    assert_eq!(rig.view(0).control.unwrap().lease, None);
    rig.pass(Duration::from_secs(5));
    assert_eq!(
        rig.writes(),
        Vec::<Vec<u8>>::new(),
        "nobody who held a drive was lost"
    );
    assert_eq!(
        rig.commanded(MQTT, run(Forward, Some(2000))).0,
        Outcome::Acknowledged
    );
}

#[test]
fn an_accepted_stop_stays() {
    for what in [STOP, Order::Coast] {
        let mut rig = Rig::new(&RigOptions::controlled());
        rig.commanded(MQTT, run(Forward, Some(3000)));
        rig.pass(Duration::from_secs(2));
        busy(&mut rig);
        order(&mut rig, GONE, plc(1), what.clone());
        leaves(&mut rig);
        rig.pass(Duration::from_secs(2));
        assert_eq!(
            rig.written(RUN),
            [if what == STOP { 0 } else { 3 }],
            "{what:?}"
        );
        assert!(rig.output(1) < 3000, "{what:?}: {}", rig.output(1));
        assert_eq!(rig.core.counters().withdrawn, 0);
    }
}

#[test]
fn a_list_whose_first_write_is_on_the_wire_is_carried_on() {
    let mut rig = Rig::new(&RigOptions::controlled());
    rig.commanded(plc(1), STOP);
    rig.pass(Duration::from_secs(1));
    rig.sent.clear();
    let ticket = order(&mut rig, GONE, plc(1), run(Forward, Some(3000)));
    while rig.written(FREQUENCY).is_empty() {
        rig.pass(Duration::from_millis(1));
    }
    assert!(rig.written(RUN).is_empty(), "RUN is still to come");
    leaves(&mut rig);
    assert_eq!(rig.outcome_of(ticket).0, Outcome::Acknowledged);
    assert_eq!(
        (rig.written(RUN), rig.core.counters().withdrawn),
        (vec![1], 0)
    );
}

#[test]
fn a_look_before_the_first_write_is_no_beginning() {
    let mut rig = Rig::new(&RigOptions {
        poll: Duration::from_secs(3600),
        ..RigOptions::controlled()
    });
    rig.commanded(plc(1), STOP);
    rig.commanded(plc(1), setpoint(2000));
    rig.pass(Duration::from_millis(100));
    rig.sent.clear();
    let ticket = order(&mut rig, GONE, plc(1), run(Forward, None));
    rig.pass(Duration::from_millis(5));
    assert_eq!(rig.sent.len(), 1, "the setpoint is being looked at");
    leaves(&mut rig);
    rig.pass(Duration::from_secs(2));
    assert_eq!(
        (rig.told(ticket), rig.written(RUN)),
        (WITHDRAWN.to_vec(), Vec::new())
    );
    assert_eq!(rig.view(0).control.unwrap().intent, RunIntent::Stop);
}

#[test]
fn what_was_in_force_before_is_in_force_again() {
    let mut rig = Rig::new(&RigOptions::controlled());
    rig.commanded(plc(1), STOP);
    assert_eq!(
        rig.commanded(plc(1), run(Forward, Some(2000))).0,
        Outcome::Acknowledged
    );
    rig.pass(Duration::from_secs(2));
    busy(&mut rig);
    order(&mut rig, GONE, plc(1), setpoint(4000));
    // Another connection of the same controller.
    order(&mut rig, 8, plc(1), setpoint(2500));
    order(&mut rig, GONE, plc(1), setpoint(4500));
    leaves(&mut rig);
    rig.pass(Duration::from_millis(500));
    assert!(
        rig.written(FREQUENCY).is_empty(),
        "the one in between was overtaken by the last"
    );
    let control = rig.view(0).control.unwrap();
    assert_eq!(
        (control.intent, control.setpoint),
        (RunIntent::Run(Forward), Some(Hertz::from_centihertz(2000)))
    );
    assert_eq!(
        rig.commanded(plc(1), run(Forward, Some(2000))).1,
        Reason::Unchanged,
        "it is in force"
    );
}

/// A motor that runs forward and may be reversed as it is, on a line that is busy.
fn busy_and_running() -> Rig {
    let mut settings = control();
    settings.reverse_below = Hertz::from_centihertz(5000);
    let mut rig = Rig::new(&RigOptions {
        control: Some(settings),
        ..RigOptions::controlled()
    });
    rig.commanded(plc(1), STOP);
    assert_eq!(
        rig.commanded(plc(1), run(Forward, Some(2000))).0,
        Outcome::Acknowledged
    );
    rig.pass(Duration::from_secs(2));
    busy(&mut rig);
    rig
}

#[test]
fn a_stop_after_a_reversal_that_was_never_sent_goes_out() {
    let mut rig = busy_and_running();
    let ticket = order(&mut rig, GONE, plc(1), run(Reverse, None));
    leaves(&mut rig);
    assert_eq!(rig.told(ticket), WITHDRAWN);
    assert_eq!(rig.view(0).control.unwrap().intent, RunIntent::Run(Forward));
    assert_eq!(
        rig.commanded(plc(1), STOP),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(rig.written(RUN), [0]);
    assert!(rig.output(1) < 2000);
}

#[test]
fn the_same_holds_for_a_reversal_whose_time_has_passed() {
    let mut rig = busy_and_running();
    let now = rig.now;
    let late = rig.command_with(plc(1), 0, run(Reverse, None), |command| {
        command.start_before = now + Duration::from_millis(1);
    });
    assert_eq!(rig.outcome_of(late), (Outcome::Expired, Reason::TooLate));
    assert_eq!(rig.view(0).control.unwrap().intent, RunIntent::Run(Forward));
    assert_eq!(
        rig.commanded(plc(1), STOP),
        (Outcome::Confirmed, Reason::None)
    );
    assert_eq!(
        rig.written(RUN),
        [0],
        "the STOP is sent, because the motor turns by our order"
    );
}

#[test]
fn writes_to_the_drives_own_registers_are_withdrawn_too() {
    let mut rig = busy_line();
    let ramp = rig.ask(
        GONE,
        0,
        NativeAsk::Write {
            address: 0x020C_u16.into(),
            values: vec![30],
        },
    );
    leaves(&mut rig);
    assert_eq!(
        rig.answer_to(ramp),
        NativeOutcome::Refused(NativeRefusal::Guard(Reason::CommanderLost))
    );
    rig.pass(Duration::from_secs(1));
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    let mut rig = busy_and_running();
    rig.ask(
        GONE,
        0,
        NativeAsk::Write {
            address: RUN.into(),
            values: vec![0],
        },
    );
    leaves(&mut rig);
    rig.pass(Duration::from_secs(1));
    assert_eq!(rig.written(RUN), [0], "but not a stop");
}

#[test]
fn a_reset_is_withdrawn_and_one_that_has_begun_is_not() {
    for begins in [false, true] {
        let mut rig = Rig::new(&RigOptions::controlled());
        rig.commanded(MQTT, run(Forward, Some(2000)));
        rig.pass(Duration::from_secs(1));
        let now = rig.now;
        rig.bus.drive_mut(Station(1)).unwrap().trip(now, 1);
        rig.pass(Duration::from_secs(4));
        busy(&mut rig);
        let ticket = order(&mut rig, GONE, MQTT, Order::Reset);
        if begins {
            while rig.written(RUN).is_empty() {
                rig.pass(Duration::from_millis(1));
            }
        }
        leaves(&mut rig);
        rig.pass(Duration::from_secs(3));
        assert_eq!(
            rig.written(RUN),
            if begins { vec![0, 4, 0] } else { Vec::new() }
        );
        assert_eq!(
            rig.told(ticket) == WITHDRAWN,
            !begins,
            "{:?}",
            rig.told(ticket)
        );
    }
}

#[test]
fn what_others_have_ordered_goes_on() {
    let mut rig = busy_line();
    let ours = order(&mut rig, 8, plc(1), run(Forward, Some(3000)));
    order(&mut rig, GONE, plc(1), setpoint(4000));
    leaves(&mut rig);
    assert_eq!(rig.outcome_of(ours).0, Outcome::Acknowledged);
    assert_eq!(
        (rig.written(FREQUENCY), rig.written(RUN)),
        (vec![3000], vec![1])
    );
    let control = rig.view(0).control.unwrap();
    assert_eq!(
        (control.intent, control.setpoint),
        (RunIntent::Run(Forward), Some(Hertz::from_centihertz(3000)))
    );
}
