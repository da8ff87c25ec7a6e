//! A gateway of the fleet: when each of its updates is due, which are not acknowledged yet, and which topics it clears.

use super::board::{Board, Phase};
use crate::books::{Mark, Shape};
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::sync::Arc;
use tokio::sync::Notify;
use vfd_gateway::daemon::mqtt::{BrokerConversation, ClientPacket, ClientRival};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::north::broker::{BrokerEvent, Publication, Qos};
use vfd_gateway::north::clock::ClockMoment;

/// Its talk with the broker.
#[derive(Debug)]
pub struct Gateway {
    board: Arc<Board>,
    number: usize,
    /// Notified when it has nothing more to send.
    over: Rc<Notify>,
    is_connected: bool,
    was_connected: bool,
    has_greeted: bool,
    /// The place of the next update in the order of all.
    place: u64,
    /// How many updates of each drive were sent.
    sent: Vec<u32>,
    /// Unacknowledged updates, with when they were due.
    unacknowledged: BTreeMap<Token, MonoTime>,
    /// Of these: updates to be sent again on this connection.
    again: VecDeque<Token>,
    /// Topics that were cleared.
    cleared: usize,
}

/// An update: its drive in the upper half, its number in the lower one.
type Token = u64;

impl Gateway {
    /// The gateway with this number.
    pub fn new(board: Arc<Board>, number: usize, over: Rc<Notify>) -> Self {
        let sent = vec![0; board.plan.shape.drives];
        Self {
            board,
            number,
            over,
            is_connected: false,
            was_connected: false,
            has_greeted: false,
            place: 0,
            sent,
            unacknowledged: BTreeMap::new(),
            again: VecDeque::new(),
            cleared: 0,
        }
    }

    fn shape(&self) -> &Shape {
        &self.board.plan.shape
    }

    fn drive_of_all(&self, drive: usize) -> usize {
        self.number * self.shape().drives + drive
    }

    fn connected(&mut self) {
        self.is_connected = true;
        self.has_greeted = false;
        self.board.connections.add();
        if !std::mem::replace(&mut self.was_connected, true) {
            self.board.gateways.add();
        }
        self.again = self.unacknowledged.keys().copied().collect();
    }

    fn acknowledged(&mut self, at: MonoTime, token: Token) {
        if let Some(due) = self.unacknowledged.remove(&token) {
            let (drive, number) = parts(token);
            self.board
                .ledger
                .acknowledged(self.drive_of_all(drive), number);
            self.board.acknowledgements.add(at.since(due));
        }
    }

    fn status(&self, text: &str) -> Publication {
        let topic = self.shape().topic_of_gateway(self.number, "status");
        let payload = text.as_bytes().to_vec();
        let retain = self.board.plan.retain;
        Publication {
            topic,
            payload,
            retain,
            qos: Qos::AtLeastOnce,
            expiry: None,
            correlation: None,
            token: None,
        }
    }

    fn update(&self, token: Token, due: MonoTime) -> Publication {
        let (plan, (drive, number)) = (&self.board.plan, parts(token));
        Publication {
            topic: plan.shape.topic(self.number, drive),
            payload: Mark::new(number, due).on(plan.shape.update, &plan.state),
            retain: plan.retain,
            qos: plan.qos,
            expiry: plan.expiry,
            correlation: None,
            token: (plan.qos == Qos::AtLeastOnce).then_some(token),
        }
    }

    /// The next update that is due. One whose successor is due as well is left out, as in a real gateway: only the
    /// newest state of a drive is published.
    fn next_due(&mut self, at: MonoTime, start: MonoTime) -> Option<Publication> {
        while self.place < self.shape().updates_of_gateway() {
            let due = self.shape().due(self.number, self.place, start);
            if due > at {
                return None;
            }
            let drive = usize::try_from(self.place % self.shape().drives as u64).ok()?;
            self.place += 1;
            if due + self.shape().interval <= at {
                continue;
            }
            let count = self.sent.get_mut(drive)?;
            let number = *count;
            *count += 1;
            let token = token(drive, number);
            if self.board.plan.qos == Qos::AtLeastOnce {
                self.unacknowledged.insert(token, due);
            }
            self.board.ledger.sent(self.drive_of_all(drive), number);
            return Some(self.update(token, due));
        }
        None
    }

