//! Every frame printed in the manuals, in both directions: as values, as bytes, and as received on a line.

use serde_json::Value;
use vfd_gateway::domain::address::DataTable;
use vfd_gateway::domain::link::Framing;
use vfd_gateway::wire::frame::{ExpectedFrame, FoundFrame};
use vfd_gateway::wire::framing::FrameAssembler;
use vfd_gateway::wire::pdu::{Reply, Request, encode_read_reply};
use vfd_gateway::wire::rtu;

/// One row of the table.
struct Entry {
    what: String,
    request: Vec<u8>,
    response: Option<Vec<u8>>,
    valid_crc: bool,
    misprint: bool,
    correct: Option<Vec<u8>>,
    station: u8,
    function: u8,
    address: u16,
    count: Option<u16>,
    raw: Vec<u16>,
}

impl Entry {
    fn of(row: &Value) -> Self {
        let decoded = &row["decoded"];
        let small = |key: &str| {
            decoded[key]
                .as_u64()
                .map(|number| u16::try_from(number).unwrap())
        };
        let raw = decoded["raw"]
            .as_array()
            .map(Vec::as_slice)
            .unwrap_or_default();
        Self {
            what: format!("{}: {}", row["drive"], row["what"]),
            request: hex(&row["request"]).unwrap(),
            response: hex(&row["response"]),
            valid_crc: row["valid_crc"].as_bool().unwrap(),
            misprint: row["misprint"].as_bool().unwrap(),
            correct: hex(&row["correct_frame"]),
            station: small("station").unwrap() as u8,
            function: small("function").unwrap() as u8,
            address: u16::from_str_radix(
                decoded["address"]
                    .as_str()
                    .unwrap()
                    .trim_start_matches("0x"),
                16,
            )
            .unwrap(),
            count: small("count"),
            raw: raw
                .iter()
                .map(|word| u16::try_from(word.as_u64().unwrap()).unwrap())
                .collect(),
        }
    }

    /// The request as described in the table.
    fn asked(&self) -> Request {
        match self.function {
            3 => Request::Read {
                address: self.address.into(),
                count: self.count.unwrap(),
            },
            6 => Request::WriteSingle {
                address: self.address.into(),
                value: self.raw[0],
            },
            other => panic!("{}: function {other}", self.what),
        }
    }

    fn reply(&self) -> Reply {
        match self.function {
            3 => Reply::Words(self.raw.clone()),
            _ => Reply::Holds { value: self.raw[0] },
        }
    }

    fn expected(&self) -> ExpectedFrame {
        let adu_bytes = if self.function == 3 { 7 } else { 8 };
        ExpectedFrame {
            station: self.station,
            function: self.function,
            adu_bytes,
        }
    }

    /// Whether `adu` would be taken for this request's answer: its reply, or an exception of its function.
    fn is_answered_by(&self, adu: &[u8]) -> bool {
        let Some((station, pdu)) = rtu::decode(adu) else {
            return false;
        };
        let exception = pdu.len() == 2 && pdu[0] == self.function | 0x80;
        station == self.station && (exception || self.asked().reply_in(pdu).is_some())
    }
}

fn hex(value: &Value) -> Option<Vec<u8>> {
    let text = value.as_str()?;
    Some(
        (0..text.len())
            .step_by(2)
            .map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap())
            .collect(),
    )
}

fn table() -> Vec<Entry> {
    let rows: Value = serde_json::from_str(include_str!("../data/hyundai-frames.json")).unwrap();
    rows.as_array().unwrap().iter().map(Entry::of).collect()
}

/// Rows with a reply, each with it.
fn replies() -> Vec<(Entry, Vec<u8>)> {
    table()
        .into_iter()
        .filter_map(|entry| entry.response.clone().map(|reply| (entry, reply)))
        .collect()
}

/// Everything that an assembler finds in `chunks`, and what is left once the line is silent.
fn heard<'a>(
    expected: ExpectedFrame,
    chunks: impl IntoIterator<Item = &'a [u8]>,
) -> (Vec<FoundFrame>, Vec<u8>) {
    let mut assembler = FrameAssembler::new(Framing::Rtu);
    let mut found = Vec::new();
    for chunk in chunks {
        assembler.push(chunk);
        while let Some(frame) = assembler.take(Some(&expected)) {
            found.push(frame);
        }
    }
    (found, assembler.end())
}

fn frame(noise: &[u8], adu: &[u8]) -> FoundFrame {
    FoundFrame {
        noise: noise.to_vec(),
        adu: adu.to_vec(),
    }
}

fn noise(seed: u64, length: usize) -> Vec<u8> {
    let mut random = fastrand::Rng::with_seed(seed);
    std::iter::repeat_with(|| random.u8(..))
        .take(length)
        .collect()
}

#[test]
fn the_table_is_whole() {
    let table = table();
    assert_eq!(table.len(), 39);
    assert_eq!(table.iter().filter(|entry| entry.valid_crc).count(), 33);
    assert_eq!(table.iter().filter(|entry| entry.misprint).count(), 5);
    assert_eq!(replies().len(), 31);
}

