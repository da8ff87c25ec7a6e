//! The parameters of a drive, for `vfd-gateway params` over the socket: the list, the present value of one, and writing
//! one through the guard.

use super::answers::json as answer;
use super::own_routes::{find, not_understood, too_many, unknown};
use super::setup::{outcome, outcome_at, unseen, word_shown};
use crate::daemon::exchange::shared::SharedDrive;
use crate::daemon::host::clock;
use crate::daemon::local::{LocalSide, OrderingClient};
use crate::domain::address::Address;
use crate::domain::address::DataTable;
use crate::domain::command::{GoOrder, Order, Outcome, Owner, Reason, RegisterWrite, Report};
use crate::drive::view::RunState;
use crate::north::api::{
    ChangeDocument, CommitDocument, LeftOutDocument, ListedParameterDocument, OrderOutcomeDocument,
    ParameterDocument, ParameterGroupDocument, ParameterListDocument, SeenWord, WordDocument,
};
use crate::north::setup_body::{PARAMETER_EXAMPLE, parameter_number};
use crate::north::shown::run_state;
use crate::profile::model::{CommitEffect, Model, ParameterGroup, Register, RegisterRole};
use axum::Router;
use axum::body::Bytes;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use std::sync::Arc;
use std::time::Duration;

/// Longest time for one read.
const READ_WITHIN: Duration = Duration::from_secs(5);

/// The routes of parameters.
pub(super) fn router() -> Router<Arc<LocalSide>> {
    Router::new()
        .route("/api/v1/drives/{name}/params", get(list))
        .route("/api/v1/drives/{name}/params/commit", post(commit))
        .route(
            "/api/v1/drives/{name}/params/{address}",
            get(show_parameter).post(set),
        )
}

/// The list of parameters. It requests nothing from the drive.
async fn list(State(side): State<Arc<LocalSide>>, Path(name): Path<String>) -> Response {
    let Some(drive) = find(&side, &name) else {
        return unknown(&side, &name);
    };
    let description = &drive.description;
    let model = &*drive.description.model;
    let parameters = model.parameters();
    let groups = model.groups();
    let shown = ParameterListDocument {
        drive: description.name.to_string().into(),
        line: description.line.to_string().into(),
        model: model.id.clone().into(),
        may_be_written: description.control.is_some(),
        parameters: parameters
            .map(|register| parameter(model, register))
            .collect(),
        commit: commit_word(model),
        left_out: left_out(model),
        groups: groups.iter().map(|group| others(model, group)).collect(),
    };
    answer(&shown).into_response()
}

fn parameter(model: &Model, register: &Register) -> ListedParameterDocument {
    ListedParameterDocument {
        code: register.label().to_owned().into(),
        name: register.name.clone().into(),
        title: register.title.clone().into(),
        address: register.address.number(),
        unit: register.unit.symbol().into(),
        kind: register.parameter_kind().keyword().into(),
        reason: register.back_door.clone(),
        is_stored: model.is_stored(register.address),
    }
}

/// The word that follows the last parameter that is restored; `None` if the drive needs none.
fn commit_word(model: &Model) -> Option<CommitDocument> {
    let stated = [CommitEffect::Store, CommitEffect::Apply]
        .into_iter()
        .find_map(|it| model.commit.stated(it));
    let word = model.last_commit().or(stated.map(|fact| &fact.value))?;
    let register = model.writable_at(word.address);
    Some(CommitDocument {
        does: word.effect.keyword().into(),
        what: register.map(|register| register.label().to_owned()),
        is_sent: model.commit(word.effect).is_some(),
    })
}

/// The registers of the model that are not parameters, each with the reason.
fn left_out(model: &Model) -> Vec<LeftOutDocument> {
    let reason = |register: &Register| match (register.access.can_read(), register.role) {
        (
            false,
            Some(RegisterRole::RunCommand | RegisterRole::Order | RegisterRole::FrequencyCommand),
        ) => Some("a command register, which cannot be read"),
        (false, _) => Some("write-only"),
        _ if register.address.table() != DataTable::Holding => {
            Some("not a parameter: no holding register")
        }
        (true, _) if register.code.is_none() => {
            Some("not a parameter: the vendor has no code for it")
        }
        (true, _) => None,
    };
    let left_out = model.registers.iter().filter_map(|register| {
        let reason = reason(register)?;
        Some(LeftOutDocument {
            code: register.label().to_owned().into(),
            address: register.address.number(),
            reason: reason.into(),
        })
    });
    left_out.collect()
}

