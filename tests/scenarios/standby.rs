//! Two gateways on one line: one sends, the other listens, and takes over what the first one leaves behind.

use crate::support::pair::{Pair, Sent, sealed};
use crate::support::{MQTT, ORIGIN, RigOptions, STOP, control, plc, run};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::control::{ControlSettings, FailSafe};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::{NativeOutcome, NativeRefusal};
use vfd_gateway::domain::standby::{LineRole, OnGatewayLost};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::drive::snapshot::DrivePresence;
use vfd_gateway::drive::view::RunState;
use vfd_gateway::gateway::{DriveNote, LineInput, LineNote};
use vfd_gateway::line::standby::{RANK_STEP, StandbyChange};
use vfd_gateway::sim::FaultPlan;
use vfd_gateway::wire::signal::{STATION, Signal, SignalKind};

const ONE: Station = Station(1);
const SECOND: Duration = Duration::from_secs(1);
const RUN: u16 = 0x0002;
/// The longest time from the last frame of one gateway to the first STOP of the other: its silence with its rank, and the
/// frames of a line of one drive.
const BOUND: Duration = Duration::from_millis(2500 + 500 + 500);

fn options(action: OnGatewayLost) -> RigOptions {
    let settings = ControlSettings {
        on_gateway_lost: Some(action),
        ..control()
    };
    RigOptions {
        control: Some(settings),
        ..RigOptions::controlled()
    }
}

/// A drive that runs at 30 Hz by an order through the first gateway.
fn running(action: OnGatewayLost) -> Pair {
    running_with(&options(action))
}

fn running_with(options: &RigOptions) -> Pair {
    let mut pair = Pair::running(options);
    let ticket = pair.command(0, MQTT, 0, run(Direction::Forward, Some(3000)));
    for _ in 0..12 {
        pair.tell(0, LineInput::PathAlive(MQTT.owner));
        pair.pass(SECOND);
    }
    assert_eq!(
        pair.told(0, ticket),
        Some((Outcome::Acknowledged, Reason::None))
    );
    assert_eq!(pair.output(1), 3000);
    pair
}

/// The values that `half` wrote to the run command since `from`.
fn run_words(pair: &Pair, half: usize, from: MonoTime) -> Vec<u16> {
    let writes = |sent: &&Sent| {
        sent.half == half
            && sent.at >= from
            && sent.pdu[0] == 6
            && sent.pdu[1..3] == RUN.to_be_bytes()
    };
    pair.sent
        .iter()
        .filter(writes)
        .map(|sent| u16::from_be_bytes([sent.pdu[3], sent.pdu[4]]))
        .collect()
}

/// Whether `half` sent anything but the answers of a listener.
fn sends(pair: &Pair, half: usize, from: MonoTime) -> bool {
    pair.sent
        .iter()
        .any(|sent| sent.half == half && sent.at >= from && !sent.is_of_listener())
}

#[test]
fn of_two_that_start_at_once_exactly_one_sends() {
    let mut pair = Pair::new(2, &options(OnGatewayLost::Stop));
    pair.start(0);
    pair.start(1);
    pair.pass(Duration::from_millis(2400));
    assert!(pair.sent.is_empty(), "everyone listens first");
    pair.pass(SECOND * 20);
    assert_eq!(
        [pair.role(0), pair.role(1)],
        [LineRole::Active, LineRole::Listening]
    );
    assert!(!sends(&pair, 1, MonoTime::ZERO));
    // The active one alone has nothing to say for long.
    let gaps = pair
        .sent
        .windows(2)
        .map(|two| two[1].at.since(two[0].end))
        .max()
        .unwrap();
    assert!(gaps <= Duration::from_millis(510), "{gaps:?}");
}

#[test]
fn an_active_gateway_without_polls_sends_every_half_second() {
    let mut pair = Pair::running(&RigOptions {
        poll: SECOND * 3600,
        ..options(OnGatewayLost::Stop)
    });
    let begin = pair.now;
    pair.pass(SECOND * 60);
    let sent: Vec<_> = pair.sent.iter().filter(|sent| sent.at > begin).collect();
    assert!((115..=123).contains(&sent.len()), "{}", sent.len());
    let signals = sent
        .iter()
        .filter(|sent| Signal::decode(STATION, &sent.pdu).is_some())
        .count();
    assert!(
        signals >= 110,
        "no drive is asked for that: {signals} of {}",
        sent.len()
    );
    assert!(!sends(&pair, 1, begin));
}

