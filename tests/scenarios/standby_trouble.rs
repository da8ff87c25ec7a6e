//! Two gateways on one line, and what goes wrong in years: kills, suspends, lost ports, cuts of the pair between the two,
//! frames that are not heard, noise, echoes, clocks that differ. `SIMULATED=10000000 cargo test --release --test suite standby_trouble -- --nocapture` plays as much time.

use crate::support::pair::Pair;
use crate::support::{ORIGIN, RigOptions, STOP, control, run};
use std::time::Duration;
use vfd_gateway::domain::command::{Direction, Outcome, Reason};
use vfd_gateway::domain::control::ControlSettings;
use vfd_gateway::domain::ids::Ticket;
use vfd_gateway::domain::standby::{LineRole, OnGatewayLost};
use vfd_gateway::domain::time::MonoTime;
use vfd_gateway::sim::FaultPlan;

const MS: fn(u64) -> Duration = Duration::from_millis;
/// Simulated time without `SIMULATED`.
const SECONDS: u64 = 30_000;
/// The run command of the model.
const RUN: [u8; 3] = [6, 0x00, 0x02];

/// What happens to the active gateway.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    Kill,
    Suspend,
    SuspendAtThePort,
    Unplug,
    /// The pair is cut between the two. Each is master of its own part then; nothing is promised but that it ends.
    Cut,
}

const FAULTS: [Fault; 5] = [
    Fault::Kill,
    Fault::Suspend,
    Fault::SuspendAtThePort,
    Fault::Unplug,
    Fault::Cut,
];

/// What the line is like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Line {
    Good,
    /// The gateways do not hear 2 % of each other's frames.
    Lossy,
    /// Replies of drives come damaged, cut short, not at all, or behind noise.
    Noisy,
    /// Each adapter receives what it sends.
    Echoing,
}

const LINES: [Line; 5] = [
    Line::Good,
    Line::Good,
    Line::Lossy,
    Line::Noisy,
    Line::Echoing,
];

impl Line {
    /// Most frames that the one that leaves sends while the other one sends.
    const fn doubled_at_most(self) -> u64 {
        match self {
            Self::Good | Self::Noisy | Self::Echoing => 1,
            // Each that is not heard is one more.
            Self::Lossy => 4,
        }
    }
}

/// What was seen.
#[derive(Debug, Default)]
struct Seen {
    rounds: u64,
    /// From the fault to the first frame that stops the drive, in ms.
    stops: Vec<u64>,
    /// Frames of a gateway after the other one has begun to send.
    doubled: u64,
    /// Most of them in one term.
    longest_doubled: u64,
    /// The same of the two masters that a cut made, once the pair is whole again.
    doubled_after_cut: u64,
    longest_after_cut: u64,
    restarts: u64,
    /// Rounds in which the drive was not started.
    refused: u64,
    commands: u64,
}

/// Follows who sends.
#[derive(Default)]
struct Watch {
    /// Frames that were looked at.
    frames: usize,
    /// The term of each gateway, since when it sends, and its frames while the other one was in a later term.
    terms: [(u64, MonoTime, u64); 2],
}

struct Play {
    pair: Pair,
    watch: Watch,
    /// The pair is cut, or was and has not been seen with one master since.
    follows_cut: bool,
    seen: Seen,
    /// RUN orders that each gateway accepted.
    accepted: [u64; 2],
    ran: [u64; 2],
}

impl Play {
    fn new(seed: u64, line: Line) -> Self {
        let settings = ControlSettings {
            on_gateway_lost: Some(OnGatewayLost::Stop),
            lost_after: MS(1 << 40),
            ..control()
        };
        let is_echoing = line == Line::Echoing;
        let options = RigOptions {
            control: Some(settings),
            seed,
            poll: MS(2000),
            ..RigOptions::controlled()
        };
        let mut pair = Pair::new(2, &options);
        if line == Line::Noisy {
            pair.bus.set_faults(FaultPlan {
                noise: 5,
                lost: 2,
                cut: 2,
                flip: 5,
                ..FaultPlan::NONE
            });
        }
        for (half, drift) in [(0, 10_000), (1, -10_000)] {
            pair.halves[half].drift_ppm = if seed.is_multiple_of(2) {
                drift
            } else {
                -drift
            };
            pair.halves[half].loses_per_mille = if line == Line::Lossy { 20 } else { 0 };
            pair.halves[half].echoes = is_echoing;
            pair.start(half);
        }
        Self {
            pair,
            watch: Watch::default(),
            follows_cut: false,
            seen: Seen::default(),
            accepted: [0; 2],
            ran: [0; 2],
        }
    }

