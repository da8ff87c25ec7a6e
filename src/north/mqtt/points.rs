//! How each register of a drive is published: which change is news, how often it is repeated without one, and with how
//! many digits.

use super::drive_topics::Kind;
use super::slot::Content;
use crate::drive::description::DriveDescription;
use crate::drive::rated::Rated;
use crate::profile::model::{Model, Register};
use crate::profile::scale::{Scaled, digits_of};
use std::time::Duration;

/// Digits of a value that is derived from a rated one.
const RATED_DIGITS: u8 = 2;

/// How the registers of a drive are published, in the order of its model.
#[derive(Debug)]
pub(in crate::north) struct Points(Vec<Point>);

/// How one register is published.
#[derive(Clone, Copy, Debug)]
struct Point {
    /// Smallest change that is news, in steps.
    band: f64,
    heartbeat: Option<Duration>,
    /// Fewer digits than the register has; `None`: all.
    digits: Option<u8>,
}

impl Points {
    pub(in crate::north) fn new(drive: &DriveDescription) -> Self {
        Self(drive.model.registers.iter().map(|register| Point::new(drive, register)).collect())
    }

    /// The heartbeat of a topic that has one of its own.
    pub(super) fn heartbeat(&self, kind: Kind) -> Option<Duration> {
        match kind {
            Kind::Polled(place) | Kind::Rated(place) => self.0.get(place)?.heartbeat,
            _ => None,
        }
    }

    /// `content` as published on a topic; `None`: the topic is empty.
    pub(super) fn shown(&self, kind: Kind, content: &Content, drive: &DriveDescription) -> Option<String> {
        let word = match content {
            Content::Cleared => return None,
            Content::Text(text) => return Some(text.clone().into_owned()),
            Content::Word(word) => *word,
        };
        let place = kind.register()?;
        let register = drive.model.registers.get(place)?;
        let all = Scaled::from_word(word, register);
        Some(match (kind, self.digits(place)) {
            (Kind::Rated(_), digits) => {
                let digits = digits.map_or(RATED_DIGITS, |digits| digits.min(RATED_DIGITS));
                Rated::of(register, &drive.ratings)?.to_digits(word, digits).to_string()
            }
            (Kind::Polled(_), Some(digits)) => all.to_digits(digits).to_string(),
            _ => all.to_string(),
        })
    }

    /// Whether a change of the topic's register from `old` to `new` is news.
    pub(in crate::north) fn differ_on(&self, kind: Kind, drive: &DriveDescription, old: u16, new: u16) -> bool {
        let text = |word| self.shown(kind, &Content::Word(word), drive);
        match kind {
            Kind::Polled(place) => self.differ(&drive.model, place, old, new),
            Kind::Rated(place) => self.differ(&drive.model, place, old, new) && text(old) != text(new),
            _ => old != new,
        }
    }

    /// Whether a change of the register of `model` at `place` from `old` to `new` is news.
    pub(super) fn differ(&self, model: &Model, place: usize, old: u16, new: u16) -> bool {
        let (Some(point), Some(register)) = (self.0.get(place), model.registers.get(place)) else { return false };
        point.is_beyond_band(register, old, new) && point.looks_different(register, old, new)
    }

    /// The value of `word` in `register`, which is at `place`.
    pub(in crate::north) fn value(&self, place: usize, register: &Register, word: u16) -> f64 {
        let scaled = Scaled::from_word(word, register);
        self.digits(place).map_or_else(|| scaled.value(), |digits| scaled.to_digits(digits).value())
    }

    fn digits(&self, place: usize) -> Option<u8> {
        self.0.get(place)?.digits
    }
}

impl Point {
    fn new(drive: &DriveDescription, register: &Register) -> Self {
        let band = named(&drive.points.dead_bands, register).map(|band| band * f64::from(register.scale));
        let digits = drive.points.decimals_of(register).filter(|digits| *digits < digits_of(register.scale));
        Self { band: band.unwrap_or(1.0), heartbeat: named(&drive.points.heartbeats, register), digits }
    }

    fn is_beyond_band(&self, register: &Register, old: u16, new: u16) -> bool {
        // A band in decimal is seldom exactly a whole number of steps.
        const ROUNDING: f64 = 1e-6;
        let raw = |word: u16| if register.signed { i32::from(word.cast_signed()) } else { i32::from(word) };
        old != new && f64::from((raw(old) - raw(new)).abs()) + ROUNDING >= self.band
    }

    fn looks_different(&self, register: &Register, old: u16, new: u16) -> bool {
        let shown = |word: u16, digits: u8| Scaled::from_word(word, register).to_digits(digits);
        self.digits.is_none_or(|digits| shown(old, digits) != shown(new, digits))
    }
}

fn named<T: Copy>(list: &[(String, T)], register: &Register) -> Option<T> {
    list.iter().find(|(name, _)| *name == register.name).map(|(_, it)| *it)
}
