//! Rules between registers and the tables of the Modbus data model that they are in.

use super::RegisterFile;
use crate::domain::address::DataTable;
use crate::domain::problem::Problem;
use crate::profile::model::RegisterRole;
use crate::toml_file::{KeyLocation, OptionalKey};
use crate::wire::pdu::function;

/// What an address of each table is called in messages.
pub(in crate::profile) const fn called(table: DataTable) -> &'static str {
    match table {
        DataTable::Holding => "a holding register",
        DataTable::Input => "an input register",
        DataTable::Coil => "a coil",
        DataTable::Discrete => "a discrete input",
    }
}

/// The function that reads `table`.
pub(in crate::profile) const fn read_by(table: DataTable) -> u8 {
    match table {
        DataTable::Holding => function::READ_HOLDING,
        DataTable::Input => function::READ_INPUT,
        DataTable::Coil => function::READ_COILS,
        DataTable::Discrete => function::READ_DISCRETE,
    }
}

/// The functions that write `table`, each of which suffices.
pub(in crate::profile) const fn written_by(table: DataTable) -> [u8; 2] {
    match table {
        DataTable::Coil | DataTable::Discrete => [function::WRITE_COIL, function::WRITE_COILS],
        DataTable::Holding | DataTable::Input => [function::WRITE_SINGLE, function::WRITE_MULTIPLE],
    }
}

/// Reports each register of `written` that its table does not allow: an input that is written, a bit that is more than 0
/// or 1.
pub(in crate::profile) fn tables_fit(written: &[RegisterFile], problems: &mut Vec<Problem>) {
    for register in written {
        let Some(table) = register.table() else {
            continue;
        };
        let access = register
            .access
            .as_ref()
            .filter(|access| access.value.can_write() && !table.is_writable());
        if let Some(access) = access {
            let problem = access
                .location
                .problem(format!("{} cannot be written", called(table)));
            problems.push(problem.right("\"read\", or another `table`"));
        }
        if table.is_of_bits() {
            bit_is_plain(register, table, problems);
        }
    }
}

/// A bit is 0 or 1, and nothing else.
fn bit_is_plain(register: &RegisterFile, table: DataTable, problems: &mut Vec<Problem>) {
    let what = format!("{} is 0 or 1", called(table));
    let form = &register.form;
    let keys: [Option<&KeyLocation>; 10] = [
        register.scale.valid().map(|it| &it.location),
        register.signed.valid().map(|it| &it.location),
        register.range.valid().map(|it| &it.location),
        form.words.valid().map(|it| &it.location),
        form.mask.valid().map(|it| &it.location),
        form.exponent_mask.valid().map(|it| &it.location),
        form.full_scale.valid().map(|it| &it.location),
        form.scale_by.valid().map(|it| &it.location),
        form.direction.valid().map(|it| &it.location),
        form.plus
            .first()
            .and_then(|part| part.address.as_ref())
            .map(|it| &it.location),
    ];
    for location in keys.into_iter().flatten() {
        problems.push(location.problem(what.clone()).right("leave it out"));
    }
    if let Some(word) = register.meaning_words().find(|word| *word > 1)
        && let Some(address) = &register.address
    {
        let problem = address
            .location
            .problem(format!("{what}, and {word} has a meaning"));
        problems.push(problem.right("`values` of \"0\" and \"1\" only"));
    }
    let OptionalKey::Valid(role) = &register.role else {
        return;
    };
    if !matches!(
        role.value,
        RegisterRole::RunCommand
            | RegisterRole::Order
            | RegisterRole::RunSource
            | RegisterRole::FrequencySource
    ) {
        let problem = role
            .location
            .problem(format!("{what}, and this role needs a number"));
        problems.push(problem.right("leave it out; a state of the drive is a `[[status]]` flag"));
    }
}

/// Reports each register of `written` that a drive with these `functions` cannot read or write.
pub(super) fn tables_are_served(
    functions: &[u8],
    written: &[RegisterFile],
    problems: &mut Vec<Problem>,
) {
    for register in written {
        let (Some(table), Some(access)) = (register.table(), &register.access) else {
            continue;
        };
        let location = register.table.valid().map(|table| &table.location);
        let Some(location) =
            location.or(register.address.as_ref().map(|address| &address.location))
        else {
            continue;
        };
        let reads = access.value.can_read().then(|| vec![read_by(table)]);
        let writes = access.value.can_write().then(|| written_by(table).to_vec());
        let missing = [reads, writes].into_iter().flatten();
        for needed in
            missing.filter(|needed| !needed.iter().any(|function| functions.contains(function)))
        {
            let names: Vec<_> = needed
                .iter()
                .map(|function| format!("{function:02X}"))
                .collect();
            let what = format!(
                "{} needs function {} hex, which the model does not serve",
                called(table),
                names.join(" or ")
            );
            problems.push(
                location
                    .problem(what)
                    .right("a `table` or an `access` that the drive serves"),
            );
        }
    }
}
