//! The poll plan of one drive: its polled registers, neighbours merged into as few frames as the model allows.
//!
//! Registers that no document of the model itself shows are read apart from the others until the drive has answered for
//! them once, so that a drive that does not know them loses nothing else by it. If it never answers for them while it
//! answers for others, they are asked for seldom.

use crate::domain::time::MonoTime;
use crate::profile::model::{Confidence, Model, PollClass, Register};
use std::time::Duration;

/// How many fast periods a slow poll waits.
pub const SLOW_FACTOR: u32 = 4;
/// How often registers that are not proven are asked for in vain, each time with answers to other requests in between,
/// before they are asked for seldom.
const VAIN_MAX: u8 = 3;
/// How often that is.
const SELDOM: Duration = Duration::from_secs(3600);

/// Time between two polls of `class` on a drive whose poll period is `poll`.
#[must_use]
pub fn period(class: PollClass, poll: Duration) -> Duration {
    match class {
        PollClass::Fast => poll,
        PollClass::Second => poll.max(Duration::from_secs(1)),
        PollClass::Slow => poll * SLOW_FACTOR,
        PollClass::Hourly => (poll * SLOW_FACTOR).max(Duration::from_secs(3600)),
    }
}

/// One read that is repeated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PollGroup {
    /// First register.
    pub address: u16,
    /// Number of words.
    pub count: u16,
    /// How often.
    pub class: PollClass,
}

impl PollGroup {
    /// Time between two reads of this group on a drive whose poll period is `poll`.
    #[must_use]
    pub fn period(&self, poll: Duration) -> Duration {
        period(self.class, poll)
    }
}

/// The poll groups of `model`: fast ones first, each in order of address. Registers of one class that
/// follow each other without a hole share a frame up to the model's limit and group boundary.
#[must_use]
pub fn groups(model: &Model) -> Vec<PollGroup> {
    joined(model, |_, _| true).into_iter().map(|(group, _)| group).collect()
}

/// The groups with whether they are proven, as far as `may_join` lets neighbours share one.
fn joined(model: &Model, may_join: impl Fn(bool, bool) -> bool) -> Vec<(PollGroup, bool)> {
    let mut groups: Vec<(PollGroup, bool)> = Vec::new();
    for class in [PollClass::Fast, PollClass::Second, PollClass::Slow, PollClass::Hourly] {
        for register in model.registers.iter().filter(|register| register.poll == Some(class)) {
            let (address, is_proven) = (register.address, is_documented(register));
            match groups.last_mut() {
                Some((last, proven))
                    if last.class == class && joins(model, last, address) && may_join(*proven, is_proven) =>
                {
                    last.count += 1;
                }
                _ => groups.push((PollGroup { address, count: 1, class }, is_proven)),
            }
        }
    }
    groups
}

/// Documents of the model show it. What only the operator states may be wrong.
fn is_documented(register: &Register) -> bool {
    register.confidence.is_proven() && register.confidence != Confidence::Configured
}

fn joins(model: &Model, group: &PollGroup, address: u16) -> bool {
    group.address.checked_add(group.count) == Some(address) && group.count < model.words_in_one_read(group.address)
}

/// One group with its times.
#[derive(Clone, Copy, Debug)]
struct Entry {
    group: PollGroup,
    /// A moment at which it falls due once it runs regularly.
    regular: MonoTime,
    due: MonoTime,
    /// The drive is known to answer for it: documents of the model say so, or it has done so.
    is_trusted: bool,
    /// How often it was asked for in vain, and the drive's answers so far when it was last.
    vain: u8,
    vain_at: u64,
}

/// The poll groups of one drive with the moments at which they are due.
#[derive(Debug)]
pub struct PollPlan {
    poll: Duration,
    /// Answers of the drive so far, to whatever request.
    answers: u64,
    entries: Vec<Entry>,
}

