//! Simulated drives on a simulated bus, as a gateway sees them on the wire; without a clock and without I/O.
//!
//! | part | what it plays |
//! | --- | --- |
//! | [`motor`] | an output frequency that ramps; a pure function of time |
//! | [`trip`] | trip count and trip records |
//! | [`drive`] | one drive, from the same model file that the gateway reads: PDUs in, PDUs out |
//! | [`options`] | properties of a drive that the model does not state |
//! | `incoming` | the master's bytes, until they form a request |
//! | `node` | a drive on the bus: when it transmits, and its pauses |
//! | `transmissions` | pending transmissions of the drives, and their collisions |
//! | [`fault`] | seeded faults of replies |
//! | [`report`] | counters of an observer on the wire |
//! | `bus_options` | the behaviour of a bus |
//! | [`bus`] | the half-duplex line: character times, turnaround, requests in, reply bytes out |
//!
//! The owner of a clock and a port drives a [`SimBus`] with three calls:
//!
//! 1. [`SimBus::receive`]: the master wrote these bytes to the port at this moment;
//! 2. [`SimBus::next_due`]: when to call again;
//! 3. [`SimBus::take_due`]: the bytes that are on the wire by now.
//!
//! Everything is repeatable: the same seed and the same calls give the same bytes at the same moments.
//! Nothing here uses the rooms that it tests; both sides share only the model.

pub mod bus;
mod bus_options;
pub mod drive;
pub mod fault;
mod incoming;
pub mod motor;
mod node;
pub mod options;
#[cfg(test)]
mod printed;
pub mod report;
mod transmissions;
pub mod trip;

pub use bus::SimBus;
pub use bus_options::{BusOptions, BusPacing};
pub use drive::SimDrive;
pub use fault::FaultPlan;
pub use options::{BadRequest, DriveOptions, RefusedStops};
pub use report::{BusReport, DriveReport};
pub use transmissions::BusDelivery;

#[cfg(test)]
mod ascii_tests;

#[cfg(test)]
mod testing {
    //! The model and the frames that the tests of this room share. Addresses and scales are typed from the
    //! interface manual of the Hyundai N700, not read from the model file.

    use super::*;
    use crate::domain::ids::Station;
    use crate::domain::link::{Framing, LinkSettings};
    use crate::domain::time::MonoTime;
    use crate::profile::catalog::Catalog;
    use crate::profile::model::Model;
    use crate::vendors;
    use std::sync::{Arc, LazyLock};
    use std::time::Duration;

    pub const RUN: u16 = 0x0002;
    pub const SETPOINT: u16 = 0x0004;
    pub const OUTPUT: u16 = 0x0101;
    pub const TRIP_COUNT: u16 = 0x0112;
    pub const F001: u16 = 0x0201;
    pub const F007: u16 = 0x020C;
    pub const F008: u16 = 0x020E;
    pub const F010: u16 = 0x0211;
    pub const F011: u16 = 0x0212;

    pub fn seconds(seconds: u64) -> MonoTime {
        MonoTime::from_millis(seconds * 1_000)
    }

    /// The built-in model called `id`.
    pub fn model(id: &str) -> Arc<Model> {
        static MODELS: LazyLock<Catalog> = LazyLock::new(vendors::catalog);
        Arc::clone(MODELS.find(id).expect("a built-in model"))
    }

    pub fn n700() -> Arc<Model> {
        model("hyundai-n700")
    }

    /// A bus with drives of the default options at `stations`.
    pub fn bus(options: BusOptions, seed: u64, stations: &[u8]) -> SimBus {
        let mut bus = SimBus::new(LinkSettings::DEFAULT, options, seed);
        for station in stations {
            let options = DriveOptions {
                proof_words: Some(0x3000..=0x3FFF),
                ..DriveOptions::default()
            };
            bus.connect(Station(*station), SimDrive::new(n700(), options));
        }
        bus
    }

    pub const UNPACED: BusOptions = BusOptions {
        framing: Framing::Rtu,
        pacing: BusPacing::None,
        turnaround: Duration::ZERO,
        silence: None,
        delivery: BusDelivery::Characters,
        faults: FaultPlan::NONE,
    };

