//! Every write of a client is accounted for once: as an order or a native request at a line, or as an attempt in the
//! journal.

use super::tests::{EVERY_LINE, Kept, Plant, ask, play_with, send};
use super::*;
use crate::daemon::exchange::inbox::{COMMANDS_MAX, INBOX_MAX, STOPS_MAX};
use crate::domain::command::{Order, Reason, Report};
use crate::domain::ids::DriveIndex;
use crate::domain::native::NativeAsk;
use crate::drive::description::DriveRef;
use crate::journal::{TriedWrite, WriteAttempt};
use crate::wire::mbap;
use tokio::io::AsyncReadExt;
use tokio::net::TcpStream;

fn text(text: &str) -> TriedWrite {
    TriedWrite::Text(text.to_owned())
}

fn drive(number: u16) -> Option<DriveRef> {
    Some(DriveRef {
        line: number / 2,
        drive: DriveIndex(number % 2),
    })
}

#[test]
fn what_no_line_saw_is_kept_with_who_what_and_why() {
    let kept = Arc::new(Kept::default());
    let journal: Journal = Some(Arc::clone(&kept) as _);
    play_with(
        EVERY_LINE,
        journal,
        async |plant: Plant, mut stream: TcpStream| {
            for (unit, pdu, place, tried, reason) in [
                (
                    101,
                    &[6, 1, 0, 0, 9][..],
                    drive(0),
                    "unit 101: function 06 at 256: 9",
                    Reason::NotUnderstood,
                ),
                (
                    102,
                    &[6, 1, 0, 0, 1],
                    drive(1),
                    "unit 102: function 06 at 256: 1",
                    Reason::ReadOnly,
                ),
                (
                    103,
                    &[6, 0, 9, 0, 1],
                    drive(2),
                    "unit 103: function 06 at 9: 1",
                    Reason::NotListed,
                ),
                (
                    1,
                    &[5, 0, 0, 0xFF, 0],
                    drive(0),
                    "unit 1: function 05 at 0: 1",
                    Reason::NotCapable,
                ),
                (
                    9,
                    &[6, 0, 0, 0, 1],
                    None,
                    "unit 9: function 06 at 0: 1",
                    Reason::UnknownDrive,
                ),
                (
                    0,
                    &[5, 0, 0, 0xFF, 0],
                    None,
                    "unit 0: function 05 at 0: 1",
                    Reason::NotAllowed,
                ),
                (
                    255,
                    &[6, 0, 0, 0, 1],
                    None,
                    "unit 255: function 06 at 0: 1",
                    Reason::NotCapable,
                ),
                (
                    101,
                    &[6, 1, 0],
                    drive(0),
                    "unit 101: bytes 06 01 00",
                    Reason::NotUnderstood,
                ),
                (
                    101,
                    &[0x17, 0, 99, 0, 1, 1, 0, 0, 1, 2, 0, 1],
                    drive(0),
                    "unit 101: function 17 at 256: 1",
                    Reason::NotListed,
                ),
            ] {
                assert_eq!(
                    ask(&mut stream, unit, pdu).await[0],
                    pdu[0] | 0x80,
                    "{unit} {pdu:?}"
                );
                let all = kept.take();
                let [
                    (
                        found,
                        WriteAttempt {
                            owner,
                            tried: found_tried,
                            report,
                            ..
                        },
                    ),
                ] = &all[..]
                else {
                    panic!("{all:?}")
                };
                assert_eq!(
                    (*found, found_tried),
                    (place, &text(tried)),
                    "{unit} {pdu:?}"
                );
                assert_eq!(*report, Some(Report::refused(reason)), "{unit} {pdu:?}");
                assert_eq!(owner.to_string(), "modbus-tcp 127.0.0.1");
            }
            // Reads are not attempts, nor are writes that order nothing.
            for (unit, pdu) in [
                (9, &[3, 0, 0, 0, 1][..]),
                (101, &[3, 0, 99, 0, 1]),
                (101, &[5, 0, 3, 0, 0]),
                (1, &[7]),
            ] {
                ask(&mut stream, unit, pdu).await;
            }
            assert_eq!(kept.take(), []);
            plant.assert_untouched();
        },
    );
}

#[test]
fn what_a_full_inbox_does_not_take_is_kept_as_the_order_that_it_was() {
    let kept = Arc::new(Kept::default());
    let journal: Journal = Some(Arc::clone(&kept) as _);
    play_with(
        EVERY_LINE,
        journal,
        async |plant: Plant, mut stream: TcpStream| {
            let inbox = &plant.shared.lines[0].inbox;
            for _ in 0..INBOX_MAX + COMMANDS_MAX + STOPS_MAX {
                let _ = inbox.put(LineMessage::Stay);
            }
            assert_eq!(ask(&mut stream, 101, &[6, 1, 0, 0, 0]).await, [0x86, 6]);
            assert_eq!(ask(&mut stream, 1, &[6, 0, 2, 0, 0]).await, [0x86, 6]);
            assert_eq!(
                ask(&mut stream, 101, &[6, 1, 2, 0, 0]).await,
                [0x86, 6],
                "to renew is no attempt"
            );
            let tried: Vec<_> = kept
                .take()
                .into_iter()
                .map(|(place, attempt)| (place, attempt.tried))
                .collect();
            let stop = TriedWrite::Order(Order::Stop { setpoint: None });
            assert_eq!(
                tried,
                [
                    (drive(0), stop),
                    (
                        drive(0),
                        TriedWrite::Registers {
                            address: 2_u16.into(),
                            values: vec![0]
                        }
                    )
                ]
            );
        },
    );
}

