//! A Modbus TCP connection under any split of its stream and any order of events.

use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence;
use std::collections::HashMap;
use std::time::Duration;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::north::modbus::{
    ConnectionLimits, ModbusAnswer, ModbusConnection, ModbusRequest, UnitCall, parse,
};
use vfd_gateway::wire::mbap;

fn config() -> ProptestConfig {
    ProptestConfig {
        failure_persistence: Some(Box::new(FileFailurePersistence::WithSource("seeds"))),
        ..ProptestConfig::default()
    }
}

/// PDUs of which most are served, some nearly, some not at all.
fn pdu() -> impl Strategy<Value = Vec<u8>> {
    let head = |function: u8, address: u16, second: u16| {
        let mut pdu = vec![function];
        pdu.extend(address.to_be_bytes());
        pdu.extend(second.to_be_bytes());
        pdu
    };
    prop_oneof![
        4 => (prop_oneof![Just(3_u8), Just(4)], any::<u16>(), 0..130_u16).prop_map(move |(f, a, n)| head(f, a, n)),
        2 => (any::<u16>(), any::<u16>()).prop_map(move |(a, v)| head(6, a, v)),
        2 => (any::<u16>(), 0..124_u16, any::<bool>()).prop_map(move |(a, n, right)| {
            let mut pdu = head(0x10, a, n);
            pdu.push((2 * n) as u8);
            pdu.extend(std::iter::repeat_n(0x5A, usize::from(2 * n) + usize::from(!right && n < 120)));
            pdu
        }),
        2 => (1..3_u8, any::<u16>(), 0..2010_u16).prop_map(move |(f, a, n)| head(f, a, n)),
        1 => (any::<u16>(), prop_oneof![Just(0), Just(0xFF00), any::<u16>()]).prop_map(move |(a, v)| head(5, a, v)),
        1 => (any::<u16>(), 0..64_u16, 0..9_u8).prop_map(move |(a, n, bytes)| {
            let mut pdu = head(0x0F, a, n);
            pdu.push(bytes);
            pdu.extend(std::iter::repeat_n(0x5A, usize::from(bytes)));
            pdu
        }),
        1 => (any::<u16>(), any::<u16>(), any::<[u8; 2]>()).prop_map(move |(a, and, or)| {
            [head(0x16, a, and), or.to_vec()].concat()
        }),
        1 => (any::<u16>(), 0..127_u16, any::<u16>(), 0..100_u16).prop_map(move |(read, n, write, m)| {
            let mut pdu = head(0x17, read, n);
            pdu.extend(&head(0, write, m)[1..]);
            pdu.push((2 * m) as u8);
            pdu.extend(std::iter::repeat_n(0x5A, usize::from(2 * m)));
            pdu
        }),
        1 => any::<[u8; 2]>().prop_map(|[access, object]| vec![0x2B, 0x0E, access, object]),
        1 => prop::collection::vec(any::<u8>(), 1..=253),
    ]
}

/// Any write of a word whose lowest bit is not set stops; so does any coil that is switched off.
fn is_stop(_: u8, ask: &ModbusRequest) -> bool {
    match ask {
        ModbusRequest::WriteWord { value, .. } => value & 1 == 0,
        ModbusRequest::WriteCoil { on, .. } => !on,
        _ => false,
    }
}

fn stream(messages: &[(u16, u8, Vec<u8>)]) -> Vec<u8> {
    let mut out = Vec::new();
    for (transaction, unit, pdu) in messages {
        mbap::encode(&mut out, *transaction, *unit, |out| {
            out.extend_from_slice(pdu)
        });
    }
    out
}

fn drain(connection: &mut ModbusConnection) -> Vec<UnitCall> {
    std::iter::from_fn(|| connection.next_call()).collect()
}

fn any_answer() -> impl Strategy<Value = Kind> {
    prop_oneof![
        4 => Just(Kind::Fitting),
        2 => any::<u8>().prop_map(Kind::Exception),
        1 => prop::collection::vec(any::<u16>(), 0..300).prop_map(Kind::Words),
        1 => prop::collection::vec(any::<u8>(), 0..300).prop_map(Kind::Bits),
        1 => prop::collection::vec(any::<u8>(), 0..300).prop_map(Kind::Identity),
        1 => Just(Kind::Written),
    ]
}

