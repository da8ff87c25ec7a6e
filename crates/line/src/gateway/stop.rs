//! A stop in progress: a latch per drive, not a queue entry. It is sent, repeated at a bounded rate, and holds until the
//! drive shows its effect.
//!
//! A stop is effective once it was acknowledged in an exchange beyond doubt, and later readings show that the drive is no
//! longer ordered to run, or an output frequency that is zero, or falls by more than its noise and is twice not above the
//! previous reading.

mod overdue;

use super::falling::OutputFallWatch;
use super::outbox::EffectOutbox;
use super::waiter::ReportWaiter;
use crate::domain::command::{Outcome, Reason, Report};
use crate::domain::time::MonoTime;
use crate::drive::run_state::STANDSTILL_HOLDS;
use crate::guard::StopOrder;
use crate::wire::pdu::Request;
use std::time::Duration;

/// Maximum number of clients that wait for one stop. Any further one is answered at once that the stop is in progress.
pub const WAITERS_MAX: usize = 64;
/// How long a drive that is busy is left alone. A stop does not wait for that.
pub const BUSY_REST: Duration = Duration::from_millis(200);
/// First wait before a stop without effect is repeated; doubled up to the maximum.
const REPEAT_FIRST: Duration = Duration::from_millis(500);
/// Maximum wait before a stop without effect is repeated.
const REPEAT_MAX: Duration = Duration::from_secs(4);
/// Time between two reads of the output frequency: enough for a ramp to show.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Consecutive unanswered reads before the drive counts as away.
const LOOKS_BEFORE_AWAY: u8 = 3;
/// How much later than usual a stop is repeated while its drive is away: one that is not heard may hear.
const REPEAT_LATER: Duration = Duration::from_secs(6);
/// Time between two reads of a drive that is back and reads as 0, until it has stood for long enough.
const LOOK_WHEN_ZERO: Duration = Duration::from_millis(500);
/// Time between two reads of a drive that is away: its return is noticed soon, at little cost to the others.
const LOOK_WHEN_AWAY: Duration = Duration::from_secs(2);

/// A stop that is not effective yet.
#[derive(Debug)]
pub struct StopLatch {
    order: StopOrder,
    waiters: Vec<ReportWaiter>,
    /// When the first of the stops merged here was accepted: an effect is expected since then.
    awaited_since: MonoTime,
    /// When the last of them was accepted.
    accepted_at: MonoTime,
    /// The stop was broadcast to all drives of the line.
    was_broadcast: bool,
    /// Number of times it was sent.
    sent: u32,
    send_at: MonoTime,
    /// The drive has acknowledged it beyond doubt.
    is_acknowledged: bool,
    /// The drive refused every form of it: it is settled once the motor is at standstill.
    was_refused: bool,
    /// The form in which it is sent next, and the number of forms refused so far.
    form: usize,
    refusals: usize,
    /// The last frame was not answered: it is sent again as soon as the drive responds to anything.
    is_unanswered: bool,
    look_at: MonoTime,
    watch: OutputFallWatch,
    /// Number of answered reads; the register to read changes with each.
    looks: usize,
    /// Consecutive unanswered reads.
    missed_looks: u8,
    /// The zeros that a drive which was away has shown last.
    zeros: Option<ZeroSpan>,
    is_late_reported: bool,
    /// Whether it was reported that the stop could not be sent in time.
    is_unsent_reported: bool,
    /// Since when the drive has been offline, if it is.
    offline_since: Option<MonoTime>,
    /// When it was declared because of a lost client or a shutdown of the gateway; `None` if a client commanded it, or it
    /// was left to the drive's own watchdog.
    declared_at: Option<MonoTime>,
    /// Neither the stop nor a read is sent before this moment.
    silent_until: MonoTime,
    /// The stop was ordered before a restart of the gateway, and nothing was sent for it since.
    is_remembered: bool,
    by_client: ByClient,
}

/// Consecutive readings of zero. A longer pause between two of them ends it: the motor may have turned meanwhile.
#[derive(Clone, Copy, Debug)]
struct ZeroSpan {
    first: MonoTime,
    last: MonoTime,
}

impl ZeroSpan {
    /// The `span` with one more, read at `now`.
    fn with(span: Option<Self>, now: MonoTime) -> Self {
        let first = span.filter(|it| now < it.ends_at()).map(|it| it.first);
        Self {
            first: first.unwrap_or(now),
            last: now,
        }
    }

