//! A reset clears a trip and nothing else: it is sent only where there may be a trip, word by word as the vendor
//! specifies, is never left in the register, carries no order to run, and is reported as the drive shows it.

use crate::support::families::{accepting, models, options_of, rig_of};
use crate::support::{MQTT, Rig, RigOptions, STOP, model, plc, run};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Order, Outcome, Reason};
use vfd_gateway::domain::ids::{Station, Ticket};
use vfd_gateway::domain::link::PortKind;
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::snapshot::DrivePresence;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::gateway::{DriveNote, LineInput};
use vfd_gateway::journal::{JournalEntry, RememberedDrive};
use vfd_gateway::profile::model::Model;
use vfd_gateway::sim::{DriveOptions, SimDrive};

const SECOND: Duration = Duration::from_secs(1);
/// A trip number that every known table has.
const CAUSE: u16 = 2;

/// One vendor's way, typed from its manual.
struct Way {
    id: &'static str,
    /// Address of the run command.
    at: u16,
    stop: u16,
    reset: u16,
    /// The frames of an undisturbed reset.
    words: &'static [u16],
    /// Bits of words that order the motor to run.
    run_bits: u16,
    /// A status word shows whether a trip holds.
    shows_trips: bool,
    /// The drive is deaf for 2 s afterwards.
    deaf: bool,
}

const WAYS: &[Way] = &[
    Way {
        id: "hyundai-n700",
        words: &[0, 4, 0],
        ..NUMBERS
    },
    Way {
        id: "hyundai-n100plus",
        words: &[0, 4, 0],
        run_bits: 0b0011,
        ..NUMBERS
    },
    Way {
        id: "teco-e510",
        at: 0x2501,
        reset: 8,
        words: &[0, 8, 0],
        run_bits: 0b0011,
        shows_trips: true,
        ..NUMBERS
    },
    Way {
        id: "teco-e510s",
        at: 0x2501,
        reset: 8,
        words: &[0, 8, 0],
        run_bits: 0b0011,
        shows_trips: true,
        ..NUMBERS
    },
    Way {
        id: "frecon-fr500a",
        at: 0x2000,
        stop: 5,
        reset: 7,
        words: &[5, 7],
        shows_trips: true,
        ..NUMBERS
    },
    // The drive is deaf to the stop after the reset word, so that is sent again.
    Way {
        id: "toshiba-vf-as1",
        ..BITS
    },
    Way {
        id: "toshiba-vf-s15",
        ..BITS
    },
];

const NUMBERS: Way = Way {
    id: "",
    at: 0x0002,
    stop: 0,
    reset: 4,
    words: &[],
    run_bits: 0,
    shows_trips: false,
    deaf: false,
};
const BITS: Way = Way {
    id: "",
    at: 0xFA00,
    stop: 0xC000,
    reset: 0xE000,
    words: &[0xC000, 0xE000, 0xC000, 0xC000],
    run_bits: 0x0600,
    shows_trips: true,
    deaf: true,
};

/// A drive that has tripped while it ran.
fn tripped(way: &Way, drives: u8) -> Rig {
    let options = options_of(&model(way.id), accepting());
    let mut rig = Rig::new(&RigOptions { drives, ..options });
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.live(SECOND * 3);
    assert!(rig.output(1) > 0, "{}", way.id);
    trip(&mut rig);
    rig.live(SECOND * 4);
    assert_eq!(rig.view(0).run_state, RunState::Tripped, "{}", way.id);
    rig.sent.clear();
    rig
}

fn trip(rig: &mut Rig) {
    let now = rig.now;
    rig.bus.drive_mut(Station(1)).unwrap().trip(now, CAUSE);
}

/// Resets, and lets time pass until `count` words of it are on the wire.
fn reset_up_to(rig: &mut Rig, way: &Way, count: usize) -> Ticket {
    let ticket = rig.command(MQTT, 0, Order::Reset);
    let limit = rig.now + SECOND * 5;
    while rig.written(way.at).len() < count {
        assert!(rig.step(limit), "{}: {:02X?}", way.id, rig.written(way.at));
    }
    ticket
}

