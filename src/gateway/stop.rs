//! A stop that is on its way: a latch per drive, not a queue entry. It is sent, repeated at a bounded rate, and holds
//! until the drive shows its effect.
//!
//! A stop is effective when its echo came in an exchange that no late reply could be mistaken for, and later readings
//! show that the drive is not ordered to run any more, or the output frequency at zero, or twice at or below the one
//! before and falling.

use super::falling::FallWatch;
use super::outbox::Outbox;
use super::waiter::Waiter;
use crate::domain::command::{Outcome, Reason, Report};
use crate::domain::control::ControlSettings;
use crate::domain::time::MonoTime;
use crate::guard::StopOrder;
use crate::wire::pdu::Request;
use std::time::Duration;

/// Most commanders that wait for one stop. The next is told at once that the stop is on its way.
pub const WAITERS_MAX: usize = 64;
/// First wait before a stop without effect is repeated; doubled up to the longest.
const REPEAT_FIRST: Duration = Duration::from_millis(500);
/// Longest such wait.
const REPEAT_MAX: Duration = Duration::from_secs(4);
/// Time between two looks at the output frequency: enough for a ramp to show.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Looks in a row that may stay without an answer before the drive counts as away.
const LOOKS_BEFORE_AWAY: u8 = 3;
/// Time between two looks for a drive that is away: it is met soon when it is back, and costs the others little.
const LOOK_WHEN_AWAY: Duration = Duration::from_secs(2);

/// One stop that is not effective yet.
#[derive(Debug)]
pub struct StopLatch {
    order: StopOrder,
    waiters: Vec<Waiter>,
    /// When the first of the stops that led to this one was accepted: since then an effect is awaited.
    awaited_since: MonoTime,
    /// When the last of them was accepted.
    accepted_at: MonoTime,
    /// It went to all drives of the line at once.
    was_broadcast: bool,
    /// How often it was sent.
    sent: u32,
    send_at: MonoTime,
    /// The drive has answered it in an exchange without doubt.
    is_acknowledged: bool,
    /// The drive refused every form of it: it is settled once the motor stands still.
    was_refused: bool,
    /// In which of its forms it goes next, and how many the drive has refused so far.
    form: usize,
    refusals: usize,
    /// The last frame had no answer at all: it goes again as soon as the drive shows itself.
    is_unanswered: bool,
    look_at: MonoTime,
    watch: FallWatch,
    /// Looks that were answered: what is looked at changes with each.
    looks: usize,
    /// Looks in a row without an answer.
    missed_looks: u8,
    was_told_late: bool,
    /// Since when the drive is offline, as long as it is.
    offline_since: Option<MonoTime>,
    /// When it was declared for a commander that was lost or a gateway that ends; nothing if somebody commanded it, or it
    /// was left to the drive's own watchdog.
    declared_at: Option<MonoTime>,
    /// Neither it nor a look goes before this moment.
    silent_until: MonoTime,
    /// It was ordered in an earlier life of the gateway, and nothing was sent for it in this one.
    is_remembered: bool,
}

/// What became of the stop on an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// Nothing to tell.
    None,
    /// No effect in time.
    NotEffective,
    /// The drive stayed away for too long; nothing is repeated any more.
    Dropped,
}

impl StopLatch {
    /// A stop that was accepted at `now` and goes as soon as the wire is free.
    #[must_use]
    pub fn new(order: StopOrder, waiter: Option<Waiter>, now: MonoTime) -> Self {
        Self {
            order,
            waiters: waiter.into_iter().collect(),
            awaited_since: now,
            accepted_at: now,
            was_broadcast: false,
            sent: 0,
            send_at: now,
            is_acknowledged: false,
            was_refused: false,
            form: 0,
            refusals: 0,
            is_unanswered: false,
            look_at: MonoTime::NEVER,
            watch: FallWatch::default(),
            looks: 0,
            missed_looks: 0,
            was_told_late: false,
            offline_since: None,
            declared_at: None,
            silent_until: MonoTime::ZERO,
            is_remembered: false,
        }
    }

    /// A stop of an earlier life of the gateway. As for a drive that was away, it is looked at first: at standstill the
    /// stop is settled, otherwise it goes out.
    #[must_use]
    pub fn remembered(order: StopOrder, now: MonoTime) -> Self {
        let away = Self { sent: 1, look_at: now, missed_looks: LOOKS_BEFORE_AWAY, ..Self::new(order, None, now) };
        Self { is_remembered: true, ..away }
    }

    /// Nobody commanded it: it was declared at `now`.
    pub const fn was_declared(&mut self, now: MonoTime) {
        self.declared_at = Some(now);
    }

    /// When it was declared.
    #[must_use]
    pub const fn declared_at(&self) -> Option<MonoTime> {
        self.declared_at
    }

    /// It is left to the drive's own watchdog until `moment`: neither it nor a look goes before.
    pub const fn leave_until(&mut self, moment: MonoTime) {
        (self.silent_until, self.declared_at) = (moment, None);
    }

