//! On a bad line every request still ends once, with the drive's own words or with a report that there are none.

use crate::support::{PROOF, Rig, RigOptions};
use std::time::Duration;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::sim::{BusOptions, FaultPlan};

#[test]
fn every_fault_at_once_mixes_nothing_up() {
    let faults: FaultPlan = "noise=80,lost=10,late=10,cut=10,flip=50,foreign=30"
        .parse()
        .expect("a plan");
    for seed in 0..4 {
        let bus = BusOptions {
            faults,
            ..BusOptions::default()
        };
        let options = RigOptions {
            drives: 4,
            bus,
            seed,
            poll: Duration::from_millis(500),
            ..RigOptions::default()
        };
        let mut rig = Rig::new(&options);
        rig.keeps_sent = false;
        let mut asked = 0_u64;
        let mut ended = 0_u64;
        let mut right = 0_u64;
        for asker in 0..6 {
            rig.read(asker, asker as u16 % 4, PROOF, 1 + asker as u16);
            asked += 1;
        }
        let until = rig.now + Duration::from_secs(600);
        rig.run_until(until, |rig, answer| {
            ended += 1;
            if let NativeOutcome::Words(words) = &answer.outcome {
                let expected = rig.proof(answer.ticket);
                assert!(
                    words.iter().all(|word| *word == expected),
                    "{words:04X?} for {expected:04X}"
                );
                right += 1;
            }
            let n = answer.ticket.0;
            rig.read(answer.asker.0, (n % 4) as u16, PROOF, 1 + (n % 8) as u16);
            asked += 1;
        });
        assert!(asked - ended <= 6);
        assert!(
            right * 10 > ended * 8,
            "most still get their words: {right} of {ended}"
        );
        // A late reply that starts at the very moment in which we start cannot be foreseen.
        let report = rig.bus.report();
        assert!(
            report.gaps_too_short <= report.replies_late / 10,
            "{}",
            report.gaps_too_short
        );
        assert!(
            report.talked_over <= report.replies_late / 10,
            "{}",
            report.talked_over
        );
    }
}

#[test]
fn no_gap_is_ever_too_short_on_a_clean_line() {
    let mut rig = Rig::new(&RigOptions {
        drives: 8,
        poll: Duration::from_millis(20),
        ..RigOptions::default()
    });
    rig.keeps_sent = false;
    rig.run_until(rig.now + Duration::from_secs(300), |_, _| {});
    let report = rig.bus.report();
    assert!(report.requests_heard > 9_000);
    assert_eq!((report.gaps_too_short, report.talked_over), (0, 0));
    // Exact in simulation: the line is kept busy with nothing but the silence of 4.5 characters in between.
    assert_eq!(report.shortest_gap, Some(Duration::from_nanos(4_687_500)));
}