/// Lets time pass while the owner of the drive sends heartbeats, until a command has its final outcome.
fn settled(rig: &mut Rig, ticket: Ticket) -> (Outcome, Reason) {
    for _ in 0..200 {
        if let Some((outcome, reason, true)) = rig.told(ticket).last() {
            return (*outcome, *reason);
        }
        rig.live(SECOND / 10);
    }
    panic!("no outcome within 20 s: {:?}", rig.told(ticket));
}

/// When `word` was first sent to the run command of the first drive.
fn sent_at(rig: &Rig, way: &Way, word: u16) -> MonoTime {
    let pdu = crate::support::families::single(way.at, word);
    rig.sent
        .iter()
        .find(|sent| sent.frame[0] == 1 && sent.pdu == pdu)
        .expect("it was sent")
        .at
}

fn is_tripped(rig: &Rig) -> bool {
    rig.bus.drive(Station(1)).unwrap().is_tripped()
}

fn keeps_the_rules(rig: &Rig, way: &Way) {
    let report = rig.bus.drive(Station(1)).unwrap().report();
    assert_eq!(
        (report.forbidden_words, report.resets_held),
        (0, 0),
        "{}",
        way.id
    );
    for word in rig.written(way.at) {
        assert!(
            [way.stop, way.reset].contains(&word),
            "{}: {word:04X} in a reset",
            way.id
        );
        assert_eq!(
            word & way.run_bits,
            0,
            "{}: {word:04X} orders to run",
            way.id
        );
    }
}

#[test]
fn there_is_a_way_for_every_model_that_can_be_reset() {
    let known: Vec<_> = models().iter().map(|model| model.id.clone()).collect();
    let mut ways: Vec<_> = WAYS.iter().map(|way| way.id.to_owned()).collect();
    ways.sort();
    assert_eq!(known, ways);
}

#[test]
fn a_reset_is_the_vendors_words_and_no_others() {
    for way in WAYS {
        let mut rig = tripped(way, 1);
        assert_eq!(
            rig.commanded(MQTT, Order::Reset),
            (Outcome::Confirmed, Reason::None),
            "{}",
            way.id
        );
        assert_eq!(rig.written(way.at), way.words, "{}", way.id);
        assert_eq!(
            rig.writes().len(),
            way.words.len(),
            "{}: nothing beside it",
            way.id
        );
        assert!(!is_tripped(&rig), "{}", way.id);
        keeps_the_rules(&rig, way);
        rig.live(SECOND * 5);
        assert_eq!(
            (rig.output(1), rig.written(way.at).len()),
            (0, way.words.len()),
            "{}: nothing follows",
            way.id
        );
    }
}

#[test]
fn a_reset_goes_only_to_a_drive_that_is_tripped_or_may_be_and_stands_still() {
    for way in WAYS {
        let mut rig = rig_of(&model(way.id), accepting());
        let told = rig.commanded(MQTT, Order::Reset);
        if way.shows_trips {
            assert_eq!(
                told,
                (Outcome::Refused, Reason::NotTripped),
                "{}: it is known not to be",
                way.id
            );
            assert!(rig.writes().is_empty(), "{}", way.id);
        } else {
            assert_eq!(
                told,
                (Outcome::Confirmed, Reason::None),
                "{}: nobody knows, and it stands still",
                way.id
            );
        }
        rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
        rig.live(SECOND);
        rig.sent.clear();
        assert_eq!(
            rig.commanded(MQTT, Order::Reset),
            (Outcome::Refused, Reason::NotTripped),
            "{}",
            way.id
        );
        assert!(rig.writes().is_empty(), "{}: {:02X?}", way.id, rig.writes());
        assert!(rig.output(1) > 0, "{}", way.id);
    }
}

