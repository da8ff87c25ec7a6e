//! Control of one drive: its owner, the current order, and who may start it. Each of these is a part with fields of its own.

use super::adoption::is_taken_up_by_broker;
use super::approved::{Approved, StopOrder};
use super::closing::Closing;
use super::interlocks::StartInterlocks;
use super::lease::ControlLease;
use super::owners::OwnerSet;
use super::run_order::RunOrder;
use super::setpoint::SetpointOrder;
use super::start_inhibit::StartInhibit;
use crate::domain::address::Address;
use crate::domain::command::{Direction, Order, Origin, Owner, RunIntent};
use crate::domain::control::{ControlSettings, LeaseMode};
use crate::domain::fail_safe::FailSafeRun;
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::bases::FrequencyBases;
use crate::drive::steps::{self, CommandStep};
use crate::journal::RememberedLease;
use crate::profile::model::Model;
use std::sync::Arc;
use std::time::Duration;

/// Control of one drive.
#[derive(Debug)]
pub struct DriveGuard {
    pub(super) model: Arc<Model>,
    pub(super) control: Option<Arc<ControlSettings>>,
    pub(super) lease: ControlLease,
    pub(super) order: RunOrder,
    pub(super) setpoint: SetpointOrder,
    pub(super) start: StartInhibit,
    pub(super) interlocks: StartInterlocks,
    pub(super) closing: Closing,
    /// Owners that hold an order to reset: it acted on arrival, and acts again only after it was withdrawn or expired.
    pub(super) resetting: OwnerSet,
    /// The last declared action since the last accepted RUN.
    pub(super) failsafe: Option<FailSafeRun>,
    /// The drive's identity was read since it came into sight, and is that of its model.
    pub(super) is_identified: bool,
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
            setpoint: SetpointOrder::none(Arc::clone(&model)),
            model,
            control,
            lease: ControlLease::default(),
            order: RunOrder::none(),
            start: StartInhibit::new(first_epoch, now),
            interlocks: StartInterlocks::default(),
            closing: Closing::default(),
            resetting: OwnerSet::default(),
            failsafe: None,
            is_identified: false,
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
        self.lease.held()
    }

    /// Whether control is held, or the drive is ordered to run.
    #[must_use]
    pub const fn is_held(&self) -> bool {
        self.lease.is_held() || self.order.is_to_run()
    }

    /// Whether the owner of the lease is awaited since before a restart of the gateway.
    #[must_use]
    pub fn is_orphaned(&self) -> bool {
        self.lease.is_orphaned()
    }

    /// Whether the order in force waits for a client to take it up.
    #[must_use]
    pub const fn is_adopted(&self) -> bool {
        self.lease.adopted().is_some() && self.order.is_to_run()
    }

    /// When [`Self::expire`] is due: the end of the lease, or of an adoption.
    #[must_use]
    pub fn next_wake(&self) -> Option<MonoTime> {
        self.lease.next_end()
    }

    /// The order in force.
    #[must_use]
    pub const fn intent(&self) -> RunIntent {
        self.order.intent()
    }

    /// Whether the drive has acknowledged the order in force.
    #[must_use]
    pub const fn is_run_acknowledged(&self) -> bool {
        self.order.is_acknowledged()
    }

    /// Whether the drive acknowledged an order to run, or may have accepted one, that has not ended since.
    #[must_use]
    pub const fn may_be_obeyed(&self) -> bool {
        self.order.may_be_obeyed()
    }

    /// The direction of the last order to run, in force or not.
    #[must_use]
    pub const fn last_direction(&self) -> Option<Direction> {
        self.order.last_direction()
    }

    /// The number of stops so far: approvals from before the last one are void.
    #[must_use]
    pub const fn stops(&self) -> u64 {
        self.order.stops()
    }

    /// The last accepted setpoint.
    #[must_use]
    pub fn setpoint(&self) -> Option<Hertz> {
        self.setpoint.value()
    }

    /// What the frequencies of the drive are fractions of.
    #[must_use]
    pub const fn bases(&self) -> &FrequencyBases {
        self.setpoint.bases()
    }

    /// Whether every client must command stop before it may start the drive.
    #[must_use]
    pub const fn is_start_inhibited(&self) -> bool {
        self.start.is_for_all()
    }

    /// The drive's epoch, as clients may quote it.
    #[must_use]
    pub const fn epoch(&self) -> u64 {
        self.start.epoch()
    }

    /// The connection of clients was reopened: orders issued before are stale.
    pub const fn new_epoch(&mut self) {
        self.start.new_epoch();
    }

    /// Sets whether the output is outside the limits or far from the setpoint.
    pub const fn output_is_outside(&mut self, is_outside: bool) {
        self.interlocks.output_is_outside(is_outside);
    }

    /// The motor was ordered to start, and the drive acknowledged it or may have received it.
    pub const fn started(&mut self, now: MonoTime) {
        self.interlocks.started(now);
    }

    /// The drive was read to be of its model.
    pub const fn was_identified(&mut self) {
        self.is_identified = true;
    }

    /// The drive is out of sight: another one may answer when it is back.
    pub const fn may_be_another(&mut self) {
        self.is_identified = false;
    }

    /// The owner renews its lease.
    pub fn renew(&mut self, owner: Owner, now: MonoTime) {
        if let Some(control) = &self.control {
            self.lease.renew(owner, control.lost_after, now);
        }
    }

    /// The connection of `owner` is open: that alone renews a session lease. It takes an adopted order up only where no
    /// other client could have given it.
    pub fn path_alive(&mut self, owner: Owner, now: MonoTime) {
        let Some(control) = self.control.clone() else {
            return;
        };
        if self.is_adopted() && owner == Owner::Mqtt && is_taken_up_by_broker(&control) {
            self.taken_up_by(owner, &control, now);
        }
        if control.lease == LeaseMode::Session {
            self.renew(owner, now);
        }
    }

    /// The client of `origin` gives an order, which may take the adopted one up: control is its own then.
    pub(super) fn take_up(
        &mut self,
        origin: Origin,
        order: &Order,
        control: &ControlSettings,
        now: MonoTime,
    ) {
        if self.is_adopted()
            && let Some(adopted) = self.lease.adopted()
            && adopted.is_taken_up_by(origin.manner, order)
        {
            self.taken_up_by(origin.owner, control, now);
        }
    }

    fn taken_up_by(&mut self, owner: Owner, control: &ControlSettings, now: MonoTime) {
        self.start.arm(owner);
        self.lease.take(owner, control.lost_after, now);
    }

    /// The drive cannot be reached: what `owner` orders, or its open connection, renews nothing, but the client is there.
    pub fn was_out_of_reach(&mut self, owner: Owner, now: MonoTime) {
        self.lease.was_out_of_reach(owner, now);
    }

    /// Restores control held when the gateway exited. No other client gets it before the drive is seen.
    pub const fn remember_lease(&mut self, lease: RememberedLease) {
        if self.control.is_some() {
            self.lease.remember(lease);
        }
    }

    /// Restores control held when the gateway exited, on a line where another gateway may be active: it says so within
    /// `signals_within`, and the lease ends then. Where none is, it lasts until the owner was awaited for its time.
    pub fn remember_lease_listening(
        &mut self,
        lease: RememberedLease,
        now: MonoTime,
        signals_within: Duration,
    ) {
        if let Some(control) = &self.control {
            let until = now + control.lost_after.max(signals_within);
            self.lease.remember_listening(lease, until);
        }
    }

    /// No other gateway was active since the start: the time of the owner counts from there.
    pub fn awaited_since_start(&mut self) {
        if let Some(control) = &self.control {
            let until = self.start.found_at() + control.lost_after;
            self.lease.awaited_until(until);
        }
    }

    /// The drive shows at `now` that its motor turns, and perhaps in which `direction`. For an orphaned lease, the owner's
    /// time begins here.
    pub fn found_running(&mut self, direction: Option<Direction>, now: MonoTime) {
        if !self.order.is_to_run() {
            self.order.turns(direction);
        }
        if let Some(control) = &self.control {
            self.lease.found_running(control.lost_after, now);
        }
    }

    /// The drive is at standstill after a stop by the owner of control: there is nothing left to hold.
    pub fn at_standstill(&mut self) {
        if self.order.is_to_run() {
            return;
        }
        let owner = self.lease.owner();
        if self.lease.is_from_before() || owner.is_some_and(|owner| self.start.is_armed(owner)) {
            self.lease.end();
        }
    }

    /// This gateway gives the line up: another one controls the drive, or will.
    pub fn give_up(&mut self) {
        self.lease.end();
        self.lease.end_adoption();
    }

    /// The gateway shuts down while another one controls the drive: nothing is accepted any more, and nothing is sent.
    pub const fn end(&mut self) {
        self.closing.end();
    }

    /// The drive leaves the configuration, or its line is restarted: from now on only stops are accepted, until
    /// [`Self::stay`].
    pub const fn leave(&mut self) {
        self.closing.leaves(true);
    }

    /// The drive stays after all.
    pub const fn stay(&mut self) {
        self.closing.leaves(false);
    }

    /// Inhibits the start at `now`, after a lost lease or an abandoned stop: no order issued before starts the drive.
    pub fn inhibit(&mut self, now: MonoTime) {
        self.start.inhibit(now);
        self.order.end();
        self.lease.end_adoption();
    }

    /// The drive tripped or is offline: it may also have lost its setpoint.
    pub fn lost_touch(&mut self, now: MonoTime) {
        self.start.inhibit(now);
        // The order of another gateway may still be in force there: it stays adopted.
        self.order.end();
        self.setpoint.may_be_lost();
    }

    /// Another gateway has ordered the drive to run in `direction`.
    pub fn turned_by_another(&mut self, direction: Direction) {
        self.order.turns(Some(direction));
    }

    /// The drive acknowledged the order to run in `direction`.
    pub fn run_was_acknowledged(&mut self, direction: Direction) {
        self.order.was_acknowledged(direction);
    }

    /// The order to run in `direction` was sent but not answered: the drive may have accepted it.
    pub const fn run_is_unknown(&mut self, direction: Direction) {
        self.order.is_unknown(direction);
    }

    /// The order to run in `direction` was never sent, or the drive refused it. It is replaced by an older one that is
    /// still to be sent, or else by what the drive obeys.
    pub fn run_failed(&mut self, direction: Direction, still_ordered: Option<Direction>) {
        self.order.failed(direction, still_ordered);
    }

    /// The drive acknowledged the setpoint `value` of `owner`.
    pub fn setpoint_was_acknowledged(&mut self, owner: Owner, value: Hertz, now: MonoTime) {
        self.setpoint.was_acknowledged(owner, value, now);
    }

    /// A setpoint was sent but not answered: the drive may no longer hold the previous one.
    pub const fn setpoint_is_unknown(&mut self) {
        self.setpoint.is_unknown();
    }

    /// The drive was reset, or may have lost power: an equal setpoint counts as new.
    pub const fn setpoint_may_be_lost(&mut self) {
        self.setpoint.may_be_lost();
    }

    /// The setpoint `value` was never sent, or the drive refused it: it is replaced by the one still to be sent, or
    /// else by the one that the drive holds.
    pub fn setpoint_failed(&mut self, value: Hertz, still_ordered: Option<(Owner, Hertz)>) {
        self.setpoint.failed(value, still_ordered);
    }

    /// Takes what a read from `first` on brought at `at`, as words of the drive's own setting.
    pub fn take_setting(&mut self, first: Address, words: &[u16], at: MonoTime) {
        self.setpoint.take_setting(first, words, at);
    }

    /// Sets the age from which a reading of the full scale is stale.
    pub const fn bases_stale_after(&mut self, limit: Duration) {
        self.setpoint.bases_stale_after(limit);
    }

    /// Takes what a read from `first` on brought at `at`, as words of full scales. Returns the register of one that has
    /// changed: it is to be read again.
    pub fn take_bases(&mut self, first: Address, words: &[u16], at: MonoTime) -> Option<Address> {
        self.setpoint.take_bases(first, words, at)
    }

    /// The drive is offline: when it is back, it may be another one.
    pub fn forget_bases(&mut self) {
        self.setpoint.forget();
    }

    /// Control was returned to panel or terminals: it has no owner here, and a client must stop before it starts.
    pub(super) fn released(&mut self, now: MonoTime) {
        self.lease.end();
        self.inhibit(now);
        self.order.release();
    }

    pub(super) fn accept_run(&mut self, owner: Owner, direction: Direction) {
        self.order.run(direction);
        self.failsafe = None;
        self.start.arm(owner);
    }

    /// Accepts a stop: all earlier approvals are void, all other clients are inhibited. A stop by a client other than the
    /// owner ends the lease.
    pub(super) fn accept_stop(&mut self, owner: Option<Owner>, coast: bool, now: MonoTime) {
        self.inhibit(now);
        self.order.stop(coast);
        if self.lease.owner() != owner {
            self.lease.end();
        }
        if let Some(owner) = owner {
            self.start.arm(owner);
        }
    }

    /// The last stop has taken effect.
    pub const fn stop_was_effective(&mut self) {
        self.order.stop_was_effective();
    }

    /// The stop that is in force has not taken effect after all: its order, to be sent again.
    pub fn stop_again(&mut self) -> Option<StopOrder> {
        let coast = self.order.stop_again()?;
        self.stop_order(coast)
    }

    /// Another gateway or master of the line stopped the drive at `now`. No owner of control here ordered this stop.
    pub fn stop_by_another(&mut self, coast: bool, now: MonoTime) -> Option<StopOrder> {
        self.control.as_ref()?;
        let order = self.stop_order(coast)?;
        self.accept_stop(None, coast, now);
        Some(order)
    }

    /// Restores a stop that was pending when the gateway exited. `None` if it can no longer be ordered.
    pub fn remember_stop(&mut self, coast: bool, now: MonoTime) -> Option<StopOrder> {
        self.stop_by_another(coast, now)
    }

    pub(super) fn stop_order(&self, coast: bool) -> Option<StopOrder> {
        let turned = self.order.last_direction();
        StopOrder::of(&self.model, coast, turned.or(self.likely_direction()))
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

    /// Whether a reset of this model needs a final word, which may be missing.
    #[must_use]
    pub fn leaves_a_reset_standing(&self) -> bool {
        self.control.is_some() && steps::of_take_back(&self.model).is_ok()
    }

    /// Clears the word of an interrupted reset: that completes the old order and is not a new one. `None` if the drive may
    /// no longer be commanded.
    pub fn take_reset_back(&self) -> Option<Approved> {
        if self.control.is_none() || self.closing.may_command().is_err() {
            return None;
        }
        let steps = steps::of_take_back(&self.model).ok()?;
        Some(self.taken_back(Order::Reset, steps))
    }

    /// Takes back a start that the drive did not follow, and inhibits the next one until a client orders it again. `None` if
    /// the drive may no longer be commanded.
    pub fn take_start_back(&mut self, now: MonoTime) -> Option<Approved> {
        if self.control.is_none() || self.closing.may_command().is_err() {
            return None;
        }
        let steps = steps::of_start_taken_back(&self.model).ok()?;
        self.inhibit(now);
        Some(self.taken_back(Order::Stop { setpoint: None }, steps))
    }

    fn taken_back(&self, order: Order, steps: Vec<CommandStep>) -> Approved {
        Approved::new(
            &self.model,
            Owner::Local,
            order,
            steps,
            MonoTime::NEVER,
            self.stops(),
        )
    }
}
