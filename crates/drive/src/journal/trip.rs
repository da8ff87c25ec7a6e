//! Trips as JSON: the published body of an event, and a record by the names of its registers.

use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::view::{DriveView, TripEvent, TripEventKind, TripRecord};
use crate::profile::model::{Register, RegisterRole};
use crate::profile::scale::ScaledValue;
use crate::profile::value::codes_of_bits;
use serde_json::{Map, Value, json};

/// How a moment is written.
type Label<'l> = dyn Fn(MonoTime) -> String + 'l;

/// The published body of `event`, without its number.
#[must_use]
pub fn event(drive: &DriveDescription, label: &Label<'_>, event: &TripEvent) -> Map<String, Value> {
    let mut body = Map::new();
    let mut say = |key: &str, value: Value| body.insert(key.to_owned(), value);
    if let TripEventKind::Tripped {
        trips,
        record: newest,
    } = &event.kind
    {
        record(drive, label, newest)
            .into_iter()
            .for_each(|(key, value)| drop(say(&key, value)));
        say("trips", (*trips).into());
    }
    say("kind", kind(&event.kind).into());
    say("drive", drive.name.as_str().into());
    // Not the record's own time: the time of the event identifies it.
    say("at", label(event.at).into());
    say("count", event.count.into());
    say("while_away", event.while_away.into());
    body
}

/// The word for what happened.
#[must_use]
pub const fn kind(kind: &TripEventKind) -> &'static str {
    match kind {
        TripEventKind::Tripped { .. } => "tripped",
        TripEventKind::Cleared => "cleared",
    }
}

/// A trip record, by the names of its registers.
#[must_use]
pub fn record(
    drive: &DriveDescription,
    label: &Label<'_>,
    record: &TripRecord,
) -> Map<String, Value> {
    let mut values = Map::new();
    for (address, word) in &record.words {
        let mut fields = drive
            .model
            .fields_at(*address)
            .filter(|register| is_of_a_record(register))
            .peekable();
        if fields.peek().is_none() {
            values.insert(address.to_string(), json!({ "value": word, "unit": null }));
        }
        values.extend(fields.map(|register| (register.name.clone(), with_unit(register, record))));
    }
    let text = text_of(drive, record);
    [
        ("at".to_owned(), label(record.at).into()),
        ("code".to_owned(), record.code.into()),
        ("text".to_owned(), text.into()),
        ("values".to_owned(), values.into()),
    ]
    .into_iter()
    .collect()
}

/// The vendor's text for the trip of `record`. If each trip has a bit, the texts of all that were active.
#[must_use]
pub fn text_of(drive: &DriveDescription, record: &TripRecord) -> Option<String> {
    let bits = drive
        .model
        .trip_bits()
        .and_then(|register| bits_text(drive, register.code(|address| word_of(record, address))?));
    bits.or_else(|| record.code.and_then(|code| text(drive, code)))
}

/// The vendor's text for the newest trip: of the record that was read since the start, else of the one that was kept.
#[must_use]
pub fn newest_text(drive: &DriveDescription, view: &DriveView) -> Option<String> {
    match &view.trip.last {
        Some(last) => text_of(drive, last),
        None => view.trip_kept.last_code.and_then(|code| text(drive, code)),
    }
}

/// The vendor's text for the active trip; `None` if none is known to be active.
#[must_use]
pub fn active_text(drive: &DriveDescription, view: &DriveView) -> Option<String> {
    if view.trip.active? {
        text_of(drive, view.trip.last.as_ref()?)
    } else {
        None
    }
}

/// What a register with `role` says about trips with the code or the bits `shown`; `None` if it shows none, or other
/// things.
#[must_use]
pub fn meaning(drive: &DriveDescription, role: RegisterRole, shown: u32) -> Option<String> {
    match role {
        RegisterRole::TripBits => bits_text(drive, shown),
        RegisterRole::TripCode | RegisterRole::TripCause | RegisterRole::TripHistory => {
            text(drive, u16::try_from(shown).ok()?)
        }
        _ => None,
    }
}

/// The texts of all trips whose bits are set in `bits`, the lowest first.
fn bits_text(drive: &DriveDescription, bits: u32) -> Option<String> {
    let texts: Vec<_> = codes_of_bits(bits)
        .filter_map(|code| text(drive, code))
        .collect();
    (!texts.is_empty()).then(|| texts.join("; "))
}

/// The vendor's text for trip `code`, marked if it is unproven; `None` for 0, which is no trip.
#[must_use]
pub fn text(drive: &DriveDescription, code: u16) -> Option<String> {
    match drive.model.trip_text(code) {
        _ if code == 0 => None,
        Some(known) => Some(known.marked()),
        None if drive.model.trip_bits().is_some() => Some(format!("bit {}", code - 1)),
        None => Some(format!("code {code}")),
    }
}

/// The symbol of a register's unit; `None` if it has none.
#[must_use]
pub fn unit(register: &Register) -> Option<&'static str> {
    Some(register.unit.symbol()).filter(|symbol| *symbol != "-")
}

/// Whether its field of a word belongs to a record.
fn is_of_a_record(register: &Register) -> bool {
    register.form.mask == u16::MAX || register.role.is_some()
}

fn word_of(record: &TripRecord, address: Address) -> Option<u16> {
    record
        .words
        .iter()
        .find(|(it, _)| *it == address)
        .map(|(_, word)| *word)
}

/// The value of `register` from the words of the record; `null` if it depends on others.
fn with_unit(register: &Register, record: &TripRecord) -> Value {
    json!({ "value": register.value(|address| word_of(record, address)).map(ScaledValue::value), "unit": unit(register) })
}
