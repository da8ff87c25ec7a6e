//! Stalled connections: sent data waits and arrives afterwards, in order. Also a gateway whose process is suspended
//! while everything else continues.

use super::extras::{Extra, Extras};
use super::mqtt::{MqttSide, moment};
use super::trouble::Trouble;
use super::world::World;
use fastrand::Rng;
use std::time::Duration;
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::north::broker::{BrokerEvent, BrokerSession};

/// A process that is suspended for this long notices it.
const NOTICED: Duration = Duration::from_secs(1);
/// Mean time between two stalls of a connection, and of the process.
const CLIENT_EVERY: Duration = Duration::from_secs(15);
const PROCESS_EVERY: Duration = Duration::from_secs(60);

/// Stalls to come.
#[derive(Debug)]
pub struct Stalls {
    rng: Rng,
    client_at: MonoTime,
    process_at: MonoTime,
    /// When stalled connections continue, the earliest first.
    pub until: Vec<(MonoTime, usize)>,
}

impl Stalls {
    pub fn new(seed: u64, extras: Extras, from: MonoTime) -> Self {
        let first = |extra, at| {
            if extras.has(extra) {
                at
            } else {
                MonoTime::NEVER
            }
        };
        Self {
            rng: Rng::with_seed(seed),
            client_at: first(Extra::ClientStalls, from + CLIENT_EVERY),
            process_at: first(Extra::Standstills, from + PROCESS_EVERY),
            until: Vec::new(),
        }
    }

    fn about(&mut self, mean: Duration) -> Duration {
        Duration::from_nanos(self.rng.u64(1..=2 * mean.as_nanos() as u64))
    }

    fn stall(&mut self) -> Duration {
        Duration::from_millis(if self.rng.bool() {
            self.rng.u64(300..4_000)
        } else {
            self.rng.u64(300..15_000)
        })
    }
}

impl MqttSide {
    /// Nothing arrives before `inward`, and nothing reaches the broker before `outward`.
    fn stall(&mut self, inward: MonoTime, outward: MonoTime) {
        self.held = (self.held.0.max(inward), self.held.1.max(outward));
        let held = self.held.0;
        self.coming
            .iter_mut()
            .for_each(|(at, _)| *at = held.max(*at));
    }

    /// No further stall begins.
    pub fn stall_ends(&mut self) {
        self.stall_at = MonoTime::NEVER;
        self.clock_at = MonoTime::NEVER;
    }
}

impl World {
    /// When a stall begins or ends.
    pub fn stalls_due(&self) -> MonoTime {
        let Some(stalls) = &self.stalls else {
            return MonoTime::NEVER;
        };
        let over = stalls.until.first().map_or(MonoTime::NEVER, |(at, _)| *at);
        stalls.client_at.min(stalls.process_at).min(over)
    }

    /// Stalls that are due begin or end.
    pub fn stalls_act(&mut self) {
        let now = self.now;
        let Some(stalls) = &mut self.stalls else {
            return;
        };
        if stalls.client_at <= now {
            stalls.client_at = now + stalls.about(CLIENT_EVERY);
            let who = stalls.rng.usize(0..self.plan.clients);
            let lasts = stalls.stall();
            self.tally.client_stalls += 1;
            self.checker
                .note(now.as_nanos(), who, "the client's connection stalls");
            self.client_stalls(who, now + lasts);
        }
        let Some(stalls) = &mut self.stalls else {
            return;
        };
        if stalls.process_at <= now {
            stalls.process_at = now + stalls.about(PROCESS_EVERY);
            let lasts = stalls.stall().min(Duration::from_secs(8));
            self.tally.standstills += 1;
            self.stand_still(lasts);
        }
        self.clients_go_on(false);
    }

    /// All stalls end.
    pub fn stalls_end(&mut self) {
        self.stalls
            .iter_mut()
            .flat_map(|stalls| &mut stalls.until)
            .for_each(|(at, _)| *at = self.now);
        self.clients_go_on(false);
        self.stalls = None;
        self.mqtt.iter_mut().for_each(MqttSide::stall_ends);
    }

    fn client_stalls(&mut self, who: usize, until: MonoTime) {
        let Some(stalls) = &mut self.stalls else {
            return;
        };
        let until = self.clients[who]
            .stalled_until
            .map_or(until, |before| before.max(until));
        self.clients[who].stalled_until = Some(until);
        stalls.until.retain(|(_, it)| *it != who);
        stalls.until.push((until, who));
        stalls.until.sort();
    }

