//! Which drive answers, what has to be set on it before it obeys the bus, and what it is set to: for `vfd-gateway verify`
//! and `enable`.

use crate::daemon::exchange::shared::SharedDrive;
use crate::daemon::host::clock;
use crate::daemon::local::{LocalSide, OrderingClient};
use crate::domain::address::Address;
use crate::domain::command::{Order, Owner, Reason, Report};
use crate::domain::link::Interface;
use crate::domain::units::UnitOfMeasure;
use crate::drive::description::DriveRef;
use crate::north::api::{
    ChangeDocument, IdentityDocument, OrderOutcomeDocument, SeenWord, SetupDocument,
    SetupItemDocument, SetupWatchdogDocument, WordDocument,
};
use crate::north::shown::message;
use crate::profile::model::{
    CommitEffect, Model, ModelIdentity, ModelWatchdog, Register, RunForm, SetupItem,
};
use crate::profile::scale::ScaledValue;
use std::time::Duration;

/// Longest time for all reads of one request.
const READ_WITHIN: Duration = Duration::from_secs(5);

/// The word of a register, or why there is none.
pub(super) type Found = Result<u16, Report>;

/// Reads which drive it is and what has to be set on it, and shows both.
pub(super) async fn report(side: &LocalSide, drive: &SharedDrive) -> SetupDocument {
    let description = &drive.description;
    let model = &*drive.description.model;
    let items: Vec<_> = concerned(side, drive).collect();
    let watchdog = model.watchdog.as_ref();
    let identity = model.identity.as_ref();
    let addresses = identity
        .map(|it| it.address)
        .into_iter()
        .chain(items.iter().filter_map(|item| item.address));
    let addresses = addresses
        .chain(watchdog.map(|it| it.time))
        .chain(watchdog.and_then(|it| it.action));
    let found = read(side, description.place, addresses).await;
    let found_at = |address| {
        found
            .iter()
            .find(|(at, _)| *at == address)
            .map(|(_, found)| found)
    };
    let seen: Vec<_> = items
        .into_iter()
        .map(|item| (item, item.address.and_then(found_at)))
        .collect();
    let is_right = seen.iter().all(|(item, found)| is_right(item, *found));
    let is_watched = watchdog.is_none_or(|watchdog| matches!(found_at(watchdog.time), Some(Ok(_))));
    let identity =
        identity.map(|identity| shown_identity(drive, identity, found_at(identity.address)));
    let is_it = identity.as_ref().is_none_or(|it| it.result == "right");
    let items = seen.iter();
    SetupDocument {
        drive: description.name.to_string().into(),
        line: description.line.to_string().into(),
        model: model.id.clone().into(),
        right: is_right && is_watched && is_it,
        identity,
        items: items
            .map(|(item, found)| shown_item(model, item, *found))
            .collect(),
        watchdog: watchdog.map(|watchdog| shown_watchdog(drive, watchdog, found_at)),
        takes_priority: takes_priority(model),
    }
}

/// Sets the registers at `addresses` to what the model demands, and returns the outcome. What was there before is
/// read first, because the log has to say it.
pub(super) async fn set(
    side: &LocalSide,
    drive: &SharedDrive,
    addresses: Vec<Address>,
) -> OrderOutcomeDocument {
    let name = &drive.description.name;
    let place = drive.description.place;
    let items: Vec<_> = concerned(side, drive)
        .filter(|item| is_among(item, &addresses))
        .collect();
    if !addresses
        .iter()
        .all(|address| items.iter().any(|item| item.address == Some(*address)))
    {
        return outcome(name.as_str(), Report::refused(Reason::NotCapable));
    }
    let old = read(side, place, addresses.iter().copied()).await;
    let report = side
        .command(OrderingClient::TOOL, place, Order::Setup(addresses))
        .await;
    let mut changes = Vec::with_capacity(items.len());
    for item in items {
        let what = item.what.as_str();
        let new = item.written();
        let old = old
            .iter()
            .find(|(at, _)| Some(*at) == item.address)
            .and_then(|(_, found)| found.as_ref().ok());
        let outcome = report.outcome.keyword();
        let reason = report.reason.keyword();
        tracing::info!(drive = %name, by = %Owner::Local, what, old, new, outcome, reason, "set for bus control");
        changes.push(ChangeDocument {
            what: what.to_owned().into(),
            address: item.address.map(Address::number),
            old: old.copied().map(u32::from),
            new: new.map(u32::from),
        });
    }
    outcome_at(drive, report, changes)
}

/// The outcome of an order for `drive`, with its vendor's words for an exception.
pub(super) fn outcome_at(
    drive: &SharedDrive,
    report: Report,
    changes: Vec<ChangeDocument>,
) -> OrderOutcomeDocument {
    OrderOutcomeDocument {
        message: message(&drive.description.model, &report).into(),
        changes,
        ..outcome(drive.description.name.as_str(), report)
    }
}

/// The outcome of an order for the drive called `name`, which changed nothing.
pub(super) fn outcome(name: &str, report: Report) -> OrderOutcomeDocument {
    OrderOutcomeDocument {
        drive: name.to_owned().into(),
        outcome: report.outcome.keyword().into(),
        reason: report.reason.keyword().into(),
        message: report.message().into(),
        held: report.held,
        exception: report.exception,
        changes: Vec::new(),
        drives: None,
    }
}

/// The items that concern the drive's line, in the model's order.
fn concerned<'d>(
    side: &LocalSide,
    drive: &'d SharedDrive,
) -> impl Iterator<Item = &'d SetupItem> + use<'d> {
    let interface = side
        .shared()
        .line(drive.description.place)
        .map(|line| line.interface);
    let concerns = move |of: Option<Interface>| of.is_none() || of == interface;
    let description = &drive.description;
    let bus = description.bus();
    let items = description.model.setup.iter();
    items.filter(move |item| concerns(item.interface) && item.concerns(&description.model, bus))
}