    /// When it ends, unless another one is read before.
    fn ends_at(self) -> MonoTime {
        self.last + STANDSTILL_HOLDS
    }

    /// Time between the first and the last.
    fn lasted(self) -> Duration {
        self.last.since(self.first)
    }
}

/// Whether a client has commanded a stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ByClient {
    No,
    /// A client has commanded the stop, and it was sent since.
    Sent,
    /// A client has commanded the stop since it was last sent. A drive that is away may hear it.
    Waits,
}

/// The state of the stop after an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopTurn {
    /// Nothing to report.
    None,
    /// No effect in time.
    NotEffective,
    /// The stop could not be sent in time.
    NotSent,
    /// The drive stayed offline for too long; the stop is no longer repeated.
    Dropped,
}

impl StopLatch {
    /// A stop that was accepted at `now` and is sent as soon as the wire is free.
    #[must_use]
    pub fn new(order: StopOrder, waiter: Option<ReportWaiter>, now: MonoTime) -> Self {
        Self {
            order,
            by_client: if waiter.is_some() {
                ByClient::Waits
            } else {
                ByClient::No
            },
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
            watch: OutputFallWatch::default(),
            looks: 0,
            missed_looks: 0,
            zeros: None,
            is_late_reported: false,
            is_unsent_reported: false,
            offline_since: None,
            declared_at: None,
            silent_until: MonoTime::ZERO,
            is_remembered: false,
        }
    }

    /// A stop from before a restart of the gateway. Like a drive that was away, the drive is read first: at standstill the
    /// stop is settled, otherwise it is sent.
    #[must_use]
    pub fn remembered(order: StopOrder, now: MonoTime) -> Self {
        let away = Self {
            sent: 1,
            look_at: now,
            missed_looks: LOOKS_BEFORE_AWAY,
            ..Self::new(order, None, now)
        };
        Self {
            is_remembered: true,
            ..away
        }
    }

    /// Marks it as declared at `now`, not commanded.
    pub const fn was_declared(&mut self, now: MonoTime) {
        self.declared_at = Some(now);
    }

    /// Whether it was only declared, and no client has commanded it.
    #[must_use]
    pub fn is_declared_alone(&self) -> bool {
        self.declared_at.is_some() && self.by_client == ByClient::No
    }

    /// When it was declared.
    #[must_use]
    pub const fn declared_at(&self) -> Option<MonoTime> {
        self.declared_at
    }

    /// Leaves it to the drive's own watchdog until `moment`: neither it nor a read is sent before.
    pub const fn leave_until(&mut self, moment: MonoTime) {
        self.silent_until = moment;
        self.declared_at = None;
    }

    /// Merges another stop for the same drive. One of the same kind joins this one, which keeps its own rate however many
    /// clients ask for it. One of another kind replaces it and is sent at once. Returns whether it is of another kind.
    pub fn also(
        &mut self,
        order: StopOrder,
        waiter: Option<ReportWaiter>,
        now: MonoTime,
        out: &mut EffectOutbox,
    ) -> bool {
        self.accepted_at = now;
        let is_other = order != self.order;
        if is_other {
            *self = Self {
                waiters: std::mem::take(&mut self.waiters),
                awaited_since: self.awaited_since,
                is_late_reported: self.is_late_reported,
                is_unsent_reported: self.is_unsent_reported,
                offline_since: self.offline_since,
                by_client: self.by_client,
                ..Self::new(order, None, now)
            };
        }
        if waiter.is_some() && now < self.silent_until {
            // A client stops it now: that takes precedence over waiting for the watchdog.
            self.silent_until = MonoTime::ZERO;
            self.send_at = now;
            self.declared_at = Some(now);
        }
        if let Some(waiter) = waiter {
            self.join(waiter, out);
        }
        is_other
    }

    /// Adds a waiting client, if there is room.
    pub fn join(&mut self, mut waiter: ReportWaiter, out: &mut EffectOutbox) {
        if self.waiters.len() >= WAITERS_MAX {
            return out.tell(
                &mut waiter,
                Report::new(Outcome::Unknown, Reason::StopPending),
                true,
            );
        }
        if self.is_acknowledged {
            out.tell(
                &mut waiter,
                Report::new(Outcome::Acknowledged, Reason::None),
                false,
            );
        }
        self.by_client = ByClient::Waits;
        if !waiter.is_done() {
            self.waiters.push(waiter);
        }
        if std::mem::take(&mut self.is_remembered) {
            // It is now ordered in this run, and waits for no read.
            self.sent = 0;
            self.missed_looks = 0;
        }
    }

