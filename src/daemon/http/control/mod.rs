//! Control from the page: who signs in, and what they order. It goes the way of the program's own tools, and the guard
//! reviews it as it does everybody's orders.

mod admission;
mod commands;
mod routes;
mod sign_in;
#[cfg(test)]
mod tests;

pub(super) use routes::router;

use super::front::Front;
use crate::daemon::local::LocalSide;
use crate::domain::ids::CommanderName;
use crate::north::operator::attempts::Attempts;
use crate::north::operator::moments::Moments;
use crate::north::operator::sessions::Sessions;
use arc_swap::ArcSwap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, Semaphore};

/// Most passwords that are compared at once: each takes 19 MiB and more, and a core for a while.
const VERIFICATIONS_MAX: usize = 1;
/// Most sign-ins at once, with those that wait for that.
const SIGN_INS_MAX: usize = 8;

/// Who is signed in, and the way of their orders.
#[derive(Debug)]
pub struct Control {
    side: Arc<LocalSide>,
    /// What orders name.
    moments: Moments,
    front: Arc<ArcSwap<Front>>,
    changed: Arc<Notify>,
    sessions: Mutex<Sessions>,
    attempts: Mutex<Attempts>,
    verifications: Arc<Semaphore>,
    sign_ins: Semaphore,
}

impl Control {
    /// Nobody is signed in. Orders go through `side` and name one of `moments`, and users are those of `front`.
    #[must_use]
    pub fn new(side: Arc<LocalSide>, moments: Moments, front: Front) -> Self {
        Self {
            side,
            moments,
            front: Arc::new(ArcSwap::from_pointee(front)),
            changed: Arc::default(),
            sessions: Mutex::default(),
            attempts: Mutex::default(),
            verifications: Arc::new(Semaphore::new(VERIFICATIONS_MAX)),
            sign_ins: Semaphore::new(SIGN_INS_MAX),
        }
    }

    /// Asks of whoever comes what `front` says from now on. Whoever is not in it any more, or has another password there, is
    /// signed out; the others notice nothing.
    pub fn change(&self, front: Front) {
        let before = self.front.swap(Arc::new(front));
        let front = self.front.load();
        self.sessions().keep(|user: CommanderName| front.knows_as(&before, user));
        // Kept until the listener has a moment, so that none is missed.
        self.changed.notify_one();
    }

    /// What the listener asks of whoever comes.
    pub(super) const fn front(&self) -> &Arc<ArcSwap<Front>> {
        &self.front
    }

    /// Rings when that is something else.
    pub(super) const fn changed(&self) -> &Arc<Notify> {
        &self.changed
    }

    fn sessions(&self) -> MutexGuard<'_, Sessions> {
        self.sessions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn attempts(&self) -> MutexGuard<'_, Attempts> {
        self.attempts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
