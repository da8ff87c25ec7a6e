//! What all threads of a simulation share: the plan, how far it is, and the books.

use super::Plan;
use crate::books::{Delays, Ledger};
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use vfd_gateway::daemon::host::clock;
use vfd_gateway::domain::time::MonoTime;

/// How far a simulation is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Everybody connects.
    Connecting,
    /// The gateways publish; the first update is due at this moment.
    Publishing(MonoTime),
    /// Nothing new is sent; what is not acknowledged still is.
    Draining,
    /// Retained messages are taken back.
    Clearing,
    /// Everybody leaves.
    Ending,
}

/// A count that many threads add to.
#[derive(Debug, Default)]
pub struct Count(AtomicU64);

impl Count {
    /// One more.
    pub fn add(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    /// How many there are.
    pub fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// What all threads share.
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
    /// Those of them that broke.
    pub broken: Count,
    /// Updates that the broker refused.
    pub refused: Count,
    /// Updates that were sent once more behind a reconnect.
    pub repeated: Count,
    /// Messages that came, all copies.
    pub received: Count,
    /// Updates that came again.
    pub again: Count,
    /// Updates that came behind a newer one of their drive.
    pub late: Count,
    /// Messages that are no update of this simulation.
    pub foreign: Count,
    /// When the simulation was begun.
    pub begun: MonoTime,
    phase: AtomicU8,
    start_ns: AtomicU64,
    reason: Mutex<String>,
    failure: Mutex<Option<String>>,
}

impl Board {
    /// A board for `plan`; nothing if its books would be too large.
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

    /// How far it is.
    pub fn phase(&self) -> Phase {
        match self.phase.load(Ordering::Acquire) {
            0 => Phase::Connecting,
            1 => Phase::Publishing(MonoTime::from_nanos(self.start_ns.load(Ordering::Acquire))),
            2 => Phase::Draining,
            3 => Phase::Clearing,
            _ => Phase::Ending,
        }
    }

    /// Goes on.
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

    /// Why somebody is not connected.
    pub fn note(&self, reason: &str) {
        if !reason.is_empty() {
            reason.clone_into(&mut self.reason.lock().unwrap_or_else(PoisonError::into_inner));
        }
    }

    /// Why somebody was not connected last; nothing: everybody was.
    pub fn reason(&self) -> Option<String> {
        let reason = self.reason.lock().unwrap_or_else(PoisonError::into_inner).clone();
        (!reason.is_empty()).then_some(reason)
    }

    /// The simulation makes no sense for this reason.
    pub fn fail(&self, reason: String) {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(reason);
    }

    /// Why it makes no sense.
    pub fn failure(&self) -> Option<String> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
