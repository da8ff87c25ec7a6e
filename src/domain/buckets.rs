//! Buckets that grow with the numbers in them, so that few of them tell small and large numbers apart equally well.

/// How numbers are sorted into buckets: each octave has as many of them.
#[derive(Clone, Copy, Debug)]
pub struct Buckets {
    sub_bits: u32,
    top_bits: u32,
}

impl Buckets {
    /// 2 to the power of `sub_bits` buckets for each octave, which is how much wider than its numbers a bucket is at most,
    /// for numbers of `top_bits` bits.
    #[must_use]
    pub const fn new(sub_bits: u32, top_bits: u32) -> Self {
        Self { sub_bits, top_bits }
    }

    /// How many there are.
    #[must_use]
    pub const fn count(self) -> usize {
        ((self.top_bits - self.sub_bits + 1) << self.sub_bits) as usize
    }

    /// The largest number that has a bucket.
    #[must_use]
    pub const fn number_max(self) -> u64 {
        (1 << self.top_bits) - 1
    }

    /// The bucket of a number.
    #[must_use]
    pub const fn place(self, number: u64) -> usize {
        let octave = u64::BITS - (number >> self.sub_bits).leading_zeros();
        let sub = (number >> octave.saturating_sub(1)) & ((1 << self.sub_bits) - 1);
        (((octave as u64) << self.sub_bits) | sub) as usize
    }

    /// The largest number in the bucket at `place`.
    #[must_use]
    pub const fn upper_end(self, place: usize) -> u64 {
        let (octave, sub) = (place as u64 >> self.sub_bits, place as u64 & ((1 << self.sub_bits) - 1));
        match octave.checked_sub(1) {
            None => sub,
            Some(shift) => (((1 << self.sub_bits) + sub + 1) << shift) - 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_follow_each_other_without_hole_and_hold_their_ends() {
        for (sub_bits, top_bits) in [(4, 27), (5, 36)] {
            let buckets = Buckets::new(sub_bits, top_bits);
            assert_eq!(buckets.place(buckets.number_max()), buckets.count() - 1);
            for at in 0..buckets.count() {
                let end = buckets.upper_end(at);
                assert_eq!((buckets.place(end), buckets.place(end + 1)), (at, at + 1), "{at}");
            }
            for number in (1..buckets.number_max()).step_by(buckets.number_max() as usize / 20_000) {
                let end = buckets.upper_end(buckets.place(number));
                assert!(number <= end && end - number <= number >> sub_bits, "{number}");
            }
        }
    }
}
