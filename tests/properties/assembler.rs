//! Replies found, and nothing else, in whatever a line delivers.

use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence;
use std::collections::BTreeSet;
use vfd_gateway::domain::address::DataTable;
use vfd_gateway::domain::link::Framing;
use vfd_gateway::wire::crc;
use vfd_gateway::wire::frame::ExpectedFrame;
use vfd_gateway::wire::framing::FrameAssembler;
use vfd_gateway::wire::pdu::{Reply, Request, encode_read_reply};
use vfd_gateway::wire::rtu::{self, ReplyLength};

fn config() -> ProptestConfig {
    ProptestConfig {
        failure_persistence: Some(Box::new(FileFailurePersistence::WithSource("seeds"))),
        ..ProptestConfig::default()
    }
}

/// Whether the bytes begin with a sound frame: a chance of 1 in 65,536, which nothing can tell from a real one.
fn begins_with_a_frame(bytes: &[u8]) -> bool {
    match rtu::reply_adu_bytes(bytes) {
        ReplyLength::Known(length) => bytes.get(..length).is_some_and(crc::is_sound),
        ReplyLength::NotYetKnown | ReplyLength::OnlySilenceTells => false,
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn a_reply_after_noise_is_found(
        station in 1..=247_u8,
        words in prop::collection::vec(any::<u16>(), 1..=125),
        noise in prop::collection::vec(any::<u8>(), 0..=256),
        chunk in 1..300_usize,
    ) {
        let request = Request::Read { address: 0_u16.into(), count: words.len() as u16 };
        let mut reply = Vec::new();
        rtu::encode(&mut reply, station, |out| encode_read_reply(out, DataTable::Holding, &words));
        let stream = [noise.as_slice(), &reply].concat();
        prop_assume!(noise.is_empty() || !begins_with_a_frame(&stream));

        let expected = ExpectedFrame { station, function: 3, adu_bytes: reply.len() };
        let mut assembler = FrameAssembler::new(Framing::Rtu);
        let mut found = None;
        for chunk in stream.chunks(chunk) {
            prop_assert!(found.is_none(), "found before it was whole");
            prop_assert!(assembler.push(chunk).is_empty());
            found = assembler.take(Some(&expected));
        }
        let found = found.expect("the reply is in the stream");
        prop_assert_eq!(found.noise, noise);
        prop_assert_eq!(&found.adu, &reply);
        prop_assert!(assembler.is_empty());
        let (_, pdu) = rtu::decode(&found.adu).expect("what is found is sound");
        prop_assert_eq!(request.reply_in(pdu), Some(Reply::Words(words)));
    }

    /// The shorter frames are tried exhaustively among the scenarios.
    #[test]
    fn up_to_three_wrong_bits_are_seen_in_frames_of_any_length(
        words in prop::collection::vec(any::<u16>(), 1..=125),
        bits in prop::collection::vec(any::<prop::sample::Index>(), 1..=3),
    ) {
        let request = Request::Read { address: 0_u16.into(), count: words.len() as u16 };
        let mut reply = Vec::new();
        rtu::encode(&mut reply, 1, |out| encode_read_reply(out, DataTable::Holding, &words));
        let mut spoilt = reply.clone();
        for bit in bits.iter().map(|bit| bit.index(reply.len() * 8)).collect::<BTreeSet<_>>() {
            spoilt[bit / 8] ^= 1 << (bit % 8);
        }
        let mut assembler = FrameAssembler::new(Framing::Rtu);
        assembler.push(&spoilt);
        while let Some(found) = assembler.take(Some(&ExpectedFrame { station: 1, function: 3, adu_bytes: reply.len() })) {
            let (station, pdu) = rtu::decode(&found.adu).expect("what is found is sound");
            prop_assert!(station != 1 || (pdu[0] != 0x83 && request.reply_in(pdu).is_none()), "{:02X?}", found.adu);
        }
    }

    #[test]
    fn garbage_never_panics_and_no_byte_is_lost(
        chunks in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..400), 0..12),
        expected in prop::option::of((any::<u8>(), any::<u8>(), 4..=256_usize)),
    ) {
        let expected = expected.map(|(station, function, adu_bytes)| ExpectedFrame { station, function, adu_bytes });
        let mut assembler = FrameAssembler::new(Framing::Rtu);
        let mut given_out = Vec::new();
        for chunk in &chunks {
            given_out.extend(assembler.push(chunk));
            while let Some(found) = assembler.take(expected.as_ref()) {
                prop_assert!(crc::is_sound(&found.adu) && found.adu.len() <= rtu::MAX_ADU_BYTES);
                given_out.extend(found.noise);
                given_out.extend(found.adu);
            }
            prop_assert!(assembler.bytes().len() <= assembler.max_bytes());
        }
        given_out.extend(assembler.end());
        prop_assert!(assembler.is_empty());
        prop_assert_eq!(given_out, chunks.concat());
    }

    #[test]
    fn garbage_is_no_pdu_that_panics(pdu in prop::collection::vec(any::<u8>(), 0..260), request in request()) {
        let reply = request.reply_in(&pdu);
        prop_assert!(reply.is_none() || pdu[0] == request.function());
        if let Some(request) = Request::decode(&pdu) {
            let mut again = Vec::new();
            request.encode(&mut again);
            prop_assert_eq!(again, pdu);
        }
    }
}

fn request() -> impl Strategy<Value = Request> {
    prop_oneof![
        (any::<u16>(), any::<u16>()).prop_map(|(address, count)| Request::Read {
            address: address.into(),
            count
        }),
        (any::<u16>(), any::<u16>()).prop_map(|(address, value)| Request::WriteSingle {
            address: address.into(),
            value
        }),
        any::<u16>().prop_map(|data| Request::Loopback { data }),
        (any::<u16>(), prop::collection::vec(any::<u16>(), 1..=123)).prop_map(
            |(address, values)| Request::WriteMultiple {
                address: address.into(),
                values
            }
        ),
    ]
}