#[derive(Clone, Debug)]
enum Kind {
    Fitting,
    Exception(u8),
    Words(Vec<u16>),
    Bits(Vec<u8>),
    Identity(Vec<u8>),
    Written,
}

impl Kind {
    fn answer(&self) -> ModbusAnswer<'_> {
        match self {
            Self::Exception(code) => ModbusAnswer::Exception(*code),
            Self::Words(words) => ModbusAnswer::Words(words),
            Self::Bits(bytes) => ModbusAnswer::Bits(bytes),
            Self::Identity(bytes) => ModbusAnswer::Identity(bytes),
            Self::Written | Self::Fitting => ModbusAnswer::Written,
        }
    }

    /// What fits `ask`, if this shall fit.
    fn fitted(&self, ask: &ModbusRequest) -> Self {
        match (self, ask) {
            (
                Self::Fitting,
                ModbusRequest::ReadWords { count, .. }
                | ModbusRequest::ReadWriteWords {
                    read_count: count, ..
                },
            ) => Self::Words(vec![*count; usize::from(*count)]),
            (Self::Fitting, ModbusRequest::ReadBits { count, .. }) => {
                Self::Bits(vec![0xA5; usize::from(count.div_ceil(8))])
            }
            (Self::Fitting, ModbusRequest::Identify { .. }) => Self::Identity(vec![0x0E, 1]),
            (other, _) => other.clone(),
        }
    }
}

#[derive(Clone, Debug)]
enum Event {
    Receive(Vec<u8>),
    Answer(usize, Kind),
    Wrote(usize),
    Pass(u64),
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        5 => pdu().prop_map(Event::Receive),
        4 => (any::<prop::sample::Index>(), any_answer()).prop_map(|(at, kind)| Event::Answer(at.index(64), kind)),
        2 => (0..2_000_usize).prop_map(Event::Wrote),
        1 => (0..3_000_u64).prop_map(Event::Pass),
    ]
}

/// The rig of the property below: what was sent, and what came out of the machine.
struct Client {
    connection: ModbusConnection,
    now: MonoTime,
    sent: Vec<(u8, Vec<u8>)>,
    calls: Vec<UnitCall>,
    read: Vec<u8>,
}

impl Client {
    fn new() -> Self {
        let connection = ModbusConnection::new(ConnectionLimits::default(), MonoTime::ZERO);
        Self {
            connection,
            now: MonoTime::ZERO,
            sent: vec![],
            calls: vec![],
            read: vec![],
        }
    }

    fn play(&mut self, event: &Event) {
        match event {
            Event::Receive(pdu) => self.send(pdu),
            Event::Answer(at, kind) if !self.calls.is_empty() => {
                let call = &self.calls[at % self.calls.len()];
                self.connection
                    .answer(self.now, call.ticket, kind.fitted(&call.ask).answer());
            }
            Event::Answer(..) => {}
            Event::Wrote(bytes) => self.write(*bytes),
            Event::Pass(millis) => {
                self.now = self.now + Duration::from_millis(*millis);
                self.connection.tick(self.now);
            }
        }
    }

    /// The transaction is the place in `sent`, the unit something else.
    fn send(&mut self, pdu: &[u8]) {
        let transaction = self.sent.len() as u16;
        let unit = (transaction * 7) as u8;
        self.connection.receive(
            self.now,
            &stream(&[(transaction, unit, pdu.to_vec())]),
            &is_stop,
        );
        self.sent.push((unit, pdu.to_vec()));
        self.calls.extend(drain(&mut self.connection));
    }

    fn write(&mut self, bytes: usize) {
        let bytes = bytes.min(self.connection.output().len());
        self.read
            .extend_from_slice(&self.connection.output()[..bytes]);
        self.connection.wrote(bytes);
    }

