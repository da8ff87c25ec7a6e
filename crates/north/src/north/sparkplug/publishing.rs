//! What the session publishes next, and what it keeps for later: births, deaths, data, history, each with its number.

use super::device::{DeviceMoment, SparkplugDevice, millis};
use super::node;
use super::payload::{PayloadMetric, SparkplugPayload};
use super::session::SparkplugSession;
use super::topics::{DeviceKind, MessageKind};
use crate::domain::time::MonoTime;
use crate::drive::view::DriveView;
use crate::north::broker::{Publication, Qos, SessionAct, SessionLine};
use std::sync::Arc;

/// Longest packet if the broker names no smaller limit.
const PACKET_MAX: usize = 256 * 1024;

impl SparkplugSession {
    pub(super) fn next_publication(
        &mut self,
        at: MonoTime,
        views: &[Arc<DriveView>],
        lines: &[SessionLine],
    ) -> Option<SessionAct> {
        if !self.may_publish() {
            self.record(at, views);
            return None;
        }
        if !self.is_born || self.rebirth_at.is_some_and(|due| due <= at) {
            return Some(self.node_birth(at, lines));
        }
        if let Some(publication) = self.next_of_presence(at, views) {
            return Some(publication);
        }
        if let Some(payload) = self.link.path.take_probe(at) {
            // It must wait wherever a command waits, so it has to be in the same queue of the broker.
            return Some(SessionAct::Publish(Publication {
                qos: Qos::AtLeastOnce,
                ..Publication::new(self.topics.probe(), payload)
            }));
        }
        if self.rebirth_at.is_some() {
            // No data once births are requested; what changes until they are due is not lost.
            self.record(at, views);
            return None;
        }
        let changed = self.node.data(millis(self.link.clock, at), lines);
        if !changed.is_empty() {
            return self.publish(at, self.topics.node(MessageKind::Data), changed);
        }
        let data = self.next_of_devices(at, views, |device, now, probes| device.data(now, probes));
        // The last one taken may need as much room again.
        let room_bytes = self.packet_bytes_max() / 2;
        data.or_else(|| {
            self.next_of_devices(at, views, |device, _, probes| {
                device.past(probes, room_bytes)
            })
        })
    }

    /// NBIRTH, with which everything starts over.
    fn node_birth(&mut self, at: MonoTime, lines: &[SessionLine]) -> SessionAct {
        let stops = self
            .drives
            .iter()
            .any(|drive| drive.control.as_ref().is_some_and(|it| it.from_sparkplug));
        let at_ms = millis(self.link.clock, at);
        let bdseq = node::bdseq(self.bdseq, at_ms);
        let metrics = self.node.birth(bdseq, at_ms, lines, stops);
        self.seq = 0;
        self.rebirth_at = None;
        self.born_at = at;
        self.place = 0;
        for device in &mut self.devices {
            device.is_born = false;
        }
        if !self.is_born {
            self.link.path.probe_from(at);
        }
        self.counters.births += 1;
        let act = self.publish(at, self.topics.node(MessageKind::Birth), metrics);
        self.is_born = act.is_some();
        self.is_known |= self.is_born;
        act.unwrap_or(SessionAct::Reconnect(
            "the broker takes no packet as large as NBIRTH",
        ))
    }

    /// The next birth or death of a device.
    fn next_of_presence(&mut self, at: MonoTime, views: &[Arc<DriveView>]) -> Option<SessionAct> {
        for (place, view) in (0..self.devices.len()).zip(views) {
            let is_online = view.is_online() && self.listens.get(place) != Some(&true);
            let device = &mut self.devices[place];
            if is_online == device.is_born || device.is_too_large {
                continue;
            }
            let drive = &self.drives[place];
            if !is_online {
                device.is_born = false;
                let topic = self.topics.device(DeviceKind::Death, &drive.name);
                return self.publish(at, topic, Vec::new());
            }
            let now = DeviceMoment {
                at,
                clock: self.link.clock,
                drive,
                view,
            };
            let metrics = device.birth(&now);
            let topic = self.topics.device(DeviceKind::Birth, &drive.name);
            let act = self.publish(at, topic, metrics);
            if act.is_none() {
                let device = &mut self.devices[place];
                device.is_born = false;
                device.is_too_large = true;
                continue;
            }
            return act;
        }
        None
    }

    /// The next data of any device that is born, each in its turn.
    fn next_of_devices(
        &mut self,
        at: MonoTime,
        views: &[Arc<DriveView>],
        data: impl Fn(&mut SparkplugDevice, &DeviceMoment<'_>, u64) -> Vec<PayloadMetric>,
    ) -> Option<SessionAct> {
        let probes = self.link.path.sent();
        for _ in 0..self.devices.len() {
            let place = self.place;
            self.place = (self.place + 1) % self.devices.len();
            let (Some(view), device, drive) = (
                views.get(place),
                &mut self.devices[place],
                &self.drives[place],
            ) else {
                continue;
            };
            if !device.is_born {
                continue;
            }
            let metrics = data(
                device,
                &DeviceMoment {
                    at,
                    clock: self.link.clock,
                    drive,
                    view,
                },
                probes,
            );
            if metrics.is_empty() {
                continue;
            }
            let act = self.publish(
                at,
                self.topics.device(DeviceKind::Data, &drive.name),
                metrics,
            );
            if act.is_some() {
                return act;
            }
        }
        None
    }

    /// Keeps what happens while no host can be reached.
    fn record(&mut self, at: MonoTime, views: &[Arc<DriveView>]) {
        for ((device, drive), view) in self.devices.iter_mut().zip(&self.drives).zip(views) {
            device.record(&DeviceMoment {
                at,
                clock: self.link.clock,
                drive,
                view,
            });
        }
    }

    /// A message with the next number; `None` if the broker accepts none as large, and then no number is used.
    fn publish(
        &mut self,
        at: MonoTime,
        topic: String,
        metrics: Vec<PayloadMetric>,
    ) -> Option<SessionAct> {
        let payload = SparkplugPayload {
            timestamp: Some(millis(self.link.clock, at)),
            metrics,
            seq: Some(self.seq.into()),
        };
        let publication = Publication::new(topic, payload.bytes());
        let (bytes, limit) = (packet_bytes(&publication), self.packet_bytes_max());
        if !self
            .link
            .oversized
            .admits(&publication.topic, bytes, Some(limit))
        {
            self.counters.too_large += 1;
            return None;
        }
        self.seq = self.seq.wrapping_add(1);
        self.counters.messages_out += 1;
        Some(SessionAct::Publish(publication))
    }

    fn packet_bytes_max(&self) -> usize {
        self.link
            .limits
            .maximum_packet_bytes
            .unwrap_or(PACKET_MAX)
            .min(PACKET_MAX)
    }

    pub(super) fn count_history(&mut self) {
        self.counters.host_awaited =
            u64::from(self.link.path.is_granted() && !self.host.is_there());
        self.counters.history_waiting = self
            .devices
            .iter()
            .map(|device| device.history.len() as u64)
            .sum();
        let dropped: u64 = self
            .devices
            .iter_mut()
            .map(|device| device.history.take_dropped())
            .sum();
        self.counters.history_dropped += dropped;
    }
}

/// No packet with this publication is larger.
fn packet_bytes(publication: &Publication) -> usize {
    const OTHER_BYTES: usize = 16;
    publication.topic.len() + publication.payload.len() + OTHER_BYTES
}