#[test]
fn a_listener_knows_what_the_drive_does_and_takes_no_commands() {
    let mut pair = running(OnGatewayLost::Stop);
    let [own, heard] = [pair.view(0, 0), pair.view(1, 0)];
    for view in [own, heard] {
        assert_eq!(
            (view.run_state, view.snapshot.presence),
            (RunState::Forward, DrivePresence::Online)
        );
    }
    let ticket = pair.command(1, plc(1), 0, run(Direction::Forward, Some(2000)));
    pair.pass(SECOND);
    assert_eq!(
        pair.told(1, ticket),
        Some((Outcome::Refused, Reason::Standby))
    );
    // Memory answers reads by the number of orders that its own clients gave.
    assert_eq!(pair.view(1, 0).orders.taken, 1);
    pair.read(1, 0, 0x0201, 1);
    let answer = pair.halves[1].answers.pop().unwrap();
    assert_eq!(
        answer.outcome,
        NativeOutcome::Refused(NativeRefusal::Standby)
    );
    assert!(!sends(&pair, 1, MonoTime::ZERO));
    assert_eq!(pair.output(1), 3000);
    // The first one sends as before, and nothing of what it sends is for the listener.
    assert_eq!(pair.core(0).report().standby.unwrap().given_up, 0);
}

#[test]
fn when_the_active_one_is_killed_the_other_does_what_is_declared() {
    for (action, words) in [
        (OnGatewayLost::Stop, &[0][..]),
        (OnGatewayLost::Coast, &[3]),
        (OnGatewayLost::Hold, &[]),
        (OnGatewayLost::Adopt, &[]),
    ] {
        let mut pair = running(action);
        pair.kill(0);
        let killed = pair.now;
        let stops = !words.is_empty();
        if stops {
            let took = pair
                .until(SECOND * 10, |pair| !run_words(pair, 1, killed).is_empty())
                .unwrap();
            assert!(took <= BOUND, "{action:?}: {took:?}");
        }
        pair.pass(Duration::from_millis(5500));
        assert_eq!(pair.role(1), LineRole::Active);
        let mut sent = run_words(&pair, 1, killed);
        sent.dedup();
        assert_eq!(sent, words, "{action:?}");
        assert_eq!(pair.output(1) == 3000, !stops, "{action:?}");
        let notes: Vec<_> = pair.halves[1].notes.iter().map(|(_, note)| *note).collect();
        let expected = match action {
            OnGatewayLost::Stop => DriveNote::GatewayLost(FailSafe::Stop),
            OnGatewayLost::Coast => DriveNote::GatewayLost(FailSafe::Coast),
            OnGatewayLost::Hold => DriveNote::GatewayLost(FailSafe::Hold),
            OnGatewayLost::Adopt => DriveNote::Adopted,
        };
        assert!(notes.contains(&expected), "{action:?}: {notes:?}");
        let silence = pair.halves[1]
            .line_notes
            .iter()
            .find_map(|(_, note)| match note {
                LineNote::TakenOver { silent_for } => *silent_for,
                _ => None,
            });
        assert!(
            silence.is_some_and(|time| (2..5).contains(&time.as_secs())),
            "{action:?}: {silence:?}"
        );
    }
}

#[test]
fn an_adopted_drive_stops_like_one_whose_client_is_lost_unless_its_client_comes_back() {
    for comes_back in [false, true] {
        let mut pair = running(OnGatewayLost::Adopt);
        pair.kill(0);
        pair.pass(Duration::from_millis(4500));
        assert_eq!(pair.role(1), LineRole::Active);
        let killed = pair.now;
        for _ in 0..10 {
            if comes_back {
                pair.command(1, ORIGIN, 0, run(Direction::Forward, Some(3000)));
            }
            pair.pass(SECOND);
        }
        assert_eq!(pair.output(1) == 3000, comes_back);
        let words = run_words(&pair, 1, killed);
        assert_eq!(words.contains(&0), !comes_back, "{words:?}");
        assert!(
            comes_back || !words.contains(&1),
            "nothing starts by itself: {words:?}"
        );
    }
}