    /// The frame to send, and the earliest moment.
    #[must_use]
    pub fn frame(&self) -> (MonoTime, Request) {
        let at = if !self.is_away() || self.is_first() || self.by_client == ByClient::Waits {
            self.send_at
        } else if self.is_remembered {
            // It is read first.
            MonoTime::NEVER
        } else {
            let stands = self.zeros.map_or(MonoTime::ZERO, ZeroSpan::ends_at);
            stands.max(self.send_at + REPEAT_LATER)
        };
        (at.max(self.silent_until), self.order.request_in(self.form))
    }

    /// The order that it sends.
    #[must_use]
    pub const fn order(&self) -> &StopOrder {
        &self.order
    }

    /// Its frame, if it has not been sent yet, neither to this drive nor as a broadcast.
    #[must_use]
    pub fn unsent(&self) -> Option<Request> {
        (self.is_first() && !self.was_broadcast).then(|| self.frame().1)
    }

    /// The stop was broadcast to all drives of the line at `now`. A broadcast is not answered, so its own frame still follows.
    /// Returns when it was accepted.
    pub fn was_broadcast(&mut self, now: MonoTime) -> MonoTime {
        self.goes_out(now);
        self.was_broadcast = true;
        self.accepted_at
    }

    /// If it was reported that the stop could not be sent, an effect is expected from `now` on.
    fn goes_out(&mut self, now: MonoTime) {
        if self.is_unsent() && self.is_unsent_reported {
            self.awaited_since = now;
            self.is_late_reported = false;
        }
    }

    /// Whether it is left to the drive's own watchdog at `now`.
    #[must_use]
    pub fn is_silent(&self, now: MonoTime) -> bool {
        now < self.silent_until
    }

    /// Whether it has never been sent: such frames take precedence over repeats.
    #[must_use]
    pub const fn is_first(&self) -> bool {
        self.sent == 0
    }

    /// When the output frequency should be read next.
    #[must_use]
    pub const fn look_at(&self) -> MonoTime {
        self.look_at
    }

    /// Number of answered reads.
    #[must_use]
    pub const fn looks(&self) -> usize {
        self.looks
    }

    /// Its frame is sent at `now`, and again as soon as the drive `hears_from`.
    pub fn was_sent(&mut self, now: MonoTime, hears_from: MonoTime) {
        self.goes_out(now);
        let doublings = self.sent.min(8);
        self.sent = self.sent.saturating_add(1);
        let repeat = now + (REPEAT_FIRST * (1 << doublings)).min(REPEAT_MAX);
        self.send_at = if now < hears_from {
            repeat.min(hears_from)
        } else {
            repeat
        };
        self.is_unanswered = false;
        if self.by_client == ByClient::Waits {
            self.by_client = ByClient::Sent;
        }
        self.look_at = MonoTime::NEVER;
    }

    /// The drive replied as expected. Only without `doubt` is that an acknowledgement: the late reply to an earlier stop
    /// looks the same. Returns the report for the waiting clients.
    pub fn echoed(&mut self, now: MonoTime, doubt: bool) -> Option<Report> {
        self.look_at = now;
        if doubt {
            // The read that follows settles missing replies. Only then is it sent again, and that reply is beyond doubt.
            // Without waiting for their reads, the stops of two drives would keep each other from ever being read.
            self.is_unanswered = true;
            return None;
        }
        if self.is_acknowledged {
            return None;
        }
        self.is_acknowledged = true;
        self.watch = OutputFallWatch::default();
        Some(Report::new(Outcome::Acknowledged, Reason::None))
    }

    /// Whether the drive has acknowledged it beyond doubt.
    #[must_use]
    pub const fn is_acknowledged(&self) -> bool {
        self.is_acknowledged
    }

    /// The frame may not have arrived: it is sent again at `now`.
    pub const fn send_again_at(&mut self, now: MonoTime) {
        self.send_at = now;
    }

    /// The frame had no valid reply: it is sent again, at once when the drive responds to anything.
    pub fn unanswered(&mut self, now: MonoTime) {
        self.look_at = now;
        self.is_unanswered = true;
    }

