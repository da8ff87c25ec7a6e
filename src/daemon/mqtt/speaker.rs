//! The MQTT session with everything it reads: views, lines, answers.

use super::{BrokerConversation, ClientPacket, ClientRival};
use crate::daemon::exchange::answers::{AnswerBox, LineNews};
use crate::daemon::exchange::north_journal::{Journal, NorthJournal};
use crate::daemon::exchange::shared::{CurrentPlant, SharedLine, SharedPlant};
use crate::daemon::exchange::to_lines::hand_over;
use crate::daemon::exchange::totals::MqttTotals;
use crate::daemon::host::random;
use crate::domain::command::Owner;
use crate::domain::ids::{Name, Ticket};
use crate::domain::time::MonoTime;
use crate::drive::description::DriveDescription;
use crate::drive::view::DriveView;
use crate::north::broker::{BrokerEvent, OversizedPublication, Publication, SessionLine, ToLine};
use crate::north::clock::ClockMoment;
use crate::north::mqtt::{GatewayIdentity, MqttAct, MqttSession, Settings};
use std::sync::Arc;

/// The gateway's side of the conversation.
#[derive(Debug)]
pub struct BrokerSession {
    session: MqttSession,
    current: CurrentPlant,
    /// The drives and lines of the session.
    shared: Arc<SharedPlant>,
    news: Arc<AnswerBox>,
    totals: Arc<MqttTotals>,
    journal: Journal,
    /// The views as of the last look, in the order of [`SharedPlant::drives`].
    views: Vec<Arc<DriveView>>,
    lines: Vec<SessionLine>,
    batch: Vec<LineNews>,
}

impl BrokerSession {
    /// Serves the drives and lines of `current` as this gateway, which answer through `news`. Attempts that reach no line are sent to
    /// `journal`. Tickets start at `first_ticket`, so that no answer to an earlier session is taken for one to this
    /// session.
    #[must_use]
    pub fn new(
        (gateway, settings): (GatewayIdentity, Settings),
        current: CurrentPlant,
        news: Arc<AnswerBox>,
        totals: Arc<MqttTotals>,
        journal: Journal,
        first_ticket: Ticket,
        at: ClockMoment,
    ) -> Self {
        let shared = current.get();
        let mut session = MqttSession::new(
            gateway,
            settings,
            drives_of(&shared),
            lines_of(&shared),
            at,
            random::secret(),
        );
        session.count_tickets_from(first_ticket);
        let views = Vec::new();
        let lines = Vec::new();
        let batch = Vec::new();
        Self {
            session,
            current,
            shared,
            news,
            totals,
            journal,
            views,
            lines,
            batch,
        }
    }

    /// Processes the answers of the lines.
    fn take_news(&mut self, at: ClockMoment) {
        self.news.take(&mut self.batch);
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
        let is_the_same = Arc::ptr_eq(&self.current.load(), &self.shared);
        if is_the_same {
            return;
        }
        self.take_news(at);
        self.shared = self.current.get();
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
            stations: self.shared.stations(place).collect(),
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
                MqttAct::ToLine(request) => requests.push(request),
                act => self.execute(at, act),
            }
        }
        self.hand_over(at, requests);
    }

    fn hand_over(&mut self, at: ClockMoment, requests: impl IntoIterator<Item = ToLine>) {
        for ticket in hand_over(&self.shared, Owner::Mqtt, requests) {
            self.session.refused_by_line(at, ticket);
        }
    }

    fn execute(&mut self, at: ClockMoment, act: MqttAct) {
        match act {
            MqttAct::ToLine(request) => self.hand_over(at, [request]),
            MqttAct::Keep(drive, attempt) => {
                self.tell_journal(|journal| journal.keep(drive, attempt))
            }
            MqttAct::EventTaken(seq) => self.tell_journal(|journal| journal.event_taken(seq)),
            MqttAct::WantEvents { after } => {
                self.tell_journal(|journal| journal.want_events(after))
            }
            MqttAct::Subscribe(_) | MqttAct::Publish(_) | MqttAct::Reconnect(_) => {}
        }
    }

    fn tell_journal(&self, tell: impl FnOnce(&dyn NorthJournal)) {
        if let Some(journal) = &self.journal {
            tell(journal.as_ref());
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
        self.totals.set_oversized(self.session.oversized());
        self.totals.set_clients_gone(self.session.clients_gone());
        self.totals
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

impl BrokerConversation for BrokerSession {
    fn will(&self) -> Publication {
        self.session.will()
    }

    fn handle(&mut self, at: ClockMoment, event: BrokerEvent<'_>) {
        self.follow(at);
        if matches!(event, BrokerEvent::Message(_)) {
            self.look_at_roles(at);
        }
        let is_answer = matches!(event, BrokerEvent::Subscribed(_));
        let given_up = self.session.counters().events_refused;
        let were_gone = self.session.clients_gone().is_some();
        self.session.handle(at, event);
        match self.session.clients_gone() {
            Some(topic) if !were_gone => tracing::warn!(
                topic,
                "alive topic says that the clients of the broker are offline; what MQTT holds is given up after `lost_after`"
            ),
            None if were_gone => {
                tracing::info!("clients of the broker are online again by the alive topic")
            }
            _ => {}
        }
        if self.session.counters().events_refused > given_up {
            tracing::error!("broker refused a trip event; no subscriber receives it");
        }
        if is_answer && self.session.counters().alive_refused > 0 {
            tracing::warn!(
                "broker does not let us read the alive topic; only the probe shows whether it delivers messages"
            );
        }
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
        [self.session.next_wake(), self.news.next_release()]
            .into_iter()
            .flatten()
            .min()
    }

    fn next_packet(&mut self, at: ClockMoment) -> Option<ClientPacket> {
        loop {
            self.pass_inward(at);
            match self.session.next_act(at, &self.views, &self.lines)? {
                MqttAct::Subscribe(filters) => return Some(ClientPacket::Subscribe(filters)),
                MqttAct::Publish(publication) => return Some(ClientPacket::Publish(publication)),
                MqttAct::Reconnect(reason) => return Some(ClientPacket::Reconnect(reason)),
                inward => self.execute(at, inward),
            }
        }
    }

    fn contested(&mut self, rival: Option<ClientRival>) {
        self.totals.contested(rival.is_some());
    }

    fn lost(&mut self, reason: &str) {
        self.totals.set_lost(reason);
    }

    fn farewell(&mut self, at: ClockMoment) -> Vec<Publication> {
        self.refresh(at);
        self.session.see_roles(at, &self.lines);
        self.session.farewell(at)
    }
}