#[test]
fn an_adopted_drive_that_is_silent_at_first_stops_as_well() {
    for silent in [Duration::from_millis(1500), SECOND * 6, SECOND * 25] {
        let mut pair = running(OnGatewayLost::Adopt);
        pair.kill(0);
        let killed = pair.now;
        pair.until(SECOND * 5, |pair| pair.role(1) == LineRole::Active)
            .expect("the line is taken over");
        pair.is_cut = true;
        pair.pass(silent);
        pair.is_cut = false;
        pair.pass(SECOND * 45);
        let words = run_words(&pair, 1, killed);
        assert!(
            words.contains(&0) && !words.contains(&1),
            "{silent:?}: {words:?}"
        );
        assert_eq!(pair.output(1), 0, "{silent:?}");
    }
}

#[test]
fn a_drive_that_stands_still_is_left_alone() {
    for action in OnGatewayLost::ALL {
        let mut pair = Pair::running(&options(action));
        pair.kill(0);
        let killed = pair.now;
        pair.pass(SECOND * 10);
        assert_eq!(pair.role(1), LineRole::Active);
        assert!(run_words(&pair, 1, killed).is_empty(), "{action:?}");
        let ticket = pair.command(1, ORIGIN, 0, STOP);
        pair.pass(SECOND * 2);
        assert!(matches!(
            pair.told(1, ticket),
            Some((Outcome::Confirmed | Outcome::Acknowledged, _))
        ));
    }
}

/// The lines of a reload or a removal are not held up by drives that another gateway runs.
#[test]
fn a_drive_that_another_gateway_runs_is_not_in_use_here() {
    let mut pair = running(OnGatewayLost::Hold);
    assert_eq!([0, 1].map(|half| pair.core(half).in_use().count()), [1, 0]);
    pair.tell(1, LineInput::Leave { stops: true });
    assert_eq!(pair.core(1).bound().count(), 0);
    // Shorter than the lease of its client.
    pair.pass(SECOND);
    assert_eq!(
        (sends(&pair, 1, MonoTime::ZERO), pair.output(1)),
        (false, 3000)
    );
}

#[test]
fn sharing_a_line_costs_a_signal_every_four_seconds_while_drives_are_polled() {
    let frames = |is_shared: bool| {
        let mut pair = Pair::new(2, &options(OnGatewayLost::Stop));
        if !is_shared {
            pair.halves[0].setup.standby = None;
        }
        pair.start(0);
        pair.pass(SECOND * 10);
        if is_shared {
            pair.start(1);
        }
        let begin = pair.sent.len();
        pair.pass(SECOND * 60);
        assert!(!sends(&pair, 1, MonoTime::ZERO));
        pair.sent.len() - begin
    };
    let [alone, shared] = [false, true].map(frames);
    assert!(alone.abs_diff(shared) <= 15 + 3, "{alone} {shared}");
}

#[test]
fn a_stop_that_was_heard_without_effect_is_repeated() {
    let mut pair = running(OnGatewayLost::Hold);
    pair.command(0, MQTT, 0, STOP);
    let sent = pair.until(SECOND, |pair| {
        run_words(pair, 0, MonoTime::ZERO).contains(&0)
    });
    assert!(sent.is_some());
    pair.pass(Duration::from_millis(12));
    pair.kill(0);
    let killed = pair.now;
    let took = pair.until(SECOND * 10, |pair| run_words(pair, 1, killed).contains(&0));
    assert!(took.is_some_and(|took| took <= BOUND), "{took:?}");
}

