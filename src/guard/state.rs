//! Control of one drive: its owner, the current order, and who may start it.

use super::adoption::AdoptedOrder;
use super::approved::StopOrder;
use super::interlocks::StartInterlocks;
use super::orphan::OrphanLease;
use super::owners::OwnerSet;
use super::setting::{Setpoint, SettingReading};
use crate::domain::command::{Direction, Owner, RunIntent};
use crate::domain::control::{ControlSettings, LeaseMode};
use crate::domain::fail_safe::FailSafeRun;
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::bases::FrequencyBases;
use crate::profile::model::Model;
use std::sync::Arc;

/// Control of one drive.
#[derive(Debug)]
pub struct DriveGuard {
    pub(super) model: Arc<Model>,
    pub(super) control: Option<Arc<ControlSettings>>,
    /// What the frequencies of the drive are fractions of.
    pub(super) bases: FrequencyBases,
    pub(super) lease: Option<Lease>,
    /// A run order from another gateway of the line that no client here has taken up yet.
    pub(super) adopted: Option<AdoptedOrder>,
    pub(super) intent: RunIntent,
    /// Whether the drive has acknowledged the intent. Until then an equal order counts as new.
    pub(super) run_acknowledged: bool,
    /// The direction in which the drive was last ordered to run, and whether it acknowledged that or only may have
    /// accepted it; `None` once the order has ended.
    pub(super) obeyed: Option<(Direction, bool)>,
    /// The last ordered direction, in force or not, or the one that the motor showed since: it may still turn.
    pub(super) turned: Option<Direction>,
    pub(super) setpoint: Option<Setpoint>,
    /// The last acknowledged setpoint.
    pub(super) held_setpoint: Option<Setpoint>,
    /// The drive's own setting of the frequency.
    pub(super) setting: Option<SettingReading>,
    /// Owners that have commanded stop since the last inhibit, and may therefore start.
    pub(super) armed: OwnerSet,
    /// Owners that hold an order to reset: it acted on arrival, and acts again only after it was withdrawn or expired.
    pub(super) resetting: OwnerSet,
    stops: u64,
    epoch: u64,
    /// When the drive was added. Orders issued before do not start it.
    pub(super) found_at: MonoTime,
    /// When the right to start last ended, by a stop, a trip or a lost lease. Orders issued before do not start the drive.
    pub(super) inhibited_at: Option<MonoTime>,
    /// The last declared action since the last accepted RUN.
    pub(super) failsafe: Option<FailSafeRun>,
    /// The last stop has taken effect, and still holds.
    pub(super) stop_took_effect: bool,
    /// Control was released, and nothing has been ordered since.
    pub(super) is_released: bool,
    pub(super) is_ending: bool,
    pub(super) interlocks: StartInterlocks,
    /// The output was seen outside the limits or far from the setpoint, and not right since.
    pub(super) is_output_outside: bool,
    /// The drive is about to leave the configuration.
    /// The drive's identity was read since it came into sight, and is that of its model.
    pub(super) is_identified: bool,
    pub(super) is_leaving: bool,
}

/// A lease on control: it ends unless its owner renews it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Lease {
    pub owner: Owner,
    pub until: MonoTime,
    /// It is from before a restart of the gateway, and its owner is awaited.
    pub orphan: Option<OrphanLease>,
    /// When its owner was last refused because the drive could not be reached: it is there all the same.
    pub refused_at: Option<MonoTime>,
}

impl DriveGuard {
    /// Creates the guard of a drive that was added at `now`: it has no owner, and the start is inhibited. Epochs count
    /// from `first_epoch`, which should differ from those of a previous run of the gateway.
    #[must_use]
    pub fn new(
        model: Arc<Model>,
        control: Option<Arc<ControlSettings>>,
        first_epoch: u64,
        now: MonoTime,
    ) -> Self {
        Self {
            bases: FrequencyBases::of(&model),
            model,
            control,
            lease: None,
            adopted: None,
            intent: RunIntent::Stop,
            run_acknowledged: false,
            obeyed: None,
            turned: None,
            setpoint: None,
            held_setpoint: None,
            setting: None,
            armed: OwnerSet::default(),
            resetting: OwnerSet::default(),
            stops: 0,
            epoch: first_epoch,
            found_at: now,
            inhibited_at: None,
            failsafe: None,
            stop_took_effect: false,
            is_released: false,
            is_ending: false,
            interlocks: StartInterlocks::default(),
            is_output_outside: false,
            is_identified: false,
            is_leaving: false,
        }
    }

