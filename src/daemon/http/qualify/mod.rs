//! Trials of what a model leaves unproven, for `vfd-gateway qualify` over the socket: what is to be tried, one order of a
//! trial, and its result.

mod body;
mod frames;
mod shown;

use super::answers::json as answer;
use super::own_routes::{find, not_understood, too_many, unknown};
use super::setup::{outcome, outcome_at};
use crate::config::qualified::{
    QualifiedDrive, QualifiedFact, QualifiedResults, QualifiedStanding, TrialFinding,
};
use crate::daemon::exchange::shared::SharedDrive;
use crate::daemon::host::clock;
use crate::daemon::local::{CommandMarks, LocalSide, OrderingClient};
use crate::daemon::qualified_file;
use crate::domain::calendar::rfc3339;
use crate::domain::command::{Outcome, Owner, Reason, Report};
use crate::domain::control::ControlAction;
use crate::domain::ids::Station;
use crate::drive::description::{DriveDescription, DriveRef};
use crate::journal::TriedWrite;
use crate::north::api::OrderOutcomeDocument;
use crate::profile::model::OrderKind;
use axum::Router;
use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use body::{RESULT_EXAMPLE, TRIAL_EXAMPLE, TrialOrder};
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Longest body in bytes.
const BODY_BYTES_MAX: usize = 1024;
/// Longest time for one read.
const READ_WITHIN: Duration = Duration::from_secs(5);

/// The trials of one gateway.
#[derive(Debug)]
pub(super) struct GatewayTrials {
    side: Arc<LocalSide>,
    data_dir: PathBuf,
    /// The orders that a drive has acknowledged in a trial since this process started.
    done: Mutex<BTreeSet<(DriveRef, TrialOrder)>>,
    /// One change of the file at a time.
    writing: tokio::sync::Mutex<()>,
}

/// The routes of the trials of the gateway with its data in `data_dir`.
pub(super) fn router(side: Arc<LocalSide>, data_dir: PathBuf) -> Router {
    let trials = GatewayTrials {
        side,
        data_dir,
        done: Mutex::default(),
        writing: tokio::sync::Mutex::default(),
    };
    Router::new()
        .route(
            "/api/v1/drives/{name}/qualify",
            get(show_trials).post(try_out),
        )
        .route("/api/v1/drives/{name}/qualify/state", get(state))
        .route("/api/v1/drives/{name}/qualify/result", post(keep_result))
        .route("/api/v1/drives/{name}/qualify/forget", post(forget))
        .layer(DefaultBodyLimit::max(BODY_BYTES_MAX))
        .with_state(Arc::new(trials))
}

impl GatewayTrials {
    async fn qualified(&self) -> Result<QualifiedResults, String> {
        let data_dir = self.data_dir.clone();
        let read = tokio::task::spawn_blocking(move || qualified_file::read(&data_dir)).await;
        read.unwrap_or_else(|error| Err(error.to_string()))
    }

    /// Changes the file. One that cannot be used is replaced: it counted for nothing.
    async fn change(
        &self,
        change: impl FnOnce(&mut QualifiedResults) -> Result<(), String>,
    ) -> Result<(), String> {
        let _writing = self.writing.lock().await;
        let mut qualified = self.qualified().await.unwrap_or_else(|error| {
            tracing::warn!(%error, "the file of qualified drives cannot be used and is replaced");
            QualifiedResults::default()
        });
        change(&mut qualified)?;
        let data_dir = self.data_dir.clone();
        let written =
            tokio::task::spawn_blocking(move || qualified_file::write(&data_dir, &qualified)).await;
        written
            .map_err(|error| error.to_string())?
            .map_err(|error| error.to_string())
    }

    fn has_done(&self, place: DriveRef, order: TrialOrder) -> bool {
        self.done
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .contains(&(place, order))
    }

    fn did(&self, place: DriveRef, order: TrialOrder) {
        self.done
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .insert((place, order));
    }

    fn forgets(&self, place: DriveRef) {
        self.done
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .retain(|(of, _)| *of != place);
    }

    /// The station of a drive; every drive of a line that is served has one.
    fn station(&self, place: DriveRef) -> Option<Station> {
        let shared = self.side.shared();
        shared
            .line(place)?
            .wiring
            .stations
            .get(place.drive.get())
            .copied()
    }

