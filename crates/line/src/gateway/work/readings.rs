//! Readings of the drive: output frequency and trips.

use super::heard_order::HeardOrder;
use super::{DriveWork, Out};
use crate::domain::address::Address;
use crate::domain::command::{Outcome, Reason, Report, RunIntent};
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::snapshot::DriveSnapshot;
use crate::drive::view::{TripEvent, TripEventKind};
use crate::gateway::event::LineEffect;
use crate::gateway::note::DriveNote;
use crate::journal::JournalEntry;
use crate::profile::model::IndicatedState;

/// The noise of a steady speed is less than this part of a hertz, or one step.
const NOISE_PER_HERTZ: u32 = 10;
const LEAST_FALL: u16 = 2;

/// The origin of words.
#[derive(Clone, Copy, Debug)]
pub struct WordsOrigin {
    /// The drive sent them no later than this.
    pub at: MonoTime,
    /// They are certainly from this drive: only then do they report trips.
    pub is_its_own: bool,
}

impl DriveWork {
    /// Words came from `address` on, for whatever reason they were read.
    pub fn take_words(
        &mut self,
        address: Address,
        words: &[u16],
        reading: WordsOrigin,
        now: MonoTime,
        out: Out<'_>,
    ) {
        self.has_changed = true;
        if reading.is_its_own
            && let Some(changed) = self.guard.take_bases(address, words, reading.at)
        {
            self.changed_basis = Some(changed);
            // What waits was worked out with another full scale.
            self.cut_motion(Reason::FullScaleUnknown, out);
        }
        if reading.is_its_own {
            self.guard.take_setting(address, words, reading.at);
        }
        let ran = self.status.is_running();
        let shown = self.status.take(address, words);
        if let Some(running) = shown {
            self.status_at = Some(reading.at);
            if running {
                self.runs_now();
            }
            // The drive was started again, and not from here.
            let is_started = running && (ran == Some(false) || self.is_turned_round());
            self.is_stopping &= self.latch.is_some() || !is_started;
            if self
                .latch
                .as_mut()
                .is_some_and(|latch| latch.shows(running, now))
            {
                self.effective(out);
            }
        }
        if let Some(state) = self.status.take_undocumented() {
            out.push_back(LineEffect::Note(self.drive, DriveNote::Undocumented(state)));
        }
        let output = match &self.output_register {
            Some(register) if self.impossible_output(address, words).is_none() => {
                register.steps(address, words)
            }
            _ => None,
        };
        if let Some(raw) = output {
            self.take_output(raw, reading.at, now, out);
            self.held_against_limits(now, out);
        }
        if let Some(running) = shown {
            self.followed(running, now, out);
        }
        if output.is_some() || self.status_at == Some(reading.at) {
            self.is_seen(out);
        }
        if self.is_moving() {
            self.has_turned = true;
            self.guard.found_running(self.turns(), now);
        }
        if self.latch.is_none() && self.stands() {
            self.has_turned = false;
            self.heard_stop_is_over();
            self.may_run_on &= matches!(self.guard.intent(), RunIntent::Run(_));
            self.is_stopping = false;
            self.guard.at_standstill();
        }
        self.bear_out(output.is_some(), now, out);
        self.take_watchdog(address, words, out);
        if reading.is_its_own {
            let events = self.trips.take(address, words, now);
            self.trip(events, out);
        } else {
            let event = self.trips.take_unsure(address, words);
            self.trip(event, out);
        }
    }

    /// Words were read from the drive at `read_at`, and `snapshot` has them.
    pub fn take_usage(&mut self, snapshot: &DriveSnapshot, read_at: MonoTime, out: Out<'_>) {
        if self.status_at.max(self.output.at()) == Some(read_at) {
            self.usage.take_running(self.runs(), read_at);
        }
        self.usage.take_readings(snapshot, out);
    }

    /// Whether the motor turns or the drive is ordered to run; `None` if that is not known.
    fn runs(&self) -> Option<bool> {
        let is_at_rest = self.status.is_running() == Some(false) || self.output.raw() == Some(0);
        if self.is_moving() {
            Some(true)
        } else {
            is_at_rest.then_some(false)
        }
    }

    /// The drive has stopped answering.
    pub(super) fn usage_out_of_sight(&mut self, out: Out<'_>) {
        self.usage.out_of_sight(out);
    }

    /// The output frequency of the last reading.
    pub(super) fn output_frequency(&self) -> Option<Hertz> {
        self.output_register
            .as_ref()?
            .frequency(self.output.raw()?, self.guard.bases())
    }

