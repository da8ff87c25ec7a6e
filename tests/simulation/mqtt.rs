//! The MQTT side: the real session, a small broker, and clients behind it.

use super::checker::messages::Inbound;
use super::extras::Extra;
use super::world::World;
use std::time::Duration;
use vfd_gateway::domain::command::{CommandAnswer, Owner};
use vfd_gateway::domain::ids::{AskerId, DriveIndex, Name};
use vfd_gateway::domain::native::NativeAnswer;
use vfd_gateway::domain::time::{MonoTime, WallTime};
use vfd_gateway::drive::description::DriveRef;
use vfd_gateway::drive::view::TripEvent;
use vfd_gateway::gateway::LineInput;
use vfd_gateway::north::broker::{
    BrokerEvent, BrokerLimits, BrokerMessage, BrokerSession, MqttVersion, Publication, Qos,
    SessionAct, SessionLine, ToLine,
};
use vfd_gateway::north::clock::ClockMoment;
use vfd_gateway::north::mqtt::{GatewayIdentity, LeaseMode, MqttSession, Settings, TopicTree};

/// The wall clock at the start of a world.
const WALL_MS: i64 = 1_767_225_600_000;
/// How often the session reads the views without being woken.
const LOOK_EVERY: Duration = Duration::from_secs(2);

/// A message under way to the session.
#[derive(Debug)]
pub(super) enum Coming {
    Connected,
    Granted(usize),
    Acknowledged(u64),
    Message {
        topic: String,
        payload: String,
        retain: bool,
        duplicate: bool,
        issued: MonoTime,
    },
}

/// The session with its broker.
pub struct MqttSide {
    pub(super) session: MqttSession,
    pub wake_at: MonoTime,
    pub(super) coming: Vec<(MonoTime, Coming)>,
    pub(super) is_connected: bool,
    /// The broker delivers what is published.
    is_subscribed: bool,
    pub message_at: MonoTime,
    outage_at: MonoTime,
    lines: Vec<SessionLine>,
    last_id: u64,
    /// The last command with an id, and epochs as they were shown.
    last: Option<(String, String, MonoTime)>,
    epochs: Vec<u64>,
    /// The path stalls: messages in both directions are held until then.
    pub(super) stall_at: MonoTime,
    pub(super) held: (MonoTime, MonoTime),
    /// How far the gateway's wall clock is ahead, when that changes next, and how far that of the clients is, in ms.
    pub(super) ahead: i64,
    pub(super) clock_at: MonoTime,
    pub(super) commanders_ahead: i64,
}

impl MqttSide {
    pub fn new(world: &World) -> Self {
        let settings = Settings {
            prefix: "vfd".into(),
            version: MqttVersion::V5,
            heartbeat: Duration::from_secs(60),
            lease: LeaseMode::Session,
            alive_topic: Some("home/status".into()),
            subscription_qos: Qos::AtLeastOnce,
            probe_interval: Duration::from_secs(1),
            probe_timeout: Duration::from_secs(3),
            command_ttl: Duration::from_secs(1),
            response_prefix: None,
            keep_telemetry: 0,
            publish: TopicTree::ALL.to_vec(),
            home_assistant: None,
        };
        let name = Name::new("line").expect("a name");
        let gateway = GatewayIdentity {
            name: Name::new("plant").expect("a name"),
            standby: None,
        };
        let session = MqttSession::new(
            (gateway, settings),
            world.descriptions.clone(),
            vec![name],
            moment(world.now, 0),
            1,
        );
        let from = world.now + Duration::from_secs(8);
        let first = |extra| {
            if world.plan.extras.has(extra) {
                from
            } else {
                MonoTime::NEVER
            }
        };
        Self {
            session,
            wake_at: world.now,
            coming: vec![(world.now, Coming::Connected)],
            is_connected: false,
            is_subscribed: false,
            message_at: world.now + Duration::from_secs(6),
            outage_at: world.now + Duration::from_secs(60),
            lines: Vec::new(),
            last_id: 0,
            last: None,
            epochs: vec![0; world.descriptions.len()],
            stall_at: first(Extra::BrokerStalls),
            held: (MonoTime::ZERO, MonoTime::ZERO),
            ahead: 0,
            clock_at: first(Extra::Clocks),
            commanders_ahead: 0,
        }
    }

