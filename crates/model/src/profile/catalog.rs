//! The built-in and user-supplied models, by identifier.

use super::check;
use super::like::{ModelText, ModelTexts, WholeFile};
use super::model::Model;
use crate::domain::problem::Problem;
use crate::toml_file::{self, KeyLocation};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

/// Models with unique identifiers. Copies share them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Catalog {
    models: BTreeMap<String, Arc<CatalogEntry>>,
}

/// A model file, and its model once it was asked for.
#[derive(Debug, PartialEq)]
struct CatalogEntry {
    file: Cow<'static, str>,
    text: Cow<'static, str>,
    /// `None`: the file is not valid.
    model: OnceLock<Option<Arc<Model>>>,
}

/// The files of a catalog, and those that are about to join it.
struct CatalogFiles<'c> {
    catalog: &'c Catalog,
    new: &'c [(String, String)],
}

impl ModelTexts for CatalogFiles<'_> {
    fn find(&self, id: &str) -> Option<ModelText<'_>> {
        let known = self.catalog.models.get(id).map(|entry| ModelText {
            file: &entry.file,
            text: &entry.text,
        });
        let new = || {
            self.new
                .iter()
                .find(|(_, text)| id_of(text).as_deref() == Some(id))
        };
        known.or_else(|| new().map(|(file, text)| ModelText { file, text }))
    }

    fn ids(&self) -> Vec<String> {
        let known = self.catalog.ids().map(str::to_owned);
        known
            .chain(self.new.iter().filter_map(|(_, text)| id_of(text)))
            .collect()
    }
}

/// The identifier that a model file states, whether or not the rest of it is sound.
#[must_use]
pub fn id_of(text: &str) -> Option<String> {
    let document = toml_file::document(text, &mut Vec::new())?;
    document
        .section()
        .table
        .get("id")?
        .get_ref()
        .as_str()
        .map(str::to_owned)
}

/// The identifier of the model that is built in as `file`: `maker-series` in `maker/series.toml`.
fn built_in_id(file: &str) -> String {
    file.strip_suffix(".toml").unwrap_or(file).replace('/', "-")
}

/// Identifies the content of a sound model file: the CRC of its lines without comments and empty ones, and of those of the
/// file from which it begins.
fn digest(text: &str, files: &CatalogFiles<'_>) -> u64 {
    const CRC: crc::Crc<u64> = crc::Crc::<u64>::new(&crc::CRC_64_XZ);
    let mut digest = CRC.digest();
    for line in text
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
    {
        digest.update(line.as_bytes());
        digest.update(b"\n");
    }
    let may_begin_from_another = text
        .lines()
        .any(|line| line.trim_start().starts_with("like"));
    let whole = may_begin_from_another
        .then(|| WholeFile::read(text, files, &mut Vec::new()))
        .flatten();
    if let Some(base) = whole.as_ref().and_then(WholeFile::base) {
        digest.update(&self::digest(base.text, files).to_le_bytes());
    }
    digest.finalize()
}

/// The model in `text` with its digest, and where its identifier is.
fn read(text: &str, files: &CatalogFiles<'_>) -> Result<(Model, KeyLocation), Vec<Problem>> {
    let (model, id) = check::model_and_id(text, files)?;
    Ok((
        Model {
            digest: digest(text, files),
            ..model
        },
        id,
    ))
}

impl Catalog {
    /// The models of `texts`, pairs of file name and content, which are known to be sound. Each is read when it is first
    /// asked for, so that many models cost a start nothing. They are named after their files.
    #[must_use]
    pub fn of_sound(texts: &[(&'static str, &'static str)]) -> Self {
        let entry = |(file, text): &(&'static str, &'static str)| {
            (
                built_in_id(file),
                Arc::new(CatalogEntry {
                    file: (*file).into(),
                    text: (*text).into(),
                    model: OnceLock::new(),
                }),
            )
        };
        Self {
            models: texts.iter().map(entry).collect(),
        }
    }

