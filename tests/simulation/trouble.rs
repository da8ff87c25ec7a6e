//! Faults other than those of replies: drives, line, port.

use super::world::World;
use std::time::Duration;
use vfd_gateway::domain::report::LineFault;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::sim::FaultPlan;

/// A kind of trouble.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Trouble {
    /// A drive is switched off, and on again later.
    PowerOff,
    /// A drive trips.
    Trip,
    /// The port is gone for a while.
    PortDown,
    /// Some stray bytes on the wire.
    Noise,
    /// A sound frame of a foreign station.
    Foreign,
    /// A node that talks without a pause for a while.
    Babble,
    /// The replies go wrong more often for a while.
    Rough,
    /// Nothing goes wrong with replies for a while.
    Calm,
}

impl Trouble {
    pub const COUNT: usize = 8;
    pub const NAMES: [&str; Self::COUNT] = [
        "power off",
        "trip",
        "port down",
        "noise",
        "foreign frame",
        "babble",
        "rough",
        "calm",
    ];
    const ALL: [Self; Self::COUNT] = [
        Self::PowerOff,
        Self::Trip,
        Self::PortDown,
        Self::Noise,
        Self::Foreign,
        Self::Babble,
        Self::Rough,
        Self::Calm,
    ];
}

/// Most bytes that a babbling node puts on the wire at once.
const BABBLE: usize = 120;

impl World {
    /// Something goes wrong.
    pub fn make_trouble(&mut self) {
        let trouble = Trouble::ALL[self.rng.usize(0..Trouble::COUNT)];
        if self.plan.only_reads {
            return;
        }
        self.tally.troubles[trouble as usize] += 1;
        let which = self.rng.u8(0..self.plan.line.drives.len() as u8);
        self.checker.note(
            self.now.as_nanos(),
            which.into(),
            Trouble::NAMES[trouble as usize],
        );
        let station = self.station(which.into());
        let now = self.now;
        let lasts = Duration::from_millis(self.rng.u64(50..15_000));
        match trouble {
            Trouble::PowerOff => {
                self.bus.set_powered(now, station, false);
                self.look_at_motor(which.into(), now);
                self.repair_in(lasts, trouble, which);
            }
            Trouble::Trip => {
                let cause = self.rng.u16(1..13);
                if let Some(drive) = self.bus.drive_mut(station) {
                    if drive.is_powered() {
                        self.checker.tripped(which.into());
                    }
                    drive.trip(now, cause);
                }
                self.look_at_motor(which.into(), now);
            }
            Trouble::PortDown if self.is_port_up => {
                self.is_port_up = false;
                self.checker.port(now.as_nanos(), false);
                self.core.handle(now, LineInput::PortDown(LineFault::Gone));
                self.repair_in(lasts, trouble, which);
            }
            Trouble::PortDown => {}
            Trouble::Noise | Trouble::Babble => {
                let most = if trouble == Trouble::Noise { 8 } else { BABBLE };
                let bytes: Vec<u8> = (0..self.rng.usize(1..=most))
                    .map(|_| self.rng.u8(..))
                    .collect();
                self.bus.speak(now, &bytes);
                if trouble == Trouble::Babble && self.rng.u8(0..4) > 0 {
                    let pause = Duration::from_millis(self.rng.u64(1..60));
                    self.repair_in(pause, trouble, which);
                }
            }
            Trouble::Foreign => {
                let frame = self.foreign_frame();
                self.bus.speak(now, &frame);
            }
            Trouble::Rough => {
                let mut chance = || self.rng.u16(0..300);
                let lost = chance();
                let late = chance();
                let cut = chance();
                let flip = chance();
                self.bus.set_faults(FaultPlan {
                    lost,
                    late,
                    cut,
                    flip,
                    ..self.plan.faults
                });
                self.repair_in(lasts, trouble, which);
            }
            Trouble::Calm => {
                self.bus.set_faults(FaultPlan::NONE);
                self.repair_in(lasts, trouble, which);
            }
        }
    }

    /// The reply of a station that is not ours to a read.
    fn foreign_frame(&mut self) -> Vec<u8> {
        let mut frame = Vec::new();
        let station = self.rng.u8(100..200);
        let word = self.rng.u16(..);
        vfd_gateway::wire::rtu::encode(&mut frame, station, |pdu| {
            pdu.extend([3, 2]);
            pdu.extend(word.to_be_bytes());
        });
        frame
    }

    /// Undoes the fault after `time`.
    pub fn repair_in(&mut self, time: Duration, trouble: Trouble, which: u8) {
        let at = self.now + time;
        let place = self.repairs.partition_point(|(other, ..)| *other <= at);
        self.repairs.insert(place, (at, trouble, which));
    }

    /// Undoes the fault.
    pub fn repair(&mut self, trouble: Trouble, which: u8) {
        self.checker
            .note(self.now.as_nanos(), which.into(), "repaired");
        match trouble {
            Trouble::PowerOff => {
                let station = self.station(which.into());
                self.bus.set_powered(self.now, station, true);
                self.look_at_motor(which.into(), self.now);
            }
            Trouble::PortDown if !self.is_port_up => self.open_port(),
            Trouble::Babble => {
                let bytes: Vec<u8> = (0..self.rng.usize(1..=BABBLE))
                    .map(|_| self.rng.u8(..))
                    .collect();
                self.bus.speak(self.now, &bytes);
                if self.rng.u8(0..12) > 0 {
                    let pause = Duration::from_millis(self.rng.u64(1..60));
                    self.repair_in(pause, trouble, which);
                }
            }
            Trouble::Rough | Trouble::Calm => self.bus.set_faults(self.plan.faults),
            _ => {}
        }
    }
}