#[test]
fn a_crc_is_right_where_the_table_says_so() {
    for entry in table() {
        for adu in [Some(&entry.request), entry.response.as_ref()]
            .into_iter()
            .flatten()
        {
            assert_eq!(
                rtu::decode(adu).is_some(),
                entry.valid_crc,
                "{}",
                entry.what
            );
        }
    }
}

#[test]
fn requests_mean_what_the_table_says_and_format_back() {
    for entry in table().iter().filter(|entry| entry.valid_crc) {
        let (station, pdu) = rtu::decode(&entry.request).unwrap();
        assert_eq!(
            (station, pdu[0]),
            (entry.station, entry.function),
            "{}",
            entry.what
        );
        let request = Request::decode(pdu).unwrap();
        assert_eq!(request, entry.asked(), "{}", entry.what);
        let mut again = Vec::new();
        rtu::encode(&mut again, station, |out| request.encode(out));
        assert_eq!(again, entry.request, "{}", entry.what);
    }
}

#[test]
fn replies_mean_what_the_table_says_and_format_back() {
    for (entry, adu) in replies() {
        let (station, pdu) = rtu::decode(&adu).unwrap();
        assert_eq!(station, entry.station, "{}", entry.what);
        let reply = entry.asked().reply_in(pdu);
        assert_eq!(reply, Some(entry.reply()), "{}", entry.what);
        let mut again = Vec::new();
        rtu::encode(&mut again, station, |out| match entry.reply() {
            Reply::Words(words) => encode_read_reply(out, DataTable::Holding, &words),
            _ => entry.asked().encode(out),
        });
        assert_eq!(again, adu, "{}", entry.what);
    }
}

/// A misprinted frame is a sound frame for another register, and that is how it must be understood.
#[test]
fn misprints_mean_the_register_that_they_name() {
    for entry in table().iter().filter(|entry| entry.misprint) {
        let printed = Request::decode(rtu::decode(&entry.request).unwrap().1).unwrap();
        let (station, meant) = rtu::decode(entry.correct.as_ref().unwrap()).unwrap();
        let meant = Request::decode(meant).unwrap();
        assert_eq!(
            (station, meant.function()),
            (entry.station, printed.function()),
            "{}",
            entry.what
        );
        assert_eq!(printed, entry.asked(), "{}", entry.what);
        assert_ne!(printed, meant, "{}", entry.what);
        if let Some(reply) = entry.response.as_ref() {
            assert_eq!(
                meant.reply_in(rtu::decode(reply).unwrap().1),
                None,
                "{}",
                entry.what
            );
        }
    }
}

/// The frames with a wrong CRC were derived from good ones: their bodies can be read, but they are not accepted.
#[test]
fn frames_with_a_wrong_crc_are_rejected() {
    for entry in table().iter().filter(|entry| !entry.valid_crc) {
        let body = Request::decode(&entry.request[1..6]).unwrap();
        let (function, address) = match body {
            Request::Read { address, .. } => (3, address),
            Request::WriteSingle { address, .. } => (6, address),
            other => panic!("{other:?}"),
        };
        assert_eq!(
            (function, address.number()),
            (entry.function, entry.address),
            "{}",
            entry.what
        );
        assert!(
            rtu::decode(entry.correct.as_ref().unwrap()).is_some(),
            "{}",
            entry.what
        );
        for chunk in [1, 8] {
            let (found, rest) = heard(entry.expected(), entry.request.chunks(chunk));
            assert_eq!((found, &rest), (vec![], &entry.request), "{}", entry.what);
            assert_eq!(rtu::decode(&rest), None, "{}", entry.what);
        }
    }
}

#[test]
fn a_reply_is_found_whole_and_byte_by_byte() {
    for (entry, adu) in replies() {
        assert_eq!(adu.len(), entry.expected().adu_bytes);
        for chunk in 1..=adu.len() {
            let (found, rest) = heard(entry.expected(), adu.chunks(chunk));
            assert_eq!(
                (found, rest),
                (vec![frame(&[], &adu)], vec![]),
                "{}",
                entry.what
            );
        }
        let (found, rest) = heard(entry.expected(), [&adu[..adu.len() - 1]]);
        assert_eq!(
            (found, rest.as_slice()),
            (vec![], &adu[..adu.len() - 1]),
            "{}",
            entry.what
        );
    }
}

#[test]
fn glued_replies_are_found_one_after_the_other() {
    let replies = replies();
    for (entry, first) in &replies {
        for (_, second) in &replies {
            let glued = [first.as_slice(), second].concat();
            for chunk in [1, 5, glued.len()] {
                let (found, rest) = heard(entry.expected(), glued.chunks(chunk));
                assert_eq!(
                    (found, rest),
                    (vec![frame(&[], first), frame(&[], second)], vec![]),
                    "{}",
                    entry.what
                );
            }
        }
    }
}

