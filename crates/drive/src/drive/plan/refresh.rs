//! A full refresh: every polled register of a drive once, as the plan reads it, and as few reads as its model allows.

use super::groups::{PollPace, apart, may_be_read_along};
use super::{PlaceOnLine, PollPlan};
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::Model;
use std::time::Duration;

/// First register and number of words of a read.
pub type Read = (Address, u16);

/// The reads that the plan sends when everything is due and the drive has answered for all of it before.
#[must_use]
pub fn full_refresh(model: &Model) -> Vec<Read> {
    let now = MonoTime::ZERO;
    let mut plan = PollPlan::new(
        model,
        PollPace::new(Duration::from_secs(1), 1.0),
        now,
        PlaceOnLine::ALONE,
    );
    let groups: Vec<_> = plan.iter().map(|(_, group, _)| group).collect();
    groups
        .into_iter()
        .for_each(|group| plan.answered(group.address, group.count));
    let mut reads = Vec::new();
    while let Some(index) = next_due(&plan, now) {
        reads.extend(plan.take(index, now, model, |_, _| true));
    }
    reads
}

fn next_due(plan: &PollPlan, now: MonoTime) -> Option<usize> {
    let due = plan.iter().filter(|(_, _, due)| *due <= now);
    due.min_by_key(|(_, group, due)| plan.urgency(*group, *due, now))
        .map(|(index, ..)| index)
}

/// The reads that take the least time together, where `cost` is the time of a read of so many words: within the limits of
/// `model`, over registers that may be read along.
#[must_use]
pub fn shortest_refresh(model: &Model, cost: impl Fn(u16) -> Duration) -> Vec<Read> {
    let mut polled: Vec<Read> = apart(model, |_, _| false)
        .into_iter()
        .map(|(it, _)| (it.address, it.count))
        .collect();
    polled.sort_unstable();
    // The least time for the first registers, and where its last read begins.
    let mut best: Vec<(Duration, usize)> = vec![(Duration::ZERO, 0)];
    for end in 1..=polled.len() {
        let least = (0..end).rev().map_while(|begin| {
            let words = words_of(model, polled.get(begin..end)?)?;
            Some((best.get(begin)?.0 + cost(words), begin))
        });
        // A register alone can always be read.
        let alone = (
            best.last().map_or(Duration::ZERO, |it| it.0) + cost(1),
            end - 1,
        );
        best.push(least.min().unwrap_or(alone));
    }
    let mut reads = Vec::new();
    let mut end = polled.len();
    while end > 0 {
        let begin = best.get(end).map_or(0, |(_, begin)| *begin).min(end - 1);
        reads.extend(
            polled
                .get(begin..end)
                .and_then(|all| Some((all.first()?.0, words_of(model, all)?))),
        );
        end = begin;
    }
    reads.reverse();
    reads
}

/// The words of one read of all these, which are in order; `None` if there is none.
fn words_of(model: &Model, all: &[Read]) -> Option<u16> {
    let (first, _) = *all.first()?;
    let mut end = 0;
    for (address, words) in all {
        let begin = address.offset_from(first)?;
        let hole = first
            .checked_add(end)?
            .onwards()
            .take(begin.saturating_sub(end).into());
        if !hole.into_iter().all(|it| may_be_read_along(model, it)) {
            return None;
        }
        end = end.max(begin.checked_add(*words)?);
    }
    (all.len() == 1 || end <= model.words_in_one_read(first)).then_some(end)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vendors;
    use std::collections::BTreeSet;

    fn words(reads: impl IntoIterator<Item = Read>) -> BTreeSet<Address> {
        reads
            .into_iter()
            .flat_map(|(address, count)| address.onwards().take(count.into()))
            .collect()
    }

    /// A request and a reply at 9600 bit/s, and what the drive needs.
    fn cost(words: u16) -> Duration {
        Duration::from_micros(28_000 + 2_083 * u64::from(words))
    }

    #[test]
    fn both_read_all_that_is_polled_of_every_model_within_its_limits() {
        for model in vendors::catalog().models() {
            let polled = words(
                apart(model, |_, _| false)
                    .into_iter()
                    .map(|(it, _)| (it.address, it.count)),
            );
            for reads in [full_refresh(model), shortest_refresh(model, cost)] {
                assert!(
                    words(reads.iter().copied()).is_superset(&polled),
                    "{}",
                    model.id
                );
                assert!(
                    reads
                        .iter()
                        .all(|(first, words)| *words <= model.words_in_one_read(*first)),
                    "{}",
                    model.id
                );
            }
        }
    }

    #[test]
    fn the_shortest_is_never_longer_than_the_plan() {
        let time = |reads: &[Read]| {
            reads
                .iter()
                .map(|(_, words)| cost(*words))
                .sum::<Duration>()
        };
        for model in vendors::catalog().models() {
            let [planned, shortest] =
                [full_refresh(model), shortest_refresh(model, cost)].map(|reads| time(&reads));
            assert!(
                shortest <= planned,
                "{}: {shortest:?}, {planned:?}",
                model.id
            );
        }
    }
}
