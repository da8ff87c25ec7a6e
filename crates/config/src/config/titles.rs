//! What people call the gateway, its lines, drives and groups.

use super::file::ConfigFile;
use super::lists;
use crate::domain::ids::Name;
use crate::domain::problem::Problem;
use crate::north::titles::{PartTitle, PlantTitles, as_seen};
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
    let drives: Vec<_> = file
        .drives()
        .map(|it| (&it.name, it.title.valid()))
        .collect();
    let groups = file.groups.iter().map(|it| (&it.name, it.title.as_ref()));
    let groups: Vec<_> = groups.collect();
    let lines = file.lines.iter().map(|it| (&it.name, it.title.valid()));
    let lines: Vec<_> = lines.collect();
    for (parts, kind) in [(&drives, "drive"), (&groups, "group"), (&lines, "line")] {
        titles_differ(parts, kind, problems);
    }
    PlantTitles {
        drives: by_name(&drives),
        gateway: file.gateway.title.valid().map(|it| it.value.clone()),
        groups: by_name(&groups),
        lines: by_name(&lines),
    }
}

/// The name and the title of a part.
type TitledPart<'a> = (&'a RequiredKey<Name>, Option<&'a LocatedValue<PartTitle>>);

/// Reports each title that looks like the name or an earlier title of another part: a person would go to the wrong motor.
fn titles_differ(parts: &[TitledPart<'_>], kind: &str, problems: &mut Vec<Problem>) {
    let named = parts
        .iter()
        .filter_map(|(name, title)| Some((name.as_ref()?.value.as_str(), title)));
    let mut taken: BTreeMap<_, _> = named
        .clone()
        .map(|(name, _)| (as_seen(name), name))
        .collect();
    for (name, title) in named {
        let Some(title) = title else {
            continue;
        };
        let other = *taken.entry(as_seen(title.value.as_str())).or_insert(name);
        if other != name {
            let what = format!("another {kind}, `{other}`, has this name or title already");
            let right = format!("a title of its own for each {kind}");
            title.refuse(what, right, problems);
        }
    }
}

/// The titles of those that have one.
fn by_name(parts: &[TitledPart<'_>]) -> BTreeMap<String, PartTitle> {
    let titled = parts
        .iter()
        .filter_map(|(name, title)| name.as_ref().zip(*title));
    titled
        .map(|(name, title)| (name.value.to_string(), title.value.clone()))
        .collect()
}
