//! Values of two words, setpoints and parameters: written and read back as one pair in one frame, never by half.

use crate::support::families::{accepting, listing, ready, refused, rig_of, write};
use crate::support::{MQTT, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, GoOrder, Order, Outcome, Reason, RegisterWrite};
use vfd_gateway::domain::ids::Station;
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::Model;

const SECOND: Duration = Duration::from_secs(1);
const PAIRS: &str = include_str!("../golden/models/pairs.toml");
const SETPOINT: u16 = 0x2004;
/// 30 Hz in steps of 1/10000.
const THIRTY: [u16; 2] = [4, 0x93E0];
/// A stored parameter, the low word first.
const RAMP: u16 = 0x2010;
/// 1000 s in steps of 1/100.
const THOUSAND: [u16; 2] = [0x86A0, 1];

fn with(from: &str, to: &str) -> Arc<Model> {
    assert!(PAIRS.contains(from), "{from}");
    Arc::new(
        check::model(&PAIRS.replacen(from, to, 1))
            .unwrap_or_else(|problems| panic!("{problems:?}")),
    )
}

fn pairs() -> Arc<Model> {
    with("", "")
}

/// The PDU that writes both words of the setpoint.
fn block(words: [u16; 2]) -> Vec<u8> {
    block_at(SETPOINT, words)
}

fn block_at(address: u16, [first, second]: [u16; 2]) -> Vec<u8> {
    let words = [address, 2].into_iter().flat_map(u16::to_be_bytes);
    let values = [first, second].into_iter().flat_map(u16::to_be_bytes);
    [0x10]
        .into_iter()
        .chain(words)
        .chain([4])
        .chain(values)
        .collect()
}

#[test]
fn both_words_go_out_and_are_read_back_in_one_frame() {
    let swapped = with("word_order = \"high-first\"", "word_order = \"low-first\"");
    for (model, words) in [(pairs(), THIRTY), (swapped, [THIRTY[1], THIRTY[0]])] {
        let mut rig = ready(&model);
        assert_eq!(
            rig.commanded(MQTT, setpoint(3000)),
            (Outcome::Confirmed, Reason::None)
        );
        assert_eq!(rig.writes(), [block(words)]);
        let is_read_back = |pdu: &[u8]| pdu == [3, 0x20, 0x04, 0, 2];
        assert!(
            rig.sent.iter().any(|sent| is_read_back(&sent.pdu)),
            "both words in one read"
        );
        let half = rig
            .sent
            .iter()
            .filter(|sent| sent.pdu[0] == 3 && sent.pdu[1..3] == [0x20, 0x04]);
        assert!(half.into_iter().all(|sent| is_read_back(&sent.pdu)));
        // RUN alone cannot check a pair, so that the setpoint goes with it.
        rig.sent.clear();
        assert_eq!(
            rig.commanded(MQTT, run(Direction::Forward, None)),
            (Outcome::Confirmed, Reason::None)
        );
        assert_eq!(rig.writes(), [block(words), vec![6, 0x20, 0, 0, 1]]);
        rig.live(SECOND * 15);
        assert_eq!(rig.output(1), 3000);
        rig.sent.clear();
        assert_eq!(
            rig.commanded(MQTT, STOP),
            (Outcome::Confirmed, Reason::None)
        );
        assert_eq!(rig.writes(), [vec![6, 0x20, 0, 0, 0]]);
    }
}

#[test]
fn limits_hold_for_a_pair() {
    let mut rig = ready(&pairs());
    assert_eq!(
        rig.commanded(MQTT, setpoint(6500)),
        (Outcome::Refused, Reason::OutsideLimits)
    );
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
}

#[test]
fn an_unanswered_pair_is_read_and_not_sent_again() {
    let mut rig = ready(&pairs());
    rig.swallows = Some(block(THIRTY));
    let (outcome, _) = rig.commanded(MQTT, setpoint(3000));
    assert_eq!(
        outcome,
        Outcome::Failed,
        "the drive shows that it holds another pair"
    );
    assert_eq!(rig.writes(), [block(THIRTY)]);
    rig.swallows = None;
    assert_eq!(
        rig.commanded(MQTT, setpoint(3000)),
        (Outcome::Confirmed, Reason::None)
    );
}

