//! The poll plan of one drive: its polled registers, merged into as few frames as the model allows, and when each is
//! due.
//!
//! Registers that no document of the model itself shows are read separately until the drive has answered for them once,
//! so that the others can be read from a drive that does not have them. If it never answers for them while it answers
//! for others, they are rarely polled. Registers between two groups are read along, until the drive refuses that.

mod groups;
mod phases;
mod refresh;
#[cfg(test)]
mod tests;

pub use groups::{HOLE_MAX, PollGroup, PollPace, SLOW_FACTOR, groups};
pub use phases::PlaceOnLine;
pub use refresh::{Read, full_refresh, shortest_refresh};

use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::{Model, PollClass};
use crate::wire::exception;
use groups::{apart, may_be_read_along};
use std::cmp::Reverse;
use std::time::Duration;

/// Number of failed reads of unproven registers, or over a hole, before they are given up; each counts only if other
/// requests were answered in between.
const VAIN_MAX: u8 = 3;
/// Period of reads of registers that the drive has never answered for.
const SELDOM: Duration = Duration::from_secs(3600);
/// Period of reads of a refused register without which nothing is known of the motor.
const SOON: Duration = Duration::from_secs(10);

/// Counts failed reads.
#[derive(Clone, Copy, Debug, Default)]
struct VainReads {
    times: u8,
    /// The drive's answers at the last failure.
    at: u64,
}

impl VainReads {
    /// Counts a failure; returns whether that is enough. A drive that answers nothing at all proves nothing.
    const fn again(&mut self, answers: u64) -> bool {
        if self.at < answers {
            self.times = self.times.saturating_add(1);
            self.at = answers;
        }
        self.times >= VAIN_MAX
    }
}

/// One group, without holes, with its times.
#[derive(Clone, Copy, Debug)]
struct PlanEntry {
    group: PollGroup,
    /// A moment at which it falls due once it runs regularly.
    regular: MonoTime,
    due: MonoTime,
    /// Whether the drive is known to answer for it: documents of the model say so, or it has done so.
    is_trusted: bool,
    was_sent: bool,
    vain: VainReads,
    /// The entry is part of a block that was refused, and is asked by itself until the drive has answered for it.
    is_apart: bool,
    /// The code with which the drive refuses its only register: it is rarely polled.
    refused: Option<u8>,
}

/// A register that the drive refuses to show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RefusedRegister {
    /// Where it is.
    pub address: Address,
    /// The exception code of the refusal.
    pub code: u8,
}

/// Whether registers between two groups are read along.
#[derive(Clone, Copy, Debug, Default)]
struct GroupBridges {
    /// The newest read over a hole.
    last: Option<(Address, u16)>,
    are_answered: bool,
    are_refused: bool,
    vain: VainReads,
}

/// The order of due polls: first by the number of whole periods that they have waited, so that an overloaded line
/// stretches all alike; then by class, then by age.
pub type Urgency = (Reverse<u64>, PollClass, MonoTime);

/// The poll groups of one drive with the moments at which they are due.
#[derive(Debug)]
pub struct PollPlan {
    pace: PollPace,
    /// Answers of the drive so far, to any request.
    answers: u64,
    bridges: GroupBridges,
    /// The newest poll.
    last: Option<(Address, u16)>,
    entries: Vec<PlanEntry>,
}

impl PollPlan {
    /// The plan of a drive of `model`. Everything is due at `start`, so that all values are known soon; after that each
    /// group has a phase of its own, so that the polls of a line do not fall due together.
    #[must_use]
    pub fn new(model: &Model, pace: PollPace, start: MonoTime, place: PlaceOnLine) -> Self {
        let groups = apart(model, |a, b| a == b);
        let plain: Vec<PollGroup> = groups.iter().map(|(group, _)| *group).collect();
        let moments = phases::spread(model, &plain, pace, start, place);
        let entry = |((group, is_trusted), regular)| PlanEntry {
            group,
            regular,
            due: start,
            is_trusted,
            was_sent: false,
            vain: VainReads::default(),
            is_apart: false,
            refused: None,
        };
        let entries = groups.into_iter().zip(moments).map(entry).collect();
        Self {
            pace,
            answers: 1,
            bridges: GroupBridges::default(),
            last: None,
            entries,
        }
    }

