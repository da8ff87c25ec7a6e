//! The order in force, to run or to stop, and what the drive obeys of it.

use crate::domain::command::{Direction, RunIntent};

/// The last accepted order to run or to stop.
#[derive(Debug)]
pub(super) struct RunOrder {
    intent: RunIntent,
    /// Whether the drive has acknowledged the intent. Until then an equal order counts as new.
    is_acknowledged: bool,
    /// The direction in which the drive was last ordered to run, and whether it acknowledged that or only may have
    /// accepted it; `None` once the order has ended.
    obeyed: Option<(Direction, bool)>,
    /// The last ordered direction, in force or not, or the one that the motor showed since: it may still turn.
    turned: Option<Direction>,
    stops: u64,
    /// The last stop has taken effect, and still holds.
    stop_took_effect: bool,
    /// Control was released, and nothing has been ordered since.
    is_released: bool,
}

impl RunOrder {
    /// Nothing was ordered yet.
    pub const fn none() -> Self {
        Self {
            intent: RunIntent::Stop,
            is_acknowledged: false,
            obeyed: None,
            turned: None,
            stops: 0,
            stop_took_effect: false,
            is_released: false,
        }
    }

    pub const fn intent(&self) -> RunIntent {
        self.intent
    }

    pub const fn is_to_run(&self) -> bool {
        matches!(self.intent, RunIntent::Run(_))
    }

    pub const fn is_acknowledged(&self) -> bool {
        self.is_acknowledged
    }

    /// Whether the drive has acknowledged the order in force, and it is to run in `direction`.
    pub fn runs_in(&self, direction: Direction) -> bool {
        self.is_acknowledged && self.intent == RunIntent::Run(direction)
    }

    pub const fn may_be_obeyed(&self) -> bool {
        self.obeyed.is_some()
    }

    pub const fn last_direction(&self) -> Option<Direction> {
        self.turned
    }

    /// The number of stops so far.
    pub const fn stops(&self) -> u64 {
        self.stops
    }

    pub const fn stop_took_effect(&self) -> bool {
        self.stop_took_effect
    }

    pub const fn is_released(&self) -> bool {
        self.is_released
    }

    /// An order to run in `direction` is accepted.
    pub const fn run(&mut self, direction: Direction) {
        self.is_released = false;
        self.stop_took_effect = false;
        self.intent = RunIntent::Run(direction);
        self.turned = Some(direction);
        self.is_acknowledged = false;
    }

    /// A stop is accepted: all earlier approvals are void.
    pub const fn stop(&mut self, coast: bool) {
        self.is_released = false;
        self.stops += 1;
        self.end();
        self.intent = if coast {
            RunIntent::Coast
        } else {
            RunIntent::Stop
        };
    }

    /// The order ends without one that follows.
    pub const fn end(&mut self) {
        self.stop_took_effect = false;
        self.intent = RunIntent::Stop;
        self.is_acknowledged = false;
        self.obeyed = None;
    }

    /// Control was returned to panel or terminals.
    pub const fn release(&mut self) {
        self.end();
        self.is_released = true;
    }

    /// The drive obeys an order to run in `direction` that was not given here.
    pub const fn runs_already(&mut self, direction: Direction) {
        self.intent = RunIntent::Run(direction);
        self.is_acknowledged = true;
        self.obeyed = Some((direction, true));
        self.turned = Some(direction);
    }

    /// The motor turns or turned in `direction`, if that is known, by whatever order.
    pub fn turns(&mut self, direction: Option<Direction>) {
        self.turned = direction.or(self.turned);
    }

    /// The drive acknowledged the order to run in `direction`.
    pub fn was_acknowledged(&mut self, direction: Direction) {
        if let RunIntent::Run(ordered) = self.intent {
            self.obeyed = Some((direction, true));
            self.is_acknowledged = ordered == direction;
        }
    }

    /// The order to run in `direction` was sent but not answered.
    pub const fn is_unknown(&mut self, direction: Direction) {
        if self.is_to_run() {
            self.obeyed = Some((direction, false));
        }
    }

    /// The order to run in `direction` was never sent, or the drive refused it. It is replaced by an older one that is
    /// still to be sent, or else by what the drive obeys: a motor that turns by our order is never shown as stopped.
    pub fn failed(&mut self, direction: Direction, still_ordered: Option<Direction>) {
        if self.intent != RunIntent::Run(direction) || self.is_acknowledged {
            return;
        }
        let stands = still_ordered.or(self.obeyed.map(|(direction, _)| direction));
        self.intent = stands.map_or(RunIntent::Stop, RunIntent::Run);
        self.is_acknowledged =
            still_ordered.is_none() && self.obeyed.is_some_and(|(_, is_sure)| is_sure);
        self.turned = stands.or(self.turned);
    }

    /// The last stop has taken effect.
    pub const fn stop_was_effective(&mut self) {
        self.stop_took_effect = true;
    }

    /// The stop that is in force has not taken effect after all. Returns whether it cuts the output off; `None` if no stop
    /// is in force.
    pub const fn stop_again(&mut self) -> Option<bool> {
        let coast = match self.intent {
            RunIntent::Stop => false,
            RunIntent::Coast => true,
            RunIntent::Run(_) => return None,
        };
        self.stop_took_effect = false;
        Some(coast)
    }
}