    /// Another stop for the same drive. One of the same kind is this one: it goes on being sent at its own rate, however
    /// many ask for it. One of another kind takes its place and goes out at once. Returns whether it is of another kind.
    pub fn also(&mut self, order: StopOrder, waiter: Option<Waiter>, now: MonoTime, out: &mut Outbox) -> bool {
        self.accepted_at = now;
        let is_other = order != self.order;
        if is_other {
            let waiters = std::mem::take(&mut self.waiters);
            let Self { awaited_since, was_told_late, offline_since, .. } = *self;
            *self = Self { waiters, awaited_since, was_told_late, offline_since, ..Self::new(order, None, now) };
        }
        if waiter.is_some() && now < self.silent_until {
            // Somebody stops it now: that goes before whatever was to come of silence.
            (self.silent_until, self.send_at, self.declared_at) = (MonoTime::ZERO, now, Some(now));
        }
        if let Some(waiter) = waiter {
            self.join(waiter, out);
        }
        is_other
    }

    /// One more waits for it, if there is room.
    pub fn join(&mut self, mut waiter: Waiter, out: &mut Outbox) {
        if self.waiters.len() >= WAITERS_MAX {
            return out.tell(&mut waiter, Report::new(Outcome::Unknown, Reason::StopPending), true);
        }
        if self.is_acknowledged {
            out.tell(&mut waiter, Report::new(Outcome::Acknowledged, Reason::None), false);
        }
        if !waiter.is_done() {
            self.waiters.push(waiter);
        }
        if std::mem::take(&mut self.is_remembered) {
            // Now it is ordered in this life, and waits for no look.
            (self.sent, self.missed_looks) = (0, 0);
        }
    }

    /// What goes on the wire and from when.
    #[must_use]
    pub fn frame(&self) -> (MonoTime, Request) {
        let at = if self.is_away() && !self.is_first() { MonoTime::NEVER } else { self.send_at.max(self.silent_until) };
        (at, self.order.request_in(self.form))
    }

    /// The word that it writes.
    #[must_use]
    pub const fn word(&self) -> u16 {
        self.order.word()
    }

    /// Its frame, if that has gone to nobody yet, neither to this drive nor to all at once.
    #[must_use]
    pub fn unsent(&self) -> Option<Request> {
        (self.is_first() && !self.was_broadcast).then(|| self.frame().1)
    }

    /// It went to all drives of the line in one frame. Nobody answers that, so its own frame still follows. Returns when
    /// it was accepted.
    pub const fn was_broadcast(&mut self) -> MonoTime {
        self.was_broadcast = true;
        self.accepted_at
    }

    /// Whether it is left to the drive's own watchdog at `now`.
    #[must_use]
    pub fn is_silent(&self, now: MonoTime) -> bool {
        now < self.silent_until
    }

    /// Whether it has never been sent: such frames go before repeats.
    #[must_use]
    pub const fn is_first(&self) -> bool {
        self.sent == 0
    }

    /// From when the output frequency should be looked at.
    #[must_use]
    pub const fn look_at(&self) -> MonoTime {
        self.look_at
    }

    /// How many looks were answered.
    #[must_use]
    pub const fn looks(&self) -> usize {
        self.looks
    }

    /// Whether the alarm was given.
    #[must_use]
    pub const fn is_late(&self) -> bool {
        self.was_told_late
    }

    /// Its frame goes out at `now`.
    pub fn was_sent(&mut self, now: MonoTime) {
        let doublings = self.sent.min(8);
        self.sent = self.sent.saturating_add(1);
        self.send_at = now + (REPEAT_FIRST * (1 << doublings)).min(REPEAT_MAX);
        self.is_unanswered = false;
        self.look_at = MonoTime::NEVER;
    }

    /// The drive answered as it should. Only without `doubt` is it an acknowledgement: the late echo of an earlier stop
    /// looks the same. Returns what those who wait are to be told.
    pub fn echoed(&mut self, now: MonoTime, doubt: bool) -> Option<Report> {
        self.look_at = now;
        if doubt {
            // The look that follows settles what was missing. Only then it goes again, and that echo is without doubt:
            // the stops of two drives that did not wait for their looks would keep both from ever being looked at.
            self.is_unanswered = true;
            return None;
        }
        if self.is_acknowledged {
            return None;
        }
        self.is_acknowledged = true;
        self.watch = FallWatch::default();
        Some(Report::new(Outcome::Acknowledged, Reason::None))
    }

    /// The drive refused it in its present form: another one that its model declares goes at once. Where it has refused
    /// all of them, it goes again in its time; meanwhile the drive is looked at, and at standstill there is nothing left
    /// to stop. Returns whether no other form is left.
    pub fn refused(&mut self, now: MonoTime) -> bool {
        self.look_at = now;
        self.form = (self.form + 1) % self.order.forms();
        self.refusals = self.refusals.saturating_add(1);
        if self.refusals < self.order.forms() {
            self.send_at = now;
            return false;
        }
        self.was_refused = true;
        true
    }

    /// Whether the drive has refused every form of it and acknowledged none.
    #[must_use]
    pub const fn is_refused(&self) -> bool {
        self.was_refused && !self.is_acknowledged
    }

