//! The units of each drive, and conflicts between them on a listener.

use super::file::{ConfigFile, DriveFile, DriveUnits, ListenerFile};
use super::port;
use crate::domain::ids::UnitId;
use crate::domain::problem::Problem;
use crate::toml_file::{KeyLocation, OptionalKey};
use std::collections::{BTreeMap, BTreeSet};

/// Default distance of the uniform unit above the native one.
pub const UNIFORM_ABOVE: u8 = 100;

/// The units of each drive of each line, in the order of the file.
/// `served` holds, per listener of `file`, the indices of the lines it serves.
pub(super) fn settle(
    file: &ConfigFile,
    served: &[BTreeSet<usize>],
    problems: &mut Vec<Problem>,
) -> Vec<Vec<DriveUnits>> {
    let servers = file.units_servers();
    let shared = shared_lines(served, &servers);
    let mut free = FreeUnits::new(file, &shared);
    let mut units: Vec<Vec<DriveUnits>> = Vec::new();
    for (index, line) in file.lines.iter().enumerate() {
        let with = shared.get(&index).copied();
        let may_be_the_device = port::is_modbus_tcp(line);
        let of_line = line.drives.iter().map(|drive| {
            let native = native_of(drive, with, may_be_the_device, &mut free, problems);
            let uniform = uniform_of(drive, native, &mut free, problems);
            DriveUnits { native, uniform }
        });
        units.push(of_line.collect());
    }
    let mut reported = BTreeSet::new();
    for lines in served {
        told_apart(file, lines, &units, &mut free, &mut reported, problems);
    }
    units
}

/// The lines that share a listener with another line, each with the first such listener.
fn shared_lines<'a>(
    served: &[BTreeSet<usize>],
    listeners: &[&'a ListenerFile],
) -> BTreeMap<usize, &'a ListenerFile> {
    let mut shared = BTreeMap::new();
    for (lines, listener) in served
        .iter()
        .zip(listeners)
        .filter(|(lines, _)| lines.len() > 1)
    {
        for line in lines {
            shared.entry(*line).or_insert(*listener);
        }
    }
    shared
}

/// The native unit: as written, or the station if the line shares its listeners with no other line. The station
/// `may_be_the_device` itself: 0 or 255, which is no unit here.
fn native_of(
    drive: &DriveFile,
    shared: Option<&ListenerFile>,
    may_be_the_device: bool,
    free: &mut FreeUnits,
    problems: &mut Vec<Problem>,
) -> Option<UnitId> {
    match &drive.unit {
        OptionalKey::Valid(written) => return Some(written.value),
        OptionalKey::Invalid => return None,
        OptionalKey::Absent => {}
    }
    // Every valid station of a serial line is a valid unit, so an invalid one is already reported as a station.
    let written = drive.station.as_ref();
    let station = written.and_then(|station| UnitId::new(station.value.0));
    let missing = drive.location.missing("unit");
    if let Some(listener) = shared {
        let listener = listener.label();
        let what = format!("`unit` is left out, and {listener} serves more than one line");
        problems.push(free.native_instead(missing.problem(what), drive, station));
        return None;
    }
    if let Some(beyond) = written
        && may_be_the_device
        && matches!(beyond.value.0, 0 | u8::MAX)
    {
        let station = beyond.value;
        let what = format!("`unit` is left out, and station {station} is no unit of a listener");
        problems.push(free.native_instead(missing.problem(what), drive, None));
    }
    station
}

/// The uniform unit: as written, or the native one plus the default distance.
fn uniform_of(
    drive: &DriveFile,
    native: Option<UnitId>,
    free: &mut FreeUnits,
    problems: &mut Vec<Problem>,
) -> Option<UnitId> {
    match &drive.uniform_unit {
        OptionalKey::Valid(written) => return Some(written.value),
        OptionalKey::Invalid => return None,
        OptionalKey::Absent => {}
    }
    let native = native?;
    let uniform = default_uniform(native);
    if uniform.is_none() {
        let what = format!(
            "`uniform_unit` is left out, and its default of {native} + {UNIFORM_ABOVE} is beyond {}",
            UnitId::MAX
        );
        problems.push(free.uniform_instead(drive.location.missing("uniform_unit").problem(what)));
    }
    uniform
}

fn default_uniform(native: UnitId) -> Option<UnitId> {
    native
        .get()
        .checked_add(UNIFORM_ABOVE)
        .and_then(UnitId::new)
}

/// One of the two units of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum UnitSide {
    Native,
    Uniform,
}

impl UnitSide {
    const fn key(self) -> &'static str {
        match self {
            Self::Native => "unit",
            Self::Uniform => "uniform_unit",
        }
    }

    const fn given(self, drive: &DriveFile) -> &OptionalKey<UnitId> {
        match self {
            Self::Native => &drive.unit,
            Self::Uniform => &drive.uniform_unit,
        }
    }
}

/// A drive that answers at a unit.
#[derive(Clone, Copy)]
struct UnitClaim<'a> {
    drive: &'a DriveFile,
    side: UnitSide,
}

impl UnitClaim<'_> {
    fn is_default(&self) -> bool {
        self.side.given(self.drive).is_absent()
    }

    fn location(&self) -> KeyLocation {
        match self.side.given(self.drive).location() {
            Some(written) => written.clone(),
            None => self.drive.location.missing(self.side.key()),
        }
    }

    fn label(&self) -> String {
        match self.side {
            UnitSide::Native => self.drive.label(),
            UnitSide::Uniform => format!("{} (uniform)", self.drive.label()),
        }
    }
}

