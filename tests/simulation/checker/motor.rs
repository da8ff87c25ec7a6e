//! The true state of each motor, read at the drive and never over the line, and what must hold between it and what the
//! gateway answers and reports:
//!
//! | rule | what it says |
//! | --- | --- |
//! | M1 | a STOP that is answered with success was sent to a drive that runs, or one was under way |
//! | M2 | no order is sent that is older than a STOP of that drive, or older than its time limit |
//! | M3 | a drive is not left with a reset in its run command |
//! | M4 | each trip is reported once, and none that did not happen |
//! | M5 | a run state that is shown was true within its age |

use super::Checker;
use super::tables::{Kind, Run};

/// A fresh value is at most this many poll periods old.
const PERIODS: u64 = 3;
/// The time that a reset may take on an open line.
const RESET_TAKES: u64 = 15_000_000_000;
/// A stop without effect is sent again within this time; one that is ordered again meanwhile is the same.
const GOES_AGAIN: u64 = 4_300_000_000;
/// Output below that is standstill to a drive that only shows its frequency, in 0.01 Hz.
const TURNS: u32 = 10;
/// Stops of a drive that wait for their answers.
const ASKED: usize = 64;

/// Words of the uniform map: bits, and the run state.
const STATUS: u16 = 1;
const RUN_STATE: u16 = 2;
/// The bit that says that something polled is stale.
const IS_STALE: u16 = 1 << 8;
/// Numbers of the run state.
const STOPPED: u16 = 1;
const FORWARD: u16 = 2;
const REVERSE: u16 = 3;
const TRIPPED: u16 = 4;
const RUNNING: u16 = 6;

/// The actual state of a motor and its drive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct State {
    pub is_on: bool,
    /// It is ordered to run, by any party.
    pub is_ordered: bool,
    /// Output frequency in 0.01 Hz, without its sign.
    pub output: u32,
    pub is_tripped: bool,
    /// How often it tripped.
    pub trips: u16,
    /// The word in its run command.
    pub run_word: u16,
    /// It does not take stops.
    pub refuses_stops: bool,
}

/// The known state of one motor.
#[derive(Clone, Debug, Default)]
pub struct Motor {
    state: State,
    /// Since when it was seen to run, to rest, and to be tripped or not, without a break.
    runs_since: Option<u64>,
    rests_since: Option<u64>,
    /// When it was seen to run last.
    ran_at: Option<u64>,
    tripped_since: Option<u64>,
    sound_since: Option<u64>,
    /// When the last frame of ours that stops went out to it, the lowest output since, and since when it is above that.
    stopped_by_us: Option<u64>,
    lowest: u32,
    risen_since: Option<u64>,
    /// Since when it may have to be stopped after all: a stop was answered with success while it fell after a stop,
    /// although others had started it, which nothing shows as long as it falls.
    owes_since: Option<u64>,
    /// Since when its run command holds a reset, and whether it has refused to end that.
    resets_since: Option<u64>,
    keeps_reset: bool,
    /// It held one, and no stop has been acknowledged since: the gateway cannot know that the reset is gone.
    may_keep_reset: bool,
    /// When we wrote the stop that takes it back last, and whether the drive's answer to that was heard.
    taken_back_at: u64,
    take_back_is_answered: bool,
    /// Stops that are not answered yet.
    asked: Vec<Asked>,
    /// Trips that were reported.
    told: u32,
}

/// A stop that is not answered yet.
#[derive(Clone, Copy, Debug)]
struct Asked {
    number: u64,
    at: u64,
    /// The motor was at rest when it was asked for.
    found_at_rest: bool,
}

impl Motor {
    /// Whether it is seen to run.
    pub const fn is_running(&self) -> bool {
        self.runs_since.is_some()
    }

    /// Whether it was seen to run at `at` or later.
    pub fn ran_since(&self, at: u64) -> bool {
        self.ran_at.is_some_and(|ran| ran >= at)
    }

    /// Whether it was seen to rest.
    pub const fn rests(&self) -> bool {
        self.rests_since.is_some()
    }

    /// Whether it is at standstill and no earlier order can move it: it is at rest, or has tripped.
    pub const fn stands(&self) -> bool {
        self.rests() || (self.state.is_tripped && self.state.output == 0)
    }

    /// Whether a stop that is written at `at` takes back a reset that the drive keeps, not sooner than `every` after
    /// the one before. One that was due before the process was suspended, until `stood_until`, is sent after that.
    pub fn takes_back(&mut self, at: u64, every: u64, stood_until: u64) -> bool {
        let is_soon = at < self.taken_back_at + every && self.taken_back_at >= stood_until + every;
        let is_due = self.may_keep_reset && !(is_soon && self.take_back_is_answered);
        self.take_back_is_answered &= !is_due;
        self.taken_back_at = if is_due { at } else { self.taken_back_at };
        is_due
    }
}

