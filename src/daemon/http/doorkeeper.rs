//! Checks of every request over TCP: it comes from an allowed network, not from a page of another site, and uses one of
//! the gateway's names. Its answer tells browsers what they may do with it.

use super::answers::refusal;
use super::entrance::PeerAddress;
use super::front::ClientRequirements;
use crate::north::operator::request::{is_of_another_site, may_be_called};
use arc_swap::ArcSwap;
use axum::extract::{Request, State};
use axum::http::header::{self, HeaderName};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::middleware::Next;
use axum::response::Response;
use std::sync::Arc;

/// The page loads nothing from other hosts, is not framed by them, and reveals nothing to them.
const HEADERS: [(HeaderName, HeaderValue); 3] = [
    (
        header::CONTENT_SECURITY_POLICY,
        HeaderValue::from_static(
            "default-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; object-src 'none'; \
             base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
        ),
    ),
    (
        header::X_CONTENT_TYPE_OPTIONS,
        HeaderValue::from_static("nosniff"),
    ),
    (
        header::REFERRER_POLICY,
        HeaderValue::from_static("no-referrer"),
    ),
];

/// Passes a request on to its route, or refuses it.
pub(super) async fn admit_request(
    State(front): State<Arc<ArcSwap<ClientRequirements>>>,
    request: Request,
    next: Next,
) -> Response {
    let is_api = request.uri().path().starts_with("/api/");
    let mut answer = match refused(&front.load(), &request) {
        Some(refused) => refused,
        None => next.run(request).await,
    };
    answer.headers_mut().extend(HEADERS);
    if is_api {
        answer
            .headers_mut()
            .insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    }
    answer
}

fn refused(front: &ClientRequirements, request: &Request) -> Option<Response> {
    // A connection may be older than the list.
    let is_foreign = request
        .extensions()
        .get::<PeerAddress>()
        .is_some_and(|PeerAddress(peer)| !front.allows(*peer));
    if is_foreign {
        return Some(refusal(
            StatusCode::FORBIDDEN,
            "your address is not in `allow` of [http]",
        ));
    }
    let said = |name| {
        request
            .headers()
            .get(name)
            .and_then(|value: &HeaderValue| value.to_str().ok())
            .unwrap_or_default()
    };
    if is_of_another_site(said("sec-fetch-site"), said("sec-fetch-mode")) {
        return Some(refusal(
            StatusCode::FORBIDDEN,
            "the request was sent by a page of another site",
        ));
    }
    if is_called_right(front, request.headers()) {
        return None;
    }
    let what = "the host name is not one of the gateway's: use its address, or add the name to `hosts` in [http]";
    Some(refusal(StatusCode::MISDIRECTED_REQUEST, what))
}

/// Browsers always send the host name; a client that does not is not a browser.
fn is_called_right(front: &ClientRequirements, headers: &HeaderMap) -> bool {
    let mut called = headers.get_all(header::HOST).iter();
    match (called.next(), called.next()) {
        (None, _) => true,
        (Some(host), None) => host
            .to_str()
            .is_ok_and(|host| may_be_called(host, front.hosts())),
        (Some(_), Some(_)) => false,
    }
}