    fn put(&mut self, at: MonoTime, coming: Coming) {
        let at = at.max(self.held.0);
        let place = self.coming.partition_point(|(other, _)| *other <= at);
        self.coming.insert(place, (at, coming));
    }

    fn lose(&mut self, now: MonoTime, back_in: Duration) {
        self.session
            .handle(moment(now, self.ahead), BrokerEvent::Lost);
        self.is_connected = false;
        self.is_subscribed = false;
        self.coming.clear();
        self.put(now + back_in, Coming::Connected);
    }
}

const fn wall_ms(now: MonoTime) -> i64 {
    WALL_MS + (now.as_nanos() / 1_000_000) as i64
}

pub(super) const fn moment(now: MonoTime, ahead: i64) -> ClockMoment {
    ClockMoment {
        mono: now,
        wall: WallTime {
            unix_ms: wall_ms(now) + ahead,
        },
    }
}

impl World {
    /// Runs the MQTT side, if it is due.
    pub fn mqtt_turn(&mut self) {
        let Some(mut side) = self.mqtt.take() else {
            return;
        };
        if side.wake_at <= self.now {
            self.broker_turn(&mut side);
            side.session.tick(moment(self.now, side.ahead));
            self.pump(&mut side);
            let session = side.session.next_wake().unwrap_or(MonoTime::NEVER);
            let coming = side.coming.first().map_or(MonoTime::NEVER, |(at, _)| *at);
            let own = side
                .message_at
                .min(side.outage_at)
                .min(side.stall_at)
                .min(side.clock_at)
                .min(self.now + LOOK_EVERY);
            side.wake_at = session
                .min(coming)
                .min(own)
                .max(self.now + Duration::from_micros(10));
        }
        self.mqtt = Some(side);
    }

    /// Whether the broker delivers what is published.
    pub fn is_subscribed(&self) -> bool {
        self.mqtt.as_ref().is_some_and(|side| side.is_subscribed)
    }

    /// The wall clock, in ms.
    pub fn wall(&self) -> i64 {
        wall_ms(self.now)
    }

    /// A message for the first drive is delivered now.
    pub fn deliver(&mut self, input: &str, payload: &str, retain: bool, duplicate: bool) {
        let Some(mut side) = self.mqtt.take() else {
            return;
        };
        let topic = format!("vfd/plant/drive/d0/{input}");
        let issued = self.now;
        self.comes(
            &mut side,
            Coming::Message {
                topic,
                payload: payload.to_owned(),
                retain,
                duplicate,
                issued,
            },
        );
        side.wake_at = self.now;
        self.mqtt = Some(side);
    }

    /// The actions of clients and the broker.
    fn broker_turn(&mut self, side: &mut MqttSide) {
        if side.outage_at <= self.now {
            side.outage_at = self.now + self.about(Duration::from_secs(120));
            self.checker
                .note(self.now.as_nanos(), 0, "the broker is lost");
            let back_in = self.about(Duration::from_secs(6));
            side.lose(self.now, back_in);
        }
        self.spoil_the_way(side);
        self.command(side);
        while side.coming.first().is_some_and(|(at, _)| *at <= self.now) {
            let (_, coming) = side.coming.remove(0);
            self.comes(side, coming);
        }
    }

    /// Clients behind the broker do what is due.
    fn command(&mut self, side: &mut MqttSide) {
        if side.message_at <= self.now {
            side.message_at = self.now + self.about(self.plan.ask_every * 3);
            if self.may_write && side.is_subscribed {
                let message = self.draw_message(side);
                side.put(self.now, message);
            }
        }
    }

    /// The same while the gateway is suspended.
    pub fn commanders_act(&mut self) {
        let Some(mut side) = self.mqtt.take() else {
            return;
        };
        self.command(&mut side);
        self.mqtt = Some(side);
    }

