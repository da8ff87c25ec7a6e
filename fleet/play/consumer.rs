//! A consumer of the fleet: it subscribes, and books what it receives.

use super::Reading;
use super::board::{Board, Phase};
use crate::books::{Mark, Receipt};
use std::rc::Rc;
use std::sync::Arc;
use tokio::sync::Notify;
use vfd_gateway::daemon::mqtt::{BrokerConversation, ClientPacket, ClientRival};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::north::broker::{
    BrokerEvent, BrokerMessage, MqttVersion, Publication, Qos, SubscriptionFilter,
};
use vfd_gateway::north::clock::ClockMoment;

/// The group of a shared subscription.
const GROUP: &str = "fleet";

/// Its talk with the broker.
#[derive(Debug)]
pub struct Consumer {
    board: Arc<Board>,
    number: usize,
    over: Rc<Notify>,
    /// With 3.1.1 a broker sends retained messages at every subscription, with the retain flag.
    version: MqttVersion,
    is_connected: bool,
    is_asked: bool,
    was_granted: bool,
}

impl Consumer {
    /// The consumer with this number.
    pub fn new(board: Arc<Board>, number: usize, over: Rc<Notify>) -> Self {
        let version = board
            .plan
            .consumers
            .get(number)
            .map_or(MqttVersion::V5, |settings| settings.version);
        Self {
            board,
            number,
            over,
            version,
            is_connected: false,
            is_asked: false,
            was_granted: false,
        }
    }

    fn filters(&self) -> Vec<SubscriptionFilter> {
        let shape = &self.board.plan.shape;
        let consumers = self.board.plan.consumers.len().max(1);
        let paths = match self.board.plan.reading {
            Reading::All => vec![shape.filter(None)],
            Reading::Shared => vec![format!("$share/{GROUP}/{}", shape.filter(None))],
            Reading::Split => {
                let own = (0..shape.gateways).filter(|gateway| gateway % consumers == self.number);
                own.map(|gateway| shape.filter(Some(gateway))).collect()
            }
        };
        let filter = |path| SubscriptionFilter {
            path,
            qos: Qos::AtLeastOnce,
            wants_retained: false,
        };
        paths.into_iter().map(filter).collect()
    }

    fn subscribed(&mut self, granted: &[bool]) {
        let refused = self
            .filters()
            .into_iter()
            .zip(granted)
            .find(|(_, granted)| !**granted)
            .map(|(filter, _)| filter);
        if let Some(filter) = refused {
            return self.board.fail(format!(
                "the broker does not grant the subscription of `{}`",
                filter.path
            ));
        }
        if !std::mem::replace(&mut self.was_granted, true) {
            self.board.consumers.add();
        }
    }

    fn receive(&self, at: MonoTime, message: &BrokerMessage<'_>) {
        let board = &self.board;
        let shape = &self.board.plan.shape;
        let is_kept = message.retain && self.version == MqttVersion::V4;
        if message.payload.is_empty() || is_kept {
            return;
        }
        let mark =
            Mark::of(shape.update, message.payload).filter(|mark| !mark.is_older_than(board.begun));
        let (Some(drive), Some(mark)) = (shape.drive_of(message.topic), mark) else {
            return board.foreign.add();
        };
        board.received.add();
        // If each consumer gets everything, only one keeps the books.
        if board.plan.reading == Reading::All && self.number > 0 {
            return;
        }
        let receipt = board.ledger.received(drive, mark.number);
        match receipt {
            Receipt::First => {}
            Receipt::Late => board.late.add(),
            Receipt::Again => return board.again.add(),
            Receipt::Foreign => return board.foreign.add(),
        }
        board.delays.add(mark.age(at));
    }
}

impl BrokerConversation for Consumer {
    fn will(&self) -> Publication {
        Publication {
            topic: format!(
                "{}/consumer-{}/status",
                self.board.plan.shape.prefix,
                self.number + 1
            ),
            payload: b"offline".to_vec(),
            retain: false,
            qos: Qos::AtMostOnce,
            expiry: None,
            correlation: None,
            token: None,
        }
    }

    fn handle(&mut self, at: ClockMoment, event: BrokerEvent<'_>) {
        match event {
            BrokerEvent::Connected(_) => {
                self.is_connected = true;
                self.is_asked = false;
                self.board.connections.add();
            }
            BrokerEvent::Subscribed(granted) => self.subscribed(&granted),
            BrokerEvent::Message(message) => self.receive(at.mono, &message),
            BrokerEvent::Lost => {
                self.is_connected = false;
                self.board.broken.add();
            }
            BrokerEvent::Acknowledged(_) | BrokerEvent::Refused(..) | BrokerEvent::Stalled(_) => {}
        }
    }

    fn tick(&mut self, _: ClockMoment) {
        if self.board.phase() == Phase::Ending {
            self.over.notify_one();
        }
    }

    fn next_wake(&self) -> Option<MonoTime> {
        None
    }

    fn next_packet(&mut self, _: ClockMoment) -> Option<ClientPacket> {
        let asks = self.is_connected && !std::mem::replace(&mut self.is_asked, true);
        asks.then(|| ClientPacket::Subscribe(self.filters()))
    }

    fn contested(&mut self, _: Option<ClientRival>) {}

    fn farewell(&mut self, _: ClockMoment) -> Vec<Publication> {
        Vec::new()
    }
}
