//! The map of a native unit: the registers that the model knows, and which of them may be written.

use super::{SheetFormat, SheetRow, SheetTable};
use crate::domain::address::{Address, DataTable};
use crate::domain::command::Rights;
use crate::domain::control::ControlSettings;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::DriveDescription;
use crate::profile::model::{
    CodeText, Model, OrderKind, OrderedWord, Register, RegisterMemory, RegisterRole, StatusFlag,
};
use crate::profile::scale::ScaledValue;
use crate::profile::words::FLAGS;
use crate::toml_file::words::word_for;

/// The map of the native unit of `drive` for a client with `rights`.
///
/// It contains every register of the model, and other forms of them that may be written. Others may be read as well; what a
/// drive does then is up to the drive.
#[must_use]
pub fn native(drive: &DriveDescription, rights: Rights) -> Vec<SheetRow> {
    let model = &drive.model;
    let control = drive.control.as_deref();
    let registers = model.registers.iter();
    let rows =
        registers.map(|register| native_row(model, register, register.address, control, rights));
    let twins = control
        .iter()
        .flat_map(|control| &control.native_write)
        .filter_map(|address| {
            if model.register_at(*address).is_some() {
                return None;
            }
            let register = model
                .stored_twin(*address)
                .or_else(|| model.in_ram_at((*address).into()))?;
            Some(native_row(
                model,
                register,
                Address::holding(*address),
                control,
                rights,
            ))
        });
    let mut all: Vec<_> = rows.chain(twins).collect();
    all.sort_by_key(|row| {
        (
            is_of_bits(row.table),
            row.table == SheetTable::Input,
            row.address,
        )
    });
    all
}

/// Whether `table` holds bits.
const fn is_of_bits(table: SheetTable) -> bool {
    matches!(table, SheetTable::Coil | SheetTable::Discrete)
}

/// The table of a native unit that shows those of the drive's `table`: without input registers of its own, holding registers
/// are both.
fn table_of(model: &Model, table: DataTable) -> SheetTable {
    match table {
        DataTable::Coil => SheetTable::Coil,
        DataTable::Discrete => SheetTable::Discrete,
        DataTable::Input => SheetTable::Input,
        DataTable::Holding
            if model
                .registers
                .iter()
                .any(|it| it.address.table() == DataTable::Input) =>
        {
            SheetTable::Holding
        }
        DataTable::Holding => SheetTable::Word,
    }
}

fn native_row(
    model: &Model,
    register: &Register,
    address: Address,
    control: Option<&ControlSettings>,
    rights: Rights,
) -> SheetRow {
    let is_command = is_command(register);
    let is_listed =
        control.is_some_and(|control| control.native_write.iter().any(|number| address == *number));
    let table = table_of(model, address.table());
    let commands = rights.write && control.is_some_and(|control| control.from_modbus_tcp);
    let stops = rights.stop
        && control.is_some()
        && model
            .orders_at(register.address)
            .any(|(kind, _)| matches!(kind, OrderKind::Stop | OrderKind::Coast));
    let is_twin = register.address != address;
    let is_in_ram = is_twin && model.in_ram_at(address).is_some();
    let is_written = commands && (is_command || is_listed) || stops;
    SheetRow {
        table,
        address: address.number(),
        count: 1,
        of: String::new(),
        code: register.code.clone().unwrap_or_default(),
        name: register.name.clone(),
        title: match is_twin {
            true if is_in_ram => format!("{} (in RAM)", register.title),
            true => format!("{} (stored)", register.title),
            false => register.title.clone(),
        },
        step: step(register),
        unit: if register.unit == UnitOfMeasure::None {
            ""
        } else {
            register.unit.symbol()
        },
        format: match register.signed {
            _ if is_of_bits(table) => SheetFormat::Bit,
            true => SheetFormat::Signed,
            false => SheetFormat::Unsigned,
        },
        is_read: register.access.can_read() && (!is_twin || is_in_ram && model.reads_ram_forms()),
        is_written,
        meaning: meaning(model, register),
        special: special(
            register,
            is_written && is_command,
            is_listed && !is_in_ram,
            is_twin && !is_in_ram,
        ),
    }
}

/// Whether a write to it is a command.
const fn is_command(register: &Register) -> bool {
    matches!(
        register.role,
        Some(RegisterRole::RunCommand | RegisterRole::Order | RegisterRole::FrequencyCommand)
    )
}

/// What one step of the raw word is; empty for codes.
fn step(register: &Register) -> String {
    let is_code = !register.meanings.is_empty()
        || register.role.is_some_and(|role| {
            matches!(role, RegisterRole::RunCommand | RegisterRole::Order) || names_trips(role)
        });
    match register.scale {
        _ if is_code || !register.form.is_plain() || register.address.table().is_of_bits() => {
            String::new()
        }
        scale if 10_u32.pow(scale.ilog10()) == scale => {
            ScaledValue::from_word(1, register).to_string()
        }
        scale => format!("1/{scale}"),
    }
}