    fn pass(&mut self, time: Duration) {
        let until = self.pair.now + time;
        loop {
            let goes_on = self.pair.step(until);
            self.look();
            if !goes_on {
                return;
            }
        }
    }

    /// Looks at the frames that were sent since the last call.
    fn look(&mut self) {
        for sent in self.pair.sent[self.watch.frames..]
            .iter()
            .filter(|sent| !sent.is_of_listener())
        {
            // A stop goes out from a gateway that listens, too.
            if sent.pdu.starts_with(&RUN) && sent.pdu[3..5] == [0, 0] {
                continue;
            }
            let report = self.pair.halves[sent.half]
                .core
                .as_ref()
                .and_then(|core| core.report().standby);
            let term = report.map_or(0, |report| {
                report.take_overs + self.pair.halves[sent.half].setup.first_epoch
            });
            let half = sent.half;
            let others_began = self.watch.terms[1 - half].1;
            let other_goes_on = self.pair.role(1 - half) == LineRole::Active;
            let own = &mut self.watch.terms[half];
            if own.0 != term {
                *own = (term, sent.at, 0);
            } else if others_began > own.1 && other_goes_on && !self.pair.is_cut {
                own.2 += 1;
                let (doubled, longest) = if self.follows_cut {
                    (
                        &mut self.seen.doubled_after_cut,
                        &mut self.seen.longest_after_cut,
                    )
                } else {
                    (&mut self.seen.doubled, &mut self.seen.longest_doubled)
                };
                *doubled += 1;
                *longest = (*longest).max(own.2);
            } else {
                own.2 = 0;
            }
            if sent.pdu.starts_with(&RUN) && sent.pdu[3..5] == [0, 1] {
                self.ran[half] += 1;
            }
        }
        self.watch.frames = self.pair.sent.len();
    }

    fn active(&self) -> Option<usize> {
        [0, 1].into_iter().find(|half| {
            self.pair.role(*half) == LineRole::Active && !self.pair.halves[*half].is_suspended
        })
    }

    /// Both run, and one of them is active.
    fn settle(&mut self) -> usize {
        for half in [0, 1] {
            let it = &self.pair.halves[half];
            if it.core.is_none() {
                self.seen.restarts += 1;
                self.pair.start(half);
            } else if it.is_suspended {
                self.pair.resume(half);
            } else if !it.is_open {
                self.pair.open(half);
            }
        }
        for _ in 0..60 {
            self.pass(MS(500));
            if let Some(active) = self.active()
                && self.pair.role(1 - active) == LineRole::Listening
                && self
                    .pair
                    .core(1 - active)
                    .report()
                    .standby
                    .is_some_and(|report| report.hears_other)
            {
                return active;
            }
        }
        panic!("no gateway is active after 30 s, or both are");
    }

    /// The same order to both: at most one accepts it.
    fn command(&mut self, order: &vfd_gateway::domain::command::Order) -> [Ticket; 2] {
        let tickets = [0, 1].map(|half| self.pair.command(half, ORIGIN, 0, order.clone()));
        self.pass(MS(800));
        let told = [0, 1].map(|half| self.pair.told(half, tickets[half]));
        let is_taken =
            |told: &Option<(Outcome, Reason)>| !matches!(told, None | Some((Outcome::Refused, _)));
        assert!(order.is_stop() || !told.iter().all(is_taken), "{told:?}");
        self.seen.commands += 1;
        tickets
    }

    /// One round: a drive that runs, a fault of the active gateway, a stop by the other.
    fn round(&mut self, fault: Fault, bound: Duration) {
        self.seen.rounds += 1;
        let active = self.settle();
        self.pair.command(active, ORIGIN, 0, STOP);
        self.pass(MS(800));
        while self.pair.output(1) != 0 {
            self.pass(MS(500));
        }
        self.pass(MS(2500));
        let before = self.ran[active];
        let tickets = self.command(&run(Direction::Forward, Some(3000)));
        let told = self.pair.told(active, tickets[active]);
        // It may have lost the line meanwhile, where frames get lost.
        if !matches!(told, Some((Outcome::Acknowledged | Outcome::Confirmed, _))) {
            self.seen.refused += 1;
            self.accepted[active] += u64::from(!matches!(told, Some((Outcome::Refused, _))));
            return;
        }
        self.accepted[active] += 1;
        assert!(
            self.ran[active] <= before + 1 && self.ran[1 - active] <= self.accepted[1 - active]
        );
        let wait = self.pair.random_below(3000);
        self.pass(MS(wait));
        let Some(active) = self.active().filter(|it| *it == active) else {
            return;
        };
        match fault {
            Fault::Kill => self.pair.kill(active),
            Fault::Suspend => self.pair.halves[active].is_suspended = true,
            Fault::SuspendAtThePort => self.pair.halves[active].stalls_at_port = true,
            Fault::Unplug => self.pair.unplug(active),
            Fault::Cut => return self.cut(),
        }
        let begin = self.pair.now;
        let limit = bound + MS(600);
        self.pass(limit);
        let stopped = self.first_stop(1 - active, begin);
        let took = stopped.map(|at| at.since(begin));
        let allowed = if fault == Fault::SuspendAtThePort {
            limit
        } else {
            bound
        };
        assert!(
            took.is_some_and(|took| took <= allowed),
            "{fault:?}: {took:?} of {allowed:?} at {:?}",
            self.pair.now
        );
        self.seen
            .stops
            .extend(took.map(|took| u64::try_from(took.as_millis()).unwrap_or(u64::MAX)));
        let rest = self.pair.random_below(8000);
        self.pass(MS(rest));
        self.pair.halves[active].stalls_at_port = false;
    }

