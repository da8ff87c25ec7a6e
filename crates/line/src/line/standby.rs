//! Several gateways on one line: the line itself is the lease.
//!
//! The active one sends at least every [`SIGNAL_AFTER`]. It may send only while it has sent within
//! [`StandbyTimes::silent_at_most`]; one that was suspended for longer listens first. A listener takes the line over
//! once it has heard no sign of another gateway for [`StandbyTimes::take_over_after`], which is longer by all that may lie
//! between sending a frame and hearing it. So there are never two that may send, without a network and without clocks that
//! agree.

mod change;
mod ears;
mod knowledge;
mod times;

use crate::domain::standby::LineRole;
use crate::domain::time::MonoTime;
pub use change::StandbyChange;
use ears::SenderEars;
pub use knowledge::StandbyKnowledge;
use std::time::Duration;
pub(in crate::line) use times::random;
use times::{CONTEND_MAX, CONTEND_WAIT, HAND_OVER_MAX, JAM_BREAK, LOOK_EVERY, LOOK_MAX, TIE_BREAK};
pub use times::{RANK_STEP, ROLE_SAID_EVERY, SIGNAL_AFTER, SIGNALS_WITHIN, StandbyTimes};

/// Whether this gateway may send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SendState {
    /// The port is not open: nothing can be heard. The line was last in use at `used_at`.
    Deaf { used_at: Option<MonoTime> },
    /// Nothing of another gateway was heard since `quiet_from`, up to `looked_at`; the line is taken over after the usual
    /// silence and `extra`.
    Listening {
        quiet_from: MonoTime,
        looked_at: MonoTime,
        extra: Duration,
    },
    /// The line is taken: between `at` and `until` a signal says so, before anything else is sent.
    Claiming { at: MonoTime, until: MonoTime },
    /// The last frame was sent at `sent_at`.
    Active { sent_at: MonoTime },
}

/// The state of the rule on one line.
#[derive(Clone, Debug)]
pub struct StandbyRule {
    times: StandbyTimes,
    state: SendState,
    /// When a frame of another gateway or master was last heard; `None` if never since the port was opened.
    heard_at: Option<MonoTime>,
    /// When this gateway takes over a line that was handed over, unless it hears another one before.
    accept_at: Option<MonoTime>,
    /// Frames since the line was taken over that were not answered, while none was.
    contended: u8,
    knowledge: StandbyKnowledge,
    ears: SenderEars,
    seed: u64,
}

impl StandbyRule {
    /// The rule with `times`, on a port that is not open yet. `seed` differs between gateways and starts.
    #[must_use]
    pub const fn new(times: StandbyTimes, seed: u64) -> Self {
        Self {
            times,
            state: SendState::Deaf { used_at: None },
            heard_at: None,
            accept_at: None,
            contended: 0,
            knowledge: StandbyKnowledge::NEW,
            ears: SenderEars::NEW,
            seed,
        }
    }

    /// The times of the rule.
    #[must_use]
    pub const fn times(&self) -> &StandbyTimes {
        &self.times
    }

    /// What this gateway does on the line.
    #[must_use]
    pub const fn role(&self) -> LineRole {
        match self.state {
            SendState::Deaf { .. } | SendState::Listening { .. } => LineRole::Listening,
            SendState::Claiming { .. } | SendState::Active { .. } => LineRole::Active,
        }
    }

    /// Whether a frame may be handed to the port at `now`. To be asked right before that: the process may have been
    /// suspended since the frame was decided on.
    #[must_use]
    pub fn may_send(&self, now: MonoTime) -> bool {
        match self.state {
            SendState::Deaf { .. } | SendState::Listening { .. } => false,
            SendState::Claiming { at, until } => now >= at && now < until,
            SendState::Active { sent_at } => now.since(sent_at) < self.times.silent_at_most,
        }
    }

    /// From when on the next frame may be sent, which has to be a signal that the line is taken; `None` if it need not.
    #[must_use]
    pub const fn claims_at(&self) -> Option<MonoTime> {
        match self.state {
            SendState::Claiming { at, .. } => Some(at),
            SendState::Deaf { .. } | SendState::Listening { .. } | SendState::Active { .. } => None,
        }
    }

