//! A drive that runs by the order of another gateway of its line, which is lost: it goes on for a while, so that its
//! client can come back here. Nothing is started by that.

use super::approved::{LossAction, StopOrder};
use super::state::DriveGuard;
use crate::domain::command::{Direction, Order, OrderManner, Origin, Owner, RunIntent};
use crate::domain::control::{ControlSettings, FailSafe, LeaseMode};
use crate::domain::standby::OnGatewayLost;
use crate::domain::time::MonoTime;
use crate::journal::FailSafeCause;

/// An order that was heard on the line and has no owner here yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct AdoptedOrder {
    /// The order.
    pub direction: Direction,
    /// When the declared action for a lost client runs, unless a client takes the order up before.
    pub until: MonoTime,
}

impl DriveGuard {
    /// This gateway takes the line over from another at `now`. The drive is ordered to run, in `direction` if that is
    /// known. Returns the declared action; `None` if the drive goes on, as it does where the line was handed over.
    pub fn gateway_left(
        &mut self,
        direction: Option<Direction>,
        was_handed_over: bool,
        now: MonoTime,
    ) -> Option<LossAction> {
        let control = self.control.clone()?;
        self.lease = None;
        self.inhibit(now);
        self.turned = direction.or(self.turned);
        let declared = control.on_gateway_lost.unwrap_or(OnGatewayLost::Stop);
        let action = match if was_handed_over {
            OnGatewayLost::Adopt
        } else {
            declared
        } {
            OnGatewayLost::Stop => FailSafe::Stop,
            OnGatewayLost::Coast => FailSafe::Coast,
            OnGatewayLost::Hold => FailSafe::Hold,
            OnGatewayLost::Adopt => return self.adopt(direction, &control, now),
        };
        Some(self.falls_due(None, action, FailSafeCause::GatewayLost, now))
    }

    /// This gateway gives the line up: another one controls the drive, or will.
    pub const fn give_up(&mut self) {
        self.lease = None;
        self.adopted = None;
    }

    /// Another gateway or master of the line stopped the drive at `now`: that is a stop by nobody who has control here.
    pub fn stop_by_another(&mut self, coast: bool, now: MonoTime) -> Option<StopOrder> {
        self.control.as_ref()?;
        let order = self.stop_order(coast)?;
        self.accept_stop(None, coast, now);
        Some(order)
    }

    /// The other gateway is lost at `now` before its stop took effect: it is sent again.
    pub fn repeat_stop(&mut self, coast: bool, now: MonoTime) -> Option<LossAction> {
        self.control.as_ref()?;
        self.lease = None;
        let action = if coast {
            FailSafe::Coast
        } else {
            FailSafe::Stop
        };
        Some(self.lost(None, action, FailSafeCause::GatewayLost, now))
    }

    /// The gateway shuts down while another one controls the drive: nothing is accepted any more, and nothing is sent.
    pub const fn end(&mut self) {
        self.is_ending = true;
    }

    /// The order is left standing. Where its direction is not known, it cannot be: a client could not repeat it.
    fn adopt(
        &mut self,
        direction: Option<Direction>,
        control: &ControlSettings,
        now: MonoTime,
    ) -> Option<LossAction> {
        let Some(direction) = direction else {
            return Some(self.falls_due(
                None,
                control.on_commander_lost,
                FailSafeCause::GatewayLost,
                now,
            ));
        };
        self.runs_already(direction);
        self.adopted = Some(AdoptedOrder {
            direction,
            until: now + control.lost_after,
        });
        None
    }

    /// The client of `origin` gives an order: if it repeats the adopted one in its cycle, or renews its lease, control is
    /// its own. A single message to run is reviewed like any other: it may be older than the loss.
    pub(super) fn take_up(&mut self, origin: Origin, order: &Order, now: MonoTime) {
        let Some(adopted) = self.adopted else {
            return;
        };
        if !self.is_adopted() {
            return;
        }
        let is_his = match order {
            Order::Go(_) if origin.manner == OrderManner::Once => false,
            Order::Go(go) => match go.run() {
                Some(direction) => direction == adopted.direction,
                None => go.frequency().is_some(),
            },
            Order::Renew | Order::Take => true,
            Order::Stop { .. }
            | Order::Coast
            | Order::Reset
            | Order::EndReset
            | Order::Release
            | Order::Setup(_) => false,
        };
        if is_his {
            self.taken_up_by(origin.owner, now);
        }
    }