    /// Takes a reading of the output frequency requested after the last frame. Returns whether the stop is effective.
    ///
    /// A drive that was away is read before it is stopped: once it has been at standstill for long enough the stop is
    /// settled, and if it turns it is sent. `runs`: its status shows it ordered to run. `least_fall`: the steps that are more
    /// than noise.
    pub fn takes_effect(&mut self, raw: u16, runs: bool, least_fall: u16, now: MonoTime) -> bool {
        self.look_at = now + LOOK_EVERY;
        self.watch.take(raw);
        if self.is_away() && raw == 0 && !runs {
            let zeros = ZeroSpan::with(self.zeros, now);
            self.zeros = Some(zeros);
            if zeros.lasted() < STANDSTILL_HOLDS {
                self.look_at = now + LOOK_WHEN_ZERO;
                return false;
            }
            self.is_back(now);
            return true;
        }
        self.is_back(now);
        let rests = self.was_refused && self.watch.is_at_zero() && !runs;
        rests || (self.is_acknowledged && self.watch.is_falling(least_fall))
    }

    /// Takes a reading of the status: whether the drive is ordered to run. Returns whether the stop is effective.
    pub fn shows(&mut self, running: bool, now: MonoTime) -> bool {
        let is_at_zero = self.zeros.is_some() && !running;
        self.look_at = now
            + if is_at_zero {
                LOOK_WHEN_ZERO
            } else {
                LOOK_EVERY
            };
        if !self.is_away() || running {
            self.is_back(now);
        }
        self.is_acknowledged && !running
    }

    /// A read was answered at `now`. One that proved nothing is not repeated at once either.
    pub fn was_looked_at(&mut self, now: MonoTime) {
        self.looks = self.looks.wrapping_add(1);
        self.look_at = self.look_at.max(now + LOOK_EVERY);
    }

    /// The drive responds again: an unanswered stop is sent again at once.
    fn is_back(&mut self, now: MonoTime) {
        self.is_remembered = false;
        if self.zeros.take().is_some() && !self.is_late_reported {
            // Until now nothing was to be sent.
            self.awaited_since = now;
        }
        let was_away = self.is_away();
        self.missed_looks = 0;
        if std::mem::take(&mut self.is_unanswered) || was_away {
            self.send_at = now;
        }
    }

    /// The line is given up: the drive is asked there no more, so what it did not answer holds the stop back no more.
    pub const fn line_given_up(&mut self) {
        if !self.is_remembered {
            self.missed_looks = 0;
        }
    }

    /// The drive cannot be asked. Its acknowledgement proves nothing once it can be asked again: others may have started
    /// it in between.
    pub const fn out_of_sight(&mut self) {
        self.is_acknowledged = false;
    }

    /// The read was not answered.
    pub fn look_failed(&mut self, now: MonoTime) {
        self.missed_looks = self.missed_looks.saturating_add(1);
        self.look_at = now
            + if self.is_away() {
                LOOK_WHEN_AWAY
            } else {
                LOOK_EVERY
            };
        if self.is_away() {
            self.watch = OutputFallWatch::default();
        }
    }

    /// Whether the drive does not answer reads: it is read before the next stop is sent, which comes much later.
    const fn is_away(&self) -> bool {
        self.missed_looks >= LOOKS_BEFORE_AWAY
    }

    /// The drive refused it in its current form: the next form that its model declares is sent at once. If it has refused
    /// all of them, the stop is repeated as usual; meanwhile the drive is read, and at standstill there is nothing left to
    /// stop. Returns whether no other form is left.
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

    /// The drive is busy at `now`: the stop is sent again `at` that moment, or as soon as the drive shows that it is not.
    pub fn is_busy(&mut self, at: MonoTime, now: MonoTime) {
        self.unanswered(now);
        self.send_at = self.send_at.min(at);
    }

    /// The waiting clients.
    pub fn waiters(&mut self) -> &mut Vec<ReportWaiter> {
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
            (&[5000, 4980], false),
            (&[5000, 5000, 4990], true),
            (&[5000, 5000, 4991], false),
            (
                &[5000, 4999, 4998, 4998, 4997, 5000, 4999, 4996, 4995],
                false,
            ),
            (&[4000, 4500, 4400], false),
            (&[4000, 4500, 4400, 4300], true),
            (&[0], false),
            (&[0, 0], true),
            (&[5000, 0, 5000, 5000], false),
            (&[], false),
        ] {
            let mut watch = OutputFallWatch::default();
            for raw in readings {
                watch.take(*raw);
            }
            assert_eq!(watch.is_falling(10), effective, "{readings:?}");
        }
    }
}
