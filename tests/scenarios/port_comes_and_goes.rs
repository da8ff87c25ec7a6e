//! A port that is lost and opened again leaves nothing behind, however often.

use crate::support::{PROOF, Rig, RigOptions};
use std::time::Duration;
use vfd_gateway::domain::link::PortKind;
use vfd_gateway::domain::native::{NativeAsk, NativeOutcome, NativeRefusal};
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::gateway::LineInput;

const CYCLES: u64 = 10_000;

/// The debug output of the core, without the numbers in it.
fn size_of_core(rig: &Rig) -> usize {
    format!("{:?}", rig.core)
        .chars()
        .filter(|c| !c.is_ascii_digit())
        .count()
}

/// Lets `rig` come to rest: no open requests, no outstanding replies.
fn rest(rig: &mut Rig) {
    rig.pass(Duration::from_secs(20));
    rig.reports.clear();
    rig.notes.clear();
}

#[test]
fn ten_thousand_times_out_and_in_leave_no_queue_and_no_miscount() {
    // Polls every hour, so that there are moments of rest.
    let options = RigOptions {
        drives: 2,
        poll: Duration::from_secs(3600),
        ..RigOptions::default()
    };
    let mut rig = Rig::new(&options);
    rig.keeps_sent = false;
    let before = *rig.core.counters();
    let mut size_early = 0;
    let mut asked = 0;
    let mut lost = 0;
    let mut refused = 0;
    let mut answered = 0;
    for cycle in 0..CYCLES {
        // Every other time while one request is on the wire and others wait.
        let in_flight = if cycle % 2 == 1 { 1 + cycle % 7 } else { 0 };
        for asker in 0..in_flight {
            rig.ask(
                asker,
                (asker % 2) as u16,
                NativeAsk::Read {
                    address: (PROOF + asker as u16).into(),
                    count: 1,
                },
            );
        }
        rig.run_until(rig.now + Duration::from_millis(cycle % 61), |_, answer| {
            assert!(
                matches!(answer.outcome, NativeOutcome::Words(_)),
                "cycle {cycle}: {answer:?}"
            );
            answered += 1;
        });
        rig.core
            .handle(rig.now, LineInput::PortDown(LineFault::Gone));
        rig.settle();
        rig.read(9, 0, PROOF, 1);
        asked += in_flight + 1;
        for (_, answer) in std::mem::take(&mut rig.answers) {
            match answer.outcome {
                NativeOutcome::NoReply => lost += 1,
                NativeOutcome::Refused(NativeRefusal::LineDown) => refused += 1,
                other => panic!("cycle {cycle}: {other:?}"),
            }
        }
        assert_eq!(
            lost + refused + answered,
            asked,
            "cycle {cycle}: everybody is answered while the port is away"
        );
        assert!(!rig.core.is_occupied(), "cycle {cycle}");
        rig.pass(Duration::from_millis(100 + cycle % 400));
        rig.core
            .handle(rig.now, LineInput::PortUp(PortKind::Serial));
        let ticket = rig.read(1, (cycle % 2) as u16, PROOF, 1);
        let outcome = rig.answer_to(ticket);
        assert!(
            matches!(outcome, NativeOutcome::Words(_)),
            "cycle {cycle}: {outcome:?}"
        );
        if cycle == 100 {
            rest(&mut rig);
            size_early = size_of_core(&rig);
        }
    }
    rest(&mut rig);
    assert!(
        lost > 0 && refused > CYCLES && answered > 0,
        "{lost} {refused} {answered}"
    );
    let after = *rig.core.counters();
    assert_eq!(
        (
            after.port_ups - before.port_ups,
            after.port_downs - before.port_downs
        ),
        (CYCLES, CYCLES)
    );
    assert_eq!((after.queue_full, after.expired), (0, 0));
    let size = size_of_core(&rig);
    assert!(
        size.abs_diff(size_early) * 20 < size_early,
        "it has grown from {size_early} to {size}"
    );
    assert_eq!(rig.core.next_effect(), None);
}
