//! Control from the page: sign-in and orders. Orders take the path of the program's own tools, and the guard reviews
//! them like all others.

mod admission;
mod commands;
mod commissioning;
mod routes;
mod sign_in;
#[cfg(test)]
mod tests;

pub(super) use admission::view;
pub(super) use routes::router;

use super::front::ClientRequirements;
use crate::daemon::commissioning::{Commissioning, ConfigSite};
use crate::daemon::local::LocalSide;
use crate::domain::ids::CommanderName;
use crate::north::operator::attempts::SignInAttempts;
use crate::north::operator::moments::SealedMoments;
use crate::north::operator::sessions::UserSessions;
use arc_swap::ArcSwap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::{Notify, Semaphore};

/// Most passwords that are compared at once: each takes 19 MiB or more, and a core for a while.
const VERIFICATIONS_MAX: usize = 1;
/// Most sign-ins at once, including those that wait for a comparison.
const SIGN_INS_MAX: usize = 8;

/// The signed-in users, and the path of their orders.
#[derive(Debug)]
pub struct HttpControl {
    side: Arc<LocalSide>,
    /// The moments that orders name.
    moments: SealedMoments,
    /// `None` without a configuration file.
    commissioning: Option<Arc<Commissioning>>,
    front: Arc<ArcSwap<ClientRequirements>>,
    changed: Arc<Notify>,
    sessions: Mutex<UserSessions>,
    attempts: Mutex<SignInAttempts>,
    verifications: Arc<Semaphore>,
    sign_ins: Semaphore,
}

impl HttpControl {
    /// Starts with no user signed in. Orders are sent through `side` and name one of `moments`; users are those of
    /// `front`, and those with the right to may change the configuration at `site`.
    #[must_use]
    pub fn new(
        side: Arc<LocalSide>,
        moments: SealedMoments,
        front: ClientRequirements,
        site: Option<ConfigSite>,
    ) -> Self {
        Self {
            commissioning: site.map(|site| Arc::new(Commissioning::new(site, Arc::clone(&side)))),
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

    /// Applies `front` from now on. Users who are no longer in it, or have another password, are signed out; the others
    /// notice nothing.
    pub fn change(&self, front: ClientRequirements) {
        let before = self.front.swap(Arc::new(front));
        let front = self.front.load();
        self.sessions()
            .keep(|user: CommanderName| front.knows_as(&before, user));
        // Stored until the listener waits for it, so that none is missed.
        self.changed.notify_one();
    }

    /// What the listener requires of clients.
    pub(super) const fn front(&self) -> &Arc<ArcSwap<ClientRequirements>> {
        &self.front
    }

    /// Notified when that has changed.
    pub(super) const fn changed(&self) -> &Arc<Notify> {
        &self.changed
    }

    fn sessions(&self) -> MutexGuard<'_, UserSessions> {
        self.sessions.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn attempts(&self) -> MutexGuard<'_, SignInAttempts> {
        self.attempts.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
