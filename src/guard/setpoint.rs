//! The accepted setpoint, and the drive's own setting as it was last read: that decides whether the setpoint is in force, not
//! what was once written.

use super::setting::{InForce, Setpoint, SettingReading};
use super::state::DriveGuard;
use crate::domain::address::Address;
use crate::domain::command::Owner;
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::steps::SHOWN_WITHIN;
use crate::profile::model::{Register, RegisterRole};
use std::time::Duration;

/// A drive that has never shown a setpoint that it acknowledged is sent it again no sooner than this: its read-back is many
/// frames.
const ASKED_AGAIN_AFTER: Duration = Duration::from_secs(5);

impl DriveGuard {
    /// The drive acknowledged the setpoint `value` of `owner`.
    pub fn setpoint_was_acknowledged(&mut self, owner: Owner, value: Hertz, now: MonoTime) {
        let accepted = Setpoint {
            acknowledged: true,
            acknowledged_at: now,
            ..Setpoint::accepted(owner, value)
        };
        let is_repeated = self
            .setpoint
            .is_some_and(|setpoint| setpoint.value == value && setpoint.is_repeated);
        let held = Setpoint {
            is_repeated,
            ..accepted
        };
        self.held_setpoint = Some(held);
        if self
            .setpoint
            .is_some_and(|setpoint| setpoint.value == value)
        {
            self.setpoint = Some(held);
        }
    }

    /// A setpoint was sent but not answered: the drive may no longer hold the previous one.
    pub const fn setpoint_is_unknown(&mut self) {
        if let Some(held) = &mut self.held_setpoint {
            held.acknowledged = false;
        }
    }

    /// The drive was reset, or may have lost power: an equal setpoint counts as new.
    pub fn setpoint_may_be_lost(&mut self) {
        self.setpoint_is_unknown();
        if let Some(setpoint) = &mut self.setpoint {
            setpoint.acknowledged = false;
        }
    }

    /// The setpoint `value` was never sent, or the drive refused it: it is replaced by the one still to be sent, or
    /// else by the one that the drive holds.
    pub fn setpoint_failed(&mut self, value: Hertz, still_ordered: Option<(Owner, Hertz)>) {
        if self
            .setpoint
            .is_some_and(|setpoint| setpoint.value == value && !setpoint.acknowledged)
        {
            let ordered = still_ordered.map(|(by, value)| Setpoint::accepted(by, value));
            self.setpoint = ordered.or(self.held_setpoint);
        }
    }

    pub(super) fn accepted_setpoint(&self) -> Option<Setpoint> {
        self.setpoint
    }

    pub(super) fn accept_setpoint(&mut self, owner: Owner, value: Hertz) {
        let is_repeated = self.is_repeated(value);
        self.setpoint = Some(Setpoint {
            is_repeated,
            ..Setpoint::accepted(owner, value)
        });
    }

    /// Takes the words that a read from `first` on brought at `at`.
    pub fn take_setting(&mut self, first: Address, words: &[u16], at: MonoTime) {
        let Some(register) = self.model.setting_register() else {
            return;
        };
        let word = |address: Address| address.word_in(first, words);
        let second = match register.form.pair {
            Some(_) => register.address.checked_add(1).and_then(word),
            None => Some(0),
        };
        let Some((first, second)) = word(register.address).zip(second) else {
            return;
        };
        self.setting = Some(SettingReading {
            words: [first, second],
            at,
        });
        if let Some(setpoint) = self.setpoint
            && setpoint.acknowledged
            && !setpoint.is_shown
        {
            let is_shown = self.holds(setpoint.value) == Some(true);
            self.setpoint = Some(Setpoint {
                is_shown,
                ..setpoint
            });
        }
    }

    /// The drive is out of sight: what it held may be another value when it is back.
    pub(super) const fn forget_setting(&mut self) {
        self.setting = None;
    }

    /// Whether the accepted setpoint, which the drive has acknowledged, is in force at `now`.
    pub(super) fn is_in_force(&self, now: MonoTime) -> InForce {
        let (Some(setpoint), Some(setting)) = (self.setpoint, self.setting) else {
            return InForce::Yes;
        };
        if self.holds(setpoint.value) != Some(false) {
            return InForce::Yes;
        }
        if setpoint.is_shown {
            // Somebody has changed it since.
            return if self.is_worn_by_setpoint(now) {
                setting.keeps_out()
            } else {
                InForce::No
            };
        }
        let since = setting.at.since(setpoint.acknowledged_at);
        if since < SHOWN_WITHIN {
            // Read before, or too soon: it need not show yet.
            return if setpoint.is_repeated {
                setting.keeps_out()
            } else {
                InForce::Yes
            };
        }
        let waits = since < ASKED_AGAIN_AFTER || self.is_worn_by_setpoint(now);
        if waits {
            setting.keeps_out()
        } else {
            InForce::No
        }
    }

    /// Whether the setpoint that is sent now was acknowledged before and never shown: its read-back is the answer.
    pub(super) fn is_repeated(&self, value: Hertz) -> bool {
        self.setpoint.is_some_and(|it| {
            it.value == value && (it.is_repeated || it.acknowledged) && !it.is_shown
        }) && self.holds(value) == Some(false)
    }

    /// Whether the setpoint goes to a stored register that was written too short a time ago.
    fn is_worn_by_setpoint(&self, now: MonoTime) -> bool {
        let Some(address) = self
            .setpoint_address()
            .filter(|address| self.model.is_stored(*address))
        else {
            return false;
        };
        let interval = self
            .control
            .as_ref()
            .map_or(Duration::ZERO, |control| control.stored_write_interval);
        self.interlocks.was_written_within(interval, address, now)
    }

    /// Where the setpoint is written.
    pub(super) fn setpoint_address(&self) -> Option<Address> {
        Some(
            self.model
                .cyclic_address(self.model.register_for(RegisterRole::FrequencyCommand)?),
        )
    }

    /// Whether the setting agrees with `value` within a step of it or of the setpoint; `None` if that is not known.
    fn holds(&self, value: Hertz) -> Option<bool> {
        let register = self.model.setting_register()?;
        let words = self.setting?.words;
        let known = |address| self.bases.word(address);
        let number = register
            .number(|address| words.get(usize::from(address != register.address)).copied())?;
        let number = i64::try_from(number.unsigned_abs()).ok()?;
        let shown = register.magnitude(number, known)?.millihertz();
        let next = register.magnitude(number + 1, known)?.millihertz();
        let command = self
            .model
            .register_for(RegisterRole::FrequencyCommand)
            .filter(|it| it.is_exact());
        let step = next
            .saturating_sub(shown)
            .max(command.map_or(0, step_millihertz));
        // Both are rounded to the nearest thousandth.
        Some(shown.abs_diff(value.millihertz()) <= step + 1)
    }
}

fn step_millihertz(register: &Register) -> u32 {
    1000 / register.scale.max(1)
}
