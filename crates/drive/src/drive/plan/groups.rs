//! Which registers share a read: neighbours, and those with only registers between them that may be read along.

use crate::domain::address::Address;
use crate::profile::model::{Confidence, FactPart, Model, PollClass, Register};
use std::time::Duration;

/// Slow period in fast periods.
pub const SLOW_FACTOR: u32 = 4;
/// Widest hole between two groups that is read along, in words. Its 26 characters cost less than another exchange at 9600
/// bit/s and above: 8 characters of the request, 5 of the reply, at least 3.5 of silence, and the drive's processing time,
/// 10 of them where that is not documented.
pub const HOLE_MAX: u16 = 13;

/// How often a drive is polled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PollPace {
    /// Time between two polls of each class, in the order of the classes: it is asked for with every value.
    periods: [Duration; PollClass::ALL.len()],
}

impl PollPace {
    /// The pace of a drive with fast polls every `poll` on a line that stretches every period by `stretch`. A `stretch`
    /// below 1 or NaN counts as 1.
    #[must_use]
    pub fn new(poll: Duration, stretch: f64) -> Self {
        let stretch = stretch.clamp(1.0, 1e6).max(1.0);
        let period = |class| {
            let wanted = match class {
                PollClass::Fast => poll,
                PollClass::Second => poll.max(Duration::from_secs(1)),
                PollClass::Slow => poll * SLOW_FACTOR,
                PollClass::Minutely => (poll * SLOW_FACTOR).max(Duration::from_secs(60)),
                PollClass::Hourly => (poll * SLOW_FACTOR).max(Duration::from_secs(3600)),
            };
            wanted.mul_f64(stretch).max(Duration::from_millis(1))
        };
        Self {
            periods: PollClass::ALL.map(period),
        }
    }

    /// Time between two polls of `class`.
    #[must_use]
    pub const fn period(&self, class: PollClass) -> Duration {
        self.periods[class as usize]
    }
}

/// One periodic read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PollGroup {
    /// First register.
    pub address: Address,
    /// Number of words.
    pub count: u16,
    /// How often.
    pub class: PollClass,
}

impl PollGroup {
    /// Time between two reads of this group on a drive that is polled at `pace`.
    #[must_use]
    pub fn period(&self, pace: PollPace) -> Duration {
        pace.period(self.class)
    }

    /// One read for both, if `model` takes one so long: its first register, its words, and those of them that lie between
    /// the two groups.
    pub(super) fn with(&self, other: &Self, model: &Model) -> Option<(Address, u16, u16)> {
        let (low, high) = if self.address <= other.address {
            (self, other)
        } else {
            (other, self)
        };
        let hole = high
            .address
            .offset_from(low.address.checked_add(low.count)?)?;
        let words = low.count.checked_add(hole)?.checked_add(high.count)?;
        (hole <= HOLE_MAX && words <= model.words_in_one_read(low.address)).then_some((
            low.address,
            words,
            hole,
        ))
    }

    /// Both halves, without a value of two words between them; `None` if it is a single value.
    pub(super) fn halves(&self, model: &Model) -> Option<(Self, Self)> {
        let is_split = |register: &Register, offset| {
            register.form.words() > 1
                && self.address.checked_add(offset - 1) == Some(register.address)
        };
        let may = |offset: &u16| {
            !model
                .registers
                .iter()
                .any(|register| is_split(register, *offset))
        };
        let offset = (1..self.count)
            .filter(may)
            .min_by_key(|offset| offset.abs_diff(self.count / 2))?;
        let high = Self {
            address: self.address.checked_add(offset)?,
            count: self.count - offset,
            ..*self
        };
        Some((
            Self {
                count: offset,
                ..*self
            },
            high,
        ))
    }

    /// The registers between the two groups.
    pub(super) fn between(&self, other: &Self) -> impl Iterator<Item = Address> {
        let (low, high) = if self.address <= other.address {
            (self, other)
        } else {
            (other, self)
        };
        let end = high.address;
        low.address
            .saturating_add(low.count)
            .onwards()
            .take_while(move |address| *address < end)
    }
}

