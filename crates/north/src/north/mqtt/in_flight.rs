//! Messages sent to the broker in order, each until the broker has acknowledged or refused it.

use crate::domain::time::MonoTime;
use crate::north::broker::PublicationRefusal;
use std::collections::VecDeque;
use std::time::Duration;

/// Most that the broker has not acknowledged on this connection.
pub(super) const IN_FLIGHT_MAX: usize = 16;
/// How often a message is offered that the broker fails to accept; with the waits in between, that is about four
/// minutes.
const FAILURES_MAX: u8 = 10;
/// The wait after a refusal, which doubles with each.
const WAIT_FIRST: Duration = Duration::from_secs(1);
const WAIT_MAX: Duration = Duration::from_secs(60);

/// Numbered messages that are not acknowledged, oldest first. Bounded by its owner.
///
/// What the broker refuses for now is sent again after a growing wait, alone and before all that was not sent yet. What
/// it will never accept is given up, so that it does not block the rest for ever.
#[derive(Debug)]
pub(super) struct InFlight<T> {
    entries: VecDeque<InFlightMessage<T>>,
    in_flight: usize,
    /// Until when nothing is sent, and from when on one at a time; `None`: the broker accepts what it gets.
    trial_from: Option<MonoTime>,
    /// The one in flight is a trial.
    is_trial: bool,
    /// Consecutive waits.
    waits: u32,
}

#[derive(Debug)]
struct InFlightMessage<T> {
    number: u64,
    it: T,
    is_sent: bool,
    failures: u8,
}

impl<T> Default for InFlight<T> {
    fn default() -> Self {
        Self {
            entries: VecDeque::new(),
            in_flight: 0,
            trial_from: None,
            is_trial: false,
            waits: 0,
        }
    }
}

impl<T> InFlight<T> {
    /// Adds something under a number that is higher than all before it.
    pub(super) fn push(&mut self, number: u64, it: T) {
        self.entries.push_back(InFlightMessage {
            number,
            it,
            is_sent: false,
            failures: 0,
        });
    }

    /// The next one to be sent on this connection.
    pub(super) fn next(&mut self, at: MonoTime) -> Option<(u64, &T)> {
        self.next_of(at, |_| true)
    }

    /// The next one to be sent on this connection, among those that `may` be sent.
    pub(super) fn next_of(&mut self, at: MonoTime, may: impl Fn(&T) -> bool) -> Option<(u64, &T)> {
        let may_go = self
            .trial_from
            .is_none_or(|from| at >= from && self.in_flight == 0);
        if !may_go || self.in_flight >= IN_FLIGHT_MAX {
            return None;
        }
        let entry = self
            .entries
            .iter_mut()
            .find(|entry| !entry.is_sent && may(&entry.it))?;
        entry.is_sent = true;
        self.in_flight += 1;
        self.is_trial = self.trial_from.is_some();
        Some((entry.number, &entry.it))
    }

    /// When [`next`](Self::next) returns something, as far as that depends on time.
    pub(super) fn wake(&self) -> Option<MonoTime> {
        let has_next = self.in_flight < self.entries.len().min(IN_FLIGHT_MAX);
        match self.trial_from {
            None => has_next.then_some(MonoTime::ZERO),
            Some(from) => (has_next && self.in_flight == 0).then_some(from),
        }
    }

    /// When something that was refused and `may` be sent is sent again.
    pub(super) fn again_at_of(&self, may: impl Fn(&T) -> bool) -> Option<MonoTime> {
        let again_at = self.trial_from.and(self.wake())?;
        let has_one = self
            .entries
            .iter()
            .any(|entry| !entry.is_sent && may(&entry.it));
        has_one.then_some(again_at)
    }

    /// The broker acknowledged the one with this number. False if that is not in flight.
    pub(super) fn acknowledged(&mut self, number: u64) -> bool {
        let is_done = self.take(number).is_some();
        // What was in flight before the refusal proves nothing.
        if is_done && self.is_trial {
            self.end_of_trials();
        }
        is_done
    }

    /// The broker refuses the one with this number. Returns it if it is given up.
    pub(super) fn refused(
        &mut self,
        at: MonoTime,
        number: u64,
        refusal: PublicationRefusal,
    ) -> Option<T> {
        let place = self.place(number)?;
        let entry = self.entries.get_mut(place)?;
        entry.failures += u8::from(refusal == PublicationRefusal::Failed);
        if refusal == PublicationRefusal::Never || entry.failures >= FAILURES_MAX {
            return self.take(number);
        }
        entry.is_sent = false;
        self.in_flight -= 1;
        // Those that were in flight together are refused together: that is one wait.
        if self.trial_from.is_none_or(|from| at >= from) {
            self.trial_from = Some(at + WAIT_MAX.min(WAIT_FIRST * 2_u32.pow(self.waits.min(16))));
            self.is_trial = false;
            self.waits = self.waits.saturating_add(1);
        }
        None
    }

    const fn end_of_trials(&mut self) {
        self.trial_from = None;
        self.is_trial = false;
        self.waits = 0;
    }

    fn take(&mut self, number: u64) -> Option<T> {
        let place = self.place(number)?;
        self.in_flight -= 1;
        self.entries.remove(place).map(|entry| entry.it)
    }

    /// The index of the one with this number, if it is in flight.
    fn place(&self, number: u64) -> Option<usize> {
        let place = self
            .entries
            .binary_search_by_key(&number, |entry| entry.number)
            .ok()?;
        self.entries
            .get(place)
            .is_some_and(|entry| entry.is_sent)
            .then_some(place)
    }

