//! Groups of parameters, derived from a model's code rule: the addresses of a group and their codes. A drive has more
//! parameters than its model describes, and a full copy needs them all.

use super::{CodeRule, Model};
use crate::domain::address::Address;
use std::collections::BTreeSet;

/// Maximum count of numbers in a group, from 0: codes have two digits.
pub const NUMBERS_MAX: u8 = 100;

/// A group of parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParameterGroup {
    /// The prefix of its codes; if codes are addresses, their first two digits.
    pub name: String,
    /// The high byte of its addresses.
    pub high: u8,
}

impl Model {
    /// The groups of the code rule; if codes are addresses, those that contain a register with a code, because no others
    /// are known. Empty without a rule.
    #[must_use]
    pub fn groups(&self) -> Vec<ParameterGroup> {
        match &self.codes {
            None | Some(CodeRule::Linear { .. }) => Vec::new(),
            // Whatever is read there is shown: no answer says where a group ends.
            Some(_) if self.read.reads_holes() => Vec::new(),
            Some(CodeRule::Groups { groups, .. }) => groups
                .iter()
                .map(|(name, high)| ParameterGroup {
                    name: name.clone(),
                    high: *high,
                })
                .collect(),
            Some(CodeRule::Hexadecimal(_)) => {
                let bytes: BTreeSet<u8> = self
                    .parameters()
                    .map(|it| it.address.number().to_be_bytes()[0])
                    .collect();
                bytes
                    .into_iter()
                    .map(|high| ParameterGroup {
                        name: format!("{high:02X}"),
                        high,
                    })
                    .collect()
            }
        }
    }

    /// The addresses that `group` may hold, in the drive's numbering.
    pub fn addresses_of(&self, group: &ParameterGroup) -> impl Iterator<Item = Address> {
        let first = Address::holding(u16::from_be_bytes([group.high, 0]));
        let all = std::iter::successors(Some(first), |address| Some(self.next_address(*address)));
        all.take(usize::from(NUMBERS_MAX))
            .filter(|address| self.code_in_group(*address).is_some())
    }

    /// The vendor's code of the parameter at `address`; `None` outside all groups.
    #[must_use]
    pub fn code_in_group(&self, address: Address) -> Option<String> {
        let rule = self.codes.as_ref()?;
        let [high, low] = address.number().to_be_bytes();
        let code = match rule {
            CodeRule::Linear { .. } => return None,
            CodeRule::Hexadecimal(_) => {
                let is_decimal = low & 0xF <= 9 && low >> 4 <= 9;
                let is_known = self
                    .parameters()
                    .any(|it| it.address.number().to_be_bytes()[0] == high);
                (is_decimal && is_known).then(|| format!("{:04X}", address.number()))?
            }
            CodeRule::Groups {
                groups, separator, ..
            } => {
                if low >= NUMBERS_MAX {
                    return None;
                }
                let (name, _) = groups.iter().find(|(_, byte)| *byte == high)?;
                format!("{name}{separator}{low:02}")
            }
        };
        // There is no code beyond the end of a group.
        (rule.address(&code) == Some(address.number())).then_some(code)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::profile::testing::{EVERYTHING, MODEL};

    #[test]
    fn a_group_is_what_its_rule_covers() {
        let model = check::model(EVERYTHING).unwrap();
        let groups = model.groups();
        assert!(!groups.is_empty());
        for group in &groups {
            let addresses: Vec<_> = model.addresses_of(group).collect();
            assert!(
                !addresses.is_empty() && addresses.len() <= usize::from(NUMBERS_MAX),
                "{group:?}"
            );
            for address in addresses {
                let code = model.code_in_group(address).unwrap();
                assert!(code.starts_with(&group.name), "{code}");
                assert_eq!(
                    model.codes.as_ref().unwrap().address(&code),
                    Some(address.number())
                );
            }
        }
        let without = check::model(MODEL).unwrap();
        assert_eq!(
            (without.groups(), without.code_in_group(0x0101_u16.into())),
            (Vec::new(), None)
        );
    }
}
