//! Files that use each other in a circle.

use super::source::Source;
use std::collections::{BTreeMap, BTreeSet};

/// Steps from a re-export to what it names.
const EXPORTS_MAX: usize = 8;

/// Which file uses which, in `src/`.
pub struct Uses<'s> {
    sources: &'s [Source],
    files: BTreeMap<Vec<&'s str>, usize>,
    /// The files that each file uses, with the first name by which it does.
    used: Vec<BTreeMap<usize, String>>,
}

impl<'s> Uses<'s> {
    pub fn of(sources: &'s [Source]) -> Self {
        let files = sources
            .iter()
            .enumerate()
            .map(|(at, source)| (source.modules(), at))
            .collect();
        let mut uses = Self {
            sources,
            files,
            used: Vec::new(),
        };
        uses.used = (0..sources.len()).map(|file| uses.used_by(file)).collect();
        uses
    }

    fn used_by(&self, file: usize) -> BTreeMap<usize, String> {
        let source = &self.sources[file];
        let mut used = BTreeMap::new();
        // What a folder's file only hands on, it does not use.
        for (_, path) in source
            .paths
            .iter()
            .filter(|(_, path)| !source.exports.contains(path))
        {
            if let Some(other) = self
                .file_of(file, path, EXPORTS_MAX)
                .filter(|other| *other != file)
            {
                used.entry(other)
                    .or_insert_with(|| path.last().cloned().unwrap_or_default());
            }
        }
        used
    }

    /// The file that defines what `path` names in `file`; `None` if it is not of this crate.
    fn file_of(&self, file: usize, path: &[String], exports: usize) -> Option<usize> {
        if path.len() == 1 {
            // A name of the file itself, or `pub(super)`.
            return None;
        }
        let source = &self.sources[file];
        let mut module = source.modules();
        let supers = path.iter().take_while(|part| *part == "super").count();
        let rest = match path[0].as_str() {
            "crate" | "vfd_gateway" => {
                module.clear();
                &path[1..]
            }
            "self" => &path[1..],
            "super" => {
                module.truncate(module.len().checked_sub(supers)?);
                &path[supers..]
            }
            first => {
                module.push(first);
                self.files.contains_key(&module).then(|| module.pop())?;
                path
            }
        };
        let (found, rest) = self.descend(&module, rest)?;
        let Some(name) = rest.first().filter(|_| exports > 0) else {
            return Some(found);
        };
        let export = self.sources[found]
            .exports
            .iter()
            .find(|export| export.last() == Some(name));
        export
            .and_then(|export| self.file_of(found, export, exports - 1))
            .or(Some(found))
    }

    /// The file that is the longest beginning of `path` below `module`, and what is left of the path.
    fn descend<'p>(&self, module: &[&'s str], path: &'p [String]) -> Option<(usize, &'p [String])> {
        let mut module: Vec<&str> = module.to_vec();
        let mut found = self.files.get(&module).map(|file| (*file, path));
        for (at, part) in path.iter().enumerate() {
            module.push(part);
            let Some(file) = self.files.get(&module) else {
                break;
            };
            found = Some((*file, &path[at + 1..]));
        }
        found
    }

    fn reached_from(&self, file: usize) -> BTreeSet<usize> {
        let mut reached = BTreeSet::new();
        let mut open = vec![file];
        while let Some(file) = open.pop() {
            open.extend(
                self.used[file]
                    .keys()
                    .filter(|other| reached.insert(**other)),
            );
        }
        reached
    }

    /// The circles of more than `most` files, each with its arrows.
    pub fn circles(&self, most: usize) -> Vec<String> {
        let reached: Vec<_> = (0..self.sources.len())
            .map(|file| self.reached_from(file))
            .collect();
        let mut seen = BTreeSet::new();
        let mut circles = Vec::new();
        for file in 0..self.sources.len() {
            let circle: BTreeSet<_> = reached[file]
                .iter()
                .filter(|it| reached[**it].contains(&file))
                .copied()
                .collect();
            if circle.len() > most && seen.insert(circle.clone()) {
                circles.push(self.described(&circle));
            }
        }
        circles
    }

    fn described(&self, circle: &BTreeSet<usize>) -> String {
        let name = |file: usize| &self.sources[file].path;
        let arrows = circle.iter().flat_map(|file| {
            let others = self.used[*file]
                .iter()
                .filter(|(other, _)| circle.contains(other));
            others.map(|(other, used)| format!("\n  {} -> {}: {used}", name(*file), name(*other)))
        });
        format!(
            "a circle of {} files:{}",
            circle.len(),
            arrows.collect::<String>()
        )
    }
}

#[test]
fn circles_are_found_through_re_exports() {
    let sources = [
        Source::new("src/a/mod.rs", "pub use one::One;\npub use two::Two;"),
        Source::new("src/a/one.rs", "use super::Two;"),
        Source::new("src/a/two.rs", "use crate::b::Three;"),
        Source::new(
            "src/b.rs",
            "fn f(x: crate::a::One) {}\n#[cfg(test)]\nuse crate::a::Four;",
        ),
        Source::new("src/c.rs", "use crate::b;"),
    ];
    let uses = Uses::of(&sources);
    assert_eq!(
        uses.circles(2),
        [
            "a circle of 3 files:\n  src/a/one.rs -> src/a/two.rs: Two\n  src/a/two.rs -> src/b.rs: Three\n  \
          src/b.rs -> src/a/one.rs: One"
        ]
    );
    assert_eq!(uses.circles(3), [""; 0]);
}