#[test]
fn a_stop_while_nobody_is_active_waits_and_is_sent_first() {
    let mut pair = running(OnGatewayLost::Hold);
    pair.kill(0);
    let killed = pair.now;
    pair.pass(Duration::from_millis(1800));
    let ticket = pair.command(1, plc(1), 0, STOP);
    assert_eq!(
        pair.told(1, ticket),
        None,
        "it is not refused: the other one is not heard any more"
    );
    let took = pair
        .until(SECOND * 10, |pair| run_words(pair, 1, killed).contains(&0))
        .unwrap();
    assert!(took <= BOUND, "{took:?}");
    pair.pass(SECOND * 15);
    assert!(matches!(
        pair.told(1, ticket),
        Some((Outcome::Acknowledged | Outcome::Confirmed, Reason::None))
    ));
    assert_eq!(pair.output(1), 0);
}

#[test]
fn a_gateway_that_was_suspended_listens_before_it_sends() {
    for at_port in [false, true] {
        for length in [
            Duration::from_millis(1200),
            SECOND * 2,
            SECOND * 4,
            SECOND * 30,
        ] {
            let mut pair = running(OnGatewayLost::Stop);
            if at_port {
                pair.halves[0].stalls_at_port = true;
                assert!(
                    pair.until(SECOND, |pair| pair.halves[0].is_suspended)
                        .is_some()
                );
            } else {
                pair.halves[0].is_suspended = true;
            }
            pair.pass(length);
            let resumed = pair.now;
            pair.resume(0);
            pair.pass(SECOND * 10);
            let took_over = length > SECOND * 3;
            let roles = [pair.role(0), pair.role(1)];
            assert_eq!(
                roles
                    .iter()
                    .filter(|role| **role == LineRole::Active)
                    .count(),
                1,
                "{length:?} {at_port}"
            );
            if took_over {
                let own: Vec<_> = pair
                    .sent
                    .iter()
                    .filter(|sent| sent.half == 0 && sent.at >= resumed && !sent.is_of_listener())
                    .collect();
                let early = own
                    .iter()
                    .filter(|sent| sent.at < resumed + SECOND * 2)
                    .count();
                assert!(
                    early <= usize::from(at_port),
                    "{length:?} {at_port}: {early}"
                );
                let ran = run_words(&pair, 0, resumed);
                assert!(!ran.contains(&1), "nothing is started: {ran:?}");
                assert_eq!(pair.output(1), 0, "the drive was stopped meanwhile");
            }
        }
    }
}

#[test]
fn a_gateway_whose_port_goes_and_comes_back_listens_first() {
    let mut pair = running(OnGatewayLost::Stop);
    pair.unplug(0);
    let unplugged = pair.now;
    let took = pair
        .until(SECOND * 10, |pair| {
            run_words(pair, 1, unplugged).contains(&0)
        })
        .unwrap();
    assert!(took <= BOUND, "{took:?}");
    pair.open(0);
    let back = pair.now;
    pair.pass(SECOND * 20);
    assert_eq!(
        [pair.role(0), pair.role(1)],
        [LineRole::Listening, LineRole::Active]
    );
    assert!(!sends(&pair, 0, back));
    assert_eq!(pair.output(1), 0);
}

/// Its port comes back, and no other gateway has taken the line over: what it ordered itself counts as seen.
#[test]
fn a_gateway_that_is_alone_does_what_is_declared_once_its_port_is_back() {
    let mut pair = running(OnGatewayLost::Stop);
    pair.kill(1);
    pair.unplug(0);
    pair.pass(SECOND * 5);
    let back = pair.now;
    pair.open(0);
    pair.pass(SECOND * 15);
    assert_eq!(pair.role(0), LineRole::Active);
    assert_eq!(run_words(&pair, 0, back).first(), Some(&0));
    assert_eq!(pair.output(1), 0);
}

