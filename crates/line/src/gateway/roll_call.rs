//! Whether another gateway listens on a shared line: the active one asks, a listener answers. Both tell whether their files
//! agree.

use crate::domain::time::MonoTime;
use crate::line::roll_call::{OwedAnswer, RollCall};
use crate::wire::signal::{SignalKind, SignalWord};
use std::time::Duration;

/// A frame for the other gateways of the line.
#[derive(Debug)]
pub(super) enum GatewayFrame {
    Word(SignalWord),
    Signal(SignalKind),
}

/// What this gateway asks, and what it has to answer.
#[derive(Debug)]
pub(super) struct LineRollCall {
    /// While this gateway is active: whether another one listens.
    roll_call: Option<RollCall>,
    /// The answer that it owes as a listener.
    answer: Option<OwedAnswer>,
    /// The digest of this gateway's drives was sent, and the question that follows it was not asked yet.
    is_digest_sent: bool,
    /// A digest of its drives.
    digest: u16,
    /// Whether the drives of the other gateway differ; `None` while that is not known.
    differs: Option<bool>,
}

impl LineRollCall {
    pub const fn new(digest: u16) -> Self {
        Self {
            roll_call: None,
            answer: None,
            is_digest_sent: false,
            digest,
            differs: None,
        }
    }

    /// This gateway has become the active one: it asks from `now` on.
    pub fn begin(&mut self, now: MonoTime) {
        (self.roll_call, self.answer, self.differs) = (Some(RollCall::new(now)), None, None);
    }

    /// This gateway is the active one no more.
    pub const fn end(&mut self) {
        (self.roll_call, self.differs) = (None, None);
    }

    /// Whether another gateway listens, if that is known.
    pub fn listener(&self) -> Option<bool> {
        self.roll_call?.listener()
    }

    /// Whether the drives of the other gateway are known to differ.
    pub fn files_differ(&self) -> bool {
        self.differs == Some(true)
    }

    /// Asks once more, at `now`.
    pub fn ask_again(&mut self, now: MonoTime) {
        self.roll_call
            .iter_mut()
            .for_each(|call| call.ask_again(now));
    }

    /// The other gateway has sent the digest of its drives.
    pub const fn digest_heard(&mut self, digest: u16) {
        self.differs = Some(digest != self.digest);
    }

    /// The active gateway asked at `at`, as was seen at `now`; the answer goes in its own `slot`.
    pub fn question_heard(&mut self, now: MonoTime, at: MonoTime, slot: Duration) {
        self.answer = Some(OwedAnswer::to_question(now, at, slot));
    }

    /// Whether the answer may be handed to the port at `now`.
    pub fn may_answer(&self, now: MonoTime) -> bool {
        self.answer.is_some_and(|answer| answer.may_be_sent(now))
    }

    /// When the next question is due whether another gateway listens.
    pub fn asks_at(&self) -> Option<MonoTime> {
        self.roll_call?.ask_at()
    }

    /// Until when the line is left silent for an answer.
    pub fn silent_until(&self) -> Option<MonoTime> {
        self.roll_call?.open_until()
    }

    /// Whether an answer is still waited for at `now`.
    pub fn waits_for_listener(&mut self, now: MonoTime) -> bool {
        let Some(call) = &mut self.roll_call else {
            return false;
        };
        call.pass(now);
        call.open_until().is_some()
    }

    /// The question whether another gateway listens, or what is sent before it, if it is time for that.
    pub fn question(&mut self, now: MonoTime) -> Option<GatewayFrame> {
        if self.asks_at().is_none_or(|at| now < at) {
            return None;
        }
        // A listener answers the question by the digest that it has just received.
        let is_sent = std::mem::replace(&mut self.is_digest_sent, true);
        Some(if is_sent {
            GatewayFrame::Signal(SignalKind::Question)
        } else {
            GatewayFrame::Word(SignalWord::Digest(self.digest))
        })
    }

    /// The question is out at `end`. It `counts` if it could be heard.
    pub fn was_asked(&mut self, end: MonoTime, counts: bool) {
        self.is_digest_sent = false;
        if counts && let Some(call) = &mut self.roll_call {
            call.asked(end);
        }
    }

    /// A listener has answered with a signal of `kind`. It `counts` if signals can be heard.
    pub fn listener_answered(&mut self, now: MonoTime, kind: SignalKind, counts: bool) {
        self.differs = Some(kind == SignalKind::Differs);
        if counts && let Some(call) = &mut self.roll_call {
            call.answered(now);
        }
    }

    /// When the answer to a question of the active gateway is due.
    pub fn answers_at(&self) -> Option<MonoTime> {
        Some(self.answer?.at())
    }

    /// The answer to a question that was heard just before `now`, if it is time for it and this gateway `may_answer`.
    pub fn due_answer(&mut self, now: MonoTime, may_answer: bool) -> Option<SignalKind> {
        if !may_answer || self.answer?.is_over(now) {
            self.answer = None;
        }
        if !self.answer?.may_be_sent(now) {
            return None;
        }
        Some(if self.differs == Some(true) {
            SignalKind::Differs
        } else {
            SignalKind::Listening
        })
    }

    /// A question was answered, or something else was heard since, which ends the time for its answer.
    pub const fn end_answer(&mut self) {
        self.answer = None;
    }
}
