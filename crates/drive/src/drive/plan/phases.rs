//! When each group of a plan falls due, so that the polls of a line are spread evenly.
//!
//! A line has one slot per drive in a period; the groups of one class of a drive follow each other in its slot. Classes
//! are offset against each other by parts of a slot. Groups that can share a read fall due together.

use super::groups::{PollGroup, PollPace, may_be_read_along};
use crate::domain::address::Address;
use crate::domain::time::MonoTime;
use crate::profile::model::{Model, PollClass};
use std::time::Duration;

/// A drive's place among those that share a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlaceOnLine {
    /// From 0.
    pub index: u32,
    /// Number of drives on the line, at least 1.
    pub drives: u32,
}

impl PlaceOnLine {
    /// A drive that is alone on its line.
    pub const ALONE: Self = Self {
        index: 0,
        drives: 1,
    };
}

/// For each of `groups`, when it first falls due in its phase.
pub(super) fn spread(
    model: &Model,
    groups: &[PollGroup],
    pace: PollPace,
    start: MonoTime,
    place: PlaceOnLine,
) -> Vec<MonoTime> {
    let mut moments: Vec<MonoTime> = Vec::with_capacity(groups.len());
    // How many of each class there were so far: those with a moment of their own, and those that follow others.
    let mut ranks = [[0_u32; 2]; 5];
    let leads: Vec<Option<usize>> = (0..groups.len())
        .map(|at| lead_of(model, groups, at, pace))
        .collect();
    for (group, lead) in groups.iter().zip(&leads) {
        let rank = &mut ranks[class_number(group.class)][usize::from(lead.is_some())];
        let moment = match lead
            .and_then(|lead| Some((*moments.get(lead)?, groups.get(lead)?.period(pace))))
        {
            Some((led_by, period)) => {
                let turns = (group.period(pace).as_nanos() / period.as_nanos().max(1)).max(1);
                let turn = u128::from(place.index + *rank) % turns;
                led_by + period * u32::try_from(turn).unwrap_or(0)
            }
            None => start + own_moment(groups, &leads, group, pace, place, *rank),
        };
        *rank += 1;
        moments.push(moment);
    }
    moments
}

/// The phase of a group without a lead, the `rank`-th of its class.
fn own_moment(
    groups: &[PollGroup],
    leads: &[Option<usize>],
    group: &PollGroup,
    pace: PollPace,
    place: PlaceOnLine,
    rank: u32,
) -> Duration {
    let of_class = |class| {
        groups
            .iter()
            .zip(leads)
            .filter(|(it, lead)| it.class == class && lead.is_none())
            .count()
    };
    let slots = |class| place.drives.max(1) * u32::try_from(of_class(class)).unwrap_or(1).max(1);
    let own = slots(group.class);
    let slot = place.index * (own / place.drives.max(1)) + rank;
    let shift = pace.period(PollClass::Fast) / slots(PollClass::Fast)
        * u32::try_from(class_number(group.class)).unwrap_or(0)
        / 4;
    group.period(pace) / own * slot + shift
}

/// The first group before the one at `at` that it can share a read with, if its period is a multiple of that group's.
fn lead_of(model: &Model, groups: &[PollGroup], at: usize, pace: PollPace) -> Option<usize> {
    let group = groups.get(at)?;
    let leads = |lead: &PollGroup| {
        let (long, short) = (
            group.period(pace).as_nanos(),
            lead.period(pace).as_nanos().max(1),
        );
        let is_polled = |address| {
            groups.iter().any(|it| {
                Address::offset_from(address, it.address).is_some_and(|offset| offset < it.count)
            })
        };
        long.is_multiple_of(short)
            && lead.with(group, model).is_some()
            && lead
                .between(group)
                .all(|address| is_polled(address) || may_be_read_along(model, address))
    };
    groups.iter().take(at).position(leads)
}

const fn class_number(class: PollClass) -> usize {
    match class {
        PollClass::Fast => 0,
        PollClass::Second => 1,
        PollClass::Slow => 2,
        PollClass::Minutely => 3,
        PollClass::Hourly => 4,
    }
}