    fn comes(&mut self, side: &mut MqttSide, coming: Coming) {
        let at = moment(self.now, side.ahead);
        match coming {
            Coming::Connected => {
                side.is_connected = true;
                let broker = BrokerLimits {
                    maximum_packet_bytes: None,
                    retains: true,
                };
                side.session.handle(at, BrokerEvent::Connected(broker));
            }
            Coming::Granted(filters) => {
                side.is_subscribed = true;
                self.checker.broker_opened(self.now.as_nanos());
                side.session
                    .handle(at, BrokerEvent::Subscribed(vec![true; filters]));
            }
            Coming::Acknowledged(token) => {
                side.session.handle(at, BrokerEvent::Acknowledged(token))
            }
            Coming::Message {
                topic,
                payload,
                retain,
                duplicate,
                issued,
            } => {
                self.tally.messages += 1;
                let wall_ms = (wall_ms(self.now) + side.ahead).unsigned_abs();
                let issued = issued.as_nanos();
                let inbound = Inbound {
                    topic: &topic,
                    payload: &payload,
                    retain,
                    duplicate,
                    wall_ms,
                    issued,
                };
                self.checker.message(self.now.as_nanos(), inbound);
                let payload = payload.as_bytes();
                let message = BrokerMessage {
                    topic: &topic,
                    payload,
                    retain,
                    duplicate,
                    expiry: None,
                    response_topic: None,
                    correlation: None,
                };
                side.session.handle(at, BrokerEvent::Message(message));
                self.pass_inward(side);
            }
        }
    }

    fn draw_message(&mut self, side: &mut MqttSide) -> Coming {
        let rng = &mut self.rng;
        let drive = rng.usize(0..self.plan.line.drives.len());
        let word = ["forward", "reverse", "stop", "Stop ", "coast", "start", ""][rng.usize(0..7)];
        let hertz = rng.u16(300..6_000) / 10;
        let frequency = format!("{}.{}", hertz / 10, hertz % 10);
        let retain = rng.u8(0..12) == 0;
        let duplicate = rng.u8(0..12) == 0;
        let to = |input: &str| format!("vfd/plant/drive/d{drive}/{input}");
        let (topic, payload) = match rng.u8(0..20) {
            0..3 => (to("run/set"), word.to_owned()),
            3..6 => (to("run/set"), "stop".to_owned()),
            6..8 => (to("frequency/set"), frequency),
            8 => (to("trip/reset"), "reset".to_owned()),
            9 => (to("lease"), String::new()),
            10 => ("vfd/plant/all/run/set".to_owned(), "stop".to_owned()),
            11 => (
                "home/status".to_owned(),
                ["online", "offline"][rng.usize(0..2)].to_owned(),
            ),
            12 => (to("param/D001/get"), String::new()),
            13 if let Some((topic, payload, issued)) = side.last.clone() => {
                // A replay without a timestamp is recognised by its id alone, if the first one ever arrived.
                let issued = if payload.contains("issued_at") {
                    issued
                } else {
                    self.now
                };
                return Coming::Message {
                    topic,
                    payload,
                    retain,
                    duplicate,
                    issued,
                };
            }
            _ => {
                side.last_id += 1;
                let mut payload =
                    format!("{{\"id\":\"o{}\",\"run\":\"{}\"", side.last_id, word.trim());
                let wall = wall_ms(self.now) + side.commanders_ahead;
                if self.plan.extras.has(Extra::Clocks) && rng.u8(0..3) == 0 {
                    // Recognised by its timestamp alone.
                    payload = format!("{{\"issued_at\":{wall},\"run\":\"{}\"}}", word.trim());
                    side.last = Some((to("command"), payload.clone(), self.now));
                    let topic = to("command");
                    return Coming::Message {
                        topic,
                        payload,
                        retain: false,
                        duplicate: false,
                        issued: self.now,
                    };
                }
                if rng.u8(0..4) > 0 {
                    payload += &format!(",\"frequency_hz\":{frequency}");
                }
                match rng.u8(0..5) {
                    0 => payload += &format!(",\"ttl_ms\":{}", rng.u16(50..3_000)),
                    1 => payload += &format!(",\"issued_at\":{}", wall - rng.i64(0..3_000)),
                    // Now and then with an epoch that was shown a while ago.
                    2 | 3 => payload += &format!(",\"epoch\":{}", side.epochs[drive]),
                    _ => {}
                }
                payload += "}";
                side.last = Some((to("command"), payload.clone(), self.now));
                (to("command"), payload)
            }
        };
        Coming::Message {
            topic,
            payload,
            retain,
            duplicate,
            issued: self.now,
        }
    }

