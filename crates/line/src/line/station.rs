//! The line's state of one station: replies that may still arrive late, and how long it has been silent.

use super::exchange::answers;
use super::quiet::StationSilence;
pub use super::stray::StrayFrame;
use crate::domain::time::MonoTime;
use crate::profile::model::{Model, RefusedWrite};
use crate::wire::pdu::Request;
use std::time::Duration;

/// Maximum number of missing replies remembered for one station; it is not asked again before the oldest is over.
pub const MISSING_MAX: usize = 8;
/// Consecutive silences after which a station counts as known to be silent.
pub const KNOWN_SILENT_AFTER: u32 = 2;
/// The wait before a station that is known to be silent is asked again; doubled with each silence.
pub const BACK_OFF_FIRST: Duration = Duration::from_secs(1);
/// The longest such wait.
pub const BACK_OFF_MAX: Duration = Duration::from_secs(30);
/// Reply timeout for a station that is known to be silent, short so that it delays the others little. A drive that
/// needs longer is noticed by its late reply and then given its full timeout again.
pub const PROBE_TIMEOUT: Duration = Duration::from_millis(100);
/// The wait before a station is asked again that may be deaf because it was switched on.
pub const DEAF_WAIT: Duration = Duration::from_millis(250);

/// How long a reply beyond the maximum lateness is remembered, so that it is recognised if it arrives after all.
pub const EXPIRED_FOR: Duration = Duration::from_secs(30);
/// In how many exchanges with noise before the reply, among how many exchanges, a silence is inserted to see whether
/// another reply follows.
pub const LOOKS: (u8, u16) = (8, 256);

/// A request whose reply did not arrive in time.
#[derive(Clone, Debug)]
pub struct MissingReply {
    /// The request.
    pub request: Request,
    /// When its last character had been sent.
    pub sent_at: MonoTime,
    /// After this moment the reply can no longer arrive.
    pub until: MonoTime,
}

/// The line's state of one station.
#[derive(Debug)]
pub struct StationState {
    /// How it answers a refused write.
    refused: RefusedWrite,
    /// Each of its replies says to which request it belongs: none is ever in doubt.
    is_identified: bool,
    /// How long it is deaf after it is switched on.
    deaf_after_power_up: Duration,
    missing: Vec<MissingReply>,
    /// Missing replies that could no longer arrive.
    expired: Vec<MissingReply>,
    /// When the last character of the newest request had been sent.
    asked_at: MonoTime,
    /// The silence that it owes after an unexplained frame.
    quiet: StationSilence,
    /// If the newest answer may have been a reply that could no longer arrive: its lateness.
    taken: Option<Duration>,
    /// Remaining silences of [`LOOKS`], and exchanges until they are replenished.
    looks: (u8, u16),
    /// Until this moment a reply may arrive to a request from before this state was created.
    asked_before_until: MonoTime,
    silent_in_a_row: u32,
    /// Consecutive back-offs.
    back_offs: u32,
    ask_again_at: MonoTime,
    /// Until this moment the station may be deaf: that a drive is switched on can only be guessed.
    may_be_deaf_until: MonoTime,
    /// Until this moment the station is known to be deaf.
    rests_until: MonoTime,
    /// Until this moment the station is busy with a write.
    pauses_until: MonoTime,
}

