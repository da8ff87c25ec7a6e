//! Back doors: registers that are other ways to the motor, as far as their unit and the model's reason show their effect.

use crate::domain::units::UnitOfMeasure;
use crate::profile::model::Register;

/// The effect of a back door.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BackDoor {
    /// Upper limit of the output frequency. Locked while the motor runs.
    Limit,
    /// A second frequency command.
    Frequency,
}

impl BackDoor {
    /// The effect of `register`; `None` if it is a plain word: no back door, or one with unknown effect.
    pub(super) fn of(register: &Register) -> Option<Self> {
        let is_frequency = register.unit == UnitOfMeasure::Hertz && register.role.is_none();
        match register.back_door.as_deref() {
            Some(why) if is_frequency && why.contains("widens the range") => Some(Self::Limit),
            Some(why) if is_frequency && why.contains("give a setpoint") => Some(Self::Frequency),
            _ => None,
        }
    }
}
