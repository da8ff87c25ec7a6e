//! Reads that detect an echo on the line: before the first write, and while it echoes.

use super::drive::{DriveOnLine, LineDrives};
use super::flight::{ExchangePurpose, PickedRequest, is_stop, poll_request};
use super::work::DriveWish;
use crate::domain::ids::DriveIndex;
use crate::domain::time::MonoTime;
use crate::line::echo::LocalEcho;
use crate::wire::pdu::Request;

/// Whether a wish is a write that waits until a read has shown whether the line echoes. A stop never does.
pub(super) fn is_needed(echo: LocalEcho, want: &DriveWish) -> bool {
    let is_write = !matches!(want.request, Request::Read { .. });
    echo == LocalEcho::Unknown && is_write && !is_stop(want.rank)
}

/// A drive whose write waits for such a read at `now`.
pub(super) fn waited_for(
    drives: &LineDrives,
    echo: LocalEcho,
    now: MonoTime,
) -> Option<DriveIndex> {
    let waits = |drive: &&DriveOnLine| {
        drive
            .work
            .wants()
            .any(|want| is_needed(echo, &want) && now >= drive.wanted_from(&want))
    };
    drives.iter().find(waits).map(|drive| drive.index)
}

/// A read of any drive, if possible of one that answers.
pub(super) fn of_any(drives: &LineDrives, now: MonoTime) -> PickedRequest {
    let answers = drives.iter().find(|drive| !drive.station.is_known_silent());
    of_drive(
        drives,
        now,
        answers.map_or(DriveIndex(0), |drive| drive.index),
    )
}

/// A read of `drive` or one after it, for its own sake, if possible one whose reply cannot be mistaken for a late one. Any
/// drive shows whether our own bytes return, even a silent one.
pub(super) fn of_drive(drives: &LineDrives, now: MonoTime, drive: DriveIndex) -> PickedRequest {
    let in_turn = || drives.iter().cycle().skip(drive.get()).take(drives.len());
    let reads = || {
        in_turn().flat_map(|drive| {
            drive
                .plan
                .iter()
                .map(move |(_, group, _)| (drive, poll_request(group)))
        })
    };
    let is_clear =
        |(drive, request): &(&DriveOnLine, Request)| now >= drive.station.unmistakable_at(request);
    let (drive, request) = reads()
        .find(is_clear)
        .or_else(|| reads().next())
        .map(|(drive, request)| (drive.index, request))
        .unwrap_or((drive, Request::read(0, 1)));
    (drive, request, ExchangePurpose::Probe)
}
