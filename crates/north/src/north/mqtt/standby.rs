//! The session as one of several gateways of the same name: each receives what the others publish, and an event that
//! several have seen is published once.

use super::peer_events::EventMark;
use super::session::MqttSession;
use super::slot::RenderContext;
use super::telemetry::PublishedShare;
use super::topics::PeerTopic;
use crate::domain::command::{Outcome, Reason, Report};
use crate::domain::time::MonoTime;
use crate::north::broker::{BrokerMessage, DriveRequest, MqttVersion, PendingRequest, Publication};
use serde_json::{Map, Value};

impl MqttSession {
    /// Whether the partner reports that it is online; `None` without one, or while that cannot be known.
    pub(super) fn is_partner_online(&self) -> Option<bool> {
        if self.link.path.is_open() {
            self.half.is_partner_online()
        } else {
            None
        }
    }

    /// Publishes from now on what the present roles require: the lines and drives on which this gateway is active, and the
    /// gateway as a whole if it leads.
    pub(super) fn apply_roles(&mut self, at: MonoTime) {
        if self.half.pair().is_none() {
            return;
        }
        let (lines, drives) = self.half.published_places();
        let (is_led, is_silent) = (!self.half.leads(), !self.half.publishes_anything());
        self.telemetry.publish_for(PublishedShare {
            is_led,
            is_silent,
            lines: Some(lines),
            drives: Some(drives),
        });
        self.announce(at);
    }

    /// Announces to Home Assistant from now on if this gateway leads; otherwise no longer.
    pub(super) fn announce(&mut self, at: MonoTime) {
        let is_mine =
            self.link.path.is_open() && self.settings.home_assistant.is_some() && self.half.leads();
        if is_mine && !self.discovery.is_open() {
            self.discovery.opened(at);
        } else if !is_mine {
            self.discovery.lost();
        }
    }

    /// Takes what this or another gateway of the name has published.
    pub(super) fn hear(&mut self, at: MonoTime, topic: PeerTopic<'_>, message: &BrokerMessage<'_>) {
        match topic {
            PeerTopic::Status => {
                if message.payload == b"offline" {
                    self.half.published_offline(at);
                    self.telemetry.forget_status();
                    self.apply_roles(at);
                }
            }
            PeerTopic::Standby(half) => {
                if self.half.heard(half, message.payload) {
                    self.telemetry.forget_lines();
                }
                self.apply_roles(at);
            }
            PeerTopic::Event(drive) => self.hear_event(at, drive, message.payload),
            PeerTopic::Last(drive) => self.hear_last(drive, message.payload),
        }
        self.count_events();
    }

    fn hear_event(&mut self, at: MonoTime, drive: &str, payload: &[u8]) {
        let Ok(body) = serde_json::from_slice::<Map<String, Value>>(payload) else {
            return;
        };
        let session = body
            .get("session")
            .and_then(Value::as_str)
            .unwrap_or_default();
        let is_ours = session == self.run || self.stored.is_ours(session);
        if is_ours || !self.drives.iter().any(|it| it.name.as_str() == drive) {
            return;
        }
        let mark = EventMark::of(drive, &body);
        let is_it = |own: &EventMark| own.is_same(&mark);
        if !self.events.drop_published(is_it) && !self.stored.drop_published(is_it) {
            self.peer_events.remember(at, mark);
        }
    }

    /// What the broker has retained when this gateway connects. Later the events themselves are received.
    fn hear_last(&mut self, drive: &str, payload: &[u8]) {
        if self.link.path.is_open() || !self.drives.iter().any(|it| it.name.as_str() == drive) {
            return;
        }
        let Ok(record) = serde_json::from_slice::<Map<String, Value>>(payload) else {
            return;
        };
        let peer_events = &mut self.peer_events;
        peer_events.remember_last(drive, record);
        if !self.events.drop_published(|own| peer_events.take_last(own)) {
            self.stored.drop_published(|own| peer_events.take_last(own));
        }
    }

    /// Whether the event with this mark may be published now.
    pub(super) fn may_publish(&self, at: MonoTime, mark: &EventMark) -> bool {
        if self.half.pair().is_none() {
            return true;
        }
        let drive = self
            .drives
            .iter()
            .position(|it| it.name.as_str() == mark.drive());
        drive.map_or_else(
            || self.half.leads(),
            |drive| self.half.may_publish(at, drive),
        )
    }

    /// Whether `report` only means that another gateway is active. That gateway answers itself.
    pub(super) fn is_left_to_another<C>(
        &self,
        pending: &PendingRequest<C>,
        report: Report,
    ) -> bool {
        let is_untried =
            matches!(pending.request, DriveRequest::Read(_)) || report.outcome == Outcome::Refused;
        self.half.pair().is_some() && report.reason == Reason::Standby && is_untried
    }

    /// The next publication about this gateway as one of several.
    pub(super) fn next_of_standby(&mut self, at: MonoTime) -> Option<Publication> {
        let now = self.present(at);
        self.half.next(&now, &self.topics)
    }

    fn present(&self, at: MonoTime) -> RenderContext {
        let expires = self.settings.version == MqttVersion::V5;
        RenderContext {
            at,
            clock: self.link.clock,
            heartbeat: self.settings.heartbeat,
            expires,
        }
    }

    /// What one of several gateways publishes on an orderly end: the lines and drives that it publishes
    /// become unavailable. The gateway becomes offline only if no other one is active.
    pub(super) fn farewell_as_half(&self, at: MonoTime) -> Vec<Publication> {
        let goodbye = super::session::goodbye;
        let published = self
            .drives
            .iter()
            .enumerate()
            .filter(|(drive, _)| self.half.publishes_for(*drive));
        let drives = published
            .map(|(_, drive)| goodbye(self.topics.drive(drive.name.as_str(), "availability")));
        let is_last = self.half.publishes_anything() || !self.half.is_another_active();
        let status = is_last.then(|| goodbye(self.topics.gateway("status")));
        drives
            .chain(self.half.farewell(&self.present(at)))
            .chain(status)
            .collect()
    }
}
