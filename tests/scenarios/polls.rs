//! Polls: what is read along, the cost of a drive that refuses that, and that nothing starves on a full line.

use crate::support::{PROOF, Rig, RigOptions, model};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::ids::{AskerId, DriveIndex, Station};
use vfd_gateway::domain::link::PortKind;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::profile::model::Model;
use vfd_gateway::sim::{BadRequest, DriveOptions, SimDrive};

const SECOND: Duration = Duration::from_secs(1);
/// Temperature to run hours: three registers between them are not polled.
const BRIDGED: [u8; 5] = [3, 0x30, 0x17, 0, 5];

fn frecon() -> Arc<Model> {
    model("frecon-fr500a")
}

fn polled(bad_request: BadRequest) -> Rig {
    Rig::new(&RigOptions {
        model: frecon(),
        poll: SECOND,
        bad_request,
        proof_words: None,
        ..RigOptions::default()
    })
}

fn is_read(rig: &Rig, pdu: [u8; 5]) -> usize {
    rig.sent.iter().filter(|sent| sent.pdu == pdu).count()
}

/// Replaces the drive by one that does not have the registers in the hole.
fn knows_no_hole(rig: &mut Rig, bad_request: BadRequest) {
    let mut model = Model::clone(&frecon());
    model
        .registers
        .retain(|register| !(0x3018..=0x301A).contains(&register.address.number()));
    let options = DriveOptions {
        bad_request,
        ..DriveOptions::default()
    };
    rig.bus
        .connect(Station(1), SimDrive::new(Arc::new(model), options));
}

#[test]
fn listed_registers_between_two_polls_are_read_along() {
    let mut rig = polled(BadRequest::AsDocumented);
    rig.sent.clear();
    rig.pass(20 * SECOND);
    assert_eq!(is_read(&rig, BRIDGED), 5, "{:02X?}", rig.frames());
    assert_eq!(
        is_read(&rig, [3, 0x30, 0x17, 0, 1]) + is_read(&rig, [3, 0x30, 0x1B, 0, 1]),
        0
    );
    let snapshot = rig.view(0).snapshot;
    let read = |address| {
        snapshot
            .reading(address)
            .map(|reading| rig.now.since(reading.at) < 5 * SECOND)
    };
    assert_eq!(
        (read(0x3017), read(0x301B), read(0x3018)),
        (Some(true), Some(true), None),
        "only what is polled"
    );
}

#[test]
fn a_drive_that_refuses_a_read_over_a_hole_is_read_group_by_group() {
    for bad_request in [BadRequest::AsDocumented, BadRequest::Silence] {
        let mut rig = polled(bad_request);
        knows_no_hole(&mut rig, bad_request);
        rig.core
            .handle(rig.now, LineInput::PortDown(LineFault::Gone));
        rig.core
            .handle(rig.now, LineInput::PortUp(PortKind::Serial));
        rig.sent.clear();
        rig.pass(60 * SECOND);
        let tries = if bad_request == BadRequest::AsDocumented {
            1
        } else {
            3
        };
        assert_eq!(is_read(&rig, BRIDGED), tries, "{bad_request:?}");
        for address in [0x17, 0x1B] {
            assert!(
                is_read(&rig, [3, 0x30, address, 0, 1]) >= 10,
                "{bad_request:?} {address:02X}"
            );
        }
        let age = rig
            .now
            .since(rig.view(0).snapshot.reading(0x301B).expect("it is read").at);
        assert!(age <= 5 * SECOND, "{bad_request:?}: {age:?}");
        // After the port is reopened, there may be another drive.
        rig.core
            .handle(rig.now, LineInput::PortDown(LineFault::Gone));
        rig.core
            .handle(rig.now, LineInput::PortUp(PortKind::Serial));
        rig.sent.clear();
        rig.pass(10 * SECOND);
        assert!(is_read(&rig, BRIDGED) >= 1, "{bad_request:?}");
    }
}

