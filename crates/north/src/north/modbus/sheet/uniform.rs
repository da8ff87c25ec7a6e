//! The map of a uniform unit, with what applies to this drive.

use super::super::map::{MapAccess, MapRow, MapTable, MapUnit, map};
use super::super::uniform::{UniformUnit, address, capability, run};
use super::{SheetRow, absent_text, of_map};
use crate::domain::command::Rights;
use crate::drive::description::DriveDescription;

/// The run values beside stop, each with the capability that it needs.
const RUN_VALUES: [(u16, u16); 6] = [
    (run::FORWARD, capability::FORWARD),
    (run::REVERSE, capability::REVERSE),
    (run::COAST, capability::COAST),
    (run::RESET, capability::RESET),
    (run::RELEASE, capability::RELEASE),
    (run::TAKE, capability::TAKE),
];

/// The map of the uniform unit of `drive` for a client with `rights`.
#[must_use]
pub fn uniform(drive: &DriveDescription, rights: Rights) -> Vec<SheetRow> {
    let unit = UniformUnit::new(drive);
    let rows = map().iter().filter(|row| row.unit == MapUnit::Uniform);
    rows.map(|row| uniform_row(row, drive, &unit, rights))
        .collect()
}

fn uniform_row(
    row: &MapRow,
    drive: &DriveDescription,
    unit: &UniformUnit,
    rights: Rights,
) -> SheetRow {
    let plain = of_map(row, row.address);
    let taken = taken(drive, unit, rights);
    let is_written = row.access == MapAccess::ReadWrite && is_written(row, &taken);
    let special = match (row.table, row.address, row.absent) {
        (MapTable::Word | MapTable::Holding, at, Some(absent)) if !unit.has(at) => {
            absent_text(row.count, absent, "always, this drive has none")
        }
        (MapTable::Word, at, Some(_)) => match register(drive, unit, at) {
            Some(register) => format!("{}; from {register}", plain.special),
            None => plain.special,
        },
        (MapTable::Holding, address::RUN, _) => values_text(&taken),
        (MapTable::Coil, at, _) => coil_text(at, &taken).to_owned(),
        _ => plain.special,
    };
    SheetRow {
        is_written,
        special,
        ..plain
    }
}

/// The run values that a client with `rights` may send to `drive`.
fn taken(drive: &DriveDescription, unit: &UniformUnit, rights: Rights) -> Vec<u16> {
    let Some(control) = &drive.control else {
        return Vec::new();
    };
    if !rights.stop {
        return Vec::new();
    }
    let commands = rights.write && control.from_modbus_tcp;
    let may = |(value, bit): &(u16, u16)| {
        unit.capabilities() & bit != 0 && (commands || *value == run::COAST)
    };
    std::iter::once(run::STOP)
        .chain(
            RUN_VALUES
                .iter()
                .filter(|it| may(it))
                .map(|(value, _)| *value),
        )
        .collect()
}

/// Whether any write to `row` is accepted from a client that may send the run values `taken`.
fn is_written(row: &MapRow, taken: &[u16]) -> bool {
    // A client that may start it may also set its frequency, and holds a lease to renew.
    let commands = taken.contains(&run::FORWARD) || taken.contains(&run::REVERSE);
    match (row.table, row.address) {
        (MapTable::Coil, address::RESET) => taken.contains(&run::RESET),
        (MapTable::Holding, address::SETPOINT | address::RENEW) => commands,
        _ => !taken.is_empty(),
    }
}

fn values_text(taken: &[u16]) -> String {
    let values: Vec<_> = taken.iter().map(u16::to_string).collect();
    if values.is_empty() {
        "no value is taken here".to_owned()
    } else {
        format!("taken here: {}", values.join(", "))
    }
}

fn coil_text(address: u16, taken: &[u16]) -> &'static str {
    let value = match address {
        address::FORWARD => run::FORWARD,
        address::REVERSE => run::REVERSE,
        address::RESET => run::RESET,
        _ => run::STOP,
    };
    match (taken.contains(&value), taken.is_empty()) {
        (true, _) => "",
        (false, false) if address != address::RESET => "only 0 is taken here",
        (false, _) => "not taken here",
    }
}

/// The drive's own register of a measurement, in words.
fn register(drive: &DriveDescription, unit: &UniformUnit, address: u16) -> Option<String> {
    let register = drive.model.register_at(unit.register_of(address)?)?;
    let code = register
        .code
        .as_ref()
        .map(|code| format!(" ({code})"))
        .unwrap_or_default();
    Some(format!("{} {}{code}", register.address, register.name))
}
