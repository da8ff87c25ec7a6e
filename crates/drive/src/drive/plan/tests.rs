//! The plan of one drive, and of many drives on one line.

use super::*;
use crate::profile::model::{Confidence, Register, RegisterAccess};
use crate::vendors;

fn model() -> Model {
    Model::clone(
        vendors::catalog()
            .find("hyundai-n700")
            .expect("it is built in"),
    )
}

#[test]
fn neighbours_share_a_frame_and_classes_do_not() {
    let groups: Vec<_> = groups(&model())
        .iter()
        .map(|group| (group.address, group.count))
        .collect();
    // D001; trip count; F001; F010 and F011 together
    assert_eq!(
        groups,
        [
            (Address::holding(0x0101), 1),
            (Address::holding(0x0112), 1),
            (Address::holding(0x0201), 1),
            (Address::holding(0x0211), 2)
        ]
    );
}

#[test]
fn neighbours_that_are_due_together_go_together_whatever_their_class() {
    let mut model = model();
    let slow = |address: u16| Register {
        address: address.into(),
        poll: Some(PollClass::Slow),
        ..model.registers[2].clone()
    };
    let (before, after) = (slow(0x0100), slow(0x0102));
    model.registers.extend([before, after]);
    model.registers.sort_by_key(|register| register.address);
    let at = MonoTime::from_millis;
    let mut plan = PollPlan::new(
        &model,
        PollPace::new(Duration::from_millis(100), 1.0),
        at(0),
        PlaceOnLine::ALONE,
    );
    let fast = |plan: &PollPlan| {
        plan.iter()
            .find(|(_, group, _)| group.address == 0x0101)
            .map(|(index, ..)| index)
    };
    let index = fast(&plan).unwrap();
    assert_eq!(
        plan.take(index, at(0), &model, |_, _| true),
        Some((Address::holding(0x0100), 3)),
        "all are due at the start"
    );
    // Each goes along with every fourth of the fast ones, and not both with the same.
    let taken: Vec<_> = (1..=8)
        .filter_map(|n| plan.take(index, at(n * 100), &model, |_, _| true))
        .collect();
    let (with_after, alone, with_before) = (
        (Address::holding(0x0101), 2),
        (Address::holding(0x0101), 1),
        (Address::holding(0x0100), 2),
    );
    assert_eq!(
        taken,
        [
            with_after,
            alone,
            alone,
            with_before,
            with_after,
            alone,
            alone,
            with_before
        ]
    );
    let due = plan.iter().filter(|(_, _, due)| *due <= at(800)).count();
    assert_eq!(due, 3, "those elsewhere still wait");
    assert_eq!(
        plan.take(index, at(900), &model, |_, words| words < 2),
        Some((Address::holding(0x0101), 1)),
        "as far as it may"
    );
}

#[test]
fn a_read_that_covers_a_group_takes_the_place_of_its_poll() {
    let at = MonoTime::from_millis;
    let first = Address::holding(0x0101);
    let mut plan = PollPlan::new(
        &model(),
        PollPace::new(Duration::from_secs(1), 1.0),
        at(0),
        PlaceOnLine::ALONE,
    );
    let due = |plan: &PollPlan| {
        plan.iter()
            .find(|(_, group, _)| group.address == first)
            .map(|(.., due)| due)
            .unwrap()
    };
    assert_eq!(plan.was_read(0x0100_u16.into(), 1, at(5)), []);
    assert_eq!(due(&plan), at(0));
    let group = PollGroup {
        address: first,
        count: 1,
        class: PollClass::Fast,
    };
    assert_eq!(plan.was_read(0x0100_u16.into(), 3, at(5)), [group]);
    assert_eq!(due(&plan), at(1005));
    // An older one brings it no closer.
    plan.was_read(first, 1, at(3));
    assert_eq!(due(&plan), at(1005));
    // F010 is polled together with F011.
    assert_eq!(plan.was_read(0x0211_u16.into(), 1, at(6)), []);
    assert_eq!(plan.was_read(0x0210_u16.into(), 4, at(6)).len(), 1);
    plan.ask_for(first, at(7));
    assert_eq!(due(&plan), at(7), "a read that is asked for comes first");
}

