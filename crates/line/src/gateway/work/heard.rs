//! Whose orders a drive may follow on a line with several gateways: what another one ordered, as heard there, and what this
//! one left.

use crate::domain::command::{Direction, GoOrder, Order, RunIntent};
use crate::domain::time::MonoTime;
use std::time::Duration;

/// How long a running drive is left alone after a take-over, if it may still show that it obeys its panel or terminals.
const SHOWS_PANEL_WITHIN: Duration = Duration::from_secs(1);

/// The last order that was heard on the line since this gateway listens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum HeardOrder {
    /// None.
    #[default]
    Nothing,
    /// To run, since this moment.
    Run(Direction, MonoTime),
    /// None: it runs, and was not started over the line, as the one that was active knows.
    Elsewhere,
    /// To stop, or to cut the output off.
    Stop { coast: bool },
}

/// What the drive does is not known although this gateway has taken the line: its first readings decide.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct UnsettledMotion {
    /// The line was handed over: a drive that runs goes on.
    pub goes_on: bool,
    /// Until this moment a reading is awaited that shows whether the drive obeys its panel.
    pub until: MonoTime,
}

/// The orders to one drive that others gave, and whether it may run on after this gateway has left it.
#[derive(Debug, Default)]
pub(super) struct HeardOrders {
    /// The last order of another gateway of the line.
    heard: HeardOrder,
    /// The drive was sent an order to run, and has since neither been seen at standstill without one nor stopped from here.
    may_run_on: bool,
    /// This gateway has taken the line, and does not know yet whether the drive is ordered to run.
    unsettled: Option<UnsettledMotion>,
}

impl HeardOrders {
    /// Another gateway sent `order` to the drive at `at`. Returns what it means, if it is about motion.
    pub fn take(&mut self, order: &Order, at: MonoTime) -> Option<HeardOrder> {
        self.heard = match order {
            Order::Go(go) => HeardOrder::Run(GoOrder::run(go)?, at),
            Order::Stop { .. } => HeardOrder::Stop { coast: false },
            Order::Coast => HeardOrder::Stop { coast: true },
            Order::Release => HeardOrder::Nothing,
            Order::Reset | Order::EndReset | Order::Take | Order::Renew | Order::Setup(_) => {
                return None;
            }
        };
        Some(self.heard)
    }

    /// The active gateway tells at `at` by which order the drive runs; `None`: it was not started over the line.
    pub fn receive(&mut self, order: Option<Direction>, at: MonoTime) {
        self.heard = order.map_or(HeardOrder::Elsewhere, |direction| {
            HeardOrder::Run(direction, at)
        });
    }

    pub const fn order(&self) -> HeardOrder {
        self.heard
    }

    /// The order in force, by whichever gateway; `own` is that of this one.
    pub const fn intent(&self, own: RunIntent) -> RunIntent {
        match self.heard {
            HeardOrder::Nothing | HeardOrder::Elsewhere => own,
            HeardOrder::Run(direction, _) => RunIntent::Run(direction),
            HeardOrder::Stop { coast: false } => RunIntent::Stop,
            HeardOrder::Stop { coast: true } => RunIntent::Coast,
        }
    }

    /// Whether the drive may run by an order that was sent from here.
    pub const fn may_run_on(&self) -> bool {
        self.may_run_on
    }

    /// The drive was sent an order to run.
    pub const fn run_was_sent(&mut self) {
        self.may_run_on = true;
    }

    /// A stop from here took effect.
    pub const fn stopped_from_here(&mut self) {
        self.may_run_on = false;
        self.heard = HeardOrder::Nothing;
    }

    /// The drive stands still: a stop that was heard has taken effect, and what starts it next is another order.
    pub const fn motor_stands(&mut self, is_ordered_to_run: bool) {
        if matches!(self.heard, HeardOrder::Stop { .. }) {
            self.heard = HeardOrder::Nothing;
        }
        self.may_run_on &= is_ordered_to_run;
    }

    /// This gateway gives the line up at `now`: its own order to run, `ordered`, stands like one that was heard.
    pub fn give_up(&mut self, ordered: Option<Direction>, is_moving: bool, now: MonoTime) {
        let others = if is_moving {
            HeardOrder::Elsewhere
        } else {
            HeardOrder::Nothing
        };
        self.heard = ordered.map_or(others, |direction| HeardOrder::Run(direction, now));
        self.may_run_on = false;
        self.unsettled = None;
    }

    /// This gateway takes the line. Returns what was heard.
    pub fn take_over(&mut self) -> HeardOrder {
        self.unsettled = None;
        std::mem::take(&mut self.heard)
    }

    /// The first readings decide what follows.
    pub fn await_readings(&mut self, goes_on: bool, now: MonoTime) {
        self.unsettled = Some(UnsettledMotion {
            goes_on,
            until: now + SHOWS_PANEL_WITHIN,
        });
    }

    pub const fn unsettled(&self) -> Option<UnsettledMotion> {
        self.unsettled
    }

    pub const fn settled(&mut self) {
        self.unsettled = None;
    }
}
