//! Those who listen to changes. Each text is made once for all of them; who does not keep up is let go.

use crate::daemon::http::large::Pieces;
use crate::daemon::http::lasting::Stay;
use axum::body::HttpBody;
use bytes::Bytes;
use hyper::body::Frame;
use std::convert::Infallible;
use std::pin::Pin;
use std::sync::{Arc, Weak};
use std::task::{Context, Poll};
use tokio::sync::mpsc;
use tokio::sync::mpsc::error::TrySendError;

/// Texts that wait for one listener, beside what its connection holds: four seconds of changes. All listeners share them.
const WAITING_MAX: usize = 8;

/// All who listen.
#[derive(Debug, Default)]
pub struct Listeners(Vec<Ear>);

#[derive(Debug)]
struct Ear {
    texts: mpsc::Sender<Bytes>,
    /// Its place is free as soon as it has left.
    stay: Weak<Stay>,
}

/// One who listens: the body of an answer.
#[derive(Debug)]
pub struct Listener {
    first: Pieces,
    texts: mpsc::Receiver<Bytes>,
    _stay: Arc<Stay>,
}

impl Listeners {
    /// One more, who hears `first` before all else. Its bound is that of `stay`.
    pub fn add(&mut self, first: Pieces, stay: Stay) -> Listener {
        let (sender, texts) = mpsc::channel(WAITING_MAX);
        let stay = Arc::new(stay);
        self.forget_gone();
        self.0.push(Ear { texts: sender, stay: Arc::downgrade(&stay) });
        Listener { first, texts, _stay: stay }
    }

    /// Forgets those who have left.
    pub fn forget_gone(&mut self) {
        self.0.retain(|ear| !ear.texts.is_closed());
    }

    /// Whether nobody listens.
    pub const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// How many listen, as far as that is known.
    #[cfg(test)]
    pub const fn count(&self) -> usize {
        self.0.len()
    }

    /// Tells all of them. Who has not taken what was told before loses the connection, and finds the whole state when it
    /// comes back.
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

impl HttpBody for Listener {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        if let Some(first) = self.first.next() {
            return Poll::Ready(Some(Ok(Frame::data(first))));
        }
        self.texts.poll_recv(context).map(|text| text.map(|text| Ok(Frame::data(text))))
    }
}