#[test]
fn another_master_ends_the_role_at_once() {
    let mut pair = running_with(&RigOptions {
        poll: SECOND * 3,
        ..options(OnGatewayLost::Stop)
    });
    // Between two polls.
    let polled = pair.sent.len();
    pair.until(SECOND, |pair| pair.sent.len() > polled);
    pair.pass(Duration::from_millis(50));
    let request = sealed(&[0x09, 0x03, 0x00, 0x01, 0x00, 0x01]);
    let now = pair.now;
    pair.bus.speak(now, &request);
    pair.pass(Duration::from_millis(200));
    assert_eq!(pair.role(0), LineRole::Listening);
    let rivals = pair.halves[0]
        .line_notes
        .iter()
        .filter(|(_, note)| matches!(note, LineNote::Rival { .. }));
    let text = rivals.map(|(_, note)| note.to_string()).next().unwrap();
    assert!(
        text.contains("rival_on_line, another master sent 09 03 00 01 00 01"),
        "{text}"
    );
    pair.pass(SECOND * 10);
    let active = [0, 1]
        .into_iter()
        .filter(|half| pair.role(*half) == LineRole::Active)
        .count();
    assert_eq!(active, 1, "the line is taken again");
}

#[test]
fn a_listener_hears_frames_that_its_adapter_delivers_in_pieces() {
    for hole in [5, 16, 30] {
        let mut pair = Pair::running(&RigOptions {
            poll: SECOND * 2,
            ..options(OnGatewayLost::Stop)
        });
        pair.halves[1].hole = Duration::from_millis(hole);
        let ticket = pair.command(0, MQTT, 0, run(Direction::Forward, Some(3000)));
        pair.pass(SECOND * 3);
        assert_eq!(
            pair.told(0, ticket),
            Some((Outcome::Acknowledged, Reason::None))
        );
        assert_eq!(
            pair.view(1, 0).run_state,
            RunState::Forward,
            "{hole} ms: the order was heard"
        );
        for _ in 0..50 {
            pair.pass(Duration::from_millis(430));
            assert_eq!(pair.role(1), LineRole::Listening, "{hole} ms");
            assert!(
                pair.core(1).report().standby.unwrap().hears_other,
                "{hole} ms"
            );
        }
    }
}

/// They ask the same drive the same questions at the same moments, as after a cut pair of wires was repaired.
#[test]
fn two_active_ones_whose_requests_are_equal_are_no_echo_of_each_other() {
    let mut pair = Pair::new(2, &options(OnGatewayLost::Stop));
    pair.is_cut = true;
    pair.start(0);
    pair.start(1);
    // Before the one that hears no drive leaves the line.
    let are_active =
        |pair: &Pair| [pair.role(0), pair.role(1)] == [LineRole::Active, LineRole::Active];
    pair.until(SECOND * 20, are_active)
        .expect("each is master of its own part");
    pair.pass(SECOND);
    pair.is_cut = false;
    let active = |pair: &Pair| {
        [0, 1]
            .into_iter()
            .filter(|half| pair.role(*half) == LineRole::Active)
            .count()
    };
    let took = pair.until(SECOND * 10, |pair| active(pair) < 2).unwrap();
    assert!(took <= SECOND, "{took:?}");
    pair.pass(SECOND * 10);
    assert_eq!(active(&pair), 1);
    // Answers to the other one are no sign of a drive that is late: the next stop is acknowledged.
    let half = usize::from(pair.role(1) == LineRole::Active);
    let ticket = pair.command(half, plc(1), 0, STOP);
    pair.pass(SECOND * 2);
    assert!(matches!(
        pair.told(half, ticket),
        Some((Outcome::Acknowledged | Outcome::Confirmed, _))
    ));
}

#[test]
fn the_third_gateway_takes_over_when_both_others_are_gone() {
    let mut pair = Pair::new(3, &options(OnGatewayLost::Stop));
    (0..3).for_each(|half| pair.start(half));
    pair.pass(SECOND * 10);
    pair.kill(0);
    pair.pass(SECOND * 10);
    assert_eq!(pair.role(1), LineRole::Active);
    pair.kill(1);
    let killed = pair.now;
    let took = pair
        .until(SECOND * 10, |pair| sends(pair, 2, killed))
        .unwrap();
    assert!(took <= BOUND + RANK_STEP, "{took:?}");
}

