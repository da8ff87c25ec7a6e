//! The cost of a line's polls and the waiting time of a stop, as far as the configuration determines them.

use super::file::LineFile;
use super::ready::{DriveSettings, LineSettings, LineSilence};
use crate::domain::problem::Problem;
use crate::domain::report::StopBounds;
use crate::domain::standby::StandbyPair;
use crate::line::budget::{self, PlannedRead, PlannedStation, PollBudget, RefreshCost};
use crate::line::standby::StandbyTimes;
use crate::line::timeouts::ReplyTimeouts;
use crate::line::timing::LineTiming;
use crate::profile::model::PollClass;
use crate::toml_file::values::duration_text;
use crate::wire::signal;
use std::time::Duration;

/// Times of a line, and whether they are allowed only on a pseudo-terminal.
#[must_use]
pub fn timing(line: &LineSettings) -> (LineTiming, bool) {
    let models = line.drives.iter().map(|drive| drive.model.as_ref());
    let needed = LineTiming::for_models(line.framing, line.link, models, line.min_request_gap);
    // Frames that say their length need no silence.
    let silence = if line.framing.has_characters() {
        line.silence
    } else {
        LineSilence::Auto
    };
    match silence {
        LineSilence::Fixed(silence) if silence < needed.silence => (needed.unpaced(silence), true),
        LineSilence::Fixed(silence) => (LineTiming { silence, ..needed }, false),
        LineSilence::Auto => (needed, false),
    }
}

/// The reply time-outs of `drive`.
#[must_use]
pub fn reply_timeouts(drive: &DriveSettings) -> ReplyTimeouts {
    drive.reply_timeout.map_or_else(
        || ReplyTimeouts::auto(&drive.model.timing),
        ReplyTimeouts::fixed,
    )
}

/// The cost of `drive` on its line.
#[must_use]
pub fn station(drive: &DriveSettings) -> PlannedStation<'_> {
    let DriveSettings {
        model,
        poll,
        max_lateness,
        ..
    } = drive;
    PlannedStation {
        model,
        poll: *poll,
        timeouts: reply_timeouts(drive),
        max_lateness: *max_lateness,
    }
}

/// The cost of the polls of `line`.
#[must_use]
pub fn budget(line: &LineSettings) -> PollBudget {
    budget::of_plan(&timing(line).0, line.drives.iter().map(station))
}

/// A full refresh of all polled registers of `line`.
#[must_use]
pub fn refresh(line: &LineSettings) -> RefreshCost {
    budget::refresh(&timing(line).0, line.drives.iter().map(station))
}

/// The bounds of a stop on `line` without the drive at `place`: what moving it to another line would leave.
#[must_use]
pub fn stop_bounds_without(line: &LineSettings, place: usize) -> StopBounds {
    let drives = line.drives.iter().enumerate();
    let others = drives.filter(|(at, _)| *at != place);
    budget::stop_bounds(&timing(line).0, others.map(|(_, drive)| station(drive)))
}

/// Maximum waiting time of a stop for one drive of `line`.
#[must_use]
pub fn stop_bounds(line: &LineSettings) -> StopBounds {
    budget::stop_bounds(&timing(line).0, line.drives.iter().map(station))
}

/// The longest exchange with a drive of `line`, from the decision to send a frame to the moment when the next one may be
/// sent, its reply waited out.
#[must_use]
pub fn longest_exchange(line: &LineSettings) -> Duration {
    // A stop waits for one exchange, or for what a broadcast takes.
    let StopBounds {
        all_healthy,
        one_silent,
        ..
    } = stop_bounds(line);
    all_healthy.max(one_silent)
}

/// The shortest safe times at rank 0 of several gateways on `line`.
#[must_use]
pub fn shortest_standby_times(line: &LineSettings) -> StandbyTimes {
    StandbyTimes::shortest(&timing(line).0, longest_exchange(line))
}

/// The times of this gateway as one of `pair` on `line`.
#[must_use]
pub fn standby_times(line: &LineSettings, pair: &StandbyPair) -> StandbyTimes {
    shortest_standby_times(line).with(pair.take_over_after, pair.rank)
}

/// Longest times of a take-over on one line, each from the death of the gateway that was active.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TakeOver {
    /// The times of the rule.
    pub times: StandbyTimes,
    /// The longest exchange: a reply to the last request of the other gateway may come so late.
    pub exchange: Duration,
    /// Longest time until this gateway may send, and has said that it does.
    pub begins: Duration,
    /// Longest time until this gateway's first STOP starts.
    pub first_stop: Duration,
    /// Longest time until this gateway's last STOP starts, if all commanded drives of the line have to be stopped.
    pub last_stop: Duration,
    /// Longest time until no drive can owe the other gateway a reply any more.
    pub settled: Duration,
    /// Longest time until all polled values have been read once, while every drive answers. From then on commands are
    /// accepted.
    pub fresh: Duration,
}

