//! The map of the gateway itself, with the names of its lines and drives.

use super::super::map::{MapAccess, MapRow, MapUnit, RowRepeat, map};
use super::super::own;
use super::{SheetRow, absent_text, of_map};
use crate::domain::command::Rights;

/// The map of a gateway with these lines and drives, in the order of its configuration, for a client with `rights`.
#[must_use]
pub fn gateway(lines: &[&str], drives: &[&str], rights: Rights) -> Vec<SheetRow> {
    let rows = map().iter().filter(|row| row.unit == MapUnit::Own);
    let (once, repeated): (Vec<_>, Vec<_>) = rows.partition(|row| row.each == RowRepeat::Once);
    let mut all: Vec<_> = once
        .into_iter()
        .map(|row| gateway_row(row, row.address, "", rights))
        .collect();
    let lines = lines.iter().take(usize::from(own::LINES_MAX));
    all.extend(
        lines
            .enumerate()
            .flat_map(|(place, name)| each(&repeated, RowScope::Line, place, name, rights)),
    );
    all.extend(
        drives
            .iter()
            .enumerate()
            .flat_map(|(place, name)| each(&repeated, RowScope::Drive, place, name, rights)),
    );
    all
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum RowScope {
    Line,
    Drive,
}

/// The rows of the line or drive in this `place`.
fn each(
    rows: &[&MapRow],
    what: RowScope,
    place: usize,
    name: &str,
    rights: Rights,
) -> Vec<SheetRow> {
    let placed = rows.iter().filter_map(|row| {
        let step = match (row.each, what) {
            (RowRepeat::Line(step), RowScope::Line) | (RowRepeat::Drive(step), RowScope::Drive) => {
                step
            }
            _ => return None,
        };
        let address = u16::try_from(place)
            .ok()?
            .checked_mul(step)?
            .checked_add(row.address)?;
        Some(gateway_row(row, address, name, rights))
    });
    placed.collect()
}

fn gateway_row(row: &MapRow, address: u16, name: &str, rights: Rights) -> SheetRow {
    let plain = of_map(row, address);
    let is_written = row.access == MapAccess::ReadWrite && rights.stop;
    let special = match row.absent {
        Some(absent) => absent_text(
            row.count,
            absent,
            "not known, or not served by this listener",
        ),
        None => plain.special,
    };
    SheetRow {
        of: name.to_owned(),
        is_written,
        special,
        ..plain
    }
}