/// Whether registers with `role` hold the vendor's numbers of trips.
const fn names_trips(role: RegisterRole) -> bool {
    matches!(
        role,
        RegisterRole::TripCode
            | RegisterRole::TripBits
            | RegisterRole::TripCause
            | RegisterRole::TripHistory
    )
}

fn meaning(model: &Model, register: &Register) -> String {
    let own = register
        .meanings
        .iter()
        .map(|(code, text)| format!("{code} {text}"));
    // If each word has a meaning, flags add nothing.
    let flags = model
        .status
        .iter()
        .filter(|flag| flag.address == register.address && register.meanings.is_empty());
    let flags = flags.map(of_flag);
    let of_role: Vec<_> = match register.role {
        Some(RegisterRole::RunCommand | RegisterRole::Order) => {
            order_words(model, register.address)
        }
        Some(role) if names_trips(role) => model.trip_codes.iter().map(of_trip).collect(),
        _ => Vec::new(),
    };
    own.chain(flags)
        .chain(of_role)
        .collect::<Vec<_>>()
        .join(", ")
}

/// The words of orders in the register at `address`, with those that the model does not prove marked.
fn order_words(model: &Model, address: Address) -> Vec<String> {
    let row = |value: u16, text: &str, is_proven: bool| {
        let mark = if is_proven { "" } else { " (unproven)" };
        let value = if value > 9 {
            format!("0x{value:04X}")
        } else {
            value.to_string()
        };
        format!("{value} {text}{mark}")
    };
    let mut rows: Vec<String> = Vec::new();
    let is_by_direction = model.turns_by_sign()
        || model
            .run
            .as_ref()
            .is_some_and(|run| run.places.direction.is_some());
    for (kind, fact) in model.orders_at(address) {
        match kind {
            OrderKind::Reverse if is_by_direction => {}
            OrderKind::Forward if is_by_direction => {
                rows.push(row(fact.value, "run", fact.confidence.is_proven()))
            }
            _ => rows.push(row(fact.value, kind.keyword(), fact.confidence.is_proven())),
        }
    }
    if let Some(words) = model.direction_at(address) {
        rows.push(row(words.forward, "forward", true));
        rows.extend(words.reverse.map(|reverse| row(reverse, "reverse", true)));
    }
    let is_command = model.orders_at(address).any(|(_, fact)| fact.value == 0);
    if let Some(run) = &model.run
        && model.takes_run_commands(address)
        && !is_command
        && let Some(order) = run.order_in(0)
    {
        let zero = if order == OrderedWord::Coast {
            "0 coast"
        } else {
            "0 stop"
        };
        rows.push(zero.to_owned());
    }
    rows
}

fn of_flag(flag: &StatusFlag) -> String {
    let word = word_for(&FLAGS, &flag.flag);
    let mark = if flag.confidence.is_proven() {
        ""
    } else {
        " (unproven)"
    };
    match (flag.mask.count_ones(), &flag.values[..]) {
        (1, [value]) if *value == flag.mask => {
            format!("bit {} {word}{mark}", flag.mask.trailing_zeros())
        }
        (16, values) => {
            let values: Vec<_> = values.iter().map(u16::to_string).collect();
            format!("{} {word}{mark}", values.join(" or "))
        }
        (_, values) => {
            let values: Vec<_> = values
                .iter()
                .map(|value| format!("0x{value:04X}"))
                .collect();
            format!(
                "{} under mask 0x{:04X} {word}{mark}",
                values.join(" or "),
                flag.mask
            )
        }
    }
}

fn of_trip(trip: &CodeText) -> String {
    let mark = if trip.confidence.is_proven() {
        ""
    } else {
        " (unproven)"
    };
    format!("{} {}{mark}", trip.code, trip.text)
}

fn special(register: &Register, commands: bool, is_listed: bool, is_twin: bool) -> String {
    let mut notes = Vec::new();
    let is_command = is_command(register);
    if commands {
        notes.push("a write is a command, with all its rules".to_owned());
    }
    if let Some(why) = &register.back_door {
        notes.push(format!("never written: {why}"));
    } else if register.role.is_some_and(RegisterRole::is_guarded) && !is_command {
        notes.push("never written by a client".to_owned());
    }
    if is_listed && register.memory != Some(RegisterMemory::Ram) || is_twin {
        notes.push("stored, in a memory that wears out".to_owned());
    }
    if !register.confidence.is_proven() {
        notes.push(format!("unproven ({})", register.confidence.keyword()));
    }
    notes.join("; ")
}
