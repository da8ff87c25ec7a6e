//! One frame that stops every drive of a line, sent if all of them are to be stopped anyway. It confirms nothing: each
//! drive is then sent its own stop and read back.

use super::core::LineCore;
use super::setup::LineSetup;
use super::work::DriveWork;
use crate::domain::time::MonoTime;
use crate::domain::traffic::FramePurpose;
use crate::line::budget::BROADCAST_TURNAROUND;
use crate::profile::model::ModelBroadcast;
use crate::wire::pdu::{Request, function};

/// The broadcast station that stops all drives of a line: it must be documented for their model, which must be the same
/// for all, and each must have a control section. `None` otherwise, or if there is only one drive, or a connection that
/// carries no broadcasts.
pub(super) fn station_for_all(setup: &LineSetup) -> Option<u8> {
    if setup.timing.may_have_converter() {
        return None;
    }
    let (first, others) = setup.drives.split_first()?;
    let ModelBroadcast { station, functions } = first.model.link.broadcast.as_ref()?;
    let is_sure = station.confidence.is_proven() && functions.contains(&function::WRITE_SINGLE);
    let are_alike = others.iter().all(|other| other.model.id == first.model.id);
    let are_controlled = setup.drives.iter().all(|drive| drive.control.is_some());
    (is_sure && are_alike && are_controlled && !others.is_empty()).then_some(station.value)
}

/// Minimum number of drives that wait for their first stop: a single one is sent its own.
const MANY: usize = 2;

impl LineCore {
    /// Sends the stop that every drive of the line waits for as one frame, if there is such a stop. Returns whether it did.
    pub(super) fn stop_all(&mut self, now: MonoTime) -> bool {
        let Some((station, request)) = self.common_stop(now) else {
            return false;
        };
        self.measured.sent(now.since(self.wire.may_send_from()));
        let mut frame = Vec::with_capacity(16);
        self.wire
            .broadcast(now, station, &request, BROADCAST_TURNAROUND, &mut frame);
        let end = now + self.timing.on_wire(frame.len());
        for drive in self.drives.iter_mut() {
            drive
                .station
                .pause_until(end + drive.setup.model.timing.pause_after(false));
        }
        self.counters.requests += 1;
        self.counters.broadcasts += 1;
        self.stops_all = true;
        self.transmit(now, frame, FramePurpose::Stop);
        true
    }

    /// The stop that every drive waits for, if it is the same for all and several of them were never sent it. One that
    /// was sent without effect so far is repeated anyway.
    fn common_stop(&self, now: MonoTime) -> Option<(u8, Request)> {
        let station = self.all_stop_at?;
        let unsent = self.drives.works().filter_map(DriveWork::unsent_stop);
        let stop = unsent.clone().next()?;
        if unsent.count() < MANY {
            return None;
        }
        let is_common = self
            .drives
            .works()
            .all(|work| work.stop_frame(now).as_ref() == Some(&stop));
        is_common.then_some((station, stop))
    }
}