/// The longest times of a take-over of `line` by this gateway, as one of `pair`.
#[must_use]
pub fn take_over(line: &LineSettings, pair: &StandbyPair) -> TakeOver {
    let times = standby_times(line, pair);
    let exchange = longest_exchange(line);
    let begins = exchange + times.worst_take_over() + claim(line);
    let StopBounds {
        all_healthy,
        one_silent,
        each_further,
    } = stop_bounds(line);
    let commanded = commanded(line);
    let further = each_further * u32::try_from(commanded.saturating_sub(1)).unwrap_or(u32::MAX);
    let first_stop = begins + all_healthy.max(one_silent);
    // If the drive that is stopped first is silent, the take-over is said once more, after a random wait.
    let again = if commanded > 1 {
        StandbyTimes::waits_after_silence() + claim(line)
    } else {
        Duration::ZERO
    };
    let last_stop = first_stop + further + again;
    let owes = |drive: &DriveSettings| {
        let waits = reply_timeouts(drive);
        waits.read.max(waits.write).max(waits.stored_write) + drive.max_lateness
    };
    let settled = exchange + line.drives.iter().map(owes).max().unwrap_or_default();
    // Each STOP has an exchange of its own, and its effect is read.
    let confirmed = last_stop + all_healthy * u32::try_from(1 + commanded).unwrap_or(u32::MAX);
    let fresh = confirmed.max(settled) + refresh(line).time;
    TakeOver {
        times,
        exchange,
        begins,
        first_stop,
        last_stop,
        settled,
        fresh,
    }
}

/// How many drives of `line` may be commanded.
fn commanded(line: &LineSettings) -> usize {
    let drives = line.drives.iter();
    drives.filter(|drive| drive.control.is_some()).count()
}

/// How long the signal takes by which a gateway takes `line`, with the silence that follows.
fn claim(line: &LineSettings) -> Duration {
    let timing = timing(line).0;
    timing.on_wire(timing.adu_bytes(signal::PDU_BYTES)) + timing.silence
}

/// Maximum additional time to confirm a stop of a drive of `line` if one of its replies is missing.
#[must_use]
pub fn missing_reply_costs(line: &LineSettings) -> Duration {
    let timing = timing(line).0;
    let costs = line
        .drives
        .iter()
        .map(|drive| budget::missing_reply_costs(&timing, &station(drive)));
    costs.max().unwrap_or_default()
}

/// The longest time between two frames to the drive at `place` of `line`, while it answers and each possible delay
/// occurs once; `None` if it has no fast polls. The drive's own watchdog must be set to more than twice that.
#[must_use]
pub fn longest_gap(line: &LineSettings, location: usize) -> Option<Duration> {
    let stations: Vec<_> = line.drives.iter().map(station).collect();
    let commanded = commanded(line);
    budget::longest_gap_on_line(&timing(line).0, &stations, location, commanded)
}

/// A plan that does not fit is stretched; it is refused if the fast values would exceed their maximum age.
pub(super) fn check(file: &LineFile, line: &LineSettings, problems: &mut Vec<Problem>) {
    let budget = budget(line);
    let drives = line.drives.iter().enumerate();
    let ages = drives.filter_map(|(at, drive)| Some((budget.fast_age(at)?, drive)));
    let Some((age, oldest)) = ages.max_by_key(|(age, _)| *age) else {
        return;
    };
    if budget.stretch <= 1.0 || age <= line.max_status_age {
        return;
    }
    let missing = file.location.missing("max_status_age");
    let location = file.max_status_age.location().unwrap_or(&missing);
    let limit = duration_text(line.max_status_age);
    let what = format!(
        "line `{}` cannot carry its polls: {}. Stretched {:.1} times, the fast values of `{}` would become {} old, \
         more than the {limit} of `max_status_age`",
        line.name,
        arithmetic(line, &budget),
        budget.stretch,
        oldest.name,
        seconds(age),
    );
    location.refuse(what, advice(line, &budget), problems);
}

/// Why the plan does not fit: the number of drives and the load per second.
fn arithmetic(line: &LineSettings, budget: &PollBudget) -> String {
    let reads: Vec<&PlannedRead> = budget.stations.iter().flatten().collect();
    let fast = reads
        .iter()
        .filter(|read| read.group.class == PollClass::Fast)
        .count();
    let costs = reads.iter().map(|read| read.cost);
    let least = costs.clone().min().unwrap_or_default();
    let most = costs.max().unwrap_or_default();
    format!(
        "{} drives with {} reads ({fast} of them fast) of {} to {} each would take {:.0} % of its time",
        line.drives.len(),
        reads.len(),
        millis(least),
        millis(most),
        budget.use_of_line * 100.0,
    )
}

/// Ways to make it fit, including the poll period that does.
fn advice(line: &LineSettings, budget: &PollBudget) -> String {
    let slowest = line.drives.iter().map(|drive| drive.poll).max();
    let kept = slowest.unwrap_or_default().mul_f64(budget.stretch);
    let kept = kept.as_secs_f64().ceil();
    let most = if line.framing.has_characters() {
        line.link.baud
    } else {
        u32::MAX
    };
    let faster = line
        .drives
        .iter()
        .map(|drive| drive.model.link.bauds.value.as_slice());
    let faster = faster
        .reduce(|a, b| {
            if a.iter().max() < b.iter().max() {
                a
            } else {
                b
            }
        })
        .unwrap_or_default();
    let faster = faster.iter().copied().filter(|baud| *baud > most).max();
    let speed = faster.map_or(String::new(), |baud| {
        format!("a higher speed (up to {baud}), ")
    });
    format!(
        "{speed}fewer drives on the line, or a longer `poll`: with poll = \"{kept:.0}s\" on each drive it fits"
    )
}

fn millis(time: Duration) -> String {
    format!("{:.1} ms", time.as_secs_f64() * 1e3)
}

fn seconds(time: Duration) -> String {
    format!("{:.1} s", time.as_secs_f64())
}
