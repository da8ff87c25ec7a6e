//! A motor's output frequency: it ramps linearly and is a pure function of time.

use crate::domain::time::MonoTime;
use std::time::Duration;

/// Microhertz in a hertz. Frequencies are kept in whole microhertz, so that a ramp can be resumed at any moment
/// without drift.
pub const MICROHERTZ: i64 = 1_000_000;

/// The output of a drive. Frequencies are in microhertz; reverse is negative.
///
/// Ramp times are those of drives: from 0 to full scale and back, whatever the setpoint is.
#[derive(Clone, Debug)]
pub struct Motor {
    full_scale: i64,
    acceleration: Duration,
    deceleration: Duration,
    since: MonoTime,
    from: i64,
    target: i64,
}

impl Motor {
    /// A motor at standstill. `full_scale` is the frequency, in microhertz and above 0, that is reached
    /// after the acceleration time.
    #[must_use]
    pub fn new(full_scale: i64, acceleration: Duration, deceleration: Duration) -> Self {
        Self {
            full_scale: full_scale.max(1),
            acceleration,
            deceleration,
            since: MonoTime::ZERO,
            from: 0,
            target: 0,
        }
    }

    /// Output frequency at `at` in microhertz; negative in reverse. `at` is not before the last order.
    #[must_use]
    pub fn output(&self, at: MonoTime) -> i64 {
        if self.from == self.target {
            return self.target;
        }
        let mut time = at.since(self.since).as_nanos();
        let mut now = self.from;
        let floor = if now.signum() == self.target.signum() {
            self.target.abs().min(now.abs())
        } else {
            0
        };
        if floor < now.abs() {
            let whole = self.time_for(now.abs() - floor, self.deceleration);
            if time < whole {
                return now.signum() * (now.abs() - self.change_in(time, self.deceleration));
            }
            time -= whole;
            now = now.signum() * floor;
        }
        let rise = self
            .change_in(time, self.acceleration)
            .min(self.target.abs() - now.abs());
        self.target.signum() * (now.abs() + rise)
    }

    /// Ramps to `target` microhertz from `at` on; 0 is a stop by the deceleration ramp, a change of sign
    /// goes through standstill.
    pub fn ramp_to(&mut self, at: MonoTime, target: i64) {
        self.settle(at);
        self.target = target;
    }

    /// Cuts the output off at `at`: it drops to 0 at once and stays there.
    pub fn cut_off(&mut self, at: MonoTime) {
        self.since = at;
        self.from = 0;
        self.target = 0;
    }

    /// Changes the acceleration time from `at` on.
    pub fn set_acceleration(&mut self, at: MonoTime, time: Duration) {
        self.settle(at);
        self.acceleration = time;
    }

    /// Changes the deceleration time from `at` on.
    pub fn set_deceleration(&mut self, at: MonoTime, time: Duration) {
        self.settle(at);
        self.deceleration = time;
    }

    /// Makes `at` the start of the next ramp, so that a new order does not change the past.
    fn settle(&mut self, at: MonoTime) {
        self.from = self.output(at);
        self.since = at;
    }

    /// Nanoseconds in which the output changes by `change`, rounded up.
    fn time_for(&self, change: i64, ramp: Duration) -> u128 {
        (u128::from(change.unsigned_abs()) * ramp.as_nanos())
            .div_ceil(u128::from(self.full_scale.unsigned_abs()))
    }

    /// Change of the output within `nanos` nanoseconds.
    fn change_in(&self, nanos: u128, ramp: Duration) -> i64 {
        let change =
            (u128::from(self.full_scale.unsigned_abs()) * nanos).checked_div(ramp.as_nanos());
        change
            .and_then(|change| i64::try_from(change).ok())
            .unwrap_or(i64::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HZ: i64 = MICROHERTZ;

    fn motor(acceleration_s: u64, deceleration_s: u64) -> Motor {
        Motor::new(
            60 * HZ,
            Duration::from_secs(acceleration_s),
            Duration::from_secs(deceleration_s),
        )
    }

    fn seconds(seconds: u64) -> MonoTime {
        MonoTime::from_millis(seconds * 1_000)
    }

    #[test]
    fn ramps_by_the_time_from_standstill_to_full_scale() {
        let mut motor = motor(10, 30);
        motor.ramp_to(seconds(1), 30 * HZ);
        assert_eq!(motor.output(seconds(1)), 0);
        assert_eq!(motor.output(seconds(3)), 12 * HZ);
        assert_eq!(motor.output(seconds(6)), 30 * HZ);
        assert_eq!(motor.output(seconds(1_000)), 30 * HZ);
        motor.ramp_to(seconds(1_000), 0);
        assert_eq!(motor.output(seconds(1_005)), 20 * HZ);
        assert_eq!(motor.output(seconds(1_015)), 0);
    }

    #[test]
    fn a_reversal_goes_through_standstill() {
        let mut motor = motor(10, 20);
        motor.ramp_to(seconds(0), 60 * HZ);
        motor.ramp_to(seconds(10), -60 * HZ);
        assert_eq!(motor.output(seconds(20)), 30 * HZ);
        assert_eq!(motor.output(seconds(30)), 0);
        assert_eq!(motor.output(seconds(35)), -30 * HZ);
        assert_eq!(motor.output(seconds(40)), -60 * HZ);
        motor.ramp_to(seconds(50), -30 * HZ);
        assert_eq!(motor.output(seconds(55)), -45 * HZ);
        assert_eq!(motor.output(seconds(90)), -30 * HZ);
    }

    #[test]
    fn a_new_ramp_time_does_not_change_the_past() {
        let mut motor = motor(10, 10);
        motor.ramp_to(seconds(0), 60 * HZ);
        motor.set_acceleration(seconds(5), Duration::from_secs(60));
        assert_eq!(motor.output(seconds(5)), 30 * HZ);
        assert_eq!(motor.output(seconds(10)), 35 * HZ);
        motor.ramp_to(seconds(10), 0);
        motor.set_deceleration(seconds(11), Duration::from_secs(60));
        assert_eq!(motor.output(seconds(12)), 28 * HZ);
    }

    #[test]
    fn cut_off_and_ramps_without_time_act_at_once() {
        let mut motor = motor(0, 10);
        motor.ramp_to(seconds(1), 60 * HZ);
        assert_eq!(motor.output(seconds(1)), 60 * HZ);
        motor.cut_off(seconds(2));
        assert_eq!(motor.output(seconds(2)), 0);
        assert_eq!(motor.output(seconds(20)), 0);
    }

    #[test]
    fn a_ramp_asked_for_at_every_odd_moment_never_passes_its_target() {
        let mut motor = motor(7, 3);
        let mut last = 0;
        for step in 0..10_000 {
            let at = MonoTime::from_nanos(step * 777_777);
            motor.ramp_to(at, 50 * HZ);
            let now = motor.output(at);
            assert!(now >= last && now <= 50 * HZ);
            last = now;
        }
        assert_eq!(motor.output(seconds(100)), 50 * HZ);
    }
}
