//! Reports the traffic on the wire to watchers of the line only.

use super::event::LineEffect;
use super::outbox::EffectOutbox;
use crate::domain::time::MonoTime;
use crate::domain::traffic::{FramePurpose, TrafficKind, TrafficRecord};
use crate::line::exchange::HeardData;
use crate::line::timing::LineTiming;
use crate::line::transaction::LineWire;

/// What watchers of one line are shown.
#[derive(Debug)]
pub(super) struct TrafficWatch {
    tells: bool,
    /// The last data received that is already reported, because a frame of ours was sent after it.
    reported_ahead: usize,
}

impl TrafficWatch {
    /// Reports traffic if it `tells`.
    pub const fn new(tells: bool) -> Self {
        Self {
            tells,
            reported_ahead: 0,
        }
    }

    /// Sets whether traffic is reported.
    pub const fn tell(&mut self, tells: bool) {
        self.tells = tells;
    }

    /// Hands a `frame` of ours to the port at `now`, and reports it after what was received before it.
    pub fn transmit(
        &mut self,
        now: MonoTime,
        (frame, why): (Vec<u8>, FramePurpose),
        wire: &LineWire,
        timing: &LineTiming,
        effects: &mut EffectOutbox,
    ) {
        let record = self.tells.then(|| TrafficRecord {
            kind: TrafficKind::Request,
            why: Some(why),
            bytes: frame.clone(),
            begin: now,
            end: now + timing.on_wire(frame.len()),
        });
        // Watchers do not delay the frame.
        effects.push_back(LineEffect::Transmit(frame));
        let Some(record) = record else { return };
        let before = wire.heard().get(self.reported_ahead..).unwrap_or_default();
        self.reported_ahead += before.len();
        before
            .iter()
            .cloned()
            .map(traffic_effect)
            .chain([LineEffect::Traffic(record)])
            .for_each(|effect| effects.push_back(effect));
    }

    /// Reports what was `heard`, unless it was already reported before a frame of ours.
    pub fn tell_of(&mut self, heard: HeardData, effects: &mut EffectOutbox) {
        if self.reported_ahead > 0 {
            self.reported_ahead -= 1;
        } else if self.tells {
            effects.push_back(traffic_effect(heard));
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
