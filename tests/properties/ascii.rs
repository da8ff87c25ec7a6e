//! ASCII replies found, and nothing else, in whatever a line delivers.

use proptest::prelude::*;
use vfd_gateway::domain::address::DataTable;
use vfd_gateway::domain::link::Framing;
use vfd_gateway::wire::ascii;
use vfd_gateway::wire::frame::{ExpectedFrame, FoundFrame};
use vfd_gateway::wire::framing::FrameAssembler;
use vfd_gateway::wire::pdu::{Reply, Request, encode_read_reply};

/// The reply with `words` of `station`; bit n of `lower` makes its nth character lower case.
fn reply(station: u8, words: &[u16], lower: u64) -> Vec<u8> {
    let mut adu = Vec::new();
    ascii::encode(&mut adu, station, |out| {
        encode_read_reply(out, DataTable::Holding, words)
    });
    adu.iter_mut()
        .enumerate()
        .filter(|(n, _)| lower >> (n % 64) & 1 == 1)
        .for_each(|(_, it)| it.make_ascii_lowercase());
    adu
}

fn words() -> impl Strategy<Value = Vec<u16>> {
    prop::collection::vec(any::<u16>(), 1..=125)
}

/// What lines are full of: hexadecimal text with starts and ends in it, or anything.
fn noise() -> impl Strategy<Value = Vec<u8>> {
    let text = prop::sample::select(b"0123456789ABCDEFabcdef::\r\n".as_slice());
    prop_oneof![
        prop::collection::vec(text, 0..=256),
        prop::collection::vec(any::<u8>(), 0..=256)
    ]
}

/// Whether a sound frame ends somewhere in `bytes`: an LRC is right by chance once in 256 times.
fn has_a_frame(bytes: &[u8]) -> bool {
    (0..bytes.len())
        .any(|start| (start..=bytes.len()).any(|end| ascii::decode(&bytes[start..end]).is_some()))
}

/// All that is found in `chunks`, and what is left.
fn found_in<'a>(chunks: impl IntoIterator<Item = &'a [u8]>) -> (Vec<FoundFrame>, Vec<u8>) {
    let mut assembler = FrameAssembler::new(Framing::Ascii);
    let mut found = Vec::new();
    for chunk in chunks {
        assert!(assembler.push(chunk).is_empty());
        found.extend(std::iter::from_fn(|| assembler.take(None)));
    }
    (found, assembler.end())
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_reply_after_noise_is_found_and_formats_back(
        station in 1..=247_u8,
        words in words(),
        noise in noise(),
        lower in any::<u64>(),
        chunk in 1..900_usize,
    ) {
        prop_assume!(!has_a_frame(&noise));
        let reply = reply(station, &words, lower);
        let stream = [noise.as_slice(), &reply].concat();
        let (found, rest) = found_in(stream.chunks(chunk));
        prop_assert_eq!((found, rest), (vec![FoundFrame { noise, adu: reply.clone() }], vec![]));

        let request = Request::Read { address: 0_u16.into(), count: words.len() as u16 };
        prop_assert_eq!(reply.len(), ascii::adu_bytes(request.reply_pdu_bytes()));
        let (from, pdu) = ascii::decode(&reply).expect("what is found is sound");
        prop_assert_eq!(from, station);
        prop_assert_eq!(request.reply_in(&pdu), Some(Reply::Words(words)));
        let mut again = Vec::new();
        ascii::encode(&mut again, from, |out| out.extend_from_slice(&pdu));
        prop_assert_eq!(again, reply.to_ascii_uppercase());
    }

    #[test]
    fn glued_replies_are_found_one_after_the_other(
        first in words(),
        second in words(),
        lower in any::<u64>(),
        chunk in 1..900_usize,
    ) {
        let (first, second) = (reply(1, &first, lower), reply(2, &second, !lower));
        let glued = [first.as_slice(), &second].concat();
        let alone = |adu: Vec<u8>| FoundFrame { noise: Vec::new(), adu };
        prop_assert_eq!(found_in(glued.chunks(chunk)), (vec![alone(first), alone(second)], vec![]));
    }

    #[test]
    fn one_wrong_bit_never_changes_what_a_frame_says(words in words(), bit in any::<prop::sample::Index>()) {
        let reply = reply(1, &words, 0);
        let mut spoilt = reply.clone();
        let bit = bit.index(reply.len() * 8);
        spoilt[bit / 8] ^= 1 << (bit % 8);
        let request = Request::Read { address: 0_u16.into(), count: words.len() as u16 };
        for found in found_in([spoilt.as_slice()]).0 {
            let (station, pdu) = ascii::decode(&found.adu).expect("what is found is sound");
            let says = request.reply_in(&pdu).filter(|_| station == 1);
            prop_assert!(says.is_none() || says == Some(Reply::Words(words.clone())), "{:?}", found.adu);
        }
    }

    #[test]
    fn garbage_never_panics_and_no_byte_is_lost(
        chunks in prop::collection::vec(noise(), 0..24),
        station in any::<u8>(),
        function in any::<u8>(),
        adu_bytes in 0..=600_usize,
    ) {
        let mut assembler = FrameAssembler::new(Framing::Ascii);
        let mut given_out = Vec::new();
        for chunk in &chunks {
            given_out.extend(assembler.push(chunk));
            while let Some(found) = assembler.take(None) {
                prop_assert!(ascii::decode(&found.adu).is_some() && found.adu.len() <= ascii::MAX_ADU_BYTES);
                given_out.extend(found.noise);
                given_out.extend(found.adu);
            }
            prop_assert!(assembler.bytes().len() <= assembler.max_bytes());
            let damaged = assembler.holds_damaged(&ExpectedFrame { station, function, adu_bytes });
            prop_assert!(!damaged || assembler.bytes().windows(2).any(|pair| pair == b"\r\n"));
        }
        given_out.extend(assembler.end());
        prop_assert!(assembler.is_empty());
        prop_assert_eq!(given_out, chunks.concat());
    }
}
