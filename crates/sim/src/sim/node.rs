//! A drive on the bus, with the times of its transmissions.

use super::drive::SimDrive;
use crate::domain::ids::Station;
use crate::domain::time::MonoTime;
use std::time::Duration;

/// A drive on the bus.
#[derive(Debug)]
pub(super) struct SimNode {
    pub station: Station,
    pub drive: SimDrive,
    pub exchanges: u64,
    /// End of its last transmission.
    pub busy_until: MonoTime,
    /// End of its last transmission that is not on time.
    pub late_until: MonoTime,
    /// The pause that it needs after the newest request, and until when.
    pause: Duration,
    pauses_until: MonoTime,
}

impl SimNode {
    pub fn new(station: Station, drive: SimDrive) -> Self {
        let never = MonoTime::ZERO;
        let pause = Duration::ZERO;
        Self {
            station,
            drive,
            exchanges: 0,
            busy_until: never,
            late_until: never,
            pause,
            pauses_until: never,
        }
    }

    /// Whether it takes a request with `pdu` that began at `start` and ended at `end`: not before the end of its pause.
    pub fn takes(&mut self, start: MonoTime, end: MonoTime, pdu: &[u8]) -> bool {
        if start < self.pauses_until {
            return false;
        }
        self.pause = self.drive.pause_after(pdu);
        self.pauses_until = end + self.pause;
        true
    }

    /// The node transmits until `end`; `is_late` if it should have done so earlier.
    pub fn transmits(&mut self, end: MonoTime, is_late: bool) {
        self.busy_until = end;
        if self.pause > Duration::ZERO {
            self.pauses_until = end + self.pause;
        }
        if is_late {
            self.late_until = end;
        }
    }
}
