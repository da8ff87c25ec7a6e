//! Whether another gateway listens on a shared line: the active one asks, a listener answers.

use super::core::LineCore;
use super::work::WishRank;
use crate::domain::report::LineFault;
use crate::domain::time::MonoTime;
use crate::line::roll_call::RollCall;
use crate::wire::signal::{self, SignalKind, SignalWord};

impl LineCore {
    /// Asks whether another gateway listens, if it is time for that. Returns whether nothing else may be sent at `now`: a
    /// stop may, and is more important than the answer.
    pub(super) fn call_roll(&mut self, now: MonoTime) -> bool {
        let has_stop = self
            .wanted_at(WishRank::RepeatedStop)
            .is_some_and(|at| now >= at);
        if has_stop {
            return false;
        }
        let Some(call) = self.roll_call_mut() else {
            return false;
        };
        call.pass(now);
        if call.open_until().is_some() {
            return true;
        }
        let is_due = call.ask_at().is_some_and(|at| now >= at);
        if is_due {
            // A listener answers the question by the digest that it has just received.
            let told = self.share.as_mut().map(|share| {
                (
                    std::mem::replace(&mut share.told_digest, true),
                    share.digest,
                )
            });
            match told {
                Some((false, digest)) => self.send_word(now, SignalWord::Digest(digest)),
                _ => self.send_signal(now, SignalKind::Question),
            }
        }
        is_due
    }

    /// The question is out.
    pub(super) fn roll_was_called(&mut self, now: MonoTime) {
        let end = now
            + self
                .timing
                .on_wire(self.timing.adu_bytes(signal::PDU_BYTES));
        if let Some(share) = &mut self.share {
            share.told_digest = false;
        }
        if let Some(call) = self.roll_call_mut() {
            call.asked(end);
        }
    }

    /// Takes the answer of a listener, if the request `frame` of another master is one. Returns whether it is.
    pub(super) fn hears_listener(&mut self, now: MonoTime, frame: &[u8]) -> bool {
        let signal = self
            .signal_in(frame)
            .filter(|(it, is_own)| it.kind.is_of_listener() && !is_own);
        let Some((signal, _)) = signal else {
            return false;
        };
        if let Some(share) = &mut self.share {
            share.differs = Some(signal.kind == SignalKind::Differs);
        }
        if let Some(call) = self.roll_call_mut() {
            call.answered(now);
        }
        true
    }

    /// When the next question is due.
    pub(super) fn roll_call_at(&self) -> Option<MonoTime> {
        self.roll_call()?.ask_at()
    }

    /// Until when the line is left silent for an answer; a stop ends that.
    pub(super) fn silent_until(&self) -> Option<MonoTime> {
        let until = self.roll_call()?.open_until()?;
        Some(
            self.wanted_at(WishRank::RepeatedStop)
                .map_or(until, |stop| stop.min(until)),
        )
    }

    fn roll_call(&self) -> Option<&RollCall> {
        if !self.may_signal() {
            return None;
        }
        self.share.as_ref()?.roll_call.as_ref()
    }

    fn roll_call_mut(&mut self) -> Option<&mut RollCall> {
        if !self.may_signal() {
            return None;
        }
        self.share.as_mut()?.roll_call.as_mut()
    }

    /// Whether a signal would be heard.
    pub(super) const fn may_signal(&self) -> bool {
        !matches!(
            self.health.trouble,
            Some(LineFault::Jammed | LineFault::Echo)
        )
    }

    /// Answers a question of the active gateway, if one was heard just before `now`. Returns whether it does.
    pub(super) fn answer_question(&mut self, now: MonoTime) -> bool {
        let listens = self.listens() && self.may_signal();
        let Some(share) = self.share.as_mut().filter(|share| share.answer.is_some()) else {
            return false;
        };
        if !listens || share.answer.is_some_and(|answer| answer.is_over(now)) {
            share.answer = None;
        }
        let answers = share.answer.is_some_and(|answer| answer.may_be_sent(now));
        if answers {
            let differs = share.differs == Some(true);
            self.send_signal(
                now,
                if differs {
                    SignalKind::Differs
                } else {
                    SignalKind::Listening
                },
            );
        }
        answers
    }

    /// When the answer to a question is due.
    pub(super) fn answer_at(&self) -> Option<MonoTime> {
        Some(self.share.as_ref()?.answer?.at())
    }
}