    /// The limits in the drive's control section.
    #[must_use]
    pub fn control(&self) -> Option<&ControlSettings> {
        self.control.as_deref()
    }

    /// The owner of control, and when the lease ends unless renewed.
    #[must_use]
    pub fn lease(&self) -> Option<(Owner, MonoTime)> {
        self.lease.map(|lease| (lease.owner, lease.until))
    }

    /// The order in force.
    #[must_use]
    pub const fn intent(&self) -> RunIntent {
        self.intent
    }

    /// Whether the drive acknowledged an order to run, or may have accepted one, that has not ended since.
    #[must_use]
    pub const fn may_be_obeyed(&self) -> bool {
        self.obeyed.is_some()
    }

    /// The last accepted setpoint.
    #[must_use]
    pub fn setpoint(&self) -> Option<Hertz> {
        self.setpoint.map(|setpoint| setpoint.value)
    }

    /// Whether the drive has acknowledged the order in force.
    #[must_use]
    pub const fn is_run_acknowledged(&self) -> bool {
        self.run_acknowledged
    }

    /// Sets whether the output is outside the limits or far from the setpoint.
    pub const fn output_is_outside(&mut self, is_outside: bool) {
        self.is_output_outside = is_outside;
    }

    /// Whether every client must command stop before it may start the drive.
    #[must_use]
    pub fn is_start_inhibited(&self) -> bool {
        self.armed.is_empty()
    }

    /// The number of stops so far: approvals from before the last one are void.
    #[must_use]
    pub const fn stops(&self) -> u64 {
        self.stops
    }

    /// The drive's epoch, as clients may quote it.
    #[must_use]
    pub const fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Orders issued up to this moment do not start the drive.
    pub(super) fn starts_after(&self) -> MonoTime {
        self.inhibited_at.unwrap_or(self.found_at)
    }

    /// The connection of clients was reopened: orders issued before are stale.
    pub fn new_epoch(&mut self) {
        self.epoch += 1;
    }

    /// When [`Self::expire`] is due: the end of the lease, or of an adoption.
    #[must_use]
    pub fn next_wake(&self) -> Option<MonoTime> {
        let lease = self
            .lease
            .map(|lease| lease.until)
            .filter(|until| *until != MonoTime::NEVER);
        lease
            .into_iter()
            .chain(self.adopted.map(|adopted| adopted.until))
            .min()
    }

    /// The owner renews its lease.
    pub fn renew(&mut self, owner: Owner, now: MonoTime) {
        if let (Some(lease), Some(control)) = (&mut self.lease, &self.control)
            && lease.owner == owner
        {
            lease.until = now + control.lost_after;
            lease.orphan = lease.orphan.and_then(OrphanLease::taken_up);
        }
    }

    /// The connection of `owner` is open: that alone renews a session lease.
    pub fn path_alive(&mut self, owner: Owner, now: MonoTime) {
        self.take_up_by_path(owner, now);
        if self
            .control
            .as_ref()
            .is_some_and(|control| control.lease == LeaseMode::Session)
        {
            self.renew(owner, now);
        }
    }

    /// The motor was ordered to start, and the drive acknowledged it or may have received it.
    pub fn started(&mut self, now: MonoTime) {
        self.interlocks.started(now);
    }

    /// Inhibits the start at `now`, after a lost lease or an abandoned stop: no order issued before starts the drive.
    pub fn inhibit(&mut self, now: MonoTime) {
        self.inhibited_at = Some(now);
        self.epoch += 1;
        self.stop_took_effect = false;
        self.armed.clear();
        self.intent = RunIntent::Stop;
        self.run_acknowledged = false;
        self.obeyed = None;
        self.adopted = None;
    }

    /// The drive tripped or is offline: it may also have lost its setpoint.
    pub fn lost_touch(&mut self, now: MonoTime) {
        let adopted = self.adopted;
        self.inhibit(now);
        // The order of another gateway may still be in force there.
        self.adopted = adopted;
        self.setpoint_may_be_lost();
    }

