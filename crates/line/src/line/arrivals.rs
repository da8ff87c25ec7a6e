//! When the bytes of a line were read, until they are classified.

use crate::domain::time::MonoTime;
use std::collections::VecDeque;

/// Reads of the port whose bytes are not classified yet, oldest first. There are never more reads than such bytes.
#[derive(Debug, Default)]
pub(super) struct PortArrivals {
    reads: VecDeque<(usize, MonoTime)>,
}

impl PortArrivals {
    /// Records that `bytes` bytes were read at `now`.
    pub fn read(&mut self, bytes: usize, now: MonoTime) {
        if bytes > 0 {
            self.reads.push_back((bytes, now));
        }
    }

    /// Removes the oldest `bytes` bytes; returns when the first and the last were read, `None` if there are none.
    pub fn take(&mut self, bytes: usize) -> Option<(MonoTime, MonoTime)> {
        let (_, first) = *self.reads.front()?;
        let mut left = bytes;
        let mut last = first;
        while left > 0
            && let Some((waiting, at)) = self.reads.front_mut()
        {
            last = *at;
            let taken = left.min(*waiting);
            left -= taken;
            *waiting -= taken;
            if *waiting == 0 {
                self.reads.pop_front();
            }
        }
        Some((first, last))
    }

    /// Discards all.
    pub fn clear(&mut self) {
        self.reads.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_have_the_moments_of_their_own_reads() {
        let ms = MonoTime::from_millis;
        let mut arrivals = PortArrivals::default();
        assert_eq!(arrivals.take(1), None);
        for (bytes, at) in [(3, 10), (0, 11), (4, 12), (2, 20)] {
            arrivals.read(bytes, ms(at));
        }
        assert_eq!(arrivals.take(2), Some((ms(10), ms(10))));
        assert_eq!(
            arrivals.take(5),
            Some((ms(10), ms(12))),
            "the rest of one read and the next"
        );
        assert_eq!(arrivals.take(1), Some((ms(20), ms(20))));
        arrivals.clear();
        assert_eq!(arrivals.take(1), None);
    }
}
