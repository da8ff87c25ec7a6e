//! One frame that stops every drive of a line, sent if all of them are to be stopped anyway. It confirms nothing: each
//! drive is then sent its own stop and read back.

use super::drive::LineDrives;
use super::setup::LineSetup;
use crate::domain::ids::Station;
use crate::domain::time::MonoTime;
use crate::profile::model::ModelBroadcast;
use crate::wire::pdu::{Request, function};

/// Minimum number of drives that wait for their first stop: a single one is sent its own.
const MANY: usize = 2;

/// The stop of all drives of a line.
#[derive(Debug)]
pub(super) struct BroadcastStop {
    /// The station that stops all drives, if the line has one.
    station: Option<u8>,
    /// The frame that is handed to the port is this stop.
    is_in_port: bool,
}

impl BroadcastStop {
    pub fn of(setup: &LineSetup) -> Self {
        Self {
            station: station_for_all(setup),
            is_in_port: false,
        }
    }

    /// Whether what is sent to `station` is for all drives of the line.
    pub fn is_for_all(&self, station: Station) -> bool {
        station == Station(0) || self.station == Some(station.0)
    }

    /// The stop that every one of `drives` waits for, if it is the same for all and several of them were never sent it. One
    /// that was sent without effect so far is repeated anyway.
    pub fn common(&self, drives: &LineDrives, now: MonoTime) -> Option<(u8, Request)> {
        let station = self.station?;
        let unsent = drives.works().filter_map(|work| work.latch()?.unsent());
        let stop = unsent.clone().next()?;
        if unsent.count() < MANY {
            return None;
        }
        let is_common = drives.works().all(|work| {
            // One that is left to its watchdog is sent nothing.
            let latch = work.latch().filter(|latch| !latch.is_silent(now));
            latch.is_some_and(|latch| latch.frame().1 == stop)
        });
        is_common.then_some((station, stop))
    }

    /// Another frame is decided on.
    pub const fn is_over(&mut self) {
        self.is_in_port = false;
    }

    /// Marks the broadcast as sent: its frame is handed to the port next.
    pub const fn is_sent(&mut self) {
        self.is_in_port = true;
    }

    /// The port has taken a frame. Returns whether it was this stop.
    pub const fn was_transmitted(&mut self) -> bool {
        std::mem::replace(&mut self.is_in_port, false)
    }
}

/// The broadcast station that stops all drives of a line: it must be documented for their model, which must be the same
/// for all, and each must have a control section. `None` otherwise, or if there is only one drive, or a connection that
/// carries no broadcasts.
fn station_for_all(setup: &LineSetup) -> Option<u8> {
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