/// A group of parameters, including those that the model does not describe: the drive may or may not have them.
fn others(model: &Model, group: &ParameterGroup) -> ParameterGroupDocument {
    let unknown = model
        .addresses_of(group)
        .filter(|address| !model.has_word_at(*address))
        .map(Address::number);
    ParameterGroupDocument {
        name: group.name.clone().into(),
        unknown: unknown.collect(),
    }
}

/// The present value of one of them.
async fn show_parameter(
    State(side): State<Arc<LocalSide>>,
    Path((name, address)): Path<(String, u16)>,
) -> Response {
    let Some(_place) = side.place() else {
        return too_many(&name);
    };
    let Some(drive) = find(&side, &name) else {
        return unknown(&side, &name);
    };
    let model = &drive.description.model;
    let register = readable(&drive, address);
    // What no register stands for is read as the number that it is, where it lies in a group of parameters.
    let in_group = if model.has_word_at(address.into()) {
        None
    } else {
        model.code_in_group(address.into())
    };
    let Some(code) = register.map(|it| it.label().to_owned()).or(in_group) else {
        return no_parameter(&name, address);
    };
    // Some drives do not answer for a parameter that they do not have and would count as silent: not while the motor
    // turns.
    let at_rest = matches!(
        run_state(&drive.view.load()),
        RunState::Stopped | RunState::Tripped
    );
    let found = match register {
        None if !at_rest => Err(Report::refused(Reason::Moving)),
        _ => read(&side, &drive, address).await,
    };
    let seen = match found {
        Ok(held) => SeenWord {
            found: Some(number(register, held)),
            ..SeenWord::default()
        },
        Err(failure) => unseen(model, &failure),
    };
    let code = code.into();
    answer(&ParameterDocument {
        code,
        address,
        seen,
    })
    .into_response()
}

/// Writes one of them.
async fn set(
    State(side): State<Arc<LocalSide>>,
    Path((name, address)): Path<(String, u16)>,
    body: Bytes,
) -> Response {
    let Some(place) = side.place() else {
        return too_many(&name);
    };
    let Some(drive) = find(&side, &name) else {
        return unknown(&side, &name);
    };
    let Some(raw) = parameter_number(&body) else {
        return not_understood(
            &name,
            format!("a body such as {PARAMETER_EXAMPLE} is expected"),
        );
    };
    if readable(&drive, address).is_none() {
        return no_parameter(&name, address);
    }
    // A client that disconnects does not cancel the order; its outcome is logged.
    let carried_out = tokio::spawn(async move {
        let _place = place;
        write(&side, &drive, address, raw).await
    });
    match carried_out.await {
        Ok(done) => answer(&done).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
    }
}

/// Lets the drive take over or store what was written.
async fn commit(State(side): State<Arc<LocalSide>>, Path(name): Path<String>) -> Response {
    let Some(place) = side.place() else {
        return too_many(&name);
    };
    let Some(drive) = find(&side, &name) else {
        return unknown(&side, &name);
    };
    let Some(word) = drive.description.model.last_commit().cloned() else {
        return answer(&outcome_at(
            &drive,
            Report::refused(Reason::NotCapable),
            Vec::new(),
        ))
        .into_response();
    };
    // A client that disconnects does not cancel the order; its outcome is logged.
    let carried_out = tokio::spawn(async move {
        let _place = place;
        let write = RegisterWrite::new(word.address, word.value);
        let Some(go) = GoOrder::new(vec![write], None, None) else {
            return outcome_at(&drive, Report::refused(Reason::NotUnderstood), Vec::new());
        };
        let report = side
            .command(OrderingClient::TOOL, drive.description.place, Order::Go(go))
            .await;
        let name = drive.description.name.as_str();
        let (does, result, reason) = (
            word.effect.keyword(),
            report.outcome.keyword(),
            report.reason.keyword(),
        );
        tracing::info!(drive = name, by = %Owner::Local, does, outcome = result, reason, "parameters committed");
        outcome_at(&drive, report, Vec::new())
    });
    match carried_out.await {
        Ok(done) => answer(&done).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
    }
}