    /// Whether the drive has answered it in an exchange without doubt.
    #[must_use]
    pub const fn is_acknowledged(&self) -> bool {
        self.is_acknowledged
    }

    /// The frame had no good answer: it goes again, at once when the drive shows itself.
    pub fn unanswered(&mut self, now: MonoTime) {
        (self.look_at, self.is_unanswered) = (now, true);
    }

    /// Takes a reading of the output frequency that was asked for after the last frame. Whether the stop is effective.
    ///
    /// A drive that was away is read before it is stopped: at standstill the stop is settled, otherwise it goes out.
    /// `runs`: its status shows it ordered to run.
    pub fn takes_effect(&mut self, raw: u16, runs: bool, now: MonoTime) -> bool {
        self.look_at = now + LOOK_EVERY;
        self.watch.take(raw);
        if self.is_away() {
            let stands_still = self.watch.is_at_zero() && !runs;
            if stands_still || raw > 0 || runs {
                self.is_back(now);
            }
            return stands_still;
        }
        self.is_back(now);
        let rests = self.was_refused && self.watch.is_at_zero() && !runs;
        rests || (self.is_acknowledged && self.watch.is_falling())
    }

    /// Takes what the drive's status shows: whether it is ordered to run. Whether the stop is effective.
    pub fn shows(&mut self, running: bool, now: MonoTime) -> bool {
        self.look_at = now + LOOK_EVERY;
        if !self.is_away() || running {
            self.is_back(now);
        }
        self.is_acknowledged && !running
    }

    /// A look was answered.
    pub const fn was_looked_at(&mut self) {
        self.looks = self.looks.wrapping_add(1);
    }

    /// The drive answers: what was not answered goes again at once.
    fn is_back(&mut self, now: MonoTime) {
        self.is_remembered = false;
        let was_away = self.is_away();
        self.missed_looks = 0;
        if std::mem::take(&mut self.is_unanswered) || was_away {
            self.send_at = now;
        }
    }

    /// The drive cannot be asked. What it has acknowledged proves nothing when it can be asked again: others may have
    /// started it in between.
    pub const fn out_of_sight(&mut self) {
        self.is_acknowledged = false;
    }

    /// The look was not answered.
    pub fn look_failed(&mut self, now: MonoTime) {
        self.missed_looks = self.missed_looks.saturating_add(1);
        self.look_at = now + if self.is_away() { LOOK_WHEN_AWAY } else { LOOK_EVERY };
        if self.is_away() {
            self.watch = FallWatch::default();
        }
    }

    /// The drive does not answer looks: it is not sent to before it is seen.
    const fn is_away(&self) -> bool {
        self.missed_looks >= LOOKS_BEFORE_AWAY
    }

    /// What time alone brings about.
    pub fn pass(&mut self, now: MonoTime, is_offline: bool, control: &ControlSettings) -> Turn {
        self.offline_since = is_offline.then(|| self.offline_since.unwrap_or(now));
        if self.drop_at(control).is_some_and(|at| now >= at) {
            return Turn::Dropped;
        }
        if self.late_at(control).is_some_and(|at| now >= at) {
            self.was_told_late = true;
            return Turn::NotEffective;
        }
        Turn::None
    }

    /// When [`Self::pass`] has something to say; nothing while it goes on as it does for a drive that answers.
    #[must_use]
    pub fn next_wake(&self, control: &ControlSettings) -> Option<MonoTime> {
        [self.drop_at(control), self.late_at(control)].into_iter().flatten().min()
    }

    /// Nothing is repeated any more for a drive that has been offline for so long since it was last to stop.
    fn drop_at(&self, control: &ControlSettings) -> Option<MonoTime> {
        self.offline_since.map(|since| since.max(self.accepted_at) + control.stop_pending_for)
    }

    /// When the alarm is due, unless it was given.
    fn late_at(&self, control: &ControlSettings) -> Option<MonoTime> {
        (!self.was_told_late).then(|| self.awaited_since + control.stop_effect_timeout)
    }

    /// What those who wait are told when it is late: whether the drive ever answered makes the difference.
    #[must_use]
    pub const fn late_report(&self) -> Report {
        let reason = if self.is_acknowledged { Reason::NotEffective } else { Reason::NoReply };
        Report::new(Outcome::Unknown, reason)
    }

    /// Those who wait.
    pub fn waiters(&mut self) -> &mut Vec<Waiter> {
        &mut self.waiters
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_output_is_no_effect() {
        for (readings, effective) in [
            (&[5000, 5000, 5000, 5000][..], false),
            (&[5000, 4990, 4980], true),
            (&[5000, 4990], false),
            (&[5000, 5000, 4999], true),
            (&[4000, 4500, 4400], false),
            (&[4000, 4500, 4400, 4300], true),
            (&[0], true),
            (&[], false),
        ] {
            let mut watch = FallWatch::default();
            for raw in readings {
                watch.take(*raw);
            }
            assert_eq!(watch.is_falling(), effective, "{readings:?}");
        }
    }
}
