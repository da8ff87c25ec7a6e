//! What a user of the page may do.

use crate::domain::ids::Name;
use std::collections::BTreeSet;

/// The role of a user, from the least to the most.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// Looks, where the page shows nothing to others.
    View,
    /// Commands drives.
    Operate,
    /// Does everything that a plant in service needs.
    Maintain,
    /// Changes the configuration as well.
    Setup,
}

impl Role {
    /// The word for it.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::View => "view",
            Self::Operate => "operate",
            Self::Maintain => "maintain",
            Self::Setup => "setup",
        }
    }

    /// Its meaning, for messages.
    #[must_use]
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::View => "looks, and commands nothing",
            Self::Operate => "commands drives",
            Self::Maintain => "commands drives, and saves diagnostics",
            Self::Setup => "does all of this, finds drives, and changes the configuration",
        }
    }
}

/// What one user may do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rights {
    /// The role.
    pub role: Role,
    /// The groups whose drives the user may command beyond a stop. `None`: all drives.
    pub groups: Option<BTreeSet<Name>>,
}

impl Rights {
    /// Whether the user may command a drive of `group`.
    #[must_use]
    pub fn may_command(&self, group: Option<&Name>) -> bool {
        let is_there = |groups: &BTreeSet<Name>| group.is_some_and(|group| groups.contains(group));
        self.may_stop() && self.groups.as_ref().is_none_or(is_there)
    }

    /// Whether the user may stop drives: all of them, whatever their groups.
    #[must_use]
    pub fn may_stop(&self) -> bool {
        self.role >= Role::Operate
    }

    /// Whether the user may change the configuration.
    #[must_use]
    pub fn may_set_up(&self) -> bool {
        self.role >= Role::Setup
    }

    /// Whether the user may do what concerns the gateway as a whole.
    #[must_use]
    pub fn may_maintain(&self) -> bool {
        self.role >= Role::Maintain
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_role_allows_what_the_ones_below_it_allow_and_groups_narrow_all_but_a_stop() {
        let group = |text: &str| Name::new(text).unwrap();
        let of = |role, groups: Option<&[&str]>| Rights {
            role,
            groups: groups.map(|all| all.iter().map(|text| group(text)).collect()),
        };
        let (water, air) = (group("water"), group("air"));
        let cases = [
            (of(Role::View, None), [false, false, false], false),
            (of(Role::Operate, None), [true, true, true], false),
            (
                of(Role::Operate, Some(&["water"])),
                [true, false, false],
                false,
            ),
            (of(Role::Maintain, Some(&[])), [false, false, false], true),
            (of(Role::Maintain, None), [true, true, true], true),
            (of(Role::Setup, None), [true, true, true], true),
        ];
        for (rights, may_command, may_maintain) in cases {
            assert_eq!(rights.may_stop(), rights.role != Role::View, "{rights:?}");
            let found = [Some(&water), Some(&air), None].map(|group| rights.may_command(group));
            assert_eq!(
                (found, rights.may_maintain()),
                (may_command, may_maintain),
                "{rights:?}"
            );
            assert_eq!(
                rights.may_set_up(),
                rights.role == Role::Setup,
                "{rights:?}"
            );
        }
    }
}