#[test]
fn half_a_pair_is_never_written() {
    let mut rig = ready(&pairs());
    for (address, values, reason) in [
        (SETPOINT, &THIRTY[..1], Reason::HalfAValue),
        (SETPOINT + 1, &THIRTY[1..], Reason::HalfAValue),
        (SETPOINT + 1, &[0, 0][..], Reason::HalfAValue),
        (SETPOINT, &[9, 0xEB10][..], Reason::OutsideLimits),
    ] {
        assert_eq!(
            write(&mut rig, address, values),
            refused(reason),
            "{address:04X} {values:?}"
        );
    }
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    assert_eq!(write(&mut rig, SETPOINT, &THIRTY), NativeOutcome::Written);
    assert_eq!(rig.writes(), [block(THIRTY)]);
}

#[test]
fn a_parameter_of_two_words_is_written_and_read_back_as_one() {
    let mut rig = rig_of(&pairs(), listing(vec![RAMP]));
    rig.live(SECOND * 3);
    rig.sent.clear();
    assert_eq!(write(&mut rig, RAMP, &THOUSAND), NativeOutcome::Written);
    assert_eq!(rig.writes(), [block_at(RAMP, THOUSAND)]);
    rig.pass(SECOND);
    assert!(
        rig.sent
            .iter()
            .any(|sent| sent.pdu == [3, 0x20, 0x10, 0, 2]),
        "both words in one read"
    );
    let ticket = rig.read(1, 0, RAMP, 2);
    assert_eq!(
        rig.answer_to(ticket),
        NativeOutcome::Words(THOUSAND.as_slice().into())
    );
    assert_eq!(
        rig.bus
            .drive_mut(Station(1))
            .unwrap()
            .stored_writes(RAMP.into()),
        1
    );
    assert_eq!(
        write(&mut rig, RAMP, &[1, 0]),
        refused(Reason::WrittenTooOften)
    );
}

#[test]
fn half_of_a_parameter_is_refused_and_the_refusal_says_what_is_right() {
    let mut rig = rig_of(&pairs(), listing(vec![RAMP, RAMP + 1]));
    rig.live(SECOND * 3);
    rig.sent.clear();
    for (address, values) in [
        (RAMP, &THOUSAND[..1]),
        (RAMP + 1, &THOUSAND[1..]),
        (RAMP + 1, &[0, 0][..]),
    ] {
        assert_eq!(
            write(&mut rig, address, values),
            refused(Reason::HalfAValue),
            "{address:04X} {values:?}"
        );
    }
    let half = Order::Go(GoOrder::new(vec![RegisterWrite::new(RAMP, 1)], None, None).unwrap());
    assert_eq!(
        rig.commanded(MQTT, half),
        (Outcome::Refused, Reason::HalfAValue)
    );
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    let mut rig = rig_of(&pairs(), accepting());
    assert_eq!(write(&mut rig, RAMP, &THOUSAND), refused(Reason::NotListed));
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
}

#[test]
fn a_parameter_whose_write_is_not_answered_is_read_and_not_sent_again() {
    let mut rig = rig_of(&pairs(), listing(vec![RAMP]));
    rig.live(SECOND * 3);
    rig.sent.clear();
    rig.swallows = Some(block_at(RAMP, THOUSAND));
    let whole =
        Order::Go(GoOrder::new(vec![RegisterWrite::pair(RAMP, THOUSAND)], None, None).unwrap());
    assert_eq!(
        rig.commanded(MQTT, whole).0,
        Outcome::Failed,
        "the drive shows that it holds another pair"
    );
    assert_eq!(rig.writes(), [block_at(RAMP, THOUSAND)]);
}
