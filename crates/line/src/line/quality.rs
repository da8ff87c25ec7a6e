//! The quality of a line: the last exchanges, good or bad, and whether motion may still be ordered over it.

/// Number of exchanges that are remembered.
pub const WINDOW: u32 = 100;
/// Minimum number of exchanges for a judgement: two bad ones at the start do not make a bad line.
pub const LEAST: u32 = 20;
/// Above this percentage of bad exchanges, run orders and higher setpoints are refused.
pub const SUSPEND_ABOVE_PER_CENT: u32 = 10;
/// Below this percentage they are accepted again.
pub const RESUME_BELOW_PER_CENT: u32 = 3;

/// The last exchanges of one line or station.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExchangeQuality {
    /// One bit each, the newest lowest; set: it was bad.
    bad: u128,
    count: u32,
    is_suspended: bool,
}

impl ExchangeQuality {
    /// Records an exchange.
    pub fn take(&mut self, is_bad: bool) {
        self.bad = (self.bad << 1 | u128::from(is_bad)) & ((1 << WINDOW) - 1);
        self.count = (self.count + 1).min(WINDOW);
        let bad = self.bad.count_ones() * 100;
        if bad > SUSPEND_ABOVE_PER_CENT * self.count && self.count >= LEAST {
            self.is_suspended = true;
        } else if bad < RESUME_BELOW_PER_CENT * self.count {
            self.is_suspended = false;
        }
    }

    /// Per cent of bad exchanges among the last hundred; `None` while there are too few.
    #[must_use]
    pub fn bad_per_cent(&self) -> Option<u8> {
        let per_cent = (self.bad.count_ones() * 100).div_ceil(self.count.max(1));
        (self.count >= LEAST).then_some(per_cent as u8)
    }

    /// Whether run orders and higher setpoints are refused.
    #[must_use]
    pub const fn is_suspended(&self) -> bool {
        self.is_suspended
    }
}

/// A line with its stations.
#[derive(Debug)]
pub struct QualityWatch {
    line: ExchangeQuality,
    stations: Vec<ExchangeQuality>,
}

impl QualityWatch {
    /// A line with `stations` stations and no exchanges yet.
    #[must_use]
    pub fn new(stations: usize) -> Self {
        Self {
            line: ExchangeQuality::default(),
            stations: vec![ExchangeQuality::default(); stations],
        }
    }

    /// Records an exchange with the station at `place`.
    pub fn take(&mut self, place: usize, is_bad: bool) {
        self.line.take(is_bad);
        if let Some(station) = self.stations.get_mut(place) {
            station.take(is_bad);
        }
    }

    /// All exchanges of the line.
    #[must_use]
    pub const fn line(&self) -> &ExchangeQuality {
        &self.line
    }

    /// All exchanges with the station at `place`; `None` if there is no such station.
    #[must_use]
    pub fn station(&self, place: usize) -> Option<&ExchangeQuality> {
        self.stations.get(place)
    }

    /// Whether motion is refused for all drives: the line is bad, and not because of one station alone.
    #[must_use]
    pub fn is_line_suspended(&self) -> bool {
        let bad = self
            .stations
            .iter()
            .filter(|station| station.is_suspended)
            .count();
        self.line.is_suspended && (bad != 1 || self.stations.len() == 1)
    }

    /// Whether motion is refused for the drive at `place`.
    #[must_use]
    pub fn is_suspended(&self, place: usize) -> bool {
        self.is_line_suspended()
            || self
                .stations
                .get(place)
                .is_some_and(ExchangeQuality::is_suspended)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(exchanges: impl IntoIterator<Item = bool>) -> ExchangeQuality {
        let mut quality = ExchangeQuality::default();
        exchanges
            .into_iter()
            .for_each(|is_bad| quality.take(is_bad));
        quality
    }

    #[test]
    fn more_than_ten_of_a_hundred_suspend_and_less_than_three_resume() {
        let hundred = |bad: usize| (0..100).map(move |n| n >= 100 - bad);
        for (bad, suspended) in [(10, false), (11, true)] {
            assert_eq!(after(hundred(bad)).is_suspended(), suspended, "{bad}");
        }
        let mut quality = after(hundred(11));
        let good = (1..).take_while(|_| {
            quality.take(false);
            quality.is_suspended()
        });
        // 89 good ones push out the good ones before; of the 11 bad ones all but 2 have to go.
        assert_eq!(good.count(), 89 + 9 - 1);
        assert_eq!(quality.bad_per_cent(), Some(2));
    }

    #[test]
    fn a_few_exchanges_tell_nothing() {
        assert!(!after([true; 19]).is_suspended());
        assert_eq!(after([true; 19]).bad_per_cent(), None);
        assert!(after([true; 20]).is_suspended());
        assert_eq!(after([true; 1000]).bad_per_cent(), Some(100));
    }

    #[test]
    fn one_bad_station_suspends_only_itself() {
        let mut line = QualityWatch::new(3);
        for n in 0..120 {
            line.take(n % 3, n % 3 == 1 && n % 2 == 0);
        }
        assert!(line.line().is_suspended());
        assert_eq!(
            [0, 1, 2].map(|place| line.is_suspended(place)),
            [false, true, false]
        );
        for n in 0..120 {
            line.take(n % 3, n % 3 < 2 && n % 2 == 0);
        }
        assert_eq!(
            [0, 1, 2].map(|place| line.is_suspended(place)),
            [true; 3],
            "two are bad: it is the line"
        );
        let mut alone = QualityWatch::new(1);
        (0..100).for_each(|n| alone.take(0, n % 2 == 0));
        assert!(alone.is_line_suspended() && alone.is_suspended(0));
    }
}
