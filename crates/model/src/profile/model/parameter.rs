//! Which registers are parameters that a tool may restore, and which of them it writes last or never.

use super::{Register, RegisterRole};

/// How a tool that restores parameters treats a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ParameterKind {
    /// Restored without conditions.
    Plain,
    /// Selects the source of commands: restored only on request, after the plain ones.
    Source,
    /// Affects communication with the drive: restored only on request, last of all.
    Link,
    /// Another way to move the motor or to widen its limits: never written over the bus.
    BackDoor,
    /// Takes commands: never restored.
    Command,
    /// Not writable.
    ReadOnly,
}

impl ParameterKind {
    /// The word used in files and answers.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Source => "source",
            Self::Link => "link",
            Self::BackDoor => "back_door",
            Self::Command => "command",
            Self::ReadOnly => "read_only",
        }
    }

    /// All kinds, in the order in which they are restored.
    pub const ALL: [Self; 6] = [
        Self::Plain,
        Self::Source,
        Self::Link,
        Self::BackDoor,
        Self::Command,
        Self::ReadOnly,
    ];

    /// Whether a tool may restore it at all.
    #[must_use]
    pub const fn is_written(self) -> bool {
        matches!(self, Self::Plain | Self::Source | Self::Link)
    }
}

impl Register {
    /// How a tool that restores parameters treats it.
    #[must_use]
    pub fn parameter_kind(&self) -> ParameterKind {
        match self.role {
            _ if !self.access.can_write() => ParameterKind::ReadOnly,
            _ if self.back_door.is_some() => ParameterKind::BackDoor,
            Some(
                RegisterRole::RunCommand
                | RegisterRole::Order
                | RegisterRole::FrequencyCommand
                | RegisterRole::FrequencySetting,
            ) => ParameterKind::Command,
            Some(RegisterRole::FrequencySource | RegisterRole::RunSource) => ParameterKind::Source,
            _ if self.is_link => ParameterKind::Link,
            _ => ParameterKind::Plain,
        }
    }

    /// The vendor's code, else the register's name.
    #[must_use]
    pub fn label(&self) -> &str {
        self.code.as_deref().unwrap_or(&self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::profile::testing::EVERYTHING;

    #[test]
    fn what_decides_more_than_itself_is_distinguished() {
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