#[test]
fn a_stop_in_the_middle_cuts_a_reset_and_takes_its_bit_back() {
    for way in WAYS {
        for count in 1..=2 {
            let mut rig = tripped(way, 1);
            let reset = reset_up_to(&mut rig, way, count);
            let cut_at = rig.now;
            let stop = rig.command(plc(1), 0, STOP);
            assert_eq!(
                rig.outcome_of(reset),
                (Outcome::Superseded, Reason::Stopped),
                "{}",
                way.id
            );
            assert_eq!(rig.now, cut_at, "{}: at once", way.id);
            assert_eq!(
                rig.outcome_of(stop),
                (Outcome::Confirmed, Reason::None),
                "{} after {count}",
                way.id
            );
            let words = rig.written(way.at);
            let resets = words.iter().filter(|word| **word == way.reset).count();
            assert_eq!(resets, count - 1, "{}: {words:04X?}", way.id);
            assert_eq!(words.last(), Some(&way.stop), "{}: {words:04X?}", way.id);
            rig.live(SECOND * 5);
            keeps_the_rules(&rig, way);
            if way.deaf {
                let held = rig.read(9, 0, way.at, 1);
                let expected = vfd_gateway::domain::native::NativeOutcome::Words([way.stop].into());
                assert_eq!(
                    rig.answer_to(held),
                    expected,
                    "{} after {count}: what the drive holds",
                    way.id
                );
            }
        }
    }
}

#[test]
fn a_lost_reply_to_the_reset_word_is_reported_as_what_the_drive_shows() {
    for way in WAYS {
        let mut rig = tripped(way, 1);
        let ticket = reset_up_to(&mut rig, way, 1);
        rig.loses_reply_to = Some(6);
        let told = rig.outcome_of(ticket);
        let expected = if way.shows_trips {
            (Outcome::Confirmed, Reason::None)
        } else {
            (Outcome::Unknown, Reason::NoReply)
        };
        assert_eq!(told, expected, "{}", way.id);
        let words = rig.written(way.at);
        assert_eq!(
            words.iter().filter(|word| **word == way.reset).count(),
            1,
            "{}: {words:04X?}",
            way.id
        );
        let ends_with_a_stop = way.words.last() == Some(&way.stop);
        assert_eq!(
            words.last() == Some(&way.stop),
            ends_with_a_stop,
            "{}: {words:04X?}",
            way.id
        );
        keeps_the_rules(&rig, way);
    }
}

#[test]
fn the_stop_that_ends_a_reset_goes_until_it_is_answered() {
    for way in WAYS
        .iter()
        .filter(|way| way.words.last() == Some(&way.stop))
    {
        for lost in 1..=3 {
            let mut rig = tripped(way, 1);
            let before = way.words.len() - 1;
            let ticket = reset_up_to(&mut rig, way, before);
            for sent in 0..lost {
                rig.loses_reply_to = Some(6);
                while rig.written(way.at).len() <= before + sent {
                    rig.live(SECOND / 100);
                }
            }
            assert_eq!(
                settled(&mut rig, ticket),
                (Outcome::Confirmed, Reason::None),
                "{}, {lost} lost",
                way.id
            );
            let words = rig.written(way.at);
            assert_eq!(
                words.len(),
                way.words.len() + lost,
                "{}: {words:04X?}",
                way.id
            );
            assert_eq!(
                words.iter().filter(|word| **word == way.reset).count(),
                1,
                "{}",
                way.id
            );
            keeps_the_rules(&rig, way);
        }
    }
}

#[test]
fn a_reset_whose_end_is_never_answered_is_reported_as_unknown_and_sent_so_often_only() {
    for way in WAYS
        .iter()
        .filter(|way| way.words.last() == Some(&way.stop))
    {
        let mut rig = tripped(way, 1);
        let ticket = reset_up_to(&mut rig, way, 2);
        let now = rig.now;
        rig.bus.set_powered(now, Station(1), false);
        rig.live(SECOND * 60);
        let (outcome, reason, is_final) = *rig.told(ticket).last().unwrap();
        assert_eq!(
            (outcome, reason, is_final),
            (Outcome::Unknown, Reason::NoReply, true),
            "{}",
            way.id
        );
        let stops = rig.written(way.at).len() - 2;
        assert!((4..=5).contains(&stops), "{}: {stops}", way.id);
    }
}

