//! The accepted setpoint, and the drive's own setting as it was last read: that decides whether the setpoint is in force, not
//! what was once written. No frequency is ordered while it is not known what a word of it means.

use crate::domain::address::Address;
use crate::domain::command::{Outcome, Owner, Reason, Report};
use crate::domain::frequency::Hertz;
use crate::domain::time::MonoTime;
use crate::drive::bases::FrequencyBases;
use crate::drive::steps::SHOWN_WITHIN;
use crate::profile::model::{Model, Register, RegisterRole};
use std::sync::Arc;
use std::time::Duration;

/// A drive that has never shown a setpoint that it acknowledged is sent it again no sooner than this: its read-back is many
/// frames.
const ASKED_AGAIN_AFTER: Duration = Duration::from_secs(5);

/// The setpoint of one drive: what was ordered, what the drive acknowledged, and what it shows.
#[derive(Debug)]
pub(super) struct SetpointOrder {
    model: Arc<Model>,
    /// What the frequencies of the drive are fractions of.
    bases: FrequencyBases,
    /// The last accepted setpoint.
    accepted: Option<Setpoint>,
    /// The last acknowledged setpoint.
    held: Option<Setpoint>,
    /// The drive's own setting of the frequency.
    setting: Option<SettingReading>,
}

/// The last accepted setpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Setpoint {
    value: Hertz,
    by: Owner,
    acknowledged: bool,
    /// When it was acknowledged last.
    acknowledged_at: MonoTime,
    /// The drive has shown it since it was accepted.
    is_shown: bool,
    /// The setpoint was sent before, acknowledged and never shown.
    is_repeated: bool,
}

impl Setpoint {
    const fn accepted(by: Owner, value: Hertz) -> Self {
        let acknowledged_at = MonoTime::ZERO;
        Self {
            value,
            by,
            acknowledged: false,
            acknowledged_at,
            is_shown: false,
            is_repeated: false,
        }
    }
}

/// The last reading of the setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct SettingReading {
    /// Its words; the second is 0 for a setting of one word.
    words: [u16; 2],
    /// When it arrived.
    at: MonoTime,
}

impl SettingReading {
    const fn keeps_out(self) -> InForce {
        InForce::KeptOut {
            held: self.words[0],
        }
    }
}

impl SetpointOrder {
    /// Nothing was ordered yet, and nothing read.
    pub fn none(model: Arc<Model>) -> Self {
        Self {
            bases: FrequencyBases::of(&model),
            model,
            accepted: None,
            held: None,
            setting: None,
        }
    }

    pub const fn bases(&self) -> &FrequencyBases {
        &self.bases
    }

    /// Sets the age from which a reading of the full scale is stale.
    pub const fn bases_stale_after(&mut self, limit: Duration) {
        self.bases.stale_after(limit);
    }

    /// Takes the words that a read from `first` on brought. Returns the register of a full scale that has changed. The
    /// setpoint that the drive holds means another frequency then, and no longer counts as in force.
    pub fn take_bases(&mut self, first: Address, words: &[u16], at: MonoTime) -> Option<Address> {
        let changed = self.bases.take(first, words, at)?;
        self.may_be_lost();
        Some(changed)
    }

    /// Whether the full scales of the setpoint are known, fresh and settled.
    pub fn knows_full_scale(&self, now: MonoTime) -> Result<(), Report> {
        let command = self.model.register_for(RegisterRole::FrequencyCommand);
        let mut registers = command.into_iter().chain(self.model.setting_register());
        let all = registers.all(|register| self.bases.are_sure(register, now));
        if all {
            Ok(())
        } else {
            Err(Report::refused(Reason::FullScaleUnknown))
        }
    }

    /// The last accepted setpoint.
    pub fn value(&self) -> Option<Hertz> {
        self.accepted.map(|setpoint| setpoint.value)
    }

    /// The drive acknowledged the setpoint `value` of `owner`.
    pub fn was_acknowledged(&mut self, owner: Owner, value: Hertz, now: MonoTime) {
        let accepted = Setpoint {
            acknowledged: true,
            acknowledged_at: now,
            ..Setpoint::accepted(owner, value)
        };
        let is_repeated = self
            .accepted
            .is_some_and(|setpoint| setpoint.value == value && setpoint.is_repeated);
        let held = Setpoint {
            is_repeated,
            ..accepted
        };
        self.held = Some(held);
        if self
            .accepted
            .is_some_and(|setpoint| setpoint.value == value)
        {
            self.accepted = Some(held);
        }
    }

