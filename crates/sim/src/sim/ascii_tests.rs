//! A bus with ASCII frames: when requests begin and end there, and what the observer counts.

use super::testing::*;
use super::*;
use crate::domain::ids::Station;
use crate::domain::link::{Framing, LinkSettings, Parity};
use crate::domain::time::MonoTime;
use crate::profile::model::{Confidence, Fact, Model};
use std::sync::Arc;
use std::time::Duration;

/// A character takes 1 ms, with 7 data bits as with 8.
const LINK: LinkSettings = LinkSettings {
    baud: 10_000,
    data_bits: 7,
    parity: Parity::Even,
    stop_bits: 1,
};
const D001: &[u8] = b":010301010001F9\r\n";
const STANDSTILL: &[u8] = b":0103020000FA\r\n";

fn ms(millis: u64) -> MonoTime {
    MonoTime::from_millis(millis)
}

fn bus_with(model: Arc<Model>) -> SimBus {
    let mut bus = SimBus::new(
        LINK,
        BusOptions {
            framing: Framing::Ascii,
            ..BusOptions::default()
        },
        0,
    );
    bus.connect(Station(1), SimDrive::new(model, DriveOptions::default()));
    bus
}

#[test]
fn requests_are_answered_in_text_at_their_moments() {
    let mut bus = bus_with(n700());
    bus.receive(ms(0), D001);
    // 17 characters, 2 ms of turnaround, and the first of 15 characters.
    assert_eq!(bus.next_due(), Some(ms(17 + 2 + 1)));
    assert_eq!(taken(&mut bus, ms(33)), STANDSTILL[..14]);
    assert_eq!(taken(&mut bus, ms(34)), STANDSTILL[14..]);
    bus.receive(ms(100), &D001.to_ascii_lowercase());
    assert_eq!(taken(&mut bus, ms(200)), STANDSTILL);
    for (n, byte) in D001.iter().enumerate() {
        bus.receive(ms(300 + 900 * n as u64), &[*byte]);
    }
    assert_eq!(taken(&mut bus, ms(20_000)), STANDSTILL);
    assert_eq!((bus.report().requests_heard, bus.report().bad_crc), (3, 0));
}

#[test]
fn what_makes_no_frame_is_ignored_and_counted() {
    for (damaged, bad) in [
        (&b":010301010001F8\r\n"[..], 1),
        (b":0103", 1),
        (b":0103:010301:", 3),
        (b"\r\n", 1),
        (&[b'0'; 2_000], 1),
        (b":\r\n\r\n", 2),
    ] {
        let mut bus = bus_with(n700());
        bus.receive(ms(0), damaged);
        assert!(taken(&mut bus, ms(5_000)).is_empty());
        bus.receive(ms(5_000), D001);
        assert_eq!(taken(&mut bus, ms(6_000)), STANDSTILL, "{damaged:?}");
        assert_eq!(
            (bus.report().bad_crc, bus.report().requests_heard),
            (bad, 1),
            "{damaged:?}"
        );
    }
}

#[test]
fn a_colon_restarts_a_request_and_a_second_of_silence_ends_it() {
    let mut bus = bus_with(n700());
    bus.receive(ms(0), b":0103010100");
    bus.receive(ms(500), D001);
    assert_eq!(taken(&mut bus, ms(900)), STANDSTILL);
    bus.receive(ms(1_000), &D001[..8]);
    bus.receive(ms(2_008), &D001[8..]);
    assert!(taken(&mut bus, ms(4_000)).is_empty());
    assert_eq!((bus.report().bad_crc, bus.report().requests_heard), (3, 1));
}

#[test]
fn the_silence_that_is_required_is_ten_milliseconds_or_what_a_model_needs() {
    let mut patient = Model::clone(&n700());
    let pause = Fact {
        value: Duration::from_millis(20),
        confidence: Confidence::Manual,
        source: String::new(),
    };
    patient.quirks.pause_before_request = Some(pause);
    let patient = Arc::new(patient);
    for (model, silence) in [(n700(), 10), (Arc::clone(&patient), 20)] {
        for (gap, too_short) in [(silence, 0), (silence - 1, 1)] {
            let mut bus = bus_with(Arc::clone(&model));
            assert_eq!(bus.required_silence(), Duration::from_millis(silence));
            bus.receive(ms(0), D001);
            taken(&mut bus, ms(34));
            bus.receive(ms(34 + gap), D001);
            assert_eq!(
                (bus.report().gaps_too_short, bus.report().talked_over),
                (too_short, 0)
            );
        }
    }
    let mut rtu = SimBus::new(LinkSettings::DEFAULT, BusOptions::default(), 0);
    rtu.connect(Station(1), SimDrive::new(patient, DriveOptions::default()));
    assert_eq!(rtu.required_silence(), Duration::from_millis(20));
}
