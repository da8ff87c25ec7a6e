//! The Sparkplug session with everything it reads: views, lines, answers.

use super::BdSeq;
use crate::daemon::exchange::answers::{AnswerBox, LineNews};
use crate::daemon::exchange::north_journal::Journal;
use crate::daemon::exchange::shared::{CurrentPlant, SharedLine, SharedPlant};
use crate::daemon::exchange::to_lines::hand_over;
use crate::daemon::exchange::totals::SparkplugTotals;
use crate::daemon::host::random;
use crate::daemon::mqtt::{BrokerConversation, Chore, ClientPacket, ClientRival};
use crate::domain::command::Owner;
use crate::domain::ids::{Name, Ticket};
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::view::DriveView;
use crate::north::broker::{BrokerEvent, OversizedPublication, Publication, SessionLine, ToLine};
use crate::north::clock::ClockMoment;
use crate::north::sparkplug::{Settings, SparkplugAct, SparkplugSession};
use std::sync::Arc;

/// What the speaker is connected to.
#[derive(Debug)]
pub struct SessionSides {
    /// The drives and lines.
    pub current: CurrentPlant,
    /// The answers of the lines.
    pub news: Arc<AnswerBox>,
    /// Where the counts are published.
    pub totals: Arc<SparkplugTotals>,
    /// Where attempts that reach no line are kept.
    pub journal: Journal,
}

/// The gateway's side of the conversation, as an edge node.
#[derive(Debug)]
pub struct NodeBrokerSession {
    session: SparkplugSession,
    bdseq: BdSeq,
    sides: SessionSides,
    /// The drives and lines of the session.
    shared: Arc<SharedPlant>,
    /// The views as of the last look, in the order of [`SharedPlant::drives`].
    views: Vec<Arc<DriveView>>,
    lines: Vec<SessionLine>,
    batch: Vec<LineNews>,
}

impl NodeBrokerSession {
    /// Serves the drives and lines of `sides`; connections are numbered by `bdseq`. Tickets start at `first_ticket`, so
    /// that no answer to an earlier session is taken for one to this session.
    #[must_use]
    pub fn new(
        settings: Settings,
        bdseq: BdSeq,
        sides: SessionSides,
        first_ticket: Ticket,
        at: ClockMoment,
    ) -> Self {
        let shared = sides.current.get();
        let mut session = SparkplugSession::new(
            settings,
            drives_of(&shared),
            &lines_of(&shared),
            at,
            random::secret(),
        );
        session.count_tickets_from(first_ticket);
        let views = Vec::new();
        let lines = Vec::new();
        let batch = Vec::new();
        let mut speaker = Self {
            session,
            bdseq,
            sides,
            shared,
            views,
            lines,
            batch,
        };
        // The first birth may be sent before anything changes.
        speaker.look_at_views();
        speaker
    }

    fn take_news(&mut self) {
        self.sides.news.take(&mut self.batch);
        for news in self.batch.drain(..) {
            if let LineNews::Command(answer) = news {
                self.session.command_answer(&answer);
            }
        }
    }

    /// Follows a change of the configuration.
    fn follow(&mut self) {
        if Arc::ptr_eq(&self.sides.current.load(), &self.shared) {
            return;
        }
        self.take_news();
        self.shared = self.sides.current.get();
        self.session
            .replace(drives_of(&self.shared), &lines_of(&self.shared));
        self.look_at_views();
    }

    fn refresh(&mut self) {
        self.take_news();
        self.follow();
        self.look_at_views();
    }

    fn look_at_views(&mut self) {
        self.views.clear();
        self.views.extend(
            self.shared
                .drives
                .iter()
                .map(|drive| drive.view.load_full()),
        );
        self.lines.clear();
        let line = |line: &Arc<SharedLine>| SessionLine {
            name: line.name.clone(),
            report: line.report(),
            // Nothing of them is published.
            stations: Vec::new(),
        };
        self.lines.extend(self.shared.lines.iter().map(line));
    }

    /// Passes on everything for the lines and the journal. It never waits for the broker.
    fn pass_inward(&mut self) {
        let mut requests = Vec::new();
        while let Some(act) = self.session.next_inward() {
            match act {
                SparkplugAct::ToLine(request) => requests.push(request),
                act => self.execute(act),
            }
        }
        self.hand_over(requests);
    }

