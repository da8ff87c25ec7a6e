//! Reports the traffic on the wire to watchers of the line only.

use super::core::{LineCore, Purpose};
use super::event::Effect;
use super::work::Rank;
use crate::domain::time::MonoTime;
use crate::domain::traffic::{TrafficKind, TrafficRecord, Why};
use crate::line::exchange::Heard;

impl LineCore {
    /// Sets whether traffic is reported.
    pub const fn tell_traffic(&mut self, tells: bool) {
        self.tells_traffic = tells;
    }

    /// Reports a `frame` of ours, handed to the port at `now`, after what was received before it.
    pub(super) fn transmit(&mut self, now: MonoTime, frame: Vec<u8>, why: Why) {
        let record = self.tells_traffic.then(|| TrafficRecord {
            kind: TrafficKind::Request,
            why: Some(why),
            bytes: frame.clone(),
            begin: now,
            end: now + self.timing.on_wire(frame.len()),
        });
        // Watchers do not delay the frame.
        self.effects.push_back(Effect::Transmit(frame));
        let Some(record) = record else { return };
        let before = self.wire.heard().get(self.told_ahead..).unwrap_or_default();
        self.told_ahead += before.len();
        let before: Vec<_> = before.iter().cloned().map(told).collect();
        before
            .into_iter()
            .chain([Effect::Traffic(record)])
            .for_each(|effect| self.effects.push_back(effect));
    }

    /// Reports what was `heard`, unless it was already reported before a frame of ours.
    pub(super) fn tell_of(&mut self, heard: Heard) {
        if self.told_ahead > 0 {
            self.told_ahead -= 1;
        } else if self.tells_traffic {
            self.effects.push_back(told(heard));
        }
    }
}

impl Purpose {
    pub(super) const fn why(&self) -> Why {
        match self {
            Self::Read(_) => Why::Client,
            Self::Work(Rank::FirstStop | Rank::RepeatedStop) => Why::Stop,
            Self::Work(Rank::Trip) => Why::Trip,
            Self::Work(Rank::Look | Rank::Step | Rank::Start) => Why::Command,
            Self::Poll { .. } => Why::Poll,
            Self::Barrier => Why::Barrier,
            Self::Probe => Why::Probe,
            Self::Trial(_) => Why::Trial,
        }
    }
}

fn told(heard: Heard) -> Effect {
    let Heard {
        kind,
        bytes,
        begin,
        end,
    } = heard;
    Effect::Traffic(TrafficRecord {
        kind,
        why: None,
        bytes,
        begin,
        end,
    })
}