    /// The port was opened at `now`. Groups never read and fast groups are due at once; all others wait for their
    /// phase, so that they are not all due together.
    pub fn port_opened(&mut self, now: MonoTime) {
        self.bridges = GroupBridges::default();
        let pace = self.pace;
        for entry in self.entries.iter_mut().filter(|entry| entry.due < now) {
            if !entry.was_sent || entry.group.class == PollClass::Fast {
                entry.due = now;
            } else {
                entry.next_regular(pace, now);
            }
        }
        self.ask_refused(now);
    }

    /// What was refused is asked again: the drive may be another one, or set in another way.
    fn ask_refused(&mut self, now: MonoTime) {
        for entry in self
            .entries
            .iter_mut()
            .filter(|entry| entry.refused.is_some())
        {
            entry.regular = entry.regular.min(now);
            entry.due = entry.due.min(now);
        }
    }

    /// The drive answered a request well; where it was a read of ours, it covered `count` words from `address` on.
    pub fn answered(&mut self, address: Address, count: u16) {
        self.answers += 1;
        self.bridges.are_answered |= self.bridges.last == Some((address, count));
        for entry in within(&mut self.entries, address, count) {
            entry.is_trusted = true;
            entry.vain = VainReads::default();
            entry.is_apart = false;
            entry.refused = None;
        }
    }