/// A random generator that repeats its numbers in every run.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, sides: u64) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % sides
    }

    fn one_of<T: Copy>(&mut self, all: &[T]) -> T {
        all[usize::try_from(self.roll(all.len() as u64)).unwrap()]
    }

    /// A write request, valid or not.
    fn write(&mut self) -> (u8, Vec<u8>) {
        let unit = self.one_of(&[1, 2, 3, 4, 101, 102, 103, 104, 0, 9, 255]);
        let address = self
            .one_of(&[0, 1, 2, 3, 4, 255, 256, 257, 258, 259, 0x020C, 0xFFFF_u16])
            .to_be_bytes();
        let value = self
            .one_of(&[0, 1, 2, 4, 5, 6, 9, 4_250, 0xFF00, 0xFFFF_u16])
            .to_be_bytes();
        let function = self.one_of(&[5, 6, 0x0F, 0x10, 0x16, 0x17_u8]);
        let mut pdu = vec![function];
        match function {
            5 | 6 => pdu.extend([address, value].concat()),
            0x0F => pdu.extend([&address[..], &[0, 2, 1, value[1] & 3]].concat()),
            0x10 => pdu.extend([&address[..], &[0, 1, 2], &value].concat()),
            0x16 => pdu.extend([address, [0, 0], value].concat()),
            _ => pdu.extend(
                [
                    &[0, self.one_of(&[0, 90]), 0, 1][..],
                    &address,
                    &[0, 1, 2],
                    &value,
                ]
                .concat(),
            ),
        }
        if self.roll(12) == 0 {
            pdu.pop();
        }
        // A stop of all is an order for each drive.
        let stops_all = unit == 255 && matches!(function, 5 | 0x0F);
        (if stops_all { 0 } else { unit }, pdu)
    }
}

/// Answers in `bytes`: exceptions, and others.
fn answers(mut bytes: &[u8]) -> (usize, usize) {
    let mut exceptions = 0;
    let mut others = 0;
    while let Ok(Some(message)) = mbap::decode(bytes) {
        if message.pdu[0] & 0x80 == 0 {
            others += 1;
        } else {
            exceptions += 1;
        }
        bytes = &bytes[message.adu_bytes..];
    }
    (exceptions, others)
}

#[test]
fn every_write_is_an_order_or_kept_or_was_nothing_to_do() {
    const AT_ONCE: usize = 24;
    let kept = Arc::new(Kept::default());
    let journal: Journal = Some(Arc::clone(&kept) as _);
    play_with(EVERY_LINE, journal, async |plant: Plant, _: TcpStream| {
        let mut dice = Dice(7);
        for round in 0..60 {
            let requests: Vec<_> = (0..AT_ONCE).map(|_| dice.write()).collect();
            let mut stream = TcpStream::connect(plant.address).await.unwrap();
            let sent: Vec<_> = requests
                .iter()
                .map(|(unit, pdu)| (7, *unit, &pdu[..]))
                .collect();
            send(&mut stream, &sent).await;
            let mut received = Vec::new();
            let mut orders = 0;
            let begun = Instant::now();
            let (exceptions, others) = loop {
                let mut buffer = [0; 4096];
                let read =
                    tokio::time::timeout(Duration::from_millis(5), stream.read(&mut buffer)).await;
                received.extend_from_slice(&buffer[..read.map_or(0, |read| read.unwrap())]);
                orders += plant
                    .shared
                    .lines
                    .iter()
                    .map(|line| writes_in(&line.inbox))
                    .sum::<usize>();
                let (exceptions, others) = answers(&received);
                if exceptions + others + orders >= AT_ONCE {
                    break (exceptions, others);
                }
                assert!(
                    begun.elapsed() < Duration::from_secs(4),
                    "{round}: {exceptions} {others} {orders}"
                );
            };
            let all = kept.take();
            assert_eq!(
                all.len(),
                exceptions,
                "{round}: an exception without a line is kept: {requests:?} {all:?}"
            );
            assert_eq!(all.len() + orders + others, AT_ONCE, "{round}: once each");
        }
    });
}

fn writes_in(inbox: &crate::daemon::exchange::inbox::LineInbox) -> usize {
    let mut batch = Vec::new();
    inbox.take(&mut batch);
    let is_write = |message: &LineMessage| match message {
        LineMessage::Command(_) | LineMessage::NativeStop(_) => true,
        LineMessage::Native(request) => matches!(request.ask, NativeAsk::Write { .. }),
        _ => false,
    };
    batch.iter().filter(|message| is_write(message)).count()
}
