//! How a vendor's own codes map to addresses on the wire.

use super::Fact;

/// The rule that maps a code to an address.
#[derive(Clone, Debug, PartialEq)]
pub enum CodeRule {
    /// A group, a separator and a number in decimal: high byte and low byte of the address.
    Groups {
        /// The groups with their high bytes. Case matters: `F` is not `f`.
        groups: Vec<(String, u8)>,
        /// Groups that the rule covers only up to a number: codes beyond it may be at any address.
        ends: Vec<(String, u8)>,
        /// The text between group and number.
        separator: String,
        /// Confidence and source of the rule.
        origin: Fact<()>,
    },
    /// Numbers in decimal with a fixed distance between their addresses: address = group x `group` + number x `number`
    /// + `offset`.
    Linear {
        /// The text between group and number; `None` if a code is a number alone.
        separator: Option<String>,
        /// Addresses from one group to the next.
        group: i32,
        /// Addresses from one number to the next.
        number: i32,
        /// The address of number 0 in group 0.
        offset: i32,
        /// Confidence and source of the rule.
        origin: Fact<()>,
    },
    /// The code is the address in hexadecimal.
    Hexadecimal(Fact<()>),
}

impl CodeRule {
    /// The address of `code` as people type it: capital and small letters are the same unless both are groups.
    #[must_use]
    pub fn address_typed(&self, code: &str) -> Option<u16> {
        [code.to_owned(), code.to_uppercase(), code.to_lowercase()]
            .iter()
            .find_map(|code| self.address(code))
    }

    /// The address of `code`; `None` if the rule does not cover it.
    #[must_use]
    pub fn address(&self, code: &str) -> Option<u16> {
        match self {
            Self::Hexadecimal(_) => {
                let is_hex = code.len() == 4 && code.bytes().all(|digit| digit.is_ascii_hexdigit());
                is_hex.then(|| u16::from_str_radix(code, 16).ok())?
            }
            Self::Linear {
                separator,
                group,
                number,
                offset,
                ..
            } => {
                let (of_group, of_number) = match separator {
                    Some(separator) => code.split_once(separator.as_str())?,
                    None => ("0", code),
                };
                let is_number = |text: &str| {
                    !text.is_empty() && text.bytes().all(|digit| digit.is_ascii_digit())
                };
                let parsed = |text: &str| {
                    if is_number(text) && text.len() <= 6 {
                        text.parse::<i64>().ok()
                    } else {
                        None
                    }
                };
                let address =
                    parsed(of_group)? * i64::from(*group) + parsed(of_number)? * i64::from(*number);
                u16::try_from(address + i64::from(*offset)).ok()
            }
            Self::Groups {
                groups,
                ends,
                separator,
                ..
            } => {
                // The longest group first: `U0` must not hide `U00`.
                let of = |(group, byte): &(String, u8)| {
                    Some((group.clone(), *byte, code.strip_prefix(group.as_str())?))
                };
                let (group, byte, rest) = groups
                    .iter()
                    .filter_map(of)
                    .max_by_key(|(group, ..)| group.len())?;
                let number = rest.strip_prefix(separator.as_str())?;
                let is_number =
                    (1..=3).contains(&number.len()) && number.bytes().all(|it| it.is_ascii_digit());
                let low: u8 = is_number.then(|| number.parse().ok())??;
                let end = ends
                    .iter()
                    .find(|(it, _)| *it == group)
                    .map_or(u8::MAX, |(_, end)| *end);
                (low <= end).then(|| u16::from_be_bytes([byte, low]))
            }
        }
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::check;
    use crate::profile::model::Confidence;
    use crate::profile::testing::{EVERYTHING, MODEL};

    fn origin() -> Fact<()> {
        Fact {
            value: (),
            confidence: Confidence::Manual,
            source: "IM 1".to_owned(),
        }
    }

    #[test]
    fn letters_of_either_case_are_taken_unless_both_are_groups() {
        let groups = [("A", 3), ("b", 4), ("F", 2), ("f", 9)]
            .map(|(group, byte)| (group.to_owned(), byte))
            .to_vec();
        let rule = CodeRule::Groups {
            groups,
            ends: Vec::new(),
            separator: String::new(),
            origin: origin(),
        };
        let typed = ["A60", "a60", "B37", "f1", "F1", "x1"].map(|code| rule.address_typed(code));
        assert_eq!(
            typed,
            [
                Some(0x033C),
                Some(0x033C),
                Some(0x0425),
                Some(0x0901),
                Some(0x0201),
                None
            ]
        );
    }

    #[test]
    fn a_code_is_its_group_and_number() {
        let groups = vec![("F01".to_owned(), 0x01), ("U00".to_owned(), 0x30)];
        let rule = CodeRule::Groups {
            groups,
            ends: Vec::new(),
            separator: ".".to_owned(),
            origin: origin(),
        };
        assert_eq!(rule.address("F01.08"), Some(0x0108));
        assert_eq!(rule.address("U00.41"), Some(0x3029));
        for wrong in [
            "F01", "F01.", "F02.00", "F01.+1", "F01.0100", "F01.256", "f01.08",
        ] {
            assert_eq!(rule.address(wrong), None, "{wrong}");
        }
        let letters = vec![("A".to_owned(), 3), ("b".to_owned(), 4)];
        let rule = CodeRule::Groups {
            groups: letters,
            ends: vec![("b".to_owned(), 17)],
            separator: String::new(),
            origin: origin(),
        };
        assert_eq!(
            (
                rule.address("A60"),
                rule.address("b17"),
                rule.address("B17")
            ),
            (Some(0x033C), Some(0x0411), None)
        );
        assert_eq!(
            (rule.address("b18"), rule.address("b255")),
            (None, None),
            "the rule ends at b17"
        );
    }

    #[test]
    fn a_linear_code_is_counted() {
        let linear = |separator: Option<&str>, group, number, offset| CodeRule::Linear {
            separator: separator.map(str::to_owned),
            group,
            number,
            offset,
            origin: origin(),
        };
        let menus = linear(Some("."), 100, 1, -1);
        assert_eq!(
            (menus.address("10.38"), menus.address("0.1")),
            (Some(1037), Some(0))
        );
        for wrong in ["0.0", "10", "10.", ".38", "10.3.8", "+1.1", "9999.1"] {
            assert_eq!(menus.address(wrong), None, "{wrong}");
        }
        let numbers = linear(None, 0, 10, -1);
        assert_eq!(
            (numbers.address("1610"), numbers.address("6554")),
            (Some(16_099), None)
        );
    }

    #[test]
    fn a_code_in_hexadecimal_is_the_address() {
        let rule = CodeRule::Hexadecimal(origin());
        assert_eq!(
            (rule.address("FE10"), rule.address("0010")),
            (Some(0xFE10), Some(0x0010))
        );
        assert_eq!((rule.address("F01.08"), rule.address("+FE1")), (None, None));
    }

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
