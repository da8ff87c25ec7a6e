//! Trips: their count, and the records of the last ones.

/// Number of kept records: the newest and the fifteen before it.
pub const RECORDS: usize = 16;

/// One trip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SimTripRecord {
    /// The drive's number for the cause.
    pub cause: u16,
    /// Output frequency at the trip in microhertz, negative in reverse.
    pub frequency: i64,
    /// Output current at the trip in microampere.
    pub current: i64,
    /// DC link voltage at the trip in microvolt.
    pub dc_link: i64,
}

/// The trips of one drive. All records are zero in a new drive.
#[derive(Clone, Debug, Default)]
pub struct TripLog {
    count: u16,
    records: [SimTripRecord; RECORDS],
}

impl TripLog {
    /// Number of trips so far; after 65,535 it starts again at 0.
    #[must_use]
    pub const fn count(&self) -> u16 {
        self.count
    }

    /// Makes `record` the newest; the oldest one is forgotten.
    pub fn push(&mut self, record: SimTripRecord) {
        self.count = self.count.wrapping_add(1);
        self.records.rotate_right(1);
        self.records[0] = record;
    }

    /// The newest record.
    #[must_use]
    pub const fn newest(&self) -> SimTripRecord {
        self.records[0]
    }

    /// The record of the trip `back` trips before the newest one; `None` beyond the last.
    #[must_use]
    pub fn record(&self, back: usize) -> Option<SimTripRecord> {
        self.records.get(back).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_record_pushes_the_others_back() {
        let mut log = TripLog::default();
        for cause in 1..=18 {
            log.push(SimTripRecord {
                cause,
                frequency: 60_000_000,
                current: 5_500_000,
                dc_link: 540_000_000,
            });
        }
        assert_eq!((log.count(), log.newest().cause), (18, 18));
        assert_eq!(
            (log.record(1).unwrap().cause, log.record(15).unwrap().cause),
            (17, 3)
        );
        assert_eq!(log.record(16), None);
    }
}
