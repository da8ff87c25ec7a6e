//! The routes of commissioning from the page: for users whose role allows it, where `[http] setup = true`.

mod shown;

use super::HttpControl;
use super::admission::{AdmittedRequest, Refused, admit_with, refused, signed_in};
use super::commands::find;
use crate::daemon::commissioning::file::NotDone;
use crate::daemon::commissioning::wanted::{WantedAddition, parse_addition};
use crate::daemon::commissioning::{self, Commissioning, Settings};
use crate::daemon::exchange::shared::SharedDrive;
use crate::daemon::host::adapters;
use crate::daemon::http::answers::{json, refusal};
use crate::daemon::http::setup;
use crate::daemon::local::OrderingClient;
use crate::domain::address::Address;
use crate::domain::command::{Outcome, Reason, Report};
use crate::journal::TriedWrite;
use crate::north::setup_body::{EXAMPLE, addresses};
use crate::toml_file::words::PARITIES;
use axum::Router;
use axum::body::Bytes;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use serde_json::{Value, json};
use shown::{problems_json, proposal_json, scan_json, site_json, values_json};
use std::sync::Arc;

/// Longest body in bytes: the drives of a whole line with their rules.
const BODY_BYTES_MAX: usize = 128 * 1024;
/// Most characters of what is kept in the audit.
const KEPT_CHARS: usize = 200;

const LINK_EXAMPLE: &str =
    r#"a `link` such as {"baud": 9600, "parity": "none", "stop_bits": 1} is expected"#;
const OFF: &str = "set-up in the page is off: `setup = true` in [http] turns it on";
const NOT_YOURS: &str = "this needs the role `setup`";

/// The routes.
pub(super) fn router(control: Arc<HttpControl>) -> Router {
    Router::new()
        .route("/api/v1/setup", get(site))
        .route("/api/v1/setup/scan", get(scan).post(begin).delete(forget))
        .route("/api/v1/setup/values", post(values))
        .route("/api/v1/setup/proposal", post(propose))
        .route("/api/v1/setup/apply", post(apply))
        .route("/api/v1/setup/drives/{name}", get(verify).post(enable))
        .with_state(control)
}

type Answer = Result<Response, Refused>;

/// Refusals of commissioning itself.
impl From<commissioning::CommissioningRefusal> for Refused {
    fn from(why: commissioning::CommissioningRefusal) -> Self {
        let status = match why {
            commissioning::CommissioningRefusal::Wrong(_) => StatusCode::BAD_REQUEST,
            commissioning::CommissioningRefusal::InTheWay(_) => StatusCode::CONFLICT,
            commissioning::CommissioningRefusal::NotThere(_) => StatusCode::NOT_FOUND,
        };
        refused(status, &why.to_string())
    }
}

fn answered(answer: Answer) -> Response {
    answer.unwrap_or_else(|refused| *refused)
}

/// Commissioning, for a user who only looks.
fn looked_at(control: &HttpControl, headers: &HeaderMap) -> Result<Arc<Commissioning>, Refused> {
    let rights = signed_in(control, headers)
        .ok_or_else(|| refused(StatusCode::UNAUTHORIZED, "you are not signed in"))?;
    allowed(control, rights.may_set_up())
}

fn allowed(control: &HttpControl, may_set_up: bool) -> Result<Arc<Commissioning>, Refused> {
    match &control.commissioning {
        Some(commissioning) if control.front.load().sets_up() => {
            if may_set_up {
                Ok(Arc::clone(commissioning))
            } else {
                Err(refused(StatusCode::FORBIDDEN, NOT_YOURS))
            }
        }
        _ => Err(refused(StatusCode::FORBIDDEN, OFF)),
    }
}

/// A request that does something, with who sent it.
async fn admitted(
    control: &HttpControl,
    request: Request,
) -> Result<(Arc<Commissioning>, OrderingClient, Bytes), Refused> {
    let AdmittedRequest {
        user,
        rights,
        body,
        old,
        ..
    } = admit_with(control, request, BODY_BYTES_MAX)
        .await?
        .whole()?;
    let commissioning = allowed(control, rights.may_set_up())?;
    match old {
        Some(old) => Err(refused(StatusCode::CONFLICT, &old.to_string())),
        None => Ok((commissioning, OrderingClient::signed_in(user), body)),
    }
}