#[test]
fn a_line_that_is_late_keeps_its_phase_and_does_not_catch_up() {
    let at = MonoTime::from_millis;
    let mut plan = PollPlan::new(
        &model(),
        PollPace::new(Duration::from_millis(100), 1.0),
        at(1000),
        PlaceOnLine {
            index: 1,
            drives: 4,
        },
    );
    let due = |plan: &PollPlan| plan.iter().next().map(|(_, _, due)| due).expect("a group");
    assert_eq!(due(&plan), at(1000), "known soon");
    plan.sent(0, at(1010));
    assert_eq!(due(&plan), at(1025), "then in its phase");
    plan.sent(0, at(1025));
    assert_eq!(due(&plan), at(1125));
    plan.sent(0, at(1777));
    assert_eq!(due(&plan), at(1825));
    let group = plan.entries[0].group;
    assert!(!plan.is_aged(group, at(1825), at(1875)) && plan.is_aged(group, at(1825), at(1876)));
}

#[test]
fn what_is_not_proven_is_read_apart_until_it_is_answered_and_seldom_if_it_never_is() {
    let mut model = model();
    let at = MonoTime::from_millis;
    let output = model
        .registers
        .iter()
        .position(|register| register.address == 0x0101)
        .unwrap();
    let unproven = Register {
        address: 0x0102_u16.into(),
        confidence: Confidence::Inferred,
        ..model.registers[output].clone()
    };
    model.registers.insert(output + 1, unproven);
    assert_eq!(groups(&model)[0].count, 2, "what a line is planned with");
    let mut plan = PollPlan::new(
        &model,
        PollPace::new(Duration::from_millis(100), 1.0),
        at(0),
        PlaceOnLine::ALONE,
    );
    assert_eq!(
        plan.take(0, at(0), &model, |_, _| true),
        Some((Address::holding(0x0101), 1))
    );
    assert_eq!(
        plan.take(1, at(0), &model, |_, _| true),
        Some((Address::holding(0x0102), 1))
    );
    for round in 1..=6_u64 {
        plan.unanswered(0x0102_u16.into(), 1, at(round * 100));
        assert_eq!(
            plan.entries[1].due <= at(700),
            round < 4,
            "{round}: silence alone tells nothing"
        );
        if round >= 2 {
            plan.answered(0x0101_u16.into(), 1);
        }
    }
    plan.answered(0x0102_u16.into(), 1);
    assert_eq!(
        plan.take(0, at(4_000_000), &model, |_, _| true),
        Some((Address::holding(0x0101), 2)),
        "known now"
    );
}

fn built_in(id: &str) -> Model {
    let catalog = vendors::catalog();
    Model::clone(catalog.find(id).expect("it is built in"))
}

/// The model with registers at these addresses alone, all of the same class but for those that are not polled.
fn with_registers(addresses: &[(u16, Option<PollClass>)]) -> Model {
    let mut model = model();
    let like = model.registers[2].clone();
    let register = |&(address, poll): &(u16, Option<PollClass>)| Register {
        address: address.into(),
        poll,
        access: RegisterAccess::Read,
        ..like.clone()
    };
    model.registers = addresses.iter().map(register).collect();
    model
}

const SLOW: Option<PollClass> = Some(PollClass::Slow);

#[test]
fn a_hole_is_read_along_where_all_of_it_is_listed_readable_and_documented() {
    let bridged = [
        (0x0101, SLOW),
        (0x0102, None),
        (0x0103, None),
        (0x0104, SLOW),
    ];
    let read = |model: &Model| {
        groups(model)
            .iter()
            .map(|group| (group.address, group.count))
            .collect::<Vec<_>>()
    };
    assert_eq!(
        read(&with_registers(&bridged)),
        [(Address::holding(0x0101), 4)]
    );
    let apart = [(Address::holding(0x0101), 1), (Address::holding(0x0104), 1)];
    let spoil: [fn(&mut Model); 5] = [
        |model| drop(model.registers.remove(1)),
        |model| model.registers[1].access = RegisterAccess::Write,
        |model| model.registers[2].confidence = Confidence::Sibling,
        |model| model.registers[2].confidence = Confidence::Configured,
        |model| model.read.max_words.value = 3,
    ];
    for (n, spoil) in spoil.iter().enumerate() {
        let mut model = with_registers(&bridged);
        spoil(&mut model);
        assert_eq!(read(&model), apart, "{n}");
    }
    let boundary = [(0x01FE, SLOW), (0x01FF, None), (0x0200, SLOW)];
    assert_eq!(
        read(&with_registers(&boundary)),
        [(Address::holding(0x01FE), 1), (Address::holding(0x0200), 1)]
    );
    let mut wide: Vec<_> = (0x0101..=0x0110).map(|address| (address, None)).collect();
    wide[0].1 = SLOW;
    wide[15].1 = SLOW;
    let mut model = with_registers(&wide);
    model.read.max_words.value = 30;
    assert_eq!(
        read(&model),
        [(Address::holding(0x0101), 1), (Address::holding(0x0110), 1)],
        "14 words cost more than they save"
    );
}

