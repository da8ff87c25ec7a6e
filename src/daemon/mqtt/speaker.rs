//! A session with everything it reads: views, lines, answers.

use super::{BdSeq, BrokerConversation, Chore, ClientPacket, ClientRival};
use crate::daemon::exchange::answers::{AnswerBox, LineNews};
use crate::daemon::exchange::north_journal::{Journal, NorthJournal};
use crate::daemon::exchange::shared::{CurrentPlant, SharedLine, SharedPlant};
use crate::daemon::exchange::to_lines::hand_over;
use crate::daemon::exchange::totals::BrokerTotals;
use crate::daemon::host::random;
use crate::domain::ids::{Name, Ticket};
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::view::DriveView;
use crate::north::broker::{
    BrokerEvent, BrokerSession, OversizedPublication, Publication, SessionAct, SessionLine,
    SessionNotice, ToLine,
};
use crate::north::clock::ClockMoment;
use std::sync::Arc;

/// What a session is connected to besides the broker.
#[derive(Debug)]
pub struct SessionSides<C> {
    /// The drives and lines.
    pub current: CurrentPlant,
    /// The answers of the lines.
    pub news: Arc<AnswerBox>,
    /// Where the counts are published.
    pub totals: Arc<BrokerTotals<C>>,
    /// Where attempts that reach no line are kept.
    pub journal: Journal,
}

/// The gateway's side of the conversation.
#[derive(Debug)]
pub struct SessionSpeaker<S: BrokerSession> {
    session: S,
    /// Numbers the connections, if the session needs that.
    bdseq: Option<BdSeq>,
    sides: SessionSides<S::Counters>,
    /// The drives and lines of the session.
    shared: Arc<SharedPlant>,
    /// The views as of the last look, in the order of [`SharedPlant::drives`].
    views: Vec<Arc<DriveView>>,
    lines: Vec<SessionLine>,
    batch: Vec<LineNews>,
}

impl<S: BrokerSession> SessionSpeaker<S> {
    /// Serves the drives and lines of `sides`; connections are numbered by `bdseq`. Tickets start at `first_ticket`, so
    /// that no answer to an earlier session is taken for one to this session.
    #[must_use]
    pub fn new(
        settings: S::Settings,
        bdseq: Option<BdSeq>,
        sides: SessionSides<S::Counters>,
        first_ticket: Ticket,
        at: ClockMoment,
    ) -> Self {
        let shared = sides.current.get();
        let (drives, lines) = (drives_of(&shared), lines_of(&shared));
        let mut session = S::new(settings, drives, lines, at, random::secret());
        session.see_titles(&shared.titles);
        session.count_tickets_from(first_ticket);
        let mut speaker = Self {
            session,
            bdseq,
            sides,
            shared,
            views: Vec::new(),
            lines: Vec::new(),
            batch: Vec::new(),
        };
        // The session may publish before anything changes.
        speaker.look_at_views();
        speaker
    }

    /// Processes the answers of the lines.
    fn take_news(&mut self, at: ClockMoment) {
        self.sides.news.take(&mut self.batch);
        for news in self.batch.drain(..) {
            match news {
                LineNews::Command(answer) => self.session.command_answer(at, &answer),
                LineNews::Native(answer) => self.session.native_answer(at, &answer),
                LineNews::Trip(place, event) => self.session.trip(at, place, &event),
                LineNews::Events { events, more } => self.session.stored_events(at, &events, more),
            }
        }
    }

    /// Follows a change of the configuration. Answers of the old drives are processed first.
    fn follow(&mut self, at: ClockMoment) {
        if Arc::ptr_eq(&self.sides.current.load(), &self.shared) {
            return;
        }
        self.take_news(at);
        self.shared = self.sides.current.get();
        self.session.see_titles(&self.shared.titles);
        self.session
            .replace(at, drives_of(&self.shared), lines_of(&self.shared));
        self.look_at_views();
    }

    fn refresh(&mut self, at: ClockMoment) {
        self.take_news(at);
        self.follow(at);
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
        let line = |(place, line): (usize, &Arc<SharedLine>)| SessionLine {
            name: line.name.clone(),
            report: line.report(),
            stations: if S::SHOWS_STATIONS {
                self.shared.stations(place).collect()
            } else {
                Vec::new()
            },
        };
        self.lines
            .extend(self.shared.lines.iter().enumerate().map(line));
    }

    /// Among several gateways of the name, a message is for the one that is active now.
    fn look_at_roles(&mut self, at: ClockMoment) {
        if self.session.has_partner() {
            self.look_at_views();
            self.session.see_roles(at, &self.lines);
        }
    }

    /// Passes on everything for the lines and the journal. It never waits for the broker.
    fn pass_inward(&mut self, at: ClockMoment) {
        let mut requests = Vec::new();
        while let Some(act) = self.session.next_inward() {
            match act {
                SessionAct::ToLine(request) => requests.push(request),
                act => self.execute(at, act),
            }
        }
        self.hand_over(at, requests);
    }

