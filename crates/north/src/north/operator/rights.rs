//! What a user of the page may do.

use crate::domain::ids::Name;
use std::collections::BTreeSet;

/// The role of a user, from the least to the most.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum UserRole {
    /// Looks, where the page shows nothing to others.
    View,
    /// Commands drives.
    Operate,
    /// Does everything that a plant in service needs.
    Maintain,
    /// Changes the configuration as well.
    Setup,
}

impl UserRole {
    /// The word for it.
    #[must_use]
    pub const fn keyword(self) -> &'static str {
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
pub struct UserRights {
    /// The role.
    pub role: UserRole,
    /// The groups whose drives the user may command beyond a stop. `None`: all drives.
    pub groups: Option<BTreeSet<Name>>,
}

impl UserRights {
    /// Whether the user may command a drive of `group`.
    #[must_use]
    pub fn may_command(&self, group: Option<&Name>) -> bool {
        let is_there = |groups: &BTreeSet<Name>| group.is_some_and(|group| groups.contains(group));
        self.may_stop() && self.groups.as_ref().is_none_or(is_there)
    }

    /// Whether the user may stop drives: all of them, whatever their groups.
    #[must_use]
    pub fn may_stop(&self) -> bool {
        self.role >= UserRole::Operate
    }

    /// Whether the user may change the configuration.
    #[must_use]
    pub fn may_set_up(&self) -> bool {
        self.role >= UserRole::Setup
    }

    /// Whether the user may do what concerns the gateway as a whole.
    #[must_use]
    pub fn may_maintain(&self) -> bool {
        self.role >= UserRole::Maintain
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_role_allows_what_the_ones_below_it_allow_and_groups_narrow_all_but_a_stop() {
        let group = |text: &str| Name::new(text).unwrap();
        let of = |role, groups: Option<&[&str]>| UserRights {
            role,
            groups: groups.map(|all| all.iter().map(|text| group(text)).collect()),
        };
        let (water, air) = (group("water"), group("air"));
        let cases = [
            (of(UserRole::View, None), [false, false, false], false),
            (of(UserRole::Operate, None), [true, true, true], false),
            (
                of(UserRole::Operate, Some(&["water"])),
                [true, false, false],
                false,
            ),
            (
                of(UserRole::Maintain, Some(&[])),
                [false, false, false],
                true,
            ),
            (of(UserRole::Maintain, None), [true, true, true], true),
            (of(UserRole::Setup, None), [true, true, true], true),
        ];
        for (rights, may_command, may_maintain) in cases {
            assert_eq!(
                rights.may_stop(),
                rights.role != UserRole::View,
                "{rights:?}"
            );
            let found = [Some(&water), Some(&air), None].map(|group| rights.may_command(group));
            assert_eq!(
                (found, rights.may_maintain()),
                (may_command, may_maintain),
                "{rights:?}"
            );
            assert_eq!(
                rights.may_set_up(),
                rights.role == UserRole::Setup,
                "{rights:?}"
            );
        }
    }
}