    /// Whether another gateway or master was heard so recently at `now` that it must be taken for alive.
    #[must_use]
    pub fn hears_other(&self, now: MonoTime) -> bool {
        self.heard_at
            .is_some_and(|at| now.since(at) <= self.times.silent_at_most)
    }

    /// Whether this gateway listens, and was not suspended right before `now`: what it has just received came just now, and
    /// did not wait in the port.
    #[must_use]
    pub fn is_attentive(&self, now: MonoTime) -> bool {
        let looked = matches!(self.state, SendState::Listening { looked_at, .. } if now.since(looked_at) <= LOOK_MAX);
        looked && self.knowledge.is_attentive(now)
    }

    /// What this gateway knows of the line while it may not send.
    #[must_use]
    pub const fn knowledge(&self) -> &StandbyKnowledge {
        &self.knowledge
    }

    /// Whether it has left the line to another gateway and waits for longer than its silence: its stops leave room for that.
    #[must_use]
    pub fn makes_room(&self) -> bool {
        matches!(self.state, SendState::Listening { extra, .. } if extra > TIE_BREAK)
    }

    /// Whether it fell silent because it heard no drive, and has heard nothing since.
    #[must_use]
    pub const fn is_deaf(&self) -> bool {
        self.ears.are_in_doubt()
    }

    /// When another gateway or master was last heard; `None` if never since the port was opened.
    #[must_use]
    pub const fn heard_at(&self) -> Option<MonoTime> {
        self.heard_at
    }

    /// When the active gateway sends a signal, unless it sends something else before.
    #[must_use]
    pub fn signal_at(&self) -> Option<MonoTime> {
        match self.state {
            SendState::Claiming { at, .. } => Some(at),
            SendState::Active { sent_at } => Some(sent_at + self.times.signal_after),
            SendState::Deaf { .. } | SendState::Listening { .. } => None,
        }
    }

    /// When [`Self::pass`] is due: a listener looks at the line or takes it over, the active gateway gives it up unless it
    /// sends something before.
    #[must_use]
    pub fn due_at(&self) -> Option<MonoTime> {
        match self.state {
            SendState::Deaf { .. } => None,
            SendState::Listening {
                quiet_from,
                looked_at,
                extra,
            } => {
                let silence = quiet_from + self.times.take_over_after + extra;
                Some(
                    silence
                        .min(looked_at + LOOK_EVERY)
                        .min(self.accept_at.unwrap_or(silence)),
                )
            }
            SendState::Claiming { until, .. } => Some(until.min(self.deaf_at())),
            SendState::Active { sent_at } => {
                Some((sent_at + self.times.silent_at_most).min(self.deaf_at()))
            }
        }
    }

    fn deaf_at(&self) -> MonoTime {
        self.ears.silent_at().unwrap_or(MonoTime::NEVER)
    }

    /// When a listener looks at the line next, whatever is due; `None` while it does not listen.
    #[must_use]
    pub fn looks_at(&self) -> Option<MonoTime> {
        let SendState::Listening { looked_at, .. } = self.state else {
            return None;
        };
        Some(looked_at + LOOK_EVERY)
    }

    /// The port was opened at `now`.
    pub fn port_opened(&mut self, now: MonoTime) {
        self.heard_at = None;
        self.accept_at = None;
        let used_at = if let SendState::Deaf { used_at } = self.state {
            used_at
        } else {
            None
        };
        self.knowledge
            .missed(used_at, now, self.times.silent_at_most);
        self.state = SendState::Listening {
            quiet_from: now,
            looked_at: now,
            extra: Duration::ZERO,
        };
    }

    /// The port is gone. Returns whether the line was given up by that.
    pub fn port_gone(&mut self) -> bool {
        self.heard_at = None;
        self.accept_at = None;
        let was_active = self.is_active();
        let used_at = match self.state {
            SendState::Deaf { used_at } => used_at,
            SendState::Listening { quiet_from, .. } => Some(quiet_from),
            SendState::Claiming { .. } => None,
            SendState::Active { sent_at } => Some(sent_at),
        };
        self.state = SendState::Deaf { used_at };
        was_active
    }

