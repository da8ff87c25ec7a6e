//! What a request that changes something must have: the gateway's own page as its origin, a session, and the token that
//! only that page knows.

use super::HttpControl;
use crate::daemon::host::clock;
use crate::daemon::http::answers::refusal;
use crate::domain::ids::CommanderName;
use crate::north::operator::body::BODY_BYTES_MAX;
use crate::north::operator::moments::OrderAge;
use crate::north::operator::request::{is_own_page, key_text, session_id};
use crate::north::operator::rights::UserRights;
use crate::north::operator::sessions::Key;
use axum::body::{Body, Bytes, HttpBody};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::middleware::Next;
use axum::response::Response;
use bytes::BytesMut;
use ring::digest::{Context, SHA256};
use std::future::poll_fn;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::timeout;

/// The header with the token.
const TOKEN_HEADER: &str = "x-csrf-token";
/// The header with the newest moment that the page has seen.
const MOMENT_HEADER: &str = "vfd-moment";
/// Most time for a body.
const BODY_WITHIN: Duration = Duration::from_secs(10);

/// A refusal as a response. Boxed: it is large and rare.
pub(super) type Refused = Box<Response>;

/// A request of a signed-in user.
pub(super) struct AdmittedRequest {
    pub user: CommanderName,
    /// What the user may do.
    pub rights: UserRights,
    /// The body, up to the longest allowed length.
    pub body: Bytes,
    /// Why the request may be old, if it may. If so, only a stop is executed.
    pub old: Option<OrderAge>,
    /// What is wrong with the body as a whole: too long, broken off or of another type. A stop in it is executed all
    /// the same.
    pub flaw: Option<Refused>,
    /// By which the session is known.
    pub key: Key,
}

impl AdmittedRequest {
    /// The request, if its body is valid.
    ///
    /// # Errors
    /// What is answered instead.
    pub fn whole(self) -> Result<Self, Refused> {
        match self.flaw {
            Some(flaw) => Err(flaw),
            None => Ok(self),
        }
    }
}

/// A refusal with a text.
pub(super) fn refused(status: StatusCode, error: &str) -> Refused {
    Box::new(refusal(status, error))
}

/// A digest of a session's id for one purpose, from which neither the id nor the digest for another purpose can be
/// derived.
pub(super) fn digest(purpose: &str, id: &[u8]) -> Key {
    let mut context = Context::new(&SHA256);
    context.update(purpose.as_bytes());
    context.update(&[0]);
    context.update(id);
    let mut key = Key::default();
    for (to, from) in key.iter_mut().zip(context.finish().as_ref()) {
        *to = *from;
    }
    key
}

/// The key of the session with `id`.
pub(super) fn key_of(id: &Key) -> Key {
    digest("session", id)
}

/// The token of the session with `id`.
pub(super) fn token_of(id: &Key) -> String {
    key_text(&digest("token", id))
}

/// The session's id that a request names.
pub(super) fn id_in(headers: &HeaderMap) -> Option<Key> {
    headers
        .get_all(header::COOKIE)
        .iter()
        .find_map(|cookies| session_id(cookies.to_str().ok()?))
}

/// Accepts a request of a signed-in user.
///
/// # Errors
/// What is answered instead.
pub(super) async fn admit(
    control: &HttpControl,
    request: Request,
) -> Result<AdmittedRequest, Refused> {
    admit_with(control, request, BODY_BYTES_MAX).await
}

/// Accepts a request of a signed-in user with a body of up to `bytes_max` bytes.
///
/// # Errors
/// What is answered instead.
pub(super) async fn admit_with(
    control: &HttpControl,
    request: Request,
    bytes_max: usize,
) -> Result<AdmittedRequest, Refused> {
    is_possible(control)?;
    let (parts, body) = request.into_parts();
    comes_from_own_page(&parts.headers)?;
    let signed_out = || refused(StatusCode::UNAUTHORIZED, "you are not signed in");
    let id = id_in(&parts.headers).ok_or_else(signed_out)?;
    let key = key_of(&id);
    control
        .sessions()
        .user(clock::now(), &key)
        .ok_or_else(signed_out)?;
    let token = parts
        .headers
        .get(TOKEN_HEADER)
        .map(header::HeaderValue::as_bytes);
    // Compare digests: the time of the comparison then reveals nothing.
    let is_right = token.is_some_and(|token| {
        digest("compare", token) == digest("compare", token_of(&id).as_bytes())
    });
    if !is_right {
        return Err(refused(
            StatusCode::FORBIDDEN,
            "the header X-CSRF-Token with the token of this session is missing",
        ));
    }
    let begun = clock::now();
    let (body, flaw) = body_of(&parts.headers, body, bytes_max).await;
    let named = parts
        .headers
        .get(MOMENT_HEADER)
        .map(header::HeaderValue::as_bytes);
    let old = control.moments.review(named, begun, clock::now()).err();
    let user = control
        .sessions()
        .used(clock::now(), &key)
        .ok_or_else(signed_out)?;
    let rights = control
        .front
        .load()
        .rights(user)
        .cloned()
        .ok_or_else(signed_out)?;
    Ok(AdmittedRequest {
        user,
        rights,
        body,
        old,
        flaw,
        key,
    })
}