#[test]
fn a_drive_that_is_deaf_for_longer_than_was_said_gets_the_stop_all_the_same() {
    for way in WAYS.iter().filter(|way| way.deaf) {
        for cut in [false, true] {
            let mut slow = Model::clone(&model(way.id));
            slow.quirks.deaf_after_reset.as_mut().unwrap().value = Duration::from_millis(2500);
            let mut rig = rig_of(&model(way.id), accepting());
            rig.bus.connect(
                Station(1),
                SimDrive::new(slow.into(), DriveOptions::default()),
            );
            rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
            rig.live(SECOND * 3);
            trip(&mut rig);
            rig.live(SECOND * 4);
            let reset = reset_up_to(&mut rig, way, 2);
            let stop = cut.then(|| rig.command(plc(1), 0, STOP));
            let told = settled(&mut rig, stop.unwrap_or(reset));
            assert_eq!(
                told,
                (Outcome::Confirmed, Reason::None),
                "{}, cut {cut}",
                way.id
            );
            let held = rig.read(9, 0, way.at, 1);
            let expected = vfd_gateway::domain::native::NativeOutcome::Words([way.stop].into());
            assert_eq!(rig.answer_to(held), expected, "{}, cut {cut}", way.id);
        }
    }
}

#[test]
fn a_reset_without_effect_is_never_confirmed() {
    for way in WAYS.iter().filter(|way| way.shows_trips) {
        for loses in [None, Some(6)] {
            let mut rig = tripped(way, 1);
            let ticket = reset_up_to(&mut rig, way, 1);
            rig.loses_reply_to = loses;
            while rig.written(way.at).len() < 2 {
                rig.step(rig.now + SECOND);
            }
            // The cause is still there.
            trip(&mut rig);
            let (outcome, reason) = rig.outcome_of(ticket);
            assert!(
                matches!(outcome, Outcome::Failed | Outcome::Unknown),
                "{}: {outcome:?}, {reason:?}",
                way.id
            );
            assert!(
                matches!(reason, Reason::NotReadBack | Reason::NoReply),
                "{}: {reason:?}",
                way.id
            );
            keeps_the_rules(&rig, way);
            rig.live(SECOND * 2);
            assert_eq!(rig.view(0).run_state, RunState::Tripped, "{}", way.id);
        }
    }
}

#[test]
fn a_drive_that_is_deaf_after_a_reset_is_left_alone_and_others_are_not_held_up() {
    for way in WAYS.iter().filter(|way| way.deaf) {
        for cut in [false, true] {
            let mut rig = tripped(way, 2);
            let reset = reset_up_to(&mut rig, way, 2);
            if cut {
                rig.command(plc(1), 0, STOP);
            }
            rig.live(SECOND * 4);
            assert!(!rig.told(reset).is_empty(), "{}", way.id);
            let since = sent_at(&rig, way, way.reset);
            let to_first: Vec<_> = rig.sent.iter().filter(|sent| sent.frame[0] == 1).collect();
            let stop = crate::support::families::single(way.at, way.stop);
            let deaf = to_first
                .iter()
                .filter(|sent| sent.at > since && sent.at < since + SECOND * 2);
            for sent in deaf {
                assert_eq!(
                    sent.pdu,
                    stop,
                    "{}, cut {cut}: {:?} after",
                    way.id,
                    sent.at.since(since)
                );
            }
            let others: Vec<_> = rig
                .sent
                .iter()
                .filter(|sent| sent.frame[0] == 2)
                .map(|sent| sent.at)
                .collect();
            let longest = others
                .windows(2)
                .map(|pair| pair[1].since(pair[0]))
                .max()
                .unwrap();
            assert!(
                longest < SECOND,
                "{}, cut {cut}: {longest:?} without the other drive",
                way.id
            );
            assert_eq!(
                rig.view(0).snapshot.presence,
                DrivePresence::Online,
                "{}, cut {cut}",
                way.id
            );
            assert_eq!(
                rig.view(1).snapshot.presence,
                DrivePresence::Online,
                "{}",
                way.id
            );
            assert_eq!(rig.written(way.at).last(), Some(&way.stop), "{}", way.id);
        }
    }
}