    /// Reads the identity of the drive: the key of its results.
    async fn drive_as_it_is(
        &self,
        description: &DriveDescription,
    ) -> Result<QualifiedDrive, Report> {
        let model = &description.model;
        let station = self
            .station(description.place)
            .ok_or(Report::refused(Reason::UnknownDrive))?;
        let identity = match &model.identity {
            None => None,
            Some(identity) => {
                let word = self
                    .side
                    .read(
                        description.place,
                        identity.address,
                        clock::now() + READ_WITHIN,
                    )
                    .await?;
                Some((identity.address.number(), word & identity.mask))
            }
        };
        let line = description.line.to_string();
        Ok(QualifiedDrive {
            line,
            station: station.0,
            model: model.id.clone(),
            digest: model.digest,
            identity,
        })
    }

    fn standing(
        &self,
        description: &DriveDescription,
        qualified: &QualifiedResults,
    ) -> QualifiedStanding {
        let station = self.station(description.place);
        station.map_or(QualifiedStanding::Never, |at| {
            qualified.standing(description.line.as_str(), at, &description.model)
        })
    }

    /// Stop, forward and the setpoint are sure before anything else is tried, and a stop before the first start.
    async fn is_in_turn(&self, description: &DriveDescription, order: TrialOrder) -> bool {
        if !self.has_done(description.place, TrialOrder::Sent(OrderKind::Stop)) {
            return false;
        }
        let control = description.control.as_ref();
        let is_sure =
            control.is_some_and(|it| description.model.may_be_ordered(&it.accept_unverified));
        if is_sure || order == TrialOrder::Sent(OrderKind::Forward) {
            return true;
        }
        let qualified = self.qualified().await.unwrap_or_default();
        self.standing(description, &qualified)
            .actions()
            .contains(&ControlAction::Basic)
    }

    async fn send(&self, drive: &SharedDrive, order: TrialOrder, epoch: Option<u64>) -> Report {
        let description = &drive.description;
        let Some(control) = &description.control else {
            return Report::refused(Reason::ReadOnly);
        };
        let is_free = matches!(order, TrialOrder::Sent(OrderKind::Stop) | TrialOrder::Renew);
        if !is_free && !self.is_in_turn(description, order).await {
            return Report::refused(Reason::Unverified);
        }
        let Some(wanted) = order.order(frames::trial_frequency(control)) else {
            return Report::refused(Reason::NotUnderstood);
        };
        let marks = CommandMarks {
            epoch: if order.runs() { epoch } else { None },
            trial: order.action(),
        };
        let report = self
            .side
            .order_marked(OrderingClient::TRIAL, description.place, wanted, marks)
            .end()
            .await;
        if matches!(report.outcome, Outcome::Acknowledged | Outcome::Confirmed) {
            self.did(description.place, order);
        }
        if let TrialOrder::Sent(kind) = order {
            let drive = description.name.as_str();
            let outcome = report.outcome.keyword();
            let reason = report.reason.keyword();
            tracing::info!(drive, by = %Owner::Local, order = kind.keyword(), outcome, reason, "trial");
        }
        report
    }
}

/// The actions to be tried at a drive, and their results so far. Its identity is read from the drive.
async fn show_trials(
    State(trials): State<Arc<GatewayTrials>>,
    Path(name): Path<String>,
) -> Response {
    let Some(_place) = trials.side.place() else {
        return too_many(&name);
    };
    let Some(drive) = find(&trials.side, &name) else {
        return unknown(&trials.side, &name);
    };
    answer(&shown::all(&trials, &drive).await).into_response()
}

/// What the drive does, as it was last polled.
async fn state(State(trials): State<Arc<GatewayTrials>>, Path(name): Path<String>) -> Response {
    let Some(drive) = find(&trials.side, &name) else {
        return unknown(&trials.side, &name);
    };
    answer(&shown::state(&drive)).into_response()
}