#[test]
fn a_line_that_is_handed_over_goes_on_without_a_pause_and_without_a_stop() {
    let mut pair = running(OnGatewayLost::Stop);
    let asked = pair.now;
    pair.tell(0, LineInput::Yield);
    assert!(
        pair.until(SECOND, |pair| pair.role(1) == LineRole::Active)
            .is_some()
    );
    assert_eq!(pair.role(0), LineRole::Listening);
    assert!(
        pair.halves[0]
            .line_notes
            .iter()
            .any(|(_, note)| *note == LineNote::GivenUp(StandbyChange::Yielded))
    );
    assert!(
        pair.halves[1]
            .line_notes
            .iter()
            .any(|(_, note)| *note == LineNote::HandedOver)
    );
    let told: Vec<_> = pair.halves[1].notes.iter().map(|(_, note)| *note).collect();
    assert!(
        told.contains(&DriveNote::GoesOn) && !told.contains(&DriveNote::Adopted),
        "no gateway is lost: {told:?}"
    );
    for _ in 0..10 {
        pair.command(1, ORIGIN, 0, run(Direction::Forward, Some(3000)));
        pair.pass(SECOND);
    }
    assert_eq!(
        [pair.role(0), pair.role(1)],
        [LineRole::Listening, LineRole::Active]
    );
    assert_eq!((run_words(&pair, 1, asked), pair.output(1)), (vec![], 3000));
    let since: Vec<_> = pair.sent.iter().filter(|sent| sent.at >= asked).collect();
    let gap = since
        .windows(2)
        .map(|two| two[1].at.since(two[0].end))
        .max()
        .unwrap();
    assert!(gap <= Duration::from_millis(520), "{gap:?}");
    assert_eq!(since.iter().filter(|sent| sent.is_damaged).count(), 0);
}

#[test]
fn a_handed_over_drive_whose_client_does_not_follow_stops() {
    let mut pair = running(OnGatewayLost::Hold);
    pair.tell(0, LineInput::Yield);
    pair.pass(SECOND * 15);
    assert_eq!((pair.role(1), pair.output(1)), (LineRole::Active, 0));
}

/// Whether `half` sent a signal of this `kind` since `from`.
fn signals(pair: &Pair, half: usize, kind: SignalKind, from: MonoTime) -> usize {
    let is_one =
        |sent: &&Sent| Signal::decode(STATION, &sent.pdu).is_some_and(|signal| signal.kind == kind);
    pair.sent
        .iter()
        .filter(|sent| sent.half == half && sent.at >= from)
        .filter(is_one)
        .count()
}

#[test]
fn where_no_other_gateway_takes_the_line_it_is_taken_back_and_its_drives_go_on() {
    let mut pair = running(OnGatewayLost::Stop);
    let begin = pair.now;
    pair.tell(0, LineInput::Yield);
    pair.until(SECOND * 5, |pair| {
        signals(pair, 0, SignalKind::HandOver, begin) > 0
    })
    .expect("it is handed over");
    pair.kill(1);
    pair.pass(SECOND);
    assert_eq!(pair.role(0), LineRole::Listening);
    pair.pass(SECOND * 5);
    assert_eq!((pair.role(0), pair.output(1)), (LineRole::Active, 3000));
    pair.command(0, ORIGIN, 0, run(Direction::Forward, Some(3000)));
    pair.pass(SECOND);
    assert_eq!(
        (run_words(&pair, 0, begin).contains(&0), pair.output(1)),
        (false, 3000)
    );
}

#[test]
fn a_line_is_not_handed_over_where_no_other_gateway_listens() {
    let mut pair = running(OnGatewayLost::Stop);
    pair.kill(1);
    let begin = pair.now;
    pair.tell(0, LineInput::Yield);
    for _ in 0..10 {
        pair.tell(0, LineInput::PathAlive(MQTT.owner));
        pair.pass(SECOND);
        assert_eq!(pair.role(0), LineRole::Active);
    }
    assert_eq!(signals(&pair, 0, SignalKind::HandOver, begin), 0);
    assert_eq!(
        (pair.core(0).report().standby.unwrap().kept, pair.output(1)),
        (1, 3000)
    );
}

