//! Listeners to changes. Each text is made once for all of them; one that does not keep up is disconnected.

use crate::daemon::http::large::AnswerPieces;
use crate::daemon::http::lasting::StreamPermit;
use axum::body::HttpBody;
use bytes::Bytes;
use hyper::body::Frame;
use std::convert::Infallible;
use std::pin::Pin;
use std::sync::{Arc, Weak};
use std::task::{Context, Poll};
use tokio::sync::mpsc;
use tokio::sync::mpsc::error::TrySendError;

/// Texts that wait for one listener, beside what its connection buffers: four seconds of changes. All listeners share
/// them.
const WAITING_MAX: usize = 8;

/// All listeners.
#[derive(Debug, Default)]
pub struct LiveListeners(Vec<ListenerEar>);

#[derive(Debug)]
struct ListenerEar {
    texts: mpsc::Sender<Bytes>,
    /// Its place is free as soon as it has left.
    stay: Weak<StreamPermit>,
}

/// A listener: the body of an answer.
#[derive(Debug)]
pub struct LiveListener {
    first: AnswerPieces,
    texts: mpsc::Receiver<Bytes>,
    _stay: Arc<StreamPermit>,
}

impl LiveListeners {
    /// Adds a listener that receives `first` before all else. `stay` bounds their number.
    pub fn add(&mut self, first: AnswerPieces, stay: StreamPermit) -> LiveListener {
        let (sender, texts) = mpsc::channel(WAITING_MAX);
        let stay = Arc::new(stay);
        self.forget_gone();
        self.0.push(ListenerEar {
            texts: sender,
            stay: Arc::downgrade(&stay),
        });
        LiveListener {
            first,
            texts,
            _stay: stay,
        }
    }

    /// Forgets listeners that have left.
    pub fn forget_gone(&mut self) {
        self.0.retain(|ear| !ear.texts.is_closed());
    }

    /// Whether there is no listener.
    pub const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The number of listeners, including those whose leaving was not noticed yet.
    #[cfg(test)]
    pub const fn count(&self) -> usize {
        self.0.len()
    }

    /// Sends `text` to all of them. One that has not read what was sent before is disconnected, and gets the whole
    /// state when it reconnects.
    pub fn tell(&mut self, text: String) {
        let text = Bytes::from(text);
        self.0.retain(|ear| match ear.texts.try_send(text.clone()) {
            Ok(()) => true,
            Err(TrySendError::Closed(_)) => false,
            Err(TrySendError::Full(_)) => {
                tracing::info!("event stream client is too slow; disconnected");
                ear.stay.upgrade().iter().for_each(|stay| stay.cut());
                false
            }
        });
    }
}

impl HttpBody for LiveListener {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        if let Some(first) = self.first.next() {
            return Poll::Ready(Some(Ok(Frame::data(first))));
        }
        self.texts
            .poll_recv(context)
            .map(|text| text.map(|text| Ok(Frame::data(text))))
    }
}