    /// The drive was read to be of its model.
    pub const fn was_identified(&mut self) {
        self.is_identified = true;
    }

    /// The drive is out of sight: another one may answer when it is back.
    pub const fn may_be_another(&mut self) {
        self.is_identified = false;
    }

    /// The last stop has taken effect.
    pub const fn stop_was_effective(&mut self) {
        self.stop_took_effect = true;
    }

    /// The stop that is in force has not taken effect after all: its order, to be sent again.
    pub fn stop_again(&mut self) -> Option<StopOrder> {
        let coast = match self.intent {
            RunIntent::Stop => false,
            RunIntent::Coast => true,
            RunIntent::Run(_) => return None,
        };
        self.stop_took_effect = false;
        self.stop_order(coast)
    }

    /// The drive is at standstill after a stop by the owner of control: there is nothing left to hold.
    pub fn at_standstill(&mut self) {
        if matches!(self.intent, RunIntent::Run(_)) {
            return;
        }
        if self
            .lease
            .is_some_and(|lease| lease.orphan.is_some() || self.armed.has(lease.owner))
        {
            self.lease = None;
        }
    }

    /// The drive acknowledged the order to run in `direction`.
    pub fn run_was_acknowledged(&mut self, direction: Direction) {
        if let RunIntent::Run(ordered) = self.intent {
            self.obeyed = Some((direction, true));
            self.run_acknowledged = ordered == direction;
        }
    }

    /// The order to run in `direction` was sent but not answered: the drive may have accepted it.
    pub const fn run_is_unknown(&mut self, direction: Direction) {
        if matches!(self.intent, RunIntent::Run(_)) {
            self.obeyed = Some((direction, false));
        }
    }

    /// The order to run in `direction` was never sent, or the drive refused it. It is replaced by an older one that is
    /// still to be sent, or else by what the drive obeys: a motor that turns by our order is never shown as stopped.
    pub fn run_failed(&mut self, direction: Direction, still_ordered: Option<Direction>) {
        if self.intent != RunIntent::Run(direction) || self.run_acknowledged {
            return;
        }
        let stands = still_ordered.or(self.obeyed.map(|(direction, _)| direction));
        self.intent = stands.map_or(RunIntent::Stop, RunIntent::Run);
        self.run_acknowledged =
            still_ordered.is_none() && self.obeyed.is_some_and(|(_, is_sure)| is_sure);
        self.turned = stands.or(self.turned);
    }

    /// Accepts an order of `owner` to run, or a setpoint for a drive that may turn: control is leased.
    pub(super) fn take_lease(&mut self, owner: Owner, now: MonoTime) {
        if let Some(control) = &self.control {
            self.adopted = None;
            self.lease = Some(Lease {
                owner,
                until: now + control.lost_after,
                orphan: None,
                refused_at: None,
            });
        }
    }

    pub(super) fn accept_run(&mut self, owner: Owner, direction: Direction) {
        self.is_released = false;
        self.stop_took_effect = false;
        self.intent = RunIntent::Run(direction);
        self.turned = Some(direction);
        self.run_acknowledged = false;
        self.failsafe = None;
        self.armed.add(owner, MonoTime::NEVER);
    }

    /// Accepts a stop: all earlier approvals are void, all other clients are inhibited. A stop by a client other than the
    /// owner ends the lease.
    pub(super) fn accept_stop(&mut self, owner: Option<Owner>, coast: bool, now: MonoTime) {
        self.is_released = false;
        self.stops += 1;
        self.inhibit(now);
        self.intent = if coast {
            RunIntent::Coast
        } else {
            RunIntent::Stop
        };
        if self.lease.is_some_and(|lease| Some(lease.owner) != owner) {
            self.lease = None;
        }
        if let Some(owner) = owner {
            self.armed.add(owner, MonoTime::NEVER);
        }
    }

    /// The direction of a motor of which none is known: the only one that is allowed, or forward.
    fn likely_direction(&self) -> Option<Direction> {
        let directions = &self.control.as_ref()?.directions;
        Some(if directions.contains(&Direction::Forward) {
            Direction::Forward
        } else {
            Direction::Reverse
        })
    }

    pub(super) fn stop_order(&self, coast: bool) -> Option<StopOrder> {
        StopOrder::of(&self.model, coast, self.turned.or(self.likely_direction()))
    }
}
