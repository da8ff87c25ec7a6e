//! Logarithmic buckets: few of them resolve small and large numbers equally well.

/// A division of numbers into buckets, with the same count of buckets in each octave.
#[derive(Clone, Copy, Debug)]
pub struct BucketDivision {
    sub_bits: u32,
    top_bits: u32,
}

impl BucketDivision {
    /// 2 to the power of `sub_bits` buckets for each octave, for numbers of `top_bits` bits. A bucket is at most
    /// 1 / 2^`sub_bits` as wide as its numbers.
    #[must_use]
    pub const fn new(sub_bits: u32, top_bits: u32) -> Self {
        Self { sub_bits, top_bits }
    }

    /// The number of buckets.
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
        let octave = place as u64 >> self.sub_bits;
        let sub = place as u64 & ((1 << self.sub_bits) - 1);
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
    fn buckets_are_contiguous_and_hold_their_ends() {
        for (sub_bits, top_bits) in [(4, 27), (5, 36)] {
            let buckets = BucketDivision::new(sub_bits, top_bits);
            assert_eq!(buckets.place(buckets.number_max()), buckets.count() - 1);
            for at in 0..buckets.count() {
                let end = buckets.upper_end(at);
                assert_eq!(
                    (buckets.place(end), buckets.place(end + 1)),
                    (at, at + 1),
                    "{at}"
                );
            }
            for number in (1..buckets.number_max()).step_by(buckets.number_max() as usize / 20_000)
            {
                let end = buckets.upper_end(buckets.place(number));
                assert!(
                    number <= end && end - number <= number >> sub_bits,
                    "{number}"
                );
            }
        }
    }
}
