//! Endless answers on a listener: how many there may be, and closing one whose reader does not keep up.
//!
//! Every request carries a [`StreamSlot`] as an extension. A route with an endless answer takes a [`StreamPermit`] from it and
//! holds that as long as the answer continues.

use std::sync::Arc;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

/// Most endless answers at once on one listener. It leaves half of the connections for other clients.
pub const LASTING_MAX: usize = 32;

/// What a connection is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ConnectionUse {
    /// Short answers.
    Short,
    /// An endless answer.
    Lasting,
    /// To be closed at once.
    Cut,
}

/// One connection, as its routes see it.
#[derive(Clone, Debug)]
pub struct StreamSlot {
    places: Arc<Semaphore>,
    used: watch::Sender<ConnectionUse>,
}

/// One connection, as its listener sees it.
#[derive(Clone, Debug)]
pub(super) struct ConnectionLife(watch::Receiver<ConnectionUse>);

/// An endless answer. It ends when this is dropped.
#[derive(Debug)]
pub struct StreamPermit {
    used: watch::Sender<ConnectionUse>,
    _place: OwnedSemaphorePermit,
}

/// The places of a new listener.
pub(super) fn places() -> Arc<Semaphore> {
    Arc::new(Semaphore::new(LASTING_MAX))
}

impl StreamSlot {
    /// A connection that is used for short answers so far.
    pub(super) fn new(places: Arc<Semaphore>) -> (Self, ConnectionLife) {
        let (used, seen) = watch::channel(ConnectionUse::Short);
        (Self { places, used }, ConnectionLife(seen))
    }

    /// Whether an endless answer is in progress.
    pub(super) fn is_lasting(&self) -> bool {
        *self.used.borrow() == ConnectionUse::Lasting
    }

    /// Lets the connection last; `None` if too many do already.
    #[must_use]
    pub fn stay(&self) -> Option<StreamPermit> {
        let place = Arc::clone(&self.places).try_acquire_owned().ok()?;
        self.used.send_replace(ConnectionUse::Lasting);
        Some(StreamPermit {
            used: self.used.clone(),
            _place: place,
        })
    }
}

impl StreamPermit {
    /// Closes the connection at once, whatever is not sent yet.
    pub fn cut(&self) {
        self.used.send_replace(ConnectionUse::Cut);
    }
}

impl Drop for StreamPermit {
    fn drop(&mut self) {
        self.used.send_if_modified(|used| {
            let is_lasting = *used == ConnectionUse::Lasting;
            if is_lasting {
                *used = ConnectionUse::Short;
            }
            is_lasting
        });
    }
}

impl ConnectionLife {
    /// Waits until the connection is to be closed at once.
    pub(super) async fn until_cut(mut self) {
        self.wait_for(ConnectionUse::Cut, true).await;
    }

    /// Waits until no endless answer is in progress.
    pub(super) async fn has_no_stay(mut self) {
        self.wait_for(ConnectionUse::Lasting, false).await;
    }

    async fn wait_for(&mut self, used: ConnectionUse, is: bool) {
        if self.0.wait_for(|now| (*now == used) == is).await.is_err() {
            // The sender is gone, so it will never be.
            std::future::pending::<()>().await;
        }
    }
}