async fn site(State(control): State<Arc<HttpControl>>, headers: HeaderMap) -> Response {
    let answer = async {
        let commissioning = looked_at(&control, &headers)?;
        let present = commissioning.present().await;
        // To find the holders of ports takes longer than this thread may.
        let ports = tokio::task::spawn_blocking(adapters::list)
            .await
            .unwrap_or_default();
        Ok(json(&site_json(&commissioning, present, &ports)).into_response())
    };
    answered(answer.await)
}

async fn scan(State(control): State<Arc<HttpControl>>, headers: HeaderMap) -> Response {
    answered(
        looked_at(&control, &headers).map(|commissioning| match commissioning.scan() {
            Some(scan) => json(&scan_json(&scan)).into_response(),
            None => refusal(StatusCode::NOT_FOUND, "no scan was started"),
        }),
    )
}

async fn begin(State(control): State<Arc<HttpControl>>, request: Request) -> Response {
    let answer = async {
        let (commissioning, who, body) = admitted(&control, request).await?;
        let expected = r#"a body such as {"port": "/dev/ttyUSB0", "stations": "1-32"} is expected"#;
        let body: Value = serde_json::from_slice(&body).unwrap_or_default();
        let wish = (body["port"].as_str(), body["stations"].as_str());
        let (Some(port), Some(stations)) = wish else {
            return Err(refused(StatusCode::BAD_REQUEST, expected));
        };
        let link = &body["link"];
        let how = match settings(link) {
            Some(only) => only,
            None if !link.is_null() => return Err(refused(StatusCode::BAD_REQUEST, LINK_EXAMPLE)),
            None if body["all_settings"] == true => Settings::All,
            None => Settings::Factory,
        };
        let scan = commissioning.begin(port, stations, how).await?;
        tracing::info!(by = %who.owner(), port, stations, "scan from the page begins");
        Ok((StatusCode::ACCEPTED, json(&scan_json(&scan))).into_response())
    };
    answered(answer.await)
}

/// The one setting that is to be tried.
fn settings(link: &Value) -> Option<Settings> {
    let baud = u32::try_from(link["baud"].as_u64()?)
        .ok()
        .filter(|baud| (300..=1_000_000).contains(baud))?;
    let stop_bits = u8::try_from(link["stop_bits"].as_u64()?)
        .ok()
        .filter(|bits| (1..=2).contains(bits))?;
    let word = link["parity"].as_str()?;
    let (_, parity) = PARITIES.into_iter().find(|(known, _)| *known == word)?;
    Some(Settings::Only {
        baud,
        parity,
        stop_bits,
    })
}

async fn forget(State(control): State<Arc<HttpControl>>, request: Request) -> Response {
    let answer = async {
        let (commissioning, ..) = admitted(&control, request).await?;
        commissioning.forget().await;
        Ok(StatusCode::NO_CONTENT.into_response())
    };
    answered(answer.await)
}

async fn values(State(control): State<Arc<HttpControl>>, request: Request) -> Response {
    let answer = async {
        let (commissioning, _, body) = admitted(&control, request).await?;
        let expected = r#"a body such as {"station": 3, "models": ["the id of one"]} is expected"#;
        let body: Value = serde_json::from_slice(&body).unwrap_or_default();
        let station = body["station"]
            .as_u64()
            .and_then(|station| u8::try_from(station).ok());
        let models = body["models"]
            .as_array()
            .map(|ids| ids.iter().filter_map(Value::as_str).map(str::to_owned));
        let (Some(station), Some(models)) = (station, models) else {
            return Err(refused(StatusCode::BAD_REQUEST, expected));
        };
        let values = commissioning
            .values(station, &models.collect::<Vec<_>>())
            .await?;
        Ok(json(&values_json(station, &values)).into_response())
    };
    answered(answer.await)
}

async fn propose(State(control): State<Arc<HttpControl>>, request: Request) -> Response {
    let answer = async {
        let (commissioning, _, body) = admitted(&control, request).await?;
        let (wanted, _) = parse_addition(&body)?;
        Ok(json(&proposal_json(&commissioning.proposal(&wanted).await?)).into_response())
    };
    answered(answer.await)
}

