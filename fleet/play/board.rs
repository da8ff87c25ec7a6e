//! State that all threads of a simulation share: the plan, its progress, and the books.

use super::Plan;
use crate::books::{Delays, Ledger};
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use vfd_gateway::daemon::host::clock;
use vfd_gateway::domain::time::MonoTime;

/// The phase of a simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Consumers and gateways connect.
    Connecting,
    /// The gateways publish; the first update is due at this moment.
    Publishing(MonoTime),
    /// No new updates are sent; unacknowledged ones still are.
    Draining,
    /// Retained messages are cleared.
    Clearing,
    /// All clients disconnect.
    Ending,
}

/// A count that many threads add to.
#[derive(Debug, Default)]
pub struct Count(AtomicU64);

impl Count {
    /// Increments it.
    pub fn add(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    /// Its value.
    pub fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// State that all threads share.
#[derive(Debug)]
pub struct Board {
    pub plan: Plan,
    pub ledger: Ledger,
    /// From when updates were due until they were received for the first time.
    pub delays: Delays,
    /// From when updates were due until they were acknowledged.
    pub acknowledgements: Delays,
    /// Gateways that were connected at least once.
    pub gateways: Count,
    /// Consumers whose subscription was granted at least once.
    pub consumers: Count,
    /// Connections that the broker accepted.
    pub connections: Count,
    /// Of these: those that broke.
    pub broken: Count,
    /// Updates that the broker refused.
    pub refused: Count,
    /// Updates that were sent again after a reconnect.
    pub repeated: Count,
    /// Messages received, including copies.
    pub received: Count,
    /// Updates received again.
    pub again: Count,
    /// Updates received after a newer one of their drive.
    pub late: Count,
    /// Messages that are not updates of this simulation.
    pub foreign: Count,
    /// When the simulation was begun.
    pub begun: MonoTime,
    phase: AtomicU8,
    start_ns: AtomicU64,
    reason: Mutex<String>,
    failure: Mutex<Option<String>>,
}

impl Board {
    /// A board for `plan`; `None` if its books would be too large.
    pub fn new(plan: Plan) -> Option<Self> {
        let ledger = Ledger::new(plan.shape.drives_of_all(), plan.shape.updates)?;
        Some(Self {
            plan,
            ledger,
            delays: Delays::default(),
            acknowledgements: Delays::default(),
            gateways: Count::default(),
            consumers: Count::default(),
            connections: Count::default(),
            broken: Count::default(),
            refused: Count::default(),
            repeated: Count::default(),
            received: Count::default(),
            again: Count::default(),
            late: Count::default(),
            foreign: Count::default(),
            begun: clock::now(),
            phase: AtomicU8::new(0),
            start_ns: AtomicU64::new(0),
            reason: Mutex::default(),
            failure: Mutex::default(),
        })
    }

    /// The present phase.
    pub fn phase(&self) -> Phase {
        match self.phase.load(Ordering::Acquire) {
            0 => Phase::Connecting,
            1 => Phase::Publishing(MonoTime::from_nanos(self.start_ns.load(Ordering::Acquire))),
            2 => Phase::Draining,
            3 => Phase::Clearing,
            _ => Phase::Ending,
        }
    }

    /// Enters `phase`.
    pub fn enter(&self, phase: Phase) {
        let number = match phase {
            Phase::Connecting => 0,
            Phase::Publishing(start) => {
                self.start_ns.store(start.as_nanos(), Ordering::Release);
                1
            }
            Phase::Draining => 2,
            Phase::Clearing => 3,
            Phase::Ending => 4,
        };
        self.phase.store(number, Ordering::Release);
    }

    /// Notes why a client is not connected.
    pub fn note(&self, reason: &str) {
        if !reason.is_empty() {
            reason.clone_into(&mut self.reason.lock().unwrap_or_else(PoisonError::into_inner));
        }
    }

    /// Why the last client was not connected; `None` if all were.
    pub fn reason(&self) -> Option<String> {
        let reason = self
            .reason
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone();
        (!reason.is_empty()).then_some(reason)
    }

    /// Fails the simulation for this reason.
    pub fn fail(&self, reason: String) {
        self.failure
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .get_or_insert(reason);
    }

    /// Why it failed.
    pub fn failure(&self) -> Option<String> {
        self.failure
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }
}