#[test]
fn a_gateway_that_ends_leaves_no_reset_standing() {
    for way in WAYS {
        let mut rig = tripped(way, 1);
        // There is no owner any more, so no action is declared for the shutdown.
        rig.pass(SECOND * 10);
        assert!(rig.view(0).control.unwrap().lease.is_none(), "{}", way.id);
        rig.sent.clear();
        reset_up_to(&mut rig, way, 2);
        rig.core.handle(rig.now, LineInput::Shutdown);
        let limit = rig.now + SECOND * 4;
        while !rig.core.is_at_rest() {
            assert!(rig.step(limit), "{}: it does not end", way.id);
        }
        assert_eq!(rig.written(way.at), way.words, "{}", way.id);
        if way.deaf {
            let held = rig.read(9, 0, way.at, 1);
            let expected = vfd_gateway::domain::native::NativeOutcome::Words([way.stop].into());
            assert_eq!(rig.answer_to(held), expected, "{}", way.id);
        }
    }
}

#[test]
fn after_a_reset_a_fresh_order_is_needed() {
    for way in WAYS {
        let mut rig = tripped(way, 1);
        assert_eq!(
            rig.commanded(MQTT, Order::Reset).0,
            Outcome::Confirmed,
            "{}",
            way.id
        );
        rig.live(SECOND * 5);
        assert_eq!(rig.output(1), 0, "{}", way.id);
        assert!(rig.view(0).control.unwrap().start_inhibited, "{}", way.id);
        rig.pass(SECOND * 5);
        rig.sent.clear();
        // A controller that keeps writing its word for run has not seen that the drive tripped.
        for _ in 0..5 {
            let told = rig.commanded(plc(1), run(Direction::Forward, Some(3000)));
            assert_eq!(
                told,
                (Outcome::Refused, Reason::StartInhibited),
                "{}",
                way.id
            );
            rig.pass(SECOND / 2);
        }
        assert!(rig.writes().is_empty(), "{}: {:02X?}", way.id, rig.writes());
        assert_eq!(
            rig.commanded(plc(1), STOP).0,
            Outcome::Confirmed,
            "{}",
            way.id
        );
        let told = rig.commanded(plc(1), run(Direction::Forward, Some(3000))).0;
        assert!(
            matches!(told, Outcome::Confirmed | Outcome::Acknowledged),
            "{}: {told:?}",
            way.id
        );
        rig.pass(SECOND);
        assert!(rig.output(1) > 0, "{}", way.id);
    }
}

#[test]
fn a_cyclic_reset_acts_once() {
    for way in WAYS {
        let mut rig = tripped(way, 1);
        rig.pass(SECOND * 5);
        rig.sent.clear();
        assert_eq!(
            rig.commanded(plc(1), Order::Reset).0,
            Outcome::Confirmed,
            "{}",
            way.id
        );
        rig.pass(SECOND * 3);
        let words = rig.written(way.at).len();
        for _ in 0..5 {
            assert_eq!(
                rig.commanded(plc(1), Order::Reset).1,
                Reason::Unchanged,
                "{}",
                way.id
            );
            rig.pass(SECOND / 2);
        }
        assert_eq!(rig.written(way.at).len(), words, "{}", way.id);
    }
}

#[test]
fn a_controller_that_holds_its_order_to_reset_resets_once() {
    for way in WAYS.iter().filter(|way| way.shows_trips) {
        let mut rig = tripped(way, 1);
        // The client that started the motor is no longer its owner.
        rig.pass(SECOND * 5);
        assert_eq!(
            rig.commanded(plc(1), Order::Reset),
            (Outcome::Confirmed, Reason::None),
            "{}",
            way.id
        );
        for _ in 0..5 {
            rig.commanded(plc(1), Order::Reset);
            rig.pass(SECOND);
        }
        trip(&mut rig);
        rig.sent.clear();
        for _ in 0..5 {
            assert_eq!(
                rig.commanded(plc(1), Order::Reset),
                (Outcome::Acknowledged, Reason::Unchanged),
                "{}",
                way.id
            );
            rig.pass(SECOND);
        }
        assert!(
            is_tripped(&rig) && rig.writes().is_empty(),
            "{}: {:02X?}",
            way.id,
            rig.writes()
        );
        // A reset word that was withdrawn, or not repeated for the length of a lease, resets again; so does that of
        // another client.
        for (by, over) in [
            (1, Some(Order::EndReset)),
            (1, Some(STOP)),
            (2, None),
            (1, None),
        ] {
            match over {
                Some(order) => drop(rig.commanded(plc(by), order)),
                None => rig.pass(SECOND * 3),
            }
            assert_eq!(
                rig.commanded(plc(by), Order::Reset),
                (Outcome::Confirmed, Reason::None),
                "{}",
                way.id
            );
            rig.pass(SECOND * 5);
            assert!(!is_tripped(&rig), "{}", way.id);
            trip(&mut rig);
            rig.pass(SECOND * 4);
        }
    }
}