    /// The connection is lost: what was in flight is sent again.
    pub(super) fn lost(&mut self) {
        for entry in &mut self.entries {
            if self.in_flight == 0 {
                break;
            }
            self.in_flight -= usize::from(std::mem::take(&mut entry.is_sent));
        }
        self.end_of_trials();
    }

    /// Removes the oldest that is not in flight, and passes the one after it to the caller.
    pub(super) fn drop_oldest(&mut self) -> Option<(T, Option<&mut T>)> {
        let place = self.entries.iter().position(|entry| !entry.is_sent)?;
        let dropped = self.entries.remove(place)?.it;
        Some((
            dropped,
            self.entries.get_mut(place).map(|entry| &mut entry.it),
        ))
    }

    /// Removes the oldest that is not in flight and that `is` one that is not to be sent any more.
    pub(super) fn drop_waiting(&mut self, mut is: impl FnMut(&T) -> bool) -> Option<u64> {
        let place = self
            .entries
            .iter()
            .position(|entry| !entry.is_sent && is(&entry.it))?;
        self.entries.remove(place).map(|entry| entry.number)
    }

    /// How many are not acknowledged.
    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);
    const START: MonoTime = MonoTime::ZERO;

    fn queue(count: u64) -> InFlight<()> {
        let mut queue = InFlight::default();
        (1..=count).for_each(|number| queue.push(number, ()));
        queue
    }

    fn sent(queue: &mut InFlight<()>, at: MonoTime) -> Vec<u64> {
        std::iter::from_fn(|| queue.next(at).map(|(number, ())| number)).collect()
    }

    #[test]
    fn all_go_in_order_again_until_each_is_acknowledged() {
        let mut queue = queue(20);
        assert_eq!(queue.wake(), Some(START));
        assert_eq!(sent(&mut queue, START), (1..=16).collect::<Vec<_>>());
        assert_eq!(queue.wake(), None);
        assert_eq!(
            [1, 3, 99, 17].map(|number| queue.acknowledged(number)),
            [true, true, false, false]
        );
        assert_eq!(sent(&mut queue, START), [17, 18]);
        queue.lost();
        assert!(
            !queue.acknowledged(2),
            "an acknowledgement of the connection before counts for nothing"
        );
        let again: Vec<_> = [2].into_iter().chain(4..=18).collect();
        assert_eq!(sent(&mut queue, START), again);
        assert_eq!(queue.len(), 18);
    }

    #[test]
    fn what_is_refused_for_now_goes_first_again_and_alone_until_one_is_taken() {
        let mut queue = queue(20);
        sent(&mut queue, START);
        for number in [2, 5] {
            assert_eq!(queue.refused(START, number, PublicationRefusal::Full), None);
        }
        (1..=16)
            .filter(|number| ![2, 5].contains(number))
            .for_each(|number| assert!(queue.acknowledged(number)));
        assert_eq!(
            queue.again_at_of(|()| true),
            Some(START + SECOND),
            "together they are one refusal"
        );
        for wait in [2, 4, 8, 16] {
            let from = queue.again_at_of(|()| true).unwrap();
            assert_eq!(
                sent(&mut queue, from.before(Duration::from_millis(1))),
                [0_u64; 0],
                "what was in flight proves nothing"
            );
            assert_eq!(sent(&mut queue, from), [2], "one, to try");
            assert_eq!(
                queue.again_at_of(|()| true),
                None,
                "its answer is waited for"
            );
            assert_eq!(queue.refused(from, 2, PublicationRefusal::Full), None);
            assert_eq!(queue.again_at_of(|()| true), Some(from + SECOND * wait));
        }
        let mut from = queue.again_at_of(|()| true).unwrap();
        for _ in 0..100 {
            assert_eq!(sent(&mut queue, from), [2]);
            assert_eq!(
                queue.refused(from, 2, PublicationRefusal::Full),
                None,
                "a broker that is full is waited for without an end"
            );
            let next = queue.again_at_of(|()| true).unwrap();
            assert!(next.since(from) <= WAIT_MAX);
            from = next;
        }
        assert_eq!(sent(&mut queue, from), [2]);
        assert!(queue.acknowledged(2));
        assert_eq!(sent(&mut queue, from), [5, 17, 18, 19, 20]);
    }

    #[test]
    fn what_can_never_be_taken_is_given_up_and_the_rest_goes_on() {
        let mut queue = queue(40);
        for number in sent(&mut queue, START) {
            assert_eq!(
                queue.refused(START, number, PublicationRefusal::Never),
                Some(())
            );
        }
        assert_eq!(sent(&mut queue, START), (17..=32).collect::<Vec<_>>());
        assert_eq!(
            queue.refused(START, 1, PublicationRefusal::Never),
            None,
            "it is gone"
        );
        assert_eq!(queue.len(), 24);
    }

    #[test]
    fn what_a_broker_fails_to_take_is_given_up_in_the_end() {
        let mut queue = queue(2);
        let mut at = START;
        assert_eq!(sent(&mut queue, at), [1, 2]);
        assert!(
            queue.refused(at, 1, PublicationRefusal::Failed).is_none() && queue.acknowledged(2)
        );
        for _ in 2..FAILURES_MAX {
            at = queue.again_at_of(|()| true).unwrap();
            assert_eq!(sent(&mut queue, at), [1]);
            assert_eq!(queue.refused(at, 1, PublicationRefusal::Failed), None);
        }
        at = queue.again_at_of(|()| true).unwrap();
        assert_eq!(sent(&mut queue, at), [1]);
        assert_eq!(queue.refused(at, 1, PublicationRefusal::Failed), Some(()));
        assert!(
            at.since(START) > SECOND * 100 && at.since(START) < SECOND * 300,
            "{:?}",
            at.since(START)
        );
    }
}