impl PollPlan {
    /// The plan of a drive of `model`. Everything is due at `start`, so that the drive is known soon; then
    /// `phase` (0 to 1) moves its polls by that part of their period, so that the drives of a line do not
    /// fall due together.
    #[must_use]
    pub fn new(model: &Model, poll: Duration, start: MonoTime, phase: f64) -> Self {
        let entry = |(group, is_trusted): (PollGroup, bool)| {
            let regular = start + group.period(poll).mul_f64(phase.clamp(0.0, 1.0));
            Entry { group, regular, due: start, is_trusted, vain: 0, vain_at: 0 }
        };
        let groups = joined(model, |a, b| a == b);
        Self { poll, answers: 1, entries: groups.into_iter().map(entry).collect() }
    }

    /// The drive answered a request well; where it was a read of ours, it covered `count` words from `address` on.
    pub fn answered(&mut self, address: u16, count: u16) {
        self.answers += 1;
        for entry in within(&mut self.entries, address, count) {
            (entry.is_trusted, entry.vain) = (true, 0);
        }
    }

    /// The drive answered a read of `count` words from `address` on with an exception, or was silent.
    pub fn was_in_vain(&mut self, address: u16, count: u16, now: MonoTime) {
        let answers = self.answers;
        for entry in within(&mut self.entries, address, count).filter(|entry| !entry.is_trusted) {
            // A drive that answers nothing at all tells nothing about these registers.
            if entry.vain_at < answers {
                (entry.vain, entry.vain_at) = (entry.vain.saturating_add(1), answers);
            }
            if entry.vain >= VAIN_MAX {
                entry.regular = now + SELDOM;
                entry.due = entry.regular;
            }
        }
    }

    /// The number of each group, what it reads and when it is due.
    pub fn iter(&self) -> impl Iterator<Item = (usize, PollGroup, MonoTime)> + '_ {
        self.entries.iter().enumerate().map(|(index, entry)| (index, entry.group, entry.due))
    }

    /// Whether a group that is due since `due` has grown older than half its period by `now`.
    #[must_use]
    pub fn is_aged(&self, group: PollGroup, due: MonoTime, now: MonoTime) -> bool {
        now.since(due) * 2 > group.period(self.poll)
    }

    /// Takes the group at `index` for the wire at `now`, with its neighbours that are due as well, whatever their class,
    /// as far as one read of `model` reaches and `may_go` allows the longer read. Returns what is to be read.
    pub fn take(
        &mut self,
        index: usize,
        now: MonoTime,
        model: &Model,
        may_go: impl Fn(u16, u16) -> bool,
    ) -> Option<(u16, u16)> {
        let Entry { group: PollGroup { mut address, mut count, .. }, is_trusted, .. } = *self.entries.get(index)?;
        self.sent(index, now);
        while is_trusted && let Some((neighbour, group)) = self.due_neighbour(address, count, now) {
            let (from, words) = (address.min(group.address), count + group.count);
            if words > model.words_in_one_read(from) || !may_go(from, words) {
                break;
            }
            (address, count) = (from, words);
            self.sent(neighbour, now);
        }
        Some((address, count))
    }

    fn due_neighbour(&self, address: u16, count: u16, now: MonoTime) -> Option<(usize, PollGroup)> {
        let end = address.checked_add(count);
        let touches =
            |group: &PollGroup| Some(group.address) == end || group.address.checked_add(group.count) == Some(address);
        let mut due = self.entries.iter().enumerate().filter(|(_, entry)| entry.is_trusted && entry.due <= now);
        due.find(|(_, entry)| touches(&entry.group)).map(|(index, entry)| (index, entry.group))
    }

    /// Notes that the group at `index` goes out at `now`. Periods that were missed are left out, so that a line
    /// that fell behind does not try to catch up; the phase is kept.
    fn sent(&mut self, index: usize, now: MonoTime) {
        let Some(entry) = self.entries.get_mut(index) else { return };
        let period = entry.group.period(self.poll).max(Duration::from_millis(1));
        if now < entry.regular {
            entry.due = entry.regular;
            return;
        }
        let missed = now.since(entry.regular).as_nanos() / period.as_nanos();
        entry.regular = entry.regular + period * u32::try_from(missed + 1).unwrap_or(u32::MAX);
        entry.due = entry.regular;
    }
}

