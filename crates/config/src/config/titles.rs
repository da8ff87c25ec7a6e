//! What people call the gateway, its lines, drives and groups.

use super::file::ConfigFile;
use super::lists;
use crate::domain::ids::Name;
use crate::domain::problem::Problem;
use crate::north::titles::{PartTitle, PlantTitles};
use crate::toml_file::{LocatedValue, RequiredKey};
use std::collections::BTreeMap;

/// The titles of the parts of `file`. One that is invalid is left out, and reported where it is read.
pub(super) fn settle(file: &ConfigFile, problems: &mut Vec<Problem>) -> PlantTitles {
    let names = file.groups.iter().filter_map(|group| group.name.as_ref());
    lists::names_differ(names.clone(), "group", problems);
    for name in names {
        if file
            .drives()
            .all(|it| it.group.valid_as(&name.value).is_none())
        {
            let what = format!("no drive is in the group `{}`", name.value);
            let right = "the name of a `group` in a `[[line.drive]]`, or no `[[group]]`";
            name.warn(what, right, problems);
        }
    }
    let lines = file.lines.iter();
    let groups = file.groups.iter();
    PlantTitles {
        drives: by_name(file.drives().map(|it| (&it.name, it.title.valid()))),
        gateway: file.gateway.title.valid().map(|it| it.value.clone()),
        groups: by_name(groups.map(|it| (&it.name, it.title.as_ref()))),
        lines: by_name(lines.map(|it| (&it.name, it.title.valid()))),
    }
}

/// The titles of those that have one.
fn by_name<'a>(
    parts: impl Iterator<Item = (&'a RequiredKey<Name>, Option<&'a LocatedValue<PartTitle>>)>,
) -> BTreeMap<String, PartTitle> {
    let titled = parts.filter_map(|(name, title)| name.as_ref().zip(title));
    titled
        .map(|(name, title)| (name.value.to_string(), title.value.clone()))
        .collect()
}
