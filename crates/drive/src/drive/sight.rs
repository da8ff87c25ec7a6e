//! What was last seen of a drive that is out of sight, and whether its motor may still run: what was not seen to stand
//! may.

use super::view::RunState;
use crate::domain::frequency::Hertz;
use crate::domain::time::{MonoTime, WallTime};

/// When something was seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeenAt {
    /// By this process.
    Here(MonoTime),
    /// By an earlier one.
    Before(WallTime),
}

/// What the last readings of a drive showed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LastSeen {
    /// The run state.
    pub run_state: RunState,
    /// The output frequency, if it was read.
    pub output: Option<Hertz>,
    /// When.
    pub at: SeenAt,
}

/// A drive that is out of sight, as it is shown; the default for one that is in sight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SightView {
    /// What was last seen of it.
    pub last_seen: Option<LastSeen>,
    /// Its motor was not seen at standstill since it last ran or was ordered to.
    pub may_still_run: bool,
}

/// Whether a drive is in sight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DriveSight {
    is_away: bool,
    last_seen: Option<LastSeen>,
    may_still_run: bool,
    /// Whether it was reported that the drive may still run.
    is_reported: bool,
    /// A person has confirmed since then that the motor stands.
    is_confirmed: bool,
}

impl DriveSight {
    /// The drive is out of sight; its last readings showed `last_seen`, or there were none. `may_run`: it was not seen at
    /// standstill, or was ordered to run since. What a person has confirmed holds until it is seen again. Returns whether to
    /// report that it may still run.
    pub const fn lost(&mut self, last_seen: Option<LastSeen>, may_run: bool) -> bool {
        if !self.is_away {
            self.is_away = true;
            self.last_seen = last_seen;
        }
        self.may_still_run |= may_run && !self.is_confirmed;
        let is_news = self.may_still_run && !self.is_reported;
        self.is_reported |= is_news;
        is_news
    }

    /// The drive is ordered to run. Out of sight it may do so, whatever a person confirmed before. Returns whether that is to be
    /// reported.
    pub const fn ordered(&mut self) -> bool {
        if !self.is_away {
            return false;
        }
        let is_news = !self.may_still_run || !self.is_reported;
        (self.may_still_run, self.is_reported, self.is_confirmed) = (true, true, false);
        is_news
    }

    /// The drive was not in sight of an earlier process, and may still run.
    pub const fn remember(&mut self, last_seen: Option<LastSeen>) {
        (self.is_away, self.last_seen, self.may_still_run) = (true, last_seen, true);
    }

    /// A reading shows what the drive does. Returns whether it was reported that it may still run.
    pub fn seen(&mut self) -> bool {
        std::mem::take(self).is_reported
    }

    /// A person confirms that the motor stands. Returns whether it was thought to run.
    pub const fn confirmed(&mut self) -> bool {
        self.is_confirmed |= self.may_still_run;
        std::mem::replace(&mut self.may_still_run, false)
    }

    /// Whether it was seen at standstill before it went out of sight, and ordered nothing since. What a person confirms takes
    /// the place of no reading.
    #[must_use]
    pub const fn stood_last(&self) -> bool {
        self.is_away && !self.may_still_run && !self.is_confirmed
    }

    /// What is shown while the drive is out of sight.
    #[must_use]
    pub const fn view(&self) -> SightView {
        SightView {
            last_seen: self.last_seen,
            may_still_run: self.may_still_run,
        }
    }

    /// What was last seen of it.
    #[must_use]
    pub const fn last_seen(&self) -> Option<LastSeen> {
        self.last_seen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RUNS: LastSeen = LastSeen {
        run_state: RunState::Forward,
        output: None,
        at: SeenAt::Here(MonoTime::from_millis(5)),
    };

    #[test]
    fn what_was_not_seen_to_stand_may_run_until_it_is_seen_or_a_person_says_otherwise() {
        let mut sight = DriveSight::default();
        assert!(sight.lost(Some(RUNS), true));
        assert!(!sight.lost(None, false), "reported once");
        assert_eq!(
            sight.view(),
            SightView {
                last_seen: Some(RUNS),
                may_still_run: true
            }
        );
        assert!(sight.confirmed() && !sight.confirmed());
        assert!(!sight.stood_last(), "a declared action still falls due");
        assert!(
            !sight.lost(None, true),
            "nothing is known that the person did not see"
        );
        assert_eq!(
            sight.view(),
            SightView {
                last_seen: Some(RUNS),
                may_still_run: false
            }
        );
        assert!(
            sight.seen(),
            "it was reported, so that it is over is reported as well"
        );
        assert_eq!(sight.view(), SightView::default());
    }

    #[test]
    fn a_drive_that_stood_does_not_run_unless_it_is_ordered_to() {
        let mut sight = DriveSight::default();
        assert!(!sight.lost(Some(RUNS), false));
        assert!(!sight.view().may_still_run && sight.stood_last());
        assert!(!sight.confirmed(), "there is nothing to confirm");
        assert!(sight.lost(None, true), "an order was on its way");
        assert_eq!(sight.view().last_seen, Some(RUNS), "nothing newer was seen");
    }

    #[test]
    fn what_an_earlier_process_left_is_told_when_the_drive_is_not_found() {
        let mut sight = DriveSight::default();
        sight.remember(None);
        assert!(sight.lost(None, false));
        let mut sight = DriveSight::default();
        sight.remember(Some(RUNS));
        assert!(!sight.seen(), "it was found before anything was reported");
    }
}
