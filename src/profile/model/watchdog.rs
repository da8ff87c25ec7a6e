//! Conversion between times and words of the drive's own watchdog.

use super::Model;
use crate::domain::address::Address;
use crate::domain::units::UnitOfMeasure;
use std::time::Duration;

impl Model {
    /// The watchdog time that `word` sets; `None` if the watchdog is off, or the model has none.
    #[must_use]
    pub fn watchdog_time(&self, word: u16) -> Option<Duration> {
        let watchdog = self
            .watchdog
            .as_ref()
            .filter(|watchdog| watchdog.off.value != word)?;
        let register = self.register_at(watchdog.time)?;
        let seconds = f64::from(word) / f64::from(register.scale.max(1));
        (register.unit == UnitOfMeasure::Second).then(|| Duration::from_secs_f64(seconds))
    }

    /// The word that sets the watchdog to exactly `time`, or switches it off without one; `None` if no word does.
    #[must_use]
    pub fn watchdog_word(&self, time: Option<Duration>) -> Option<u16> {
        let watchdog = self.watchdog.as_ref()?;
        let Some(time) = time else {
            return Some(watchdog.off.value);
        };
        let register = self.register_at(watchdog.time)?;
        let steps = time.as_millis() * u128::from(register.scale);
        if !steps.is_multiple_of(1000) {
            return None;
        }
        let word = u16::try_from(steps / 1000).ok()?;
        (register.takes(word) && self.watchdog_time(word) == Some(time)).then_some(word)
    }

    /// Whether the facts about the drive's own watchdog are proven.
    #[must_use]
    pub fn watchdog_is_proven(&self) -> bool {
        self.watchdog.as_ref().is_some_and(|watchdog| {
            let registers = [Some(watchdog.time), watchdog.action].into_iter().flatten();
            let mut registers = registers.filter_map(|address| self.register_at(address));
            watchdog.off.confidence.is_proven()
                && registers.all(|register| register.confidence.is_proven())
        })
    }

    /// Whether a write to `address` sets the drive's own watchdog: its time, its reaction, or a stored twin of either.
    #[must_use]
    pub fn sets_watchdog(&self, address: impl Into<Address>) -> bool {
        let address = address.into();
        let Some(watchdog) = &self.watchdog else {
            return false;
        };
        let is_one =
            |address: Address| watchdog.time == address || watchdog.action == Some(address);
        is_one(address)
            || self
                .stored_twin(address)
                .is_some_and(|register| is_one(register.address))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::testing::fact;
    use crate::profile::model::ModelWatchdog;

    #[test]
    fn a_time_is_a_word_only_where_the_drive_has_just_that_time() {
        let mut model = crate::drive::testing::model();
        let Some(register) = model
            .registers
            .iter_mut()
            .find(|register| register.address == 0x020C)
        else {
            panic!("it has a ramp")
        };
        register.unit = UnitOfMeasure::Second;
        register.scale = 10;
        register.range = Some(0..=255);
        assert_eq!(
            (model.watchdog_time(20), model.watchdog_word(None)),
            (None, None),
            "it has none"
        );
        model.watchdog = Some(ModelWatchdog {
            time: 0x020C_u16.into(),
            off: fact(0),
            action: None,
            action_digit: None,
            keeps_running: Vec::new(),
            stops: Vec::new(),
        });
        let word = |millis| model.watchdog_word(Some(Duration::from_millis(millis)));
        assert_eq!(
            [0, 50, 100, 2500, 25_500, 25_600].map(word),
            [None, None, Some(1), Some(25), Some(255), None]
        );
        assert_eq!(
            (model.watchdog_word(None), model.watchdog_time(0)),
            (Some(0), None)
        );
        assert_eq!(model.watchdog_time(25), Some(Duration::from_millis(2500)));
        assert!(
            model.watchdog_is_proven()
                && model.sets_watchdog(0x020C)
                && !model.sets_watchdog(0x020E)
        );
    }
}