    /// The steps of the output in a hertz.
    pub(super) fn steps_per_hertz(&self) -> u32 {
        self.output_register
            .as_ref()
            .map_or(1, |register| register.steps_per_hertz(self.guard.bases()))
    }

    /// The register of the output frequency, if `words` show more there than the drive can do: such a reading proves
    /// nothing.
    pub fn impossible_output(&self, address: Address, words: &[u16]) -> Option<Address> {
        let register = self.output_register.as_ref()?;
        let shown = register.frequency(register.steps(address, words)?, self.guard.bases())?;
        let most = self
            .guard
            .control()
            .map_or(Hertz::ZERO, |control| control.most)
            .max(register.range());
        (shown > most.doubled()).then(|| register.address())
    }

    /// Whether the drive shows a different direction than when its stop took effect: another master has ordered it to
    /// turn the other way.
    fn is_turned_round(&self) -> bool {
        let is_reverse = self.status.get(IndicatedState::Reverse);
        self.ramps_reverse.is_some() && is_reverse.is_some() && self.ramps_reverse != is_reverse
    }

    pub(super) fn take_output(&mut self, raw: u16, read_at: MonoTime, now: MonoTime, out: Out<'_>) {
        self.output.take(raw, read_at);
        if self.latch.is_some() {
            let runs = self.status.is_running() == Some(true);
            let noise = u16::try_from(self.steps_per_hertz() / NOISE_PER_HERTZ).unwrap_or(u16::MAX);
            let least_fall = noise.max(LEAST_FALL);
            if self
                .latch
                .as_mut()
                .is_some_and(|latch| latch.takes_effect(raw, runs, least_fall, now))
            {
                self.effective(out);
            }
        }
        self.held_against_its_stop(now, out);
        if self.output.is_active() {
            let event = self.trips.output_is_active(now);
            self.trip(event, out);
        }
    }

    /// The motor turns behind a stop that took effect. Where it becomes faster, it was started from elsewhere. Where it keeps a
    /// speed, it may never have obeyed, and only ramped to its setpoint: the stop is sent again.
    fn held_against_its_stop(&mut self, now: MonoTime, out: Out<'_>) {
        if !self.is_stopping || self.latch.is_some() || self.status.is_running() == Some(false) {
            return;
        }
        let Some(control) = self.guard.control() else {
            return;
        };
        if self.output.has_risen(self.steps_per_hertz()) {
            self.is_stopping = false;
        } else if self.output.has_settled(control.stop_effect_timeout) {
            let Some(order) = self.guard.stop_again() else {
                return;
            };
            self.stop(order, None, now, out);
        }
    }

    pub(super) fn effective(&mut self, out: Out<'_>) {
        let Some(mut latch) = self.latch.take() else {
            return;
        };
        if latch.is_acknowledged() {
            self.guard.stop_was_effective();
            self.may_run_on = false;
            self.heard = HeardOrder::Nothing;
            self.is_stop_refused = false;
            self.stop_refused_at = None;
        }
        self.output.ramps_down(out.now());
        self.ramps_reverse = self.status.get(IndicatedState::Reverse);
        let was_reported =
            latch.is_reported() || (self.is_refusal_reported && !self.is_stop_refused);
        self.is_refusal_reported &= self.is_stop_refused;
        let over = self.guard.stop_is_over(true);
        self.fail_safe_came(over, out);
        out.keep(self.drive, JournalEntry::StopOver { is_effective: true });
        if was_reported {
            out.push_back(LineEffect::Note(self.drive, DriveNote::EffectiveAtLast));
        }
        for mut waiter in std::mem::take(latch.waiters()) {
            self.tell(
                &mut waiter,
                Report::new(Outcome::Confirmed, Reason::None),
                true,
                out,
            );
        }
    }

    pub(super) fn trip(&mut self, events: impl IntoIterator<Item = TripEvent>, out: Out<'_>) {
        let events = Vec::from_iter(events);
        let has_trip = events
            .iter()
            .any(|event| event.kind != TripEventKind::Cleared);
        let is_tripped = self.trips.view().active == Some(true);
        if has_trip || (is_tripped && self.guard.intent() != RunIntent::Stop) {
            // A trip cuts the output off: what reads as 0 from now on stands.
            self.has_turned = false;
            // A trip ends all orders: after a reset a new order is required.
            self.guard.lost_touch(out.now());
            self.cut_motion(Reason::Tripped, out);
        }
        self.usage.count_trips(&events, out);
        self.keep_trips(&events, out);
        events
            .into_iter()
            .for_each(|event| out.push_back(LineEffect::Trip(self.drive, event)));
    }
}