    /// A setpoint was sent but not answered: the drive may no longer hold the previous one.
    pub const fn is_unknown(&mut self) {
        if let Some(held) = &mut self.held {
            held.acknowledged = false;
        }
    }

    /// The drive was reset, or may have lost power: an equal setpoint counts as new.
    pub const fn may_be_lost(&mut self) {
        self.is_unknown();
        if let Some(setpoint) = &mut self.accepted {
            setpoint.acknowledged = false;
        }
    }

    /// The setpoint `value` was never sent, or the drive refused it: it is replaced by the one still to be sent, or
    /// else by the one that the drive holds.
    pub fn failed(&mut self, value: Hertz, still_ordered: Option<(Owner, Hertz)>) {
        if self
            .accepted
            .is_some_and(|setpoint| setpoint.value == value && !setpoint.acknowledged)
        {
            let ordered = still_ordered.map(|(by, value)| Setpoint::accepted(by, value));
            self.accepted = ordered.or(self.held);
        }
    }

    /// Whether the drive has acknowledged `value` as the last accepted setpoint, and its owner `is_his`.
    pub fn has_acknowledged(&self, value: Hertz, is_his: impl FnOnce(Owner) -> bool) -> bool {
        self.accepted
            .is_some_and(|last| last.acknowledged && last.value == value && is_his(last.by))
    }

    pub fn accept(&mut self, owner: Owner, value: Hertz) {
        let is_repeated = self.is_repeated(value);
        self.accepted = Some(Setpoint {
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
        if let Some(setpoint) = self.accepted
            && setpoint.acknowledged
            && !setpoint.is_shown
        {
            let is_shown = self.holds(setpoint.value) == Some(true);
            self.accepted = Some(Setpoint {
                is_shown,
                ..setpoint
            });
        }
    }

    /// The drive is out of sight: when it is back, it may be another one, and hold another value.
    pub fn forget(&mut self) {
        self.bases.forget();
        self.setting = None;
    }

    /// Whether the accepted setpoint, which the drive has acknowledged, is in force; `is_worn`: it goes to a stored register
    /// that was written too short a time ago.
    pub fn is_in_force(&self, is_worn: bool) -> InForce {
        let (Some(setpoint), Some(setting)) = (self.accepted, self.setting) else {
            return InForce::Yes;
        };
        if self.holds(setpoint.value) != Some(false) {
            return InForce::Yes;
        }
        if setpoint.is_shown {
            // The drive's own setting was changed since.
            return if is_worn {
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
        let waits = since < ASKED_AGAIN_AFTER || is_worn;
        if waits {
            setting.keeps_out()
        } else {
            InForce::No
        }
    }

    /// Whether the setpoint that is sent now was acknowledged before and never shown: its read-back is the answer.
    pub fn is_repeated(&self, value: Hertz) -> bool {
        self.accepted.is_some_and(|it| {
            it.value == value && (it.is_repeated || it.acknowledged) && !it.is_shown
        }) && self.holds(value) == Some(false)
    }

    /// Where the setpoint is written.
    pub fn address(&self) -> Option<Address> {
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

/// Whether a setpoint that equals the accepted one is in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum InForce {
    /// The setpoint is in force, as far as the drive shows: nothing is sent.
    Yes,
    /// The drive holds another value: it is sent.
    No,
    /// The drive has acknowledged it and holds another value. It is not sent again yet.
    KeptOut {
        /// The first word of what it holds.
        held: u16,
    },
}

impl InForce {
    /// The answer to a client whose order would change nothing.
    pub fn report(self) -> Result<(), Report> {
        match self {
            Self::Yes | Self::No => Ok(()),
            Self::KeptOut { held } => Err(Report {
                held: Some(held),
                ..Report::new(Outcome::Failed, Reason::NotReadBack)
            }),
        }
    }
}

fn step_millihertz(register: &Register) -> u32 {
    1000 / register.scale.max(1)
}
