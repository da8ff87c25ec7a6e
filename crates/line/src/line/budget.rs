//! The time that a poll plan and a stop take on the wire, computed before any port is opened.

use super::station::BACK_OFF_FIRST;
use super::timeouts::{ReplyTimeouts, RequestClass, longer_reply, reply_delay, turnaround};
use super::timing::LineTiming;
use crate::domain::report::StopBounds;
use crate::drive::plan::{self, PollGroup};
use crate::profile::model::{Barrier, BlockWrite, Model, PollClass};
use crate::wire::pdu::function;
use std::time::Duration;

/// Turnaround assumed for a drive whose documents give no processing time. An estimate for planning a line, not a
/// limit.
pub const ASSUMED_TURNAROUND: Duration = Duration::from_millis(10);

/// How long a line is left alone after a broadcast, so that every drive can carry it out (Modbus over serial line
/// V1.02, 2.4.1: typically 100 to 200 ms).
pub const BROADCAST_TURNAROUND: Duration = Duration::from_millis(100);

/// PDU bytes of a read request, of a write and of a write's reply.
const SHORT_PDU_BYTES: usize = 5;
const WORD_BYTES: usize = 2;

/// A station of a line, as needed to compute its cost.
#[derive(Clone, Copy, Debug)]
pub struct PlannedStation<'a> {
    /// Its model.
    pub model: &'a Model,
    /// Period of its fast polls.
    pub poll: Duration,
    /// Its reply timeouts.
    pub timeouts: ReplyTimeouts,
    /// How long after a timeout a reply may still arrive.
    pub max_lateness: Duration,
}

/// One repeated read of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlannedRead {
    /// What is read in one frame.
    pub group: PollGroup,
    /// Intended time between two reads.
    pub period: Duration,
    /// Time that one read takes, silence included.
    pub cost: Duration,
    /// Time that one read takes, silence included, with the longest reply delay that can be set on the drive.
    pub cost_if_delayed: Duration,
}

/// What the polls of one line cost.
#[derive(Clone, Debug, PartialEq)]
pub struct PollBudget {
    /// Share of the line's time that the plan takes; above 1.0 every period stretches.
    pub use_of_line: f64,
    /// Share of the line's time that the plan takes if every drive were set to the longest reply delay.
    pub use_if_delayed: f64,
    /// By how much every period is stretched: 1.0 while the plan fits.
    pub stretch: f64,
    /// The longest exchange of the plan, given that its reply is not missing.
    pub longest_exchange: Duration,
    /// The reads of each station, in the order of the stations.
    pub stations: Vec<Vec<PlannedRead>>,
}

impl PollBudget {
    /// Approximate maximum age of a value of `read` while its drive answers: the stretched period, and what may be on
    /// the wire before it.
    #[must_use]
    pub fn age(&self, read: &PlannedRead) -> Duration {
        read.period.mul_f64(self.stretch) + self.longest_exchange * 2
    }

    /// Maximum age of a fast value of the station at `place`; `None` if it has none.
    #[must_use]
    pub fn fast_age(&self, place: usize) -> Option<Duration> {
        let fast = self
            .stations
            .get(place)?
            .iter()
            .filter(|read| read.group.class == PollClass::Fast);
        fast.map(|read| self.age(read)).max()
    }
}

/// Time that one exchange takes: silence, request, turnaround, reply.
#[must_use]
pub fn exchange_time(
    timing: &LineTiming,
    request_pdu_bytes: usize,
    turnaround: Duration,
    reply_pdu_bytes: usize,
) -> Duration {
    let on_wire = |pdu_bytes| timing.on_wire(timing.adu_bytes(pdu_bytes));
    timing.silence + on_wire(request_pdu_bytes) + turnaround + on_wire(reply_pdu_bytes)
}

/// Time that one read of `count` words takes if the drive answers after `turnaround`.
#[must_use]
pub fn read_time(timing: &LineTiming, count: u16, turnaround: Duration) -> Duration {
    exchange_time(timing, SHORT_PDU_BYTES, turnaround, reply_bytes(count))
}