    /// The models of `texts`, pairs of file name and content.
    ///
    /// # Errors
    /// As [`Self::with_texts`].
    pub fn from_texts<'a>(
        texts: impl IntoIterator<Item = (&'a str, &'a str)>,
    ) -> Result<Self, Vec<(String, Problem)>> {
        Self::default().with_texts(texts)
    }

    /// Adds the models of `texts`, pairs of file name and content.
    ///
    /// # Errors
    /// All problems of all texts, each with its file name: whatever [`check::model`] refuses, and identifiers
    /// that are already in use.
    pub fn with_texts<F: Into<String>, T: AsRef<str>>(
        mut self,
        texts: impl IntoIterator<Item = (F, T)>,
    ) -> Result<Self, Vec<(String, Problem)>> {
        let new: Vec<_> = texts
            .into_iter()
            .map(|(file, text)| (file.into(), text.as_ref().to_owned()))
            .collect();
        let files = CatalogFiles {
            catalog: &self,
            new: &new,
        };
        let read: Vec<_> = new.iter().map(|(_, text)| read(text, &files)).collect();
        let mut all = Vec::new();
        for ((file, text), read) in new.into_iter().zip(read) {
            let added = read.and_then(|(model, id)| self.add(model, file.clone(), text, &id));
            all.extend(
                added
                    .err()
                    .into_iter()
                    .flatten()
                    .map(|problem| (file.clone(), problem)),
            );
        }
        if all.is_empty() { Ok(self) } else { Err(all) }
    }

    /// The model with identifier `id` as one complete file: as it is, or together with what it takes over from others.
    #[must_use]
    pub fn text_of(&self, id: &str) -> Option<String> {
        let text = &self.models.get(id)?.text;
        let files = CatalogFiles {
            catalog: self,
            new: &[],
        };
        let whole = WholeFile::read(text, &files, &mut Vec::new())?;
        Some(if whole.base().is_none() {
            text.to_string()
        } else {
            whole.text()
        })
    }

    /// The model with identifier `id`, if any.
    #[must_use]
    pub fn find(&self, id: &str) -> Option<&Arc<Model>> {
        let entry = self.models.get(id)?;
        let read = || {
            read(
                &entry.text,
                &CatalogFiles {
                    catalog: self,
                    new: &[],
                },
            )
            .ok()
        };
        entry
            .model
            .get_or_init(|| read().map(|(model, _)| Arc::new(model)))
            .as_ref()
    }

    /// All models, in the order of their identifiers.
    pub fn models(&self) -> impl Iterator<Item = &Arc<Model>> {
        self.ids().filter_map(|id| self.find(id))
    }

    /// The identifiers, in alphabetical order.
    pub fn ids(&self) -> impl Iterator<Item = &str> {
        self.models.keys().map(String::as_str)
    }

    fn add(
        &mut self,
        model: Model,
        file: String,
        text: String,
        id: &KeyLocation,
    ) -> Result<(), Vec<Problem>> {
        if let Some(taken) = self.models.get(&model.id) {
            let problem = id.problem(format!(
                "`{}` is already defined by {}",
                model.id, taken.file
            ));
            return Err(vec![problem.right("a unique identifier")]);
        }
        let id = model.id.clone();
        let model = OnceLock::from(Some(Arc::new(model)));
        self.models.insert(
            id,
            Arc::new(CatalogEntry {
                file: file.into(),
                text: text.into(),
                model,
            }),
        );
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::testing::MODEL;

    #[test]
    fn models_are_found_by_their_identifier() {
        let catalog = Catalog::from_texts([("acme.toml", MODEL)]).unwrap();
        assert_eq!(catalog.ids().collect::<Vec<_>>(), ["acme-1"]);
        assert_eq!(catalog.find("acme-1").unwrap().vendor, "Acme");
        assert!(catalog.find("acme-2").is_none());
    }

    #[test]
    fn a_built_in_model_is_read_when_it_is_asked_for_and_then_shared() {
        let like = include_str!("../../../../tests/golden/models/like.toml");
        let catalog = Catalog::of_sound(&[
            ("acme/1.toml", MODEL),
            ("acme/like.toml", like),
            ("acme/everything.toml", crate::profile::testing::EVERYTHING),
            ("acme/broken.toml", "id ="),
        ]);
        let is_read = |id: &str| catalog.models[id].model.get().is_some();
        assert_eq!(
            catalog.ids().collect::<Vec<_>>(),
            ["acme-1", "acme-broken", "acme-everything", "acme-like"]
        );
        assert!(catalog.ids().all(|id| !is_read(id)));
        let copy = catalog.clone();
        let model = copy.find("acme-1").unwrap();
        assert!(is_read("acme-1") && Arc::ptr_eq(model, catalog.find("acme-1").unwrap()));
        assert_eq!(catalog.find("acme-like").unwrap().id, "acme-like");
        assert!(!is_read("acme-everything"), "only its text was needed");
        assert!(catalog.find("acme-broken").is_none());
        let ids: Vec<_> = catalog.models().map(|model| model.id.as_str()).collect();
        assert_eq!(ids, ["acme-1", "acme-everything", "acme-like"]);

        let problems = catalog.with_texts([("own.toml", MODEL)]).unwrap_err();
        assert_eq!(
            problems[0].1.what,
            "`acme-1` is already defined by acme/1.toml"
        );
    }

    #[test]
    fn the_digest_follows_the_content_and_what_is_taken_over() {
        let built_in = |text: &str| Catalog::from_texts([("acme.toml", text)]).unwrap();
        let digest = |text: &str| built_in(text).find("acme-1").unwrap().digest;
        assert_eq!(digest(MODEL), digest(&format!("# a comment\n{MODEL}")));
        let other = MODEL.replacen("Acme", "Acme Drives", 1);
        assert_ne!(digest(MODEL), digest(&other));
        let like = |text: &str| {
            let own = [(
                "own.toml",
                "like = \"acme-1\"\nid = \"acme-2\"\ntitle = \"Two\"\n",
            )];
            built_in(text)
                .with_texts(own)
                .map(|it| it.find("acme-2").unwrap().digest)
        };
        assert_ne!(
            like(MODEL).unwrap(),
            like(&other).unwrap(),
            "a change of the other file is one of this model"
        );
    }

    #[test]
    fn problems_of_all_texts_are_reported_with_their_files() {
        let problems = Catalog::from_texts([("a", "x ="), ("b", MODEL), ("c", MODEL)]).unwrap_err();
        let reported: Vec<_> = problems
            .iter()
            .map(|(file, problem)| (file.as_str(), problem.key.as_str()))
            .collect();
        assert_eq!(reported, [("a", ""), ("c", "id")]);
    }

    #[test]
    fn files_of_a_user_join_those_that_are_there() {
        let built_in = Catalog::from_texts([("built-in/acme.toml", MODEL)]).unwrap();
        let text = |id: &str| MODEL.replacen("acme-1", id, 1);
        let own = |ids: [&str; 2]| ids.map(|id| (format!("own/{id}.toml"), text(id)));
        let joined = built_in
            .clone()
            .with_texts(own(["acme-2", "acme-3"]))
            .unwrap();
        assert_eq!(
            joined.ids().collect::<Vec<_>>(),
            ["acme-1", "acme-2", "acme-3"]
        );

        let problems = built_in.with_texts(own(["acme-2", "acme-1"])).unwrap_err();
        let [(file, problem)] = &problems[..] else {
            panic!("{problems:?}")
        };
        assert_eq!(
            (file.as_str(), problem.place_in(MODEL)),
            ("own/acme-1.toml", (1, 6))
        );
        assert_eq!(
            problem.what,
            "`acme-1` is already defined by built-in/acme.toml"
        );
    }
}