    fn next_repeat(&mut self) -> Option<Publication> {
        while let Some(token) = self.again.pop_front() {
            if let Some(due) = self.unacknowledged.get(&token) {
                self.board.repeated.add();
                return Some(self.update(token, *due));
            }
        }
        None
    }

    /// Clears its retained messages, then notifies that it has finished.
    fn next_clearing(&mut self) -> Option<Publication> {
        let drives = if self.board.plan.retain {
            self.shape().drives
        } else {
            0
        };
        while self.cleared < drives {
            let drive = self.cleared;
            self.cleared += 1;
            if self.sent.get(drive).is_some_and(|sent| *sent > 0) {
                let topic = self.shape().topic(self.number, drive);
                return Some(Publication {
                    topic,
                    ..self.status("")
                });
            }
        }
        if self.cleared == drives {
            self.cleared += 1;
            return Some(self.status(""));
        }
        self.over.notify_one();
        None
    }
}

const fn token(drive: usize, number: u32) -> Token {
    ((drive as u64) << 32) | number as u64
}

const fn parts(token: Token) -> (usize, u32) {
    ((token >> 32) as usize, (token & u32::MAX as u64) as u32)
}

impl BrokerConversation for Gateway {
    fn will(&self) -> Publication {
        self.status("offline")
    }

    fn handle(&mut self, at: ClockMoment, event: BrokerEvent<'_>) {
        match event {
            BrokerEvent::Connected(_) => self.connected(),
            BrokerEvent::Acknowledged(token) => self.acknowledged(at.mono, token),
            BrokerEvent::Refused(token, _) => {
                self.unacknowledged.remove(&token);
                self.board.refused.add();
            }
            BrokerEvent::Lost => {
                self.is_connected = false;
                self.board.broken.add();
            }
            BrokerEvent::Subscribed(_) | BrokerEvent::Message(_) | BrokerEvent::Stalled(_) => {}
        }
    }

    fn tick(&mut self, _: ClockMoment) {
        if self.board.phase() == Phase::Ending {
            self.over.notify_one();
        }
    }

    fn next_wake(&self) -> Option<MonoTime> {
        match self.board.phase() {
            Phase::Publishing(start)
                if self.is_connected && self.place < self.shape().updates_of_gateway() =>
            {
                Some(self.shape().due(self.number, self.place, start))
            }
            _ => None,
        }
    }

    fn next_packet(&mut self, at: ClockMoment) -> Option<ClientPacket> {
        if !self.is_connected {
            return None;
        }
        if !std::mem::replace(&mut self.has_greeted, true) {
            return Some(ClientPacket::Publish(self.status("online")));
        }
        let next = self.next_repeat().or_else(|| match self.board.phase() {
            Phase::Publishing(start) => self.next_due(at.mono, start),
            Phase::Clearing => self.next_clearing(),
            Phase::Connecting | Phase::Draining | Phase::Ending => None,
        });
        next.map(ClientPacket::Publish)
    }

    fn contested(&mut self, _: Option<ClientRival>) {}