fn since(is_so: bool, before: Option<u64>, at: u64) -> Option<u64> {
    is_so.then(|| before.unwrap_or(at))
}

impl Checker {
    /// Notes the actual state of the motor of `drive` at `at`.
    pub fn sees_motor(&mut self, at: u64, drive: usize, state: State) {
        let facts = self.line.drives[drive].kind.facts();
        let holds_reset = facts.run_of(state.run_word) == Some(Run::Reset)
            && facts.reset.last() != Some(&state.run_word)
            && state.is_on;
        let motor = &mut self.motors[drive];
        motor.runs_since = since(
            state.is_on && state.is_ordered && state.output >= TURNS,
            motor.runs_since,
            at,
        );
        motor.ran_at = motor.runs_since.map_or(motor.ran_at, |_| Some(at));
        motor.rests_since = since(
            !state.is_ordered && state.output == 0,
            motor.rests_since,
            at,
        );
        motor.tripped_since = since(state.is_tripped, motor.tripped_since, at);
        motor.sound_since = since(!state.is_tripped, motor.sound_since, at);
        motor.keeps_reset = holds_reset && (motor.keeps_reset || state.refuses_stops);
        motor.resets_since = since(holds_reset && !motor.keeps_reset, motor.resets_since, at);
        motor.may_keep_reset |= holds_reset;
        motor.lowest = motor.lowest.min(state.output);
        motor.risen_since = since(
            motor.runs_since.is_some() && state.output > motor.lowest,
            motor.risen_since,
            at,
        );
        motor.owes_since = motor.owes_since.filter(|_| motor.rests_since.is_none());
        motor.state = state;
        let lag = self.lag(drive);
        let motor = &self.motors[drive];
        let owes_since = motor
            .owes_since
            .zip(motor.risen_since)
            .map(|(owes, risen)| owes.max(risen).max(self.stood.1));
        if owes_since.is_some_and(|since| at > since + lag) && self.wire.is_up() {
            let text = format!(
                "a stop of drive {drive} was answered with success, and the motor runs on: {state:?}"
            );
            self.object("M1", || text);
        }
    }

    /// A stop frame of ours was sent to `drive`, or to all.
    pub(super) fn stop_sent(&mut self, at: u64, drive: usize) {
        let motor = &mut self.motors[drive];
        motor.stopped_by_us = Some(at);
        motor.owes_since = None;
        motor.lowest = u32::MAX;
        motor.risen_since = None;
    }

    /// The drive answered a write to its run command, and the answer was received.
    pub(super) fn run_write_answered(&mut self, drive: usize) {
        self.motors[drive].take_back_is_answered = true;
    }

    /// The drive acknowledged a stop of ours, and the answer was received.
    pub(super) fn stop_taken(&mut self, drive: usize) {
        self.motors[drive].may_keep_reset = false;
    }

    /// A start frame of ours was sent to `drive`. Another rule checks whether it was allowed; no earlier stop is due
    /// any more.
    pub(super) fn run_sent(&mut self, drive: usize) {
        self.motors[drive].owes_since = None;
    }

    /// A stop is requested.
    pub(super) fn stop_asked(&mut self, at: u64, drive: usize, number: u64) {
        let motor = &mut self.motors[drive];
        let found_at_rest = motor.rests();
        if motor.asked.len() >= ASKED {
            motor.asked.remove(0);
        }
        motor.asked.push(Asked {
            number,
            at,
            found_at_rest,
        });
    }

    /// All drives were stopped at once, and that is answered now, when the last one has stopped. A motor that was found at
    /// rest had nothing to stop: one that others have started after two readings that showed it at rest runs rightly.
    pub(super) fn all_stops_answered(&mut self, at: u64, number: u64) {
        for drive in 0..self.motors.len() {
            let lag = self.lag(drive);
            let readings = self.books[drive].readings;
            let motor = &mut self.motors[drive];
            let was_shown = |from: u64, until: u64| {
                let shows_rest =
                    |(output, at): &&(u16, u64)| *output == 0 && (from..until).contains(at);
                until > from + lag || readings.iter().filter(shows_rest).count() >= 2
            };
            let is_started_since = |it: &Asked| {
                it.number == number
                    && it.found_at_rest
                    && motor
                        .runs_since
                        .is_some_and(|since| was_shown(it.at, since))
            };
            match motor.asked.iter().position(is_started_since) {
                Some(place) => {
                    motor.asked.remove(place);
                    self.books[drive].stop_was_none(number);
                }
                None => self.stop_answered(at, drive, number),
            }
        }
    }

    /// How long a fresh value may lag behind the truth.
    fn lag(&self, drive: usize) -> u64 {
        PERIODS * self.line.drives[drive].poll + self.bound
    }