    /// A frame is handed to the port after `now`.
    pub fn sent(&mut self, now: MonoTime) {
        if self.is_active() {
            self.state = SendState::Active { sent_at: now };
        }
    }

    /// At `now`, the last frame was handed to the port. If that took too long, the line is given up.
    pub fn was_sent(&mut self, now: MonoTime) -> Option<StandbyChange> {
        match self.state {
            SendState::Active { sent_at } if now.since(sent_at) > HAND_OVER_MAX => {
                self.listen(now);
                Some(StandbyChange::Stalled)
            }
            _ => None,
        }
    }

    /// A sound frame that is not of this gateway was received at `now`, while it listens: another one sends.
    pub fn heard(&mut self, now: MonoTime) {
        if let SendState::Listening {
            quiet_from, extra, ..
        } = &mut self.state
        {
            *quiet_from = now;
            // The line has its gateway: no other one has to be let in first.
            *extra = Duration::ZERO;
            self.ears.heard();
            self.heard_at = Some(now);
            // Another one has accepted the line.
            self.accept_at = None;
        }
    }

    /// A sound reply was received at `now` whose request was not heard: the line is in use, perhaps by this gateway's own
    /// last request.
    pub const fn heard_alone(&mut self, now: MonoTime) {
        if let SendState::Listening { quiet_from, .. } = &mut self.state {
            *quiet_from = now;
            self.ears.heard();
        }
    }

    /// A drive has answered a request of this gateway at `now`.
    pub const fn answered(&mut self, now: MonoTime) {
        self.ears.answered(now);
    }

    /// A request of this gateway had no sound reply.
    pub const fn missed(&mut self) {
        if self.is_active() {
            self.ears.missed();
        }
    }

    /// The last byte, of whatever kind, was received at `at`: there was no silence before.
    pub fn received(&mut self, at: MonoTime) {
        if let SendState::Listening { quiet_from, .. } = &mut self.state {
            *quiet_from = (*quiet_from).max(at);
        }
    }

    /// A jam is over at `now`: the silence begins for all gateways at once, and a random part separates those of one rank.
    pub fn jam_ended(&mut self, now: MonoTime) {
        let random = self.random(JAM_BREAK);
        if let SendState::Listening {
            quiet_from, extra, ..
        } = &mut self.state
        {
            *quiet_from = now;
            *extra = (*extra).max(random);
        }
    }

    /// A request of another master was received at `now`. Returns whether this gateway was active: it gives the line up.
    pub fn heard_request(&mut self, now: MonoTime) -> Option<StandbyChange> {
        let gives_up = self.is_active();
        if gives_up {
            let used_at = self.may_send(now).then_some(now);
            self.knowledge
                .missed(used_at, now, self.times.silent_at_most);
            // The other one may have given the line up by this gateway's own frame: the random part of the wait stays.
            self.listen(now);
            self.heard_at = Some(now);
            self.ears.heard();
        } else {
            self.heard(now);
        }
        gives_up.then_some(StandbyChange::Rival)
    }

    /// No drive has answered since the line was taken over, and at `now` another request was not, or what came `is_damaged`:
    /// another one may have taken the line over at the same moment, and send in step with this one. So the next frame waits
    /// for a random time: who waits longer hears the other one. If that does not help, the line is given up.
    pub fn unanswered(&mut self, now: MonoTime, is_damaged: bool) -> Option<StandbyChange> {
        let SendState::Active { sent_at } = self.state else {
            return None;
        };
        if self.contended < if is_damaged { CONTEND_MAX } else { 1 } {
            self.contended += 1;
            let at = now + self.random(CONTEND_WAIT);
            let until = (at + HAND_OVER_MAX).min(sent_at + self.times.silent_at_most);
            self.state = SendState::Claiming { at, until };
            return None;
        }
        if !is_damaged {
            return None;
        }
        self.listen(now);
        Some(StandbyChange::Collided)
    }

