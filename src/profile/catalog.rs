//! Models by their identifiers, from the texts that are built in.

use super::check;
use super::model::Model;
use crate::domain::problem::Problem;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Models, none twice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Catalog {
    models: BTreeMap<String, Arc<Model>>,
}

impl Catalog {
    /// The models of `texts`, which are pairs of a file's name and its text.
    ///
    /// # Errors
    /// All problems of all texts, each with the name of its file: what [`check::model`] refuses, and an
    /// identifier that an earlier text has.
    pub fn from_texts<'a>(texts: impl IntoIterator<Item = (&'a str, &'a str)>) -> Result<Self, Vec<(String, Problem)>> {
        let mut catalog = Self::default();
        let mut all = Vec::new();
        for (file, text) in texts {
            let problems = match check::model(text) {
                Ok(model) => catalog.add(model).err().into_iter().collect(),
                Err(problems) => problems,
            };
            all.extend(problems.into_iter().map(|problem| (file.to_owned(), problem)));
        }
        if all.is_empty() { Ok(catalog) } else { Err(all) }
    }

    /// The model called `id`.
    #[must_use]
    pub fn find(&self, id: &str) -> Option<&Arc<Model>> {
        self.models.get(id)
    }

    /// The identifiers, in alphabetical order.
    pub fn ids(&self) -> impl Iterator<Item = &str> {
        self.models.keys().map(String::as_str)
    }

    fn add(&mut self, model: Model) -> Result<(), Problem> {
        if self.models.contains_key(&model.id) {
            let what = format!("another model is called `{}`", model.id);
            return Err(Problem::new("id", 0..0, what).right("an identifier of its own"));
        }
        self.models.insert(model.id.clone(), Arc::new(model));
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
    fn problems_of_all_texts_are_told_with_their_files() {
        let problems = Catalog::from_texts([("a", "x ="), ("b", MODEL), ("c", MODEL)]).unwrap_err();
        let told: Vec<_> = problems.iter().map(|(file, problem)| (file.as_str(), problem.key.as_str())).collect();
        assert_eq!(told, [("a", ""), ("c", "id")]);
    }
}