fn is_among(item: &SetupItem, addresses: &[Address]) -> bool {
    item.address
        .is_some_and(|address| addresses.contains(&address))
}

/// Reads each register once, one after the other.
async fn read(
    side: &LocalSide,
    place: DriveRef,
    addresses: impl Iterator<Item = Address>,
) -> Vec<(Address, Found)> {
    let deadline = clock::now() + READ_WITHIN;
    let mut found: Vec<(Address, Found)> = Vec::new();
    for address in addresses {
        if !found.iter().any(|(at, _)| *at == address) {
            found.push((address, side.read(place, address, deadline).await));
        }
    }
    found
}

/// What can only be checked at the drive itself is never wrong here.
fn is_right(item: &SetupItem, found: Option<&Found>) -> bool {
    match found {
        None => item.address.is_none(),
        Some(Ok(word)) => item.is_right(*word),
        Some(Err(_)) => false,
    }
}

fn shown_item(model: &Model, item: &SetupItem, found: Option<&Found>) -> SetupItemDocument {
    let register = item.address.and_then(|address| model.register_at(address));
    let result = match found {
        None => "at_the_drive",
        Some(Ok(_)) if is_right(item, found) => "right",
        Some(Ok(_)) => "wrong",
        Some(Err(_)) => "not_answered",
    };
    let wanted = item.values.value.iter();
    SetupItemDocument {
        what: item.what.clone().into(),
        text: item.text.clone().into(),
        address: item.address.map(Address::number),
        wanted: wanted.map(|value| word_shown(register, *value)).collect(),
        result: result.into(),
        seen: seen_word(model, register, found),
    }
}

/// Whether the drive is the one that the configuration names, and which one it is otherwise.
fn shown_identity(
    drive: &SharedDrive,
    identity: &ModelIdentity,
    found: Option<&Found>,
) -> IdentityDocument {
    let description = &drive.description;
    let qualified = description
        .control
        .as_ref()
        .and_then(|control| control.qualified_drive());
    let qualified = qualified
        .filter(|(address, _)| *address == identity.address)
        .map(|(_, word)| word & identity.mask);
    let (result, other) = match found {
        Some(Ok(word)) if !identity.is_right(*word) => ("wrong", identity.other(*word)),
        Some(Ok(word)) if qualified.is_some_and(|qualified| qualified != word & identity.mask) => {
            ("not_tried", None)
        }
        Some(Ok(_)) => ("right", None),
        Some(Err(_)) | None => ("not_answered", None),
    };
    let register = description.model.register_at(identity.address);
    let wanted = qualified.map_or_else(|| identity.values.value.clone(), |word| vec![word]);
    IdentityDocument {
        what: register.map(|register| register.label().to_owned()),
        mask: Some(identity.mask),
        wanted,
        result: result.into(),
        other: other.map(str::to_owned),
        seen: seen_word(&description.model, register, found),
    }
}

fn shown_watchdog<'f>(
    drive: &SharedDrive,
    watchdog: &ModelWatchdog,
    found_at: impl Fn(Address) -> Option<&'f Found>,
) -> SetupWatchdogDocument {
    let model = &*drive.description.model;
    let register = model.register_at(watchdog.time);
    let found = found_at(watchdog.time);
    let judged = drive
        .view
        .load()
        .watchdog
        .map(|watchdog| watchdog.state.keyword());
    let state = match found {
        Some(Ok(word)) if *word == watchdog.off.value => "off",
        Some(Ok(_)) => "on",
        Some(Err(_)) | None => "not_answered",
    };
    let action = watchdog.action.and_then(|address| {
        let held = found_at(address)?.as_ref().ok()?;
        Some(word_shown(model.register_at(address), *held))
    });
    // One that is stored by a word of its own may have been.
    let is_stored = model.is_stored(watchdog.time) || model.commit(CommitEffect::Store).is_some();
    SetupWatchdogDocument {
        what: register.map(|register| register.label().to_owned()),
        state: state.into(),
        action,
        judged: judged.map(str::to_owned),
        is_stored: Some(is_stored),
        seen: seen_word(model, register, found),
    }
}

/// The word that was read, or why it could not be.
fn seen_word(model: &Model, register: Option<&Register>, found: Option<&Found>) -> SeenWord {
    match found {
        None => SeenWord::default(),
        Some(Ok(held)) => SeenWord {
            found: Some(word_shown(register, *held)),
            ..SeenWord::default()
        },
        Some(Err(failure)) => unseen(model, failure),
    }
}

/// Why a word could not be read.
pub(super) fn unseen(model: &Model, failure: &Report) -> SeenWord {
    SeenWord {
        found: None,
        reason: Some(failure.reason.keyword().to_owned()),
        message: Some(message(model, failure)),
        exception: failure.exception,
    }
}

/// A word and its meaning, if it is more than a number.
pub(super) fn word_shown(register: Option<&Register>, raw: u16) -> WordDocument {
    let text = register.and_then(|register| {
        let is_plain = register.unit == UnitOfMeasure::None && register.scale == 1;
        let scaled = || {
            format!(
                "{} {}",
                ScaledValue::from_word(raw, register),
                register.unit
            )
        };
        let meaning = register.meaning(raw).map(str::to_owned);
        meaning.or_else(|| (!is_plain).then(scaled))
    });
    WordDocument {
        raw: raw.into(),
        text,
    }
}

/// Whether the drive obeys every command from the bus whatever its own settings say.
fn takes_priority(model: &Model) -> bool {
    let form = model.run.as_ref().map(|run| &run.form);
    matches!(form, Some(RunForm::Bits { priority: 1.., .. }))
}
