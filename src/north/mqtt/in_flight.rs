//! What goes to the broker in order, each until the broker acknowledged it.

use std::collections::VecDeque;

/// Most that the broker has not acknowledged on this connection.
pub(super) const IN_FLIGHT_MAX: usize = 16;

/// Numbered things that are not acknowledged, oldest first. Those at the front are in flight. Its bound is its owner's.
#[derive(Debug)]
pub(super) struct InFlight<T> {
    entries: VecDeque<(u64, T)>,
    in_flight: usize,
}

impl<T> Default for InFlight<T> {
    fn default() -> Self {
        Self { entries: VecDeque::new(), in_flight: 0 }
    }
}

impl<T> InFlight<T> {
    /// Adds something under a number that is higher than all before it.
    pub(super) fn push(&mut self, number: u64, it: T) {
        self.entries.push_back((number, it));
    }

    /// The next to be sent on this connection.
    pub(super) fn next(&mut self) -> Option<(u64, &T)> {
        if self.in_flight >= IN_FLIGHT_MAX {
            return None;
        }
        let (number, it) = self.entries.get(self.in_flight)?;
        self.in_flight += 1;
        Some((*number, it))
    }

    /// Whether [`next`](Self::next) gives something.
    pub(super) fn has_next(&self) -> bool {
        self.in_flight < self.entries.len().min(IN_FLIGHT_MAX)
    }

    /// The broker has the one with this number. False if that is not in flight.
    pub(super) fn acknowledged(&mut self, number: u64) -> bool {
        let place = self.entries.iter().take(self.in_flight).position(|(it, _)| *it == number);
        let Some(place) = place else { return false };
        self.entries.remove(place);
        self.in_flight -= 1;
        true
    }

    /// The connection is gone: what was in flight goes again.
    pub(super) const fn lost(&mut self) {
        self.in_flight = 0;
    }

    /// Takes out the oldest that is not in flight, and shows the one behind it.
    pub(super) fn drop_oldest(&mut self) -> Option<(T, Option<&mut T>)> {
        let (_, dropped) = self.entries.remove(self.in_flight)?;
        Some((dropped, self.entries.get_mut(self.in_flight).map(|(_, it)| it)))
    }

    /// How many are not acknowledged.
    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(queue: &mut InFlight<()>) -> Vec<u64> {
        std::iter::from_fn(|| queue.next().map(|(number, ())| number)).collect()
    }

    #[test]
    fn all_go_in_order_again_until_each_is_acknowledged() {
        let mut queue = InFlight::default();
        (1..=20).for_each(|number| queue.push(number, ()));
        assert!(queue.has_next());
        assert_eq!(sent(&mut queue), (1..=16).collect::<Vec<_>>());
        assert!(!queue.has_next());
        assert_eq!([1, 3, 99, 17].map(|number| queue.acknowledged(number)), [true, true, false, false]);
        assert_eq!(sent(&mut queue), [17, 18]);
        queue.lost();
        assert!(!queue.acknowledged(2), "an acknowledgement of the connection before counts for nothing");
        let again: Vec<_> = [2].into_iter().chain(4..=18).collect();
        assert_eq!(sent(&mut queue), again);
        assert_eq!(queue.len(), 18);
    }
}