    /// Executes all acts of the session.
    fn pump(&mut self, side: &mut MqttSide) {
        self.look_at_views();
        side.lines.clear();
        side.lines.push(SessionLine {
            name: Name::new("line").expect("a name"),
            report: self.core.report(),
            stations: Vec::new(),
        });
        self.pass_inward(side);
        if !side.is_connected {
            return;
        }
        while let Some(act) =
            side.session
                .next_act(moment(self.now, side.ahead), &self.views, &side.lines)
        {
            match act {
                SessionAct::Subscribe(filters) => side.put(
                    self.now + Duration::from_millis(3),
                    Coming::Granted(filters.len()),
                ),
                SessionAct::Publish(publication) => self.publish(side, publication),
                SessionAct::Reconnect(_) => return side.lose(self.now, Duration::from_secs(1)),
                inward => self.inward(inward),
            }
        }
    }

    fn publish(&mut self, side: &mut MqttSide, it: Publication) {
        let payload = String::from_utf8(it.payload).unwrap_or_default();
        self.checker
            .published(self.now.as_nanos(), &it.topic, &payload);
        let back_at = self.now.max(side.held.1) + Duration::from_millis(self.rng.u64(1..40));
        if let Some(token) = it.token {
            side.put(back_at, Coming::Acknowledged(token));
        }
        if it.topic.ends_with("/probe") && side.is_subscribed {
            let issued = self.now;
            side.put(
                back_at,
                Coming::Message {
                    topic: it.topic,
                    payload,
                    retain: false,
                    duplicate: false,
                    issued,
                },
            );
        } else if it.topic.ends_with("/state")
            && let Some(drive) = it
                .topic
                .bytes()
                .rev()
                .nth(6)
                .map(|digit| usize::from(digit - b'0'))
            && let Some((_, rest)) = payload.split_once("\"epoch\":")
            && self.rng.u8(0..4) > 0
        {
            let digits = rest
                .split([',', '}'])
                .next()
                .and_then(|digits| digits.parse().ok());
            if let (Some(epoch), Some(shown)) = (digits, side.epochs.get_mut(drive)) {
                *shown = epoch;
            }
        }
    }

    fn pass_inward(&mut self, side: &mut MqttSide) {
        while let Some(act) = side.session.next_inward() {
            self.inward(act);
        }
    }

    fn inward(&mut self, act: SessionAct) {
        match act {
            SessionAct::ToLine(ToLine::Command(_, command)) => {
                self.core.handle(self.now, LineInput::Command(command))
            }
            SessionAct::ToLine(ToLine::Read(_, request)) => {
                self.core.handle(self.now, LineInput::Native(request))
            }
            SessionAct::ToLine(ToLine::PathAlive) => self
                .core
                .handle(self.now, LineInput::PathAlive(Owner::Mqtt)),
            SessionAct::ToLine(ToLine::PathOpened) => self
                .core
                .handle(self.now, LineInput::PathOpened(Owner::Mqtt)),
            SessionAct::Subscribe(_) | SessionAct::Publish(_) => {}
            SessionAct::Reconnect(_) | SessionAct::Leave(_) => {}
            SessionAct::Keep(..) | SessionAct::EventTaken(_) | SessionAct::WantEvents { .. } => {}
        }
    }

    /// The line reports on a command.
    pub fn mqtt_hears(&mut self, answer: &CommandAnswer) {
        let (now, Some(side)) = (
            self.now,
            self.mqtt.as_mut().filter(|_| answer.asker == AskerId::MQTT),
        ) else {
            return;
        };
        side.session.command_answer(moment(now, side.ahead), answer);
        side.wake_at = now;
        self.mqtt_turn();
    }

    /// The line answers a read.
    pub fn mqtt_reads(&mut self, answer: &NativeAnswer) {
        let (now, Some(side)) = (
            self.now,
            self.mqtt.as_mut().filter(|_| answer.asker == AskerId::MQTT),
        ) else {
            return;
        };
        side.session.native_answer(moment(now, side.ahead), answer);
        side.wake_at = now;
    }

    /// A drive has tripped, or its trip was cleared.
    pub fn mqtt_trip(&mut self, drive: DriveIndex, event: &TripEvent) {
        let (now, Some(side)) = (self.now, self.mqtt.as_mut()) else {
            return;
        };
        side.session
            .trip(moment(now, side.ahead), DriveRef { line: 0, drive }, event);
        side.wake_at = now;
    }
}