async fn apply(State(control): State<Arc<HttpControl>>, request: Request) -> Response {
    let answer = async {
        let (commissioning, who, body) = admitted(&control, request).await?;
        let (wanted, digest) = parse_addition(&body)?;
        let digest = digest
            .ok_or_else(|| refused(StatusCode::BAD_REQUEST, "`digest` is missing: check first"))?;
        // A client that disconnects does not leave the file half way.
        let changed =
            tokio::spawn(async move { (commissioning.apply(&wanted, &digest).await, wanted) });
        let Ok((done, wanted)) = changed.await else {
            return Err(refused(
                StatusCode::INTERNAL_SERVER_ERROR,
                "the change broke off",
            ));
        };
        let what = described(&wanted);
        match &done {
            Ok(_) => kept(&control, who, Outcome::Acknowledged, &what),
            Err(NotDone::Refused(why)) => {
                kept(&control, who, Outcome::Refused, &format!("{what}: {why}"))
            }
            Err(NotDone::Problems(_)) => kept(
                &control,
                who,
                Outcome::Refused,
                &format!("{what}: it has problems"),
            ),
        }
        match done {
            Ok(done) => {
                let kept_as = done.kept_as.display().to_string();
                tracing::info!(by = %who.owner(), kept_as, "configuration changed from the page: {what}");
                let changes: Vec<_> = done
                    .applied
                    .changes
                    .iter()
                    .map(ToString::to_string)
                    .collect();
                let warnings = problems_json(&done.applied.warnings, "");
                let answer = json!({ "applied": true, "kept_as": kept_as, "changes": changes, "warnings": warnings });
                Ok(json(&answer).into_response())
            }
            Err(NotDone::Refused(why)) => Err(why.into()),
            Err(NotDone::Problems(proposal)) => {
                let mut answer = proposal_json(&proposal);
                answer["error"] = "the file would have problems; nothing was changed".into();
                Ok((StatusCode::UNPROCESSABLE_ENTITY, json(&answer)).into_response())
            }
        }
    };
    answered(answer.await)
}

/// What was changed, for log and audit.
fn described(wanted: &WantedAddition) -> String {
    match wanted {
        WantedAddition::Line { name, drives } => {
            let drives: Vec<_> = drives.iter().map(|drive| drive.name.as_str()).collect();
            format!("set-up: line {name} with {}", drives.join(", "))
        }
        WantedAddition::Control { drive, .. } => format!("set-up: control of {drive}"),
    }
}

/// Keeps in the audit what a user did here; why it was refused is part of the text.
fn kept(control: &HttpControl, who: OrderingClient, outcome: Outcome, what: &str) {
    let tried = TriedWrite::Text(what.chars().take(KEPT_CHARS).collect());
    control
        .side
        .keep(who, None, tried, Report::new(outcome, Reason::None));
}

async fn verify(
    State(control): State<Arc<HttpControl>>,
    Path(name): Path<String>,
    headers: HeaderMap,
) -> Response {
    let answer = async {
        let commissioning = looked_at(&control, &headers)?;
        let (side, drive) = (commissioning.side(), drive(&control, &name)?);
        let _place = side.place().ok_or_else(too_many)?;
        Ok(json(&setup::report(side, &drive).await).into_response())
    };
    answered(answer.await)
}

/// Sets what the drive's model demands for bus control, as `vfd-gateway enable` does: the gateway is the tool of a user
/// whom the configuration allows this.
async fn enable(
    State(control): State<Arc<HttpControl>>,
    Path(name): Path<String>,
    request: Request,
) -> Response {
    let answer = async {
        let (commissioning, who, body) = admitted(&control, request).await?;
        let drive = drive(&control, &name)?;
        let expected = || {
            refused(
                StatusCode::BAD_REQUEST,
                &format!("a body such as {EXAMPLE} is expected"),
            )
        };
        let registers: Vec<_> = addresses(&body)
            .ok_or_else(expected)?
            .into_iter()
            .map(Address::holding)
            .collect();
        let place = commissioning.side().place().ok_or_else(too_many)?;
        // A client that disconnects does not cancel the order.
        let set = tokio::spawn(async move {
            let _place = place;
            setup::set(commissioning.side(), &drive, registers).await
        });
        let Ok(answer) = set.await else {
            return Err(refused(
                StatusCode::INTERNAL_SERVER_ERROR,
                "the order broke off",
            ));
        };
        tracing::info!(by = %who.owner(), drive = name, "set for bus control from the page");
        // The order itself is the gateway's own; this names the user.
        kept(
            &control,
            who,
            Outcome::Acknowledged,
            &format!("set-up: enable of {name}"),
        );
        Ok(json(&answer).into_response())
    };
    answered(answer.await)
}

fn drive(control: &HttpControl, name: &str) -> Result<Arc<SharedDrive>, Refused> {
    find(control, name).ok_or_else(|| refused(StatusCode::NOT_FOUND, "there is no such drive"))
}

fn too_many() -> Refused {
    refused(
        StatusCode::SERVICE_UNAVAILABLE,
        "other tools are being served; try again in a moment",
    )
}
