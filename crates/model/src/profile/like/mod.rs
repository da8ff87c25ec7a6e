//! `like` and `without`: a model file that begins from another model and says what differs.
//!
//! The tables of both files are merged before they are read, so that every check sees the whole. What is taken over keeps
//! its documents and is graded for the new model. Locations of what is taken over lie behind the end of the file's own
//! text; [`WholeFile::placed`] reports its mistakes at `like`, with file and line.

mod grade;
mod overlay;
#[cfg(test)]
mod tests;

#[cfg(test)]
pub(super) use overlay::ROWS;
pub(super) use overlay::row_of;

use crate::domain::problem::{Problem, alternatives, nearest_names};
use crate::toml_file::declare::{declare_table, list, optional};
use crate::toml_file::values::ValueKind;
use crate::toml_file::{
    KeyLocation, LocatedValue, OptionalKey, TableReader, TomlDocument, document, written,
};
use std::iter;
use toml::de::DeTable;

/// Most files that one file may begin from, one after the other.
const DEPTH_MAX: usize = 4;

/// The text of a model file.
#[derive(Clone, Copy, Debug)]
pub(super) struct ModelText<'s> {
    pub file: &'s str,
    pub text: &'s str,
}

/// The model files that others may begin from.
pub(super) trait ModelTexts {
    /// The file of the model `id`.
    fn find(&self, id: &str) -> Option<ModelText<'_>>;
    /// All identifiers.
    fn ids(&self) -> Vec<String>;
}

/// No other models.
pub(super) struct NoOtherModels;

impl ModelTexts for NoOtherModels {
    fn find(&self, _: &str) -> Option<ModelText<'_>> {
        None
    }

    fn ids(&self) -> Vec<String> {
        Vec::new()
    }
}

declare_table! {
    /// The keys `like` and `without`.
    LikeFile is "" {
        /// The `id` of another model that this file begins from: then it says only what differs. See
        /// [below](#a-file-that-begins-from-another-model).
        like: OptionalKey<String> = optional(ValueKind::text());
        /// With `like`: what is left out of the other model, as `"watchdog"`, `"run.coast"`, `"register.torque"` or `"trip.7"`.
        without: OptionalKey<Vec<LocatedValue<String>>> = list(ValueKind::text());
    }
}

