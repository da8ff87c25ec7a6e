//! The state of one client across its connections.

use super::client_queue::ClientQueue;
use super::machine::ConnectionId;
use super::packet::{SessionExpiry, WillMessage};
use crate::domain::time::MonoTime;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

/// The number of a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SessionId(pub u64);

/// The state of one client.
#[derive(Debug)]
pub struct ClientSession {
    /// Its identifier.
    pub client: Arc<str>,
    /// Its connection, if it has one.
    pub connection: Option<ConnectionId>,
    /// How long the session lasts without a connection.
    pub expiry: SessionExpiry,
    /// When the last connection ended.
    pub gone_at: MonoTime,
    /// The will of the connection, or of one that has broken while the delay is not over.
    pub will: Option<WillMessage>,
    pub filters: BTreeSet<String>,
    pub queue: ClientQueue,
    /// Messages at quality of service 2 that the client has not released.
    pub incoming: BTreeSet<u16>,
}

impl ClientSession {
    pub fn new(client: Arc<str>, now: MonoTime) -> Self {
        Self {
            client,
            connection: None,
            expiry: SessionExpiry::AT_ONCE,
            gone_at: now,
            will: None,
            filters: BTreeSet::new(),
            queue: ClientQueue::default(),
            incoming: BTreeSet::new(),
        }
    }

    /// Whether it has expired at `now`.
    pub fn is_over(&self, now: MonoTime) -> bool {
        match self.expiry {
            SessionExpiry::After(span) => {
                self.connection.is_none() && now.since(self.gone_at) >= span
            }
            SessionExpiry::Never => false,
        }
    }

    /// Takes the will if it is to be published at `now`.
    pub fn take_due_will(&mut self, now: MonoTime) -> Option<WillMessage> {
        let away = now.since(self.gone_at);
        let is_due = |will: &mut WillMessage| self.connection.is_none() && away >= will.delay;
        self.will.take_if(is_due)
    }

    /// Takes the will if it is due when another connection takes over: a will with a delay is not published then.
    pub fn take_will_at_once(&mut self) -> Option<WillMessage> {
        self.will
            .take()
            .filter(|will| self.connection.is_some() && will.delay == Duration::ZERO)
    }
}
