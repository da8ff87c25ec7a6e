//! `[codes]`: how the vendor's codes map to addresses.

use super::facts::{FactReader, Origin, fact};
use crate::domain::problem::Problem;
use crate::profile::model::CodeRule;
use crate::profile::words::declare_words;
use crate::toml_file::declare::{KeyForm, declare_table, optional};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{LocatedValue, OptionalKey, TableReader};

declare_words! {
    /// Values of `form`.
    FORMS: CodeForm {
        /// The code is the address in hexadecimal.
        Hexadecimal "hexadecimal";
        /// Address = group x `group` + number x `number` + `offset`, in decimal; without `separator` a code is a number alone.
        Linear "linear";
    }
}

/// A rule other than `groups`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CodeForm {
    Hexadecimal,
    Linear,
}

declare_table! {
    /// How the vendor's codes go together with addresses. Registers that break the rule are reported; one that states its `code`
    /// may leave out `address`. Either `groups` or `form`.
    CodesFile is "[codes]" at location with facts: &FactReader<'_> {
        /// A code is the name of a group and a number in decimal; the address is the group's high byte and the number: with
        /// `{ F = 0x01 }` `F08` is 0x0108. Upper and lower case are different groups.
        groups: OptionalKey<GroupBytes> = bytes(true);
        /// The last number of each group that follows the rule; codes beyond it may be anywhere.
        ends: OptionalKey<GroupBytes> = bytes(false), without "all numbers";
        /// The rule, unless it is `groups`.
        form: OptionalKey<CodeForm> = optional(ValueKind::one_of(&FORMS));
        /// The text between group and number, as the `.` of `P.01`.
        separator: OptionalKey<String> =
            optional(ValueKind::parsed("text", |text| Some(text.to_owned()))), without "none";
        /// With `form = "linear"` and a separator: addresses from one group to the next.
        group: OptionalKey<i32> = optional(distance()), or 100;
        /// With `form = "linear"`: addresses from one number to the next.
        number: OptionalKey<i32> = optional(distance()), or 1;
        /// With `form = "linear"`: the address of number 0 in group 0, often -1.
        offset: OptionalKey<i32> = optional(ValueKind::number(-50_000..=50_000)), or 0;
        origin: Option<Origin> = facts.sources();
    }
}

/// Bytes by the names of groups.
type GroupBytes = Vec<(String, LocatedValue<u8>)>;

/// A table of groups, each with a byte; `is_filled`: of at least one.
fn bytes(is_filled: bool) -> KeyForm<'static, OptionalKey<GroupBytes>> {
    let kind = ValueKind::number(0..=u8::MAX);
    let right = format!("a table, each {}", kind.right());
    let form = KeyForm::of(kind, move |reader, key, kind| {
        reader.inner(key, |mut groups| {
            if is_filled && groups.is_empty() {
                let problem = groups.location().problem("is empty");
                groups
                    .problems()
                    .push(problem.right("at least one group with its high byte"));
            }
            groups.all(kind)
        })
    });
    form.right(right)
}

fn distance() -> ValueKind<'static, i32> {
    ValueKind::number(1..=10_000)
}

impl CodesFile {
    /// Reads the rule, and reports keys that belong to another one.
    pub(super) fn of(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let codes = Self::keys(facts, &mut reader);
        codes.check(reader.problems());
        reader.finish();
        codes
    }

    fn check(&self, problems: &mut Vec<Problem>) {
        let form = self.form.valid().map(|form| form.value);
        if form != Some(CodeForm::Linear) {
            for (key, given) in [
                ("group", &self.group),
                ("number", &self.number),
                ("offset", &self.offset),
            ] {
                linear_only(key, given, problems);
            }
        } else if matches!(self.separator, OptionalKey::Absent) {
            linear_only("group", &self.group, problems);
        }
        match (&self.groups, &self.form) {
            (OptionalKey::Absent, OptionalKey::Valid(_)) if form == Some(CodeForm::Linear) => {}
            (OptionalKey::Valid(_), OptionalKey::Absent) => self.ends_are_of_groups(problems),
            (OptionalKey::Absent, OptionalKey::Valid(_)) => {
                groups_only("separator", &self.separator, problems);
                groups_only("ends", &self.ends, problems);
            }
            (OptionalKey::Invalid, OptionalKey::Absent)
            | (OptionalKey::Absent, OptionalKey::Invalid) => {}
            (OptionalKey::Absent, OptionalKey::Absent) => self.no_form("has no rule", problems),
            _ => self.no_form("has two rules", problems),
        }
    }

    /// Each group that ends early is one of `groups`.
    fn ends_are_of_groups(&self, problems: &mut Vec<Problem>) {
        let groups = self.groups.valid().map(|groups| &groups.value);
        for (name, end) in self.ends.valid().iter().flat_map(|ends| &ends.value) {
            if !groups.is_some_and(|groups| groups.iter().any(|(group, _)| group == name)) {
                let problem = end.location.problem(format!("there is no group `{name}`"));
                problems.push(problem.right("one of `groups`"));
            }
        }
    }

    fn no_form(&self, what: &str, problems: &mut Vec<Problem>) {
        let problem = self.location.problem(what);
        problems.push(problem.right("either `groups` or `form`, \"hexadecimal\" or \"linear\""));
    }

    /// `None` if any part is unusable.
    pub fn ready(&self) -> Option<CodeRule> {
        let origin = fact((), self.origin.as_ref())?;
        let bytes = |groups: &GroupBytes| {
            let bytes = groups.iter();
            bytes
                .map(|(name, byte)| (name.clone(), byte.value))
                .collect()
        };
        Some(match (&self.groups, &self.form) {
            (OptionalKey::Valid(groups), OptionalKey::Absent) => CodeRule::Groups {
                groups: bytes(&groups.value),
                ends: self
                    .ends
                    .valid()
                    .map(|ends| bytes(&ends.value))
                    .unwrap_or_default(),
                separator: self.separator.or(String::new())?,
                origin,
            },
            (OptionalKey::Absent, OptionalKey::Valid(form)) => match form.value {
                CodeForm::Hexadecimal => CodeRule::Hexadecimal(origin),
                CodeForm::Linear => CodeRule::Linear {
                    separator: self.separator.clone().optional()?,
                    group: self.group()?,
                    number: self.number()?,
                    offset: self.offset()?,
                    origin,
                },
            },
            _ => return None,
        })
    }
}

/// `given` has no effect here: it belongs to groups.
fn groups_only<T>(key: &str, given: &OptionalKey<T>, problems: &mut Vec<Problem>) {
    if let OptionalKey::Valid(LocatedValue { location, .. }) = given {
        let problem = location.problem(format!("`{key}` applies to `groups` only"));
        problems.push(problem.right("leave it out"));
    }
}

/// `given` has no effect here: it belongs to a linear rule with groups.
fn linear_only(key: &str, given: &OptionalKey<i32>, problems: &mut Vec<Problem>) {
    if let OptionalKey::Valid(LocatedValue { location, .. }) = given {
        let what = format!("`{key}` applies to `form = \"linear\"` only");
        let what = if key == "group" {
            format!("{what}, with a `separator`")
        } else {
            what
        };
        problems.push(location.problem(what).right("leave it out"));
    }
}
