//! What happens to a write behind the guard's door, with a control section that only tests have.

use super::*;
use crate::domain::command::{Manner, Origin, Owner, Rights};
use crate::domain::ids::{AskerId, DriveIndex, Station, Ticket};
use crate::domain::link::LinkSettings;
use crate::domain::native::{NativeAnswer, NativeAsk, NativeOutcome, NativeRequest};
use crate::domain::time::MonoTime;
use crate::guard::Control;
use crate::line::timing::Timing;
use crate::profile::check;
use crate::vendors;
use crate::wire::rtu;
use std::sync::Arc;
use std::time::Duration;

const RUN: u16 = 0x0002;
const ORIGIN: Origin = Origin { owner: Owner::Mqtt, rights: Rights { write: true, stop: true }, manner: Manner::Once };

/// A line with one drive that may be written to, and the time.
struct Line {
    core: LineCore,
    now: MonoTime,
    sent: Vec<Vec<u8>>,
    answers: Vec<NativeAnswer>,
}

impl Line {
    fn new() -> Self {
        let (_, text) = vendors::texts().first().unwrap();
        let drive = DriveSetup {
            station: Station(1),
            model: Arc::new(check::model(text).unwrap()),
            poll: Duration::from_secs(3600),
            reply_timeout: Duration::from_millis(200),
            max_lateness: Duration::from_millis(500),
            control: Control::Anything,
        };
        let timing = Timing::for_models(LinkSettings::DEFAULT, [4.5], Duration::ZERO);
        let now = MonoTime::from_millis(1);
        let core = LineCore::new(LineSetup { timing, drives: vec![drive], tells_traffic: false }, now);
        let mut line = Self { core, now, sent: Vec::new(), answers: Vec::new() };
        line.core.handle(now, Input::PortUp);
        // The first polls are answered by echoing back as many zeros as were asked for.
        while line.pass(Duration::from_millis(20)) {
            let words = usize::from(line.sent.pop().unwrap()[5]);
            line.receive(&[&[3, 2 * words as u8][..], &vec![0; 2 * words]].concat());
        }
        line
    }

    fn write(&mut self, ticket: u64, address: u16, value: u16) {
        let request = NativeRequest {
            asker: AskerId(1),
            ticket: Ticket(ticket),
            drive: DriveIndex(0),
            origin: ORIGIN,
            ask: NativeAsk::Write { address, values: vec![value] },
            deadline: self.now + Duration::from_secs(1),
        };
        self.core.handle(self.now, Input::Native(request));
    }

    fn receive(&mut self, pdu: &[u8]) {
        let mut frame = Vec::new();
        rtu::encode(&mut frame, 1, |out| out.extend_from_slice(pdu));
        self.core.handle(self.now, Input::Bytes(&frame));
    }

    /// Lets time pass; whether a frame went out.
    fn pass(&mut self, time: Duration) -> bool {
        let until = self.now + time;
        let before = self.sent.len();
        loop {
            let wake = self.core.next_wake().map_or(until, |wake| wake.at.min(until));
            self.now = self.now.max(wake);
            self.core.handle(self.now, Input::Time);
            while let Some(effect) = self.core.next_effect() {
                match effect {
                    Effect::Transmit(frame) => self.sent.push(frame),
                    Effect::Answer(answer) => self.answers.push(answer),
                    _ => {}
                }
            }
            if self.now >= until || self.sent.len() > before {
                return self.sent.len() > before;
            }
        }
    }

    fn outcomes(&mut self) -> Vec<NativeOutcome> {
        std::mem::take(&mut self.answers).into_iter().map(|answer| answer.outcome).collect()
    }
}

#[test]
fn the_drives_own_reply_decides_what_became_of_a_write() {
    for (reply, outcome) in [
        (&[6, 0, 2, 0, 1][..], NativeOutcome::Written),
        (&[6, 0, 2, 0, 0], NativeOutcome::KeptOldValue(0)),
        (&[0x86, 4], NativeOutcome::DriveException(4)),
    ] {
        let mut line = Line::new();
        line.write(1, RUN, 1);
        assert!(line.pass(Duration::from_millis(20)));
        assert_eq!(line.sent, [[0x01, 0x06, 0x00, 0x02, 0x00, 0x01, 0xE9, 0xCA]], "RUN FWD of the manual");
        line.receive(reply);
        line.pass(Duration::from_millis(20));
        assert_eq!(line.outcomes(), [outcome]);
    }
}

#[test]
fn a_write_is_never_repeated() {
    for reply in [None, Some([6, 0, 2, 0, 1])] {
        let mut line = Line::new();
        line.write(1, RUN, 1);
        line.pass(Duration::from_millis(20));
        if let Some(pdu) = reply {
            let mut frame = Vec::new();
            rtu::encode(&mut frame, 1, |out| out.extend_from_slice(&pdu));
            frame[6] ^= 1;
            line.core.handle(line.now, Input::Bytes(&frame));
        }
        assert!(!line.pass(Duration::from_secs(5)), "{:02X?}", line.sent);
        assert_eq!(line.outcomes(), [NativeOutcome::NoReply]);
    }
}

#[test]
fn a_write_past_its_deadline_never_reaches_the_wire() {
    let mut line = Line::new();
    line.write(1, RUN, 1);
    line.pass(Duration::from_millis(20));
    // The reply stays out, so a write to the same register has to wait for as long as it may come late.
    line.write(2, RUN, 2);
    line.now = line.now + Duration::from_millis(1100);
    line.core.handle(line.now, Input::Time);
    line.pass(Duration::from_secs(3));
    assert_eq!(line.sent.len(), 1, "{:02X?}", line.sent);
    assert_eq!(line.outcomes(), [NativeOutcome::NoReply, NativeOutcome::Expired]);
}

#[test]
fn a_stop_goes_first_and_waits_for_no_late_reply() {
    let mut line = Line::new();
    line.write(1, RUN, 1);
    line.pass(Duration::from_millis(20));
    line.write(2, 0x0004, 3000);
    line.write(3, RUN, 0);
    // The reply to the first stays out; the stop follows at once, although its answer could be mistaken.
    assert!(line.pass(Duration::from_secs(1)));
    assert_eq!(line.sent[1], [0x01, 0x06, 0x00, 0x02, 0x00, 0x00, 0x28, 0x0A], "STOP of the manual");
}