/// Reports each unit that belongs to an earlier drive, or to the same drive, of the same listener. `reported` holds the
/// places that are already reported.
fn told_apart(
    file: &ConfigFile,
    lines: &BTreeSet<usize>,
    units: &[Vec<DriveUnits>],
    free: &mut FreeUnits,
    reported: &mut BTreeSet<(usize, usize, UnitSide)>,
    problems: &mut Vec<Problem>,
) {
    let mut owners: BTreeMap<UnitId, UnitClaim<'_>> = BTreeMap::new();
    for line in lines {
        let drives = file.lines.get(*line).map_or(&[][..], |line| &line.drives);
        let units = units.get(*line).map_or(&[][..], |units| units);
        for (index, (drive, units)) in drives.iter().zip(units).enumerate() {
            for (side, unit) in [
                (UnitSide::Native, units.native),
                (UnitSide::Uniform, units.uniform),
            ] {
                let (Some(unit), claim) = (unit, UnitClaim { drive, side }) else {
                    continue;
                };
                let Some(owner) = owners.get(&unit) else {
                    owners.insert(unit, claim);
                    continue;
                };
                if !follows_from_another(*owner, claim) && reported.insert((*line, index, side)) {
                    problems.push(clash(*owner, claim, unit, free));
                }
            }
        }
    }
}

/// Whether two drives have the same unit only because they have the same station, or the same uniform unit only
/// because they have the same native one: that is reported by itself.
fn follows_from_another(owner: UnitClaim<'_>, claim: UnitClaim<'_>) -> bool {
    owner.side == claim.side && owner.is_default() && claim.is_default()
}

fn clash(
    owner: UnitClaim<'_>,
    claim: UnitClaim<'_>,
    unit: UnitId,
    free: &mut FreeUnits,
) -> Problem {
    let what = if std::ptr::eq(owner.drive, claim.drive) {
        format!(
            "{} would answer at unit {unit} both as its vendor describes it and uniformly",
            claim.drive.label()
        )
    } else {
        format!(
            "{} and {} would both answer at unit {unit}",
            owner.label(),
            claim.label()
        )
    };
    let problem = claim.location().problem(what);
    match claim.side {
        UnitSide::Native => free.native_instead(problem, claim.drive, None),
        UnitSide::Uniform => free.uniform_instead(problem),
    }
}

/// Units that no drive has. Each is offered once, so that taking every advice leaves no two the same.
struct FreeUnits {
    used: BTreeSet<UnitId>,
}

impl FreeUnits {
    fn new(file: &ConfigFile, shared: &BTreeMap<usize, &ListenerFile>) -> Self {
        let mut used = BTreeSet::new();
        for (line, drive) in (0..)
            .zip(&file.lines)
            .flat_map(|(index, line)| line.drives.iter().map(move |it| (index, it)))
        {
            let native = match (&drive.unit, &drive.station) {
                (OptionalKey::Valid(unit), _) => Some(unit.value),
                (OptionalKey::Absent, Some(station)) if !shared.contains_key(&line) => {
                    UnitId::new(station.value.0)
                }
                _ => None,
            };
            let uniform = match &drive.uniform_unit {
                OptionalKey::Valid(unit) => Some(unit.value),
                OptionalKey::Absent => native.and_then(default_uniform),
                OptionalKey::Invalid => None,
            };
            used.extend(native.into_iter().chain(uniform));
        }
        Self { used }
    }

    /// Adds to `problem` a unit for the native registers of `drive`, `wanted` if that is free. Where the uniform
    /// unit follows the native one, that is free too.
    fn native_instead(
        &mut self,
        problem: Problem,
        drive: &DriveFile,
        wanted: Option<UnitId>,
    ) -> Problem {
        let follows = drive.uniform_unit.is_absent();
        let fits = |unit: &UnitId| {
            !follows || default_uniform(*unit).is_some_and(|it| !self.used.contains(&it))
        };
        let unit = self.units(wanted).find(fits);
        if let Some(unit) = unit {
            self.used.insert(unit);
            if follows {
                self.used.extend(default_uniform(unit));
            }
            return problem.right(format!("unit = {unit}, which is free"));
        }
        match (self.take(wanted), self.take(None)) {
            (Some(native), Some(uniform)) if follows => problem.right(format!(
                "unit = {native} and uniform_unit = {uniform}, which are free"
            )),
            _ => problem.right(NONE_FREE),
        }
    }

    /// Adds to `problem` a unit for the uniform registers.
    fn uniform_instead(&mut self, problem: Problem) -> Problem {
        match self.take(None) {
            Some(unit) => problem.right(format!("uniform_unit = {unit}, which is free")),
            None => problem.right(NONE_FREE),
        }
    }

    fn take(&mut self, wanted: Option<UnitId>) -> Option<UnitId> {
        let unit = self.units(wanted).next()?;
        self.used.insert(unit);
        Some(unit)
    }

    /// The free units, `wanted` before the others, which stand in order.
    fn units(&self, wanted: Option<UnitId>) -> impl Iterator<Item = UnitId> {
        let all = (UnitId::MIN..=UnitId::MAX).filter_map(UnitId::new);
        wanted
            .into_iter()
            .chain(all)
            .filter(|unit| !self.used.contains(unit))
    }
}

/// What to do where all units are taken.
const NONE_FREE: &str = "a listener of its own for each line (`lines`): no unit is free";