/// The greatest age of each polled register of each drive within `time`, looked at every 50 ms.
fn oldest(
    rig: &mut Rig,
    model: &Model,
    drives: u16,
    time: Duration,
) -> BTreeMap<(u16, u16), Duration> {
    let mut oldest = BTreeMap::new();
    let end = rig.now + time;
    while rig.now < end {
        rig.pass(Duration::from_millis(50));
        for drive in 0..drives {
            let snapshot = rig.core.snapshot(DriveIndex(drive)).expect("a drive");
            for register in model
                .registers
                .iter()
                .filter(|register| register.poll.is_some())
            {
                let age = snapshot
                    .reading(register.address)
                    .map_or(Duration::MAX, |it| rig.now.since(it.at));
                let most = oldest
                    .entry((drive, register.address.number()))
                    .or_insert(age);
                *most = age.max(*most);
            }
        }
    }
    oldest
}

#[test]
fn an_over_full_plan_stretches_every_class_and_starves_none() {
    let model = model("hyundai-n700");
    // 16 drives whose fast polls alone would need the line two times over.
    let mut rig = Rig::new(&RigOptions {
        drives: 16,
        poll: Duration::from_millis(160),
        ..RigOptions::default()
    });
    rig.keeps_sent = false;
    rig.pass(10 * SECOND);
    let ages = oldest(&mut rig, &model, 16, 20 * SECOND);
    let worst = |address: u16| {
        ages.iter()
            .filter(|(it, _)| it.1 == address)
            .map(|(_, age)| *age)
            .max()
            .unwrap()
    };
    assert!(worst(0x0101) <= 2 * SECOND, "{:?}", worst(0x0101));
    assert!(
        worst(0x0201) <= 6 * SECOND && worst(0x0112) <= 6 * SECOND,
        "{:?}",
        (worst(0x0201), worst(0x0112))
    );
    // Clients have their share of it all the same.
    for asker in 0..4 {
        rig.read(asker, asker as u16, PROOF, 1);
    }
    let mut right = BTreeMap::new();
    let until = rig.now + 20 * SECOND;
    rig.run_until(until, |rig, answer| {
        assert!(
            matches!(answer.outcome, NativeOutcome::Words(_)),
            "{answer:?}"
        );
        *right.entry(answer.asker).or_insert(0) += 1;
        rig.read(answer.asker.0, answer.asker.0 as u16, PROOF, 1);
    });
    assert!(right.values().all(|right| *right >= 20), "{right:?}");
}

#[test]
fn polls_keep_their_turn_whatever_clients_ask() {
    let model = model("hyundai-n700");
    let mut rig = Rig::new(&RigOptions {
        drives: 8,
        poll: SECOND,
        ..RigOptions::default()
    });
    rig.keeps_sent = false;
    // Each of twenty clients always has sixteen reads waiting, of eight words, all different.
    for asker in 0..20 {
        for n in 0..16 {
            rig.read(asker, asker as u16 % 8, PROOF + n * 8 + asker as u16 / 8, 8);
        }
    }
    let mut ages = BTreeMap::new();
    let end = rig.now + 30 * SECOND;
    let mut n = 0_u16;
    while rig.now < end {
        let until = rig.now + Duration::from_millis(50);
        rig.run_until(until, |rig, answer| {
            n = n.wrapping_add(7);
            rig.read(
                answer.asker.0,
                answer.asker.0 as u16 % 8,
                PROOF + n % 0xF8,
                8,
            );
        });
        for drive in 0..8 {
            let snapshot = rig.core.snapshot(DriveIndex(drive)).expect("a drive");
            for register in model
                .registers
                .iter()
                .filter(|register| register.poll.is_some())
            {
                let age = snapshot
                    .reading(register.address)
                    .map_or(Duration::MAX, |it| rig.now.since(it.at));
                let most = ages.entry(register.address.number()).or_insert(age);
                *most = age.max(*most);
            }
        }
    }
    assert!(
        ages[&0x0101] <= 2 * SECOND && ages[&0x0112] <= 2 * SECOND,
        "{ages:?}"
    );
    // A slow one precedes all client requests once it has waited for a whole period.
    assert!(
        ages[&0x0201] <= 9 * SECOND && ages[&0x0211] <= 9 * SECOND,
        "{ages:?}"
    );
}

