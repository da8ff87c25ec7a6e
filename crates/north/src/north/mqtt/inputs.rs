//! Messages from the broker: what each requests, and whether it is accepted.

use super::attempts;
use super::command_ids::IdState;
use super::dispatch::MqttAsker;
use super::home_assistant::DiscoveryPlant;
use super::payload::{self, InputCommand, InputRequest, RefusedCommand, short};
use super::results::ReplyTopic;
use super::session::MqttSession;
use super::topics::{DriveInput, InputAddress, MqttInbound};
use super::types::LeaseMode;
use crate::domain::command::{Order, Owner, Reason, Report};
use crate::domain::ids::{CommanderName, Name};
use crate::domain::problem::nearest;
use crate::journal::TriedWrite;
use crate::north::broker::{
    BrokerMessage, BrokerSession, MqttVersion, ReturnedProbe, SessionNotice, tried_by,
};
use crate::north::clock::ClockMoment;
use crate::north::command_words::{beside_a_stop, without_mark};

/// Why a command is refused while its time in transit is unknown.
const WAY_UNPROVEN: &str = "the gateway's probe through the broker is late, so the command may have waited: send it again with a new id";
/// The longest correlation data that is returned.
const CORRELATION_MAX_BYTES: usize = 1_024;

impl MqttSession {
    /// Takes a message. It gives at most one command, one for each drive if it is for all. A message that attempts a
    /// write and gives no command is kept as an attempt, once.
    pub(super) fn message(&mut self, at: ClockMoment, message: &BrokerMessage<'_>) {
        self.counters.messages_in += 1;
        let plant = DiscoveryPlant::of(
            &self.settings,
            &self.topics,
            &self.titles,
            &self.lines,
            &self.drives,
        );
        let is_discovery = plant.is_some_and(|plant| self.discovery.take(at.mono, message, &plant));
        match self.topics.parse(message.topic) {
            None => self.counters.ignored += u64::from(!is_discovery),
            Some(MqttInbound::Probe) => self.probe(at, message),
            Some(MqttInbound::Alive) => self.alive(message),
            Some(MqttInbound::AllRun) => self.all_run(at, message),
            Some(MqttInbound::Peer(topic)) => self.hear(at.mono, topic, message),
            Some(MqttInbound::Drive(place)) => self.drive_input(at, place, message),
        }
    }

    fn alive(&mut self, message: &BrokerMessage<'_>) {
        let says = std::str::from_utf8(without_mark(message.payload)).unwrap_or_default();
        let were_gone = self.clients_gone().is_some();
        self.are_commanders_gone = says.trim().eq_ignore_ascii_case("offline");
        let notice = match self.clients_gone() {
            Some(topic) if !were_gone => SessionNotice::ClientsGone(topic.to_owned()),
            None if were_gone => SessionNotice::ClientsBack,
            _ => return,
        };
        self.link.notify(notice);
    }

    fn probe(&mut self, at: ClockMoment, message: &BrokerMessage<'_>) {
        let was_open = self.link.path.is_open();
        if message.retain
            || self.link.path.returned(at.mono, message.payload) == ReturnedProbe::Foreign
        {
            return;
        }
        if !was_open {
            self.stored.opened();
            // What was known of other gateways on the connection before is forgotten.
            self.apply_roles(at.mono);
            self.announce(at.mono);
        }
        let is_alive = self.link.path.is_sign_of_life(at.mono) && !self.are_commanders_gone;
        if is_alive && self.settings.lease == LeaseMode::Session {
            self.link.commands.path_alive();
        }
    }