#[test]
fn the_active_gateway_knows_whether_another_one_listens() {
    let mut pair = Pair::running(&options(OnGatewayLost::Stop));
    let known = |pair: &mut Pair| pair.core(0).report().standby.unwrap().listener;
    assert_eq!(known(&mut pair), Some(true));
    let begin = pair.now;
    pair.pass(SECOND * 120);
    assert_eq!(
        (
            known(&mut pair),
            signals(&pair, 1, SignalKind::Listening, begin)
        ),
        (Some(true), 2)
    );
    assert_eq!(
        pair.sent
            .iter()
            .filter(|sent| sent.half == 1 && sent.at >= begin)
            .count(),
        2,
        "it sends nothing else"
    );
    for lost in [true, false] {
        if lost {
            pair.kill(1);
        } else {
            pair.start(1);
        }
        pair.pass(SECOND * 65);
        assert_eq!(known(&mut pair), Some(!lost));
    }
    assert!(
        pair.halves[0]
            .line_notes
            .iter()
            .all(|(_, note)| !matches!(note, LineNote::Rival { .. }))
    );
}

#[test]
fn of_several_listeners_the_first_answers() {
    let mut pair = Pair::new(3, &options(OnGatewayLost::Stop));
    (0..3).for_each(|half| pair.start(half));
    pair.pass(SECOND * 70);
    let answers = [1, 2].map(|half| signals(&pair, half, SignalKind::Listening, MonoTime::ZERO));
    assert_eq!(answers, [2, 0]);
    assert!(pair.sent.iter().all(|sent| !sent.is_damaged));
}

#[test]
fn a_listener_that_was_suspended_gives_no_late_answer() {
    let mut pair = Pair::running(&options(OnGatewayLost::Stop));
    let asked = signals(&pair, 0, SignalKind::Question, MonoTime::ZERO);
    pair.until(SECOND * 70, |pair| {
        signals(pair, 0, SignalKind::Question, MonoTime::ZERO) > asked
    })
    .expect("it asks");
    let begin = pair.now;
    pair.halves[1].is_suspended = true;
    pair.pass(SECOND);
    pair.resume(1);
    pair.pass(Duration::from_millis(300));
    assert_eq!(signals(&pair, 1, SignalKind::Listening, begin), 0);
}

#[test]
fn one_that_was_suspended_while_it_was_active_gives_no_late_answer() {
    let mut pair = running(OnGatewayLost::Stop);
    pair.halves[0].is_suspended = true;
    pair.until(SECOND * 20, |pair| {
        signals(pair, 1, SignalKind::Question, MonoTime::ZERO) > 0
    })
    .expect("the other one asks");
    let asked = pair.now;
    pair.pass(Duration::from_millis(200));
    pair.resume(0);
    pair.pass(Duration::from_millis(150));
    assert_eq!(signals(&pair, 0, SignalKind::Listening, asked), 0);
    pair.pass(SECOND * 3);
    assert_eq!(
        pair.core(1).report().standby.unwrap().listener,
        Some(true),
        "it answers the next one"
    );
}

#[test]
fn a_stop_does_not_wait_for_the_answer_of_a_listener() {
    let mut pair = running(OnGatewayLost::Stop);
    pair.kill(1);
    let asked = signals(&pair, 0, SignalKind::Question, MonoTime::ZERO);
    pair.until(SECOND * 70, |pair| {
        signals(pair, 0, SignalKind::Question, MonoTime::ZERO) > asked
    })
    .expect("it asks");
    pair.pass(Duration::from_millis(20));
    let begin = pair.now;
    pair.command(0, MQTT, 0, STOP);
    pair.pass(Duration::from_millis(50));
    assert_eq!(run_words(&pair, 0, begin), [0]);
}

#[test]
fn a_silent_drive_is_shown_as_offline_by_the_listener_too() {
    let mut pair = Pair::running(&options(OnGatewayLost::Stop));
    pair.bus.set_powered(pair.now, ONE, false);
    pair.pass(SECOND * 10);
    for half in [0, 1] {
        assert_eq!(
            pair.view(half, 0).snapshot.presence,
            DrivePresence::Offline,
            "{half}"
        );
    }
    pair.bus.set_powered(pair.now, ONE, true);
    pair.pass(SECOND * 40);
    for half in [0, 1] {
        assert_eq!(
            pair.view(half, 0).snapshot.presence,
            DrivePresence::Online,
            "{half}"
        );
    }
    // Each has left the line to the other once: its receiver could have been dead.
    assert_eq!(
        [pair.role(0), pair.role(1)],
        [LineRole::Active, LineRole::Listening]
    );
}