    /// The connection of the clients behind `way` is open. That takes the order up only where no other client could have
    /// given it.
    pub(super) fn take_up_by_path(&mut self, way: Owner, now: MonoTime) {
        let Some(control) = &self.control else { return };
        let by_broker_alone = control.from_mqtt
            && !(control.from_modbus_tcp || control.from_page || control.from_sparkplug);
        if self.is_adopted()
            && way == Owner::Mqtt
            && by_broker_alone
            && control.lease == LeaseMode::Session
        {
            self.taken_up_by(way, now);
        }
    }

    fn taken_up_by(&mut self, owner: Owner, now: MonoTime) {
        self.armed.add(owner, MonoTime::NEVER);
        self.take_lease(owner, now);
    }

    /// Ends the adoption if its time is over at `now`, and returns the declared action; `None` if none is needed, because
    /// the order is no longer in force and the drive is `at_rest`.
    pub(super) fn expire_adopted(&mut self, now: MonoTime, at_rest: bool) -> Option<LossAction> {
        self.adopted.filter(|adopted| adopted.until <= now)?;
        let is_over = at_rest && !self.is_adopted();
        let action = self.control.as_ref()?.on_commander_lost;
        self.inhibit(now);
        if is_over {
            return None;
        }
        Some(self.falls_due(None, action, FailSafeCause::GatewayLost, now))
    }

    /// The drive obeys an order to run in `direction` that was not given here.
    pub(super) fn runs_already(&mut self, direction: Direction) {
        self.intent = RunIntent::Run(direction);
        self.run_acknowledged = true;
        self.obeyed = Some((direction, true));
        self.turned = Some(direction);
    }

    /// Another gateway has ordered the drive to run in `direction`.
    pub const fn turned_by_another(&mut self, direction: Direction) {
        self.turned = Some(direction);
    }

    /// The direction of the last order to run, in force or not.
    #[must_use]
    pub const fn last_direction(&self) -> Option<Direction> {
        self.turned
    }

