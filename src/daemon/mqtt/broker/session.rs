//! What the broker keeps for one client, over its connections.

use super::machine::ConnectionId;
use super::outbox::Outbox;
use super::packet::{Expiry, Will};
use crate::domain::time::MonoTime;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

/// The number of a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SessionId(pub u64);

/// What is kept for one client.
#[derive(Debug)]
pub struct Session {
    /// Its identifier.
    pub client: Arc<str>,
    /// Where it is now.
    pub connection: Option<ConnectionId>,
    /// How long it lasts without one.
    pub expiry: Expiry,
    /// When the last one ended.
    pub gone_at: MonoTime,
    /// What is published if the connection breaks, or has broken and the delay is not over.
    pub will: Option<Will>,
    pub filters: BTreeSet<String>,
    pub outbox: Outbox,
    /// Messages at quality of service 2 that the client has not released.
    pub incoming: BTreeSet<u16>,
}

impl Session {
    pub fn new(client: Arc<str>, now: MonoTime) -> Self {
        Self {
            client,
            connection: None,
            expiry: Expiry::AT_ONCE,
            gone_at: now,
            will: None,
            filters: BTreeSet::new(),
            outbox: Outbox::default(),
            incoming: BTreeSet::new(),
        }
    }

    /// Whether it is over at `now`.
    pub fn is_over(&self, now: MonoTime) -> bool {
        match self.expiry {
            Expiry::After(span) => self.connection.is_none() && now.since(self.gone_at) >= span,
            Expiry::Never => false,
        }
    }

    /// The will, if it is to be published at `now`.
    pub fn take_due_will(&mut self, now: MonoTime) -> Option<Will> {
        let away = now.since(self.gone_at);
        let is_due = |will: &mut Will| self.connection.is_none() && away >= will.delay;
        self.will.take_if(is_due)
    }

    /// Another connection takes it over: a will that waits for longer than that is not published.
    pub fn take_will_at_once(&mut self) -> Option<Will> {
        self.will.take().filter(|will| self.connection.is_some() && will.delay == Duration::ZERO)
    }
}
