//! The drive's own communication watchdog, and whether its setting matches the configuration.

use crate::domain::address::Address;
use crate::profile::model::Model;
use std::sync::Arc;
use std::time::Duration;

/// How the drive's own watchdog is set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum WatchdogState {
    /// The watchdog has not been read yet, or the drive is offline.
    #[default]
    Unknown,
    /// The watchdog is off.
    Off,
    /// The watchdog is on, but the motor keeps running.
    KeepsRunning,
    /// The watchdog may stop the drive without a fault: its time is not more than twice the longest gap between two frames.
    TooShort,
    /// Its time is longer than allowed.
    TooLong,
    /// The watchdog is on, and its time is in range.
    InOrder,
}

impl WatchdogState {
    /// The word used in payloads.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Off => "off",
            Self::KeepsRunning => "keeps_running",
            Self::TooShort => "too_short",
            Self::TooLong => "too_long",
            Self::InOrder => "in_order",
        }
    }
}

/// The drive's own watchdog as it is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WatchdogView {
    /// How it is set.
    pub state: WatchdogState,
    /// Its time, if it is on.
    pub time: Option<Duration>,
    /// Whether the model's facts about it are proven.
    pub is_proven: bool,
}

impl WatchdogView {
    /// Whether it can be relied on to stop the motor in time.
    #[must_use]
    pub fn is_in_order(&self) -> bool {
        self.is_proven && self.state == WatchdogState::InOrder
    }
}

/// The range of acceptable watchdog times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WatchdogRange {
    /// Exclusive lower bound: twice the longest gap between two frames.
    pub more_than: Duration,
    /// Inclusive upper bound: as long as a client may be silent.
    pub at_most: Duration,
}

impl WatchdogRange {
    /// Any time.
    pub const ANY: Self = Self {
        more_than: Duration::ZERO,
        at_most: Duration::MAX,
    };

    /// The state of a watchdog set to `time`.
    #[must_use]
    pub fn judge(&self, time: Duration) -> WatchdogState {
        if time > self.at_most {
            WatchdogState::TooLong
        } else if time <= self.more_than {
            WatchdogState::TooShort
        } else {
            WatchdogState::InOrder
        }
    }
}

/// The watchdog of one drive, as last read.
#[derive(Clone, Debug)]
pub struct WatchdogWatch {
    model: Arc<Model>,
    range: WatchdogRange,
    time: Option<u16>,
    action: Option<u16>,
    /// Its time when it was last known to stop the motor soon enough, kept while the drive is offline.
    last_time: Option<Duration>,
}

impl WatchdogWatch {
    /// The watch of a drive of `model`, whose watchdog time should be in `range`. Its state is unknown until it is
    /// read, and stays so if the model has no watchdog.
    #[must_use]
    pub const fn new(model: Arc<Model>, range: WatchdogRange) -> Self {
        Self {
            model,
            range,
            time: None,
            action: None,
            last_time: None,
        }
    }

    /// Takes the words that a read from `address` on has brought. Returns the state if that is another one now.
    pub fn take(&mut self, address: Address, words: &[u16]) -> Option<WatchdogState> {
        let watchdog = self.model.watchdog.as_ref()?;
        let word_at = |wanted: Address| wanted.word_in(address, words);
        let (time, action) = (word_at(watchdog.time), watchdog.action.and_then(word_at));
        if time.is_none() && action.is_none() {
            return None;
        }
        let before = self.state();
        self.time = time.or(self.time);
        self.action = action.or(self.action);
        let state = self.state();
        let stops = matches!(state, WatchdogState::InOrder | WatchdogState::TooShort);
        if state != WatchdogState::Unknown {
            self.last_time = if stops { self.read_time() } else { None };
        }
        (state != before).then_some(state)
    }

    /// The drive is offline: its watchdog may have any setting when it returns.
    pub const fn forget(&mut self) {
        self.time = None;
        self.action = None;
    }

    /// The view; `None` if the model has no watchdog.
    #[must_use]
    pub fn view(&self) -> Option<WatchdogView> {
        self.model.watchdog.as_ref()?;
        let is_proven = self.model.watchdog_is_proven();
        Some(WatchdogView {
            state: self.state(),
            time: self.read_time(),
            is_proven,
        })
    }

    /// After how long without a frame the drive stops its motor by itself; `None` if not read or not reliable.
    #[must_use]
    pub fn stops_after(&self) -> Option<Duration> {
        if self.model.watchdog_is_proven() {
            self.last_time
        } else {
            None
        }
    }

    fn read_time(&self) -> Option<Duration> {
        self.time.and_then(|word| self.model.watchdog_time(word))
    }