    fn farewell(&mut self, _: ClockMoment) -> Vec<Publication> {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::books::{Balance, Update};
    use crate::play::{Plan, Reading};
    use std::time::Duration;
    use vfd_gateway::domain::time::WallTime;
    use vfd_gateway::north::broker::BrokerLimits;

    const START: MonoTime = MonoTime::from_millis(10_000);

    fn gateway() -> Gateway {
        let shape = Shape {
            prefix: "vfd".to_owned(),
            gateways: 1,
            drives: 2,
            update: Update::State,
            interval: Duration::from_secs(1),
            updates: 10,
        };
        let plan = Plan {
            shape,
            qos: Qos::AtLeastOnce,
            retain: true,
            expiry: None,
            state: br#"{"online":true}"#.to_vec(),
            gateways: Vec::new(),
            consumers: Vec::new(),
            reading: Reading::All,
            connects_per_second: 1,
            threads: 1,
            drain: Duration::ZERO,
            watched: Vec::new(),
        };
        let board = Arc::new(Board::new(plan).unwrap());
        let mut gateway = Gateway::new(board, 0, Rc::default());
        gateway.handle(at(0), BrokerEvent::Connected(BrokerLimits::default()));
        assert_eq!(published(&mut gateway, 0), ["vfd/gw-0001/status"]);
        gateway.board.enter(Phase::Publishing(START));
        gateway
    }

    /// The moment `millis` milliseconds after the start.
    fn at(millis: u64) -> ClockMoment {
        ClockMoment {
            mono: START + Duration::from_millis(millis),
            wall: WallTime { unix_ms: 0 },
        }
    }

    fn tokens(gateway: &mut Gateway, millis: u64) -> Vec<u64> {
        let next = || gateway.next_packet(at(millis));
        let packets: Vec<_> = std::iter::from_fn(next).collect();
        packets
            .into_iter()
            .filter_map(|it| {
                if let ClientPacket::Publish(it) = it {
                    it.token
                } else {
                    None
                }
            })
            .collect()
    }

    fn published(gateway: &mut Gateway, millis: u64) -> Vec<String> {
        let packets: Vec<_> = std::iter::from_fn(|| gateway.next_packet(at(millis))).collect();
        packets
            .into_iter()
            .filter_map(|it| {
                if let ClientPacket::Publish(it) = it {
                    Some(it.topic)
                } else {
                    None
                }
            })
            .collect()
    }

    #[test]
    fn drives_take_turns_and_what_is_overtaken_is_left_out() {
        let mut gateway = gateway();
        assert_eq!(tokens(&mut gateway, 0), [token(0, 0)]);
        assert_eq!(gateway.next_wake(), Some(at(500).mono));
        assert_eq!(tokens(&mut gateway, 499), [0; 0]);
        assert_eq!(tokens(&mut gateway, 500), [token(1, 0)]);
        // Due at 2.5 s (drive 1, overtaken at 3.5 s), 3 s and 3.5 s.
        assert_eq!(tokens(&mut gateway, 3_600), [token(0, 1), token(1, 1)]);
        let expected = Balance {
            sent: 4,
            unacknowledged_missing: 4,
            ..Balance::default()
        };
        assert_eq!(gateway.board.ledger.balance(), expected);
    }

    #[test]
    fn what_was_not_acknowledged_goes_again_and_nothing_else() {
        let mut gateway = gateway();
        assert_eq!(tokens(&mut gateway, 500), [token(0, 0), token(1, 0)]);
        gateway.handle(at(600), BrokerEvent::Acknowledged(token(0, 0)));
        gateway.handle(at(700), BrokerEvent::Lost);
        assert!(gateway.next_packet(at(1_500)).is_none() && gateway.next_wake().is_none());
        gateway.handle(at(1_600), BrokerEvent::Connected(BrokerLimits::default()));
        assert_eq!(
            tokens(&mut gateway, 1_600),
            [token(1, 0), token(0, 1), token(1, 1)]
        );
        gateway.handle(at(1_700), BrokerEvent::Acknowledged(token(1, 0)));
        assert_eq!(
            (
                gateway.board.ledger.balance().acknowledged,
                gateway.board.repeated.get()
            ),
            (2, 1)
        );
        assert_eq!(
            gateway.board.acknowledgements.longest(),
            Duration::from_millis(1_200)
        );
    }

    #[test]
    fn at_the_end_it_takes_back_what_it_published() {
        let mut gateway = gateway();
        tokens(&mut gateway, 0);
        gateway.board.enter(Phase::Draining);
        assert_eq!(published(&mut gateway, 2_000), [""; 0], "nothing new");
        gateway.board.enter(Phase::Clearing);
        assert_eq!(
            published(&mut gateway, 2_100),
            ["vfd/gw-0001/drive/drive-01/state", "vfd/gw-0001/status"]
        );
        assert_eq!(published(&mut gateway, 2_200), [""; 0], "once");
    }
}
