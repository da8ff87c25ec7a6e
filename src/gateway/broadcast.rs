//! One frame that stops every drive of a line, sent where all of them are to be stopped anyway. It confirms nothing: each
//! drive gets its own stop behind it and is looked at.

use super::core::LineCore;
use super::event::Effect;
use super::setup::LineSetup;
use super::work::DriveWork;
use crate::domain::time::MonoTime;
use crate::domain::traffic::{TrafficKind, TrafficRecord};
use crate::profile::model::Broadcast;
use crate::wire::pdu::{Request, function};
use std::time::Duration;

/// How long a line is left alone after a broadcast, so that every drive has done what it says (Modbus over serial line
/// V1.02, 2.4.1: typically 100 to 200 ms).
pub const TURNAROUND: Duration = Duration::from_millis(100);

/// The station that stops all drives of a line: documented for their model, which must be the same for all, and each
/// must be under control. Nothing where one of that is missing, or where there is only one drive.
pub(super) fn station_for_all(setup: &LineSetup) -> Option<u8> {
    let (first, others) = setup.drives.split_first()?;
    let Broadcast { station, functions } = first.model.link.broadcast.as_ref()?;
    let is_sure = station.confidence.is_proven() && functions.contains(&function::WRITE_SINGLE);
    let are_alike = others.iter().all(|other| other.model.id == first.model.id);
    let are_controlled = setup.drives.iter().all(|drive| drive.control.is_some());
    (is_sure && are_alike && are_controlled && !others.is_empty()).then_some(station.value)
}

impl LineCore {
    /// Sends the stop that every drive of the line waits for as one frame, if there is such a stop. Whether it did.
    pub(super) fn stop_all(&mut self, now: MonoTime) -> bool {
        let Some((station, request)) = self.common_stop() else { return false };
        self.works.iter_mut().for_each(DriveWork::stop_was_broadcast);
        let mut frame = Vec::with_capacity(16);
        self.wire.broadcast(now, station, &request, TURNAROUND, &mut frame);
        self.counters.requests += 1;
        self.counters.broadcasts += 1;
        if self.setup.tells_traffic {
            let record = TrafficRecord { at: now, kind: TrafficKind::Request, bytes: frame.clone() };
            self.effects.push_back(Effect::Traffic(record));
        }
        self.effects.push_back(Effect::Transmit(frame));
        true
    }

    /// The stop that was never sent to any of the drives and is the same for all.
    fn common_stop(&self) -> Option<(u8, Request)> {
        let station = self.all_stop_at?;
        let (first, others) = self.works.split_first()?;
        let stop = first.unsent_stop()?;
        let is_common = others.iter().all(|other| other.unsent_stop().as_ref() == Some(&stop));
        is_common.then_some((station, stop))
    }
}