    /// A frame of six bytes and their CRC.
    pub fn frame(station: u8, function: u8, first: u16, second: u16) -> Vec<u8> {
        let mut frame = Vec::new();
        crate::wire::rtu::encode(&mut frame, station, |pdu| {
            pdu.push(function);
            crate::wire::pdu::put_words(pdu, &[first, second]);
        });
        frame
    }

    /// All bytes on the wire until `at`.
    pub fn taken(bus: &mut SimBus, at: MonoTime) -> Vec<u8> {
        let mut bytes = Vec::new();
        bus.take_due(at, |_, due| bytes.extend_from_slice(due));
        bytes
    }

    pub fn from_hex(hex: &str) -> Vec<u8> {
        (0..hex.len())
            .step_by(2)
            .map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::testing::*;
    use super::*;
    use crate::domain::ids::Station;
    use crate::domain::time::MonoTime;
    use serde_json::Value;

    /// Every frame that the interface manual prints for the model, and those derived from its misprints.
    fn printed_frames() -> Vec<Value> {
        let all: Value =
            serde_json::from_str(include_str!("../../../../tests/data/hyundai-frames.json"))
                .unwrap();
        all.as_array()
            .unwrap()
            .iter()
            .filter(|frame| frame["drive"] == "n700")
            .cloned()
            .collect()
    }

    /// Brings the drive into the state in which the printed answer is due: a setpoint and an output
    /// frequency for a read, the time for the ramp included.
    fn prepare(bus: &mut SimBus, request: &[u8], value: Option<u16>) -> MonoTime {
        let address = u16::from_be_bytes([request[2], request[3]]);
        let word = value.unwrap_or(0);
        let mut send = |at, address, value| {
            bus.receive(at, &frame(1, 6, address, value));
            taken(bus, at);
        };
        match (request[1], address) {
            (3, OUTPUT | F001) => {
                send(seconds(1), SETPOINT, word);
                send(seconds(1), RUN, u16::from(word > 0));
            }
            (3, F007) => send(seconds(1), F007, word),
            (6, RUN | SETPOINT | F007 | F008 | F010 | F011 | 0x0202 | 0x0203) => {}
            other => panic!("no state is known for {other:?}"),
        }
        seconds(100)
    }

    #[test]
    fn every_frame_pair_of_the_manual_is_played() {
        let mut played = 0;
        for printed in printed_frames() {
            let Some(response) = printed["response"].as_str().map(from_hex) else {
                continue;
            };
            let request = from_hex(printed["request"].as_str().unwrap());
            let mut bus = bus(UNPACED, 0, &[1]);
            let value = printed["decoded"]["raw"][0].as_u64().map(|raw| raw as u16);
            let at = prepare(&mut bus, &request, value);
            bus.receive(at, &request);
            let address = u16::from_be_bytes([request[2], request[3]]);
            // A misprinted frame addresses a register that the model does not have: an invalid request.
            let expected = if address == 0x0203 { vec![] } else { response };
            assert_eq!(taken(&mut bus, at), expected, "{}", printed["what"]);
            played += 1;
        }
        assert_eq!(played, 19);
    }

    #[test]
    fn printed_frames_with_a_wrong_crc_are_ignored() {
        let mut played = 0;
        for printed in printed_frames()
            .iter()
            .filter(|printed| printed["valid_crc"] == false)
        {
            let mut bus = bus(UNPACED, 0, &[1]);
            bus.receive(seconds(1), &from_hex(printed["request"].as_str().unwrap()));
            assert!(
                taken(&mut bus, seconds(2)).is_empty(),
                "{}",
                printed["what"]
            );
            assert_eq!((bus.report().bad_crc, bus.report().requests_heard), (1, 0));
            played += 1;
        }
        assert_eq!(played, 4);
    }

    #[test]
    fn a_misprinted_read_is_a_read_of_the_other_register() {
        // The compact column of the F007 read repeats the frame that reads F001.
        let mut bus = bus(UNPACED, 0, &[1]);
        bus.receive(seconds(1), &frame(1, 6, SETPOINT, 5000));
        taken(&mut bus, seconds(1));
        bus.receive(seconds(2), &from_hex("010302010001D472"));
        assert_eq!(taken(&mut bus, seconds(2)), from_hex("0103021388B512"));
        assert_eq!(bus.exchange(Station(1)), 2);
    }
}