    fn all_run(&mut self, at: ClockMoment, message: &BrokerMessage<'_>) {
        if clears(message) {
            return;
        }
        let reply = self.reply_to(message);
        let asked = payload::read_all(message.payload).and_then(|()| self.live(message, true));
        let controlled: Vec<_> = (0..self.drives.len())
            .filter(|drive| self.drives[*drive].control.is_some())
            .collect();
        let is_another_asked = !self.half.leads();
        let mine: Vec<_> = controlled
            .iter()
            .copied()
            .filter(|drive| self.half.may_take(*drive, true))
            .collect();
        let refused = match asked {
            Err(refused) => refused,
            Ok(()) if controlled.is_empty() => RefusedCommand::plain(Reason::ReadOnly),
            Ok(()) => {
                for drive in mine {
                    let asker = MqttAsker {
                        by: Owner::Mqtt,
                        id: self.next_id(),
                        reply: reply.clone(),
                    };
                    self.give(
                        at,
                        drive,
                        asker,
                        InputCommand::plain(Order::Stop { setpoint: None }),
                        message,
                    );
                }
                return;
            }
        };
        if is_another_asked {
            return;
        }
        let refused = if message.retain {
            self.live(message, false).err().unwrap_or(refused)
        } else {
            refused
        };
        let asker = MqttAsker {
            by: Owner::Mqtt,
            id: self.next_id(),
            reply,
        };
        let tried = (!message.payload.is_empty())
            .then(|| attempts::text(self.topics.below(message.topic), message.payload));
        self.keep(None, Owner::Mqtt, tried, Report::refused(refused.reason));
        self.refuse(
            at,
            "all",
            self.topics.gateway("all/result"),
            &asker,
            &refused,
        );
    }

    fn drive_input(
        &mut self,
        at: ClockMoment,
        place: InputAddress<'_>,
        message: &BrokerMessage<'_>,
    ) {
        if clears(message) {
            return;
        }
        let Some(drive) = self
            .drives
            .iter()
            .position(|drive| drive.name.as_str() == place.drive)
        else {
            return self.unknown_drive(at, place, message);
        };
        let (id, asked) = payload::read(place.input, message.payload, &self.drives[drive].model);
        let is_a_stop = matches!(&asked, Ok(InputRequest::Order(wish)) if wish.order.is_stop());
        if !self.half.may_take(drive, is_a_stop) {
            return;
        }
        let tried = self.tried(place, &asked, message);
        let owner = owner(place);
        let by = *owner.as_ref().unwrap_or(&Owner::Mqtt);
        let (owner, asked) = match (owner, asked) {
            // A stop is carried out whatever else the message contains, in its topic too.
            (Err(refused), Ok(InputRequest::Order(wish))) if is_a_stop => (
                Ok(by),
                Ok(InputRequest::Order(InputCommand {
                    remark: Some(beside_a_stop(&refused)),
                    ..wish
                })),
            ),
            other => other,
        };
        let live = self.live(message, is_a_stop).and(owner.map(|_| ()));
        let taken = live
            .and(asked)
            .and_then(|asked| self.once(place.input, message, asked));
        let reply = self.reply_to(message);
        let asker = MqttAsker {
            by,
            id: id.unwrap_or_else(|| self.next_id()),
            reply,
        };
        match taken {
            Err(refused) => self.refuse_for(at, drive, &asker, &refused, tried),
            Ok(InputRequest::Read(register)) => self.read(at, drive, asker, register, message),
            Ok(InputRequest::Order(wish)) if is_a_stop => {
                self.give(at, drive, asker, wish, message)
            }
            Ok(InputRequest::Order(wish)) => self.order(at, drive, asker, wish, message),
        }
    }

    /// What a message attempts to write; `None` if it does not.
    fn tried(
        &self,
        place: InputAddress<'_>,
        asked: &Result<InputRequest, RefusedCommand>,
        message: &BrokerMessage<'_>,
    ) -> Option<TriedWrite> {
        match asked {
            Ok(InputRequest::Order(wish)) => tried_by(&wish.order),
            Ok(InputRequest::Read(_)) => None,
            Err(_) => attempts::of_text(place, self.topics.below(message.topic), message.payload),
        }
    }

    /// Refuses replays. With MQTT 5 none is delivered at subscribe, so a stop with the retain flag is a live one.
    fn live(&self, message: &BrokerMessage<'_>, is_a_stop: bool) -> Result<(), RefusedCommand> {
        let is_live = !message.retain || is_a_stop && self.settings.version == MqttVersion::V5;
        if is_live {
            Ok(())
        } else {
            Err(RefusedCommand::plain(Reason::Retained))
        }
    }

