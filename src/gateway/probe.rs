//! Reads that detect an echo on the line: before the first write, and while it echoes.

use super::core::{ExchangePurpose, LineCore};
use super::decide::{Picked, is_stop, poll_request};
use super::drive::DriveOnLine;
use super::work::DriveWish;
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::line::echo::LocalEcho;
use crate::wire::pdu::Request;

impl LineCore {
    /// Whether a wish is a write that waits until a read has shown whether the line echoes. A stop never does.
    pub(super) fn needs_probe(&self, want: &DriveWish) -> bool {
        let is_write = !matches!(want.request, Request::Read { .. });
        self.echo.known() == LocalEcho::Unknown && is_write && !is_stop(want.rank)
    }

    /// A drive whose write waits for such a read at `now`.
    pub(super) fn waits_for_probe(&self, now: MonoTime) -> Option<DriveIndex> {
        let waits = |drive: &&DriveOnLine| {
            drive
                .work
                .wants()
                .any(|want| self.needs_probe(&want) && now >= drive.wanted_from(&want))
        };
        self.drives.iter().find(waits).map(|drive| drive.index)
    }

    /// On an echoing line: the read that checks whether it still echoes.
    pub(super) fn pick_due_probe(&mut self, now: MonoTime) -> Option<Picked> {
        if now < self.health.probe_at {
            return None;
        }
        self.health.was_probed(now);
        let answers = self
            .drives
            .iter()
            .find(|drive| !drive.station.is_known_silent());
        Some(self.probe(now, answers.map_or(DriveIndex(0), |drive| drive.index)))
    }

    /// A read for its own sake, if possible one whose reply cannot be mistaken for a late one. Any drive shows whether
    /// our own bytes return, even a silent one.
    pub(super) fn probe(&self, now: MonoTime, drive: DriveIndex) -> Picked {
        let in_turn = || {
            self.drives
                .iter()
                .cycle()
                .skip(drive.get())
                .take(self.drives.len())
        };
        let reads = || {
            in_turn().flat_map(|drive| {
                drive
                    .plan
                    .iter()
                    .map(move |(_, group, _)| (drive, poll_request(group)))
            })
        };
        let is_clear = |(drive, request): &(&DriveOnLine, Request)| {
            now >= drive.station.unmistakable_at(request)
        };
        let (drive, request) = reads()
            .find(is_clear)
            .or_else(|| reads().next())
            .map(|(drive, request)| (drive.index, request))
            .unwrap_or((drive, Request::read(0, 1)));
        (drive, request, ExchangePurpose::Probe)
    }
}