/// The entries that lie within `count` words from `address` on.
fn within(entries: &mut [Entry], address: u16, count: u16) -> impl Iterator<Item = &mut Entry> {
    let end = u32::from(address) + u32::from(count);
    entries.iter_mut().filter(move |Entry { group, .. }| {
        group.address >= address && u32::from(group.address) + u32::from(group.count) <= end
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::vendors;

    fn model() -> Model {
        let (_, text) = vendors::texts().first().expect("a built-in model");
        check::model(text).expect("a sound model")
    }

    #[test]
    fn neighbours_share_a_frame_and_classes_do_not() {
        let groups: Vec<_> = groups(&model()).iter().map(|group| (group.address, group.count)).collect();
        // D001; trip count; F001; F010 and F011 together
        assert_eq!(groups, [(0x0101, 1), (0x0112, 1), (0x0201, 1), (0x0211, 2)]);
    }

    #[test]
    fn neighbours_that_are_due_together_go_together_whatever_their_class() {
        let mut model = model();
        let slow = |address: u16| Register { address, poll: Some(PollClass::Slow), ..model.registers[2].clone() };
        let (before, after) = (slow(0x0100), slow(0x0102));
        model.registers.extend([before, after]);
        model.registers.sort_by_key(|register| register.address);
        let at = MonoTime::from_millis;
        let mut plan = PollPlan::new(&model, Duration::from_millis(100), at(0), 0.0);
        let fast = |plan: &PollPlan| plan.iter().find(|(_, group, _)| group.address == 0x0101).map(|(index, ..)| index);
        let index = fast(&plan).unwrap();
        assert_eq!(plan.take(index, at(0), &model, |_, _| true), Some((0x0100, 3)), "all are due at the start");
        assert_eq!(plan.take(index, at(100), &model, |_, _| true), Some((0x0101, 1)), "the slow ones are not due");
        let due = plan.iter().filter(|(_, _, due)| *due <= at(100)).count();
        assert_eq!(due, 3, "those elsewhere still wait");
        assert_eq!(plan.take(index, at(400), &model, |_, words| words < 3), Some((0x0100, 2)), "as far as it may");
    }

    #[test]
    fn a_line_that_fell_behind_keeps_its_phase_and_does_not_catch_up() {
        let at = MonoTime::from_millis;
        let mut plan = PollPlan::new(&model(), Duration::from_millis(100), at(1000), 0.25);
        let due = |plan: &PollPlan| plan.iter().next().map(|(_, _, due)| due).expect("a group");
        assert_eq!(due(&plan), at(1000), "known soon");
        plan.sent(0, at(1010));
        assert_eq!(due(&plan), at(1025), "then in its phase");
        plan.sent(0, at(1025));
        assert_eq!(due(&plan), at(1125));
        plan.sent(0, at(1777));
        assert_eq!(due(&plan), at(1825));
        let group = plan.entries[0].group;
        assert!(!plan.is_aged(group, at(1825), at(1875)) && plan.is_aged(group, at(1825), at(1876)));
    }

    #[test]
    fn what_is_not_proven_is_read_apart_until_it_is_answered_and_seldom_if_it_never_is() {
        let mut model = model();
        let at = MonoTime::from_millis;
        let output = model.registers.iter().position(|register| register.address == 0x0101).unwrap();
        let unproven =
            Register { address: 0x0102, confidence: Confidence::Inferred, ..model.registers[output].clone() };
        model.registers.insert(output + 1, unproven);
        assert_eq!(groups(&model)[0].count, 2, "what a line is planned with");
        let mut plan = PollPlan::new(&model, Duration::from_millis(100), at(0), 0.0);
        assert_eq!(plan.take(0, at(0), &model, |_, _| true), Some((0x0101, 1)));
        assert_eq!(plan.take(1, at(0), &model, |_, _| true), Some((0x0102, 1)));
        for round in 1..=6_u64 {
            plan.was_in_vain(0x0102, 1, at(round * 100));
            assert_eq!(plan.entries[1].due <= at(700), round < 4, "{round}: silence alone tells nothing");
            if round >= 2 {
                plan.answered(0x0101, 1);
            }
        }
        plan.answered(0x0102, 1);
        assert_eq!(plan.take(0, at(4_000_000), &model, |_, _| true), Some((0x0101, 2)), "known now");
    }
}