    /// The registers that the drive refuses to show.
    pub fn refused_registers(&self) -> impl Iterator<Item = RefusedRegister> + '_ {
        let refused = |entry: &PlanEntry| {
            Some(RefusedRegister {
                address: entry.group.address,
                code: entry.refused?,
            })
        };
        self.entries.iter().filter_map(refused)
    }

    /// A read that was none of the polls brought `count` words from `address` on, the last byte of them at `at`: the groups
    /// that lie in it are not due before their period has passed since then. Returns those groups.
    pub fn was_read(&mut self, address: Address, count: u16, at: MonoTime) -> Vec<PollGroup> {
        let pace = self.pace;
        let read = within(&mut self.entries, address, count).map(|entry| {
            entry.was_sent = true;
            entry.due = entry.due.max(at + entry.group.period(pace));
            entry.group
        });
        read.collect()
    }

    /// The drive answered a read of `count` words from `address` on with exception `code`. If it refuses one of the
    /// registers of a poll, the parts of that are asked. Returns a register that is left out from now on.
    pub fn refused(
        &mut self,
        (address, count): (Address, u16),
        code: u8,
        model: &Model,
        now: MonoTime,
    ) -> Option<RefusedRegister> {
        if self.bridges.last == Some((address, count)) {
            self.read_apart(now);
            return None;
        }
        // Vendors have codes of their own for what 02 and 03 say; these say something else.
        let names_registers = !matches!(
            code,
            exception::ILLEGAL_FUNCTION
                | exception::SERVER_DEVICE_FAILURE
                | exception::SERVER_DEVICE_BUSY
                | exception::GATEWAY_PATH_UNAVAILABLE
                | exception::GATEWAY_TARGET_FAILED
        );
        if !names_registers || self.last != Some((address, count)) {
            self.was_in_vain(address, count, now);
            return None;
        }
        let first = self
            .entries
            .iter()
            .position(|entry| holds((address, count), entry.group))?;
        if self
            .entries
            .iter()
            .filter(|entry| holds((address, count), entry.group))
            .count()
            == 1
        {
            return self.part_refused(first, code, model, now);
        }
        for entry in within(&mut self.entries, address, count) {
            entry.is_apart = true;
            entry.due = now;
        }
        None
    }

    /// The drive refused the entry at `index` alone: its halves are asked, or its only register is left out. It is then
    /// refused in earnest: once may be chance.
    fn part_refused(
        &mut self,
        index: usize,
        code: u8,
        model: &Model,
        now: MonoTime,
    ) -> Option<RefusedRegister> {
        let answers = self.answers;
        let entry = self.entries.get_mut(index)?;
        if let Some((low, high)) = entry.group.halves(model) {
            let part = |group| PlanEntry {
                group,
                due: now,
                is_apart: true,
                vain: VainReads::default(),
                ..*entry
            };
            let (low, high) = (part(low), part(high));
            *entry = low;
            self.entries.insert(index + 1, high);
            return None;
        }
        entry.is_apart = true;
        if !entry.vain.again(answers) {
            return None;
        }
        entry.regular = now
            + if model.is_essential(entry.group.address) {
                SOON
            } else {
                SELDOM
            };
        entry.due = entry.regular;
        let is_new = entry.refused.replace(code).is_none();
        is_new.then_some(RefusedRegister {
            address: entry.group.address,
            code,
        })
    }

    /// The drive was silent on a read of `count` words from `address` on.
    pub fn unanswered(&mut self, address: Address, count: u16, now: MonoTime) {
        let is_new = self.bridges.last == Some((address, count)) && !self.bridges.are_answered;
        if is_new && self.bridges.vain.again(self.answers) {
            self.read_apart(now);
        } else {
            self.was_in_vain(address, count, now);
        }
    }

    /// The drive does not accept a read over a hole: its registers are due at once, group by group.
    fn read_apart(&mut self, now: MonoTime) {
        self.bridges.are_refused = true;
        if let Some((address, count)) = self.bridges.last.take() {
            within(&mut self.entries, address, count).for_each(|entry| entry.due = now);
        }
    }

    fn was_in_vain(&mut self, address: Address, count: u16, now: MonoTime) {
        let answers = self.answers;
        for entry in within(&mut self.entries, address, count).filter(|entry| !entry.is_trusted) {
            if entry.vain.again(answers) {
                entry.regular = now + SELDOM;
                entry.due = entry.regular;
            }
        }
    }

    /// The drive answers again: registers that a person may have changed meanwhile are due at once.
    pub fn drive_is_back(&mut self, now: MonoTime) {
        for entry in self
            .entries
            .iter_mut()
            .filter(|entry| entry.group.class == PollClass::Minutely)
        {
            entry.due = entry.due.min(now);
        }
        self.ask_refused(now);
    }

    /// The register at `address` is due at `moment`, if not earlier.
    pub fn ask_for(&mut self, address: Address, moment: MonoTime) {
        for entry in self
            .entries
            .iter_mut()
            .filter(|entry| covers(entry.group, address))
        {
            entry.due = entry.due.min(moment);
        }
    }

    /// Index, group and due time of each group.
    pub fn iter(&self) -> impl Iterator<Item = (usize, PollGroup, MonoTime)> + '_ {
        self.entries
            .iter()
            .enumerate()
            .map(|(index, entry)| (index, entry.group, entry.due))
    }

    /// How urgent a group is at `now` that has been due since `due`.
    #[must_use]
    pub fn urgency(&self, group: PollGroup, due: MonoTime, now: MonoTime) -> Urgency {
        // An hourly poll must not wait for hours.
        let period = group
            .period(self.pace)
            .min(self.pace.period(PollClass::Slow));
        let waited = now.since(due).as_millis() / period.as_millis().max(1);
        (
            Reverse(u64::try_from(waited).unwrap_or(u64::MAX)),
            group.class,
            due,
        )
    }

    /// Whether a group that has been due since `due` is too old at `now` to wait for others: a fast one after half its
    /// period, any other after a whole one.
    #[must_use]
    pub fn is_aged(&self, group: PollGroup, due: MonoTime, now: MonoTime) -> bool {
        let is_fast =
            group.class == PollClass::Fast && now.since(due) * 2 > group.period(self.pace);
        is_fast || self.urgency(group, due, now).0.0 > 0
    }

    /// Takes the group at `index` for the wire at `now`, with due neighbours of any class, as far as one read of
    /// `model` reaches and `may_go` allows the longer read. Returns first register and number of words.
    pub fn take(
        &mut self,
        index: usize,
        now: MonoTime,
        model: &Model,
        may_go: impl Fn(Address, u16) -> bool,
    ) -> Option<(Address, u16)> {
        let PlanEntry {
            group: mut all,
            is_trusted,
            is_apart,
            ..
        } = *self.entries.get(index)?;
        self.sent(index, now);
        let mut has_holes = false;
        while is_trusted
            && !is_apart
            && let Some((neighbour, longer, hole)) = self.due_neighbour(&all, now, model, &may_go)
        {
            all = longer;
            has_holes |= hole > 0;
            self.sent(neighbour, now);
        }
        let read = (all.address, all.count);
        self.bridges.last = has_holes.then_some(read);
        self.last = Some(read);
        Some(read)
    }

    /// A group that is due at `now` and fits into one read with `all`, that read, and the number of words between them.
    fn due_neighbour(
        &self,
        all: &PollGroup,
        now: MonoTime,
        model: &Model,
        may_go: impl Fn(Address, u16) -> bool,
    ) -> Option<(usize, PollGroup, u16)> {
        let is_apart = |address| {
            self.entries
                .iter()
                .any(|it| it.is_apart && covers(it.group, address))
        };
        let joined = |entry: &PlanEntry| {
            let (address, count, hole) = all.with(&entry.group, model)?;
            let mut between = all.between(&entry.group);
            let may_bridge = !self.bridges.are_refused
                && between.all(|it| may_be_read_along(model, it) && !is_apart(it));
            ((hole == 0 || may_bridge) && may_go(address, count)).then_some((address, count, hole))
        };
        let may_join = |entry: &PlanEntry| entry.is_trusted && !entry.is_apart && entry.due <= now;
        let due = self
            .entries
            .iter()
            .enumerate()
            .filter(|(_, entry)| may_join(entry));
        let fitting = due.filter_map(|(index, entry)| {
            let (address, count, hole) = joined(entry)?;
            Some((
                index,
                PollGroup {
                    address,
                    count,
                    ..*all
                },
                hole,
            ))
        });
        // The nearest, so that what lies between the two is not read on its own.
        fitting.min_by_key(|(_, longer, _)| longer.count)
    }

    fn sent(&mut self, index: usize, now: MonoTime) {
        let pace = self.pace;
        if let Some(entry) = self.entries.get_mut(index) {
            entry.was_sent = true;
            entry.next_regular(pace, now);
        }
    }
}

