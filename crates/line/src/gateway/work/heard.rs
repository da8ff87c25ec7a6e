//! What another gateway of the line orders the drive to do, as heard on the line, and what follows when that gateway is
//! lost.

use super::heard_order::{HeardOrder, UnsettledMotion};
use super::{DriveWork, Out};
use crate::domain::command::{Direction, GoOrder, Order, Outcome, Reason, Report, RunIntent};
use crate::domain::time::MonoTime;
use crate::gateway::event::LineEffect;
use crate::gateway::note::DriveNote;
use crate::gateway::stop::StopLatch;
use crate::guard::LossAction;
use crate::profile::model::IndicatedState;
use std::time::Duration;

/// How long a running drive is left alone after a take-over, if it may still show that it obeys its panel or terminals.
const SHOWS_PANEL_WITHIN: Duration = Duration::from_secs(1);

impl DriveWork {
    /// Another gateway sent `order` to the drive at `at`.
    pub fn heard(&mut self, order: &Order, at: MonoTime, out: Out<'_>) {
        let heard = match order {
            Order::Go(go) => match GoOrder::run(go) {
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
        if let HeardOrder::Run(direction, _) = heard {
            self.guard.turned_by_another(direction);
            // Newer than a stop answered from memory.
            self.answered = None;
        }
        let is_settled = self.latch.as_ref().is_some_and(StopLatch::is_acknowledged);
        if matches!(heard, HeardOrder::Run(..)) && is_settled {
            // The stop that waits here is older than this order.
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
            HeardOrder::Nothing | HeardOrder::Elsewhere => self.guard.intent(),
            HeardOrder::Run(direction, _) => RunIntent::Run(direction),
            HeardOrder::Stop { coast: false } => RunIntent::Stop,
            HeardOrder::Stop { coast: true } => RunIntent::Coast,
        }
    }

    /// This gateway gives the line up at `now`, or its port is gone: control is no longer its own.
    pub fn give_up(&mut self, now: MonoTime, out: Out<'_>) {
        // Its own order stands like one that was heard.
        let ordered = match self.guard.intent() {
            RunIntent::Run(direction) => Some(direction),
            RunIntent::Stop | RunIntent::Coast if self.may_run_on => self.guard.last_direction(),
            RunIntent::Stop | RunIntent::Coast => None,
        };
        let others = if self.is_moving() {
            HeardOrder::Elsewhere
        } else {
            HeardOrder::Nothing
        };
        self.heard = ordered.map_or(others, |direction| HeardOrder::Run(direction, now));
        self.may_run_on = false;
        self.unsettled = None;
        // The lease goes on: where no other gateway takes the line, its commander is lost in its own time.
        self.line_down(now, Reason::Standby, out);
        self.latch.iter_mut().for_each(StopLatch::line_given_up);
    }

    /// This gateway takes the line over at `now`: a drive that was heard or seen ordered to run gets the declared action,
    /// and a stop that was heard without effect is repeated. Where the line was handed over on purpose, running drives go
    /// on. What was not seen at standstill may run by an order that nobody remembers: its first readings decide.
    pub fn take_over(&mut self, now: MonoTime, goes_on: bool, out: Out<'_>) {
        let heard = std::mem::take(&mut self.heard);
        self.unsettled = None;
        self.guard.give_up();
        if self.guard.control().is_none() || self.latch.is_some() {
            return;
        }
        self.has_changed = true;
        match heard {
            HeardOrder::Stop { coast } if !self.stands() => {
                let lost = self.guard.repeat_stop(coast, now);
                self.gateway_left(lost, goes_on, now, out);
            }
            HeardOrder::Run(direction, at) => {
                let is_newer = self.status_at.is_some_and(|status_at| status_at > at);
                let is_followed = !is_newer || self.status.is_running() != Some(false);
                self.runs_on(is_followed.then_some(direction), goes_on, now, out);
            }
            HeardOrder::Elsewhere if goes_on => {}
            HeardOrder::Stop { .. } | HeardOrder::Nothing | HeardOrder::Elsewhere => {
                self.unsettled = Some(UnsettledMotion {
                    goes_on,
                    until: now + SHOWS_PANEL_WITHIN,
                });
                self.settle(now, out);
            }
        }
    }

    /// Decides what follows for a drive that may run by an order that nobody remembers, as soon as that can be seen. A drive
    /// that shows that it obeys its panel or terminals is left alone.
    pub(super) fn settle(&mut self, now: MonoTime, out: Out<'_>) {
        let Some(UnsettledMotion { goes_on, until }) = self.unsettled else {
            return;
        };
        let is_ordered_here =
            self.latch.is_some() || matches!(self.guard.intent(), RunIntent::Run(_));
        if is_ordered_here || self.stands() {
            self.unsettled = None;
            return;
        }
        let is_local = self.status_view().is_local();
        let may_show_it =
            is_local.is_none() && self.model.status_flag(IndicatedState::BusRun).is_some();
        if !self.is_moving() || (may_show_it && now < until) {
            return;
        }
        self.unsettled = None;
        if is_local != Some(true) {
            self.runs_on(self.ordered_direction(), goes_on, now, out);
        }
    }

    /// The active gateway tells at `at` by which order the drive runs; `None`: it was not started over the line.
    pub fn order_received(&mut self, order: Option<Direction>, at: MonoTime) {
        self.heard = order.map_or(HeardOrder::Elsewhere, |direction| {
            HeardOrder::Run(direction, at)
        });
        self.has_changed = true;
    }

    /// What is sent about the drive before the line is handed over: the order by which it runs, or that it was not
    /// started over the line. `None` if it does not run.
    #[must_use]
    pub fn order_to_tell(&self) -> Option<Option<Direction>> {
        self.guard.control()?;
        match self.guard.intent() {
            RunIntent::Run(direction) => Some(Some(direction)),
            RunIntent::Stop | RunIntent::Coast if self.is_stopping => None,
            RunIntent::Stop | RunIntent::Coast if self.may_run_on => {
                Some(self.guard.last_direction())
            }
            RunIntent::Stop | RunIntent::Coast => self.is_moving().then_some(None),
        }
    }

    /// Whether the drive runs, and this listener does not know by which order.
    #[must_use]
    pub fn lacks_order(&self) -> bool {
        let is_known =
            !matches!(self.heard, HeardOrder::Nothing) || self.ordered_direction().is_some();
        let runs = self.guard.control().is_some()
            && self.is_moving()
            && self.status_view().is_local() != Some(true);
        runs && self.latch.is_none() && !is_known
    }

    /// When [`Self::settle`] is due at the latest.
    pub(super) fn settles_at(&self) -> Option<MonoTime> {
        let unsettled = self.unsettled?;
        self.is_moving().then_some(unsettled.until)
    }

    /// The drive is ordered to run, in `direction` if that is known, and the gateway that ordered it is lost.
    fn runs_on(
        &mut self,
        direction: Option<Direction>,
        goes_on: bool,
        now: MonoTime,
        out: Out<'_>,
    ) {
        let lost = self.guard.gateway_left(direction, goes_on, now);
        self.gateway_left(lost, goes_on, now, out);
    }

    /// The gateway that had the line is lost, or gave it up on purpose (`was_given`).
    fn gateway_left(
        &mut self,
        lost: Option<LossAction>,
        was_given: bool,
        now: MonoTime,
        out: Out<'_>,
    ) {
        self.has_changed = true;
        if self.guard.is_adopted() {
            let note = if was_given {
                DriveNote::GoesOn
            } else {
                DriveNote::Adopted
            };
            out.push_back(LineEffect::Note(self.drive, note));
        }
        if let Some(lost) = lost {
            let note = if was_given {
                DriveNote::LineGiven(lost.action)
            } else {
                DriveNote::GatewayLost(lost.action)
            };
            out.push_back(LineEffect::Note(self.drive, note));
            self.fail_safe(lost, now, out);
        }
    }

    /// The gateway shuts down while it listens.
    pub const fn end(&mut self) {
        self.guard.end();
    }

    /// The direction in which the drive shows that it runs.
    fn ordered_direction(&self) -> Option<Direction> {
        if self.status.is_running() == Some(true) {
            self.shown_direction()
        } else {
            None
        }
    }
}
