//! The poll plan of one drive: its polled registers, neighbours merged into as few frames as the model allows.

use crate::domain::time::MonoTime;
use crate::profile::model::{Model, PollClass};
use std::time::Duration;

/// How many fast periods a slow poll waits.
pub const SLOW_FACTOR: u32 = 4;

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
        match self.class {
            PollClass::Fast => poll,
            PollClass::Slow => poll * SLOW_FACTOR,
        }
    }
}

/// The poll groups of `model`: fast ones first, each in order of address. Registers of one class that
/// follow each other without a hole share a frame up to the model's limit and group boundary.
#[must_use]
pub fn groups(model: &Model) -> Vec<PollGroup> {
    let mut groups: Vec<PollGroup> = Vec::new();
    for class in [PollClass::Fast, PollClass::Slow] {
        for register in model.registers.iter().filter(|register| register.poll == Some(class)) {
            match groups.last_mut() {
                Some(last) if last.class == class && joins(model, last, register.address) => last.count += 1,
                _ => groups.push(PollGroup { address: register.address, count: 1, class }),
            }
        }
    }
    groups
}

fn joins(model: &Model, group: &PollGroup, address: u16) -> bool {
    group.address.checked_add(group.count) == Some(address) && group.count < model.words_in_one_read(group.address)
}

/// The poll groups of one drive with the moments at which they are due.
#[derive(Debug)]
pub struct PollPlan {
    poll: Duration,
    entries: Vec<(PollGroup, MonoTime)>,
}

impl PollPlan {
    /// The plan of a drive of `model`, first due from `start` on. `phase` (0 to 1) moves all its polls by
    /// that part of their period, so that the drives of a line do not fall due together.
    #[must_use]
    pub fn new(model: &Model, poll: Duration, start: MonoTime, phase: f64) -> Self {
        let entries = groups(model)
            .into_iter()
            .map(|group| (group, start + group.period(poll).mul_f64(phase.clamp(0.0, 1.0))))
            .collect();
        Self { poll, entries }
    }

    /// The group at `index` and when it is due, for as long as there are groups.
    pub fn iter(&self) -> impl Iterator<Item = (usize, PollGroup, MonoTime)> + '_ {
        self.entries.iter().enumerate().map(|(index, (group, due))| (index, *group, *due))
    }

    /// Whether the group at `index`, due since `due`, has grown older than half its period by `now`.
    #[must_use]
    pub fn is_aged(&self, group: PollGroup, due: MonoTime, now: MonoTime) -> bool {
        now.since(due) * 2 > group.period(self.poll)
    }

    /// Notes that the group at `index` goes out at `now`. Periods that were missed are left out, so that
    /// a line that fell behind does not try to catch up; the phase is kept.
    pub fn sent(&mut self, index: usize, now: MonoTime) {
        let Some((group, due)) = self.entries.get_mut(index) else { return };
        let period = group.period(self.poll).max(Duration::from_millis(1));
        let missed = now.since(*due).as_nanos() / period.as_nanos();
        let periods = u32::try_from(missed + 1).unwrap_or(u32::MAX);
        *due = *due + period * periods;
    }
}
