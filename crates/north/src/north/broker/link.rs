//! The part of a session that knows neither topics nor payloads.

use super::commands::BrokerCommands;
use super::issued::ClientClocks;
use super::oversized::OversizedTopics;
use super::path::BrokerPath;
use super::session::{SessionAct, SessionNotice};
use super::types::{BrokerEvent, BrokerLimits};
use crate::domain::ids::AskerId;
use crate::north::clock::{ClockMoment, LabelClock};
use std::time::Duration;

/// The link of a session to its broker, and to the lines. `C` is what the session needs to answer a command.
#[derive(Debug)]
pub(in crate::north) struct BrokerLink<C> {
    pub(in crate::north) clock: LabelClock,
    pub(in crate::north) issued: ClientClocks,
    pub(in crate::north) path: BrokerPath,
    pub(in crate::north) limits: BrokerLimits,
    /// What is larger than the broker takes.
    pub(in crate::north) oversized: OversizedTopics,
    pub(in crate::north) commands: BrokerCommands<C>,
    /// What the last event means for the log.
    notice: Option<SessionNotice>,
}

impl<C> BrokerLink<C> {
    /// A link without a connection, whose commands the lines answer to `asker`. `probe_key` is random; a probe is sent
    /// every `probe_interval`, and awaited for `probe_timeout`.
    pub(in crate::north) fn new(
        asker: AskerId,
        started: ClockMoment,
        probe_key: u128,
        probe_interval: Duration,
        probe_timeout: Duration,
    ) -> Self {
        Self {
            clock: LabelClock::new(started),
            issued: ClientClocks::default(),
            path: BrokerPath::new(probe_key, probe_interval, probe_timeout),
            limits: BrokerLimits::default(),
            oversized: OversizedTopics::default(),
            commands: BrokerCommands::new(asker),
            notice: None,
        }
    }

    /// Takes what happened on the connection, before the session does.
    pub(in crate::north) fn handle(&mut self, at: ClockMoment, event: &BrokerEvent<'_>) {
        self.clock.see(at);
        if let BrokerEvent::Stalled(stood) = event {
            return self.path.stalled(at.mono, *stood);
        }
        self.path.look(at.mono);
        match event {
            BrokerEvent::Connected(limits) => {
                self.lost(at);
                self.limits = *limits;
                self.oversized.forget();
                self.path.connected();
            }
            BrokerEvent::Lost => self.lost(at),
            _ => {}
        }
    }

    fn lost(&mut self, at: ClockMoment) {
        self.path.lost(at.mono);
        self.commands.path_lost();
    }

    /// The next item for the lines, and after them attempts to be kept.
    pub(in crate::north) fn next_inward(&mut self) -> Option<SessionAct> {
        if let Some(request) = self.commands.next_to_line() {
            return Some(SessionAct::ToLine(request));
        }
        let (drive, attempt) = self.commands.next_attempt()?;
        Some(SessionAct::Keep(drive, attempt))
    }

    /// Keeps `notice` for the log, one for each event.
    pub(in crate::north) fn notify(&mut self, notice: SessionNotice) {
        self.notice = Some(notice);
    }

    /// The next notice for the log.
    pub(in crate::north) fn next_notice(&mut self) -> Option<SessionNotice> {
        if let Some(notice) = self.notice.take() {
            return Some(notice);
        }
        let oversized = self.oversized.next_unreported()?;
        Some(SessionNotice::Oversized(oversized))
    }
}
