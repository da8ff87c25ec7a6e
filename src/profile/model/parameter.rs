//! Which registers of a model are parameters that a tool may write back, and which of them it writes last or never.

use super::{Model, Register, Role};

/// What a tool that writes parameters back does with a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ParameterKind {
    /// It is written back like any other.
    Plain,
    /// It decides whom the motor obeys: only if that is wanted, behind the plain ones.
    Source,
    /// It decides how the drive is reached: only if that is wanted, last of all.
    Link,
    /// It is another way to move the motor or to widen its limits: never over the bus.
    BackDoor,
    /// Commands are written there: never as it is.
    Command,
    /// The drive does not take it.
    ReadOnly,
}

impl ParameterKind {
    /// The word for it in files and answers.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Source => "source",
            Self::Link => "link",
            Self::BackDoor => "back_door",
            Self::Command => "command",
            Self::ReadOnly => "read_only",
        }
    }

    /// All of them, in the order in which they are written as far as they are.
    pub const ALL: [Self; 6] = [Self::Plain, Self::Source, Self::Link, Self::BackDoor, Self::Command, Self::ReadOnly];

    /// Whether a tool may write it at all.
    #[must_use]
    pub const fn is_written(self) -> bool {
        matches!(self, Self::Plain | Self::Source | Self::Link)
    }
}

impl Register {
    /// What a tool that writes parameters back does with it.
    #[must_use]
    pub fn parameter_kind(&self) -> ParameterKind {
        match self.role {
            _ if !self.access.can_write() => ParameterKind::ReadOnly,
            _ if self.back_door.is_some() => ParameterKind::BackDoor,
            Some(Role::RunCommand | Role::FrequencyCommand | Role::FrequencySetting) => ParameterKind::Command,
            Some(Role::FrequencySource | Role::RunSource) => ParameterKind::Source,
            _ if self.is_link => ParameterKind::Link,
            _ => ParameterKind::Plain,
        }
    }

    /// The vendor's code, else our own name.
    #[must_use]
    pub fn label(&self) -> &str {
        self.code.as_deref().unwrap_or(&self.name)
    }
}

impl Model {
    /// The registers that can be read and that the vendor has a code for, in order of address.
    pub fn parameters(&self) -> impl Iterator<Item = &Register> {
        self.registers.iter().filter(|register| register.access.can_read() && register.code.is_some())
    }

    /// Whether `word` at `address` has the drive obey the line, as its set-up demands.
    #[must_use]
    pub fn is_set_up_by(&self, address: u16, word: u16) -> bool {
        self.setup.iter().any(|item| item.address == Some(address) && item.values.value.contains(&word))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::profile::testing::EVERYTHING;

    #[test]
    fn what_decides_more_than_itself_is_told_apart() {
        let model = check::model(EVERYTHING).unwrap();
        let kind = |name: &str| model.register_named(name).unwrap().parameter_kind();
        assert_eq!(kind("run_command"), ParameterKind::Command);
        assert_eq!(kind("run_source"), ParameterKind::Source);
        assert_eq!(kind("torque_command"), ParameterKind::BackDoor);
        assert_eq!(kind("status"), ParameterKind::ReadOnly);
        assert_eq!(kind("loss_reaction"), ParameterKind::Plain);
        assert_eq!(kind("loss_time"), ParameterKind::Plain);
        let mut register = model.register_named("loss_time").unwrap().clone();
        register.is_link = true;
        assert_eq!(register.parameter_kind(), ParameterKind::Link);
    }
}
