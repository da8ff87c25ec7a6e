//! Endless answers on a listener: how many there may be, and closing one whose reader does not keep up.
//!
//! Every request carries a [`Lasting`] as an extension. A route with an endless answer takes a [`Stay`] from it and
//! holds that as long as the answer continues.

use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

/// Most endless answers at once on one listener. It leaves half of the connections for other clients.
pub const LASTING_MAX: usize = 32;

/// What a connection is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Use {
    /// Short answers.
    Short,
    /// An endless answer.
    Lasting,
    /// To be closed at once.
    Cut,
}

/// One connection, as its routes see it.
#[derive(Clone, Debug)]
pub struct Lasting {
    places: Arc<Semaphore>,
    used: watch::Sender<Use>,
}

/// One connection, as its listener sees it.
#[derive(Clone, Debug)]
pub(super) struct Life(watch::Receiver<Use>);

/// An endless answer. It ends when this is dropped.
#[derive(Debug)]
pub struct Stay {
    used: watch::Sender<Use>,
    _place: OwnedSemaphorePermit,
}

/// The places of a new listener.
pub(super) fn places() -> Arc<Semaphore> {
    Arc::new(Semaphore::new(LASTING_MAX))
}

impl Lasting {
    /// A connection that is used for short answers so far.
    pub(super) fn new(places: Arc<Semaphore>) -> (Self, Life) {
        let (used, seen) = watch::channel(Use::Short);
        (Self { places, used }, Life(seen))
    }

    /// Whether an endless answer is in progress.
    pub(super) fn is_lasting(&self) -> bool {
        *self.used.borrow() == Use::Lasting
    }

    /// Lets the connection last; `None` if too many do already.
    #[must_use]
    pub fn stay(&self) -> Option<Stay> {
        let place = Arc::clone(&self.places).try_acquire_owned().ok()?;
        self.used.send_replace(Use::Lasting);
        Some(Stay {
            used: self.used.clone(),
            _place: place,
        })
    }
}

impl Stay {
    /// Closes the connection at once, whatever is not sent yet.
    pub fn cut(&self) {
        self.used.send_replace(Use::Cut);
    }
}

impl Drop for Stay {
    fn drop(&mut self) {
        self.used.send_if_modified(|used| {
            let is_lasting = *used == Use::Lasting;
            if is_lasting {
                *used = Use::Short;
            }
            is_lasting
        });
    }
}

impl Life {
    /// Waits until the connection is to be closed at once.
    pub(super) async fn until_cut(mut self) {
        self.wait_for(Use::Cut, true).await;
    }

    /// Waits until no endless answer is in progress.
    pub(super) async fn has_no_stay(mut self) {
        self.wait_for(Use::Lasting, false).await;
    }

    async fn wait_for(&mut self, used: Use, is: bool) {
        if self.0.wait_for(|now| (*now == used) == is).await.is_err() {
            // The sender is gone, so it will never be.
            std::future::pending::<()>().await;
        }
    }
}