/// Both take the line in the same moment, and go on in step.
#[test]
fn of_two_that_take_the_line_at_once_one_goes_on() {
    let mut pair = Pair::new(2, &options(OnGatewayLost::Stop));
    pair.start(1);
    pair.pass(RANK_STEP);
    pair.start(0);
    let is_settled = |pair: &Pair| {
        let [first, second] = [0, 1].map(|half| pair.role(half) == LineRole::Active);
        first != second && pair.sent.len() > 4
    };
    let took = pair.until(SECOND * 5, is_settled).expect("one is active");
    assert!(
        pair.sent[0].is_damaged && pair.sent[1].is_damaged,
        "they began in step"
    );
    assert!(took < SECOND * 4, "{took:?}: no second silence");
    let active = [0, 1]
        .into_iter()
        .find(|half| pair.role(*half) == LineRole::Active)
        .unwrap();
    pair.pass(SECOND * 10);
    assert_eq!(pair.role(active), LineRole::Active, "it stays so");
    let given_up = [0, 1].map(|half| pair.core(half).report().standby.unwrap().given_up);
    assert_eq!((given_up[active], given_up[1 - active]), (0, 1));
    let text = pair.halves[1 - active]
        .line_notes
        .last()
        .unwrap()
        .1
        .to_string();
    assert!(
        text.contains("rival_on_line, another gateway sent FA 03"),
        "{text}"
    );
}

#[test]
fn a_damaged_reply_after_a_take_over_does_not_cost_another_silence() {
    let mut pair = running(OnGatewayLost::Stop);
    pair.kill(0);
    let killed = pair.now;
    pair.bus.set_faults(FaultPlan {
        flip: 1000,
        ..FaultPlan::NONE
    });
    pair.until(SECOND * 5, |pair| run_words(pair, 1, killed) == [0])
        .expect("a stop is sent");
    pair.pass(Duration::from_millis(100));
    pair.bus.set_faults(FaultPlan::NONE);
    // Enough for the random wait, the repeated stop and the read that shows its effect.
    let is_known = |pair: &Pair| pair.view(1, 0).run_state == RunState::Stopping;
    let took = pair.until(SECOND * 5, is_known).expect("the drive obeys");
    assert!(took < SECOND, "{took:?}");
    assert_eq!(pair.core(1).report().standby.unwrap().given_up, 0);
}

/// A read every half second would keep it from ever being silent.
#[test]
fn a_drive_that_owes_late_replies_is_left_alone_by_the_sign_of_life() {
    let mut pair = Pair::running(&options(OnGatewayLost::Stop));
    pair.bus.set_faults(FaultPlan {
        beyond: 1000,
        ..FaultPlan::NONE
    });
    pair.pass(SECOND * 20);
    pair.bus.set_faults(FaultPlan::NONE);
    let from = pair.now;
    // Both have left the line to the other one once.
    pair.pass(SECOND * 30);
    let half = usize::from(pair.role(1) == LineRole::Active);
    pair.command(half, ORIGIN, 0, STOP);
    pair.pass(SECOND * 10);
    let ticket = pair.command(half, ORIGIN, 0, run(Direction::Forward, Some(3000)));
    pair.pass(SECOND * 2);
    assert_eq!(
        pair.told(half, ticket),
        Some((Outcome::Acknowledged, Reason::None)),
        "the stop was confirmed before"
    );
    let signals = pair
        .sent
        .iter()
        .filter(|sent| sent.at > from && Signal::decode(STATION, &sent.pdu).is_some());
    assert!(signals.count() > 3);
    assert_eq!(
        [pair.role(half), pair.role(1 - half)],
        [LineRole::Active, LineRole::Listening]
    );
}
