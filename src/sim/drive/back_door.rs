//! Registers that are other ways to the motor: what they do, as far as their unit and the model's reason tell.

use crate::domain::units::UnitOfMeasure;
use crate::profile::model::Register;

/// What a back door does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BackDoor {
    /// No frequency above it is given out. It is locked while the motor runs.
    Limit,
    /// A second frequency command.
    Frequency,
}

impl BackDoor {
    /// What `register` does; nothing where it is a plain word, because it is none or because nobody knows.
    pub(super) fn of(register: &Register) -> Option<Self> {
        let is_frequency = register.unit == UnitOfMeasure::Hertz && register.role.is_none();
        match register.back_door.as_deref() {
            Some(why) if is_frequency && why.contains("widens the range") => Some(Self::Limit),
            Some(why) if is_frequency && why.contains("give a setpoint") => Some(Self::Frequency),
            _ => None,
        }
    }
}
