//! A second gateway on the same lines: whether they can have one, and what happens to their drives when it is lost.

use super::file::{ConfigFile, ControlFile, LineFile, StandbyFile};
use super::line_plan;
use super::ready::{LineSettings, PortAddress};
use super::words;
use crate::domain::control::BusFunctions;
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
        let problem = standby
            .location
            .problem("has no effect: no line has `standby = true`");
        problems.push(
            problem
                .right("`standby = true` in each `[[line]]` that the other gateway is on")
                .warning(),
        );
    }
    let (half, partner) = (standby.half.as_ref(), standby.partner.as_ref());
    if let (Some(half), Some(partner)) = (half, partner)
        && half.value == partner.value
    {
        let problem = partner.location.problem(format!(
            "`{}` is the name of this gateway itself",
            half.value
        ));
        problems.push(problem.right("the `half` of the other gateway"));
    }
    Some(StandbyPair {
        half: half?.value.clone(),
        partner: partner?.value.clone(),
        rank: standby.rank()?,
        take_over_after: standby.take_over_after()?,
    })
}

/// Each line that has a second gateway can have one.
pub(super) fn check(file: &ConfigFile, problems: &mut Vec<Problem>) {
    for line in &file.lines {
        let Some(LocatedValue { location, .. }) = shared(line) else {
            continue;
        };
        if matches!(file.standby, OptionalKey::Absent) {
            let problem = location
                .problem("there is no `[standby]`, which names the two gateways of the line");
            problems.push(problem.right("`[standby]` with `half` and `partner`, or leave it out"));
        }
        if let Some(why) = why_not_heard(line) {
            let right = "leave it out; two gateways need RS-485 at a serial device of each";
            problems.push(
                location
                    .problem(format!("a second gateway would hear nothing: {why}"))
                    .right(right),
            );
        }
        if let Some(rts) = line
            .direction
            .valid()
            .filter(|it| it.value == DirectionControl::Rts)
        {
            let what = "with a second gateway: a program that is suspended while it holds RTS keeps the other one from sending";
            problems.push(
                rts.location
                    .problem(what)
                    .right("\"adapter\" or \"kernel\""),
            );
        }
        let stations = line
            .drives
            .iter()
            .filter_map(|drive| drive.station.as_ref());
        for station in stations.filter(|station| station.value == signal::STATION) {
            let what = format!(
                "the gateways of a line use station {} for themselves",
                station.value
            );
            problems.push(
                station
                    .location
                    .problem(what)
                    .right("another station of the drive"),
            );
        }
    }
}

/// The key of `line` that says that it has a second gateway, if it says so.
fn shared(line: &LineFile) -> Option<&LocatedValue<bool>> {
    line.standby.valid().filter(|standby| standby.value)
}

/// Why a second gateway could not hear what is sent on `line`.
fn why_not_heard(line: &LineFile) -> Option<&'static str> {
    let is_rs232 = line
        .interface
        .valid()
        .is_some_and(|interface| interface.value == Interface::Rs232);
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
            let problem = location.missing("on_gateway_lost").problem(
                "`on_gateway_lost` is missing: the line has a second gateway, which may have ordered the drive to run",
            );
            problems.push(problem.right(words::on_gateway_lost().right()));
            None
        }
        OptionalKey::Absent => Some(None),
        OptionalKey::Valid(written) if is_shared => Some(Some(written.value)),
        OptionalKey::Valid(written) => {
            let problem = written
                .location
                .problem("has no effect: the line has no second gateway");
            problems.push(
                problem
                    .right("leave it out, or `standby = true` in the `[[line]]`")
                    .warning(),
            );
            Some(None)
        }
    }
}

/// A drive that is started and stopped at its terminals, as `bus` says, cannot be promised to be stopped by a take-over.
pub(super) fn wired(file: &ControlFile, bus: BusFunctions, problems: &mut Vec<Problem>) {
    let stops = |lost: &&LocatedValue<OnGatewayLost>| {
        matches!(lost.value, OnGatewayLost::Stop | OnGatewayLost::Coast)
    };
    if let Some(lost) = file.on_gateway_lost.valid().filter(stops) {
        let what = format!(
            "the drive is started and stopped elsewhere (bus = \"{}\"), so this cannot be relied on",
            bus.keyword()
        );
        problems.push(
            lost.location
                .problem(what)
                .right("\"hold\" or \"adopt\", or bus = \"both\""),
        );
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
        let right = format!(
            "at least \"{}\", or \"auto\"",
            duration_text(whole_millis(shortest))
        );
        problems.push(location.problem(what).right(right));
    }
}

/// `time`, or the next longer one that a file can state.
fn whole_millis(time: Duration) -> Duration {
    Duration::from_millis(u64::try_from(time.as_nanos().div_ceil(1_000_000)).unwrap_or(u64::MAX))
}