/// The poll groups of `model`: fast ones first, each class in order of address. Registers of one class share a frame up
/// to the model's limit and group boundary if they are adjacent, or if all between them [may be read
/// along](may_be_read_along).
#[must_use]
pub fn groups(model: &Model) -> Vec<PollGroup> {
    let mut groups: Vec<PollGroup> = Vec::new();
    for (group, _) in apart(model, |_, _| true) {
        let bridged = groups
            .last()
            .filter(|last| last.class == group.class)
            .and_then(|last| {
                let (address, count, _) = last.with(&group, model)?;
                let ends_are_shown = [last, &group]
                    .into_iter()
                    .all(|group| is_shown(model, group));
                let may = ends_are_shown
                    && last
                        .between(&group)
                        .all(|hole| may_be_read_along(model, hole));
                may.then_some(PollGroup {
                    address,
                    count,
                    ..group
                })
            });
        match (bridged, groups.last_mut()) {
            (Some(bridged), Some(last)) => *last = bridged,
            _ => groups.push(group),
        }
    }
    groups
}

/// The groups without holes and whether each is proven; `may_join` decides whether neighbours may share a group.
pub(super) fn apart(
    model: &Model,
    may_join: impl Fn(bool, bool) -> bool,
) -> Vec<(PollGroup, bool)> {
    let mut groups: Vec<(PollGroup, bool)> = Vec::new();
    for class in [
        PollClass::Fast,
        PollClass::Second,
        PollClass::Slow,
        PollClass::Minutely,
        PollClass::Hourly,
    ] {
        for (address, words, is_proven) in polled(model, class) {
            match groups.last_mut() {
                Some((last, _)) if last.class == class && covers(last, address, words) => {}
                Some((last, proven))
                    if last.class == class
                        && follows(model, last, address, words)
                        && may_join(*proven, is_proven) =>
                {
                    last.count += words;
                }
                _ => groups.push((
                    PollGroup {
                        address,
                        count: words,
                        class,
                    },
                    is_proven,
                )),
            }
        }
    }
    groups
}

/// What is polled in `class`, in order of address: first word, number of words that belong together, and whether it is
/// documented. The words that are added to a value are polled with it.
fn polled(model: &Model, class: PollClass) -> Vec<(Address, u16, bool)> {
    let mut polled = Vec::new();
    for register in model
        .registers
        .iter()
        .filter(|register| register.poll == Some(class))
    {
        let is_proven = is_documented(register);
        polled.push((register.address, register.form.words(), is_proven));
        polled.extend(
            register
                .form
                .plus
                .iter()
                .map(|part| (part.address, 1, is_proven)),
        );
    }
    polled.sort_by_key(|(address, words, _)| (*address, std::cmp::Reverse(*words)));
    polled
}

/// Whether `words` from `address` on lie within `group`: another register may be a field of the same word.
fn covers(group: &PollGroup, address: Address, words: u16) -> bool {
    address
        .offset_from(group.address)
        .is_some_and(|offset| offset + words <= group.count)
}

/// Whether a read of others may cover `address`: the model lists it, and its own documents show that it can be read. A
/// number that does not exist spoils a whole read, unless the model says that holes can be read.
pub(super) fn may_be_read_along(model: &Model, address: Address) -> bool {
    model.readable_at(address).is_some_and(is_documented) || model.is_readable_hole(address)
}

fn is_shown(model: &Model, group: &PollGroup) -> bool {
    group
        .address
        .onwards()
        .take(group.count.into())
        .all(|address| may_be_read_along(model, address))
}

/// Whether documents of the model show it. What only the operator states may be wrong.
fn is_documented(register: &Register) -> bool {
    register.proves(FactPart::Reading) && register.confidence != Confidence::Configured
}

fn follows(model: &Model, group: &PollGroup, address: Address, words: u16) -> bool {
    let count = group.count.saturating_add(words);
    group.address.checked_add(group.count) == Some(address)
        && count <= model.words_in_one_read(group.address)
}