impl StationState {
    /// A station of `model` that has not been addressed yet.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        let deaf = model.quirks.deaf_after_power_up.as_ref();
        Self {
            refused: model.write.refused.value,
            is_identified: false,
            deaf_after_power_up: deaf.map_or(Duration::ZERO, |fact| fact.value),
            missing: Vec::new(),
            expired: Vec::new(),
            asked_at: MonoTime::ZERO,
            quiet: StationSilence::NONE,
            taken: None,
            looks: LOOKS,
            asked_before_until: MonoTime::ZERO,
            silent_in_a_row: 0,
            back_offs: 0,
            ask_again_at: MonoTime::ZERO,
            may_be_deaf_until: MonoTime::ZERO,
            rests_until: MonoTime::ZERO,
            pauses_until: MonoTime::ZERO,
        }
    }

    /// This station where replies may carry the number of their request. If they do, no late reply makes it dirty.
    #[must_use]
    pub fn identified(self, is_identified: bool) -> Self {
        Self {
            is_identified,
            ..self
        }
    }

    /// Whether a late reply may still be mistaken for another at `now`.
    #[must_use]
    pub fn is_dirty(&self, now: MonoTime) -> bool {
        now < self.clean_at()
    }

    /// From when on no late reply can arrive, if no further reply goes missing. A moment in the past means now.
    #[must_use]
    pub fn clean_at(&self) -> MonoTime {
        if self.is_identified {
            return MonoTime::ZERO;
        }
        let known = self.missing.iter().map(|missing| missing.until).max();
        known
            .unwrap_or(MonoTime::ZERO)
            .max(self.asked_before_until)
            .max(self.quiet.until())
    }

    /// When a late answer can no longer be mistaken for the answer to `request`. A moment in the past means now.
    #[must_use]
    pub fn unmistakable_at(&self, request: &Request) -> MonoTime {
        if self.is_identified {
            return MonoTime::ZERO;
        }
        if self.missing.len() >= MISSING_MAX {
            let oldest = self.missing.iter().map(|missing| missing.until).min();
            return oldest.unwrap_or(MonoTime::ZERO).max(self.quiet.until());
        }
        let mistakable = self
            .missing
            .iter()
            .filter(|missing| self.is_mistakable(&missing.request, request));
        let known = mistakable
            .map(|missing| missing.until)
            .max()
            .unwrap_or(MonoTime::ZERO)
            .max(self.quiet.until());
        match request {
            // Its data are fresh: no earlier request had them.
            Request::Loopback { .. } => known,
            _ => known.max(self.asked_before_until),
        }
    }

    /// Whether an exception, or a write's reply with another value, could be a late one of `function`.
    #[must_use]
    pub fn misses_function(&self, function: u8, now: MonoTime) -> bool {
        if self.is_identified {
            return false;
        }
        let misses =
            |missing: &MissingReply| now < missing.until && missing.request.function() == function;
        now < self.asked_before_until.max(self.quiet.until()) || self.missing.iter().any(misses)
    }

    /// Before this moment no requests are sent to the station, because it has been silent.
    #[must_use]
    pub const fn ask_again_at(&self) -> MonoTime {
        self.ask_again_at
    }

    /// Before this moment it is known to be deaf: only stops are sent to it.
    #[must_use]
    pub const fn rests_until(&self) -> MonoTime {
        self.rests_until
    }

    /// Before this moment nothing is sent to it, not even a stop: it needs a pause after a write.
    #[must_use]
    pub const fn pauses_until(&self) -> MonoTime {
        self.pauses_until
    }

    /// The station needs a pause until `moment`.
    pub fn pause_until(&mut self, moment: MonoTime) {
        self.pauses_until = self.pauses_until.max(moment);
    }

    /// From when requests may be sent to it, considering silence, deafness and pauses.
    #[must_use]
    pub fn may_be_asked_from(&self) -> MonoTime {
        self.ask_again_at
            .max(self.rests_until)
            .max(self.pauses_until)
    }

    /// The station may have been sent a request by another; the reply can arrive until `moment`. Answers to that one explain frames.
    pub const fn asked_before(&mut self, moment: MonoTime) {
        self.quiet = StationSilence::NONE;
        self.asked_before_until = moment;
    }

    /// The station is known to be deaf until `moment`.
    pub fn rest_until(&mut self, moment: MonoTime) {
        self.rests_until = self.rests_until.max(moment);
    }

    /// Its line was opened at `now`, perhaps because the power came back to both.
    pub fn line_opened(&mut self, now: MonoTime) {
        self.quiet.forget();
        self.may_be_deaf(now);
        if now < self.may_be_deaf_until {
            self.ask_again_at = self.ask_again_at.min(now + DEAF_WAIT);
        }
    }

    /// Whether it has been silent so often that it is only probed.
    #[must_use]
    pub const fn is_known_silent(&self) -> bool {
        self.silent_in_a_row >= KNOWN_SILENT_AFTER
    }

    /// The last silence may have been a slow reply: the station is not given up before a full timeout.
    #[must_use]
    pub const fn is_in_question(&self) -> bool {
        self.silent_in_a_row > 0
    }

    /// A request has remained unanswered at `now`.
    pub fn reply_missing(&mut self, missing: MissingReply, now: MonoTime) {
        self.expire(now);
        if self.is_identified && self.missing.len() >= MISSING_MAX {
            self.missing.remove(0);
        }
        self.missing.push(missing);
    }

    /// A request is sent to it; its last character is sent at `end`.
    pub const fn asked(&mut self, end: MonoTime) {
        self.asked_at = end;
    }

    /// How late a reply may arrive: `declared`, or more if that was observed.
    #[must_use]
    pub fn lateness(&self, declared: Duration) -> Duration {
        self.quiet.lateness(declared)
    }

    /// Whether its replies may belong to other requests, or to another drive.
    #[must_use]
    pub fn is_doubtful(&self) -> bool {
        self.quiet.is_required()
    }

    /// A sound frame of the station with `pdu` arrived at `now` that answers no open request. An unexplained one makes
    /// the station dirty until it has been silent for as long as the latest reply was late, unless it is the first one to a
    /// request that `waits`: then only a reply that follows does. `declared`: the declared maximum lateness.
    pub fn stray(
        &mut self,
        pdu: &[u8],
        now: MonoTime,
        declared: Duration,
        waits: bool,
    ) -> StrayFrame {
        self.expire(now);
        if self.is_identified {
            return StrayFrame::Explained;
        }
        if now < self.asked_before_until
            || self
                .missing
                .iter()
                .any(|missing| answers(&missing.request, pdu))
        {
            self.heard(now);
            return StrayFrame::Explained;
        }
        let expired = self
            .expired
            .iter()
            .position(|expired| answers(&expired.request, pdu));
        let beyond = expired
            .map(|place| now.since(self.expired.remove(place).sent_at))
            .or(self.taken.take());
        let late = beyond.unwrap_or_else(|| now.since(self.asked_at).min(declared));
        if beyond.is_none() && waits {
            return StrayFrame::WrongForm(late);
        }
        if beyond.is_some() {
            self.quiet.observed(late);
        }
        self.is_unexplained(late, now);
        if beyond.is_some() {
            StrayFrame::BeyondLimit(late)
        } else {
            StrayFrame::TooMany(late)
        }
    }

    /// A frame that arrived `late` belongs to no request of ours.
    pub fn is_unexplained(&mut self, late: Duration, now: MonoTime) {
        self.quiet.unexplained(late, now);
        self.looks = LOOKS;
    }

    /// A frame of it was received at `now`: a required silence starts over.
    pub fn heard(&mut self, now: MonoTime) {
        self.quiet.heard(now);
    }

    fn expire(&mut self, now: MonoTime) {
        let (missing, expired): (Vec<_>, Vec<_>) = self
            .missing
            .drain(..)
            .partition(|missing| now < missing.until);
        self.missing = missing;
        self.expired
            .retain(|expired| now < expired.until + EXPIRED_FOR);
        self.expired.extend(expired);
        let excess = self.expired.len().saturating_sub(MISSING_MAX);
        self.expired.drain(..excess);
    }

    /// The request that `pdu` answers late, and when its last character had been sent; `None` if that is not certain.
    #[must_use]
    pub fn answered_late(&self, pdu: &[u8], now: MonoTime) -> Option<(&Request, MonoTime)> {
        let is_answered =
            |missing: &&MissingReply| now < missing.until && answers(&missing.request, pdu);
        let mut answered = self.missing.iter().filter(is_answered);
        let only = answered.next()?;
        answered
            .next()
            .is_none()
            .then_some((&only.request, only.sent_at))
    }

    /// The station was silent: it is polled less and less often, unless it may be deaf for a while.
    pub fn silent(&mut self, now: MonoTime) {
        self.silent_in_a_row = self.silent_in_a_row.saturating_add(1);
        if self.silent_in_a_row == KNOWN_SILENT_AFTER {
            self.may_be_deaf(now);
        }
        if !self.is_known_silent() {
            return;
        }
        if now < self.may_be_deaf_until {
            self.ask_again_at = now + DEAF_WAIT;
            return;
        }
        self.ask_again_at =
            now + (BACK_OFF_FIRST * (1 << self.back_offs.min(16))).min(BACK_OFF_MAX);
        self.back_offs = self.back_offs.saturating_add(1);
    }

    /// A valid answer arrived to a request whose answer is unmistakable. Drives answer in order, so none of the missing
    /// replies can follow.
    pub fn answered(&mut self) {
        self.missing.clear();
        self.asked_before_until = MonoTime::ZERO;
        self.is_there();
    }

    /// The exchange of `request` was answered at `now`. `was_noisy`: other data arrived before the answer. If that was
    /// the reply, the answer belonged to another request and one more will follow: a silence shows it.
    pub fn exchange_ended(&mut self, request: &Request, was_noisy: bool, now: MonoTime) {
        self.expire(now);
        // Drives answer in order: an expired reply has been mistaken for this answer, or never arrives.
        let taken = self
            .expired
            .iter()
            .find(|expired| self.is_mistakable(&expired.request, request));
        self.taken = taken.map(|expired| now.since(expired.sent_at));
        self.expired.clear();
        let (looks, until_next) = self.looks;
        self.looks = if until_next == 0 {
            LOOKS
        } else {
            (looks, until_next - 1)
        };
        if was_noisy && self.looks.0 > 0 && !self.is_identified {
            self.looks.0 -= 1;
            self.quiet.look(now);
        }
        self.quiet.exchange_ended(now);
    }

    /// A frame arrived at `now` that may be the refusal of the open request, and may be a late one. It settles nothing.
    /// It is not unexplained either: a drive that refuses every stop would otherwise never be polled again.
    pub fn refused_in_doubt(&mut self, now: MonoTime) {
        self.is_there();
        self.quiet.exchange_ended(now);
    }

    /// A frame of the station was received that was not the answer: it is there, but slow.
    pub fn is_there(&mut self) {
        self.silent_in_a_row = 0;
        self.back_offs = 0;
        self.ask_again_at = MonoTime::ZERO;
    }

    fn may_be_deaf(&mut self, now: MonoTime) {
        self.may_be_deaf_until = self.may_be_deaf_until.max(now + self.deaf_after_power_up);
    }

    /// Whether the reply to `missing` would be accepted as the reply to `request`.
    fn is_mistakable(&self, missing: &Request, request: &Request) -> bool {
        let keeps_old_value = self.refused != RefusedWrite::Exception;
        match (missing, request) {
            // An exception carries only its function.
            (Request::Unserved { .. }, _) | (_, Request::Unserved { .. }) => {
                missing.function() == request.function()
            }
            // The reply to a read tells the function and the number of bytes; 1 to 8 bits take one byte.
            (Request::Read { .. }, Request::Read { .. }) => {
                missing.function() == request.function()
                    && missing.reply_pdu_bytes() == request.reply_pdu_bytes()
            }
            // Where a refused write may be answered with any value, the value says nothing.
            (
                Request::WriteSingle {
                    address: a,
                    value: of_a,
                },
                Request::WriteSingle {
                    address: b,
                    value: of_b,
                },
            ) => a == b && (of_a == of_b || keeps_old_value),
            (Request::Loopback { data: a }, Request::Loopback { data: b }) => a == b,
            (
                Request::WriteMultiple {
                    address: a,
                    values: of_a,
                },
                Request::WriteMultiple {
                    address: b,
                    values: of_b,
                },
            ) => a == b && of_a.len() == of_b.len(),
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::address::{Address, DataTable};
    use crate::line::quiet::{QUIET_EXCHANGES, QUIET_LEAST};
    use crate::profile::model::{Confidence, Fact};
    use crate::vendors;

    const LATENESS: Duration = Duration::from_millis(500);
    const DEAF: Duration = Duration::from_secs(2);

    fn station_with(refused: RefusedWrite, deaf_after_power_up: Duration) -> StationState {
        let mut model = Model::clone(
            vendors::catalog()
                .find("hyundai-n700")
                .expect("it is built in"),
        );
        model.write.refused.value = refused;
        let fact = Fact {
            value: deaf_after_power_up,
            confidence: Confidence::Manual,
            source: String::new(),
        };
        model.quirks.deaf_after_power_up = Some(fact);
        StationState::new(&model)
    }

    fn miss(station: &mut StationState, request: Request, now: MonoTime, lateness: Duration) {
        station.reply_missing(
            MissingReply {
                request,
                sent_at: now,
                until: now + lateness,
            },
            now,
        );
    }

    fn station() -> StationState {
        station_with(RefusedWrite::KeepsOldValue, Duration::ZERO)
    }

    fn write(address: u16, value: u16) -> Request {
        Request::WriteSingle {
            address: address.into(),
            value,
        }
    }

    fn read(address: u16, count: u16) -> Request {
        Request::Read {
            address: address.into(),
            count,
        }
    }

    #[test]
    fn only_what_cannot_be_mistaken_may_go_to_a_dirty_station() {
        let mut station = station();
        let now = MonoTime::from_millis(1000);
        miss(&mut station, read(0x0101, 1), now, LATENESS);
        assert_eq!(
            station.unmistakable_at(&read(0x0201, 1)),
            now + LATENESS,
            "same count, other address"
        );
        assert_eq!(
            station.unmistakable_at(&read(0x0101, 2)),
            MonoTime::ZERO,
            "another count"
        );
        assert_eq!(
            station.unmistakable_at(&write(2, 0)),
            MonoTime::ZERO,
            "another function"
        );
        miss(&mut station, write(2, 0), now, LATENESS);
        assert_eq!(
            station.unmistakable_at(&write(2, 1)),
            now + LATENESS,
            "a kept old value looks the same"
        );
        assert_eq!(station.unmistakable_at(&write(4, 1)), MonoTime::ZERO);
        assert!(station.misses_function(6, now) && !station.misses_function(8, now));
        assert!(!station.is_dirty(now + LATENESS));
    }

    #[test]
    fn reads_of_bits_are_distinguished_by_their_bytes_and_words_by_their_function() {
        let now = MonoTime::from_millis(1000);
        let from = |table, count| Request::Read {
            address: Address::new(table, 6),
            count,
        };
        let waits_for = |missing: Request, request: Request| {
            let mut station = station_with(RefusedWrite::Exception, Duration::ZERO);
            miss(&mut station, missing, now, LATENESS);
            station.unmistakable_at(&request) == now + LATENESS
        };
        assert!(
            waits_for(from(DataTable::Coil, 1), from(DataTable::Coil, 8)),
            "one byte each"
        );
        assert!(
            !waits_for(from(DataTable::Coil, 8), from(DataTable::Coil, 9)),
            "two bytes"
        );
        assert!(
            !waits_for(from(DataTable::Coil, 1), from(DataTable::Discrete, 1)),
            "another function"
        );
        assert!(
            !waits_for(from(DataTable::Holding, 1), from(DataTable::Input, 1)),
            "another function"
        );
        assert!(waits_for(
            from(DataTable::Input, 2),
            from(DataTable::Input, 2)
        ));
        let coil = |number, value| Request::WriteSingle {
            address: Address::new(DataTable::Coil, number),
            value,
        };
        assert!(
            waits_for(coil(1, 1), coil(1, 1)),
            "an earlier stop looks the same"
        );
        assert!(!waits_for(coil(1, 1), coil(1, 0)));
        assert!(!waits_for(coil(1, 1), write(1, 1)), "another function");
        let word = |value| Request::WriteMultiple {
            address: 2_u16.into(),
            values: vec![value],
        };
        assert!(
            waits_for(word(1), word(0)),
            "the reply to 10 hex carries no value"
        );
    }

    #[test]
    fn where_replies_are_numbered_none_makes_a_station_dirty() {
        let mut station = station().identified(true);
        let at = MonoTime::from_millis;
        station.asked_before(at(60_000));
        for count in 1..=100 {
            miss(&mut station, read(1, count), at(1_000), LATENESS);
            assert_eq!(
                station.stray(&[3, 2, 0, 7], at(1_100), LATENESS, false),
                StrayFrame::Explained
            );
        }
        station.exchange_ended(&read(1, 1), true, at(1_200));
        assert_eq!(
            (station.clean_at(), station.unmistakable_at(&read(1, 1))),
            (MonoTime::ZERO, MonoTime::ZERO)
        );
        assert!(!station.misses_function(3, at(1_200)) && !station.is_doubtful());
        assert_eq!(station.missing.len(), MISSING_MAX);
    }

    #[test]
    fn an_answer_that_cannot_be_mistaken_proves_that_none_follows() {
        let mut station = station();
        miss(&mut station, read(1, 1), MonoTime::ZERO, LATENESS);
        station.answered();
        assert_eq!(station.unmistakable_at(&read(1, 1)), MonoTime::ZERO);
    }

    /// The PDU of a reply with one word.
    const ONE_WORD: [u8; 4] = [3, 2, 0, 7];

    #[test]
    fn a_frame_that_nothing_explains_makes_a_station_dirty_until_it_was_silent() {
        let mut station = station();
        let at = MonoTime::from_millis;
        station.asked(at(1_000));
        station.exchange_ended(&read(1, 1), false, at(1_010));
        let late = Duration::from_millis(80);
        assert_eq!(
            station.stray(&ONE_WORD, at(1_080), LATENESS, false),
            StrayFrame::TooMany(late)
        );
        assert!(station.is_doubtful());
        assert_eq!(
            station.unmistakable_at(&read(1, 9)),
            at(1_080) + late * 3 / 2,
            "not even a barrier"
        );
        assert!(station.misses_function(6, at(1_100)));
        // Each further frame of it, an answer too, restarts the silence.
        station.heard(at(1_100));
        assert_eq!(station.clean_at(), at(1_100) + late * 3 / 2);
        for n in 0..QUIET_EXCHANGES {
            assert!(station.is_doubtful(), "{n}");
            station.exchange_ended(&read(1, 1), false, at(2_000));
        }
        assert!(!station.is_doubtful());
    }

    #[test]
    fn a_missing_reply_explains_a_frame_and_one_that_comes_too_late_is_learned() {
        let at = MonoTime::from_millis;
        let mut station = station();
        miss(&mut station, read(1, 1), at(1_000), LATENESS);
        assert_eq!(
            station.stray(&ONE_WORD, at(1_400), LATENESS, false),
            StrayFrame::Explained
        );
        assert!(!station.is_doubtful());
        let late = Duration::from_millis(900);
        assert_eq!(
            station.stray(&ONE_WORD, at(1_900), LATENESS, false),
            StrayFrame::BeyondLimit(late)
        );
        assert_eq!(station.lateness(LATENESS), late * 3 / 2);
        station.line_opened(at(3_000));
        assert_eq!(
            (station.lateness(LATENESS), station.is_doubtful()),
            (LATENESS, false)
        );
        // Mistaken for an answer, it is detected by the reply that follows it.
        let mut station = station_with(RefusedWrite::Exception, Duration::ZERO);
        miss(&mut station, read(1, 1), at(1_000), LATENESS);
        miss(&mut station, read(1, 2), at(1_800), LATENESS);
        station.asked(at(1_850));
        station.exchange_ended(&read(2, 1), false, at(1_900));
        assert_eq!(
            station.stray(&ONE_WORD, at(1_950), LATENESS, false),
            StrayFrame::BeyondLimit(late)
        );
    }

    #[test]
    fn after_noise_and_an_answer_a_silence_shows_whether_more_follows() {
        let mut station = station();
        let now = MonoTime::from_millis(5);
        for _ in 0..LOOKS.0 {
            station.exchange_ended(&read(1, 1), true, now);
            assert_eq!(
                (station.clean_at(), station.is_doubtful()),
                (now + QUIET_LEAST, false)
            );
        }
        let later = MonoTime::from_millis(5_000);
        station.exchange_ended(&read(1, 1), true, later);
        assert!(
            !station.is_dirty(later),
            "where there is always noise, it tells nothing"
        );
        (0..=LOOKS.1).for_each(|_| station.exchange_ended(&read(1, 1), false, later));
        station.exchange_ended(&read(1, 1), true, later);
        assert!(station.is_dirty(later));
    }

    #[test]
    fn what_is_missing_is_bounded() {
        let mut station = station();
        for count in 1..=MISSING_MAX as u16 {
            miss(
                &mut station,
                read(1, count),
                MonoTime::from_millis(u64::from(count)),
                LATENESS,
            );
        }
        let first_gone = MonoTime::from_millis(1) + LATENESS;
        assert_eq!(station.unmistakable_at(&read(1, 100)), first_gone);
        miss(&mut station, read(1, 100), first_gone, LATENESS);
        assert_eq!(station.missing.len(), MISSING_MAX);
    }

    #[test]
    fn a_dead_station_is_asked_less_and_less() {
        let mut station = station();
        let now = MonoTime::from_millis(10);
        station.silent(now);
        assert_eq!(
            station.ask_again_at(),
            MonoTime::ZERO,
            "one silence is no death"
        );
        let mut waits = Vec::new();
        for _ in 0..7 {
            station.silent(now);
            waits.push(station.ask_again_at().since(now).as_secs());
        }
        assert_eq!(waits, [1, 2, 4, 8, 16, 30, 30]);
        station.is_there();
        assert!(!station.is_known_silent());
        assert_eq!(station.ask_again_at(), MonoTime::ZERO);
    }
    #[test]
    fn where_refusals_are_exceptions_the_value_tells_writes_apart() {
        for (refused, another_value_is_free) in [
            (RefusedWrite::Exception, true),
            (RefusedWrite::KeepsOldValue, false),
        ] {
            let mut station = station_with(refused, Duration::ZERO);
            let now = MonoTime::from_millis(1000);
            miss(&mut station, write(2, 1), now, LATENESS);
            assert_eq!(
                station.unmistakable_at(&write(2, 1)),
                now + LATENESS,
                "{refused:?}"
            );
            assert_eq!(
                station.unmistakable_at(&write(2, 0)) <= now,
                another_value_is_free,
                "{refused:?}"
            );
            assert!(
                station.misses_function(6, now),
                "an exception is in doubt all the same"
            );
        }
    }

    #[test]
    fn a_refused_function_can_be_mistaken_for_whatever_has_that_function() {
        let unserved = |function, data| Request::Unserved { function, data };
        let now = MonoTime::from_millis(1000);
        for (missing, request, mistakable) in [
            (read(1, 1), unserved(8, 1), false),
            (unserved(8, 1), read(1, 1), false),
            (unserved(8, 1), unserved(8, 2), true),
            (unserved(8, 1), unserved(0x11, 1), false),
            (Request::Loopback { data: 1 }, unserved(8, 2), true),
            (unserved(8, 1), Request::Loopback { data: 2 }, true),
            (
                Request::Loopback { data: 1 },
                Request::Loopback { data: 2 },
                false,
            ),
            (
                Request::Loopback { data: 1 },
                Request::Loopback { data: 1 },
                true,
            ),
        ] {
            let mut station = station();
            miss(&mut station, missing.clone(), now, LATENESS);
            assert_eq!(
                station.unmistakable_at(&request) > now,
                mistakable,
                "{missing:?} then {request:?}"
            );
        }
    }

    #[test]
    fn a_station_that_may_be_deaf_is_asked_again_soon_and_stays_dirty() {
        let mut station = station_with(RefusedWrite::Exception, DEAF);
        let lost = MonoTime::from_millis(10_000);
        station.line_opened(MonoTime::from_millis(1));
        let silent = |station: &mut StationState, at: MonoTime| {
            miss(station, read(1, 1), at, LATENESS);
            station.silent(at);
            station.ask_again_at().since(at)
        };
        assert_eq!(silent(&mut station, lost), Duration::ZERO);
        for at in [300, 700, 1999] {
            assert_eq!(
                silent(&mut station, lost + Duration::from_millis(at)),
                DEAF_WAIT
            );
        }
        assert!(station.is_known_silent() && station.is_dirty(lost + DEAF));
        let waits = [2300, 3300, 5300]
            .map(|at| silent(&mut station, lost + Duration::from_millis(at)).as_secs());
        assert_eq!(waits, [1, 2, 4], "after that it is as dead as any other");
    }

    #[test]
    fn a_line_that_opens_ends_the_back_off_of_a_drive_that_may_have_been_switched_on() {
        for (deaf, wait) in [(DEAF, DEAF_WAIT), (Duration::ZERO, BACK_OFF_FIRST)] {
            let mut station = station_with(RefusedWrite::Exception, deaf);
            let now = MonoTime::from_millis(20_000);
            for at in [0, 10_000, 20_000] {
                station.silent(MonoTime::from_millis(at));
            }
            station.line_opened(now);
            assert!(station.ask_again_at().since(now) >= wait, "{deaf:?}");
            assert_eq!(
                station.ask_again_at().since(now) == DEAF_WAIT,
                !deaf.is_zero()
            );
        }
    }

    #[test]
    fn a_station_that_rests_is_not_asked_until_then() {
        let mut station = station();
        let moment = MonoTime::from_millis(2000);
        station.rest_until(moment);
        station.rest_until(MonoTime::from_millis(1000));
        station.is_there();
        assert_eq!(
            station.may_be_asked_from(),
            moment,
            "whatever was heard meanwhile"
        );
        assert_eq!(
            station.ask_again_at(),
            MonoTime::ZERO,
            "it is not taken for silent"
        );
    }

    #[test]
    fn a_late_frame_belongs_to_the_one_request_that_it_answers() {
        let mut station = station();
        let first = MonoTime::from_millis(100);
        let second = MonoTime::from_millis(200);
        miss(&mut station, read(1, 1), first, LATENESS);
        assert_eq!(
            station.answered_late(&[3, 2, 0, 7], second),
            Some((&read(1, 1), first))
        );
        assert_eq!(
            station.answered_late(&[0x83, 2], second),
            Some((&read(1, 1), first))
        );
        for other in [&[3, 4, 0, 7, 0, 8][..], &[6, 0, 1, 0, 1], &[0x86, 2]] {
            assert_eq!(station.answered_late(other, second), None, "{other:?}");
        }
        assert_eq!(
            station.answered_late(&[3, 2, 0, 7], first + LATENESS),
            None,
            "it cannot come any more"
        );
        miss(&mut station, read(9, 1), second, LATENESS);
        assert_eq!(
            station.answered_late(&[3, 2, 0, 7], second),
            None,
            "it may be either's"
        );
    }
}
