//! Frames in the bytes of a line: the same whatever chunks they arrive in, sound, and no byte lost.
//!
//! Input: a byte of flags (1 ASCII, 2 with an expectation), a seed for the chunks, with an expectation its station,
//! function and length; then the bytes of the line.

use super::feed::{Feed, chunks};
use std::ops::Range;
use vfd_model::domain::link::Framing;
use vfd_model::wire::frame::{ExpectedFrame, FoundFrame};
use vfd_model::wire::framing::{self, FrameAssembler};
use vfd_model::wire::rtu::{self, ReplyLength};
use vfd_model::wire::{crc, pdu::function};

pub fn run(bytes: &[u8]) {
    let mut feed = Feed::new(bytes);
    let flags = feed.byte();
    let framing = match (flags & 4, flags & 1) {
        (0, 0) => Framing::Rtu,
        (0, _) => Framing::Ascii,
        _ => Framing::Mbap,
    };
    let seed = feed.byte();
    let expected = (flags & 2 != 0).then(|| expected(framing, &mut feed));
    let expected = expected.as_ref();
    let stream = feed.rest();
    hear(framing, expected, chunks(stream, seed));
    // Only what fits can be complete.
    let stream = &stream[..stream.len().min(2 * framing::max_adu_bytes(framing))];
    let whole = hear(framing, expected, [stream]);
    let in_chunks = hear(framing, expected, chunks(stream, seed));
    let in_bytes = hear(framing, expected, chunks(stream, 0));
    if whole != in_chunks || whole != in_bytes {
        // If two frames share bytes, it cannot be decided which one was sent.
        let is_ambiguous =
            framing == Framing::Rtu && expected.is_some_and(|it| share_bytes(stream, it));
        assert!(
            is_ambiguous,
            "whole {whole:02X?}\nin chunks {in_chunks:02X?}\nin bytes {in_bytes:02X?}"
        );
    }
}

fn expected(framing: Framing, feed: &mut Feed<'_>) -> ExpectedFrame {
    let station = feed.byte();
    let function = feed.byte() & !function::EXCEPTION_BIT;
    ExpectedFrame {
        station,
        function,
        adu_bytes: framing::adu_bytes(framing, 2 + usize::from(feed.byte()) % 252),
    }
}

/// What is found in `chunks`, and what is left.
fn hear<'a>(
    framing: Framing,
    expected: Option<&ExpectedFrame>,
    chunks: impl IntoIterator<Item = &'a [u8]>,
) -> (Vec<FoundFrame>, Vec<u8>) {
    let mut assembler = FrameAssembler::new(framing);
    let mut found = Vec::new();
    let mut put_in = Vec::new();
    let mut given_out = Vec::new();
    for chunk in chunks {
        put_in.extend_from_slice(chunk);
        given_out.extend(assembler.push(chunk));
        while let Some(one) = assembler.take(expected) {
            check(framing, expected, &one);
            given_out.extend_from_slice(&one.noise);
            given_out.extend_from_slice(&one.adu);
            found.push(one);
        }
        assert!(
            assembler.bytes().len() <= assembler.max_bytes(),
            "{} bytes are kept",
            assembler.bytes().len()
        );
        let is_damaged = expected.is_some_and(|expected| assembler.holds_damaged(expected));
        assert!(
            !(is_damaged && assembler.is_empty()),
            "nothing is damaged where nothing is"
        );
    }
    let rest = assembler.clear();
    given_out.extend_from_slice(&rest);
    assert_eq!(given_out, put_in, "bytes in are frames and noise out");
    (found, rest)
}

/// A frame is sound and formats back; after noise an RTU frame is the expected one.
fn check(framing: Framing, expected: Option<&ExpectedFrame>, found: &FoundFrame) {
    assert!(
        found.adu.len() <= framing::max_adu_bytes(framing),
        "{} bytes",
        found.adu.len()
    );
    let (station, pdu) = framing::decode(framing, &found.adu).expect("what is found is sound");
    let mut again = Vec::new();
    framing::encode(framing, &mut again, station, |out| {
        out.extend_from_slice(&pdu)
    });
    match framing {
        Framing::Rtu => assert_eq!(again, found.adu),
        Framing::Ascii => assert_eq!(again, found.adu.to_ascii_uppercase()),
        Framing::Mbap => {
            framing::set_transaction(
                framing,
                &mut again,
                framing::transaction_of(framing, &found.adu).expect("a number"),
            );
            assert_eq!(
                (again, found.noise.is_empty()),
                (found.adu.clone(), true),
                "a stream has no noise"
            );
        }
    }
    if framing == Framing::Rtu && !found.noise.is_empty() {
        let expected = expected.expect("behind noise only the expected reply is looked for");
        assert_eq!(
            (station, pdu[0] & !function::EXCEPTION_BIT),
            (expected.station, expected.function)
        );
    }
}

/// Whether two sound frames overlap somewhere in `stream`.
fn share_bytes(stream: &[u8], expected: &ExpectedFrame) -> bool {
    let places: Vec<_> = (0..stream.len())
        .flat_map(|start| frames_at(stream, start, expected))
        .collect();
    let overlap =
        |one: &Range<usize>, other: &Range<usize>| one.start < other.end && other.start < one.end;
    places
        .iter()
        .enumerate()
        .any(|(n, one)| places[n + 1..].iter().any(|other| overlap(one, other)))
}

/// The sound frames that begin at `start`: by the length of their function, and by those that are expected.
fn frames_at(stream: &[u8], start: usize, expected: &ExpectedFrame) -> Vec<Range<usize>> {
    let known = match rtu::reply_adu_bytes(&stream[start..]) {
        ReplyLength::Known(length) => Some(length),
        ReplyLength::NotYetKnown | ReplyLength::OnlySilenceTells => None,
    };
    let mut lengths = vec![expected.adu_bytes, rtu::EXCEPTION_ADU_BYTES];
    lengths.extend(known);
    lengths.sort_unstable();
    lengths.dedup();
    let places = lengths.into_iter().map(|length| start..start + length);
    places
        .filter(|place| stream.get(place.clone()).is_some_and(crc::is_sound))
        .collect()
}