    /// Whether the order in force waits for a client to take it up.
    #[must_use]
    pub fn is_adopted(&self) -> bool {
        self.adopted.is_some() && matches!(self.intent(), RunIntent::Run(_))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{NOW, RESTING, STOP, command, guard_of, mqtt, plc, run};
    use super::super::{CommandVerdict, DriveFacts};
    use super::*;
    use crate::domain::command::{CommandRequest, Reason};
    use crate::drive::testing::{control, model};
    use std::time::Duration;

    fn lost(action: OnGatewayLost) -> DriveGuard {
        let settings = ControlSettings {
            on_gateway_lost: Some(action),
            ..control()
        };
        guard_of(model(), settings)
    }

    fn soon(request: CommandRequest) -> CommandRequest {
        CommandRequest {
            start_before: NOW + Duration::from_secs(60),
            ..request
        }
    }

    #[test]
    fn the_declared_action_is_taken_and_nothing_may_start_before_a_stop() {
        for (declared, action, stops) in [
            (OnGatewayLost::Stop, FailSafe::Stop, true),
            (OnGatewayLost::Coast, FailSafe::Coast, true),
            (OnGatewayLost::Hold, FailSafe::Hold, false),
        ] {
            let mut guard = lost(declared);
            let found = guard
                .gateway_left(Some(Direction::Forward), false, NOW)
                .unwrap();
            assert_eq!(
                (found.action, found.order.is_some(), found.cause),
                (action, stops, FailSafeCause::GatewayLost)
            );
            assert!(
                guard.is_start_inhibited()
                    && guard.fail_safe().is_some()
                    && guard.lease().is_none()
            );
        }
    }

    #[test]
    fn an_adopted_order_waits_for_its_client_and_ends_like_a_lost_lease() {
        let mut guard = lost(OnGatewayLost::Adopt);
        assert_eq!(
            guard.gateway_left(Some(Direction::Forward), false, NOW),
            None
        );
        assert_eq!(
            (guard.intent(), guard.is_adopted()),
            (RunIntent::Run(Direction::Forward), true)
        );
        let until = guard.next_wake().unwrap();
        assert_eq!(until, NOW + control().lost_after);
        assert_eq!(
            guard.expire(until.before(Duration::from_nanos(1)), false),
            None
        );
        let ended = guard.expire(until, false).unwrap();
        assert_eq!(
            (ended.action, ended.cause),
            (control().on_commander_lost, FailSafeCause::GatewayLost)
        );
        assert!(!guard.is_adopted() && guard.is_start_inhibited());
        assert_eq!(guard.expire(until, false), None, "once");
    }

    #[test]
    fn the_client_that_repeats_the_order_controls_the_drive() {
        let facts = DriveFacts {
            at_standstill: false,
            rests: false,
            ..RESTING
        };
        let mut guard = lost(OnGatewayLost::Adopt);
        assert_eq!(
            guard.gateway_left(Some(Direction::Forward), false, NOW),
            None
        );
        for (origin, direction, reason) in [
            (plc(1), Direction::Reverse, Reason::StartInhibited),
            (mqtt(), Direction::Forward, Reason::RestartDelay),
        ] {
            let found = guard.review(&soon(command(origin, run(direction))), &facts, NOW);
            assert_eq!(found.unwrap_err().reason, reason);
            assert!(
                guard.is_adopted(),
                "another order, or one that may be older"
            );
        }
        let same = guard.review(&soon(command(plc(1), run(Direction::Forward))), &facts, NOW);
        assert!(same.is_ok(), "{same:?}");
        assert_eq!(
            (guard.lease().map(|(owner, _)| owner), guard.is_adopted()),
            (Some(plc(1).owner), false)
        );
        let other = guard.review(&soon(command(plc(2), run(Direction::Forward))), &facts, NOW);
        assert_eq!(other.unwrap_err().reason, Reason::OtherOwner);
    }

    #[test]
    fn a_drive_that_was_out_of_sight_is_stopped_in_time_and_not_started_by_its_client() {
        for at_rest in [false, true] {
            let mut guard = lost(OnGatewayLost::Adopt);
            assert_eq!(
                guard.gateway_left(Some(Direction::Forward), false, NOW),
                None
            );
            let until = guard.next_wake().unwrap();
            guard.lost_touch(NOW);
            let facts = DriveFacts {
                at_standstill: false,
                rests: false,
                ..RESTING
            };
            let found = guard.review(&soon(command(plc(1), run(Direction::Forward))), &facts, NOW);
            assert_eq!(found.unwrap_err().reason, Reason::StartInhibited);
            let ended = guard.expire(until, at_rest);
            assert_eq!(
                ended.map(|lost| lost.cause),
                (!at_rest).then_some(FailSafeCause::GatewayLost)
            );
            assert_eq!(guard.next_wake(), None);
        }
        let mut guard = lost(OnGatewayLost::Adopt);
        assert_eq!(
            guard.gateway_left(Some(Direction::Forward), false, NOW),
            None
        );
        guard.give_up();
        assert_eq!(guard.next_wake(), None, "another gateway controls it");
    }

    #[test]
    fn a_stop_ends_the_adoption() {
        let mut guard = lost(OnGatewayLost::Adopt);
        assert_eq!(
            guard.gateway_left(Some(Direction::Forward), false, NOW),
            None
        );
        assert!(matches!(
            guard.review(&command(mqtt(), STOP), &RESTING, NOW),
            Ok(CommandVerdict::Stop(_))
        ));
        assert!(!guard.is_adopted() && guard.next_wake().is_none());
    }

    #[test]
    fn an_order_of_unknown_direction_is_not_adopted() {
        let mut guard = lost(OnGatewayLost::Adopt);
        let found = guard.gateway_left(None, false, NOW).unwrap();
        assert_eq!(found.action, control().on_commander_lost);
    }

    #[test]
    fn the_open_path_takes_an_order_up_only_if_no_other_client_could_have_given_it() {
        for (from_page, taken_up) in [(false, true), (true, false)] {
            let settings = ControlSettings {
                on_gateway_lost: Some(OnGatewayLost::Adopt),
                from_mqtt: true,
                from_modbus_tcp: false,
                from_page,
                from_sparkplug: false,
                lease: LeaseMode::Session,
                ..control()
            };
            let mut guard = guard_of(model(), settings);
            assert_eq!(
                guard.gateway_left(Some(Direction::Forward), false, NOW),
                None
            );
            guard.path_alive(Owner::Mqtt, NOW);
            assert_eq!(guard.lease().is_some(), taken_up);
        }
    }
}
