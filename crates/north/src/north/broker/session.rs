//! What a session with a broker takes and returns, whatever its topics and payloads.

use super::commands::ToLine;
use super::oversized::OversizedPublication;
use super::types::{BrokerEvent, Publication, SessionLine, SubscriptionFilter};
use crate::domain::command::{CommandAnswer, Owner};
use crate::domain::ids::{AskerId, Name, Ticket};
use crate::domain::native::NativeAnswer;
use crate::domain::time::MonoTime;
use crate::drive::description::{DriveDescription, DriveRef};
use crate::drive::view::{DriveView, TripEvent};
use crate::journal::{StoredEvent, WriteAttempt};
use crate::north::clock::ClockMoment;
use crate::north::titles::PlantTitles;
use std::fmt::Debug;
use std::sync::Arc;

/// An act for the owner of a session.
#[derive(Clone, Debug, PartialEq)]
pub enum SessionAct {
    /// Subscribe to these filters; they are answered together.
    Subscribe(Vec<SubscriptionFilter>),
    /// Publish.
    Publish(Publication),
    /// Hand this to the lines.
    ToLine(ToLine),
    /// Keep this attempt to write, which no line saw: it was refused, is a repeat, or was withdrawn before it reached a
    /// line. `None` for the drive: the message is for all, or for one that does not exist.
    Keep(Option<DriveRef>, WriteAttempt),
    /// The broker has the stored event with this number, or will not accept it: it is not to be published again.
    EventTaken(u64),
    /// The session requests the first stored events with higher numbers that no broker has: now if there are any, else
    /// as soon as there is one. It is answered once, by [`BrokerSession::stored_events`].
    WantEvents {
        /// The highest number that it has received.
        after: u64,
    },
    /// Drop the connection and make a new one: the broker publishes the will.
    Reconnect(&'static str),
    /// Publish the last messages, disconnect, and make a new connection.
    Leave(&'static str),
}

/// Something about the broker or its clients that belongs into the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SessionNotice {
    /// A publication is larger than the broker takes. Each topic is named once on each connection.
    Oversized(OversizedPublication),
    /// This topic says that the clients of the broker are offline, and leases depend on it.
    ClientsGone(String),
    /// The clients of the broker are online again.
    ClientsBack,
    /// The broker refused a trip event, which is given up.
    EventRefused,
    /// The broker does not grant the subscription to the alive topic.
    AliveTopicRefused,
    /// The primary host says that it is online in a message that is this much older than one before, so that the message
    /// does not count.
    HostBehind {
        /// How much older, in milliseconds.
        behind_ms: u64,
    },
}

/// A session with a broker as a machine without a socket or a clock. Its owner moves things between it, the broker and
/// the lines:
///
/// * what happens on the connection goes to [`handle`](Self::handle), answers of the lines to
///   [`command_answer`](Self::command_answer) and [`native_answer`](Self::native_answer), trips to
///   [`trip`](Self::trip), or if a journal keeps them, to [`stored_events`](Self::stored_events);
/// * [`tick`](Self::tick) is called when [`next_wake`](Self::next_wake) is due;
/// * after each of these, and whenever a view changed, [`next_act`](Self::next_act) is called until it returns
///   `None`. While there is no room for publications, [`next_inward`](Self::next_inward) is called instead;
/// * after each event, [`next_notice`](Self::next_notice) is called until it returns `None`.
pub trait BrokerSession: Debug {
    /// The settings of a session.
    type Settings;
    /// What a session counts.
    type Counters: Copy + Debug;
    /// To whom lines answer its commands.
    const ASKER: AskerId;
    /// The owner of its commands.
    const OWNER: Owner;
    /// Whether the broker is to publish the will after the last messages, too.
    const LEAVES_WILL: bool;
    /// Whether it publishes how a line sees its drives.
    const SHOWS_STATIONS: bool;

    /// The session of a gateway with these drives and lines, started now. `probe_key` is random, and used by this
    /// session only: without it no peer can forge a probe.
    #[must_use]
    fn new(
        settings: Self::Settings,
        drives: Vec<DriveDescription>,
        lines: Vec<Name>,
        started: ClockMoment,
        probe_key: u128,
    ) -> Self;