impl PlanEntry {
    /// Sets the due time to the next one in its phase after `now`. Missed periods are skipped, so that a line that fell
    /// behind does not try to catch up.
    fn next_regular(&mut self, pace: PollPace, now: MonoTime) {
        if now >= self.regular {
            let period = self.group.period(pace);
            let missed = now.since(self.regular).as_nanos() / period.as_nanos();
            self.regular = self.regular + period * u32::try_from(missed + 1).unwrap_or(u32::MAX);
        }
        self.due = self.regular;
    }
}

/// The entries that lie within `count` words from `address` on.
fn within(
    entries: &mut [PlanEntry],
    address: Address,
    count: u16,
) -> impl Iterator<Item = &mut PlanEntry> {
    entries
        .iter_mut()
        .filter(move |entry| holds((address, count), entry.group))
}

/// Whether `group` lies within a read.
fn holds((address, count): (Address, u16), group: PollGroup) -> bool {
    let offset = group.address.offset_from(address);
    offset.is_some_and(|offset| u32::from(offset) + u32::from(group.count) <= u32::from(count))
}

/// Whether the register at `address` is in `group`.
fn covers(group: PollGroup, address: Address) -> bool {
    address
        .offset_from(group.address)
        .is_some_and(|offset| offset < group.count)
}
