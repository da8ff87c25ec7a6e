//! Whether the drive still follows its order to run. One that was seen running and then shows for a while that it neither
//! runs nor ramps was stopped elsewhere: by its panel, a terminal, another master, or a dip of its supply.

use super::follow_watch::FollowWatch;
use super::{DriveWork, Out};
use crate::domain::command::{
    Direction, GoOrder, Order, Outcome, Owner, Reason, Report, RunIntent,
};
use crate::domain::time::MonoTime;
use crate::gateway::event::LineEffect;
use crate::gateway::note::DriveNote;
use crate::journal::TriedWrite;
use crate::profile::model::IndicatedState;
use std::time::Duration;

/// Number of readings in a row after which the order is over.
const READINGS: u8 = 3;
/// The least time between the first and the last of them.
const LASTS: Duration = Duration::from_secs(2);

impl DriveWork {
    /// A new order begins.
    pub(super) fn restart_follow_watch(&mut self) {
        self.followed = FollowWatch::default();
        self.is_stopped_elsewhere = false;
    }

    /// Takes a reading of the status at `now`: the drive shows whether it is ordered to run.
    pub(super) fn followed(&mut self, running: bool, now: MonoTime, out: Out<'_>) {
        let direction = match self.order_in_force() {
            Some(direction) if self.is_status_proven() => direction,
            _ => {
                self.followed = FollowWatch::default();
                return;
            }
        };
        let ramps = self.status.get(IndicatedState::Stopping) == Some(true);
        let turns = self.output_register.is_some() && self.output.raw() != Some(0);
        let followed = &mut self.followed;
        followed.has_run |= running;
        if running || ramps || turns {
            followed.at_rest = 0;
            return;
        }
        if followed.at_rest == 0 {
            followed.since = now;
        }
        followed.at_rest = followed.at_rest.saturating_add(1);
        if followed.has_run && followed.at_rest >= READINGS && now.since(followed.since) >= LASTS {
            self.was_stopped_elsewhere(direction, now, out);
        }
    }

    /// The direction of the order to run that the drive has acknowledged. What else is on its way does not change it.
    fn order_in_force(&self) -> Option<Direction> {
        match self.guard.intent() {
            RunIntent::Run(direction)
                if self.latch.is_none() && self.guard.is_run_acknowledged() =>
            {
                Some(direction)
            }
            _ => None,
        }
    }

    fn is_status_proven(&self) -> bool {
        self.model
            .status_flag(IndicatedState::Running)
            .is_some_and(|flag| flag.confidence.is_proven())
    }

    /// The order is over. Nothing restarts the motor but a new one.
    fn was_stopped_elsewhere(&mut self, direction: Direction, now: MonoTime, out: Out<'_>) {
        let owner = self.guard.lease().map_or(Owner::Local, |(owner, _)| owner);
        self.restart_follow_watch();
        self.guard.inhibit(now);
        let report = Report::new(Outcome::Failed, Reason::StoppedElsewhere);
        self.is_stopped_elsewhere = true;
        self.last = Some(report);
        self.has_changed = true;
        out.push_back(LineEffect::Note(self.drive, DriveNote::StoppedElsewhere));
        if let Some(run) = GoOrder::new(Vec::new(), None, Some(direction)) {
            out.attempt_ended(self.drive, owner, TriedWrite::Order(Order::Go(run)), report);
        }
    }
}
