//! Whatever happens to a line in whatever order: nothing panics, each request ends once and in time, one frame is
//! out at a time and never too early, and the line always says when it wants to be woken.

use crate::support::{ORIGIN, on};
use proptest::prelude::*;
use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;
use vfd_gateway::domain::ids::{AskerId, DriveIndex, Station, Ticket};
use vfd_gateway::domain::link::{EchoPolicy, Framing, LinkSettings, PortKind};
use vfd_gateway::domain::native::{NativeAsk, NativeRequest};
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::{DriveSetup, Effect, Input, LineCore, LineSetup, WakeReason};
use vfd_gateway::journal::Remembered;
use vfd_gateway::line::timeouts::ReplyTimeouts;
use vfd_gateway::line::timing::Timing;
use vfd_gateway::wire::framing;
use vfd_gateway::wire::pdu::{self, Request};

const PATIENCE: Duration = Duration::from_secs(2);

#[derive(Clone, Debug)]
enum Event {
    Wait(u32),
    Noise(Vec<u8>),
    /// The right reply to the frame that was sent last, or a damaged one.
    Reply(Option<u8>),
    Read {
        asker: u8,
        drive: u8,
        address: u16,
        count: u16,
    },
    Write {
        asker: u8,
        drive: u8,
        address: u16,
        value: u16,
    },
    Gone(u8),
    PortDown,
    PortUp,
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        4 => (0_u32..800_000).prop_map(Event::Wait),
        2 => prop::collection::vec(any::<u8>(), 1..40).prop_map(Event::Noise),
        6 => prop::option::weighted(0.2, any::<u8>()).prop_map(Event::Reply),
        6 => (0_u8..4, 0_u8..4, any::<u16>(), 1_u16..=125)
            .prop_map(|(asker, drive, address, count)| Event::Read { asker, drive, address, count }),
        1 => (0_u8..4, 0_u8..4, any::<u16>(), any::<u16>())
            .prop_map(|(asker, drive, address, value)| Event::Write { asker, drive, address, value }),
        1 => (0_u8..4).prop_map(Event::Gone),
        1 => Just(Event::PortDown),
        2 => Just(Event::PortUp),
    ]
}

/// What an observer knows of the line.
struct Watch {
    core: LineCore,
    framing: Framing,
    now: MonoTime,
    silence: Duration,
    /// Requests without an answer, with who asked.
    open: HashSet<(u64, u64)>,
    asked: u64,
    last_frame: Vec<u8>,
    last_byte: MonoTime,
}

impl Watch {
    fn new(framing: Framing) -> Self {
        let model = on(framing);
        let drives = (1..=3).map(|station| DriveSetup {
            station: Station(station),
            model: Arc::clone(&model),
            poll: Duration::from_millis(300),
            timeouts: ReplyTimeouts::fixed(Duration::from_millis(200)),
            max_lateness: Duration::from_millis(500),
            control: None,
            remembered: Remembered::default(),
        });
        let timing = Timing::for_models(framing, LinkSettings::DEFAULT, [model.as_ref()], Duration::ZERO);
        let setup = LineSetup {
            timing,
            drives: drives.collect(),
            echo: EchoPolicy::Strip,
            tells_traffic: true,
            first_epoch: 1,
            asked_before: false,
            joins_late: false,
            keeps: false,
        };
        let now = MonoTime::from_millis(1);
        let core = LineCore::new(setup, now);
        let silence = timing.silence;
        let (open, last_byte) = (HashSet::new(), MonoTime::ZERO);
        Self { core, framing, now, silence, open, asked: 0, last_frame: vec![], last_byte }
    }