    fn state(&self) -> WatchdogState {
        let (Some(watchdog), Some(word)) = (&self.model.watchdog, self.time) else {
            return WatchdogState::Unknown;
        };
        if word == watchdog.off.value {
            return WatchdogState::Off;
        }
        let says = |word: u16| {
            watchdog
                .action_digit
                .map_or(word, |digit| word / digit.max(1) % 10)
        };
        match (watchdog.action, self.action.map(says), self.read_time()) {
            (Some(_), Some(action), _) if watchdog.keeps_running.contains(&action) => {
                WatchdogState::KeepsRunning
            }
            // A word that the model does not list has an unknown meaning, and a reaction that was not read does not
            // count.
            (Some(_), action, _) if !action.is_some_and(|it| watchdog.stops.contains(&it)) => {
                WatchdogState::Unknown
            }
            (_, _, Some(time)) => self.range.judge(time),
            (_, _, None) => WatchdogState::Unknown,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::units::UnitOfMeasure;
    use crate::profile::model::ModelWatchdog;
    use crate::vendors::testing::{fact, model};

    const TIME: u16 = 0x0201;
    const ACTION: u16 = 0x0204;

    fn watched() -> Arc<Model> {
        let mut model = model();
        let (keeps_running, stops) = (vec![3], vec![0, 1]);
        let (action, action_digit) = (Some(ACTION.into()), None);
        model.watchdog = Some(ModelWatchdog {
            time: TIME.into(),
            off: fact(0),
            action,
            action_digit,
            keeps_running,
            stops,
        });
        for register in model
            .registers
            .iter_mut()
            .filter(|register| register.address == TIME)
        {
            register.unit = UnitOfMeasure::Second;
            register.scale = 10;
        }
        Arc::new(model)
    }

    fn range() -> WatchdogRange {
        WatchdogRange {
            more_than: Duration::from_secs(1),
            at_most: Duration::from_secs(3),
        }
    }

    #[test]
    fn a_watchdog_is_in_order_between_its_times_alone() {
        for (time, action, state) in [
            (0, 0, WatchdogState::Off),
            (10, 0, WatchdogState::TooShort),
            (11, 0, WatchdogState::InOrder),
            (30, 0, WatchdogState::InOrder),
            (31, 0, WatchdogState::TooLong),
            (20, 3, WatchdogState::KeepsRunning),
            (0, 3, WatchdogState::Off),
            (20, 4, WatchdogState::Unknown),
            (20, 0xFFFF, WatchdogState::Unknown),
        ] {
            let mut watch = WatchdogWatch::new(watched(), range());
            assert_eq!(watch.view().unwrap().state, WatchdogState::Unknown);
            let reported = Some(state).filter(|it| *it != WatchdogState::Unknown);
            assert_eq!(
                watch.take(TIME.into(), &[time, 0, 0, action]),
                reported,
                "{time} {action}"
            );
            assert_eq!(
                watch.take(TIME.into(), &[time, 0, 0, action]),
                None,
                "reported once"
            );
            let stops = matches!(state, WatchdogState::InOrder | WatchdogState::TooShort);
            assert_eq!(watch.stops_after().is_some(), stops, "{time} {action}");
        }
    }

    #[test]
    fn one_digit_of_a_word_may_be_the_reaction() {
        for (word, state) in [
            (0, WatchdogState::InOrder),
            (122, WatchdogState::InOrder),
            (200, WatchdogState::KeepsRunning),
            (1211, WatchdogState::KeepsRunning),
            (300, WatchdogState::Unknown),
            (0x0200, WatchdogState::Unknown),
        ] {
            let mut model = Model::clone(&watched());
            if let Some(watchdog) = &mut model.watchdog {
                watchdog.action_digit = Some(100);
                watchdog.keeps_running = vec![2];
            }
            let mut watch = WatchdogWatch::new(Arc::new(model), range());
            watch.take(TIME.into(), &[20, 0, 0, word]);
            assert_eq!(watch.view().unwrap().state, state, "{word}");
        }
    }

    #[test]
    fn half_of_it_tells_nothing() {
        let mut watch = WatchdogWatch::new(watched(), range());
        assert_eq!(
            watch.take(TIME.into(), &[20]),
            None,
            "it may keep the motor running"
        );
        assert_eq!(
            watch.take(0x0100_u16.into(), &[20]),
            None,
            "another register"
        );
        assert_eq!(
            watch.take(ACTION.into(), &[1]),
            Some(WatchdogState::InOrder)
        );
    }

    #[test]
    fn a_drive_out_of_sight_has_a_watchdog_that_was_read_and_is_not_shown() {
        let mut watch = WatchdogWatch::new(watched(), range());
        watch.take(TIME.into(), &[20, 0, 0, 1]);
        watch.forget();
        assert_eq!(
            watch.view().unwrap(),
            WatchdogView {
                is_proven: true,
                ..WatchdogView::default()
            }
        );
        assert_eq!(watch.stops_after(), Some(Duration::from_secs(2)));
        watch.take(TIME.into(), &[0, 0, 0, 1]);
        assert_eq!(watch.stops_after(), None);
    }

    #[test]
    fn a_model_without_one_shows_none() {
        let mut watch = WatchdogWatch::new(Arc::new(model()), range());
        assert_eq!(
            (watch.take(0_u16.into(), &[1; 100]), watch.view()),
            (None, None)
        );
    }
}
