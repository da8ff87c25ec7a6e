//! A second gateway on the same lines: whether they can have one, and what happens to their drives when it is lost.

use super::file::{ConfigFile, ControlFile, LineFile, StandbyFile, on_gateway_lost};
use super::line_plan;
use super::ready::{LineSettings, PortAddress};
use crate::domain::link::{DirectionControl, Interface};
use crate::domain::problem::Problem;
use crate::domain::standby::{OnGatewayLost, StandbyPair};
use crate::toml_file::values::duration_text;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey};
use crate::wire::signal;
use std::time::Duration;

/// The pair of `standby`; `None` if it is invalid, see `problems`.
pub(super) fn settle(
    standby: &StandbyFile,
    file: &ConfigFile,
    problems: &mut Vec<Problem>,
) -> Option<StandbyPair> {
    let is_on = |line: &LineFile| line.standby().unwrap_or(true);
    if !file.lines.is_empty() && !file.lines.iter().any(is_on) {
        let what = "has no effect: no line has `standby = true`";
        let right = "`standby = true` in each `[[line]]` that the other gateway is on";
        standby.location.warn(what, right, problems);
    }
    if let (Some(half), Some(partner)) = (&standby.half, &standby.partner)
        && half.value == partner.value
    {
        let what = format!("`{}` is the name of this gateway itself", half.value);
        let right = "the `half` of the other gateway";
        partner.refuse(what, right, problems);
    }
    standby.settings()
}

/// Each line that has a second gateway can have one.
pub(super) fn check(file: &ConfigFile, problems: &mut Vec<Problem>) {
    for line in &file.lines {
        let Some(shared) = line.standby.valid_as(&true) else {
            continue;
        };
        if file.standby.is_absent() {
            let what = "there is no `[standby]`, which names the two gateways of the line";
            let right = "`[standby]` with `half` and `partner`, or leave it out";
            shared.refuse(what, right, problems);
        }
        if let Some(why) = why_not_heard(line) {
            let what = format!("a second gateway would hear nothing: {why}");
            let right = "leave it out; two gateways need RS-485 at a serial device of each";
            shared.refuse(what, right, problems);
        }
        if let Some(rts) = line.direction.valid_as(&DirectionControl::Rts) {
            let what = "with a second gateway: a program that is suspended while it holds RTS keeps the other one from sending";
            rts.refuse(what, "\"adapter\" or \"kernel\"", problems);
        }
        let stations = line.drives.iter().filter_map(|it| it.station.as_ref());
        for station in stations.filter(|station| station.value == signal::STATION) {
            let number = station.value;
            let what = format!("the gateways of a line use station {number} for themselves");
            station.refuse(what, "another station of the drive", problems);
        }
    }
}

/// Why a second gateway could not hear what is sent on `line`.
fn why_not_heard(line: &LineFile) -> Option<&'static str> {
    let is_rs232 = line.interface.valid_as(&Interface::Rs232).is_some();
    match line.port.as_ref().map(|port| &port.value) {
        Some(PortAddress::Tcp { .. }) => {
            Some("a serial device server passes on only what its drives send")
        }
        Some(PortAddress::ModbusTcp { .. }) => {
            Some("a Modbus TCP connection belongs to one client")
        }
        Some(PortAddress::Device(_)) | None => {
            is_rs232.then_some("RS-232 connects two devices, not three")
        }
    }
}

/// What happens to a drive of `line` when the other gateway is lost, from its section at `location`: `Some(None)` where
/// there is no other; `None` if it is invalid, see `problems`.
pub(super) fn on_lost(
    file: &ControlFile,
    location: &KeyLocation,
    line: &LineFile,
    problems: &mut Vec<Problem>,
) -> Option<Option<OnGatewayLost>> {
    let is_shared = line.standby()?;
    match &file.on_gateway_lost {
        OptionalKey::Invalid => None,
        OptionalKey::Absent if is_shared => {
            let what = "`on_gateway_lost` is missing: the line has a second gateway, which may have ordered the drive to run";
            let location = location.missing("on_gateway_lost");
            location.refuse(what, on_gateway_lost().right(), problems);
            None
        }
        OptionalKey::Absent => Some(None),
        OptionalKey::Valid(written) if is_shared => Some(Some(written.value)),
        OptionalKey::Valid(written) => {
            let what = "has no effect: the line has no second gateway";
            let right = "leave it out, or `standby = true` in the `[[line]]`";
            written.warn(what, right, problems);
            Some(None)
        }
    }
}

/// The configured silence is no shorter than `line` needs: else both gateways might send.
pub(super) fn has_time(file: &ConfigFile, line: &LineSettings, problems: &mut Vec<Problem>) {
    let (Some(standby), Some(_)) = (file.standby.valid(), &line.standby) else {
        return;
    };
    let Some(LocatedValue {
        value: Some(given),
        location,
    }) = standby.value.take_over_after.valid()
    else {
        return;
    };
    let shortest = line_plan::shortest_standby_times(line).take_over_after;
    if *given < shortest {
        let what = format!(
            "after {} the other gateway may still be sending on line `{}`, or waiting for a reply there",
            duration_text(*given),
            line.name
        );
        let shortest = duration_text(whole_millis(shortest));
        let right = format!("at least \"{shortest}\", or \"auto\"");
        location.refuse(what, right, problems);
    }
}

/// `time`, or the next longer one that a file can state.
fn whole_millis(time: Duration) -> Duration {
    Duration::from_millis(u64::try_from(time.as_nanos().div_ceil(1_000_000)).unwrap_or(u64::MAX))
}