fn readable(drive: &SharedDrive, address: u16) -> Option<&Register> {
    drive
        .description
        .model
        .parameters()
        .find(|register| register.address == address)
}

fn no_parameter(name: &str, address: u16) -> Response {
    let message = format!("the model has no parameter at 0x{address:04X} that can be read");
    let refusal = OrderOutcomeDocument {
        message: message.into(),
        ..outcome(name, Report::refused(Reason::NotListed))
    };
    (StatusCode::UNPROCESSABLE_ENTITY, answer(&refusal)).into_response()
}

/// The number that the drive holds at `address`: both words of a value of two.
async fn read(side: &LocalSide, drive: &SharedDrive, address: u16) -> Result<u32, Report> {
    let register = readable(drive, address);
    let count = register.map_or(1, |register| register.form.words());
    let deadline = clock::now() + READ_WITHIN;
    let words = side
        .read_words(drive.description.place, address.into(), count, deadline)
        .await?;
    match (register.and_then(|register| register.form.pair), &words[..]) {
        (Some(order), [first, second]) => Ok(order.number([*first, *second])),
        (None, [word]) => Ok(u32::from(*word)),
        _ => Err(Report::refused(Reason::NoReply)),
    }
}

/// The number and its meaning, if it is more than a number.
fn number(register: Option<&Register>, raw: u32) -> WordDocument {
    let of_two = register.and_then(|register| Some((register, register.form.pair?)));
    let Some((register, order)) = of_two else {
        return word_shown(register, (raw & 0xFFFF) as u16);
    };
    let words = order.words(raw);
    let value = register.value(|address| address.word_in(register.address, &words));
    WordDocument {
        raw,
        text: value.map(|value| format!("{value} {}", register.unit)),
    }
}

/// The write of `raw` to the register at `address`; `None` if its words do not hold that.
fn written(model: &Model, address: u16, raw: u32) -> Option<RegisterWrite> {
    match model
        .writable_at(address)
        .and_then(|register| register.form.pair)
    {
        Some(order) => Some(RegisterWrite::pair(address, order.words(raw))),
        None => Some(RegisterWrite::new(address, u16::try_from(raw).ok()?)),
    }
}

/// The old value is read first, because it is logged.
async fn write(
    side: &LocalSide,
    drive: &SharedDrive,
    address: u16,
    new: u32,
) -> OrderOutcomeDocument {
    let description = &drive.description;
    let model = &*drive.description.model;
    let name = description.name.as_str();
    let place = description.place;
    let old = match read(side, drive, address).await {
        Ok(old) => old,
        Err(failed) => {
            return outcome_at(
                drive,
                Report {
                    outcome: Outcome::Refused,
                    ..failed
                },
                Vec::new(),
            );
        }
    };
    let Some(write) = written(model, address, new) else {
        return outcome(name, Report::refused(Reason::OutsideRange));
    };
    let Some(go) = GoOrder::new(vec![write], None, None) else {
        return outcome(name, Report::refused(Reason::NotUnderstood));
    };
    let report = side
        .command(OrderingClient::TOOL, place, Order::Go(go))
        .await;
    let what = model.register_at(address).map_or("-", Register::label);
    let result = report.outcome.keyword();
    let reason = report.reason.keyword();
    tracing::info!(drive = name, by = %Owner::Local, what, old, new, outcome = result, reason, "parameter set");
    let change = ChangeDocument {
        what: what.to_owned().into(),
        address: Some(address),
        old: Some(old),
        new: Some(new),
    };
    outcome_at(drive, report, vec![change])
}