    fn hand_over(&mut self, at: ClockMoment, requests: impl IntoIterator<Item = ToLine>) {
        for ticket in hand_over(&self.shared, S::OWNER, requests) {
            self.session.refused_by_line(at, ticket);
        }
    }

    fn execute(&mut self, at: ClockMoment, act: SessionAct) {
        match act {
            SessionAct::ToLine(request) => self.hand_over(at, [request]),
            SessionAct::Keep(drive, attempt) => {
                self.ask_journal(|journal| journal.keep(drive, attempt))
            }
            SessionAct::EventTaken(seq) => self.ask_journal(|journal| journal.event_taken(seq)),
            SessionAct::WantEvents { after } => {
                self.ask_journal(|journal| journal.want_events(after))
            }
            SessionAct::Subscribe(_)
            | SessionAct::Publish(_)
            | SessionAct::Reconnect(_)
            | SessionAct::Leave(_) => {}
        }
    }

    fn ask_journal(&self, ask: impl FnOnce(&dyn NorthJournal)) {
        if let Some(journal) = &self.sides.journal {
            ask(journal.as_ref());
        }
    }

    /// Logs and publishes what has changed in the session.
    fn count(&mut self, at: ClockMoment) {
        while let Some(notice) = self.session.next_notice() {
            log(notice);
        }
        let totals = &self.sides.totals;
        totals.set_oversized(self.session.oversized());
        totals.set_clients_gone(self.session.clients_gone());
        totals.set(self.session.is_path_alive(at), &self.session.counters());
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

fn log(notice: SessionNotice) {
    match notice {
        SessionNotice::Oversized(OversizedPublication {
            topic,
            bytes,
            limit,
        }) => tracing::warn!(
            topic,
            bytes,
            limit,
            "publication is larger than the broker takes; it is not published"
        ),
        SessionNotice::ClientsGone(topic) => tracing::warn!(
            topic,
            "alive topic says that the clients of the broker are offline; control over MQTT ends \
             after `lost_after`"
        ),
        SessionNotice::ClientsBack => {
            tracing::info!("clients of the broker are online again by the alive topic")
        }
        SessionNotice::EventRefused => {
            tracing::error!("broker refused a trip event; no subscriber receives it")
        }
        SessionNotice::AliveTopicRefused => tracing::warn!(
            "broker does not let us read the alive topic; only the probe shows whether it delivers messages"
        ),
        SessionNotice::HostBehind { behind_ms } => tracing::warn!(
            behind_ms,
            "primary host is online by a STATE message that is older than one before: its clock was ahead; the message \
             does not count"
        ),
    }
}

impl<S: BrokerSession> BrokerConversation for SessionSpeaker<S> {
    fn chore(&mut self) -> Option<Chore> {
        let (number, chore) = self.bdseq.as_mut()?.begin();
        self.session.connecting(number);
        chore
    }

    fn unsent(&mut self) {
        if let Some(bdseq) = &mut self.bdseq {
            bdseq.unsent();
        }
    }

    fn wants_connection(&self) -> bool {
        self.session.wants_connection()
    }

    fn will(&self) -> Publication {
        self.session.will()
    }

    fn handle(&mut self, at: ClockMoment, event: BrokerEvent<'_>) {
        self.follow(at);
        if matches!(event, BrokerEvent::Message(_)) {
            self.look_at_roles(at);
        }
        self.session.handle(at, event);
        self.pass_inward(at);
        self.count(at);
    }

    fn tick(&mut self, at: ClockMoment) {
        self.refresh(at);
        self.session.tick(at);
        self.pass_inward(at);
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
            self.pass_inward(at);
            match self.session.next_act(at, &self.views, &self.lines)? {
                SessionAct::Subscribe(filters) => return Some(ClientPacket::Subscribe(filters)),
                SessionAct::Publish(publication) => {
                    return Some(ClientPacket::Publish(publication));
                }
                SessionAct::Reconnect(reason) => return Some(ClientPacket::Reconnect(reason)),
                SessionAct::Leave(reason) => return Some(ClientPacket::Leave(reason)),
                inward => self.execute(at, inward),
            }
        }
    }

    fn contested(&mut self, rival: Option<ClientRival>) {
        // On standby, the rival is the other gateway of the pair, which has taken the role over.
        self.sides
            .totals
            .contested(rival.is_some() && self.session.wants_connection());
    }

    fn lost(&mut self, reason: &str) {
        self.sides.totals.set_lost(reason);
    }

    fn farewell(&mut self, at: ClockMoment) -> Vec<Publication> {
        self.refresh(at);
        self.look_at_roles(at);
        self.session.farewell(at)
    }

    fn leaves_will(&self) -> bool {
        S::LEAVES_WILL
    }
}
