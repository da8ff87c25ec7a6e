//! A setpoint of two words: written and read back as one pair in one frame, never by half.

use crate::support::families::{ready, refused, write};
use crate::support::{MQTT, STOP, run, setpoint};
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::native::NativeOutcome;
use vfd_gateway::profile::check;
use vfd_gateway::profile::model::Model;

const SECOND: Duration = Duration::from_secs(1);
const PAIRS: &str = include_str!("../golden/models/pairs.toml");
const SETPOINT: u16 = 0x2004;
/// 30 Hz in steps of 1/10000.
const THIRTY: [u16; 2] = [4, 0x93E0];

fn with(from: &str, to: &str) -> Arc<Model> {
    assert!(PAIRS.contains(from), "{from}");
    Arc::new(check::model(&PAIRS.replacen(from, to, 1)).unwrap_or_else(|problems| panic!("{problems:?}")))
}

fn pairs() -> Arc<Model> {
    with("", "")
}

/// The PDU that writes both words.
fn block([first, second]: [u16; 2]) -> Vec<u8> {
    let words = [SETPOINT, 2].into_iter().flat_map(u16::to_be_bytes);
    let values = [first, second].into_iter().flat_map(u16::to_be_bytes);
    [0x10].into_iter().chain(words).chain([4]).chain(values).collect()
}

#[test]
fn both_words_go_out_and_are_read_back_in_one_frame() {
    let swapped = with("word_order = \"high-first\"", "word_order = \"low-first\"");
    for (model, words) in [(pairs(), THIRTY), (swapped, [THIRTY[1], THIRTY[0]])] {
        let mut rig = ready(&model);
        assert_eq!(rig.commanded(MQTT, setpoint(3000)), (Outcome::Confirmed, Reason::None));
        assert_eq!(rig.writes(), [block(words)]);
        let is_read_back = |pdu: &[u8]| pdu == [3, 0x20, 0x04, 0, 2];
        assert!(rig.sent.iter().any(|sent| is_read_back(&sent.pdu)), "both words in one read");
        let half = rig.sent.iter().filter(|sent| sent.pdu[0] == 3 && sent.pdu[1..3] == [0x20, 0x04]);
        assert!(half.into_iter().all(|sent| is_read_back(&sent.pdu)));
        // RUN alone cannot check a pair, so that the setpoint goes with it.
        rig.sent.clear();
        assert_eq!(rig.commanded(MQTT, run(Direction::Forward, None)), (Outcome::Confirmed, Reason::None));
        assert_eq!(rig.writes(), [block(words), vec![6, 0x20, 0, 0, 1]]);
        rig.live(SECOND * 15);
        assert_eq!(rig.output(1), 3000);
        rig.sent.clear();
        assert_eq!(rig.commanded(MQTT, STOP), (Outcome::Confirmed, Reason::None));
        assert_eq!(rig.writes(), [vec![6, 0x20, 0, 0, 0]]);
    }
}

#[test]
fn limits_hold_for_a_pair() {
    let mut rig = ready(&pairs());
    assert_eq!(rig.commanded(MQTT, setpoint(6500)), (Outcome::Refused, Reason::OutsideLimits));
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
}

#[test]
fn an_unanswered_pair_is_read_and_not_sent_again() {
    let mut rig = ready(&pairs());
    rig.swallows = Some(block(THIRTY));
    let (outcome, _) = rig.commanded(MQTT, setpoint(3000));
    assert_eq!(outcome, Outcome::Failed, "the drive shows that it holds another pair");
    assert_eq!(rig.writes(), [block(THIRTY)]);
    rig.swallows = None;
    assert_eq!(rig.commanded(MQTT, setpoint(3000)), (Outcome::Confirmed, Reason::None));
}

#[test]
fn half_a_pair_is_never_written() {
    let mut rig = ready(&pairs());
    for (address, values, reason) in [
        (SETPOINT, &THIRTY[..1], Reason::NotUnderstood),
        (SETPOINT + 1, &THIRTY[1..], Reason::NotListed),
        (SETPOINT + 1, &[0, 0][..], Reason::NotListed),
        (SETPOINT, &[9, 0xEB10][..], Reason::OutsideLimits),
    ] {
        assert_eq!(write(&mut rig, address, values), refused(reason), "{address:04X} {values:?}");
    }
    assert_eq!(rig.writes(), Vec::<Vec<u8>>::new());
    assert_eq!(write(&mut rig, SETPOINT, &THIRTY), NativeOutcome::Written);
    assert_eq!(rig.writes(), [block(THIRTY)]);
}
