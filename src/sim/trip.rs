//! Trips: how many there were, and the records of the last ones as a drive shows them in its registers.

/// Words of one record: cause, output frequency x100 in Hz, output current x10 in A, DC link voltage in V.
pub const RECORD_WORDS: u16 = 4;
/// Records that are kept: the newest and five before it.
pub const RECORDS: u16 = 6;

/// One trip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TripRecord {
    /// The drive's number for the cause.
    pub cause: u16,
    /// Output frequency at the trip, x100 in Hz.
    pub frequency_x100: u16,
    /// Output current at the trip, x10 in A.
    pub current_x10: u16,
    /// DC link voltage at the trip in V.
    pub dc_link_v: u16,
}

/// The trips of one drive. All records are zero in a new drive.
#[derive(Clone, Debug, Default)]
pub struct TripLog {
    count: u16,
    records: [TripRecord; RECORDS as usize],
}

impl TripLog {
    /// Number of trips so far; after 65,535 it starts again at 0.
    #[must_use]
    pub const fn count(&self) -> u16 {
        self.count
    }

    /// Makes `record` the newest; the oldest one is forgotten.
    pub fn push(&mut self, record: TripRecord) {
        self.count = self.count.wrapping_add(1);
        self.records.rotate_right(1);
        self.records[0] = record;
    }

    /// The word `offset` words behind the start of the newest record, newest record first; nothing behind the last.
    #[must_use]
    pub fn word(&self, offset: u16) -> Option<u16> {
        let record = self.records.get(usize::from(offset / RECORD_WORDS))?;
        Some(match offset % RECORD_WORDS {
            0 => record.cause,
            1 => record.frequency_x100,
            2 => record.current_x10,
            _ => record.dc_link_v,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_record_pushes_the_others_back() {
        let mut log = TripLog::default();
        for cause in 1..=7 {
            log.push(TripRecord { cause, frequency_x100: 6000, current_x10: 55, dc_link_v: 540 });
        }
        assert_eq!(log.count(), 7);
        let words: Vec<_> = (0..5).map(|offset| log.word(offset).unwrap()).collect();
        assert_eq!(words, [7, 6000, 55, 540, 6]);
        assert_eq!(log.word(20), Some(2));
        assert_eq!(log.word(24), None);
    }
}