/// One order of a trial.
async fn try_out(
    State(trials): State<Arc<GatewayTrials>>,
    Path(name): Path<String>,
    body: Bytes,
) -> Response {
    let Some((order, epoch)) = body::trial(&body) else {
        return not_understood(&name, format!("a body such as {TRIAL_EXAMPLE} is expected"));
    };
    // A stop never waits for a place.
    let place = trials.side.place();
    if place.is_none() && order != TrialOrder::Sent(OrderKind::Stop) && order != TrialOrder::Renew {
        return too_many(&name);
    }
    let Some(drive) = find(&trials.side, &name) else {
        return unknown(&trials.side, &name);
    };
    // A client that disconnects does not cancel the order: its lease ends, and the fail-safe action follows.
    let carried_out = tokio::spawn(async move {
        let _place = place;
        outcome_at(&drive, trials.send(&drive, order, epoch).await, Vec::new())
    });
    match carried_out.await {
        Ok(done) => answer(&done).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, format!("{error}\n")).into_response(),
    }
}

/// The result of a trial.
async fn keep_result(
    State(trials): State<Arc<GatewayTrials>>,
    Path(name): Path<String>,
    body: Bytes,
) -> Response {
    let Some((action, result, by)) = body::result(&body) else {
        return not_understood(
            &name,
            format!("a body such as {RESULT_EXAMPLE} is expected"),
        );
    };
    let Some(drive) = find(&trials.side, &name) else {
        return unknown(&trials.side, &name);
    };
    let description = &drive.description;
    let place = description.place;
    let is_on = description
        .control
        .as_ref()
        .is_some_and(|control| control.qualify);
    let was_tried = TrialOrder::of_action(action)
        .iter()
        .all(|order| trials.has_done(place, *order));
    let report = if !is_on {
        Report::refused(Reason::NotAllowed)
    } else if result == TrialFinding::Confirmed && !was_tried {
        Report::refused(Reason::Unverified)
    } else {
        match trials.drive_as_it_is(description).await {
            Err(report) => Report {
                outcome: Outcome::Refused,
                ..report
            },
            Ok(as_it_is) => {
                let at = rfc3339(clock::wall());
                let fact = QualifiedFact {
                    action,
                    result,
                    by: by.clone(),
                    at,
                };
                match trials
                    .change(|qualified| qualified.record(&as_it_is, fact))
                    .await
                {
                    Ok(()) => Report::new(Outcome::Confirmed, Reason::None),
                    Err(error) => return not_kept(&name, &error),
                }
            }
        }
    };
    let kept = match result {
        TrialFinding::Contradicted if report.outcome == Outcome::Confirmed => {
            Report::new(Outcome::Failed, Reason::NotReadBack)
        }
        _ => report,
    };
    let what = format!("qualify {}: {} by {by}", action.keyword(), result.keyword());
    trials.side.keep(
        OrderingClient::TRIAL,
        Some(place),
        TriedWrite::Text(what),
        kept,
    );
    let (action, result, outcome_word) =
        (action.keyword(), result.keyword(), report.outcome.keyword());
    tracing::info!(drive = %description.name, action, result, by, outcome = outcome_word, "qualified");
    answer(&outcome(&name, report)).into_response()
}

/// Forgets all results of a drive.
async fn forget(
    State(trials): State<Arc<GatewayTrials>>,
    Path(name): Path<String>,
    body: Bytes,
) -> Response {
    let Some(by) = body::by(&body) else {
        return not_understood(
            &name,
            "a body such as {\"by\": \"anna\"} is expected".to_owned(),
        );
    };
    let Some(drive) = find(&trials.side, &name) else {
        return unknown(&trials.side, &name);
    };
    let description = &drive.description;
    let Some(station) = trials.station(description.place) else {
        return unknown(&trials.side, &name);
    };
    let line = description.line.as_str();
    let forgotten = trials.change(|qualified| {
        qualified.forget(line, station);
        Ok(())
    });
    if let Err(error) = forgotten.await {
        return not_kept(&name, &error);
    }
    trials.forgets(description.place);
    let report = Report::new(Outcome::Confirmed, Reason::None);
    trials.side.keep(
        OrderingClient::TRIAL,
        Some(description.place),
        TriedWrite::Text(format!("qualify: forgotten by {by}")),
        report,
    );
    tracing::info!(drive = %description.name, by, "results of trials forgotten");
    answer(&outcome(&name, report)).into_response()
}

fn not_kept(name: &str, error: &str) -> Response {
    tracing::error!(drive = name, error, "cannot keep the result of a trial");
    let document = OrderOutcomeDocument {
        message: format!("the result cannot be kept: {error}").into(),
        ..outcome(name, Report::refused(Reason::QueueFull))
    };
    (StatusCode::INTERNAL_SERVER_ERROR, answer(&document)).into_response()
}
