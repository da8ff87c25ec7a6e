//! Shared helpers for the families' tests: requests to one drive without a bus. Addresses, words and scales are typed
//! from the vendors' manuals.

mod bits;
mod elsewhere;
mod memory;
mod power;
mod priority;
mod requests;
mod trips;
mod values;
mod watchdog;
mod words;

use super::*;
use crate::sim::motor::MICROHERTZ;
use crate::sim::options::BadRequest;
use crate::sim::testing::*;
use crate::wire::pdu;

/// A drive of the built-in model called `id`, ready to be commanded.
fn ready(id: &str) -> SimDrive {
    SimDrive::new(model(id), DriveOptions::default())
}

fn ms(millis: u64) -> MonoTime {
    MonoTime::from_millis(millis)
}

fn ask(drive: &mut SimDrive, at: MonoTime, pdu: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    drive.answer(at, pdu, 0x1_0007, &mut out).then_some(out)
}

/// The whole reply to a write.
fn send(drive: &mut SimDrive, at: MonoTime, address: u16, value: u16) -> Option<Vec<u8>> {
    let mut pdu = vec![6];
    pdu::put_words(&mut pdu, &[address, value]);
    ask(drive, at, &pdu)
}

/// What the drive holds after a write, as its reply says.
#[track_caller]
fn write(drive: &mut SimDrive, at: MonoTime, address: u16, value: u16) -> u16 {
    let reply = send(drive, at, address, value).unwrap();
    assert_eq!(reply.len(), 5, "{reply:02X?}");
    assert_eq!((reply[0], &reply[1..3]), (6, &address.to_be_bytes()[..]));
    u16::from_be_bytes([reply[3], reply[4]])
}

/// Writes that the drive takes.
#[track_caller]
fn take(drive: &mut SimDrive, at: MonoTime, writes: &[(u16, u16)]) {
    for (address, value) in writes {
        assert_eq!(write(drive, at, *address, *value), *value, "{address:04X}");
    }
}

/// The exception code with which the drive refuses a write.
#[track_caller]
fn refused(drive: &mut SimDrive, at: MonoTime, address: u16, value: u16) -> u8 {
    let reply = send(drive, at, address, value).unwrap();
    assert_eq!((reply.len(), reply[0]), (2, 0x86), "{reply:02X?}");
    reply[1]
}

fn read(drive: &mut SimDrive, at: MonoTime, address: u16, count: u16) -> Option<Vec<u16>> {
    let mut pdu = vec![3];
    pdu::put_words(&mut pdu, &[address, count]);
    let reply = ask(drive, at, &pdu)?;
    assert_eq!(reply[..2], [3, (2 * count) as u8], "{reply:02X?}");
    Some(pdu::words(&reply[2..]))
}

#[track_caller]
fn word(drive: &mut SimDrive, at: MonoTime, address: u16) -> u16 {
    read(drive, at, address, 1).unwrap()[0]
}

fn hertz(drive: &SimDrive, at: MonoTime) -> i64 {
    drive.output(at) / MICROHERTZ
}
