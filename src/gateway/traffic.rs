//! Reports the traffic on the wire to watchers of the line only.

use super::core::{ExchangePurpose, LineCore};
use super::event::LineEffect;
use super::work::WishRank;
use crate::domain::time::MonoTime;
use crate::domain::traffic::{FramePurpose, TrafficKind, TrafficRecord};
use crate::line::exchange::HeardData;

impl LineCore {
    /// Sets whether traffic is reported.
    pub const fn tell_traffic(&mut self, tells: bool) {
        self.tells_traffic = tells;
    }

    /// Reports a `frame` of ours, handed to the port at `now`, after what was received before it.
    pub(super) fn transmit(&mut self, now: MonoTime, frame: Vec<u8>, why: FramePurpose) {
        let record = self.tells_traffic.then(|| TrafficRecord {
            kind: TrafficKind::Request,
            why: Some(why),
            bytes: frame.clone(),
            begin: now,
            end: now + self.timing.on_wire(frame.len()),
        });
        // Watchers do not delay the frame.
        self.effects.push_back(LineEffect::Transmit(frame));
        let Some(record) = record else { return };
        let before = self.wire.heard().get(self.told_ahead..).unwrap_or_default();
        self.told_ahead += before.len();
        let before: Vec<_> = before.iter().cloned().map(traffic_effect).collect();
        before
            .into_iter()
            .chain([LineEffect::Traffic(record)])
            .for_each(|effect| self.effects.push_back(effect));
    }

    /// Reports what was `heard`, unless it was already reported before a frame of ours.
    pub(super) fn tell_of(&mut self, heard: HeardData) {
        if self.told_ahead > 0 {
            self.told_ahead -= 1;
        } else if self.tells_traffic {
            self.effects.push_back(traffic_effect(heard));
        }
    }
}

impl ExchangePurpose {
    pub(super) const fn why(&self) -> FramePurpose {
        match self {
            Self::Read(_) => FramePurpose::Client,
            Self::Work(WishRank::FirstStop | WishRank::RepeatedStop) => FramePurpose::Stop,
            Self::Work(WishRank::Trip) => FramePurpose::Trip,
            Self::Work(WishRank::Look | WishRank::Step | WishRank::Start) => FramePurpose::Command,
            Self::Poll { .. } => FramePurpose::Poll,
            Self::Barrier => FramePurpose::Barrier,
            Self::Probe => FramePurpose::Probe,
            Self::Trial(_) => FramePurpose::Trial,
        }
    }
}

fn traffic_effect(heard: HeardData) -> LineEffect {
    let HeardData {
        kind,
        bytes,
        begin,
        end,
    } = heard;
    LineEffect::Traffic(TrafficRecord {
        kind,
        why: None,
        bytes,
        begin,
        end,
    })
}