    /// The pair is cut for a while, and is whole again: one of the two goes on.
    fn cut(&mut self) {
        (self.pair.is_cut, self.follows_cut) = (true, true);
        let lasts = self.pair.random_below(10_000);
        self.pass(MS(lasts));
        self.pair.is_cut = false;
        self.pass(MS(5000));
        self.settle();
        self.follows_cut = false;
    }

    fn first_stop(&self, half: usize, from: MonoTime) -> Option<MonoTime> {
        let stops = self
            .pair
            .sent
            .iter()
            .rev()
            .take_while(|sent| sent.at >= from);
        stops
            .filter(|sent| {
                sent.half == half && sent.pdu.starts_with(&RUN) && sent.pdu[3..5] == [0, 0]
            })
            .last()
            .map(|it| it.at)
    }
}

fn seconds() -> u64 {
    std::env::var("SIMULATED")
        .ok()
        .and_then(|text| text.parse().ok())
        .unwrap_or(SECONDS)
}

#[test]
fn in_years_of_trouble_one_sends_and_a_running_drive_is_stopped_in_time() {
    let mut totals = Vec::new();
    for (seed, line) in (1..).zip(LINES) {
        let mut play = Play::new(seed, line);
        let times = play.pair.halves[1].setup.standby.unwrap();
        // A clock that is slow by one per cent takes longer; then the line's own frames.
        let bound = times.worst_take_over() + times.worst_take_over() / 50 + MS(400);
        let end = play.pair.now + Duration::from_secs(seconds() / LINES.len() as u64);
        while play.pair.now < end {
            let fault = FAULTS[play.pair.random_below(5) as usize];
            play.round(fault, bound);
            let frames = play.pair.sent.len();
            if frames > 10_000 {
                play.pair.sent.clear();
                play.watch.frames = 0;
            }
            assert!(
                play.ran
                    .iter()
                    .zip(play.accepted)
                    .all(|(ran, accepted)| *ran <= accepted),
                "nothing starts by itself"
            );
        }
        assert!(
            play.seen.longest_doubled <= line.doubled_at_most(),
            "{line:?}: {}",
            play.seen.longest_doubled
        );
        // They may run into each other some times before one is heard.
        assert!(
            play.seen.longest_after_cut <= 10,
            "{line:?}: {}",
            play.seen.longest_after_cut
        );
        totals.push((line, bound, play.seen));
    }
    for (line, bound, mut seen) in totals {
        seen.stops.sort_unstable();
        let at = |share: usize| {
            seen.stops
                .get((seen.stops.len() * share / 1000).min(seen.stops.len().saturating_sub(1)))
        };
        println!(
            "{line:?}: {} rounds, {} commands to both, {} restarts; first STOP after p50 {:?} ms, \
             p99 {:?} ms, longest {:?} ms, bound {} ms; frames after the other one began: {}, most in one term {}; \
             after cuts: {}, {}",
            seen.rounds,
            seen.commands,
            seen.restarts,
            at(500),
            at(990),
            at(1000),
            bound.as_millis(),
            seen.doubled,
            seen.longest_doubled,
            seen.doubled_after_cut,
            seen.longest_after_cut
        );
        // On the noisy line it is about one in four.
        assert!(
            seen.refused * 3 < seen.rounds,
            "{} of {} rounds did not start the drive",
            seen.refused,
            seen.rounds
        );
        assert!(
            seen.stops.len() as u64 * 2 > seen.rounds,
            "most rounds have measured something: {}",
            seen.stops.len()
        );
    }
}
