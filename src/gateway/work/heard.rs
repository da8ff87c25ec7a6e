//! What another gateway of the line orders the drive to do, as heard on the line, and what follows when that gateway is
//! lost.

use super::heard_order::HeardOrder;
use super::{DriveWork, Out};
use crate::domain::command::{Direction, Go, Order, Outcome, Reason, Report, RunIntent};
use crate::domain::time::MonoTime;
use crate::gateway::event::Effect;
use crate::gateway::note::Note;
use crate::profile::model::Flag;

impl DriveWork {
    /// Another gateway sent `order` to the drive at `at`.
    pub fn heard(&mut self, order: &Order, at: MonoTime, out: Out<'_>) {
        let heard = match order {
            Order::Go(go) => match Go::run(go) {
                Some(direction) => HeardOrder::Run(direction, at),
                None => return,
            },
            Order::Stop { .. } => HeardOrder::Stop { coast: false },
            Order::Coast => HeardOrder::Stop { coast: true },
            Order::Release => HeardOrder::Nothing,
            Order::Reset | Order::EndReset | Order::Take | Order::Renew | Order::Setup(_) => return,
        };
        self.heard = heard;
        self.has_changed = true;
        if let HeardOrder::Run(..) = heard {
            // A stop that waits here is older than this order.
            self.drop_stop(Report::new(Outcome::Unknown, Reason::Standby), out);
        }
    }

    /// The drive stands still: a stop that was heard has taken effect, and what starts it next is another order.
    pub(super) fn heard_stop_is_over(&mut self) {
        if matches!(self.heard, HeardOrder::Stop { .. }) {
            self.heard = HeardOrder::Nothing;
        }
    }

    /// The order in force, by whichever gateway.
    pub(super) fn ordered(&self) -> RunIntent {
        match self.heard {
            HeardOrder::Nothing => self.guard.intent(),
            HeardOrder::Run(direction, _) => RunIntent::Run(direction),
            HeardOrder::Stop { coast: false } => RunIntent::Stop,
            HeardOrder::Stop { coast: true } => RunIntent::Coast,
        }
    }

    /// This gateway gives the line up at `now`, or its port is gone: control is no longer its own.
    pub fn give_up(&mut self, now: MonoTime, out: Out<'_>) {
        // Its own order stands like one that was heard.
        self.heard = match self.guard.intent() {
            RunIntent::Run(direction) => HeardOrder::Run(direction, now),
            RunIntent::Stop | RunIntent::Coast => HeardOrder::Nothing,
        };
        self.line_down(now, Reason::Standby, out);
        self.guard.give_up();
    }

    /// This gateway takes the line over at `now`: a drive that was seen ordered to run gets the declared action, and a stop
    /// that was heard without effect is repeated. Where the line was handed over on purpose, running drives go on.
    pub fn take_over(&mut self, now: MonoTime, was_handed_over: bool, out: Out<'_>) {
        let heard = std::mem::take(&mut self.heard);
        if self.guard.control().is_none() || self.latch.is_some() {
            return;
        }
        let is_local = self.status_view().is_local() == Some(true);
        let is_ordered = !is_local && (self.status.is_running() == Some(true) || self.output.is_active());
        let lost = match heard {
            HeardOrder::Stop { coast } if !self.is_at_standstill() => self.guard.repeat_stop(coast, now),
            HeardOrder::Run(direction, at) => {
                let is_newer = self.status_at.is_some_and(|status_at| status_at > at);
                let is_followed = !is_newer || self.status.is_running() != Some(false);
                self.guard.gateway_left(is_followed.then_some(direction), was_handed_over, now)
            }
            HeardOrder::Nothing if is_ordered => {
                self.guard.gateway_left(self.ordered_direction(), was_handed_over, now)
            }
            HeardOrder::Stop { .. } | HeardOrder::Nothing => None,
        };
        self.has_changed = true;
        if self.guard.is_adopted() {
            out.push_back(Effect::Note(self.drive, Note::Adopted));
        }
        if let Some(lost) = lost {
            out.push_back(Effect::Note(self.drive, Note::GatewayLost(lost.action)));
            self.fail_safe(lost, now, out);
        }
    }

    /// The gateway shuts down while it listens.
    pub const fn end(&mut self) {
        self.guard.end();
    }

    /// The direction in which the drive shows that it runs.
    fn ordered_direction(&self) -> Option<Direction> {
        let is_reverse = self.status.get(Flag::Reverse).filter(|_| self.status.is_running() == Some(true))?;
        Some(if is_reverse { Direction::Reverse } else { Direction::Forward })
    }
}