    /// Refuses repeats without an id by which they could be recognized.
    fn once(
        &self,
        input: DriveInput<'_>,
        message: &BrokerMessage<'_>,
        asked: InputRequest,
    ) -> Result<InputRequest, RefusedCommand> {
        let is_exempt = match &asked {
            InputRequest::Read(_) => input.only_reads(),
            InputRequest::Order(wish) => wish.id.is_some() || wish.order.is_stop(),
        };
        if message.duplicate && !is_exempt {
            return Err(RefusedCommand::new(
                Reason::Duplicate,
                "a repeat of a message without an id, which may be old",
            ));
        }
        Ok(asked)
    }

    fn unknown_drive(
        &mut self,
        at: ClockMoment,
        place: InputAddress<'_>,
        message: &BrokerMessage<'_>,
    ) {
        if !self.half.leads() {
            return;
        }
        let name = place.drive;
        let by = owner(place).unwrap_or(Owner::Mqtt);
        let near = nearest(name, self.drives.iter().map(|drive| drive.name.as_str()));
        let hint = near.map_or_else(String::new, |near| format!("; is it `{near}`?"));
        let unknown = RefusedCommand::new(
            Reason::UnknownDrive,
            format!("there is no drive `{name}`{hint}"),
        );
        let refused = self.live(message, false).err().unwrap_or(unknown);
        let tried = attempts::of_text(place, self.topics.below(message.topic), message.payload);
        self.keep(None, by, tried, Report::refused(refused.reason));
        if Name::new(name).is_none() {
            // There is no topic for an answer.
            self.counters.ignored += 1;
            return;
        }
        let asker = MqttAsker {
            by,
            id: self.next_id(),
            reply: self.reply_to(message),
        };
        let topic = self.topics.drive(name, "result");
        self.refuse(at, name, topic, &asker, &refused);
    }

    /// An order that is subject to deadline, ids and bounds.
    fn order(
        &mut self,
        at: ClockMoment,
        drive: usize,
        asker: MqttAsker,
        mut wish: InputCommand,
        message: &BrokerMessage<'_>,
    ) {
        let tried = tried_by(&wish.order);
        if wish.id.is_some() {
            let known =
                self.seen[drive].look(at.mono, (asker.by, &asker.id), &wish.order, wish.epoch);
            let refused = Report::refused(Reason::Duplicate);
            match known {
                IdState::New => {}
                IdState::UnderWay => {
                    self.counters.duplicates += 1;
                    return self.keep(Some(drive), asker.by, tried, refused);
                }
                IdState::Ended(report) => {
                    self.keep(Some(drive), asker.by, tried, refused);
                    return self.repeat(at, drive, &asker, &wish, report);
                }
                IdState::Other => {
                    return self.refuse_for(
                        at,
                        drive,
                        &asker,
                        &RefusedCommand::plain(Reason::Duplicate),
                        tried,
                    );
                }
            }
        }
        let dated = self.date(at, &mut wish);
        let has_room = self.link.commands.has_room_for_command();
        let queue_full = || RefusedCommand::plain(Reason::QueueFull);
        match dated.and_then(|()| has_room.then_some(()).ok_or_else(queue_full)) {
            Ok(()) => {
                self.remark_on_clients_gone(&mut wish);
                self.give(at, drive, asker, wish, message);
            }
            Err(refused) => {
                self.remember_refusal(at, drive, &asker, &wish, refused.reason);
                self.refuse_for(at, drive, &asker, &refused, tried);
            }
        }
    }

    /// A motor that is started while no client can keep its lease alive is stopped soon.
    fn remark_on_clients_gone(&self, wish: &mut InputCommand) {
        let starts = matches!(&wish.order, Order::Go(go) if go.run().is_some());
        if !starts {
            return;
        }
        let Some(topic) = self.clients_gone() else {
            return;
        };
        let gone = format!(
            "`{topic}` says that the clients of the broker are offline: the declared action is carried out after \
             `lost_after`, unless it says `online` by then"
        );
        wish.remark = Some(match &wish.remark {
            Some(remark) => format!("{remark}; {gone}"),
            None => gone,
        });
    }

    /// A refusal is final: the same message delivered again is answered with it and never executed.
    fn remember_refusal(
        &mut self,
        at: ClockMoment,
        drive: usize,
        asker: &MqttAsker,
        wish: &InputCommand,
        reason: Reason,
    ) {
        if wish.id.is_none() {
            return;
        }
        let by_id = (asker.by, asker.id.clone());
        self.seen[drive].add_refused(
            at.mono,
            by_id,
            wish.order.clone(),
            wish.epoch,
            Report::refused(reason),
        );
    }