#[test]
fn what_is_planned_is_what_is_read() {
    for model in vendors::catalog().models() {
        let id = &model.id;
        let at = MonoTime::ZERO;
        let mut plan = PollPlan::new(
            model,
            PollPace::new(Duration::from_secs(1), 1.0),
            at,
            PlaceOnLine::ALONE,
        );
        // Once it has answered for everything.
        plan.entries
            .iter_mut()
            .for_each(|entry| entry.is_trusted = true);
        let is_polled = |address: &Address| {
            model
                .register_at(*address)
                .is_some_and(|it| it.poll.is_some())
        };
        let (mut read, mut reads) = (Vec::new(), 0);
        let due = |plan: &PollPlan| {
            plan.iter()
                .find(|(.., due)| *due <= at)
                .map(|(index, ..)| index)
        };
        while let Some(index) = due(&plan) {
            let (address, count) = plan.take(index, at, model, |_, _| true).unwrap();
            read.extend(address.onwards().take(count.into()).filter(is_polled));
            reads += 1;
        }
        let words = |it: &PollGroup| it.address.onwards().take(it.count.into());
        let mut planned: Vec<Address> = groups(model).iter().flat_map(words).collect();
        planned.retain(is_polled);
        planned.sort_unstable();
        read.sort_unstable();
        // Two registers may share a word.
        planned.dedup();
        read.dedup();
        assert_eq!(read, planned, "{id}");
        assert!(reads <= groups(model).len(), "{id}: {reads}");
    }
}

#[test]
fn a_refused_bridge_is_not_tried_again_until_the_port_is_opened() {
    let model = with_registers(&[(0x0101, SLOW), (0x0102, None), (0x0103, SLOW)]);
    let at = MonoTime::from_millis;
    let mut plan = PollPlan::new(
        &model,
        PollPace::new(Duration::from_millis(100), 1.0),
        at(0),
        PlaceOnLine::ALONE,
    );
    let take = |plan: &mut PollPlan, now| plan.take(0, at(now), &model, |_, _| true);
    assert_eq!(take(&mut plan, 0), Some((Address::holding(0x0101), 3)));
    plan.refused((0x0101_u16.into(), 3), 2, &model, at(10));
    assert!(
        plan.iter().all(|(.., due)| due == at(10)),
        "what it was to bring is asked for at once"
    );
    assert_eq!(take(&mut plan, 10), Some((Address::holding(0x0101), 1)));
    assert_eq!(take(&mut plan, 450), Some((Address::holding(0x0101), 1)));
    plan.port_opened(at(500));
    assert_eq!(take(&mut plan, 850), Some((Address::holding(0x0101), 3)));
    // Silence may have other reasons; but not again and again while other requests are answered.
    for now in [1250, 1650, 2050] {
        plan.unanswered(0x0101_u16.into(), 3, at(now));
        plan.answered(0x0201_u16.into(), 1);
        assert_eq!(
            take(&mut plan, now),
            Some(if now < 2050 {
                (Address::holding(0x0101), 3)
            } else {
                (Address::holding(0x0101), 1)
            })
        );
    }
    plan.port_opened(at(2100));
    take(&mut plan, 2450);
    plan.answered(0x0101_u16.into(), 3);
    for now in [2850, 3250, 3650, 4050, 4450] {
        assert_eq!(
            take(&mut plan, now),
            Some((Address::holding(0x0101), 3)),
            "it has been answered once"
        );
        plan.unanswered(0x0101_u16.into(), 3, at(now));
        plan.answered(0x0201_u16.into(), 1);
    }
}