    /// M1: a stop is answered with success.
    pub(super) fn stop_answered(&mut self, at: u64, drive: usize, number: u64) {
        let lag = self.lag(drive);
        let motor = &mut self.motors[drive];
        let Some(place) = motor.asked.iter().position(|it| it.number == number) else {
            return;
        };
        let asked = motor.asked.remove(place).at;
        if motor.rests() {
            // There was nothing to stop, and later orders count.
            self.books[drive].stop_was_none(number);
            return;
        }
        // A stop for all is answered when the last drive has stopped. One of the others may have been started again.
        if self.books[drive]
            .orders
            .iter()
            .any(|it| it.number > number && it.has_run && it.taken > 0)
        {
            return;
        }
        let Some(runs_since) = motor.runs_since.filter(|_| {
            motor
                .stopped_by_us
                .is_none_or(|sent| sent + GOES_AGAIN < asked)
        }) else {
            return;
        };
        if at <= runs_since + lag {
            return;
        }
        // A result that waited for the broker is about a stop that had taken effect before others started the motor.
        let readings = &self.books[drive].readings;
        let showed_rest =
            |(output, at): &&(u16, u64)| *output == 0 && (asked..runs_since).contains(at);
        if asked < self.messages.opened_at && readings.iter().filter(showed_rest).count() >= 2 {
            return;
        }
        let has_risen = motor.risen_since.is_some_and(|risen| at > risen + lag);
        // A stop that was under way when the process was suspended continues with it.
        let goes_on = asked < self.stood.1 + lag;
        if motor.stopped_by_us.is_some() && (goes_on || !has_risen) {
            motor.owes_since = Some(at);
        } else {
            let text = format!(
                "a stop of drive {drive} is answered with success, no frame was sent for it, and the motor runs on at \
                 {} since {} ms",
                motor.state.output,
                (at - runs_since) / 1_000_000
            );
            self.object("M1", || text);
        }
    }

    /// A stop is refused.
    pub(super) fn stop_refused(&mut self, drive: usize, number: u64) {
        self.motors[drive].asked.retain(|it| it.number != number);
    }

    /// M3, as time goes by.
    pub(super) fn check_resets(&mut self, at: u64) {
        if !self.wire.is_up() {
            return;
        }
        let from = self.wire.up_since().max(self.wire.noise_at);
        for drive in 0..self.motors.len() {
            let Some(since) = self.motors[drive].resets_since else {
                continue;
            };
            if at > since.max(from) + RESET_TAKES && self.line.drives[drive].has_control {
                let text = format!(
                    "drive {drive} holds a reset in its run command since {} ms",
                    (at - since) / 1_000_000
                );
                self.object("M3", || text);
            }
        }
    }

    /// A number of trips of `drive` is reported.
    pub fn trips_told(&mut self, drive: usize, trips: u16) {
        let motor = &mut self.motors[drive];
        motor.told += u32::from(trips);
        if motor.told > u32::from(motor.state.trips) {
            let text = format!(
                "{} trips of drive {drive} are told, it had {}",
                motor.told, motor.state.trips
            );
            self.object("M4", || text);
        }
    }

    /// The gateway is killed: what was reported and not kept may be reported again.
    pub(super) fn telling_starts_again(&mut self, drive: usize, kept: u32) {
        let motor = &mut self.motors[drive];
        motor.told = motor.told.min(kept);
        motor.asked.clear();
    }

    /// M4: trips that were shown for long were reported.
    pub(super) fn check_told(&mut self, drive: usize, shown: u32) {
        if self.motors[drive].told < shown {
            let text = format!(
                "drive {drive} showed {shown} trips for long, {} are told",
                self.motors[drive].told
            );
            self.object("M4", || text);
        }
    }

    /// M5: the run state among `count` words from `address` on that a client received.
    pub(super) fn check_run_state(
        &mut self,
        at: u64,
        drive: usize,
        address: u16,
        count: u16,
        pdu: &[u8],
    ) {
        if address > STATUS || address + count <= RUN_STATE {
            return;
        }
        let word = |register: u16| {
            let place = 2 + 2 * usize::from(register - address);
            u16::from_be_bytes([pdu[place], pdu[place + 1]])
        };
        if word(STATUS) & IS_STALE != 0 {
            return;
        }
        let motor = &self.motors[drive];
        let kind = self.line.drives[drive].kind;
        // What a drive without a status shows of a trip is inferred.
        let not_so = match word(RUN_STATE) {
            STOPPED => motor.runs_since,
            FORWARD | REVERSE | RUNNING => motor.rests_since.filter(|_| motor.state.is_on),
            TRIPPED if kind != Kind::N700 => motor.sound_since.filter(|_| motor.state.is_on),
            _ => return,
        };
        self.counts.states += 1;
        let lag = self.lag(drive);
        if let Some(since) = not_so.filter(|since| at > since + lag) {
            let text = format!(
                "run state {} of drive {drive} is shown as fresh, and has not been true for {} ms: {:?}",
                word(RUN_STATE),
                (at - since) / 1_000_000,
                motor.state
            );
            self.object("M5", || text);
        }
    }
}
