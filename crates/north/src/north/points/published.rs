//! How each register of a drive is published: which change is news, how often it is repeated without one, and with how
//! many digits.

use super::content::PointContent;
use super::point::DrivePoint;
use crate::drive::description::DriveDescription;
use crate::drive::rated::RatedConversion;
use crate::profile::model::Register;
use crate::profile::scale::ScaledValue;
use std::time::Duration;

/// Digits of a value that is derived from a rated one.
pub const RATED_DIGITS: u8 = 2;

/// How the registers of a drive are published, in the order of its model.
#[derive(Debug)]
pub struct PublishedPoints(Vec<PublishedPoint>);

/// How one register is published.
#[derive(Clone, Copy, Debug)]
struct PublishedPoint {
    /// Smallest change that is news; `None`: any.
    band: Option<f64>,
    heartbeat: Option<Duration>,
    /// Fewer digits than the register has; `None`: all.
    digits: Option<u8>,
}

impl PublishedPoints {
    pub fn new(drive: &DriveDescription) -> Self {
        Self(
            drive
                .model
                .registers
                .iter()
                .map(|register| PublishedPoint::new(drive, register))
                .collect(),
        )
    }

    /// The heartbeat of a point that has one of its own.
    pub fn heartbeat(&self, point: DrivePoint) -> Option<Duration> {
        match point {
            DrivePoint::Polled(place) | DrivePoint::Rated(place) => self.0.get(place)?.heartbeat,
            _ => None,
        }
    }

    /// `content` of a point as text; `None` if there is none.
    pub fn shown(
        &self,
        point: DrivePoint,
        content: &PointContent,
        drive: &DriveDescription,
    ) -> Option<String> {
        let all = match content {
            PointContent::Unknown => return None,
            PointContent::Text(text) => return Some(text.clone().into_owned()),
            PointContent::Flag(flag) => return Some(flag.to_string()),
            PointContent::Number(number) => return Some(number.to_string()),
            PointContent::Hertz(hertz) => return Some(hertz.to_string()),
            PointContent::Sum(sum) => return Some(sum.to_string()),
            PointContent::Value(value) => *value,
        };
        let place = point.register()?;
        let register = drive.model.registers.get(place)?;
        Some(match (point, self.digits(place)) {
            (DrivePoint::Rated(_), digits) => {
                let digits = digits.map_or(RATED_DIGITS, |digits| digits.min(RATED_DIGITS));
                RatedConversion::of(register, &drive.ratings)?
                    .to_digits(all, digits)
                    .to_string()
            }
            (DrivePoint::Polled(_), Some(digits)) => all.to_digits(digits).to_string(),
            _ => all.to_string(),
        })
    }

    /// Whether a change of the point's register from `old` to `new` is news.
    pub fn differ_on(
        &self,
        point: DrivePoint,
        drive: &DriveDescription,
        old: ScaledValue,
        new: ScaledValue,
    ) -> bool {
        let text = |value| self.shown(point, &PointContent::Value(value), drive);
        match point {
            DrivePoint::Polled(place) => self.differ(place, old, new),
            DrivePoint::Rated(place) => self.differ(place, old, new) && text(old) != text(new),
            _ => old != new,
        }
    }

    /// Whether a change of the model's register at `place` from `old` to `new` is news.
    pub fn differ(&self, place: usize, old: ScaledValue, new: ScaledValue) -> bool {
        let Some(point) = self.0.get(place) else {
            return false;
        };
        point.is_beyond_band(old, new) && point.looks_different(old, new)
    }

    /// The number that is shown for `scaled`, the value of the register at `place`.
    pub fn value(&self, place: usize, scaled: ScaledValue) -> f64 {
        self.digits(place)
            .map_or_else(|| scaled.value(), |digits| scaled.to_digits(digits).value())
    }

    fn digits(&self, place: usize) -> Option<u8> {
        self.0.get(place)?.digits
    }
}

impl PublishedPoint {
    fn new(drive: &DriveDescription, register: &Register) -> Self {
        let band = value_of_register(&drive.points.dead_bands, register);
        let digits = drive
            .points
            .decimals_of(register)
            .filter(|digits| *digits < register.digits());
        Self {
            band,
            heartbeat: value_of_register(&drive.points.heartbeats, register),
            digits,
        }
    }

    fn is_beyond_band(&self, old: ScaledValue, new: ScaledValue) -> bool {
        // A band in decimal is seldom exactly a whole number of steps.
        const ROUNDING: f64 = 1e-6;
        let steps = |value: ScaledValue| value.fraction().0 as f64;
        let in_steps = |band: f64| band * new.fraction().1 as f64;
        let is_beyond = |band| (steps(old) - steps(new)).abs() + ROUNDING >= in_steps(band);
        let is_comparable = old.fraction().1 == new.fraction().1;
        old != new
            && self
                .band
                .is_none_or(|band| !is_comparable || is_beyond(band))
    }

    fn looks_different(&self, old: ScaledValue, new: ScaledValue) -> bool {
        let shown = |value: ScaledValue, digits: u8| value.to_digits(digits);
        self.digits
            .is_none_or(|digits| shown(old, digits) != shown(new, digits))
    }
}

fn value_of_register<T: Copy>(list: &[(String, T)], register: &Register) -> Option<T> {
    list.iter()
        .find(|(name, _)| *name == register.name)
        .map(|(_, it)| *it)
}
