//! The full scale of the setpoint: no frequency is ordered while it is not known what a word of it means.

use super::review::refused;
use super::state::DriveGuard;
use crate::domain::address::Address;
use crate::domain::command::{Reason, Report};
use crate::domain::time::MonoTime;
use crate::drive::bases::FrequencyBases;
use crate::profile::model::RegisterRole;
use std::time::Duration;

impl DriveGuard {
    /// What the frequencies of the drive are fractions of.
    #[must_use]
    pub const fn bases(&self) -> &FrequencyBases {
        &self.bases
    }

    /// Sets the age from which a reading of the full scale is stale.
    pub const fn bases_stale_after(&mut self, limit: Duration) {
        self.bases.stale_after(limit);
    }

    /// Takes the words that a read from `first` on brought. Returns the register of a full scale that has changed: it is to
    /// be read again. The setpoint that the drive holds means another frequency then, and no longer counts as in force.
    pub fn take_bases(&mut self, first: Address, words: &[u16], at: MonoTime) -> Option<Address> {
        let changed = self.bases.take(first, words, at)?;
        self.setpoint_may_be_lost();
        Some(changed)
    }

    /// The drive is offline: when it is back, it may be another one.
    pub fn forget_bases(&mut self) {
        self.bases.forget();
        self.forget_setting();
    }

    /// Whether the full scales of the setpoint are known, fresh and settled.
    pub(super) fn knows_full_scale(&self, now: MonoTime) -> Result<(), Report> {
        let command = self.model.register_for(RegisterRole::FrequencyCommand);
        let mut registers = command.into_iter().chain(self.model.setting_register());
        let all = registers.all(|register| self.bases.are_sure(register, now));
        if all {
            Ok(())
        } else {
            Err(refused(Reason::FullScaleUnknown))
        }
    }
}