    /// The answers to each transaction, as unit and PDU.
    fn answers(&self) -> HashMap<u16, Vec<(u8, Vec<u8>)>> {
        let mut answers: HashMap<u16, Vec<_>> = HashMap::new();
        let mut rest = self.read.as_slice();
        while let Some(message) = mbap::decode(rest).expect("only whole, sound messages go out") {
            answers
                .entry(message.transaction)
                .or_default()
                .push((message.unit, message.pdu.to_vec()));
            rest = &rest[message.adu_bytes..];
        }
        assert!(rest.is_empty());
        answers
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn any_split_of_a_stream_gives_the_same_calls_and_answers(
        messages in prop::collection::vec((any::<u16>(), any::<u8>(), pdu()), 1..30),
        cuts in prop::collection::vec(1..60_usize, 1..40),
    ) {
        let stream = stream(&messages);
        let limits = ConnectionLimits { pending_max: 30, ..ConnectionLimits::default() };
        let mut whole = ModbusConnection::new(limits, MonoTime::ZERO);
        whole.receive(MonoTime::ZERO, &stream, &is_stop);
        let mut split = ModbusConnection::new(limits, MonoTime::ZERO);
        let mut rest = stream.as_slice();
        for cut in cuts.iter().cycle() {
            let (chunk, behind) = rest.split_at((*cut).min(rest.len()));
            split.receive(MonoTime::ZERO, chunk, &is_stop);
            rest = behind;
            if rest.is_empty() {
                break;
            }
        }
        prop_assert_eq!(split.output(), whole.output());
        prop_assert_eq!(split.counters(), whole.counters());
        let calls = drain(&mut whole);
        prop_assert_eq!(&drain(&mut split), &calls);
        let asks: Vec<ModbusRequest> = messages.iter().filter_map(|(_, _, pdu)| parse(pdu).ok()).collect();
        prop_assert_eq!(calls.into_iter().map(|call| call.ask).collect::<Vec<_>>(), asks);
    }

    #[test]
    fn each_request_gets_exactly_one_answer_of_its_own(events in prop::collection::vec(event(), 1..80)) {
        let mut client = Client::new();
        for event in &events {
            client.play(event);
        }
        client.play(&Event::Pass(ConnectionLimits::default().answer_within.as_millis() as u64));
        client.write(usize::MAX);
        prop_assert_eq!(client.connection.close_reason(), None);
        let mut answers = client.answers();
        for (transaction, (unit, pdu)) in client.sent.iter().enumerate() {
            let got = answers.remove(&(transaction as u16)).unwrap_or_default();
            prop_assert_eq!(got.len(), 1, "transaction {}: {:?}", transaction, got);
            prop_assert_eq!((got[0].0, got[0].1[0] & 0x7F), (*unit, pdu[0] & 0x7F));
        }
        prop_assert!(answers.is_empty());
    }

    /// Nothing is answered, so that only what overtakes finds a place.
    #[test]
    fn a_stop_is_never_refused_for_want_of_a_place(pdus in prop::collection::vec(pdu(), 1..200)) {
        let mut client = Client::new();
        pdus.iter().for_each(|pdu| client.send(pdu));
        let mut of_unit: HashMap<u8, usize> = HashMap::new();
        for (place, pdu) in pdus.iter().enumerate() {
            let unit = (place * 7) as u8;
            if parse(pdu).is_ok_and(|ask| is_stop(unit, &ask)) {
                *of_unit.entry(unit).or_default() += 1;
            }
        }
        for (unit, stops) in of_unit {
            let taken = client.calls.iter().filter(|call| call.unit == unit && is_stop(unit, &call.ask)).count();
            prop_assert!(taken >= 1, "{} stops of unit {}, none taken", stops, unit);
        }
        let others = client.calls.iter().filter(|call| !is_stop(call.unit, &call.ask)).count();
        prop_assert!(others <= ConnectionLimits::default().pending_max);
    }

    #[test]
    fn random_bytes_never_panic(
        chunks in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..300), 0..20),
        millis in prop::collection::vec(0..10_000_u64, 20),
    ) {
        let mut connection = ModbusConnection::new(ConnectionLimits::default(), MonoTime::ZERO);
        let mut now = MonoTime::ZERO;
        for (chunk, millis) in chunks.iter().zip(millis) {
            connection.receive(now, chunk, &is_stop);
            drain(&mut connection);
            now = now + Duration::from_millis(millis);
            connection.tick(now);
            prop_assert!(connection.next_wake().is_none_or(|wake| wake > now));
        }
    }
}
