//! Large answers: all that wait for their clients share one bound, and each is sent in pieces.
//!
//! A document of a plant with hundreds of drives has some hundred kilobytes, and every connection may request one and
//! not read it.

use super::answers::refusal;
use super::taking::PIECE_BYTES;
use axum::body::{Body, Bytes, HttpBody, to_bytes};
use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::middleware::Next;
use axum::response::Response;
use hyper::body::{Frame, SizeHint};
use std::convert::Infallible;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Most KiB of large answers of one listener that may wait at once. A longer answer waits alone.
const KIB_MAX: u32 = 8 * 1024;

/// The room for large answers of one listener.
#[derive(Clone, Debug)]
pub struct AnswerRoom(Arc<Semaphore>);

impl Default for AnswerRoom {
    fn default() -> Self {
        Self(Arc::new(Semaphore::new(KIB_MAX as usize)))
    }
}

/// An answer that is sent in pieces. Its room is free again when the last one is taken.
#[derive(Debug)]
pub struct AnswerPieces {
    rest: Bytes,
    room: Option<OwnedSemaphorePermit>,
}

impl AnswerRoom {
    /// `bytes` in pieces; `None` if there is no room for as many.
    pub fn pieces(&self, bytes: Bytes) -> Option<AnswerPieces> {
        if bytes.len() <= PIECE_BYTES {
            return Some(AnswerPieces {
                rest: bytes,
                room: None,
            });
        }
        let kib = u32::try_from(bytes.len().div_ceil(1024))
            .unwrap_or(u32::MAX)
            .min(KIB_MAX);
        let room = Arc::clone(&self.0).try_acquire_many_owned(kib).ok()?;
        Some(AnswerPieces {
            rest: bytes,
            room: Some(room),
        })
    }
}

impl AnswerPieces {
    /// The next one.
    pub fn next(&mut self) -> Option<Bytes> {
        if self.rest.is_empty() {
            self.room = None;
            return None;
        }
        Some(self.rest.split_to(self.rest.len().min(PIECE_BYTES)))
    }
}

impl HttpBody for AnswerPieces {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        _: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        Poll::Ready(self.next().map(|piece| Ok(Frame::data(piece))))
    }

    fn is_end_stream(&self) -> bool {
        self.rest.is_empty()
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.rest.len() as u64)
    }
}

/// Sends a large answer in pieces, or refuses it. Files of the program itself take no memory and pass.
pub(super) async fn limit_answer(
    State(room): State<AnswerRoom>,
    request: Request,
    next: Next,
) -> Response {
    let path = request.uri().path();
    let is_made = path.starts_with("/api/") || path == "/metrics";
    let answer = next.run(request).await;
    let is_large = answer
        .body()
        .size_hint()
        .exact()
        .is_some_and(|bytes| bytes > PIECE_BYTES as u64);
    if !(is_made && is_large) {
        return answer;
    }
    let (head, body) = answer.into_parts();
    // It is complete already: its length is known.
    let pieces = to_bytes(body, usize::MAX)
        .await
        .ok()
        .and_then(|bytes| room.pieces(bytes));
    match pieces {
        Some(pieces) => Response::from_parts(head, Body::new(pieces)),
        None => {
            tracing::info!("too many large responses are unread; refused another one");
            refusal(
                StatusCode::SERVICE_UNAVAILABLE,
                "other clients are reading large responses; retry in a few seconds",
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_answers_share_their_room_and_give_it_back() {
        let room = AnswerRoom::default();
        let mut large: Vec<_> = (0..8)
            .map(|_| room.pieces(vec![1; 1024 * 1024].into()).unwrap())
            .collect();
        assert!(room.pieces(vec![1; PIECE_BYTES + 1].into()).is_none());
        assert!(
            room.pieces(vec![1; PIECE_BYTES].into()).is_some(),
            "small ones are bounded by their connections"
        );
        large.pop();
        assert!(room.pieces(vec![1; PIECE_BYTES + 1].into()).is_some());
        large.clear();
        let mut all = room.pieces(vec![1; 20 * 1024 * 1024].into()).unwrap();
        assert!(
            room.pieces(vec![1; PIECE_BYTES + 1].into()).is_none(),
            "it waits alone"
        );
        let mut taken = 0;
        while let Some(piece) = all.next() {
            assert!(piece.len() <= PIECE_BYTES);
            taken += piece.len();
        }
        assert_eq!(taken, 20 * 1024 * 1024);
    }
}