    /// The operator asked at `now` to give the line up. Another gateway is expected to take it before this one does.
    pub fn give_up(&mut self, now: MonoTime, wait: Duration) -> Option<StandbyChange> {
        if !self.is_active() {
            return None;
        }
        self.state = SendState::Listening {
            quiet_from: now,
            looked_at: now,
            extra: wait,
        };
        Some(StandbyChange::Yielded)
    }

    /// The active gateway hands the line over at `now`.
    pub fn handed_over(&mut self, now: MonoTime) {
        self.heard_at = Some(now);
        if let SendState::Listening {
            quiet_from,
            looked_at,
            extra,
        } = &mut self.state
        {
            (*quiet_from, *looked_at) = (now, now);
            *extra = Duration::ZERO;
            self.accept_at = Some(now + self.times.accept_after);
        }
    }

    /// The line was handed over at `now`, and this gateway does not take it: the other one takes it back first.
    pub fn refused(&mut self, now: MonoTime) {
        self.heard(now);
        let longer = self.times.take_over_after * 2;
        if let SendState::Listening { extra, .. } = &mut self.state {
            *extra = longer;
        }
    }

    fn take(&mut self, now: MonoTime) {
        self.ears.taken(now);
        self.knowledge.is_complete(now);
        self.accept_at = None;
        self.contended = 0;
        // The others must hear it at once: the next rank is waiting.
        self.state = SendState::Claiming {
            at: now,
            until: now + HAND_OVER_MAX,
        };
    }

    const fn is_active(&self) -> bool {
        matches!(
            self.state,
            SendState::Claiming { .. } | SendState::Active { .. }
        )
    }

    /// Time has passed up to `now`. `is_free`: a frame could be sent now, as far as the wire is concerned.
    pub fn pass(&mut self, now: MonoTime, is_free: bool) -> Option<StandbyChange> {
        match self.state {
            SendState::Deaf { .. } => None,
            SendState::Claiming { .. } | SendState::Active { .. }
                if self.due_at().is_some_and(|at| now < at) =>
            {
                None
            }
            SendState::Claiming { .. } | SendState::Active { .. } if now >= self.deaf_at() => {
                let wait = self.ears.fall_silent(self.times.take_over_after);
                let extra = wait + self.random(wait);
                self.knowledge.is_complete(now);
                self.state = SendState::Listening {
                    quiet_from: now,
                    looked_at: now,
                    extra,
                };
                Some(StandbyChange::Deaf)
            }
            SendState::Claiming { .. } | SendState::Active { .. } => {
                self.listen(now);
                self.knowledge.missed(None, now, self.times.silent_at_most);
                Some(StandbyChange::Stalled)
            }
            SendState::Listening {
                quiet_from,
                looked_at,
                extra,
            } => {
                let was_suspended = now.since(looked_at) > LOOK_MAX;
                if was_suspended {
                    self.accept_at = None;
                    self.knowledge.begins(now);
                    self.knowledge
                        .missed(Some(quiet_from), now, self.times.silent_at_most);
                }
                let quiet_from = if was_suspended { now } else { quiet_from };
                if is_free && self.accept_at.is_some_and(|at| now >= at) {
                    self.take(now);
                    return Some(StandbyChange::HandedOver);
                }
                if is_free && now >= quiet_from + self.times.take_over_after + extra {
                    self.take(now);
                    return Some(StandbyChange::TakenOver);
                }
                self.state = SendState::Listening {
                    quiet_from,
                    looked_at: now,
                    extra,
                };
                None
            }
        }
    }

    /// Listens from `now` on, with a random part in the wait: whatever made two gateways send must not repeat in step.
    fn listen(&mut self, now: MonoTime) {
        let extra = self.random(TIE_BREAK);
        self.knowledge.begins(now);
        self.state = SendState::Listening {
            quiet_from: now,
            looked_at: now,
            extra,
        };
    }

    fn random(&mut self, longest: Duration) -> Duration {
        times::random(&mut self.seed, longest)
    }
}

#[cfg(test)]
mod tests;