    /// Data that waited in continuing connections arrives now; `has_waited` if the process was suspended.
    fn clients_go_on(&mut self, has_waited: bool) {
        while let Some(stalls) = &mut self.stalls
            && stalls.until.first().is_some_and(|(at, _)| *at <= self.now)
        {
            let (_, who) = stalls.until.remove(0);
            self.clients[who].stalled_until = None;
            let bytes = std::mem::take(&mut self.clients[who].waiting);
            self.has_waited = has_waited;
            if !bytes.is_empty() {
                self.client_sends(who, &bytes);
            }
            self.has_waited = false;
        }
    }

    /// The process is suspended for `time`: clients, drives and other parties continue.
    fn stand_still(&mut self, time: Duration) {
        let from = self.now;
        let until = self.now + time;
        self.checker.stands_still(from.as_nanos(), until.as_nanos());
        (0..self.clients.len()).for_each(|who| self.client_stalls(who, until));
        let mut heard = Vec::new();
        loop {
            let due = self.bus.next_due().unwrap_or(MonoTime::NEVER);
            let repair = self
                .repairs
                .iter()
                .find(|it| it.1 != Trouble::PortDown)
                .map_or(MonoTime::NEVER, |it| it.0);
            let message = self
                .mqtt
                .as_ref()
                .map_or(MonoTime::NEVER, |side| side.message_at);
            let next = due
                .min(repair)
                .min(message)
                .min(self.client_at)
                .min(self.others_due());
            if next > until {
                break;
            }
            self.now = self.now.max(next);
            self.bus
                .take_due(self.now, |_, bytes| heard.extend_from_slice(bytes));
            self.act_meanwhile();
        }
        self.now = until;
        self.checker.stood_still(from.as_nanos(), until.as_nanos());
        if !heard.is_empty() && self.is_port_up {
            self.checker.heard(until.as_nanos(), &heard);
            self.core.handle(until, LineInput::Bytes(&heard));
        }
        let is_noticed = time >= NOTICED;
        if is_noticed {
            self.mqtt_stood_still(time);
        }
        self.clients_go_on(is_noticed);
    }

    /// The actions of other parties while the process is suspended.
    fn act_meanwhile(&mut self) {
        if let Some(place) = self
            .repairs
            .iter()
            .position(|it| it.1 != Trouble::PortDown && it.0 <= self.now)
        {
            let (_, trouble, which) = self.repairs.remove(place);
            self.repair(trouble, which);
        }
        if self.client_at <= self.now {
            self.client_at = self.now + self.about(self.plan.ask_every);
            self.client_acts();
        }
        self.others_act();
        self.commanders_act();
    }

    /// The gateway was suspended for `stood`, and knows it.
    fn mqtt_stood_still(&mut self, stood: Duration) {
        let (now, Some(side)) = (self.now, &mut self.mqtt) else {
            return;
        };
        if side.is_connected {
            side.session
                .handle(moment(now, side.ahead), BrokerEvent::Stalled(stood));
        }
        side.wake_at = now;
    }

    /// The path stalls, and clocks jump.
    pub(super) fn spoil_the_way(&mut self, side: &mut MqttSide) {
        if side.stall_at <= self.now {
            side.stall_at = self.now + self.about(Duration::from_secs(20));
            let most = if self.rng.bool() { 3_500 } else { 15_000 };
            let until = self.now + Duration::from_millis(self.rng.u64(300..most));
            let which = self.rng.u8(0..4);
            side.stall(
                if which == 1 { self.now } else { until },
                if which == 2 { self.now } else { until },
            );
            self.tally.broker_stalls += 1;
            self.checker.note(
                self.now.as_nanos(),
                which.into(),
                "the way to the broker stalls",
            );
        }
        if side.clock_at <= self.now {
            side.clock_at = self.now + self.about(Duration::from_secs(30));
            let mut jump = || match self.rng.u8(0..5) {
                0 | 1 => 0,
                2 => self.rng.i64(-2_500..2_500),
                3 => self.rng.i64(-60_000..60_000),
                _ => self.rng.i64(-300_000..300_000),
            };
            side.ahead = jump();
            side.commanders_ahead = jump();
            self.tally.clock_steps += 1;
            let text = format!(
                "clocks: the gateway's {} ms, commanders' {} ms",
                side.ahead, side.commanders_ahead
            );
            self.checker.note(self.now.as_nanos(), 0, &text);
        }
    }
}
