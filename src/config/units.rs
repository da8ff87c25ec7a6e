//! Under which unit each drive is reached, and that no listener serves two drives at the same one.

use super::file::{DriveFile, File, ListenerFile};
use crate::domain::ids::UnitId;
use crate::domain::problem::Problem;
use crate::profile::reader::Given;
use std::collections::{BTreeMap, BTreeSet};

/// The unit of each drive of each line, in the order of the file; nothing: see `problems`.
/// `served` holds, per listener of `file`, the indices of the lines it serves.
pub(super) fn settle(file: &File, served: &[BTreeSet<usize>], problems: &mut Vec<Problem>) -> Vec<Vec<Option<UnitId>>> {
    let shared = shared_lines(served, &file.listeners);
    let mut free = Free::new(file, &shared);
    let units: Vec<Vec<Option<UnitId>>> = file
        .lines
        .iter()
        .enumerate()
        .map(|(index, line)| {
            let with = shared.get(&index).copied();
            line.drives.iter().map(|drive| unit_of(drive, with, &mut free, problems)).collect()
        })
        .collect();
    let mut told = BTreeSet::new();
    for lines in served {
        told_apart(file, lines, &units, &mut free, &mut told, problems);
    }
    units
}

/// The lines that share a listener with another line, each with the first such listener.
fn shared_lines<'a>(served: &[BTreeSet<usize>], listeners: &'a [ListenerFile]) -> BTreeMap<usize, &'a ListenerFile> {
    let mut shared = BTreeMap::new();
    for (lines, listener) in served.iter().zip(listeners).filter(|(lines, _)| lines.len() > 1) {
        for line in lines {
            shared.entry(*line).or_insert(listener);
        }
    }
    shared
}

/// The unit of one drive: as written, or its station where the line shares its listeners with no other line.
fn unit_of(
    drive: &DriveFile,
    shared: Option<&ListenerFile>,
    free: &mut Free,
    problems: &mut Vec<Problem>,
) -> Option<UnitId> {
    match &drive.unit {
        Given::Usable(written) => return Some(written.value),
        Given::Unusable => return None,
        Given::LeftOut => {}
    }
    // No model has a station that is no unit, so what falls out here is reported as a station.
    let station = drive.station.as_ref().and_then(|station| UnitId::new(station.value.0));
    let Some(listener) = shared else { return station };
    let what = format!("`unit` is left out, and {} serves more than one line", listener.label());
    problems.push(with_free(drive.place.missing("unit").problem(what), free.like(station)));
    None
}

/// Reports each drive whose unit belongs to an earlier drive of the same listener. `told` keeps the places
/// that are already reported.
fn told_apart(
    file: &File,
    lines: &BTreeSet<usize>,
    units: &[Vec<Option<UnitId>>],
    free: &mut Free,
    told: &mut BTreeSet<(usize, usize)>,
    problems: &mut Vec<Problem>,
) {
    let mut owners: BTreeMap<UnitId, &DriveFile> = BTreeMap::new();
    for line in lines {
        let drives = file.lines.get(*line).map_or(&[][..], |line| &line.drives);
        let units = units.get(*line).map_or(&[][..], |units| units);
        for (index, (drive, unit)) in drives.iter().zip(units).enumerate() {
            let Some(unit) = *unit else { continue };
            let Some(owner) = owners.get(&unit) else {
                owners.insert(unit, drive);
                continue;
            };
            if !follows_from_station(owner, drive) && told.insert((*line, index)) {
                problems.push(clash(owner, drive, unit, free));
            }
        }
    }
}

/// Whether two drives have the same unit only because they have the same station, which is reported as such.
fn follows_from_station(one: &DriveFile, other: &DriveFile) -> bool {
    matches!((&one.unit, &other.unit), (Given::LeftOut, Given::LeftOut))
}

fn clash(owner: &DriveFile, drive: &DriveFile, unit: UnitId, free: &mut Free) -> Problem {
    let place = match &drive.unit {
        Given::Usable(written) => written.place.clone(),
        Given::LeftOut | Given::Unusable => drive.place.missing("unit"),
    };
    let what = format!("{} and {} would both answer at unit {unit}", owner.label(), drive.label());
    with_free(place.problem(what), free.like(None))
}

fn with_free(problem: Problem, free: Option<UnitId>) -> Problem {
    match free {
        Some(unit) => problem.right(format!("unit = {unit}, which is free")),
        None => problem.right("a listener of its own for each line (`lines`): no unit is free"),
    }
}

/// Units that no drive has. Each is offered once, so that taking every advice leaves no two the same.
struct Free {
    used: BTreeSet<UnitId>,
}

impl Free {
    fn new(file: &File, shared: &BTreeMap<usize, &ListenerFile>) -> Self {
        let lines = file.lines.iter().enumerate();
        let drives = lines.flat_map(|(index, line)| line.drives.iter().map(move |drive| (index, drive)));
        let unit = |(line, drive): (usize, &DriveFile)| match (&drive.unit, &drive.station) {
            (Given::Usable(unit), _) => Some(unit.value),
            (Given::LeftOut, Some(station)) if !shared.contains_key(&line) => UnitId::new(station.value.0),
            _ => None,
        };
        Self { used: drives.filter_map(unit).collect() }
    }

    /// `wanted` if it is free, else the lowest that is.
    fn like(&mut self, wanted: Option<UnitId>) -> Option<UnitId> {
        let all = (UnitId::MIN..=UnitId::MAX).filter_map(UnitId::new);
        let unit = wanted.into_iter().chain(all).find(|unit| !self.used.contains(unit))?;
        self.used.insert(unit);
        Some(unit)
    }
}