#[test]
fn a_reply_is_found_after_noise() {
    for (entry, adu) in replies() {
        for seed in 0..20 {
            for length in [1, 2, 3, 5, 8, 13, 64, 250, 256, 504] {
                let noise = noise(seed, length);
                let stream = [noise.as_slice(), &adu].concat();
                for chunk in [7, stream.len()] {
                    let (found, rest) = heard(entry.expected(), stream.chunks(chunk));
                    assert_eq!(
                        (found, rest),
                        (vec![frame(&noise, &adu)], vec![]),
                        "{} {seed} {length}",
                        entry.what
                    );
                }
            }
        }
    }
}

#[test]
fn a_reply_is_found_after_more_noise_than_is_kept() {
    for (entry, adu) in replies() {
        let stream = [noise(1, 3_000).as_slice(), &adu].concat();
        let (found, rest) = heard(entry.expected(), stream.chunks(100));
        assert_eq!((found.len(), rest.len()), (1, 0), "{}", entry.what);
        assert_eq!(found[0].adu, adu, "{}", entry.what);
    }
}

/// Noise that looks like the head of a longer frame, up to the longest, must not hide the reply.
#[test]
fn a_reply_is_found_after_the_head_of_another_frame() {
    for (entry, adu) in replies() {
        let station = entry.station;
        for head in [
            &[station][..],
            &[station, entry.function],
            &[station, 3, 250],
            &[station, 3, 255],
            &[station, 4, 255, 0],
            &[station, 0x10],
            &[station, 0x16, 0, 0],
            &[station, 0x2B],
            &[station, 0x83, 2],
            &[0xFF, 0xFF, 0xFF],
            &[station; 9],
        ] {
            let stream = [head, &adu].concat();
            for chunk in [1, stream.len()] {
                let (found, rest) = heard(entry.expected(), stream.chunks(chunk));
                assert_eq!(
                    (found, rest),
                    (vec![frame(head, &adu)], vec![]),
                    "{} {head:02X?}",
                    entry.what
                );
            }
        }
    }
}

/// The echo of our own read in front of the reply, as some adapters give it.
#[test]
fn a_reply_is_found_after_the_echo_of_its_read() {
    for (entry, adu) in replies()
        .into_iter()
        .filter(|(entry, _)| entry.function == 3)
    {
        let stream = [entry.request.as_slice(), &adu].concat();
        let (found, rest) = heard(entry.expected(), [stream.as_slice()]);
        assert_eq!(
            (found, rest),
            (vec![frame(&entry.request, &adu)], vec![]),
            "{}",
            entry.what
        );
    }
}

#[test]
fn noise_after_a_reply_is_left_over() {
    for (entry, adu) in replies() {
        for seed in 0..20 {
            for length in [1, 2, 3, 5, 8, 64, 256] {
                let noise = noise(seed, length);
                let stream = [adu.as_slice(), &noise].concat();
                let (found, rest) = heard(entry.expected(), stream.chunks(7));
                assert_eq!(
                    (found, rest),
                    (vec![frame(&[], &adu)], noise),
                    "{} {seed} {length}",
                    entry.what
                );
            }
        }
    }
}

/// The promise: up to three wrong bits are always seen. Every way to spoil one, two or three bits is tried.
#[test]
fn one_two_or_three_wrong_bits_are_never_taken_for_an_answer() {
    let mut seen: Vec<(Vec<u8>, Vec<u8>)> = Vec::new();
    for (entry, adu) in replies() {
        if seen.contains(&(entry.request.clone(), adu.clone())) {
            continue;
        }
        let bits = adu.len() * 8;
        for first in 0..bits {
            for second in first..bits {
                for third in second..bits {
                    assert_rejected(&entry, &adu, &[first, second, third]);
                }
            }
        }
        seen.push((entry.request.clone(), adu));
    }
}

/// Equal places in `bits` (ascending) count once.
fn assert_rejected(entry: &Entry, adu: &[u8], bits: &[usize; 3]) {
    let mut spoilt = adu.to_vec();
    for (n, bit) in bits.iter().enumerate() {
        if n == 0 || bits[n - 1] != *bit {
            spoilt[bit / 8] ^= 1 << (bit % 8);
        }
    }
    let (found, rest) = heard(entry.expected(), [spoilt.as_slice()]);
    let taken = found
        .iter()
        .map(|frame| frame.adu.as_slice())
        .chain([rest.as_slice()])
        .find(|adu| entry.is_answered_by(adu));
    assert_eq!(taken, None, "{}: {spoilt:02X?}", entry.what);
}

/// No known function code gives the length of such a frame, so silence delimits it.
#[test]
fn a_frame_of_unknown_length_is_ended_by_silence() {
    let (entry, _) = replies().remove(0);
    let mut adu = Vec::new();
    rtu::encode(&mut adu, entry.station, |out| {
        out.extend([0x2B, 0x0E, 0x01, 0x00, 0x00])
    });
    let (found, rest) = heard(entry.expected(), adu.chunks(1));
    assert_eq!((found, &rest), (vec![], &adu));
    assert_eq!(rtu::decode(&rest), Some((entry.station, &adu[1..6])));
    assert!(!entry.is_answered_by(&rest));
}