/// What the journal would pass to the next start.
fn remembered(rig: &Rig) -> RememberedDrive {
    let mut memory = RememberedDrive::default();
    rig.entries()
        .into_iter()
        .for_each(|entry| memory.take(entry));
    memory
}

/// A tripped drive whose gateway has a journal.
fn kept(way: &Way) -> Rig {
    let options = options_of(&model(way.id), accepting());
    let mut rig = Rig::new(&RigOptions {
        keeps: true,
        poll: SECOND / 5,
        ..options
    });
    rig.commanded(MQTT, run(Direction::Forward, Some(3000)));
    rig.live(SECOND * 3);
    trip(&mut rig);
    rig.live(SECOND * 4);
    rig.sent.clear();
    rig
}

fn takes_it_back(way: &Way) -> bool {
    way.words.last() == Some(&way.stop)
}

#[test]
fn the_next_life_takes_back_the_word_that_resets_wherever_the_last_one_was_killed() {
    for way in WAYS {
        for count in 1..=way.words.len() {
            let mut rig = kept(way);
            reset_up_to(&mut rig, way, count);
            let memory = remembered(&rig);
            assert!(memory.reset, "{}: kept before it is written", way.id);
            let stands = reads(&mut rig, way.at);
            rig.restart(memory);
            rig.pass(SECOND * 10);
            let taken_back = rig.written(way.at);
            if !takes_it_back(way) {
                assert_eq!(taken_back, [0; 0], "{}: it leaves no word standing", way.id);
                continue;
            }
            assert!(
                taken_back.iter().all(|word| *word == way.stop),
                "{} {count}: {taken_back:02X?}",
                way.id
            );
            let may_stand = way.words[count - 1] == way.reset;
            // A drive that restarts with its reset has forgotten the word; one that shows it is read first.
            let shown = reads(&mut rig, way.at);
            assert!(
                !may_stand || shown.is_some() || !taken_back.is_empty(),
                "{} {count}",
                way.id
            );
            if stands.is_some_and(|word| word != way.reset) {
                assert_eq!(
                    taken_back, [0; 0],
                    "{} {count}: it shows that there is nothing to take back",
                    way.id
                );
            }
            assert_ne!(shown, Some(way.reset), "{} {count}", way.id);
            assert!(
                taken_back.len() <= 1,
                "{} {count}: {taken_back:02X?}",
                way.id
            );
            assert_eq!(rig.output(1), 0, "{}", way.id);
            keeps_the_rules(&rig, way);
            let said = rig
                .entries()
                .into_iter()
                .filter(|it| matches!(it, JournalEntry::ResetWord { may_stand: false }));
            assert_eq!(said.count(), 1, "{} {count}: and that is kept", way.id);
        }
    }
}

#[test]
fn a_reset_that_an_unplugged_line_has_cut_off_is_taken_back_when_that_is_back() {
    for way in WAYS.iter().filter(|way| takes_it_back(way)) {
        let mut rig = kept(way);
        reset_up_to(&mut rig, way, 2);
        rig.core
            .handle(rig.now, LineInput::PortDown(LineFault::Gone));
        rig.settle();
        rig.pass(SECOND);
        rig.sent.clear();
        rig.core
            .handle(rig.now, LineInput::PortUp(PortKind::Serial));
        rig.settle();
        rig.pass(SECOND * 15);
        // A drive that restarts with its reset has forgotten the word; if it shows that, it is not written to.
        let is_shown = reads(&mut rig, way.at).is_some();
        assert_eq!(
            rig.written(way.at),
            if is_shown { vec![] } else { vec![way.stop] },
            "{}",
            way.id
        );
        assert!(!remembered(&rig).reset, "{}", way.id);
        keeps_the_rules(&rig, way);
    }
}