/// Adds up the plans of `stations`, which share the line of `timing`.
#[must_use]
pub fn of_plan<'a>(
    timing: &LineTiming,
    stations: impl IntoIterator<Item = PlannedStation<'a>>,
) -> PollBudget {
    let stations: Vec<_> = stations
        .into_iter()
        .map(|station| planned(timing, &station))
        .collect();
    let part = |cost: fn(&PlannedRead) -> Duration| {
        let parts = stations
            .iter()
            .flatten()
            .map(|read| cost(read).as_secs_f64() / read.period.as_secs_f64());
        parts.sum::<f64>()
    };
    let use_of_line = part(|read| read.cost);
    let use_if_delayed = part(|read| read.cost_if_delayed);
    let longest_exchange = stations
        .iter()
        .flatten()
        .map(|read| read.cost)
        .max()
        .unwrap_or_default();
    PollBudget {
        use_of_line,
        use_if_delayed,
        stretch: use_of_line.max(1.0),
        longest_exchange,
        stations,
    }
}

/// What it takes to read all polled registers of a line once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RefreshCost {
    /// Reads by the plan, when all is due.
    pub reads: usize,
    /// Time that they take.
    pub time: Duration,
    /// Reads of the shortest refresh within the limits of the models.
    pub shortest_reads: usize,
    /// Time that they take.
    pub shortest_time: Duration,
}

/// A full refresh of `stations`, beside the shortest one.
#[must_use]
pub fn refresh<'a>(
    timing: &LineTiming,
    stations: impl IntoIterator<Item = PlannedStation<'a>>,
) -> RefreshCost {
    let mut all = RefreshCost::default();
    for station in stations {
        let cost = |words| read_cost(timing, station.model, words);
        let time = |reads: &[plan::Read]| {
            reads
                .iter()
                .map(|(_, words)| cost(*words))
                .sum::<Duration>()
        };
        let planned = plan::full_refresh(station.model);
        let shortest = plan::shortest_refresh(station.model, cost);
        all.reads += planned.len();
        all.time += time(&planned);
        all.shortest_reads += shortest.len();
        all.shortest_time += time(&shortest);
    }
    all
}

/// Time that one read of `count` words of a drive of `model` takes.
fn read_cost(timing: &LineTiming, model: &Model, count: u16) -> Duration {
    let wait = turnaround(&model.timing, RequestClass::Read);
    read_time(timing, count, wait) + longer(timing, model, reply_bytes(count))
}

fn planned(timing: &LineTiming, station: &PlannedStation<'_>) -> Vec<PlannedRead> {
    let times = &station.model.timing;
    let read = |group: PollGroup| {
        let cost = read_cost(timing, station.model, group.count);
        let period = group.period(plan::PollPace::new(station.poll, 1.0));
        PlannedRead {
            group,
            period,
            cost,
            cost_if_delayed: cost + reply_delay(times),
        }
    };
    plan::groups(station.model).into_iter().map(read).collect()
}

/// How long a stop for one drive of a line of `stations` may have to wait.
#[must_use]
pub fn stop_bounds<'a>(
    timing: &LineTiming,
    stations: impl IntoIterator<Item = PlannedStation<'a>>,
) -> StopBounds {
    let stations: Vec<_> = stations.into_iter().collect();
    // A stop that is accepted right after a broadcast stop waits until the drives have carried that out.
    let pauses = stations
        .iter()
        .map(|it| pause_after(it.model, RequestClass::Write));
    let left_alone = pauses.fold(BROADCAST_TURNAROUND, Duration::max);
    let after_broadcast = exchange_time(timing, SHORT_PDU_BYTES, left_alone, 0);
    let least = if !timing.may_have_converter() && may_stop_at_once(&stations) {
        after_broadcast
    } else {
        Duration::ZERO
    };
    let mut bounds = StopBounds {
        all_healthy: least,
        one_silent: least,
        each_further: Duration::ZERO,
    };
    for station in &stations {
        for (class, request, reply) in exchanges(station.model) {
            let longer = longer(timing, station.model, reply);
            let healthy =
                turnaround(&station.model.timing, class) + reply_delay(&station.model.timing);
            let timeout = station.timeouts.of(class);
            // The current exchange ends with its reply, and the silence after that is the one before the stop.
            let in_time = exchange_time(timing, request, healthy.min(timeout) + longer, reply);
            // The drive that was written to may be the one to be stopped.
            let pause = pause_after(station.model, class);
            // A reply may begin at the last moment, and is then received to its end.
            let silent = exchange_time(timing, request, timeout + longer, reply)
                + timing.on_wire(timing.adu_bytes(reply))
                + timing.silence;
            bounds.all_healthy = bounds.all_healthy.max(in_time + pause);
            bounds.one_silent = bounds.one_silent.max(silent + pause);
            if class == RequestClass::Write {
                bounds.each_further = bounds.each_further.max(in_time);
            }
        }
    }
    bounds
}