/// Moments at which reads of `drives` drives of `model` fall due from `from` on, in ms, if each goes at once.
fn due_moments(model: &Model, drives: u32, from: u64) -> Vec<MonoTime> {
    let poll = Duration::from_secs(1);
    let place = |index| PlaceOnLine { index, drives };
    let plan = |index| {
        PollPlan::new(
            model,
            PollPace::new(poll, 1.0),
            MonoTime::from_millis(from),
            place(index),
        )
    };
    let mut plans: Vec<PollPlan> = (0..drives).map(plan).collect();
    plans
        .iter_mut()
        .flat_map(|plan| &mut plan.entries)
        .for_each(|entry| entry.is_trusted = true);
    let end = MonoTime::from_millis(from + 40_000);
    let mut moments = Vec::new();
    loop {
        let all = plans
            .iter()
            .enumerate()
            .flat_map(|(at, plan)| plan.iter().map(move |(index, _, due)| (due, at, index)));
        let Some((due, at, index)) = all.min().filter(|(due, ..)| *due < end) else {
            return moments;
        };
        plans[at].take(index, due, model, |_, _| true);
        moments.push(due);
    }
}

#[test]
fn polls_of_a_full_line_are_spread_evenly() {
    const DRIVES: u32 = 32;
    let slot = Duration::from_secs(1) / DRIVES;
    let catalog = vendors::catalog();
    for id in vendors::reviewed() {
        let model = catalog.find(id).expect("it is built in");
        let moments = due_moments(model, DRIVES, 0);
        let regular: Vec<_> = moments
            .iter()
            .filter(|at| **at >= MonoTime::from_millis(10_000))
            .collect();
        let begun_at = |at: usize| {
            regular[at..]
                .iter()
                .take_while(|later| later.since(*regular[at]) < slot)
                .count()
        };
        let most = (0..regular.len()).map(begun_at).max().unwrap();
        let mean = regular.len() as f64 / (30.0 * f64::from(DRIVES));
        assert!(
            most as f64 <= mean + 3.0,
            "{id}: {most} reads within one {slot:?}, {mean} on average"
        );
    }
}

#[test]
fn a_line_that_was_down_does_not_have_all_its_polls_due_at_once() {
    let model = built_in("toshiba-vf-s15");
    let at = MonoTime::from_millis;
    let mut plan = PollPlan::new(
        &model,
        PollPace::new(Duration::from_secs(1), 1.0),
        at(0),
        PlaceOnLine::ALONE,
    );
    plan.port_opened(at(60_000));
    assert!(
        plan.iter().all(|(.., due)| due == at(60_000)),
        "nothing is known yet, and it has not waited since the start"
    );
    for index in 0..plan.entries.len() {
        plan.take(index, at(60_000), &model, |_, _| true);
    }
    plan.port_opened(at(120_000));
    for (_, group, due) in plan.iter() {
        assert_eq!(
            due == at(120_000),
            group.class == PollClass::Fast,
            "{group:?}: {due:?}"
        );
        assert!(due >= at(120_000));
    }
}

#[test]
fn whatever_waits_for_whole_periods_goes_first_whatever_its_class() {
    let plan = PollPlan::new(
        &model(),
        PollPace::new(Duration::from_secs(1), 1.0),
        MonoTime::ZERO,
        PlaceOnLine::ALONE,
    );
    let at = MonoTime::from_millis;
    let group = |class| PollGroup {
        address: 1_u16.into(),
        count: 1,
        class,
    };
    let urgency = |class, due| plan.urgency(group(class), at(due), at(10_000));
    assert!(
        urgency(PollClass::Fast, 9_900) < urgency(PollClass::Slow, 6_001),
        "by class"
    );
    assert!(
        urgency(PollClass::Slow, 6_000) < urgency(PollClass::Fast, 9_001),
        "a whole period"
    );
    assert!(
        urgency(PollClass::Fast, 8_000) < urgency(PollClass::Slow, 6_000),
        "two of them"
    );
    assert!(
        urgency(PollClass::Hourly, 6_000) < urgency(PollClass::Fast, 9_001),
        "not an hour"
    );
}