    fn happen(&mut self, event: Event) {
        match event {
            Event::Wait(micros) => return self.pass(Duration::from_micros(micros.into())),
            Event::Noise(bytes) => self.bytes(&bytes),
            Event::Reply(damage) => self.reply(damage),
            Event::Read { asker, drive, address, count } => {
                let count = count.min((0x1_0000 - u32::from(address)).min(125) as u16);
                self.ask(asker, drive, NativeAsk::Read { address, count });
            }
            Event::Write { asker, drive, address, value } => {
                self.ask(asker, drive, NativeAsk::Write { address, values: vec![value] });
            }
            Event::Gone(asker) => {
                self.core.handle(self.now, Input::AskerGone(AskerId(asker.into())));
                self.open.retain(|(_, of)| *of != u64::from(asker));
            }
            Event::PortDown => {
                self.core.handle(self.now, Input::PortDown(LineFault::Gone));
                self.last_byte = self.now;
            }
            Event::PortUp => {
                self.core.handle(self.now, Input::PortUp(PortKind::Serial));
                self.last_byte = self.now;
            }
        }
        self.decide();
    }

    fn ask(&mut self, asker: u8, drive: u8, ask: NativeAsk) {
        self.asked += 1;
        self.open.insert((self.asked, asker.into()));
        let request = NativeRequest {
            asker: AskerId(asker.into()),
            ticket: Ticket(self.asked),
            drive: DriveIndex(drive.into()),
            origin: ORIGIN,
            ask,
            deadline: self.now + PATIENCE,
        };
        self.core.handle(self.now, Input::Native(request));
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.core.handle(self.now, Input::Bytes(bytes));
        self.last_byte = self.now;
    }

    fn reply(&mut self, damage: Option<u8>) {
        let Some((station, pdu)) = framing::decode(self.framing, &self.last_frame) else { return };
        let Some(Request::ReadHolding { count, .. }) = Request::decode(&pdu) else { return };
        let mut reply = Vec::new();
        framing::encode(self.framing, &mut reply, station, |out| pdu::encode_words_reply(out, &vec![7; count.into()]));
        if let Some(damage) = damage {
            let at = usize::from(damage) % reply.len();
            reply[at] ^= 0x10;
        }
        self.bytes(&reply);
    }

    /// Lets time pass from wake-up to wake-up.
    fn pass(&mut self, time: Duration) {
        let until = self.now + time;
        while let Some(wake) = self.core.next_wake().filter(|wake| wake.at <= until) {
            assert!(wake.at > self.now, "woken for ever: {wake:?} at {:?}", self.now);
            self.now = wake.at;
            self.decide();
        }
        self.now = until;
        self.decide();
    }

    fn decide(&mut self) {
        self.core.handle(self.now, Input::Time);
        while let Some(effect) = self.core.next_effect() {
            match effect {
                Effect::Transmit(frame) => {
                    assert!(self.now.since(self.last_byte) >= self.silence, "{frame:02X?} too early");
                    let reason = self.core.next_wake().map(|wake| wake.reason);
                    assert!(matches!(reason, Some(WakeReason::ReplyDue | WakeReason::RequestDeadline)));
                    self.last_frame = frame;
                }
                Effect::Answer(answer) => {
                    let was_open = self.open.remove(&(answer.ticket.0, answer.asker.0));
                    assert!(was_open, "answered twice or to nobody: {answer:?}");
                }
                Effect::Command(_)
                | Effect::Trip(..)
                | Effect::Note(..)
                | Effect::LineNote(_)
                | Effect::Reopen(_)
                | Effect::Keep(_)
                | Effect::Presence(..)
                | Effect::Traffic(_) => {}
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_request_ends_once_whatever_happens(
        events in prop::collection::vec(event(), 1..120),
        framing in prop_oneof![Just(Framing::Rtu), Just(Framing::Ascii)],
    ) {
        let mut watch = Watch::new(framing);
        watch.happen(Event::PortUp);
        for event in events {
            watch.happen(event);
        }
        watch.pass(PATIENCE);
        prop_assert!(watch.open.is_empty(), "without an answer: {:?}", watch.open);
    }
}