/// By how much the confirmation of a stop is delayed if a reply of `station` is missing or damaged: the reads of its
/// effect wait until no late reply can be mistaken for theirs. That takes one exchange with a barrier, or else the
/// maximum lateness; nothing where replies carry the number of their request.
#[must_use]
pub fn missing_reply_costs(timing: &LineTiming, station: &PlannedStation<'_>) -> Duration {
    if timing.framing.identifies_replies() {
        return Duration::ZERO;
    }
    // Other barriers have to be tested first, and on some lines they prove nothing.
    let settles = |barrier: &Barrier| match barrier {
        Barrier::Read(read) => Some(read.count),
        Barrier::Loop(_) | Barrier::Refused(_) => None,
    };
    let words = station.model.barriers.iter().filter_map(settles).max();
    let wait = station.timeouts.read;
    words.map_or(wait + station.max_lateness, |words| {
        let usual = turnaround(&station.model.timing, RequestClass::Read)
            + reply_delay(&station.model.timing);
        read_time(timing, words, usual.min(wait))
            + longer(timing, station.model, reply_bytes(words))
    })
}

/// Whether one frame may stop all `stations`, as far as their models tell.
fn may_stop_at_once(stations: &[PlannedStation<'_>]) -> bool {
    let Some((first, others)) = stations.split_first() else {
        return false;
    };
    let hears_all = first
        .model
        .link
        .broadcast
        .as_ref()
        .is_some_and(|it| it.station.confidence.is_proven());
    hears_all && !others.is_empty() && others.iter().all(|other| other.model.id == first.model.id)
}

/// The longest time between two frames to a station that answers, if everything goes wrong once: a reply is missing
/// and waited out, the station is left alone, the next request is not answered either, stops for others go first, and
/// it is deaf after a write.
#[must_use]
pub fn longest_gap(
    timing: &LineTiming,
    age: Duration,
    station: &PlannedStation<'_>,
    stop: &StopBounds,
) -> Duration {
    let wait = station.timeouts.read;
    let has_to_wait = station.model.barriers.is_empty() && !timing.framing.identifies_replies();
    let is_waited_out = if has_to_wait {
        station.max_lateness
    } else {
        Duration::ZERO
    };
    let retry = read_time(timing, station.model.read.longest(), wait);
    age + wait
        + is_waited_out
        + BACK_OFF_FIRST
        + retry
        + stop.one_silent
        + station.model.longest_deafness()
}

/// The longest time between two frames to the station at `place` of `stations`, while it answers and every possible
/// delay occurs once, including stops for the `commanded` stations of the line. `None` if it is not polled fast. Its
/// own watchdog has to be set to more than twice that.
#[must_use]
pub fn longest_gap_on_line(
    timing: &LineTiming,
    stations: &[PlannedStation<'_>],
    place: usize,
    commanded: usize,
) -> Option<Duration> {
    let budget = of_plan(timing, stations.iter().copied());
    let mut stop = stop_bounds(timing, stations.iter().copied());
    stop.one_silent +=
        stop.each_further * u32::try_from(commanded.saturating_sub(1)).unwrap_or(u32::MAX);
    Some(longest_gap(
        timing,
        budget.fast_age(place)?,
        stations.get(place)?,
        &stop,
    ))
}

/// The longest exchanges with a drive of `model`: class, and PDU bytes of request and reply.
fn exchanges(model: &Model) -> impl Iterator<Item = (RequestClass, usize, usize)> + '_ {
    let block = |block: &BlockWrite| {
        (
            6 + WORD_BYTES * usize::from(block.count.value),
            SHORT_PDU_BYTES,
        )
    };
    let has_coil = model
        .registers
        .iter()
        .any(|it| it.access.can_write() && it.address.table().is_of_bits());
    let coil = if has_coil && !model.serves(function::WRITE_COIL) {
        6 + 1
    } else {
        SHORT_PDU_BYTES
    };
    let single = if model.serves(function::WRITE_SINGLE) {
        coil
    } else {
        6 + WORD_BYTES
    };
    let has_pair = model
        .registers
        .iter()
        .any(|it| it.access.can_write() && it.form.pair.is_some());
    let pair = has_pair.then_some((6 + 2 * WORD_BYTES, SHORT_PDU_BYTES));
    let writes = [
        Some((single, SHORT_PDU_BYTES)),
        pair,
        model.write.block.as_ref().map(block),
    ];
    let writes = writes.into_iter().flatten();
    let writes = writes.flat_map(|(request, reply)| {
        [RequestClass::Write, RequestClass::StoredWrite]
            .into_iter()
            .map(move |class| (class, request, reply))
    });
    let reads = [reply_bytes(model.read.longest()), SHORT_PDU_BYTES];
    writes.chain(
        reads
            .into_iter()
            .map(|reply| (RequestClass::Read, SHORT_PDU_BYTES, reply)),
    )
}

/// How long a drive of `model` is left alone after a request of `class`.
fn pause_after(model: &Model, class: RequestClass) -> Duration {
    match class {
        RequestClass::Read => Duration::ZERO,
        RequestClass::Write => model.timing.pause_after(false),
        RequestClass::StoredWrite => model.timing.pause_after(true),
    }
}

/// By how much a reply with a PDU of `pdu_bytes` takes longer because the drive sends longer characters.
fn longer(timing: &LineTiming, model: &Model, pdu_bytes: usize) -> Duration {
    let char_bits = model.timing.reply_char_bits.as_ref().map(|fact| fact.value);
    longer_reply(timing, char_bits, timing.adu_bytes(pdu_bytes))
}

fn reply_bytes(count: u16) -> usize {
    2 + WORD_BYTES * usize::from(count)
}

#[cfg(test)]
mod tests {
    use super::super::timing::testing::{ASCII, N700};
    use super::*;
    use crate::domain::link::Framing;
    use crate::profile::model::{BarrierRead, Confidence, Fact};
    use crate::vendors;

    fn fact<T>(value: T) -> Fact<T> {
        Fact {
            value,
            confidence: Confidence::Manual,
            source: String::new(),
        }
    }

    const fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    fn n700() -> Model {
        Model::clone(
            vendors::catalog()
                .find("hyundai-n700")
                .expect("it is built in"),
        )
    }

    /// A model with one register that is polled fast.
    fn model(change: impl FnOnce(&mut Model)) -> Model {
        let mut model = n700();
        let first = model
            .registers
            .iter()
            .position(|register| register.poll == Some(PollClass::Fast))
            .unwrap();
        model.registers = vec![model.registers.swap_remove(first)];
        model.link.broadcast = None;
        model.timing.processing_max = None;
        model.timing.reply_delay_max = None;
        model.timing.reply_char_bits = None;
        model.write.block = None;
        change(&mut model);
        model
    }

    fn station(model: &Model) -> PlannedStation<'_> {
        let timeouts = ReplyTimeouts::fixed(Duration::from_millis(100));
        let poll = Duration::from_millis(500);
        PlannedStation {
            model,
            poll,
            timeouts,
            max_lateness: Duration::from_millis(300),
        }
    }

    #[test]
    fn one_word_at_9600_takes_30_milliseconds() {
        let model = model(|_| {});
        // 4.6875 silence + 8.3333 request + 10 turnaround + 7.2917 reply
        let budget = of_plan(&N700, [station(&model)]);
        assert_eq!(budget.longest_exchange.as_micros(), 30_312);
        assert!((budget.use_of_line - 0.060_625).abs() < 1e-5);
        assert_eq!(budget.fast_age(0).map(|age| age.as_micros()), Some(560_625));
        let full = of_plan(&N700, [station(&model); 20]);
        assert!((full.stretch - 1.2125).abs() < 1e-3);
        assert_eq!(full.fast_age(19).map(|age| age.as_millis()), Some(666));
        assert_eq!(full.fast_age(20), None);
    }

    #[test]
    fn delays_and_longer_characters_are_counted() {
        let model = model(|model| {
            model.timing.processing_max = Some(fact(Duration::from_millis(20)));
            model.timing.reply_delay_max = Some(fact(Duration::from_millis(60)));
            model.timing.reply_char_bits = Some(fact(12));
        });
        let budget = of_plan(&N700, [station(&model)]);
        let Some([read]) = budget.stations.first().map(Vec::as_slice) else {
            panic!("{budget:?}")
        };
        // 7 characters of 2 more bits each
        assert_eq!(read.cost.as_micros(), 30_312 + 10_000 + 1_458);
        assert_eq!(read.cost_if_delayed - read.cost, Duration::from_millis(60));
        assert!(budget.use_if_delayed > budget.use_of_line);
    }

    #[test]
    fn ascii_frames_cost_two_characters_for_each_byte() {
        // 10 silence + 17 characters request + 10 turnaround + 15 characters reply
        assert_eq!(
            read_time(&ASCII, 1, ASSUMED_TURNAROUND).as_micros(),
            10_000 + 17_708 + 10_000 + 15_625
        );
    }

    #[test]
    fn a_missing_reply_costs_a_barrier_or_the_longest_lateness() {
        let with = |barriers| model(|model| model.barriers = barriers);
        let read = with(vec![Barrier::Read(BarrierRead {
            address: 1_u16.into(),
            count: 2,
        })]);
        assert_near(
            missing_reply_costs(&N700, &station(&read)),
            chars(8 + 9, 1, 10),
        );
        for barriers in [vec![], vec![Barrier::Loop(fact(()))]] {
            assert_eq!(
                missing_reply_costs(&N700, &station(&with(barriers))),
                Duration::from_millis(100 + 300)
            );
        }
    }

    /// Time of `chars` characters at 9600 bit/s 8N1, `silences` silences and `wait_ms` milliseconds of waiting.
    fn chars(chars: u64, silences: u64, wait_ms: u64) -> Duration {
        Duration::from_millis(wait_ms)
            + Duration::from_nanos(silences * 4_687_500 + chars * 1_041_667)
    }

    fn assert_near(got: Duration, expected: Duration) {
        assert!(
            got.abs_diff(expected) < Duration::from_micros(2),
            "{got:?}, not {expected:?}"
        );
    }

    #[test]
    fn over_modbus_tcp_only_the_drives_themselves_take_time() {
        let timing = LineTiming::for_models(Framing::Mbap, N700.link, [], Duration::ZERO);
        let broadcasts = |model: &mut Model| model.link.broadcast = n700().link.broadcast.clone();
        let model = model(broadcasts);
        assert!(
            may_stop_at_once(&[station(&model); 2]),
            "as on a serial line"
        );
        let bounds = stop_bounds(&timing, [station(&model); 2]);
        assert_eq!(
            (bounds.all_healthy, bounds.one_silent, bounds.each_further),
            (ms(10), ms(100), ms(10))
        );
        assert_eq!(
            missing_reply_costs(&timing, &station(&model)),
            Duration::ZERO
        );
    }

    #[test]
    fn a_stop_waits_for_the_longest_exchange_of_any_kind() {
        let with_words = |words| model(|model| model.read.max_words.value = words);
        let bounds = |models: &[Model]| stop_bounds(&N700, models.iter().map(station));
        let long = bounds(&[with_words(8), with_words(1)]);
        assert_near(long.all_healthy, chars(8 + 21, 1, 10));
        assert_near(long.one_silent, chars(8 + 21 + 21, 2, 100));
        assert_near(long.each_further, chars(8 + 8, 1, 10));
        assert_near(
            bounds(&[with_words(1)]).one_silent,
            chars(8 + 8 + 8, 2, 100),
        );
        let block = BlockWrite {
            address: 2_u16.into(),
            count: fact(10),
        };
        let by_blocks =
            model(|model| (model.read.max_words.value, model.write.block) = (1, Some(block)));
        assert_near(bounds(&[by_blocks]).one_silent, chars(29 + 8 + 8, 2, 100));
        let long_characters = model(|model| {
            model.read.max_words.value = 1;
            model.timing.reply_char_bits = Some(fact(20));
        });
        assert_near(
            bounds(&[long_characters]).one_silent,
            chars(8 + 16 + 8, 2, 100),
        );
        let slow = model(|model| {
            model.read.max_words.value = 1;
            model.timing.processing_max = Some(fact(Duration::from_millis(30)));
            model.timing.stored_write_max = Some(fact(Duration::from_millis(50)));
            model.timing.reply_delay_max = Some(fact(Duration::from_millis(40)));
        });
        let slow = bounds(&[slow]);
        assert_near(slow.all_healthy, chars(8 + 8, 1, 90));
        assert_near(slow.each_further, chars(8 + 8, 1, 70));
        let patient = model(|model| {
            model.read.max_words.value = 1;
            model.timing.pause_after_write = Some(fact(Duration::from_millis(20)));
            model.timing.pause_after_stored_write = Some(fact(Duration::from_millis(70)));
        });
        let patient = bounds(&[patient]);
        assert_near(patient.all_healthy, chars(8 + 8, 1, 10 + 70));
        assert_near(patient.one_silent, chars(8 + 8 + 8, 2, 100 + 70));
        // Another drive that is stopped at the same time does not wait for it.
        assert_near(patient.each_further, chars(8 + 8, 1, 10));
        let storing = with_words(8);
        let timeouts = ReplyTimeouts {
            stored_write: Duration::from_millis(300),
            ..station(&storing).timeouts
        };
        let storing = PlannedStation {
            timeouts,
            ..station(&storing)
        };
        assert_near(
            stop_bounds(&N700, [storing]).one_silent,
            chars(8 + 8 + 8, 2, 300),
        );
    }
}
