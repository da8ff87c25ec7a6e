//! `[codes]`: how the vendor's codes and the addresses go together.

use super::facts::{Facts, Origin, fact};
use crate::domain::problem::Problem;
use crate::profile::model::CodeRule;
use crate::profile::reader::{Given, Place, Reader, Written};
use crate::profile::values::Kind;

/// What a rule may say of its form.
const FORMS: [(&str, ()); 1] = [("hexadecimal", ())];

/// `[codes]`
pub(in crate::profile) struct CodesFile {
    form: Option<CodesForm>,
    origin: Option<Origin>,
}

enum CodesForm {
    Hexadecimal,
    Groups { groups: Vec<(String, u8)>, separator: Given<String> },
}

impl CodesFile {
    pub(super) fn read(facts: &Facts<'_>, mut reader: Reader<'_, '_>) -> Self {
        let groups = reader.table("groups");
        let form = reader.optional("form", &Kind::one_of(&FORMS));
        let separator = reader.optional("separator", &Kind::parsed("text", |text| Some(text.to_owned())));
        let place = reader.place().clone();
        let form = match (groups, form) {
            (Given::Usable(section), Given::LeftOut) => {
                let groups = read_groups(reader.open(section.value));
                Some(CodesForm::Groups { groups, separator })
            }
            (Given::LeftOut, Given::Usable(_)) => {
                no_separator(&separator, reader.problems());
                Some(CodesForm::Hexadecimal)
            }
            (Given::Unusable, Given::LeftOut) | (Given::LeftOut, Given::Unusable) => None,
            (Given::LeftOut, Given::LeftOut) => no_form(&place, "says no rule", reader.problems()),
            _ => no_form(&place, "says two rules", reader.problems()),
        };
        let codes = Self { form, origin: facts.origin(&mut reader) };
        reader.finish();
        codes
    }

    /// Nothing where any part cannot be used.
    pub fn ready(&self) -> Option<CodeRule> {
        let origin = fact((), self.origin.as_ref())?;
        Some(match self.form.as_ref()? {
            CodesForm::Hexadecimal => CodeRule::Hexadecimal(origin),
            CodesForm::Groups { groups, separator } => {
                CodeRule::Groups { groups: groups.clone(), separator: separator.or(String::new())?, origin }
            }
        })
    }
}

fn read_groups(mut reader: Reader<'_, '_>) -> Vec<(String, u8)> {
    let place = reader.place().clone();
    if reader.is_empty() {
        reader.problems().push(place.problem("is empty").right("at least one group with its high byte"));
    }
    let groups = reader.all(&Kind::number(0..=u8::MAX));
    groups.into_iter().map(|(name, byte)| (name, byte.value)).collect()
}

fn no_separator(separator: &Given<String>, problems: &mut Vec<Problem>) {
    if let Given::Usable(Written { place, .. }) = separator {
        problems.push(place.problem("a separator stands between group and number").right("leave it out"));
    }
}

fn no_form(place: &Place, what: &str, problems: &mut Vec<Problem>) -> Option<CodesForm> {
    problems.push(place.problem(what).right("either `groups` or `form = \"hexadecimal\"`"));
    None
}