    fn repeat(
        &mut self,
        at: ClockMoment,
        drive: usize,
        asker: &MqttAsker,
        wish: &InputCommand,
        report: Report,
    ) {
        self.counters.duplicates += 1;
        self.publish_again(at, drive, asker, &wish.order, report);
    }

    /// Determines when a command was issued, and refuses one that is or may be too old.
    fn date(&mut self, at: ClockMoment, wish: &mut InputCommand) -> Result<(), RefusedCommand> {
        let ttl = wish.ttl.unwrap_or(self.settings.command_ttl);
        let issue = wish
            .issued_at
            .map(|issued_at| self.link.issued.take(at, issued_at))
            .transpose()?;
        if self.link.path.is_unproven() {
            return Err(RefusedCommand::new(Reason::Stale, WAY_UNPROVEN));
        }
        let age = issue
            .as_ref()
            .map_or_else(|| self.link.path.may_have_waited(), |issue| issue.age);
        if age > ttl {
            return Err(RefusedCommand::plain(Reason::Stale));
        }
        if let Some(issue) = issue {
            wish.issued = Some(issue.moment);
            wish.remark = issue.remark;
        }
        Ok(())
    }

    /// Records an attempt that no line sees. `drive` is its place in the session's list.
    fn keep(
        &mut self,
        drive: Option<usize>,
        owner: Owner,
        tried: Option<TriedWrite>,
        report: Report,
    ) {
        let drive = drive.and_then(|drive| self.drives.get(drive));
        self.link.commands.keep_attempt(drive, owner, tried, report);
    }

    /// Refuses what was attempted on a drive, before it reaches a line.
    pub(super) fn refuse_for(
        &mut self,
        at: ClockMoment,
        drive: usize,
        asker: &MqttAsker,
        refused: &RefusedCommand,
        tried: Option<TriedWrite>,
    ) {
        self.keep(
            Some(drive),
            asker.by,
            tried,
            Report::refused(refused.reason),
        );
        let name = self.drives[drive].name.clone();
        let topic = self.topics.drive(name.as_str(), "result");
        self.refuse(at, name.as_str(), topic, asker, refused);
    }

    fn refuse(
        &mut self,
        at: ClockMoment,
        drive: &str,
        topic: String,
        asker: &MqttAsker,
        refused: &RefusedCommand,
    ) {
        self.counters.refused += 1;
        self.counters.refused_retained += u64::from(refused.reason == Reason::Retained);
        self.counters.duplicates += u64::from(refused.reason == Reason::Duplicate);
        self.publish_refusal(at, drive, topic, asker, refused);
    }

    /// The response topic of the request, if it is allowed.
    fn reply_to(&mut self, message: &BrokerMessage<'_>) -> Option<ReplyTopic> {
        if self.settings.version != MqttVersion::V5 {
            return None;
        }
        let topic = message.response_topic?;
        let allowed = self.settings.response_prefix.as_deref();
        let is_short = message
            .correlation
            .is_none_or(|it| it.len() <= CORRELATION_MAX_BYTES);
        if !is_short || !allowed.is_some_and(|allowed| self.topics.may_respond_to(topic, allowed)) {
            self.counters.responses_ignored += 1;
            return None;
        }
        Some(ReplyTopic {
            topic: topic.to_owned(),
            correlation: message.correlation.map(<[u8]>::to_vec),
        })
    }
}

/// Whether the message only clears a retained one.
const fn clears(message: &BrokerMessage<'_>) -> bool {
    message.retain && message.payload.is_empty()
}

/// The client that commands at `place`.
///
/// # Errors
/// The name in the topic is not a valid client name.
fn owner(place: InputAddress<'_>) -> Result<Owner, RefusedCommand> {
    let Some(by) = place.by else {
        return Ok(Owner::Mqtt);
    };
    CommanderName::new(by).map(Owner::MqttBy).ok_or_else(|| {
        let right = format!(
            "1 to {} letters, digits, `-`, `_` or `.`, not only dots",
            CommanderName::MAX_CHARS
        );
        RefusedCommand::new(
            Reason::NotUnderstood,
            format!(
                "`{}` is not a valid client name; expected {right}",
                short(by)
            ),
        )
    })
}
