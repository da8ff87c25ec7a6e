//! What this gateway knows of a line that it shares with others.

use super::setup::LineSetup;
use crate::domain::time::MonoTime;
use crate::line::overheard::Listener;
use crate::line::standby::Standby;

/// The share of this gateway in a line.
#[derive(Debug)]
pub(super) struct Share {
    pub rule: Standby,
    pub listener: Listener,
    /// Unanswered requests of others in a row, per drive.
    pub unanswered: Vec<u8>,
    /// Another gateway was heard since this one was started: what it remembers of the orders then is out of date.
    pub has_heard_other: bool,
    /// A drive has answered since the line was taken over.
    pub is_confirmed: bool,
    /// Until when the line is to be handed over, as soon as nothing is under way.
    pub yields_until: Option<MonoTime>,
    /// The frame that hands it over is on its way to the port.
    pub hands_over: bool,
    pub take_overs: u64,
    pub given_up: u64,
    pub rivals: u64,
}

impl Share {
    /// The share in the line of `setup`; `None` if no other gateway shares it.
    pub fn of(setup: &LineSetup) -> Option<Self> {
        Some(Self {
            rule: Standby::new(setup.standby?, setup.first_epoch),
            listener: Listener::default(),
            unanswered: vec![0; setup.drives.len()],
            has_heard_other: false,
            is_confirmed: false,
            yields_until: None,
            hands_over: false,
            take_overs: 0,
            given_up: 0,
            rivals: 0,
        })
    }

    /// A listener heard another gateway, or its drives answer it, at `at`.
    pub fn another_sends(&mut self, at: MonoTime) {
        self.has_heard_other = true;
        self.rule.heard(at);
    }
}
