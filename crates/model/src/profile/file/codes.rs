//! `[codes]`: how the vendor's codes map to addresses.

use super::facts::{FactReader, Origin, fact};
use crate::domain::problem::Problem;
use crate::profile::model::CodeRule;
use crate::toml_file::values::ValueKind;
use crate::toml_file::{KeyLocation, LocatedValue, OptionalKey, TableReader, TomlSection};

/// Values of `form`.
const FORMS: [(&str, CodeForm); 2] = [
    ("hexadecimal", CodeForm::Hexadecimal),
    ("linear", CodeForm::Linear),
];

#[derive(Clone, Copy, PartialEq, Eq)]
enum CodeForm {
    Hexadecimal,
    Linear,
}

/// `[codes]`
pub(in crate::profile) struct CodesFile {
    form: Option<CodesForm>,
    origin: Option<Origin>,
}

enum CodesForm {
    Hexadecimal,
    Linear {
        separator: OptionalKey<String>,
        group: OptionalKey<i32>,
        number: OptionalKey<i32>,
        offset: OptionalKey<i32>,
    },
    Groups {
        groups: Vec<(String, u8)>,
        ends: Vec<(String, u8)>,
        separator: OptionalKey<String>,
    },
}

impl CodesFile {
    pub(super) fn read(facts: &FactReader<'_>, mut reader: TableReader<'_, '_>) -> Self {
        let groups = reader.table("groups");
        let ends = reader.table("ends");
        let form = reader.optional("form", &ValueKind::one_of(&FORMS));
        let separator = reader.optional(
            "separator",
            &ValueKind::parsed("text", |text| Some(text.to_owned())),
        );
        let distance = ValueKind::number(1..=10_000_i32);
        let group = reader.optional("group", &distance);
        let number = reader.optional("number", &distance);
        let offset = reader.optional("offset", &ValueKind::number(-50_000..=50_000_i32));
        let location = reader.location().clone();
        let is_linear = form
            .valid()
            .is_some_and(|form| form.value == CodeForm::Linear);
        if !is_linear {
            for (key, given) in [("group", &group), ("number", &number), ("offset", &offset)] {
                linear_only(key, given, reader.problems());
            }
        } else if matches!(
            (&separator, &group),
            (OptionalKey::Absent, OptionalKey::Valid(_))
        ) {
            linear_only("group", &group, reader.problems());
        }
        let form = match (groups, form) {
            (OptionalKey::Absent, OptionalKey::Valid(_)) if is_linear => Some(CodesForm::Linear {
                separator,
                group,
                number,
                offset,
            }),
            (OptionalKey::Valid(section), OptionalKey::Absent) => {
                let groups = read_groups(reader.open(section.value));
                let ends = read_ends(ends, &groups, &mut reader);
                Some(CodesForm::Groups {
                    groups,
                    ends,
                    separator,
                })
            }
            (OptionalKey::Absent, OptionalKey::Valid(_)) => {
                no_separator(&separator, reader.problems());
                if let OptionalKey::Valid(LocatedValue { location, .. }) = &ends {
                    reader.problems().push(
                        location
                            .problem("`ends` applies to `groups` only")
                            .right("leave it out"),
                    );
                }
                Some(CodesForm::Hexadecimal)
            }
            (OptionalKey::Invalid, OptionalKey::Absent)
            | (OptionalKey::Absent, OptionalKey::Invalid) => None,
            (OptionalKey::Absent, OptionalKey::Absent) => {
                no_form(&location, "has no rule", reader.problems())
            }
            _ => no_form(&location, "has two rules", reader.problems()),
        };
        let codes = Self {
            form,
            origin: facts.origin(&mut reader),
        };
        reader.finish();
        codes
    }

    /// `None` if any part is unusable.
    pub fn ready(&self) -> Option<CodeRule> {
        let origin = fact((), self.origin.as_ref())?;
        Some(match self.form.as_ref()? {
            CodesForm::Hexadecimal => CodeRule::Hexadecimal(origin),
            CodesForm::Linear {
                separator,
                group,
                number,
                offset,
            } => CodeRule::Linear {
                separator: separator.clone().optional()?,
                group: group.or(100)?,
                number: number.or(1)?,
                offset: offset.or(0)?,
                origin,
            },
            CodesForm::Groups {
                groups,
                ends,
                separator,
            } => CodeRule::Groups {
                groups: groups.clone(),
                ends: ends.clone(),
                separator: separator.or(String::new())?,
                origin,
            },
        })
    }
}

fn read_groups(mut reader: TableReader<'_, '_>) -> Vec<(String, u8)> {
    let location = reader.location().clone();
    if reader.is_empty() {
        reader.problems().push(
            location
                .problem("is empty")
                .right("at least one group with its high byte"),
        );
    }
    let groups = reader.all(&ValueKind::number(0..=u8::MAX));
    groups
        .into_iter()
        .map(|(name, byte)| (name, byte.value))
        .collect()
}

/// The last number of each group that ends early; each must be one of `groups`.
fn read_ends<'a>(
    ends: OptionalKey<TomlSection<'a>>,
    groups: &[(String, u8)],
    reader: &mut TableReader<'a, '_>,
) -> Vec<(String, u8)> {
    let OptionalKey::Valid(LocatedValue { value: section, .. }) = ends else {
        return Vec::new();
    };
    let ends = reader.open(section).all(&ValueKind::number(0..=u8::MAX));
    for (name, end) in &ends {
        if !groups.iter().any(|(group, _)| group == name) {
            let problem = end.location.problem(format!("there is no group `{name}`"));
            reader.problems().push(problem.right("one of `groups`"));
        }
    }
    ends.into_iter()
        .map(|(name, end)| (name, end.value))
        .collect()
}

fn no_separator(separator: &OptionalKey<String>, problems: &mut Vec<Problem>) {
    if let OptionalKey::Valid(LocatedValue { location, .. }) = separator {
        problems.push(
            location
                .problem("`separator` applies to `groups` only")
                .right("leave it out"),
        );
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

fn no_form(location: &KeyLocation, what: &str, problems: &mut Vec<Problem>) -> Option<CodesForm> {
    problems.push(
        location
            .problem(what)
            .right("either `groups` or `form`, \"hexadecimal\" or \"linear\""),
    );
    None
}