    /// Ticket numbers continue from this one.
    fn count_tickets_from(&mut self, first: Ticket);

    /// Takes the titles of drives, lines and the gateway. Ignored by a session that shows none.
    fn see_titles(&mut self, _titles: &Arc<PlantTitles>) {}

    /// Replaces drives and lines.
    fn replace(&mut self, at: ClockMoment, drives: Vec<DriveDescription>, lines: Vec<Name>);

    /// Whether there is to be a connection.
    fn wants_connection(&self) -> bool {
        true
    }

    /// The next connection has this number. Called before [`will`](Self::will), if connections are numbered.
    fn connecting(&mut self, _number: u8) {}

    /// What the broker publishes when the connection breaks.
    #[must_use]
    fn will(&self) -> Publication;

    /// Takes what happened on the connection.
    fn handle(&mut self, at: ClockMoment, event: BrokerEvent<'_>);

    /// Takes the current outcome of a command. Answers to others, or to commands that are no longer pending, are
    /// ignored.
    fn command_answer(&mut self, at: ClockMoment, answer: &CommandAnswer);

    /// Takes the answer to a read. Answers to others, or to reads that are no longer pending, are ignored.
    fn native_answer(&mut self, _at: ClockMoment, _answer: &NativeAnswer) {}

    /// Takes the notice that a line could not accept the request with this ticket, because its inbox was full.
    fn refused_by_line(&mut self, at: ClockMoment, ticket: Ticket);

    /// Takes a trip or its clearing. Ignored by a session that shows trips from the views alone.
    fn trip(&mut self, _at: ClockMoment, _place: DriveRef, _event: &TripEvent) {}

    /// Takes events of the journal, the answer to [`SessionAct::WantEvents`]. `more`: the journal has others.
    fn stored_events(&mut self, _at: ClockMoment, _events: &[StoredEvent], _more: bool) {}

    /// Whether other gateways get the same messages, so that [`see_roles`](Self::see_roles) is to be called before each.
    fn has_partner(&self) -> bool {
        false
    }

    /// Takes the present roles of the gateway on its lines, in their order. [`next_act`](Self::next_act) does it itself.
    fn see_roles(&mut self, at: ClockMoment, lines: &[SessionLine]);

    /// Advances to the present.
    fn tick(&mut self, at: ClockMoment);

    /// When [`tick`](Self::tick) and [`next_act`](Self::next_act) are to be called if no event occurs before.
    #[must_use]
    fn next_wake(&self) -> Option<MonoTime>;

    /// The next item for the lines: commands, reads, and the state of the path from the clients; after them attempts to
    /// be kept. It needs no room on the connection, so that a stop never waits for one.
    fn next_inward(&mut self) -> Option<SessionAct>;

    /// The next act. `views` are in the order of the drives, `lines` in the order of the lines. What is returned counts
    /// as done, except publications with a token, which are sent again after a reconnect until they are acknowledged.
    fn next_act(
        &mut self,
        at: ClockMoment,
        views: &[Arc<DriveView>],
        lines: &[SessionLine],
    ) -> Option<SessionAct>;

    /// What is still to be published on an orderly end.
    fn farewell(&mut self, at: ClockMoment) -> Vec<Publication>;

    /// The next notice for the log; each is returned once.
    fn next_notice(&mut self) -> Option<SessionNotice>;

    /// What is not published because it is larger than the broker takes.
    #[must_use]
    fn oversized(&self) -> &[OversizedPublication];

    /// The topic that says that the clients of the broker are gone, while it does and a lease depends on it.
    #[must_use]
    fn clients_gone(&self) -> Option<&str> {
        None
    }

    /// Whether the path through the broker was proven recently, and clients can command.
    #[must_use]
    fn is_path_alive(&self, at: ClockMoment) -> bool;

    /// The counters so far.
    #[must_use]
    fn counters(&self) -> Self::Counters;
}