#[test]
fn a_client_that_floods_takes_no_more_than_its_share() {
    let mut rig = Rig::new(&RigOptions {
        drives: 4,
        ..RigOptions::default()
    });
    rig.keeps_sent = false;
    const FLOODER: u64 = 99;
    let mut n = 0_u16;
    for _ in 0..400 {
        n += 1;
        rig.read(FLOODER, n % 4, PROOF + n / 4 % 0xF8, 1);
    }
    for asker in 0..19 {
        rig.read(asker, asker as u16 % 4, PROOF + asker as u16, 2);
    }
    let mut words: BTreeMap<AskerId, u32> = BTreeMap::new();
    let until = rig.now + 60 * SECOND;
    rig.run_until(until, |rig, answer| {
        if matches!(answer.outcome, NativeOutcome::Words(_)) {
            *words.entry(answer.asker).or_default() += 1;
        }
        n = n.wrapping_add(1);
        match answer.asker.0 {
            FLOODER => rig.read(FLOODER, n % 4, PROOF + n / 4 % 0xF8, 1),
            asker => rig.read(asker, n % 4, PROOF + (asker as u16 * 8 + n) % 0xF0, 2),
        };
    });
    let mean = words.values().sum::<u32>() / 20;
    let modest = words
        .iter()
        .filter(|(asker, _)| asker.0 != FLOODER)
        .map(|(_, right)| *right)
        .min()
        .unwrap();
    assert!(
        words.len() == 20 && f64::from(modest) >= 0.8 * f64::from(mean),
        "{words:?}"
    );
    // It may share the exchanges of others, and gets no more turns than they.
    assert!(
        f64::from(words[&AskerId(FLOODER)]) <= 1.5 * f64::from(mean),
        "{words:?}"
    );
}

#[test]
fn a_line_that_comes_back_knows_all_its_drives_again_soon() {
    let model = model("hyundai-n700");
    let mut rig = Rig::new(&RigOptions {
        drives: 32,
        poll: 2 * SECOND,
        ..RigOptions::default()
    });
    rig.keeps_sent = false;
    rig.pass(20 * SECOND);
    rig.core
        .handle(rig.now, LineInput::PortDown(LineFault::Gone));
    rig.pass(60 * SECOND);
    rig.core
        .handle(rig.now, LineInput::PortUp(PortKind::Serial));
    let up = rig.now;
    rig.pass(Duration::from_millis(1500));
    for drive in 0..32 {
        let at = |address| {
            rig.core
                .snapshot(DriveIndex(drive))
                .and_then(|it| it.reading(address))
                .expect("read")
                .at
        };
        assert!(at(0x0101) > up, "{drive}: how it is was asked first");
    }
    let ages = oldest(&mut rig, &model, 32, 20 * SECOND);
    let fast = ages
        .iter()
        .filter(|(it, _)| it.1 == 0x0101)
        .map(|(_, age)| *age)
        .max()
        .unwrap();
    assert!(fast <= 3 * SECOND, "{fast:?}");
}

/// The process was suspended while the reply was under way: its values are as old as the reply, not as the resumption.
#[test]
fn a_reading_that_waited_for_a_suspended_process_is_not_fresh() {
    let mut rig = polled(BadRequest::AsDocumented);
    rig.sent.clear();
    while rig.sent.is_empty() {
        rig.step(rig.now + SECOND);
    }
    let asked_at = rig.now;
    let begins = u16::from_be_bytes([rig.sent[0].pdu[1], rig.sent[0].pdu[2]]);
    rig.now = rig.now + SECOND * 8;
    let mut waited = Vec::new();
    rig.bus
        .take_due(rig.now, |_, bytes| waited.extend_from_slice(bytes));
    rig.core.handle(rig.now, LineInput::Bytes(&waited));
    rig.settle();
    rig.pass(Duration::from_millis(20));
    let read_at = rig
        .view(0)
        .snapshot
        .reading(begins)
        .expect("it was taken")
        .at;
    assert!(
        read_at >= asked_at && read_at < asked_at + SECOND,
        "{:?} after the request",
        read_at.since(asked_at)
    );
}
