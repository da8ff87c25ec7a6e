//! Signing in and out.

use super::HttpControl;
use super::admission::{
    Refused, admit, comes_from_own_page, id_in, is_possible, json_body, key_of, refused, token_of,
};
use crate::daemon::host::clock;
use crate::daemon::http::answers::json;
use crate::daemon::http::entrance::PeerAddress;
use crate::daemon::http::front::{ClientRequirements, HttpUser};
use crate::domain::ids::{CommanderName, Name};
use crate::north::api::{SignInBody, read_exactly};
use crate::north::operator::body::SIGN_IN_EXAMPLE;
use crate::north::operator::request::{COOKIE, key_text};
use crate::north::operator::rights::UserRights;
use crate::north::operator::sessions::Key;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use ring::rand::{SecureRandom, SystemRandom};
use serde_json::{Value, json};
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::timeout;

/// Longest wait for the comparison of a password.
const VERIFIED_WITHIN: Duration = Duration::from_secs(5);

/// Whether control is possible, who is signed in, and the moment for the next order.
pub(super) async fn session(
    State(control): State<Arc<HttpControl>>,
    headers: HeaderMap,
) -> Response {
    let front = control.front.load_full();
    let is_enabled = !front.users().is_empty();
    let id = if is_enabled { id_in(&headers) } else { None };
    let user = id.and_then(|id| {
        Some((
            control.sessions().user(clock::now(), &key_of(&id))?,
            token_of(&id),
        ))
    });
    let mut answer = user.map_or(json!({ "user": null, "token": null }), |(user, token)| {
        signed_in_as(&front, user, token)
    });
    answer["enabled"] = is_enabled.into();
    answer["private"] = front.is_private().into();
    answer["moment"] = control.moments.at(clock::now()).into();
    json(&answer).into_response()
}

/// Who is signed in, what this user may do, and the token that the user's requests carry.
fn signed_in_as(front: &ClientRequirements, user: CommanderName, token: String) -> Value {
    let rights = front.rights(user);
    let groups = rights.and_then(|rights| rights.groups.as_ref());
    json!({
        "user": user.as_str(),
        "role": rights.map(|rights| rights.role.keyword()),
        "groups": groups.map(|groups| groups.iter().map(Name::as_str).collect::<Vec<_>>()),
        "setup": front.sets_up() && rights.is_some_and(UserRights::may_set_up),
        "token": token,
    })
}

/// Signs in.
pub(super) async fn sign_in(State(control): State<Arc<HttpControl>>, request: Request) -> Response {
    match signed_in(&control, request).await {
        Ok(answer) => answer,
        Err(refused) => *refused,
    }
}

async fn signed_in(control: &HttpControl, request: Request) -> Result<Response, Refused> {
    is_possible(control)?;
    let (parts, body) = request.into_parts();
    comes_from_own_page(&parts.headers)?;
    let body = json_body(&parts.headers, body).await?;
    let expected = || {
        refused(
            StatusCode::BAD_REQUEST,
            &format!("a body such as {SIGN_IN_EXAMPLE} is expected"),
        )
    };
    let SignInBody {
        user: name,
        password,
    } = read_exactly(&body).ok_or_else(expected)?;
    let peer = parts
        .extensions
        .get::<PeerAddress>()
        .map_or(IpAddr::V4(Ipv4Addr::LOCALHOST), |PeerAddress(peer)| *peer);
    // Not counted as an attempt: nothing was compared.
    let Ok(_place) = control.sign_ins.try_acquire() else {
        return Err(busy());
    };
    control
        .attempts()
        .begin(clock::now(), peer)
        .map_err(|wait| wait_first(wait, peer))?;
    let Some(user) = verified(control, &name, password).await? else {
        control.attempts().failed(clock::now(), peer);
        tracing::warn!(%peer, "sign-in on the page failed");
        return Err(refused(
            StatusCode::UNAUTHORIZED,
            "the user or the password is wrong",
        ));
    };
    control.attempts().succeeded(peer);
    let id = random().ok_or_else(|| {
        refused(
            StatusCode::INTERNAL_SERVER_ERROR,
            "no random numbers from the system",
        )
    })?;
    if let Some(before) = id_in(&parts.headers) {
        control.sessions().close(&key_of(&before));
    }
    control.sessions().open(clock::now(), key_of(&id), user);
    tracing::info!(%user, %peer, "signed in on the page");
    let mut answer = signed_in_as(&control.front.load(), user, token_of(&id));
    answer["moment"] = control.moments.at(clock::now()).into();
    let mut answer = json(&answer).into_response();
    set_cookie(control, &mut answer, &key_text(&id), "");
    Ok(answer)
}

fn busy() -> Refused {
    refused(
        StatusCode::SERVICE_UNAVAILABLE,
        "too many sign-ins at once; try again",
    )
}

fn wait_first(wait: Duration, peer: IpAddr) -> Refused {
    tracing::debug!(%peer, ?wait, "sign-in on the page refused: too many have failed");
    let seconds = wait.as_secs() + u64::from(wait.subsec_nanos() > 0);
    let mut answer = refused(
        StatusCode::TOO_MANY_REQUESTS,
        &format!("too many sign-ins have failed; try again in {seconds} s"),
    );
    answer
        .headers_mut()
        .insert(header::RETRY_AFTER, HeaderValue::from(seconds));
    answer
}

/// The user called `name`, if `password` is right. Takes equally long for a user who does not exist.
async fn verified(
    control: &HttpControl,
    name: &str,
    password: String,
) -> Result<Option<CommanderName>, Refused> {
    let place = timeout(
        VERIFIED_WITHIN,
        Arc::clone(&control.verifications).acquire_owned(),
    )
    .await;
    let Ok(Ok(place)) = place else {
        return Err(busy());
    };
    let front = control.front.load_full();
    let known = front
        .users()
        .iter()
        .find(|user| user.name.as_str() == name)
        .cloned();
    let Some(HttpUser { name, hash, .. }) =
        known.clone().or_else(|| front.users().first().cloned())
    else {
        return Ok(None);
    };
    let matches = tokio::task::spawn_blocking(move || {
        let _place = place;
        hash.matches(&password)
    });
    let matches = matches.await.unwrap_or(false) && known.is_some();
    // The configuration may have changed meanwhile.
    Ok(Some(name).filter(|name| matches && control.front.load().knows_as(&front, *name)))
}

/// Signs out.
pub(super) async fn sign_out(
    State(control): State<Arc<HttpControl>>,
    request: Request,
) -> Response {
    let admitted = match admit(&control, request).await {
        Ok(admitted) => admitted,
        Err(refused) => return *refused,
    };
    control.sessions().close(&admitted.key);
    tracing::info!(user = %admitted.user, "signed out on the page");
    let mut answer = StatusCode::NO_CONTENT.into_response();
    set_cookie(&control, &mut answer, "", "; Max-Age=0");
    answer
}

/// 256 random bits.
fn random() -> Option<Key> {
    let mut id = Key::default();
    SystemRandom::new().fill(&mut id).ok().map(|()| id)
}

/// Scripts cannot read the cookie, and other pages cannot have it sent.
fn set_cookie(control: &HttpControl, answer: &mut Response, id: &str, more: &str) {
    let secure = if control.front.load().tls().is_some() {
        "; Secure"
    } else {
        ""
    };
    let cookie = format!("{COOKIE}={id}; HttpOnly; SameSite=Strict; Path=/{secure}{more}");
    if let Ok(cookie) = HeaderValue::from_str(&cookie) {
        answer.headers_mut().insert(header::SET_COOKIE, cookie);
    }
}