#[test]
fn a_reset_waits_for_the_row_that_remembers_its_word_but_not_for_long() {
    for way in WAYS {
        for is_kept in [true, false] {
            let mut rig = kept(way);
            rig.all_is_kept();
            rig.notes.clear();
            rig.command(MQTT, 0, Order::Reset);
            rig.pass(Duration::from_millis(12));
            assert_eq!(rig.written(way.at), [0; 0], "{}", way.id);
            if is_kept {
                rig.all_is_kept();
            }
            rig.pass(SECOND * 5);
            assert_eq!(rig.written(way.at), way.words, "{}", way.id);
            let is_slow = rig
                .notes
                .iter()
                .any(|(_, note)| *note == DriveNote::JournalSlow);
            assert_eq!(is_slow, !is_kept, "{}: {:?}", way.id, rig.notes);
        }
    }
}

#[test]
fn a_motor_that_turns_by_others_after_that_is_left_alone_until_it_stands_still() {
    for way in WAYS.iter().filter(|way| takes_it_back(way)) {
        let mut rig = kept(way);
        reset_up_to(&mut rig, way, 2);
        let memory = remembered(&rig);
        let now = rig.now;
        let drive = rig.bus.drive_mut(Station(1)).unwrap();
        drive.set_powered(now, false);
        drive.set_powered(now, true);
        rig.pass(SECOND * 3);
        let model = model(way.id);
        let word = model.run.as_ref().unwrap().forward.value;
        for (address, word) in [(way.at, way.stop), (way.at, way.reset), (way.at, way.stop)] {
            send(&mut rig, address, word);
        }
        rig.pass(SECOND * 3);
        let frequency = crate::support::families::address_of(
            &model,
            vfd_gateway::profile::model::RegisterRole::FrequencyCommand,
        );
        send(&mut rig, frequency, 2000);
        send(&mut rig, way.at, word);
        rig.pass(SECOND * 3);
        assert!(rig.output(1) > 0, "{}: it runs", way.id);
        rig.restart(RememberedDrive {
            lease: None,
            ..memory
        });
        rig.pass(SECOND * 10);
        assert_eq!(
            (rig.written(way.at), rig.output(1) > 0),
            (vec![], true),
            "{}",
            way.id
        );
    }
}

#[test]
fn a_reset_that_is_over_leaves_nothing_to_take_back() {
    let nothing_is_left = |rig: &Rig, way: &Way| {
        assert!(!remembered(rig).reset, "{}", way.id);
        assert!(
            !rig.notes
                .iter()
                .any(|(_, note)| *note == DriveNote::ResetTakenBack),
            "{}: {:?}",
            way.id,
            rig.notes
        );
    };
    for way in WAYS {
        let mut rig = kept(way);
        rig.commanded(MQTT, Order::Reset);
        rig.pass(SECOND);
        nothing_is_left(&rig, way);
        // Nor does one that a stop cuts off, once that is acknowledged.
        let mut rig = kept(way);
        reset_up_to(&mut rig, way, way.words.len().min(2));
        rig.commanded(plc(1), STOP);
        rig.pass(SECOND * 5);
        nothing_is_left(&rig, way);
    }
}

/// What the drive shows in a register, if that can be read.
fn reads(rig: &mut Rig, address: u16) -> Option<u16> {
    let now = rig.now;
    let pdu = [vec![3], address.to_be_bytes().to_vec(), vec![0, 1]].concat();
    let mut reply = Vec::new();
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .answer(now, &pdu, 0, &mut reply);
    (reply.first() == Some(&3)).then(|| u16::from_be_bytes([reply[2], reply[3]]))
}

/// Another master writes a word.
fn send(rig: &mut Rig, address: u16, word: u16) {
    let now = rig.now;
    let pdu = crate::support::families::single(address, word);
    rig.bus
        .drive_mut(Station(1))
        .unwrap()
        .answer(now, &pdu, 0, &mut Vec::new());
}