    fn hand_over(&mut self, requests: impl IntoIterator<Item = ToLine>) {
        for ticket in hand_over(&self.shared, Owner::Sparkplug, requests) {
            self.session.refused_by_line(ticket);
        }
    }

    fn execute(&mut self, act: SparkplugAct) {
        match act {
            SparkplugAct::ToLine(request) => self.hand_over([request]),
            SparkplugAct::Keep(drive, attempt) => {
                if let Some(journal) = &self.sides.journal {
                    journal.keep(drive, attempt);
                }
            }
            SparkplugAct::Subscribe(_)
            | SparkplugAct::Publish(_)
            | SparkplugAct::Reconnect(_)
            | SparkplugAct::Leave(_) => {}
        }
    }

    fn count(&mut self, at: ClockMoment) {
        while let Some(OversizedPublication {
            topic,
            bytes,
            limit,
        }) = self.session.next_oversized()
        {
            tracing::warn!(
                topic,
                bytes,
                limit,
                "publication is larger than the broker takes; it is not published"
            );
        }
        self.sides.totals.set_oversized(self.session.oversized());
        self.sides
            .totals
            .set(self.session.is_path_alive(at), &self.session.counters());
    }
}

fn drives_of(shared: &SharedPlant) -> Vec<DriveDescription> {
    shared
        .drives
        .iter()
        .map(|drive| drive.description.clone())
        .collect()
}

fn lines_of(shared: &SharedPlant) -> Vec<Name> {
    shared.lines.iter().map(|line| line.name.clone()).collect()
}

impl BrokerConversation for NodeBrokerSession {
    fn chore(&mut self) -> Option<Chore> {
        let (number, chore) = self.bdseq.begin();
        self.session.connecting(number);
        chore
    }

    fn unsent(&mut self) {
        self.bdseq.unsent();
    }

    fn wants_connection(&self) -> bool {
        self.session.wants_connection()
    }

    fn will(&self) -> Publication {
        self.session.will()
    }

    fn handle(&mut self, at: ClockMoment, event: BrokerEvent<'_>) {
        self.follow();
        let was_behind = self.session.counters().host_behind_ms;
        self.session.handle(at, event);
        let behind_ms = self.session.counters().host_behind_ms;
        if behind_ms != was_behind
            && let Some(behind_ms) = behind_ms
        {
            tracing::warn!(
                behind_ms,
                "primary host is online by a STATE message that is older than one before: its clock was ahead; the message \
                 does not count"
            );
        }
        self.pass_inward();
        self.count(at);
    }

    fn tick(&mut self, at: ClockMoment) {
        self.refresh();
        self.session.tick(at);
        self.pass_inward();
        self.count(at);
    }

    fn next_wake(&self) -> Option<MonoTime> {
        [self.session.next_wake(), self.sides.news.next_release()]
            .into_iter()
            .flatten()
            .min()
    }

    fn next_packet(&mut self, at: ClockMoment) -> Option<ClientPacket> {
        loop {
            self.pass_inward();
            match self.session.next_act(at, &self.views, &self.lines)? {
                SparkplugAct::Subscribe(filters) => return Some(ClientPacket::Subscribe(filters)),
                SparkplugAct::Publish(publication) => {
                    return Some(ClientPacket::Publish(publication));
                }
                SparkplugAct::Reconnect(reason) => return Some(ClientPacket::Reconnect(reason)),
                SparkplugAct::Leave(reason) => return Some(ClientPacket::Leave(reason)),
                inward => self.execute(inward),
            }
        }
    }

    fn contested(&mut self, rival: Option<ClientRival>) {
        // The other gateway of a pair has taken the line over, and is the edge node from then on.
        self.sides
            .totals
            .contested(rival.is_some() && self.session.wants_connection());
    }

    fn lost(&mut self, reason: &str) {
        self.sides.totals.set_lost(reason);
    }

    fn farewell(&mut self, at: ClockMoment) -> Vec<Publication> {
        self.session.farewell(at)
    }

    /// tck-id-payloads-ndeath-will-message-publisher-disconnect-mqtt50: NDEATH is published twice, with the same
    /// number.
    fn leaves_will(&self) -> bool {
        true
    }
}