/// A file with what it takes over from others.
pub(super) struct WholeFile<'s> {
    document: TomlDocument<'s>,
    /// Where it says what it begins from, and the file of that model.
    base: Option<(KeyLocation, ModelText<'s>)>,
    /// The texts that it takes over from, each with where it lies behind its own.
    parts: Vec<(usize, ModelText<'s>)>,
}

impl<'s> WholeFile<'s> {
    /// Reads `text` and the files of `sources` that it begins from. `None`: there is no whole, and why is reported.
    pub(super) fn read(
        text: &'s str,
        sources: &'s dyn ModelTexts,
        problems: &mut Vec<Problem>,
    ) -> Option<Self> {
        Self::after(text, sources, &[], problems)
    }

    /// Reads `text`, from which the models `on_way` begin, and the files of `sources` that it begins from. `None`:
    /// there is no complete file, and why is reported.
    fn after(
        text: &'s str,
        sources: &'s dyn ModelTexts,
        on_way: &[String],
        problems: &mut Vec<Problem>,
    ) -> Option<Self> {
        let mut own = document(text, problems)?.into_table();
        let LikeFile { like, without } = taken_out(&mut own, problems);
        let like = match like {
            OptionalKey::Valid(like) => like,
            OptionalKey::Invalid => return None,
            OptionalKey::Absent => {
                if let OptionalKey::Valid(without) = without {
                    let problem = without.location.problem("there is nothing to leave out");
                    problems.push(problem.right("`like`, the model that this file begins from"));
                }
                return Some(Self {
                    document: TomlDocument::of(own),
                    base: None,
                    parts: Vec::new(),
                });
            }
        };
        let id = own
            .get("id")
            .and_then(|id| id.get_ref().as_str())
            .unwrap_or_default()
            .to_owned();
        let way: Vec<_> = on_way.iter().cloned().chain([id.clone()]).collect();
        let source = base_of(&like, &way, sources, problems)?;
        let mut of_base = Vec::new();
        let base = Self::after(source.text, sources, &way, &mut of_base);
        let start = text.len() + 1;
        let inherited = base
            .iter()
            .flat_map(|base| &base.parts)
            .map(|(at, part)| (at + start, *part));
        let parts: Vec<_> = iter::once((start, source)).chain(inherited).collect();
        let whole = |document| Self {
            document,
            base: Some((like.location.clone(), source)),
            parts,
        };
        let Some(base) = base else {
            let there = of_base.into_iter().map(|problem| Problem {
                span: problem.span.start + start..problem.span.end + start,
                ..problem
            });
            problems.extend(whole(TomlDocument::of(DeTable::new())).placed(there.collect()));
            return None;
        };
        let mut base = written::moved(base.document.into_table(), start);
        grade::take_over(&mut base, &like.value, &own, &id, problems);
        if let OptionalKey::Valid(without) = without {
            overlay::remove(&mut base, &without.value, &like.value, problems);
        }
        Some(whole(TomlDocument::of(overlay::merged(own, base))))
    }

    /// The table.
    pub(super) const fn document(&self) -> &TomlDocument<'s> {
        &self.document
    }

    /// The file with all that it takes over, as one complete text.
    pub(super) fn text(self) -> String {
        written::text_of(&self.document.into_table())
    }

    /// The file that it begins from.
    pub(super) fn base(&self) -> Option<ModelText<'s>> {
        self.base.as_ref().map(|(_, source)| *source)
    }

    /// `problems`, with those of what is taken over at `like`.
    pub(super) fn placed(&self, problems: Vec<Problem>) -> Vec<Problem> {
        let at_like = |problem: Problem| {
            let Some((like, _)) = &self.base else {
                return problem;
            };
            let part = self
                .parts
                .iter()
                .rfind(|(start, _)| *start <= problem.span.start);
            let Some((start, ModelText { file, text })) = part else {
                return problem;
            };
            let there = Problem {
                span: problem.span.start - start..problem.span.end - start,
                ..problem.clone()
            };
            let what = format!("{file}, line {}: {}", there.place_in(text).0, problem.what);
            let right = problem.right.map(|right| format!("{right}; or `without`"));
            Problem {
                key: like.key.clone(),
                span: like.span.clone(),
                what,
                right,
                ..problem
            }
        };
        problems.into_iter().map(at_like).collect()
    }

    /// One problem in place of the mistakes that the model has by itself.
    pub(super) fn base_has_mistakes(&self) -> Option<Problem> {
        let (like, source) = self.base.as_ref()?;
        let problem = like.problem(format!("{} has mistakes of its own", source.file));
        Some(problem.right("a model without mistakes"))
    }

    /// Whether `problem` is about what is taken over.
    pub(super) fn is_taken_over(&self, problem: &Problem) -> bool {
        self.parts
            .first()
            .is_some_and(|(start, _)| *start <= problem.span.start)
    }
}

/// The keys `like` and `without`, taken out of `table`.
fn taken_out(table: &mut DeTable<'_>, problems: &mut Vec<Problem>) -> LikeFile {
    let keys = ["like", "without"]
        .into_iter()
        .filter_map(|key| table.remove_entry(key));
    let document = TomlDocument::of(keys.collect());
    LikeFile::keys(&mut TableReader::new(document.section(), problems))
}

/// The file of the model that `like` names, for a file that the models on `way` begin from.
fn base_of<'s>(
    like: &LocatedValue<String>,
    way: &[String],
    sources: &'s dyn ModelTexts,
    problems: &mut Vec<Problem>,
) -> Option<ModelText<'s>> {
    let id = &like.value;
    let tell = |what: String, right: String| like.location.problem(what).right(right);
    if way.contains(id) {
        let way = way
            .iter()
            .chain([id])
            .map(String::as_str)
            .collect::<Vec<_>>()
            .join(", ");
        problems.push(tell(
            format!("leads back to itself: {way}"),
            "a model that begins from another one".to_owned(),
        ));
        return None;
    }
    if way.len() > DEPTH_MAX {
        let what = format!(
            "begins from more than {DEPTH_MAX} models, one after the other: {}",
            way.join(", ")
        );
        problems.push(tell(
            what,
            "a complete file, as `models show MODEL --toml` prints it".to_owned(),
        ));
        return None;
    }
    let source = sources.find(id);
    if source.is_none() {
        let ids = sources.ids();
        let near = nearest_names(id, ids.iter().map(String::as_str));
        let right = match alternatives(
            &near
                .iter()
                .map(|near| format!("`{near}`"))
                .collect::<Vec<_>>(),
        ) {
            near if near.is_empty() => {
                "the `id` of a model that is built in or in the same directories".to_owned()
            }
            near => near,
        };
        problems.push(tell(format!("there is no model `{id}`"), right));
    }
    source
}