/// Whether any user can sign in.
///
/// # Errors
/// What is answered instead.
pub(super) fn is_possible(control: &HttpControl) -> Result<(), Refused> {
    if control.front.load().users().is_empty() {
        let what = "the page cannot send commands: no `users` are configured in [http]";
        return Err(refused(StatusCode::FORBIDDEN, what));
    }
    Ok(())
}

/// Whether the request was not sent by another page. Clients other than browsers do not send these headers.
///
/// # Errors
/// What is answered instead.
pub(super) fn comes_from_own_page(headers: &HeaderMap) -> Result<(), Refused> {
    let host = headers
        .get(header::HOST)
        .and_then(|host| host.to_str().ok())
        .unwrap_or_default();
    let is_own = |origin: &header::HeaderValue| {
        origin
            .to_str()
            .is_ok_and(|origin| is_own_page(origin, host))
    };
    if headers.get_all(header::ORIGIN).iter().all(is_own) {
        return Ok(());
    }
    let what = "this request was sent by another page; a proxy in front of the gateway must pass the header Host on as it is";
    Err(refused(StatusCode::FORBIDDEN, what))
}

/// The body of a request, which is JSON or empty.
///
/// # Errors
/// What is answered instead.
pub(super) async fn json_body(headers: &HeaderMap, body: Body) -> Result<Bytes, Refused> {
    let (body, flaw) = body_of(headers, body, BODY_BYTES_MAX).await;
    flaw.map_or(Ok(body), Err)
}

/// The first bytes of a body, and what is wrong with it.
async fn body_of(headers: &HeaderMap, body: Body, bytes_max: usize) -> (Bytes, Option<Refused>) {
    let mut bytes = BytesMut::new();
    let flaw = match timeout(BODY_WITHIN, collect(body, &mut bytes, bytes_max)).await {
        Ok(true) => None,
        Ok(false) => {
            let what = format!("the body is longer than {bytes_max} bytes, or broke off");
            Some(refused(StatusCode::PAYLOAD_TOO_LARGE, &what))
        }
        Err(_) => Some(refused(
            StatusCode::REQUEST_TIMEOUT,
            "the body did not arrive in time",
        )),
    };
    let kind = headers
        .get(header::CONTENT_TYPE)
        .and_then(|kind| kind.to_str().ok())
        .unwrap_or_default();
    let is_json = kind
        .split(';')
        .next()
        .is_some_and(|kind| kind.trim().eq_ignore_ascii_case("application/json"));
    let is_right = is_json || (bytes.is_empty() && kind.is_empty());
    let of_kind = || {
        refused(
            StatusCode::UNSUPPORTED_MEDIA_TYPE,
            "the content type must be application/json",
        )
    };
    (bytes.freeze(), flaw.or_else(|| (!is_right).then(of_kind)))
}

/// Reads `body` up to the longest allowed length. Returns false if that is not all of it.
async fn collect(body: Body, bytes: &mut BytesMut, bytes_max: usize) -> bool {
    let mut body = pin!(body);
    while let Some(frame) = poll_fn(|cx| body.as_mut().poll_frame(cx)).await {
        let Ok(frame) = frame else { return false };
        let Ok(piece) = frame.into_data() else {
            continue;
        };
        let room = bytes_max.saturating_sub(bytes.len());
        bytes.extend_from_slice(piece.get(..room).unwrap_or(&piece));
        if piece.len() > room {
            return false;
        }
    }
    true
}

/// Lets a client see the drives only after it has signed in, where that is configured. The page itself is shown to everybody: it
/// holds nothing of the plant, and one signs in there.
pub async fn view(
    State(control): State<Arc<HttpControl>>,
    request: Request,
    next: Next,
) -> Response {
    if control.front.load().is_private()
        && is_of_plant(&request)
        && !is_signed_in(&control, &request)
    {
        return refusal(
            StatusCode::UNAUTHORIZED,
            "sign in first: this gateway shows its drives to users only",
        );
    }
    next.run(request).await
}

/// Whether it asks for something of the drives.
fn is_of_plant(request: &Request) -> bool {
    let path = request.uri().path();
    path.starts_with("/api/v1/") && path != "/api/v1/session"
}

fn is_signed_in(control: &HttpControl, request: &Request) -> bool {
    signed_in(control, request.headers()).is_some()
}

/// What the user who sent `headers` may do; `None` if none is signed in.
pub(super) fn signed_in(control: &HttpControl, headers: &HeaderMap) -> Option<UserRights> {
    let user = control
        .sessions()
        .user(clock::now(), &key_of(&id_in(headers)?))?;
    control.front.load().rights(user).cloned()
}
