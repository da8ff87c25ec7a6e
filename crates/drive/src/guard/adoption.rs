//! A drive that runs by the order of another gateway of its line, which is lost: it goes on for a while, so that its
//! client can come back here. Nothing is started by that.

use crate::domain::command::{Direction, Order, OrderManner};
use crate::domain::control::{ControlSettings, LeaseMode};
use crate::domain::time::MonoTime;

/// An order that was heard on the line and has no owner here yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct AdoptedOrder {
    direction: Direction,
    until: MonoTime,
}

impl AdoptedOrder {
    pub const fn new(direction: Direction, until: MonoTime) -> Self {
        Self { direction, until }
    }

    /// When the declared action for a lost client runs, unless a client takes the order up before.
    pub const fn until(self) -> MonoTime {
        self.until
    }

    /// Whether a client takes it up by `order`: it repeats the order in its cycle, or renews its lease. A single message to
    /// run is reviewed like any other: it may be older than the loss.
    pub fn is_taken_up_by(self, manner: OrderManner, order: &Order) -> bool {
        match order {
            Order::Go(_) if manner == OrderManner::Once => false,
            Order::Go(go) => match go.run() {
                Some(direction) => direction == self.direction,
                None => go.frequency().is_some(),
            },
            Order::Renew | Order::Take => true,
            Order::Stop { .. }
            | Order::Coast
            | Order::Reset
            | Order::EndReset
            | Order::Release
            | Order::Setup(_) => false,
        }
    }
}

/// Whether an open connection to the broker takes an order up: no other client could have given it.
pub(super) fn is_taken_up_by_broker(control: &ControlSettings) -> bool {
    let by_broker_alone = control.from_mqtt
        && !(control.from_modbus_tcp || control.from_page || control.from_sparkplug);
    by_broker_alone && control.lease == LeaseMode::Session
}

#[cfg(test)]
mod tests {
    use super::super::tests::{NOW, RESTING, STOP, command, guard_of, mqtt, plc, run};
    use super::super::{CommandVerdict, DriveFacts, DriveGuard};
    use super::*;
    use crate::domain::command::{CommandRequest, Owner, Reason, RunIntent};
    use crate::domain::control::FailSafe;
    use crate::domain::fail_safe::FailSafeCause;
    use crate::domain::standby::OnGatewayLost;
    use crate::vendors::testing::{control, model};
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
